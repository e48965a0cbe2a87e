"""Estimators of one's own: what they are given, what the lab makes of their estimates, and what it refuses."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import lab
from lab.calibration.estimator import LEAST_SQUARES, EstimationProblem, Estimator
from lab.core.errors import LabError

SESSION = lab.simulate("irb120", poses=30, seed=3)
Estimate = tuple[np.ndarray, np.ndarray]


class GaussNewton(Estimator):
    """Least squares again, from what the problem gives: the lab's own result by another way."""

    name = "gauss-newton"

    def __init__(self) -> None:
        self.problems = list[EstimationProblem]()

    def estimate(self, problem: EstimationProblem) -> Estimate:
        self.problems.append(problem)
        values = problem.start
        for _ in range(4):
            residuals, jacobian = problem.linearized(values)
            values = values + np.linalg.lstsq(jacobian, residuals)[0]
        return values, np.linalg.inv(jacobian.T @ jacobian)


def identified(estimator: Any = LEAST_SQUARES, **options: Any) -> lab.CalibrationResult:
    return lab.identify(SESSION.measurements, robot="irb120", estimator=estimator, **options)


def test_least_squares_by_a_users_own_code_is_the_lab_s() -> None:
    """Values, intervals and the errors of cross-validation agree; it has five folds of 24 poses beside all 30."""
    estimator = GaussNewton()
    own, known = (identified(each, instrument="uniform-8um") for each in (estimator, LEAST_SQUARES))
    np.testing.assert_allclose(own.identification.values, known.identification.values, atol=1e-8)
    np.testing.assert_allclose(own.identification.std, known.identification.std, rtol=1e-3)
    assert own.validated and known.validated
    assert own.after.mean == pytest.approx(known.after.mean, rel=1e-4)
    assert own.to_dict()["estimator"] == "gauss-newton" and known.to_dict()["estimator"] == LEAST_SQUARES
    assert own.verdict.word == known.verdict.word and own.validation.judged_by == "cross-validation"
    assert sorted(len(each.points) for each in estimator.problems) == [24] * 5 + [30]


def test_the_problem_holds_derivatives_whitened_residuals_and_the_prior() -> None:
    own = GaussNewton()
    identified(own, noise_mm=0.01)
    problem = own.problems[0]
    values = problem.start + 1e-4 * np.random.default_rng(0).standard_normal(len(problem.names))
    residuals, jacobian = problem.linearized(values)
    step = 1e-6
    for i in range(len(values)):
        moved = step * (np.arange(len(values)) == i)
        slope = (problem.residuals(values - moved) - problem.residuals(values + moved)) / (2 * step)
        np.testing.assert_allclose(jacobian[:, i], slope, rtol=1e-4, atol=1e-2)
    np.testing.assert_allclose(residuals, ((problem.points - problem.predicted(values)) / 1e-5).ravel())
    np.testing.assert_allclose(
        np.concatenate([problem.linearized(values, slice(i, i + 1))[0] for i in range(30)]), residuals
    )
    np.testing.assert_array_equal(problem.residuals(values, np.array([4])), residuals[12:15])
    assert problem.sigma_m == pytest.approx(1e-5)
    links = np.array([name.startswith("link") for name in problem.names])
    assert (np.diag(problem.prior_information) > 0).tolist() == links.tolist()
    angles = np.array([name.endswith(("theta", "alpha", "beta")) for name in problem.names])
    widest = 1 / np.sqrt(np.diag(problem.prior_information))[links & angles].max()
    assert 0.5e-3 < widest < 1.5e-3 * 1.01  # conditional on the others, no wider than a tolerance
    assert not identified_problem(prior="off").prior_information.any()


def identified_problem(**options: Any) -> EstimationProblem:
    own = GaussNewton()
    identified(own, **options)
    return own.problems[0]


class Given(Estimator):
    """An estimator that returns what a test gives it."""

    name = "given"

    def __init__(self, make: Callable[[EstimationProblem], Any]) -> None:
        self.make = make

    def estimate(self, problem: EstimationProblem) -> Estimate:
        made: Estimate = self.make(problem)
        return made


BAD: dict[str, tuple[Callable[[EstimationProblem], Any], str]] = {
    "none": (lambda p: None, "returns NoneType; return values and their covariance"),
    "values alone": (lambda p: p.start, "returns ndarray; return values and their covariance"),
    "few values": (lambda p: (p.start[1:], np.eye(27)), r"returns values of shape \(26,\); return shape \(27,\)"),
    "few variances": (
        lambda p: (p.start, np.ones(27)),
        r"returns a covariance of shape \(27,\); return shape \(27, 27\)",
    ),
    "not finite": (lambda p: (p.start * np.nan, np.eye(27)), "returns values with nan at"),
    "infinite": (
        lambda p: (p.start, np.full((27, 27), np.inf)),
        "returns a covariance with inf at",
    ),
    "negative": (lambda p: (p.start, -np.eye(27)), "returns a covariance that is not positive definite"),
    "indefinite": (
        lambda p: (p.start, 2 * np.ones((27, 27)) - np.eye(27)),
        "returns a covariance that is not positive definite",
    ),
    "texts": (lambda p: ("ab", "cd"), r"returns str; return values of shape \(27,\)"),
    "raises": (lambda p: 1 / 0, "raises ZeroDivisionError: division by zero; repair it"),
}


@pytest.mark.parametrize("case", BAD)
def test_an_impossible_estimate_is_refused_in_one_line(case: str) -> None:
    make, said = BAD[case]
    with pytest.raises(LabError, match=f"estimator 'given': estimate {said}") as error:
        identified(Given(make), instrument="uniform-8um")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("given", [3, Estimator, type("Nameless", (GaussNewton,), {"name": ""})()])
def test_what_is_no_estimator_is_refused(given: object) -> None:
    with pytest.raises(LabError, match=r"give (a name, or a|an object of a subclass of) lab\.Estimator"):
        identified(given)


def test_an_estimator_has_a_name_of_its_own() -> None:
    twin = type("Twin", (GaussNewton,), {"name": LEAST_SQUARES})
    with pytest.raises(LabError, match="estimator 'least-squares': the lab has one of that name; give yours another"):
        identified(twin())
    assert identified(GaussNewton).options.fitting.estimator == "gauss-newton"  # a class is as good as an object


def test_two_estimators_at_once_are_refused() -> None:
    with pytest.raises(LabError, match=r"estimator gauss-newton: (--)?model residual estimates the parameters, too"):
        identified(GaussNewton(), model="residual")
    with pytest.raises(LabError, match=r"estimator gauss-newton: (--)?method sequential estimates the parameters, too"):
        lab.calibrate("irb120", poses=20, observe="pose", method="sequential", estimator=GaussNewton())
