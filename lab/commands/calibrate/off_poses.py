"""Poses that are off, among those fitted and among those held out, and how heavy the noise's tails are."""

from functools import partial

import numpy as np

from lab.calibration.gauss_newton import ExtraResiduals, Observations
from lab.calibration.identify import Identification
from lab.calibration.noise.tails import tail_dof
from lab.calibration.observations.protocol import observation_of, only_positions
from lab.calibration.statistics.linearized import NoiseDistribution, linearized
from lab.calibration.statistics.outliers import LEAST_SIGMA_M, HeldOut, Outliers, find_outliers, off_held_out
from lab.calibration.weights import Noise, joined, weighed, weighted_constraints
from lab.core.measurements import Measurements
from lab.core.random import rng_for

__all__ = ["off_among_fitted", "off_among_held", "tail_of"]

NORMAL_QUARTILE = 0.6744897501960817  # half of normal errors are smaller, in their standard deviations


def off_among_fitted(
    start: Identification, rows: Measurements, noise: Noise, shape: NoiseDistribution, seed: int
) -> Outliers:
    """The rows that are off, by a search that starts from an identification.

    Args:
        shape: of the noise, where it has no heavy tails.
        seed: of the draws that the level stands on.
    """
    observation = observation_of(start.model)
    observations, known = weighed(observation, rows, noise)
    alone, extra = observations.pose_by_pose(), _known_beside(start, observations, known=known)
    search = partial(
        find_outliers,
        start.model,
        alone,
        start.fit.free,
        start.nominal_aligned,
        known=known,
        extra_residuals=extra,
        things=observation.positions or None,
    )
    found = search(rng=rng_for(seed, "null"), shape=shape)
    if not len(found.rows) or not only_positions(observation):
        return found
    tail = tail_dof(linearized(start.model, alone, found.fit.values, start.fit.free, extra))
    if np.isinf(tail):
        return found
    return search(rng=rng_for(seed, "null"), shape=NoiseDistribution("student", dof=tail))


def _known_beside(start: Identification, observations: Observations, *, known: bool) -> ExtraResiduals:
    """What is known beside the measurements, an automatic prior weighed by a sigma that outliers do not inflate."""
    prior = start.prior
    if prior is None or not prior.automatic:
        return start.extra_residuals
    white = observations.apply(observations.points - start.model.points(observations.inputs, start.values))
    sigma = 1.0 if known else max(float(np.median(np.abs(white))) / NORMAL_QUARTILE, LEAST_SIGMA_M)
    return joined(weighted_constraints(observation_of(start.model), observations), prior.rows(sigma))


def off_among_held(found: Identification, rows: Measurements, held: Measurements, noise: Noise, tail: float) -> HeldOut:
    """The poses held out that are off, by an identification from ``rows``.

    Args:
        tail: of ``tail_of``.
    """
    observation = observation_of(found.model)
    parts = [weighed(observation, part, noise) for part in (rows, held)]
    both = parts[0][0].pose_by_pose().joined(parts[1][0].pose_by_pose())
    return off_held_out(
        found.model,
        both,
        len(rows),
        found.fit,
        known=parts[0][1],
        extra_residuals=found.extra_residuals,
        things=observation.positions,
        tail_dof=tail,
    )


def tail_of(found: Identification, rows: Measurements, noise: Noise) -> float:
    """Degrees of freedom of the noise's tails; infinite where they may be Gaussian."""
    if not only_positions(observation := observation_of(found.model)):
        return float("inf")
    alone = weighed(observation, rows, noise)[0].pose_by_pose()
    return tail_dof(linearized(found.model, alone, found.values, found.fit.free, found.extra_residuals))
