"""Errors that numbers share: the filter against the dense covariance, the likelihood against its definition."""

from dataclasses import replace

import numpy as np
import pytest

from lab.kinematics.compiled import kernels
from lab.noise.correlation import Correlation
from lab.noise.error_term import Components, ErrorShapes, correlation_of
from lab.noise.variance_components import RestrictedProblem, best_components, chosen_components, small_sample

POSES, NUMBERS = 12, 6
PARTS = Components({"scatter": 0.7, "shift": 1.3, "trend": 2.0}, 0.8)


def shapes(rng: np.random.Generator, poses: int = POSES) -> ErrorShapes:
    shift = np.tile(np.eye(3), (poses, 2, 1))
    times = np.arange(poses, dtype=float)
    times[poses // 2 :] += 2.5  # a pause
    along = (times - times.mean()) / np.abs(times - times.mean()).max()
    scatter = 0.5 * rng.standard_normal((poses, NUMBERS, 4))
    return ErrorShapes(scatter, shift, along, times)


def correlation(of: ErrorShapes, parts: Components) -> Correlation:
    return correlation_of(of, parts)


def dense(of: ErrorShapes, parts: Components) -> np.ndarray:
    """The covariance by its definition, number by number."""
    n, m = of.scatter.shape[:2]
    covariance = np.eye(n * m)
    for i in range(n):
        for j in range(n):
            block = parts["shift"] * parts.carry ** abs(of.times[i] - of.times[j]) * of.shift[i] @ of.shift[j].T
            block = block + parts["trend"] * of.trend[i] @ of.trend[j].T
            if i == j:
                block = block + parts["scatter"] * of.scatter[i] @ of.scatter[i].T
            covariance[i * m : i * m + m, j * m : j * m + m] += block
    return covariance


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("shuffled", [False, True])
@pytest.mark.parametrize(
    "parts",
    [
        PARTS,
        Components({"scatter": 2.0}),
        Components({"shift": 3.0}, 0.5),
        Components({"scatter": 1.0, "shift": 3.0}),
        Components({"trend": 9.0}),
    ],
)
def test_whitened_errors_have_unit_covariance(
    parts: Components, shuffled: bool, compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not compiled:
        monkeypatch.setattr(kernels, "_CODE", None)
    rng = np.random.default_rng(0)
    of = shapes(rng)
    if shuffled:  # rows of a file need not stand in the order of time
        order = rng.permutation(POSES)
        of = ErrorShapes(of.scatter[order], of.shift[order], of.along[order], of.times[order])
    shared = correlation(of, parts)
    assert shared.between_poses == bool(parts.carry or parts["trend"])
    unit = np.eye(POSES * NUMBERS).reshape(POSES, NUMBERS, -1)
    white = shared.white(unit).reshape(POSES * NUMBERS, -1)
    assert np.allclose(white @ dense(of, parts) @ white.T, np.eye(len(white)), atol=1e-12)
    assert np.allclose(shared.coloured(shared.white(unit)), unit, atol=1e-12)
    assert np.allclose(1 + shared.squares.ravel(), np.diag(dense(of, parts)))


@pytest.mark.skipif(not kernels.compiled(), reason="built without a C compiler")
def test_the_compiled_filter_is_that_of_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(5)
    of, rows = shapes(rng, 200), rng.standard_normal((200, NUMBERS, 4, 2))
    fast = correlation(of, PARTS).white(rows)
    singular = replace(correlation(of, PARTS), scatter=np.full((200, NUMBERS, 4), np.nan))
    with pytest.raises(np.linalg.LinAlgError):
        singular.white(rows)
    monkeypatch.setattr(kernels, "_CODE", None)
    np.testing.assert_allclose(fast, correlation(of, PARTS).white(rows), rtol=0, atol=1e-12)


def test_single_poses_keep_their_own_covariance_and_nothing_else() -> None:
    of = shapes(np.random.default_rng(1))
    alone = correlation(of, PARTS).of_single_poses()
    unit = np.eye(POSES * NUMBERS).reshape(POSES, NUMBERS, -1)
    white = alone.white(unit).reshape(POSES * NUMBERS, -1)
    covariance = np.linalg.inv(white.T @ white).reshape(POSES, NUMBERS, POSES, NUMBERS)
    whole = dense(of, PARTS).reshape(POSES, NUMBERS, POSES, NUMBERS)
    for i in range(POSES):
        assert np.allclose(covariance[i, :, i], whole[i, :, i])
        assert np.abs(covariance[i, :, i - 1]).max() < 1e-12


def problem(rng: np.random.Generator, of: ErrorShapes, errors: np.ndarray, *, known: bool = False) -> RestrictedProblem:
    columns = rng.standard_normal((*of.scatter.shape[:2], 5))
    columns /= np.linalg.norm(columns, axis=(0, 1))
    return RestrictedProblem(np.concatenate([columns, errors[..., None]], axis=2), errors.size, of, known)


def test_the_restricted_likelihood_is_that_of_the_dense_covariance() -> None:
    rng = np.random.default_rng(2)
    of = shapes(rng)
    asked = problem(rng, of, rng.standard_normal((POSES, NUMBERS)))
    found = asked.likelihood(PARTS)
    rows = asked.rows.reshape(POSES * NUMBERS, -1)
    columns, errors = rows[:, :-1], rows[:, -1]
    inverse = np.linalg.inv(dense(of, PARTS))
    information = columns.T @ inverse @ columns
    best = np.linalg.solve(information, columns.T @ inverse @ errors)
    left = (errors - columns @ best) @ inverse @ (errors - columns @ best)
    dof = rows.shape[0] - 5
    expected = (
        np.linalg.slogdet(dense(of, PARTS))[1] + np.linalg.slogdet(information)[1] + dof * np.log(left / dof) + dof
    )
    assert np.allclose(found.information, information)
    assert found.scale == pytest.approx(left / dof)
    assert found.deviance == pytest.approx(expected - np.log(1 - PARTS.carry))  # the weak prior of a slow shift


def drawn(rng: np.random.Generator, of: ErrorShapes, parts: Components) -> np.ndarray:
    """Errors of this covariance, by the dense factor."""
    n, m = of.scatter.shape[:2]
    return (np.linalg.cholesky(dense(of, parts)) @ rng.standard_normal(n * m)).reshape(n, m)


@pytest.mark.parametrize(
    ("parts", "kind"),
    [
        (Components({"scatter": 4.0}), "scatter"),
        (Components({"shift": 4.0}, 0.8), "wandering"),
        (Components({"trend": 30.0}), "drift"),
    ],
)
def test_what_is_there_is_taken_and_nothing_else(parts: Components, kind: str) -> None:
    rng = np.random.default_rng(3)
    of = shapes(rng, 40)
    for _ in range(2):
        estimate, trials = chosen_components(problem(rng, of, drawn(rng, of, parts)))
        assert estimate.kinds == (kind,)
        assert [trial.kind for trial in trials if trial.taken] == [kind]


def test_independent_errors_share_nothing_at_the_level_of_the_test() -> None:
    rng = np.random.default_rng(5)
    of = shapes(rng, 20)
    taken = [chosen_components(problem(rng, of, rng.standard_normal((20, NUMBERS))))[0].kinds for _ in range(30)]
    assert sum(kinds != () for kinds in taken) <= 2  # 0.3 expected; the chance of more than 2 is 0.4 %


def test_a_given_variance_is_an_upper_bound() -> None:
    rng = np.random.default_rng(6)
    of = shapes(rng, 40)
    small, large = (
        problem(rng, of, size * rng.standard_normal((40, NUMBERS)), known=True).likelihood(Components()).scale
        for size in (0.5, 2.0)
    )
    assert small == pytest.approx(0.25, rel=0.3) and large == 1.0


def test_estimated_variances_widen_the_covariance_and_lower_its_degrees_of_freedom() -> None:
    rng = np.random.default_rng(7)
    of, parts = shapes(rng, 12), Components({"scatter": 3.0})
    asked = problem(rng, of, drawn(rng, of, parts))
    estimate = best_components(asked, ("scatter",))
    small = small_sample(asked, estimate)
    plain = np.linalg.inv(estimate.likelihood.information)
    grown = small.factor @ plain @ small.factor.T
    assert (np.linalg.eigvalsh(grown - plain) > -1e-12).all() and np.trace(grown) > np.trace(plain)
    assert (small.dof < asked.dof).all() and (small.dof > 5).all()


def test_standard_deviations_grow_as_the_root_of_all_variances_together() -> None:
    rng = np.random.default_rng(8)
    of, parts = shapes(rng, 12), Components({"scatter": 3.0})
    asked = problem(rng, of, drawn(rng, of, parts))
    found = small_sample(asked, best_components(asked, ("scatter",))).components
    assert set(found.names) == {"scale", "scatter"}
    np.testing.assert_allclose(found.slopes.sum(axis=0), 0.5, rtol=5e-3)  # each is homogeneous of degree one half
    assert (found.slopes > 0).all() and (np.linalg.eigvalsh(found.covariance) > 0).all()
