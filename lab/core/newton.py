"""Newton's method for many systems at once, and the Gauss-Newton step in unit columns."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.linear_model import unit_columns
from lab.core.se3 import Array

__all__ = ["least_squares_step", "newton"]

_Step = Callable[[Array, NDArray[np.bool_]], tuple[Array, NDArray[np.bool_]]]
"""From unknowns ``(n, x)`` and the active rows ``(n,)`` to steps ``(n, x)`` and the rows ``(n,)`` of a last step."""


@dataclass(frozen=True)
class _NewtonResult:
    """Result of the iteration.

    Attributes:
        values: ``(n, x)``, NaN after a step of NaN.
        converged: ``(n,)``.
        iterations: ``(n,)``.
    """

    values: Array
    converged: NDArray[np.bool_]
    iterations: NDArray[np.int_]


def newton(step: _Step, start: Array, max_iterations: int) -> _NewtonResult:
    """Iterate from ``start`` ``(n, x)``, each row up to its own last step, which is taken.

    A last step of NaN ends its row unconverged.
    """
    values = start.copy()
    active, iterations = np.ones(len(start), dtype=np.bool_), np.zeros(len(start), dtype=np.int_)
    for _ in range(max_iterations):
        change, settled = step(values, active)
        values += np.where(active[:, None], change, 0.0)
        iterations += active
        active &= ~settled
        if not active.any():
            break
    return _NewtonResult(values, ~active & np.isfinite(values).all(axis=1), iterations)


def least_squares_step(jacobian: Array, residual: Array, tolerance: float | None = None) -> Array:
    """Return the least-squares step ``(x,)`` for ``residual`` ``(r,)`` by unit columns of ``jacobian`` ``(r, x)``.

    Args:
        tolerance: of the largest singular value, below which one is zero; by default that of rounding.
    """
    columns, scale = unit_columns(jacobian)
    step: Array = np.linalg.lstsq(columns, residual, rcond=tolerance)[0] / scale
    return step
