"""Whitened rows of a linear problem, in clusters whose errors may go together, and a test that allows for it.

An error of the joints moves all targets of a pose together, and poses far from the base more than others. What a pose
contributes to a score is then one number, of unknown variance, and only its sign is by chance (Hemerik, Goeman & Finos
2020): no variance has to be the same anywhere.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lab.core.linear_model import matched_dof, p_value_of_squares
from lab.core.se3 import Array

__all__ = ["ClusteredRows", "cluster_sums", "clusters_first", "jackknifed"]

_UNDETERMINED = 1e-3  # share of a row's variance that the fit has to leave
_SPANNED = 1e-8  # share of a column's squares below which the fitted columns hold it


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

    def p_value(self, fitted: Sequence[int], added: Sequence[int]) -> float:
        """The chance of as large a score of the added columns if only the fitted ones are there.

        With g_i what cluster i contributes to the scores, and G the inner products of the added columns beyond what
        is fitted, the statistic is s' G^-1 s of s, their sum. Under random signs of the g_i its mean is the sum of
        g_i' G^-1 g_i and its variance twice that of (g_i' G^-1 g_j)^2 over i other than j: a scaled chi squared has
        both.
        """
        basis = self._basis(tuple(fitted))
        residual = self.rows[:, -1] - basis @ (basis.T @ self.rows[:, -1])
        columns = self.rows[:, list(added)]
        own, sizes, _ = np.linalg.svd(columns - basis @ (basis.T @ columns), full_matrices=False)
        own = own[:, sizes > _SPANNED * max(float(np.linalg.norm(columns)), 1e-300)]  # G is one
        scores = cluster_sums(own * jackknifed(residual, basis)[:, None], self.starts)
        inner, squares = scores.T @ scores, (scores**2).sum(axis=1)
        mean, variance = float(squares.sum()), 2 * float((inner**2).sum() - (squares**2).sum())
        if not variance > 0:
            return 1.0
        dof = matched_dof(mean, variance)
        return float(p_value_of_squares(float(((own.T @ residual) ** 2).sum()), dof, variance=mean / dof))


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
