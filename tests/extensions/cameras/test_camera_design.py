"""Poses chosen for cameras: what a picture shows, how much it tells, and that the plan runs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lab
from lab.core.errors import LabError
from lab.extensions.cameras.picture_planning import PlannedPictures
from lab.options.virtual_campaign import DesignOptions
from lab.planning.design_problem import PoseProblem, pose_problem
from lab.pose_selection.exchange import information

PLACED = """
[[camera]]
name = "wrist"
fixed_to = "hand"
position_mm = [60.0, 0.0, -30.0]
rotation_deg = [0.0, 0.0, 10.0]

[[board]]
size_u_percent = 0.0
name = "table"
position_mm = [330.0, 60.0, 20.0]
rotation_deg = [180.0, 0.0, 0.0]
"""
_POSES = 15


def _options(folder: Path, text: str = PLACED, **more: object) -> DesignOptions:
    path = folder / "placed.toml"
    path.write_text(text)
    return DesignOptions(observe="pixels", cameras=path, poses=_POSES, candidates=120, starts=1, **more)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> PoseProblem:
    return pose_problem(_options(tmp_path_factory.mktemp("cameras")))


def _planned(problem: PoseProblem) -> PlannedPictures:
    assert isinstance(problem.planned, PlannedPictures)
    return problem.planned


@pytest.mark.thorough
def test_no_candidate_looks_away_and_a_turned_wrist_sees_nothing(problem: PoseProblem) -> None:
    planned, joints = _planned(problem), problem.candidates.joints
    tips = planned.arm.tips(joints)
    cameras, board = tips[:, 0] @ planned.scene.cameras[0], planned.scene.boards[0]
    middle = board[:3, 3] + board[:3, :3] @ planned.scene.rig.boards[0].corners.mean(axis=0)
    sight = middle - cameras[:, :3, 3]
    towards = np.einsum("ni,ni->n", cameras[:, :3, 2], sight) / np.linalg.norm(sight, axis=1)
    assert (towards > np.cos(np.deg2rad(60))).all()
    assert (board[:3, 2] @ sight.T / np.linalg.norm(sight, axis=1) > np.cos(np.deg2rad(70))).all()
    assert (planned.counts(joints) >= planned.scene.rig.simulated.corners).all()
    turned = joints.copy()
    turned[:, 4] += np.pi  # the line of sight is turned by half about the wrist
    assert not planned.sees(turned).any()


def test_places_are_those_of_the_simulated_scene(problem: PoseProblem) -> None:
    planned, joints = _planned(problem), problem.candidates.joints[:5]
    exact = planned.scene.seen(0, 0, planned.arm.tips(joints), planned.arm.targets)[0]
    for corner in (0, 17, 53):
        inputs = np.column_stack([joints, np.full(len(joints), corner)])
        assert np.allclose(planned.pixels.points(inputs, planned.values)[:, 0], exact[:, corner], atol=1e-12)


def test_few_rows_hold_the_information_of_all_corners_by_differences(problem: PoseProblem) -> None:
    planned, retained = _planned(problem), problem.structure.identifiable
    joints = problem.candidates.joints[:1]
    inside = planned.scene.visible(0, 0, planned.arm, joints, planned.arm.tips(joints))[1]
    inputs = np.column_stack([np.repeat(joints, inside.sum(), axis=0), np.flatnonzero(inside[0])])
    columns = []
    for i in retained:
        step = 1e-6 * np.eye(len(planned.values))[i]
        high, low = (planned.pixels.points(inputs, planned.values + sign * step) for sign in (1, -1))
        columns.append(((high - low) / 2e-6).ravel())
    expected = information(np.array(columns).T[None]) / 1e-4**2  # 0.1 px
    found = problem.whitened(joints)
    assert found.shape[1] == 6
    assert np.allclose(information(found), expected, rtol=1e-5, atol=1e-6 * expected.max())


@pytest.mark.thorough
def test_the_plan_runs_in_a_virtual_calibration(tmp_path: Path) -> None:
    options = _options(tmp_path)
    plan = lab.design(options)
    assert isinstance(plan, lab.library.design.DesignResult)
    plan.write_files(tmp_path)
    values = plan.to_dict()
    assert len(values["corners"]) == _POSES
    assert min(values["corners"]) >= 6
    run = lab.calibrate("irb120", observe="pixels", cameras=options.cameras, plan=tmp_path / "plan.csv")
    assert run.to_dict()["poses"] >= _POSES - 2  # the true arm may miss a board that the nominal one just sees
    assert run.to_dict()["rank"] == values["parameters"]
    assert 0.3 < run.to_dict()["after_mm"]["rms"] / values["predicted_mm"]["rms"] < 3  # one campaign


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"instrument": "leica-at960"}, "--instrument: is of a design for measured points"),
        ({"payload_kg": (1.0,)}, "--payload-kg: is of a design for measured points"),
        ({"observe": "points"}, "--cameras: is of --observe pixels"),
        ({"cameras": None}, "give --cameras"),
    ],
)
def test_options_that_make_no_sense_are_refused(tmp_path: Path, more: dict[str, object], message: str) -> None:
    with pytest.raises(LabError, match=message):
        replace(_options(tmp_path), **more).refuse_nonsense()  # type: ignore[arg-type]


def test_a_board_without_a_place_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LabError, match="board table has no place"):
        pose_problem(_options(tmp_path, PLACED[: PLACED.rindex("position_mm")]))
