"""Model the errors of measured numbers beside the instrument's, as they were found in one set of measurements.

A value of SI units from which the shared errors of any measurements of the same arm follow: of those that it was
estimated from, of poses held out, and of those of another day.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to

from lab.calibration.gauss_newton import Observations
from lab.calibration.noise.change_points import APART, session_of
from lab.calibration.noise.error_term import Components, ErrorShapes, ErrorSizes, ErrorTerm, Move
from lab.calibration.noise.terms import HARDLY_CORRELATED, TERMS, correlation_of
from lab.calibration.statistics.joint_rounding import by_joint_positions, counting
from lab.core.measurements import Measurements, seen_mask, setups
from lab.core.se3 import Array
from lab.kinematics.encoders import Encoders
from lab.kinematics.model import Model

__all__ = ["NOTABLE", "Clock", "ErrorModel", "correlated", "counted", "error_shapes", "row_times"]

NOTABLE = 0.1  # of the noise: what whole counts of the encoders make beside it
_LEAST_ALONE = 0.1  # of a noise that was estimated with the counts in it: what it is at least without them


@dataclass(frozen=True)
class Clock:
    """The time of a campaign, in the spacing of its poses.

    Attributes:
        middle: the mean time of its poses.
        half_span: from there to the last.
        origin_s, spacing_s: of ``time_s``: where times begin, and what one of them is; None where rows are counted.
        sessions: in their order.
    """

    middle: float
    half_span: float
    origin_s: float = 0.0
    spacing_s: float | None = None
    sessions: tuple[tuple[str, str], ...] = ()

    @staticmethod
    def of(data: Measurements) -> "Clock":
        """Of measured rows; sessions are laid side by side."""
        seconds, origin, spacing = data.conditions.get("time_s", np.full(len(data), np.nan)), 0.0, None
        if np.isfinite(seconds).all() and (gaps := np.diff(np.sort(seconds))).size and np.median(gaps) > 0:
            origin, spacing = float(seconds.min()), float(np.median(gaps))
        known = Clock(0.0, 1.0, origin, spacing, tuple(dict.fromkeys(setups(data))))
        within = _within_session(row_times(data, known))
        return replace(
            known, middle=float(within.mean()), half_span=float(max(np.abs(within - within.mean()).max(), 1.0))
        )


@dataclass(frozen=True)
class ErrorModel:
    """Standard deviations of the errors that numbers share, term by term.

    Attributes:
        sigma_m: of the instrument, of one coordinate, as it was estimated beside them.
        independent_share: of a known instrument's variance: how much of it is independent from pose to pose.
        sizes: by the name of the term, without those of zero.
        clock: of that campaign; None on another day, when a drift has come to an end that nobody knows.
        values: parameters by name, at which the derivatives by the joints are taken.
        carry: the correlation of the autoregressive term from one pose to the next.
        counts_rad: ``(J, J)`` a root of the covariance that whole counts of known encoders give the joint positions
            (rad, m); None where they are ideal, or too fine to be weighted.
        moves: of the base at once; none on another day, when nobody knows where it was left.
    """

    sigma_m: float
    independent_share: float
    sizes: Mapping[str, float]
    clock: Clock | None
    values: Mapping[str, float]
    carry: float = 0.0
    counts_rad: Array | None = None
    moves: tuple[Move, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "sizes", {name: size for name, size in self.sizes.items() if size})

    def size(self, name: str) -> float:
        """Return the standard deviation of a term by its name; zero where it is not there."""
        return self.sizes.get(name, 0.0)

    @property
    def terms(self) -> tuple[ErrorTerm, ...]:
        """The terms that are there."""
        return tuple(term for term in TERMS if self.size(term.name) > 0)

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of the terms that are there."""
        return tuple(term.kind for term in self.terms)

    @property
    def is_known(self) -> bool:
        """Whether nothing was estimated from residuals: only whole counts of the encoders beside the instrument."""
        return self.counts_rad is not None and not self.terms

    @property
    def scatter_rad(self) -> float:
        """Standard deviation of where each joint stops from one pose to the next; m of a slide."""
        return self.size("scatter")

    @property
    def wandering_m(self) -> float:
        """Standard deviation of a shift that is correlated in time, of one coordinate."""
        return self.size("shift")

    @property
    def drift_m(self) -> float:
        """Standard deviation of the shift at the end of a steady drift, of one coordinate."""
        return self.size("trend")

    @property
    def step_m(self) -> float:
        """Standard deviation of a shift where the base moves at once, of one coordinate."""
        return self.size("step")

    @property
    def common_m2(self) -> float:
        """Variance of a coordinate on another day: the independent errors beyond the instrument's, and every shift."""
        own = max(self.independent_m**2 - self.sigma_m**2, 0.0)
        return float(own + sum(self.size(term.name) ** 2 for term in self.terms if term.unit == "m"))

    @property
    def within_m2(self) -> tuple[float, ...]:
        """Mean variances of a coordinate that each term's shifts make in the campaign itself."""
        return tuple(term.variance_within(self.size(term.name), self.moves) for term in self.terms)

    def joint_covariance(self, joints: int) -> Array:
        """Covariance ``(J, J)`` of so many joints' positions at one pose (rad, m)."""
        own: Array = sum(self.size(term.name) ** 2 for term in TERMS if term.unit == "rad") * np.eye(joints)
        return own if self.counts_rad is None else own + self.counts_rad @ self.counts_rad.T

    def moved(self, name: str, step: float) -> "ErrorModel":
        """Return the model with the logarithm of one variance (of ``carry`` that of its odds) larger by ``step``.

        Args:
            name: as in ``small_samples.ComponentErrors``.
        """
        factor = float(np.exp(step / 2))
        if name == "scale":
            return replace(self, independent_share=self.independent_share * factor**2)
        if name == "carry":
            odds = self.carry / (1 - self.carry) * factor**2
            return replace(self, carry=odds / (1 + odds))
        return replace(self, sizes={**self.sizes, name: factor * self.size(name)})

    @property
    def independent_m(self) -> float:
        """The instrument's noise that is independent from pose to pose, of one coordinate."""
        return float(self.sigma_m * np.sqrt(self.independent_share))

    @property
    def words(self) -> tuple[str, ...]:
        """Each of the errors for a person."""
        said = ["joint positions are whole counts of the encoders"] if self.counts_rad is not None else []
        beside = ErrorSizes(self.carry, self.moves)
        return (*said, *(text for term in self.terms for text in term.words(self.size(term.name), beside)))

    def to_dict(self) -> dict[str, Any]:
        """Return the model as ``result.json`` holds it, without what is of that campaign alone."""
        found: dict[str, Any] = {
            "independent_mm": 1e3 * self.independent_m,
            "independent_share": self.independent_share,
        }
        for term in TERMS:
            if term.key:
                found[term.key] = 1e3 * self.size(term.name)
            if term.structure == "autoregressive":
                found["wandering_correlation"] = self.carry
        if further := {term.name: self.size(term.name) for term in self.terms if not term.key}:
            found["further"] = further
        moves = [{"before": each.before, "after": each.after, "size_mm": 1e3 * each.size_m} for each in self.moves]
        counts = None if self.counts_rad is None else self.counts_rad.tolist()
        return {**found, "moves": moves, "encoder_counts_rad": counts}


