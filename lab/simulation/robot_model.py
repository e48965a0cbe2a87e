"""Define a robot's nominal model in MuJoCo, and read poses off any MuJoCo model."""

import copy
import itertools
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import mujoco
import numpy as np

from lab.core import se3
from lab.core.errors import LabError, LabWarning
from lab.core.se3 import Array
from lab.core.values import Value
from lab.formats.cell_toml import Cell
from lab.kinematics.dynamics.beam import LinkSections
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.kinematics.serial.axes_to_dh import JointAxes
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import DEFAULT_TOOL, SerialArm
from lab.kinematics.tree import TreeArm, TreeChain, tip_of

__all__ = [
    "FLANGE",
    "TRACKER",
    "OpenModel",
    "Origin",
    "RobotModel",
    "SerialModel",
    "TreeModel",
    "add_targets",
    "add_tracker",
    "allow_massless",
    "at_pose",
    "at_zero",
    "body_pose",
    "compiled",
    "coordinates",
    "flange_body",
    "joint_axes",
    "joint_of",
    "last_frame",
    "move_to",
    "named_tool",
    "site_pose",
    "station_suffixed",
    "update_constants",
    "world_axes",
]

FLANGE, TRACKER = "flange", "tracker"
_DEFAULT_TRACKER = (1.6, -1.3, 1.1)  # head of a tracker (m) near a small arm


