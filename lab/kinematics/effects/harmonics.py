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
    TermFamily,
    VirtualEffect,
    joint_terms,
    turning_joints,
)
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import joint_parameter

__all__ = ["HARMONIC", "LARGEST_ORDER", "Harmonics", "Runout", "harmonics"]

LARGEST_ORDER = 64  # that is searched where nothing says of more: above, none of a real arm was worth its poses

_NAMES = ("sin1", "cos1", "sin2", "cos2")


def harmonics(group: str, joints: Sequence[int], order: int) -> Effect:
    """The fitted group of one order k: s_i and c_i of these joints, from 0."""
    parameters = tuple(
        joint_parameter(group, i, f"{function}{order}", wave=order) for i in joints for function in ("sin", "cos")
    )

    def offsets(positions: Array, _: Array, values: Array) -> tuple[Array, Array]:
        derivative = np.zeros((*positions.shape, len(parameters)))
        for column, i in enumerate(joints):
            derivative[:, i, 2 * column] = np.sin(order * positions[:, i])
            derivative[:, i, 2 * column + 1] = np.cos(order * positions[:, i])
        return derivative @ values, derivative

    where = [(i, (function, order, i)) for i in joints for function in ("sin", "cos")]
    return Effect(group, parameters, offsets, plain=lambda values: joint_terms(values, *where))


def _of_one_joint(arm: ArmFacts, joint: int, order: int) -> Effect:
    name = HARMONIC.name(joint, order)
    if joint not in turning_joints(arm.chain) or order < 1:
        raise LabError(f"--model {name}: give a joint that turns, and a wave number from 1")
    return harmonics(name, (joint,), order)


def _searched(arm: ArmFacts) -> list[tuple[int, int]]:
    usual = [(joint, order) for joint in turning_joints(arm.chain) for order in range(1, LARGEST_ORDER + 1)]
    return list(dict.fromkeys([*usual, *_expected(arm)]))


def _expected(arm: ArmFacts) -> list[tuple[int, int]]:
    """Waves of the motors by the gear ratios: once a turn, as an eccentric one, and twice, as a wave generator."""
    if (ratio := arm.chain.gear_ratio) is None:
        return []
    waves = [(joint, turns * abs(float(ratio[joint]))) for joint in turning_joints(arm.chain) for turns in (1, 2)]
    near = [(joint, whole) for joint, wave in waves for whole in (int(np.floor(wave)), int(np.ceil(wave)))]
    return list(dict.fromkeys((joint, whole) for joint, whole in near if whole >= 1))


HARMONIC = TermFamily(
    "harmonic",
    "wave number, how often a turn",
    _of_one_joint,
    _searched,
    lambda joint, order: f"joint {joint} runs out {'once' if order == 1 else f'{order} times'} a turn",
    _expected,
)


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
        FittedGroup("harmonics", lambda arm: harmonics("harmonics", turning_joints(arm.chain), 1)),
        FittedGroup("harmonics2", lambda arm: harmonics("harmonics2", turning_joints(arm.chain), 2)),
    )
    terms: ClassVar[tuple[TermFamily, ...]] = (HARMONIC,)

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """The same amplitude for every hinge; the phases are drawn, those of each order from their own stream."""
        sizes, hinge = (self.harmonic_mrad / 1e3, self.harmonic2_mrad / 1e3), ~np.array(arm.chain.prismatic)
        phases = [rng.uniform(0.0, 2 * np.pi, arm.chain.size) for rng in rngs]
        waves = [
            (size * wave(phase)) * hinge for size, phase in zip(sizes, phases, strict=True) for wave in (np.cos, np.sin)
        ]
        return Runout(np.stack(waves, axis=1))
