"""Touched planes."""

import numpy as np
from helpers.fixture_data import many
from helpers.robots import IRB120, assert_derivatives

from lab.sensors.plane import Planes


def test_a_level_plane_is_no_singularity() -> None:
    rng = np.random.default_rng(0)
    observation = many(Planes, 1)
    values = np.append(observation.nominal_arm, [0.0, 0.0, 0.3])
    inputs = np.column_stack([IRB120.chain.random_joints(5, rng), np.zeros(5)])
    assert_derivatives(lambda v: observation.points(inputs, v), observation.observe(inputs, values)[1], values)
    sizes = np.linalg.svd(observation.observe(inputs, values)[1][:, 0, 0, -3:], compute_uv=False)
    assert sizes[-1] > 0.1
