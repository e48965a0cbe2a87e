"""What it does to a verification that the variances of its noise are estimates themselves.

r' S^-1 r of q numbers is chi squared if S is known. Where S stands on estimated variances t with the covariance W, it
is larger on average and scatters more: with G_i = S^-1 dS/dt_i, A1 = sum W_ij tr G_i tr G_j and A2 = sum W_ij tr G_i
G_j, its mean and variance are those of q / l times an F with q and m degrees of freedom (Kenward & Roger 1997,
equations 5 to 8). Where one variance alone was estimated that is the usual F. Errors that are correlated in time say
much less of their variance than there are numbers.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lab.calibration.gauss_newton import Observations
from lab.core.measurements import seen_mask
from lab.core.se3 import Array
from lab.noise.variance_components import ComponentErrors
from lab.verification.prediction import CalibrationPrediction

__all__ = ["MOST_POSES", "STEP", "with_estimated_noise"]

STEP = 0.1  # of the logarithm of a variance, for differences
MOST_POSES = 100  # that say the degrees of freedom: of more they are much the same
_MOST_DOF = 1_000_000
_MOST_SHARE = 0.5  # of the numbers: what is told so badly that A2 were more is beyond an expansion


def with_estimated_noise(
    prediction: CalibrationPrediction,
    observed: Observations,
    errors: ComponentErrors,
    moved: Sequence[tuple[Observations, Observations]],
) -> tuple[CalibrationPrediction, Observations]:
    """A prediction and measurements whose test keeps its level although the variances were estimated.

    Args:
        observed: the measurements, weighed by the estimated variances.
        errors: of these; its slopes are of the prediction's free parameters.
        moved: for each variance the first ``MOST_POSES`` measurements, weighed by it ``STEP`` larger and smaller.
    """
    some = observed.take(np.arange(min(len(observed.inputs), MOST_POSES)))
    mask = seen_mask(some.points)
    numbers = 3 * int(mask.sum())
    slopes = prediction.arm.observe(some.inputs, prediction.values)[1][mask]
    rows = slopes.reshape(numbers, -1)[:, list(prediction.free)]
    inverse = np.linalg.inv(_noise(some, numbers) + rows @ prediction.covariance @ rows.T)
    shares = []
    for (more, less), slope in zip(moved, errors.slopes, strict=True):
        change = (_noise(more, numbers) - _noise(less, numbers)) / (2 * STEP)
        known = (slope[:, None] + slope) * prediction.covariance
        shares.append(inverse @ (change + rows @ known @ rows.T))
    traces = np.array([np.trace(share) for share in shares])
    products = np.array([[np.sum(a * b.T) for b in shares] for a in shares])
    scale, dof = _matched(
        numbers, float(traces @ errors.covariance @ traces), float((errors.covariance * products).sum())
    )
    return (
        replace(prediction, covariance=prediction.covariance / scale, dof=dof),
        replace(observed, whiten=observed.whiten * np.sqrt(scale)),
    )


def _noise(observed: Observations, numbers: int) -> Array:
    """Covariance ``(numbers, numbers)`` (m^2) of the measurements' errors."""
    root = observed.in_metres(np.eye(numbers))
    return root @ root.T


def _matched(q: int, first: float, second: float) -> tuple[float, int]:
    """The factor l and the degrees of freedom m (Kenward & Roger 1997)."""
    if not second > 0:
        return 1.0, _MOST_DOF
    shrunk = min(1.0, _MOST_SHARE * q / second)
    first, second = shrunk * first, shrunk * second
    b, g = (first + 6 * second) / (2 * q), ((q + 1) * first - (q + 4) * second) / ((q + 2) * second)
    c = np.array([g, q - g, q + 2 - g]) / (3 * q + 2 * (1 - g))
    mean = 1 / (1 - second / q)
    variance = 2 / q * (1 + c[0] * b) / ((1 - c[1] * b) ** 2 * (1 - c[2] * b))
    excess = q * variance / (2 * mean**2) - 1
    dof = min(4 + (q + 2) / excess, _MOST_DOF) if excess > 0 else _MOST_DOF
    return float(dof / (mean * (dof - 2))), round(dof)
