"""Links drawn as they bend: where the arm's equations put their ends, as a beam between, larger by the factor."""

import numpy as np
from helpers.robots import IRB120

from lab.extensions.robotics.trajectory.path_errors import bent_links
from lab.kinematics.dynamics.gravity import link_loads


def test_lines_end_where_the_deformed_arm_has_its_frames() -> None:
    """At factor 1, joints and links giving way: each line ends where the next begins, the last at the flange."""
    assert IRB120.loads is not None
    rng, links = np.random.default_rng(0), link_loads(IRB120.loads)
    joints, sag = IRB120.chain.random_joints(4, rng), 1e-2 * rng.normal(size=(4, 6))
    torsors = {link: 1e-2 * rng.normal(size=(4, 6)) for link in (1, 3)}
    lines = bent_links(links, joints, sag, torsors, 1.0)
    assert sorted(lines) == [0, 1, 2, 3, 5]  # link 5 has no length
    arm = IRB120.serial_arm(("p1",))
    Ts = arm.tool(joints + sag, arm.nominal({"p1": np.zeros(3)}), 0, torsors)[0]
    np.testing.assert_allclose(lines[5][:, -1], Ts[:, :3, 3], atol=1e-12)
    np.testing.assert_allclose(lines[1][:, -1], lines[2][:, 0], atol=1e-12)
    rigid = bent_links(links, joints, sag, torsors, 0.0)
    np.testing.assert_allclose(rigid[0], lines[0], atol=0.02)
    assert np.abs(rigid[5] - lines[5]).max() > 1e-3


def test_a_link_between_its_ends_is_a_loaded_beam() -> None:
    """Under a force at its end: F (3 L x^2 - x^3) / 6EI, times the factor; the clamped end has no slope."""
    assert IRB120.loads is not None
    links = link_loads(IRB120.loads)
    length = links.ends[1][0]
    end, slope, still = 2e-4, 2e-4 * 3 / (2 * length), np.zeros((1, 6))
    torsors = {1: np.array([[0.0, end, 0.0, 0.0, 0.0, slope]])}
    straight, bent = (bent_links(links, still, still, torsors, factor)[1][0] for factor in (0.0, 50.0))
    x = np.linalg.norm(straight - straight[0], axis=1)
    expected = 50 * end * (3 * length * x**2 - x**3) / (2 * length**3)
    np.testing.assert_allclose(np.linalg.norm(bent - straight, axis=1), expected, atol=1e-3 * expected[-1])
