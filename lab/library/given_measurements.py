"""Make measurements and robots of arrays or files, and place their frames in the world."""

import atexit
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.core.se3 import Array
from lab.core.values import ArrowTable, arrow_columns
from lab.extension_points import named_parts
from lab.formats import measurement_csv
from lab.formats.measurement_csv import USES
from lab.formats.orientations import orientation_texts
from lab.formats.robot_toml import ANGLES, LENGTHS, write_table
from lab.kinematics.array_arm import as_numbers
from lab.kinematics.serial.chain import Chain, Convention, parallel_links
from lab.library.measurement_checks import checked, robot_of
from lab.library.simulate import MeasurementSession
from lab.prediction.planned_accuracy import refuse_degrees
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot
from lab.sensors.sensor_registry import sensor_named

__all__ = ["WorldFrames", "measurements", "read_measurements", "robot_from_dh", "world_frames", "write_measurements"]

_AngleUnit = Literal["rad", "deg"]
_LengthUnit = Literal["m", "mm"]
_CALL = "lab.measurements"
_COLUMNS = ("theta", "d", "a", "alpha")
_ROUNDING = 1e-3  # of rotation matrices that were printed


def measurements(
    joints: ArrayLike | Mapping[str, ArrayLike] | ArrowTable,
    points: ArrayLike | None = None,
    *,
    robot: str | Path | Robot,
    unit: _LengthUnit = "m",
    joint_unit: _AngleUnit = "rad",
    targets: Sequence[str] = (),
    orientations: ArrayLike | None = None,
    ids: Sequence[Any] | None = None,
    use: Sequence[str] | None = None,
    sessions: Sequence[str] | None = None,
    sigma: ArrayLike | None = None,
    conditions: Mapping[str, ArrayLike] | None = None,
    columns: Mapping[str, Sequence[Any]] | None = None,
) -> Measurements:
    """Make measurements of arrays, as if they had been read from a file; nothing is written.

    Args:
        joints: ``(n, joints)`` positions, one row a pose: hinges in ``joint_unit``, slides in ``unit``. Without
            points it may be a table with all columns: a mapping of them, or an object with the Arrow C interface
            (pandas, polars, pyarrow), named as in a file (``q1_deg``, ``p1_x_mm``, ``use``) or as ``columns()`` of
            measurements names them (``q1`` in ``joint_unit``, ``p1.x`` in ``unit``).
        points: ``(n, 3)`` or ``(n, targets, 3)`` positions of the targets in the instrument's frame, in ``unit``; NaN
            where a target was not seen. None where no points are observed (cables, sockets, planes).
        robot: whose joints they are: a name, a path, or a loaded robot. The measurements remember it.
        unit: of lengths: ``m`` or ``mm``.
        joint_unit: of hinges: ``rad`` or ``deg``.
        targets: names of the targets; ``p1``, ``p2`` and so on where none are given.
        orientations: ``(n, 3, 3)`` rotations from the first target's frame to the instrument's, NaN where not measured,
            for ``observe="pose"``.
        ids: what each row is called; its number where none are given.
        use: what each row is for: ``calibrate`` (where nothing is given), ``reference``, ``test`` or ``skip``.
        sessions: the session of each row; for ``observe="cable"`` each anchor of the wire is one.
        sigma: standard deviation of a coordinate, one or ``(n,)``, in ``unit``.
        conditions: ``(n,)`` each, by the name of its column in a file: ``payload_kg``, ``temp_C``, ``time_s``, and
            ``cable_mm`` for ``observe="cable"``, in the unit that the name says.
        columns: further columns as texts, ``(n,)`` each: ``station``, and ``location`` and ``socket`` for
            ``observe="socket"`` and ``"plane"``.

    Returns:
        The measurements: joint positions in rad or m, points in m in the instrument's frame.

    Raises:
        LabError: an array has another shape or is not of numbers, a table lacks a column or has a wrong cell, joint
            positions are not finite or in another unit, or points are in another unit.

    Example:
        >>> import lab
        >>> day = lab.simulate("irb120", poses=30, seed=7).measurements
        >>> own = lab.measurements(day.joints, 1e3 * day.points[:, 0], robot="irb120", unit="mm")
        >>> lab.identify(own, instrument="uniform-8um").to_dict()["verdict"]
        'good'
        >>> lab.measurements(own.columns(), robot="irb120") == own
        True
    """
    loaded = load_robot(robot)
    length, _ = _unit("unit", unit, LENGTHS), _unit("joint_unit", joint_unit, ANGLES)
    if points is None and (table := _table(joints)) is not None:
        read = measurement_csv.read_columns(_CALL, table, loaded.chain.joint_names, loaded.chain.prismatic,
                                            (unit, joint_unit))  # fmt: skip
        if len(targets):
            raise LabError(f"{_CALL}: a table names its targets by its columns; leave out targets")
    else:
        read = _of_arrays(loaded, joints, points, (unit, joint_unit), tuple(map(str, targets)))
    n, observed = len(read), points is not None or bool(read.targets)
    texts = {name: _texts(f"columns['{name}']", each, n) for name, each in (columns or {}).items()}
    if orientations is not None:
        texts |= _orientations(read.targets, orientations, n)
    read = replace(
        read,
        ids=read.ids if ids is None else _texts("ids", ids, n),
        use=read.use if use is None else _uses(use, n),
        marked=read.marked or use is not None,
        sessions=read.sessions if sessions is None else _texts("sessions", sessions, n),
        sigma_m=read.sigma_m if sigma is None else length * _column("sigma", sigma, n),
        conditions={
            **read.conditions,
            **{name: _column(f"conditions['{name}']", each, n) for name, each in (conditions or {}).items()},
        },
        other={**read.other, **texts},
    )
    if joint_unit == "rad":
        slides = np.array(loaded.chain.prismatic, dtype=np.bool_)
        refuse_degrees(read.joints[:, ~slides], _CALL, "give joint_unit='deg'")
    return checked(_CALL, read, loaded, points=observed)


