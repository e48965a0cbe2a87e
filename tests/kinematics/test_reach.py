"""The reach of a nominal arm: no pose within the limits is farther from axis 1, and one is as far."""

import numpy as np
from helpers.robots import IRB120

from lab.kinematics.reach import reach_from_axis
from lab.kinematics.serial.serial_arm import SerialArm


def test_no_pose_is_farther_than_the_reach() -> None:
    arm = SerialArm(IRB120.chain)
    joints = IRB120.chain.random_joints(20_000, np.random.default_rng(0))
    places = arm.flange(joints, arm.nominal())[:, :2, 3]
    farthest, reach = np.linalg.norm(places, axis=1).max(), reach_from_axis(IRB120.chain)
    assert 0.97 * reach < farthest <= reach
