"""Build the true robot: a copy of the model with errors of its bodies, and exact positions in a tracker's frame."""

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any, Self, TypeVar

import mujoco
import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.core.values import Value
from lab.kinematics.effects.bending import ElasticLinks
from lab.kinematics.effects.compliance import HardeningSprings, JointSprings
from lab.kinematics.effects.effect import PAYLOAD, PoseConditions
from lab.kinematics.effects.sessions import StationPoses
from lab.kinematics.model import RigidArm
from lab.kinematics.serial.axes_to_dh import JointAxes, Truth, parameters_from_axes
from lab.kinematics.serial.serial_arm import SerialArm
from lab.simulation.effects import NOTHING_SET, TrueEffects
from lab.simulation.elastic_links import FlexibleArm
from lab.simulation.robot_model import OpenModel, RobotModel, SerialModel, coordinates, joint_axes, update_constants
from lab.simulation.sampler import NORMAL, Sampler

__all__ = [
    "GeometryErrors",
    "Perturbation",
    "TrueOpenRobot",
    "TrueRobot",
    "TrueSerialRobot",
    "before_stations",
    "perturbed_bodies",
    "put_before_tracker",
    "random_perturbation",
    "random_table",
    "random_tracker",
    "true_robot",
    "true_robot_from_table",
]


_TrueRobot = TypeVar("_TrueRobot", bound="TrueRobot")


@dataclass(frozen=True)
class GeometryErrors:
    """Geometric errors of a virtual robot, as standard deviations per axis.

    Attributes:
        position_sigma_m: of the bodies' positions, or of a mechanism's lengths.
        rotation_sigma_rad: of the bodies' orientations, or of a mechanism's angles.
        joint_offset_sigma: of the joints' offsets, rad or m.
        table_alone: whether only the entries of the Denavit-Hartenberg table are in error.
        sampler: draws them, in these standard deviations.
    """

    position_sigma_m: float
    rotation_sigma_rad: float
    joint_offset_sigma: float = 0.0
    table_alone: bool = False
    sampler: Sampler = NORMAL


@dataclass(frozen=True)
class Perturbation:
    """Geometric errors of the bodies.

    Attributes:
        bodies: their names.
        position_m: ``(b, 3)``, added to the body's position in its parent's frame.
        rotation_rad: ``(b, 3)``, a rotation vector in the body's own frame.
        joint_offset: ``(n,)`` rad or m: the joint's true position less the measured one.
    """

    bodies: tuple[str, ...]
    position_m: Array
    rotation_rad: Array
    joint_offset: Array

    def __post_init__(self) -> None:
        b = len(self.bodies)
        if self.position_m.shape != (b, 3) or self.rotation_rad.shape != (b, 3) or self.joint_offset.ndim != 1:
            raise LabError(f"a perturbation of {b} bodies: give position_m and rotation_rad of shape ({b}, 3)")


def perturbed_bodies(robot: OpenModel) -> tuple[str, ...]:
    """Return the bodies that get errors: base, every link, and each flange if it is a body of its own."""
    base = [robot.base_body] if robot.base_body else []
    return tuple(dict.fromkeys([*base, *robot.bodies, *robot.carriers]))


def random_perturbation(
    robot: OpenModel,
    position_sigma_m: float,
    rotation_sigma_rad: float,
    rng: np.random.Generator,
    offset_sigma: float = 0.0,
    sampler: Sampler = NORMAL,
) -> Perturbation:
    """Draw errors of every body with these standard deviations per axis, then of every joint (rad or m)."""
    bodies = perturbed_bodies(robot)
    draws = sampler.draw(rng, (len(bodies), 6))
    offset = offset_sigma * sampler.draw(rng, (robot.chain.size,))
    return Perturbation(bodies, position_sigma_m * draws[:, :3], rotation_sigma_rad * draws[:, 3:], offset)


