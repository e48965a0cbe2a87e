"""Estimate the pose of the flange's face in the last frame of a calibrated arm.

Measured points of the tool are located relative to the last joint's axis. The face relative to that axis (along it,
about it, beside it, tilted) follows from two sources alone: the nominal last link, within the tolerances of
manufacture, and the stated places of the points in the flange. The first is a normal prior of a small motion
d = (t, phi) of the face in the last frame, the second are measurements of it: a point stated at s is measured at
s + t + phi x s. Both together are a linear least-squares problem of six unknowns.

Three points and more show by the distances between them how well their places are stated. Where all of them are farther
from their places, or more turned, than tolerances of the last link explain, they sit on something that was not stated
(an adapter), and are not used.
"""

from dataclasses import dataclass

import numpy as np

from lab.core import se3
from lab.core.probability import chi2_sf
from lab.core.se3 import Array

__all__ = ["Flange", "located_flange", "point_rows"]

_STATED_M = 10e-6  # one standard deviation of a stated coordinate, before distances between points show it
_STATED_DOF = 1  # as many residuals that weighs
_LEVEL = 0.01  # of each of two tests: the chance that places stated rightly are not used
_SPREAD_M = 1e-3  # of points about a line: below, they do not turn about it
_RANK = 1e-6  # of the largest singular value: below, points show no such motion
_DETERMINED = 0.5  # of its tolerance: a rotation more certain than that is identified


@dataclass(frozen=True)
class Flange:
    """Pose of the flange in the last frame of the calibrated arm, with its covariance.

    Attributes:
        T_last_flange: ``(4, 4)`` m.
        gain: ``(6, 3 k)`` derivative of the estimated motion (m, rad) by the k measured points.
        covariance: ``(6, 6)`` of the motion's errors that are not those of the measured points.
        dof: degrees of freedom of the covariance's size.
        turned: whether they determine the flange's rotation.
        deviation_m: ``(k,)`` distance of each measured point from its stated position in the nominal flange.
    """

    T_last_flange: Array
    gain: Array
    covariance: Array
    dof: float
    uses_stated: bool
    turned: bool
    deviation_m: Array


def point_rows(points: Array) -> Array:
    """Return derivatives ``(..., 3, 6)`` of points ``(..., 3)`` of a body by its small motion (m, rad): [1, -[p]x]."""
    one = np.broadcast_to(np.eye(3), (*points.shape, 3))
    return np.concatenate([one, -se3.skew(points)], axis=-1)


def located_flange(
    measured: Array, covariance: Array, stated: Array, prior: Array, dof: float, *, posed: bool = False
) -> Flange:
    """Estimate the pose of the flange.

    Args:
        measured: ``(k, 3)`` m, the points in the last frame; none where no place was stated.
        covariance: ``(3 k, 3 k)`` m^2 of them.
        stated: ``(k, 3)`` m, their places in the flange.
        prior: ``(6, 6)`` covariance (m, rad) that tolerances give the flange's motion.
        posed: whether the points stand for a measured pose: distances between them then show nothing.
    """
    # The motion's measurements, d = motion of the face, against its prior by the last link's tolerances.
    count = 3 * len(stated)
    deviation = (measured - stated).ravel()
    distances = np.asarray(np.linalg.norm(measured - stated, axis=1))
    nothing = Flange(np.eye(4), np.zeros((6, count)), prior, dof, False, False, distances)
    if not count:
        return nothing
    rows = point_rows(stated).reshape(count, 6)
    variance, shape_dof = (
        (_STATED_M**2, dof) if posed else _stated_variance(rows, stated, deviation, _least(prior[:3, :3]))
    )
    whole = rows @ prior @ rows.T + covariance + variance * np.eye(count)
    if _is_elsewhere(whole, rows, deviation):
        return nothing
    # The posterior mean and covariance of the linear least-squares problem.
    gain = np.asarray(np.linalg.solve(whole, rows @ prior).T)
    motion, left = gain @ deviation, np.eye(6) - gain @ rows
    posterior = left @ prior @ left.T + variance * gain @ gain.T
    turned = bool(np.linalg.eigvalsh(posterior[3:, 3:]).max() < _DETERMINED**2 * _least(prior[3:, 3:]))
    T = se3.pose(se3.exp(motion[3:]), motion[:3])
    return Flange(T, gain, np.asarray(posterior), shape_dof if turned else dof, True, turned, distances)


def _is_elsewhere(whole: Array, rows: Array, deviation: Array) -> bool:
    """Decide whether points are moved together farther than errors of this covariance explain.

    Distances between them have no part in it: it is a test of what they have in common with a rigid motion, and one of
    their mean, which finds a shift better.
    """
    motions, sizes, _ = np.linalg.svd(rows, full_matrices=False)
    motions = motions[:, sizes > _RANK * sizes[0]]
    mean = np.tile(np.eye(3), (len(deviation) // 3, 1))
    chances = []
    for basis in (motions, mean):
        along = basis.T @ deviation
        square = along @ np.linalg.solve(basis.T @ whole @ basis, along)
        chances.append(float(chi2_sf(square, basis.shape[1])))
    return min(chances) < _LEVEL


def _least(covariance: Array) -> float:
    return float(np.linalg.eigvalsh(covariance)[0])


def _stated_variance(rows: Array, stated: Array, deviation: Array, as_a_link: float) -> tuple[float, float]:
    """Variance (m^2) of a stated coordinate and its degrees of freedom; as of a link where no distances show it."""
    apart = np.linalg.svd(stated - stated.mean(axis=0), compute_uv=False)
    if len(stated) < 3 or apart[1] < _SPREAD_M:
        return as_a_link, 1.0
    left = deviation - rows @ np.linalg.lstsq(rows, deviation, rcond=None)[0]
    dof = len(deviation) - 6 + _STATED_DOF
    return float((left @ left + _STATED_DOF * _STATED_M**2) / dof), float(dof)
