"""Which criterion should choose the poses? 10,000 paired campaigns for each answer.

The 27 parameters of the canonical gauge, poses chosen by each criterion in each scaling, or at random; 100 virtual
arms, each measured 100 times, the same arms and the same noise for every criterion; validated on the parameters' errors
and on validation poses. With ``--compliant`` the arms deflect by their weight and a payload and have runout, and these
are fitted, too. The tables of the thesis that asks this come from ``lab reproduce thesis``.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from shared import (
    Answer,
    Block,
    Document,
    Flag,
    Paragraph,
    Section,
    Table,
    drawing,
    mark_ratios,
    paragraphs,
    run_script,
    save_figure,
)
from study_runs import study_runner

from lab.core.number_text import fixed
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.gauge import base_set
from lab.options.option_groups import Effects
from lab.report.style import GRID, REFERENCE, SCALINGS
from lab.report.views.study_texts import effect_text
from lab.robots.load_robot import load_virtual
from lab.simulation.collisions import random_poses
from lab.studies.analysis import CampaignArray, Comparison, Mean, Pair, compared, groups, means
from lab.studies.grid import ANY, GridCell, Study
from lab.studies.run_study import read_store

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NEEDS = ("matplotlib",)

STUDIED = ("random", "O1", "O2", "O3", "O4", "O5")  # the condition number is O2 turned over: the same poses
SCALED = ("raw", "unit", "length", "whitened")
METRICS = {
    "fresh_mean_mm": "mean error on validation poses",
    "fresh_worst_mm": "worst error on validation poses",
    "length_rms_mm": "error of the lengths",
    "angle_rms_mrad": "error of the angles",
}
BASELINE = "O1"
SOFT = Effects(stiffness_nm_per_rad=1e5, harmonic_mrad=0.1, payload_kg=(0.0, 3.0))
SOFT_MODEL = "compliance+harmonics"


def criterion_study(
    robots: int,
    draws: int,
    poses: Sequence[int],
    criteria: Sequence[str],
    scalings: Sequence[str],
    *,
    compliant: bool = False,
) -> Study:
    """The 27 parameters of the canonical gauge by the default target, poses by each criterion; O1 is always there.

    Args:
        compliant: of arms with compliance and runout, whose 14 parameters are fitted, too.
    """
    compared_ones = tuple(criteria) if BASELINE in criteria else (BASELINE, *criteria)
    factors = {"criterion": compared_ones, "scaling": tuple(scalings), "poses": tuple(poses)}
    if not compliant:
        return Study(name="which-criterion", robots=robots, draws=draws, factors=factors)
    factors |= {"effects": ("soft",), "model": (SOFT_MODEL,)}
    return Study("which-criterion-compliant", robots=robots, draws=draws, factors=factors, effects={"soft": SOFT})


@dataclass(frozen=True)
class CriterionComparison:
    """What a study of criteria says.

    Attributes:
        compared: all cells of a number of poses, by metric and number.
        means: of every cell, by metric.
        searches: by cell, the predicted error over O1's by the poses of each other search.
    """

    cells: tuple[GridCell, ...]
    compared: Mapping[tuple[str, int], Comparison]
    means: Mapping[str, tuple[Mean, ...]]
    searches: Mapping[GridCell, tuple[float, ...]]

    def reference(self, comparison: Comparison) -> int:
        """The number of O1's cell."""
        return next(i for i in comparison.group.cells if self.cells[i].criterion == BASELINE)

    def against_reference(self, comparison: Comparison, cell: int) -> Pair | None:
        """A cell against O1; None of O1 itself."""
        own = self.reference(comparison)
        return None if cell == own else comparison.against(own, cell)


def answered(arranged: CampaignArray, searches: Mapping[GridCell, tuple[float, ...]]) -> CriterionComparison:
    """Means, and all pairs of criteria and scalings for each number of poses."""
    cells = arranged.cells
    together = {cells[group.cells[0]].poses: group for group in groups(cells, ["criterion", "scaling"])}
    return CriterionComparison(
        cells,
        {(metric, poses): compared(arranged, group, metric) for metric in METRICS for poses, group in together.items()},
        {metric: means(arranged, metric) for metric in METRICS},
        searches,
    )


