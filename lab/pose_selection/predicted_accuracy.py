"""Predict the accuracy of a calibration from the information of its poses, and the number of poses for an accuracy."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.core.units import MM

__all__ = ["PredictedAccuracy", "predict", "smallest_count"]

_DRAWS = 2000  # of the parameter error
_SHARE = 0.95  # of the validation poses, and of the calibrations


@dataclass(frozen=True)
class PredictedAccuracy:
    """Predicted position errors over the test poses, as lengths of the 3D error (m).

    Attributes:
        rms: ``(t,)`` sqrt(tr J C J') at each test pose.
        coverage_radius: bound of the error at 95 % of the validation poses in 95 % of the calibrations.
    """

    rms: Array
    coverage_radius: float

    def repeated(self, times: float) -> "PredictedAccuracy":
        """Return the prediction for ``times`` the information: every error is smaller by its root."""
        return PredictedAccuracy(self.rms / np.sqrt(times), float(self.coverage_radius / np.sqrt(times)))


def predict(information: Array, test: Array, rng: np.random.Generator) -> PredictedAccuracy:
    """Predict accuracy from an information matrix ``(p, p)`` and Jacobians at test poses ``(t, 3, p)`` (m).

    The coverage radius x is the strict one: P(Q95 over poses of |J d| <= x) = 95 % over draws d ~ N(0, C). The
    marginal 95 % of all pose-draws would hold in too few calibrations.
    """
    size = np.sqrt(np.diag(information))
    factor = np.linalg.inv(np.linalg.cholesky(information / np.outer(size, size))) / size  # C = factor' factor
    spread = test @ factor.T
    rms = np.sqrt((spread**2).sum(axis=(1, 2)))
    draws = rng.standard_normal((_DRAWS, len(information)))
    squared = np.zeros((_DRAWS, len(test)))
    for axis in spread.transpose(1, 2, 0):
        squared += np.square(draws @ axis)
    kept = np.quantile(np.sqrt(squared, out=squared), _SHARE, axis=1, overwrite_input=True)
    return PredictedAccuracy(rms, float(np.quantile(kept, _SHARE)))


def smallest_count(coverage_radius: Callable[[int], float], wanted: float, least: int, most: int) -> int:
    """Find the smallest number of poses whose coverage radius is within ``wanted`` (m).

    Args:
        coverage_radius: number of poses to the coverage radius (m) of a design of that size.
        least, most: bounds of the number.

    Raises:
        LabError: even ``most`` poses do not reach it.
    """
    most = max(most, least)
    low, high = least, least
    while (error := coverage_radius(high)) > wanted:
        if high == most:
            raise LabError(
                f"{MM.text(wanted, 6)} is out of reach: {most} poses predict {MM.text(error)}; "
                "allow more candidates, add targets, average readings, or take a better instrument"
            )
        low, high = high + 1, min(2 * high, most)
    while low < high:
        middle = (low + high) // 2
        if coverage_radius(middle) <= wanted:
            high = middle
        else:
            low = middle + 1
    return high
