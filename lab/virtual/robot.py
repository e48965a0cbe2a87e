"""A robot's MuJoCo model (MJCF or URDF) and the chain that it draws."""

import itertools
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from lab import frames
from lab.errors import LabError
from lab.frames import Array
from lab.geometry.axes import JointAxes, chain_from_axes
from lab.geometry.chain import Chain
from lab.geometry.serial import DEFAULT_TOOL, SerialArm
from lab.virtual.limits import joint_limits

FLANGE, TRACKER = "flange", "tracker"
_DEFAULT_TRACKER = (1.6, -1.3, 1.1)  # head of a tracker (m) where the model places none


@dataclass(frozen=True)
class RobotModel:
    """The drawing as MuJoCo has it.

    Attributes:
        spec: what the model was compiled from; copy it before editing.
        model: nominal, with a site for each target of ``tool`` and one for the tracker's head.
        chain: the distal Denavit-Hartenberg table of the arm.
        T_world_frame0: pose ``(4, 4)`` of the table's frame 0.
        bodies: the jointed bodies, base outward.
        base_body: what carries them, "" where that is the world.
        tool: targets' positions (m) in the table's last frame.
        warnings: what of the file was left out.
    """

    path: Path
    spec: mujoco.MjSpec
    model: mujoco.MjModel
    chain: Chain
    T_world_frame0: Array
    bodies: tuple[str, ...]
    base_body: str
    tool: dict[str, Array]
    warnings: tuple[str, ...] = ()

    @property
    def carrier(self) -> str:
        """The body that carries the flange's site, else the last jointed one."""
        for site in range(self.model.nsite):
            if self.model.site(site).name == FLANGE:
                return str(self.model.body(int(self.model.site_bodyid[site])).name)
        return self.bodies[-1]

    def values_before(self, arm: SerialArm, T_world_tracker: Array) -> Array:
        """Nominal parameters ``(p,)`` of the arm as a tracker at this pose ``(4, 4)`` sees it."""
        values = arm.nominal(self.tool)
        T_tracker_frame0 = frames.inverse(T_world_tracker) @ self.T_world_frame0
        values[:3], values[3:6] = T_tracker_frame0[:3, 3], frames.log(T_tracker_frame0[:3, :3])
        return values

    @property
    def T_world_tracker(self) -> Array:
        """Nominal pose of the tracker's frame."""
        return site_pose(self.model, at_zero(self.model), TRACKER)


def load_model(path: Path) -> RobotModel:
    """Load an MJCF or a URDF with exactly one serial chain of hinges and slides.

    Sites on the last body or beyond it are its targets, except one named ``flange``, which
    places the last frame. It gets those of the default tool that it lacks; one without a site
    ``tracker`` gets a tracker beside it. Meshes that cannot be read are left out, with a warning.

    Raises:
        LabError: the file is malformed, or has no chain, several, or one that is not serial.
    """
    spec, model, left_out = _built(path)
    bodies = _serial_bodies(path, model)
    data = at_zero(model)
    flange = _flange_pose(model, data, bodies)
    base_body = _base_body(model, bodies)
    base = body_pose(data, model.body(base_body).id) if base_body else np.eye(4)
    chain, T_world_frame0 = chain_from_axes(
        path.resolve().parent.name if path.stem in ("robot", "scene") else path.stem,
        tuple(joint_name(model, body) for body in bodies),
        tuple(bool(_joint(model, body).type[0] == mujoco.mjtJoint.mjJNT_SLIDE) for body in bodies),
        _nominal_axes(model, data, bodies),
        base,
        flange,
        joint_limits(path, model, [joint_name(model, body) for body in bodies]),
    )
    tool = _add_sites(spec, model, data, bodies, last_frame(chain, T_world_frame0))
    return RobotModel(path, spec, _compile(path, spec), chain, T_world_frame0, bodies, base_body, tool, left_out)


def last_frame(chain: Chain, T_world_frame0: Array) -> Array:
    """Pose ``(4, 4)`` of the table's last frame in the world, readings zero."""
    arm = SerialArm(chain)
    pose: Array = T_world_frame0 @ arm.flange(np.zeros((1, chain.size)), arm.nominal())[0]
    return pose


