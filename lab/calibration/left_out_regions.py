"""What a model lacks where nothing near was measured: what it lacks of regions that it is fitted without.

The poses are parted into regions of joint space. Each is left out in turn, the linear model is solved by the others,
and the errors e of the poses that the others do not cover are compared with their covariance V by noise and parameters.
Where they are larger (at 1 %), every joint is taken to be off by s d, with d how far a pose is beyond what is covered,
in units of how far that reaches: s is where the sum of e' (V + s^2 d^2 S S')^-1 e is as expected (Paule & Mandel 1982),
with S the derivatives by the joints.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.calibration.pose_cover import PoseCover, joint_regions
from lab.core.linear_model import matched_dof, p_value_of_squares, unit_columns
from lab.core.probabilities import chi2_sf
from lab.core.se3 import Array
from lab.core.significance import EXTRAPOLATION

__all__ = ["LinearRows", "growth_beyond_cover"]

_REGIONS = 8
_LEAST_POSES = 5 * _REGIONS
_LEAST_FAR = 3  # regions with poses that the others do not cover: of fewer no variance is told
_RIDGE = 1e-9  # of unit columns: what a region alone tells has a large covariance, not none


@dataclass(frozen=True)
class LinearRows:
    """A fitted linear problem pose by pose, in whitened units; rows of zeros where nothing was observed.

    Attributes:
        columns: ``(n, m, f)`` derivatives by the parameters that were fitted.
        residual: ``(n, m)`` what the fit leaves.
        known: ``(r, f)`` derivatives of what else is known of the parameters.
        by_joints: ``(n, m, joints)`` derivatives by joint positions: rad of a hinge, as much at a lever of a slide.
        numbers: ``(n,)`` how many numbers each pose has.
        sigma_known: whether the rows' variance is one at least.
    """

    columns: Array
    residual: Array
    known: Array
    by_joints: Array
    numbers: NDArray[np.int_]
    sigma_known: bool

    @property
    def variance(self) -> float:
        """Of a number that the fit leaves."""
        dof = int(self.numbers.sum()) - self.columns.shape[2]
        return float((self.residual**2).sum()) / dof if dof > 0 else 0.0

    def without(self, left_out: NDArray[np.bool_], values: Array) -> "LinearRows":
        """The problem fitted without some parameters ``(f,)``, which had these values ``(left_out,)``."""
        kept = self.columns[..., ~left_out]
        before = self.residual + self.columns[..., left_out] @ values
        flat, target = kept.reshape(-1, kept.shape[2]), before.ravel()
        whole = np.concatenate([flat, self.known[:, ~left_out]])
        units, scale = unit_columns(whole)
        back = np.linalg.lstsq(units, np.concatenate([target, np.zeros(len(self.known))]), rcond=None)[0] / scale
        residual = (target - flat @ back).reshape(self.residual.shape)
        return replace(self, columns=kept, residual=residual, known=self.known[:, ~left_out])


@dataclass(frozen=True)
class _LeftOut:
    """Poses of one region that the others do not cover, as the others predict them.

    Attributes:
        error: ``(k, m)``.
        covariance: ``(k, m, m)`` by noise and parameters.
        by_joints: ``(k, m, joints)`` times the distance to what is covered.
        numbers: how many numbers these are.
        p: the chance of errors as large.
    """

    error: Array
    covariance: Array
    by_joints: Array
    numbers: int
    p: float


def growth_beyond_cover(rows: LinearRows, joints: Array, turning: NDArray[np.bool_]) -> float:
    """One standard deviation (rad) by which joints are off, for each unit of distance beyond what is covered.

    Zero where noise and the parameters' covariance explain what is missed in regions that are left out.

    Args:
        joints: ``(n, joints)`` the positions of the poses.
        turning: ``(joints,)`` which joints turn.
    """
    if len(PoseCover.of(joints, turning).poses) < _LEAST_POSES:
        return 0.0
    columns, scale = unit_columns(rows.columns.reshape(-1, rows.columns.shape[2]))
    scaled = replace(rows, columns=columns.reshape(rows.columns.shape), known=rows.known / scale)
    labels = joint_regions(joints, turning, _REGIONS, 0)
    tried = [_left_out(scaled, joints, turning, labels == region) for region in range(_REGIONS)]
    parts = [part for part in tried if part is not None]
    if len(parts) < _LEAST_FAR or _together([part.p for part in parts]) >= EXTRAPOLATION:
        return 0.0
    return float(np.sqrt(_excess(parts) * len(parts) / (len(parts) - 2)))  # a new region is another draw: Student's t


def _left_out(rows: LinearRows, joints: Array, turning: NDArray[np.bool_], out: NDArray[np.bool_]) -> _LeftOut | None:
    """What the other poses say of those of a region that they do not cover; None where they cover them all."""
    away = PoseCover.of(joints[~out], turning).beyond(joints[out])
    far = np.flatnonzero(out)[away > 0]
    size = rows.columns.shape[2]
    dof = int(rows.numbers[~out].sum()) - size
    if not len(far) or dof < 1:
        return None
    rest, left = rows.columns[~out].reshape(-1, size), rows.residual[~out].ravel()
    information = rest.T @ rest + rows.known.T @ rows.known + _RIDGE * np.eye(size)
    removed = rows.columns[out].reshape(-1, size).T @ rows.residual[out].ravel()
    inverse: Array = np.asarray(np.linalg.inv(information), dtype=np.float64)
    moved = inverse @ -removed  # at the whole fit the scores of all rows add up to nothing
    variance = float(((left - rest @ moved) ** 2).sum()) / dof
    variance = max(variance, 1.0) if rows.sigma_known else variance
    there = rows.columns[far]
    spread: Array = np.eye(there.shape[1]) + there @ inverse @ np.swapaxes(there, 1, 2)
    error = rows.residual[far] - there @ moved
    numbers = int(rows.numbers[far].sum())
    p = _p_value(error / np.sqrt(variance), there, inverse, spread, (numbers, dof))
    return _LeftOut(error, variance * spread, away[away > 0][:, None, None] * rows.by_joints[far], numbers, p)


def _p_value(error: Array, columns: Array, inverse: Array, spread: Array, counts: tuple[int, int]) -> float:
    """The chance of as large a sum of squares of errors, each pose's by its own covariance (Satterthwaite 1946).

    Args:
        spread: ``(k, m, m)`` the poses' covariances.
        counts: numbers, and degrees of freedom of the variance.
    """
    numbers, dof = counts
    factor: Array = np.linalg.inv(np.linalg.cholesky(spread))
    squares = float(((factor @ error[..., None]) ** 2).sum())
    white = factor @ columns
    flat = white.reshape(-1, white.shape[2])
    across = inverse @ (flat.T @ flat)
    own = white @ inverse @ np.swapaxes(white, 1, 2)
    between = max(float(np.trace(across @ across)) - float((own**2).sum()), 0.0)
    like = matched_dof(float(numbers), 2 * (numbers + between))
    return float(p_value_of_squares(squares, like, dof, numbers / like))


def _together(chances: list[float]) -> float:
    """The chance of p-values as small as these, of all regions together (Fisher 1925)."""
    logs = np.log(np.maximum(chances, np.finfo(float).tiny))
    return float(chi2_sf(-2 * float(logs.sum()), 2 * len(chances)))


def _excess(parts: list[_LeftOut]) -> float:
    """The variance that makes the weighted squares of all errors as large as expected."""

    def lacking(size: float) -> float:
        found = 0.0
        for part in parts:
            whole = part.covariance + size * part.by_joints @ np.swapaxes(part.by_joints, 1, 2)
            found += float((part.error * np.linalg.solve(whole, part.error[..., None])[..., 0]).sum()) - part.numbers
        return found

    low, high = 0.0, 1e-10
    if lacking(low) <= 0:
        return 0.0
    while lacking(high) > 0:
        if high > 1.0:  # more than a radian is no error of a calibration
            return high
        low, high = high, 10 * high
    return float(scipy.optimize.brentq(lacking, low, high, rtol=1e-3))
