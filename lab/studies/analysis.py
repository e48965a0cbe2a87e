"""Analyse a study's campaigns: means, paired comparisons and ranks, each with its uncertainty.

Campaigns with one robot are not independent. Statistics are therefore
resampled by robots, each with all its draws (Davison & Hinkley 1997, section 3.8: resampling within them too
would count the noise twice; Field & Welsh 2007), which requires noise independent from robot to robot. Poses and
validation poses are the same in all campaigns of a cell: intervals do not include their choice.

The same robot and draw have the same noise in every cell, so that cells are compared campaign by campaign. A ratio is
the geometric mean of the campaigns' ratios, which need not be the ratio of the means. Its interval and p-value are
Student's, of the robots' mean log-ratios, which are nearly normal and never reach a ratio of zero; fewer robots than
``LEAST_ROBOTS`` give none.

Intervals of means and differences are studentized and symmetric: mean ± q s, q the 95 % quantile of |m* - m| / s* over
the resamples (Davison & Hinkley 1997, section 5.2; Hall 1992, section 3.6). Percentiles and BCa are too narrow for few
robots (Hesterberg 2015): of 95 % intervals for the mean of 8 normal robots 90 % hold by either, 97 % by this one; of 20
log-normal ones (sigma 0.7) 90 % against 94 %. The p-value is consistent with it: 5 % or less where zero is outside. The
mean of positive numbers has its interval on the log scale where the symmetric one would reach zero.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.probability import t_ppf, t_sf
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.significance import STUDY_COMPARISON
from lab.studies.grid import FACTORS, GridCell, is_any

__all__ = [
    "COMPARED",
    "LEAST_ROBOTS",
    "RESAMPLES",
    "Analysis",
    "CampaignArray",
    "CellGroup",
    "Comparison",
    "Kind",
    "Mean",
    "Pair",
    "Rank",
    "analysed",
    "compared",
    "groups",
    "holm",
    "means",
    "resampled",
]

_SAME = 1e-12  # a smaller variance, relative to that of all robots, is that of one robot drawn repeatedly


@dataclass(frozen=True)
class _Resampled:
    """Means of some columns over robots, with their bootstrap.

    Attributes:
        mean, lower, upper: ``(m,)`` with an interval; NaN for too few robots.
        p: ``(m,)`` of a mean of zero; NaN for less than two robots.
        means: ``(resamples, m)``.
    """

    mean: Array
    lower: Array
    upper: Array
    p: Array
    means: Array


def resampled(values: Array, weights: Array, level: float) -> _Resampled:
    """Compute means over robots with their intervals.

    Args:
        values: ``(robots, m)``; NaN for none.
        weights: ``(resamples, robots)`` counts of each robot.
        level: of the p-values, and one less the intervals' coverage.
    """
    finite = np.isfinite(values)
    count = finite.sum(axis=0)
    mean = np.where(finite, values, 0.0).sum(axis=0) / np.where(count, count, np.nan)
    left = np.where(finite, values - mean, 0.0)
    floor = _SAME * (left**2).mean(axis=0)
    _, std = _moments(np.ones((1, len(values))), finite, left, floor)
    shifts, stds = _moments(weights, finite, left, floor)
    sizes = np.sort(_quotient(np.abs(shifts), stds), axis=0)
    total = len(weights) + 1
    drawn = count > 1
    reach = sizes[total - round(level * total) - 1]
    far = np.where(drawn & np.isfinite(reach), reach * std[0], np.nan)
    larger = (sizes >= _quotient(np.abs(mean), std[0])).sum(axis=0)
    return _Resampled(mean, mean - far, mean + far, np.where(drawn, (1 + larger) / total, np.nan), mean + shifts)


def _moments(weights: Array, finite: Array, left: Array, floor: Array) -> tuple[Array, Array]:
    """Return the means ``(resamples, m)`` of the residuals, and their standard errors."""
    count = weights @ finite.astype(float)
    shift = weights @ left / np.maximum(count, 1)
    square = weights @ left**2 / np.maximum(count, 1) - shift**2
    variance = np.where(square > floor, square, 0.0) / np.maximum(count - 1, 1)
    return shift, np.sqrt(variance)


def _quotient(size: Array, std: Array) -> Array:
    """Return size over standard error; infinite if one robot alone was drawn, zero for zero."""
    return np.where(std > 0, size / np.where(std > 0, std, 1.0), np.where(size > 0, np.inf, 0.0))


def holm(p: Array) -> Array:
    """Correct a family of p-values ``(m,)`` under any dependence (Holm 1979); NaN stays out of it."""
    corrected = np.full(len(p), np.nan)
    order = np.argsort(p)[: int(np.isfinite(p).sum())]
    steps = p[order] * np.arange(len(order), 0, -1)
    corrected[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return corrected


_KEYS = ("cell", "robot", "draw", "converged")  # columns other than metrics
_FAILURE = "failure"  # and the reason of a failure, where it is known
RESAMPLES = 9999
LEAST_ROBOTS = 5  # of a ratio's interval: of fewer, Student's quantile exceeds three standard errors


@dataclass(frozen=True)
class CellGroup:
    """Cells that agree in all factors but some.

    Attributes:
        free: the factors in which they differ.
        shared: levels of the other factors that vary in the study.
        cells: their numbers.
    """

    free: tuple[str, ...]
    shared: Mapping[str, Any]
    cells: tuple[int, ...]


def groups(cells: Sequence[GridCell], free: Collection[str]) -> tuple[CellGroup, ...]:
    """Group cells that agree in all factors but the free ones; a cell with the level "any" is in each such group.

    Subsets of another group are left out.
    """
    rest = [name for name in FACTORS if name not in free]
    varying = _varying(cells, rest)
    by_members: dict[tuple[int, ...], CellGroup] = {}
    for key in dict.fromkeys(tuple(getattr(cell, name) for name in rest) for cell in cells):
        wanted = dict(zip(rest, key, strict=True))
        members = tuple(i for i, cell in enumerate(cells) if _agrees(cell, wanted))
        shared = {name: wanted[name] for name in varying}
        by_members.setdefault(members, CellGroup(tuple(free), shared, members))
    return tuple(group for members, group in by_members.items() if not _is_within_another(members, by_members))


def _is_within_another(members: Collection[int], groups: Iterable[Collection[int]]) -> bool:
    return any(set(members) < set(other) for other in groups)


def _agrees(cell: GridCell, wanted: Mapping[str, Any]) -> bool:
    return all(getattr(cell, name) == level or is_any(name, getattr(cell, name)) for name, level in wanted.items())


@dataclass(frozen=True)
class CampaignArray:
    """A study's rows by cell, robot and draw, with the resamples of the robots.

    Attributes:
        columns: in any order of rows.
        place: ``(rows,)`` of each row in an array of the shape (cells, robots, draws).
        weights: ``(resamples, robots)`` counts of each robot, the same in every cell.
    """

    cells: tuple[GridCell, ...]
    columns: Mapping[str, NDArray[Any]]
    shape: tuple[int, int, int]
    place: NDArray[np.int_]
    weights: Array

    @classmethod
    def of(
        cls, columns: Mapping[str, NDArray[Any]], cells: Sequence[GridCell], seed: int = 0, resamples: int = RESAMPLES
    ) -> "CampaignArray":
        """Arrange the columns ``cell``, ``robot``, ``draw``, ``converged`` and metrics as an array.

        Raises:
            LabError: a column is missing, a cell is unknown, or a campaign is duplicated.
        """
        if missing := [name for name in _KEYS if name not in columns]:
            raise LabError(f"campaigns: column '{missing[0]}' is missing; there are {', '.join(columns) or 'none'}")
        cell = np.asarray(columns["cell"], dtype=int)
        if not len(cell):
            raise LabError("campaigns: there are none; run the study first")
        if cell.min() < 0 or cell.max() >= len(cells):
            raise LabError(f"campaigns: cell {cell.max()} is unknown; the study has {len(cells)}, counted from 0")
        robots, robot = np.unique(columns["robot"], return_inverse=True)
        draws, draw = np.unique(columns["draw"], return_inverse=True)
        shape = (len(cells), len(robots), len(draws))
        place = np.ravel_multi_index((cell, robot, draw), shape)
        if len(np.unique(place)) < len(place):
            raise LabError("campaigns: a cell's robot and draw is there twice; give each campaign once")
        drawn = rng_for(seed, "bootstrap").multinomial(len(robots), np.full(len(robots), 1 / len(robots)), resamples)
        return cls(tuple(cells), columns, shape, place, drawn.astype(float))

    def values(self, metric: str) -> Array:
        """Return a metric ``(cells, robots, draws)``; NaN without a converged campaign or a finite value.

        Raises:
            LabError: the metric is unknown.
        """
        if metric not in self.columns:
            raise LabError(f"metric '{metric}' is unknown; there are {', '.join(self.columns)}")
        given = np.asarray(self.columns[metric], dtype=float)
        good = np.asarray(self.columns["converged"], dtype=bool) & np.isfinite(given)
        return self._arranged(np.where(good, given, np.nan), np.nan)

    def present(self) -> NDArray[np.bool_]:
        """Return which campaigns ``(cells, robots, draws)`` exist."""
        return self._arranged(np.ones(len(self.place)), 0.0).astype(bool)

    def not_converged(self) -> NDArray[np.int_]:
        """Count campaigns that did not converge, by cell."""
        failed = ~np.asarray(self.columns["converged"], dtype=bool)
        return np.asarray(self._arranged(failed.astype(float), 0.0).sum((1, 2)), dtype=int)

    def failures(self) -> tuple[tuple[tuple[str, int], ...], ...]:
        """Count the reasons of failed campaigns, the most frequent first, by cell."""
        failed = np.flatnonzero(~np.asarray(self.columns["converged"], dtype=bool))
        reasons = self.columns.get(_FAILURE, np.full(len(self.place), "not converged", dtype=object))
        found: list[Counter[str]] = [Counter() for _ in self.cells]
        for row in failed.tolist():
            found[int(self.columns["cell"][row])][str(reasons[row])] += 1
        return tuple(tuple(sorted(each.items(), key=lambda pair: (-pair[1], pair[0]))) for each in found)

    def _arranged(self, given: Array, empty: float) -> Array:
        flat = np.full(np.prod(self.shape), empty)
        flat[self.place] = given
        return flat.reshape(self.shape)


COMPARED = ("fresh_mean_mm", "fresh_worst_mm", "length_rms_mm", "angle_rms_mrad", "link_length_rms_mm",
            "link_angle_rms_mrad", "mixed_rms")  # fmt: skip  # less is better
_TIED = 1e-12  # scores within this, relative to the largest, are equal

Kind = Literal["ratio", "difference"]


@dataclass(frozen=True)
class Mean:
    """A metric's mean in a cell: over robots, of each one's mean over its draws.

    Attributes:
        mean, lower, upper: with its 95 % interval; NaN for too few robots.
        campaigns: their number.
        not_converged: number of those that failed; they are left out, as those whose metric is not finite.
        used: number of the others.
        robots: number of robots of these.
        failures: reasons of the failed campaigns, and how many have each, the most frequent first.
    """

    cell: int
    metric: str
    mean: float
    lower: float
    upper: float
    campaigns: int
    not_converged: int
    used: int
    robots: int
    failures: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True)
class Pair:
    """A pair of cells over the same robots and the same noise.

    Attributes:
        first, second: the cells' numbers.
        effect, lower, upper: exp of the mean log-ratio of second to first, or the mean of second less first, and the
            95 % interval of this pair alone; NaN where it is not estimable.
        p: p-value of no effect.
        p_holm: this p-value, corrected for all pairs of the comparison (Holm 1979).
        used: campaigns that both have, converged in both.
        left_out: campaigns that both have, not converged in one or both.
        robots: number of robots of the used ones.
    """

    first: int
    second: int
    effect: float
    lower: float
    upper: float
    p: float
    p_holm: float
    used: int
    left_out: int
    robots: int = 0

    @property
    def is_significant(self) -> bool:
        """True if the pair differs significantly, corrected for all pairs of the comparison."""
        return self.p_holm <= STUDY_COMPARISON


@dataclass(frozen=True)
class Rank:
    """Rank of a cell among those that it is compared with; 1 has the least of the metric.

    Attributes:
        rank: as observed; ties share the better one.
        lowest, highest: the 95 % set of ranks, jointly for all cells of the comparison: from the cells
            that are significantly better and worse (Mogstad, Romano, Shaikh & Wilhelm 2024).
            Quantiles of resampled ranks would not cover equal cells (Hall & Miller 2009).
        chances: share of the resamples in which it has rank 1, 2, ...
    """

    cell: int
    rank: int
    lowest: int
    highest: int
    chances: tuple[float, ...]


@dataclass(frozen=True)
class Comparison:
    """Comparison of all pairs of a group's cells by one metric, with their ranks.

    Attributes:
        pairs: in the order of the group's cells.
        ranks: best first; a cell that never converged has none.
    """

    group: CellGroup
    metric: str
    kind: Kind
    pairs: tuple[Pair, ...]
    ranks: tuple[Rank, ...]

    def against(self, one: int, other: int) -> Pair:
        """Return the pair of two of the group's cells, ``other`` against ``one``."""
        pair = next(pair for pair in self.pairs if {pair.first, pair.second} == {one, other})
        return pair if pair.first == one else _reversed(pair, self.kind)


