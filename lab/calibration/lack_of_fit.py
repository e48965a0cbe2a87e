"""Test lack of fit, and choose the intervals: those of the weights, or cluster-robust ones of whole poses."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.identify import Identification
from lab.calibration.noise.rigid_distances import goodness_by_distances, instrument_noise
from lab.calibration.observation import observation_of, only_positions
from lab.calibration.statistics.goodness_of_fit import (
    goodness_beside_shared_errors,
    goodness_of_fit,
    isotropy,
    repeats,
    sandwich,
)
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.calibration.statistics.linearized import NoiseDistribution, linearized
from lab.calibration.statistics.outliers import LEAST_SIGMA_M
from lab.calibration.validation import configurations
from lab.calibration.weights import Noise, weigh
from lab.core.checks import Check
from lab.core.measurements import Measurements, seen_mask
from lab.core.probability import f_isf
from lab.core.significance import UNSOLICITED_WARNING
from lab.noise.error_model import ErrorModel
from lab.noise.instruments import is_isotropic

__all__ = ["adequacy_of", "with_intervals_of_poses", "with_own_intervals"]


def _beside_shared_errors(
    found: Identification,
    observations: Observations,
    rows: Measurements,
    shared: ErrorModel,
    instrument: tuple[Observations, NoiseDistribution] | None = None,
) -> Check:
    """Test whether residuals vary with the joints, beside errors that are independent between poses.

    Where the instrument's noise was given, residuals above it are lack of fit, even where shared errors would explain
    them: without repeats nothing shows that these are not what the model lacks.

    Args:
        instrument: the observations weighted by the instrument alone, and the shape of its noise; None where sigma was
            estimated.
    """
    linear = linearized(found.model, observations, found.values, found.fit.free, found.extra_residuals)
    slopes = by_joint_positions(found.model, observations.inputs, found.values, rows.joints.shape[1])
    judged = goodness_beside_shared_errors(linear, linear.rows_of(observations, slopes), rows.joints)
    judged = replace(judged, data={**judged.data, "shared": shared})
    if judged.outcome == "failed" or instrument is None:
        return judged
    extra = found.extra_residuals
    alone = goodness_of_fit(
        found.model, instrument[0], found.fit, sigma_given=True, shape=instrument[1], extra_residuals=extra
    )
    if alone.outcome != "failed":
        return judged
    return replace(alone, data={**alone.data, "shared": shared})


def _by_distances(found: Identification, observations: Observations, rows: Measurements) -> Check | None:
    """Test residuals against the instrument's noise, estimated from a tool's rigid distances.

    None where there are none, or where the noise is not the same in all directions: then distances, which lie across
    the line of sight as often as not, do not say what it is.
    """
    if found.sigma_given or not only_positions(observation_of(found.model)):
        return None
    instrument = instrument_noise(rows.points)
    if instrument is None or not instrument.is_rigid or instrument.sigma_m < LEAST_SIGMA_M:
        return None
    if _is_of_the_instrument(found, observations):
        return None
    return goodness_by_distances(found.residual_sigma_m**2 * found.dof, found.dof, instrument)


def with_own_intervals(
    found: Identification, observations: Observations, noise: Noise, *, searched: bool, plausible: bool
) -> tuple[Identification, list[Check]]:
    """Return the identification with the poses' own intervals, and the test of that, where directions are uneven.

    It is the instrument's only where targets of one pose show it against each other, which the arm moves as one; else
    the arm may be the cause, and the intervals are those of whole poses (cluster-robust).

    Args:
        searched: whether effects of the arm were searched.
        plausible: whether the weights stand on a known sigma or on a prior.
    """
    device = noise.instrument
    if (device is not None and not is_isotropic(device)) or found.sigma_m < LEAST_SIGMA_M:
        return found, []
    seen = isotropy(found.model, observations, found.fit)
    if seen.outcome != "failed":
        return found, []
    clustered = not plausible and len(np.unique(_clusters(found, observations))) > len(found.fit.free)
    of_instrument = _is_of_the_instrument(found, observations)
    data = {"of_instrument": of_instrument, "clustered": clustered, "searched": searched}
    check = Check("intervals.uneven", "failed", seen.statistic, seen.p, UNSOLICITED_WARNING, data)
    return _of_whole_poses(found, observations) if clustered else found, [check]


def with_intervals_of_poses(
    found: Identification, observations: Observations, *, searched: bool
) -> tuple[Identification, list[Check]]:
    """Return the identification with cluster-robust intervals, and why, where what poses share is undecided.

    Args:
        searched: whether effects of the arm were searched.
    """
    if len(np.unique(_clusters(found, observations))) <= len(found.fit.free):
        return found, []
    return _of_whole_poses(found, observations), [Check("intervals.undecided", "failed", data={"searched": searched})]


def _of_whole_poses(found: Identification, observations: Observations) -> Identification:
    """The identification with the covariance of each configuration's own residuals: repeats are one cluster."""
    linear = linearized(found.model, observations, found.values, found.fit.free)
    own = sandwich(linear.by_cluster(_clusters(found, observations)))
    return replace(found, covariance=own.covariance, dof_each=own.dof)


