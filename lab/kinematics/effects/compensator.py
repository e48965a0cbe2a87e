"""A gravity compensator: a spring between two links that bears part of the arm's weight, and whose joint gives way.

A spring of stiffness k and free length l0 whose ends are at distances a and b from the joint pulls with the torque
k a b sin(phi) (1 - l0 / l), where l^2 = a^2 + b^2 - 2 a b cos(phi). With s^2 = a^2 + b^2 and r = 2 a b / s^2 its length
is s sqrt(1 - r cos(phi)): the torque is a function of the joint's own angle, whose first two harmonics hold all but
about 3 r^2 / 32 of it. They are fitted, as a spring's ends are seldom known.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.effects.conditions import PoseConditions
from lab.kinematics.effects.effect import (
    ArmFacts,
    Effect,
    FittedGroup,
    MovesJoints,
    SimulatedEffect,
    VirtualEffect,
    joint_terms,
    turning_joints,
)
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import joint_parameter

__all__ = ["Compensator", "CompensatorSpring", "compensator"]

_JOINT = 1  # from 0: the one that lifts the arm, where compensators are
_ORDERS = (1, 2)
_RATIO, _PRELOAD = 0.2, 0.7  # r, and l0 / s, of a virtual arm: ends at 0.1 and 1 of a length, stretched at all angles


def compensator(chain: JointSpec) -> Effect:
    """The fitted group: sine and cosine of joint 2's angle and of twice that, times what it gives way to the spring."""
    _refuse_without(chain, "--model compensator")
    parameters = tuple(
        joint_parameter("compensator", _JOINT, f"spring_{function}{order}", wave=order)
        for order in _ORDERS
        for function in ("sin", "cos")
    )

    def offsets(joints: Array, _: Array, values: Array) -> tuple[Array, Array]:
        angle = joints[:, _JOINT]
        derivative = np.zeros((*joints.shape, len(parameters)))
        waves = [function(order * angle) for order in _ORDERS for function in (np.sin, np.cos)]
        derivative[:, _JOINT] = np.stack(waves, axis=1)
        return derivative @ values, derivative

    where = [(_JOINT, (function, order, _JOINT)) for order in _ORDERS for function in ("sin", "cos")]
    return Effect("compensator", parameters, offsets, plain=lambda values: joint_terms(values, *where))


@dataclass(frozen=True)
class CompensatorSpring(SimulatedEffect, MovesJoints):
    """Of one arm; a spring that is stretched at all angles, and pulls in neither direction where joint 2 is at zero.

    Attributes:
        gives_rad: how far joint 2 would give way to k a b, the torque of a spring without free length at 90 degrees.
    """

    gives_rad: float

    @classmethod
    def none(cls, joints: int) -> Self:
        """No spring."""
        return cls(0.0)

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """Joint 2's, by the spring's torque at its angle."""
        offsets: Array = np.zeros(joints.shape)
        if self.gives_rad:
            angle = joints[:, _JOINT]
            offsets[:, _JOINT] = self.gives_rad * np.sin(angle) * (1 - _PRELOAD / np.sqrt(1 - _RATIO * np.cos(angle)))
        return offsets

    def true_parameters(self) -> dict[str, float]:
        """The first two harmonics; those of the cosine are zero, by symmetry."""
        angle = np.linspace(-np.pi, np.pi, 256, endpoint=False)
        at = self.joint_offsets(np.tile(angle[:, None], (1, _JOINT + 1)), PoseConditions({}, len(angle), ()))
        sines = {f"joint2.spring_sin{k}": float(2 * np.mean(at[:, _JOINT] * np.sin(k * angle))) for k in _ORDERS}
        return sines | {f"joint2.spring_cos{k}": 0.0 for k in _ORDERS}

    def refuse_unfit(self, chain: JointSpec) -> None:
        """The spring sits at joint 2."""
        if self.gives_rad:
            _refuse_without(chain, "effects: gives_rad")


@dataclass(frozen=True)
class Compensator(VirtualEffect):
    """A gravity compensator of a virtual arm."""

    compensator_mrad: float = 0.0
    """How far joint 2 gives way to its gravity compensator, a spring, at 90 degrees."""

    groups: ClassVar[tuple[FittedGroup, ...]] = (
        FittedGroup("compensator", lambda arm: compensator(arm.chain), "joint 2 gives way to a spring"),
    )

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """As it is given."""
        if self.compensator_mrad:
            _refuse_without(arm.chain, "--compensator-mrad")
        return CompensatorSpring(self.compensator_mrad / 1e3 / (1 - _PRELOAD))


def _refuse_without(chain: JointSpec, what: str) -> None:
    """A LabError where there is no joint 2 that turns."""
    if _JOINT not in turning_joints(chain):
        raise LabError(f"{what}: robot {chain.name} has no joint 2 that turns, where a compensator would be")