def row_times(data: Measurements, clock: Clock | None = None) -> Array:
    """When each row was measured, ``(n,)`` in the spacing of poses: by ``time_s``, else by the row's place in the file.

    Rows of another session or station are far away, so that nothing wanders from one to the next.

    Args:
        clock: of the campaign that the rows are some of; their own without.
    """
    known = Clock.of(data) if clock is None else clock
    if known.spacing_s is not None:
        times = (data.conditions["time_s"] - known.origin_s) / known.spacing_s
        times = np.where(np.isfinite(times), times, known.middle)  # of rows that were held out
    elif data.lines:
        times = np.array(data.lines, dtype=np.float64)
    elif all(name.isdecimal() for name in data.ids):
        times = np.array([float(name) for name in data.ids])
    else:
        times = np.arange(len(data), dtype=np.float64)
    place = {setup: i for i, setup in enumerate(dict.fromkeys((*known.sessions, *setups(data))))}
    return np.asarray(times + APART * np.array([place[setup] for setup in setups(data)]))


def _within_session(times: Array) -> Array:
    """Times of rows, those of each session from their own beginning."""
    return np.asarray(times - APART * session_of(times))


def error_shapes(
    model: Model, observed: Observations, values: Array, joints: int, times: Array, clock: Clock | None
) -> ErrorShapes:
    """What joints, a shift of the base and a drift do to the observed numbers, whitened as these are weighed."""
    n, k, d = observed.points.shape
    mask = observed.seen[..., None, None]
    slopes = by_joint_positions(model, observed.inputs, values, joints)
    moved = np.broadcast_to(np.eye(d), (n, k, d, d))
    scatter, shift = (
        np.where(mask, observed.in_units_of_noise(each), 0.0).reshape(n, k * d, -1) for each in (slopes, moved)
    )
    if observed.correlation is not None:
        scatter, shift = (observed.correlation.white(each) for each in (scatter, shift))
    along = np.ones(n) if clock is None else (_within_session(times) - clock.middle) / clock.half_span
    return ErrorShapes(scatter, shift, along, times)


