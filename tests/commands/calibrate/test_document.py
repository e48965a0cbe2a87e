"""Reports as a person gets them: one file each that needs nothing else, with the numbers of ``result.json``."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.campaigns import calibration, session
from helpers.html_page import Page
from helpers.robots import data_file

import lab
from lab.calibration.checks import note
from lab.campaign.option_groups import Effects, Fitting
from lab.campaign.options import VirtualCampaign
from lab.commands.calibrate.document import document_of
from lab.commands.calibrate.figures import error_vectors, has_correction, residual_pictures, world_of
from lab.commands.calibrate.options import MeasuredCampaign
from lab.commands.calibrate.result import errors_without_outliers
from lab.commands.calibrate.run import calibrate, identify
from lab.core import se3
from lab.formats.measurement_csv import write_measurements
from lab.render.document import Card, digits_of, short
from lab.render.phrases.registry import phrases
from lab.render.terminal import to_text

SECTIONS = ["Errors and reasons", "Before and after calibration", "Errors over the workspace",
            "Uncertainty and goodness of fit", "Parameters", "Identifiability and conditioning",
            "What was done", "Glossary"]  # fmt: skip
FIGURES = ["errors-figure", "arm-scene", "where", "uncertainty", "residuals", "residuals-in-time", "corrections",
           "singular-values-figure", "correlations-figure"]  # fmt: skip
NASTY = """<script>alert("$x_1$")</script>&'<b>"""


def written(path: Path, seven) -> Page:
    seven.report(path)
    assert path.stat().st_size < 1e6
    return Page(path)


@pytest.mark.thorough
@pytest.mark.figures
def test_a_run_has_its_sections_and_figures(drawn_run: Path) -> None:
    seen = Page(drawn_run / "report.html")
    assert seen.headings[1:] == SECTIONS and list(seen.figures) == FIGURES
    for figure in seen.figures.values():
        assert len(figure["caption"]) > 40
    assert [name for name, figure in seen.figures.items() if not figure["svg"]] == ["arm-scene"]
    # one spread; two maps in two views; two maps; six joints; three axes in time and quantiles; two units; …
    assert (
        seen.source.count("<svg") == 1 + 4 + 2 + 6 + 4 + 2 + 1 + 1
        and seen.tags.count("h1") == 1
        and 'lang="en"' in seen.source
    )
    assert "lab calibrate --seed 7" in seen.text and "numpy" in seen.text and "seconds" not in seen.text
    config = json.loads((drawn_run / "config.json").read_text())
    assert config["model_sha256"] in seen.text and config["versions"]["mujoco"] in seen.text
    assert (drawn_run / "report.html").stat().st_size < 1e6


@pytest.mark.pages
def test_its_numbers_are_those_of_the_result(seven_run: Path, seven, tmp_path: Path) -> None:
    seen = written(tmp_path / "report.html", seven)
    result = json.loads((seven_run / "result.json").read_text())
    assert (
        seen.headings[0]
        == f"irb120: {short(result['before_mm']['mean'])} → {short(result['after_mm']['mean'])} mm, good"
    )
    for row in seen.table("", "mean", "rms"):
        errors = result[f"{row[0]}_mm"]
        for cell, key in zip(row[1:], ("mean", "rms", "p95", "max", "count"), strict=True):
            assert seen.number(cell) == pytest.approx(errors[key], rel=5e-3)
    shown = seen.table("parameter", "correction", "95 % interval", "unit", "estimated", "nominal", "status")
    rows = [[row[i] for i in (0, 3, 5, 4, 1, 2, 6)] for row in shown]
    stored = json.loads((seven_run / "parameters.json").read_text())
    stored = [each for each in stored if each["status"] != "converted"]  # Z and E, beside the parameters
    assert [row[0] for row in rows] == [each["name"] for each in stored]
    parameters = zip(seven.identification.model.parameters, seven.parameters, strict=True)
    for row, each, (found, estimated) in zip(rows, stored, parameters, strict=True):
        scale, unit, digits = found.unit.factor, found.unit.name, found.unit.decimals
        low, high = each["interval_95"] or (np.nan, np.nan)
        half = 0.5001 * 10 ** -digits_of(scale * (high - low) / 2, digits)
        assert row[1] == unit and seen.number(row[2]) == pytest.approx(scale * each["nominal"], abs=half)
        if each["status"] != "identified":
            assert row[3:6] == ["", "", ""] and row[6].startswith("fixed at nominal; aliased with ")
            continue
        low, high = (scale * end for end in each["interval_95"])
        assert seen.number(row[3]) == pytest.approx(scale * each["estimate"], abs=half)
        assert seen.number(row[5]) == pytest.approx((high - low) / 2, abs=half)  # two digits, as its value
        drawn = each["name"].startswith("link")
        assert has_correction(found, estimated) is drawn
        assert (row[4] != "") is drawn
        if drawn:
            assert seen.number(row[4]) == pytest.approx(scale * (each["estimate"] - each["nominal"]), abs=half)
    pairs = seen.table("strongly correlated parameters")
    assert [row[0] for row in pairs] == [" and ".join(each["parameters"]) for each in result["correlated"]]


