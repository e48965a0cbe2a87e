"""Put a robot's model into its cell: obstacles, tools, limits, and the instrument's pose; check the cell's numbers.

Implausible sizes and positions, such as lengths in metres under ``_mm`` or an instrument inside the robot, are refused
if surely wrong, and warned of if they may be right. Sizes are compared with usual ones and with the robot's reach.
"""

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import mujoco
import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.cell_toml import Cell, Obstacle
from lab.formats.link_tree import free_name
from lab.simulation.candidate_poses import LARGE_REFLECTOR_M
from lab.simulation.collisions import contacts_at, describe_collisions, kinematics_at
from lab.simulation.meshes import VISUAL_GROUP
from lab.simulation.robot_model import (
    TRACKER,
    RobotModel,
    SerialModel,
    at_pose,
    at_zero,
    body_pose,
    compiled,
    flange_body,
    last_frame,
    move_to,
    station_suffixed,
)

__all__ = ["edges_text", "extents_mm", "implausible", "in_cell"]

_Model = TypeVar("_Model", bound=RobotModel)
_OBSTACLE_RGBA, _PLATE_RGBA = (0.45, 0.55, 0.65, 1.0), (0.58, 0.60, 0.64, 1.0)
_MESHES = (".stl", ".obj")


def in_cell(robot: _Model, cell: Cell) -> _Model:
    """Return a copy of a robot's model in its cell.

    The robot keeps its pose in the model; the cell is placed around it, and gravity turned if the robot is tilted.

    Raises:
        LabError: the robot has no such joints, a file cannot be read, or the arm touches something at the cell's home.
    """
    spec, T_robot_cell = robot.spec.copy(), se3.inverse(cell.robot.pose)
    spec.option.gravity = T_robot_cell[:3, :3] @ spec.option.gravity
    shapes, world = _Shapes(spec, cell.path), spec.worldbody  # with a body each, MuJoCo would hold all pairs of them
    obstacles = dict[str, float | None]()
    for obstacle in cell.obstacle:
        clearance_m = cell.clearance_m(obstacle)
        obstacles[shapes.add(world, T_robot_cell @ obstacle.pose, obstacle, clearance_m or 0.0, _OBSTACLE_RGBA)] = (
            clearance_m
        )
    tool, plates = _carried(robot, shapes, cell)
    places = [T_robot_cell @ each.pose for each in cell.instrument_places]
    for station, T in list(zip(cell.station, places, strict=False))[1:]:
        _add_station(robot, spec, station.name, T)
    if places:
        _place_tracker(robot, spec, places[0])
    lower, upper, home = cell.joint_spec_values(robot.chain)
    chain = replace(robot.chain, lower=lower, upper=upper, given_home=home)
    acceptance = robot.acceptance_rad if cell.reflector is None else float(np.deg2rad(cell.reflector.degrees))
    model = compiled(cell.path, spec)
    stations = tuple(each.name for each in cell.station)
    placed = replace(
        robot, spec=spec, model=model, chain=chain, tool=tool, acceptance_rad=acceptance, stations=stations,
        obstacles=obstacles, plates=plates, origin=replace(robot.origin, cell=cell),
    )  # fmt: skip
    if home is not None:
        _refuse_home(placed, cell, home)
    return placed


def _refuse_home(robot: RobotModel, cell: Cell, home: Array) -> None:
    """Refuse a home ``(joints,)`` beyond the limits, or where the arm touches something, with a LabError."""
    if (beyond := np.flatnonzero(robot.chain.beyond_limits(home[None], 1e-9)[0])).size:
        raise LabError(f"{cell.path}: [home]: {robot.chain.limit_note(int(beyond[0]), home[beyond[0]])}; start within")
    if touches := describe_collisions(robot, home[None])[0]:
        raise LabError(f"{cell.path}: [home]: {touches} there; start elsewhere, or move that")


