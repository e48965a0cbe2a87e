"""Gross mistakes: discrete ones, compared by description length where the placed nominal arm misses by much.

A row is described by its miss where the arm is placed best, or, where that is far off, as one that could be anywhere:
so a few wrong rows neither hide a mistake nor look like one (Rissanen 1978). Mistakes are undone greedily, the one that
shortens the description most first.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.measurements import Measurements, evenly
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.diagnosis.hypothesis import Diagnosable, Finding, Hypothesis, MeasuresOrientations, hypotheses_of
from lab.diagnosis.placement import Placement, placed, refined
from lab.diagnosis.reading_mistakes import joint_mistakes, point_mistakes, row_mistakes, zero_mistakes
from lab.kinematics.model import RigidArm

__all__ = ["Gross", "gross_mistakes"]

_SCALES_M = np.geomspace(1e-4, 2e-2, 12)  # of ordinary misses
_ANYWHERE_M = 1.0  # the extent of where a wrong row's point may be
_SHARE_WRONG = 0.01  # of rows, before anything is known
_GAIN = 12.0  # nats by which a mistake has to shorten the description, beside the choice of it
_NEAR_RIVAL = 6.0  # nats: a hypothesis that is as good to so little is a rival
_MOST_MISTAKES = 3
_FEW_ROWS, _MOST_ROWS = 40, 120  # by which hypotheses are compared: placed alone, and with the links refined
_REFINED = 8  # hypotheses
_LARGE, _FAR = 3e-3, 8.0  # m of the median miss, and times it of the largest: below both nothing is searched
_FAR_FOR_ALL = 5.0  # times that median: what one joint read wrongly does at least to most rows
_NEARER = 8.0  # times, that mistakes undone bring the arm nearer to most rows
_STRANGE_PRICE = 8.0  # nats of the links' distance from nominal: one of them is far beyond any tolerance
_MOST_OUTLIERS, _MOVED_ROWS = 0.3, 3  # share of rows, and rows in succession at an end that are no outliers
_ROBOT = 6.0  # nats of the choice of another robot


@dataclass(frozen=True)
class Gross:
    """Gross mistakes of measurements.

    Attributes:
        findings: the one that shortens the description most first.
        corrected: the measurements with all of them undone.
        outliers: rows that are far off with them undone, by their ids: root mean square length of their errors (m).
    """

    findings: tuple[Finding, ...]
    corrected: Measurements
    outliers: Mapping[str, float]


@dataclass(frozen=True)
class _Reading:
    """Measurements as one hypothesis reads them, with how the placed arm misses them."""

    data: Measurements
    placement: Placement

    @property
    def misses(self) -> Array:
        """Miss of each row ``(n,)`` (m)."""
        return self.placement.misses

    def length(self, rows: int) -> float:
        """Return the description length (nats) of so many rows and of the links."""
        return _described(self.misses, rows, _extent(self.data))[0] + self.placement.price

    @property
    def rows(self) -> int:
        """Number of rows with a reading of their own."""
        return int((~np.isnan(self.misses)).sum())

    @property
    def ordinary_m(self) -> float:
        """Miss of a sound row."""
        return _described(self.misses, self.rows, _ANYWHERE_M)[1]

    @property
    def is_mostly_sound(self) -> bool:
        """Whether three quarters of the rows are nearer than by any joint that is read wrongly."""
        known = self.misses[~np.isnan(self.misses)]
        return bool(len(known)) and float(np.quantile(known, 0.75)) <= _FAR_FOR_ALL * _LARGE

    def is_near(self, before: "_Reading") -> bool:
        """Check whether the arm is near most rows now, or much nearer than before."""
        middle, was = (float(np.nanmedian(each.misses)) for each in (self, before))
        return middle < max(_LARGE, was / _NEARER)

    @property
    def misses_by_much(self) -> bool:
        """Whether anything can be gained by reading otherwise."""
        known = self.misses[~np.isnan(self.misses)]
        if not len(known):
            return False
        middle = float(np.median(known))
        far = middle > _LARGE or float(known.max()) > _FAR * max(middle, _SCALES_M[0])
        return far or self.placement.price > _STRANGE_PRICE


def _described(misses: Array, rows: int, extent_m: float) -> tuple[float, float]:
    """Return the description length (nats) of rows by their misses, and the scale of the sound ones (m).

    Args:
        rows: that are to be described: those that a reading drops count as wrong.
        extent_m: of where a wrong row may be.
    """
    known = misses[~np.isnan(misses)]
    sound = 3 * (np.log(_SCALES_M) + 0.5 * (known[:, None] / _SCALES_M) ** 2)
    wrong = 3 * np.log(extent_m) - np.log(_SHARE_WRONG)
    lengths = np.minimum(sound, wrong).sum(axis=0) + wrong * max(rows - len(known), 0)
    best = int(np.argmin(lengths))
    return float(lengths[best]), float(_SCALES_M[best])


def _used_points(data: Measurements) -> Array:
    """Return the points of the rows that are not to be skipped; NaN in the others."""
    return np.where(data.used[:, None, None], data.points, np.nan)


def _extent(data: Measurements) -> float:
    """Return the extent (m) of measured points; one metre of other readings."""
    if data.points.shape[2] != 3 or not np.isfinite(data.points).any():
        return _ANYWHERE_M
    return max(float(np.nanmax(np.nanstd(data.points, axis=0))) * 4, _ANYWHERE_M)


def gross_mistakes(
    sensor: object,
    arm: RigidArm,
    data: Measurements,
    nominal: Array,
    others: Iterable[tuple[str, Callable[[], RigidArm]]] = (),
    seed: int = 0,
) -> Gross:
    """Find the mistakes of reading that explain why a nominal arm misses measurements.

    Args:
        sensor: of the measurements; one that does not know how an arm misses its readings reads points.
        arm: nominal, measured by points.
        nominal: ``(p,)`` its parameters.
        others: names of other robots with as many joints, and functions that build their arms.
    """
    task = _Task(sensor, arm, nominal, seed)
    here = first = task.refined(data)
    findings = list[Finding]()
    while here.misses_by_much and len(findings) < _MOST_MISTAKES:
        found = task.best(here, others if not findings else ())
        if found is None:
            break
        findings.append(found[0])
        task, here = task.by(found[0].hypothesis), found[1]
    if findings and not here.is_near(first):  # no reading explains the misses: what only shrinks them is no cause
        findings, here = [], first
    limit = _FAR * max(here.ordinary_m, _SCALES_M[0])
    far = _alone(np.nan_to_num(here.misses, nan=0.0) > limit)
    outliers = {data.ids[i]: float(np.sqrt(3) * here.misses[i]) for i in np.flatnonzero(far)}
    return Gross(tuple(findings), here.data, outliers)


def _alone(far: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which rows are outliers: none where too many are far off, and none at an end, where something moved."""
    if far.mean() >= _MOST_OUTLIERS:
        return np.zeros_like(far)
    alone = far.copy()
    for rows in (slice(None), slice(None, None, -1)):
        inner = far[rows]
        length = int(np.argmin(inner))  # rows at this end that are all far
        if length >= _MOVED_ROWS:
            alone[rows][:length] = False
    return alone


