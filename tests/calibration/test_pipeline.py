"""How a file is fitted as a whole: repeats, robust fits, selection and hold-outs together."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120, somewhere

import lab
from lab.calibration.checks import check_outlier_search
from lab.calibration.fitted import Fitted, Judging
from lab.calibration.fitter import FitOptions, Fitter
from lab.calibration.gauss_newton import Observations
from lab.calibration.identify import Identification, IdentifyOptions, identify
from lab.calibration.pipeline import FITTING, STEPS, PipelineOptions, identify_robot, run_steps, start
from lab.calibration.statistics.candidate_models import FullModel
from lab.calibration.statistics.goodness_of_fit import adequacy_of, with_intervals_of_poses
from lab.calibration.statistics.linearized import NoiseDistribution
from lab.calibration.weights import Noise
from lab.campaign.option_groups import Fitting
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.kinematics.effects.effect import SessionInfo
from lab.kinematics.gauge import base_set
from lab.kinematics.model import Model
from lab.noise.error_model import ErrorModel
from lab.render.phrases.registry import phrases
from lab.sensors.points import PointSensor

SIGMA = 5e-6
POINTS = PipelineOptions(PointSensor())
NAMES = IRB120.chain.joint_names


def simulated(groups, sizes, joints, conditions, seed: int, sessions=None) -> Measurements:
    """A virtual arm by its equations: geometry off by 0.5 mm and mrad, effects of the given sizes by name."""
    rng = np.random.default_rng(seed)
    course = SessionInfo(tuple(dict.fromkeys(sessions or ())))
    arm = IRB120.arm_with(("p1",), groups, course)
    rigid = arm.rigid
    values = arm.nominal(IRB120.tool)
    values[: len(rigid.names)] = somewhere(rigid, rng)
    kept = list(base_set(rigid, values[: len(rigid.names)]).identifiable)
    values[kept] += 5e-4 * rng.normal(size=len(kept))
    for i in range(len(rigid.names), len(arm.names)):
        values[i] = sizes.get(arm.names[i], sizes.get(arm.names[i].rpartition(".")[2], 0.0))
    data = measured(NAMES, joints, ("p1",), np.zeros((len(joints), 1, 3)))
    data = replace(data, conditions=conditions, sessions=tuple(sessions or data.sessions))
    points = arm.points(data.inputs(arm.conditions), values) + SIGMA * rng.normal(size=(len(joints), 1, 3))
    return replace(data, points=points)


def fitter(data: Measurements, noise: Noise | None = None, **options) -> Fitter:
    return Fitter(IRB120, ("p1",), data, PointSensor(), noise or Noise(), Fitting(**options).of_fit, 0)


def fitted(data: Measurements, noise: Noise | None = None, held: Measurements | None = None, **options) -> Fitted:
    return run_steps(Fitted(fitter(data, noise, **options), data, held), FITTING)


def told(fit: Fitted) -> tuple[str, ...]:
    return phrases(fit.checks)


def random_joints(count: int, seed: int) -> np.ndarray:
    return IRB120.chain.random_joints(count, np.random.default_rng(seed))


@pytest.mark.thorough
def test_repeats_from_the_other_side_or_session_are_no_repeats() -> None:
    """Twice the same joints, approached from both sides or before and after a bump, are not the noise of one pose."""
    joints = np.repeat(random_joints(40, 0), 2, axis=0)
    sides = np.tile([1.0, -1.0], 40)
    approach = {f"approach_{name}": sides for name in NAMES}
    data = simulated(("backlash",), {"backlash": 2e-4}, joints, approach, 1)
    assert fitted(data).adequacy.outcome != "passed"
    plain = replace(data, conditions={})  # who does not say from which side cannot be helped
    assert fitted(plain).adequacy.name == "lack_of_fit.repeats"
    bumped = simulated(("sessions",), {"x": 5e-4}, joints, {}, 1, sessions=["1", "2"] * 40)
    assert fitted(bumped).adequacy.outcome != "passed"
    honest = simulated((), {}, joints, {}, 1)
    tested = fitted(honest).adequacy
    assert tested.name == "lack_of_fit.repeats" and tested.outcome == "passed"


@pytest.mark.thorough
@pytest.mark.parametrize("prior", [False, True])
def test_what_is_named_is_what_is_left_out(prior: bool) -> None:
    """A prior weighs by a sigma that outliers inflate: they are found again with the clean one."""
    for seed in range(3):
        data = simulated((), {}, random_joints(50, seed), {}, seed)
        points = data.points.copy()
        points[[3, 20, 41], 0, 0] += np.array([50e-3, 5e-3, 0.3e-3])
        spoilt = replace(data, points=points)
        fit = fitted(spoilt, robust=True, prior=prior)
        named = {pose.id for pose in fit.outliers}
        assert {"3", "20", "41"} <= named and set(fit.rows.ids) == set(spoilt.ids) - named
        assert fit.identification.sigma_m < 1.5 * SIGMA


@pytest.mark.thorough
def test_a_few_poses_that_alone_show_an_effect_are_no_outliers() -> None:
    """5 of 60 poses from the other side: without backlash they look bad, with it they are not."""
    joints = random_joints(60, 3)
    sides = np.where(np.arange(60) % 12 == 5, -1.0, 1.0)
    data = simulated(("backlash",), {"backlash": 4e-4}, joints, {f"approach_{name}": sides for name in NAMES}, 3)
    fit = fitted(data, Noise(sigma_m=SIGMA), model="auto", robust=True)
    assert "backlash" in fit.groups and not fit.outliers and len(fit.rows) == 60


@pytest.mark.thorough
def test_of_very_many_poses_some_choose_the_groups_and_all_are_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("fitter", "pipeline"):
        monkeypatch.setattr(f"lab.calibration.{module}.MOST_CHOSEN_BY", 60)
    data = simulated(("harmonics",), {"sin1": 2e-4}, random_joints(120, 3), {}, 3)
    fit = fitted(data, Noise(sigma_m=SIGMA), model="auto")
    assert fit.groups == ("harmonics",) and len(fit.rows) == len(data)
    (thinned,) = (each for each in fit.checks if each.name == "selection.thinned")
    assert thinned.data == {"used": 60, "count": 120}
    assert "groups were selected with 60 of the 120 poses, evenly spaced" in told(fit)
    sigmas = np.sqrt(np.diag(fit.identification.covariance))
    alone = fitted(data.take(list(range(60))), Noise(sigma_m=SIGMA), model="harmonics")
    assert np.median(sigmas / np.sqrt(np.diag(alone.identification.covariance))) < 0.8  # twice as many poses say more


def test_held_out_poses_that_are_off_are_named() -> None:
    data = simulated((), {}, random_joints(80, 4), {}, 4)
    points = data.points.copy()
    points[70, 0, 1] += 2e-3
    spoilt = replace(data, points=points)
    rows, held = spoilt.take(list(range(60))), spoilt.take(list(range(60, 80)))
    for robust in (False, True):
        fit = run_steps(Fitted(fitter(spoilt, robust=robust), rows, held), FITTING)
        assert [(pose.id, pose.held_out) for pose in fit.outliers] == [("70", True)]
        assert fit.outliers[0].size_m == pytest.approx(2e-3, rel=0.05)
        assert any("the validation error includes it" in warning for warning in told(fit))  # robust or not
    assert fit.adequacy.name == "lack_of_fit.holdout" and fit.adequacy.p > 0.001


def test_a_clock_that_started_long_ago_does_not_matter() -> None:
    joints, time_s = random_joints(60, 5), np.linspace(0, 3600, 60)
    found = []
    for begun in (0.0, 1.7e9):
        data = simulated(("drift",), {"drift.x": 1e-3, "drift.rz": 2e-4}, joints, {"time_s": time_s}, 5)
        late = replace(data, conditions={"time_s": time_s + begun})
        fit = fitted(late, Noise(sigma_m=SIGMA), model="drift")
        assert fit.identification.status == "converged" and fit.identification.fit.condition < 100
        found.append(fit.identification.values)
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-8)  # 1.7e9 s hold 0.2 µs


@pytest.mark.thorough
def test_a_wish_is_of_whichever_model_has_it() -> None:
    data = simulated(("harmonics",), {"sin1": 2e-4}, random_joints(60, 6), {}, 6)
    fit = fitted(data, Noise(sigma_m=SIGMA), model="auto", fix=("joint6.sin1", "link4.d"))
    free = [fit.identification.model.names[i] for i in fit.identification.fit.free]
    assert "joint6.sin1" not in free and "link4.d" not in free
    assert fit.groups[0] == "harmonics"  # what follows stands in for link4.d, which is held where it is not


def test_a_prior_that_holds_back_is_told() -> None:
    data = simulated((), {}, random_joints(40, 7), {}, 7)
    joints = data.joints.copy()
    joints[:, 3] += np.deg2rad(2.0)  # an offset of 23 tolerances
    late = replace(data, joints=joints)
    said = told(fitted(late, prior=True))
    assert any("link4.theta is 2" in warning and "tolerances from its nominal value" in warning for warning in said)
    assert not any("tolerances from its nominal value" in w for w in told(fitted(data, prior=True)))


def test_a_search_for_outliers_that_does_not_converge_is_told() -> None:
    data = simulated((), {}, random_joints(40, 3), {}, 4)
    made = fitter(data)
    found = made.identified(data, ())[0]
    outliers = made.outliers_of(found, data)
    assert check_outlier_search(outliers) == []
    stuck = check_outlier_search(replace(outliers, fit=replace(outliers.fit, status="not converged")))
    assert "without outliers did not converge" in phrases(stuck)[0]


@pytest.mark.thorough
def test_what_stays_fixed_of_a_doubted_group_is_no_wish_of_the_model_without_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A drift of which these poses show a part is put aside to see whether errors wander without it."""
    data = simulated(("drift",), {"drift.x": 2e-4}, random_joints(60, 3), {"time_s": 60.0 * np.arange(60)}, 3)
    shown = FullModel.added

    def added(large: FullModel, *of: object) -> tuple[tuple[int, ...], tuple[int, ...]]:
        new, fitted = shown(large, *of)
        hidden = [i for i, name in enumerate(large.observation.model.names) if name == "drift.y"]
        return new, tuple(i for i in fitted if i not in hidden)

    monkeypatch.setattr(FullModel, "added", added)
    fit = fitted(data, Noise(sigma_m=SIGMA), model="auto")
    assert fit.groups == ("drift",) and fit.unshown == ("drift.y",)


