"""Errors of poses that are left out, by formulas instead of refits, and the factor of predicted variances by them.

With P of universal kriging the error of numbers that are left out together is P_ii^-1 (P r)_i, and its covariance
matrix P_ii^-1, noise included (Cressie 1993, section 3.2; Cook & Weisberg 1982 without a process). The variances of
the process are those of all poses. The factor uses the quantile of conformal prediction (Vovk, Gammerman & Shafer
2005, section 4.1): that of n errors, below which one more lies in 95 % of all cases.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy  # its solvers are loaded at their first use
from numpy.typing import NDArray

from lab.calibration.residual.pose_numbers import Reduction
from lab.calibration.residual.process import Support, scaled_by
from lab.core.measurements import evenly
from lab.core.se3 import Array

__all__ = ["LeftOut", "bound_factor", "left_out"]

_MAX_LEFT_OUT = 300  # poses: their time grows with the numbers' square
_TOGETHER = 20  # poses that are worked out at once
_LEAST_NARROWING = 60  # points that may make bounds narrower: fewer say too little of the largest errors
_LEVEL, _LIMIT = 0.95, 7.814727903251179  # of chi^2 with three degrees of freedom
_FACTORS = np.geomspace(1 / 16, 16.0, 97)


@dataclass(frozen=True)
class LeftOut:
    """A pose that was left out.

    Attributes:
        pose: its row.
        error: ``(s,)`` measured less predicted (m) of the numbers seen there.
        covariance: ``(s, s)`` predicted of it, noise included (m^2).
    """

    pose: int
    error: Array
    covariance: Array


def left_out(
    support: Support, reduction: Reduction, noise: float, left: tuple[Array, Array], labels: NDArray[np.int_]
) -> Iterator[LeftOut]:
    """Errors of poses whose repeats are left out with them.

    Args:
        support: all numbers.
        reduction: of them.
        noise: variance of the noise (m^2).
        left: P times the residuals: of the numbers that the offsets move, and of those with the noise alone.
        labels: ``(n,)`` of configurations, left out together.
    """
    count = labels.max() + 1
    some = evenly(count, _MAX_LEFT_OUT)
    chosen, of_moved, of_alone = (
        np.arange(count) if some is None else some,
        labels[support.numbers.pose],
        labels[reduction.alone],
    )
    for first in range(0, len(chosen), _TOGETHER):
        columns = np.flatnonzero(np.isin(of_moved, chosen[first : first + _TOGETHER]))
        start = int(columns[0])  # rows above are zero
        unit = np.zeros((len(support.root) - start, len(columns)), order="F")
        unit[columns - start, np.arange(len(columns))] = 1
        triangle = support.root[start:, start:]
        half = scipy.linalg.solve_triangular(triangle, unit, lower=True, overwrite_b=True, check_finite=False)
        for label in chosen[first : first + _TOGETHER]:
            moved, alone = np.flatnonzero(of_moved == label), np.flatnonzero(of_alone == label)
            own = half[:, of_moved[columns] == label]
            slopes = np.concatenate([own.T @ support.half_columns[start:], support.noise_columns[alone] / noise])
            whole = scipy.linalg.block_diag(own.T @ own, np.eye(len(alone)) / noise)
            covariance = np.linalg.inv(whole - slopes @ np.linalg.solve(support.information, slopes.T))
            error = covariance @ np.concatenate([left[0][moved], left[1][alone]])
            poses = np.concatenate([support.numbers.pose[moved], reduction.alone[alone]])
            for pose in np.unique(poses):
                rows = np.flatnonzero(poses == pose)
                turned = reduction.back(pose, covariance[np.ix_(rows, rows)])
                yield LeftOut(int(pose), reduction.back(pose, error[rows]), reduction.back(pose, turned.T))


def bound_factor(errors: Array, covariances: Array, noise: float, prior: Array) -> float:
    """The factor of predicted variances by which 95 % of the points left out lie within their bounds.

    Args:
        errors: ``(m, 3)`` of points that were left out (m).
        covariances: ``(m, 3, 3)`` predicted, noise included (m^2).
        noise: variance of the noise of a number (m^2).
        prior: ``(m,)`` sums of the three variances by the offsets before any measurement (m^2).
    """
    rank = int(np.ceil(_LEVEL * (len(errors) + 1)))
    if rank > len(errors):  # too few to tell
        return 1.0
    alone = noise * np.eye(3)
    predicted = covariances - alone
    share = np.trace(predicted, axis1=1, axis2=2) / np.maximum(prior, 1e-300)
    for factor in _FACTORS if len(errors) >= _LEAST_NARROWING else _FACTORS[_FACTORS >= 1]:
        whole = predicted * scaled_by(factor, share)[:, None, None] + alone
        squares = np.einsum("mi,mi->m", errors, np.linalg.solve(whole, errors[..., None])[..., 0])
        if np.sort(squares)[rank - 1] <= _LIMIT:
            return float(factor)
    return float(_FACTORS[-1])
