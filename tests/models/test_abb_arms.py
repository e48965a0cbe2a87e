"""The ABB arms of figure I.4 of Mahdadi & Bouafia (2020): tables against public URDFs."""

import numpy as np
import pytest

from lab.robots.load_robot import load_robot

# Origins (m) and axes of the joints at zero, and the flange's distance from link 6: of the public URDFs.
IRB140 = (
    ((0, 0, 0), "z"), ((0.070, 0, 0.352), "y"), ((0, -0.065, 0.360), "y"), ((0.239, 0.065, 0), "x"),
    ((0.141, 0, 0), "y"), ((0.065, 0, 0), "x"),
)  # fmt: skip
IRB2400 = (
    ((0, 0, 0), "z"), ((0.1, 0, 0.615), "y"), ((0, 0, 0.705), "y"), ((0, 0, 0.135), "x"), ((0.755, 0, 0), "y"),
    ((0.085, 0, 0), "x"),
)  # fmt: skip
URDFS = {"irb140": IRB140, "irb2400": IRB2400}


def turned(axis: str, angle: float) -> np.ndarray:
    """A rotation about an axis, by its two-dimensional one."""
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    R = np.eye(3)
    R[first, first] = R[second, second] = np.cos(angle)
    R[first, second], R[second, first] = -np.sin(angle), np.sin(angle)
    return R


def flange_of(urdf: tuple, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and orientation of the flange, z along axis 6, as the URDF's joints say."""
    p, R = np.zeros(3), np.eye(3)
    for (origin, axis), angle in zip(urdf, joints, strict=True):
        p, R = p + R @ np.array(origin), R @ turned(axis, angle)
    return p, R @ turned("y", np.pi / 2)


@pytest.mark.parametrize("name", URDFS)
def test_the_flange_is_where_the_public_urdf_has_it(name: str) -> None:
    arm = load_robot(name).serial_arm(("p1",))
    values = arm.nominal({"p1": np.zeros(3)})
    joints = arm.chain.random_joints(200, np.random.default_rng(0))
    Ts = arm.tool(joints, values)[0]
    for T, q in zip(Ts, joints, strict=True):
        p, R = flange_of(URDFS[name], q)
        np.testing.assert_allclose(T[:3, 3], p, atol=1e-12)
        np.testing.assert_allclose(T[:3, :3], R, atol=1e-12)
