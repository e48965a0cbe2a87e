"""Backlash of single joints: which groups stand for it, by the columns that there are, and what they do."""

import numpy as np
import pytest
from helpers.robots import IRB120, VERSATRAN

from lab.kinematics.effects.backlash import approached_groups
from lab.kinematics.effects.effect_registry import describe_term, effect


@pytest.mark.parametrize(
    ("joints", "groups"),
    [
        ((), ("backlash",)),
        ((2,), ("joint2.backlash",)),
        ((5, 1), ("joint1.backlash", "joint5.backlash")),
        (range(1, 7), ("backlash",)),
    ],
)
def test_columns_say_of_which_joints(joints: tuple[int, ...], groups: tuple[str, ...]) -> None:
    columns = {f"approach_q{joint}": None for joint in joints} | {"payload_kg": None}
    assert approached_groups(IRB120.chain, columns) == groups


def test_one_joint_is_fitted_as_all_are() -> None:
    every, one = effect("backlash", IRB120.chain, None), effect("joint2.backlash", IRB120.chain, None)
    assert one.conditions == ("approach_q2",) and one.parameters[0].name == "joint2.backlash"
    joints, sides = np.zeros((20, 6)), np.random.default_rng(0).choice([-1.0, 1.0], (20, 6))
    moved, derivative = one.offsets(joints, sides[:, [1]], np.array([3e-4]))
    widths = np.array([0, 3e-4, 0, 0, 0, 0])
    np.testing.assert_array_equal(moved, every.offsets(joints, sides, widths)[0])
    np.testing.assert_array_equal(derivative[..., 0], every.offsets(joints, sides, widths)[1][..., 1])
    assert describe_term("joint2.backlash") == "joint 2 has play" and not describe_term("joint2.backlash3")
    assert effect("joint2.backlash", VERSATRAN, None).parameters[0].unit.si == "m"
