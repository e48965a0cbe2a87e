"""What estimated variances cost a verification: against closed forms, and where errors are correlated in time."""

from typing import cast

import numpy as np
import pytest
from noise_models import CASES, ErrorShapes, _moved, _weighed, errors, linear_arm
from scipy import stats

import lab
from lab.calibration.gauss_newton import Observations
from lab.core.random import rng_for
from lab.core.significance import VERIFICATION
from lab.kinematics.effects.arm_with_effects import Arm
from lab.noise.error_term import Components
from lab.noise.variance_components import ComponentErrors
from lab.verification.predicted_points import STEP, CalibrationPrediction, with_estimated_noise

CASE = CASES["AR(1) 0.9, 1 target, 40 poses"]
ARM = linear_arm(CASE, 0, 12)
"""Twelve poses of an arm that is linear in its parameters."""


def judged(parts: Components, scale: float, known: ComponentErrors) -> tuple[float, int]:
    """The factor of the test and its degrees of freedom, where so much is known of the variances."""
    rows = np.arange(12)
    shift = np.tile(np.eye(3), (12, 1, 1)) / 8e-6
    shapes = ErrorShapes(ARM.scatter / 8e-6, shift, np.ones(12), rows.astype(float))
    made = errors(CASE, ARM, rows, rng_for(0, "noise"))
    covariance = 1e-11 * np.eye(ARM.parameters)
    prediction = CalibrationPrediction(
        cast(Arm, ARM), np.zeros(len(covariance)), tuple(range(len(covariance))), covariance, 93
    )

    def by(parts: Components, scale: float) -> Observations:
        return _weighed(CASE, rows, made, parts, scale, shapes)

    moved = [(by(*_moved(parts, scale, name, STEP)), by(*_moved(parts, scale, name, -STEP))) for name in known.names]
    found, observed = with_estimated_noise(prediction, by(parts, scale), known, moved)
    factor = (observed.whiten / by(parts, scale).whiten).ravel()[0] ** 2
    np.testing.assert_allclose(np.diag(found.covariance) * factor, 1e-11)
    assert found.dof is not None
    return float(factor), found.dof


def whole(names: tuple[str, ...], variances: list[float], slope: float) -> ComponentErrors:
    return ComponentErrors(names, np.diag(variances), np.full((len(names), ARM.parameters), slope))


@pytest.mark.parametrize("dof", [20, 93])
def test_one_variance_that_everything_scales_with_gives_the_usual_F(dof: int) -> None:
    factor, found = judged(Components(), 1.3, whole(("scale",), [2 / dof], 0.5))
    assert found == pytest.approx(dof, abs=1) and factor == pytest.approx(1.0, abs=5e-3)


def test_the_level_is_that_of_draws_of_the_variances() -> None:
    """Squares with two estimated variances, by what they are made of: draws of estimates around the truth."""
    parts, names, sizes = Components({"shift": 4 * 8e-6**2}, 0.8), ("scale", "shift"), [0.05, 0.1]
    factor, dof = judged(parts, 1.0, whole(names, sizes, 0.0))
    rng = np.random.default_rng(0)
    kernel = np.kron(0.8 ** np.abs(np.subtract.outer(np.arange(12), np.arange(12))), np.eye(3))
    known = ARM.slopes.reshape(36, -1) / 8e-6
    known = 1e-11 * known @ known.T
    true, count = np.eye(36) + 4 * kernel + known, 4000
    drawn = np.linalg.cholesky(true) @ rng.standard_normal((36, count))
    spread = np.array(sizes)[:, None]
    logs = np.sqrt(spread) * rng.standard_normal((2, count)) - spread / 2  # estimates without bias
    squares = np.empty(count)
    for i, (scale, shift) in enumerate(np.exp(logs).T):
        squares[i] = drawn[:, i] @ np.linalg.solve(scale * np.eye(36) + 4 * shift * kernel + known, drawn[:, i])
    tested = stats.f.sf(factor * squares / 36, 36, dof)
    without = stats.chi2.sf(squares, 36)
    assert np.mean(tested < 0.05) == pytest.approx(0.05, abs=0.012)
    assert np.mean(without < 0.05) > 0.08


def test_what_is_known_after_all_costs_nothing() -> None:
    known = whole(("scale", "carry"), [0.1, 0.2], 0.3)
    left = known.without("scale")
    assert left.names == ("carry",) and left.covariance.tolist() == [[0.2]] and left.slopes.shape[0] == 1
    assert known.of([2, 0]).slopes.shape == (2, 2)
    assert judged(Components(), 1.0, left.without("carry")) == (1.0, 1_000_000)


@pytest.mark.thorough
def test_a_run_with_errors_that_wander_says_less_of_its_noise_than_it_has_numbers() -> None:
    day = lab.simulate("irb120", poses=48, seed=3, effects=lab.Effects(noise_correlation=0.9))
    old, new = day.measurements[:40], day.measurements[np.arange(40, 48)]
    run = lab.identify(old, robot="irb120", validate=day.validation)
    model = run.to_dict()["noise_model"]
    assert model["wandering_mm"] > 0 and set(model["component_errors"]["names"]) >= {"shift", "carry"}
    found = lab.verify(run, new, force=True).to_dict()
    assert found["good"] and found["sigma_freedom"] != run.to_dict()["freedom"]
    told = lab.verify(run, new, force=True, noise_mm=0.008).to_dict()
    assert told["p"] > VERIFICATION and told["sigma_freedom"] != found["sigma_freedom"]
