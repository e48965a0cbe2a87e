"""Poses of many arms at once are those of each."""

import numpy as np
from helpers.robots import RX130
from pose_batches import MeasuredPoses, StackedPoseArm, fit_poses

from lab.kinematics.serial.serial_arm import SerialArm


def test_without_noise_identifiable_parameters_are_found() -> None:
    arm, rng = StackedPoseArm(SerialArm(RX130, ("p1",))), np.random.default_rng(0)
    names = ("base.x", "base.y", "base.z", "base.rx", "base.ry", "base.rz", "tool.p1.x", "tool.p1.y", "tool.p1.z")
    free, start = arm.columns(names), np.tile(arm.nominal(), (3, 1))
    truth = start.copy()
    truth[:, free] += 1e-3 * rng.standard_normal((3, len(free)))
    joints = RX130.random_joints(3 * 12, rng).reshape(3, 12, 6)
    exact = MeasuredPoses(joints, *arm.poses(joints, truth))
    found = fit_poses(arm, exact, start, free, position_weight=1.0, rotation_weight=np.asarray(1.0))
    assert found.converged.all() and len(exact) == 3 and len(exact.take(np.array([0, 2]))) == 2
    np.testing.assert_allclose(found.values, truth, atol=1e-10)