@dataclass(frozen=True)
class Origin:
    """The files of a robot.

    Attributes:
        source: the name or path that it was loaded by; "" for a robot made in memory.
        sha256: of its files.
        cell: its cell; None without one.
        load: loads the model of an origin again.
    """

    source: str = ""
    sha256: str = ""
    cell: Cell | None = None
    load: "Callable[[Origin], RobotModel] | None" = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RobotModel(Value, ABC):
    """A robot's nominal model in MuJoCo.

    It is pickled and copied by its origin, and loaded from there again: MuJoCo's descriptions cannot be pickled.

    Attributes:
        origin: the files that it was loaded from.
        spec: source of the compiled model; copy it before editing.
        model: nominal, with a site for each target of ``tool`` and one for the tracker's head.
        chain: the measured joints.
        T_world_frame0: pose ``(4, 4)`` (m) of the base's frame, a table's frame 0, in the world of the MuJoCo model.
        base_body: the parent of the first moving body, "" if that is the world.
        tool: targets' positions (m) in a table's last frame, or the platform's.
        shapes_assumed: whether the links' shapes are rods (``build_serial``).
        masses_assumed: whether the masses of some links are those of rods.
        acceptance_rad: largest angle off its axis that the reflector takes, from the cell; None for the instrument's.
        overlapping: pairs of bodies that touch by construction: their contacts are not checked.
        fixed_joints: joints of a gripper, which are fixed at zero.
        stations: names of the instrument's stations, the first of which is the site ``tracker``; none for a single
            one without a name.
        obstacles: the cell's obstacles, in its order, each with its clearance (m); None where the cell states none.
        plates: the cell's plates on the flange.
        travel_is_bounded: whether ``travel_per_joint`` bounds the motion of every point.
        missing: message on parts of the file that could not be read, which a virtual arm needs; "" if none.
    """

    travel_is_bounded: ClassVar[bool] = True

    path: Path
    spec: mujoco.MjSpec = field(compare=False)
    model: mujoco.MjModel
    chain: JointSpec
    T_world_frame0: Array
    base_body: str
    tool: dict[str, Array]
    shapes_assumed: bool = False
    masses_assumed: bool = False
    missing: str = ""
    overlapping: tuple[tuple[str, str], ...] = ()
    fixed_joints: tuple[str, ...] = ()
    acceptance_rad: float | None = None
    stations: tuple[str, ...] = ()
    obstacles: Mapping[str, float | None] = field(default_factory=dict)
    plates: tuple[str, ...] = ()
    origin: Origin = Origin()

    def _about(self) -> str:
        return self.chain.name

    def __reduce__(self) -> tuple[Callable[..., "RobotModel"], tuple[Any, ...]]:
        if self.origin.load is None:
            raise TypeError(f"robot {self.chain.name} was made in memory; save it as a file and load that to pickle it")
        return self.origin.load, (self.origin,)

    @property
    def assumed(self) -> str:
        """Description of the parts of the arm that the lab assumed; "" if none."""
        messages = ["its links are drawn as rods"] if self.shapes_assumed else []
        return " and ".join([*messages, "weigh what rods would"] if self.masses_assumed else messages)

    @abstractmethod
    def qpos(self, joints: Array) -> Array:
        """Return MuJoCo's coordinates ``(n, nq)`` at joint positions ``(n, joints)``; NaN if impossible."""

    @abstractmethod
    def travel_per_joint(self) -> Array:
        """Return the largest motion ``(joints,)`` (m) of a point of the arm per rad or m of each joint, in any pose.

        It is a bound only if ``travel_is_bounded``.
        """

    @abstractmethod
    def with_parameters(self, targets: tuple[str, ...], values: Array, joints: Array) -> tuple[mujoco.MjModel, Array]:
        """Return a copy with the parameters ``(p,)`` of the arm with these targets, and its coordinates ``(n, nq)``.

        Its base has this model's pose; the coordinates are those at joint positions ``(n, joints)``.
        """

    def values_before(self, arm: RigidArm, T_world_tracker: Array) -> Array:
        """Return nominal parameters ``(p,)`` of the arm in the frame of a tracker at this pose ``(4, 4)``."""
        values = arm.nominal(self.tool)
        T_tracker_frame0 = se3.inverse(T_world_tracker) @ self.T_world_frame0
        values[:3], values[3:6] = T_tracker_frame0[:3, 3], se3.log(T_tracker_frame0[:3, :3])
        return values

    @property
    def T_world_tracker(self) -> Array:
        """Nominal pose ``(4, 4)`` (m) of the tracker's frame in the world of the MuJoCo model."""
        return site_pose(self.model, at_zero(self.model), TRACKER)

    @property
    def station_sites(self) -> tuple[str, ...]:
        """The sites at the instrument's head, one for each station."""
        return (TRACKER, *(station_suffixed(TRACKER, name) for name in self.stations[1:]))

    @property
    def Ts_world_station(self) -> Array:
        """Nominal poses ``(s, 4, 4)`` (m) of the instrument's frame at each of its stations, in the model's world."""
        data = at_zero(self.model)
        return np.stack([site_pose(self.model, data, site) for site in self.station_sites])

    def place_tracker(self, model: mujoco.MjModel, T_world_tracker: Array, station: int = 0) -> None:
        """Move the body of a station's site in a copy of the model, so that the site has this pose."""
        site = self.station_sites[station]
        body, nominal = int(model.site(site).bodyid[0]), at_zero(self.model)
        if not body:
            return
        T_body_site = se3.inverse(body_pose(nominal, body)) @ site_pose(self.model, nominal, site)
        T = T_world_tracker @ se3.inverse(T_body_site)
        model.body_pos[body], model.body_quat[body] = T[:3, 3], se3.quaternion_from_rotation(T[:3, :3])


def coordinates(model: mujoco.MjModel, joint_names: Sequence[str], joints: Array) -> Array:
    """Return a model's coordinates ``(n, nq)`` with these joints at values ``(n, joints)``, all others at zero."""
    qpos = np.zeros((len(joints), model.nq))
    qpos[:, [int(model.joint(name).qposadr[0]) for name in joint_names]] = joints
    return qpos


def flange_body(model: mujoco.MjModel, bodies: Sequence[str]) -> str:
    """Return the body that carries the flange's site, else the last of the jointed ones."""
    for site in range(model.nsite):
        if model.site(site).name == FLANGE:
            return str(model.body(int(model.site_bodyid[site])).name)
    return bodies[-1]


