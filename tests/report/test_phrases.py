"""Phrases of checks: each check of a fit has one, and each that fails has a next step."""

import ast

import pytest
from helpers.robots import ROOT

from lab.core.checks import Check
from lab.phrases.phrase import PHRASES
from lab.phrases.verdict_phrases import next_step
from lab.phrases.verification_phrases import next_step as after_verification
from lab.verdict.verdict import Answer

MAKERS = {"Check", "_noted", "_failed"}


def names_of_checks() -> set[str]:
    """The names that the modules of ``calibration`` give to checks, read from their sources."""
    calls = (
        node
        for path in (ROOT / "lab" / "calibration").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in MAKERS and node.args
    )
    return {node.args[0].value for node in calls if isinstance(node.args[0], ast.Constant)}


def test_every_check_has_a_phrase() -> None:
    assert names_of_checks() - set(PHRASES) == set()


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
