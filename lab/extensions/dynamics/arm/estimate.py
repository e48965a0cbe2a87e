"""An arm's dynamics as identified: base parameters with intervals, a load beside them, and how they predict."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.extensions.dynamics.payload.estimate import LoadEstimate, Nuisance
from lab.extensions.dynamics.regression import ChannelSolution, ResidualVerdict

__all__ = ["DynamicsEstimate", "Prediction"]


@dataclass(frozen=True)
class Prediction:
    """How well torques that were not fitted are predicted.

    Attributes:
        of: which torques.
        rows: how many independent rows there are.
        relative: ``(J,)`` what is left of each drive's torque, of its root mean square.
        noise_ratio: ``(J,)`` root mean square of what is left, by the noise of the fit.
        total_relative, total_noise_ratio: the same of all drives together.
        measured, predicted: ``(n, J)``.
    """

    of: str
    relative: Array
    noise_ratio: Array
    total_relative: float
    total_noise_ratio: float
    measured: Array
    predicted: Array

    @property
    def rows(self) -> int:
        """How many independent rows there are."""
        return len(self.measured)


@dataclass(frozen=True)
class DynamicsEstimate:
    """The base parameters of an arm with 95 % intervals; NaN where they are not identified.

    Attributes:
        names: of the base parameters, b of them.
        values, sigma, half_width: ``(b,)`` in SI, with the standard deviations and the intervals' half-widths.
        covariance: ``(b, b)``; NaN where one is not identified.
        noise: ``(J,)`` standard deviation of one reading of each drive's torque, Nm (N of a slide).
        time_s: ``(n,)`` of the rows that were fitted, run by run.
        measured, residual: ``(n, J)`` what was to be explained, and what of that is left.
        delay: how much later the torques are than the positions, where that was fitted.
        load: what the loaded run carries, fitted at once with the arm; None without such a run, or where it is known.
        by_difference: the same from the loaded run less the unloaded one, where their paths are alike.
        predictions: of torques that were not fitted.
    """

    names: tuple[str, ...]
    values: Array
    sigma: Array
    half_width: Array
    covariance: Array
    noise: Array
    time_s: Array
    measured: Array
    residual: Array
    delay: Nuisance | None
    load: LoadEstimate | None
    by_difference: LoadEstimate | None
    predictions: tuple[Prediction, ...]
    verdict: ResidualVerdict
    solution: ChannelSolution

    @property
    def identified(self) -> NDArray[np.bool_]:
        """``(b,)`` which base parameters the motion shows."""
        return np.isfinite(self.values)

    @property
    def rows(self) -> int:
        """The numbers that were fitted, each of which counts as independent."""
        return int(self.residual.size)

    @cached_property
    def relative_sigma(self) -> Array:
        """``(b,)`` standard deviations by the values' sizes."""
        return np.asarray(self.sigma / np.maximum(np.abs(self.values), 1e-300))

    @property
    def relative_error(self) -> float:
        """What is left of the fitted torques, of their root mean square."""
        return float(np.sqrt((self.residual**2).sum() / (self.measured**2).sum()))