def _carried(robot: RobotModel, shapes: "_Shapes", cell: Cell) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Put the cell's plates and tool points onto the flange.

    Returns:
        The tool points (m, in the last frame), and the names of the plates' shapes.
    """
    if not (cell.plate or cell.tool):
        return robot.tool, ()
    if not isinstance(robot, SerialModel):
        raise LabError(f"{cell.path}: [[tool]] and [[plate]] are for serial arms; describe those of {robot.chain.name}")
    data, last = at_zero(robot.model), last_frame(robot.chain, robot.T_world_frame0)
    carrier = robot.model.body(flange_body(robot.model, robot.bodies))
    spec, T_body_last = shapes.spec, se3.inverse(body_pose(data, carrier.id)) @ last
    body = spec.body(carrier.name)
    plates = tuple(shapes.add(body, T_body_last @ plate.pose, plate, 0.0, _PLATE_RGBA) for plate in cell.plate)
    if not cell.tool:
        return robot.tool, plates
    for site in [site for site in spec.sites if site.name in robot.tool]:
        spec.delete(site)
    _add_points(spec, body, T_body_last, cell)
    return {point.name: point.position for point in cell.tool}, plates


def _add_points(spec: mujoco.MjSpec, body: mujoco.MjsBody, T_body_last: Array, cell: Cell) -> None:
    """Add the cell's tool points to the body that carries the last frame."""
    taken = {site.name for site in spec.sites}
    for point in cell.tool:
        if point.name in taken:
            raise LabError(f"{cell.path}: tool point '{point.name}': the model has a site of that name; rename it")
        T = T_body_last @ se3.pose(point.rotation, point.position)
        size = (LARGE_REFLECTOR_M, 0.0, 0.0)
        body.add_site(name=point.name, size=size, **at_pose(T))


class _Shapes:
    """Solid shapes that are added to a model, each by a name of its own: the model is searched for its names once."""

    def __init__(self, spec: mujoco.MjSpec, path: Path) -> None:
        geoms = list(spec.geoms)
        self._meshes = dict[tuple[Path, float], str]()
        self.spec, self._path, self._taken = spec, path, {each.name for each in (*geoms, *spec.bodies)}
        self._group = VISUAL_GROUP if any(each.group == VISUAL_GROUP for each in geoms) else 0  # so that it is drawn

    def add(self, body: mujoco.MjsBody, T: Array, shape: Obstacle, clearance_m: float, rgba: tuple[float, ...]) -> str:
        """Give a body a solid shape at this pose ``(4, 4)`` (m) in it, with this clearance; return its name."""
        kind, size = mujoco.mjtGeom.mjGEOM_BOX, [each / 2e3 for each in shape.size_mm]
        if shape.shape == "cylinder":
            kind, size = mujoco.mjtGeom.mjGEOM_CYLINDER, [MM.to_si(shape.radius_mm), shape.height_mm / 2e3, 0.0]
        mesh = {}
        if shape.shape == "mesh":
            kind, size = mujoco.mjtGeom.mjGEOM_MESH, [0.0, 0.0, 0.0]
            mesh["meshname"] = self._add_mesh(shape)
        name = free_name(shape.name, self._taken)
        self._taken.add(name)
        body.add_geom(
            name=name, type=kind, size=size, rgba=rgba, margin=clearance_m, contype=1, conaffinity=1,
            group=self._group, mass=0.0, **at_pose(T), **mesh,
        )  # fmt: skip
        return name

    def _add_mesh(self, shape: Obstacle) -> str:
        """Return the name of a shape's mesh in the model, to which each file is added once."""
        file = (self._path.parent / shape.file).resolve()
        if file.suffix.lower() not in _MESHES or not file.is_file():
            raise LabError(f"{self._path}: mesh '{shape.name}': {file} is no file of {' or '.join(_MESHES)}; give one")
        if (file, shape.scale) not in self._meshes:
            self._meshes[file, shape.scale] = f"cell {shape.name}"
            self.spec.add_mesh(name=f"cell {shape.name}", file=str(file), scale=[shape.scale] * 3)
        return self._meshes[file, shape.scale]


def _place_tracker(robot: RobotModel, spec: mujoco.MjSpec, T_world_tracker: Array) -> None:
    """Move the body that carries the tracker's head, or the head alone where the world carries it."""
    site = spec.site(TRACKER)
    stand, own = site.parent, robot.model.site(TRACKER)
    if int(own.bodyid[0]) == 0:
        move_to(site, T_world_tracker)
        return
    move_to(stand, _body_pose_of_tracker(robot, T_world_tracker))


