"""Grübler's count with internal freedoms, of what textbooks count and of every description."""

import numpy as np
import pytest
from helpers.robots import ROOT

from lab.core import se3
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.closed.mobility import BodyCount, body_count, mobility
from lab.robots.load_robot import load_robot

IRB340 = str(ROOT / "models" / "delta" / "irb340.toml")
MECHANISMS = sorted(
    str(path.relative_to(ROOT)) for path in ROOT.glob("models/*/*.toml") if "[[frame]]" in path.read_text()
)


def mechanism_of(path: str) -> Mechanism:
    chain = load_robot(ROOT / path).chain
    assert isinstance(chain, Mechanism)
    return chain


@pytest.mark.parametrize("path", MECHANISMS)
def test_the_count_is_that_of_the_equations(path: str) -> None:
    """Bodies and joints on the one hand; joints, passive values and closures on the other."""
    mechanism = mechanism_of(path)
    tree = mechanism.tree
    assert body_count(tree).mobility == mechanism.size + len(tree.passive) - tree.equations == mechanism.size


def test_the_course_s_delta() -> None:
    """6 x 10 - 6 x 15 + 39 - 6 = 3 (Mallem 2011, section 11.4): without the rods' own turns it would be 9."""
    found = body_count(mechanism_of("models/delta/six_rods.toml").tree)
    assert (found.bodies, len(found.freedoms), sum(found.freedoms), found.internal) == (10, 15, 39, 6)
    assert found.mobility == 3 and mobility(11, found.freedoms) == 9
    assert body_count(mechanism_of("models/rpr3/mechanism.toml").tree) == BodyCount(True, 7, (1,) * 9, 0)
    hexapod = body_count(mechanism_of("models/hexapod/mechanism.toml").tree)
    assert (hexapod.bodies, len(hexapod.freedoms), hexapod.internal, hexapod.mobility) == (13, 18, 6, 6)


def test_the_fourth_axis_turns_the_tool_and_nothing_else() -> None:
    robot, three = load_robot(IRB340), load_robot(ROOT / "models" / "delta" / "small.toml")
    arm, delta = robot.arm(("p1",)), three.arm(("p1",))
    zero = {"p1": np.zeros(3)}
    joints = robot.chain.random_joints(20, np.random.default_rng(0))
    poses, alone = arm.tool(joints, arm.nominal(zero))[0], delta.tool(joints[:, :3], delta.nominal(zero))[0]
    np.testing.assert_allclose(poses[:, :3, 3], alone[:, :3, 3], atol=1e-14)
    turns = se3.exp(joints[:, 3:] * np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(poses[:, :3, :3], turns, atol=1e-12)