def _table(given: object) -> Mapping[str, Any] | None:
    """Return the columns of a table; None for arrays."""
    if isinstance(given, Mapping):
        return given
    return arrow_columns(given) if isinstance(given, ArrowTable) else None


def _of_arrays(
    robot: Robot, joints: Any, points: ArrayLike | None, units: tuple[str, str], targets: tuple[str, ...]
) -> Measurements:
    """Return the measurements of joint positions ``(n, joints)`` and points in units of lengths and angles."""
    length, angle = LENGTHS[units[0]], ANGLES[units[1]]
    positions, size = _numbers("joints", joints), robot.chain.size
    if positions.ndim and not len(positions):
        raise LabError(f"{_CALL}: joints have no rows; give one row of {size} numbers a pose")
    if positions.ndim != 2 or positions.shape[1] != size:
        raise LabError(
            f"{_CALL}: joints have shape {positions.shape}, but robot {robot.name} has {size} joints; give one row of "
            f"{size} numbers a pose"
        )
    if not np.isfinite(positions).all():
        row, joint = np.argwhere(~np.isfinite(positions))[0].tolist()
        raise LabError(f"{_CALL}: joints[{row}, {joint}] is {positions[row, joint]}; give a finite number")
    n = len(positions)
    seen = np.zeros((n, 0, 3)) if points is None else length * _points(points, n)
    names = targets or tuple(f"p{i + 1}" for i in range(seen.shape[1]))
    if len(names) != seen.shape[1] or len(set(names)) != len(names):
        raise LabError(f"{_CALL}: targets are {', '.join(names)}, but points have {seen.shape[1]}; give one name each")
    return measured(robot.chain.joint_names, np.where(robot.chain.prismatic, length, angle) * positions, names, seen)


