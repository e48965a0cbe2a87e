"""Group measured rows: repeats of one configuration, folds of a cross-validation, and rows that are held out."""

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.calibration.observation import observation_of
from lab.core.errors import LabError, be, counted, option_name
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.recent import recent
from lab.core.se3 import Array
from lab.kinematics.model import Model

__all__ = [
    "FOLDS",
    "ROWS_PER_PARAMETER",
    "SAME_CONFIGURATION",
    "configurations",
    "cv_groups_of",
    "folds",
    "hold_out",
    "hold_out_last",
    "rows_in_time",
    "split_by_label",
]

SAME_CONFIGURATION = 0.01  # rad (m for a slide): joint positions this near are repeats of one configuration
FOLDS = 5
ROWS_PER_PARAMETER = 1.5  # what each fold must leave to fit
_MANY_ROWS, _CELLS = 20_000, 8  # more rows are compared by cells, so many to the width of a configuration

_Rows = NDArray[np.int_]


@recent(8)  # several tests of one fit group the same rows
def configurations(joints: Array) -> _Rows:
    """Label joint positions ``(n, joints)``: rows within 0.01 rad (m) in every joint share a label ``(n,)``.

    Of very many rows those in one cell of an eighth of that stand for each other, or their pairs would be too many.
    The labels are read-only.
    """
    labels = _configurations(joints)
    labels.flags.writeable = False
    return labels


def _configurations(joints: Array) -> _Rows:
    """Group positions as ``configurations`` does."""
    if len(joints) > _MANY_ROWS:
        corners = np.floor(joints * (_CELLS / SAME_CONFIGURATION))
        _, one, cell = np.unique(_row_numbers(corners), return_index=True, return_inverse=True)
        if len(one) < len(joints):
            return _configurations((corners[one] + 0.5) * (SAME_CONFIGURATION / _CELLS))[cell]
    _, first, same = np.unique(joints, axis=0, return_index=True, return_inverse=True)
    if len(first) < len(joints):  # the pairs of many visits of one pose would be too many
        order = np.argsort(first)
        return _configurations(joints[first[order]])[np.argsort(order)[same]]
    pairs = scipy.spatial.cKDTree(joints).query_pairs(SAME_CONFIGURATION, p=np.inf, output_type="ndarray")
    if not len(pairs):
        return np.arange(len(joints))
    links = scipy.sparse.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(joints), len(joints)))
    labels: _Rows = scipy.sparse.csgraph.connected_components(links, directed=False)[1].astype(np.int_)
    return labels


def _row_numbers(rows: Array) -> NDArray[np.uint64]:
    """Return a number ``(n,)`` for each of rows ``(n, c)`` of whole numbers, unique among a million."""
    factors = rng_for(0, "split").integers(1 << 63, size=rows.shape[1], dtype=np.uint64) | np.uint64(1)
    return np.asarray((rows.astype(np.int64).view(np.uint64) * factors).sum(axis=1, dtype=np.uint64))


def cv_groups_of(model: Model, data: Measurements) -> _Rows:
    """Label rows ``(n,)`` that are fitted or held out together: at a fixture, or repeats of a configuration."""
    labels = observation_of(model).cv_groups(data)
    return configurations(data.joints) if labels is None else labels


def split_by_label(labels: _Rows, share: float, seed: int) -> tuple[_Rows, _Rows]:
    """Split rows into those to fit and those to hold out: whole labels at random, until the share is reached."""
    order = rng_for(seed, "split").permutation(labels.max() + 1)
    sizes = np.bincount(labels)[order]
    left_out = order[np.cumsum(sizes) - sizes < share * len(labels) - 0.5]
    test = np.isin(labels, left_out)
    return np.flatnonzero(~test), np.flatnonzero(test)


def folds(labels: _Rows, seed: int) -> _Rows:
    """Assign each row ``(n,)`` to a fold, five or as many as there are labels: whole labels, at random."""
    order = rng_for(seed, "split").permutation(labels.max() + 1)
    fold_of = np.empty(len(order), dtype=np.int_)
    fold_of[order] = np.arange(len(order)) % FOLDS
    return np.asarray(fold_of[labels])


def hold_out(model: Model, data: Measurements, share: float, seed: int) -> tuple[Measurements, Measurements]:
    """Split the rows into those to fit and the hold-out set.

    Raises:
        LabError: the share is not between 0 and 1, or leaves nothing to fit or to validate on.
    """
    if not 0 < share < 1:
        raise LabError(f"{option_name('holdout')} {share:g}: give a share between 0 and 1, e.g. 0.3")
    fitted, held_out = split_by_label(cv_groups_of(model, data), share, seed)
    if not len(held_out) or not len(fitted):
        raise LabError(
            f"{option_name('holdout')} {share:g}: {len(data)} poses leave too few to fit or to validate; change "
            f"the share"
        )
    return data[fitted], data[held_out]


def rows_in_time(data: Measurements) -> _Rows:
    """Return the rows in the order in which they were measured: by ``time_s`` where every row has it, else as given."""
    seconds = data.conditions.get("time_s", np.full(len(data), np.nan))
    return np.argsort(seconds, kind="stable") if np.isfinite(seconds).all() else np.arange(len(data))


def hold_out_last(model: Model, data: Measurements, share: float) -> tuple[Measurements, Measurements]:
    """Split off the last rows as the hold-out set: by ``time_s`` where every row has it, else by their order.

    Later rows whose configuration (or fixture) was measured before them are in neither set: the hold-out set is new in
    time and in joint space.

    Raises:
        LabError: the share is not between 0 and 1, or leaves nothing to fit or to validate on.
    """
    if not 0 < share < 1:
        raise LabError(f"{option_name('holdout_last')} {share:g}: give a share between 0 and 1, e.g. 0.3")
    order, cut = rows_in_time(data), len(data) - round(share * len(data))
    first, last = np.sort(order[:cut]), np.sort(order[cut:])
    if not len(first) or not len(last):
        raise LabError(
            f"{option_name('holdout_last')} {share:g}: {len(data)} poses leave too few to fit or to validate; "
            f"change the share"
        )
    labels = cv_groups_of(model, data)
    new = last[~np.isin(labels[last], labels[first])]
    if not len(new):
        raise LabError(
            f"{option_name('holdout_last')} {share:g}: the last {counted(len(last), 'row')} {be(len(last))} of "
            f"configurations or "
            f"fixtures that were measured before; change the share, or give {option_name('holdout')}"
        )
    return data[first], data[new]
