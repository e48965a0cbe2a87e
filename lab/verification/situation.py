"""What large errors of a verification come from: a setup or tool that is another one, another arm, another unit.

The errors of a calibrated arm are a small part of a millimetre. Errors of many millimetres are mostly no change of the
arm: base, tool or both were set up anew, the file is of another arm, or its numbers are in another unit or frame. Each
is tried by trimmed least squares (``other_numbers``), and named where it brings the errors back to what the run
predicts.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from lab.calibration.gauss_newton import Observations
from lab.calibration.other_numbers import PLACED, in_other_numbers, length_words, trimmed_error
from lab.core.se3 import Array
from lab.verification.prediction import CalibrationPrediction

__all__ = ["Situation", "SituationKind", "another_unit", "situation"]

SituationKind = Literal["setup", "tool", "setup and tool", "unit", "joint unit", "mirrored", "another arm"]
_LARGE_M = 2e-3  # errors that are no change of an arm in use
_LARGE = 10.0  # times the predicted errors
_NORMAL = 3.0  # times the predicted errors: as predicted
_ALIEN = 5.0  # times the predicted errors, which no new base and tool bring down
_LIKE_NOMINAL = 0.25  # of the nominal model's errors: a calibration of this arm leaves far less
_MOST_POSES = 200


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
        ("setup and tool", PLACED),
    )
    for kind, groups in tried:
        named = tuple(group for group in PLACED if group in groups or group in refit)
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
    left = f"With {' and '.join(refit)} fitted anew errors are {length_words(left_m)}"
    return Situation(kind, f"{said}: use --refit {','.join(refit)}. {left}", refit, left_m)


@dataclass(frozen=True)
class _Trial:
    """New measurements, by the calibrated arm and by the nominal one."""

    prediction: CalibrationPrediction
    observed: Observations
    values: Array

    def left(self, groups: Sequence[str]) -> float:
        """The root mean square error (m) with groups fitted anew; infinite where they cannot be."""
        return trimmed_error(self.prediction.arm, self.observed.inputs, self.observed.points, self.values, groups)

    def in_other_numbers(self) -> Situation | None:
        """Points or joint positions in another unit, or in a mirrored frame."""
        arm, observed = self.prediction.arm, self.observed
        slides = arm.rigid.chain.prismatic
        found = in_other_numbers(arm, slides, observed.inputs, observed.points, self.values)
        return None if found is None else Situation(found.kind, found.words, (), found.left_m)

    def of_another_arm(self, promised_m: float) -> Situation | None:
        """An arm that the calibration describes about as badly as the nominal model does."""
        left = self.left(PLACED)
        arm = self.prediction.arm
        nominal = arm.nominal({target: np.zeros(3) for target in arm.targets})
        by_nominal = trimmed_error(arm, self.observed.inputs, self.observed.points, nominal, PLACED)
        if not np.isfinite(left) or left < max(_ALIEN * promised_m, _LIKE_NOMINAL * by_nominal):
            return None
        words = (
            "this is another arm than the calibrated one, or it was rebuilt or crashed: verify against its own run, or "
            f"calibrate anew. With base and tool fitted anew errors are {length_words(left)}, those of the nominal "
            f"model {length_words(by_nominal)}"
        )
        return Situation("another arm", words, (), left)
