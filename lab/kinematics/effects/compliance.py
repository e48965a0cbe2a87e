"""Elastic joints: compliance, hardening springs, gravity compensators.

Joints whose springs are not linear: joint i gives way by d_i g_i^3 beside what is in proportion to its torque g_i.

Harmonic drives grow stiffer with torque (d_i < 0). The cube is that of the torque at the measured joint positions: what
the joint gives way changes it by one part in a thousand.

A gravity compensator: a spring between two links that bears part of the arm's weight, and whose joint gives way.

A spring of stiffness k and free length l0 whose ends are at distances a and b from the joint pulls with the torque
k a b sin(phi) (1 - l0 / l), where l^2 = a^2 + b^2 - 2 a b cos(phi). With s^2 = a^2 + b^2 and r = 2 a b / s^2 its length
is s sqrt(1 - r cos(phi)): the torque is a function of the joint's own angle, whose first two harmonics hold all but
about 3 r^2 / 32 of it. They are fitted, as a spring's ends are seldom known.

Joints that give way to the weight of links whose masses nobody knows.

The torque of link l's weight about joint i is linear in the link's mass and first moment (Khalil & Dombre 2002,
section 9.3.2). A mass times a constant lever acts like a first moment of the link that holds the lever, and a moment
along axis l like one of the link before: what is left of each link are its first moments across its own axis, along x
and y of its frame. A joint that gives way by c_i then stands at q_i + c_i m_l |g| (x_l, y_l) . r_il, with r_il the
torques of a unit weight there; c_i and m_l are known as their product alone, which is the parameter.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from lab.core.errors import LabError, option_name
from lab.core.limits import positive
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MRAD, Unit
from lab.kinematics.dynamics.gravity import Loads, link_loads
from lab.kinematics.effects.effect import (
    PAYLOAD,
    ArmFacts,
    Effect,
    FittedGroup,
    MovesJoints,
    PoseConditions,
    SimulatedEffect,
    TermFamily,
    VirtualEffect,
    joint_terms,
    levers,
    rates_in,
    rates_of,
    refuse_negative,
    turning_joints,
)
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import Parameter, joint_parameter
from lab.kinematics.serial.chain import Chain

__all__ = [
    "GRAVITY",
    "NEWTON_STEPS",
    "Compensator",
    "CompensatorSpring",
    "Compliance",
    "Hardening",
    "HardeningSprings",
    "JointSprings",
    "compensator",
    "compliance",
    "compliances",
    "hardening",
]

_DOWN = np.array([0.0, 0.0, -1.0])  # in frame 0, where a file does not say


def _of_one_link(arm: ArmFacts, joint: int, link: int) -> Effect:
    """Return the deflection (rad) of a joint, from 0, under a link's weight, from 1: along x and y of its frame."""
    name, chain = GRAVITY.name(joint, link), arm.chain
    if not isinstance(chain, Chain) or (joint, link) not in _searched(arm):
        raise LabError(
            f"{option_name('model')} {name}: give a joint that turns and a link that it carries, of a robot "
            f"without loops"
        )
    parameters = tuple(joint_parameter(name, joint, f"gravity{link}{axis}") for axis in "xy")
    down = _DOWN if arm.loads is None else arm.loads.gravity / np.linalg.norm(arm.loads.gravity)

    def offsets(joints: Array, _: Array, values: Array) -> tuple[Array, Array]:
        derivative = np.zeros((*joints.shape, 2))
        derivative[:, joint] = _unit_torques(chain, joints, down, joint, link - 1)
        return derivative @ values, derivative

    where = [(joint, ("weight", joint, link - 1, axis, down.tolist())) for axis in range(2)]
    return Effect(name, parameters, offsets, plain=lambda values: joint_terms(values, *where))


def _unit_torques(chain: Chain, joints: Array, down: Array, joint: int, link: int) -> Array:
    """Torques about a hinge of a unit weight times metre on a link, along x and y of its frame, ``(n, 2)``.

    Args:
        down: unit vector ``(3,)`` in frame 0.
        joint, link: from 0; the frame turns with the link's own joint, z along that joint's axis.
    """
    frames = Loads(chain, np.zeros(chain.size), np.zeros((chain.size, 3)), down).frames(joints)
    across = np.cross(down, frames.axes[:, joint])  # down . (z x r) = (down x z) . r
    torques: Array = np.einsum("ni,nij->nj", across, frames.rotations[:, link, :, :2])
    return torques


