"""Whether what an arm's fit leaves is noise, and if not, what it follows."""

from collections.abc import Sequence

import numpy as np

from lab.core.se3 import Array
from lab.extensions.dynamics.arm.runs import DynamicModel, ThinnedRun
from lab.extensions.dynamics.regression import BiasCandidate, ChannelSolution, ResidualVerdict, Series, verdict
from lab.kinematics.dynamics.arm_dynamics import directions
from lab.kinematics.dynamics.rigid_body import LOAD

__all__ = ["residual_verdict"]

_DELAY = "a delay between torques and positions; estimate it (delay)"
_FILTERED = "a filter that torques came through and positions did not; record without it"
_FRICTION = "friction that the model leaves out; take it in"
_GROWING = "friction that grows with what a joint bears"
_LOAD = "a load other than the one that was given; mend it, or have it estimated"


def residual_verdict(
    model: DynamicModel,
    runs: Sequence[ThinnedRun],
    solution: ChannelSolution,
    columns: Sequence[Array],
    *,
    known_load: Array | None,
    delay: bool,
) -> ResidualVerdict:
    """The tests of a fit.

    Args:
        columns: ``(n, J, c)`` that were fitted, and their first two derivatives in time.
        known_load: what was not fitted, because it was given.
        delay: whether one was fitted.
    """
    fitted = solution.values[: columns[0].shape[2]]
    suspects = [BiasCandidate((columns[2] @ fitted)[..., None], _FILTERED)]
    if not delay:
        suspects.append(BiasCandidate((columns[1] @ fitted)[..., None], _DELAY))
    signs = np.concatenate([run.thinned(directions(run.speeds)) for run in runs])
    if model.arm.friction:
        # by what the model says that a drive gives: as recorded, its noise would be that which is to be explained
        suspects.append(BiasCandidate(_diagonal(np.abs(columns[0] @ fitted) * signs), _GROWING))
    else:
        speeds = np.concatenate([run.thinned(run.speeds) for run in runs])
        suspects.append(BiasCandidate(np.concatenate([_diagonal(signs), _diagonal(speeds)], axis=2), _FRICTION))
    if known_load is not None and any(run.loaded for run in runs):
        loads = [run.rows()[..., : len(LOAD)] * float(run.loaded) for run in runs]
        suspects.append(BiasCandidate(np.concatenate(loads), _LOAD))
    return verdict(solution, suspects, _series(runs))


def _series(runs: Sequence[ThinnedRun]) -> list[Series]:
    series, first = [], 0
    for run in runs:
        count = len(run.rows())
        series.append(Series(first, first + count, run.band.hz))
        first += count
    return series


def _diagonal(values: Array) -> Array:
    """``(n, J)`` as diagonal matrices ``(n, J, J)``."""
    diagonal: Array = values[:, :, None] * np.eye(values.shape[1])
    return diagonal
