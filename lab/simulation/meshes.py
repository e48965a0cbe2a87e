"""Visual shells of a robot as triangles, and the poses of its bodies at each configuration.

Bodies for an arm of which only the axes are known: rods for links, as thick as the arm is large, and their masses.

A link runs along its own axis for d and along the common normal for a. A slide is a rod as long as its
stroke that reaches back from the link, or, where another slide rides on it, a carriage on a column. Two links
whose rods meet in most poses (around a wrist, say) cannot be judged by rods, so they may touch. So may what sits on a
slide's own line and the link that guides it: a quill is drawn back into the arm with the hand that turns about it.
"""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.formats.link_tree import link_tree
from lab.kinematics.model import RigidArm
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.chain import Chain
from lab.simulation.collisions import at_contacts
from lab.simulation.model import (
    TRACKER,
    RobotModel,
    at_zero,
    body_pose,
    compiled,
    coordinates,
    flange_body,
    let_weigh_nothing,
    site_pose,
)

__all__ = [
    "DENSITY",
    "VISUAL_GROUP",
    "Shell",
    "arm_shells",
    "body_poses",
    "dress",
    "instrument_body",
    "link_rods",
    "reach_of",
    "shells",
    "solid_points",
    "station_body_poses",
]

VISUAL_GROUP = 2  # of the geoms that are there to be seen
_UNPAINTED = (0.5, 0.5, 0.5, 1.0)  # MuJoCo's colour of a geom that names none
_SECTIONS = 32  # facets of a round primitive


Surface = tuple[Array, NDArray[np.int_], Array]  # vertices (v, 3) m, faces (f, 3), unit normals (v, 3)


@dataclass(frozen=True)
class Shell:
    """Visible surface of one body, in the body's frame.

    Attributes:
        vertices: ``(v, 3)`` m.
        faces: ``(f, 3)`` indices into them.
        normals: ``(v, 3)``, unit.
        rgba: ``(v, 4)``, 0 to 255.
    """

    body: str
    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]
    normals: NDArray[np.float32]
    rgba: NDArray[np.uint8]


def shells(robot: RobotModel) -> list[Shell]:
    """The visual geoms of every body; all geoms but planes where the model marks none as visual."""
    model = robot.model
    plane = int(mujoco.mjtGeom.mjGEOM_PLANE)
    solid = [g for g in range(model.ngeom) if int(model.geom_type[g]) != plane]
    visual = [g for g in solid if int(model.geom_group[g]) == VISUAL_GROUP] or solid
    bodies: dict[int, list[int]] = {}
    for geom in visual:
        bodies.setdefault(int(model.geom_bodyid[geom]), []).append(geom)
    return [_shell(model, body, geoms) for body, geoms in bodies.items()]


def arm_shells(robot: RobotModel) -> list[Shell]:
    """The shells of all bodies but the instrument's: for where nothing is measured, or nobody knows by what."""
    instrument = instrument_body(robot)
    return [each for each in shells(robot) if each.body != instrument]


def solid_points(robot: RobotModel) -> list[tuple[str, Array]]:
    """The corners ``(v, 3)`` (m, in the world) of each solid shape but planes, the arm at home, with its name.

    A shape of a body has the body's name.
    """
    model, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[:] = robot.qpos(robot.chain.home[None])[0]
    mujoco.mj_kinematics(model, data)
    found = list[tuple[str, Array]]()
    for geom in np.flatnonzero(model.geom_contype | model.geom_conaffinity).tolist():
        if int(model.geom_type[geom]) == mujoco.mjtGeom.mjGEOM_PLANE:
            continue
        body = int(model.geom_bodyid[geom])
        T_world_geom = se3.pose(data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom])
        found.append(
            (
                _name(model, body) if body else model.geom(geom).name,
                se3.transform(T_world_geom, _triangles(model, geom)[0]),
            )
        )
    return found


def instrument_body(robot: RobotModel) -> str:
    """The name of the body that carries the tracker's site, "" where that is the world."""
    body = int(robot.model.site(TRACKER).bodyid[0])
    return _name(robot.model, body) if body else ""


