"""Rotations and poses: group axioms, and every angle."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lab.core import se3
from lab.core.se3 import Array


def rotation_vectors(regime: str, rng: np.random.Generator) -> Array:
    directions = rng.normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    angles = {
        "anywhere": rng.uniform(0, np.pi, 500),
        "near identity": rng.uniform(0, 1e-7, 500),
        "next to nothing": rng.uniform(0, 1e-160, 500),
        "near half a turn": np.pi - rng.uniform(0, 1e-9, 500),
        "where the series ends": rng.uniform(0.009, 0.011, 500),
    }[regime]
    return directions * angles[:, None]


REGIMES = ["anywhere", "near identity", "next to nothing", "near half a turn", "where the series ends"]


@pytest.mark.parametrize("regime", REGIMES)
def test_log_undoes_exp(regime: str) -> None:
    vectors = rotation_vectors(regime, np.random.default_rng(0))
    back = se3.log(se3.exp(vectors))
    np.testing.assert_allclose(se3.exp(back), se3.exp(vectors), atol=1e-14)
    if regime != "near half a turn":  # there v and v - 2 pi are equally good
        np.testing.assert_allclose(back, vectors, atol=1e-14)
    assert (np.linalg.norm(back, axis=1) <= np.pi + 1e-15).all()


@pytest.mark.parametrize("regime", REGIMES)
def test_exp_is_a_rotation_and_quaternions_agree(regime: str) -> None:
    rotations = se3.exp(rotation_vectors(regime, np.random.default_rng(1)))
    np.testing.assert_allclose(
        rotations @ np.swapaxes(rotations, 1, 2), np.broadcast_to(np.eye(3), (500, 3, 3)), atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.det(rotations), 1, atol=1e-14)
    quaternions = se3.quaternion_from_rotation(rotations)
    np.testing.assert_allclose(se3.rotation_from_quaternion(quaternions), rotations, atol=2e-15)


@pytest.mark.parametrize("regime", REGIMES)
def test_left_jacobian_is_the_derivative_of_exp(regime: str) -> None:
    rng = np.random.default_rng(2)
    for vector in rotation_vectors(regime, rng)[:20]:
        for axis in np.eye(3):
            rate = se3.exp(vector + 1e-30j * axis).imag / 1e-30
            expected = se3.skew(se3.left_jacobian(vector) @ axis) @ se3.exp(vector)
            np.testing.assert_allclose(rate, expected, atol=1e-13)


def test_known_rotation() -> None:
    np.testing.assert_allclose(se3.exp(np.array([0, 0, np.pi / 2])) @ [1, 0, 0], [0, 1, 0], atol=2e-16)


def test_poses_compose_and_invert() -> None:
    rng = np.random.default_rng(3)
    a = se3.pose(se3.exp(rng.normal(size=(20, 3))), rng.normal(size=(20, 3)))
    b = se3.pose(se3.exp(rng.normal(size=(20, 3))), rng.normal(size=(20, 3)))
    points = rng.normal(size=(20, 5, 3))
    np.testing.assert_allclose(se3.transform(a @ b, points), se3.transform(a, se3.transform(b, points)), atol=1e-14)
    np.testing.assert_allclose(a @ se3.inverse(a), np.broadcast_to(np.eye(4), (20, 4, 4)), atol=1e-14)


def test_rotation_between_opposite_and_near_vectors() -> None:
    rng = np.random.default_rng(4)
    for scale in (1.0, 1e-8, 0.0):
        a = rng.normal(size=3)
        a /= np.linalg.norm(a)
        b = a + scale * rng.normal(size=3)
        b /= np.linalg.norm(b)
        for target in (b, -b):
            turn = se3.rotation_between(a, target)
            np.testing.assert_allclose(turn @ a, target, atol=2e-8 if target is not b else 1e-14)
            np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)


def test_nearest_rotation_never_mirrors() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        nearest = se3.nearest_rotation(rng.normal(size=(3, 3)))
        assert np.linalg.det(nearest) == pytest.approx(1)


@pytest.mark.parametrize("off_rad", [0.0, 1e-15, 1e-14, 1e-12, 1e-9, 1e-5, 1.0])
def test_roll_pitch_yaw_at_every_pitch(off_rad: float) -> None:
    """Also where the pitch is a right angle, or nearly, and the angles there are many."""
    rng = np.random.default_rng(5)
    for right_angle in (np.pi / 2, -np.pi / 2):
        roll, yaw = rng.uniform(-np.pi, np.pi, (2, 500))
        pitch = np.full(500, right_angle * (1 - off_rad / (np.pi / 2)))
        angles = np.stack([roll, pitch, yaw], axis=-1)
        rotations = se3.rotation_from_roll_pitch_yaw(angles)
        np.testing.assert_allclose(rotations, Rotation.from_euler("xyz", angles).as_matrix(), atol=1e-14)
        back = se3.roll_pitch_yaw(rotations)
        np.testing.assert_allclose(se3.rotation_from_roll_pitch_yaw(back), rotations, atol=1e-14)
        if off_rad == 1.0:
            np.testing.assert_allclose(back, angles, atol=1e-14)
        if off_rad == 0.0:
            assert (back[:, 2] == 0).all()


@pytest.mark.parametrize("regime", REGIMES)
def test_every_way_to_write_a_rotation_leads_back(regime: str) -> None:
    """Rotation vector, quaternion, angles; the same as another library's."""
    vectors = rotation_vectors(regime, np.random.default_rng(6))
    vectors[:3] = np.pi * np.eye(3)  # half a turn about a coordinate axis
    vectors[3] = 0.0
    rotations = se3.exp(vectors)
    np.testing.assert_allclose(rotations, Rotation.from_rotvec(vectors).as_matrix(), atol=1e-15)
    for there, back in (
        (se3.log, se3.exp),
        (se3.quaternion_from_rotation, se3.rotation_from_quaternion),
        (se3.roll_pitch_yaw, se3.rotation_from_roll_pitch_yaw),
    ):
        np.testing.assert_allclose(back(there(rotations)), rotations, atol=1e-14, err_msg=there.__name__)
        np.testing.assert_allclose(back(there(rotations[7])), rotations[7], atol=1e-14)  # one alone