@dataclass(frozen=True)
class Analysis:
    """Results of a study's analysis.

    Attributes:
        cells: the combinations of the factors, in the order of their numbers.
        means: of each cell and metric: ``cell``, ``metric``, ``mean``, ``lower``, ``upper``.
        comparisons: of each metric and factor, the ``pairs`` and ``ranks`` of the cells that agree in all other factors
            (``group``).
    """

    cells: tuple[GridCell, ...]
    means: tuple[Mean, ...]
    comparisons: tuple[Comparison, ...]


def means(campaigns: CampaignArray, metric: str) -> tuple[Mean, ...]:
    """Compute the mean of every cell."""
    values, failed = campaigns.values(metric), campaigns.not_converged()
    by_robot = _over_draws(values)
    found = resampled(by_robot.T, campaigns.weights, STUDY_COMPARISON)
    counts = campaigns.present().sum((1, 2))
    used, robots, failures = np.isfinite(values).sum((1, 2)), np.isfinite(by_robot).sum(1), campaigns.failures()
    lower, upper = _above_zero(found, by_robot)
    return tuple(
        Mean(
            cell=i,
            metric=metric,
            mean=float(found.mean[i]),
            lower=float(lower[i]),
            upper=float(upper[i]),
            campaigns=int(counts[i]),
            not_converged=int(failed[i]),
            used=int(used[i]),
            robots=int(robots[i]),
            failures=failures[i],
        )
        for i in range(len(campaigns.cells))
    )


