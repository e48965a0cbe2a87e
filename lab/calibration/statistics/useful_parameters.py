"""How well a parameter of an effect has to be known to be of any use where nothing was measured.

A wave of which less than half lies in its joint's measured range looks like a slope and a curvature there, and the
geometry and other slow waves do too. Fitted all the same, they grow against each other, and leave the measured range
with the difference of large numbers. So such a wave is fitted only where it is known as surely as a wave of a gear, and
so is a ratio, the slope itself: of a joint that moved through 60 degrees it takes what a spring's second wave leaves.
"""

from collections.abc import Sequence

import numpy as np

from lab.calibration.identify import WEAK
from lab.core.se3 import Array
from lab.kinematics.parameter import Kind, Parameter

__all__ = ["TELLING", "largest_useful_std"]

TELLING = 1e-4  # rad or m: an effect of one joint that is known no better says nothing of poses beyond the measured
_USEFUL: dict[Kind, float] = {"ratio": TELLING, "compliance": 1e-4, "section": 1e-4, "mass": 1.0}  # else WEAK
_SUPPORTED = 0.5  # of a wave's length, in the measured range


def largest_useful_std(parameters: Sequence[Parameter], joints: Array) -> Array:
    """``(p,)`` the largest standard deviation, in each one's unit, with which it is worth fitting.

    Args:
        parameters: p of them.
        joints: ``(n, joints)`` measured positions (rad, m of a slide).
    """
    turns = np.ptp(joints, axis=0) / (2 * np.pi)
    return np.array([TELLING if _is_slow(each, turns) else _USEFUL.get(each.kind, WEAK) for each in parameters])


def _is_slow(wave: Parameter, turns: Array) -> bool:
    """Whether less than half of a parameter's wave lies in the measured range, ``(joints,)`` turns."""
    turning = wave.joint if wave.turning is None else wave.turning
    return bool(wave.wave and turning is not None and wave.wave * turns[turning] < _SUPPORTED)
