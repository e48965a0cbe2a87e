"""A run whose measurements are misread says so alone, and what is found decides the verdict by its size."""

import json
from collections.abc import Callable
from dataclasses import replace

import jsonschema
import numpy as np
import pytest
from helpers.campaigns import session
from helpers.robots import ROOT

import lab
from lab.core.measurements import Measurements
from lab.diagnosis.hypothesis import Finding, Hypothesis
from lab.phrases.verdict_phrases import next_step
from lab.report.document import Section, shown
from lab.report.views.calibration_document import document_of
from lab.report.views.calibration_figures import residual_pictures
from lab.verdict.diagnosed import checks_of, with_fitted

TARGETS = ("p1", "p2")
NOISE_MM = 8e-3 / np.sqrt(3)  # of the virtual instrument: uniform within 8 um


@pytest.fixture(scope="module")
def rows() -> Measurements:
    return session("irb120", poses=40, seed=7, targets=TARGETS).measurements


@pytest.fixture(scope="module")
def sound(rows: Measurements) -> lab.CalibrationResult:
    return lab.identify(rows, noise_mm=NOISE_MM)


def negated(rows: Measurements) -> Measurements:
    return replace(rows, joints=rows.joints * [1, -1, 1, 1, 1, 1])


def swapped(rows: Measurements) -> Measurements:
    late = (np.arange(len(rows)) >= 25)[:, None, None]
    return replace(rows, points=np.where(late, rows.points[:, ::-1], rows.points))


MISREAD: dict[str, tuple[Callable[[Measurements], Measurements], str]] = {
    "a sign": (negated, "joint_sign:q2"),
    "nests": (swapped, "targets_exchanged:p1"),
}


@pytest.fixture(scope="module")
def misread(rows: Measurements) -> dict[str, lab.CalibrationResult]:
    return {case: lab.identify(spoil(rows), noise_mm=NOISE_MM) for case, (spoil, _) in MISREAD.items()}


@pytest.mark.thorough
@pytest.mark.parametrize("case", MISREAD)
def test_of_misread_measurements_nothing_else_is_said(case: str, misread, sound) -> None:
    result, key = misread[case], MISREAD[case][1]
    (finding,) = result.diagnosis
    assert result.verdict.word == "bad" and result.exit_code == 1
    assert [each.name for each in result.verdict.reasons] == [f"diagnosis.{finding.name}"]
    assert {each.standing for each in result.verdict.answers.values()} == {"not judged"}
    assert not (result.warnings or result.checks or result.state.outliers or result.state.findings)
    assert not result.validated and finding.hypothesis.key == key
    left_m = np.sqrt(3 * np.nanmean(sound.identification.residuals**2))  # what the fit of sound readings leaves
    assert finding.before_m > 1e-3 and finding.after_m == pytest.approx(left_m, rel=1e-3)
    assert f"--accept {key}" in next_step(result.verdict)


@pytest.mark.thorough
@pytest.mark.parametrize("case", MISREAD)
def test_an_accepted_mistake_is_undone(case: str, rows: Measurements, sound) -> None:
    spoil, key = MISREAD[case]
    result = lab.identify(spoil(rows), accept=(key,), noise_mm=NOISE_MM)
    assert result.verdict.word == sound.verdict.word == "good" and result.diagnosis[0].accepted
    np.testing.assert_allclose(result.values, sound.values, rtol=0, atol=1e-9)


@pytest.mark.thorough
def test_of_two_mistakes_the_one_that_is_not_accepted_stays(rows: Measurements, sound) -> None:
    """Each has the error before it is undone, and after it; one that is undone already is not undone again."""
    both = swapped(negated(rows))
    first, second = lab.identify(both, noise_mm=NOISE_MM).diagnosis
    assert {first.hypothesis.key, second.hypothesis.key} == {key for _, key in MISREAD.values()}
    assert first.before_m > first.after_m == second.before_m > 100 * second.after_m
    half = lab.identify(both, accept=(first.hypothesis.key,), noise_mm=NOISE_MM)
    assert half.verdict.word == "bad" and [each.accepted for each in half.diagnosis] == [True, False]
    assert half.diagnosis[1].after_m == pytest.approx(second.after_m, rel=1e-3)
    whole = lab.identify(both, accept=(first.hypothesis.key, second.hypothesis.key), noise_mm=NOISE_MM)
    np.testing.assert_allclose(whole.values, sound.values, rtol=0, atol=1e-9)