@pytest.mark.thorough
def test_where_groups_were_searched_nobody_is_told_to_search_them() -> None:
    """Waves of the residuals that no group has are alike at neighbouring poses, whatever was asked for."""
    joints = random_joints(80, 4)
    data = replace(simulated((), {}, joints + 1e-4 * np.sin(2 * joints[:, ::-1]), {}, 4), joints=joints)
    for model in ("geometric", "gear", "auto"):
        fit = fitted(data, model=model)
        assert fit.remaining is not None and fit.remaining.searched == (model == "auto")
        searched, seen = model == "auto", Observations.unweighted(data)
        cause = phrases(with_intervals_of_poses(fit.identification, seen, searched=searched)[1])
        assert all(("--model auto" in words) != searched for words in (*cause, *told(fit)) if "auto" in words)


def test_where_all_poses_held_out_are_off_none_is_left_to_test_by() -> None:
    """Errors that the repeats of a pose share make no difference to that."""
    joints = np.repeat(random_joints(20, 2), 2, axis=0)
    data = simulated((), {}, joints, {}, 2)
    shared = ErrorModel(SIGMA, 1.0, {"scatter": 1e-5}, None, {})
    for noise in (Noise(), Noise(shared=shared), Noise(sigma_m=SIGMA, shared=shared)):
        found = fitter(data, noise).identified_with(data, (), ())
        judged = [adequacy_of(found, data, held, noise, NoiseDistribution()) for held in (None, data.take([]))]
        assert str(judged[0]) == str(judged[1])


