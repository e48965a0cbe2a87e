"""A measuring day as a tracker's program and a Universal Robots controller write it."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from lab.core.se3 import Array

__all__ = ["BEGIN", "controller_log", "dated", "leica"]

BEGIN = datetime(2026, 5, 14, 9, 30, tzinfo=UTC)


def dated(seconds: float) -> str:
    """A moment of the day as a date with a time."""
    return (BEGIN + timedelta(seconds=seconds)).strftime("%Y-%m-%d %H:%M:%S.%f")


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
