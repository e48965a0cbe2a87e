"""The picture of a status: every calibration and verification of every arm over time."""

from datetime import date

from lab.commands.status.result import StatusResult
from lab.render.charts.axes import Axes
from lab.render.document import Picture
from lab.render.style import GRID, INK, MEASURED, MUTED, RMS, WORST
from lab.render.svg import axes_picture

__all__ = ["checks_picture"]

_MARKS = {
    "good": (RMS, "o"),
    "doubtful": (MEASURED, "^"),
    "bad": (WORST, "D"),
    "not judged": (MUTED, "s"),
}  # by verdict: they differ without colour, too
_ROW, _MOST_NAME = 0.24, 26  # inches of an arm; characters of its name
_MONTHS = (1, 2, 3, 6, 12, 24, 60, 120)  # between ticks
_MOST_TICKS = 8


def checks_picture(result: StatusResult) -> Picture:
    """Draw a row for each arm, the worst on top: a mark for each check, a stroke for each calibration."""
    arms = result.arms
    days = [(each, len(arms) - 1 - i) for i, arm in enumerate(arms) for each in arm.checks if each.on is not None]

    def draw(axes: Axes) -> None:
        for row in range(len(arms)):
            axes.axhline(row, color=GRID, linewidth=0.8)
        strokes = [(each.on.toordinal(), row) for each, row in days if each.on is not None and each.calibrates]
        if strokes:
            at, rows = zip(*strokes, strict=True)
            axes.plot(at, rows, "|", color=INK, markersize=15, label="calibration")
        for verdict, (colour, mark) in _MARKS.items():
            own = [(each.on.toordinal(), row) for each, row in days if each.on is not None and each.verdict == verdict]
            if own:
                at, rows = zip(*own, strict=True)
                axes.plot(at, rows, mark, color=colour, markersize=5, label=verdict)
        axes.axvline(result.on.toordinal(), color=MUTED, linewidth=1, linestyle=":")
        first = min((each.on for each, _ in days if each.on is not None), default=result.on)
        ticks = _ticks(first, result.on)
        axes.set_xticks([each.toordinal() for each in ticks], [f"{each:%Y-%m}" for each in ticks])
        names = [arm.called for arm in reversed(arms)]
        axes.set_yticks(range(len(arms)), [n if len(n) <= _MOST_NAME else f"{n[:_MOST_NAME]}…" for n in names])
        span = max(30, result.on.toordinal() - first.toordinal())
        left, right = first.toordinal() - 0.03 * span, result.on.toordinal() + 0.03 * span
        axes.set(xlim=(left, right), ylim=(-0.7, len(arms) + 0.6))
        axes.grid(visible=False)
        axes.legend(loc="upper left", ncols=5)

    label = f"Calibrations and verifications of {len(arms)} arms up to {result.on}, by verdict"
    widest = max((min(len(arm.called), _MOST_NAME) for arm in arms), default=0)
    return axes_picture("checks", label, (7.2, 1.1 + _ROW * len(arms)), draw, (0.35 + 0.075 * widest, 0.45, 0.2, 0.15))


def _ticks(first: date, last: date) -> list[date]:
    """Firsts of months between two days, at most eight."""
    months = [first.year * 12 + first.month - 1, last.year * 12 + last.month - 1]
    step = next((each for each in _MONTHS if (months[1] - months[0]) / each < _MOST_TICKS), _MONTHS[-1])
    start = -(-(months[0]) // step) * step
    return [date(at // 12, at % 12 + 1, 1) for at in range(start, months[1] + 1, step)]
