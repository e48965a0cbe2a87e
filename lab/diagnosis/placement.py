"""Place a nominal arm robustly among measured points, of which a part may be wrong.

With links as the nominal model has them, the base's rotation (as nine free numbers), its position and the targets
enter the points linearly: p = R_B (F + R t) + t_B gives A p + c - R t = F with A = R_B' and c = -R_B' t_B. Subsets of
few rows are solved so. The one with the smallest capped misses (least median of squares: Rousseeuw 1984) is refined by
reweighted least squares, in which the links may move, too, at a price.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.guess import columns_of, flange_poses, initial_guess
from lab.core import se3
from lab.core.measurements import seen_mask
from lab.core.se3 import Array
from lab.kinematics.model import Model

__all__ = ["Placement", "placed", "refined", "row_misses"]

_SUBSETS, _SUBSET_ROWS = 16, 7
_RIDGE = 1e-6  # of the mean diagonal: subsets in which targets do not show stay solvable
_STEPS = 9
_NOISE_M = 0.5e-3  # beside which tolerances bound the links
_TOLERANCES = 2.0  # standard deviation of the links, in tolerances
_LEAST_SCALE_M = 1e-3  # of the misses that a refinement takes as ordinary
_REACH_M = 10.0  # standard deviation of what has no nominal value: base, targets


@dataclass(frozen=True)
class Placement:
    """An arm placed among points.

    Attributes:
        values: ``(p,)`` parameters.
        predicted: ``(n, k, 3)`` m, of the model there.
        misses: ``(n,)`` root mean square of a coordinate's error in each row (m); NaN where nothing was seen.
        price: of the links' distance from nominal (nats).
    """

    values: Array
    predicted: Array
    misses: Array
    price: float = 0.0


def row_misses(points: Array, predicted: Array) -> Array:
    """Return the root mean square ``(..., n)`` of the coordinates' errors of each row; NaN where nothing was seen."""
    squares, seen = (points - predicted) ** 2, np.isfinite(points)
    total, count = np.where(seen, squares, 0.0).sum(axis=(-2, -1)), seen.sum(axis=(-2, -1))
    return np.asarray(np.sqrt(np.where(count > 0, total / np.maximum(count, 1), np.nan)))


def placed(arm: Model, inputs: Array, points: Array, nominal: Array, rng: np.random.Generator) -> Placement:
    """Place base and targets by the points, with the links as they are in ``nominal``.

    Args:
        inputs: ``(n, joints + conditions)``.
        points: ``(n, k, 3)`` m, NaN where not seen; some may be wrong.
        nominal: ``(p,)`` nominal parameters.
    """
    base, tool = list(columns_of(arm, ("base",))), list(columns_of(arm, ("tool",)))
    at_zero = nominal.copy()
    at_zero[base] = 0.0
    origins, rotations = flange_poses(arm, inputs, at_zero, tool)
    seen = seen_mask(points)
    normal, right = _linear_rows(origins, rotations, points, seen)
    subsets = _subsets(np.any(seen, axis=1), rng)
    turned = _rotations(normal, right, subsets)  # (s, 3, 3)
    positions, targets = _rest(turned, origins, rotations, points, seen, subsets)
    # the placement of each subset, at all rows
    local = origins + np.einsum("nkij,skj->snki", rotations, targets)
    predicted = np.einsum("sij,snkj->snki", turned, local) + positions[:, None, None]
    misses = row_misses(points, predicted)
    best = int(np.argmin(_capped(misses)))
    values = nominal.copy()
    values[base] = np.concatenate([positions[best], se3.log(turned[best])])
    values[tool] = targets[best].ravel()
    by_subset = Placement(values, predicted[best], misses[best])
    # joints that turn little do not show nine numbers of a rotation: by the rotation alone, from all rows
    whole = initial_guess(arm, Observations(inputs, points, np.ones(seen.shape)), nominal)
    at_all = arm.points(inputs, whole)
    by_all = Placement(whole, at_all, row_misses(points, at_all))
    return by_all if _capped(by_all.misses) < _capped(by_subset.misses) else by_subset


def _capped(misses: Array) -> Array:
    """Return costs ``(...)`` of misses ``(..., n)``: those beyond three times their lower quartile count alike."""
    known = np.isfinite(misses)
    count = known.sum(axis=-1)
    ordered = np.sort(np.where(known, misses, np.inf), axis=-1)
    limit = 3 * np.maximum(_quantile(ordered, count, 0.25), _LEAST_SCALE_M)
    total = np.where(np.isfinite(ordered), np.minimum(ordered, limit[..., None]), 0.0).sum(axis=-1)
    cost = total / np.maximum(count, 1) + _quantile(ordered, count, 0.5)
    return np.asarray(np.where(count > 0, cost, np.inf))


def _quantile(ordered: Array, count: Array, share: float) -> Array:
    """Return a quantile ``(...)`` of the first ``count`` of ordered values ``(..., n)``, interpolated linearly."""
    place = share * np.maximum(count - 1, 0)
    low = np.floor(place).astype(np.int_)
    high = np.minimum(low + 1, np.maximum(count - 1, 0))
    below, above = (np.take_along_axis(ordered, each[..., None], axis=-1)[..., 0] for each in (low, high))
    return np.asarray(below + (place - low) * (above - below))


