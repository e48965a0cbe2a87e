"""Which criterion should choose the poses: what 27 parameters and fresh poses say, campaign by campaign."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from lab.commands.study.format import effect_words
from lab.experiments.script import paragraphs
from lab.render.document import Block, Table
from lab.render.format import fixed
from lab.studies.analysis import Comparison, Mean, Pair, compared, means
from lab.studies.grid import ANY, Cell, Study
from lab.studies.table import CampaignArray, groups

__all__ = [
    "CRITERIA",
    "REFERENCE",
    "SCALINGS",
    "CriterionComparison",
    "answer_blocks",
    "answer_summary",
    "answered",
    "criterion_study",
]

CRITERIA = ("random", "O1", "O2", "O3", "O4", "O5")  # the condition number is O2 turned over: the same poses
SCALINGS = ("raw", "unit", "length", "whitened")
METRICS = {
    "fresh_mean_mm": "mean error on validation poses",
    "fresh_worst_mm": "worst error on validation poses",
    "length_rms_mm": "error of the lengths",
    "angle_rms_mrad": "error of the angles",
}
REFERENCE = "O1"


def criterion_study(
    robots: int, draws: int, poses: Sequence[int], criteria: Sequence[str], scalings: Sequence[str]
) -> Study:
    """The 27 parameters of the canonical gauge by the default target, poses by each criterion; O1 is always there."""
    compared_ones = tuple(criteria) if REFERENCE in criteria else (REFERENCE, *criteria)
    factors = {"criterion": compared_ones, "scaling": tuple(scalings), "poses": tuple(poses)}
    return Study(name="which-criterion", robots=robots, draws=draws, factors=factors)


@dataclass(frozen=True)
class CriterionComparison:
    """What a study of criteria says.

    Attributes:
        compared: all cells of a number of poses, by metric and number.
        means: of every cell, by metric.
        searches: by cell, the predicted error over O1's by the poses of each other search.
    """

    cells: tuple[Cell, ...]
    compared: Mapping[tuple[str, int], Comparison]
    means: Mapping[str, tuple[Mean, ...]]
    searches: Mapping[Cell, tuple[float, ...]]

    def reference(self, comparison: Comparison) -> int:
        """The number of O1's cell."""
        return next(i for i in comparison.group.cells if self.cells[i].criterion == REFERENCE)

    def against_reference(self, comparison: Comparison, cell: int) -> Pair | None:
        """A cell against O1; None of O1 itself."""
        own = self.reference(comparison)
        return None if cell == own else comparison.against(own, cell)


def answered(arranged: CampaignArray, searches: Mapping[Cell, tuple[float, ...]]) -> CriterionComparison:
    """Means, and all pairs of criteria and scalings for each number of poses."""
    cells = arranged.cells
    together = {cells[group.cells[0]].poses: group for group in groups(cells, ["criterion", "scaling"])}
    return CriterionComparison(
        cells,
        {(metric, poses): compared(arranged, group, metric) for metric in METRICS for poses, group in together.items()},
        {metric: means(arranged, metric) for metric in METRICS},
        searches,
    )


def name_of(cell: Cell) -> str:
    """A cell's criterion and scaling; O2 is the condition number turned over, and has the same poses."""
    criterion = "O2, condition" if cell.criterion == "O2" else cell.criterion
    return criterion if cell.scaling == ANY else f"{criterion} {cell.scaling}"


def answer_blocks(answer: CriterionComparison) -> tuple[Block, ...]:
    """A table for each number of poses, and what they say."""
    tables = (_table(answer, poses) for poses in dict.fromkeys(number for _, number in answer.compared))
    return (*tables, *paragraphs(answer_words(answer)))


def _table(answer: CriterionComparison, poses: int) -> Table:
    title = (
        f"{poses} poses: mean error, µm, on validation poses; how many % more than {REFERENCE}'s it is, and the worst, "
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
            shown.append("" if pair is None else fixed(100 * (pair.effect - 1), 1, signed=True))
            halves[metric] += [] if pair is None else [50 * (pair.upper - pair.lower)]
        between = f"{min(others):+.0f} to {max(others):+.0f}" if others and cell.criterion != REFERENCE else ""
        rows.append((name_of(cell), f"{1e3 * mean.mean:.2f}", *shown, between.replace("-", "−")))
    rows.append(("95 % intervals, at most", "", *(f"± {np.nanmax(each):.1f}" for each in halves.values()), ""))
    headings = ("poses by", "µm", "mean", "worst", "lengths", "angles", "searches")
    return Table(headings, tuple(rows), title)


def answer_words(answer: CriterionComparison) -> list[str]:
    """A sentence for each metric and number of poses, and one for each criterion over all of them."""
    lines = []
    for (metric, poses), comparison in answer.compared.items():
        leaders = [name_of(answer.cells[rank.cell]) for rank in comparison.ranks if rank.lowest == 1]
        best, own = comparison.ranks[0].cell, answer.reference(comparison)
        criteria = {REFERENCE: own} | {answer.cells[r.cell].criterion: r.cell for r in comparison.ranks}
        shown = dict.fromkeys((own, criteria.get("random", own), comparison.ranks[-1].cell))
        said = [f"{name_of(answer.cells[i])} {_more(comparison.against(best, i))}" for i in shown if i != best]
        head = f"{poses} poses, {METRICS[metric]}: best {'is' if len(leaders) == 1 else 'are'} {', '.join(leaders)}"
        lines.append("; ".join([head, *said]))
    return [*lines, *(_over_all(answer, name) for name in dict.fromkeys(cell.criterion for cell in answer.cells))]


def _more(pair: Pair) -> str:
    return f"{effect_words(pair, 'ratio')} {'as much' if pair.effect >= 2 else 'more'}"


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
    better, worse = (sum(pair.told and sign * np.log(pair.effect) > 0 for pair in pairs) for sign in (-1, 1))
    name = "O2, condition" if criterion == "O2" else criterion
    return (
        f"{name}: surely better than {REFERENCE} in {better} of {len(pairs)} comparisons, worse in {worse}; "
        f"its error is {effects.min():.2f} to {effects.max():.2f} times {REFERENCE}'s, median {np.median(effects):.2f}"
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
