"""Layout graphs are those of textbooks, and count the bodies and joints of Grübler's formula."""

import numpy as np
import pytest

from lab.kinematics.closed.layout import layout_of
from lab.kinematics.closed.mechanism import Mechanism
from lab.robots.load_robot import load_robot

LEGS = {
    "rpr3": ["R-P̲-R"] * 3, "rrr3": ["R̲-R-R"] * 3, "prr3": ["P̲-R-R"] * 3, "rps3": ["R-P̲-S"] * 3,
    "hexapod": ["S-P̲-S"] * 6, "delta/six_rods": ["R̲-S-S"] * 6, "rpr2": ["P-P", "R-P̲-R", "R-P̲-R"],
}  # fmt: skip


@pytest.mark.parametrize("name", LEGS)
def test_legs_are_a_textbook_s(name: str) -> None:
    layout = layout_of(load_robot(name).chain.tree)  # type: ignore[union-attr]
    assert ["-".join(layout.joints[i].text for i in leg) for leg in layout.legs] == LEGS[name]


def test_a_ball_on_a_hinged_slide_is_lee_and_shah_s_manipulator() -> None:
    """3-RPS: lengths, the plane of each leg, and the sideways motion by closed form (Lee & Shah 1988)."""
    robot = load_robot("rps3")
    mechanism, zero = robot.chain, {"p1": np.zeros(3)}
    assert isinstance(mechanism, Mechanism)
    arm = robot.arm(("p1",))
    joints = mechanism.random_joints(40, np.random.default_rng(3))
    poses = arm.tool(joints, arm.nominal(zero))[0]
    fits = np.isfinite(poses).all(axis=(1, 2))
    assert fits.sum() >= 38
    for T, lengths in zip(poses[fits], joints[fits], strict=True):
        R, place, radius = T[:3, :3], T[:3, 3], 0.2
        for i, angle in enumerate(np.deg2rad([0, 120, 240])):
            out, across = np.array([np.cos(angle), np.sin(angle), 0]), np.array([-np.sin(angle), np.cos(angle), 0])
            ball = R @ (radius * out) + place
            assert np.linalg.norm(ball - 0.3 * out) == pytest.approx(lengths[i], abs=2e-6)
            assert ball @ across == pytest.approx(0, abs=2e-6)
        moved = np.array([radius * (R[0, 0] - R[1, 1]) / 2, -radius * R[0, 1]])
        np.testing.assert_allclose(place[:2], moved, rtol=0, atol=3e-6)
        assert R[1, 0] == pytest.approx(R[0, 1], abs=1e-5)
    level = np.abs(poses[fits][:, 2, 2] - 1).max()
    assert level > 1e-4  # it did tilt


def test_two_legs_in_one_pin_are_the_course_s_exercise() -> None:
    """Mallem 2011, exercise 11.5: A1 where circles 1 and 3 meet, A2 where circle 2 meets the one about A1, E at A2."""
    robot = load_robot("rpr3/shared_pin")
    mechanism, arm = robot.chain, robot.arm(("p1",))
    B1, B2, B3, bar = np.zeros(2), np.array([1.2, 0.1]), np.array([0.2, 0.9]), 0.4

    def meeting(a: np.ndarray, b: np.ndarray, ra: float, rb: float) -> list[np.ndarray]:
        apart = np.linalg.norm(b - a)
        along = (ra**2 - rb**2 + apart**2) / (2 * apart)
        unit, rise = (b - a) / apart, np.sqrt(max(ra**2 - along**2, 0.0))
        return [a + along * unit + sign * rise * np.array([-unit[1], unit[0]]) for sign in (1, -1)]

    joints = mechanism.random_joints(30, np.random.default_rng(4))
    poses = arm.tool(joints, arm.nominal({"p1": np.zeros(3)}))[0]
    found = 0
    for T, (q1, q2, q3) in zip(poses, joints, strict=True):
        if not np.isfinite(T).all():
            continue
        every = [(A1, A2) for A1 in meeting(B1, B3, q1, q3) for A2 in meeting(A1, B2, bar, q2)]
        apart = [max(np.abs(A2 - T[:2, 3]).max(), np.abs((A2 - A1) / bar - T[:2, 0]).max()) for A1, A2 in every]
        assert min(apart) < 1e-9
        found += 1
    assert found > 25
