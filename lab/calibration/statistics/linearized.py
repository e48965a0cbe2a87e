"""Linearize a fit pose by pose, for all tests of residuals: outliers, goodness of fit.

Near the solution the whitened residual of all poses is r = (I - Q Q') e, whatever the parameters are (Cook & Weisberg
1982, section 2.1).

Rows of one configuration may have correlated errors: an error of the joints moves all targets of a pose together, and
model discrepancy repeats at each visit. So a cluster is a configuration, however often it is measured. The covariance
of what columns add to a fit comes from the jackknife over clusters, which assumes neither independent rows nor equal
variances (Bell & McCaffrey 2002, CR3).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import ExtraResiduals, Observations
from lab.core.linear_model import (
    WELL_CONDITIONED,
    LinearModel,
    condition_bound,
    p_value_of_squares,
    pseudo_inverse,
    triangle_of,
)
from lab.core.se3 import Array
from lab.kinematics.model import Model

__all__ = [
    "FULL_RANK",
    "ClusterTest",
    "ClusteredRows",
    "LinearizedFit",
    "Mask",
    "NoiseDistribution",
    "SubsetFit",
    "cluster_sums",
    "clusters_first",
    "jackknifed",
    "linearized",
    "smallest_p",
]

Mask = NDArray[np.bool_]
FULL_RANK = 1e-8  # of the largest singular value of the column-scaled Jacobian
_DETERMINED = 1e-6  # share of a direction's variance that other poses must leave to its residual
_LEAST_KURTOSIS_DOF = 4.5
_BLOCK = 2_000_000  # numbers drawn or worked out at a time
_MIN_LEVERAGE = 1e-3  # of a pose in its own prediction: five terms of a series are exact
_NO_LEVERAGE, _MANY = 0.01, 60_000  # of each number's own error in its prediction, and how many numbers: no matter


@dataclass(frozen=True)
class NoiseDistribution:
    """The distribution of whitened noise: mean zero, variance one, the mean of some readings.

    Attributes:
        dof: of Student's t, above 2.
    """

    kind: Literal["gaussian", "uniform", "student"] = "gaussian"
    readings: int = 1
    dof: float = np.inf

    @property
    def excess_kurtosis(self) -> float:
        """Zero if Gaussian; that of a mean of readings falls as one over their number; of Student's t where it has one.

        Below 4.5 degrees of freedom it is taken as there, as it has no end.
        """
        if self.kind == "student":
            return 6 / (max(self.dof, _LEAST_KURTOSIS_DOF) - 4)
        return 0.0 if self.kind == "gaussian" else -1.2 / self.readings

    def draw(self, size: tuple[int, ...], rng: np.random.Generator) -> Array:
        """Independent whitened errors."""
        if self.kind == "gaussian":
            return rng.standard_normal(size)
        if self.kind == "student":
            return np.asarray(rng.standard_t(self.dof, size) * np.sqrt((self.dof - 2) / self.dof))
        total = rng.random(size)
        for _ in range(self.readings - 1):
            total += rng.random(size)
        total -= 0.5 * self.readings
        total *= np.sqrt(12 / self.readings)
        return total


@dataclass(frozen=True)
class LinearizedFit:
    """Whitened residuals and derivatives near a solution, one block a pose.

    Attributes:
        residual: ``(n, m)`` measured less predicted, m = k d; zero where not observed.
        jacobian: ``(n, m, f)`` of the prediction, columns scaled to unit norm; zero where not observed.
        scale: ``(f,)`` the norms they had.
        mask: ``(n, m)`` which numbers were observed.
        poses: how many of the n blocks are poses, the first; the others hold what else is known, and are not tested.
    """

    residual: Array
    jacobian: Array
    scale: Array
    mask: Mask
    poses: int

    def everywhere(self) -> "SubsetFit":
        """Least squares on all poses."""
        return self.within(np.ones(len(self.mask), dtype=bool))

    def blocks(self) -> Iterator[slice]:
        """Yield the blocks of poses in parts of a bounded size."""
        size = max(_BLOCK // max(self.jacobian[0].size, 1), 1)
        return (slice(first, first + size) for first in range(0, len(self.mask), size))

    def basis(self, directions: Array) -> Iterator[tuple[slice, Array]]:
        """Yield the rows in other directions ``(f, rank)``, ``(n, m, rank)``, in parts."""
        for part in self.blocks():
            rows = self.jacobian[part]
            yield part, (rows.reshape(-1, len(directions)) @ directions).reshape(*rows.shape[:2], -1)

    def rows_of(self, observed: Observations, vectors: Array) -> Array:
        """Whiten vectors ``(n, k, d, c)`` at the poses to ``(poses, m, c)``; zero where not seen."""
        rows = np.zeros((self.poses, self.mask.shape[1], vectors.shape[3]))
        _fill(rows, self.mask[: self.poses], observed.apply(vectors))
        return rows

    def by_cluster(self, labels: NDArray[np.int_]) -> "LinearizedFit":
        """Merge the poses of each cluster, as repeats of one configuration, into one block.

        A block holds the triangle R of its rows J = Q R, and Q' r of their residuals r: as many numbers as parameters
        at most. The fit is the same, and so are leverages; what no parameter follows within a block is gone.

        Args:
            labels: ``(poses,)`` the cluster of each pose.
        """
        labels = np.unique(labels, return_inverse=True)[1]
        count = int(labels.max(initial=-1)) + 1
        if count == self.poses:
            return self
        order = np.argsort(labels, kind="stable")
        blocks, columns = [], len(self.scale)
        for rows in np.split(order, np.flatnonzero(np.diff(labels[order])) + 1):
            seen = self.mask[rows]
            basis, triangle = np.linalg.qr(self.jacobian[rows][seen])
            blocks.append((triangle, basis.T @ self.residual[rows][seen]))
        further = len(self.mask) - self.poses
        height = max(self.mask.shape[1] if further else 0, *(len(residual) for _, residual in blocks))
        residual, mask = np.zeros((count + further, height)), np.zeros((count + further, height), dtype=np.bool_)
        jacobian = np.zeros((count + further, height, columns))
        for block, (triangle, own) in enumerate(blocks):
            jacobian[block, : len(own)], residual[block, : len(own)], mask[block, : len(own)] = triangle, own, True
        width = self.mask.shape[1]
        for target, source in ((jacobian, self.jacobian), (residual, self.residual), (mask, self.mask)):
            target[count:, :width] = source[self.poses :]
        return LinearizedFit(residual, jacobian, self.scale, mask, count)

    def within(self, inside: Mask) -> "SubsetFit":
        """Least squares on the poses ``inside`` ``(n,)``."""
        # the fit of the poses inside: its directions Q = J B
        rows = (np.where(inside[part, None, None], self.jacobian[part], 0.0) for part in self.blocks())
        triangle = triangle_of(each.reshape(-1, len(self.scale)) for each in rows)
        directions, full_rank = _directions(triangle)
        # the roots (I -+ H_ii)^-1/2 of each pose, and how many of its numbers the others predict
        width = self.mask.shape[1]
        root, count = np.empty((len(inside), width, width)), self.mask.sum(axis=1)
        for part, basis in self.basis(directions):
            own = basis @ np.swapaxes(basis, 1, 2)  # (n, m, m) H_ii
            sign = np.where(inside[part], -1.0, 1.0)[:, None, None]
            if float(np.einsum("nii->n", own).max()) < _MIN_LEVERAGE:
                root[part] = _root_near_one(sign * own)
                continue
            spread, axes = np.linalg.eigh(np.eye(width) + sign * own)
            alone = spread < _DETERMINED
            gain = np.where(alone, 0.0, 1 / np.sqrt(np.maximum(spread, _DETERMINED)))
            root[part] = (gain[:, None, :] * axes) @ np.swapaxes(axes, 1, 2)
            count[part] -= alone.sum(axis=1)
        return SubsetFit(
            linear=self,
            inside=inside,
            directions=directions,
            root=root,
            count=np.where(np.arange(len(count)) < self.poses, count, 0),
            dof=int(self.mask[inside].sum()) - directions.shape[1],
            full_rank=full_rank,
        )


@dataclass(frozen=True)
class SubsetFit:
    """Least squares on some poses, with every pose judged by the others of them.

    Attributes:
        directions: ``(f, rank)`` from its columns to an orthonormal basis Q of the rows inside.
        root: ``(n, m, m)`` whitens a pose's residual: (I - H_ii)^-1/2 inside, (I + H_ii)^-1/2 outside.
        count: ``(n,)`` numbers of a pose that the other poses predict.
        full_rank: whether the poses inside identify all parameters.
    """

    linear: LinearizedFit
    inside: Mask
    directions: Array
    root: Array
    count: NDArray[np.int_]
    dof: int
    full_rank: bool

    @property
    def back(self) -> Array:
        """``(f, rank)`` from the basis to the parameters: their covariance is back back' where noise is white."""
        return self.directions / self.linear.scale[:, None]

    def basis(self) -> Iterator[tuple[slice, Array]]:
        """Yield Q ``(n, m, rank)`` in parts: H_ij = Q_i Q_j' maps pose j's errors to pose i's prediction."""
        return self.linear.basis(self.directions)

    def left(self) -> Array:
        """Return the share ``(n, m)`` of each fitted number's variance that remains in its residual."""
        left = np.empty(self.linear.mask.shape)
        for part, basis in self.basis():
            left[part] = 1 - (basis**2).sum(axis=2)
        return left

    def residuals(self, errors: Array) -> Array:
        """Return the residuals of errors ``(..., n, m)`` after least squares on the poses inside, outside too."""
        fitted = np.where(self.inside[:, None], errors, 0.0).reshape(*errors.shape[:-2], -1)
        rows = self.linear.jacobian.reshape(fitted.shape[-1], -1)
        step = (fitted @ rows) @ self.directions @ self.directions.T
        return np.asarray(errors - (step @ rows.T).reshape(errors.shape))

    def squares(self, residuals: Array) -> tuple[Array, Array]:
        """Squared whitened distance ``(..., n)`` of each pose from what the others predict, and the fit's own sum.

        Inside, r' (I - H)^-1 r is how much the sum falls when the pose is left out (Cook & Weisberg 1982,
        eq. 2.2.8 for blocks), and is so its squared prediction error from the others.
        """
        turned = np.einsum("nij,...nj->...ni", self.root, residuals)
        return (turned**2).sum(axis=-1), (residuals[..., self.inside, :] ** 2).sum(axis=(-2, -1))

    def p_values(
        self,
        distance: Array,
        total: Array,
        sigma_given: bool,
        floor: float = 0.0,
        poses: NDArray[np.int_] | None = None,
    ) -> Array:
        """Return each pose's p-value ``(..., n)`` as if it alone were tested, under Gaussian noise.

        Chi squared with a given sigma; else F of the externally studentized distance, with sigma estimated from
        the poses inside without it.

        Args:
            distance, total: of ``squares``.
            floor: the smallest sigma that is accepted.
            poses: which ones ``distance`` is of, in its shape; all in their order where not given.
        """
        inside, count = (every if poses is None else every[poses] for every in (self.inside, self.count))
        size = np.maximum(count, 1)
        if sigma_given:
            p = p_value_of_squares(distance, size)
        else:
            dof = self.dof - np.where(inside, count, 0)
            rest = np.maximum(total[..., None] - np.where(inside, distance, 0.0), 0.0)
            variance = np.maximum(rest / np.maximum(dof, 1), max(floor, 1e-150) ** 2)
            p = np.where(dof > 0, p_value_of_squares(distance, size, np.maximum(dof, 1), variance), 1.0)
        return np.where(count > 0, p, 1.0)


