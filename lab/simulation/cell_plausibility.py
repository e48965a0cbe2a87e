"""Sizes and places of a cell that cannot be meant: lengths in metres under ``_mm``, an instrument inside the robot.

What is surely wrong is refused; what may be right is a warning. Sizes are compared with those of things that people
build cells of, and with the robot's reach.
"""

from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.formats.cell_toml import Cell, Obstacle
from lab.simulation.collisions import at_contacts, standing
from lab.simulation.model import RobotModel

__all__ = ["extents_mm", "implausible", "in_words"]

_POSES = 100  # random ones within the limits
_REFUSED_MM = (5.0, 100e3)  # an obstacle's longest edge is larger, and smaller
_DOUBTED_MM = (30.0, 30e3)
_NEAR_MM = 5.0  # from the origin of its frame, without being there: metres under mm
_TOOL_MM = 2.0
_CLEARANCE_MM = 0.5
_AT_BASE_M, _NEAR_BASE_M = 0.05, 0.3  # between the instrument's head and the robot's base
_NEAR_REACH = 0.7  # of the reach: an instrument nearer to the base is in the arm's way
_FAR_HEAD_M = 30.0
_SWALLOWED_M = 0.02  # how deep the base's origin is in an obstacle
_ALWAYS, _MOSTLY = 1.0, 0.9  # shares of the poses in which the arm touches an obstacle
_WIDE_TOOL = (1.0, 5.0)  # lengths of a tool or a plate beside the reach: doubted, refused
_NARROW_DEG = 4 * np.pi  # a joint's range that would be two turns in radians


def implausible(robot: RobotModel, cell: Cell) -> tuple[str, ...]:
    """What of a cell may be wrong, in words.

    Args:
        robot: the model in this cell.

    Raises:
        LabError: a size or a place is surely wrong; the message says which one, and how to mend it.
    """
    joints = robot.chain.random_joints(_POSES, rng_for(0, "poses"))
    joints = joints[~np.isnan(robot.qpos(joints)).any(axis=1)]
    moving = np.flatnonzero(robot.model.body_weldid)
    places = np.array([stand.xpos[moving] for stand in standing(robot, joints)]).reshape(-1, 3)
    reach = float(np.linalg.norm(places - robot.T_world_frame0[:3, 3], axis=1).max(initial=0.0))
    return (
        *_of_sizes(robot, cell),
        *_of_tools(cell, reach),
        *_of_positions(cell),
        *_of_base(robot, cell),
        *_of_contacts(robot, cell, joints),
        *_of_instrument(robot, cell, reach),
        *_of_reach(robot, cell, reach),
        *_of_joints(cell),
    )


def extents_mm(robot: RobotModel, shape: Obstacle, name: str) -> Array:
    """Edges ``(3,)`` of the box around a shape, along its own axes.

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
    return np.asarray(1e3 * np.ptp(points, axis=0))


def in_words(extents: Sequence[float] | Array) -> str:
    """Edges in mm, for a person."""
    return " x ".join(f"{edge:.0f}" if edge >= 1000 else f"{edge:.3g}" for edge in extents) + " mm"


def _of_sizes(robot: RobotModel, cell: Cell) -> Iterator[str]:
    """Obstacles and plates whose longest edge is too short or too long for one."""
    names = [*robot.obstacles, *robot.plates]
    for shape, name in zip((*cell.obstacle, *cell.plate), names, strict=True):
        extents = extents_mm(robot, shape, name)
        longest, what = float(extents.max()), f"{cell.path}: {shape.shape} '{shape.name}' is {in_words(extents)}"
        if shape.shape == "mesh":
            other = "m" if shape.unit == "mm" else "mm"
            mend = f'its unit is {shape.unit}; give unit = "{other}" if the file is in {other}'
        else:
            mend = "its lengths are in mm; give them so"
        if not _REFUSED_MM[0] <= longest <= _REFUSED_MM[1]:
            raise LabError(f"{what}, no size of {'a plate' if shape in cell.plate else 'an obstacle'}; {mend}")
        if not _DOUBTED_MM[0] <= longest <= _DOUBTED_MM[1] and shape not in cell.plate:
            yield f"{what}, an unusual size; {mend}"
        stated = cell.clearance_mm if shape.clearance_mm is None else shape.clearance_mm
        if stated is not None and 0 < stated < _CLEARANCE_MM:
            yield f"{cell.path}: '{shape.name}' has a clearance of {stated:g} mm; give it in mm, not in metres"


def _of_tools(cell: Cell, reach: float) -> Iterator[str]:
    """Points and plates on the flange that are no tool's."""
    lengths = {f"tool point '{point.name}'": 1e3 * float(np.linalg.norm(point.position)) for point in cell.tool}
    for what, length in lengths.items():
        if 0 < length < _TOOL_MM:
            yield f"{cell.path}: {what} is {length:.2g} mm from the flange; give position_mm in mm, not in metres"
    for plate in cell.plate:
        lengths[f"plate '{plate.name}'"] = max([*plate.size_mm, plate.radius_mm, plate.height_mm])
    for what, length in lengths.items():
        doubted, refused = (share * 1e3 * reach for share in _WIDE_TOOL)
        words = f"{cell.path}: {what}: {length:.4g} mm on a robot that reaches {1e3 * reach:.4g} mm"
        if length > refused:
            raise LabError(f"{words}; give lengths in mm")
        if length > doubted:
            yield f"{words}; give lengths in mm"


