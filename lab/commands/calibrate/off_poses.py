"""Poses that are off, among those fitted and among those held out, and how heavy the noise's tails are."""

from functools import partial

import numpy as np

from lab.calibration.gauss_newton import Observations
from lab.calibration.identify import Identification
from lab.calibration.noise.tails import tail_dof
from lab.calibration.observation import observation_of, only_positions
from lab.calibration.statistics.linearized import NoiseDistribution, linearized
from lab.calibration.statistics.outliers import LEAST_SIGMA_M, HeldOut, Outliers, find_outliers, off_held_out
from lab.calibration.weights import Noise, joined, weighed, weighted_constraints
from lab.core.measurements import Measurements
from lab.core.random import rng_for

__all__ = ["off_among_fitted", "off_among_held", "tail_of"]


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
    alone, extra = observations.pose_by_pose(), start.extra_residuals
    searched = partial(
        find_outliers,
        start.model,
        alone,
        start.fit.free,
        start.nominal_aligned,
        known=known,
        things=observation.positions or None,
    )
    if start.prior is not None and start.prior.automatic:  # the fit weighs it by a sigma that outliers inflate
        beside, sigma = weighted_constraints(observation, observations), 1.0
        if not known:
            unweighted = joined(beside, start.prior.rows(LEAST_SIGMA_M))
            sigma = _sigma_without(searched(extra_residuals=unweighted, rng=rng_for(seed, "null"), shape=shape), alone)
        extra = joined(beside, start.prior.rows(sigma))
    search = partial(searched, extra_residuals=extra)
    found = search(rng=rng_for(seed, "null"), shape=shape)
    if not len(found.rows) or not only_positions(observation):
        return found
    tail = tail_dof(linearized(start.model, alone, found.fit.values, start.fit.free, extra))
    if np.isinf(tail):
        return found
    return search(rng=rng_for(seed, "null"), shape=NoiseDistribution("student", dof=tail))


def _sigma_without(found: Outliers, observations: Observations) -> float:
    """The sigma that the residuals of all poses say that are not off."""
    inside = np.ones(len(observations.inputs), dtype=np.bool_)
    inside[found.rows] = False
    dof = int(observations.seen[inside].sum()) * observations.points.shape[2] - found.fit.rank
    return max(float(np.sqrt(2 * found.fit.cost_trace[-1] / max(dof, 1))), LEAST_SIGMA_M)


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
