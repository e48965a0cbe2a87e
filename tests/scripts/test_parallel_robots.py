"""Parallel robots: the script's ranks exactly, its errors within bounds, and no error at all without noise."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import parallel_robots as script
import pytest
from helpers.run_script import answer_of
from shared import run_script

from lab.campaign.robot import load_robot
from lab.kinematics.gauge import base_set

# parameters, rank: facts-robots.md, section 5, where the frame is in the plane or known; in space it is fitted too
RANKS = {
    "2-RPR at P, in the plane": (11, 8),
    "2-RPR at P": (14, 11),
    "3-RPR pose, frame known": (15, 15),
    "3-RPR pose": (30, 23),
    "3-RPR point p1, frame known": (15, 14),
    "3-RPR point p1": (21, 17),
    "Delta": (39, 24),
    "Delta of 800 mm": (39, 24),
    "IRB 120": (34, 27),
}
OTHERS = {
    "3-RRR pose": (36, 29),  # 21 of the legs, the plane's place, and the targets' but for the platform's frame
    "3-PRR pose": (36, 26),  # 18 of the legs: a guide along its own line is the slide's offset
    "Hexapod pose": (57, 45),  # 42, as of poses, and the three distances between the targets
}
ROUNDING_M = 1e-12
longer_rod = cache(script.longer_rod)


@pytest.mark.thorough
@pytest.mark.parametrize("name", OTHERS)
def test_the_ranks_of_the_other_robots(name: str):
    robot = load_robot(script.CASES[name].robot)
    arm = robot.arm(script.THREE)
    assert (len(arm.names), len(base_set(arm, arm.nominal(robot.tool)).identifiable)) == OTHERS[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_the_other_robots_come_out_at_their_floor(name: str):
    rows = [script.one_robot(name, seed) for seed in range(24)]
    assert all(row["converged"] and not row["refused"] for row in rows)
    assert 0.9 < np.median([row["ratio"] for row in rows]) < 1.5
    assert all(row["fresh_um"] < 1.6 * row["predicted_um"] for row in rows)


@pytest.mark.thorough
@pytest.mark.parametrize("name", script.NOISELESS)
def test_nothing_is_left_without_noise(name: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(script, "FRESH", 100)
    row = script.one_robot(name, 0, True)
    assert row["converged"] and row["worst_um"] / 1e6 < ROUNDING_M


def test_a_closed_form_answers_wherever_the_drawing_does():
    for name in ("rpr2", "rpr3", "delta"):
        row = script.assembled(name, 2000, 3)
        assert row["right"] == row["answered"] == row["close"] - row["refused"]
        assert row["refused"] <= (4 if name == "rpr3" else 0)  # nearly singular
        if name == "delta":
            assert row["the first mode"] == 2000  # the lower


@pytest.mark.thorough
def test_a_longer_rod_tilts_the_platform_and_shows():
    """Facts: 0.87 mrad and 2.0 µm, in a smaller space. Twins 130 mm apart turn by 0.1 / 130 about one another."""
    row = longer_rod()
    assert script.LONGER_M / 0.130 < row["tilt_mrad"] / 1e3 < 1.5 * script.LONGER_M / 0.130
    assert row["converged"] and 1 < row["fresh_um"] < 40


FEW = ("2-RPR at P", "3-RPR pose", "Delta")


@pytest.mark.thorough
@pytest.mark.parametrize("names", [FEW, pytest.param(tuple(RANKS), marks=pytest.mark.slow)], ids=["few", "all"])
def test_the_script_answers(names: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    cases = {name: case for name, case in script.CASES.items() if name in names}
    monkeypatch.setattr(script, "CASES", cases)
    monkeypatch.setattr(script, "FRESH", 40)
    monkeypatch.setattr(script, "PIXELS", 31)
    monkeypatch.setattr(script, "NOISELESS", ())
    monkeypatch.setattr(script, "EVERY", 1)
    monkeypatch.setattr(script, "longer_rod", longer_rod)
    found = answer_of("parallel_robots.py", "--robots", 2, "--readings", 200, "--out", tmp_path)
    table = found["table"]
    assert {name: (rows[0]["parameters"], rows[0]["rank"]) for name, rows in table.items()} == {
        name: RANKS[name] for name in names
    }
    for rows in table.values():
        assert len(rows) == 2 and rows[0]["rank"] == rows[1]["rank"] and all(row["converged"] for row in rows)
        assert 0.4 < np.median([row["ratio"] for row in rows]) < 3
        assert all(row["before_mm"] > 20 * row["fresh_um"] / 1e3 for row in rows)
    for row in found["six rods"]:
        assert row["rank_drawn"] == 38 and row["rank_copy"] == 51
        assert row["plain"]["converged"] and row["prior"]["converged"] and row["three rods"]["inadequate"]
        assert row["exact"]["fresh_um"] < 2 < row["prior"]["fresh_um"] < 20 < row["three rods"]["fresh_um"]
    for kind in ("png", "svg"):
        assert (tmp_path / f"singularities.{kind}").stat().st_size > 10_000
    assert any("of imperfect copies" in line for line in script.report(found))
    assert json.loads((tmp_path / "parallel_robots.json").read_text(encoding="utf-8")) == found


def test_one_robot_has_no_median(capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as stop:
        run_script("parallel_robots", ["--robots", "1"])
    assert stop.value.code == 2 and "two --robots or more" in capsys.readouterr().err
