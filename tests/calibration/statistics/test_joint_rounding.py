"""Joint positions that a file rounds."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120

from lab.calibration.statistics.joint_rounding import rounding
from lab.core.measurements import measured
from lab.kinematics.serial.serial_arm import SerialArm

ARM = SerialArm(IRB120.chain)
NAMES = IRB120.chain.joint_names


def test_readings_that_are_not_rounded_have_no_limit() -> None:
    rng = np.random.default_rng(0)
    joints = IRB120.chain.random_joints(40, rng)
    data = measured(NAMES, joints, ("p1",), ARM.points(joints, ARM.nominal()))
    assert rounding(ARM, data, ARM.nominal()) is None
    step = np.deg2rad(0.5)
    rounded = replace(data, joints=step * np.round(joints / step))
    found = rounding(ARM, rounded, ARM.nominal())
    assert found is not None and found.step_rad == pytest.approx(step)
    made = np.linalg.norm(ARM.points(rounded.joints, ARM.nominal()) - data.points, axis=2)
    assert found.rms_m == pytest.approx(np.sqrt((made**2).mean()), rel=0.3)