def _add_station(robot: RobotModel, spec: mujoco.MjSpec, name: str, T_world_station: Array) -> None:
    """Copy the body that carries the tracker's head to a further station; the head alone without a body."""
    if int(robot.model.site(TRACKER).bodyid[0]) == 0:
        spec.worldbody.add_site(name=station_suffixed(TRACKER, name), **at_pose(T_world_station))
        return
    spec.copy_during_attach = True
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # MuJoCo's is about names without a prefix: these have a suffix
        stand = spec.worldbody.add_frame().attach_body(spec.site(TRACKER).parent, "", station_suffixed("", name))
    move_to(stand, _body_pose_of_tracker(robot, T_world_station))


def _body_pose_of_tracker(robot: RobotModel, T_world_head: Array) -> Array:
    """Return the world pose ``(4, 4)`` of the body that carries the tracker, from that of its head."""
    body = int(robot.model.site(TRACKER).bodyid[0])
    T_body_site = se3.inverse(body_pose(at_zero(robot.model), body)) @ robot.T_world_tracker
    return T_world_head @ se3.inverse(T_body_site)


_POSES = 100  # random ones within the limits
_REFUSED_MM = (5.0, 100e3)  # an obstacle's longest edge is larger, and smaller
_DOUBTED_MM = (30.0, 30e3)  # warned of outside these
_NEAR_MM = 5.0  # from the origin of its frame, without being there: metres under mm
_TOOL_MM = 2.0
_CLEARANCE_MM = 0.5
_AT_BASE_M, _NEAR_BASE_M = 0.05, 0.3  # between the instrument's head and the robot's base
_NEAR_REACH = 0.7  # of the reach: an instrument nearer to the base is in the arm's way
_FAR_HEAD_M = 30.0
_SWALLOWED_M = 0.02  # how deep the base's origin is in an obstacle
_ALWAYS, _MOSTLY = 1.0, 0.9  # shares of the poses in which the arm touches an obstacle: refused, doubted
_WIDE_TOOL = (1.0, 5.0)  # lengths of a tool or a plate beside the reach: doubted, refused
_NARROW_DEG = 4 * np.pi  # a joint's range that would be two turns in radians


def implausible(robot: RobotModel, cell: Cell) -> tuple[str, ...]:
    """Describe the doubtful entries of a cell.

    Args:
        robot: the model in this cell.

    Raises:
        LabError: a size or a place is surely wrong; the message says which one, and how to mend it.
    """
    joints = robot.chain.random_joints(_POSES, rng_for(0, "poses"))
    joints = joints[~np.isnan(robot.qpos(joints)).any(axis=1)]
    moving = np.flatnonzero(robot.model.body_weldid)
    places = np.array([stand.xpos[moving] for stand in kinematics_at(robot, joints)]).reshape(-1, 3)
    reach = float(np.linalg.norm(places - robot.T_world_frame0[:3, 3], axis=1).max(initial=0.0))
    return (
        *_check_sizes(robot, cell),
        *_check_tools(cell, reach),
        *_check_positions(cell),
        *_check_base(robot, cell),
        *_check_contacts(robot, cell, joints),
        *_check_instruments(robot, cell, reach),
        *_check_reach(robot, cell, reach),
        *_check_limits(cell),
    )


def extents_mm(robot: RobotModel, shape: Obstacle, name: str) -> Array:
    """Return edges ``(3,)`` of the box around a shape, along its own axes.

    Args:
        robot: the model in the cell.
        name: of the shape in the model.
    """
    if shape.shape == "box":
        return np.array(shape.size_mm)
    if shape.shape == "cylinder":
        return np.array([2 * shape.radius_mm, 2 * shape.radius_mm, shape.height_mm])
    model = robot.model
    mesh = int(model.geom_dataid[model.geom(name).id])
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    turned = np.empty(9)
    mujoco.mju_quat2Mat(turned, model.mesh_quat[mesh])  # MuJoCo turns a mesh onto its principal axes
    points = model.mesh_vert[first : first + count] @ turned.reshape(3, 3).T
    return np.asarray(MM.of(np.ptp(points, axis=0)))


