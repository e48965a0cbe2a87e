"""Measured points."""

import numpy as np
from helpers.robots import IRB120

from lab.calibration.observation import Points, observation_of
from lab.core.measurements import measured
from lab.kinematics.serial.arm import SerialArm
from lab.sensors.points import PointSensor

ARM = SerialArm(IRB120.chain)
NAMES = IRB120.chain.joint_names


def test_points_are_left_as_they_are() -> None:
    data = measured(NAMES, np.zeros((1, 6)), ("p1",), np.zeros((1, 1, 3)))
    model, same = PointSensor().observation(ARM, data, ARM.nominal())
    assert model is ARM and same is data and isinstance(observation_of(ARM), Points)


def test_a_row_without_a_measured_target_is_none() -> None:
    points = np.zeros((3, 2, 3))
    points[0], points[1, 0] = np.nan, np.nan
    data = measured(NAMES, np.zeros((3, 6)), ("p1", "p2"), points)
    assert PointSensor().rows(data).tolist() == [False, True, True] and PointSensor().targets(data) == ("p1", "p2")