def at_zero(model: mujoco.MjModel) -> mujoco.MjData:
    """The model's kinematics with every joint at zero."""
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    return data


def body_pose(data: mujoco.MjData, body: int) -> Array:
    """World pose ``(4, 4)`` of a body."""
    return frames.pose(data.xmat[body].reshape(3, 3), data.xpos[body])


def site_pose(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> Array:
    """World pose ``(4, 4)`` of a site."""
    site = model.site(name).id
    return frames.pose(data.site_xmat[site].reshape(3, 3), data.site_xpos[site])


def joint_name(model: mujoco.MjModel, body: str) -> str:
    """The name of a body's joint."""
    return str(_joint(model, body).name)


def joint_axes(
    model: mujoco.MjModel, data: mujoco.MjData, joint_names: Sequence[str], targets: Sequence[str]
) -> JointAxes:
    """The joints' axes and the targets' sites in the world, at the pose that ``data`` holds."""
    joints = [model.joint(name).id for name in joint_names]
    sites = [model.site(name).id for name in targets]
    return JointAxes(data.xanchor[joints].copy(), data.xaxis[joints].copy(), data.site_xpos[sites].copy())


def _built(path: Path) -> tuple[mujoco.MjSpec, mujoco.MjModel, tuple[str, ...]]:
    """The file as a spec and a model; where its meshes cannot be read, without them, and a warning."""
    spec = _read(path)
    try:
        return spec, _compile(path, spec), ()
    except LabError as error:
        bare = _read(path)
        if not bare.meshes:
            raise
        _delete_meshes(bare)
        try:
            model = _compile(path, bare)
        except LabError:
            raise error from None
        return bare, model, (f"{error}; meshes are left out, so collisions with them are not seen",)


def _delete_meshes(spec: mujoco.MjSpec) -> None:
    """Leave the kinematics; a body whose mass came from a mesh gets next to none."""
    for geom in [geom for geom in spec.geoms if geom.type == mujoco.mjtGeom.mjGEOM_MESH]:
        spec.delete(geom)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    spec.compiler.boundmass = max(spec.compiler.boundmass, 1e-9)
    spec.compiler.boundinertia = max(spec.compiler.boundinertia, 1e-12)


def _read(path: Path) -> mujoco.MjSpec:
    """The file with a name for every body that has no joint, and without sites that have no name."""
    if not path.is_file():
        raise LabError(f"{path}: no such file; give a robot's MJCF, URDF or TOML table")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise LabError(f"{path}: not a readable MJCF or URDF, mend it there: {_one_line(error)}") from error
    for site in [site for site in spec.sites if not site.name]:
        spec.delete(site)
    names = {body.name for body in spec.bodies}
    for i, body in enumerate(spec.bodies):
        if not body.name and not body.joints:
            body.name = next(name for n in itertools.count(i) if (name := f"body{n}") not in names)
            names.add(body.name)
    return spec


def _compile(path: Path, spec: mujoco.MjSpec) -> mujoco.MjModel:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # MuJoCo's are about the dynamics, which nothing here integrates
            return spec.compile()
    except ValueError as error:
        raise LabError(f"{path}: MuJoCo cannot build it, mend this: {_one_line(error)}") from error


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _joint(model: mujoco.MjModel, body: str) -> "mujoco._structs._MjModelJointViews":
    return model.joint(int(model.body(body).jntadr[0]))


def _serial_bodies(path: Path, model: mujoco.MjModel) -> tuple[str, ...]:
    """The jointed bodies of the one chain, base outward."""
    jointed = [b for b in range(1, model.nbody) if model.body_jntnum[b] > 0]
    if not jointed:
        raise LabError(f"{path}: no joints, so no chain; give a model with hinge or slide joints")
    for b in jointed:
        names = [model.joint(int(model.body_jntadr[b]) + i).name or "(unnamed)" for i in range(model.body_jntnum[b])]
        kinds = {int(model.jnt_type[int(model.body_jntadr[b]) + i]) for i in range(model.body_jntnum[b])}
        if kinds - {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}:
            raise LabError(f"{path}: joint {names[0]} is a ball or free joint; a chain has hinges and slides only")
        if len(names) > 1:
            raise LabError(f"{path}: body {model.body(b).name} has joints {', '.join(names)}; give each its own body")
        if not model.body(b).name or not names[0].strip("()") or names[0] == "(unnamed)":
            raise LabError(f"{path}: a jointed body or its joint has no name (body {b}); name both")
    if model.neq:
        raise LabError(f"{path}: it has {model.neq} equality constraints (loops or mimic joints); remove them")
    chains = []
    for tip in jointed:
        path_up = _ancestors(model, tip)
        if not any(tip in _ancestors(model, b)[1:] for b in jointed):
            chains.append([b for b in reversed(path_up) if b in jointed])
    if len(chains) > 1:
        listed = "; ".join(", ".join(joint_name(model, model.body(b).name) for b in chain) for chain in chains)
        raise LabError(f"{path}: {len(chains)} candidate chains ({listed}); keep one")
    return tuple(model.body(b).name for b in chains[0])


def _ancestors(model: mujoco.MjModel, body: int) -> list[int]:
    """The body, its parent, and so on up to but without the world."""
    line = []
    while body != 0:
        line.append(body)
        body = int(model.body_parentid[body])
    return line


def _base_body(model: mujoco.MjModel, bodies: tuple[str, ...]) -> str:
    parent = int(model.body(bodies[0]).parentid[0])
    return str(model.body(parent).name) if parent else ""


def _beyond(model: mujoco.MjModel, body: str) -> list[int]:
    """The body and all those it carries."""
    first = model.body(body).id
    return [b for b in range(model.nbody) if first in _ancestors(model, b)]


def _flange_pose(model: mujoco.MjModel, data: mujoco.MjData, bodies: tuple[str, ...]) -> Array:
    for site in range(model.nsite):
        if model.site(site).name == FLANGE and int(model.site_bodyid[site]) in _beyond(model, bodies[-1]):
            return site_pose(model, data, FLANGE)
    return body_pose(data, model.body(bodies[-1]).id)


def _nominal_axes(model: mujoco.MjModel, data: mujoco.MjData, bodies: tuple[str, ...]) -> JointAxes:
    return joint_axes(model, data, [joint_name(model, body) for body in bodies], ())


def _add_sites(
    spec: mujoco.MjSpec, model: mujoco.MjModel, data: mujoco.MjData, bodies: tuple[str, ...], T_world_last: Array
) -> dict[str, Array]:
    """Give the spec a site for every target and the tracker; return the targets in the last frame."""
    existing = {model.site(site).name: site for site in range(model.nsite)}
    if TRACKER not in existing:
        taken = {body.name for body in spec.bodies}
        name = next(name for n in itertools.count(1) if (name := TRACKER if n == 1 else f"{TRACKER}{n}") not in taken)
        tracker = spec.worldbody.add_body(name=name, pos=_DEFAULT_TRACKER)
        tracker.add_site(name=TRACKER)
    beyond = _beyond(model, bodies[-1])
    tool = {
        name: frames.transform(frames.inverse(T_world_last), data.site_xpos[site : site + 1])[0]
        for name, site in existing.items()
        if name and name not in (FLANGE, TRACKER) and int(model.site_bodyid[site]) in beyond
    }
    carrier = int(model.site_bodyid[existing[FLANGE]]) if FLANGE in existing else model.body(bodies[-1]).id
    T_carrier_last = frames.inverse(body_pose(data, carrier)) @ T_world_last
    for name, place in DEFAULT_TOOL.items():
        if name not in tool and name not in existing:
            tool[name] = np.array(place)
            local = frames.transform(T_carrier_last, tool[name][None])[0]
            quat = frames.quaternion_from_rotation(T_carrier_last[:3, :3])  # a reflector faces along the last frame's z
            spec.body(model.body(carrier).name).add_site(name=name, pos=local, quat=quat)
    return tool
