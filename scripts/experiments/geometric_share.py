"""What share of an arm's position error is geometric? Virtual arms with geometric errors and others at several levels.

Judd & Knasinski (1990) found about 95 % of the error of their arms to be geometric. Here the answer is known: the
same arms are calibrated by a geometric model with each other source of error alone, and with all of them, at sizes from
a quarter to eight times representative ones. What the model leaves is not geometric. Two shares are told: of the error,
1 - after / before, and of its square, 1 - (after / before)^2.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from shared import SERIES, Answer, Document, Flag, Table, drawing, paragraphs, run_script, save_figure
from study_runs import study_runner

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.core.significance import STUDY_COMPARISON
from lab.options.option_groups import Effects
from lab.report.style import MUTED, REFERENCE
from lab.studies.analysis import CampaignArray, resampled
from lab.studies.grid import NONE, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NEEDS = ("matplotlib",)

LEVELS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
SOURCES: Mapping[str, Effects] = {  # at level 1
    "compliance, 1e5 Nm/rad": Effects(stiffness_nm_per_rad=1e5, payload_kg=(0.0, 3.0)),
    "runout, 0.1 mrad": Effects(harmonic_mrad=0.1),
    "gear ratios, 50 ppm": Effects(gear_ppm=50.0),
    "backlash, 0.05 mrad": Effects(backlash_mrad=0.05),
    "repeatability, 0.01 mrad": Effects(repeatability_mrad=0.01),
}
ALL = "all of them"
PRINTED = 0.95
_HARDER = "stiffness_nm_per_rad"  # less of it is more of an error


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    robots: int = 100
    """Virtual arms."""
    draws: int = 5
    """Campaigns with each, that differ in the noise."""
    workers: int = 2
    """Processes."""
    out: Path = Path("runs/geometric-share")
    """Folder of the study and the picture; a study that is there goes on."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Share:
    """What a source at a level leaves to geometry.

    Attributes:
        before_mm, after_mm: mean errors on validation poses, with nominal links and with identified ones.
        share, lower, upper: of the error that is geometric, mean over the arms, with its 95 % interval.
        of_square: of the square of the error.
    """

    source: str
    level: float
    before_mm: float
    after_mm: float
    share: float
    lower: float
    upper: float
    of_square: float


def effects_at(effects: Effects, level: float) -> dict[str, object]:
    """The sizes of an effect's errors at a level, by option."""
    usual, found = Effects(), dict[str, object]()
    for each in fields(Effects):
        value = getattr(effects, each.name)
        if value == getattr(usual, each.name):
            continue
        size = isinstance(value, float)
        found[each.name] = value / level if each.name == _HARDER else level * value if size else value
    return found


def sets_of_effects() -> dict[str, Effects]:
    """By ``source @ level``: each source, and all together."""
    found: dict[str, Effects] = {}
    for level in LEVELS:
        every: dict[str, object] = {}
        for name, effects in SOURCES.items():
            asked = effects_at(effects, level)
            found[_key(name, level)] = Effects(**asked)  # type: ignore[arg-type]
            every |= asked
        found[_key(ALL, level)] = Effects(**every)  # type: ignore[arg-type]
    return found


def _key(name: str, level: float) -> str:
    return f"{name} @ {level:g}"


def shares(campaigns: CampaignArray) -> list[Share]:
    """Of the study's cells, the first of which has no effects."""
    before, after = (np.nanmean(campaigns.values(name), axis=2) for name in ("before_mm", "fresh_mean_mm"))  # (c, r)
    share, square = 1 - after / before, 1 - (after / before) ** 2
    found = resampled(share.T, campaigns.weights, STUDY_COMPARISON)
    return [
        Share(
            source=NONE if cell.effects == NONE else cell.effects.rsplit(" @ ", 1)[0],
            level=0.0 if cell.effects == NONE else float(cell.effects.rsplit(" @ ", 1)[1]),
            before_mm=float(np.nanmean(before[i])),
            after_mm=float(np.nanmean(after[i])),
            share=float(found.mean[i]),
            lower=float(found.lower[i]),
            upper=float(found.upper[i]),
            of_square=float(np.nanmean(square[i])),
        )
        for i, cell in enumerate(campaigns.cells)
    ]


