"""The page of corrected targets."""

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.html_page import Page

import lab
from lab.cli.main import main
from lab.core import se3
from lab.core.number_text import short
from lab.library.load_run import load_run
from lab.report.views.compensation_document import page_scene

NASTY = """<script>alert("$x_1$")</script>&'<b>"""


@pytest.mark.pages
@pytest.mark.thorough
def test_corrected_targets_are_listed_and_those_that_fail(seven_run: Path, tmp_path: Path) -> None:
    """Also where none is reached."""
    calibrated = load_run(seven_run)
    arm, values = calibrated.estimate.geometry
    Ts = arm.tool(0.7 * arm.chain.random_joints(12, np.random.default_rng(1)), values)[0]
    Ts[3, :3, 3] += 5.0
    quaternions = se3.quaternion_from_rotation(Ts[:, :3, :3])
    lines = [f"{NASTY.replace(',', '')}{i}," + ",".join(repr(float(v)) for v in (*(1e3 * T[:3, 3]), *q))
             for i, (T, q) in enumerate(zip(Ts, quaternions, strict=True))]  # fmt: skip
    lines = [line.replace('"', "") for line in lines]
    for name, rows, reached in (("all", slice(None), 11), ("none", slice(3, 4), 0)):
        (tmp_path / f"{name}.csv").write_text("\n".join(["id,x_mm,y_mm,z_mm,qw,qx,qy,qz", *lines[rows]]) + "\n")
        out = tmp_path / name
        targets = str(tmp_path / f"{name}.csv")
        main(["compensate", targets, "--run", str(seven_run), "--out", str(out), "--json"])
        seen, result = Page(out / "report.html"), json.loads((out / "result.json").read_text())
        assert result["converged"] == reached and seen.headings[0].startswith(f"irb120: {reached} of ")
        assert set(seen.figures) == ({"moved-figure", "targets-scene"} if reached else set())
        for each in result["failed"]:
            assert [each["id"], each["reason"]] in seen.table("target", "why it is not reached")
        if reached:
            assert short(result["correction_mm"]["mean"]) in seen.text
            assert len(seen.table("target", "q1, °")) == reached


def test_the_scene_has_the_errors_without_and_with_the_correction(seven_run: Path) -> None:
    """By an own way: the calibrated arm with the nominal joints; ellipsoids whose half-axes give the expected error."""
    calibrated = load_run(seven_run)
    arm, values = calibrated.estimate.geometry
    Ts = arm.tool(0.5 * arm.chain.random_joints(5, np.random.default_rng(2)), values)[0]
    Ts[4, :3, 3] = 0.001 * np.arange(3)  # as if given in the robot's base, next to its axis
    names = tuple(f"t{i}" for i in range(5))
    targets = lab.Targets("p1", names, Ts[:, :3, 3], Ts[:, :3, :3], np.full((5, 6), np.nan))
    result = lab.compensate(targets, run=seven_run, no_check=True)
    assert result.far_away == ("t4",)
    scene = page_scene(result)
    rows = result.reached
    there = arm.points(result.found.uncorrected[rows], values)[:, 0]
    (arrows,) = scene.arrows
    lengths = np.linalg.norm(there - Ts[rows, :3, 3], axis=1)
    np.testing.assert_allclose(np.linalg.norm(arrows.vectors, axis=1), lengths, rtol=1e-9)
    np.testing.assert_allclose(lengths, result.correction_m[rows], rtol=0.05)
    T = calibrated.robot.model.T_world_frame0 @ se3.inverse(arm.T_tracker_frame0(values))
    np.testing.assert_allclose(scene.points, se3.transform(T, Ts[rows, :3, 3]), atol=1e-9)
    np.testing.assert_allclose(arrows.vectors, (there - Ts[rows, :3, 3]) @ T[:3, :3].T, atol=1e-12)
    drawn = scene.ellipsoids
    half = np.linalg.norm(drawn.half_sizes / drawn.factor, axis=1)
    np.testing.assert_allclose(half, result.predicted_m[rows], rtol=1e-6)