def _searched(arm: ArmFacts) -> list[tuple[int, int]]:
    """List every hinge with its own link and all revolute links beyond."""
    if not isinstance(arm.chain, Chain):
        return []
    turning = turning_joints(arm.chain)
    return [(i, link + 1) for i in turning for link in turning if link >= i]


GRAVITY = TermFamily(
    "gravity",
    "a link, whose weight it gives way to",
    _of_one_link,
    _searched,
    lambda joint, link: f"joint {joint} gives way to the weight of link {link}",
)


NEWTON_STEPS = 2  # the first leaves about 1e-11 rad of a sag of 1 mrad
_TYPICAL_COMPLIANCE = 1e-5  # rad/Nm
_MASS_SCALE_KG = 10.0


def compliance(loads: Loads, payload: bool = False, *, moving: bool = False) -> Effect:
    """The fitted group: c_i of the joints that bear the arm's weight.

    The equilibrium is solved by Newton's method, with c the compliances (rad/Nm) and g the joints' torques
    (``Loads``). With ``payload``, an unknown mass at the last frame's origin is fitted too, beside the rows' own
    ``payload_kg``. With ``moving``, inertia loads the joints too, as their rates say.
    """
    links = link_loads(loads) if moving else None
    bearing = loads.bearing(rng_for(0, "structure"))
    group, slides = "payload" if payload else "compliance", loads.chain.prismatic
    slide = Unit("m/N", "µm/N", 1e6)
    parameters = tuple(
        joint_parameter(group, i, "compliance", "compliance", unit=slide if slides[i] else None) for i in bearing
    )
    if payload:
        parameters += (Parameter("payload", "mass", group, "mass", Unit("kg", "kg", 1.0), _MASS_SCALE_KG),)

    def offsets(joints: Array, conditions: Array, values: Array) -> tuple[Array, Array]:
        soft: Array = np.zeros(loads.chain.size, dtype=np.result_type(values, float))
        soft[list(bearing)] = values[: len(bearing)]
        mass = conditions[:, 0] + (values[-1] if payload else 0.0)
        inertia = None if links is None else links.inertia(joints, *rates_in(conditions, loads.chain.size), mass)
        rest = loads.equilibrium(joints, soft, mass, NEWTON_STEPS, inertia)
        pushed = np.zeros((*joints.shape, len(parameters)), dtype=soft.dtype)
        for k, i in enumerate(bearing):
            pushed[:, i, k] = rest.force[:, i]
        if payload:
            heavier = loads.forces(joints + rest.offset, mass + 1.0)[0]
            if links is not None:
                heavier = heavier + links.inertia(joints, *rates_in(conditions, loads.chain.size), mass + 1.0)
            pushed[..., -1] = soft * (heavier - rest.force)
        rate_of: Array = np.asarray(np.linalg.solve(rest.equations, pushed), dtype=soft.dtype)
        return rest.offset, rate_of

    def plain(values: Array) -> list[dict[str, Any]]:
        found = dict(zip(bearing, values.tolist(), strict=False))
        soft = [found.get(i, 0.0) for i in range(loads.chain.size)]
        return [{"springs": soft, "payload_kg": float(values[-1]) if payload else 0.0}]

    typical = (*[_TYPICAL_COMPLIANCE] * len(bearing), 0.0) if payload else ()
    asked = (PAYLOAD, *rates_of(loads.chain.joint_names)) if moving else (PAYLOAD,)
    return Effect(group, parameters, offsets, asked, typical=typical, plain=None if moving else plain)


def _fitted(name: str, arm: ArmFacts) -> Effect:
    if arm.chain.has_loops:
        raise LabError(
            f"{option_name('model')} {name}: robot {arm.chain.name} has loops, and nothing bends such a robot here"
        )
    if arm.loads is None:
        raise LabError(
            f"{option_name('model')} {name}: robot {arm.chain.name} is a table without masses; give it as MJCF "
            f"or URDF, "
            "or fit what gives way to unknown masses: joint2.gravity2 and its like"
        )
    return compliance(arm.loads, payload=name == "payload", moving=arm.moving)


