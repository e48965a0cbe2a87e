"""Nested cross-validation by regions: its parts, and its bounds on a rigid arm, of which nothing is worse beyond."""

import numpy as np
from extrapolation import splits
from helpers.robots import IRB120

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
