"""Elastic joints: compliance, hardening springs, gravity compensators, links of unknown mass.

Hardening: joint i deflects by d_i g_i^3 beside the part in proportion to its torque g_i, at the measured joint
positions. Harmonic drives grow stiffer with torque (d_i < 0).

A gravity compensator is a spring between two links, whose joint deflects. With stiffness k, free length l0 and ends at
distances a and b from the joint its torque is k a b sin(phi) (1 - l0 / l), with l^2 = a^2 + b^2 - 2 a b cos(phi). With
s^2 = a^2 + b^2 and r = 2 a b / s^2 its length is s sqrt(1 - r cos(phi)): the first two harmonics of the joint's angle,
which are fitted, are all but about 3 r^2 / 32 of it.

Unknown masses: the torque of link l's weight about joint i is linear in the link's mass and first moment (Khalil &
Dombre 2002, section 9.3.2). A mass times a constant lever acts like a first moment of the link with the lever, and a
moment along axis l like one of the link before: what remains are each link's first moments across its own axis, along x
and y of its frame. A joint with compliance c_i is at q_i + c_i m_l |g| (x_l, y_l) . r_il, with r_il the torques of a
unit weight there; the parameter is the product of c_i and the moment.
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
from lab.kinematics.dynamics.gravity import Loads, chain_frames, link_loads, solved_by
from lab.kinematics.effects.effect import (
    PAYLOAD,
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
    "NEWTON_STEPS",
    "CompensatorSpring",
    "Compliance",
    "GravityCompensator",
    "Hardening",
    "HardeningSprings",
    "JointSprings",
    "compliances",
]

_DOWN = np.array([0.0, 0.0, -1.0])  # default in frame 0


def _of_one_link(arm: ArmFacts, joint: int, link: int) -> Effect:
    """Return the group of a joint's deflections (rad), from 0, under a link's weight, from 1."""
    name, chain = _GRAVITY.name(joint, link), arm.chain
    if not isinstance(chain, Chain) or (joint, link) not in _searched(arm):
        raise LabError(
            f"{option_name('model')} {name}: give a joint that turns and a link that it carries, of a robot "
            "without loops"
        )
    parameters = tuple(joint_parameter(name, joint, f"gravity{link}{axis}") for axis in "xy")
    down = _DOWN if arm.loads is None else arm.loads.gravity / np.linalg.norm(arm.loads.gravity)

    plain = [("weight", joint, link - 1, axis, down.tolist()) for axis in range(2)]
    return from_signals(
        name, parameters, (joint, joint), lambda joints, _: _unit_torques(chain, joints, down, joint, link - 1), plain
    )


def _unit_torques(chain: Chain, joints: Array, down: Array, joint: int, link: int) -> Array:
    """Return torques about a hinge of a unit weight times metre on a link, along x and y of its frame, ``(n, 2)``.

    Args:
        down: unit vector ``(3,)`` in frame 0.
        joint, link: from 0; the frame turns with the link's own joint, z along that joint's axis.
    """
    frames = chain_frames(chain, joints)
    across = np.cross(down, frames.axes[:, joint])  # down . (z x r) = (down x z) . r
    torques: Array = np.einsum("ni,nij->nj", across, frames.rotations[:, link, :, :2])
    return torques


def _searched(arm: ArmFacts) -> list[tuple[int, int]]:
    """List every hinge with its own link and all revolute links beyond."""
    if not isinstance(arm.chain, Chain):
        return []
    turning = turning_joints(arm.chain)
    return [(i, link + 1) for i in turning for link in turning if link >= i]


_GRAVITY = TermFamily(
    "gravity",
    "a link, whose weight it gives way to",
    _of_one_link,
    _searched,
    lambda joint, link: f"joint {joint} gives way to the weight of link {link}",
)


NEWTON_STEPS = 2  # after the first an error of about 1e-11 rad of a sag of 1 mrad remains
_TYPICAL_COMPLIANCE = 1e-5  # rad/Nm
_MASS_SCALE_KG = 10.0


def _compliance(loads: Loads, payload: bool = False, *, moving: bool = False) -> Effect:
    """Return the fitted group: c_i of the joints that bear the arm's weight, by Newton's method for the equilibrium.

    With ``payload``, a mass at the last frame's origin is fitted, beside the rows' ``payload_kg``. With ``moving``,
    inertia is a load, too.
    """
    group = "payload" if payload else "compliance"
    springs = _FittedSprings(loads, loads.bearing(rng_for(0, "structure")), payload, moving)
    return Effect(
        group,
        springs.parameters(group),
        springs.offsets,
        (PAYLOAD, *rates_of(loads.chain.joint_names)) if moving else (PAYLOAD,),
        typical=(*[_TYPICAL_COMPLIANCE] * len(springs.bearing), 0.0) if payload else (),
        terms=None if moving else springs.terms,
        stacks=not (payload or moving),
    )


@dataclass(frozen=True)
class _FittedSprings:
    """Springs in the joints that bear the arm's weight, as functions of their compliances.

    Attributes:
        loads: the arm's masses.
        bearing: the joints that bear it.
        payload: whether a mass at the last frame's origin is fitted behind the compliances.
        moving: whether inertia is a load, too.
    """

    loads: Loads
    bearing: tuple[int, ...]
    payload: bool
    moving: bool

    def parameters(self, group: str) -> tuple[Parameter, ...]:
        """Return the compliances, and the mass."""
        slide, slides = Unit("m/N", "µm/N", 1e6), self.loads.chain.prismatic
        compliances = tuple(
            joint_parameter(group, i, "compliance", "compliance", unit=slide if slides[i] else None)
            for i in self.bearing
        )
        mass = Parameter("payload", "mass", group, "mass", Unit("kg", "kg", 1.0), _MASS_SCALE_KG)
        return (*compliances, mass) if self.payload else compliances

    def offsets(self, joints: Array, conditions: Array, values: Array) -> tuple[Array, Array]:
        """Return the sag x of the joints, x = c F(q + x), and its derivatives."""
        # compliances c of all joints, and the mass at the hand
        c: Array = np.zeros((*values.shape[:-1], self.loads.chain.size), dtype=np.result_type(values, float))
        c[..., list(self.bearing)] = values[..., : len(self.bearing)]
        mass = conditions[:, 0] + (values[-1] if self.payload else 0.0)
        # the equilibrium, with the forces F there
        rest = self.loads.equilibrium(joints, c, mass, NEWTON_STEPS, self._inertia(joints, conditions, mass))
        # (1 - c F') dx = F dc + c dF
        right = np.zeros((*rest.force.shape, len(self.bearing) + self.payload), dtype=c.dtype)
        for k, i in enumerate(self.bearing):
            right[..., i, k] = rest.force[..., i]
        if self.payload:
            heavier = self.loads.forces(joints + rest.offset, mass + 1.0)[0]
            inertia = self._inertia(joints, conditions, mass + 1.0)
            heavier = heavier if inertia is None else heavier + inertia
            right[..., -1] = c * (heavier - rest.force)
        moving_joints = slice(None) if values.ndim == 1 else np.array(self.bearing)
        derivative: Array = np.asarray(solved_by(rest.equations, right, moving_joints), dtype=c.dtype)
        return rest.offset, derivative

    def _inertia(self, joints: Array, conditions: Array, mass: Array) -> Array | None:
        """Return the forces of inertia by the rates among the conditions; None at rest."""
        if not self.moving:
            return None
        return link_loads(self.loads).inertia(joints, *rates_in(conditions, self.loads.chain.size), mass)

    def terms(self, values: Array) -> list[dict[str, Any]]:
        """Return ``Effect.terms``."""
        by_joint = dict(zip(self.bearing, values.tolist(), strict=False))
        compliances = [by_joint.get(i, 0.0) for i in range(self.loads.chain.size)]
        return [{"springs": compliances, "payload_kg": float(values[-1]) if self.payload else 0.0}]


def _fitted(name: str, arm: ArmFacts) -> Effect:
    if beside := arm.chain.beside_serial:
        raise LabError(
            f"{option_name('model')} {name}: robot {arm.chain.name} has {beside}, and nothing bends such a robot here"
        )
    if arm.loads is None:
        raise LabError(
            f"{option_name('model')} {name}: robot {arm.chain.name} is a table without masses; give it as MJCF or "
            "URDF, or fit what gives way to unknown masses: joint2.gravity2 and its like"
        )
    return _compliance(arm.loads, payload=name == "payload", moving=arm.moving)


def compliances(chain: JointSpec, stiffness: Mapping[int, float]) -> Array:
    """Return ``(n,)`` rad/Nm (m/N of a slide), zero for a stiff joint, from stiffnesses (Nm/rad) by joint, from 1.

    A slide takes a stiffness as a hinge at ``LEVER_M``.
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
        compliance_rad_per_nm: ``(n,)`` deflection per torque.
        payload_at_m: ``(3,)``, payloads' centre of mass in the last frame.
    """

    compliance_rad_per_nm: Array
    payload_at_m: Array

    def __post_init__(self) -> None:
        refuse_negative("compliance_rad_per_nm", self.compliance_rad_per_nm)

    @classmethod
    def none(cls, joints: int) -> Self:
        """Return stiff joints."""
        return cls(np.zeros(joints), np.zeros(3))

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the payload."""
        return (PAYLOAD,) if self.compliance_rad_per_nm.any() else ()

    def true_parameters(self) -> dict[str, float]:
        """Return c_i."""
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

    terms: ClassVar[tuple[TermFamily, ...]] = (_GRAVITY,)

    def check(self) -> None:
        """Refuse a stiffness that is not above zero."""
        if self.stiffness_nm_per_rad is not None:
            positive(option_name("stiffness_nm_per_rad"), self.stiffness_nm_per_rad)

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Return the same stiffness for every joint that bears the arm's weight."""
        at = np.zeros(3) if arm.loads is None else arm.loads.payload_at_m
        if self.stiffness_nm_per_rad is None:
            return JointSprings(np.zeros(arm.chain.size), at)
        if arm.loads is None:
            beside = arm.chain.beside_serial or "no masses"
            raise LabError(
                f"{option_name('stiffness_nm_per_rad')}: robot {arm.chain.name} has {beside}, so nothing bends it"
            )
        bearing = arm.loads.bearing(rng_for(0, "structure"))
        stiffness = {joint + 1: self.stiffness_nm_per_rad for joint in bearing}
        return JointSprings(compliances(arm.chain, stiffness), at)


