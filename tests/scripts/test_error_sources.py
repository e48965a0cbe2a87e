"""The ranking of error sources on positions whose errors are known: own kinematics of a UR5, own errors."""

import numpy as np
import pytest
from error_sources import measured, sources_of
from helpers.run_script import answer_of

UR5 = np.array([(0, 0, 0, 89.159), (90, 0, 0, 0), (0, -425, 0, 0), (0, -392.25, 0, 109.15), (90, 0, 0, 94.65),
                (-90, 0, 0, 82.3)], dtype=float)  # alpha, a, theta, d; Craig, ° and mm  # fmt: skip
UR5[:, [0, 2]] = np.deg2rad(UR5[:, [0, 2]])
UR5[:, [1, 3]] /= 1e3


def points(table: np.ndarray, q: np.ndarray) -> np.ndarray:
    """A point of the tool in a tracker's frame: Rx(alpha) Tx(a) Rz(theta) Tz(d), link by link."""
    T = np.tile(np.eye(4), (len(q), 1, 1))
    for (alpha, a, theta, d), angle in zip(table, q.T, strict=True):
        c, s, ca, sa = np.cos(theta + angle), np.sin(theta + angle), np.cos(alpha), np.sin(alpha)
        one, zero = np.ones_like(c), np.zeros_like(c)
        link = np.array([[c, -s, zero, a * one], [s * ca, c * ca, -sa * one, -d * sa * one],
                         [s * sa, c * sa, ca * one, d * ca * one], [zero, zero, zero, one]])  # fmt: skip
        T = T @ link.transpose(2, 0, 1)
    seen = T[:, :3, :3] @ np.array([0.02, -0.03, 0.1]) + T[:, :3, 3]
    turn = np.array([[0, -1.0, 0], [1, 0, 0], [0, 0, 1]])
    return seen @ turn.T + np.array([1.5, -0.4, 0.3])


@pytest.mark.thorough
def test_each_source_alone_is_found_and_noise_is_the_rest() -> None:
    rng = np.random.default_rng(0)
    q = rng.uniform(-2.8, 2.8, (300, 6))
    turned = q + 2e-3 * np.array([0, 1, -1, 0.5, 1, 0]) + 5e-4 * np.array([0, 1, 0, 1, 0, 0]) * q
    joints = sources_of("ur5", q, points(UR5, turned), 3, 0)
    assert joints.rms_mm["none"] > 0.3 and joints.rms_mm["both"] < 1e-3
    assert joints.rms_mm["joints"] < 1e-3 and joints.ratio[1] > 1 and joints.resamples == 1.0
    off = UR5.copy()
    off[:, 1] += 0.8e-3 * np.array([0, 1, -1, 1, 1, 1])
    off[1:, 0] += 1e-3 * np.array([1, 0, 1, -1, 1])
    geometry = sources_of("ur5", q, points(off, q) + 2e-5 * rng.standard_normal((300, 3)), 3, 0)
    assert geometry.ratio[2] < 1 and geometry.resamples == 0.0
    assert geometry.rms_mm["both"] == pytest.approx(2e-2 * np.sqrt(3), rel=0.1)
    assert geometry.shares["rest"][0] == pytest.approx((geometry.rms_mm["both"] / geometry.rms_mm["none"]) ** 2)
    for each in (joints, geometry):
        assert sum(share for share, _, _ in each.shares.values()) == pytest.approx(1.0)


def test_measured_positions_are_read_in_si() -> None:
    """The UR5's file is in degrees, the UR10's in radians; both arms reach about a metre."""
    for robot in ("ur5", "ur10"):
        q, p = measured(robot)
        assert q.shape == (len(p), 6) and np.abs(q).max() < 2 * np.pi and 0.3 < np.ptp(p, axis=0).max() < 3


@pytest.mark.slow
def test_geometry_comes_before_the_joints_of_both_measured_arms() -> None:
    for arm in answer_of("error_sources.py")["arms"]:
        assert arm["ratio"][2] < 1 and arm["shares"]["rest"][2] < arm["shares"]["joints"][1]
