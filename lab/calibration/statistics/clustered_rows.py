"""Whitened rows of a linear problem, in clusters whose errors may be correlated, and a test that allows for it.

An error of the joints moves all targets of a pose together, what a model lacks repeats at each visit of a pose, and
poses far from the base are moved more than others. So a cluster is a configuration of the arm, however often it is
measured. The covariance of what columns add to a fit comes from the jackknife over clusters, which assumes neither
independent rows nor equal variances (Bell & McCaffrey 2002, CR3).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lab.core.linear_model import p_value_of_squares
from lab.core.se3 import Array

__all__ = ["ClusterTest", "ClusteredRows", "cluster_sums", "clusters_first", "jackknifed"]

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
    def has_freedom(self) -> bool:
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
    def of(cls, rows: Array, labels: NDArray[np.int_], numbers: int) -> "ClusteredRows":
        """Of rows, the first of which are of observed things of so many numbers each; each other row is alone.

        Args:
            labels: of the things, from 0 on.
        """
        order, starts = clusters_first(np.repeat(labels, numbers), len(rows))
        return cls(rows[order], starts, len(np.unique(labels)) < len(labels))

    def _basis(self, fitted: tuple[int, ...]) -> Array:
        """Orthonormal columns for those that are fitted; the same are asked for again and again."""
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
        mean = float(np.trace(covariance))
        numbers = np.asarray(mean**2 / float((covariance**2).sum()) if mean else own.shape[1])
        fall = float(((own.T @ self.rows[:, -1]) ** 2).sum())
        variance = np.maximum(mean / numbers, 1e-300)
        return ClusterTest(float(p_value_of_squares(fall, numbers, found.dof, variance)), found.dof)


@dataclass(frozen=True)
class _Jackknife:
    """Return how far leaving out each cluster moves coefficients.

    Attributes:
        moves: ``(clusters, added)``.
        trace: what the sum of their squares is on average where errors are white, of variance one.
        dof: degrees of freedom of that sum.
    """

    moves: Array
    trace: float
    dof: float


def _jackknife(whole: Array, added: int, errors: Array, starts: NDArray[np.int_]) -> _Jackknife | None:
    """The jackknife of the last coefficients of a fit; None where one cluster alone determines any of them.

    With H_i the part of a cluster's rows Z_i in the fit, Z_i Z_i', and U_i the columns that are added, the coefficients
    move by U_i' (1 - H_i)^-1 e_i, with e_i the cluster's residuals.

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
        weights = np.swapaxes(solved[..., 1:], 1, 2)  # a cluster's move is weights (e_i - Z_i Z' e), of unit errors e
        own, shared = weights @ np.swapaxes(weights, 1, 2), weights @ block
        trace += float(np.einsum("iaa->", own) - (shared**2).sum())
        squares += float((own**2).sum() - 2 * (own * (shared @ np.swapaxes(shared, 1, 2))).sum())
        inner += np.einsum("iaf,iag->fg", shared, shared)
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
    """An order ``(count,)`` of rows in which those of one label follow each other, and where each label begins.

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
