"""Least squares of whitened columns, against the normal equations, and its tests, against simulated noise."""

import numpy as np
import pytest
from scipy import stats

from lab.core.linear_model import (
    LinearModel,
    condition_bound,
    half_width_95,
    matched_dof,
    p_value_of_squares,
    pseudo_inverse,
    triangle,
    triangle_of,
    unit_columns,
)

RNG = np.random.default_rng(1)
COLUMNS = RNG.standard_normal((40, 6)) * 10.0 ** np.arange(-3, 3)
ROWS = RNG.standard_normal(40)


def test_it_solves_the_normal_equations_and_projects() -> None:
    model = LinearModel.of(COLUMNS, 1e-9)
    square = COLUMNS.T @ COLUMNS
    np.testing.assert_allclose(model.solve(ROWS), np.linalg.solve(square, COLUMNS.T @ ROWS), rtol=1e-9)
    np.testing.assert_allclose(model.covariance, np.linalg.inv(square), rtol=1e-8)
    assert model.full_rank and model.identifiable.all() and (model.rank, model.dof) == (6, 34)
    np.testing.assert_allclose(COLUMNS.T @ model.residual(ROWS) / np.linalg.norm(COLUMNS, axis=0), 0, atol=1e-13)
    np.testing.assert_allclose(model.residual(model.residual(ROWS)), model.residual(ROWS), atol=1e-14)
    assert model.leverages.sum() == pytest.approx(6) and (model.leverages < 1).all()


def test_columns_that_depend_on_each_other_leave_what_stands_alone() -> None:
    columns = np.column_stack([COLUMNS, COLUMNS[:, 1] - 2 * COLUMNS[:, 3], np.zeros(40)])
    model = LinearModel.of(columns, 1e-9)
    assert model.rank == 6 and not model.full_rank
    assert model.identifiable.tolist() == [True, False, True, False, True, True, False, False]
    alone = LinearModel.of(COLUMNS, 1e-9)
    np.testing.assert_allclose(model.residual(ROWS), alone.residual(ROWS), atol=1e-12)
    np.testing.assert_allclose(model.solve(ROWS)[[0, 2, 4, 5]], alone.solve(ROWS)[[0, 2, 4, 5]], rtol=1e-8)


def test_the_scale_of_columns_decides_what_is_shortest() -> None:
    """Of two equal columns both take half; where one is written ten times larger as it is, it takes nearly all."""
    columns = np.column_stack([ROWS, 10 * ROWS])
    np.testing.assert_allclose(LinearModel.of(columns, 1e-9).solve(ROWS), [0.5, 0.05])
    np.testing.assert_allclose(LinearModel.of(columns, 1e-9, scaled=True).solve(ROWS), np.array([1, 10]) / 101)


def test_no_columns_and_columns_of_zeros_explain_nothing() -> None:
    for columns in (np.empty((40, 0)), np.zeros((40, 2))):
        model = LinearModel.of(columns, 1e-9)
        assert model.rank == 0 and model.dof == 40
        np.testing.assert_array_equal(model.residual(ROWS), ROWS)


def test_p_values_of_noise_are_uniform() -> None:
    rng, model = np.random.default_rng(2), LinearModel.of(COLUMNS, 1e-9)
    noise = 0.3 * rng.standard_normal((40, 4000))
    explained, left = (model.coordinates(noise) ** 2).sum(axis=0), (model.residual(noise) ** 2).sum(axis=0)
    by_sigma = p_value_of_squares(left, model.dof, variance=0.3**2)
    by_residuals = p_value_of_squares(explained, model.rank, model.dof, left / model.dof)
    for p in (by_sigma, by_residuals):
        assert stats.kstest(p, "uniform").pvalue > 1e-3