def _above_zero(by_resampling: _Resampled, by_robot: Array) -> tuple[Array, Array]:
    """Return the ends ``(cells,)`` of means' intervals, on the log scale where positive numbers' would reach zero.

    Args:
        by_robot: ``(cells, robots)``.
    """
    positive = (np.where(np.isfinite(by_robot), by_robot, np.inf) > 0).all(axis=1) & np.isfinite(by_resampling.mean)
    log = positive & (by_resampling.lower <= 0)
    mean = np.where(log, by_resampling.mean, 1.0)
    times = np.exp(np.where(log, (by_resampling.upper - by_resampling.mean) / mean, 0.0))
    return np.where(log, mean / times, by_resampling.lower), np.where(log, mean * times, by_resampling.upper)


def compared(campaigns: CampaignArray, group: CellGroup, metric: str, kind: Kind = "ratio") -> Comparison:
    """Compare all pairs of a group's cells, and rank the cells.

    A campaign counts in a pair where it converged in both cells (and, for a ratio, the metric is positive in both).
    """
    values, present = (every[list(group.cells)] for every in (campaigns.values(metric), campaigns.present()))
    if kind == "ratio":
        values = np.log(np.where(values > 0, values, np.nan))
    numbers = list(combinations(range(len(group.cells)), 2))
    apart = [values[j] - values[i] for i, j in numbers]  # (robots, draws) each
    by_robot = np.stack([_over_draws(each) for each in apart], axis=1)
    found = resampled(by_robot, campaigns.weights, STUDY_COMPARISON)
    if kind == "ratio":
        found = _by_student(found, by_robot)
    corrected = holm(found.p)
    effects = np.stack([found.mean, found.lower, found.upper])
    mean, lower, upper = np.exp(effects) if kind == "ratio" else effects
    pairs = tuple(
        Pair(
            first=group.cells[i],
            second=group.cells[j],
            effect=float(mean[k]),
            lower=float(lower[k]),
            upper=float(upper[k]),
            p=float(found.p[k]),
            p_holm=float(corrected[k]),
            used=(used := int(np.isfinite(apart[k]).sum())),
            left_out=int((present[i] & present[j]).sum()) - used,
            robots=int(np.isfinite(by_robot[:, k]).sum()),
        )
        for k, (i, j) in enumerate(numbers)
    )
    return Comparison(group, metric, kind, pairs, _ranks(group, numbers, found, pairs))


