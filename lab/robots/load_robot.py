"""Load a robot by name or path: a folder of ``models``, an MJCF, a URDF, a table, or a mechanism."""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from os import PathLike, fspath
from pathlib import Path

from lab.core.errors import LabError, error_context, option_name
from lab.formats.mechanism_toml import read_mechanism
from lab.formats.robot_toml import described_links, is_mechanism, links_of, read_table
from lab.kinematics.dynamics.gravity import refuse_without_length
from lab.robots.config_file import CONFIG_FILE
from lab.robots.robot import ClosedRobot, Robot, SerialRobot, TreeRobot
from lab.robots.robot_files import description_of, ends_of, is_own, joined, parted, sha256_of
from lab.simulation.build_serial import table_model
from lab.simulation.cell import in_cell
from lab.simulation.closed_robot import closed_model
from lab.simulation.load_model import load_model, loads_of
from lab.simulation.robot_model import Origin, RobotModel, SerialModel, TreeModel
from lab.simulation.robot_plausibility import implausible_robot

__all__ = ["load_robot", "load_virtual", "robot_of_call"]


def load_robot(
    robot: str | PathLike[str] | Robot, cell: Path | None = None, *, tips: Sequence[str] = (), base: str = ""
) -> Robot:
    """Load a robot: its nominal model, masses and warnings.

    Args:
        robot: the name of a model of the lab; a path to an MJCF, a URDF, or a TOML table or mechanism; or the folder
            of a run of ``lab identify`` or ``lab calibrate``, or what ``lab.load_run`` made of it, for its calibrated
            robot (geometry alone). A loaded robot is unchanged.
        cell: the file that describes its cell, if any.
        tips: of an MJCF or a URDF: the bodies, links or sites that are the ends of its chains. One makes a serial arm,
            several a robot with several tips, whose targets are ``<tip>.p1`` and so on. By default the only chain, or
            every site ``<tip>.flange``.
        base: the body or link below the first joint; joints that move it are held at zero.

    Returns:
        The robot, with warnings on its files.

    Raises:
        LabError: there is no such robot, or it or its cell cannot be read.

    Example:
        >>> import lab
        >>> robot = lab.load_robot("irb120")
        >>> robot.name, len(robot.chain.joint_names)
        ('irb120', 6)
    """
    if isinstance(robot, Robot):
        if tips or base:
            raise LabError(f"robot {robot.name} is loaded already; name its tips where it is loaded")
        return robot.placed_in(cell)
    if not isinstance(robot, str | PathLike):
        raise LabError(f"a robot is given as {type(robot).__name__}; give a name, a path, or a loaded robot")
    source = joined(fspath(robot), base, tips)
    if (Path(source) / CONFIG_FILE).is_file():
        source = _calibrated(Path(source))
    loaded = _loaded(source)
    origin = replace(loaded.model.origin, source=source)
    return replace(loaded, model=replace(loaded.model, origin=origin)).placed_in(cell)


def robot_of_call(call: str, data: object, robot: str | Path | Robot | None) -> Robot:
    """Return the robot that a call was given for measured data; without data the default ``irb120``.

    Raises:
        LabError: data are given without a robot, or it cannot be loaded.
    """
    if robot is None and data is not None:
        raise LabError(f"{call}: {data} names no robot; give robot=")
    return load_robot("irb120" if robot is None else robot)


def _calibrated(run: Path) -> str:
    """Return the path of the calibrated robot in a run's folder."""
    for name in ("calibrated.toml", "calibrated.xml"):
        if (run / name).is_file():
            return str(run / name)
    raise LabError(f"{run}: holds no calibrated robot; give the folder of a run of lab identify or lab calibrate")


def _load_again(origin: Origin) -> RobotModel:
    """Load the model of a pickled robot; refuse missing or changed files."""
    loaded = load_robot(origin.source)
    if loaded.sha256 != origin.sha256:
        raise LabError(f"{origin.source}: the robot's files changed since it was pickled; load it anew")
    return loaded.model if origin.cell is None else in_cell(loaded.model, origin.cell)


