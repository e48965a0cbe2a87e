"""Estimate the spread of the residuals of measured positions, with configurations as clusters.

Readings of one configuration share the model discrepancy there. With N configurations that leave m residuals each, the
variance of their means, B = sum of squares of the means / (3 N - f), is that of the lack of fit and a share 1 / m of
the noise of a reading; W, the variance within configurations, is the noise. One reading at a new configuration is off
by B + (1 - 1 / m) W. By configurations the parameters' covariance is larger by m B over the variance of one reading.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.identification import Identification
from lab.calibration.observation import observation_of
from lab.calibration.statistics.linearized import linearized
from lab.core.linear_model import p_value_of_squares
from lab.core.measurements import seen_mask
from lab.core.significance import LACK_OF_FIT

__all__ = ["ResidualSpread", "for_later_rows", "residual_spread"]

_FEWEST_DOF = 3  # by which the variance of configurations' means is estimated
_BLOCKS = 8  # of rows that follow each other
_FEWEST_POSES = 5 * _BLOCKS
_MAX_POSES = 20_000  # by which blocks are judged
_RIDGE = 1e-9  # of unit columns


@dataclass(frozen=True)
class ResidualSpread:
    """Spread of the residuals of measured positions.

    Attributes:
        total_m: one standard deviation of a coordinate, of one reading at a new configuration; NaN where unknown.
        of_arm_m: the part of it that is not the instrument's: all of it where no noise is given.
        widened: how many times the parameters' covariance is larger by configurations than by readings, one at least.
        dof: degrees of freedom of these variances; None where the noise is given, and explains the residuals.
    """

    total_m: float
    of_arm_m: float
    widened: float = 1.0
    dof: int | None = None


def residual_spread(
    found: Identification,
    labels: NDArray[np.int_] | None = None,
    *,
    lack_of_fit: bool = False,
    independent_m: float | None = None,
) -> ResidualSpread:
    """Estimate the spread of the residuals of measured positions.

    Args:
        labels: ``(n,)`` which configuration each fitted row is of; each row its own where not given.
        lack_of_fit: whether the residuals are more than the noise that was given.
        independent_m: the instrument's part of the noise of a coordinate, where the measurements share further errors,
            which the fit weighs already; None where they share none.
    """
    if not observation_of(found.model).positions:
        return _spread_of_readings(found, lack_of_fit=lack_of_fit)
    if found.process is not None:
        return ResidualSpread(float(np.fmax(found.residual_sigma_m, found.sigma_m)), 0.0, dof=max(found.dof, 1))
    # one reading at a new configuration
    variances = _Variances.of(found, labels)
    total_m, dof = float(np.sqrt(variances.of_one_reading)), max(variances.dof, 1)
    own_clusters = found.dof_each is not None or independent_m is not None  # of the covariance: nothing widens it
    if not found.sigma_given:
        shared = not own_clusters and variances.is_shared
        widened = max(variances.of_means / variances.pooled, 1.0) if shared else 1.0
        return ResidualSpread(total_m, total_m, widened, dof)
    # beside a given noise
    total_m = float(np.fmax(total_m, found.sigma_m))
    if not lack_of_fit and independent_m is None:
        return ResidualSpread(total_m, 0.0)
    exceeded = not own_clusters and lack_of_fit and found.sigma_m > 0
    widened = max(variances.of_means / found.sigma_m**2, 1.0) if exceeded else 1.0
    noise_m = found.sigma_m if independent_m is None else independent_m
    of_arm_m = float(np.sqrt(max(total_m**2 - noise_m**2, 0.0)))
    return ResidualSpread(total_m, of_arm_m, widened, dof if lack_of_fit else None)


def _spread_of_readings(found: Identification, *, lack_of_fit: bool) -> ResidualSpread:
    """Return the spread where no positions were observed: only how much the covariance is widened."""
    exceeded = found.sigma_given and lack_of_fit and found.dof_each is None and found.sigma_m > 0
    widened = max(found.residual_sigma_m / found.sigma_m, 1.0) ** 2 if exceeded else 1.0
    dof = None if found.sigma_given and not lack_of_fit else max(found.dof, 1)
    return ResidualSpread(float("nan"), float("nan"), widened, dof)


def for_later_rows(
    left: ResidualSpread, found: Identification, observed: Observations, order: NDArray[np.int_], most_m: float
) -> ResidualSpread:
    """Widen what a fit leaves by what it misses of later rows, which often are elsewhere too.

    Each of eight blocks of rows that follow each other is predicted by the fit of the others. The variance that makes
    their weighted squares as large as expected (Paule & Mandel 1982) is added, as a further block is another draw of it
    (Student's t).

    Args:
        order: ``(n,)`` its rows in the order in which they were measured.
        most_m: as much is added at most: the standard deviation of a coordinate of an arm that was never calibrated.
    """
    if len(order) < _FEWEST_POSES or found.process is not None or not observation_of(found.model).positions:
        return left
    # the linear problem, its unit variance, and its information
    observed = observed.take(order).thinned(_MAX_POSES)
    linear = linearized(found.model, observed, found.values, found.fit.free, found.extra_residuals)
    rows, size = linear.jacobian.reshape(-1, len(linear.scale)), linear.mask.shape[1]
    residual = linear.residual.ravel()
    information = rows.T @ rows + _RIDGE * np.eye(rows.shape[1])
    variance = float(residual @ residual) / max(int(linear.mask.sum()) - rows.shape[1], 1)
    if found.sigma_given:
        variance = max(variance, 1.0)
    # each block predicted by the others: its squared errors, and those expected of noise and parameters
    squares, expected, numbers = np.zeros((3, _BLOCKS))
    for i, block in enumerate(np.array_split(np.arange(linear.poses), _BLOCKS)):
        of_block = slice(block[0] * size, (block[-1] + 1) * size)
        block_rows, block_residual = rows[of_block], residual[of_block]
        inverse = np.linalg.inv(information - block_rows.T @ block_rows)
        error = block_residual + block_rows @ (inverse @ (block_rows.T @ block_residual))
        squares[i], numbers[i] = error @ error, linear.mask[block].sum()
        expected[i] = variance * (numbers[i] + float(np.einsum("nf,fg,ng->", block_rows, inverse, block_rows)))

    def excess(more: float) -> float:
        return float((squares / (expected + more * numbers)).sum()) - _BLOCKS

    if excess(0.0) <= 0:
        return left
    # the variance between blocks, as a further block draws it
    more = float(scipy.optimize.brentq(excess, 0.0, float((squares / numbers).sum())))
    unit_m = found.sigma_m if found.sigma_given else found.residual_sigma_m / np.sqrt(variance)
    added = min(more * _BLOCKS / (_BLOCKS - 2) * unit_m**2, most_m**2)
    sizes = (float(np.sqrt(size**2 + added)) for size in (left.total_m, left.of_arm_m))
    return replace(left, total_m=next(sizes), of_arm_m=next(sizes))


@dataclass(frozen=True)
class _Variances:
    """Variances of a coordinate's residual (m^2), between configurations and within them.

    Attributes:
        between: of the means of configurations.
        within: of readings of one configuration; zero where none is repeated.
        pooled: of all readings, as if they were independent.
        readings: of a configuration, their harmonic mean.
    """

    between: float
    within: float
    pooled: float
    readings: float
    dof_between: int
    dof_within: int
    dof_pooled: int

    @classmethod
    def of(cls, found: Identification, labels: NDArray[np.int_] | None) -> "_Variances":
        positions = observation_of(found.model).positions
        residuals, count = found.residuals[:, :positions], found.residuals.shape[1]
        labels = np.arange(len(residuals)) if labels is None else np.unique(labels, return_inverse=True)[1]
        seen = seen_mask(residuals)
        residuals = np.where(seen[..., None], residuals, 0.0)
        cells = np.zeros((int(labels.max()) + 1, *residuals.shape[1:]))
        readings = np.zeros(cells.shape[:2])
        np.add.at(cells, labels, residuals)
        np.add.at(readings, labels, seen)
        means = cells / np.maximum(readings, 1.0)[..., None]
        apart = np.where(seen[..., None], residuals - means[labels], 0.0)
        fitted = round(len(found.fit.free) * positions / count)
        filled = readings[readings > 0]
        numbers, dofs = int(seen.sum()), (3 * len(filled) - fitted, 3 * (int(seen.sum()) - len(filled)))
        pooled_dof = 3 * numbers - fitted
        pooled = float((residuals**2).sum()) / pooled_dof if pooled_dof > 0 else float("nan")
        if dofs[0] < _FEWEST_DOF or not dofs[1]:
            return cls(pooled, 0.0, pooled, 1.0, pooled_dof, 0, pooled_dof)
        between, within = float((means**2).sum()) / dofs[0], float((apart**2).sum()) / dofs[1]
        return cls(between, within, pooled, float(1 / np.mean(1 / filled)), *dofs, pooled_dof)

    @property
    def of_means(self) -> float:
        """The variance of a reading that the means of configurations stand for, as if all were independent."""
        return self.readings * self.between

    @property
    def of_one_reading(self) -> float:
        return self.between + (1 - 1 / self.readings) * self.within

    @property
    def is_shared(self) -> bool:
        """Test whether configurations differ by more than their readings do (F test)."""
        if not self.dof_within or not self.within > 0:
            return self.dof_within > 0
        squares = self.of_means * self.dof_between / self.within
        return float(p_value_of_squares(squares, self.dof_between, self.dof_within)) < LACK_OF_FIT

    @property
    def dof(self) -> int:
        return self.dof_between if self.is_shared else self.dof_pooled
