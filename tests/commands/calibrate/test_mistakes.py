"""Mistakes of a measurement session are not called noise: the verdict is not good, and says what happened."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from helpers.mistakes import MISTAKES, session_with_noise, stopped_elsewhere

import lab
from lab.phrases.phrase import phrases

STATED = {"": {}, "stated": {"noise_mm": 0.009}, "stated too large": {"noise_mm": 0.05}}
SIZES_M = (0.1e-3, 0.3e-3, 1e-3)  # the standard error of a step is 4 µm, that of a turn 15 µm at a metre


STEPS = {  # fitted, where they are found
    "the tracker moved half way": ("base_step",),
    "the tracker moved at any pose": ("base_step",),
    "three blocks": ("base_step", "base_step"),
    "the tracker turned": ("base_step",),
    "a zero shifted": ("joint_step",),
    "the reflector was reseated": ("tool_step",),
}


def is_seen(mistake: str, seed: int, size_m: float, **options: object) -> bool:
    """Whether it spoils the verdict, or is in the fit as what it is."""
    data, rng = session_with_noise(seed)
    found = identified(MISTAKES[mistake](data, rng, size_m), **options)
    fitted = tuple(each.name for each in found.diagnosis if each.accepted)
    return found.verdict.word != "good" or fitted == STEPS.get(mistake)


def identified(data, **options: object) -> lab.CalibrationResult:
    return lab.identify(data, robot="irb120", holdout=0.3, **options)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("mistake", list(MISTAKES)[::3])
def test_no_mistake_is_good(mistake: str) -> None:
    seed = list(MISTAKES).index(mistake)
    assert is_seen(mistake, seed, 0.1e-3, **list(STATED.values())[seed % len(STATED)])


@pytest.mark.thorough
def test_errors_correlated_in_time_are_not_covered_by_a_large_stated_noise() -> None:
    """A stated noise is white: errors of poses in a row that are alike spoil a prediction, however small they are."""
    data, rng = session_with_noise(4)
    found = identified(MISTAKES["correlated in time"](data, rng, 0.1e-3), noise_mm=0.05)
    assert found.verdict.word == "doubtful"


def test_a_session_without_mistakes_is_good() -> None:
    found = identified(session_with_noise(0)[0])
    assert found.verdict.word == "good" and not found.state.findings
    check = found.to_dict()["prediction_at_validation"]
    assert check["observed_95_mm"] < check["allowed_95_mm"] and not check["exceeded"]


@pytest.mark.parametrize("held_out", ["", "rows about it", "all rows after it"])
def test_a_step_is_fitted_between_the_poses_where_it_happened_whichever_are_held_out(held_out: str) -> None:
    """Rows held out show where; where none of the others is after it, they are off, and not to be judged good."""
    data, rng = session_with_noise(1)
    moved = MISTAKES["the tracker moved half way"](data, rng, 1e-3)
    number = np.arange(len(moved))
    test = {"": number < 0, "rows about it": abs(number - 30) < 5, "all rows after it": number >= 30}[held_out]
    moved = replace(moved, use=tuple("test" if each else "calibrate" for each in test))
    found = lab.identify(moved, robot="irb120", noise_mm=0.009)
    (step,) = found.diagnosis
    assert step.name == "base_step" and step.hypothesis.of == (moved.ids[29], moved.ids[30])
    assert step.accepted == (held_out != "all rows after it") == (found.verdict.word == "good")
    size, std = (np.array(each)[:3] for each in (step.sizes, step.stds))
    assert np.linalg.norm(size) == pytest.approx(1e-3, abs=3 * np.linalg.norm(std))


@pytest.mark.parametrize(
    ("mistake", "what"), [("a zero shifted", "joint_step"), ("the reflector was reseated", "tool_step")]
)
def test_a_step_is_named_as_what_it_is(mistake: str, what: str) -> None:
    data, rng = session_with_noise(1)
    (found,) = lab.identify(MISTAKES[mistake](data, rng, 0.1e-3), robot="irb120").diagnosis
    assert found.name == what and found.accepted
    assert data.ids.index(found.hypothesis.of[-1]) == pytest.approx(30, abs=2)


def test_an_arm_that_grows_is_found_and_by_how_much() -> None:
    """About its base, by 60 ppm from the first pose to the last; a scale, which no row shows, is no growth."""
    data, _ = session_with_noise(0)
    away = data.points - identified(data).state.identification.values[:3]
    since = np.linspace(0, 1, len(data))[:, None, None]
    (found,) = lab.identify(replace(data, points=data.points + 60e-6 * since * away), robot="irb120").diagnosis
    assert found.name == "growth" and found.sizes[0] == pytest.approx(60e-6, abs=3 * found.stds[0])
    assert not lab.identify(replace(data, points=data.points + 60e-6 * away), robot="irb120").diagnosis


@pytest.mark.thorough
def test_a_drift_is_no_missing_effect() -> None:
    data, rng = session_with_noise(4)
    found = identified(MISTAKES["drift"](data, rng, 0.3e-3))
    assert found.verdict.word == "doubtful" and [each.name for each in found.diagnosis] == ["drift"]
    assert "finding.missing" not in [each.name for each in found.verdict.reasons]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("effect", "named"),
    [
        ({"ripple_mrad": 0.1}, "times a turn"),
        ({"stiffness_nm_per_rad": 3e4}, "compliance"),
    ],
)
def test_an_effect_that_is_called_noise_is_named(effect: dict[str, float], named: str) -> None:
    found = lab.calibrate("irb120", poses=60, seed=1, **effect)
    assert found.verdict.word == "doubtful" and named in phrases(found.verdict.reasons)[0]


@pytest.mark.thorough
def test_scatter_is_supported_by_repeated_poses_alone() -> None:
    """An arm stops 20 µm off from one visit to the next: in 60 poses, or in 20 that are each visited three times."""
    words = {}
    for visits in (1, 3):
        exact, rng = session_with_noise(2, 60 // visits, 0.0)
        rows = np.tile(np.arange(len(exact)), visits)
        data = replace(exact[rows], ids=tuple(str(i) for i in range(60)), lines=())
        data = stopped_elsewhere(data, 0.04e-3 * rng.normal(size=data.joints.shape))
        found = identified(replace(data, points=data.points + 9e-6 * rng.normal(size=data.points.shape)))
        words[visits] = found.verdict.word, [(each.name, each.outcome) for each in found.state.findings]
    assert words == {1: ("doubtful", [("finding.scatter", "failed")]), 3: ("good", [("finding.scatter", "noted")])}


def test_points_that_are_all_zero_are_bad_without_a_warning_of_arithmetic() -> None:
    data, _ = session_with_noise(5, 30)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = identified(replace(data, points=0 * data.points))
    assert found.verdict.word == "bad" and "the same in every pose" in phrases(found.verdict.reasons)[0]


@pytest.mark.slow
@pytest.mark.parametrize("stated", STATED)
def test_of_a_thousand_mistakes_none_is_good(stated: str) -> None:
    good = [
        (mistake, size, seed)
        for mistake in MISTAKES
        for size in SIZES_M
        for seed in range(38)
        if not is_seen(mistake, seed, size, **STATED[stated])
    ]
    assert len(good) <= 4, good  # of 1,026: the upper 95 % limit is 1 %