def _by_student(by_resampling: _Resampled, by_robot: Array) -> _Resampled:
    """Return the means over robots with Student's intervals and p-values.

    Args:
        by_robot: ``(robots, m)`` log-ratios; NaN for none.
    """
    finite = np.isfinite(by_robot)
    count = finite.sum(axis=0)
    dof = np.maximum(count - 1, 1)
    left = np.where(finite, by_robot - by_resampling.mean, 0.0)
    std = np.sqrt((left**2).sum(axis=0) / dof / np.maximum(count, 1))
    enough = count >= LEAST_ROBOTS
    far = np.where(enough, t_ppf(1 - STUDY_COMPARISON / 2, dof) * std, np.nan)
    p = np.where(enough, 2 * t_sf(_quotient(np.abs(by_resampling.mean), std), dof), np.nan)
    return replace(by_resampling, lower=by_resampling.mean - far, upper=by_resampling.mean + far, p=p)


def _ranks(
    group: CellGroup, numbers: Sequence[tuple[int, int]], found: _Resampled, pairs: Sequence[Pair]
) -> tuple[Rank, ...]:
    """Rank cells by the scores that fit the pairs' effects best; with all campaigns these are the cells' means."""
    finite = np.isfinite(found.mean)
    signs = np.zeros((len(numbers), len(group.cells)))
    for row, (i, j) in zip(signs, numbers, strict=True):
        row[[i, j]] = -1, 1
    ranked = np.flatnonzero(np.abs(signs[finite]).sum(axis=0))
    scores = np.linalg.pinv(signs[finite])[ranked].T  # (pairs, cells)
    at, drawn = _placed(found.mean[None, finite] @ scores)[0], _placed(found.means[:, finite] @ scores)
    significant = np.array([pair.is_significant for pair in pairs], dtype=bool)
    behind = signs * np.sign(np.where(significant, found.mean, 0.0))[:, None]  # 1 where a cell has significantly more
    ranks = []
    for k, cell in enumerate(ranked):
        lowest, highest = 1 + int((behind[:, cell] > 0).sum()), len(ranked) - int((behind[:, cell] < 0).sum())
        chances = np.bincount(drawn[:, k], minlength=len(ranked) + 1)[1:] / len(drawn)
        ranks.append(Rank(group.cells[cell], int(at[k]), lowest, highest, tuple(chances.tolist())))
    return tuple(sorted(ranks, key=lambda each: (each.rank, each.cell)))


