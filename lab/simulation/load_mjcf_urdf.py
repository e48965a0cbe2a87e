"""A robot's MuJoCo model from an MJCF or a URDF."""

import itertools
from pathlib import Path

import mujoco
import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.formats.urdf_source import UrdfSource, is_urdf, read_urdf
from lab.kinematics.joints import JointSpec
from lab.kinematics.serial.arm import DEFAULT_TOOL
from lab.kinematics.serial.axes_to_dh import chain_from_axes
from lab.simulation.collisions import at_contacts
from lab.simulation.joint_limits import joint_limits
from lab.simulation.link_shapes import dress
from lab.simulation.model import (
    FLANGE,
    TRACKER,
    add_targets,
    add_tracker,
    at_zero,
    body_pose,
    compiled,
    coordinates,
    flange_body,
    joint_axes,
    joint_name,
    joint_of,
    let_weigh_nothing,
    one_line,
    site_pose,
)
from lab.simulation.model_file_gate import refuse_unbounded_model
from lab.simulation.serial_model import SerialModel, last_frame

__all__ = ["load_model"]

_POSES = 200  # at which is looked what overlaps by construction


def load_model(path: Path) -> SerialModel:
    """Load an MJCF or a URDF with exactly one serial chain of hinges and slides.

    Sites on the last body or beyond it are its targets, except one named ``flange``, which
    places the last frame (of a URDF a link ``tool0`` or ``flange``). It gets those of the default tool that it
    lacks; one without a site ``tracker`` gets a tracker beside it, and one without shapes gets rods for links.
    Meshes that cannot be read are left out, and told.

    Raises:
        LabError: the file is malformed, or has no chain, several, or one that is not serial.
    """
    if not path.is_file():
        raise LabError(f"{path}: no such file; give a robot's MJCF, URDF or TOML table")
    refuse_unbounded_model(path)
    urdf = read_urdf(path) if is_urdf(path) else None
    spec, model, missing = _built(path, urdf)
    bodies = _serial_bodies(path, model)
    data = at_zero(model)
    flange = _flange_pose(model, data, bodies)
    base_body = _base_body(model, bodies)
    base = body_pose(data, model.body(base_body).id) if base_body else np.eye(4)
    chain, T_world_frame0 = chain_from_axes(
        path.resolve().parent.name if path.stem in ("robot", "scene") else path.stem,
        tuple(joint_name(model, body) for body in bodies),
        tuple(bool(joint_of(model, body).type[0] == mujoco.mjtJoint.mjJNT_SLIDE) for body in bodies),
        joint_axes(model, data, [joint_name(model, body) for body in bodies], ()),
        base,
        flange,
        joint_limits(path, model, [joint_name(model, body) for body in bodies]),
    )
    T_world_last = last_frame(chain, T_world_frame0)
    tool = _own_targets(model, data, bodies, T_world_last)
    sites = {model.site(site).name for site in range(model.nsite)}
    spare = {name: np.array(place) for name, place in DEFAULT_TOOL.items() if name not in sites}
    carrier = model.body(flange_body(model, bodies))
    add_targets(spec.body(carrier.name), se3.inverse(body_pose(data, carrier.id)) @ T_world_last, spare)
    if TRACKER not in sites:
        add_tracker(spec)
    solid = model.geom_bodyid[(model.geom_contype | model.geom_conaffinity) != 0]
    shapeless = not missing and not np.isin(solid, _beyond(model, bodies[0])).any()
    weighed = shapeless and dress(path, spec, chain, T_world_frame0, bodies, tool | spare)
    model = compiled(path, spec)
    overlapping = _exclude_overlaps(spec, model, chain, (base_body, bodies[0]))
    model = compiled(path, spec) if overlapping else model
    return SerialModel(
        path=path, spec=spec, model=model, chain=chain, T_world_frame0=T_world_frame0, bodies=bodies,
        base_body=base_body, tool=tool | spare, shapes_assumed=shapeless, masses_assumed=weighed, missing=missing,
        overlapping=overlapping, held=() if urdf is None else urdf.held,
    )  # fmt: skip


