"""Joint values that do not follow the arm: residuals that look like a part of the last move.

Joints read back before they have followed lag behind the arm by a share of the move from the pose before; where a
controller reports where the joints are to be, the arm lags behind them, and the share is negative.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Fit, Observations
from lab.calibration.statistics.linearized import FULL_RANK, LinearizedFit, SubsetFit, linearized
from lab.core.linear_model import LinearModel, p_value_of_squares
from lab.core.measurements import Measurements, setups
from lab.core.probabilities import t_sf
from lab.core.se3 import Array
from lab.core.significance import UNSOLICITED_WARNING
from lab.kinematics.model import Model

__all__ = ["Lag", "lagging", "moves_before"]

_SEVERAL = 2  # joints: one alone is as well an error of that joint


@dataclass(frozen=True)
class Lag:
    """A session whose joint values do not follow the arm.

    Attributes:
        session: its name.
        p: the chance, over all sessions, that noise follows the moves as well.
        fractions: ``(joints,)`` of the last move that the joint positions still lack; negative where the arm lacks it.
        significant: ``(joints,)``, whether a joint's own fraction is more than noise would make it.
    """

    session: str
    p: float
    fractions: Array
    significant: NDArray[np.bool_]


def moves_before(data: Measurements, ids: Sequence[str]) -> Array:
    """``(n, joints)`` how far the joints moved from the pose before in its session and from its station; zeros first.

    Args:
        data: all that was measured, in its order.
        ids: n of its rows.
    """
    moves = np.zeros_like(data.joints)
    together = setups(data)
    for setup in dict.fromkeys(together):
        here = np.flatnonzero([each == setup for each in together])
        moves[here[1:]] = np.diff(data.joints[here], axis=0)
    if tuple(ids) == data.ids:
        return moves
    row_of = {name: i for i, name in enumerate(data.ids)}
    return np.asarray(moves[[row_of[name] for name in ids]])


def lagging(
    model: Model, observed: Observations, fit: Fit, moves: Array, reading_jacobian: Array, sessions: Sequence[str]
) -> tuple[Lag, ...]:
    """The sessions where several joints lag.

    Residuals are regressed on J_q (joint position - the one before), after what the fit takes up of it (Frisch & Waugh
    1933): F for all joints together, Student's t for each, both with sigma from what is then left.

    Args:
        moves: ``(n, joints)``, joint position less the one before, which need not be among the rows.
        reading_jacobian: ``(n, k, d, joints)``, of the prediction by the joint positions.
        sessions: ``(n,)`` names.
    """
    linear = linearized(model, observed, fit.values, fit.free)
    within = linear.everywhere()
    names = list(dict.fromkeys(sessions))
    found = []
    for name in names:
        rows = [i for i, session in enumerate(sessions) if session == name]
        here = np.zeros_like(moves)
        here[rows] = moves[rows]
        mask = observed.seen
        columns = np.zeros(reading_jacobian.shape)
        columns[mask] = observed.apply(reading_jacobian * here[:, None, None, :]).reshape(columns[mask].shape)
        lag = _regressed(name, linear, within, columns.reshape(*linear.mask.shape, -1), len(names))
        if lag.p < UNSOLICITED_WARNING and lag.significant.sum() >= _SEVERAL:
            found.append(lag)
    return tuple(found)


def _regressed(name: str, linear: LinearizedFit, within: SubsetFit, columns: Array, sessions: int) -> Lag:
    """Regression of the residuals on ``columns`` ``(n, m, joints)`` beside the fit's own."""
    joints = columns.shape[2]
    left = np.moveaxis(within.residuals(np.moveaxis(columns, 2, 0)), 0, 2).reshape(-1, joints)
    before, scale = (np.linalg.norm(part, axis=0) for part in (columns.reshape(-1, joints), left))
    told = scale > FULL_RANK * np.maximum(before, 1e-300)
    fractions, significant, p = np.zeros(joints), np.zeros(joints, dtype=bool), 1.0
    moves = LinearModel.of(left[:, told], FULL_RANK)
    residual = linear.residual.ravel()
    pull = moves.coordinates(residual)
    dof = within.dof - len(pull)
    if len(pull) and dof > 0:
        variance = max(float(residual @ residual - pull @ pull) / dof, 1e-300)
        p = min(1.0, sessions * float(p_value_of_squares(pull @ pull, len(pull), dof, variance)))
        estimate, std = moves.back @ pull, np.sqrt(variance) * np.linalg.norm(moves.back, axis=1)
        fractions[told] = estimate
        significant[told] = 2 * t_sf(np.abs(estimate / std), dof) * joints < UNSOLICITED_WARNING
    return Lag(name, p, fractions, significant)