@pytest.mark.thorough
@pytest.mark.figures
def test_the_same_seed_gives_the_same_bytes(drawn_run: Path, seven, tmp_path: Path) -> None:
    written(tmp_path / "again.html", replace(seven, seconds=99.0))
    assert (tmp_path / "again.html").read_bytes() == (drawn_run / "report.html").read_bytes()


@pytest.mark.thorough
@pytest.mark.figures
def test_what_a_user_named_is_escaped(tmp_path: Path) -> None:
    """The names of files, robots, poses and targets are text, in the page as in its pictures."""
    bad = calibration(seed=2, bad_share=0.08, bad_mm=(5.0, 50.0))
    target = "a$b<i>&"
    data = replace(bad.measurements, targets=(target,), ids=tuple(f"{NASTY}{i}" for i in range(len(bad.measurements))))
    file = tmp_path / f"{NASTY.replace('/', '')}.csv"
    write_measurements(file, data, bad.robot.chain.prismatic)
    options = MeasuredCampaign(file, noise_mm=0.005)
    found = identify(options)
    assert found.fit.outliers and found.fitted.targets == (target,)
    model = found.robot.model
    named = replace(found.robot, model=replace(model, chain=replace(model.chain, name=NASTY)))
    found = replace(found, robot=named, fit=replace(found.fit, checks=(note(f"{NASTY} of a warning"),)))
    seen = written(tmp_path / "report.html", found)
    assert seen.headings[0].startswith(NASTY) and seen.items[-1:] == [f"{NASTY} of a warning"]
    assert found.fit.outliers[0].id in [row[0] for row in seen.table("pose", "line")]
    assert f"pose {NASTY}" in seen.text  # in a picture, where dollars might begin a formula
    assert f"tool.{target}.x" in [row[0] for row in seen.table("parameter")]
    assert "<i>" not in seen.source and "alert(" in seen.text


CASES = {
    "exact, with nothing left over": (
        VirtualCampaign(seed=1, poses=9, instrument="exact"),
        "doubtful",
        {"correlations-figure", "uncertainty"},
    ),
    "bad": (VirtualCampaign(seed=1, gate_mm=1e-4), "bad", set()),
    "three targets, robust": (
        VirtualCampaign(
            seed=2, targets=("p1", "p2", "p3"), effects=Effects(bad_share=0.1), fitting=Fitting(robust=True)
        ),
        "good",
        set(),
    ),
    "nothing differs": (VirtualCampaign(seed=1, position_sigma_mm=0, rotation_sigma_mrad=0), "good", set()),
}


@pytest.mark.pages
@pytest.mark.thorough
@pytest.mark.parametrize("case", CASES)
def test_virtual_runs_of_every_end_are_told(case: str, tmp_path: Path) -> None:
    options, verdict, missing = CASES[case]
    found = calibrate(options)
    assert found.verdict.word == verdict
    seen = written(tmp_path / "report.html", found)
    assert set(seen.figures) == set(FIGURES) - missing and seen.headings[0].endswith(verdict)
    for reason in phrases(found.verdict.reasons):
        assert seen.text.lower().count(reason.lower()) == 1
    assert ("Outliers: " in " ".join(seen.headings)) is bool(found.fit.outliers)


