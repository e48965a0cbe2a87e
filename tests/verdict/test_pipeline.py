"""How a file is fitted as a whole: repeats, robust fits, selection and hold-outs together."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.robots import IRB120, somewhere

import lab
from lab.calibration.fitter import Fitter
from lab.calibration.weights import Noise
from lab.core.checks import Check
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.kinematics.effects.effect import SessionInfo
from lab.kinematics.gauge import base_set
from lab.options.option_groups import Fitting
from lab.phrases.phrase import phrases
from lab.sensors.points import PointSensor
from lab.verdict.fitted import Fitted, JudgementOptions
from lab.verdict.pipeline import FITTING, STEPS, identify_robot, run_steps, start

SIGMA = 5e-6
POINTS = PointSensor()
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
    return Fitter(IRB120, ("p1",), data, PointSensor(), noise or Noise(), Fitting(**options).to_si(), 0)


def fitted(data: Measurements, noise: Noise | None = None, held: Measurements | None = None, **options) -> Fitted:
    return run_steps(Fitted(fitter(data, noise, **options), data, held), FITTING)


def random_joints(count: int, seed: int) -> np.ndarray:
    return IRB120.chain.random_joints(count, np.random.default_rng(seed))


@pytest.mark.thorough
def test_repeats_from_the_other_side_are_no_repeats() -> None:
    """Twice the same joints, approached from both sides, are not the noise of one pose."""
    joints = np.repeat(random_joints(40, 0), 2, axis=0)
    sides = np.tile([1.0, -1.0], 40)
    approach = {f"approach_{name}": sides for name in NAMES}
    data = simulated(("backlash",), {"backlash": 2e-4}, joints, approach, 1)
    assert fitted(data).adequacy.outcome != "passed"
    plain = replace(data, conditions={})  # who does not say from which side cannot be helped
    assert fitted(plain).adequacy.name == "lack_of_fit.repeats"
    honest = simulated((), {}, joints, {}, 1)
    tested = fitted(honest).adequacy
    assert tested.name == "lack_of_fit.repeats" and tested.outcome == "passed"


@pytest.mark.thorough
def test_what_is_named_is_what_is_left_out() -> None:
    """A prior weighs by a sigma that outliers inflate: they are found again with the clean one."""
    for seed in range(3):
        data = simulated((), {}, random_joints(50, seed), {}, seed)
        points = data.points.copy()
        points[[3, 20, 41], 0, 0] += np.array([50e-3, 5e-3, 0.3e-3])
        spoilt = replace(data, points=points)
        fit = fitted(spoilt, robust=True, prior=True)
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


def test_held_out_poses_that_are_off_are_named() -> None:
    data = simulated((), {}, random_joints(80, 4), {}, 4)
    points = data.points.copy()
    points[70, 0, 1] += 2e-3
    spoilt = replace(data, points=points)
    rows, held = spoilt[list(range(60))], spoilt[list(range(60, 80))]
    fit = run_steps(Fitted(fitter(spoilt, robust=True), rows, held), FITTING)
    assert [(pose.id, pose.held_out) for pose in fit.outliers] == [("70", True)]
    assert fit.outliers[0].size_m == pytest.approx(2e-3, rel=0.05)
    assert any(each.name == "outliers.held_out" for each in fit.checks)
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
def test_a_step_is_left_out() -> None:
    """Without the search for outliers nothing of them is told, and the same parameters are found."""
    clean = simulated((), {}, random_joints(40, 8), {}, 8)
    points = clean.points.copy()
    points[::10, 0, 0] += 2e-3
    spoilt = replace(clean, points=points)
    whole = identify_robot(IRB120, spoilt, POINTS)
    less = identify_robot(
        IRB120, spoilt, POINTS, steps={k: v for k, v in STEPS.items() if k not in ("find outliers", "validate")}
    )
    assert whole.outliers and not less.outliers and np.isinf(less.tail_dof)
    assert "outliers.kept" in {each.name for each in whole.checks} - {each.name for each in less.checks}
    np.testing.assert_array_equal(less.identification.values, whole.identification.values)
    assert less.validation.errors is None and less.verdict.word == "not judged" and less.bounds is None
    assert whole.validation.judged_by == "cross-validation" and whole.bounds is not None


@pytest.mark.thorough
def test_the_state_is_looked_at_after_a_step() -> None:
    data = simulated((), {}, random_joints(40, 9), {}, 9)
    first = start(IRB120, data, POINTS, judging=JudgementOptions(holdout=0.25))
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
    whole = identify_robot(IRB120, data, POINTS, judging=JudgementOptions(holdout=0.25))
    np.testing.assert_array_equal(judged.identification.covariance, whole.identification.covariance)
    assert phrases(judged.checks) == phrases(whole.checks)


def test_a_step_of_ones_own_takes_the_place_of_the_labs() -> None:
    """Twice the covariance in place of the chosen intervals: twice the standard deviations, the same parameters."""
    day = lab.simulate("irb120", poses=40, seed=7)

    def doubled(state: Fitted) -> Fitted:
        return replace(state, identification=replace(state.weighted, covariance=4 * state.weighted.covariance))

    whole = lab.identify(day.measurements, instrument="uniform-8um", steps={**STEPS, "choose intervals": lambda s: s})
    wider = lab.identify(day.measurements, instrument="uniform-8um", steps={**STEPS, "choose intervals": doubled})
    np.testing.assert_allclose(wider.identification.std, 2 * whole.identification.std, rtol=1e-12)
    np.testing.assert_array_equal(wider.identification.values, whole.identification.values)


def test_the_stages_are_the_names_of_the_steps() -> None:
    data, names = lab.simulate("irb120", poses=40, seed=7).measurements, list[str]()

    def half(state: Fitted) -> Fitted:
        state.progress(1, 2)
        return state

    def note(event: lab.Event) -> None:
        names.append(f"{event.stage} {event.fraction:g}" if event.stage == "half" else event.stage)

    lab.identify(data, steps={**STEPS, "half": half}, progress=note)
    assert list(dict.fromkeys(names)) == ["", "read the measurements", *STEPS, "half nan", "half 0.5"]


def _forgotten(state: Fitted) -> None:
    replace(state, checks=())


@pytest.mark.parametrize(
    ("steps", "says"),
    [
        ({**STEPS, "fit": _forgotten}, "step 'fit' returns NoneType; return the state"),
        ({**STEPS, "fit": lambda state: state}, "no fit yet: run the step 'fit' before this one"),
        ({**STEPS, "judge": lambda state: state}, "no verdict yet: run the step 'judge' before this one"),
        ({**STEPS, "fit": lambda state: state.nothing}, "step 'fit' raises AttributeError: 'Fitted' object has no"),
        ({**STEPS, "fit": None}, "step 'fit' is None; give a function"),
        ({name: step for name, step in STEPS.items() if name != "judge"}, "no verdict yet: run the step 'judge'"),
        ([*STEPS], "steps are a list; give a mapping"),
        ({}, "no fit yet: run the step 'fit'"),
    ],
)
@pytest.mark.parametrize("call", ["identify", "calibrate"])
def test_a_step_that_leaves_the_next_without_what_it_needs_is_named(steps: Any, says: str, call: str) -> None:
    data = lab.simulate("irb120", poses=30, seed=7).measurements
    with pytest.raises(LabError) as refused:
        lab.identify(data, steps=steps) if call == "identify" else lab.calibrate(poses=30, seed=7, steps=steps)
    assert says in str(refused.value) and "\n" not in str(refused.value)


def _without(*names: str) -> dict[str, Any]:
    return {name: step for name, step in STEPS.items() if name not in names}


@pytest.mark.parametrize(
    ("step", "options"),
    [
        ("select model", {"model": "compliance"}),
        ("select model", {"model": "auto"}),
        ("hold out", {"holdout": 0.3}),
        ("hold out", {"holdout_last": 0.3}),
        ("fit residual", {"model": "residual"}),
    ],
)
def test_an_option_without_the_step_that_reads_it_is_refused(step: str, options: dict[str, Any]) -> None:
    data = lab.simulate("irb120", poses=30, seed=7).measurements
    with pytest.raises(LabError, match=f"needs the step '{step}', which is left out"):
        lab.identify(data, steps=_without(step), **options)


def test_a_check_of_ones_own_is_shown_by_its_name_and_data() -> None:
    own = (Check("mine.odd", "noted", data={"size_m": 3.0}), Check("mine.even", "failed"))
    assert phrases(own) == ("mine.odd: size_m = 3.0", "mine.even: failed")


def test_lack_of_fit_that_no_step_tested_says_so() -> None:
    """The reason is the step that was left out, not a residual that the model does not have."""
    data = lab.simulate("irb120", poses=30, seed=7).measurements
    result = lab.identify(data, instrument="uniform-8um", steps=_without("check lack of fit", "validate"))
    (reason,) = (each for each in result.verdict.reasons if each.name == "lack_of_fit.nothing")
    assert reason.data["why"] == "left out" and "residual" not in phrases([reason])[0]
