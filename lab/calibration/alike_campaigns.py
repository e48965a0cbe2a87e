"""Identify campaigns at the same poses together: ``identify`` of each, with one stacked least squares for all.

The first campaign is identified alone. It shows what is identifiable and the least prior; of the others, those stay out
that call for more than plain least squares: they are identified alone, too.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.calibration.batched_fits import (
    BLOCK,
    BatchFits,
    PointBatch,
    align,
    fit_points,
    in_the_instruments_frame,
    weighted,
)
from lab.calibration.fit_options import FitOptions
from lab.calibration.gauss_newton import Fit, Observations, settled
from lab.calibration.guess import columns_of
from lab.calibration.identification import Identification, needs_no_prior, spread
from lab.calibration.observation import Points, observation_of
from lab.calibration.prior import Prior, prior_of
from lab.calibration.weights import Noise, root_mean_square_sigma, weigh, weighted_constraints
from lab.core.linear_model import unit_columns
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.kinematics.gauge import same_base_set
from lab.kinematics.serial.serial_arm import SerialArm, stacked

__all__ = ["identify_alike"]

_WELL_CONDITIONED = 1e3  # of the Jacobian in unit columns: beyond, a fit is damped and reported
_LIKE_THE_FIRST = 2.0  # times its residuals: beyond, another minimum is possible


def identify_alike(
    first: Identification, data: Measurements, points: Array, nominal: Array, noise: Noise, options: FitOptions
) -> list[Identification | None]:
    """Identify campaigns that have another's poses, weights and options, from all measured points of their own.

    Args:
        first: the identification of ``data``, by ``nominal``, ``noise`` and ``options``.
        points: ``(b, n, k, 3)`` m of the campaigns, at the rows of ``data``.

    Returns:
        For each campaign what ``identify`` returns; None where it has to be identified alone: effects, an estimator, a
        prior or damped steps take part, points are missing, or the fit is not like the first one.
    """
    plain = noise.shared is None and _is_plain(options)
    if not (plain and _is_plain_fit(first) and np.isfinite(points).all()):
        return [None] * len(points)
    batch = _Batch(first, data, nominal, noise, options)
    parts = [points[i : i + BLOCK] for i in range(0, len(points), BLOCK)]
    return [one for part in parts for one in batch.identified(part)]


def _is_plain(options: FitOptions) -> bool:
    """Check whether options request least squares of all parameters at once from nominal links."""
    return options.solve is None and options.estimator is None and options.prior != "on" and not options.near


def _is_plain_fit(first: Identification) -> bool:
    """Check whether a well-conditioned fit gave all identifiable parameters of a rigid serial arm and its base."""
    observation, free = observation_of(first.model), set(first.fit.free)
    if not (isinstance(observation, Points) and isinstance(first.model, SerialArm)) or first.prior is not None:
        return False
    usual = first.fit.status == "converged" and first.plausible and first.dof > 0
    return usual and free >= {*range(6), *first.base_set.identifiable} and first.fit.condition < _WELL_CONDITIONED


@dataclass(frozen=True)
class _Batch:
    """Campaigns beside a first one."""

    first: Identification
    data: Measurements
    nominal: Array
    noise: Noise
    options: FitOptions

    def identified(self, points: Array) -> list[Identification | None]:
        """Identify campaigns by their points ``(b, n, k, 3)``."""
        first, model, free = self.first, self.first.model, list(self.first.fit.free)
        observation, (b, n) = observation_of(model), points.shape[:2]
        # weigh all points in one table
        table = replace(self.data[np.tile(np.arange(n), b)], points=points.reshape(b * n, *points.shape[2:]))
        observed, _ = weigh(observation, table, self.noise)
        inputs, whiten = observed.inputs[:n], observed.whiten.reshape(b, n, *observed.whiten.shape[1:])
        # place base and tool by the nominal links, all points of the same weight
        arms = stacked(model)
        campaigns = align(arms, inputs, points, first.nominal_aligned)
        placed = fit_points(campaigns, first.nominal_aligned, columns_of(model, observation.placed))
        aligned = in_the_instruments_frame(campaigns, placed.values)
        # fit the identifiable parameters by the points' weights, the others at nominal
        start = placed.values.copy()
        start[:, list(first.base_set.fixed)] = self.nominal[list(first.base_set.fixed)]
        fits = fit_points(_weighted(campaigns, whiten), start, free)
        solved = np.asarray(placed.converged & fits.converged & _well_placed(placed))
        result: list[Identification | None] = [None] * b
        if not solved.any():
            return result
        # the triangle in the instrument's frame, and further steps of ill-conditioned fits
        points, whiten, aligned = points[solved], whiten[solved], aligned[solved]
        values = in_the_instruments_frame(campaigns.take(np.flatnonzero(solved)), fits.values[solved])
        unturned = np.broadcast_to(np.eye(4), (len(points), 4, 4))
        measured = PointBatch(arms, inputs, points.transpose(0, 2, 3, 1), unturned)
        triangles = _triangles(_weighted(measured, whiten), values, free)
        triangles *= whiten[0, 0, 0] if _equal(whiten) else 1.0
        single = [Observations(inputs, *each) for each in zip(points, whiten, strict=True)]
        solutions = [settled(model, *each) for each in zip(single, _fits(values, free, triangles), strict=True)]
        predicted = arms.points(inputs, np.array([each.values for each in solutions])).transpose(0, 3, 1, 2)
        spreads = first.spread * np.array([spread(each) for each in points]) / spread(self.data.points)
        several = zip(single, aligned, solutions, points - predicted, spreads, strict=True)
        for i, one in zip(np.flatnonzero(solved), several, strict=True):
            result[i] = self._identification(*one)
        return result

    @cached_property
    def _prior(self) -> Prior | None:
        """The prior of the links, which is the same wherever base and tool are; None where none is requested."""
        if self.options.prior == "off":
            return None
        first = self.first
        return prior_of(first.model, first.base_set, self.nominal, self.options.tolerance, links_alone=True)

    def _stays(self, solution: Fit, unit_sigma: float) -> bool:
        """Check whether a fit is well-conditioned, and no prior takes part in it."""
        if not solution.condition < _WELL_CONDITIONED:
            return False
        prior, structure, sigma_given = self._prior, self.first.base_set, self.first.sigma_given
        return prior is None or needs_no_prior(prior, solution, structure, unit_sigma, sigma_given=sigma_given)

    def _identification(
        self, observed: Observations, aligned: Array, solution: Fit, residuals: Array, spread_ratio: float
    ) -> Identification | None:
        """Return the identification of one campaign; None where it has to be identified alone."""
        first, observation = self.first, observation_of(self.first.model)
        # the noise of the residuals, in units of the weights
        white = observed.apply(residuals)
        unit_sigma = float(np.sqrt(white @ white / first.dof))
        given = root_mean_square_sigma(observed, observation.positions, observation.units) if first.sigma_given else 1.0
        # leave out another minimum, and what would be reported, damped or helped by a prior
        like_first = given * unit_sigma < _LIKE_THE_FIRST * first.residual_sigma_m
        if not (like_first and self._stays(solution, unit_sigma)):
            return None
        scale = 1.0 if first.sigma_given else unit_sigma
        identification = replace(
            first,
            nominal_aligned=aligned,
            values=solution.values,
            base_set=same_base_set(first.base_set, first.model, aligned),
            fit=solution,
            sigma_m=given * scale,
            residual_sigma_m=given * unit_sigma,
            covariance=solution.unit_covariance() * scale**2,
            residuals=residuals,
            spread=float(spread_ratio),
            extra_residuals=weighted_constraints(observation, observed),
        )
        return identification if identification.plausible else None


def _equal(whiten: Array) -> bool:
    """Check whether all coordinates have the same weight."""
    return whiten.ndim == 3 and bool((whiten == whiten[0, 0, 0]).all())


def _weighted(campaigns: PointBatch, whiten: Array) -> PointBatch:
    """Return campaigns weighted by ``(b, n, k)`` or ``(b, n, k, 3, 3)``; as they are where all weights are equal."""
    if _equal(whiten):
        return campaigns
    return weighted(campaigns, whiten[..., None, None] * np.eye(3) if whiten.ndim == 3 else whiten)


def _triangles(campaigns: PointBatch, values: Array, free: list[int]) -> Array:
    """Return R ``(b, f + 1, f + 1)`` of the whitened Jacobian of the free parameters, with the residual beside it."""
    jacobian, residual = campaigns.linearized(values, free)
    rows = np.concatenate([jacobian, residual[:, None]], axis=1).swapaxes(1, 2)  # (b, r, f + 1)
    return np.asarray(np.linalg.qr(rows, mode="r"))


def _fits(values: Array, free: list[int], triangles: Array) -> Iterator[Fit]:
    """Yield the fit of each campaign, without the steps that led to it."""
    for own, upper in zip(values, triangles, strict=True):
        columns, scale = unit_columns(upper[:-1, :-1])
        yield Fit(own, tuple(free), "converged", (0.5 * float(upper[:, -1] @ upper[:, -1]),), columns, scale)


def _well_placed(placed: BatchFits) -> NDArray[np.bool_]:
    """Check ``(b,)`` whether base and tool are determined by the nominal links: a condition below 1000."""
    scale = np.sqrt(np.diagonal(placed.information, axis1=1, axis2=2))
    usable = np.asarray(np.isfinite(placed.information).all(axis=(1, 2)) & (scale > 0).all(axis=1))
    square = placed.information / (scale[:, :, None] * scale[:, None, :])
    sizes = np.linalg.eigvalsh(np.where(usable[:, None, None], square, np.eye(square.shape[1])))
    well: NDArray[np.bool_] = sizes[:, 0] * _WELL_CONDITIONED**2 > sizes[:, -1]
    return usable & well
