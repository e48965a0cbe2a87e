"""Newton's and Gauss and Newton's method: the loop, and the step in unit columns.

What the lab solves step by step differs in what a step is: a system of equations, least squares by normal equations
of a whole batch, a chord, a pseudo-inverse with a limit. What does not differ is the loop (``newton``): rows of
unknowns go on until their own steps are small enough, the others are left alone, and the result says which arrived
and in how many steps. Methods that keep more than that from step to step (a damping, a line search, a way that must
not be left) have loops of their own, and say why.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.linear_model import unit_columns
from lab.core.se3 import Array

__all__ = ["NewtonResult", "Step", "least_squares_step", "newton"]

Step = Callable[[Array, NDArray[np.bool_]], tuple[Array, NDArray[np.bool_]]]
"""Unknowns ``(n, x)``, and which rows ``(n,)`` still go on, to steps ``(n, x)``, and which of them ``(n,)`` are so
small that they are the last ones. What is said of rows that do not go on is not used."""


@dataclass(frozen=True)
class NewtonResult:
    """Result of the iteration.

    Attributes:
        values: ``(n, x)`` the unknowns; NaN where a step was.
        converged: ``(n,)`` whether the last step was small enough.
        iterations: ``(n,)`` how many steps were taken.
    """

    values: Array
    converged: NDArray[np.bool_]
    iterations: NDArray[np.int_]


def newton(step: Step, start: Array, max_iterations: int) -> NewtonResult:
    """Take steps from ``start`` ``(n, x)``, each row until its own step is small enough, which is still taken.

    Args:
        step: what is added to the unknowns. A step of NaN that says it is the last one ends its row unconverged.
        max_iterations: how many steps a row takes at most.
    """
    values = start.copy()
    going, iterations = np.ones(len(start), dtype=np.bool_), np.zeros(len(start), dtype=np.int_)
    for _ in range(max_iterations):
        change, settled = step(values, going)
        values += np.where(going[:, None], change, 0.0)
        iterations += going
        going &= ~settled
        if not going.any():
            break
    return NewtonResult(values, ~going & np.isfinite(values).all(axis=1), iterations)


def least_squares_step(jacobian: Array, residual: Array, tolerance: float | None = None) -> Array:
    """The step ``(x,)`` that makes up for ``residual`` ``(r,)`` best, by unit columns of ``jacobian`` ``(r, x)``.

    Where some directions do nothing, the step has none of them.

    Args:
        tolerance: of the largest singular value, below which a direction does nothing; rounding where not given.
    """
    columns, scale = unit_columns(jacobian)
    step: Array = np.linalg.lstsq(columns, residual, rcond=tolerance)[0] / scale
    return step
