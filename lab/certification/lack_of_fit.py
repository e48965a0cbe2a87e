"""Compare validation with an uncertainty budget: what the budget does not explain is a term of its own.

A budget predicts how large errors at poses that were not fitted are. Their mean square is compared with the predicted
one: it is a sum of squares of correlated normal numbers, taken for a scaled chi squared (Satterthwaite 1946), or an F
where the noise was estimated. Where validation shows more than chance allows, the excess is the variance of a further
quantity, the lack of fit (JCGM 100:2008, 4.2.2 and F.2.4.5). Errors with longer tails than the normal show in the
largest 5 % rather than in the mean square; where these are larger than chance allows, the lack of fit grows until the
budget contains them. Chance is that of known noise. Errors that a model leaves, and that are taken for noise, are no
draws from a normal distribution: with these, whatever validation shows beyond the prediction counts.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to

from lab.core.linear_model import matched_dof, p_value_of_squares
from lab.core.probability import binomial_cdf
from lab.core.se3 import Array
from lab.core.significance import CERTIFICATE_VALIDATION
from lab.prediction.workspace_prediction import length_not_exceeded

__all__ = ["LackOfFit", "ValidationErrors", "lack_of_fit"]

_SHARE = 0.95
_MIN_DOF = 3.0  # that a budget can state


@dataclass(frozen=True)
class ValidationErrors:
    """Errors at poses that were not fitted, with their covariance by a budget.

    Attributes:
        rms_m, p95_m: root mean square and 95th percentile of their lengths.
        own: ``(n, 3, 3)`` m^2, covariance of each point's error by what differs from point to point.
        shared: ``(n, 3, c)`` m, what independent numbers of variance one that all points share do to them.
        freedom: degrees of freedom of the noise that scales both; infinite where it is known.
        known: whether all random errors are of a stated instrument and a stated or measured robot. Else part of them
            is what the model leaves, which follows the poses, and need not be normal.
    """

    rms_m: float
    p95_m: float
    poses: int
    own: Array
    shared: Array
    dof: float = np.inf
    all_given: bool = True

    def covariances(self, more_m: float = 0.0) -> Array:
        """Covariances ``(n, 3, 3)`` m^2 of the points' errors, with so much more per coordinate."""
        return np.asarray(self.own + self.shared @ np.swapaxes(self.shared, 1, 2) + more_m**2 * np.eye(3))


@dataclass(frozen=True)
class LackOfFit:
    """Errors of a validation beside those that a budget predicts.

    Attributes:
        observed_rms_m, expected_rms_m: root mean square error of the validation, and as the budget predicts it.
        observed_95_m, expected_95_m: the length that 95 % of the errors do not exceed, likewise.
        p: the chance of a larger mean square, if the budget is right.
        sigma_m: what the budget lacks, of one coordinate; 0 where chance explains the difference.
    """

    observed_rms_m: float
    expected_rms_m: float
    observed_95_m: float
    expected_95_m: float
    p: float
    sigma_m: float
    dof: float
    poses: int


def lack_of_fit(found: ValidationErrors) -> LackOfFit:
    """Test whether a budget explains the validation errors, and estimate the excess.

    Returns:
        The comparison; ``sigma_m`` is above zero where the mean square, or the largest errors, are more than chance
        allows at the level ``CERTIFICATE_VALIDATION``; where the noise is not known, more than predicted.
    """
    squares, dof = found.covariances(), None if np.isinf(found.dof) else found.dof
    expected = float(np.trace(squares, axis1=1, axis2=2).mean())
    observed = found.rms_m**2
    numbers = np.minimum(matched_dof(expected, _variance_of_mean(found)), 3.0 * found.poses)
    p = float(p_value_of_squares(observed / expected, numbers, dof, 1 / numbers))
    excess = max(observed - expected, 0.0) if p < CERTIFICATE_VALIDATION or not found.all_given else 0.0
    sigma = max(float(np.sqrt(excess / 3)), _for_the_largest(found, expected + excess))
    share = 3 * sigma**2 / (3 * sigma**2 + expected)
    return LackOfFit(
        found.rms_m,
        float(np.sqrt(expected)),
        found.p95_m,
        length_not_exceeded(squares, dof),
        p,
        sigma,
        max(share**2 * found.poses, _MIN_DOF),
        found.poses,
    )


def _variance_of_mean(found: ValidationErrors) -> float:
    """Return the variance (m^4) of the mean square, by what the errors share and what each has of its own."""
    n = len(found.own)
    flat = found.shared.reshape(3 * n, -1)
    between = flat.T @ flat
    crossed = np.einsum("nic,nij,njc->", found.shared, found.own, found.shared)
    return float(2 * ((found.own**2).sum() + 2 * crossed + (between**2).sum()) / n**2)


def _for_the_largest(found: ValidationErrors, mean_square: float) -> float:
    """Return the lack of fit (m) with which the budget contains 95 % of the errors; 0 for normal errors.

    Normal errors are scaled to the mean square that was found, so that only their tails are judged here.

    Args:
        mean_square: of the errors, by the budget with the lack of fit that it shows (m^2).
    """
    squares, dof = found.covariances(), None if np.isinf(found.dof) else found.dof
    expected = float(np.trace(squares, axis1=1, axis2=2).mean())
    sigma = float(np.sqrt((mean_square - expected) / 3)) if mean_square > expected else 0.0
    by_chance = found.all_given and not sigma  # a lack of fit is no draw from a normal distribution
    realised = max(found.rms_m / float(np.sqrt(mean_square)), 1.0) if by_chance else 1.0
    share = _share_by_chance(found.poses) if by_chance else _SHARE
    if found.p95_m <= realised * length_not_exceeded(found.covariances(sigma), dof, share):
        return 0.0

    def lacks(more_m: float) -> float:
        return found.p95_m - length_not_exceeded(found.covariances(more_m), dof)

    high = found.p95_m
    if lacks(sigma) <= 0 or lacks(high) > 0:
        return sigma if lacks(sigma) <= 0 else high
    return float(scipy.optimize.brentq(lacks, sigma, high, xtol=1e-6 * high))


def _share_by_chance(count: int) -> float:
    """Return the share below which the 95th percentile of so many lengths lies, but for a 5 % chance."""
    rank = int(np.ceil(_SHARE * (count - 1))) + 1

    def exceeded(share: float) -> float:
        return float(binomial_cdf(rank - 1, count, share)) - CERTIFICATE_VALIDATION

    return float(scipy.optimize.brentq(exceeded, 1e-9, 1 - 1e-9))
