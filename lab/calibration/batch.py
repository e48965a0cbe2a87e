"""Gauss-Newton for many campaigns at once: arms of one nominal model, solved in blocks by normal equations.

What was measured, and how the arms predict it, is a part (``BatchObservation``): positions at poses that all
campaigns share (``batch_points``), or positions and orientations at joint positions of their own (``batch_poses``).
A block always holds as many campaigns, the last one padded: a matrix product's last bits change with its size.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from lab.core.newton import newton
from lab.core.se3 import Array
from lab.kinematics.compiled.kernels import solve_positive

__all__ = ["BLOCK", "MAX_STEPS", "BatchFits", "BatchObservation", "fit_batch"]

BLOCK = 50  # campaigns solved together: what fits the processor's cache
MAX_STEPS = 20
SETTLED = 1e-9  # m or rad: a step below is still taken, so that what remains is its square
CHORD_SETTLED = 1e-8  # of the chord method, which gains two digits a step
RANK_TOLERANCE = 1e-10  # of the normal equations of unit columns


class BatchObservation(Protocol):
    """What was measured in b campaigns, with the arms that predict it from parameters ``(b, p)``."""

    def __len__(self) -> int:
        """How many campaigns there are."""

    def take(self, rows: NDArray[np.int_]) -> Self:
        """Some of the campaigns, also more than once."""

    def residual(self, values: Array) -> Array:
        """Whitened residual ``(b, r)``, measured less predicted."""

    def linearized(self, values: Array, free: Sequence[int]) -> tuple[Array, Array]:
        """Whitened derivatives ``(b, f, r)`` of the prediction by the ``free`` parameters, and the residual."""

    def settled(self, step: Array, squares: Array, tolerance: float) -> NDArray[np.bool_]:
        """``(b,)`` which steps ``(b, f)`` are the last ones.

        Args:
            step: of the free parameters, m and rad.
            squares: ``(b,)`` of the moves of the whitened prediction.
            tolerance: m or rad.
        """


@dataclass(frozen=True)
class BatchFits:
    """Where the fits ended.

    Attributes:
        values: ``(b, p)`` the parameters.
        converged: ``(b,)``.
        steps: ``(b,)`` how many were taken.
        information: ``(b, f, f)`` J' J of the free parameters, whitened as the observation is.
    """

    values: Array
    converged: NDArray[np.bool_]
    steps: NDArray[np.int_]
    information: Array


def fit_batch(
    observed: BatchObservation,
    start: Array,
    free: Sequence[int],
    *,
    frozen: bool = False,
    shortest: bool = False,
    max_steps: int = MAX_STEPS,
    block: int = BLOCK,
) -> BatchFits:
    """Least squares over the free parameters of every campaign, block by block, the others held.

    Args:
        start: ``(b, p)``, or ``(p,)`` for all alike.
        frozen: take the Jacobian at the start of the first campaign for all steps (the chord method).
        shortest: where the measurements do not tell the parameters apart, take the shortest step in unit columns;
            else they must tell them apart.
        max_steps: take so many at most.
        block: how many campaigns are solved together.
    """
    count = len(observed)
    order = np.arange(-(-count // block) * block)
    order[count:] = 0
    starts = np.broadcast_to(start, (count, np.shape(start)[-1]))
    parts = []
    for first in range(0, len(order), block):
        rows = order[first : first + block]
        some, values, unknowns = observed.take(rows), starts[rows].copy(), list(free)
        if frozen:
            parts.append(_chord(some, values, unknowns, max_steps))
        else:
            parts.append(_gauss_newton(some, values, unknowns, shortest, max_steps))
    return BatchFits(*(np.concatenate(part)[:count] for part in zip(*parts, strict=True)))


_Part = tuple[Array, NDArray[np.bool_], NDArray[np.int_], Array]


def _gauss_newton(block: BatchObservation, values: Array, free: list[int], shortest: bool, max_steps: int) -> _Part:
    """Normal equations of unit columns: the condition of a base set leaves them ten digits."""
    information = np.empty((len(block), len(free), len(free)))

    def step(unknowns: Array, going: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        values[:, free] = unknowns
        columns, residual = block.linearized(values, free)
        products = columns @ columns.swapaxes(1, 2)
        scale = np.sqrt(np.diagonal(products, axis1=1, axis2=2))
        scale = np.where(scale == 0, 1.0, scale)
        square = products / (scale[:, :, None] * scale[:, None, :])
        right = (columns @ residual[:, :, None])[:, :, 0] / scale
        if shortest:
            scaled: Array = np.einsum("bfg,bg->bf", np.linalg.pinv(square, rcond=RANK_TOLERANCE, hermitian=True), right)
        else:
            scaled = solve_positive(square, right)
        squares = np.einsum("bf,bfg,bg->b", scaled, square, scaled)
        information[going] = products[going]
        return scaled / scale, block.settled(scaled / scale, squares, SETTLED)

    found = newton(step, values[:, free], max_steps)
    values[:, free] = found.values
    return values, found.converged, found.iterations, information


def _chord(block: BatchObservation, values: Array, free: list[int], max_steps: int) -> _Part:
    """The Jacobian at the first campaign's start for all campaigns and steps: x += pinv(J0) r."""
    first = np.zeros(1, dtype=np.int_)
    rows = block.take(first).linearized(values[first], free)[0][0]  # (f, r)
    scale = np.linalg.norm(rows, axis=1)
    inverse = np.linalg.pinv((rows / scale[:, None]).T) / scale[:, None]  # (f, r)

    def step(unknowns: Array, _: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        values[:, free] = unknowns
        change = block.residual(values) @ inverse.T
        return change, block.settled(change, ((change @ rows) ** 2).sum(axis=1), CHORD_SETTLED)

    found = newton(step, values[:, free], max_steps)
    values[:, free] = found.values
    return values, found.converged, found.iterations, np.tile(rows @ rows.T, (len(block), 1, 1))
