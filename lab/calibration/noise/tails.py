"""Tail weight of the noise: degrees of freedom of Student's t, from the central residuals.

Student's t with n degrees of freedom stands for noise whose variance changes by chance (Lange, Little & Taylor 1989).
Its shape is fitted to the residuals within several times their median alone, by the likelihood of what lies within: bad
readings are outside, and cannot pretend that noise had tails.
"""

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to

from lab.calibration.statistics.linearized import LinearizedFit
from lab.core.se3 import Array

__all__ = ["tail_dof"]

_WITHIN = 7.0  # standard deviations, as the median of the sizes says them
_MEDIAN = 0.6744897501960817  # of a standard normal's size
_DOFS = np.array([2.2, 2.6, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0, 12.0, 20.0, 40.0, np.inf])
_SCALES = np.linspace(0.6, 1.25, 27)  # of the median's standard deviation
_LEAST_NUMBERS = 50
_INTERVALS = 60_000  # of sizes: with a million numbers they change a log-likelihood by 0.001
_CAUTION = 1.0  # the least degrees of freedom whose log-likelihood is less than the largest by so much


def tail_dof(linear: LinearizedFit) -> float:
    """Degrees of freedom of Student's t that the noise may well have; infinite where it may be Gaussian.

    Of those that the residuals do not contradict the heaviest tails are taken, unless none are as likely: the test of
    outliers is to keep its level.
    """
    within = linear.everywhere()
    left = within.left()
    tested = linear.mask & (left > 0.2) & (np.arange(len(left)) < linear.poses)[:, None]
    numbers = np.abs(linear.residual[tested]) / np.sqrt(left[tested])
    if len(numbers) < _LEAST_NUMBERS or not (middle := float(np.median(numbers))) > 0:
        return float("inf")
    inside = numbers * (_MEDIAN / middle)
    inside, count = _counted(inside[inside < _WITHIN])
    heights = np.array([max(_height(inside, count, _WITHIN, dof, scale) for scale in _SCALES) for dof in _DOFS])
    if heights.max() - heights[-1] < _CAUTION:
        return float("inf")
    return float(_DOFS[np.flatnonzero(heights > heights.max() - _CAUTION)[0]])


def _counted(sizes: Array) -> tuple[Array, Array]:
    """Sizes below the bound and how many there are of each: of very many, the middles of narrow intervals."""
    if len(sizes) <= _INTERVALS:
        return sizes, np.ones(len(sizes))
    count, edges = np.histogram(sizes, _INTERVALS, (0.0, _WITHIN))
    return (edges[:-1] + edges[1:]) / 2, count.astype(np.float64)


def _height(numbers: Array, count: Array, bound: float, dof: float, scale: float) -> float:
    """Log-likelihood of sizes ``(n,)``, so many of each, of numbers of this distribution below a bound."""
    if np.isinf(dof):
        below = scipy.special.ndtr(bound / scale)
        logs = -0.5 * (numbers / scale) ** 2 - 0.5 * np.log(2 * np.pi)
        return float((logs @ count) - count.sum() * np.log(scale * (2 * below - 1)))
    constant = scipy.special.gammaln((dof + 1) / 2) - scipy.special.gammaln(dof / 2) - 0.5 * np.log(dof * np.pi)
    logs = constant - (dof + 1) / 2 * np.log1p((numbers / scale) ** 2 / dof)
    below = scipy.special.stdtr(dof, bound / scale)
    return float((logs @ count) - count.sum() * np.log(scale * (2 * below - 1)))
