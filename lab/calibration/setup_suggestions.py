"""Suggest changes of the set-up that make weakly observable parameters observable, tried out on the model."""

from dataclasses import dataclass

import numpy as np

from lab.calibration.fitter import NominalRobot
from lab.calibration.identifiability import condition_of
from lab.calibration.sensor import Sensor
from lab.core.se3 import Array
from lab.kinematics.effects.effect import NO_SESSIONS, SessionInfo

__all__ = ["SetupSuggestion", "changes"]

_OFFSET_M = 0.05  # by which a target is moved along x of its frame, and a second one stands from the first


@dataclass(frozen=True)
class SetupSuggestion:
    """A change of what is measured, and the condition number that the same poses would then have."""

    change: str
    condition: float


def changes(
    robot: NominalRobot,
    sensor: Sensor,
    targets: tuple[str, ...],
    groups: tuple[str, ...],
    values: Array,
    inputs: Array,
    course: SessionInfo = NO_SESSIONS,
) -> tuple[SetupSuggestion, ...]:
    """The changes that anyone can make, the best first.

    Args:
        sensor: that measures.
        values: ``(p,)`` of the arm with these targets and groups, measured by points.
        inputs: where it is measured, ``(n, joints + conditions)``.
        course: how.
    """
    arm = robot.arm_with(targets, groups, course)
    known = dict(zip(arm.names, values, strict=True))
    moved = known | {
        name: value + _OFFSET_M for name, value in known.items() if name.endswith(".x") and "tool." in name
    }
    away = np.array([moved[name] for name in arm.names])
    more = robot.arm_with((*targets, "another"), groups, course)
    first = [known[f"tool.{targets[0]}.{axis}"] for axis in "xyz"]
    second = dict(zip("xyz", np.array(first) + np.array([_OFFSET_M, _OFFSET_M, 0.0]), strict=True))
    both = known | {f"tool.another.{axis}": value for axis, value in second.items()}
    found = [
        SetupSuggestion(
            f"the target {1e3 * _OFFSET_M:g} mm elsewhere on what carries it", condition_of(arm, away, inputs)
        ),
        SetupSuggestion("a second target", condition_of(more, np.array([both[name] for name in more.names]), inputs)),
    ]
    if (posed := sensor.with_orientation(arm, targets[0])) is not None:
        seen = np.concatenate([inputs, np.broadcast_to([1.0, 0.0, 0.0, 0.0], (len(inputs), 4))], axis=1)
        found.append(
            SetupSuggestion("orientations measured too", condition_of(posed.model, posed.nominal(values), seen))
        )
    return tuple(sorted(found, key=lambda change: change.condition))
