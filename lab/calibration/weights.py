"""Weights of measurements: by an instrument's noise, a given sigma, a row's own, or all equal."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from lab.calibration.gauss_newton import ExtraResiduals, Observations
from lab.calibration.observation import Observation
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.core.errors import LabError, option_name
from lab.core.linear_model import whitening
from lab.core.measurements import Measurements, seen_mask
from lab.core.se3 import Array
from lab.kinematics.effects.range_errors import RANGE, range_prior_rows
from lab.kinematics.model import Model
from lab.noise.error_model import Clock, ErrorModel, row_times, within_session
from lab.noise.error_term import UNCORRELATED, Components, ErrorShapes, correlation_of
from lab.noise.instruments import Instrument, is_isotropic

__all__ = [
    "Noise",
    "constraint_rows",
    "error_shapes",
    "joined",
    "root_mean_square_sigma",
    "weigh",
    "weighted_constraints",
]


@dataclass(frozen=True)
class Noise:
    """Assumed noise of an identification: an instrument's, a given sigma, or none.

    A row's own ``sigma_m`` goes before both. With neither, all measurements have the same weight and
    sigma is estimated from the residuals. ``shared`` are errors beside the instrument's; ``error_terms`` are names of
    terms that packages add, to be searched among these.
    """

    instrument: Instrument | None = None
    sigma_m: float | None = None
    readings: int = 1
    shared: ErrorModel | None = None
    error_terms: tuple[str, ...] = ()

    @property
    def independent(self) -> "Noise":
        """The noise without shared errors that were estimated from residuals."""
        return self if self.shared is None or self.shared.is_given else replace(self, shared=None)


def weigh(observation: Observation, data: Measurements, noise: Noise) -> tuple[Observations, bool]:
    """Return the points with their weights, and whether these are from a given sigma.

    Raises:
        LabError: only some rows have a sigma of their own, or the instrument measures nothing that is observed.
    """
    observed, known = _by_instrument(observation, data, noise)
    if noise.shared is None:
        return observed, known
    return _correlated(observation.model, observed, data, noise.shared, known=known), known


def _by_instrument(observation: Observation, data: Measurements, noise: Noise) -> tuple[Observations, bool]:
    inputs, units = data.inputs(observation.model.conditions), observation.units
    instrument = noise.instrument if noise.instrument is not None and noise.instrument.kind != "exact" else None
    shape = data.points.shape[:2]
    # without any noise all weights are equal
    given = np.isfinite(data.sigma_m)
    if noise.sigma_m is None and instrument is None and not (len(given) and given.all()):
        if given.any():
            raise LabError(
                f"sigma_mm is empty in some rows; fill it in, or give {option_name('noise_mm')} or "
                f"{option_name('instrument')} for those"
            )
        return Observations(inputs, data.points, np.broadcast_to(1 / units, shape)), False
    # an instrument's covariance, a row's own sigma before it
    rows = np.broadcast_to(data.sigma_m[:, None], shape)
    if instrument is not None and not is_isotropic(instrument):
        covariance = _instrument_covariance(observation, instrument, data.points, noise.readings)
        covariance = np.where(given[:, None, None, None], (rows * units)[..., None, None] ** 2 * np.eye(3), covariance)
        return Observations(inputs, data.points, whitening(covariance)), True
    # one sigma, a row's own before it
    default = noise.sigma_m if instrument is None else instrument.isotropic_sigma(noise.readings)
    sigma = rows if default is None else np.where(np.isnan(rows), default, rows)
    return Observations(inputs, data.points, 1 / (sigma * units)), True


def _instrument_covariance(observation: Observation, device: Instrument, points: Array, readings: int) -> Array:
    """Return ``(n, k, 3, 3)``: the instrument's of positions; of other quantities their mean in units."""
    if not observation.positions:
        raise LabError(
            f"{device.name} measures points, of which none are observed: give {option_name('noise_mm')} instead"
        )
    observed = np.nan_to_num(points[:, : observation.positions], nan=1.0)
    covariance = np.asarray(device.covariance(observed, readings))
    if observation.positions == len(observation.units):
        return covariance
    mean = float(np.trace(covariance, axis1=2, axis2=3).mean()) / 3
    others = (mean * observation.units[observation.positions :, None, None] ** 2) * np.eye(3)  # their covariance
    return np.concatenate([covariance, np.broadcast_to(others, (len(points), *others.shape))], axis=1)


