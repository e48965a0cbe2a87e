"""Joints whose springs are not linear: joint i gives way by d_i g_i^3 beside what is in proportion to its torque g_i.

Harmonic drives grow stiffer with torque (d_i < 0). The cube is that of the torque at the measured joint positions: what
the joint gives way changes it by one part in a thousand.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.effects.conditions import PAYLOAD
from lab.kinematics.effects.effect import (
    ArmFacts,
    Effect,
    FittedGroup,
    SimulatedEffect,
    VirtualEffect,
    joint_terms,
    levers,
)
from lab.kinematics.parameter import joint_parameter

__all__ = ["Hardening", "HardeningSprings", "hardening"]

_TORQUE_NM = 30.0  # at which the option states its size
_SCALE = 1e-7  # rad/(Nm)^3


def hardening(loads: Loads) -> Effect:
    """The fitted group: d_i of the joints that bear the arm's weight."""
    bearing, slides = list(loads.bearing(rng_for(0, "structure"))), loads.chain.prismatic
    parameters = tuple(
        joint_parameter(
            "hardening", i, "hardening", "compliance", unit="m/N^3" if slides[i] else "rad/(Nm)^3", scale=_SCALE
        )
        for i in bearing
    )

    def offsets(joints: Array, payload: Array, values: Array) -> tuple[Array, Array]:
        torque = loads.forces(joints, payload[:, 0])[0]
        derivative = np.zeros((*joints.shape, len(bearing)), dtype=torque.dtype)
        for column, i in enumerate(bearing):
            derivative[:, i, column] = torque[:, i] ** 3
        return derivative @ values, derivative

    where = [(i, ("torque cubed", i)) for i in bearing]
    return Effect("hardening", parameters, offsets, (PAYLOAD,), plain=lambda values: joint_terms(values, *where))


def _fitted(arm: ArmFacts) -> Effect:
    if arm.chain.has_loops or arm.loads is None:
        why = "has loops" if arm.chain.has_loops else "is a table without masses"
        raise LabError(f"--model hardening: robot {arm.chain.name} {why}, so nothing is known to load its joints")
    return hardening(arm.loads)


@dataclass(frozen=True)
class HardeningSprings(SimulatedEffect):
    """Of one arm; ``simulation.elastic`` finds how it settles.

    Attributes:
        cubic_rad_per_nm3: ``(n,)``, by which a joint gives way for the cube of its torque; below zero it hardens.
    """

    cubic_rad_per_nm3: Array

    @classmethod
    def none(cls, joints: int) -> Self:
        """Linear springs."""
        return cls(np.zeros(joints))

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """The payload."""
        return (PAYLOAD,) if self.cubic_rad_per_nm3.any() else ()

    def true_parameters(self) -> dict[str, float]:
        """d_i."""
        return {f"joint{i + 1}.hardening": float(value) for i, value in enumerate(self.cubic_rad_per_nm3)}


@dataclass(frozen=True)
class Hardening(VirtualEffect):
    """Springs of a virtual arm's joints that grow stiffer with torque."""

    hardening_mrad: float = 0.0
    """By how much less than in proportion joints that bear the arm's weight give way at 30 Nm."""

    groups: ClassVar[tuple[FittedGroup, ...]] = (
        FittedGroup("hardening", _fitted, "joints that grow stiffer, or softer, with torque"),
    )

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """The same for every joint that bears the arm's weight.

        Raises:
            LabError: the arm has no masses.
        """
        cubic = np.zeros(arm.chain.size)
        if self.hardening_mrad:
            if arm.loads is None:
                raise LabError(f"--hardening-mrad: robot {arm.chain.name} has no masses, so nothing bends it")
            bearing = list(arm.loads.bearing(rng_for(0, "structure")))
            cubic[bearing] = -self.hardening_mrad / 1e3 / _TORQUE_NM**3
        return HardeningSprings(levers(arm.chain) ** 4 * cubic)
