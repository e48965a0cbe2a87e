"""A path check looks at few of a way's places: it says what a look at each of them says, with little slack or much."""

from pathlib import Path

import numpy as np
import pytest
from helpers.cells import between_table_and_post

from lab.core.se3 import Array
from lab.simulation import free_path
from lab.simulation.collisions import collides
from lab.simulation.free_path import path_check
from lab.simulation.robot_model import RobotModel

STEP_M = 0.005  # coarser than the lab's, so that each place can be looked at


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(free_path, "_STEP_M", STEP_M)


def place_by_place(model: RobotModel, start: Array, end: Array, step_m: float = STEP_M) -> bool:
    steps = max(1, int(np.ceil(np.abs(end - start) @ model.travel_per_joint() / step_m)))
    return not collides(model, start + np.linspace(0, 1, steps + 1)[:, None] * (end - start)).any()


@pytest.mark.parametrize(("name", "clearance_mm"), [("tx40", 0.0), ("scara", 20.0)])
def test_what_it_says_is_what_each_place_says(name: str, clearance_mm: float, tmp_path: Path) -> None:
    """Long moves and short ones, half of which begin where the arm nearly touches something."""
    model = between_table_and_post(name, tmp_path, clearance_mm)
    rng, free = np.random.default_rng(5), path_check(model)
    ends = model.chain.random_joints(24, rng)
    moves = [(ends[i], ends[i] + share * (ends[i + 1] - ends[i])) for i in range(23) for share in (1.0, 0.2, 0.01)]
    said = [free(*move) for move in moves]
    assert said == [place_by_place(model, *move) for move in moves]
    assert 0 < sum(said) < len(said)


def test_one_place_is_a_way_too(tmp_path: Path) -> None:
    model = between_table_and_post("irb120", tmp_path, 20.0)
    free, poses = path_check(model), model.chain.random_joints(30, np.random.default_rng(2))
    assert [free(pose, pose) for pose in poses] == list(~collides(model, poses))
