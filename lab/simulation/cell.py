"""A robot's model in its cell: with what stands around it, what it carries, its limits, and its instrument's place."""

import warnings
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import mujoco
import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.cell_toml import Cell, Obstacle
from lab.formats.link_tree import free_name
from lab.simulation.collisions import collisions_in_words
from lab.simulation.meshes import VISUAL_GROUP
from lab.simulation.model import (
    TRACKER,
    RobotModel,
    at_zero,
    body_pose,
    compiled,
    flange_body,
    station_suffixed,
)
from lab.simulation.serial_model import SerialModel, last_frame

__all__ = ["in_cell"]

Model = TypeVar("Model", bound=RobotModel)
_OBSTACLE_RGBA, _PLATE_RGBA = (0.45, 0.55, 0.65, 1.0), (0.58, 0.60, 0.64, 1.0)
_REFLECTOR_M = 0.01905  # radius of a 1.5-inch reflector
_MESHES = (".stl", ".obj")


def in_cell(robot: Model, cell: Cell) -> Model:
    """A copy of a robot's model with what its cell says.

    The robot stays where it is in its model; what the cell has is put about it, gravity too where the robot is tilted.

    Raises:
        LabError: the robot has no such joints, a file cannot be read, or the arm touches something at the home that
            the cell says.
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
    chain = replace(robot.chain, lower=lower, upper=upper, said_home=home)
    acceptance = robot.acceptance_rad if cell.reflector is None else float(np.deg2rad(cell.reflector.degrees))
    model = compiled(cell.path, spec)
    stations = tuple(each.name for each in cell.station)
    placed = replace(
        robot, spec=spec, model=model, chain=chain, tool=tool, acceptance_rad=acceptance, stations=stations,
        obstacles=obstacles, plates=plates,
    )  # fmt: skip
    if home is not None:
        if (beyond := np.flatnonzero(chain.beyond_limits(home[None], 1e-9)[0])).size:
            raise LabError(f"{cell.path}: [home]: {chain.said_beyond(int(beyond[0]), home[beyond[0]])}; start within")
        if touches := collisions_in_words(placed, home[None])[0]:
            raise LabError(f"{cell.path}: [home]: {touches} there; start elsewhere, or move that")
    return placed


def _carried(robot: RobotModel, shapes: "_Shapes", cell: Cell) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Put the cell's plates and tool points onto the flange.

    Returns:
        The tool points (m, in the last frame) that there are, and the names of the plates' shapes.
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
    taken = {site.name for site in spec.sites}
    for point in cell.tool:
        if point.name in taken:
            raise LabError(f"{cell.path}: tool point '{point.name}': the model has a site of that name; rename it")
        T = T_body_last @ se3.pose(point.rotation, point.position)
        size = (_REFLECTOR_M, 0.0, 0.0)
        body.add_site(name=point.name, pos=T[:3, 3], quat=se3.quaternion_from_rotation(T[:3, :3]), size=size)
    return {point.name: point.position for point in cell.tool}, plates


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
            kind, size = mujoco.mjtGeom.mjGEOM_CYLINDER, [shape.radius_mm / 1e3, shape.height_mm / 2e3, 0.0]
        mesh = {}
        if shape.shape == "mesh":
            kind, size = mujoco.mjtGeom.mjGEOM_MESH, [0.0, 0.0, 0.0]
            mesh["meshname"] = self._add_mesh(shape)
        name = free_name(shape.name, self._taken)
        self._taken.add(name)
        body.add_geom(
            name=name, type=kind, size=size, pos=T[:3, 3], quat=se3.quaternion_from_rotation(T[:3, :3]), rgba=rgba,
            margin=clearance_m, contype=1, conaffinity=1, group=self._group, mass=0.0, **mesh,
        )  # fmt: skip
        return name

    def _add_mesh(self, shape: Obstacle) -> str:
        """The name of a shape's mesh in the model, to which each file is added once."""
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
        site.pos, site.quat = T_world_tracker[:3, 3], se3.quaternion_from_rotation(T_world_tracker[:3, :3])
        return
    T = _stand_pose(robot, T_world_tracker)
    stand.pos, stand.quat = T[:3, 3], se3.quaternion_from_rotation(T[:3, :3])


def _add_station(robot: RobotModel, spec: mujoco.MjSpec, name: str, T_world_station: Array) -> None:
    """A copy of the body that carries the tracker's head, at a further station; of the head alone without a body."""
    if int(robot.model.site(TRACKER).bodyid[0]) == 0:
        quat = se3.quaternion_from_rotation(T_world_station[:3, :3])
        spec.worldbody.add_site(name=station_suffixed(TRACKER, name), pos=T_world_station[:3, 3], quat=quat)
        return
    T, spec.copy_during_attach = _stand_pose(robot, T_world_station), True
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # MuJoCo's is about names without a prefix: these have a suffix
        stand = spec.worldbody.add_frame().attach_body(spec.site(TRACKER).parent, "", station_suffixed("", name))
    stand.pos, stand.quat = T[:3, 3], se3.quaternion_from_rotation(T[:3, :3])


def _stand_pose(robot: RobotModel, T_world_head: Array) -> Array:
    """World pose ``(4, 4)`` of the body that carries the tracker, where its head is to be at this one."""
    body = int(robot.model.site(TRACKER).bodyid[0])
    T_body_site = se3.inverse(body_pose(at_zero(robot.model), body)) @ robot.T_world_tracker
    return T_world_head @ se3.inverse(T_body_site)