_TORQUE_NM = 30.0  # torque of the option's size
_SCALE = 1e-7  # rad/(Nm)^3


def _hardening(loads: Loads) -> Effect:
    """Return the fitted group: d_i of the joints that bear the arm's weight."""
    bearing, slides = list(loads.bearing(rng_for(0, "structure"))), loads.chain.prismatic
    units = Unit("rad/(Nm)^3", "nrad/(Nm)³", 1e9, 4), Unit("m/N^3", "nm/N³", 1e9, 4)
    parameters = tuple(
        joint_parameter("hardening", i, "hardening", "compliance", unit=units[slides[i]], scale=_SCALE) for i in bearing
    )

    plain = [("torque cubed", i) for i in bearing]
    return from_signals(
        "hardening",
        parameters,
        bearing,
        lambda joints, payload: loads.forces(joints, payload[:, 0])[0][:, bearing] ** 3,
        plain,
        (PAYLOAD,),
    )


def _fitted_hardening(arm: ArmFacts) -> Effect:
    if arm.chain.beside_serial or arm.loads is None:
        why = f"has {arm.chain.beside_serial}" if arm.chain.beside_serial else "is a table without masses"
        raise LabError(
            f"{option_name('model')} hardening: robot {arm.chain.name} {why}, so nothing is known to load its joints"
        )
    return _hardening(arm.loads)