def _exclude_overlaps(
    spec: mujoco.MjSpec, model: mujoco.MjModel, chain: JointSpec, base: tuple[str, str]
) -> tuple[tuple[str, str], ...]:
    """Exclude the contact of bodies that touch in all of many random poses; their names.

    Of the base and the first link, too, where they touch in some: MuJoCo looks at the contact of no other neighbours.
    Not of the tracker's body, where it is one of its own: what stands in the arm's way is a fault of the scene.
    """
    stand = str(model.body(model.site(TRACKER).bodyid[0]).name)
    always, sometimes = set[tuple[str, str]](), set[tuple[str, str]]()
    joints = chain.random_joints(_POSES, rng_for(0, "structure"))
    for i, data in enumerate(at_contacts(model, coordinates(model, chain.joint_names, joints))):
        pairs = {(int(min(pair)), int(max(pair))) for pair in model.geom_bodyid[data.contact.geom]}
        touching = {(str(model.body(a).name), str(model.body(b).name)) for a, b in pairs if a}  # a = 0: the world
        always, sometimes = touching if i == 0 else always & touching, sometimes | touching
    names = sorted(pair for pair in always | ({base} & sometimes) if stand in base or stand not in pair)
    for first, second in names:
        spec.add_exclude(bodyname1=first, bodyname2=second)
    return tuple(names)


def _built(path: Path, urdf: UrdfSource | None) -> tuple[mujoco.MjSpec, mujoco.MjModel, str]:
    """The file as a spec and a model; where its meshes cannot be read, without them, and why."""
    spec = _read(path, urdf)
    try:
        if urdf is not None and urdf.missing:
            raise LabError(urdf.missing)
        return spec, compiled(path, spec), ""
    except LabError as error:
        bare = _read(path, urdf)
        if not bare.meshes:
            raise
        _delete_meshes(bare)
        try:
            model = compiled(path, bare)
        except LabError:
            raise error from None
        return bare, model, f"{error}; meshes are left out"


def _delete_meshes(spec: mujoco.MjSpec) -> None:
    """Leave the kinematics; a body whose mass came from a mesh gets next to none."""
    for geom in [geom for geom in spec.geoms if geom.type == mujoco.mjtGeom.mjGEOM_MESH]:
        spec.delete(geom)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    let_weigh_nothing(spec)


def _read(path: Path, urdf: UrdfSource | None) -> mujoco.MjSpec:
    """The file with a name for every body that has no joint, and without sites that have no name."""
    try:
        spec = (
            mujoco.MjSpec.from_file(str(path))
            if urdf is None
            else mujoco.MjSpec.from_string(urdf.text, assets=urdf.assets)
        )
    except ValueError as error:
        raise LabError(f"{path}: not a readable MJCF or URDF, mend it there: {one_line(error)}") from error
    spec.compiler.fusestatic = False  # a fixed link says where the flange is
    if not spec.geoms:
        let_weigh_nothing(spec)  # until it gets rods
    for site in [site for site in spec.sites if not site.name]:
        spec.delete(site)
    names = {body.name for body in spec.bodies}
    for i, body in enumerate(spec.bodies):
        if not body.name and not body.joints:
            body.name = next(name for n in itertools.count(i) if (name := f"body{n}") not in names)
            names.add(body.name)
    return spec


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
        raise LabError(
            f"{path}: it has {model.neq} equality constraints (loops or mimic joints); remove "
            "them, or describe its loops in a mechanism's TOML"
        )
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
    """Of the site ``flange``, else of a body that robot descriptions call so, else of the last jointed one."""
    beyond = _beyond(model, bodies[-1])
    for site in range(model.nsite):
        if model.site(site).name == FLANGE and int(model.site_bodyid[site]) in beyond:
            return site_pose(model, data, FLANGE)
    named = {model.body(body).name: body for body in beyond}
    at = [named[name] for name in ("tool0", FLANGE) if name in named]  # tool0 has z along the last axis
    return body_pose(data, [*at, model.body(bodies[-1]).id][0])


def _own_targets(
    model: mujoco.MjModel, data: mujoco.MjData, bodies: tuple[str, ...], T_world_last: Array
) -> dict[str, Array]:
    """The sites on the last body or beyond it, in the last frame (m)."""
    beyond = _beyond(model, bodies[-1])
    T_last_world = se3.inverse(T_world_last)
    return {
        model.site(site).name: se3.transform(T_last_world, data.site_xpos[site : site + 1])[0]
        for site in range(model.nsite)
        if model.site(site).name not in (FLANGE, TRACKER) and int(model.site_bodyid[site]) in beyond
    }
