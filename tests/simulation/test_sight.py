"""Rays in a cell: what the arm hides."""

import numpy as np
from helpers.robots import IRB120

from lab.simulation.robot_model import SerialModel
from lab.simulation.sight import unhidden


def test_points_behind_the_arm_are_hidden_and_those_before_it_are_not() -> None:
    robot = IRB120.model
    assert isinstance(robot, SerialModel)
    rest = np.zeros((2, 6))
    origins = np.array([[2.0, 0.0, 0.3], [2.0, 3.0, 0.3]])
    points = np.array([[[1.5, 0.0, 0.3], [-2.0, 0.0, 0.3]], [[-2.0, 3.0, 0.3], [np.nan, 0.0, 0.3]]])
    np.testing.assert_array_equal(unhidden(robot, rest, origins, points), [[True, False], [True, False]])
