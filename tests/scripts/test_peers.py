"""The comparison with other packages: what is asked for, and how answers are judged."""

import json
from pathlib import Path

import numpy as np
import peers
import pytest
from helpers.robots import ROOT
from shared import run_script


@pytest.mark.parametrize(
    "given",
    [
        ["--only", "robodk"],
        ["--only", "eaik/flying"],
        ["--rounds", "0"],
        ["--folder", str(ROOT / "README.md")],
        ["--write", "--only", "eaik"],
    ],
)
def test_a_wrong_request_is_one_line(given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        run_script("peers", given)
    printed = capsys.readouterr()
    assert stop.value.code == 2 and printed.err.startswith("lab: ") and printed.err.count("\n") == 1 and not printed.out


@pytest.fixture(scope="module")
def problems(tmp_path_factory: pytest.TempPathFactory) -> peers.Problems:
    """What all tools are given."""
    return peers.prepare(tmp_path_factory.mktemp("problems"))


def test_solutions_are_counted_that_meet_their_pose(problems: peers.Problems) -> None:
    near, few = problems.arrays["poses"], 3
    robot = problems.arm
    joints = np.random.default_rng(3).uniform(-1, 1, (few, 6))
    poses = robot.flange(joints, problems.nominal)
    answer = np.full((few, 2, 6), np.nan)
    answer[:, 0] = joints
    answer[1, 1] = joints[1] + 1e-3  # a millimetre off: no solution
    answer[2, 0, 5] += 2e-5  # turned by more than counts
    arrays = {**problems.arrays, "poses": np.concatenate([poses, near[few:]])}
    found = peers.judged(
        peers.Problems(robot, problems.nominal, arrays, problems.bound), "inverse", "one solution", answer, None
    )
    assert found["solved"] == pytest.approx(2 / 3) and found["solutions"] == pytest.approx(2 / 3)
    assert not found["agrees"] and found["largest_m"] < 1e-12
    json.dumps(found)


@pytest.mark.slow
def test_the_lab_is_measured(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run_script("peers", ["--only", "lab", "--rounds", "1", "--folder", str(tmp_path), "--json"])
    found = json.loads(capsys.readouterr().out)
    assert not found["left_out"] and {row["topic"] for row in found["rows"]} == set(peers.TOPICS) - {"jobs"}
    jobs = found["jobs"]["lab"]
    assert jobs["fit"]["mm"] < 0.005 and jobs["own_residual"]["mm"] < 0.01 and max(jobs["study"]["mm"].values()) < 0.02