def root_mean_square_sigma(observed: Observations, positions: int, units: Array | float = 1.0) -> float:
    """Return the sigma of an observed number, as it is weighted, where its unit is one.

    Of the first ``positions`` things; of all where there are none.

    Args:
        units: ``(k,)`` of each thing.
    """
    things = positions or observed.points.shape[1]
    seen = seen_mask(observed.points[:, :things])
    if observed.whiten.ndim == 2:
        return float(np.sqrt(np.mean(1 / (observed.whiten * units)[:, :things][seen] ** 2)))
    whiten = observed.whiten[:, :things][seen]
    return float(np.sqrt(np.mean(np.sum(np.linalg.inv(whiten) ** 2, axis=(1, 2))) / 3))


def weighted_constraints(observation: Observation, observed: Observations) -> ExtraResiduals:
    """Return the prior information of an observation, weighted as its measurements are, and of its range errors.

    Range errors are of a named instrument, whose noise is known: their prior has its own weight.
    """
    beside: ExtraResiduals = partial(_weighted, observation, observed.typical_weight)
    parameters = observation.model.parameters
    if not any(each.group == RANGE for each in parameters):
        return beside
    return joined(beside, partial(range_prior_rows, parameters))


def constraint_rows(observation: Observation, observed: Observations, values: Array) -> Array:
    """Return the derivatives ``(r, p)`` of this prior information, in units of the positions (m)."""
    rows: Array = weighted_constraints(observation, observed)(values)[1] / observed.typical_weight
    return rows


def _weighted(observation: Observation, weight: float, values: Array) -> tuple[Array, Array]:
    residual, jacobian = observation.extra_residuals(values)
    return weight * residual, weight * jacobian


def joined(first: ExtraResiduals, second: ExtraResiduals) -> ExtraResiduals:
    """Join two sources of extra residuals."""
    return partial(_both, first, second)


def _both(first: ExtraResiduals, second: ExtraResiduals, values: Array) -> tuple[Array, Array]:
    (a, da), (b, db) = first(values), second(values)
    return np.concatenate([a, b]), np.concatenate([da, db])


def error_shapes(
    model: Model, observed: Observations, values: Array, joints: int, times: Array, clock: Clock | None
) -> ErrorShapes:
    """Return the effects of joints, a shift of the base and a drift on the observed numbers, whitened like these."""
    n, k, d = observed.points.shape
    mask = observed.seen[..., None, None]
    slopes = by_joint_positions(model, observed.inputs, values, joints)
    moved = np.broadcast_to(np.eye(d), (n, k, d, d))
    scatter, shift = (
        np.where(mask, observed.in_units_of_noise(each), 0.0).reshape(n, k * d, -1) for each in (slopes, moved)
    )
    if observed.correlation is not None:
        scatter, shift = (observed.correlation.white(each) for each in (scatter, shift))
    along = np.ones(n) if clock is None else (within_session(times) - clock.middle) / clock.half_span
    return ErrorShapes(scatter, shift, along, times)


def _correlated(
    model: Model, observed: Observations, data: Measurements, shared: ErrorModel, *, known: bool
) -> Observations:
    """Return the measurements, weighted by the instrument, with the errors that they share.

    Args:
        model: that predicts ``observed``; parameters without a value in ``shared`` are zero.
        known: whether the weights stand on a known sigma; else they are in units of ``shared.sigma_m``.
    """
    values = np.array([shared.values.get(name, 0.0) for name in model.names])
    alone = replace(observed, whiten=observed.whiten / np.sqrt(shared.independent_share)) if known else observed
    times, unit = row_times(data, shared.clock), 1.0 if known else shared.sigma_m
    shapes = error_shapes(model, alone, values, data.joints.shape[1], times, shared.clock)
    variances = {term.name: (shared.size(term.name) / unit) ** 2 for term in shared.terms}
    carry = shared.carry if shared.carry > UNCORRELATED else 0.0
    correlation = correlation_of(shapes, Components(variances, carry))
    if shared.counts_rad is not None:
        rounded = shapes.scatter @ shared.counts_rad / unit
        correlation = replace(correlation, scatter=np.concatenate([correlation.scatter, rounded], axis=2))
    return replace(alone, correlation=correlation)