def robot_from_dh(
    table: ArrayLike,
    *,
    convention: Convention = "distal",
    name: str = "robot",
    unit: _LengthUnit = "m",
    joint_unit: _AngleUnit = "rad",
    prismatic: Sequence[bool] = (),
    limits: ArrayLike | None = None,
    tool: Mapping[str, ArrayLike] | None = None,
    path: str | Path | None = None,
) -> Robot:
    """Make a robot of a Denavit-Hartenberg table.

    Args:
        table: ``(n, 4)``, a row a link: theta, d, a, alpha; angles in ``joint_unit``, lengths in ``unit``. Theta of a
            hinge, and d of a slide, is its offset.
        convention: ``distal`` (Denavit and Hartenberg 1955: d and theta, then a and alpha) or ``craig`` (Craig 1986:
            a and alpha, then d and theta).
        name: of the robot.
        unit: of lengths: ``m`` or ``mm``.
        joint_unit: of angles: ``rad`` or ``deg``.
        prismatic: ``(n,)`` which joints slide; none where nothing is given.
        limits: ``(n, 2)`` the smallest and the largest position of each joint, hinges in ``joint_unit`` and slides in
            ``unit``; ±180° of hinges where nothing is given.
        tool: points on the flange by name, ``(3,)`` in ``unit``: the targets. Where none are given there are three,
            p1 (30, 20, 100), p2 (-25, 30, 80) and p3 (0, -40, 90) mm; ``{"p1": [0, 0, 0]}`` is the origin of the last
            frame.
        path: the TOML file that is written, from which every command and later session can load the robot; where none
            is given, one that is removed as Python ends, so give one for runs that are to be repeated.

    Returns:
        The robot, loaded from the file that was written.

    Raises:
        LabError: the table or another argument has another shape, is not finite, or the file cannot be written.

    Example:
        >>> import lab, numpy as np
        >>> quarter = np.pi / 2
        >>> arm = lab.robot_from_dh([[0, 0.4, 0, quarter], [0, 0, 0.3, 0], [0, 0, 0.2, 0]], tool={"p1": [0, 0, 0.1]})
        >>> arm.name, arm.chain.joint_names
        ('robot', ('q1', 'q2', 'q3'))
    """
    length, angle = _unit("unit", unit, LENGTHS), _unit("joint_unit", joint_unit, ANGLES)
    rows = _numbers("table", table)
    if rows.ndim != 2 or rows.shape[1] != len(_COLUMNS) or not np.isfinite(rows).all():
        raise LabError(
            f"lab.robot_from_dh: the table has shape {rows.shape}; give a row of four finite numbers a link: "
            f"{', '.join(_COLUMNS)}"
        )
    if convention not in get_args(Convention):
        raise LabError(f"lab.robot_from_dh: convention is {convention!r}; give 'distal' or 'craig'")
    rows = np.column_stack([rows * [angle, length, length, angle], np.zeros(len(rows))])
    slides = _flags(prismatic, len(rows))
    lower, upper = _limits(limits, slides, np.where(slides, length, angle))
    none = np.full(len(rows), np.nan)
    chain = Chain(
        name=name,
        joint_names=tuple(f"q{i + 1}" for i in range(len(rows))),
        prismatic=tuple(slides.tolist()),
        sign=np.ones(len(rows)),
        lower=lower,
        upper=upper,
        speed=none,
        acceleration=none,
        convention=convention,
        table=rows,
        parallel=parallel_links(convention, rows[:, 3]),
    )
    points = {str(key): length * _numbers(f"tool['{key}']", each) for key, each in (tool or {}).items()}
    if wrong := [key for key, each in points.items() if each.shape != (3,)]:
        raise LabError(f"lab.robot_from_dh: tool['{wrong[0]}'] has shape {points[wrong[0]].shape}; give three numbers")
    file = Path(tempfile.mkdtemp(dir=_temporary())) / "robot.toml" if path is None else Path(path)
    try:
        file.write_text(write_table(chain, None, points), encoding="utf-8")
    except OSError as error:
        raise LabError(f"{file}: cannot be written ({error.strerror}); give another path") from error
    return load_robot(file)


