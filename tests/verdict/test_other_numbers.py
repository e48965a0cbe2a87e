"""Points and joint positions in another unit or frame are named by what brings them back onto the arm."""

import numpy as np
import pytest
from helpers.robots import IRB120, somewhere

from lab.kinematics.serial.serial_arm import SerialArm
from lab.verdict.other_numbers import PLACED, in_other_numbers, trimmed_error

CHAIN = IRB120.chain
ARM = SerialArm(CHAIN)
SLIDES = (False,) * 6


@pytest.fixture
def day() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joint positions, points of an arm that stands elsewhere, and the values of the nominal one."""
    rng = np.random.default_rng(4)
    joints = CHAIN.random_joints(30, rng)
    points = ARM.points(joints, somewhere(ARM, rng)) + 1e-4 * rng.normal(size=(30, 1, 3))
    return joints, points, ARM.nominal()


def test_points_and_joints_are_named_by_their_unit_or_frame(day) -> None:
    joints, points, nominal = day
    cases = {
        "unit": [(joints, 1e-3 * points), (joints, points / 25.4), (joints, 1e3 * points)],
        "joint_unit": [(np.deg2rad(joints), points)],
        "mirrored": [(joints, points * [1.0, 1.0, -1.0]), (joints, points[..., [1, 0, 2]])],
    }
    for kind, files in cases.items():
        for inputs, measured in files:
            found = in_other_numbers(ARM, SLIDES, inputs, measured, nominal)
            assert found is not None and found.name == f"situation.{kind}"
            assert found.data["left_m"] < 1e-3
    assert in_other_numbers(ARM, SLIDES, joints, points, nominal) is None
    assert in_other_numbers(ARM, SLIDES, joints, np.random.default_rng(1).permutation(points), nominal) is None


def test_a_few_bad_readings_do_not_hide_what_the_others_show(day) -> None:
    joints, points, nominal = day
    assert trimmed_error(ARM, joints, points, nominal, PLACED) < 5e-4
    off = points.copy()
    off[:5] += 10.0
    assert trimmed_error(ARM, joints, off, nominal, PLACED) < 5e-4
    assert trimmed_error(ARM, joints, points[::-1], nominal, PLACED) > 0.05
    assert np.isinf(trimmed_error(ARM, joints[:3], points[:3], nominal, PLACED))
