"""Angles first, from orientations; lengths after, from positions: the sequential calibration of measured poses.

Orientations do not depend on lengths, and positions are linear in them (Mallem 2011; Khalil & Dombre 2002,
chapter 11, for the RX 130). Of an arm with parallel axes the literal split does not hold: orientations see only
the sum of the angles about them, and the gauge keeps each, so that (1, -1) of two is invisible. Such directions
belong to the lengths. With them the two steps alternate: exact for exact poses, while angles that carry the
orientations' noise times the reach leave positions worse than the global fit, which weighs both at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lab.calibration.gauss_newton import Fit, Observations, Status, fit
from lab.calibration.observations.full_pose import Poses
from lab.calibration.observations.protocol import Observation
from lab.core.errors import LabError
from lab.core.measurements import seen_mask
from lab.core.se3 import Array
from lab.kinematics.gauge import independent_columns

MOST_ROUNDS = 100
SETTLED = 1e-13  # m or rad: a round that changes less has come to rest
ROUNDING = 1e-9  # a change below that no longer shrinks is rounding


@dataclass(frozen=True)
class Split:
    """What the orientations identify, and what is left to the positions.

    Attributes:
        angles: indices of the parameters that orientations tell apart.
        rest: ``(p, r)`` directions for the positions: lengths, and angles that orientations do not see.
    """

    angles: tuple[int, ...]
    rest: Array


def split_of(observation: Poses, seen: Observations, free: Sequence[int], values: Array) -> Split:
    """The split of the ``free`` parameters at nominal links.

    An angle that orientations do not tell apart changes them as those do that are kept, with coefficients c:
    moving it by 1 and them by -c is invisible.
    """
    _, jacobian = observation.observe(seen.inputs, observation.rank_point(values))
    rows = jacobian[:, -1][seen_mask(seen.points)[:, -1]].reshape(-1, len(observation.names))
    turning = [i for i in free if observation.parameters[i].is_angle]
    order = [i for i in observation.column_priority() if i in turning]
    angles = tuple(order[i] for i in independent_columns(rows[:, order], range(len(order))))
    lost = [i for i in order if i not in angles]
    single = np.eye(len(observation.names))
    coefficients = np.linalg.lstsq(rows[:, angles], rows[:, lost])[0]
    coefficients[np.abs(coefficients) < 1e-9] = 0.0
    hidden = single[:, lost]
    hidden[list(angles)] -= coefficients
    lengths = [i for i in free if i not in turning]
    directions = np.concatenate([single[:, lengths], hidden], axis=1)
    return Split(angles, directions)


def fit_sequentially(observation: Observation, seen: Observations, free: Sequence[int], start: Array) -> Fit:
    """Alternate angles from orientations with lengths from positions until neither changes.

    Args:
        free: the parameters to fit, as ``identify`` keeps them.
        start: ``(p,)`` nominal links, base and tool located.

    Returns:
        The values, with the linear problem of *all* measurements at them: rank and condition are the global
        fit's, and so is the covariance, which the sequential estimate does not reach.

    Raises:
        LabError: no orientation was seen.
    """
    if not isinstance(observation, Poses):
        raise LabError("the sequential method takes its angles from orientations: say --observe pose")
    if not seen_mask(seen.points)[:, -1].any():
        raise LabError("no orientation was seen: the sequential method takes its angles from them")
    split = split_of(observation, seen, free, start)
    alone = np.eye(len(start))[:, list(split.angles)]
    values, costs, change = start.copy(), [], np.inf
    status: Status = "not converged"
    for _ in range(MOST_ROUNDS):
        turned = values + _step(observation, seen, slice(-1, None), values, alone)
        moved = turned + _step(observation, seen, slice(None, -1), turned, split.rest)
        last, change = change, float(np.abs(moved - values).max())
        values = moved
        costs.append(0.5 * float((seen.apply(seen.points - observation.points(seen.inputs, values)) ** 2).sum()))
        if change < SETTLED or (change < ROUNDING and change >= 0.5 * last):
            status = "converged"
            break
    linear = fit(observation, seen, free, values, tolerance_m=np.inf)  # its step is not wanted, its triangle is
    return replace(linear, values=values, status=status, cost_trace=tuple(costs))


def _step(observation: Poses, seen: Observations, things: slice, values: Array, directions: Array) -> Array:
    """Gauss and Newton's step ``(p,)`` along ``directions`` ``(p, r)`` from some of the observed things."""
    part = Observations(seen.inputs, seen.points[:, things], seen.whiten[:, things])
    predicted, jacobian = observation.observe(seen.inputs, values)
    rows = part.apply(jacobian[:, things] @ directions)
    size = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    residual = part.apply(part.points - predicted[:, things])
    return np.asarray(directions @ (np.linalg.lstsq(rows / size, residual)[0] / size))
