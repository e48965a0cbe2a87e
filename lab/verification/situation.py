"""What large errors of a verification come from: a setup or tool that is another one, another arm, another unit.

The errors of a calibrated arm are a small part of a millimetre. Errors of many millimetres are mostly no change of the
arm: base, tool or both were set up anew, the file is of another arm, or its numbers are in another unit or frame. Each
is tried by ordinary least squares, and named where it brings the errors back to what the run predicts. The worst part
of the points is left out of each fit (least trimmed squares: Rousseeuw & Van Driessen 2006), so that a few bad readings
neither hide a situation nor look like one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations, fit
from lab.calibration.identify import PLAUSIBLE_SPREAD, spread
from lab.calibration.initial_guess import columns_of, initial_guess
from lab.core.measurements import seen_mask
from lab.core.se3 import Array
from lab.verification.prediction import CalibrationPrediction

__all__ = ["Situation", "SituationKind", "another_unit", "situation"]

SituationKind = Literal["setup", "tool", "setup and tool", "unit", "joint unit", "mirrored", "another arm"]
_LARGE_M = 2e-3  # errors that are no change of an arm in use
_LARGE = 10.0  # times the predicted errors
_NORMAL = 3.0  # times the predicted errors: as predicted
_ALIEN = 5.0  # times the predicted errors, which no new base and tool bring down
_LIKE_NOMINAL = 0.25  # of the nominal model's errors: a calibration of this arm leaves far less
_NEAR = 0.02  # of the points' spread: a model of this kind of arm in the right unit and frame
_CLEARLY = 5.0  # times less, in another unit or frame
_KEPT = 0.7  # of the points that are fitted
_TRIMS = 4
_LEAST_FREEDOM = 3
_MOST_POSES = 200
_BOTH = ("base", "tool")
_FACTORS = {
    1e3: "m where mm are expected",
    25.4: "inches where mm are expected",
    1e-3: "mm where m are expected, or in µm where mm are expected",
    25.4e-3: "inches where m are expected",
}
_JOINT_FACTORS = {
    180 / np.pi: "radians where degrees are expected",
    np.pi / 180: "degrees where radians are expected",
}


@dataclass(frozen=True)
class Situation:
    """What the errors come from, where that is no change of the arm.

    Attributes:
        words: what it is and what to do, then the numbers: two sentences.
        refit: what ``--refit`` is to name; nothing where it does not help.
        left_m: root mean square error that is left in this situation.
    """

    kind: SituationKind
    words: str
    refit: tuple[str, ...]
    left_m: float


def situation(
    prediction: CalibrationPrediction, observed: Observations, values: Array, promised_m: float, refit: Sequence[str]
) -> Situation | None:
    """Return what the errors come from; None where they are small, or nothing of this kind explains them.

    Args:
        values: ``(p,)`` the arm's, with what was fitted anew.
        promised_m: root mean square error that the run predicts.
        refit: what was fitted anew already.
    """
    trial = _Trial(prediction, observed.thinned(_MOST_POSES), values)
    if trial.left(()) <= max(_LARGE_M, _LARGE * promised_m):
        return None
    tried: tuple[tuple[SituationKind, tuple[str, ...]], ...] = (
        ("setup", ("base",)),
        ("tool", ("tool",)),
        ("setup and tool", _BOTH),
    )
    for kind, groups in tried:
        named = tuple(group for group in _BOTH if group in groups or group in refit)
        if set(named) != set(refit) and (left := trial.left(named)) <= _NORMAL * promised_m:
            return _set_up_anew(kind, named, left)
    return trial.in_other_numbers() or trial.of_another_arm(promised_m)


def another_unit(prediction: CalibrationPrediction, observed: Observations) -> Situation | None:
    """Return the unit in which measured points, or joint positions, are those of the arm; None if there is none."""
    return _Trial(prediction, observed.thinned(_MOST_POSES), prediction.values).in_other_numbers()


def _set_up_anew(kind: SituationKind, refit: tuple[str, ...], left_m: float) -> Situation:
    said = {
        "setup": "the robot or the instrument was set up anew",
        "tool": "another tool is mounted, or its targets were moved",
        "setup and tool": "robot or instrument were set up anew, with another tool",
    }[kind]
    flag = ",".join(refit)
    return Situation(
        kind, f"{said}: use --refit {flag}. With {' and '.join(refit)} fitted anew errors are {_mm(left_m)}", refit,
        left_m,
    )  # fmt: skip


@dataclass(frozen=True)
class _Trial:
    """New measurements, by the calibrated arm and by the nominal one."""

    prediction: CalibrationPrediction
    observed: Observations
    values: Array

    def left(self, groups: Sequence[str]) -> float:
        """The root mean square error (m) with groups fitted anew; infinite where they cannot be."""
        return self._left(self.observed.inputs, self.observed.points, self.values, groups)

    def in_other_numbers(self) -> Situation | None:
        """Points or joint positions in another unit, or in a mirrored frame."""
        inputs, points = self.observed.inputs, self.observed.points
        plain, near = self.left(_BOTH), _NEAR * self._spread(inputs)
        for factor, said in _FACTORS.items():
            if not PLAUSIBLE_SPREAD[0] <= factor * spread(points) / self._spread(inputs) <= PLAUSIBLE_SPREAD[1]:
                continue
            left = self._left(inputs, factor * points, self.values, _BOTH)
            if left < near and _CLEARLY * left < factor * plain:
                words = f"wrong unit: the points are in {said}. Times {factor:g} errors are {_mm(left)}"
                return Situation("unit", words, (), left)
        slides = np.array(self.prediction.arm.rigid.chain.prismatic)
        for factor, said in _JOINT_FACTORS.items():
            turned = inputs.copy()
            turned[:, : len(slides)] *= np.where(slides, 1.0, factor)
            left = self._left(turned, points, self.values, _BOTH)
            if left < _NEAR * self._spread(turned) and _CLEARLY * left < plain:
                words = f"wrong unit: the joint positions are in {said}. Converted, errors are {_mm(left)}"
                return Situation("joint unit", words, (), left)
        left = self._left(inputs, points * [-1.0, 1.0, 1.0], self.values, _BOTH)
        if left < near and _CLEARLY * left < plain:
            words = (
                "the points are mirrored: two of their axes are swapped, or one is negated; export them in a "
                f"right-handed frame. Mirrored back errors are {_mm(left)}"
            )
            return Situation("mirrored", words, (), left)
        return None

    def of_another_arm(self, promised_m: float) -> Situation | None:
        """An arm that the calibration describes about as badly as the nominal model does."""
        left = self.left(_BOTH)
        arm = self.prediction.arm
        nominal = arm.nominal({target: np.zeros(3) for target in arm.targets})
        by_nominal = self._left(self.observed.inputs, self.observed.points, nominal, _BOTH)
        if not np.isfinite(left) or left < max(_ALIEN * promised_m, _LIKE_NOMINAL * by_nominal):
            return None
        words = (
            "this is another arm than the calibrated one, or it was rebuilt or crashed: verify against its own run, or "
            f"calibrate anew. With base and tool fitted anew errors are {_mm(left)}, those of the nominal model "
            f"{_mm(by_nominal)}"
        )
        return Situation("another arm", words, (), left)

    def _spread(self, inputs: Array) -> float:
        """Of the predicted points (m)."""
        predicted = self.prediction.arm.points(inputs, self.values)
        return spread(np.where(np.isnan(self.observed.points), np.nan, predicted))

    def _left(self, inputs: Array, points: Array, values: Array, groups: Sequence[str]) -> float:
        """Root mean square length of the best part of the errors, as of numbers that nothing was fitted to."""
        arm, seen = self.prediction.arm, seen_mask(points)
        columns, count = list(columns_of(arm, groups)) if groups else [], int(seen.sum())
        kept = max(int(np.ceil(_KEPT * count)), -(-(len(columns) + _LEAST_FREEDOM) // 3))
        if kept > count or np.isnan(arm.points(inputs, values)).any():
            return float("inf")
        fitted, least = seen, float("inf")
        for _ in range(_TRIMS if columns else 1):
            placed = values
            if columns:
                some = _only(Observations(inputs, points, np.ones(seen.shape)), fitted)
                placed = initial_guess(arm, some, values, groups)
                if len(groups) > 1:
                    placed = fit(arm, some, columns, placed, tolerance_m=1e-7, most_steps=20).values
            errors = np.where(seen, ((points - arm.points(inputs, placed)) ** 2).sum(axis=2), np.inf)
            bound = np.partition(errors[seen], kept - 1)[kept - 1]
            best = errors <= bound
            square = float(errors[best].sum())
            if not square < least:
                break
            least, fitted = square, best
        return float(np.sqrt(least / kept * 3 * kept / (3 * kept - len(columns))))


def _only(observed: Observations, seen: NDArray[np.bool_]) -> Observations:
    """The same with some of the points alone."""
    rows = np.flatnonzero(seen.any(axis=1))
    points = np.where(seen[:, :, None], observed.points, np.nan)
    return replace(observed, points=points).take(rows)


def _mm(metres: float) -> str:
    return f"{1e3 * metres:,.0f} mm" if metres >= 0.1 else f"{1e3 * metres:.3g} mm"
