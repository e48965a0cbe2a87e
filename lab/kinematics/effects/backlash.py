"""Errors that depend on how a pose was approached: backlash, hysteresis and lag.

Hysteresis of width h_i: joint i is at q_i + s_i h_i / 2, where s_i is the direction in which it moved last.

What friction and wind-up leave behind: like play, but told by the order of the poses alone, where a file does not say
from which side each joint came (``backlash``).
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
    PoseConditions,
    SimulatedEffect,
    TermFamily,
    VirtualEffect,
    approach_of,
    by_joint,
    joint_terms,
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
    "hysteresis",
]

_SCALE = 1e-3  # rad, m of a slide


def backlash(chain: JointSpec) -> Effect:
    """The fitted group: b_i of every joint."""
    return _fitted_widths("backlash", chain, approach_of)


def _fitted_widths(group: str, chain: JointSpec, direction_of: Callable[[str], str]) -> Effect:
    """The fitted group of widths w_i: joint i is at q_i + s_i w_i / 2, with a direction s_i of 1 or -1.

    Args:
        direction_of: from a joint's name to the condition that is its direction.
    """
    parameters = tuple(_width(group, chain, i, group) for i in range(chain.size))
    conditions = tuple(map(direction_of, chain.joint_names))
    where = [(i, ("condition", name, 0.0)) for i, name in enumerate(conditions)]
    return Effect(
        group,
        parameters,
        lambda _, direction, values: by_joint(direction / 2, values),
        conditions,
        plain=lambda values: joint_terms(values, *where, times=0.5),
    )


def approached_groups(chain: JointSpec, columns: Container[str]) -> tuple[str, ...]:
    """The groups that stand for ``backlash`` where measurements have some columns alone.

    Args:
        columns: the names of the measurements' conditions.

    Returns:
        A group for each joint whose direction of approach is among the columns, where others' are not; else
        ``backlash`` itself.
    """
    known = [joint for joint, name in enumerate(chain.joint_names) if approach_of(name) in columns]
    return tuple(map(_PLAY.name, known)) if 0 < len(known) < chain.size else ("backlash",)


def _width(group: str, chain: JointSpec, joint: int, symbol: str) -> Parameter:
    kind: Kind = "length" if chain.prismatic[joint] else "angle"
    return joint_parameter(group, joint, symbol, kind, scale=_SCALE)


def _of_one_joint(arm: ArmFacts, joint: int, _: int) -> Effect:
    name, size = _PLAY.name(joint), arm.chain.size

    def offsets(joints: Array, direction: Array, values: Array) -> tuple[Array, Array]:
        derivative = np.zeros((len(joints), size, 1))
        derivative[:, joint] = direction / 2
        return derivative @ values, derivative

    width = _width(name, arm.chain, joint, "backlash")
    condition = approach_of(arm.chain.joint_names[joint])
    where = (joint, ("condition", condition, 0.0))
    return Effect(name, (width,), offsets, (condition,), plain=lambda values: joint_terms(values, where, times=0.5))


_PLAY = TermFamily("backlash", "", _of_one_joint, lambda _: (), lambda joint, _: f"joint {joint} has play")


@dataclass(frozen=True)
class Play(SimulatedEffect, MovesJoints):
    """Backlash of one arm.

    Attributes:
        backlash_rad: ``(n,)`` full widths, m of a slide.
    """

    backlash_rad: Array

    def __post_init__(self) -> None:
        refuse_negative("backlash_rad", self.backlash_rad)

    @classmethod
    def none(cls, joints: int) -> Self:
        """Joints without play."""
        return cls(np.zeros(joints))

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """The direction of approach of joints with play."""
        return tuple(approach_of(name) for name, width in zip(joint_names, self.backlash_rad, strict=True) if width)

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """Half the width above the measured position at approach +1, below it at -1."""
        offsets: Array = self.backlash_rad / 2 * conditions.approach
        return offsets

    def true_parameters(self) -> dict[str, float]:
        """b_i."""
        return {f"joint{i + 1}.backlash": float(value) for i, value in enumerate(self.backlash_rad)}


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


def hysteresis(chain: JointSpec) -> Effect:
    """The fitted group: h_i of every joint."""
    return _fitted_widths("hysteresis", chain, last_move_of)


@dataclass(frozen=True)
class JointHysteresis(SimulatedEffect, MovesJoints):
    """Hysteresis of one arm.

    Attributes:
        hysteresis_rad: ``(n,)`` full widths, m of a slide.
    """

    hysteresis_rad: Array

    def __post_init__(self) -> None:
        refuse_negative("hysteresis_rad", self.hysteresis_rad)

    @classmethod
    def none(cls, joints: int) -> Self:
        """Joints without friction."""
        return cls(np.zeros(joints))

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """Half the width to where the joint came from its last position, by the order of the poses."""
        if not self.hysteresis_rad.any():
            return np.zeros(joints.shape)
        return np.asarray(self.hysteresis_rad / 2 * last_moves(joints))

    def true_parameters(self) -> dict[str, float]:
        """h_i."""
        return {f"joint{i + 1}.hysteresis": float(value) for i, value in enumerate(self.hysteresis_rad)}


@dataclass(frozen=True)
class Hysteresis(VirtualEffect):
    """Hysteresis of a virtual arm."""

    hysteresis_mrad: float = 0.0
    """Mean hysteresis of the joints, by the direction of their last move."""

    draws: ClassVar[int] = 1
    groups: ClassVar[tuple[FittedGroup, ...]] = (
        FittedGroup(
            "hysteresis",
            lambda arm: hysteresis(arm.chain),
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
        lag: share of the last move that a joint position still lacks when it is read, in [0, 1).
    """

    lag: float

    def __post_init__(self) -> None:
        if not 0 <= self.lag < 1:
            raise LabError("effects: lag is to be in [0, 1)")

    @classmethod
    def none(cls, joints: int) -> Self:
        """Joint positions of the settled arm."""
        return cls(0.0)

    def shown(self, joints: Array) -> Array:
        """Behind where they will settle; the first pose is settled."""
        shown: Array = joints - self.lag * np.diff(joints, axis=0, prepend=joints[:1])
        return shown


@dataclass(frozen=True)
class Lag(VirtualEffect):
    """Lag of a virtual arm's joint positions."""

    lag: float = 0.0
    """Lag of the joint positions, as a share of the last move, from 0 to below 1."""

    def check(self) -> None:
        """Refuse a joint that never moves."""
        if not self.lag < 1:
            raise LabError(f"{option_name('lag')} {self.lag:g}: give a share from 0 to below 1")

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Return the lag as given."""
        return ReadingLag(self.lag)
