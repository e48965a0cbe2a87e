"""Visual shells of a robot as triangles, and the poses of its bodies at each configuration."""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.model import RigidArm
from lab.simulation.robot_model import TRACKER, RobotModel, at_zero, body_pose, site_pose

__all__ = [
    "VISUAL_GROUP",
    "Shell",
    "arm_shells",
    "body_poses",
    "instrument_body",
    "shells",
    "solid_points",
    "station_body_poses",
]

VISUAL_GROUP = 2  # of geoms for display
_UNPAINTED = (0.5, 0.5, 0.5, 1.0)  # MuJoCo's default colour
_SECTIONS = 32  # facets of a round primitive


_Surface = tuple[Array, NDArray[np.int_], Array]  # vertices (v, 3) m, faces (f, 3), unit normals (v, 3)


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
    """Return the visual geoms of every body; all geoms but planes if the model marks none as visual."""
    model = robot.model
    plane = int(mujoco.mjtGeom.mjGEOM_PLANE)
    solid = [g for g in range(model.ngeom) if int(model.geom_type[g]) != plane]
    visual = [g for g in solid if int(model.geom_group[g]) == VISUAL_GROUP] or solid
    bodies: dict[int, list[int]] = {}
    for geom in visual:
        bodies.setdefault(int(model.geom_bodyid[geom]), []).append(geom)
    return [_shell(model, body, geoms) for body, geoms in bodies.items()]


def arm_shells(robot: RobotModel) -> list[Shell]:
    """Return the shells of all bodies but the instrument's."""
    instrument = instrument_body(robot)
    return [each for each in shells(robot) if each.body != instrument]


def solid_points(robot: RobotModel) -> list[tuple[str, Array]]:
    """Return the name and corners ``(v, 3)`` (m, in the world) of each solid shape but planes, the arm at home.

    A shape of a body has the name of the body.
    """
    model, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[:] = robot.qpos(robot.chain.home[None])[0]
    mujoco.mj_kinematics(model, data)
    found = list[tuple[str, Array]]()
    for geom in np.flatnonzero(model.geom_contype | model.geom_conaffinity).tolist():
        if int(model.geom_type[geom]) == mujoco.mjtGeom.mjGEOM_PLANE:
            continue
        body = int(model.geom_bodyid[geom])
        name = _name(model, body) if body else model.geom(geom).name
        T_world_geom = se3.pose(data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom])
        found.append((name, se3.transform(T_world_geom, _triangles(model, geom)[0])))
    return found


def instrument_body(robot: RobotModel) -> str:
    """Return the name of the body that carries the tracker's site, "" where that is the world."""
    body = int(robot.model.site(TRACKER).bodyid[0])
    return _name(robot.model, body) if body else ""


def body_poses(robot: RobotModel, arm: RigidArm, values: Array, joints: Array) -> dict[str, Array]:
    """Return the world poses ``(n, 4, 4)`` (m) of all bodies of the identified arm, at ``joints`` ``(n, joints)``.

    The tracker's body is placed by the base in ``values``, the pose of frame 0 in the tracker.
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
    """Return the world poses ``(4, 4)`` (m) of the bodies that carry the instrument at further stations, by name.

    Args:
        Ts_world_station: poses of its head, by the names of stations; stations not in the robot's cell are ignored.
    """
    model, nominal, found = robot.model, at_zero(robot.model), {}
    for name, site in zip(robot.stations[1:], robot.station_sites[1:], strict=True):
        if (body := int(model.site(site).bodyid[0])) and name in Ts_world_station:
            T_head_body = se3.inverse(site_pose(model, nominal, site)) @ body_pose(nominal, body)
            found[_name(model, body)] = Ts_world_station[name] @ T_head_body
    return found


def _tracker_body_pose(robot: RobotModel, arm: RigidArm, values: Array) -> Array:
    nominal = at_zero(robot.model)
    T_world_body = body_pose(nominal, int(robot.model.site(TRACKER).bodyid[0]))
    T_tracker_body = se3.inverse(site_pose(robot.model, nominal, TRACKER)) @ T_world_body
    return robot.T_world_frame0 @ se3.inverse(arm.T_tracker_frame0(values)) @ T_tracker_body


def _name(model: mujoco.MjModel, body: int) -> str:
    return str(model.body(body).name) or f"body{body}"


def _shell(model: mujoco.MjModel, body: int, geoms: list[int]) -> Shell:
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
    rgba, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    if material >= 0 and np.allclose(rgba, _UNPAINTED):
        rgba = model.mat_rgba[material]
    bytes_: NDArray[np.uint8] = np.round(255 * np.clip(rgba, 0.0, 1.0)).astype(np.uint8)
    return bytes_


def _triangles(model: mujoco.MjModel, geom: int) -> _Surface:
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


def _mesh(model: mujoco.MjModel, mesh: int) -> _Surface:
    """Return a mesh with one vertex for each pair of corner and normal, so that its edges stay sharp."""
    first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    corners, normals = (of[first : first + count].astype(np.int_) for of in (model.mesh_face, model.mesh_facenormal))
    width = int(model.mesh_normalnum[mesh])
    pairs, faces = np.unique(corners * width + normals, return_inverse=True)
    vertices = model.mesh_vert[int(model.mesh_vertadr[mesh]) :][pairs // width].astype(np.float64)
    directions = model.mesh_normal[int(model.mesh_normaladr[mesh]) :][pairs % width].astype(np.float64)
    return vertices, faces.reshape(corners.shape), directions


def _box(half: Array) -> _Surface:
    square = np.array([[-1.0, -1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]])
    sides = [np.roll(square * [1, sign, sign], axis, axis=1) for axis in range(3) for sign in (1, -1)]
    normals = [np.roll([0.0, 0.0, sign], axis) for axis in range(3) for sign in (1, -1)]
    faces = np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(6)[:, None, None]
    return np.concatenate(sides) * half, faces.reshape(-1, 3), np.repeat(normals, 4, axis=0)


def _cylinder(radius: float, half: float) -> _Surface:
    profile = np.array([[0.0, -half], [radius, -half], [radius, half], [0.0, half]])
    outward = np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    return _revolved(np.stack([profile[:-1], profile[1:]], axis=1), np.stack([outward, outward], axis=1))


def _capsule(radius: float, half: float) -> _Surface:
    """Return the surface of a capsule: two half spheres and a wall; a sphere where ``half`` is zero."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, _SECTIONS // 2 + 1)
    outward = np.column_stack([np.cos(angle), np.sin(angle)])
    outward = np.insert(outward, len(outward) // 2, outward[len(outward) // 2], axis=0)  # the wall's two edges
    shift = np.where(np.arange(len(outward)) < len(outward) // 2, -half, half)
    profile = radius * outward + np.column_stack([np.zeros(len(shift)), shift])
    return _revolved(np.stack([profile[:-1], profile[1:]], axis=1), np.stack([outward[:-1], outward[1:]], axis=1))


def _revolved(bands: Array, normals: Array) -> _Surface:
    """Revolve bands about z from their edges ``(b, 2, 2)``, (radius, height) upward, and the normals there."""
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
