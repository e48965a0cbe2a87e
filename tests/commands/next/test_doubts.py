"""While poses are measured, mistakes of reading are named, and what an earlier run could not tell apart."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from helpers.campaigns import own_copy, run_of, session

import lab
from lab.library.next_pose import NextPoseResult


@pytest.fixture(scope="module")
def plan() -> lab.DesignResult:
    return lab.design("irb120", poses=14, candidates=100, starts=1)


@pytest.mark.thorough
def test_a_mistake_of_reading_is_the_first_warning(plan: lab.DesignResult) -> None:
    rows = session("irb120", poses=20, seed=7).measurements
    negated = replace(rows, joints=rows.joints * [1, 1, -1, 1, 1, 1])
    assert lab.next_pose(plan, rows, candidates=100).doubts == ()
    found: NextPoseResult = lab.next_pose(plan, negated, candidates=100)
    assert "joint_sign:q3" in found.warnings[0] and not any("stated noise" in each for each in found.warnings)
    few = lab.next_pose(plan, negated[:5], candidates=100)  # base and tool explain them
    assert few.doubts == ()


@pytest.mark.thorough
def test_what_a_run_left_open_is_to_be_measured(tmp_path: Path) -> None:
    run = own_copy(run_of(seed=7), tmp_path / "run")
    file = run / "measurements.csv"
    assert lab.next_pose(run, file, candidates=100).doubts == ()
    result = json.loads((run / "result.json").read_text(encoding="utf-8"))
    entry = {"key": "base_step:3", "rivals": ["joint_step:q1"], "deciding_measurement": "nests on the floor"}
    result["findings"] = [entry, entry | {"deciding_measurement": None}]
    (run / "result.json").write_text(json.dumps(result), encoding="utf-8")
    (doubt,) = lab.next_pose(run, file, candidates=100).doubts
    assert all(part in doubt for part in ("nests on the floor", "base_step:3", "joint_step:q1"))