def station_suffixed(name: str, station: str) -> str:
    """Return the name of a body or site of the instrument's stand at a station that is not the first."""
    return f"{name} {station}"


def add_targets(body: mujoco.MjsBody, T_body_last: Array, tool: Mapping[str, Array]) -> None:
    """Give a body a site for each target (m, in the last frame), which faces along that frame's z."""
    for name, place in tool.items():
        body.add_site(name=name, **at_pose(T_body_last @ se3.pose(np.eye(3), place)))


def at_pose(T: Array) -> dict[str, Array]:
    """Return a pose ``(4, 4)`` (m) as MuJoCo's ``pos`` and ``quat``."""
    return {"pos": T[:3, 3], "quat": se3.quaternion_from_rotation(T[:3, :3])}


def move_to(element: mujoco.MjsBody | mujoco.MjsSite, T: Array) -> None:
    """Give a body or a site of a spec this pose ``(4, 4)`` (m) in its parent."""
    placed = at_pose(T)
    element.pos, element.quat = placed["pos"], placed["quat"]


def named_tool(tool: Mapping[str, Array]) -> dict[str, Array]:
    """Return the targets (m) of a description; those of the default tool if it names none."""
    named = {name: place for name, place in tool.items() if name not in (FLANGE, TRACKER)}
    return named or {name: np.array(place) for name, place in DEFAULT_TOOL.items()}


def add_tracker(spec: mujoco.MjSpec, away: float = 1.0) -> None:
    """Add the head of a tracker, ``away`` times as far as from a small arm."""
    taken = {body.name for body in spec.bodies}
    name = next(name for n in itertools.count(1) if (name := TRACKER if n == 1 else f"{TRACKER}{n}") not in taken)
    x, y, z = _DEFAULT_TRACKER
    spec.worldbody.add_body(name=name, pos=(away * x, away * y, z)).add_site(name=TRACKER)


def at_zero(model: mujoco.MjModel) -> mujoco.MjData:
    """Compute the model's kinematics with every joint at zero."""
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    return data


def body_pose(data: mujoco.MjData, body: int) -> Array:
    """Return world pose ``(4, 4)`` of a body."""
    return se3.pose(data.xmat[body].reshape(3, 3), data.xpos[body])