def huber(
    model: Model, rows: Measurements, nominal: np.ndarray, noise: Noise, request: IdentifyOptions
) -> Identification:
    """An estimator of a caller's own: iteratively reweighted least squares with Huber's weights."""
    found = identify(model, rows, nominal, noise, request)
    for _ in range(10):
        sizes = np.linalg.norm(found.residuals[:, 0], axis=1)
        scale = np.median(sizes) / 1.54  # of the norm of three normal numbers
        sigma_m = scale * np.sqrt(np.maximum(sizes / (1.345 * scale), 1.0))
        found = identify(model, replace(rows, sigma_m=sigma_m), nominal, Noise(), request)
    return found


def spoilt_and_clean() -> tuple[Measurements, Measurements]:
    clean = simulated((), {}, random_joints(60, 8), {}, 8)
    points = clean.points.copy()
    points[::10, 0, 0] += 2e-3
    return replace(clean, points=points), clean


def off(fit: Fitted, other: Fitted) -> float:
    """How far two fits predict the fitted points apart, RMS (m)."""
    inputs = other.rows.joints
    mine, others = (each.identification.model.points(inputs, each.identification.values) for each in (fit, other))
    return float(np.sqrt(((mine - others) ** 2).sum(axis=2).mean()))


class Huber(lab.Estimator):
    """The same estimator as the seam takes it: weights of whole poses by the lengths of their whitened residuals."""

    name = "huber"

    def estimate(self, problem: lab.EstimationProblem) -> tuple[np.ndarray, np.ndarray]:
        values, weights = problem.start, np.ones(len(problem.points))
        for _ in range(20):
            residuals, jacobian = problem.linearized(values)
            roots = np.repeat(np.sqrt(weights), 3)
            values = values + np.linalg.lstsq(roots[:, None] * jacobian, roots * residuals)[0]
            sizes = np.linalg.norm(problem.residuals(values).reshape(-1, 3), axis=1)
            scale = np.median(sizes) / 1.54
            weights = 1 / np.maximum(sizes / (1.345 * scale), 1.0)
        weighted = np.repeat(weights, 3)[:, None] * jacobian
        return values, scale**2 * np.linalg.inv(jacobian.T @ weighted)


