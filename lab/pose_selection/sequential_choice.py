"""Choose the next pose of a measurement session, given all poses measured so far, and decide when to stop.

A session that is planned while it is measured ends when the predicted error is within the wanted one. Noise that is
larger than stated would end it too early, so the residuals are tested after every pose. The significance level is
divided over all these tests (a union bound), so that testing often raises no false alarm.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.probability import chi2_isf, chi2_ppf
from lab.core.se3 import Array
from lab.pose_selection.criteria import Criterion

__all__ = ["NoiseCheck", "best_candidates", "noise_check"]

_SHORTLIST = 48  # candidates of the steepest ascent, whose scores are computed
_LEVEL = 0.05  # of the test of the noise over a whole session


def best_candidates(goal: Criterion, information: Array, pool: Array) -> tuple[NDArray[np.int_], Array]:
    """Rank candidates by the score with one of them added, best first.

    The criterion's slope picks a short list, of which the scores are computed.

    Args:
        information: ``(p, p)`` so far, positive definite.
        pool: ``(m, r, p)`` sensitivities of the candidates.

    Returns:
        Rows of the short list ``(s,)``, and what each adds to the score ``(s,)``.
    """
    slope = goal.slope(information)
    ascent = np.einsum("mrp,mrp->m", pool @ slope, pool)
    rows = np.argsort(-ascent, kind="stable")[:_SHORTLIST]
    part = pool[rows]
    gains = goal.score(information + np.swapaxes(part, 1, 2) @ part) - goal.score(information)
    order = np.argsort(-gains, kind="stable")
    return rows[order], gains[order]


@dataclass(frozen=True)
class NoiseCheck:
    """Residuals of the poses so far against the stated noise.

    Attributes:
        ratio: noise by the residuals, as a multiple of the stated noise.
        factor: by which predicted errors are larger than with the stated noise; at least 1.
        larger: whether the noise is shown to be larger than stated.
    """

    ratio: float
    factor: float
    larger: bool


def noise_check(ratio: float, dof: int, look: int) -> NoiseCheck:
    """Test the stated noise at one of many looks; the level of all looks together is 5 %.

    Args:
        ratio: noise by the residuals, as a multiple of the stated noise.
        dof: degrees of freedom of the residuals.
        look: number of this look, from 1.
    """
    level = _LEVEL * 6 / (np.pi * look) ** 2  # sums to the level over all looks
    larger = bool(dof * ratio**2 > chi2_isf(level, dof))
    bound = ratio * np.sqrt(dof / chi2_ppf(level, dof))
    return NoiseCheck(ratio, float(bound if larger else max(1.0, ratio)), larger)
