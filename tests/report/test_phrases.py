"""Phrases of checks: each check of a fit has one, and each that fails has a next step."""

import ast
from dataclasses import replace

import pytest
from helpers.campaigns import session
from helpers.robots import ROOT

from lab.core.checks import Check
from lab.diagnosis.hypothesis import Finding, Hypothesis
from lab.diagnosis.reading_mistakes import joint_mistakes, point_mistakes
from lab.phrases.diagnosis_phrases import deciding_measurement
from lab.phrases.phrase import PHRASES, phrase
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

    assert "--model auto" in next_step(Judged("finding.drift", "finding.missing"))
    assert "--robust" in next_step(Judged("finding.drift"), with_outliers=True)
    assert "--robust" not in next_step(Judged("arm.convergence"), with_outliers=True)
    assert "lab next" in next_step(Judged("accuracy.gate"))


@pytest.mark.parametrize("name", [each for each in PHRASES if each.startswith(("changed.", "situation."))])
def test_every_change_and_every_cause_has_a_next_step_after_a_verification(name: str) -> None:
    anew = name.startswith(("situation.setup", "situation.tool"))
    data = {"of": ("q3",), "number": 3, "left_m": 1e-4} | ({"refit": ("base", "tool")} if anew else {})
    one = Check(name, "failed", data=data)
    whole = {"cause": None, "alike": ()}
    whole |= {"cause": one} if name.startswith("situation.") else {"alike": (one,)}
    step = after_verification(Check("verification", "failed", data=whole), "bad")
    assert step.endswith(".") and "{" not in step and "Go on" not in step
    assert ("joint 3" in step) is (name == "changed.joint_step") and ("--refit base,tool" in step) is anew


def test_after_a_verification_what_is_not_known_is_measured_or_calibrated_anew() -> None:
    joint, base = (
        Check(f"changed.{name}_step", "passed", data={"of": ("q2",), "number": 2}) for name in ("joint", "base")
    )
    whole = {"cause": None, "alike": (joint, base)}
    both = after_verification(Check("verification", "failed", data=whole), "bad")
    decides = deciding_measurement("base_step", ["joint_step"])
    assert "Measure more poses" in both and both.endswith(f"decided by {decides}.")
    several = Check("verification", "failed", data=whole | {"alike": ()})
    assert after_verification(several, "bad").startswith("Calibrate anew")
    good = Check("verification", "passed", data=whole)
    assert after_verification(good, "good") != after_verification(good, "doubtful")


OF_ROWS = {
    "targets_exchanged": (("p1", "p2", "3", "11"), (("rows", 9),)),
    "targets_exchanged_once": (("p1", "p2", "4", "7"), (("targets", 2),)),
    "rows_shifted": (("+1", "6", "11"), (("rows", 6),)),
    "joint_stuck": (("q4", "6", "9"), (("rows", 4),)),
    "rows_exchanged": (("3", "8"), ()),
    "other_robot": (("ur5e",), ()),
}
CONTINUOUS = {
    "base_step": (("24", "25"), ("m",) * 3 + ("rad",) * 3),
    "tool_step": (("24", "25"), ("m",) * 3),
    "target_step": (("p2", "24", "25"), ("m",) * 3),
    "joint_step": (("q2", "24", "25"), ("rad",)),
    "joint_gain": (("q3",), ("1",)),
    "joint_coupling": (("q3", "q2"), ("1",)),
    "joint_zero": (("q3",), ("rad",)),
    "link": (("link3.a",), ("m",)),
    "scale": ((), ("1",)),
    "shear": ((), ("1",) * 5),
    "drift": ((), ("m",) * 3),
    "growth": ((), ("1",)),
}


def hypotheses() -> dict[str, Hypothesis]:
    """One hypothesis of each kind that the rooms build, by its name, with its numbers where it has a size."""
    day = session("irb120", poses=12, seed=7, targets=("p1", "p2"))
    made = [*joint_mistakes(day.robot.chain, day.measurements), *point_mistakes()]
    made += [Hypothesis(name, of, corrected=lambda rows: rows, data=data) for name, (of, data) in OF_ROWS.items()]
    with_size = [Hypothesis(name, of, units=units) for name, (of, units) in CONTINUOUS.items()]
    return {
        " ".join([each.name, *each.of[:1], *["with a size"] * bool(each.units)]): each for each in (*made, *with_size)
    }


KINDS = hypotheses()


@pytest.mark.parametrize("name", KINDS)
def test_a_finding_says_where_how_much_and_what_to_do(name: str) -> None:
    """Of one that was undone or fitted no remedy is given; without an error of the fit, what it explains is said."""
    of = KINDS[name]
    count = len(of.units)
    finding = Finding(of, 80.0, (2e-3,) * count, (1e-4,) * count, explains_m=3e-4, before_m=0.05, after_m=2e-5)
    text = phrase(finding.check)
    assert all(part in text for part in of.of if part not in ("+1", "-1", "+", "-")) and "{" not in text
    assert "20 µm" in text and "50 mm" in text
    assert ("95 %" in text) is bool(count) and (f"--accept {of.key}" in text) is (
        count == 0 and of.name != "other_robot"
    )
    assert "--accept" not in phrase(finding.as_accepted().check)
    assert "300 µm" in phrase(replace(finding, before_m=float("nan")).check)


def test_every_kind_of_finding_has_a_phrase() -> None:
    """Also those of sensors, whose names stand in their sources."""
    named = {f"diagnosis.{each.name}" for each in KINDS.values()}
    for path in (ROOT / "lab").rglob("*.py"):
        if "Hypothesis(" not in (text := path.read_text(encoding="utf-8")):
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Hypothesis" and node.args:
                first = node.args[0]
                named |= {f"diagnosis.{first.value}"} if isinstance(first, ast.Constant) else set()
    assert named - set(PHRASES) == set()


def test_rivals_are_named_with_the_measurement_that_decides() -> None:
    step = Finding(KINDS["base_step 24 with a size"], 60.0, (1e-4,) * 6, (1e-5,) * 6, 1e-4, rivals=("joint_step:q1",))
    text = phrase(step.check)
    assert "joint_step:q1" in text and deciding_measurement("base_step", step.rivals) in text
    assert deciding_measurement("joint_step", ("base_step",)) == deciding_measurement("base_step", step.rivals) != ""
    assert "would decide" not in phrase(replace(step, rivals=("shear",)).check)


def test_a_rotation_within_its_interval_is_left_out() -> None:
    sure = Finding(KINDS["base_step 24 with a size"], 60.0, (3e-4, 0, 0, 1e-6, 0, 0), (1e-5,) * 6, 1e-4)
    assert "0.3 ± 0.02 mm (95 %)" in phrase(sure.check)
    turned = replace(sure, sizes=(3e-4, 0, 0, 1e-3, 0, 0))
    assert "0.3 ± 0.02 mm and 1 ± 0.02 mrad (95 %)" in phrase(turned.check)