def answer(options: Options) -> Answer:
    """Run the study, draw the shares against the level, and say where 95 % holds.

    Raises:
        LabError: there are fewer than two robots.
    """
    if options.robots < 2:
        raise LabError("give two --robots or more: a scatter is asked for")
    effects = sets_of_effects()
    factors = {"effects": (NONE, *effects), "criterion": ("random",), "poses": (60,)}
    study = Study("geometric-share", robots=options.robots, draws=options.draws, factors=factors, effects=effects)
    with study_runner(options.workers) as run:
        found = shares(run(study, options.out / study.name)[0])
    save_figure(options.out, "geometric_share", _picture(found))
    at = crossing([each for each in found if each.source == ALL])
    words = (
        f"With all sources together, {100 * PRINTED:g} % of the error is geometric where they have {at:.2g} times "
        f"these sizes; with larger ones less is. With none of them {100 * found[0].share:.2f} % is: the instrument's "
        "noise leaves the rest."
    )
    values = {"shares": [asdict(each) for each in found], "level_of_95": at, "words": words}
    lines = [words, f"picture: {options.out / 'geometric_share.png'}"]
    title = "What share of the error is geometric?"
    return Answer(values, Document(title, (_table(found), *paragraphs(lines))))


def crossing(together: Sequence[Share]) -> float:
    """The level at which the share falls to 95 %; infinite where it does not, zero where it never holds."""
    levels, share = (np.array([getattr(each, name) for each in together]) for name in ("level", "share"))
    if share[0] < PRINTED:
        return 0.0
    if share[-1] >= PRINTED:
        return float("inf")
    return float(np.exp(np.interp(-PRINTED, -share, np.log(levels))))


def _table(found: Sequence[Share]) -> Table:
    order = {name: i for i, name in enumerate((NONE, *SOURCES, ALL))}
    rows = tuple(
        (
            each.source,
            f"{each.level:g}",
            f"{each.before_mm:.3f}",
            f"{each.after_mm:.4f}",
            f"{100 * each.share:.1f} ({100 * each.lower:.1f} to {100 * each.upper:.1f})",
            f"{100 * each.of_square:.2f}",
        )
        for each in sorted(found, key=lambda each: (order[each.source], each.level))
    )
    heads = ("other errors", "times", "before, mm", "after, mm", "geometric, %", "of the square, %")
    return Table(heads, rows, "Mean errors on validation poses, with 95 % intervals over the arms")


def _picture(found: Sequence[Share]) -> "Figure":
    with drawing((7.5, 4.6)) as figure:
        axes = figure.add_subplot(xscale="log", title="Share of the position error that is geometric")
        for i, name in enumerate((*SOURCES, ALL)):
            rows = [each for each in found if each.source == name]
            middle, low, high = (
                100 * np.array([getattr(each, part) for each in rows]) for part in ("share", "lower", "upper")
            )
            colour = REFERENCE if name == ALL else SERIES[i % len(SERIES)][0]
            spread: Array = np.array([middle - low, high - middle])
            mark = "s--" if name == ALL else "o-"
            axes.errorbar(LEVELS, middle, spread, fmt=mark, color=colour, markersize=4, capsize=3, label=name)
        axes.axhline(100 * PRINTED, color=MUTED, linestyle=":", label="95 % (Judd & Knasinski 1990)")
        axes.set_xticks(LEVELS, [f"{level:g}" for level in LEVELS])
        axes.set_xticks([], minor=True)
        axes.set(xlabel="size of the other errors, times the one named", ylabel="geometric, %")
        axes.legend(loc="lower left")
    return figure


if __name__ == "__main__":
    run_script("geometric_share")
