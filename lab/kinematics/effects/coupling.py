"""Transmission errors: gear ratios and couplings between joints."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from lab.core.errors import LabError, option_name
from lab.core.se3 import Array
from lab.core.units import PPM
from lab.kinematics.effects.effect import (
    ArmFacts,
    Effect,
    FittedGroup,
    MovesJoints,
    OnePerJoint,
    PoseConditions,
    SimulatedEffect,
    TermFamily,
    VirtualEffect,
    from_signals,
    turning_joints,
)
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import joint_parameter

__all__ = [
    "Coupling",
    "FullCoupling",
    "Gear",
    "GearErrors",
    "JointCoupling",
    "gear",
]


def _coupling(group: str, pairs: Sequence[tuple[int, int]]) -> Effect:
    """Return the fitted group: k_ij of these pairs of joints, from 0."""
    parameters = tuple(joint_parameter(group, i, f"coupling{j + 1}", "ratio") for i, j in pairs)
    others = [j for _, j in pairs]
    plain = [("position", j) for j in others]
    return from_signals(group, parameters, [i for i, _ in pairs], lambda joints, _: joints[:, others], plain)


def _neighbours(arm: ArmFacts) -> list[tuple[int, int]]:
    """List every hinge with its inner neighbour, and the last one also with the one before."""
    last = arm.chain.size - 1
    pairs = [*((i, i - 1) for i in range(1, arm.chain.size)), *([(last, last - 2)] if last >= 2 else [])]
    return [pair for pair in pairs if set(pair) <= set(turning_joints(arm.chain))]


def _of_one_pair(arm: ArmFacts, joint: int, other: int) -> Effect:
    name = _COUPLED.name(joint, other)
    if (joint, other - 1) not in _all_pairs(arm):
        raise LabError(f"{option_name('model')} {name}: give two different joints that turn, of 1 to {arm.chain.size}")
    return _coupling(name, [(joint, other - 1)])


def _all_pairs(arm: ArmFacts) -> list[tuple[int, int]]:
    return list(itertools.permutations(turning_joints(arm.chain), 2))


_COUPLED = TermFamily(
    "coupling",
    "the joint that it follows",
    _of_one_pair,
    lambda arm: [(i, j + 1) for i, j in _all_pairs(arm)],
    lambda joint, other: f"joint {joint} follows joint {other}",
)


@dataclass(frozen=True)
class JointCoupling(SimulatedEffect, MovesJoints):
    """Joint coupling of one arm.

    Attributes:
        coupling: ``(n, n)``; joint i moves by coupling[i, j] per unit of joint j's position. Zero diagonal.
    """

    coupling: Array

    def __post_init__(self) -> None:
        if self.coupling.ndim == 2 and np.diag(self.coupling).any():
            raise LabError("effects: coupling of a joint with itself is its gear error; give that instead")

    @classmethod
    def none(cls, joints: int) -> Self:
        """Return uncoupled joints."""
        return cls(np.zeros((joints, joints)))

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """Return offsets in proportion to the other joints' positions."""
        return np.asarray(joints @ self.coupling.T)

    def true_parameters(self) -> dict[str, float]:
        """Return k_ij of all pairs."""
        n = len(self.coupling)
        pairs = ((i, j) for i in range(n) for j in range(n) if i != j)
        return {f"joint{i + 1}.coupling{j + 1}": float(self.coupling[i, j]) for i, j in pairs}


@dataclass(frozen=True)
class Coupling(VirtualEffect):
    """Coupled joints of a virtual arm."""

    coupling_ppm: float = 0.0
    """How far wrist joints follow their neighbours (1σ)."""

    draws: ClassVar[int] = 1
    groups: ClassVar[tuple[FittedGroup, ...]] = (
        FittedGroup("coupling", lambda arm: _coupling("coupling", _neighbours(arm))),
    )
    terms: ClassVar[tuple[TermFamily, ...]] = (_COUPLED,)

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Draw the couplings of the last two hinges to their inner neighbour, itself a hinge."""
        chain = arm.chain
        coupled = np.zeros((chain.size, chain.size))
        for i in range(max(1, chain.size - 2), chain.size):
            coupled[i, i - 1] = not (chain.prismatic[i] or chain.prismatic[i - 1])
        return JointCoupling(PPM.to_si(self.coupling_ppm) * rngs[0].standard_normal(coupled.shape) * coupled)


@dataclass(frozen=True)
class _FullJointCoupling(JointCoupling):
    """Coupling of any hinge to any other, beside the wrist coupling."""


@dataclass(frozen=True)
class FullCoupling(VirtualEffect):
    """Couplings of all joints of a virtual arm."""

    full_coupling_ppm: float = 0.0
    """How far every joint follows every other (1σ)."""

    draws: ClassVar[int] = 1

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Draw the couplings of all pairs of hinges."""
        size, turning = arm.chain.size, ~np.array(arm.chain.prismatic)
        pairs = np.outer(turning, turning) & ~np.eye(size, dtype=bool)
        return _FullJointCoupling(PPM.to_si(self.full_coupling_ppm) * rngs[0].standard_normal((size, size)) * pairs)


def gear(chain: JointSpec) -> Effect:
    """Return the fitted group: e_i of every joint."""
    parameters = tuple(joint_parameter("gear", i, "gear", "ratio") for i in range(chain.size))
    plain = [("position", i) for i in range(chain.size)]
    return from_signals("gear", parameters, range(chain.size), lambda joints, _: joints, plain)


@dataclass(frozen=True)
class GearErrors(OnePerJoint, MovesJoints):
    """Gear ratio errors of one arm.

    Attributes:
        gear: ``(n,)``; a joint moves by 1 + gear per unit of its measured position.
    """

    gear: Array
    symbol: ClassVar[str] = "gear"

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """Return offsets in proportion to the joint's position."""
        return np.asarray(self.gear * joints)


@dataclass(frozen=True)
class Gear(VirtualEffect):
    """Gear errors of a virtual arm."""

    gear_ppm: float = 0.0
    """Relative error of the gear ratios (1σ)."""

    draws: ClassVar[int] = 1
    groups: ClassVar[tuple[FittedGroup, ...]] = (FittedGroup("gear", lambda arm: gear(arm.chain)),)

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Draw one normal number a joint."""
        return GearErrors(PPM.to_si(self.gear_ppm) * rngs[0].standard_normal(arm.chain.size))