def name_of(cell: GridCell) -> str:
    """A cell's criterion and scaling; O2 is the condition number turned over, and has the same poses."""
    criterion = "O2, condition" if cell.criterion == "O2" else cell.criterion
    return criterion if cell.scaling == ANY else f"{criterion} {cell.scaling}"


def answer_blocks(answer: CriterionComparison) -> tuple[Block, ...]:
    """A table for each number of poses, and what they say."""
    tables = (_table(answer, poses) for poses in dict.fromkeys(number for _, number in answer.compared))
    return (*tables, *paragraphs(answer_words(answer)))


def _table(answer: CriterionComparison, poses: int) -> Table:
    title = (
        f"{poses} poses: mean error, µm, on validation poses; how many % more than {BASELINE}'s it is, and the worst, "
        "and the lengths' and angles' errors; and how many % more the mean is by the poses of other searches"
    )
    rows: list[tuple[str, ...]] = []
    halves: dict[str, list[float]] = {metric: [0.0] for metric in METRICS}
    for rank in answer.compared["fresh_mean_mm", poses].ranks:
        cell, mean = answer.cells[rank.cell], answer.means["fresh_mean_mm"][rank.cell]
        others = [100 * (ratio - 1) for ratio in answer.searches.get(cell, ())]
        shown = []
        for metric in METRICS:
            pair = answer.against_reference(answer.compared[metric, poses], rank.cell)
            shown.append("" if pair is None else _more_than_reference(pair, with_interval=metric == "fresh_mean_mm"))
            halves[metric] += [] if pair is None else [50 * (pair.upper - pair.lower)]
        between = f"{min(others):+.0f} to {max(others):+.0f}" if others and cell.criterion != BASELINE else ""
        rows.append((name_of(cell), f"{1e3 * mean.mean:.2f}", *shown, between.replace("-", "−")))
    rows.append(("95 % intervals, at most", "", *(f"± {np.nanmax(each):.1f}" for each in halves.values()), ""))
    headings = ("poses by", "µm", "mean", "worst", "lengths", "angles", "searches")
    return Table(headings, tuple(rows), title)


def _more_than_reference(pair: Pair, *, with_interval: bool) -> str:
    """How many per cent a cell's error is more, with its interval where that is asked for."""
    more, lower, upper = (fixed(100 * (end - 1), 1, signed=True) for end in (pair.effect, pair.lower, pair.upper))
    return f"{more} ({lower} to {upper})" if with_interval else more


def answer_words(answer: CriterionComparison) -> list[str]:
    """A sentence for each metric and number of poses, and one for each criterion over all of them."""
    lines = []
    for (metric, poses), comparison in answer.compared.items():
        leaders = [name_of(answer.cells[rank.cell]) for rank in comparison.ranks if rank.lowest == 1]
        best, own = comparison.ranks[0].cell, answer.reference(comparison)
        criteria = {BASELINE: own} | {answer.cells[r.cell].criterion: r.cell for r in comparison.ranks}
        shown = dict.fromkeys((own, criteria.get("random", own), comparison.ranks[-1].cell))
        said = [f"{name_of(answer.cells[i])} {_more(comparison.against(best, i))}" for i in shown if i != best]
        head = f"{poses} poses, {METRICS[metric]}: best {'is' if len(leaders) == 1 else 'are'} {', '.join(leaders)}"
        lines.append("; ".join([head, *said]))
    return [*lines, *(_over_all(answer, name) for name in dict.fromkeys(cell.criterion for cell in answer.cells))]


def _more(pair: Pair) -> str:
    return f"{effect_text(pair, 'ratio')} {'as much' if pair.effect >= 2 else 'more'}"


