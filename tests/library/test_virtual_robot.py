"""A virtual robot from its options: each of its parts has a stream of its own."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120

from lab.library.virtual_arm import fresh_poses, perturbed_arm, poses_to_measure
from lab.options.virtual_campaign import VirtualCampaign

OPTIONS = VirtualCampaign(seed=3, poses=8)


def test_more_poses_change_neither_the_arm_nor_the_first_poses() -> None:
    more = replace(OPTIONS, poses=12)
    few, many = (poses_to_measure(IRB120, options)[0] for options in (OPTIONS, more))
    np.testing.assert_array_equal(few, many[:8])
    reals = perturbed_arm(IRB120, OPTIONS), perturbed_arm(IRB120, more)
    np.testing.assert_array_equal(*(real.points(few, ("p1",)) for real in reals))


def test_validation_poses_are_apart_from_the_measured_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lab.library.virtual_arm.FRESH_POSES", 20)
    real = perturbed_arm(IRB120, OPTIONS)
    fresh = fresh_poses(real, OPTIONS, ())
    assert len(fresh) == 20 and not np.isin(fresh.joints, poses_to_measure(IRB120, OPTIONS)[0]).any()
    np.testing.assert_array_equal(fresh.points, real.points(fresh.joints, ("p1",)))
