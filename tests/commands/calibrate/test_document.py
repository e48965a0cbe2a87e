"""Reports as a person gets them: one file each that needs nothing else, with the numbers of ``result.json``."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.campaigns import calibration
from helpers.html_page import Page
from helpers.robots import data_file

import lab
from lab.core import se3
from lab.core.number_text import digits_of, short
from lab.formats.measurement_csv import write_measurements
from lab.library.identify import identify
from lab.options.measured_campaign import MeasuredCampaign
from lab.options.option_groups import Fitting
from lab.report.views.calibration_figures import error_vectors, has_correction, world_of
from lab.verdict.fit_checks import note

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
    assert [name for name, figure in seen.figures.items() if not figure["svg"]] == ["arm-scene"]
    config = json.loads((drawn_run / "config.json").read_text())
    assert config["model_sha256"] in seen.text and config["versions"]["mujoco"] in seen.text


@pytest.mark.thorough
@pytest.mark.pages
def test_its_numbers_are_those_of_the_result(seven_run: Path, seven, tmp_path: Path) -> None:
    seen = written(tmp_path / "report.html", seven)
    result = json.loads((seven_run / "result.json").read_text())
    assert all(short(result[name]["mean"]) in seen.headings[0] for name in ("before_mm", "after_mm"))
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
            assert row[3:6] == ["", "", ""]
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
    assert found.state.outliers and found.fitted.targets == (target,)
    model = found.robot.model
    named = replace(found.robot, model=replace(model, chain=replace(model.chain, name=NASTY)))
    found = replace(found, robot=named, state=replace(found.state, checks=(note(f"{NASTY} of a warning"),)))
    seen = written(tmp_path / "report.html", found)
    assert seen.headings[0].startswith(NASTY) and seen.items[-1:] == [f"{NASTY} of a warning"]
    assert found.state.outliers[0].id in [row[0] for row in seen.table("pose", "line")]
    assert f"tool.{target}.x" in [row[0] for row in seen.table("parameter")]
    assert "<i>" not in seen.source and "alert(" in seen.text


@pytest.mark.pages
def test_held_out_poses_are_drawn_where_they_are(seven, tmp_path: Path) -> None:
    found = lab.identify(seven.measurements, holdout=0.3, instrument="uniform-8um")
    seen = written(tmp_path / "report.html", found)
    assert "where" in seen.figures
    held = found.measurements.without(found.fitted.ids)
    shown = error_vectors(found)
    assert len(held) == 15 and shown.names == held.ids and shown.thing == "pose"
    lengths = np.linalg.norm(shown.after, axis=1)
    np.testing.assert_allclose(lengths, found.validation.errors.after[:, 0], rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(shown.before, axis=1), found.validation.errors.before[:, 0], rtol=1e-9)
    measured = se3.transform(world_of(found), held.points[:, 0])
    np.testing.assert_allclose(shown.points + shown.after, measured, atol=1e-12)  # each error is that of its pose
    assert np.linalg.norm(shown.before, axis=1).mean() > 10 * lengths.mean()


@pytest.mark.pages
@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "rows", "options"),
    [
        ("irb120_cable_robotcali_1042.csv", 130, {"observe": "cable", "fitting": Fitting(prior=True), "holdout": 0.3}),
        ("panda_sockets_mukca_3.csv", None, {"observe": "socket", "robot": "panda"}),
    ],
)
def test_whatever_was_observed_gives_a_report(name: str, rows, options, tmp_path: Path) -> None:
    file = tmp_path / name
    lines = data_file(name).read_text().splitlines(keepends=True)
    file.write_text("".join(lines[: rows and rows + 1]))
    asked = MeasuredCampaign(file, **options)
    found = identify(asked)
    seen = written(tmp_path / "report.html", found)
    assert set(seen.figures) == set(FIGURES) - {"uncertainty", "residuals", "residuals-in-time"}
    assert len(seen.table("parameter")) == len(found.parameters)