def _over_all(answer: CriterionComparison, criterion: str) -> str:
    """How a criterion does against O1 over all metrics, scalings and numbers of poses."""
    pairs = [
        pair
        for comparison in answer.compared.values()
        for cell in comparison.group.cells
        if answer.cells[cell].criterion == criterion
        and (pair := answer.against_reference(comparison, cell)) is not None
    ]
    if not pairs:
        first = [
            c for c in answer.compared.values() if any(r.lowest == 1 and r.cell == answer.reference(c) for r in c.ranks)
        ]
        return f"{criterion}: among the best in {len(first)} of {len(answer.compared)} comparisons"
    effects = np.array([pair.effect for pair in pairs])
    better, worse = (sum(pair.is_significant and sign * np.log(pair.effect) > 0 for pair in pairs) for sign in (-1, 1))
    name = "O2, condition" if criterion == "O2" else criterion
    return (
        f"{name}: surely better than {BASELINE} in {better} of {len(pairs)} comparisons, worse in {worse}; "
        f"its error is {effects.min():.2f} to {effects.max():.2f} times {BASELINE}'s, median {np.median(effects):.2f}"
    )


def answer_summary(answer: CriterionComparison) -> dict[str, Any]:
    """What ``--json`` prints of it."""
    rows = []
    for (metric, poses), comparison in answer.compared.items():
        for rank in comparison.ranks:
            cell = answer.cells[rank.cell]
            mean, pair = answer.means[metric][rank.cell], answer.against_reference(comparison, rank.cell)
            rows.append(
                {
                    "metric": metric,
                    "poses": poses,
                    "criterion": cell.criterion,
                    "scaling": cell.scaling,
                    "mean": [mean.mean, mean.lower, mean.upper],
                    "campaigns": mean.campaigns,
                    "not_converged": mean.not_converged,
                    "ranks_95": [rank.lowest, rank.highest],
                    "to_o1": None if pair is None else asdict(pair),
                    "other_searches_to_o1": list(answer.searches.get(cell, ())),
                }
            )
    return {"rows": rows, "words": answer_words(answer)}


def predicted_rms(study: Study, designs: Sequence[Array]) -> Array:
    """RMS position error (m, per m of noise) at the study's validation poses, of designs ``(n, joints)``."""
    robot = load_virtual(study.robot)
    model, rigid = robot.model, robot.arm(study.targets)
    arm = robot.arm_with(study.targets, study.cells[0].fitting.groups)
    values = np.zeros(len(arm.names))
    values[: len(rigid.names)] = model.values_before(rigid, model.T_world_tracker)
    kept = list(base_set(arm, values).identifiable)

    def rates(joints: Array) -> Array:
        unloaded = np.zeros((len(joints), len(arm.conditions)))
        return arm.observe(np.concatenate([joints, unloaded], axis=1), values)[1][..., kept].reshape(-1, len(kept))

    fresh = random_poses(model, study.fresh, rng_for(study.seed, "fresh"))
    flat, places = rates(fresh), len(fresh) * len(study.targets)
    spread = flat.T @ flat / places
    seen = [rates(joints) for joints in designs]
    return np.sqrt([np.trace(np.linalg.solve(each.T @ each, spread)) for each in seen])


def other_searches(
    study: Study, seeds: Sequence[int], folder: Path, run: Callable[[Study, Path], object], reference: str
) -> dict[GridCell, tuple[float, ...]]:
    """By cell, and for each seed, the predicted error over that of the reference criterion's poses of the same seed.

    A study's intervals are for the poses that it has. Another search by the same criterion ends at other poses;
    how much that matters is predicted to first order, for the nominal arm.

    Args:
        run: makes the poses of a study, into a folder.
    """
    ratios: dict[GridCell, tuple[float, ...]] = dict.fromkeys(study.cells, ())
    for seed in seeds:
        another = replace(study, seed=seed, robots=1, draws=1)
        run(another, folder / f"search{seed}")
        store = read_store(folder / f"search{seed}")
        designs = [store.read_poses(number) for number in range(len(study.cells))]
        found = predicted_rms(study, [joints for joints in designs if joints is not None])
        best = {cell.poses: rms for cell, rms in zip(study.cells, found, strict=True) if cell.criterion == reference}
        for cell, rms in zip(study.cells, found, strict=True):
            ratios[cell] += (float(rms / best[cell.poses]),)
    return ratios