def body_poses(robot: RobotModel, arm: RigidArm, values: Array, joints: Array) -> dict[str, Array]:
    """World poses ``(n, 4, 4)`` (m) of all bodies of the arm with parameters ``values``, at ``joints`` ``(n, joints)``.

    The tracker's body stands where ``values``' base, the pose of frame 0 in the tracker, puts it.
    """
    model, qpos = robot.with_parameters(arm.targets, values, joints)
    data = mujoco.MjData(model)
    positions, rotations = np.empty((len(joints), model.nbody, 3)), np.empty((len(joints), model.nbody, 9))
    for i, row in enumerate(qpos):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        positions[i], rotations[i] = data.xpos, data.xmat
    Ts_world_body = se3.pose(rotations.reshape(*positions.shape, 3), positions)  # (n, bodies, 4, 4)
    poses = {_name(model, body): Ts_world_body[:, body] for body in range(model.nbody)}
    if name := instrument_body(robot):
        poses[name] = np.broadcast_to(_tracker_body_pose(robot, arm, values), (len(joints), 4, 4))
    return poses


def station_body_poses(robot: RobotModel, Ts_world_station: Mapping[str, Array]) -> dict[str, Array]:
    """World poses ``(4, 4)`` (m) of the bodies that carry the instrument at its further stations, by their names.

    Args:
        Ts_world_station: where its head stands, by the names of stations; those that the robot's cell has not are
            left out.
    """
    model, nominal, found = robot.model, at_zero(robot.model), {}
    for name, site in zip(robot.stations[1:], robot.station_sites[1:], strict=True):
        if (body := int(model.site(site).bodyid[0])) and name in Ts_world_station:
            T_head_body = se3.inverse(site_pose(model, nominal, site)) @ body_pose(nominal, body)
            found[_name(model, body)] = Ts_world_station[name] @ T_head_body
    return found


def _tracker_body_pose(robot: RobotModel, arm: RigidArm, values: Array) -> Array:
    """World pose ``(4, 4)`` of the tracker's body."""
    nominal = at_zero(robot.model)
    T_world_body = body_pose(nominal, int(robot.model.site(TRACKER).bodyid[0]))
    T_tracker_body = se3.inverse(site_pose(robot.model, nominal, TRACKER)) @ T_world_body
    return robot.T_world_frame0 @ se3.inverse(arm.T_tracker_frame0(values)) @ T_tracker_body


def _name(model: mujoco.MjModel, body: int) -> str:
    return str(model.body(body).name) or f"body{body}"


def _shell(model: mujoco.MjModel, body: int, geoms: list[int]) -> Shell:
    """The geoms of one body as one mesh."""
    parts = [_triangles(model, geom) for geom in geoms]
    starts = np.cumsum([0, *(len(vertices) for vertices, _, _ in parts)])
    vertices, normals, colours = [], [], []
    for geom, (local, _, local_normals) in zip(geoms, parts, strict=True):
        T_body_geom = se3.pose(se3.rotation_from_quaternion(model.geom_quat[geom]), model.geom_pos[geom])
        vertices.append(se3.transform(T_body_geom, local))
        normals.append(local_normals @ T_body_geom[:3, :3].T)
        colours.append(np.tile(_colour(model, geom), (len(local), 1)))
    return Shell(
        _name(model, body),
        np.concatenate(vertices).astype(np.float32),
        np.concatenate([faces + start for (_, faces, _), start in zip(parts, starts, strict=False)]).astype(np.uint32),
        np.concatenate(normals).astype(np.float32),
        np.concatenate(colours),
    )


def _colour(model: mujoco.MjModel, geom: int) -> NDArray[np.uint8]:
    """A geom's own colour goes before its material's."""
    rgba, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    if material >= 0 and np.allclose(rgba, _UNPAINTED):
        rgba = model.mat_rgba[material]
    bytes_: NDArray[np.uint8] = np.round(255 * np.clip(rgba, 0.0, 1.0)).astype(np.uint8)
    return bytes_


def _triangles(model: mujoco.MjModel, geom: int) -> Surface:
    """The surface of a geom in its own frame."""
    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), np.asarray(model.geom_size[geom], dtype=np.float64)
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return _mesh(model, int(model.geom_dataid[geom]))
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return _box(size)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return _cylinder(size[0], size[1])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return _capsule(size[0], size[1])
    vertices, faces, normals = _capsule(1.0, 0.0)
    radii = size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else size[[0, 0, 0]]
    steep = normals / radii
    return vertices * radii, faces, steep / np.linalg.norm(steep, axis=1, keepdims=True)