def random_table(
    arm: SerialArm,
    position_sigma_m: float,
    rotation_sigma_rad: float,
    rng: np.random.Generator,
    sampler: Sampler = NORMAL,
) -> Array:
    """Draw parameters ``(p,)`` with errors of the links' Denavit-Hartenberg entries (and betas) alone."""
    base, table, tool = arm.split(arm.nominal())
    sigma = np.array([rotation_sigma_rad, position_sigma_m, position_sigma_m, rotation_sigma_rad, rotation_sigma_rad])
    return arm.assemble(base, table + sigma * sampler.draw(rng, table.shape), tool)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TrueRobot(Value, ABC):
    """A perturbed arm before a tracker.

    It is pickled by its robot's files, which hold the meshes, and the numbers that differ from the nominal model's.

    Attributes:
        model: with the true poses of the bodies and the tracker.
        T_world_tracker: pose ``(4, 4)`` (m) of the tracker's frame in the world of the MuJoCo model: ``points`` are
            measured in the tracker's frame, ``T_world_tracker @ p`` are the sites' positions in the world.
        effects: beside the geometry.
    """

    robot: RobotModel
    model: mujoco.MjModel
    T_world_tracker: Array
    effects: TrueEffects

    def _about(self) -> str:
        return self.robot.chain.name

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "model": _differences(self.robot.model, self.model)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        model = copy.deepcopy(state["robot"].model)
        for part, name, value in state["model"]:
            if isinstance(value, np.ndarray):
                getattr(part(model), name)[...] = value
            else:
                setattr(part(model), name, value)
        self.__dict__.update(state, model=model)

    def with_effects(self, effects: TrueEffects) -> Self:
        """Return this arm and tracker with these effects alone.

        Raises:
            LabError: they are for other joints.
        """
        effects.refuse_unfit(self.robot.chain)
        return replace(self, effects=effects)

    def points(
        self,
        joints: Array,
        targets: Sequence[str],
        conditions: Mapping[str, Array] = NOTHING_SET,
        scatter: Array | float = 0.0,
    ) -> Array:
        """Return the exact positions ``(m, k, 3)`` m of the targets in the tracker's frame, at ``joints`` ``(m, n)``.

        They include all effects that are the same at every visit: motors, then loads, growth, and tracker drift.

        Args:
            conditions: ``payload_kg``, ``approach_<joint>`` (+1 or -1), ``time_s``, ``temp_C`` and ``session 2`` (1
                after the bump), ``(m,)`` each; defaults are no payload, no approach, time zero, no bump, and 20
                degrees Celsius.
            scatter: ``(m, n)`` rad or m, random joint errors.
        """
        sites = [self.model.site(name).id for name in targets]
        pose_conditions = PoseConditions(conditions, len(joints), self.robot.chain.joint_names)
        driven = self.effects.driven(joints, pose_conditions) + scatter
        world = self._site_positions(driven, sites, pose_conditions.column(PAYLOAD))
        world = self.effects.moved(world, self.robot.T_world_frame0[:3, 3], pose_conditions)
        first = se3.transform(se3.inverse(self.T_world_tracker), world.reshape(-1, 3)).reshape(world.shape)
        return self.effects.seen_after(first, pose_conditions)

    @abstractmethod
    def truth(self, targets: tuple[str, ...]) -> Truth | None:
        """Return the parameters of the geometry, without effects, with these targets, read off the joint axes.

        None for a mechanism with loops, which axes do not determine, and for a robot with several tips.
        """

    def _site_positions(self, driven: Array, sites: list[int], payload_kg: Array) -> Array:
        """Return the world positions ``(m, k, 3)`` m of the sites at driven joint positions ``(m, n)``."""
        data = mujoco.MjData(self.model)
        world = np.full((len(driven), len(sites), 3), np.nan)
        qpos = self._qpos(driven)
        for i in np.flatnonzero(np.isfinite(qpos).all(axis=1)):
            data.qpos[:] = qpos[i]
            mujoco.mj_kinematics(self.model, data)
            world[i] = data.site_xpos[sites]
        return world

    @abstractmethod
    def _qpos(self, driven: Array) -> Array:
        """Return MuJoCo's coordinates ``(m, nq)`` at driven joint positions ``(m, n)``; NaN if impossible."""


def _whole(model: mujoco.MjModel) -> mujoco.MjModel:
    return model


_Part = Callable[[mujoco.MjModel], Any]
_PARTS: tuple[_Part, ...] = (_whole, attrgetter("opt"), attrgetter("stat"))


def _differences(nominal: mujoco.MjModel, model: mujoco.MjModel) -> list[tuple[_Part, str, Any]]:
    """Return the numbers of a model that differ from the nominal one's: the part that holds them, name and value."""
    return [
        (part, name, np.copy(value) if isinstance(value, np.ndarray) else value)
        for part in _PARTS
        for name in dir(part(model))
        if not name.startswith("_")
        and isinstance(value := getattr(part(model), name), np.ndarray | float | int)
        and not np.array_equal(value, getattr(part(nominal), name), equal_nan=np.asarray(value).dtype.kind == "f")
    ]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TrueOpenRobot(TrueRobot):
    """A perturbed robot without loops, of one chain or several.

    Attributes:
        joint_offset: ``(n,)`` rad or m.
    """

    robot: OpenModel
    joint_offset: Array

    def _qpos(self, driven: Array) -> Array:
        return coordinates(self.model, self.robot.chain.joint_names, driven + self.joint_offset)

    def truth(self, targets: tuple[str, ...]) -> Truth | None:
        """Return None: the axes of several chains are read off one at a time; the fit to exact points gives all."""
        return None

    def with_effects(self, effects: TrueEffects) -> Self:
        """Return this robot with these effects alone.

        Raises:
            LabError: they bend its links or joints, or are for other joints.
        """
        if effects.is_elastic and not isinstance(self, TrueSerialRobot):
            raise LabError(
                f"robot {self.robot.chain.name} has {self.robot.chain.beside_serial}, and nothing bends it here"
            )
        return super().with_effects(effects)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TrueSerialRobot(TrueOpenRobot):
    """A perturbed serial arm."""

    robot: SerialModel

    def _site_positions(self, driven: Array, sites: list[int], payload_kg: Array) -> Array:
        if not self.effects.is_elastic:
            return super()._site_positions(driven, sites, payload_kg)
        springs = self.effects.part(JointSprings)
        arm = FlexibleArm(self.model, self.robot, springs.payload_at_m, self.effects.part(ElasticLinks).compliances)
        hard = self.effects.part(HardeningSprings).cubic_rad_per_nm3
        settled = arm.settled(driven + self.joint_offset, springs.compliance_rad_per_nm, payload_kg, cubic=hard)
        return arm.positions(settled, sites)

    def truth(self, targets: tuple[str, ...]) -> Truth:
        """Return the canonical parameters of the geometry, without effects, read off the joint axes."""
        arm = SerialArm(self.robot.chain, targets)
        data = mujoco.MjData(self.model)
        data.qpos[:] = self._qpos(np.zeros((1, self.robot.chain.size)))[0]
        mujoco.mj_kinematics(self.model, data)
        world = joint_axes(self.model, data, self.robot.chain.joint_names, arm.targets)
        T_tracker_world = se3.inverse(self.T_world_tracker)
        axes = JointAxes(
            se3.transform(T_tracker_world, world.origins),
            world.directions @ T_tracker_world[:3, :3].T,
            se3.transform(T_tracker_world, world.targets),
        )
        return parameters_from_axes(arm, axes, self.robot.values_before(arm, self.T_world_tracker))


