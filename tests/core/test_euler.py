"""Rotations by three angles in all orders and by axis and angle, against scipy's and matrices written out by hand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lab.core import se3
from lab.core.euler import axis_angle, euler_angles, rotation_from_euler
from lab.core.orientation import ORDERS, Order


def turned(axis: str, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    rows = {"x": [[1, 0, 0], [0, c, -s], [0, s, c]], "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
            "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]]}  # fmt: skip
    return np.array(rows[axis])


def product(order: str, angles: np.ndarray) -> np.ndarray:
    a, b, c = (turned(axis, angle) for axis, angle in zip(order, angles, strict=True))
    return np.asarray(a @ b @ c)


@pytest.mark.parametrize("order", ORDERS)
def test_both_solutions_are_the_rotation(order: Order) -> None:
    rng = np.random.default_rng(0)
    for rotation in Rotation.random(30, rng=1).as_matrix():
        found = euler_angles(rotation, order)
        assert found.solutions.shape == (2, 3) and found.free == 0
        for angles in found.solutions:
            np.testing.assert_allclose(product(order, angles), rotation, rtol=0, atol=1e-14)
            np.testing.assert_allclose(rotation_from_euler(angles, order), rotation, rtol=0, atol=1e-14)
        scipys = Rotation.from_matrix(rotation).as_euler(order.upper())
        assert np.abs(found.solutions - scipys).max(axis=1).min() < 1e-12
        apart = np.abs(np.angle(np.exp(1j * (found.solutions[0] - found.solutions[1]))))
        assert apart.max() > 1e-3 and (np.abs(found.solutions) <= np.pi).all()
    near = product(order, np.array([0.3, (0.0 if order[0] == order[2] else np.pi / 2) + 1e-5, 0.4]))
    found = euler_angles(near, order)
    assert found.free == 0
    np.testing.assert_allclose(product(order, found.solutions[0]), near, rtol=0, atol=1e-14)
    assert rng is not None


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("side", [0, 1])
def test_a_singular_order_says_what_is_determined(order: Order, side: int) -> None:
    bend = np.pi * side if order[0] == order[2] else np.pi / 2 - np.pi * side
    rotation = product(order, np.array([0.3, bend, 0.9]))
    found = euler_angles(rotation, order)
    assert found.solutions.shape == (1, 3) and found.solutions[0, 0] == 0 and found.free in (1, -1)
    for a in (0.0, 0.3, -2.0):
        same = np.array([a, bend, found.solutions[0, 2] - found.free * a])
        np.testing.assert_allclose(product(order, same), rotation, rtol=0, atol=1e-12)
    assert np.cos(found.solutions[0, 2] - (0.9 + found.free * 0.3)) == pytest.approx(1)


def test_axis_and_angle_at_every_angle() -> None:
    rng = np.random.default_rng(2)
    for angle in (1e-6, 0.1, 1.0, 3.0, np.pi - 1e-6, np.pi):
        for axis in rng.normal(size=(20, 3)):
            unit = axis / np.linalg.norm(axis)
            rotation = (
                np.eye(3) + np.sin(angle) * se3.skew(unit) + (1 - np.cos(angle)) * se3.skew(unit) @ se3.skew(unit)
            )
            found = axis_angle(rotation)
            assert found.angle == pytest.approx(angle, abs=1e-14) and found.both_axes is (angle == np.pi)
            sign = np.sign(found.axis @ unit) if found.both_axes else 1.0
            np.testing.assert_allclose(found.axis, sign * unit, rtol=0, atol=1e-9)
    still = axis_angle(np.eye(3))
    assert still.angle == 0 and np.isnan(still.axis).all() and not still.both_axes
