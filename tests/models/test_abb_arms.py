"""The ABB arms of figure I.4 of Mahdadi & Bouafia (2020): tables against public URDFs."""

import numpy as np
import pytest

from lab.campaign.robot import load_robot
from lab.kinematics.reach import reach_from_axis

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
RANGES = {
    "irb140": ((-180, 180), (-90, 110), (-230, 50), (-200, 200), (-115, 115), (-400, 400)),
    "irb2400": ((-180, 180), (-100, 110), (-60, 65), (-200, 200), (-120, 120), (-400, 400)),
}


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


@pytest.mark.parametrize("name", RANGES)
def test_ranges_are_those_of_the_makers_data(name: str) -> None:
    chain = load_robot(name).chain
    np.testing.assert_allclose(np.rad2deg([chain.lower, chain.upper]).T, RANGES[name], atol=1e-9)


def test_the_reach_of_the_wrist_is_the_makers() -> None:
    """810 mm stretched; the IRB 2400's axis 3 stops before, and the law of cosines gives 1550 mm."""
    chains = {name: load_robot(name).serial_arm(("p1",)).chain for name in URDFS}
    wrist = {name: np.array([0.0, 0.0, -URDFS[name][-1][0][0]]) for name in URDFS}
    reach = {name: 1e3 * reach_from_axis(chain, wrist[name]) for name, chain in chains.items()}
    assert reach["irb140"] == pytest.approx(70 + 360 + 380, abs=1e-3)
    forearm = np.hypot(755, 135)
    short = np.pi / 2 - (np.deg2rad(60) + np.arctan2(135, 755))  # of stretched, at q3 = -60°
    bent = np.sqrt(705**2 + forearm**2 + 2 * 705 * forearm * np.cos(short))
    assert reach["irb2400"] == pytest.approx(100 + bent, abs=1e-3)
    assert reach["irb2400"] == pytest.approx(1550, abs=0.1)
