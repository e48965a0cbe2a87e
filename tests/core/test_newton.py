"""The loop of Newton's method: rows of their own, what ends them, and what it returns."""

import numpy as np
import pytest

from lab.core.newton import least_squares_step, newton
from lab.core.se3 import Array


def roots(values: Array, _: Array) -> tuple[Array, Array]:
    """Newton's step to the square roots of 1, 2, 3, ..."""
    step = -(values**2 - np.arange(1.0, 1.0 + len(values))[:, None]) / (2 * values)
    return step, np.abs(step[:, 0]) < 1e-8


def test_it_converges_quadratically_and_counts_the_steps() -> None:
    found = newton(roots, np.array([[1.0], [1.0], [3.0]]), 20)
    np.testing.assert_allclose(found.values[:, 0] ** 2, [1, 2, 3], rtol=1e-15)
    assert found.converged.all() and found.iterations.tolist() == [1, 5, 5]


def test_a_row_that_is_done_is_left_alone() -> None:
    """Each row ends where it ends by itself, however long the others go on; and the caller knows which go on."""
    asked = []

    def step(values: Array, going: Array) -> tuple[Array, Array]:
        asked.append(going.copy())
        return roots(values, going)

    start = np.array([[1.0], [1.4], [300.0]])
    together = newton(step, start, 30)
    for row in range(3):
        alone = newton(lambda values, going, row=row: _only(row, values, going), start[row : row + 1], 30)
        np.testing.assert_array_equal(alone.values[0], together.values[row])
        assert alone.iterations[0] == together.iterations[row]
    assert [int(going.sum()) for going in asked] == sorted((int(going.sum()) for going in asked), reverse=True)
    assert not asked[-1][0]


def _only(row: int, values: Array, going: Array) -> tuple[Array, Array]:
    step = -(values**2 - (row + 1.0)) / (2 * values)
    return step, np.abs(step[:, 0]) < 1e-8


def test_too_few_iterations_are_told() -> None:
    found = newton(roots, np.array([[1.0], [1.0], [300.0]]), 5)
    assert found.converged.tolist() == [True, True, False] and found.iterations[2] == 5


def test_a_step_into_nothing_ends_its_row_alone() -> None:
    def step(values: Array, going: Array) -> tuple[Array, Array]:
        change, settled = roots(values, going)
        change[1] = np.nan
        settled[1] = True
        return change, settled

    found = newton(step, np.ones((3, 1)), 20)
    assert found.converged.tolist() == [True, False, True] and np.isnan(found.values[1]).all()
    assert found.iterations[1] == 1


def test_the_start_is_not_changed() -> None:
    start = np.ones((3, 1))
    newton(roots, start, 20)
    np.testing.assert_array_equal(start, 1.0)


def test_a_least_squares_step_does_not_depend_on_units() -> None:
    rng = np.random.default_rng(1)
    jacobian, residual, units = rng.standard_normal((12, 4)), rng.standard_normal(12), 10.0 ** np.arange(-6, 6, 3)
    step = least_squares_step(jacobian, residual, 1e-12)
    np.testing.assert_allclose(least_squares_step(jacobian * units, residual, 1e-12) * units, step, rtol=1e-12)
    np.testing.assert_allclose(jacobian.T @ (residual - jacobian @ step), 0, atol=1e-14)


def test_a_least_squares_step_does_nothing_along_what_does_nothing() -> None:
    jacobian = np.array([[1.0, 1.0, 0.0], [2.0, 2.0, 0.0]])
    assert least_squares_step(jacobian, np.array([2.0, 4.0]), 1e-12) == pytest.approx([1.0, 1.0, 0.0])
