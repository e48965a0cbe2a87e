"""What accuracy does an instrument buy, and how many poses make up for a cheaper one?

Virtual arms measured by each instrument from designed poses, few and many; the same arms, and judged on the same fresh
poses without noise: the mean error, and within what 95 % of the poses are.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from shared import FIGURE_STYLE, SERIES, Answer, Document, Flag, Table, paragraphs, run_script, save_figure

from lab.studies.analysis import Mean, means
from lab.studies.grid import Study
from lab.studies.progress import study_runner

INSTRUMENTS = ("uniform-8um", "leica-at960", "leica-at500", "faro-vantage", "optical-cmm")
METRICS = {"fresh_mean_mm": "mean", "fresh_p95_mm": "95 % of the poses are within"}
WANTED_MM = (0.01, 0.02, 0.05)
Curves = dict[str, list[tuple[int, Mean]]]  # by instrument: poses and mean


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    robots: int = 100
    """Virtual arms."""
    draws: int = 50
    """Campaigns with each, that differ in the noise."""
    poses: tuple[int, ...] = (15, 20, 30, 50, 100)
    """Numbers of poses, chosen anew for each instrument."""
    instruments: tuple[str, ...] = INSTRUMENTS
    """Which ones."""
    workers: int = 2
    """Processes."""
    out: Path = Path("runs/accuracy-versus-instrument")
    """Folder of the study and the picture; a study that is there goes on."""
    quick: Flag = False
    """10 arms, 10 draws, 15 and 30 poses."""
    json: Flag = False
    """Print one JSON object."""


def answer(options: Options) -> Answer:
    """Run the study, or go on with it, and draw it."""
    robots, draws, poses = (10, 10, (15, 30)) if options.quick else (options.robots, options.draws, options.poses)
    factors = {"instrument": options.instruments, "poses": tuple(sorted(poses))}
    study = Study(name="accuracy-versus-instrument", robots=robots, draws=draws, factors=factors)
    with study_runner(options.workers) as run:
        campaigns, _ = run(study, options.out / "study")
    curves = {metric: by_instrument(study, means(campaigns, metric)) for metric in METRICS}
    title = f"Which instrument, how many poses? {robots * draws:,} campaigns with {robots} arms at each point"
    save_figure(options.out, "instruments", instruments_figure({METRICS[m]: curves[m] for m in METRICS}, title))
    said = words(curves["fresh_p95_mm"])
    tables = (table(lines, METRICS[metric]) for metric, lines in curves.items())
    blocks = (*tables, *paragraphs([*said, f"picture: {options.out / 'instruments.png'}"]))
    return Answer({"rows": rows(curves), "words": said}, Document(title, blocks))


def by_instrument(study: Study, found: tuple[Mean, ...]) -> Curves:
    """Means in the order of the poses."""
    curves: Curves = {}
    for cell, mean in zip(study.cells, found, strict=True):
        curves.setdefault(cell.instrument, []).append((cell.poses, mean))
    return {name: sorted(points, key=lambda point: point[0]) for name, points in curves.items()}


def rows(curves: dict[str, Curves]) -> list[dict[str, object]]:
    """All means, as ``--json`` prints them."""
    return [
        {"metric": metric, "instrument": name, "poses": poses, **asdict(mean)}
        for metric, lines in curves.items()
        for name, points in lines.items()
        for poses, mean in points
    ]


def instruments_figure(curves: Mapping[str, Mapping[str, Sequence[tuple[int, Mean]]]], title: str) -> Figure:
    """Errors on validation poses (µm) against the number of poses, a line an instrument, a panel a metric.

    Args:
        curves: by what the panel shows, then by instrument: poses and means.
    """
    with matplotlib.rc_context(FIGURE_STYLE):
        figure = Figure(figsize=(11, 5), layout="constrained")
        grid = figure.subplots(1, len(curves), squeeze=False, sharey=True)[0]
        for axes, (words, lines) in zip(grid, curves.items(), strict=True):
            for (name, points), (colour, mark, dash) in zip(lines.items(), SERIES, strict=False):
                x = [poses for poses, _ in points]
                y, low, high = 1e3 * np.array([(mean.mean, mean.lower, mean.upper) for _, mean in points]).T
                axes.errorbar(x, y, [y - low, high - y], color=colour, marker=mark, linestyle=dash, markersize=5.5,
                              linewidth=1.5, capsize=3, label=name)  # fmt: skip
            axes.set(xscale="log", yscale="log", xlabel="number of poses", title=words)
            axes.set_xticks(x, [str(each) for each in x])
            axes.set_xticks([], minor=True)
        grid[0].set_ylabel("error on validation poses, µm")
        low, high = grid[0].get_ylim()
        ticks = [t for t in (1, 2, 3, 5, 7, 10, 20, 30, 50, 70, 100, 200, 300, 500, 1000) if low <= t <= high]
        grid[0].set_yticks(ticks, [str(tick) for tick in ticks])
        grid[0].set_yticks([], minor=True)
        handles, labels = grid[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside right center", handlelength=3.5)
        figure.suptitle(title)
    return figure


def table(curves: Curves, title: str) -> Table:
    """A row an instrument, a column a number of poses."""
    headings = (f"{poses} poses" for poses, _ in next(iter(curves.values())))
    cells = (
        (name, *(f"{1e3 * m.mean:.2f} ± {500 * (m.upper - m.lower):.2f}" for _, m in points))
        for name, points in curves.items()
    )
    return Table(("instrument", *headings), tuple(cells), f"error on validation poses, µm (± 95 %): {title}")


def words(curves: Curves) -> list[str]:
    """How many poses each accuracy takes, and where many poses with one instrument are worth few with another."""
    lines = []
    for wanted in WANTED_MM:
        takes = ", ".join(f"{name} {_fewest(points, wanted)}" for name, points in curves.items())
        lines.append(f"95 % of the poses within {wanted:g} mm take: {takes} poses")
    order = sorted(curves, key=lambda name: curves[name][-1][1].mean)
    for better, worse in pairwise(order):
        poses, mean = curves[worse][-1]
        fewer = _fewest(curves[better], mean.mean)
        lines.append(f"{worse}: {poses} poses bring 95 % within {mean.mean:.4f} mm; {better} does that with {fewer}")
    return lines


def _fewest(points: list[tuple[int, Mean]], wanted: float) -> str:
    """The fewest of the poses tried that surely reach an accuracy: the whole interval does."""
    enough = [poses for poses, mean in points if mean.upper <= wanted]
    if not enough:
        return f"more than {points[-1][0]}"
    return f"{enough[0]} or fewer" if enough[0] == points[0][0] else str(enough[0])


if __name__ == "__main__":
    run_script("accuracy_versus_instrument")