def _mesh(model: mujoco.MjModel, mesh: int) -> Surface:
    """A mesh with one vertex for each pair of corner and normal, so that its edges stay sharp."""
    first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    corners, normals = (of[first : first + count].astype(np.int_) for of in (model.mesh_face, model.mesh_facenormal))
    width = int(model.mesh_normalnum[mesh])
    pairs, faces = np.unique(corners * width + normals, return_inverse=True)
    vertices = model.mesh_vert[int(model.mesh_vertadr[mesh]) :][pairs // width].astype(np.float64)
    directions = model.mesh_normal[int(model.mesh_normaladr[mesh]) :][pairs % width].astype(np.float64)
    return vertices, faces.reshape(corners.shape), directions


def _box(half: Array) -> Surface:
    """Six sides, each with its own corners and normal."""
    square = np.array([[-1.0, -1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]])
    sides = [np.roll(square * [1, sign, sign], axis, axis=1) for axis in range(3) for sign in (1, -1)]
    normals = [np.roll([0.0, 0.0, sign], axis) for axis in range(3) for sign in (1, -1)]
    faces = np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(6)[:, None, None]
    return np.concatenate(sides) * half, faces.reshape(-1, 3), np.repeat(normals, 4, axis=0)


def _cylinder(radius: float, half: float) -> Surface:
    """Return the surface of a cylinder: two lids and a wall."""
    profile = np.array([[0.0, -half], [radius, -half], [radius, half], [0.0, half]])
    outward = np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    return _revolved(np.stack([profile[:-1], profile[1:]], axis=1), np.stack([outward, outward], axis=1))


def _capsule(radius: float, half: float) -> Surface:
    """Return the surface of a capsule: two half spheres and a wall; a sphere where ``half`` is zero."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, _SECTIONS // 2 + 1)
    outward = np.column_stack([np.cos(angle), np.sin(angle)])
    outward = np.insert(outward, len(outward) // 2, outward[len(outward) // 2], axis=0)  # the wall's two edges
    shift = np.where(np.arange(len(outward)) < len(outward) // 2, -half, half)
    profile = radius * outward + np.column_stack([np.zeros(len(shift)), shift])
    return _revolved(np.stack([profile[:-1], profile[1:]], axis=1), np.stack([outward[:-1], outward[1:]], axis=1))


def _revolved(bands: Array, normals: Array) -> Surface:
    """Bands about z from their two edges ``(b, 2, 2)``, (radius, height) upward, and the normals there."""
    angle = np.linspace(0.0, 2 * np.pi, _SECTIONS + 1)[:, None]
    ring = np.arange(_SECTIONS)
    low, high = ring, ring + _SECTIONS + 1
    quads = np.concatenate([np.stack([low, low + 1, high + 1], 1), np.stack([low, high + 1, high], 1)])
    faces = quads + 2 * (_SECTIONS + 1) * np.arange(len(bands))[:, None, None]

    def spun(plane: Array) -> Array:
        edge = plane.reshape(-1, 1, 2)
        around = np.cos(angle), np.sin(angle), np.ones_like(angle)
        parts = [edge[..., column] * of[:, 0] for column, of in zip((0, 0, 1), around, strict=True)]
        return np.stack(parts, axis=-1).reshape(-1, 3)

    return spun(bands), faces.reshape(-1, 3), spun(normals)


DENSITY = 1500.0  # kg/m^3 of a rod: castings are hollow, motors and gears are not
_THICK, _TAPER = 0.06, 0.55  # radius of the first link beside the arm's reach; how much less the last one's is
_SPOKE_M, _BALL_M = 0.004, 0.014  # radius of what carries a target; how far from the target it ends
_SOME_KG = 1e-6  # a body with less has no mass of its own
_SHORT_M = 1e-3  # a shorter stretch is drawn as a ball
_ALIKE_RAD = 1e-3  # axes that differ by less are one
_POSES, _MOST = 200, 0.5  # poses at which rods are looked at; in more than this share of them links only seem to touch
_PAINT, _STEEL = (0.95, 0.38, 0.06, 1.0), (0.58, 0.60, 0.64, 1.0)


@dataclass(frozen=True)
class Rod:
    """A stretch with round ends of the link that ``joint`` (from 0; -1 is the base) moves.

    ``start`` and ``end`` are ``(3,)`` m in frame 0, joint positions zero.
    """

    joint: int
    start: Array
    end: Array
    radius: float


def reach_of(chain: Chain) -> float:
    """Return the largest distance (m) of the last frame from frame 0, in random poses within the limits."""
    arm = SerialArm(chain)
    joints = chain.random_joints(_POSES, rng_for(0, "structure"))
    return float(np.linalg.norm(arm.flange(joints, arm.nominal())[:, :3, 3], axis=1).max())


def link_rods(chain: Chain) -> list[Rod]:
    """The rods of all links, at least one each."""
    n, (frames_at, last) = chain.size, _frames(chain)
    ends = [frame[:3, 3] - row[1] * frame[:3, 2] for frame, row in zip(frames_at, chain.table, strict=True)]
    ends.append(last[:3, 3])  # where the link before each joint ends, and the last
    radii = _THICK * max(reach_of(chain), 0.1) * (1 - _TAPER * np.arange(n) / max(n - 1, 1))
    rods = []
    for i in range(n):
        here, z = frames_at[i][:3, 3], frames_at[i][:3, 2]
        stretches = [(here, ends[i + 1])]
        if not chain.prismatic[i]:
            stretches.append((ends[i], here))
        elif i + 1 < n and chain.prismatic[i + 1]:
            low, high = np.sort(chain.sign[i] * np.array([min(chain.lower[i], 0.0), max(chain.upper[i], 0.0)]))
            rods.append(Rod(i - 1, here + low * z, here + high * z, radii[i]))
        else:
            stretches.append((here - chain.sign[i] * _stroke(chain.lower[i], chain.upper[i]) * z, here))
        long = [pair for pair in stretches if np.linalg.norm(pair[1] - pair[0]) > _SHORT_M]
        if i == n - 1:
            long = [(start, _short_of(last[:3, 3], start, end, radii[i])) for start, end in long]
        rods += [Rod(i, start, end, radii[i]) for start, end in long or [(here, here)]]
    return rods


def _frames(chain: Chain) -> tuple[list[Array], Array]:
    """The frame ``(4, 4)`` of each joint's link in frame 0, and the last frame, joint positions zero."""
    arm = SerialArm(chain)
    tree, frame, found = link_tree(arm, arm.nominal()), np.eye(4), list[Array]()
    for link in tree.moving:
        frame = frame @ link.T_parent_link
        found.append(frame)
    return found, frame @ tree.moving[-1].T_link_frame


def _drawn_in(chain: Chain) -> list[tuple[int, int]]:
    """Pairs of a slide's guide (-1 is the base) and what the slide carries on its own line into it.

    That is links which turn about the line or slide along it, and, ``chain.size``, the flange if it is there too.
    """
    frames, last = _frames(chain)
    found = list[tuple[int, int]]()
    for i in [joint for joint, slides in enumerate(chain.prismatic) if slides]:
        origin, along = frames[i][:3, 3], frames[i][:3, 2]
        for k, frame in enumerate([*frames, last][i + 1 :], start=i + 1):
            off = np.cross(frame[:3, 3] - origin, along)
            across = np.cross(frame[:3, 2], along) if k < chain.size else np.zeros(3)
            if np.linalg.norm(off) > _SHORT_M or np.linalg.norm(across) > _ALIKE_RAD:
                break
            found.append((i - 1, k))
    return found


def _stroke(lower: float, upper: float) -> float:
    """A slide's stroke (m); negative where it moves out against its axis, as a quill does whose axis points up."""
    return float(np.copysign(upper - lower, upper if abs(upper) >= abs(lower) else lower))


def _short_of(flange: Array, start: Array, end: Array, radius: float) -> Array:
    """Return the end of a rod's axis at which its round end just reaches the flange."""
    along = end - start
    length = float(np.linalg.norm(along))
    meets = np.linalg.norm(end - flange) < _SHORT_M and length > 2 * radius
    return np.asarray(end - along * (radius / length if meets else 0.0))


def dress(
    path: Path,
    spec: mujoco.MjSpec,
    chain: Chain,
    T_world_frame0: Array,
    bodies: Sequence[str],
    tool: Mapping[str, Array],
    mass_kg: Array | None = None,
) -> bool:
    """Give bodies that stand on the chain's axes rods, and spokes to the targets ``tool`` (m, in the last frame).

    Args:
        bodies: of the joints, outward.
        mass_kg: ``(joints,)`` of links that have none yet, NaN where unknown; those are as heavy as their rods.

    Returns:
        Whether the mass of any had to be assumed.
    """
    bare = spec.copy()
    let_weigh_nothing(bare)
    model = compiled(path, bare)
    data = at_zero(model)
    rods, owners = link_rods(chain), np.full(chain.size, np.nan) if mass_kg is None else mass_kg
    volume = np.zeros(chain.size)
    for rod in rods:
        if rod.joint >= 0:
            volume[rod.joint] += _volume(rod)
    density = np.where(np.isnan(owners), DENSITY, owners / volume)
    heavy = model.body_mass[[model.body(name).id for name in bodies]] > _SOME_KG
    density[heavy] = 0.0
    base = model.body(int(model.body(bodies[0]).parentid[0])).name
    for rod in rods:
        name = bodies[rod.joint] if rod.joint >= 0 else base
        T_body_frame0 = se3.inverse(body_pose(data, model.body(name).id)) @ T_world_frame0
        _add(spec.body(name), rod, T_body_frame0, density[rod.joint] if rod.joint >= 0 else 0.0)
    T_frame0_last = SerialArm(chain).flange(np.zeros((1, chain.size)), SerialArm(chain).nominal())[0]
    hand = flange_body(model, bodies)
    T_body_frame0 = se3.inverse(body_pose(data, model.body(hand).id)) @ T_world_frame0
    for place in tool.values():
        length = np.linalg.norm(place)
        if length > 2 * _BALL_M:
            tip = se3.transform(T_frame0_last, (place * (1 - _BALL_M / length))[None])[0]
            _add(spec.body(hand), Rod(chain.size, T_frame0_last[:3, 3], tip, _SPOKE_M), T_body_frame0, 0.0)
    named = [*bodies, hand, base]  # -1 is the base
    _let_touch(path, spec, chain, {(named[guide], named[carried]) for guide, carried in _drawn_in(chain)})
    return bool((np.isnan(owners) & ~heavy).any())


def _volume(rod: Rod) -> float:
    length = float(np.linalg.norm(rod.end - rod.start))
    return np.pi * rod.radius**2 * (length + 4 / 3 * rod.radius)


def _add(body: mujoco.MjsBody, rod: Rod, T_body_frame0: Array, density: float) -> None:
    """A capsule, or a ball."""
    ends = se3.transform(T_body_frame0, np.array([rod.start, rod.end]))
    colour = _PAINT if rod.joint % 2 == 0 else _STEEL
    if np.linalg.norm(ends[1] - ends[0]) <= _SHORT_M:
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[rod.radius, 0, 0], pos=ends[0], density=density, rgba=colour
        )
        return
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        size=[rod.radius, 0, 0],
        fromto=ends.ravel(),
        density=density,
        rgba=colour,
    )


def _let_touch(path: Path, spec: mujoco.MjSpec, chain: Chain, drawn_in: Set[tuple[str, str]]) -> None:
    """Exclude contacts between bodies that touch in most poses, and between these pairs."""
    model = compiled(path, spec)
    counts: dict[tuple[int, int], int] = {}
    joints = chain.random_joints(_POSES, rng_for(0, "structure"))
    for data in at_contacts(model, coordinates(model, chain.joint_names, joints)):
        pairs = np.sort(model.geom_bodyid[data.contact.geom[: data.ncon]], axis=1)
        for a, b in {(int(a), int(b)) for a, b in pairs}:
            counts[a, b] = counts.get((a, b), 0) + 1
    named = [tuple(model.body(body).name for body in pair) for pair, count in counts.items() if count > _MOST * _POSES]
    for first, second in named:
        spec.add_exclude(bodyname1=first, bodyname2=second)
    for first, second in sorted(drawn_in):
        if first != second and not {(first, second), (second, first)} & set(named):
            spec.add_exclude(bodyname1=first, bodyname2=second)
