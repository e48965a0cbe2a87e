"""The instrument's noise from distances between targets of one rigid tool, which no arm, base or drift changes.

To first order the distance of two targets errs by u'(e_a - e_b), with u the direction from one to the other: distances
d = c + G e of all poses have constants c and the covariance sigma^2 G G' (isotropic, independent noise e). Generalized
least squares of c leaves squares that are sigma^2 times a chi squared. They are a part of the squares that any fit of a
rigid arm leaves, and orthogonal to the rest: the rest is tested against them by F, as lack of fit is against pure error
(Draper & Smith 1998, section 2.1).
"""

from dataclasses import dataclass

import numpy as np

from lab.core.checks import Check, Outcome
from lab.core.linear_model import p_value_of_squares
from lab.core.measurements import seen_mask
from lab.core.probability import chi2_ppf
from lab.core.se3 import Array
from lab.core.significance import LACK_OF_FIT, UNSOLICITED_WARNING
from lab.core.units import MICRONS

__all__ = ["CoordinateNoise", "goodness_by_distances", "instrument_noise"]

_LEAST_TARGETS = 3
_LEAST_POSES = 10
_FLAT = 1e-3  # of targets in a line or in one place: the smallest singular value of G, of the largest


@dataclass(frozen=True)
class CoordinateNoise:
    """Noise of one coordinate, estimated from distances between targets.

    Attributes:
        moving_p: the chance of as large a change of the distances over the poses if the tool were rigid.
    """

    sigma_m: float
    low_m: float
    high_m: float
    dof: int
    moving_p: float

    @property
    def is_rigid(self) -> bool:
        """Check whether the distances are constant within noise; otherwise they do not determine the noise."""
        return self.moving_p >= UNSOLICITED_WARNING

    @property
    def description(self) -> str:
        """Description for a report."""
        if not self.is_rigid:
            return (
                f"the distances between the targets change over the poses (F test, p = {self.moving_p:.1g}): the tool "
                "is not rigid, or the targets were measured by instruments that drift apart"
            )
        sigma, low, high = (f"{MICRONS.of(size):.3g}" for size in (self.sigma_m, self.low_m, self.high_m))
        return (
            f"by the distances between the targets the instrument's noise per axis is {sigma} µm (95 % interval "
            f"{low} to {high} µm, {self.dof} degrees of freedom)"
        )


def instrument_noise(points: Array) -> CoordinateNoise | None:
    """Estimate the noise from distances between targets; None of fewer than three targets or ten whole poses.

    Args:
        points: ``(n, k, 3)`` m, in the order in which they were measured, NaN where not seen.
    """
    whole = points[seen_mask(points).all(axis=1)]
    n, k = whole.shape[:2]
    if k < _LEAST_TARGETS or n < _LEAST_POSES:
        return None
    # the distances d of pairs that determine all others, and their derivatives G by the errors
    pairs = [(0, 1), (0, 2), (1, 2), *((a, b) for b in range(3, k) for a in range(3))]
    apart = np.stack([whole[:, b] - whole[:, a] for a, b in pairs], axis=1)
    lengths = np.linalg.norm(apart, axis=2)
    if not lengths.min() > 0:
        return None
    slopes: Array = np.zeros((n, len(pairs), k, 3))
    for i, (a, b) in enumerate(pairs):
        slopes[:, i, b] = apart[:, i] / lengths[:, i, None]
        slopes[:, i, a] = -slopes[:, i, b]
    slopes = slopes.reshape(n, len(pairs), -1)
    sizes = np.linalg.svd(slopes, compute_uv=False)
    if (sizes[:, -1] < _FLAT * sizes[:, 0]).any():
        return None
    # whitened: d = c + G e of all poses, with constants c
    white = np.linalg.inv(np.linalg.cholesky(slopes @ np.swapaxes(slopes, 1, 2)))  # of rows: one unit of sigma
    numbers = (white @ lengths[..., None]).ravel()
    # F test of constants that creep, and of targets that shift against each other
    along = np.linspace(-1, 1, n)[:, None, None]
    shifted = white @ slopes[..., 3:]  # all targets against the first, as by two instruments with frames of their own
    creeping = np.concatenate([along * white, shifted, along * shifted], axis=2)
    constant, moving = (each.reshape(len(numbers), -1) for each in (white, creeping))
    squares, dof = _left(constant, numbers), len(numbers) - len(pairs)
    less, fewer = _left(np.concatenate([constant, moving], axis=1), numbers), dof - moving.shape[1]
    p = p_value_of_squares(max(squares - less, 0.0), moving.shape[1], fewer, max(less, 1e-300) / fewer)
    # the noise, and its interval by chi squared
    high, low = np.sqrt(squares / chi2_ppf([0.025, 0.975], dof))
    return CoordinateNoise(float(np.sqrt(squares / dof)), float(low), float(high), dof, float(p))


def goodness_by_distances(squares: float, dof: int, instrument: CoordinateNoise) -> Check | None:
    """Test whether a fit leaves more than the instrument's noise; None where it leaves nothing to test.

    Args:
        squares: the sum of its squared residuals (m^2), all of one weight.
    """
    rest, own = dof - instrument.dof, instrument.sigma_m**2 * instrument.dof
    if rest < 1 or not own > 0:
        return None
    variance = own / instrument.dof
    beyond = max(squares - own, 0.0)
    p = float(p_value_of_squares(beyond, rest, instrument.dof, variance))
    ratio = np.sqrt(beyond / rest / variance)
    data = {"dof": (rest, instrument.dof), "instrument": instrument}
    outcome: Outcome = "failed" if p < LACK_OF_FIT else "passed"
    return Check("lack_of_fit.distances", outcome, float(ratio), p, LACK_OF_FIT, data)


def _left(columns: Array, numbers: Array) -> float:
    """Return the sum of squares that a least-squares fit of the columns leaves of the numbers."""
    residuals = numbers - columns @ np.linalg.lstsq(columns, numbers, rcond=None)[0]
    return float(residuals @ residuals)