@pytest.mark.pages
def test_a_run_that_is_not_judged(seven, tmp_path: Path) -> None:
    seen = written(tmp_path / "report.html", lab.identify(seven.measurements.take(range(11))))
    assert (
        seen.headings[0] == "irb120: identified, not judged" and "Verdict: not judged (no gate was given)" in seen.text
    )
    assert list(seen.figures) == FIGURES[1:]


@pytest.mark.pages
def test_held_out_poses_are_drawn_where_they_are(seven, tmp_path: Path) -> None:
    found = lab.identify(seven.measurements, holdout=0.3, instrument="uniform-8um")
    seen = written(tmp_path / "report.html", found)
    assert "at the poses of the hold-out set." in seen.figures["where"]["caption"]
    held = found.measurements.without(found.fitted.ids)
    shown = error_vectors(found)
    assert len(held) == 15 and shown.names == held.ids and shown.thing == "pose"
    lengths = np.linalg.norm(shown.after, axis=1)
    np.testing.assert_allclose(lengths, found.validation.errors.after[:, 0], rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(shown.before, axis=1), found.validation.errors.before[:, 0], rtol=1e-9)
    measured = se3.transform(world_of(found), held.points[:, 0])
    np.testing.assert_allclose(shown.points + shown.after, measured, atol=1e-12)  # each error is that of its pose
    assert np.linalg.norm(shown.before, axis=1).mean() > 10 * lengths.mean()


def test_the_title_counts_no_outliers_where_the_card_does_not() -> None:
    """One number for one thing, in the title, the card and the sentence below."""
    measured = session(poses=30, seed=2, bad_share=0.2, bad_mm=(5.0, 50.0)).measurements
    found = lab.identify(measured, holdout=0.3, robust=True)
    without = errors_without_outliers(found)
    assert without is not None and without.mean < 0.1 * found.after.mean
    said = document_of(found)
    card = next(block for block in said.blocks if isinstance(block, Card))
    assert f" → {short(without.mean)} mm," in said.title and card.numbers[1][1] == short(without.mean, "mm")
    assert f"is {short(without.mean)} mm with the calibrated one, without the outliers." in to_text(said)


def test_a_joint_that_errs_like_a_sine_is_seen_in_its_picture_alone() -> None:
    """The residual along a joint's motion is its lever times its error: a wave against it, nothing against others."""
    day = session(poses=150, seed=7).measurements
    joints = day.joints.copy()
    joints[:, 2] += 2e-4 * np.sin(3 * joints[:, 2])  # what the controller says; 60 µm at 0.3 m
    found = lab.identify(replace(day, joints=joints), instrument="uniform-8um")
    trends = [each.label for each in residual_pictures(found)[: found.robot.chain.size]]
    assert [label.split(": ")[0] for label in trends] == list(found.robot.chain.joint_names)
    assert "trend" in trends[2] and "no trend" not in trends[2] and sum("no trend" in each for each in trends) >= 4


@pytest.mark.pages
@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "rows", "options"),
    [
        ("irb120_cable_robotcali_1042.csv", 130, {"observe": "cable", "fitting": Fitting(prior=True), "holdout": 0.3}),
        ("panda_sockets_mukca_3.csv", None, {"observe": "socket", "robot": "panda"}),
        (
            "ur10_ipa_D.csv",
            120,
            {"observe": "pose", "orientation": "intrinsic-xyz", "robot": "ur10", "holdout": 0.3},
        ),
    ],
)
def test_whatever_was_observed_gives_a_report(name: str, rows, options, tmp_path: Path) -> None:
    file = tmp_path / name
    lines = data_file(name).read_text().splitlines(keepends=True)
    file.write_text("".join(lines[: rows and rows + 1]))
    asked = MeasuredCampaign(file, **options)
    found = identify(asked)
    seen = written(tmp_path / "report.html", found)
    assert set(seen.figures) == set(FIGURES) - (
        set() if asked.observe == "pose" else {"uncertainty", "residuals", "residuals-in-time"}
    )
    words = {"cable": "error of the cable's length", "socket": "distance from the socket", "pose": "position error"}
    assert words[asked.observe] in seen.text and found.verdict.word in seen.text
    assert len(seen.table("parameter")) == len(found.parameters)
