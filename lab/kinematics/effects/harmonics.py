"""Errors that are periodic in a joint's position: harmonics, cross-harmonics and ripple.

Cross-harmonics, from an eccentric shaft or a bent axis through other joints: the turn of joint j moves another frame by
s sin q_j + c cos q_j. The frame of joint i + 1 is the far end of link i. It moves as one of a link's dimensions would
move it: along x (as ``a``), along z (as ``d``), about x (as ``alpha``), and about y before a nominally parallel axis
(as ``beta``). About z it is joint i's position. Displacements in any direction are sums of these; the last link's end
moves along y and about y, too.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Literal, Self

import numpy as np

from lab.core.errors import LabError, option_name
from lab.core.se3 import Array
from lab.core.units import MRAD
from lab.kinematics.effects.effect import (
    AXES,
    ArmFacts,
    Effect,
    FittedGroup,
    MovesJoints,
    PoseConditions,
    SimulatedEffect,
    TermFamily,
    VirtualEffect,
    Wave,
    from_signals,
    levers,
    turning_joints,
)
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import Kind, joint_parameter, link_end_parameter
from lab.kinematics.serial.chain import Chain

__all__ = ["CROSS_FAMILIES", "CrossHarmonics", "Harmonics", "Ripple", "Runout", "harmonics"]

_LARGEST_ORDER = 64  # of the search without gear ratios: above, none of a real arm was significant
_NAMES = ("sin1", "cos1", "sin2", "cos2")


def harmonics(group: str, joints: Sequence[int], order: int) -> Effect:
    """Return the fitted group of one order k: s_i and c_i of these joints, from 0."""
    parameters = tuple(
        joint_parameter(group, i, f"{function}{order}", wave=order) for i in joints for function in ("sin", "cos")
    )

    def signals(positions: Array, _: Array) -> Array:
        angles = order * positions[:, joints]
        return np.stack([np.sin(angles), np.cos(angles)], axis=2).reshape(len(positions), 2 * angles.shape[1])

    plain = [(function, order, i) for i in joints for function in ("sin", "cos")]
    wave = Wave(order, joints[0], joints[0]) if len(joints) == 1 else None
    return from_signals(group, parameters, [i for i in joints for _ in range(2)], signals, plain, wave=wave)


def _of_one_joint(arm: ArmFacts, joint: int, order: int) -> Effect:
    name = _HARMONIC.name(joint, order)
    if joint not in turning_joints(arm.chain) or order < 1:
        raise LabError(f"{option_name('model')} {name}: give a joint that turns, and a wave number from 1")
    return harmonics(name, (joint,), order)


def _searched(arm: ArmFacts) -> list[tuple[int, int]]:
    usual = [(joint, order) for joint in turning_joints(arm.chain) for order in range(1, _LARGEST_ORDER + 1)]
    return list(dict.fromkeys([*usual, *_expected(arm)]))


def _expected(arm: ArmFacts) -> list[tuple[int, int]]:
    """Return waves of the motors by the gear ratios: once (eccentricity) and twice (wave generator) a turn."""
    if (ratio := arm.chain.gear_ratio) is None:
        return []
    waves = [(joint, turns * abs(float(ratio[joint]))) for joint in turning_joints(arm.chain) for turns in (1, 2)]
    near = [(joint, whole) for joint, wave in waves for whole in (int(np.floor(wave)), int(np.ceil(wave)))]
    return list(dict.fromkeys((joint, whole) for joint, whole in near if whole >= 1))


_HARMONIC = TermFamily(
    "harmonic",
    "wave number, how often a turn",
    _of_one_joint,
    _searched,
    lambda joint, order: f"joint {joint} runs out {'once' if order == 1 else f'{order} times'} a turn",
    _expected,
)


@dataclass(frozen=True)
class Runout(SimulatedEffect, MovesJoints):
    """Harmonic joint errors of one arm.

    Attributes:
        harmonics_rad: ``(n, 4)``: coefficients of sin q, cos q, sin 2q, cos 2q of the joint's own position q. Zero for
            a slide.
    """

    harmonics_rad: Array
    addition_order: ClassVar[int] = 1

    @classmethod
    def none(cls, joints: int) -> Self:
        """Return joints without runout."""
        return cls(np.zeros((joints, 4)))

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """Return waves of the joint's position."""
        if not self.harmonics_rad.any():
            return np.zeros(joints.shape)
        sin1, cos1, sin2, cos2 = self.harmonics_rad.T
        once, twice = (np.sin(joints), np.cos(joints)), (np.sin(2 * joints), np.cos(2 * joints))
        return np.asarray(sin1 * once[0] + cos1 * once[1] + sin2 * twice[0] + cos2 * twice[1])

    def true_parameters(self) -> dict[str, float]:
        """Return s_i and c_i of both orders."""
        rows = enumerate(self.harmonics_rad.tolist(), start=1)
        return {f"joint{i}.{name}": value for i, row in rows for name, value in zip(_NAMES, row, strict=True)}

    def refuse_unfit(self, chain: JointSpec) -> None:
        """Refuse harmonics of a slide."""
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
    terms: ClassVar[tuple[TermFamily, ...]] = (_HARMONIC,)

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Draw phases, each order from its own stream; the amplitude is the same for every hinge."""
        sizes, hinge = (MRAD.to_si(self.harmonic_mrad), MRAD.to_si(self.harmonic2_mrad)), ~np.array(arm.chain.prismatic)
        phases = [rng.uniform(0.0, 2 * np.pi, arm.chain.size) for rng in rngs]
        waves = [
            (size * wave(phase)) * hinge for size, phase in zip(sizes, phases, strict=True) for wave in (np.cos, np.sin)
        ]
        return Runout(np.stack(waves, axis=1))


_DIRECTIONS: Mapping[str, tuple[Literal["length", "angle"], str]] = {
    "x": ("length", "moves along x"),
    "y": ("length", "moves along y"),
    "z": ("length", "moves along its joint's axis"),
    "rx": ("angle", "turns about x"),
    "ry": ("angle", "turns about y"),
}


def _of_position(arm: ArmFacts, joint: int, other: int) -> Effect:
    """Return the group of the position of a joint, from 0, by the turn of another one, from 1."""
    name, turning = _POSITION.name(joint, other), other - 1
    if joint == turning or joint >= arm.chain.size or turning not in turning_joints(arm.chain):
        raise LabError(f"{option_name('model')} {name}: give two different joints, the second one a joint that turns")
    kind: Kind = "length" if arm.chain.prismatic[joint] else "angle"
    parameters = tuple(
        joint_parameter(name, joint, f"cross{other}_{wave}", kind, wave=1, turning=turning) for wave in ("sin", "cos")
    )

    def signals(joints: Array, _: Array) -> Array:
        return _waves(joints[:, turning])

    wave = Wave(1, turning, joint)
    return from_signals(name, parameters, (joint, joint), signals, _plain_waves(turning), wave=wave)


def _of_link_end(direction: str, arm: ArmFacts, link: int, other: int) -> Effect:
    """Return the group of the far end of a link, from 0, by the turn of a joint, from 1."""
    name, turning = f"link{link + 1}.{direction}_cross{other}", other - 1
    if (link, other) not in _link_pairs(direction, arm):
        raise LabError(
            f"{option_name('model')} {name}: give a link and a joint that turns, of a robot without loops; "
            "y only of the last link, ry also before a parallel axis, z only of a joint that turns"
        )
    component, (kind, _) = AXES.index(direction), _DIRECTIONS[direction]
    parameters = tuple(
        link_end_parameter(name, link, f"{direction}_cross{other}_{wave}", kind, turning) for wave in ("sin", "cos")
    )

    def offsets(joints: Array, _: Array, values: Array) -> tuple[Array, Array]:
        derivative = np.zeros((len(joints), len(AXES), 2), dtype=joints.dtype)
        derivative[:, component] = _waves(joints[:, turning])
        return derivative @ values, derivative

    def terms(values: Array) -> list[dict[str, Any]]:
        waves = zip(values.tolist(), _plain_waves(turning), strict=True)
        return [{"link": link, "axis": component, "times": value, "of": list(wave)} for value, wave in waves]

    wave = Wave(1, turning, component)
    return Effect(name, parameters, offsets, moves="links", links=(link,), terms=terms, wave=wave)


def _waves(position: Array) -> Array:
    return np.stack([np.sin(position), np.cos(position)], axis=1)


def _plain_waves(turning: int) -> list[tuple[str, int, int]]:
    return [(function, 1, turning) for function in ("sin", "cos")]


def _position_pairs(arm: ArmFacts) -> list[tuple[int, int]]:
    turning = turning_joints(arm.chain)
    return [(joint, other + 1) for joint in range(arm.chain.size) for other in turning if other != joint]


def _link_pairs(direction: str, arm: ArmFacts) -> list[tuple[int, int]]:
    """List the links with such a displacement beside their joint's position, each with every hinge."""
    chain = arm.chain
    if not isinstance(chain, Chain):
        return []
    last = chain.size - 1
    own: dict[str, Callable[[int], bool]] = {
        "y": lambda link: link == last,
        "ry": lambda link: link == last or chain.joins_parallel_axes(link),
        "z": lambda link: not chain.prismatic[link],
    }
    links = [link for link in range(chain.size) if direction not in own or own[direction](link)]
    return [(link, other + 1) for link in links for other in turning_joints(chain)]