def site_pose(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> Array:
    """Return world pose ``(4, 4)`` of a site."""
    site = model.site(name).id
    return se3.pose(data.site_xmat[site].reshape(3, 3), data.site_xpos[site])


def joint_axes(
    model: mujoco.MjModel, data: mujoco.MjData, joint_names: Sequence[str], targets: Sequence[str]
) -> JointAxes:
    """Return the joints' axes and the targets' sites in the world, at the pose that ``data`` holds."""
    joints = [model.joint(name).id for name in joint_names]
    sites = [model.site(name).id for name in targets]
    return JointAxes(data.xanchor[joints].copy(), data.xaxis[joints].copy(), data.site_xpos[sites].copy())


def compiled(path: Path, spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a spec; a LabError with the file's name if it cannot be built."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # MuJoCo's concern the dynamics, which the lab does not integrate
            return spec.compile()
    except ValueError as error:
        raise LabError(f"{path}: MuJoCo cannot build it, mend this: {' '.join(str(error).split())}") from error


def _warned(message: str) -> None:
    """Warn of what MuJoCo reports while it computes, without its counts, so that each warning comes once."""
    text = " ".join(message.partition("(")[0].split())
    warnings.warn(f"MuJoCo: {text}", LabWarning, stacklevel=2)


mujoco.set_mju_user_warning(_warned)  # else it prints them, and writes MUJOCO_LOG.TXT into the working folder


def update_constants(model: mujoco.MjModel) -> None:
    """Compute again what MuJoCo derives from a model whose bodies were moved in place.

    Its warnings are dropped: they concern the dynamics, which the lab does not integrate.
    """
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        mujoco.mj_setConst(model, mujoco.MjData(model))
    finally:
        mujoco.set_mju_user_warning(before)


def allow_massless(spec: mujoco.MjSpec) -> None:
    """Let a spec compile whose moving bodies have no mass."""
    spec.compiler.boundmass = max(spec.compiler.boundmass, 1e-9)
    spec.compiler.boundinertia = max(spec.compiler.boundinertia, 1e-12)


def joint_of(model: mujoco.MjModel, body: str) -> "mujoco._structs._MjModelJointViews":
    """Return the first joint of a body."""
    return model.joint(int(model.body(body).jntadr[0]))


@dataclass(frozen=True)
class _Tip:
    """An end of a robot, with its targets.

    Attributes:
        carrier: the body that carries its last frame.
        T_world_last: pose ``(4, 4)`` (m) of its last frame, joint positions zero.
        T_world_nominal: the same of the nominal model.
        targets: ``(3,)`` m in the last frame.
    """

    carrier: str
    T_world_last: Array
    T_world_nominal: Array
    targets: Mapping[str, Array]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class OpenModel(RobotModel):
    """A robot without loops: one chain, or several.

    Attributes:
        bodies: the jointed bodies, in the order of the joints.
    """

    bodies: tuple[str, ...]

    @property
    @abstractmethod
    def carriers(self) -> tuple[str, ...]:
        """The bodies that carry the last frames."""

    @abstractmethod
    def carrier_of(self, target: str) -> str:
        """Return the body that carries a target."""

    @abstractmethod
    def _arm(self, targets: tuple[str, ...]) -> RigidArm:
        """Return the arm with these targets."""

    def with_parameters(self, targets: tuple[str, ...], values: Array, joints: Array) -> tuple[mujoco.MjModel, Array]:
        """Return a copy with its bodies moved onto the joint axes of the parameters, and its coordinates."""
        model = copy.deepcopy(self.model)
        self.place_bodies(model, self._arm(targets), values)
        return model, self.qpos(joints)

    @abstractmethod
    def _axes(self, arm: RigidArm, values: Array) -> Mapping[str, tuple[Array, Array | None]]:
        """Return direction and point ``(3,)`` (m; None of a slide) of each body's joint axis, in the world."""

    @abstractmethod
    def _tips(self, arm: RigidArm, values: Array) -> list[_Tip]:
        """Return the robot's ends."""

    def qpos(self, joints: Array) -> Array:
        """Return MuJoCo's coordinates ``(n, nq)``: joint positions, and zero for all others."""
        return coordinates(self.model, self.chain.joint_names, joints)

    def travel_per_joint(self) -> Array:
        """Bound the travel by balls about each body's origin that contain it and all that it carries."""
        model = self.model
        touching = (model.geom_contype | model.geom_conaffinity) != 0
        joints = [model.joint(name) for name in self.chain.joint_names]
        travel = np.zeros(model.nbody)
        for joint, slides in zip(joints, self.chain.prismatic, strict=True):
            far = np.abs(joint.range).max() if slides else 2 * np.linalg.norm(joint.pos)
            travel[joint.bodyid[0]] = far
        ball = np.zeros(model.nbody)
        for geom in np.flatnonzero(touching):
            body = model.geom_bodyid[geom]
            ball[body] = max(ball[body], np.linalg.norm(model.geom_pos[geom]) + model.geom_rbound[geom])
        for body in range(model.nbody - 1, 0, -1):  # MuJoCo numbers parents before children
            parent = model.body_parentid[body]
            ball[parent] = max(ball[parent], np.linalg.norm(model.body_pos[body]) + travel[body] + ball[body])
        moved = [ball[joint.bodyid[0]] + np.linalg.norm(joint.pos) for joint in joints]
        return np.where(self.chain.prismatic, 1.0, moved)

    def place_bodies(self, model: mujoco.MjModel, arm: RigidArm, values: Array) -> None:
        """Move the bodies and target sites of a copy of the model so that it has the arm's axes and targets.

        Each jointed body turns by the smallest rotation that aligns its axis and shifts across it;
        a body without a joint keeps its pose on its parent. The base in ``values`` is not used:
        frame 0 is the model's.
        """
        moved = self.moved_bodies(arm, values)
        for name in dict.fromkeys([*self.bodies, *self.carriers]):
            body = model.body(name).id
            local = se3.inverse(moved[int(model.body_parentid[body])]) @ moved[body]
            model.body_pos[body], model.body_quat[body] = local[:3, 3], se3.quaternion_from_rotation(local[:3, :3])
        sites = {model.site(i).name: i for i in range(model.nsite)}
        for tip in self._tips(arm, _without_base(values)):
            for target, point in tip.targets.items():
                if target not in sites:  # a measured target without a site
                    continue
                site = sites[target]
                T_body_last = se3.inverse(moved[int(model.site_bodyid[site])]) @ tip.T_world_last
                model.site_pos[site] = se3.transform(T_body_last, point[None])[0]

    def moved_bodies(self, arm: RigidArm, values: Array) -> list[Array]:
        """Return the world poses ``(4, 4)`` (m) of all bodies that ``place_bodies`` sets, joint positions zero."""
        still, data = _without_base(values), at_zero(self.model)
        moved = self._moved_poses(arm, still, data)
        for tip in self._tips(arm, still):
            if tip.carrier not in self.bodies:
                body = self.model.body(tip.carrier).id
                moved[body] = tip.T_world_last @ se3.inverse(tip.T_world_nominal) @ body_pose(data, body)
        return moved

    def _moved_poses(self, arm: RigidArm, values: Array, data: mujoco.MjData) -> list[Array]:
        """Return world poses of all bodies, at joint positions zero, with the arm's axes."""
        model = self.model
        poses: list[Array] = [np.eye(4)]
        axes = self._axes(arm, values)
        for body in range(1, model.nbody):
            nominal = body_pose(data, body)
            parent = int(model.body_parentid[body])
            name = model.body(body).name
            if name not in axes:
                poses.append(poses[parent] @ se3.inverse(body_pose(data, parent)) @ nominal)
                continue
            axis, origin = axes[name]
            joint = int(model.body(body).jntadr[0])
            turn = se3.rotation_between(data.xaxis[joint], axis)
            anchor = data.xanchor[joint]
            moved_anchor = anchor
            if origin is not None:
                moved_anchor = origin + axis * np.dot(anchor - origin, axis)
            poses.append(se3.pose(turn @ nominal[:3, :3], moved_anchor + turn @ (nominal[:3, 3] - anchor)))
        return poses


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SerialModel(OpenModel):
    """A serial arm.

    Attributes:
        chain: its distal Denavit-Hartenberg table.
        bodies: the jointed bodies, base outward.
        links: sections of elastic links from its description; None without any.
        named_carrier: the body that carries the flange, where a tip was named; "" for the usual one.
    """

    chain: Chain
    links: LinkSections | None = None
    named_carrier: str = ""

    @property
    def carrier(self) -> str:
        """The body of the named tip, else that of the flange's site, else the last jointed one."""
        return self.named_carrier or flange_body(self.model, self.bodies)

    @property
    def carriers(self) -> tuple[str, ...]:
        """The body that carries the last frame."""
        return (self.carrier,)

    def carrier_of(self, target: str) -> str:
        """Return the body that carries the last frame."""
        return self.carrier

    def _arm(self, targets: tuple[str, ...]) -> SerialArm:
        return SerialArm(self.chain, targets)

    def _axes(self, arm: RigidArm, values: Array) -> Mapping[str, tuple[Array, Array | None]]:
        assert isinstance(arm, SerialArm)
        return world_axes(arm, values, self.T_world_frame0, self.bodies)

    def _tips(self, arm: RigidArm, values: Array) -> list[_Tip]:
        assert isinstance(arm, SerialArm)
        T_world_last = self.T_world_frame0 @ arm.flange(np.zeros((1, arm.chain.size)), values)[0]
        targets = dict(zip(arm.targets, arm.split(values)[2], strict=True))
        return [_Tip(self.carrier, T_world_last, last_frame(self.chain, self.T_world_frame0), targets)]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TreeModel(OpenModel):
    """A robot with several tips.

    Attributes:
        tip_carriers: the bodies that carry the last frames, by tip.
    """

    chain: TreeChain
    tip_carriers: tuple[str, ...]

    @property
    def carriers(self) -> tuple[str, ...]:
        """The bodies that carry the last frames, by tip."""
        return self.tip_carriers

    def carrier_of(self, target: str) -> str:
        """Return the body that carries the target's tip."""
        return self.tip_carriers[self.chain.tips.index(tip_of(target))]

    @property
    def last_frames(self) -> list[Array]:
        """Poses ``(4, 4)`` of the tips' last frames in the world, joint positions zero."""
        arm = TreeArm(self.chain, (f"{self.chain.tips[0]}.p1",))
        return [tip.T_world_last for tip in self._tips(arm, arm.nominal())]

    def _arm(self, targets: tuple[str, ...]) -> TreeArm:
        return TreeArm(self.chain, targets)

    def _axes(self, arm: RigidArm, values: Array) -> Mapping[str, tuple[Array, Array | None]]:
        assert isinstance(arm, TreeArm)
        axes: dict[str, tuple[Array, Array | None]] = {}
        for branch in arm.tips:
            bodies = [self.bodies[joint] for joint in branch.joints]
            axes |= world_axes(branch.arm, arm.serial_values(branch, values), self.T_world_frame0, bodies)
        return axes

    def _tips(self, arm: RigidArm, values: Array) -> list[_Tip]:
        assert isinstance(arm, TreeArm)
        nominal, tips = arm.nominal(), list[_Tip]()
        points = dict(zip(arm.targets, values[len(values) - 3 * len(arm.targets) :].reshape(-1, 3), strict=True))
        for tip, branch, carrier in zip(self.chain.tips, arm.tips, self.tip_carriers, strict=True):
            still = np.zeros((1, branch.arm.chain.size))
            now, before = (
                self.T_world_frame0 @ branch.arm.flange(still, arm.serial_values(branch, each))[0]
                for each in (values, nominal)
            )
            own = {target: point for target, point in points.items() if tip_of(target) == tip}
            tips.append(_Tip(carrier, now, before, own))
        return tips


def world_axes(
    arm: SerialArm, values: Array, T_world: Array, bodies: Sequence[str]
) -> dict[str, tuple[Array, Array | None]]:
    """Return direction and point ``(3,)`` (m; None of a slide) of each body's joint axis, joint positions zero.

    Args:
        T_world: pose ``(4, 4)`` of the frame of ``values`` in the world.
        bodies: of the joints.
    """
    axes: dict[str, tuple[Array, Array | None]] = {}
    for motion in arm.motions(values):
        if motion.joint is None:
            continue
        axis = T_world[:3, :3] @ motion.axis[:3, 0] * arm.chain.sign[motion.joint]
        origin = None if motion.origin is None else se3.transform(T_world, motion.origin[:3].T)[0]
        axes[bodies[motion.joint]] = axis, origin
    return axes


def _without_base(values: Array) -> Array:
    """Return parameters with the base at the origin: frame 0 is the model's."""
    still = values.copy()
    still[:6] = 0.0
    return still


def last_frame(chain: Chain, T_world_frame0: Array) -> Array:
    """Return pose ``(4, 4)`` of the table's last frame in the world, joint positions zero."""
    arm = SerialArm(chain)
    pose: Array = T_world_frame0 @ arm.flange(np.zeros((1, chain.size)), arm.nominal())[0]
    return pose