@cache
def _temporary() -> str:
    """Return the folder of this process for robots without a path, which is removed as it ends."""
    folder = tempfile.mkdtemp(prefix="lab-robots-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def _flags(prismatic: Sequence[bool], n: int) -> NDArray[np.bool_]:
    if len(prismatic) not in (0, n):
        raise LabError(f"lab.robot_from_dh: prismatic has {len(prismatic)} entries; give {n}: one for each link")
    return np.array(prismatic if len(prismatic) else [False] * n, dtype=np.bool_)


def _limits(limits: ArrayLike | None, slides: NDArray[np.bool_], units: Array) -> tuple[Array, Array]:
    """Lower and upper limits ``(n,)`` (rad or m)."""
    if limits is None and slides.any():
        raise LabError("lab.robot_from_dh: a slide needs its limits; give limits, two numbers a link")
    if limits is None:
        return np.full(len(slides), -np.pi), np.full(len(slides), np.pi)
    ends = _numbers("limits", limits)
    if ends.shape != (len(slides), 2) or not (ends[:, 0] < ends[:, 1]).all():
        raise LabError(
            f"lab.robot_from_dh: limits have shape {ends.shape}; give {len(slides)} rows, the lower limit and then the "
            "upper one"
        )
    return ends[:, 0] * units, ends[:, 1] * units


def _unit(argument: str, unit: str, units: Mapping[str, float]) -> float:
    if unit not in units:
        raise LabError(f"{argument} is {unit!r}; give {' or '.join(map(repr, units))}")
    return units[unit]


def _numbers(argument: str, values: ArrayLike) -> Array:
    return as_numbers(argument, values).copy()


def _points(points: ArrayLike, n: int) -> Array:
    """Points as ``(n, targets, 3)``; one target may be ``(n, 3)``."""
    coordinates = _numbers("points", points)
    coordinates = coordinates[:, None, :] if coordinates.ndim == 2 else coordinates
    if coordinates.ndim != 3 or coordinates.shape[0] != n or coordinates.shape[2] != 3:
        raise LabError(
            f"{_CALL}: points have shape {np.shape(points)}; give ({n}, 3) or ({n}, targets, 3): one row for each of "
            f"the {n} poses"
        )
    if (infinite := np.isinf(coordinates).any(axis=(1, 2))).any():
        raise LabError(f"{_CALL}: points[{infinite.argmax()}] is not finite; give NaN where a target was not seen")
    return np.where(np.isnan(coordinates).any(axis=2, keepdims=True), np.nan, coordinates)


def _column(argument: str, values: ArrayLike, n: int) -> Array:
    column = _numbers(argument, values)
    if column.shape not in ((), (n,)):
        raise LabError(f"{_CALL}: {argument} has shape {column.shape}; give one number, or {n}: one for each pose")
    return np.broadcast_to(column, (n,)).copy()


def _texts(argument: str, values: Sequence[Any], n: int) -> tuple[str, ...]:
    texts = tuple(map(str, values))
    if isinstance(values, str) or len(texts) != n:
        raise LabError(f"{_CALL}: {argument} has {len(texts)} entries; give {n}: one for each pose")
    return texts


def _uses(use: Sequence[str], n: int) -> tuple[str, ...]:
    uses = _texts("use", use, n)
    if wrong := set(uses) - set(USES):
        raise LabError(f"{_CALL}: use '{min(wrong)}' is unknown; there are {', '.join(USES)}")
    return uses


def _orientations(targets: tuple[str, ...], orientations: ArrayLike, n: int) -> dict[str, tuple[str, ...]]:
    rotations = _numbers("orientations", orientations)
    if rotations.shape != (n, 3, 3) or not targets:
        raise LabError(
            f"{_CALL}: orientations have shape {rotations.shape}; give ({n}, 3, 3), a rotation matrix for each pose, "
            "and points beside them"
        )
    complete = np.asarray(np.isfinite(rotations).all(axis=(1, 2)), dtype=np.bool_)
    rotations = np.where(complete[:, None, None], rotations, np.eye(3))
    off = np.abs(rotations @ rotations.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2))
    if (wrong := np.flatnonzero((off > _ROUNDING) | (np.linalg.det(rotations) < 0))).size:
        raise LabError(
            f"{_CALL}: orientations[{wrong[0]}] is no rotation matrix; give orthonormal ones of determinant 1"
        )
    return orientation_texts(targets[0], rotations, complete)


class WorldFrames(NamedTuple):
    """Frames of the instrument and of the robot's base in the world of a MuJoCo model.

    Attributes:
        T_world_instrument: pose ``(4, 4)`` (m) of the frame in which points are measured.
        T_world_base: pose ``(4, 4)`` (m) of the nominal robot's base frame (frame 0).
    """

    T_world_instrument: Array
    T_world_base: Array


