"""Phrases of checks, and that nothing is decided by them: with every phrase replaced, all else stays as it is."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import pytest
from helpers.drawing import nothing_drawn
from helpers.mistakes import MISTAKES, session_with_noise

import lab
from lab.calibration.noise.rigid_distances import InstrumentNoise
from lab.calibration.verdict import Answer
from lab.commands.result import Result
from lab.core.checks import Check
from lab.core.measurements import Measurements
from lab.noise.error_model import ErrorModel
from lab.render.phrases.registry import PHRASES
from lab.render.phrases.verdict import next_step
from lab.render.phrases.verify import next_step as after_verification
from lab.render.phrases.verify import parameter_text

SENTENCES = {
    "words",
    "reason",
    "reasons",
    "warnings",
    "adequacy",
    "why_not",
    "rule_words",
    "source",
    "seconds",
    "run",
    "run_sha256",
}


def without_sentences(value: Any) -> Any:
    """All of a result but its sentences, and what another run or folder changes."""
    if isinstance(value, Mapping):
        return {key: without_sentences(each) for key, each in value.items() if key not in SENTENCES}
    return [without_sentences(each) for each in value] if isinstance(value, list | tuple) else value


def outcomes(made: Iterable[Result]) -> list[str]:
    """Exit code and JSON of commands, without sentences."""
    return [json.dumps([each.exit_code, without_sentences(each.to_dict())], sort_keys=True) for each in made]


@cache
def session(mistake: str = "", size_m: float = 1e-3, seed: int = 1, poses: int = 25) -> Measurements:
    data, rng = session_with_noise(seed, poses)
    return MISTAKES[mistake](data, rng, size_m) if mistake else data


def identified(data: Measurements, **options: Any) -> lab.CalibrationResult:
    return lab.identify(data, robot="irb120", **{"holdout": 0.3, **options})


def of_measurements() -> Iterator[Result]:
    data = session()
    yield identified(data, noise_mm=0.2)
    yield identified(session("the tracker moved half way", 3e-3))
    yield identified(data, noise_mm=0.009, gate_mm=0.001)
    yield identified(replace(data, points=0 * data.points))


@pytest.fixture
def silent(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Replaces every phrase by "x"."""

    def silence() -> None:
        for name in PHRASES:
            monkeypatch.setitem(PHRASES, name, lambda _: "x")
        monkeypatch.setattr(InstrumentNoise, "description", property(lambda _: "x"))
        monkeypatch.setattr(ErrorModel, "descriptions", property(lambda _: ("x",)))

    return silence


@pytest.mark.parametrize("name", [*PHRASES, "another.reason"])
def test_every_reason_has_a_next_step(name: str) -> None:
    class Judged:
        word, reasons, fit = "bad", (Check(name, "failed"),), Answer("bad", ())

    step = next_step(Judged())
    assert step.endswith(".") and "lab compensate" not in step


def test_the_next_step_is_the_cheapest_that_helps() -> None:
    class Judged:
        word, fit = "bad", Answer("holds", ())

        def __init__(self, *names: str) -> None:
            self.reasons = tuple(Check(name, "failed") for name in names)

    assert "--model auto" in next_step(Judged("finding.change", "finding.missing"))
    assert "--robust" in next_step(Judged("finding.change"), with_outliers=True)
    assert "--robust" not in next_step(Judged("arm.spread"), with_outliers=True)
    assert "lab next" in next_step(Judged("accuracy.gate"))


def test_a_good_arm_is_used_next() -> None:
    class Judged:
        word, reasons = "good", ()

    assert "lab compensate" in next_step(Judged())
    assert "lab compensate" not in next_step(Judged(), in_instrument_frame=False)


@pytest.mark.parametrize("name", [each for each in PHRASES if each.startswith(("changed.", "situation."))])
def test_every_change_and_every_cause_has_a_next_step_after_a_verification(name: str) -> None:
    anew = name.startswith(("situation.setup", "situation.tool"))
    data = {"of": ("3", "q3"), "left_m": 1e-4, "factor": 2.0} | ({"refit": ("base", "tool")} if anew else {})
    one = Check(name, "failed", data=data)
    whole = {"cause": None, "alike": (), "likeliest": None}
    whole |= {"cause": one} if name.startswith("situation.") else {"alike": (one,)}
    step = after_verification(Check("verification", "failed", data=whole), "bad")
    assert step.endswith(".") and "{" not in step and "Go on" not in step
    assert ("joint 3" in step) is (name == "changed.joint") and ("--refit base,tool" in step) is anew


def test_after_a_verification_what_is_not_known_is_measured_or_calibrated_anew() -> None:
    joint, base = (Check(f"changed.{name}", "passed", data={"of": ("2", "q2")}) for name in ("joint", "base"))
    whole = {"cause": None, "alike": (joint, base), "likeliest": None}
    assert "Measure more poses" in after_verification(Check("verification", "failed", data=whole), "bad")
    several = Check("verification", "failed", data=whole | {"alike": ()})
    assert after_verification(several, "bad").startswith("Calibrate anew")
    good = Check("verification", "passed", data=whole)
    assert after_verification(good, "good") != after_verification(good, "doubtful")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("link3.theta", "zero of joint 3 (link3.theta)"),
        ("link12.a", "length of link 12 (link12.a)"),
        ("base.x", "base.x"),
        ("zero of joint 2", "zero of joint 2"),
        ("joint2.compliance", "joint2.compliance"),
    ],
)
def test_parameters_are_named_in_words_where_these_are_right(name: str, words: str) -> None:
    assert parameter_text(name) == words


@pytest.mark.thorough
def test_no_decision_of_a_fit_depends_on_a_phrase(silent: Callable[[], None]) -> None:
    with nothing_drawn():
        said = outcomes(of_measurements())
        silent()
        assert outcomes(of_measurements()) == said
        assert identified(session(), noise_mm=0.2).to_dict()["reasons"] == ["x"]
