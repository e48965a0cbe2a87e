"""A UR5e as a Denavit-Hartenberg table, and its poses by plain products."""

from pathlib import Path

import numpy as np
from day_files import JOINTS

from lab.core.se3 import Array

__all__ = ["UR5E_TABLE", "distal_pose", "ur5e_toml"]

UR5E_TABLE = np.array(  # theta, d, a, alpha: Universal Robots, "DH parameters for calculations of kinematics"
    [[0, 0.1625, 0, np.pi / 2], [0, 0, -0.425, 0], [0, 0, -0.3922, 0], [0, 0.1333, 0, np.pi / 2],
     [0, 0.0997, 0, -np.pi / 2], [0, 0.0996, 0, 0]]
)  # fmt: skip


def ur5e_toml(path: Path, corrections: str = "") -> Path:
    """Write the nominal table, with a file of corrections if named."""
    lines = ['name = "ur5e"', 'convention = "distal"'] + ([f'corrections = "{corrections}"'] if corrections else [])
    for joint, (theta, d, a, alpha) in zip(JOINTS, UR5E_TABLE.tolist(), strict=True):
        lines += ["", "[[joint]]", f'name = "{joint}"', f"theta_rad = {theta}", f"d_m = {d}", f"a_m = {a}"]
        lines += [f"alpha_rad = {alpha}", "lower_deg = -360", "upper_deg = 360"]
    path.write_text("\n".join(lines) + "\n")
    return path


def distal_pose(table: Array, joints: Array) -> Array:
    """The last frame ``(4, 4)`` of a distal table, by plain products: Rz(theta + q) Tz(d) Tx(a) Rx(alpha)."""
    T = np.eye(4)
    for (theta, d, a, alpha), q in zip(table, joints, strict=True):
        c, s, ca, sa = np.cos(theta + q), np.sin(theta + q), np.cos(alpha), np.sin(alpha)
        T = T @ np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1.0]])
    return T
