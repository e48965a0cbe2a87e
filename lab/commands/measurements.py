"""Measurements read and written, and the frame that they are in."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from lab.campaign.robot import Robot, load_robot
from lab.commands.calibrate.run import MeasurementSession, robot_of
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.formats import measurement_csv
from lab.sensors.registry import sensor_named

__all__ = ["WorldFrames", "read_measurements", "world_frames", "write_measurements"]


class WorldFrames(NamedTuple):
    """Frames of the instrument and of the robot's base in the world of a MuJoCo model.

    Attributes:
        T_world_instrument: pose ``(4, 4)`` (m) of the frame in which points are measured.
        T_world_base: pose ``(4, 4)`` (m) of the nominal robot's base frame (frame 0).
    """

    T_world_instrument: Array
    T_world_base: Array


def read_measurements(
    path: str | Path, robot: str | Path | Robot = "irb120", *, observe: str = "points"
) -> Measurements:
    """Read a measurement file: joint positions (rad or m), and points (m) in the frame that the file has them in.

    Args:
        path: the CSV file.
        robot: whose joints its columns are: a name, a path, or a loaded robot. The measurements remember it.
        observe: which of its columns are the measurements: ``points``, ``pose``, ``cable``, ``socket`` or ``plane``.

    Raises:
        LabError: with the file, the line as an editor counts it, and the column.

    Example:
        >>> import lab, pathlib, tempfile
        >>> day = lab.simulate("irb120", poses=12, seed=7)
        >>> file = pathlib.Path(tempfile.mkdtemp()) / "day.csv"
        >>> lab.write_measurements(file, day.measurements, day.robot)
        >>> len(lab.read_measurements(file, "irb120"))
        12
    """
    known, columns = load_robot(robot), sensor_named(observe).columns
    chain = known.chain
    read = measurement_csv.read_measurements(Path(path), chain.joint_names, chain.prismatic, columns=columns)
    return replace(read, robot=known.source)


def write_measurements(path: str | Path, measurements: Measurements, robot: str | Path | Robot | None = None) -> None:
    """Write measurements as the CSV that ``lab identify`` reads back the same: joints in rad (m of a slide).

    Args:
        path: the file, which is replaced.
        measurements: points in any one frame, in which they are written.
        robot: whose joints are measured, which says which of them slide: a name, a path, or a loaded robot; by default
            the one that the measurements name.

    Raises:
        LabError: the measurements name no robot and none is given, its joints are others, or the file cannot be
            written.

    Example:
        >>> import lab, pathlib, tempfile
        >>> day = lab.simulate("irb120", poses=12, seed=7)
        >>> file = pathlib.Path(tempfile.mkdtemp()) / "day.csv"
        >>> lab.write_measurements(file, day.measurements)
        >>> file.read_text().partition(",")[0]
        'q1_rad'
    """
    known = robot_of("lab.write_measurements", measurements, robot)
    try:
        measurement_csv.write_measurements(Path(path), measurements, known.chain.prismatic)
    except OSError as error:
        raise LabError(f"{path}: cannot be written ({error.strerror}); give another path") from error


def world_frames(of: str | Path | Robot | MeasurementSession) -> WorldFrames:
    """Return the frames of the instrument and of the robot's base in the world of the MuJoCo model.

    Args:
        of: a simulated measurement session, with its instrument's pose then; or a robot (a name, a path, or a
            loaded one), whose instrument is the nominal one that designs are made for.

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
