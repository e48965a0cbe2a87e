"""A mechanism with loops in MuJoCo: nominal, as a "real" robot whose dimensions are off, and identified."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Self

import mujoco
import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.formats.description import DescriptionFormat
from lab.formats.mechanism_toml import MechanismFile
from lab.kinematics.closed.arm import ClosedArm
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.serial.arm import DEFAULT_TOOL
from lab.simulation.build_closed import BASE_BODY, closed_mjcf, closed_qpos, closed_spec
from lab.simulation.effects import Effects
from lab.simulation.model import FLANGE, TRACKER, RobotModel, compiled, coordinates
from lab.simulation.true_robot import TrueRobot, put_before_tracker

__all__ = ["CLOSED_MJCF", "ClosedModel", "TrueMechanism", "closed_model", "random_values", "true_mechanism"]

_SAMPLES = 1000  # random poses


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ClosedModel(RobotModel):
    """The nominal model of a mechanism.

    Attributes:
        height_m: of its base above the floor; None where there is none.
    """

    travel_is_bounded: ClassVar[bool] = False

    chain: Mechanism
    height_m: float | None

    def qpos(self, joints: Array) -> Array:
        """Passive joints stand where the nominal model's loops have them."""
        closed = self.chain.assembled(joints, self.chain.nominal_values)
        return _passive_coordinates(
            self.model, self.chain, joints, np.where(closed.fits, closed.configuration.passive, np.nan)
        )

    def travel_per_joint(self) -> Array:
        """Return the largest motion of a target per joint (m per m or rad), over many random poses."""
        arm = ClosedArm(self.chain, tuple(self.tool))
        joints = arm.structure_joints(_SAMPLES, rng_for(0, "structure"))
        moved = arm.joint_derivatives(arm.observe(joints, arm.nominal(self.tool))[1])
        return np.asarray(np.linalg.norm(moved, axis=2).max(axis=(0, 1)))

    def with_parameters(self, targets: tuple[str, ...], values: Array, joints: Array) -> tuple[mujoco.MjModel, Array]:
        """A mechanism with these parameters, its loops closed at the joint positions."""
        passive = self.chain.assembled(joints, values).configuration.passive
        model = self.with_values(values, {}).compile()
        return model, _passive_coordinates(model, self.chain, joints, passive)

    def with_values(self, values: Array, tool: Mapping[str, Array]) -> mujoco.MjSpec:
        """A copy with the mechanism's parameters ``(p,)`` and these targets (m, on the platform)."""
        return closed_spec(self.chain, values, tool, self.height_m)


def closed_model(path: Path, described: MechanismFile) -> ClosedModel:
    """The mechanism of a description, which says all that its shapes can be drawn from."""
    mechanism = described.mechanism
    named = {name: place for name, place in described.tool.items() if name not in (FLANGE, TRACKER)}
    tool = named or {name: np.array(place) for name, place in DEFAULT_TOOL.items()}
    spec = closed_spec(mechanism, mechanism.nominal_values, tool, described.height_m)
    return ClosedModel(
        path=path,
        spec=spec,
        model=compiled(path, spec),
        chain=mechanism,
        T_world_frame0=se3.pose(np.eye(3), np.array([0.0, 0.0, described.height_m or 0.0])),
        base_body=BASE_BODY,
        tool=tool,
        height_m=described.height_m,
    )


def _identified_mjcf(robot: ClosedModel, arm: ClosedArm, values: Array) -> str:
    """The identified mechanism as MJCF whose loops, closed, have the identified sites in the tracker's frame."""
    spec = robot.with_values(values, arm.tool_positions(values))
    model = compiled(robot.path, spec)
    robot.place_tracker(model, robot.T_world_frame0 @ se3.inverse(arm.T_tracker_frame0(values)))
    carrier = spec.site(TRACKER).parent
    placed = model.body(carrier.name)
    carrier.pos, carrier.quat = placed.pos, placed.quat
    return closed_mjcf(spec)


CLOSED_MJCF: DescriptionFormat[ClosedArm, ClosedModel] = DescriptionFormat(
    "calibrated.xml", lambda identified: _identified_mjcf(identified.model, identified.arm, identified.values)
)


def _passive_coordinates(model: mujoco.MjModel, mechanism: Mechanism, joints: Array, passive: Array) -> Array:
    """MuJoCo's coordinates ``(n, nq)`` at joint positions ``(n, joints)`` and passive values ``(z, n)``."""
    moving = [i for i, name in enumerate(mechanism.joint_names) if mechanism.offset_of(i) not in _legs(mechanism)]
    names = [mechanism.joint_names[i] for i in moving]
    names += [mechanism.tree.name_of(f, s) for f, s in mechanism.tree.passive]
    return coordinates(model, names, np.concatenate([joints[:, moving], passive.T], axis=1))


def _legs(mechanism: Mechanism) -> list[str]:
    return [f"{rod.name}.length" for rod in mechanism.tree.rods]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TrueMechanism(TrueRobot):
    """A mechanism whose dimensions are off.

    Attributes:
        values: ``(p,)`` of ``Mechanism.names``; the base stands in the world at its nominal pose.
    """

    robot: ClosedModel
    values: Array

    def truth(self, targets: tuple[str, ...]) -> None:
        """Dimensions of a mechanism are not read off its joint axes."""

    def with_effects(self, effects: Effects) -> Self:
        """This robot with these effects alone; nothing of it bends.

        Raises:
            LabError: the effects bend its links, or are of a robot with other joints.
        """
        if effects.is_elastic:
            raise LabError(f"robot {self.robot.chain.name} has loops, and nothing bends such a robot here")
        return super().with_effects(effects)

    def _qpos(self, driven: Array) -> Array:
        """Newton's method on MuJoCo's constraints, from nominal passive values: a jump to another mode is NaN."""
        chain = self.robot.chain
        start = chain.assembled(driven, chain.nominal_values).configuration.passive
        found = np.full((len(driven), self.model.nq), np.nan)
        near = np.isfinite(start).all(axis=0)
        qpos, jumped = closed_qpos(self.model, chain, self.values, driven[near], start[:, near])
        found[near] = np.where(jumped[:, None], np.nan, qpos)
        return found


def true_mechanism(robot: ClosedModel, values: Array, T_world_tracker: Array) -> TrueMechanism:
    """The robot with other dimensions, before a tracker."""
    model = robot.with_values(values, robot.tool).compile()
    put_before_tracker(model, robot, T_world_tracker)
    return TrueMechanism(
        robot=robot,
        model=model,
        T_world_tracker=T_world_tracker,
        values=values,
        effects=Effects.none(robot.chain.size),
    )


def random_values(
    mechanism: Mechanism, position_sigma_m: float, rotation_sigma_rad: float, rng: np.random.Generator
) -> Array:
    """Parameters ``(p,)`` off by normal draws of these standard deviations, the base at its nominal pose."""
    turns = [tree_step.is_turn for tree_step in (mechanism.tree.step(f, s) for f, s in mechanism.tree.constants)]
    sigma = np.array([rotation_sigma_rad if turn else position_sigma_m for turn in turns])
    sigma = np.concatenate([np.zeros(6), sigma, np.full(len(mechanism.tree.lengths), position_sigma_m)])
    off: Array = mechanism.nominal_values + sigma * rng.standard_normal(len(sigma))
    return off
