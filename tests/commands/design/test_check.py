"""`lab design --check`: an earlier plan against a cell that has changed, and how long a day takes."""

import json
from pathlib import Path

import numpy as np
import pytest

from lab.cli.main import main
from lab.formats.programs.protocol import PAUSE_S
from lab.library.design import design
from lab.library.session_duration import SessionDuration
from lab.library.simulate import simulate
from lab.options.virtual_campaign import DesignOptions

BOX = """[[obstacle]]
name = "box"
shape = "box"
size_mm = [{0}]
position_mm = [{1}]
"""


WAYPOINTS = """id,use,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg
home,skip,0,0,0,0,0,0
1,calibrate,-40,10,0,0,40,0
via001,skip,0,-20,0,0,40,0
2,calibrate,50,-10,10,0,30,0
home_again,skip,0,0,0,0,0,0
"""
SEES_ALL = '[reflector]\nkind = "other"\nacceptance_deg = 179\n'


@pytest.fixture
def plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A plan of two poses, in the working folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "plan.csv").write_text(WAYPOINTS)
    (tmp_path / "cell.toml").write_text(SEES_ALL)
    return tmp_path / "run"


def checked(plan: Path, capsys: pytest.CaptureFixture[str], *flags: str) -> tuple[int, dict]:
    code = main(["design", "--check", str(plan / "plan.csv"), *flags, "--json"])
    return code, json.loads(capsys.readouterr().out)


@pytest.mark.thorough
def test_a_plan_can_be_run_where_it_was_made(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = design(DesignOptions("course2r", candidates=40, starts=1, poses=8))
    made.save(tmp_path / "run")
    code, found = checked(tmp_path / "run", capsys, "--robot", "course2r", "--out", str(tmp_path / "again"))
    assert code == 0 and found["good"] and found["faults"] == [] and found["poses"] == 8
    for key in ("tour_seconds", "day_seconds", "reference_measurements"):
        assert found[key] == pytest.approx(made.to_dict()[key], rel=1e-6)


@pytest.mark.thorough
def test_a_plan_with_its_reference_pose_is_measured_and_checked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its rows are named, its program waits as often, the day counts them once, and a simulated day has them all."""
    made = design(DesignOptions("irb120", candidates=60, starts=1, poses=12, reference_every=5))
    made.save(tmp_path / "run")
    code, found = checked(tmp_path / "run", capsys, "--out", str(tmp_path / "again"))
    day, length = simulate("irb120", plan=tmp_path / "run" / "plan.csv"), SessionDuration.of(made.tour)
    ids = [name for name, stop in zip(made.columns()["id"], made.columns()["stop"], strict=True) if stop == "measure"]
    assert [name for name in ids if "_" in name] == ["1_2", "1_3", "1_4"] and ids.index("1_2") == 5 and ids[-1] == "1_4"
    assert code == 0 and found["poses"] == 12 and length.references == found["reference_measurements"] == 4
    assert found["day_seconds"] == pytest.approx(length.seconds, abs=0.1)
    assert length.seconds == pytest.approx(1800 + made.tour.seconds + 15 * PAUSE_S)
    assert len(day.measurements) == 15
    again = day.measurements.joints[[ids.index(name) for name in ("1", "1_2", "1_3", "1_4")]]
    np.testing.assert_allclose(again, again[:1].repeat(4, axis=0), atol=1e-12)
    assert (tmp_path / "run" / "plan.mod").read_text().count("WaitTime") == 15


def test_an_obstacle_that_came_later_is_found(plan: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("wall.toml").write_text(SEES_ALL + BOX.format("2000, 2000, 100", "0, 0, 500"))
    assert checked(plan, capsys, "--cell", "cell.toml", "--out", "free")[0] == 0
    code, found = checked(plan, capsys, "--cell", "wall.toml", "--out", "wall")
    assert code == 1 and not found["good"]
    assert {fault["stop"] for fault in found["faults"]} == {"home", "1", "via001", "2", "home_again"}
    assert all("wall" in fault["why"] or "box" in fault["why"] for fault in found["faults"])


def test_narrower_limits_are_found(plan: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("narrow.toml").write_text(SEES_ALL + "[joints.q1]\nlower_deg = -45\nupper_deg = 45\n")
    code, found = checked(plan, capsys, "--cell", "narrow.toml", "--out", "narrow")
    assert code == 1 and [fault["stop"] for fault in found["faults"]] == ["2"]


def test_a_thin_wall_between_two_stops_is_found(plan: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Both stops are free, the way between them is not: the arm turns its first joint through a wall."""
    Path("two.csv").write_text("id,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\na,-40,0,0,0,30,0\nb,40,0,0,0,30,0\n")
    Path("wall.toml").write_text(SEES_ALL + BOX.format("300, 10, 900", "400, 0, 450"))
    assert main(["design", "--check", "two.csv", "--cell", "wall.toml", "--out", "w", "--json"]) == 1
    faults = json.loads(capsys.readouterr().out)["faults"]
    assert faults == [{"stop": "b", "why": "the path to it from a does not keep the clearances"}]


@pytest.mark.parametrize(
    ("flags", "told"),
    [("--check nowhere.csv", "nowhere.csv"), ("--check {plan} --no-check", "--no-check"),
     ("--check {plan} --extend {plan}", "--extend"), ("--check {plan} --controller rapid", "--controller"),
     ("--reference-every 0", "-every"),
     ("--check {plan} --robot scara", "joint q3 is a slide"),
     ("--check skip.csv", "no waypoint is to be measured"), ("--check {plan} --cell none.toml", "none.toml")],
)  # fmt: skip
def test_mistakes_are_told_in_one_line(plan: Path, capfd, flags: str, told: str) -> None:
    Path("skip.csv").write_text("use,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\nskip,0,0,0,0,0,0\n")
    assert main(["design", *flags.format(plan=plan / "plan.csv").split(), "--out", "bad"]) == 2
    err = capfd.readouterr().err
    assert told in err and len(err.strip().splitlines()) == 1 and not Path("bad").exists()


def test_a_day_is_warm_up_moves_pauses_and_references() -> None:
    day = SessionDuration(30, 62.0)
    assert day.references == 4  # first, after 10 and 20, and last
    assert day.seconds == pytest.approx(1800 + 62 + 30 * PAUSE_S + 4 * (2 * 2.0 + PAUSE_S))
    assert np.isclose(SessionDuration(1, 4.0).references, 2) and "warm-up" in day.description
