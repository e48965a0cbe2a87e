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


def word_of(mistake: str, seed: int, size_m: float, **options: object) -> str:
    data, rng = session_with_noise(seed)
    return identified(MISTAKES[mistake](data, rng, size_m), **options).verdict.word


def identified(data, **options: object) -> lab.CalibrationResult:
    return lab.identify(data, robot="irb120", holdout=0.3, **options)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("mistake", list(MISTAKES)[::3])
def test_no_mistake_is_good(mistake: str) -> None:
    seed = list(MISTAKES).index(mistake)
    assert word_of(mistake, seed, 0.1e-3, **list(STATED.values())[seed % len(STATED)]) != "good"


@pytest.mark.thorough
def test_errors_correlated_in_time_are_not_covered_by_a_large_stated_noise() -> None:
    """A stated noise is white: errors of poses in a row that are alike spoil a prediction, however small they are."""
    assert word_of("correlated in time", 4, 0.1e-3, noise_mm=0.05) == "doubtful"


def test_a_session_without_mistakes_is_good() -> None:
    found = identified(session_with_noise(0)[0])
    assert found.verdict.word == "good" and not found.state.findings
    check = found.to_dict()["prediction_at_validation"]
    assert check["observed_95_mm"] < check["allowed_95_mm"] and not check["exceeded"]


@pytest.mark.thorough
def test_the_first_sentence_names_the_poses_and_the_size() -> None:
    data, rng = session_with_noise(1)
    found = identified(MISTAKES["the tracker moved half way"](data, rng, 3e-3))
    (step, *_) = found.to_dict()["noise_findings"]
    assert step["kind"] == "step" and step["size_mm"] == pytest.approx(3.0, rel=0.1) and len(step["between"]) == 2


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
        if word_of(mistake, seed, size, **STATED[stated]) == "good"
    ]
    assert len(good) <= 4, good  # of 1,026: the upper 95 % limit is 1 %
