"""Detect points or joint positions in another unit or frame than they are taken for.

Base and tool are fitted by ordinary least squares. The worst part of the points is left out of each fit (least trimmed
squares: Rousseeuw & Van Driessen 2006), so that a few outliers neither hide a cause nor look like one. A conversion
that leaves a small part of the points' spread, and far less than the numbers as they are, is the cause.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations, fit
from lab.calibration.guess import columns_of, initial_guess
from lab.calibration.identification import PLAUSIBLE_SPREAD, spread
from lab.core.checks import Check
from lab.core.measurements import seen_mask
from lab.core.se3 import Array
from lab.kinematics.model import Model

__all__ = ["PLACED", "in_other_numbers", "trimmed_error"]

PLACED = ("base", "tool")
_NEAR = 0.02  # of the points' spread: a model of this kind of arm in the right unit and frame
_CLEARLY = 5.0  # times less than as they are
_FITTED_SHARE = 0.7  # of the points that are fitted
_TRIMS = 4
_MIN_DOF = 3
_FACTORS = (1e3, 25.4, 1e-3, 25.4e-3)  # to the expected unit, of lengths
_JOINT_FACTORS = (180 / np.pi, np.pi / 180)


def in_other_numbers(model: Model, slides: Sequence[bool], inputs: Array, points: Array, values: Array) -> Check | None:
    """Return the check that names the unit or frame in which the numbers are those of an arm; None if there is none.

    Args:
        slides: which joints are prismatic.
        inputs: ``(n, joints + conditions)``.
        points: ``(n, k, 3)`` m, NaN where not observed.
        values: ``(p,)`` of the arm; its base and tool are fitted.
    """
    seen = seen_mask(points)

    def size(at: Array) -> float:
        return spread(np.where(seen[:, :, None], model.points(at, values), np.nan))

    plain = trimmed_error(model, inputs, points, values, PLACED)
    here = size(inputs)
    for factor in _FACTORS:
        if not PLAUSIBLE_SPREAD[0] <= factor * spread(points) / here <= PLAUSIBLE_SPREAD[1]:
            continue
        left = trimmed_error(model, inputs, factor * points, values, PLACED)
        if left < _NEAR * here and _CLEARLY * left < factor * plain:
            return Check("situation.unit", "failed", data={"factor": factor, "left_m": left})
    for factor in _JOINT_FACTORS:
        turned = inputs.copy()
        turned[:, : len(slides)] *= np.where(slides, 1.0, factor)
        left = trimmed_error(model, turned, points, values, PLACED)
        if left < _NEAR * size(turned) and _CLEARLY * left < plain:
            return Check("situation.joint_unit", "failed", data={"factor": factor, "left_m": left})
    left = trimmed_error(model, inputs, points * [-1.0, 1.0, 1.0], values, PLACED)
    if left < _NEAR * here and _CLEARLY * left < plain:
        return Check("situation.mirrored", "failed", data={"left_m": left})
    return None


def trimmed_error(model: Model, inputs: Array, points: Array, values: Array, groups: Sequence[str]) -> float:
    """Return the root mean square error (m) of the best part of points, with groups fitted to them.

    It is that of numbers to which nothing was fitted; infinite where the points are too few, or loops do not close.

    Args:
        inputs, points, values: as for ``in_other_numbers``.
        groups: ``base``, ``tool``, both, or none.
    """
    seen = seen_mask(points)
    columns, count = list(columns_of(model, groups)) if groups else [], int(seen.sum())
    retained = max(int(np.ceil(_FITTED_SHARE * count)), -(-(len(columns) + _MIN_DOF) // 3))
    if retained > count or np.isnan(model.points(inputs, values)).any():
        return float("inf")
    fitted, least = seen, float("inf")
    for _ in range(_TRIMS if columns else 1):
        placed = values
        if columns:
            some = _only(Observations(inputs, points, np.ones(seen.shape)), fitted)
            placed = initial_guess(model, some, values, groups)
            if len(groups) > 1:
                placed = fit(model, some, columns, placed, tolerance_m=1e-7, most_steps=20).values
        errors = np.where(seen, ((points - model.points(inputs, placed)) ** 2).sum(axis=2), np.inf)
        best = errors <= np.partition(errors[seen], retained - 1)[retained - 1]
        square = float(errors[best].sum())
        if not square < least:
            break
        least, fitted = square, best
    return float(np.sqrt(3 * least / (3 * retained - len(columns))))


def _only(observed: Observations, seen: NDArray[np.bool_]) -> Observations:
    rows = np.flatnonzero(seen.any(axis=1))
    points = np.where(seen[:, :, None], observed.points, np.nan)
    return replace(observed, points=points).take(rows)