def edges_text(extents: Sequence[float] | Array) -> str:
    """Format edges in mm."""
    return " x ".join(f"{edge:.0f}" if edge >= 1000 else f"{edge:.3g}" for edge in extents) + " mm"


def _check_sizes(robot: RobotModel, cell: Cell) -> Iterator[str]:
    names = [*robot.obstacles, *robot.plates]
    for shape, name in zip((*cell.obstacle, *cell.plate), names, strict=True):
        extents = extents_mm(robot, shape, name)
        longest, what = float(extents.max()), f"{cell.path}: {shape.shape} '{shape.name}' is {edges_text(extents)}"
        mend = _unit_note(shape)
        if not _REFUSED_MM[0] <= longest <= _REFUSED_MM[1]:
            raise LabError(f"{what}, no size of {'a plate' if shape in cell.plate else 'an obstacle'}; {mend}")
        if not _DOUBTED_MM[0] <= longest <= _DOUBTED_MM[1] and shape not in cell.plate:
            yield f"{what}, an unusual size; {mend}"
        stated = cell.clearance_mm if shape.clearance_mm is None else shape.clearance_mm
        if stated is not None and 0 < stated < _CLEARANCE_MM:
            yield f"{cell.path}: '{shape.name}' has a clearance of {stated:g} mm; give it in mm, not in metres"


def _unit_note(shape: Obstacle) -> str:
    """Return how to mend a shape's size."""
    if shape.shape != "mesh":
        return "its lengths are in mm; give them so"
    other = "m" if shape.unit == "mm" else "mm"
    return f'its unit is {shape.unit}; give unit = "{other}" if the file is in {other}'


def _check_tools(cell: Cell, reach: float) -> Iterator[str]:
    lengths = {f"tool point '{point.name}'": MM.of(float(np.linalg.norm(point.position))) for point in cell.tool}
    for what, length in lengths.items():
        if 0 < length < _TOOL_MM:
            yield f"{cell.path}: {what} is {length:.2g} mm from the flange; give position_mm in mm, not in metres"
    for plate in cell.plate:
        lengths[f"plate '{plate.name}'"] = max([*plate.size_mm, plate.radius_mm, plate.height_mm])
    for what, length in lengths.items():
        doubted, refused = (MM.of(share * reach) for share in _WIDE_TOOL)
        text = f"{cell.path}: {what}: {length:.4g} mm on a robot that reaches {MM.text(reach, 4)}"
        if length > refused:
            raise LabError(f"{text}; give lengths in mm")
        if length > doubted:
            yield f"{text}; give lengths in mm"


def _check_positions(cell: Cell) -> Iterator[str]:
    """Find positions millimetres from the origin of their frame, as metres under ``_mm`` are."""
    places = {f"obstacle '{each.name}'": each for each in cell.obstacle} | {"[robot]": cell.robot}
    for each in cell.instrument_places:
        places["[instrument]" if each is cell.instrument else f"station '{getattr(each, 'name', '')}'"] = each
    for what, place in places.items():
        if 0 < max(abs(x) for x in place.position_mm) < _NEAR_MM:
            at = ", ".join(f"{x:g}" for x in place.position_mm)
            yield f"{cell.path}: {what}: position_mm is [{at}]; give it in mm, not in metres"


def _check_base(robot: RobotModel, cell: Cell) -> Iterator[str]:
    data = next(kinematics_at(robot, robot.chain.home[None]))
    for name in robot.obstacles:
        depth = _depth(robot.model, data, robot.model.geom(name).id, robot.T_world_frame0[:3, 3])
        if depth > _SWALLOWED_M:
            yield f"{cell.path}: the robot's base is {MM.of(depth):.0f} mm deep in '{name}'; move one of them"


def _check_contacts(robot: RobotModel, cell: Cell, joints: Array) -> Iterator[str]:
    if not len(joints):
        return
    counts = dict.fromkeys(robot.obstacles, 0)
    for data in contacts_at(robot.model, robot.qpos(joints)):
        for geom in np.unique(data.contact.geom):
            if (name := robot.model.geom(int(geom)).name) in counts:
                counts[name] += 1
    for name, count in counts.items():
        clearance_mm = MM.of(robot.obstacles[name] or 0.0)
        kept = f", or nearer than its clearance of {clearance_mm:g} mm," if clearance_mm else ""
        text = f"{cell.path}: the arm is in '{name}'{kept} in {count} of {len(joints)} random poses"
        mend = "mend its size, its position, or that of [robot]"
        if count >= _ALWAYS * len(joints):
            raise LabError(f"{text}; {mend}")
        if count >= _MOSTLY * len(joints):
            yield f"{text}; {mend}"


