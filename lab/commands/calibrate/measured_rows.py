"""Measurements read from a file or given in memory, and whether those in memory can be the robot's."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from lab.calibration.identify import spread
from lab.campaign.robot import Robot, load_robot
from lab.commands.calibrate.options import MeasuredCampaign
from lab.commands.hand_load import HandLoad
from lab.core.copies import without_copies
from lab.core.errors import LabError
from lab.core.measurements import Measurements, setups, thinned
from lab.formats.measurement_csv import read_measurements
from lab.sensors.registry import sensor_named

__all__ = ["checked", "read_rows", "robot_of"]

ANOTHER_UNIT = 100.0  # times as far as the robot's points: mm taken for m are a thousand
LEAST_SPREAD_M = 1.0  # no error of a robot is as large
LEAST_ROWS = 3
_SPREAD_OF = 4_000  # of more poses the spread of so many is as good


def robot_of(call: str, data: Measurements, robot: str | Path | Robot | None) -> Robot:
    """The robot of measurements in memory: the given one, else the one whose name they have.

    Args:
        call: what an error calls the call.
        data: the measurements.
        robot: a name, a path, or a loaded robot; None where the measurements are to say it.

    Raises:
        LabError: neither says which robot it is, it cannot be loaded, or its joints are others.
    """
    if robot is None and not data.robot:
        raise LabError(f"{call}: the measurements do not say of which robot they are; give robot=")
    known = load_robot(data.robot if robot is None else robot)
    _refuse_other_joints(call, data, known)
    return known


def _refuse_other_joints(what: str | Path, data: Measurements, robot: Robot) -> None:
    """A LabError for measurements in memory whose joints are not the robot's: by number, name, or type where known."""
    chain, names = robot.chain, data.joint_names
    plain = tuple(f"q{j + 1}" for j in range(chain.size))
    if len(names) != chain.size or (names != chain.joint_names and plain not in (names, chain.joint_names)):
        raise LabError(
            f"{what}: joints {', '.join(names)} were measured, but robot {robot.name} has "
            f"{', '.join(chain.joint_names)}; take the right robot"
        )
    slides = chain.prismatic if data.robot in ("", robot.source) else _slides(data.robot)
    if slides is not None and tuple(slides) != tuple(chain.prismatic):
        j = [a == b for a, b in zip(slides, chain.prismatic, strict=True)].index(False)
        kinds = ("a slide", "revolute") if slides[j] else ("revolute", "a slide")
        raise LabError(
            f"{what}: joint {names[j]} is {kinds[0]} of robot {data.robot}, which was measured, but {kinds[1]} of "
            f"robot {robot.name}; take the right robot"
        )


def read_rows(
    robot: Robot, path: Path, options: MeasuredCampaign, load: HandLoad | None, given: Measurements | None = None
) -> Measurements:
    """The rows of a file, or those given in memory, with what the robot carries there.

    Args:
        robot: whose they are.
        path: of the file; of rows in memory what an error calls them.
        options: what is observed, and how.
        load: what the robot carries; None for nothing.
        given: the rows in memory; None where the file is to be read.

    Raises:
        LabError: the file cannot be read, rows in memory cannot be the robot's, joints are impossible, or next to
            nothing but copied rows is left.
    """
    chain, sensor = robot.chain, sensor_named(options.observe)
    positions = sensor.in_instrument_frame
    if given is None:
        read = read_measurements(path, chain.joint_names, chain.prismatic, columns=sensor.columns)
        read = replace(read, robot=robot.source)
    else:
        read = checked(path, given, robot, points=positions)
    robot.refuse_impossible(path, read.take([i for i, use in enumerate(read.use) if use != "skip"]))
    read = without_copies(path, read) if positions else read
    return read if load is None else load.weighed(read)


def checked(what: str | Path, data: Measurements, robot: Robot, *, points: bool = True) -> Measurements:
    """Measurements in memory, as those of a robot.

    Args:
        what: what an error calls them.
        data: joint positions (rad or m) and points (m).
        robot: whose they are to be.
        points: whether points are observed.

    Raises:
        LabError: the joints are not the robot's, or the points spread so much further than the robot's that they are
            in another unit.
    """
    _refuse_other_joints(what, data, robot)
    if points:
        _refuse_another_unit(what, data, robot)
    return replace(data, robot=robot.source)


def _slides(robot: str) -> tuple[bool, ...] | None:
    """Which joints of a robot slide; None where it is no longer there to say so."""
    try:
        return load_robot(robot).chain.prismatic
    except LabError:
        return None


def _refuse_another_unit(what: str | Path, data: Measurements, robot: Robot) -> None:
    some = thinned(data.take(np.flatnonzero(data.seen.any(axis=1) & (np.array(data.use) != "skip"))), _SPREAD_OF)
    arm, ratios = robot.arm(data.targets), list[float]()
    predicted = arm.points(some.joints, arm.nominal(robot.tool))
    predicted = np.where(np.isnan(some.points), np.nan, predicted)
    placed = setups(some)
    for each in dict.fromkeys(placed):  # each in a frame of its own
        rows = [i for i, setup in enumerate(placed) if setup == each]
        measured_m, robot_m = spread(some.points[rows]), spread(predicted[rows])
        if len(rows) >= LEAST_ROWS and measured_m > LEAST_SPREAD_M:
            ratios.append(measured_m / max(robot_m, 1e-9))
    if ratios and (times := float(np.median(ratios))) > ANOTHER_UNIT:
        raise LabError(
            f"{what}: the points spread {times:,.0f} times as far as the robot's do in these poses; points in memory "
            "are in m: divide them by 1000 if they are in mm"
        )