def _of_positions(cell: Cell) -> Iterator[str]:
    """Places that are millimetres from the origin of their frame, as metres under ``_mm`` are."""
    places = {f"obstacle '{each.name}'": each for each in cell.obstacle} | {"[robot]": cell.robot}
    for each in cell.instrument_places:
        places["[instrument]" if each is cell.instrument else f"station '{getattr(each, 'name', '')}'"] = each
    for what, place in places.items():
        if 0 < max(abs(x) for x in place.position_mm) < _NEAR_MM:
            at = ", ".join(f"{x:g}" for x in place.position_mm)
            yield f"{cell.path}: {what}: position_mm is [{at}]; give it in mm, not in metres"


def _of_base(robot: RobotModel, cell: Cell) -> Iterator[str]:
    """Obstacles that hold the origin of the robot's base."""
    data = next(standing(robot, robot.chain.home[None]))
    for name in robot.obstacles:
        depth = _depth(robot.model, data, robot.model.geom(name).id, robot.T_world_frame0[:3, 3])
        if depth > _SWALLOWED_M:
            yield f"{cell.path}: the robot's base is {1e3 * depth:.0f} mm deep in '{name}'; move one of them"


def _of_contacts(robot: RobotModel, cell: Cell, joints: Array) -> Iterator[str]:
    """Obstacles that the arm touches wherever it is."""
    if not len(joints):
        return
    counts = dict.fromkeys(robot.obstacles, 0)
    for data in at_contacts(robot.model, robot.qpos(joints)):
        for geom in np.unique(data.contact.geom):
            if (name := robot.model.geom(int(geom)).name) in counts:
                counts[name] += 1
    for name, count in counts.items():
        clearance_mm = 1e3 * (robot.obstacles[name] or 0.0)
        kept = f", or nearer than its clearance of {clearance_mm:g} mm," if clearance_mm else ""
        words = f"{cell.path}: the arm is in '{name}'{kept} in {count} of {len(joints)} random poses"
        mend = "mend its size, its position, or that of [robot]"
        if count >= _ALWAYS * len(joints):
            raise LabError(f"{words}; {mend}")
        if count >= _MOSTLY * len(joints):
            yield f"{words}; {mend}"


def _of_instrument(robot: RobotModel, cell: Cell, reach: float) -> Iterator[str]:
    """Instruments inside something, at the robot's base, in the arm's way, or far away."""
    if not cell.instrument_places:
        return
    model, data = robot.model, next(standing(robot, robot.chain.home[None]))
    stands = {int(model.site(site).bodyid[0]) for site in robot.station_sites} - {0}
    solid = [
        geom
        for geom in np.flatnonzero(model.geom_contype | model.geom_conaffinity).tolist()
        if int(model.geom_bodyid[geom]) not in stands
    ]
    base = robot.T_world_frame0[:3, 3]
    for name, T in zip(robot.stations or ("",), robot.Ts_world_station, strict=True):
        head, who = T[:3, 3], f"{cell.path}: the instrument{f' at station {name!r}' if name else ''}"
        mend = "its head's position_mm is in mm, in the cell's frame; move it away"
        for geom in solid:
            if _depth(model, data, geom, head) > 0:
                body = int(model.geom_bodyid[geom])
                inside = f"the arm, in {model.body(body).name}" if body else f"'{model.geom(geom).name}'"
                raise LabError(f"{who} stands inside {inside}; {mend}")
        away = float(np.linalg.norm(head - base))
        if away < _AT_BASE_M:
            raise LabError(f"{who} is {1e3 * away:.3g} mm from the robot's base; {mend}")
        if away < _NEAR_BASE_M:
            yield f"{who} is {1e3 * away:.3g} mm from the robot's base; {mend}"
        elif away < _NEAR_REACH * reach:
            yield f"{who} is {1e3 * away:.0f} mm from the robot's base, in the arm's way; {mend}"
        elif away > _FAR_HEAD_M:
            yield f"{who} is {away:.3g} m from the robot's base; give position_mm in mm"


def _of_reach(robot: RobotModel, cell: Cell, reach: float) -> Iterator[str]:
    """Cells of which nothing is in the robot's reach."""
    if not robot.obstacles:
        return
    base, data = robot.T_world_frame0[:3, 3], next(standing(robot, robot.chain.home[None]))
    ids = [robot.model.geom(name).id for name in robot.obstacles]
    gaps = np.linalg.norm(data.geom_xpos[ids] - base, axis=1) - robot.model.geom_rbound[ids]
    if gaps.min() > 2 * reach:
        yield (
            f"{cell.path}: every obstacle is farther away than twice the robot's reach of {1e3 * reach:.0f} mm, the "
            f"nearest by {1e3 * gaps.min():.0f} mm; give positions in mm, in the frame in which [robot] stands"
        )


def _of_joints(cell: Cell) -> Iterator[str]:
    """Limits in degrees that look like radians."""
    for name, limits in cell.joints.items():
        low, high, cable = limits.lower_deg, limits.upper_deg, limits.cable_deg
        left = 2 * cable if cable is not None else None if low is None or high is None else high - low
        if left is not None and left < _NARROW_DEG:
            yield f"{cell.path}: joint {name} is left {left:.3g}° of its range; give limits in degrees, not in radians"


def _depth(model: mujoco.MjModel, data: mujoco.MjData, geom: int, point: Array) -> float:
    """How deep (m) a point is in a shape, along the axes of the world; 0 outside it, and of planes.

    From inside a convex shape a ray leaves it in every direction; from outside, of two opposite ones one misses it.
    """
    kind, depth = int(model.geom_type[geom]), np.inf
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        return 0.0
    for direction in np.concatenate([np.eye(3), -np.eye(3)]):
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            met = mujoco.mj_rayMesh(model, data, geom, point, direction, None)
        else:
            rotation = data.geom_xmat[geom]
            met = mujoco.mju_rayGeom(
                data.geom_xpos[geom], rotation, model.geom_size[geom], point, direction, kind, None
            )
        if met < 0:
            return 0.0
        depth = min(depth, float(met))
    return depth