def read_measurements(
    path: str | Path, robot: str | Path | Robot | None = None, *, observe: str | type = "points"
) -> Measurements:
    """Read a measurement file: joint positions (rad or m), and points (m) in the frame that the file has them in.

    Args:
        path: the CSV file.
        robot: whose joints its columns are: a name, a path, or a loaded robot; by default the one of the run in whose
            folder the file lies. The measurements remember it.
        observe: which of its columns are the measurements: ``points``, ``pose``, ``cable``, ``socket`` or ``plane``;
            or a sensor of your own.

    Returns:
        The measurements of all rows of the file, whatever their ``use``.

    Raises:
        LabError: no robot is given or named; or the file is wrong, with the line as an editor counts it and the column.

    Example:
        >>> import lab, pathlib, tempfile
        >>> day = lab.simulate("irb120", poses=12, seed=7)
        >>> file = pathlib.Path(tempfile.mkdtemp()) / "day.csv"
        >>> lab.write_measurements(file, day.measurements, day.robot)
        >>> len(lab.read_measurements(file, "irb120"))
        12
    """
    loaded = robot_of("lab.read_measurements", path, robot)
    columns = sensor_named(named_parts("observe", observe)).columns
    chain = loaded.chain
    read = measurement_csv.read_measurements(Path(path), chain.joint_names, chain.prismatic, columns=columns)
    return replace(read, robot=loaded.source)


def write_measurements(path: str | Path, measurements: Measurements, robot: str | Path | Robot | None = None) -> None:
    """Write measurements as the CSV that ``lab identify`` reads back the same: joints in rad (m of a slide).

    Args:
        path: the file, which is replaced.
        measurements: points in any one frame, in which they are written.
        robot: whose joints are measured, with their kinds: a name, a path, or a loaded robot; by default
            the one that the measurements name.

    Raises:
        LabError: the arguments are of other types, the measurements name no robot and none is given, its joints are
            others, or the file cannot be written.

    Example:
        >>> import lab, pathlib, tempfile
        >>> day = lab.simulate("irb120", poses=12, seed=7)
        >>> file = pathlib.Path(tempfile.mkdtemp()) / "day.csv"
        >>> lab.write_measurements(file, day.measurements)
        >>> file.read_text().partition(",")[0]
        'q1_rad'
    """
    if not isinstance(path, str | Path) or not isinstance(measurements, Measurements):
        raise LabError(
            f"lab.write_measurements: given {type(path).__name__} and {type(measurements).__name__}; give the path of "
            "the file, then the measurements"
        )
    loaded = robot_of("lab.write_measurements", measurements, robot)
    try:
        measurement_csv.write_measurements(Path(path), measurements, loaded.chain.prismatic)
    except OSError as error:
        raise LabError(f"{path}: cannot be written ({error.strerror}); give another path") from error


def world_frames(of: str | Path | Robot | MeasurementSession) -> WorldFrames:
    """Return the frames of the instrument and of the robot's base in the world of the MuJoCo model.

    Args:
        of: a simulated measurement session, with its instrument's pose then; or a robot (a name, a path, or a
            loaded one), whose instrument is the nominal one that designs are made for.

    Returns:
        Their poses in the world (m).

    Raises:
        LabError: there is no such robot (the message lists all), or it cannot be read.

    Example:
        >>> import lab
        >>> day = lab.simulate("irb120", poses=12, seed=7)
        >>> frames = lab.world_frames(day)
        >>> frames.T_world_instrument.shape, frames.T_world_base.shape
        ((4, 4), (4, 4))
        >>> R, t = frames.T_world_instrument[:3, :3], frames.T_world_instrument[:3, 3]
        >>> in_world = day.measurements.points @ R.T + t  # as MuJoCo has the points, up to what is measured with noise
    """
    if isinstance(of, MeasurementSession):
        return WorldFrames(of.true_robot.T_world_tracker, of.robot.T_world_frame0)
    robot = load_robot(of)
    return WorldFrames(robot.model.T_world_tracker, robot.T_world_frame0)