def _check_instruments(robot: RobotModel, cell: Cell, reach: float) -> Iterator[str]:
    if not cell.instrument_places:
        return
    mend, base = "its head's position_mm is in mm, in the cell's frame; move it away", robot.T_world_frame0[:3, 3]
    for name, T in zip(robot.stations or ("",), robot.Ts_world_station, strict=True):
        head, who = T[:3, 3], f"{cell.path}: the instrument{f' at station {name!r}' if name else ''}"
        if inside := _surrounding(robot, head):
            raise LabError(f"{who} stands inside {inside}; {mend}")
        away = float(np.linalg.norm(head - base))
        if away < _AT_BASE_M:
            raise LabError(f"{who} is {MM.text(away)} from the robot's base; {mend}")
        if away < _NEAR_BASE_M:
            yield f"{who} is {MM.text(away)} from the robot's base; {mend}"
        elif away < _NEAR_REACH * reach:
            yield f"{who} is {MM.of(away):.0f} mm from the robot's base, in the arm's way; {mend}"
        elif away > _FAR_HEAD_M:
            yield f"{who} is {away:.3g} m from the robot's base; give position_mm in mm"


def _surrounding(robot: RobotModel, head: Array) -> str:
    """Return the solid shape in which an instrument's head ``(3,)`` m is, its own stand aside; "" for none."""
    model, data = robot.model, next(kinematics_at(robot, robot.chain.home[None]))
    stands = {int(model.site(site).bodyid[0]) for site in robot.station_sites} - {0}
    for geom in np.flatnonzero(model.geom_contype | model.geom_conaffinity).tolist():
        body = int(model.geom_bodyid[geom])
        if body not in stands and _depth(model, data, geom, head) > 0:
            return f"the arm, in {model.body(body).name}" if body else f"'{model.geom(geom).name}'"
    return ""


def _check_reach(robot: RobotModel, cell: Cell, reach: float) -> Iterator[str]:
    if not robot.obstacles:
        return
    base, data = robot.T_world_frame0[:3, 3], next(kinematics_at(robot, robot.chain.home[None]))
    ids = [robot.model.geom(name).id for name in robot.obstacles]
    gaps = np.linalg.norm(data.geom_xpos[ids] - base, axis=1) - robot.model.geom_rbound[ids]
    if gaps.min() > 2 * reach:
        yield (
            f"{cell.path}: every obstacle is farther away than twice the robot's reach of {MM.of(reach):.0f} mm, the "
            f"nearest by {MM.of(gaps.min()):.0f} mm; give positions in mm, in the frame in which [robot] stands"
        )


def _check_limits(cell: Cell) -> Iterator[str]:
    for name, limits in cell.joints.items():
        low, high, cable = limits.lower_deg, limits.upper_deg, limits.cable_deg
        left = 2 * cable if cable is not None else None if low is None or high is None else high - low
        if left is not None and left < _NARROW_DEG:
            yield f"{cell.path}: joint {name} is left {left:.3g}° of its range; give limits in degrees, not in radians"


def _depth(model: mujoco.MjModel, data: mujoco.MjData, geom: int, point: Array) -> float:
    """Return the depth (m) of a point in a shape, along the axes of the world; 0 outside it, and of planes.

    From inside a convex shape a ray leaves it in every direction; from outside, of two opposite ones one misses it.
    """
    kind, depth = int(model.geom_type[geom]), np.inf
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        return 0.0
    for direction in np.concatenate([np.eye(3), -np.eye(3)]):
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            distance = mujoco.mj_rayMesh(model, data, geom, point, direction, None)
        else:
            rotation = data.geom_xmat[geom]
            distance = mujoco.mju_rayGeom(
                data.geom_xpos[geom], rotation, model.geom_size[geom], point, direction, kind, None
            )
        if distance < 0:
            return 0.0
        depth = min(depth, float(distance))
    return depth