def compliances(chain: JointSpec, stiffness: Mapping[int, float]) -> Array:
    """``(n,)`` rad/Nm (m/N of a slide), zero for a stiff joint, from stiffnesses (Nm/rad) by joint, from 1.

    A slide takes a stiffness as a hinge would at ``LEVER_M``.
    """
    found = np.zeros(chain.size)
    for joint, value in stiffness.items():
        if not 1 <= joint <= chain.size:
            raise LabError(f"a stiffness of joint {joint}: robot {chain.name} has joints 1 to {chain.size}")
        if not value > 0:
            raise LabError(f"joint {joint}: a stiffness of {value} Nm/rad; give one above zero, or none")
        found[joint - 1] = 1 / value
    scaled: Array = levers(chain) ** 2 * found
    return scaled


@dataclass(frozen=True)
class JointSprings(SimulatedEffect):
    """Compliant joints of one arm; ``simulation.elastic`` finds the equilibrium.

    Attributes:
        compliance_rad_per_nm: ``(n,)``; a joint gives way by this times the weight's torque about it.
        payload_at_m: ``(3,)``, payloads' centre of mass in the last frame.
    """

    compliance_rad_per_nm: Array
    payload_at_m: Array

    def __post_init__(self) -> None:
        refuse_negative("compliance_rad_per_nm", self.compliance_rad_per_nm)

    @classmethod
    def none(cls, joints: int) -> Self:
        """Stiff joints."""
        return cls(np.zeros(joints), np.zeros(3))

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """The payload."""
        return (PAYLOAD,) if self.compliance_rad_per_nm.any() else ()

    def true_parameters(self) -> dict[str, float]:
        """c_i."""
        return {f"joint{i + 1}.compliance": float(value) for i, value in enumerate(self.compliance_rad_per_nm)}


@dataclass(frozen=True)
class Compliance(VirtualEffect):
    """Compliance of a virtual arm's joints."""

    stiffness_nm_per_rad: float | None = None
    """Stiffness of the joints that bear the arm's weight (2 and 3 of the IRB 120)."""

    groups: ClassVar[tuple[FittedGroup, ...]] = (
        FittedGroup("compliance", lambda arm: _fitted("compliance", arm)),
        FittedGroup(  # a mass and a stiffness, both unknown, hardly differ: no candidate
            "payload",
            lambda arm: _fitted("payload", arm),
            "compliance with an unknown mass at the flange",
            is_candidate=False,
        ),
    )

    terms: ClassVar[tuple[TermFamily, ...]] = (GRAVITY,)

    def check(self) -> None:
        """Refuse a stiffness that is none."""
        if self.stiffness_nm_per_rad is not None:
            positive(option_name("stiffness_nm_per_rad"), self.stiffness_nm_per_rad)

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Return the same stiffness for every joint that bears the arm's weight."""
        at = np.zeros(3) if arm.loads is None else arm.loads.payload_at_m
        if self.stiffness_nm_per_rad is None:
            return JointSprings(np.zeros(arm.chain.size), at)
        if arm.loads is None:
            raise LabError(
                f"{option_name('stiffness_nm_per_rad')}: robot {arm.chain.name} has no masses, so nothing bends it"
            )
        bearing = arm.loads.bearing(rng_for(0, "structure"))
        stiffness = {joint + 1: self.stiffness_nm_per_rad for joint in bearing}
        return JointSprings(compliances(arm.chain, stiffness), at)


_TORQUE_NM = 30.0  # at which the option states its size
_SCALE = 1e-7  # rad/(Nm)^3


def hardening(loads: Loads) -> Effect:
    """The fitted group: d_i of the joints that bear the arm's weight."""
    bearing, slides = list(loads.bearing(rng_for(0, "structure"))), loads.chain.prismatic
    units = Unit("rad/(Nm)^3", "nrad/(Nm)³", 1e9, 4), Unit("m/N^3", "nm/N³", 1e9, 4)
    parameters = tuple(
        joint_parameter("hardening", i, "hardening", "compliance", unit=units[slides[i]], scale=_SCALE) for i in bearing
    )

    def offsets(joints: Array, payload: Array, values: Array) -> tuple[Array, Array]:
        torque = loads.forces(joints, payload[:, 0])[0]
        derivative = np.zeros((*joints.shape, len(bearing)), dtype=torque.dtype)
        for column, i in enumerate(bearing):
            derivative[:, i, column] = torque[:, i] ** 3
        return derivative @ values, derivative

    where = [(i, ("torque cubed", i)) for i in bearing]
    return Effect("hardening", parameters, offsets, (PAYLOAD,), plain=lambda values: joint_terms(values, *where))