@dataclass(frozen=True)
class HardeningSprings(OnePerJoint):
    """Hardening joint springs of one arm; ``simulation.elastic`` finds the equilibrium.

    Attributes:
        cubic_rad_per_nm3: ``(n,)`` deflection by the cube of the torque; negative for hardening.
    """

    cubic_rad_per_nm3: Array
    symbol: ClassVar[str] = "hardening"

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the payload."""
        return (PAYLOAD,) if self.cubic_rad_per_nm3.any() else ()


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
                beside = arm.chain.beside_serial or "no masses"
                raise LabError(
                    f"{option_name('hardening_mrad')}: robot {arm.chain.name} has {beside}, so nothing bends it"
                )
            bearing = list(arm.loads.bearing(rng_for(0, "structure")))
            cubic[bearing] = MRAD.to_si(-self.hardening_mrad) / _TORQUE_NM**3
        return HardeningSprings(levers(arm.chain) ** 4 * cubic)


_JOINT = 1  # from 0: the joint with a compensator, which lifts the arm
_ORDERS = (1, 2)
_RATIO, _PRELOAD = 0.2, 0.7  # r and l0 / s of a virtual arm: a spring that is stretched at all angles


def _compensator(chain: JointSpec) -> Effect:
    """Return the fitted group: joint 2's deflections by sine and cosine of its angle and of twice that."""
    _refuse_without(chain, f"{option_name('model')} compensator")
    parameters = tuple(
        joint_parameter("compensator", _JOINT, f"spring_{function}{order}", wave=order)
        for order in _ORDERS
        for function in ("sin", "cos")
    )

    def signals(joints: Array, _: Array) -> Array:
        waves = [function(order * joints[:, _JOINT]) for order in _ORDERS for function in (np.sin, np.cos)]
        return np.stack(waves, axis=1)

    plain = [(function, order, _JOINT) for order in _ORDERS for function in ("sin", "cos")]
    return from_signals("compensator", parameters, [_JOINT] * len(plain), signals, plain)