@dataclass(frozen=True)
class _Task:
    """Comparison of how one sensor's readings of one arm may be read."""

    sensor: object
    arm: RigidArm
    nominal: Array
    seed: int

    @property
    def _by_sensor(self) -> bool:
        return isinstance(self.sensor, Diagnosable)

    def read(self, data: Measurements) -> _Reading:
        """Return measurements with the misses of the nominal arm, where it is placed best."""
        if isinstance(self.sensor, Diagnosable):
            misses = self.sensor.misses(self.arm, data, self.nominal)
            return _Reading(data, Placement(self.nominal, np.empty(0), misses))
        at = placed(self.arm, data.joints, _used_points(data), self.nominal, rng_for(self.seed, "null"))
        return _Reading(data, self._with_orientations(data, at))

    def refined(self, data: Measurements) -> _Reading:
        """Return measurements with the misses of an arm whose links may be off, too."""
        reading = self.read(data)
        if self._by_sensor:
            return reading
        at = refined(self.arm, data.joints, _used_points(data), self.nominal, reading.placement)
        return _Reading(data, self._with_orientations(data, at))

    def _with_orientations(self, data: Measurements, at: Placement) -> Placement:
        """Return a placement whose misses are those of measured orientations, too."""
        if not isinstance(self.sensor, MeasuresOrientations):
            return at
        turned = self.sensor.turned_misses(self.arm, data, at.values)
        return replace(at, misses=np.where(np.isnan(turned), at.misses, np.hypot(at.misses, turned)))

    def best(
        self, here: _Reading, others: Iterable[tuple[str, Callable[[], RigidArm]]]
    ) -> tuple[Finding, _Reading] | None:
        """Return the hypothesis that shortens the description most, with the measurements read so; None if none."""
        # all hypotheses by few rows, links as they are; the best of them by more rows, with the links refined
        hypotheses = self._hypotheses(here)
        few = self.read(self._thinned(here.data, _FEW_ROWS, here))
        rough = sorted((-self._gain(each, here, few, _FEW_ROWS), i) for i, each in enumerate(hypotheses))
        base = self.refined(self._thinned(here.data, _MOST_ROWS, here))
        tried = list[tuple[float, Hypothesis, "_Task"]]()
        for _, i in rough[:_REFINED]:
            of = hypotheses[i]
            tried.append((self._gain(of, here, base, _MOST_ROWS), of, self.by(of)))
        for name, made in others:
            other = self._of_robot(made)
            gain = base.length(base.rows) - other.refined(base.data).length(base.rows) - _ROBOT
            tried.append((gain, _other_robot(name), other))
        tried.sort(key=lambda each: -each[0])
        if not tried or tried[0][0] < _GAIN:
            return None
        gain, hypothesis, task = tried[0]
        assert hypothesis.corrected is not None
        rivals = tuple(each.key for other_gain, each, _ in tried[1:] if gain - other_gain < _NEAR_RIVAL)
        after = task.refined(hypothesis.corrected(here.data))
        before_m, after_m = (float(np.sqrt(3) * np.nanmedian(each.misses)) for each in (here, after))
        return Finding(hypothesis, 2 * gain, (), (), before_m, before_m, after_m, rivals), after

    def _hypotheses(self, here: _Reading) -> list[Hypothesis]:
        known = list(hypotheses_of(self.sensor, self.arm, here.data))
        if self._by_sensor and here.is_mostly_sound:  # what is wrong with all rows does not explain a few
            return known
        whole = list(joint_mistakes(self.arm.chain, here.data))
        if self._by_sensor:
            return known + whole
        whole += point_mistakes()
        known += zero_mistakes(self.arm, here.data, self.nominal, here.placement)
        known += row_mistakes(self.arm, here.data, here.placement, here.ordinary_m, whole)
        return known + whole

    def _gain(self, hypothesis: Hypothesis, here: _Reading, base: _Reading, rows: int) -> float:
        """Return by how much a hypothesis shortens the description of so many rows (nats).

        Args:
            base: these rows as they are; with the links refined, where those of the hypothesis are to be.
        """
        assert hypothesis.corrected is not None
        task = self.by(hypothesis)
        try:
            data = self._thinned(hypothesis.corrected(here.data), rows, here)
            reading = task.refined(data) if base.placement.price or rows > _FEW_ROWS else task.read(data)
        except (LabError, np.linalg.LinAlgError):
            return -np.inf
        scaled = 3 * base.rows * float(np.log(dict(hypothesis.data).get("factor", 1.0)))  # as densities are
        if self._by_sensor:  # rows that are wrong in either unit are no better described in a larger one
            scaled = min(scaled, 0.0)
        choice = hypothesis.price_of_alternatives / 2  # nats
        return base.length(base.rows) - reading.length(base.rows) + scaled - choice

    def _thinned(self, data: Measurements, rows: int, here: _Reading) -> Measurements:
        """Return so many rows, evenly, with those that are far off now.

        All of a sensor that knows its misses, as rows of a picture belong together.
        """
        some = None if self._by_sensor else evenly(len(data), rows)
        if some is None:
            return data
        far = np.flatnonzero(here.misses > _FAR * here.ordinary_m)[:rows]
        return data[np.union1d(some, far)]

    def by(self, hypothesis: Hypothesis) -> "_Task":
        """Return the task by the sensor of a hypothesis, where it is another one."""
        return self if hypothesis.sensor is None else replace(self, sensor=hypothesis.sensor)

    def _of_robot(self, made: Callable[[], RigidArm]) -> "_Task":
        arm = made()
        return replace(self, arm=arm, nominal=arm.nominal({target: np.zeros(3) for target in arm.targets}))


def _other_robot(name: str) -> Hypothesis:
    return Hypothesis("other_robot", (name,), corrected=lambda rows: replace(rows, robot=name))