def _fitted_hardening(arm: ArmFacts) -> Effect:
    if arm.chain.has_loops or arm.loads is None:
        why = "has loops" if arm.chain.has_loops else "is a table without masses"
        raise LabError(
            f"{option_name('model')} hardening: robot {arm.chain.name} {why}, so nothing is known to load its joints"
        )
    return hardening(arm.loads)


@dataclass(frozen=True)
class HardeningSprings(SimulatedEffect):
    """Hardening joint springs of one arm; ``simulation.elastic`` finds the equilibrium.

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
        FittedGroup("hardening", _fitted_hardening, "joints that grow stiffer, or softer, with torque"),
    )

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Return the same hardening for every joint that bears the arm's weight."""
        cubic = np.zeros(arm.chain.size)
        if self.hardening_mrad:
            if arm.loads is None:
                raise LabError(
                    f"{option_name('hardening_mrad')}: robot {arm.chain.name} has no masses, so nothing bends it"
                )
            bearing = list(arm.loads.bearing(rng_for(0, "structure")))
            cubic[bearing] = MRAD.to_si(-self.hardening_mrad) / _TORQUE_NM**3
        return HardeningSprings(levers(arm.chain) ** 4 * cubic)


_JOINT = 1  # from 0: the one that lifts the arm, where compensators are
_ORDERS = (1, 2)
_RATIO, _PRELOAD = 0.2, 0.7  # r, and l0 / s, of a virtual arm: ends at 0.1 and 1 of a length, stretched at all angles


def compensator(chain: JointSpec) -> Effect:
    """The fitted group: sine and cosine of joint 2's angle and of twice that, times what it gives way to the spring."""
    _refuse_without(chain, f"{option_name('model')} compensator")
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
    """Gravity compensator of one arm: a spring stretched at all angles, without torque where joint 2 is at zero.

    Attributes:
        deflects_rad: how far joint 2 would give way to k a b, the torque of a spring without free length at 90 degrees.
    """

    deflects_rad: float

    @classmethod
    def none(cls, joints: int) -> Self:
        """Return no spring."""
        return cls(0.0)

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """Joint 2's, by the spring's torque at its angle."""
        offsets: Array = np.zeros(joints.shape)
        if self.deflects_rad:
            angle = joints[:, _JOINT]
            offsets[:, _JOINT] = (
                self.deflects_rad * np.sin(angle) * (1 - _PRELOAD / np.sqrt(1 - _RATIO * np.cos(angle)))
            )
        return offsets

    def true_parameters(self) -> dict[str, float]:
        """The first two harmonics; those of the cosine are zero, by symmetry."""
        angle = np.linspace(-np.pi, np.pi, 256, endpoint=False)
        at = self.joint_offsets(np.tile(angle[:, None], (1, _JOINT + 1)), PoseConditions({}, len(angle), ()))
        sines = {f"joint2.spring_sin{k}": float(2 * np.mean(at[:, _JOINT] * np.sin(k * angle))) for k in _ORDERS}
        return sines | {f"joint2.spring_cos{k}": 0.0 for k in _ORDERS}

    def refuse_unfit(self, chain: JointSpec) -> None:
        """The spring sits at joint 2."""
        if self.deflects_rad:
            _refuse_without(chain, "effects: deflects_rad")


@dataclass(frozen=True)
class Compensator(VirtualEffect):
    """A gravity compensator of a virtual arm."""

    compensator_mrad: float = 0.0
    """How far joint 2 gives way to its gravity compensator, a spring, at 90 degrees."""

    groups: ClassVar[tuple[FittedGroup, ...]] = (
        FittedGroup("compensator", lambda arm: compensator(arm.chain), "joint 2 gives way to a spring"),
    )

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Return the compensator as given."""
        if self.compensator_mrad:
            _refuse_without(arm.chain, option_name("compensator_mrad"))
        return CompensatorSpring(MRAD.to_si(self.compensator_mrad) / (1 - _PRELOAD))


def _refuse_without(chain: JointSpec, what: str) -> None:
    """A LabError where there is no joint 2 that turns."""
    if _JOINT not in turning_joints(chain):
        raise LabError(f"{what}: robot {chain.name} has no joint 2 that turns, where a compensator would be")
