"""A measurement session as a tracker's program and a controller write it: the same numbers in several forms."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lab.core.se3 import Array

__all__ = ["plain", "polyworks", "rows_of_joints", "spatial_analyzer"]


def spatial_analyzer(path: Path, names: Sequence[str], points: Array, sigma: Array | None = None) -> Path:
    """Collection, group, target and coordinates in mm, with comments above; uncertainties ``(n, 3)`` m if given."""
    sigmas = "" if sigma is None else ", Ux, Uy, Uz"
    lines = ["// SpatialAnalyzer 2024.1", "// Working frame: A::WORLD", "// Units: mm"]
    lines += [f"// Collection, Group, Target, X, Y, Z{sigmas}"]
    for i, (name, point) in enumerate(zip(names, points, strict=True)):
        cells = ["A", "robot", name, *(f"{1e3 * each:.6f}" for each in point)]
        cells += [] if sigma is None else [f"{1e3 * each:.6f}" for each in sigma[i]]
        lines.append(", ".join(cells))
    path.write_text("\n".join(lines) + "\n")
    return path


def polyworks(path: Path, names: Sequence[str], points: Array) -> Path:
    """A table of measured and nominal coordinates with tabs, decimal commas, a line of units and a blank column."""
    lines = ["Project: arm", "", "Name\tMeas X\tMeas Y\tMeas Z\t\tNominal X"]
    lines += ["\t[mm]\t[mm]\t[mm]\t\t[mm]"]
    for name, point in zip(names, points, strict=True):
        lines.append("\t".join([name, *(f"{1e3 * each:.6f}".replace(".", ",") for each in point), "", "0,0"]))
    path.write_bytes("\r\n".join([*lines, "End of report", ""]).encode("utf-16"))
    return path


def plain(path: Path, names: Sequence[str], points: Array) -> Path:
    """Name, x, y, z, separated by spaces, without a header, in mm."""
    path.write_text("".join(f"{n} {x:.6f} {y:.6f} {z:.6f}\n" for n, (x, y, z) in zip(names, 1e3 * points, strict=True)))
    return path


def rows_of_joints(path: Path, names: Sequence[str], joints: Array) -> Path:
    """A row for each pose: its name and the joints in degrees."""
    header = "Pose," + ",".join(f"J{j + 1} (deg)" for j in range(joints.shape[1]))
    rows = (",".join([n, *(f"{each:.9f}" for each in np.rad2deg(row))]) for n, row in zip(names, joints, strict=True))
    path.write_text("\n".join([header, *rows]) + "\n")
    return path