@pytest.mark.thorough
def test_an_estimator_of_a_callers_own_takes_the_place_of_least_squares() -> None:
    """As an option it fits every model and every fold; as a step it fits the chosen model alone."""
    spoilt, clean = spoilt_and_clean()
    truth, plain = identify_robot(IRB120, clean, POINTS), identify_robot(IRB120, spoilt, POINTS)
    everywhere = identify_robot(IRB120, spoilt, PipelineOptions(PointSensor(), FitOptions(estimator=Huber())))

    def fit_robustly(state: Fitted) -> Fitted:
        fitter, (model, request) = state.fitter, state.fitter.modelled(state.groups, state.unshown)
        found = huber(model, state.given, fitter.nominal(model), fitter.noise, request)
        return state.with_fit(found, state.given)

    once = identify_robot(IRB120, spoilt, POINTS, steps={**STEPS, "fit": fit_robustly})
    assert off(plain, truth) > 100e-6
    for robust in (everywhere, once):
        assert off(robust, truth) < 20e-6
        assert {"0", "10", "20", "30", "40", "50"} <= {pose.id for pose in robust.outliers}
        assert robust.verdict.word in ("good", "doubtful", "bad") and robust.validation.errors is not None
    assert np.nanmedian(everywhere.validation.errors.after) < 0.2 * np.nanmedian(once.validation.errors.after)


def test_a_step_is_left_out() -> None:
    """Without the search for outliers nothing of them is told, and the same parameters are found."""
    spoilt, _ = spoilt_and_clean()
    whole = identify_robot(IRB120, spoilt, POINTS)
    less = identify_robot(
        IRB120, spoilt, POINTS, steps={k: v for k, v in STEPS.items() if k not in ("find outliers", "validate")}
    )
    assert whole.outliers and not less.outliers and np.isinf(less.tail_dof)
    assert "outliers.kept" in {each.name for each in whole.checks} - {each.name for each in less.checks}
    np.testing.assert_array_equal(less.identification.values, whole.identification.values)
    assert less.validation.errors is None and less.verdict.word == "not judged" and less.bounds is None
    assert whole.validation.judged_by == "cross-validation" and whole.bounds is not None


def test_the_state_is_looked_at_after_a_step() -> None:
    data = simulated((), {}, random_joints(40, 9), {}, 9)
    first = start(IRB120, data, PipelineOptions(PointSensor(), judging=Judging(holdout=0.25)))
    assert first.held_out is None and len(first.given) == 40 and not first.checks
    names = list(STEPS)
    held = run_steps(first, {name: STEPS[name] for name in names[: names.index("fit")]})
    assert len(held.given) == 30 and held.held_out is not None and len(held.held_out) == 10
    with pytest.raises(LabError, match="the pipeline has no fit yet: run the step 'fit' before this one"):
        STEPS["choose intervals"](held)
    fit = STEPS["fit"](held)
    assert fit.weighted is fit.identification and fit.identification.status == "converged"
    assert first.held_out is None  # a step changes no state, it makes a new one
    judged = run_steps(fit, {name: STEPS[name] for name in names[names.index("fit") + 1 :]})
    assert judged.validation.judged_by == "holdout" and judged.verdict.word in ("good", "doubtful")
    whole = identify_robot(IRB120, data, PipelineOptions(PointSensor(), judging=Judging(holdout=0.25)))
    np.testing.assert_array_equal(judged.identification.covariance, whole.identification.covariance)
    assert phrases(judged.checks) == phrases(whole.checks)