def _linear_rows(origins: Array, rotations: Array, points: Array, seen: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return normal matrices ``(n, u, u)`` and right sides ``(n, u)`` of each row, by A (9), c (3), targets (3 k)."""
    n, k = seen.shape
    columns = np.zeros((n, k, 3, 12 + 3 * k))
    for axis in range(3):
        columns[:, :, axis, 3 * axis : 3 * axis + 3] = np.nan_to_num(points)
        columns[:, :, axis, 9 + axis] = 1.0
    for target in range(k):
        columns[:, target, :, 12 + 3 * target : 15 + 3 * target] = -rotations[:, target]
    columns *= seen[:, :, None, None]
    rows = columns.reshape(n, 3 * k, -1)
    wanted = np.where(seen[:, :, None], origins, 0.0).reshape(n, 3 * k, 1)
    turned = np.swapaxes(rows, 1, 2)
    return turned @ rows, (turned @ wanted)[..., 0]


def _subsets(usable: NDArray[np.bool_], rng: np.random.Generator) -> Array:
    """Return weights ``(s, n)`` of rows: of all of them, then of random ones alone."""
    numbers = np.flatnonzero(usable)
    weights = np.zeros((1 + _SUBSETS, len(usable)))
    weights[0] = usable
    for each in weights[1:]:
        each[rng.permutation(numbers)[:_SUBSET_ROWS]] = 1.0
    return weights


def _rotations(normal: Array, right: Array, subsets: Array) -> Array:
    """Return the base's rotation ``(s, 3, 3)`` by each subset's linear solve."""
    size = normal.shape[1]
    summed = (subsets @ normal.reshape(len(normal), -1)).reshape(-1, size, size)
    summed += (_RIDGE * np.trace(summed, axis1=1, axis2=2) / size)[:, None, None] * np.eye(size)
    solved = np.linalg.solve(summed, (subsets @ right)[..., None])[..., 0]
    return np.asarray(se3.nearest_rotation(np.swapaxes(solved[:, :9].reshape(-1, 3, 3), 1, 2)))


def _rest(
    turned: Array, origins: Array, rotations: Array, points: Array, seen: NDArray[np.bool_], subsets: Array
) -> tuple[Array, Array]:
    """Return the base's position ``(s, 3)`` and the targets ``(s, k, 3)`` for its rotations ``(s, 3, 3)``.

    In the base's own axes the equations R_B' p - F = c + R t have columns that do not depend on the rotation.
    """
    n, k = seen.shape
    columns = np.zeros((n, k, 3, 3 + 3 * k))
    columns[..., :3] = np.eye(3)
    for target in range(k):
        columns[:, target, :, 3 + 3 * target : 6 + 3 * target] = rotations[:, target]
    columns = (columns * seen[:, :, None, None]).reshape(n, 3 * k, -1)
    size = columns.shape[2]
    wanted = np.einsum("sji,nkj->snki", turned, np.nan_to_num(points)) - origins
    normal = (subsets @ (np.swapaxes(columns, 1, 2) @ columns).reshape(n, -1)).reshape(-1, size, size)
    right = np.einsum("sn,nau,sna->su", subsets, columns, wanted.reshape(len(turned), n, -1), optimize=True)
    solved = np.linalg.solve(normal + 1e-6 * np.eye(size), right[..., None])[..., 0]  # an unseen target: at the flange
    return np.einsum("sij,sj->si", turned, solved[:, :3]), solved[:, 3:].reshape(len(turned), k, 3)


def refined(arm: Model, inputs: Array, points: Array, nominal: Array, start: Placement) -> Placement:
    """Refine a placement by reweighted Gauss-Newton steps in which the links move, too.

    Rows far off lose their weight (Geman & McClure 1985). A link that ends far from nominal costs little more than one
    outside its tolerances: a controller's zero may be anywhere.
    """
    is_link = np.array([each.is_link for each in arm.parameters])
    scales = np.array([each.scale if each.is_link else np.inf for each in arm.parameters])
    stds = np.where(is_link & np.isfinite(scales), _TOLERANCES * scales, _REACH_M)
    mean = np.where(is_link, nominal, start.values)
    values, best, seen = start.values, start, np.isfinite(points)
    for step in range(_STEPS + 1):
        predicted, jacobian = arm.observe(inputs, values)
        if not np.isfinite(predicted).all():  # a loop that does not close
            break
        misses = row_misses(points, predicted)
        price = float(np.log1p(((values - mean)[is_link] / stds[is_link]) ** 2 / 2).sum())
        if step == 0 or _capped(misses) < _capped(best.misses):
            best = Placement(values, predicted, misses, price)
        # weights of rows by their misses
        scale = max(2 * float(np.nanquantile(misses, 0.3)), _LEAST_SCALE_M)
        weight = 1 / (1 + (np.nan_to_num(misses) / scale) ** 2)
        # one step of the whole arm
        each = np.broadcast_to((weight / _NOISE_M)[:, None, None], points.shape)[seen]
        rows, left = jacobian[seen] * each[:, None], (points - predicted)[seen] * each
        normal = rows.T @ rows + np.diag(1 / stds**2)
        values = values + np.linalg.solve(normal, rows.T @ left + (mean - values) / stds**2)
    return best