_MARKS = {**SCALINGS, ANY: (REFERENCE, "X")}
_SCALING_WORDS = {
    "raw": "mm and rad",
    "unit": "unit columns",
    "length": "angles × 300 mm",
    "whitened": "tolerances, noise",
    ANY: "the same in each",
}


def criteria_figure(answer: CriterionComparison, metrics: Sequence[str], titles: Sequence[str], title: str) -> "Figure":
    """Errors against those of O1's poses: a row of panels a metric, a column a number of poses, a mark a scaling."""
    numbers = list(dict.fromkeys(poses for _, poses in answer.compared))
    order = _by_error(answer)
    size = (max(8.5, 2.2 + 3.1 * len(numbers)), 1.5 + 2.6 * len(metrics))
    with drawing(size) as figure:
        grid = figure.subplots(len(metrics), len(numbers), squeeze=False, sharex=True, sharey=True)
        for i, metric in enumerate(metrics):
            for j, poses in enumerate(numbers):
                axes = grid[i, j]
                _criteria_panel(axes, answer, metric, poses, order)
                mean = answer.means[metric][answer.reference(answer.compared[metric, poses])].mean
                micro = "µrad" if metric.endswith("mrad") else "µm"
                axes.set_title(f"{poses} poses: {titles[i]},\n{BASELINE} {1e3 * mean:.3g} {micro}", fontsize=10)
        axes = grid[0, 0]
        mark_ratios(axes)
        handles = [
            axes.plot(
                [], [], mark, color=colour, markeredgecolor=REFERENCE, linestyle="", label=_SCALING_WORDS[scaling]
            )[0]
            for scaling, (colour, mark) in _MARKS.items()
            if any(cell.scaling == scaling for cell in answer.cells)
        ]
        if any(answer.searches.values()):
            handles += axes.plot(
                [], [], "|", color=REFERENCE, markersize=8, linestyle="", label="poses of other searches"
            )
        words = f"error, times that of {BASELINE}'s poses; 95 % intervals, mostly within the marks"
        figure.supxlabel(words, fontsize=10)
        figure.legend(handles=handles, title="scaling", loc="outside right center", fontsize=9)
        figure.suptitle(title)
    return figure


def _by_error(answer: CriterionComparison) -> list[str]:
    """The criteria, best on top: by the mean logarithm of their error on validation poses."""
    logs: dict[str, list[float]] = {}
    for cell, mean in zip(answer.cells, answer.means["fresh_mean_mm"], strict=True):
        logs.setdefault(cell.criterion, []).append(float(np.log(mean.mean)))
    return sorted(logs, key=lambda name: (name != BASELINE, np.mean(logs[name])))