def test_sound_measurements_have_no_section(sound) -> None:
    assert sound.diagnosis == () and sound.to_dict()["findings"] == []
    assert not any("wrong with" in title for title in titles(sound))


@pytest.mark.thorough
def test_what_is_found_stands_first_and_in_the_values(misread) -> None:
    result = misread["a sign"]
    assert titles(result)[0] == "What is wrong with the measurements" and len(titles(result)) == 2
    schema = json.loads((ROOT / "docs" / "reference" / "schemas" / "result.schema.json").read_text(encoding="utf-8"))
    values = json.loads(json.dumps(result.to_dict()))
    jsonschema.validate(values, schema)
    (entry,) = values["findings"]
    assert entry["reading"] and not entry["accepted"] and entry["of"] == ["q2"] and not entry["sizes"]
    assert entry["before_mm"] == pytest.approx(1e3 * result.diagnosis[0].before_m)


def titles(result: lab.CalibrationResult) -> list[str]:
    return [block.title for block in shown(document_of(result).blocks, "terminal") if isinstance(block, Section)]


def test_a_step_is_fitted_and_marked_in_time(rows: Measurements, sound) -> None:
    """The result without it is said; the chart of residuals in time has a line between the two poses."""
    late = (np.arange(len(rows)) >= 25)[:, None, None]
    result = lab.identify(replace(rows, points=rows.points + np.where(late, [4e-4, 0, 0], 0.0)), noise_mm=NOISE_MM)
    (finding,) = result.diagnosis
    entry = result.to_dict()["findings"][0]
    assert finding.accepted and finding.hypothesis.of == (rows.ids[24], rows.ids[25])
    assert result.verdict.word == "good" and finding.after_m < 2e-5 < 1e-4 < finding.before_m
    moved = [each for each in entry["sizes"] if each["unit"] == "mm"]
    assert np.hypot.reduce([each["size"] for each in moved]) == pytest.approx(0.4, abs=0.05)
    pytest.importorskip("matplotlib")
    assert [lines_of(each) for each in (result, sound)] == [[25.5], []]  # rows are counted from one


def lines_of(result: lab.CalibrationResult) -> list[float]:
    """The dashed lines of the first chart in time."""
    (first,) = [each for each in residual_pictures(result) if each.name == "residuals-time-0"]
    dashed = [line for line in first.draw().axes[0].lines if line.get_linestyle() == "--"]
    return [float(line.get_xdata()[0]) for line in dashed]


def found(discrete: bool, explains_m: float, accepted: bool = False) -> Finding:
    undo = (lambda rows: rows) if discrete else None
    return Finding(Hypothesis("joint_gain", ("q1",), corrected=undo), 50.0, explains_m=explains_m, accepted=accepted)


OUTCOMES = [
    (found(False, 1e-4), 1e-4, "failed"),
    (found(False, 0.8e-4), 1e-4, "failed"),
    (found(False, 0.6e-4), 1e-4, "noted"),
    (found(False, 2e-4), float("nan"), "noted"),
    (found(False, 2e-4), 1e-4, "noted"),  # groups of effects explain it
    (found(False, 2e-4, accepted=True), 1e-4, "noted"),
    (found(True, 1e-6), 1e-4, "failed"),
    (found(True, 1e-6, accepted=True), 1e-4, "noted"),
]


@pytest.mark.parametrize(("finding", "left_m", "outcome"), OUTCOMES)
def test_a_finding_counts_where_most_of_the_error_left_is_it(finding: Finding, left_m: float, outcome: str) -> None:
    assert checks_of(with_fitted([finding], left_m), left_m)[0].outcome == outcome


def test_a_mistake_that_no_fit_contains_makes_doubtful(rows: Measurements) -> None:
    """With the group that explains it the arm is good again, and the mistake is one that the fit has in."""
    coupled = replace(rows, joints=rows.joints + 1e-3 * rows.joints[:, [1]] * np.eye(6)[2])
    plain, whole = (lab.identify(coupled, model=model, noise_mm=NOISE_MM) for model in ("geometric", "coupling"))
    assert [each.hypothesis.of for each in plain.diagnosis] == [("q3", "q2")]
    assert plain.verdict.word == "doubtful" and plain.verdict.reasons[0].name == "diagnosis.joint_coupling"
    assert [each.accepted for each in (*plain.diagnosis, *whole.diagnosis)] == [False, True]
    assert not any(each.name.startswith("diagnosis") for each in whole.verdict.reasons)