def _directions(triangle: Array) -> tuple[Array, bool]:
    """Return the directions ``(f, rank)`` B of an orthonormal basis Q = J B of rows with this R, and full rank."""
    if condition_bound(triangle) < WELL_CONDITIONED:
        return pseudo_inverse(triangle, FULL_RANK), True
    model = LinearModel.of(triangle, FULL_RANK, scaled=True)
    return model.back, model.full_rank


def _root_near_one(small: Array) -> Array:
    """Return ``(1 + A)^-1/2`` of matrices ``(n, m, m)`` of norms below a thousandth, by the binomial series."""
    one = np.eye(small.shape[1])
    total = one - 7 / 8 * small
    for factor in (5 / 6, 3 / 4, 1 / 2):
        total = one - factor * small @ total
    return np.asarray(total)


def linearized(
    model: Model,
    observed: Observations,
    values: Array,
    free: Sequence[int],
    extra_residuals: ExtraResiduals | None = None,
) -> LinearizedFit:
    """Return the linear problem of ``observed`` at ``values`` ``(p,)`` in the parameters ``free``.

    Args:
        extra_residuals: what else is known of the parameters; its rows stay whichever poses are looked at.
    """
    seen = observed.seen
    n, k, d = observed.points.shape
    more, rows = (np.empty(0), np.empty((0, len(values)))) if extra_residuals is None else extra_residuals(values)
    blocks = n + -(-len(more) // (k * d))
    residual, slopes = np.zeros((blocks, k * d)), np.zeros((blocks, k * d, len(free)))
    filled = np.zeros((blocks, k * d), dtype=bool)
    filled[:n] = np.repeat(seen, d, axis=1)
    first = 0
    for part in observed.blocks():
        here = slice(first, first + len(part.inputs))
        predicted, jacobian = model.observe(part.inputs, values)
        _fill(residual[here], filled[here], part.apply(part.points - predicted))
        _fill(slopes[here], filled[here], part.apply(jacobian[..., list(free)]))
        first = here.stop
    filled[n:].flat[: len(more)] = True
    residual[n:][filled[n:]] = more
    slopes[n:][filled[n:]] = rows[:, list(free)]
    scale = np.sqrt(np.einsum("nmf,nmf->f", slopes, slopes))
    scale[scale == 0] = 1.0
    slopes /= scale
    return LinearizedFit(residual, slopes, scale, filled, n)


def _fill(target: Array, where: Mask, rows: Array) -> None:
    if where.all():
        target[:] = rows.reshape(target.shape)
    else:
        target[where] = rows


def smallest_p(
    within: SubsetFit, mask: Mask, shape: NoiseDistribution, sigma_given: bool, draws: int, rng: np.random.Generator
) -> Array:
    """Return the smallest of all poses' p-values ``(draws,)``, ascending, for noise alone of this shape.

    Of many poses the errors themselves are taken for the residuals, where the fit follows no pose.
    """
    found = []
    sizes = np.unique(within.count)
    alone = mask.size > _MANY and float(within.left()[mask].min()) > 1 - _NO_LEVERAGE
    block = 1 if alone else max(1, _BLOCK // mask.size)
    for first in range(0, draws, block):
        errors = shape.draw((min(block, draws - first), *mask.shape), rng)
        if not mask.all():
            errors *= mask
        if alone:
            distance = np.einsum("bnm,bnm->bn", errors, errors)
            total = distance.sum(axis=1)
        else:
            distance, total = within.squares(within.residuals(errors))
        # Among poses of as many numbers the farthest has the smallest p-value: only those are worked out.
        farthest = np.stack([np.where(within.count == size, distance, -1.0).argmax(axis=1) for size in sizes], axis=1)
        largest = np.take_along_axis(distance, farthest, axis=1)
        found.append(within.p_values(largest, total, sigma_given, poses=farthest).min(axis=1))
    return np.sort(np.concatenate(found))


_UNDETERMINED = 1e-3  # share of a row's variance that the fit has to leave
_SPANNED = 1e-8  # share of a column's squares below which the fitted columns hold it
_ALONE = 1e-6  # share of a direction that the other clusters determine, below which one determines it alone
_LEAST_DOF = 1.5  # of a variance: with fewer a test rejects next to nothing


@dataclass(frozen=True)
class ClusterTest:
    """A test of added columns by clusters.

    Attributes:
        p: the chance of as large a fall in squares if the columns are not there; 1 where the test cannot be made.
        dof: degrees of freedom of the variance between clusters; 0 where one cluster alone determines what is added.
    """

    p: float
    dof: float

    @property
    def can_reject(self) -> bool:
        """True where the clusters are enough for the test to reject anything."""
        return self.dof >= _LEAST_DOF


@dataclass(frozen=True)
class ClusteredRows:
    """Rows in the order of their clusters.

    Attributes:
        rows: ``(r, c + 1)`` columns of comparable size and, last, what they are to explain.
        starts: ``(clusters,)`` the first row of each cluster.
        shared: whether any cluster holds more than one observed thing.
    """

    rows: Array
    starts: NDArray[np.int_]
    shared: bool
    _bases: dict[tuple[int, ...], Array] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, rows: Array, labels: NDArray[np.int_], rows_each: int) -> "ClusteredRows":
        """Build from rows: first those of observed things, ``rows_each`` of each, then single ones."""
        order, starts = clusters_first(np.repeat(labels, rows_each), len(rows))
        return cls(rows[order], starts, len(np.unique(labels)) < len(labels))

    def _basis(self, fitted: tuple[int, ...]) -> Array:
        if fitted not in self._bases:
            self._bases.clear()
            self._bases[fitted] = np.linalg.qr(self.rows[:, list(fitted)])[0]
        return self._bases[fitted]

    def test(self, fitted: Sequence[int], added: Sequence[int]) -> ClusterTest:
        """Test the added columns beside the fitted ones, with errors that are correlated within clusters.

        With b the coefficients in an orthonormal basis of what the added columns have beyond the fitted ones, b' b is
        the fall in squares. With V the covariance of b, b' b / tr V has an F distribution, nearly, with
        tr(V)^2 / tr(V^2) degrees of freedom (Brunner, Dette & Munk 1997) and those of tr V (Satterthwaite 1946). V is
        that of the jackknife over clusters, scaled to have no bias where errors are white. It comes from the fit with
        the added columns, so that an effect that is there does not inflate it.
        """
        basis, columns = self._basis(tuple(fitted)), self.rows[:, list(added)]
        own, sizes, _ = np.linalg.svd(columns - basis @ (basis.T @ columns), full_matrices=False)
        own = own[:, sizes > _SPANNED * max(float(np.linalg.norm(columns)), 1e-300)]
        found = _jackknife(np.concatenate([basis, own], axis=1), own.shape[1], self.rows[:, -1], self.starts)
        if found is None or not found.dof > 0:
            return ClusterTest(1.0, 0.0)
        covariance = found.moves.T @ found.moves * (own.shape[1] / found.trace)
        mean = float(np.trace(covariance))  # of the fall in squares without an effect: tr V
        added_dof = np.asarray(mean**2 / float((covariance**2).sum()) if mean else own.shape[1])
        fall = float(((own.T @ self.rows[:, -1]) ** 2).sum())
        variance = np.maximum(mean / added_dof, 1e-300)
        return ClusterTest(float(p_value_of_squares(fall, added_dof, found.dof, variance)), found.dof)


@dataclass(frozen=True)
class _Jackknife:
    """Moves of coefficients as each cluster is left out.

    Attributes:
        moves: ``(clusters, added)`` the change of each coefficient.
        trace: what the sum of their squares is on average where errors are white, of variance one.
        dof: degrees of freedom of that sum.
    """

    moves: Array
    trace: float
    dof: float


def _jackknife(whole: Array, added: int, errors: Array, starts: NDArray[np.int_]) -> _Jackknife | None:
    """Return the jackknife of the last coefficients of a fit; None where one cluster alone determines any of them.

    With H_i the part of a cluster's rows Z_i in the fit, Z_i Z_i', and U_i the columns that are added, the coefficients
    move by U_i' (1 - H_i)^-1 e_i, with e_i the cluster's residuals (Bell & McCaffrey 2002, CR3).

    Of white errors with variance one the residuals have the covariance 1 - Z Z'. So with the weights
    W_i = U_i' (1 - H_i)^-1 and the products S_i = W_i Z_i the moves of clusters i and j have the covariance
    C_ij = W_i W_i' [i = j] - S_i S_j'. The sum of squares of all moves has the mean sum tr C_ii, which is ``trace``,
    and the variance 2 sum tr(C_ij C_ij'); its degrees of freedom are trace^2 / sum tr(C_ij C_ij') (Satterthwaite
    1946).

    Args:
        whole: ``(r, f)`` orthonormal columns, those that are added last.
        errors: ``(r,)`` what is fitted.
    """
    residual, fitted = errors - whole @ (whole.T @ errors), whole.shape[1] - added
    moves, sizes = np.zeros((len(starts), added)), np.diff(starts, append=len(whole))
    trace = squares = 0.0
    inner = np.zeros((whole.shape[1], whole.shape[1]))
    for size in np.unique(sizes):
        clusters = np.flatnonzero(sizes == size)
        rows = starts[clusters, None] + np.arange(size)
        block = whole[rows]
        solved = _by_others(block, np.concatenate([residual[rows][..., None], block[..., fitted:]], axis=2))
        if solved is None:
            return None
        moves[clusters] = np.einsum("ina,in->ia", block[..., fitted:], solved[..., 0])
        weights = np.swapaxes(solved[..., 1:], 1, 2)  # W_i
        # own: W_i W_i', shared: S_i
        own, shared = weights @ np.swapaxes(weights, 1, 2), weights @ block
        trace += float(np.einsum("iaa->", own) - (shared**2).sum())
        squares += float((own**2).sum() - 2 * (own * (shared @ np.swapaxes(shared, 1, 2))).sum())
        inner += np.einsum("iaf,iag->fg", shared, shared)  # sum over i, j of tr(S_i S_j' S_j S_i') = |sum S_i' S_i|^2
    squares += float((inner**2).sum())
    return _Jackknife(moves, trace, trace**2 / squares if trace > 0 and squares > 0 else 0.0)


def _by_others(block: Array, wanted: Array) -> Array | None:
    """(1 - Z_i Z_i')^-1 of ``wanted`` ``(m, n, w)``, with Z_i of ``block`` ``(m, n, f)``.

    None where a cluster determines one of the wanted columns alone, the first one aside, which is of residuals.
    """
    if block.shape[1] <= block.shape[2]:
        share, axes = np.linalg.eigh(block @ np.swapaxes(block, 1, 2))
        start, back = np.zeros_like(wanted), axes
    else:
        share, axes = np.linalg.eigh(np.swapaxes(block, 1, 2) @ block)
        start, back = wanted, block @ axes
    left = 1 - share
    coordinates, alone = np.swapaxes(back, 1, 2) @ wanted, left < _ALONE
    if (np.abs(coordinates[..., 1:]).max(axis=2, initial=0.0)[alone] > np.sqrt(_ALONE)).any():
        return None
    dropped = 0.0 if start is not wanted else -1.0
    gain = np.where(alone, dropped, 1 / np.where(alone, 1.0, left))
    return np.asarray(start + back @ (gain[..., None] * coordinates))


def clusters_first(labels: NDArray[np.int_], count: int) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Return an order ``(count,)`` of rows in which those of one label follow each other, and where each label begins.

    Args:
        labels: from 0 on, of the first rows; each of the others is alone.
    """
    every = np.concatenate([labels, labels.max(initial=-1) + 1 + np.arange(count - len(labels))])
    order = np.argsort(every, kind="stable")
    return order, np.flatnonzero(np.diff(every[order], prepend=-1))


def cluster_sums(rows: Array, starts: NDArray[np.int_]) -> Array:
    """Sums ``(clusters, ...)`` of rows ``(r, ...)`` from each start to the next."""
    return np.asarray(np.add.reduceat(rows, starts, axis=0))


def jackknifed(residual: Array, basis: Array) -> Array:
    """Residuals ``(r,)`` of rows that the others predict, where the basis ``(r, f)`` is fitted.

    A fit takes its leverage of each error away. What is left over one less that leverage is a little larger than the
    error on average: what stands on it keeps its level from above (MacKinnon & White 1985, HC3).
    """
    left = 1 - (basis**2).sum(axis=1)
    return np.asarray(np.where(left > _UNDETERMINED, residual / np.maximum(left, _UNDETERMINED), 0.0))
