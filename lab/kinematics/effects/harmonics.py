"""Runout of gear or encoder: joint i is at q_i + s_i sin(k q_i) + c_i cos(k q_i), once (k = 1) and twice a turn."""

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
    turning_joints,
)
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import joint_parameter

__all__ = ["Harmonics", "Runout", "harmonics"]

_NAMES = ("sin1", "cos1", "sin2", "cos2")


def harmonics(chain: JointSpec, order: int = 1) -> Effect:
    """The fitted group of one order k: s_i and c_i of every hinge."""
    turning = turning_joints(chain)
    group = "harmonics" if order == 1 else f"harmonics{order}"
    parameters = tuple(joint_parameter(group, i, f"{wave}{order}") for i in turning for wave in ("sin", "cos"))

    def offsets(joints: Array, _: Array, values: Array) -> tuple[Array, Array]:
        derivative = np.zeros((*joints.shape, len(parameters)))
        for k, i in enumerate(turning):
            derivative[:, i, 2 * k] = np.sin(order * joints[:, i])
            derivative[:, i, 2 * k + 1] = np.cos(order * joints[:, i])
        return derivative @ values, derivative

    return Effect(group, parameters, offsets)


@dataclass(frozen=True)
class Runout(SimulatedEffect, MovesJoints):
    """Of one arm.

    Attributes:
        harmonics_rad: ``(n, 4)``: coefficients of sin q, cos q, sin 2q, cos 2q of the joint's own position q. Zero for
            a slide.
    """

    harmonics_rad: Array
    addition_order: ClassVar[int] = 1

    @classmethod
    def none(cls, joints: int) -> Self:
        """Joints that run true."""
        return cls(np.zeros((joints, 4)))

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """Waves of the joint's position."""
        if not self.harmonics_rad.any():
            return np.zeros(joints.shape)
        sin1, cos1, sin2, cos2 = self.harmonics_rad.T
        once, twice = (np.sin(joints), np.cos(joints)), (np.sin(2 * joints), np.cos(2 * joints))
        waves: Array = sin1 * once[0] + cos1 * once[1] + sin2 * twice[0] + cos2 * twice[1]
        return waves

    def true_parameters(self) -> dict[str, float]:
        """s_i and c_i of both orders."""
        rows = enumerate(self.harmonics_rad.tolist(), start=1)
        return {f"joint{i}.{name}": value for i, row in rows for name, value in zip(_NAMES, row, strict=True)}

    def refuse_unfit(self, chain: JointSpec) -> None:
        """A slide does not turn.

        Raises:
            LabError: a slide is to have harmonics.
        """
        if self.harmonics_rad[list(chain.prismatic)].any():
            raise LabError(f"robot {chain.name}: a slide has no harmonics_rad; give it zeros")


@dataclass(frozen=True)
class Harmonics(VirtualEffect):
    """Runout of a virtual arm."""

    harmonic_mrad: float = 0.0
    """Runout of each joint once a turn, with a random phase."""
    harmonic2_mrad: float = 0.0
    """Runout of each joint twice a turn, with a random phase."""

    draws: ClassVar[int] = 2
    groups: ClassVar[tuple[FittedGroup, ...]] = (
        FittedGroup("harmonics", lambda arm: harmonics(arm.chain)),
        FittedGroup("harmonics2", lambda arm: harmonics(arm.chain, 2)),
    )

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """The same amplitude for every hinge; the phases are drawn, those of each order from their own stream."""
        sizes, hinge = (self.harmonic_mrad / 1e3, self.harmonic2_mrad / 1e3), ~np.array(arm.chain.prismatic)
        phases = [rng.uniform(0.0, 2 * np.pi, arm.chain.size) for rng in rngs]
        waves = [
            (size * wave(phase)) * hinge for size, phase in zip(sizes, phases, strict=True) for wave in (np.cos, np.sin)
        ]
        return Runout(np.stack(waves, axis=1))