@dataclass(frozen=True)
class CompensatorSpring(SimulatedEffect, MovesJoints):
    """Gravity compensator of one arm: a spring stretched at all angles, without torque at zero of joint 2.

    Attributes:
        deflects_rad: deflection of joint 2 by k a b, the torque of a spring without free length at 90 degrees.
    """

    deflects_rad: float

    @classmethod
    def none(cls, joints: int) -> Self:
        """Return no spring."""
        return cls(0.0)

    def joint_offsets(self, joints: Array, conditions: PoseConditions) -> Array:
        """Return joint 2's deflection at its angle."""
        offsets: Array = np.zeros(joints.shape)
        if self.deflects_rad:
            angle = joints[:, _JOINT]
            offsets[:, _JOINT] = (
                self.deflects_rad * np.sin(angle) * (1 - _PRELOAD / np.sqrt(1 - _RATIO * np.cos(angle)))
            )
        return offsets

    def true_parameters(self) -> dict[str, float]:
        """Return the first two harmonics; those of the cosine are zero, by symmetry."""
        angle = np.linspace(-np.pi, np.pi, 256, endpoint=False)
        at = self.joint_offsets(np.tile(angle[:, None], (1, _JOINT + 1)), PoseConditions({}, len(angle), ()))
        sines = {f"joint2.spring_sin{k}": float(2 * np.mean(at[:, _JOINT] * np.sin(k * angle))) for k in _ORDERS}
        return sines | {f"joint2.spring_cos{k}": 0.0 for k in _ORDERS}

    def refuse_unfit(self, chain: JointSpec) -> None:
        """Refuse an arm without a joint 2 that turns."""
        if self.deflects_rad:
            _refuse_without(chain, "effects: deflects_rad")


@dataclass(frozen=True)
class GravityCompensator(VirtualEffect):
    """A gravity compensator of a virtual arm."""

    compensator_mrad: float = 0.0
    """How far joint 2 gives way to its gravity compensator, a spring, at 90 degrees."""

    groups: ClassVar[tuple[FittedGroup, ...]] = (
        FittedGroup("compensator", lambda arm: _compensator(arm.chain), "joint 2 gives way to a spring"),
    )

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Return the compensator as given."""
        if self.compensator_mrad:
            _refuse_without(arm.chain, option_name("compensator_mrad"))
        return CompensatorSpring(MRAD.to_si(self.compensator_mrad) / (1 - _PRELOAD))


def _refuse_without(chain: JointSpec, what: str) -> None:
    if _JOINT not in turning_joints(chain):
        raise LabError(f"{what}: robot {chain.name} has no joint 2 that turns, where a compensator would be")