def _once(other: int) -> str:
    return f"with the sine and cosine of joint {other}"


def _link_description(motion: str, link: int, other: int) -> str:
    return f"the far end of link {link} {motion} {_once(other)}"


_POSITION = TermFamily(
    "cross",
    "the joint whose turn moves it",
    _of_position,
    _position_pairs,
    lambda joint, other: f"joint {joint} moves {_once(other)}",
)
CROSS_FAMILIES = (
    _POSITION,
    *(
        TermFamily(
            f"{direction}_cross",
            "the joint whose turn moves it",
            partial(_of_link_end, direction),
            partial(_link_pairs, direction),
            partial(_link_description, words),
            owner="link",
        )
        for direction, (_, words) in _DIRECTIONS.items()
    ),
)


@dataclass(frozen=True)
class _CrossRunout(SimulatedEffect, MovesJoints):
    """Cross-joint harmonics of one arm.

    Attributes:
        cross_rad: ``(n, n, 2)``: coefficients (rad, m of a slide) of sine and cosine of joint j's position in joint
            i's, by i and j. Zero diagonal, and zero for a slide j.
    """

    cross_rad: Array

    @classmethod
    def none(cls, joints: int) -> Self:
        return cls(np.zeros((joints, joints, 2)))

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        sine, cosine = np.moveaxis(self.cross_rad, 2, 0)
        return np.asarray(np.sin(joints) @ sine.T + np.cos(joints) @ cosine.T)

    def true_parameters(self) -> dict[str, float]:
        found: dict[str, float] = {}
        for i, j in np.argwhere(self.cross_rad.any(axis=2)).tolist():
            sine, cosine = self.cross_rad[i, j].tolist()
            found |= {f"joint{i + 1}.cross{j + 1}_sin": sine, f"joint{i + 1}.cross{j + 1}_cos": cosine}
        return found

    def refuse_unfit(self, chain: JointSpec) -> None:
        if self.cross_rad[:, list(chain.prismatic)].any() or np.diagonal(self.cross_rad).any():
            raise LabError(f"robot {chain.name}: cross_rad of a slide's turn, or of a joint by itself; give it zeros")


