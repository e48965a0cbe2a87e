"""Check measurements in memory: whose robot they are, its joints, and their unit."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from lab.calibration.identification import spread
from lab.core.errors import LabError
from lab.core.measurements import Measurements, setups, thinned
from lab.prediction.planned_accuracy import refuse_degrees
from lab.robots.config_file import robot_of_file
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot

__all__ = ["checked", "robot_of"]

_UNITS_PER_M = {"mm": 1000.0, "cm": 100.0, "inches": 39.37}
_NEAR_A_UNIT = 1.25  # factor within which a ratio is that of a unit
_ANOTHER_UNIT = 100.0  # a ratio above is that of another unit, whichever
_LEAST_SPREAD_M = 1.0  # no error of a robot is as large
_LEAST_ROWS = 3
_SPREAD_OF = 4_000  # of more poses the spread of so many is as good


def robot_of(call: str, data: Measurements | str | Path, robot: str | Path | Robot | None) -> Robot:
    """Return the robot of measurements in memory or of a file: the given one, else the one that they name.

    A file names the robot of the run in whose folder it lies.

    Raises:
        LabError: neither names a robot, it cannot be loaded, or its joints are others; it begins with ``call``.
    """
    if not isinstance(data, Measurements):
        if not isinstance(data, str | Path):
            raise LabError(
                f"{call}: measurements are given as {type(data).__name__}; give a file, or make them by "
                "lab.measurements(joints, points, robot=...)"
            )
        named = robot_of_file(Path(data)) if robot is None else robot
        if named is None:
            raise LabError(f"{call}: {data} names no robot; give robot=")
        return load_robot(named)
    if robot is None and not data.robot:
        raise LabError(f"{call}: the measurements name no robot; give robot=")
    loaded = load_robot(data.robot if robot is None else robot)
    _refuse_other_joints(call, data, loaded)
    return loaded


def checked(what: str | Path, data: Measurements, robot: Robot, *, points: bool = True) -> Measurements:
    """Return measurements in memory as those of a robot, where they can be.

    Raises:
        LabError: there are no rows, the joints are not the robot's or are in degrees, or the points spread so much
            further than the robot's that they are in another unit; it begins with ``what``.
    """
    if not len(data):
        raise LabError(f"{what}: the measurements have no rows; give some")
    _refuse_other_joints(what, data, robot)
    slides = np.array(robot.chain.prismatic, dtype=np.bool_)
    refuse_degrees(data.joints[:, ~slides], str(what), "joints in memory are in rad: give np.deg2rad(joints)")
    if points:
        _refuse_another_unit(what, data, robot)
    return data if data.robot == robot.source else replace(data, robot=robot.source)


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


def _slides(robot: str) -> tuple[bool, ...] | None:
    """Return which joints of a robot are prismatic; None if the robot can no longer be loaded."""
    try:
        return load_robot(robot).chain.prismatic
    except LabError:
        return None


def _refuse_another_unit(what: str | Path, data: Measurements, robot: Robot) -> None:
    some = thinned(data[data.seen.any(axis=1) & (np.array(data.use) != "skip")], _SPREAD_OF)
    arm, ratios = robot.arm(data.targets), list[float]()
    predicted = arm.points(some.joints, arm.nominal(robot.tool))
    predicted = np.where(np.isnan(some.points), np.nan, predicted)
    placed = setups(some)
    for each in dict.fromkeys(placed):  # each in a frame of its own
        rows = [i for i, setup in enumerate(placed) if setup == each]
        measured_m, robot_m = spread(some.points[rows]), spread(predicted[rows])
        if len(rows) >= _LEAST_ROWS and measured_m > _LEAST_SPREAD_M:
            ratios.append(measured_m / max(robot_m, 1e-9))
    if not ratios:
        return
    times = float(np.median(ratios))
    unit, factor = min(_UNITS_PER_M.items(), key=lambda each: abs(np.log(times / each[1])))
    near = max(times / factor, factor / times) <= _NEAR_A_UNIT
    if near or times > _ANOTHER_UNIT:
        remedy = f"divide them by {factor:g}, since they are in {unit}" if near else "convert them"
        raise LabError(
            f"{what}: the points spread {times:,.0f} times as far as the robot's do in these poses; points in memory "
            f"are in m: {remedy}"
        )
