"""Joint values that do not follow the arm: residuals that look like a part of the last move.

Joints read back before they have followed lag behind the arm by a share of the move from the pose before; where a
controller reports where the joints are to be, the arm lags behind them, and the share is negative.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Fit, Observations
from lab.calibration.row_groups import configurations
from lab.calibration.statistics.linearized import FULL_RANK, ClusteredRows, linearized
from lab.core.linear_model import LinearModel, p_value_of_squares
from lab.core.measurements import Measurements, setups
from lab.core.probability import t_sf
from lab.core.se3 import Array
from lab.core.significance import UNSOLICITED_WARNING
from lab.kinematics.model import Model

__all__ = ["JointLag", "lagging", "moves_before"]

_SEVERAL = 2  # joints


@dataclass(frozen=True)
class JointLag:
    """A session whose joint values do not follow the arm.

    Attributes:
        p: the chance, over all sessions, that noise follows the moves as well.
        fractions: ``(joints,)`` of the last move that the joint positions still lack; negative where the arm lacks it.
        significant: ``(joints,)``, whether a joint's own fraction is more than noise would make it.
    """

    session: str
    p: float
    fractions: Array
    significant: NDArray[np.bool_]

    @property
    def is_claimed(self) -> bool:
        """True where several joints lag beyond the noise; one alone may be an error of that joint."""
        return bool(self.p < UNSOLICITED_WARNING and self.significant.sum() >= _SEVERAL)


def moves_before(data: Measurements, ids: Sequence[str], *, several_a_pose: bool = False) -> Array:
    """Return the joints' moves ``(n, joints)`` from the pose before in its session and station; zeros first.

    Args:
        data: all that was measured, in its order.
        ids: n of its rows.
        several_a_pose: whether consecutive rows with equal joint positions are readings of one pose.
    """
    moves = np.zeros_like(data.joints)
    together = setups(data)
    for setup in dict.fromkeys(together):
        here = np.flatnonzero([each == setup for each in together])
        moves[here[1:]] = np.diff(data.joints[here], axis=0)
        if several_a_pose:
            first = np.append(True, moves[here[1:]].any(axis=1))
            moves[here] = moves[here[np.maximum.accumulate(np.where(first, np.arange(len(here)), 0))]]
    if tuple(ids) == data.ids:
        return moves
    row_of = {name: i for i, name in enumerate(data.ids)}
    return np.asarray(moves[[row_of[name] for name in ids]])


def lagging(
    model: Model,
    observed: Observations,
    fit: Fit,
    moves: Array,
    reading_jacobian: Array,
    sessions: Sequence[str],
    omitted: Callable[[], Sequence[Array]] = tuple,
) -> tuple[JointLag, ...]:
    """Return the sessions where several joints lag.

    Residuals are regressed on J_q (joint position - the one before), after what the fit takes up of it (Frisch & Waugh
    1933): F for all joints together, Student's t for each, both with sigma from what is then left. Residuals of an
    effect that the model lacks follow the moves by chance, all the more as the targets and repeats of a pose share
    them. So a lag has to be significant by configurations too, and beside those of the groups that the model lacks that
    forward selection takes: a lag competes with them.

    Args:
        moves: ``(n, joints)``, joint position less the one before, which need not be among the rows.
        reading_jacobian: ``(n, k, d, joints)``, of the prediction by the joint positions.
        sessions: ``(n,)`` names.
        omitted: makes the derivatives ``(n, k, d, p)`` by the parameters of each group that the model lacks; it is
            called where a lag is suspected.
    """
    linear = linearized(model, observed, fit.values, fit.free)
    mask, seen, joints = linear.mask, observed.seen, moves.shape[1]
    basis = LinearModel.of(linear.jacobian[mask], FULL_RANK, scaled=True).basis
    residual = linear.residual[mask]
    labels = configurations(observed.inputs[:, :joints])[np.nonzero(seen)[0]]
    names = list(dict.fromkeys(sessions))
    found, rivals = [], None
    for name in names:
        here = np.where(np.array([session == name for session in sessions])[:, None], moves, 0.0)
        columns = observed.apply(reading_jacobian * here[:, None, None, :])
        lag = _regressed(name, basis, residual, columns, len(names))
        if not lag.is_claimed:
            continue
        rivals = [observed.apply(each) for each in omitted()] if rivals is None else rivals
        beside = _beside_rivals(basis, residual, columns, rivals)
        lag = _regressed(name, beside, residual, columns, len(names))
        rows = ClusteredRows.of(np.column_stack([beside, columns, residual]), labels, observed.points.shape[2])
        fitted = beside.shape[1]
        by_clusters = rows.test(range(fitted), range(fitted, fitted + joints)).p * len(names)
        lag = replace(lag, p=max(lag.p, min(1.0, by_clusters)))
        if lag.is_claimed:
            found.append(lag)
    return tuple(found)


def _beside_rivals(basis: Array, residual: Array, columns: Array, rivals: Sequence[Array]) -> Array:
    """The basis of the fit and of the rivals that forward selection by BIC takes, with ``columns`` among them."""
    others: dict[int, Array] = dict(enumerate([columns, *rivals]))
    taken, every = [basis], basis
    while others:
        left = residual - every @ (every.T @ residual)
        own = {k: _beyond(every, each) for k, each in others.items()}
        bic = {k: _bic(left, each) for k, each in own.items()}
        best = min(bic, key=lambda k: bic[k])
        if bic[best] >= _bic(left, left[:, None][:, :0]):
            break
        every = np.concatenate([every, own[best]], axis=1)
        taken += [others[best]] if best else []
        del others[best]
    return basis if len(taken) == 1 else np.concatenate([basis, _beyond(basis, np.column_stack(taken[1:]))], axis=1)


def _beyond(basis: Array, columns: Array) -> Array:
    left = columns - basis @ (basis.T @ columns)
    own_columns = np.linalg.norm(left, axis=0) > FULL_RANK * np.linalg.norm(columns, axis=0)
    own = LinearModel.of(left[:, own_columns], FULL_RANK).basis
    return np.linalg.qr(own - basis @ (basis.T @ own))[0]


def _bic(left: Array, own: Array) -> float:
    """Return the BIC of residuals ``(r,)`` with more orthonormal columns, but for a constant."""
    squares = float(left @ left - ((own.T @ left) ** 2).sum())
    return float(len(left) * np.log(max(squares, 1e-300)) + own.shape[1] * np.log(len(left)))


def _regressed(name: str, basis: Array, residual: Array, columns: Array, sessions: int) -> JointLag:
    """Regress residuals ``(r,)`` on ``columns`` ``(r, joints)`` beside the orthonormal basis of the fit."""
    joints = columns.shape[1]
    left = columns - basis @ (basis.T @ columns)
    before, scale = (np.linalg.norm(part, axis=0) for part in (columns, left))
    independent = scale > FULL_RANK * np.maximum(before, 1e-300)
    fractions, significant, p = np.zeros(joints), np.zeros(joints, dtype=bool), 1.0
    moves = LinearModel.of(left[:, independent], FULL_RANK)
    residual = residual - basis @ (basis.T @ residual)
    pull = moves.coordinates(residual)
    dof = len(residual) - basis.shape[1] - len(pull)
    if len(pull) and dof > 0:
        variance = max(float(residual @ residual - pull @ pull) / dof, 1e-300)
        p = min(1.0, sessions * float(p_value_of_squares(pull @ pull, len(pull), dof, variance)))
        estimate, std = moves.back @ pull, np.sqrt(variance) * np.linalg.norm(moves.back, axis=1)
        fractions[independent] = estimate
        significant[independent] = 2 * t_sf(np.abs(estimate / std), dof) * joints < UNSOLICITED_WARNING
    return JointLag(name, p, fractions, significant)