@dataclass(frozen=True)
class CrossHarmonics(VirtualEffect):
    """Cross-harmonics of a virtual arm."""

    cross_harmonic_mrad: float = 0.0
    """How far each joint is moved by the turn of another one, once a turn, with a random phase."""

    draws: ClassVar[int] = 1
    terms: ClassVar[tuple[TermFamily, ...]] = CROSS_FAMILIES

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Draw the driving joint and the phase; the amplitude is the same for every joint."""
        size = arm.chain.size
        partner, phase = rngs[0].random(size), rngs[0].uniform(0.0, 2 * np.pi, size)
        amplitude, cross = MRAD.to_si(levers(arm.chain) * self.cross_harmonic_mrad), np.zeros((size, size, 2))
        for i in range(size):
            if others := [j for j in turning_joints(arm.chain) if j != i]:
                j = others[int(partner[i] * len(others))]
                cross[i, j] = amplitude[i] * np.array([np.cos(phase[i]), np.sin(phase[i])])
        return _CrossRunout(cross)


_ORDERS = (3, 60)  # least and largest; one and two are runout


@dataclass(frozen=True)
class _GearWaves(SimulatedEffect, MovesJoints):
    """Gear ripple of one arm.

    Attributes:
        waves: ``(n, 3)``: periods in a turn of each joint, and coefficients (rad) of sine and cosine. Zero for a slide.
    """

    waves: Array

    @classmethod
    def none(cls, joints: int) -> Self:
        return cls(np.zeros((joints, 3)))

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        order, sine, cosine = self.waves.T
        return np.asarray(sine * np.sin(order * joints) + cosine * np.cos(order * joints))

    def true_parameters(self) -> dict[str, float]:
        found: dict[str, float] = {}
        for i, (order, sine, cosine) in enumerate(self.waves.tolist(), start=1):
            if order:
                found |= {f"joint{i}.sin{order:.0f}": sine, f"joint{i}.cos{order:.0f}": cosine}
        return found

    def refuse_unfit(self, chain: JointSpec) -> None:
        if self.waves[list(chain.prismatic), 1:].any():
            raise LabError(f"robot {chain.name}: a slide has no waves; give it zeros")


@dataclass(frozen=True)
class Ripple(VirtualEffect):
    """Gear waves of a virtual arm."""

    ripple_mrad: float = 0.0
    """A wave of each joint's gear, as often a turn as the robot's gear ratios state, else 3 to 60 times."""

    draws: ClassVar[int] = 1

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Draw phases, and orders without a given gear ratio; the amplitude is the same for every hinge."""
        size = arm.chain.size
        order = rngs[0].integers(_ORDERS[0], _ORDERS[1] + 1, size)
        if (ratio := arm.chain.gear_ratio) is not None:
            order = np.where(arm.chain.prismatic, order, np.maximum(np.round(np.abs(ratio)), 1)).astype(np.int_)
        phase = rngs[0].uniform(0.0, 2 * np.pi, size)
        amplitude = MRAD.to_si(self.ripple_mrad) * ~np.array(arm.chain.prismatic)
        waves = np.stack([order, amplitude * np.cos(phase), amplitude * np.sin(phase)], axis=1)
        return _GearWaves(waves * (amplitude > 0)[:, None])