def _clusters(found: Identification, observations: Observations) -> NDArray[np.int_]:
    """Label the configurations of the poses."""
    joints = observations.inputs.shape[1] - len(found.model.conditions)
    return configurations(observations.inputs[:, :joints])


def _is_of_the_instrument(found: Identification, observations: Observations) -> bool:
    """Test whether residuals of targets about their pose's mean differ across and along the line of sight."""
    mask = seen_mask(observations.points)
    several = mask.sum(axis=1) > 1
    if not several.any():
        return False
    residuals = np.where(
        mask[..., None], observations.points - found.model.points(observations.inputs, found.values), 0
    )
    middle = residuals.sum(axis=1, keepdims=True) / np.maximum(mask.sum(axis=1), 1)[:, None, None]
    apart = np.where(mask[..., None], residuals - middle, 0.0)[several]
    points = np.nan_to_num(observations.points[several])
    sight = points / np.maximum(np.linalg.norm(points, axis=2, keepdims=True), 1e-300)
    along = (apart * sight).sum(axis=2)
    across = float((apart**2).sum() - (along**2).sum()) / 2
    numbers = float(mask[several].sum() - several.sum())
    ratio = across / max(float((along**2).sum()), 1e-300)
    return max(ratio, 1 / max(ratio, 1e-300)) > _uneven(numbers)


def _uneven(numbers: float) -> float:
    """Return the critical ratio of two variances, of twice as many and as many numbers."""
    return float(
        max(
            f_isf(UNSOLICITED_WARNING / 2, 2 * numbers, numbers),
            f_isf(UNSOLICITED_WARNING / 2, numbers, 2 * numbers),
        )
    )


def adequacy_of(
    found: Identification, rows: Measurements, held_out: Measurements | None, noise: Noise, shape: NoiseDistribution
) -> Check:
    """Test whether a model fits its rows, by the best test that the data allow.

    Args:
        held_out: poses that were not fitted; None, or without rows, where there are none to test by.
        shape: of the instrument's noise.
    """
    observation = observation_of(found.model)
    observations, sigma_given = weigh(observation, rows, noise)
    shared = noise.shared if noise.shared is None or not noise.shared.is_given else None
    labels = repeats(rows) if shared is not None or not sigma_given else None
    unrepeated = labels is not None and len(np.unique(labels)) == len(labels)
    if shared is not None and unrepeated:
        alone = weigh(observation, rows, replace(noise, shared=None))[0]
        instrument = (alone, shape) if sigma_given else None
        return _beside_shared_errors(found, observations, rows, shared, instrument)
    if unrepeated and (judged := _by_distances(found, observations, rows)) is not None:
        return judged
    judging = held_out if held_out is not None and len(held_out) and observation.positions else None
    return goodness_of_fit(
        found.model,
        observations,
        found.fit,
        sigma_given=sigma_given and shared is None,
        shape=shape,
        labels=labels,
        held_out=None if judging is None else weigh(observation, judging, noise)[0],
        extra_residuals=found.extra_residuals,
    )
