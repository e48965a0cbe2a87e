"""Find when the parameters of a robot changed, by a sequential change-point test of its calibrations.

The calibrations of a series are independent. Where nothing changes, their estimates x_j scatter about one value with
their covariances C_j. After each new calibration every change point t is tried: the weighted means before and after it
differ by d, with covariance C = (sum before of C_j^-1)^-1 + (sum after of C_j^-1)^-1. If a direction g of the
parameters alone has changed, its size is the least-squares estimate g' C^-1 d / g' C^-1 g with variance 1 / g' C^-1 g
(generalized likelihood ratio; Basseville & Nikiforov 1993, section 2.4).

The k-th test of a year rejects at the level a / (k (k + 1)), corrected for directions and change points (Bonferroni).
These levels add up to less than a for any number of tests, so an unchanged robot raises an alarm in at most a share a
of the years, however often it is measured.

The test finds the change and names the direction; its size is the difference d itself, with the interval of C. That
interval covers whatever else has changed. The interval of the least-squares estimate is narrower, and covers only if
nothing else changed by however little (``scripts/experiments/history_study.py``).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lab.core.linear_model import half_width_95, p_value_of_squares
from lab.core.probability import chi2_isf, t_isf, t_sf
from lab.core.se3 import Array
from lab.core.significance import TREND_YEAR
from lab.prediction.estimate import IdentifiedSubset

__all__ = ["POWER", "CalibrationSeries", "ChangeDirections", "ParameterChange", "levels"]

POWER = 0.95  # with which a minimum detectable change is found
_YEAR = 365.25  # days
_APART = float(chi2_isf(0.01, 1))  # by how much more the best direction explains than one that is ruled out
_MORE = 0.01  # level at which one direction alone does not explain a change


@dataclass(frozen=True)
class ChangeDirections:
    """Ways in which the compared parameters may change, each by one number.

    Attributes:
        names: ``(c,)``, the ``f`` parameters themselves first.
        columns: ``(f, c)`` the change of the parameters for a change by one; the first f are those of the unit matrix.
    """

    names: tuple[str, ...]
    columns: Array


@dataclass(frozen=True)
class ParameterChange:
    """A change between two calibrations of a series.

    Attributes:
        after: index of the last calibration before the change.
        found_at: index of the calibration that raised the alarm.
        named: the directions that may have changed, the likeliest first: of several, any one explains the change
            unless ``several``.
        changes, half_widths: of each, with half of its 95 % interval, whatever else has changed.
        several: whether no direction explains the change alone; ``named`` are then those that surely changed.
        p: chance of so strong an alarm in the test that raised it, if nothing had changed; ``level`` is that test's.
    """

    after: int
    found_at: int
    named: tuple[str, ...]
    changes: tuple[float, ...]
    half_widths: tuple[float, ...]
    several: bool
    p: float
    level: float


def levels(days: Sequence[float]) -> tuple[float, ...]:
    """Return the level of the test after each calibration ``(n,)``; there is none after the first.

    Args:
        days: when each was measured, ascending.
    """
    return (0.0, *(_level(count) for count in _counted(days)[1:]))


def _level(count: int) -> float:
    return TREND_YEAR / (count * (count + 1))


def _counted(days: Sequence[float]) -> list[int]:
    """Return the number of the test after each calibration in its year; years are counted from the first."""
    found, year = [0], 0
    for day in days[1:]:
        this = int((day - days[0]) // _YEAR)
        found.append(found[-1] + 1 if this == year else 1)
        year = this
    return found


@dataclass(frozen=True)
class _Pooled:
    information: Array
    mean: Array


class CalibrationSeries:
    """Calibrations of one robot in the order of their dates."""

    def __init__(
        self, estimates: Sequence[IdentifiedSubset], days: Sequence[float], directions: ChangeDirections
    ) -> None:
        """Start from calibrations that identified the same parameters; ``directions`` of these are tested."""
        self._estimates, self._days = estimates, days
        first = estimates[0]
        assert all(each.names == first.names for each in estimates)
        self._scale = np.sqrt(np.diag(first.covariance))
        values = np.array([each.values - first.values for each in estimates])
        turns = np.array(first.is_angle)
        values = np.where(turns, np.remainder(values + np.pi, 2 * np.pi) - np.pi, values)
        scales = np.outer(self._scale, self._scale)
        self._information = np.linalg.inv(np.array([each.covariance / scales for each in estimates]))  # (n, f, f)
        self._pull = np.einsum("nij,nj->ni", self._information, values / self._scale)
        self._freedom = [np.inf if each.dof is None else float(each.dof) for each in estimates]
        self._levels = levels(days)
        self._next_level = _level(_counted(days)[-1] + 1)  # of one more test in the last one's year
        self.directions = directions
        self._columns = directions.columns / self._scale[:, None]

    def first(self, count: int) -> "CalibrationSeries":
        """Return the first so many calibrations of the series."""
        return CalibrationSeries(self._estimates[:count], self._days[:count], self.directions)

    def change_points(self) -> tuple[ParameterChange, ...]:
        """Return every change, in order; each is estimated from all calibrations between its neighbours."""
        alarms: list[tuple[int, int, float]] = []
        start = 0
        for last in range(1, len(self._levels)):
            if last > start and (found := self._alarm(start, last)) is not None:
                alarms.append((found[0], last, found[1]))
                start = found[0] + 1
        starts = [0, *(after + 1 for after, _, _ in alarms)]
        ends = [*(after for after, _, _ in alarms[1:]), len(self._levels) - 1]
        return tuple(
            self._described(first, alarm, end) for first, alarm, end in zip(starts, alarms, ends, strict=False)
        )

    def detectable(self, directions: Array, start: int) -> Array:
        """Return the change ``(c,)`` of each direction ``(f, c)`` that one more calibration finds in 95 of 100.

        It is infinite for a direction that is zero.

        Args:
            start: the first calibration since the last change.
        """
        before = self._pooled(start, len(self._levels) - 1).information
        level = self._next_level / (len(self.directions.names) * (len(self._levels) - start))
        dof = min(self._freedom[start:])
        needed = t_isf(level / 2, dof) + t_isf(1 - POWER, dof)
        columns = directions / self._scale[:, None]
        known = np.einsum("ic,ij,jc->c", columns, _of_difference(before, self._information[-1]), columns)
        with np.errstate(divide="ignore"):
            sizes: Array = needed / np.sqrt(np.maximum(known, 0.0))
        return sizes

    def _pooled(self, first: int, last: int) -> _Pooled:
        information = self._information[first : last + 1].sum(axis=0)
        return _Pooled(information, np.linalg.solve(information, self._pull[first : last + 1].sum(axis=0)))

    def _alarm(self, start: int, last: int) -> tuple[int, float] | None:
        """Return the likeliest change point, and its p, where the test after calibration ``last`` rejects."""
        z = self._scores(start, last)
        dof, tried = min(self._freedom[start : last + 1]), z.size
        p = min(1.0, float(tried * 2 * t_sf(np.abs(z).max(), dof)))
        return (start + int(np.abs(z).max(axis=1).argmax()), p) if p < self._levels[last] else None

    def _scores(self, start: int, last: int) -> Array:
        """Standardized changes ``(change points, c)`` between the calibrations from ``start`` to ``last``."""
        information, pull = self._information[start : last + 1], self._pull[start : last + 1]
        before, after = np.cumsum(information, axis=0)[:-1], np.cumsum(information[::-1], axis=0)[-2::-1]
        pulls = np.cumsum(pull, axis=0)[:-1], np.cumsum(pull[::-1], axis=0)[-2::-1]
        means = [np.linalg.solve(own, of[..., None])[..., 0] for own, of in zip((before, after), pulls, strict=True)]
        known = _of_difference(before, after) @ self._columns  # (t, f, c)
        sizes = np.einsum("ic,tic->tc", self._columns, known)
        pulled = np.einsum("tic,ti->tc", known, means[1] - means[0])
        with np.errstate(divide="ignore", invalid="ignore"):
            scores: Array = np.nan_to_num(pulled / np.sqrt(sizes))
        return scores

    def _described(self, first: int, alarm: tuple[int, int, float], end: int) -> ParameterChange:
        """Estimate the change after calibration ``after`` from all calibrations from ``first`` to ``end``."""
        after, found_at, p = alarm
        # the difference d of the means before and after, with its information
        before, later = self._pooled(first, after), self._pooled(after + 1, end)
        information, d = _of_difference(before.information, later.information), later.mean - before.mean
        # how much of d' I d each direction explains
        squares = (self._columns.T @ information @ d) ** 2 / np.einsum(
            "ic,ij,jc->c", self._columns, information, self._columns
        )
        freedom = min(self._freedom[first : end + 1])
        best, dof = float(squares.max()), None if np.isinf(freedom) else int(freedom)
        left = float(d @ information @ d) - best
        # more than one direction where the best leaves more than chance; the first directions are the parameters
        several = len(d) > 1 and float(p_value_of_squares(left, len(d) - 1, dof)) < _MORE
        level, std = self._levels[found_at], np.sqrt(np.diag(np.linalg.inv(information)))
        chance = 2 * t_sf(np.abs(d) / std, freedom) * len(d)
        below, limit = (chance, level) if several else (best - squares, _APART)
        retained = [i for i in np.argsort(below, kind="stable").tolist() if below[i] < limit]
        sizes, halves = self._sizes(d, half_width_95(freedom) * std)
        return ParameterChange(
            after,
            found_at,
            tuple(self.directions.names[i] for i in retained),
            tuple(float(sizes[i]) for i in retained),
            tuple(float(halves[i]) for i in retained),
            several,
            p,
            level,
        )

    def _sizes(self, d: Array, halves: Array) -> tuple[Array, Array]:
        """Return the size of each direction ``(c,)`` and half of its 95 % interval, whatever else has changed.

        It is that of the parameter that shows the direction best: of a parameter itself, its difference.

        Args:
            d: ``(f,)`` the differences of the parameters, over their scale.
            halves: halves of their intervals.
        """
        best = np.abs(self._columns / halves[:, None]).argmax(axis=0)
        share = self._columns[best, np.arange(len(best))]
        return d[best] / share, halves[best] / np.abs(share)


def _of_difference(before: Array, after: Array) -> Array:
    """Return the information ``(..., f, f)`` of the difference of two means, (A^-1 + B^-1)^-1."""
    information: Array = before @ np.linalg.solve(before + after, after)
    return (information + np.swapaxes(information, -1, -2)) / 2
