"""Daily touches of a socket by a virtual arm, for the tests of ``lab verify``."""

from datetime import date, timedelta
from functools import cache

import numpy as np

import lab
from lab.core.measurements import Measurements
from lab.core.se3 import Array

__all__ = ["daily"]

SIGMA_M = 20e-6


@cache
def _touches() -> tuple[Array, Array]:
    """Joint positions ``(4, 6)`` of touches of one socket, and the derivatives ``(4, 3, 6)`` of the ball by them."""
    touches = lab.simulate("irb120", poses=8, seed=1, observe="socket", fixtures=1, instrument="exact")
    rows = [i for i, name in enumerate(touches.measurements.other["socket"]) if name == "a"]
    joints, real = touches.measurements.joints[rows], touches.true_robot
    moves = 1e-6 * np.eye(6)
    ends = [[real.points(joints + sign * move, ("p1",))[:, 0] for sign in (1, -1)] for move in moves]
    return joints, np.stack([(ahead - behind) / 2e-6 for ahead, behind in ends], axis=2)


def daily(
    days: int, *, slip_rad: Array | None = None, since: int = 0, seed: int = 0, first: str = "2026-03-02"
) -> Measurements:
    """Measurements of four configurations a day at one socket; from day ``since`` on the zeros are off by ``slip_rad``.

    The arm is that of ``lab.calibrate("irb120", seed=1)``, the ball that of its target p1.
    """
    joints, slopes = _touches()
    rng, found = np.random.default_rng(seed), []
    for day in range(days):
        move = np.zeros(6) if slip_rad is None or day < since else slip_rad
        noise = rng.normal(0, SIGMA_M, (len(joints), 3))
        back = np.linalg.pinv(slopes) @ (noise - slopes @ move)[..., None]
        found.append(joints + back[..., 0])
    dates = [str(date.fromisoformat(first) + timedelta(days=day)) for day in range(days) for _ in joints]
    return lab.measurements(np.concatenate(found), robot="irb120", sessions=dates)
