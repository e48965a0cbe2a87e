"""Errors that measured numbers share, beside the instrument's, as they were found in one set of measurements.

A value of SI units that says for any measurements of the same arm which of their numbers err together: those that it
was estimated from, poses held out, and those of another day.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from lab.calibration.gauss_newton import Observations
from lab.calibration.noise.likelihood import ErrorShapes
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.core.measurements import Measurements, seen_mask
from lab.core.se3 import Array
from lab.kinematics.model import Model

__all__ = ["Clock", "SharedErrors", "correlated", "error_shapes", "row_times"]

_APART = 1e6  # times, between the last pose of a session and the first of the next


@dataclass(frozen=True)
class Clock:
    """The time of a campaign, in the spacing of its poses.

    Attributes:
        middle: the mean time of its poses.
        half_span: from there to the last.
    """

    middle: float
    half_span: float

    @staticmethod
    def of(times: Array) -> "Clock":
        """Of ``row_times``; sessions are laid side by side."""
        within = times % _APART
        return Clock(float(within.mean()), float(max(np.abs(within - within.mean()).max(), 1.0)))


@dataclass(frozen=True)
class SharedErrors:
    """Standard deviations of errors that numbers share.

    Attributes:
        sigma_m: of the instrument, of one coordinate, as it was estimated beside them.
        independent_share: of a known instrument's variance: how much of it is independent from pose to pose.
        scatter_rad: of where each joint stops from one pose to the next; m of a slide.
        wandering_m: of a shift of the base (or the instrument) that comes and goes, of one coordinate.
        carry: the correlation of that shift from one pose to the next.
        drift_m: of the shift at the campaign's end, where the base moves steadily, of one coordinate.
        clock: of that campaign; None on another day, when a drift has come to an end that nobody knows.
        values: parameters by name, at which the derivatives by the joints are taken.
    """

    sigma_m: float
    independent_share: float
    scatter_rad: float
    wandering_m: float
    carry: float
    drift_m: float
    clock: Clock | None
    values: Mapping[str, float]

    @property
    def independent_m(self) -> float:
        """The instrument's noise that is independent from pose to pose, of one coordinate."""
        return float(self.sigma_m * np.sqrt(self.independent_share))

    @property
    def words(self) -> tuple[str, ...]:
        """Each of them for a person."""
        said = []
        if self.scatter_rad:
            said.append(f"joints scatter by {1e3 * self.scatter_rad:.2g} mrad from pose to pose")
        if self.wandering_m:
            size = f"{1e6 * self.wandering_m:.2g} µm (1σ per axis)"
            said.append(f"errors are correlated in time: {size}, {self.carry:.2g} from one pose to the next")
        if self.drift_m:
            said.append(f"the base or the instrument drifts steadily, by {2e6 * self.drift_m:.2g} µm over the campaign")
        return tuple(said)


def row_times(data: Measurements) -> Array:
    """When each row was measured, ``(n,)`` in the spacing of poses: by ``time_s``, else by the row's place in the file.

    Rows of another session are far away, so that nothing wanders from one to the next.
    """
    seconds = data.conditions.get("time_s", np.full(len(data), np.nan))
    if np.isfinite(seconds).all() and (gaps := np.diff(np.sort(seconds))).size and np.median(gaps) > 0:
        times = seconds / float(np.median(gaps))
    elif data.lines:
        times = np.array(data.lines, dtype=np.float64)
    elif all(name.isdecimal() for name in data.ids):
        times = np.array([float(name) for name in data.ids])
    else:
        times = np.arange(len(data), dtype=np.float64)
    session = {name: i for i, name in enumerate(dict.fromkeys(data.sessions))}
    return np.asarray(times + _APART * np.array([session[name] for name in data.sessions]))


def error_shapes(
    model: Model, observed: Observations, values: Array, joints: int, times: Array, clock: Clock | None
) -> ErrorShapes:
    """What joints, a shift of the base and a drift do to the observed numbers, in units of the instrument's noise."""
    n, k, d = observed.points.shape
    mask = seen_mask(observed.points)[..., None, None]
    slopes = by_joint_positions(model, observed.inputs, values, joints)
    moved = np.broadcast_to(np.eye(d), (n, k, d, d))
    scatter, shift = (
        np.where(mask, observed.in_units_of_noise(each), 0.0).reshape(n, k * d, -1) for each in (slopes, moved)
    )
    along = np.ones(n) if clock is None else (times % _APART - clock.middle) / clock.half_span
    trend = along[:, None, None] * shift
    return ErrorShapes(scatter, shift, trend, times)


def correlated(
    model: Model, observed: Observations, data: Measurements, shared: SharedErrors, *, known: bool
) -> Observations:
    """The measurements, weighed by the instrument, with the errors that they share.

    Args:
        model: that predicts ``observed``; parameters that ``shared`` does not know are zero.
        known: whether the weights stand on a known sigma; else they are in units of ``shared.sigma_m``.
    """
    values = np.array([shared.values.get(name, 0.0) for name in model.names])
    alone = replace(observed, whiten=observed.whiten / np.sqrt(shared.independent_share)) if known else observed
    times, unit = row_times(data), 1.0 if known else shared.sigma_m
    shapes = error_shapes(model, alone, values, data.joints.shape[1], times, shared.clock)
    correlation = shapes.correlation(
        shared.scatter_rad / unit, shared.wandering_m / unit, shared.carry, shared.drift_m / unit
    )
    return replace(alone, correlation=correlation)