def correlated(
    model: Model, observed: Observations, data: Measurements, shared: ErrorModel, *, known: bool
) -> Observations:
    """The measurements, weighed by the instrument, with the errors that they share.

    Args:
        model: that predicts ``observed``; parameters that ``shared`` does not know are zero.
        known: whether the weights stand on a known sigma; else they are in units of ``shared.sigma_m``.
    """
    values = np.array([shared.values.get(name, 0.0) for name in model.names])
    alone = replace(observed, whiten=observed.whiten / np.sqrt(shared.independent_share)) if known else observed
    times, unit = row_times(data, shared.clock), 1.0 if known else shared.sigma_m
    shapes = error_shapes(model, alone, values, data.joints.shape[1], times, shared.clock)
    for term in shared.terms:
        shapes = term.changed_at(shapes, shared.moves, another_day=shared.clock is None)
    variances = {term.name: (shared.size(term.name) / unit) ** 2 for term in shared.terms}
    carry = shared.carry if shared.carry > HARDLY_CORRELATED else 0.0
    correlation = correlation_of(shapes, Components(variances, carry))
    if shared.counts_rad is not None:
        rounded = shapes.scatter @ shared.counts_rad / unit
        correlation = replace(correlation, scatter=np.concatenate([correlation.scatter, rounded], axis=2))
    return replace(alone, correlation=correlation)


def counted(
    model: Model, data: Measurements, values: Array, encoders: Encoders, sigma_m: float, dof: int | None = None
) -> ErrorModel | None:
    """What whole counts of known encoders make of the numbers of a pose, where that is not little beside the noise.

    Errors in variables: a count is off by half of one at most, uniformly, and through the derivatives by the joints
    all numbers of a pose share that.

    Args:
        data: with what the model observes.
        values: ``(p,)`` of a fit; the derivatives are taken there.
        sigma_m: the noise of a coordinate; where it was estimated, with the counts in it.
        dof: residual degrees of freedom, where it was estimated.
    """
    if not counting(model, data, values, encoders) > NOTABLE * sigma_m > 0:
        return None
    root = np.asarray(np.linalg.cholesky(encoders.covariance))
    alone_m = sigma_m if dof is None else _without_counts(model, data, values, root, dof, sigma_m)
    named = dict(zip(model.names, values.tolist(), strict=True))
    return ErrorModel(alone_m, 1.0, {}, None, named, counts_rad=root)


def _without_counts(model: Model, data: Measurements, values: Array, root: Array, dof: int, sigma_m: float) -> float:
    """The sigma for which the residuals r are what they should be beside counts: sum r' (sigma^2 + S S')^-1 r = dof.

    Where even a small one explains the residuals, that is it.
    """
    inputs = data.inputs(model.conditions)
    mask, n = seen_mask(data.points)[..., None], len(data)
    residual = np.where(mask, data.points - model.points(inputs, values), 0.0).reshape(n, -1, 1)
    slopes = np.where(mask[..., None], by_joint_positions(model, inputs, values, len(root)), 0.0)
    made = slopes.reshape(n, -1, len(root)) @ root
    variances, axes = np.linalg.eigh(made @ made.swapaxes(1, 2))
    squares = (axes.swapaxes(1, 2) @ residual)[..., 0] ** 2

    def excess(log_sigma: float) -> float:
        return float((squares / (np.exp(2 * log_sigma) + np.maximum(variances, 0.0))).sum()) - dof

    low, high = np.log(_LEAST_ALONE * sigma_m), np.log(sigma_m)
    if excess(low) <= 0:
        return float(np.exp(low))
    return float(np.exp(scipy.optimize.brentq(excess, low, high + 1.0)))
