"""Change points: sudden moves of the base, found by a scan over the rows.

After a change the base stands elsewhere, by one shift for all rows that follow. For every row at which that may have
happened, within a session, the three coefficients are tested at once, beside the parameters and what else lasts: an F
test of whitened rows, all candidates from sums that run along the rows. The search counts: the least p is multiplied by
the number of candidates (Bonferroni), so that it is a bound of the chance of any.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.probability import f_sf
from lab.core.se3 import Array

__all__ = [
    "ANOTHER_SESSION",
    "APART",
    "ChangePoint",
    "Found",
    "before_and_after",
    "likeliest_change",
    "rows_around",
    "session_of",
]

APART = 1e9  # times, from the first pose of a session to the first of the next
_LEAST_ROWS = 8  # on either side in a session: of fewer with heavy tails the mean is none of a normal distribution
_LEAST_SHARE = 1e-6  # of a shift's size that parameters leave: below, they cannot be told from it
_ROUNDING = 1e-12  # added to the normal equations of unit columns


@dataclass(frozen=True)
class ChangePoint:
    """When the base moved.

    Attributes:
        time: by the times of the rows.
        share: of the rows, how many follow; the mean over all is where the base is said to be.
    """

    time: float
    share: float


ANOTHER_SESSION = ChangePoint(-np.inf, 0.0)
"""On another day nobody knows where the base is left: it is off by the same shift in all rows."""


@dataclass(frozen=True)
class Found:
    """The likeliest change of a scan.

    Attributes:
        f: the F statistic of its three coefficients.
        p: the chance of a larger one at any candidate, where nothing moved.
        candidates: how many there were.
    """

    change: ChangePoint
    f: float
    p: float
    candidates: int


def before_and_after(times: Array, changes: Sequence[ChangePoint]) -> Array:
    """Return the regressors ``(n, changes)`` of unit shifts: minus the share before a change, the rest after it."""
    time, share = np.array([(each.time, each.share) for each in changes]).reshape(-1, 2).T
    return np.asarray((times[:, None] >= time) - share)


def rows_around(times: Array, time: float) -> tuple[int, int]:
    """Return the last row before a time, and the first one after it."""
    last, first = (
        int(np.argmax(np.where(rows, sign * times, -np.inf))) for rows, sign in ((times < time, 1), (times > time, -1))
    )
    return last, first


def session_of(times: Array) -> NDArray[np.int_]:
    """Return the session index of each row, from 0: nothing is set up anew within one."""
    return np.round(times / APART).astype(np.int_)


def likeliest_change(white: Array, shift: Array, times: Array) -> Found | None:
    """The change that the rows show most; None where there are too few rows for any.

    Args:
        white: ``(n, m, k + 1)`` derivatives by all that is fitted, then residuals, whitened pose by pose.
        shift: ``(n, m, 3)`` what a shift of the base does to them.
        times: ``(n,)`` of the rows.
    """
    order = np.argsort(times, kind="stable")
    seen = np.any(shift[order], axis=(1, 2))
    order = order[seen]  # rows of nothing else, in which no base is
    white, shift, times = white[order], shift[order], times[order]
    starts = _candidates(times)
    if not len(starts):
        return None
    sums = _after(np.swapaxes(shift, 1, 2) @ np.concatenate([white, shift], axis=2), starts)
    flat = white.reshape(-1, white.shape[2])
    squares = flat.T @ flat
    q, left = _gains(sums, squares)
    numbers = int(np.any(flat, axis=1).sum())
    dof = numbers - len(squares) + 1 - shift.shape[2]
    if dof < 1:
        return None
    f = (q / shift.shape[2]) / (np.maximum(left - q, 1e-300) / dof)
    best = int(np.argmax(f))
    change = ChangePoint(float(times[starts[best] - 1 : starts[best] + 1].mean()), float(1 - starts[best] / len(times)))
    p = float(f_sf(float(f[best]), shift.shape[2], dof))
    return Found(change, float(f[best]), min(1.0, p * len(starts)), len(starts))


def _candidates(times: Array) -> NDArray[np.int_]:
    """Rows, in the order of time, before which the base may have moved: enough of its session on either side."""
    found, sessions = [], session_of(times)
    for label in dict.fromkeys(sessions.tolist()):
        rows = np.flatnonzero(sessions == label)
        inner = rows[_LEAST_ROWS : len(rows) - _LEAST_ROWS + 1]
        found.append(inner[times[inner] > times[inner - 1]] if len(inner) else inner)
    return np.concatenate(found)


def _after(products: Array, starts: NDArray[np.int_]) -> Array:
    """``(c, 3, k + 4)`` inner products of the centred shift of each candidate, by those of single rows ``(n, 3, ...)``.

    Its own ones stand in the last three columns.
    """
    total = products.sum(axis=0)
    after = total - np.cumsum(products, axis=0)[starts - 1]
    share = (1 - starts / len(products))[:, None, None]
    own = np.arange(products.shape[2]) >= products.shape[2] - products.shape[1]
    return np.asarray(np.where(own, (1 - 2 * share) * after + share**2 * total, after - share * total))


def _gains(sums: Array, squares: Array) -> tuple[Array, float]:
    """Return each candidate's reduction of the sum of squares ``(c,)``, and that sum beside what is fitted."""
    size, axes = len(squares) - 1, sums.shape[1]
    scale = 1 / np.sqrt(np.maximum(np.diag(squares)[:size], 1e-300))
    root = np.linalg.cholesky(scale[:, None] * squares[:size, :size] * scale + _ROUNDING * np.eye(size))
    pull = np.linalg.solve(root, scale * squares[:size, size])
    crossed = scale[:, None] * np.swapaxes(sums[..., :size], 1, 2)  # (c, k, 3)
    beside = np.linalg.solve(root, crossed.transpose(1, 0, 2).reshape(size, -1)).reshape(size, -1, axes)
    own = sums[..., size + 1 :]
    free = own - np.einsum("kci,kcj->cij", beside, beside)
    toward = sums[..., size] - np.einsum("kci,k->ci", beside, pull)
    sizes, turned = np.linalg.eigh(free)
    told = sizes > _LEAST_SHARE * np.trace(own, axis1=1, axis2=2)[:, None]
    along = np.einsum("cij,ci->cj", turned, toward)
    gains = np.where(told, along**2 / np.where(told, sizes, 1.0), 0.0).sum(axis=1)
    return gains, float(squares[size, size] - pull @ pull)