def _loaded(robot: str) -> Robot:
    name, ends = parted(robot)
    path = description_of(name)
    digest = sha256_of(path)
    if ends:
        digest = hashlib.sha256(f"{digest} {ends}".encode()).hexdigest()
    return (_read_once if is_own(path) else _read)(path, digest, ends)


def _read(path: Path, sha256: str, ends: str = "") -> Robot:
    """Read a description, whose digest is known, with the ends of its chains if they are given."""
    if path.suffix != ".toml":
        robot = _of_model_file(path, ends)
    elif ends:
        raise LabError(
            f"{path}: is a table, whose tips are its own; leave out {option_name('tip')} and {option_name('base')}"
        )
    elif (links := described_links(path)) is not None:
        return _with_links(path, sha256, *links)
    elif is_mechanism(path):
        described = read_mechanism(path)
        robot = ClosedRobot(closed_model(path, described), described.warnings)
    else:
        table = read_table(path)
        robot = _serial(path, table_model(path, table), table.warnings)
    return _from_files(robot, path, sha256)


def _of_model_file(path: Path, ends: str) -> Robot:
    """Read an MJCF or a URDF."""
    base, tips = ends_of(ends)
    model = load_model(path, tips, base)
    warnings = (f"{model.missing}, so no shape is shown",) if model.missing else ()
    if model.overlapping:
        pairs = ", ".join(f"{first} and {second}" for first, second in model.overlapping)
        warnings = (*warnings, f"{pairs} touch by construction: their contacts are not checked")
    if model.fixed_joints:
        why = "move no tip, or the base: they are" if ends else "are taken for a gripper's, and"
        warnings = (*warnings, f"{', '.join(model.fixed_joints)} {why} held at zero")
    chains = model.chain.chains if isinstance(model, TreeModel) else (model.chain,)
    warnings = (*warnings, *implausible_robot(chains, str(path)))
    return TreeRobot(model, warnings) if isinstance(model, TreeModel) else _serial(path, model, warnings)


def _serial(path: Path, model: SerialModel, warnings: tuple[str, ...]) -> SerialRobot:
    """Return a serial arm with its masses, if the file gives them."""
    robot = SerialRobot(model, warnings)
    if model.links is not None:
        with error_context(path):
            refuse_without_length(loads_of(model), model.links)
    return robot if model.masses_assumed else replace(robot, loads=robot.simulated_loads())


def _from_files(robot: Robot, path: Path, sha256: str) -> Robot:
    origin = Origin(str(path), sha256, load=_load_again)
    return replace(robot, model=replace(robot.model, origin=origin))


_read_once = cache(_read)  # by digest: robots are immutable


def _with_links(path: Path, sha256: str, base: str, sections: object) -> Robot:
    beside = path.parent / base if (path.parent / base).is_file() else Path(base)
    if beside.suffix == ".toml" and beside.is_file() and described_links(beside) is not None:
        raise LabError(f"{path}: robot {base} names another robot in its turn; give that one")
    loaded = _loaded(str(beside))
    with error_context(path):
        model = loaded.serial_model
        if model.links is not None:
            raise LabError(f"robot {base} has [[link]] sections of its own; change those")
    links = links_of(path, sections, model.chain.size)
    both = hashlib.sha256(f"{loaded.sha256} {sha256}".encode()).hexdigest()
    model = replace(model, links=links)
    with error_context(path):
        refuse_without_length(loads_of(model), links)
    loads = None if loaded.loads is None else loads_of(model)
    return _from_files(replace(loaded, model=model, loads=loads), path, both)


def load_virtual(robot: str | Path | Robot, cell: Path | None = None) -> Robot:
    """Load a robot for a virtual arm: missing shapes and masses are assumed, with a warning.

    Raises:
        LabError: it cannot be loaded, or meshes that it needs cannot be read.
    """
    loaded = load_robot(robot, cell)
    if loaded.model.missing:
        raise LabError(f"{loaded.model.missing}, but a virtual arm needs them: add them, or remove what needs them")
    assumed = (f"robot {loaded.name}: {loaded.model.assumed}",) if loaded.model.assumed else ()
    warnings = tuple(dict.fromkeys((*loaded.warnings, *assumed)))
    return replace(loaded, loads=loaded.simulated_loads(), warnings=warnings)