def test_matched_degrees_of_freedom_are_those_of_the_sum_that_they_match() -> None:
    assert matched_dof(7.0, 14.0) == 7.0  # chi squared itself
    assert matched_dof(3.0 * 7.0, 9.0 * 14.0) == 7.0  # times a number
    assert np.isinf(matched_dof(1.0, 0.0))
    squares = np.random.default_rng(3).standard_normal((20_000, 12)) ** 2 @ np.linspace(0.2, 2.0, 12)
    dof = float(matched_dof(squares.mean(), squares.var()))
    assert 8 < dof < 12
    assert np.mean(squares / squares.mean() * dof > stats.chi2.isf(0.05, dof)) == pytest.approx(0.05, abs=0.006)


def test_half_widths_fall_to_the_normal_one() -> None:
    assert half_width_95(np.array([5.0, np.inf])) == pytest.approx([2.570581835636314, 1.959963984540054], abs=1e-12)


def test_unit_columns_keep_columns_of_zeros() -> None:
    scaled, size = unit_columns(np.array([[3.0, 0.0], [4.0, 0.0]]))
    np.testing.assert_array_equal(size, [5.0, 1.0])
    np.testing.assert_array_equal(scaled, [[0.6, 0.0], [0.8, 0.0]])


@pytest.mark.parametrize("shape", [(9, 4), (4, 4), (3, 5)])
def test_a_triangle_has_the_inner_products_of_its_rows(shape: tuple[int, int]) -> None:
    rows = np.random.default_rng(5).standard_normal(shape)
    upper = triangle(rows)
    np.testing.assert_array_equal(triangle(np.asfortranarray(rows), overwrite=True), upper)
    assert upper.shape == (min(shape), shape[1]) and not np.tril(upper, -1).any()
    np.testing.assert_allclose(upper.T @ upper, rows.T @ rows, atol=1e-13)


def test_the_inverse_of_a_triangle_leaves_out_what_is_not_determined() -> None:
    triangle = np.triu(np.random.default_rng(3).standard_normal((6, 6))) + 3 * np.eye(6)
    assert np.abs(pseudo_inverse(triangle, 1e-10) @ triangle - np.eye(6)).max() < 1e-13
    for small in (0.0, 1e-13):  # the fifth column is all but a sum of others
        triangle[:, 4] = triangle[:, 0] - triangle[:, 2]
        triangle[4, 4] = small
        inverse = pseudo_inverse(triangle, 1e-10)
        assert np.abs(triangle @ inverse @ triangle - triangle).max() < 1e-12
        assert np.linalg.norm(inverse) < 1e3 and np.linalg.matrix_rank(inverse, 1e-6) == 5


def test_of_fewer_rows_than_columns_the_inverse_is_the_shortest() -> None:
    rows = np.random.default_rng(4).standard_normal((3, 5))
    np.testing.assert_allclose(pseudo_inverse(triangle(rows), 1e-10), np.linalg.pinv(triangle(rows)), atol=1e-13)


def test_a_condition_is_at_most_its_bound() -> None:
    for seed in range(30):
        rng = np.random.default_rng(seed)
        upper = triangle(rng.standard_normal((20, 6)) * 10.0 ** rng.uniform(-2, 2, 6))
        condition = np.linalg.cond(upper)
        assert condition <= condition_bound(upper) <= 6 * condition * (1 + 1e-9)
    upper[3, 3] = 0.0
    assert np.isinf(condition_bound(upper)) and np.isinf(condition_bound(upper[:4]))


@pytest.mark.parametrize("dependent", [False, True])
def test_the_triangle_of_many_rows_is_that_of_all_at_once(dependent: bool) -> None:
    """By products of columns, and where these depend on each other by reflections."""
    columns = RNG.standard_normal((12_000, 5)) * 10.0 ** np.arange(-3, 2)
    columns[:, 4] = columns[:, 0] + columns[:, 3] if dependent else columns[:, 4]
    triangle = triangle_of(np.array_split(columns, [10_000]))
    products = columns.T @ columns
    np.testing.assert_allclose(triangle.T @ triangle, products, rtol=1e-10, atol=1e-13 * products.max())
    assert (np.linalg.svd(triangle / np.linalg.norm(triangle, axis=0))[1][-1] < 1e-13) == dependent
