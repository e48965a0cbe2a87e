"""Joints that give way to gravity: joint i is at q_i + c_i g_i(q + offset), by the nominal model's masses."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from lab.core.errors import LabError
from lab.core.numbers import positive
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.dynamics.link_loads import link_loads
from lab.kinematics.effects.conditions import PAYLOAD, rates_in, rates_of
from lab.kinematics.effects.effect import (
    ArmFacts,
    Effect,
    FittedGroup,
    SimulatedEffect,
    TermFamily,
    VirtualEffect,
    levers,
    refuse_negative,
)
from lab.kinematics.effects.gravity_terms import GRAVITY
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import Parameter, joint_parameter

__all__ = ["NEWTON_STEPS", "Compliance", "JointSprings", "compliance", "compliances"]

NEWTON_STEPS = 2  # the first leaves about 1e-11 rad of a sag of 1 mrad
TYPICAL_COMPLIANCE = 1e-5  # rad/Nm
MASS_SCALE_KG = 10.0


def compliance(loads: Loads, payload: bool = False, *, moving: bool = False) -> Effect:
    """The fitted group: c_i of the joints that bear the arm's weight.

    The equilibrium is solved by Newton's method, with c the compliances (rad/Nm) and g the joints' torques
    (``Loads``). With ``payload``, an unknown mass at the last frame's origin is fitted too, beside the rows' own
    ``payload_kg``. With ``moving``, inertia loads the joints too, as their rates say.
    """
    links = link_loads(loads) if moving else None
    bearing = loads.bearing(rng_for(0, "structure"))
    group, slides = "payload" if payload else "compliance", loads.chain.prismatic
    units = ["m/N" if slides[i] else "rad/Nm" for i in bearing]
    parameters = tuple(
        joint_parameter(group, i, "compliance", "compliance", unit=unit) for i, unit in zip(bearing, units, strict=True)
    )
    if payload:
        parameters += (Parameter("payload", "mass", group, "mass", "kg", MASS_SCALE_KG),)

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

    typical = (*[TYPICAL_COMPLIANCE] * len(bearing), 0.0) if payload else ()
    asked = (PAYLOAD, *rates_of(loads.chain.joint_names)) if moving else (PAYLOAD,)
    return Effect(group, parameters, offsets, asked, typical=typical, plain=None if moving else plain)


def _fitted(name: str, arm: ArmFacts) -> Effect:
    if arm.chain.has_loops:
        raise LabError(f"--model {name}: robot {arm.chain.name} has loops, and nothing bends such a robot here")
    if arm.loads is None:
        raise LabError(
            f"--model {name}: robot {arm.chain.name} is a table without masses; give it as MJCF or URDF, "
            "or fit what gives way to unknown masses: joint2.gravity2 and its like"
        )
    return compliance(arm.loads, payload=name == "payload", moving=arm.moving)


def compliances(chain: JointSpec, stiffness: Mapping[int, float]) -> Array:
    """``(n,)`` rad/Nm (m/N of a slide), zero for a stiff joint, from stiffnesses (Nm/rad) by joint, from 1.

    A slide takes a stiffness as a hinge would at ``LEVER_M``.

    Raises:
        LabError: a stiffness is of no joint, or not above zero.
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
    """Of one arm; ``simulation.elastic`` finds how it settles.

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
            positive("--stiffness-nm-per-rad", self.stiffness_nm_per_rad)

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """The same stiffness for every joint that bears the arm's weight.

        Raises:
            LabError: the arm has no masses.
        """
        at = np.zeros(3) if arm.loads is None else arm.loads.payload_at_m
        if self.stiffness_nm_per_rad is None:
            return JointSprings(np.zeros(arm.chain.size), at)
        if arm.loads is None:
            raise LabError(f"--stiffness-nm-per-rad: robot {arm.chain.name} has no masses, so nothing bends it")
        bearing = arm.loads.bearing(rng_for(0, "structure"))
        stiffness = {joint + 1: self.stiffness_nm_per_rad for joint in bearing}
        return JointSprings(compliances(arm.chain, stiffness), at)