def true_robot(robot: OpenModel, perturbation: Perturbation, T_world_tracker: Array) -> TrueOpenRobot:
    """Return the robot with these errors, before a tracker; a serial one as a ``TrueSerialRobot``.

    Raises:
        LabError: a body is unknown, or there is not one offset for each joint.
    """
    model = copy.deepcopy(robot.model)
    known = perturbed_bodies(robot)
    if unknown := [name for name in perturbation.bodies if name not in known]:
        raise LabError(f"body '{unknown[0]}' is unknown: robot {robot.chain.name} has {', '.join(known)}")
    if len(perturbation.joint_offset) != robot.chain.size:
        raise LabError(f"{len(perturbation.joint_offset)} joint offsets for {robot.chain.size} joints: give one each")
    for name, position, rotation in zip(
        perturbation.bodies, perturbation.position_m, perturbation.rotation_rad, strict=True
    ):
        body = model.body(name)
        turned = se3.rotation_from_quaternion(body.quat) @ se3.exp(rotation)
        body.pos[:] += position
        body.quat[:] = se3.quaternion_from_rotation(turned)
    return _before_tracker(robot, model, T_world_tracker, perturbation.joint_offset)


def true_robot_from_table(robot: OpenModel, arm: RigidArm, values: Array, T_world_tracker: Array) -> TrueOpenRobot:
    """Return the robot with its bodies on the axes of Denavit-Hartenberg chains; the base stays."""
    model = copy.deepcopy(robot.model)
    robot.place_bodies(model, arm, values)
    return _before_tracker(robot, model, T_world_tracker, np.zeros(robot.chain.size))


def random_tracker(robot: RobotModel, rng: np.random.Generator, station: int = 0) -> Array:
    """Draw a tracker's pose ``(4, 4)``: near a nominal station, at any angle about z, a little tilted."""
    place: Array = robot.Ts_world_station[station].copy()
    place[:3, 3] += rng.uniform(-0.15, 0.15, 3)
    tilt = np.append(np.deg2rad(2.0) * rng.standard_normal(2), 0.0)
    place[:3, :3] = se3.exp(tilt) @ se3.exp(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))
    return place


def before_stations(real: _TrueRobot, Ts_world_station: Array) -> _TrueRobot:
    """Return the robot with further stations of its instrument, at world poses ``(s - 1, 4, 4)`` (m)."""
    if not len(Ts_world_station):
        return real
    model, T_tracker_world = copy.deepcopy(real.model), se3.inverse(real.T_world_tracker)
    for station, T in enumerate(Ts_world_station, start=1):
        real.robot.place_tracker(model, T, station)
    update_constants(model)
    poses = StationPoses(dict(zip(real.robot.stations[1:], T_tracker_world @ Ts_world_station, strict=True)))
    return replace(real, model=model, effects=real.effects.having(poses))


def put_before_tracker(model: mujoco.MjModel, robot: RobotModel, T_world_tracker: Array) -> None:
    """Place the tracker of a copy of a robot's model, its bodies moved, at this pose ``(4, 4)`` in the world."""
    robot.place_tracker(model, T_world_tracker)
    update_constants(model)


def _before_tracker(robot: OpenModel, model: mujoco.MjModel, T_world_tracker: Array, offset: Array) -> TrueOpenRobot:
    put_before_tracker(model, robot, T_world_tracker)
    nothing = TrueEffects.none(robot.chain.size)
    if isinstance(robot, SerialModel):
        return TrueSerialRobot(
            robot=robot, model=model, T_world_tracker=T_world_tracker, joint_offset=offset, effects=nothing
        )
    return TrueOpenRobot(
        robot=robot, model=model, T_world_tracker=T_world_tracker, joint_offset=offset, effects=nothing
    )
