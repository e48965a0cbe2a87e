"""Calibrate measured poses sequentially: angles from orientations, then lengths from positions.

Orientations do not depend on lengths, and positions are linear in them (Mallem 2011; Khalil & Dombre 2002,
chapter 11, for the RX 130). For an arm with parallel axes this split does not hold literally: orientations depend on
the sum of the angles about these axes alone, and the gauge identifies each angle, so that (1, -1) of two leaves all
orientations as they are. Such directions belong to the lengths. With them the two steps alternate: exact for exact
poses, less accurate than the global fit for noisy ones. The covariance of the estimate has the noise of the positions
in the lengths, and the errors of the angles that these lengths take up.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lab.calibration.gauss_newton import RANK_TOLERANCE, Fit, Observations, OtherEstimate, Status, fit
from lab.calibration.observation import Observation
from lab.core.errors import LabError, option_name
from lab.core.linear_model import unit_columns
from lab.core.newton import least_squares_step
from lab.core.se3 import Array
from lab.kinematics.gauge import independent_columns
from lab.kinematics.model import Model

__all__ = ["fit_sequentially", "split_of"]

_MOST_ROUNDS = 100
_SETTLED = 1e-13  # m or rad: a round that changes less has come to rest
_ROUNDING = 1e-9  # a change below that no longer shrinks is rounding


@dataclass(frozen=True)
class _Split:
    """Split of the parameters into those identified by orientations and those left to the positions.

    Attributes:
        angles: indices of the parameters that orientations identify.
        rest: ``(p, r)`` directions for the positions: lengths, and angles that orientations do not depend on.
    """

    angles: tuple[int, ...]
    rest: Array


def split_of(observation: Observation, observed: Observations, free: Sequence[int], values: Array) -> _Split:
    """Return the split of the ``free`` parameters at nominal links.

    An angle that orientations do not identify changes them as the identified ones do, with coefficients c: moving it
    by 1 and these by -c leaves all orientations as they are.

    Args:
        observation: of positions, then orientations.
        values: ``(p,)`` nominal links, base and tool located.
    """
    model, positions = observation.model, observation.positions
    _, jacobian = model.observe(observed.inputs, model.rank_point(values))
    rows = jacobian[:, positions:][observed.seen[:, positions:]].reshape(-1, len(model.names))
    rotating = [i for i in free if model.parameters[i].is_angle]
    order = [i for i in model.column_priority() if i in rotating]
    angles = independent_columns(rows, order)
    dependent = [i for i in order if i not in angles]
    single = np.eye(len(model.names))
    coefficients = np.linalg.lstsq(rows[:, angles], rows[:, dependent])[0]
    coefficients[np.abs(coefficients) < 1e-9] = 0.0
    unobservable = single[:, dependent]
    unobservable[list(angles)] -= coefficients
    lengths = [i for i in free if i not in rotating]
    directions = np.concatenate([single[:, lengths], unobservable], axis=1)
    return _Split(angles, directions)


def fit_sequentially(observation: Observation, observed: Observations, free: Sequence[int], start: Array) -> Fit:
    """Alternate angles from orientations with lengths from positions until neither changes.

    Args:
        observation: of positions, then orientations.
        start: ``(p,)`` nominal links, base and tool located.

    Returns:
        The values with the covariance of this estimate, and with the linear problem of *all* measurements at them: rank
        and condition number are the global fit's.

    Raises:
        LabError: no orientation is observed, or none was measured.
    """
    model, positions = observation.model, observation.positions
    if not 0 < positions < len(observation.units):
        raise LabError(f"the sequential method takes its angles from orientations: give {option_name('observe')} pose")
    if not observed.seen[:, positions:].any():
        raise LabError("no orientation was seen: the sequential method takes its angles from them")
    split = split_of(observation, observed, free, start)
    angles = np.eye(len(start))[:, list(split.angles)]
    values, costs, change = start.copy(), [], np.inf
    status: Status = "not converged"
    for _ in range(_MOST_ROUNDS):
        turned = values + _step(model, observed, slice(positions, None), values, angles)
        moved = turned + _step(model, observed, slice(None, positions), turned, split.rest)
        last, change = change, float(np.abs(moved - values).max())
        values = moved
        residuals = observed.apply(observed.points - model.points(observed.inputs, values))
        costs.append(0.5 * float((residuals**2).sum()))
        if change < _SETTLED or (change < _ROUNDING and change >= 0.5 * last):
            status = "converged"
            break
    linear = fit(model, observed, free, values, tolerance_m=np.inf)
    covariance = _unit_covariance(model, observed, positions, split, values)[np.ix_(free, free)]
    return replace(
        linear, values=values, status=status, cost_trace=tuple(costs), other=OtherEstimate(covariance, linear.values)
    )


def _unit_covariance(model: Model, observed: Observations, positions: int, split: _Split, values: Array) -> Array:
    """Covariance ``(p, p)`` of the sequential estimate, where whitened noise has variance one.

    The estimate x solves Q_a'(r_o - O x) = 0 and Q_l'(r_p - P x) = 0: orientations with their derivatives O leave
    nothing along those by the angles, of basis Q_a, and positions nothing along those by the rest, of basis Q_l. With
    N = [Q_a'O; Q_l'P] its error is N^-1 [Q_a'e_o; Q_l'e_p], of covariance N^-1 N^-T: that of the angles alone in the
    first block, and what the lengths take up of their errors beside the positions' noise in the others.
    """
    directions = np.concatenate([np.eye(len(values))[:, list(split.angles)], split.rest], axis=1)  # (p, f)
    count, (_, jacobian) = len(split.angles), model.observe(observed.inputs, values)
    turned, moved = (
        Observations(observed.inputs, observed.points[:, part], observed.whiten[:, part]).apply(
            jacobian[:, part] @ directions
        )
        for part in (slice(positions, None), slice(None, positions))
    )
    by_angles, by_rest = np.linalg.qr(turned[:, :count])[0], np.linalg.qr(moved[:, count:])[0]
    system, scale = unit_columns(np.concatenate([by_angles.T @ turned, by_rest.T @ moved]))
    estimator = directions @ (np.linalg.pinv(system, rcond=RANK_TOLERANCE) / scale[:, None])
    covariance: Array = estimator @ estimator.T
    return covariance


def _step(model: Model, observed: Observations, quantities: slice, values: Array, directions: Array) -> Array:
    """Return the Gauss-Newton step ``(p,)`` along ``directions`` ``(p, r)`` from some of the observed quantities."""
    part = Observations(observed.inputs, observed.points[:, quantities], observed.whiten[:, quantities])
    predicted, jacobian = model.observe(observed.inputs, values)
    rows = part.apply(jacobian[:, quantities] @ directions)
    residual = part.apply(part.points - predicted[:, quantities])
    return np.asarray(directions @ least_squares_step(rows, residual))
