"""The marginal model: the algebra is that of the dense covariance, and variances are recovered."""

import numpy as np
import pytest

from lab.diagnosis.marginal import MarginalFit, Problem, Variances, estimated, rotated

POSES, NUMBERS = 120, 6


def problem_of(rng: np.random.Generator, scatter: float = 0.0, effect: float = 1.0) -> tuple[Problem, np.ndarray]:
    """A problem with two columns without a prior, six of one kind, and the slopes of three joints."""
    columns = rng.normal(size=(POSES, NUMBERS, 8))
    slopes = rng.normal(size=(POSES, NUMBERS, 3))
    kinds = np.array([-1, -1, 0, 0, 0, 1, 1, 1])
    true = np.concatenate([[5.0, -3.0], rng.normal(size=3), effect * rng.normal(size=3)])
    errors = rng.normal(size=(POSES, NUMBERS)) + (slopes @ (np.sqrt(scatter) * rng.normal(size=(POSES, 3, 1))))[..., 0]
    mask = rng.random((POSES, NUMBERS)) > 0.05
    residual = np.where(mask, columns @ true + errors, 0.0)
    turned, (whole,), sizes, known = rotated(residual, [columns], slopes, mask)
    return Problem(turned, whole, kinds, sizes, known, False), true


def test_it_is_the_dense_model() -> None:
    problem, _ = problem_of(np.random.default_rng(0), scatter=0.5)
    variances = Variances(1.3, 0.4, np.array([0.7, 2.0]), np.ones(POSES))
    fit = MarginalFit(problem, variances)
    known = problem.mask
    columns, residual = problem.columns[known], problem.residual[known]
    random = problem.kinds >= 0
    sizes = variances.kinds[problem.kinds[random]]
    dense = np.diag(fit.diagonal[known]) + (columns[:, random] * sizes) @ columns[:, random].T
    inverse = np.linalg.inv(dense)
    flat = columns[:, ~random]
    normal = flat.T @ inverse @ flat
    projected = inverse - inverse @ flat @ np.linalg.solve(normal, flat.T @ inverse)
    np.testing.assert_allclose(fit.pulls[known], projected @ residual, atol=1e-6)
    restricted = np.linalg.slogdet(dense)[1] + np.linalg.slogdet(normal)[1] + residual @ projected @ residual
    assert fit.deviance == pytest.approx(restricted, abs=1e-4)


def test_errors_of_left_out_poses_are_those_of_the_others_predictions() -> None:
    problem, _ = problem_of(np.random.default_rng(1))
    fit = MarginalFit(problem, Variances(1.0, 0.0, np.ones(2), np.ones(POSES)))
    rows = np.array([3, 17, 90])
    others = np.setdiff1d(np.arange(POSES), rows)
    alone = MarginalFit(
        Problem(
            problem.residual[others],
            problem.columns[others],
            problem.kinds,
            problem.scatter[others],
            problem.mask[others],
            False,
        ),
        Variances(1.0, 0.0, np.ones(2), np.ones(len(others))),
    )
    wanted = problem.residual[rows] - problem.columns[rows] @ alone.coefficients
    seen = problem.mask[rows]
    np.testing.assert_allclose(fit.predicted_errors(rows)[seen], wanted[seen], atol=1e-6)


@pytest.mark.parametrize("scatter", [0.0, 0.5])
def test_variances_are_recovered(scatter: float) -> None:
    found = []
    for seed in range(12):
        problem, _ = problem_of(np.random.default_rng(seed), scatter)
        found.append(estimated(problem).variances)
    assert np.mean([each.noise for each in found]) == pytest.approx(1.0, abs=0.1)
    assert np.mean([each.scatter for each in found]) == pytest.approx(scatter, abs=0.08)


def test_coefficients_without_a_prior_are_covered() -> None:
    off = []
    for seed in range(60):
        problem, true = problem_of(np.random.default_rng(100 + seed), 0.5)
        fit = estimated(problem)
        off.append((fit.coefficients[:2] - true[:2]) / np.sqrt(np.diag(fit.covariance)[:2]))
    assert 0.8 < np.std(off) < 1.2


@pytest.mark.parametrize("off", [60.0, 5e3, 1e6])
def test_a_pose_far_off_does_not_count(off: float) -> None:
    """However far it is off."""
    problem, _ = problem_of(np.random.default_rng(4))
    spoilt = problem.residual.copy()
    spoilt[50] += off
    fit = estimated(Problem(spoilt, problem.columns, problem.kinds, problem.scatter, problem.mask, False))
    assert np.flatnonzero(fit.variances.outlying).tolist() == [50]
    np.testing.assert_allclose(fit.coefficients, estimated(problem).coefficients, atol=0.1)
