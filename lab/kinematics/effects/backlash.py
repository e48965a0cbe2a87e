"""Errors that depend on the approach of a pose: backlash, hysteresis and lag.

Backlash of width b_i: joint i is at q_i + s_i b_i / 2, with the direction of approach s_i of a file's column.
Hysteresis, from friction and wind-up, is the same by the last direction of motion in the order of the poses.
"""

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from lab.core.errors import LabError, option_name
from lab.core.measurements import last_moves
from lab.core.se3 import Array
from lab.core.units import MRAD
from lab.kinematics.effects.effect import (
    ArmFacts,
    ChangesJointPositions,
    Effect,
    FittedGroup,
    MovesJoints,
    OnePerJoint,
    PoseConditions,
    SimulatedEffect,
    TermFamily,
    VirtualEffect,
    approach_of,
    from_signals,
    last_move_of,
    levers,
    refuse_negative,
)
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import Kind, Parameter, joint_parameter

__all__ = [
    "Backlash",
    "Hysteresis",
    "JointHysteresis",
    "Lag",
    "Play",
    "ReadingLag",
    "approached_groups",
    "backlash",
]

_SCALE = 1e-3  # rad, m of a slide


def backlash(chain: JointSpec) -> Effect:
    """Return the fitted group: b_i of every joint."""
    return _fitted_widths("backlash", chain, approach_of)


def _fitted_widths(group: str, chain: JointSpec, direction_of: Callable[[str], str]) -> Effect:
    """Return the group of widths w_i: joint i is at q_i + s_i w_i / 2, with s_i = 1 or -1 of a condition."""
    parameters = tuple(_width(group, chain, i, group) for i in range(chain.size))
    return _widths(group, parameters, range(chain.size), tuple(map(direction_of, chain.joint_names)))


def _widths(group: str, widths: tuple[Parameter, ...], joints: Sequence[int], conditions: tuple[str, ...]) -> Effect:
    plain = [("condition", name, 0.0) for name in conditions]
    return from_signals(group, widths, joints, lambda _, direction: direction, plain, conditions, times=0.5)


def approached_groups(chain: JointSpec, columns: Container[str]) -> tuple[str, ...]:
    """Return the groups that replace ``backlash`` for measurements with these conditions.

    They are of the joints whose direction of approach is among ``columns``, if others' are not; else ``backlash``
    itself.
    """
    approached = [joint for joint, name in enumerate(chain.joint_names) if approach_of(name) in columns]
    return tuple(map(_PLAY.name, approached)) if 0 < len(approached) < chain.size else ("backlash",)


def _width(group: str, chain: JointSpec, joint: int, symbol: str) -> Parameter:
    kind: Kind = "length" if chain.prismatic[joint] else "angle"
    return joint_parameter(group, joint, symbol, kind, scale=_SCALE)


def _of_one_joint(arm: ArmFacts, joint: int, _: int) -> Effect:
    name, condition = _PLAY.name(joint), approach_of(arm.chain.joint_names[joint])
    width = _width(name, arm.chain, joint, "backlash")
    return _widths(name, (width,), (joint,), (condition,))


_PLAY = TermFamily("backlash", "", _of_one_joint, lambda _: (), lambda joint, _: f"joint {joint} has play")


@dataclass(frozen=True)
class Play(OnePerJoint, MovesJoints):
    """Backlash of one arm.

    Attributes:
        backlash_rad: ``(n,)`` full widths, m of a slide.
    """

    backlash_rad: Array
    symbol: ClassVar[str] = "backlash"

    def __post_init__(self) -> None:
        refuse_negative("backlash_rad", self.backlash_rad)

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the directions of approach of joints with backlash."""
        return tuple(approach_of(name) for name, width in zip(joint_names, self.backlash_rad, strict=True) if width)

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """Return half the width above the measured position at approach +1, below it at -1."""
        return np.asarray(self.backlash_rad / 2 * conditions.approach)


@dataclass(frozen=True)
class Backlash(VirtualEffect):
    """Play of a virtual arm."""

    backlash_mrad: float = 0.0
    """Mean play of the joints."""

    draws: ClassVar[int] = 1
    groups: ClassVar[tuple[FittedGroup, ...]] = (FittedGroup("backlash", lambda arm: backlash(arm.chain)),)
    terms: ClassVar[tuple[TermFamily, ...]] = (_PLAY,)

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Draw each joint's backlash between half and one and a half times the mean."""
        return Play(levers(arm.chain) * MRAD.to_si(self.backlash_mrad) * rngs[0].uniform(0.5, 1.5, arm.chain.size))


@dataclass(frozen=True)
class JointHysteresis(OnePerJoint, MovesJoints):
    """Hysteresis of one arm.

    Attributes:
        hysteresis_rad: ``(n,)`` full widths, m of a slide.
    """

    hysteresis_rad: Array
    symbol: ClassVar[str] = "hysteresis"

    def __post_init__(self) -> None:
        refuse_negative("hysteresis_rad", self.hysteresis_rad)

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """Return half the width in each joint's last direction of motion."""
        if not self.hysteresis_rad.any():
            return np.zeros(joints.shape)
        return np.asarray(self.hysteresis_rad / 2 * last_moves(joints))


@dataclass(frozen=True)
class Hysteresis(VirtualEffect):
    """Hysteresis of a virtual arm."""

    hysteresis_mrad: float = 0.0
    """Mean hysteresis of the joints, by the direction of their last move."""

    draws: ClassVar[int] = 1
    groups: ClassVar[tuple[FittedGroup, ...]] = (
        FittedGroup(
            "hysteresis",
            lambda arm: _fitted_widths("hysteresis", arm.chain, last_move_of),
            "play by the direction of the last move, as rows are ordered",
        ),
    )

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Draw each joint's hysteresis between half and one and a half times the mean."""
        widths = MRAD.to_si(self.hysteresis_mrad) * rngs[0].uniform(0.5, 1.5, arm.chain.size)
        return JointHysteresis(levers(arm.chain) * widths)


@dataclass(frozen=True)
class ReadingLag(SimulatedEffect, ChangesJointPositions):
    """Lag of one arm's joint readings.

    Attributes:
        lag: share of the last move that a reading lacks, in [0, 1).
    """

    lag: float

    def __post_init__(self) -> None:
        if not 0 <= self.lag < 1:
            raise LabError("effects: lag is to be in [0, 1)")

    @classmethod
    def none(cls, joints: int) -> Self:
        """Return no lag."""
        return cls(0.0)

    def shown(self, joints: Array) -> Array:
        """Return readings behind the settled positions; the first pose is settled."""
        return np.asarray(joints - self.lag * np.diff(joints, axis=0, prepend=joints[:1]))


@dataclass(frozen=True)
class Lag(VirtualEffect):
    """Lag of a virtual arm's joint positions."""

    lag: float = 0.0
    """Lag of the joint positions, as a share of the last move, from 0 to below 1."""

    def check(self) -> None:
        """Refuse a lag of one or more."""
        if not self.lag < 1:
            raise LabError(f"{option_name('lag')} {self.lag:g}: give a share from 0 to below 1")

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Return the lag as given."""
        return ReadingLag(self.lag)
