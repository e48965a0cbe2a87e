"""Find change points, sudden moves of the base, by a scan over the rows.

A change shifts the base in all following rows. For every candidate row within a session, the three coefficients are
tested at once, beside the parameters and other lasting errors: an F test of whitened rows, all candidates from
cumulative sums. The least p is multiplied by the number of candidates (Bonferroni), and so bounds the p-value of the
search.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its solvers are loaded at their first use
from numpy.typing import NDArray

from lab.core.probability import f_sf
from lab.core.se3 import Array

__all__ = [
    "ANOTHER_SESSION",
    "APART",
    "BaseChange",
    "ChangeScan",
    "before_and_after",
    "likeliest_change",
    "rows_around",
    "session_of",
]

APART = 1e9  # units of time, from the first pose of a session to the first of the next
_MIN_ROWS = 8  # on either side in a session: with heavy tails, means of fewer are not normally distributed
_MIN_SHARE = 1e-6  # of a shift's variance beside the parameters: below, they are confounded
_ROUNDING = 1e-12  # added to the normal equations of unit columns


@dataclass(frozen=True)
class BaseChange:
    """A sudden move of the base.

    Attributes:
        time: by the times of the rows.
        share: share of the rows after it; the estimated base is the mean over all rows.
    """

    time: float
    share: float


ANOTHER_SESSION = BaseChange(-np.inf, 0.0)
"""Another session has an unknown base: the same shift in all rows."""


@dataclass(frozen=True)
class ChangeScan:
    """The likeliest change of a scan.

    Attributes:
        f: the F statistic of its three coefficients.
        p: probability of a larger one at any candidate without a move.
        candidates: their number.
    """

    change: BaseChange
    f: float
    p: float
    candidates: int


def before_and_after(times: Array, changes: Sequence[BaseChange]) -> Array:
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
    """Return the session index of each row, from 0."""
    return np.round(times / APART).astype(np.int_)


def likeliest_change(white: Array, shift: Array, times: Array) -> ChangeScan | None:
    """Find the likeliest change; None if there are too few rows for any.

    Args:
        white: ``(n, m, k + 1)`` derivatives by all fitted parameters, then residuals, whitened pose by pose.
        shift: ``(n, m, 3)`` their derivatives by a shift of the base.
        times: ``(n,)`` of the rows.
    """
    order = np.argsort(times, kind="stable")
    seen = np.any(shift[order], axis=(1, 2))
    order = order[seen]  # other rows do not depend on the base
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
    change = BaseChange(float(times[starts[best] - 1 : starts[best] + 1].mean()), float(1 - starts[best] / len(times)))
    p = float(f_sf(float(f[best]), shift.shape[2], dof))
    return ChangeScan(change, float(f[best]), min(1.0, p * len(starts)), len(starts))


def _candidates(times: Array) -> NDArray[np.int_]:
    """Return candidate rows, in the order of time, with enough rows of their session on either side."""
    found, sessions = [], session_of(times)
    for label in dict.fromkeys(sessions.tolist()):
        rows = np.flatnonzero(sessions == label)
        inner = rows[_MIN_ROWS : len(rows) - _MIN_ROWS + 1]
        found.append(inner[times[inner] > times[inner - 1]] if len(inner) else inner)
    return np.concatenate(found)


def _after(products: Array, starts: NDArray[np.int_]) -> Array:
    """Return inner products ``(c, 3, k + 4)`` of each candidate's centred shift, from those of rows ``(n, 3, ...)``.

    The last three columns are its products with itself.
    """
    total = products.sum(axis=0)
    after = total - np.cumsum(products, axis=0)[starts - 1]
    share = (1 - starts / len(products))[:, None, None]
    own = np.arange(products.shape[2]) >= products.shape[2] - products.shape[1]
    return np.asarray(np.where(own, (1 - 2 * share) * after + share**2 * total, after - share * total))


def _gains(sums: Array, squares: Array) -> tuple[Array, float]:
    """Return each candidate's reduction of the sum of squares ``(c,)``, and that sum after the fit of the others."""
    size, axes = len(squares) - 1, sums.shape[1]
    scale = 1 / np.sqrt(np.maximum(np.diag(squares)[:size], 1e-300))
    root = np.linalg.cholesky(scale[:, None] * squares[:size, :size] * scale + _ROUNDING * np.eye(size))
    pull = scipy.linalg.lapack.dtrtrs(root, scale * squares[:size, size], lower=1)[0]
    crossed = scale[:, None] * np.swapaxes(sums[..., :size], 1, 2)  # (c, k, 3)
    beside = scipy.linalg.lapack.dtrtrs(root, crossed.transpose(1, 0, 2).reshape(size, -1), lower=1)[0]
    beside = beside.reshape(size, -1, axes)
    own = sums[..., size + 1 :]
    free = own - np.einsum("kci,kcj->cij", beside, beside)
    toward = sums[..., size] - np.einsum("kci,k->ci", beside, pull)
    sizes, turned = np.linalg.eigh(free)
    separable = sizes > _MIN_SHARE * np.trace(own, axis1=1, axis2=2)[:, None]
    along = np.einsum("cij,ci->cj", turned, toward)
    gains = np.where(separable, along**2 / np.where(separable, sizes, 1.0), 0.0).sum(axis=1)
    return gains, float(squares[size, size] - pull @ pull)