def _criteria_panel(axes: "Axes", answer: CriterionComparison, metric: str, poses: int, order: Sequence[str]) -> None:
    comparison = answer.compared[metric, poses]
    scalings = [scaling for scaling in _MARKS if scaling != ANY]
    pairs = [pair for each in answer.compared.values() for pair in each.pairs]
    farthest = 1.15 * max(max(pair.effect, 1 / pair.effect) for pair in pairs if _with_reference(answer, pair))
    axes.axvline(1.0, color=REFERENCE, linewidth=1)
    axes.set_xscale("log")
    for number in comparison.group.cells:
        cell = answer.cells[number]
        pair = answer.against_reference(comparison, number)
        ends = (1.0, 1.0, 1.0) if pair is None else (pair.effect, pair.lower, pair.upper)
        aside = 0.0 if cell.scaling == ANY else 0.19 * (scalings.index(cell.scaling) - 1.5)
        row = order.index(cell.criterion) + aside
        colour, mark = _MARKS[cell.scaling]
        axes.hlines(row, ends[1], ends[2], color=REFERENCE, linewidth=1.5)
        axes.plot(ends[0], row, mark, color=colour, markeredgecolor=REFERENCE, markeredgewidth=0.6, markersize=6.5)
        if metric.startswith("fresh") and pair is not None:
            others = np.array(answer.searches.get(cell, ()))
            inside = others[others <= farthest]
            axes.plot(inside, np.full(len(inside), row), "|", color=REFERENCE, markersize=7, zorder=1.5)
            for k, far in enumerate(others[others > farthest]):
                axes.text(farthest, row + 0.25 * (k + 1), f"{far:.1f} ▸", ha="right", va="center", fontsize=8)
    names = ["O2, condition number" if name == "O2" else name for name in order]
    axes.set_yticks(range(len(order)), names)
    axes.set_ylim(len(order) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    for row in range(1, len(order)):
        axes.axhline(row - 0.5, color=GRID, linewidth=0.8)
    axes.tick_params(axis="y", length=0)


def _with_reference(answer: CriterionComparison, pair: Pair) -> bool:
    return BASELINE in (answer.cells[pair.first].criterion, answer.cells[pair.second].criterion)


SHOWN = {"fresh_mean_mm": "mean fresh error", "length_rms_mm": "error of the lengths"}


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    robots: int = 100
    """Virtual arms."""
    draws: int = 100
    """Campaigns with each, that differ in the noise."""
    poses: tuple[int, ...] = (10, 20, 40)
    """Numbers of poses."""
    criteria: tuple[str, ...] = STUDIED
    """Which are compared with O1."""
    scalings: tuple[str, ...] = SCALED
    """In which units of the parameters."""
    searches: int = 2
    """How often all poses are chosen anew, to say how much is the search's luck."""
    workers: int = 2
    """Processes."""
    out: Path = Path("runs/thesis-tables")
    """Folder of the study and the picture; a study that is there goes on."""
    quick: Flag = False
    """10 arms, 10 draws, 20 poses, two scalings: a minute."""
    compliant: Flag = False
    """Arms with compliance and runout, both fitted."""
    json: Flag = False
    """Print one JSON object."""


def answer(options: Options) -> Answer:
    """Run the study of criteria."""
    began = time.perf_counter()
    soft = options.compliant
    if options.quick:
        study = criterion_study(10, 10, (20,), STUDIED, ("raw", "whitened"), compliant=soft)
    else:
        robots, draws, poses = options.robots, options.draws, options.poses
        study = criterion_study(robots, draws, poses, options.criteria, options.scalings, compliant=soft)
    folder = options.out / ("compliant" if soft else "study")
    with study_runner(options.workers) as run:
        campaigns, done = run(study, folder)
        seeds = range(1, 1 + (0 if options.quick else options.searches))
        others = other_searches(study, seeds, folder if soft else options.out, run, BASELINE)
    comparison = answered(campaigns, others)
    of = " of compliant arms" if soft else ""
    title = f"Which criterion should choose the poses{of}? {study.robots * study.draws:,} paired campaigns each"
    picture = f"which_criterion{'_compliant' if soft else ''}"
    save_figure(options.out, picture, criteria_figure(comparison, list(SHOWN), list(SHOWN.values()), title))
    seconds = time.perf_counter() - began
    end = f"{done.computed:,} campaigns, all in {seconds:.0f} s; {options.out / f'{picture}.png'}"
    blocks: tuple[Block, ...] = (Section("Which criterion", (*answer_blocks(comparison), Paragraph(end))),)
    values: dict[str, Any] = {"answer": answer_summary(comparison), "seconds": seconds}
    return Answer(values, Document(title, blocks))


if __name__ == "__main__":
    run_script("thesis_tables")
