"""The page of a plan."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from helpers.html_page import Page

import lab
from lab.core.se3 import transform
from lab.options.virtual_campaign import DesignOptions
from lab.planning.design_problem import pose_problem
from lab.report.views.design_document import page_scene
from lab.simulation.meshes import body_poses


@pytest.mark.thorough
@pytest.mark.figures
def test_a_plan_says_its_predicted_errors(drawn_plan: Path) -> None:
    seen = Page(drawn_plan / "report.html")
    result = json.loads((drawn_plan / "result.json").read_text())
    assert set(seen.figures) == {"plan-scene", "curve-figure", "poses-figure"}
    for row, step in zip(seen.table("poses", "RMS, mm"), result["curve"], strict=True):
        shown = [value for key, value in step.items() if key != "o1"]  # which is the same for any number
        assert [seen.number(cell) for cell in row] == pytest.approx(shown, rel=5e-3)
    assert len(seen.table("index")) == len(result["indices"])


@cache
def planned() -> lab.DesignResult:
    return lab.design("irb120", poses=10, candidates=60, starts=1)


@pytest.mark.thorough
def test_the_tour_is_played_through_its_poses() -> None:
    """By an own way: the bodies at the joint positions of each pose; the moves take as long as the tour's."""
    plan = planned()
    scene, problem = page_scene(plan), plan.problem
    assert len(scene.stops) == len(plan.joints) == len(scene.names)
    assert (np.diff(scene.times) >= 0).all() and scene.times[0] == 0.0
    assert scene.times[-1] == pytest.approx(float(plan.tour.seconds), rel=1e-9)
    expected = body_poses(problem.robot.model, problem.arm, problem.values, plan.joints)
    for body in {shell.body for shell in scene.shells}:
        np.testing.assert_allclose(scene.bodies[body][scene.stops], expected[body], atol=1e-9)
    (path,) = scene.lines
    points = transform(problem.robot.model.T_world_tracker, problem.arm.points(plan.joints, problem.values)[:, 0])
    np.testing.assert_allclose(scene.points, points, atol=1e-9)
    assert np.linalg.norm(path.points[:, None] - points, axis=2).min(axis=0).max() < 1e-9


@pytest.mark.thorough
def test_targets_that_no_pose_reaches_are_named_with_their_frame(tmp_path: Path) -> None:
    robot, file = lab.load_robot("irb120"), tmp_path / "task.csv"

    def warned(region: str) -> list[str]:
        problem = pose_problem(DesignOptions(robot="irb120", region=region, candidates=60), robot)
        return [each for each in problem.warnings if "--region" in each]

    arm = robot.arm(("p1",))
    values = robot.model.values_before(arm, robot.model.T_world_tracker)
    near = 1e3 * arm.points(0.3 * arm.chain.random_joints(3, np.random.default_rng(0)), values)[:, 0]
    rows = [f"t{i},{x},{y},{z}" for i, (x, y, z) in enumerate(near)]
    head, moon = "id,x_mm,y_mm,z_mm", "moon,9000,9000,9000"
    file.write_text("\n".join([head, *rows, moon]))
    (text,) = warned(str(file))
    assert "moon (1 of 4)" in text
    file.write_text("\n".join([head, *rows]))
    assert not warned(str(file))
    assert len(warned("300,1500,-100,100,300,500")) == 1  # half of the box
    file.write_text("\n".join([head, moon]))
    with pytest.raises(lab.LabError, match="none of its 1 points"):
        warned(str(file))
