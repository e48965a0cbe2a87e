"""A measuring day as a tracker's program and a controller write it: the same numbers in several forms."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from lab.core.se3 import Array

__all__ = ["controller_log", "dated", "leica", "plain", "polyworks", "rows_of_joints", "spatial_analyzer"]

BEGIN = datetime(2026, 5, 14, 9, 30, tzinfo=UTC)


def dated(seconds: float) -> str:
    """A moment of the day as a date with a time."""
    return (BEGIN + timedelta(seconds=seconds)).strftime("%Y-%m-%d %H:%M:%S.%f")


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


def leica(path: Path, names: Sequence[str], points: Array, sigma: Array, seconds: Sequence[float]) -> Path:
    """A table with semicolons: metres, uncertainties for k = 1, times, temperature and pressure."""
    lines = ["Leica Tracker Pilot;;;;;;;;;;", "Point ID;X [m];Y [m];Z [m];Std X [m];Std Y [m];Std Z [m];Date;Time;"
             "Temperature [°C];Pressure [hPa]"]  # fmt: skip
    for i, (name, point) in enumerate(zip(names, points, strict=True)):
        day, _, time = dated(seconds[i]).partition(" ")
        numbers = [*(f"{each:.9f}" for each in point), *(f"{each:.9f}" for each in sigma[i])]
        lines.append(";".join([name, *numbers, day, time, f"{20 + 0.1 * i:.1f}", "1013.2"]))
    path.write_bytes("\n".join(lines).encode("cp1252"))
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


def controller_log(
    path: Path, joints: Array, *, stand_s: float = 3.0, move_s: float = 2.0, rate_hz: float = 25.0, start: float = 0.0
) -> Array:
    """A log of Universal Robots' form, which stands at each pose; the middle of each stand ``(n,)`` s is returned."""
    rng = np.random.default_rng(5)
    times, rows, middles = [], [], []
    at = start
    for k, q in enumerate(joints):
        if k:
            share = np.arange(1, int(move_s * rate_hz)) / (move_s * rate_hz)
            smooth = share * share * (3 - 2 * share)
            rows += list(joints[k - 1] + smooth[:, None] * (q - joints[k - 1]))
            times += list(at + share * move_s)
            at += move_s
        count = int(stand_s * rate_hz) + 1
        times += list(at + np.arange(count) / rate_hz)
        rows += [q] * count
        middles.append(at + stand_s / 2)
        at += stand_s
    noisy = np.array(rows) + rng.uniform(-1e-5, 1e-5, (len(rows), joints.shape[1]))
    header = "timestamp " + " ".join(f"actual_q_{j}" for j in range(joints.shape[1]))
    lines = (f"{t:.3f} " + " ".join(f"{each:.8f}" for each in q) for t, q in zip(times, noisy, strict=True))
    path.write_text("\n".join([header, *lines]) + "\n")
    return np.array(middles)