def _placed(scores: Array) -> NDArray[np.int_]:
    """Return the ranks ``(n, cells)`` of scores: one plus the number of smaller ones."""
    margin = _TIED * np.abs(scores).max(axis=1, initial=0.0)[:, None, None]
    return np.asarray(1 + (scores[:, None, :] < scores[:, :, None] - margin).sum(axis=2))


def _over_draws(values: Array) -> Array:
    """Return means over the last axis of finite values; NaN without any."""
    good = np.isfinite(values)
    count = good.sum(axis=-1)
    return np.asarray(np.where(good, values, 0.0).sum(axis=-1) / np.where(count, count, np.nan))


def _reversed(pair: Pair, kind: Kind) -> Pair:
    ends = np.array([pair.effect, pair.upper, pair.lower])
    effect, lower, upper = (1 / ends if kind == "ratio" else -ends).tolist()
    return replace(pair, first=pair.second, second=pair.first, effect=effect, lower=lower, upper=upper)


def analysed(
    columns: Mapping[str, NDArray[Any]],
    cells: Sequence[GridCell],
    seed: int = 0,
    metrics: Sequence[str] = COMPARED,
    factors: Sequence[str] | None = None,
) -> Analysis:
    """Compute the means of every cell by every column, and comparisons by some metrics and factors.

    Args:
        metrics: of which less is better.
        factors: all that vary if not given.
    """
    campaigns = CampaignArray.of(columns, cells, seed)
    chosen = factors or _varying(cells, FACTORS)
    several = [group for factor in chosen for group in groups(cells, [factor]) if len(group.cells) > 1]
    measured = [name for name in columns if name not in (*_KEYS, _FAILURE)]
    return Analysis(
        tuple(cells),
        tuple(mean for name in measured for mean in means(campaigns, name)),
        tuple(compared(campaigns, group, metric) for metric in metrics for group in several),
    )


def _varying(cells: Sequence[GridCell], factors: Iterable[str]) -> list[str]:
    return [name for name in factors if len(_levels(cells, name)) > 1]


def _levels(cells: Sequence[GridCell], factor: str) -> set[Any]:
    return {level for cell in cells if not is_any(factor, level := getattr(cell, factor))}
