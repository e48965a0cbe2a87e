"""Nested cross-validation by regions: its parts, and its bounds on a rigid arm, of which nothing is worse beyond."""

import numpy as np
import pytest
from extrapolation import cross_validated, splits
from helpers.robots import IRB120

from lab.core.measurements import measured

TURNING = np.ones(6, dtype=bool)


def test_every_part_is_a_region_of_its_own() -> None:
    joints = IRB120.chain.random_joints(200, np.random.default_rng(0))
    parts = splits(joints, TURNING, "regions", 5, 0.1)
    assert (np.sum(parts, axis=0) == 1).all() and all(part.sum() >= 20 for part in parts)
    for part in parts:  # a box that no pose of another part is in
        low, high = joints[part].min(axis=0), joints[part].max(axis=0)
        assert not ((joints[~part] >= low) & (joints[~part] <= high)).all(axis=1).any()
    beyond = splits(joints, TURNING, "beyond", 5, 0.1)
    assert [int(part.sum()) for part in beyond] == [20] * 6
    assert joints[beyond[2], 1].max() < joints[~beyond[2], 1].min()
    assert (np.sum(splits(joints, TURNING, "random", 5, 0.1), axis=0) == 1).all()


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["regions", "beyond"])
def test_bounds_hold_on_a_rigid_arm(kind: str) -> None:
    rng = np.random.default_rng(1)
    joints, arm = IRB120.chain.random_joints(120, rng), IRB120.arm(("p1",))
    points = arm.points(joints, arm.nominal(IRB120.tool)) + 2e-5 * rng.standard_normal((120, 1, 3))
    data = measured(IRB120.chain.joint_names, joints, ("p1",), points)
    found = cross_validated(IRB120, data, "geometric", splits(joints, TURNING, kind, 3, 0.1))
    assert found["within_bounds"] > 0.88 and found["max_mm"] < 0.5
