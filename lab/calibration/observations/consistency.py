"""Rows of a file whose parts contradict each other: points that the joints of the same row do not give."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.identify import fit_base_and_tool
from lab.calibration.observations.protocol import Points
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.kinematics.model import Model

__all__ = ["Disagreement", "disagreement"]

FAR = 10.0  # times the median distance: no noise does that
LEAST_M = 5e-3  # and more than a nominal model is wrong by
_PLACING = 10  # rows that place base and tool with room to spare


@dataclass(frozen=True)
class Disagreement:
    """Rows ``(r,)`` whose points are ``sizes_m`` ``(r,)`` away from where their joints put them, the largest first."""

    rows: NDArray[np.int_]
    sizes_m: Array


def disagreement(arm: Model, data: Measurements, nominal: Array) -> Disagreement:
    """Rows where the file's points and joints cannot both be right, with nominal links and base and tool fitted.

    Args:
        arm: measured by the points of ``data``, which need not be what is fitted.
        data: the file's.
        nominal: ``(p,)`` nominal parameters of ``arm``.
    """
    none = Disagreement(np.empty(0, np.int_), np.empty(0))
    if data.points.shape[1] == 0 or int(data.seen.sum()) < _PLACING:
        return none
    observed = Observations(data.inputs(arm.conditions), data.points, np.ones(data.points.shape[:2]))
    values = fit_base_and_tool(Points(arm), observed, nominal)
    distance = np.linalg.norm(data.points - arm.points(observed.inputs, values), axis=2)
    distance = np.where(np.isnan(distance), 0.0, distance).max(axis=1)
    typical = float(np.median(distance[data.seen.any(axis=1)]))
    rows = np.flatnonzero(distance > max(FAR * typical, LEAST_M))
    rows = rows[np.argsort(-distance[rows], kind="stable")]
    return Disagreement(rows, distance[rows])
