"""What the library gives is a value: it is pickled, copied and compared, and prints shortly."""

import copy
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow
import pytest
from helpers.campaigns import calibration, run_of, session
from helpers.recordings import rrd
from helpers.robots import MODELS

import lab
from lab.formats.target_csv import Targets

MADE: dict[str, Callable[[Path], Any]] = {
    "robot": lambda run: lab.load_robot("irb120"),
    "mechanism": lambda run: lab.load_robot("delta"),
    "instrument": lambda run: lab.instrument("leica-at960"),
    "session": lambda run: session(poses=20, seed=3),
    "targets": lambda run: Targets("p1", ("1",), np.ones((1, 3)), np.full((1, 3, 3), np.nan), np.full((1, 6), np.nan)),
    "calibrate": lambda run: calibration(poses=30, seed=3),
    "estimate": lambda run: lab.load_estimate(run),
    "run": lambda run: lab.load_run(run),
    "inspect": lambda run: lab.inspect("irb120"),
    "predict": lambda run: lab.predict(np.zeros((2, 6)), run),
    "verify": lambda run: lab.verify(run, session(poses=20, seed=3).measurements, refit=("base", "tool")),
    "solve_kinematics": lambda run: lab.solve_kinematics("irb120", joints=(0.0,) * 6),
}


@pytest.fixture(scope="module")
def run() -> Path:
    return run_of(poses=30, seed=3)


@pytest.mark.parametrize("name", MADE)
def test_it_is_pickled_copied_compared_and_printed(name: str, run: Path) -> None:
    made = MADE[name](run)
    for again in (pickle.loads(pickle.dumps(made)), copy.deepcopy(made)):
        assert again == made and again is not made
    assert len(repr(made)) < 150 and "\n" not in repr(made) and len(str(made).splitlines()) >= 1
    assert made._repr_html_().startswith("<table>")


@pytest.mark.parametrize("robot", ["irb120", "hexapod", "scara"])
def test_a_session_is_pickled_without_meshes_and_measures_the_same(robot: str) -> None:
    """What is not in the robot's files is a few hundred numbers; exact points follow from them to the bit."""
    made = session(robot, poses=20, seed=3)
    kept = pickle.dumps(made)
    again = pickle.loads(kept)
    assert len(kept) < 100e3 and again == made
    joints = made.measurements.joints
    targets = made.measurements.targets
    np.testing.assert_array_equal(again.true_robot.points(joints, targets), made.true_robot.points(joints, targets))
    assert len(pickle.dumps(made.measurements)) < 10e3


@pytest.mark.thorough
def test_a_session_has_the_same_validation_poses_in_another_process(tmp_path: Path) -> None:
    made = session(poses=20, seed=3)
    (tmp_path / "session.pickle").write_bytes(pickle.dumps(made))
    there = "import pickle, sys; print(pickle.load(open(sys.argv[1], 'rb')).validation.points.tobytes().hex())"
    command = [sys.executable, "-c", there, str(tmp_path / "session.pickle")]
    shown = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    assert bytes.fromhex(shown.strip()) == made.validation.points.tobytes()


def test_what_differs_is_not_equal(run: Path) -> None:
    data = session(poses=20, seed=3).measurements
    moved = data.points.copy()
    moved[7, 0, 1] += 1e-9
    assert replace(data, points=moved) != data and data[:10] != data
    assert lab.load_robot("irb120") != lab.load_robot("tx40") != "tx40"
    assert lab.inspect("irb120") != lab.inspect("irb120", targets=("p2",))


def test_a_result_that_was_pickled_says_and_saves_the_same(tmp_path: Path) -> None:
    found = calibration(poses=30, seed=3)
    again = pickle.loads(pickle.dumps(found))
    assert again.summary() == found.summary() and again.to_dict() == found.to_dict()
    assert (again.save(tmp_path / "again") / "result.json").read_bytes() == (
        found.save(tmp_path / "first") / "result.json"
    ).read_bytes()


def test_a_robot_whose_files_changed_since_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "arm.toml"
    file.write_text((MODELS / "ur10" / "robot.toml").read_text())
    kept = pickle.dumps(lab.load_robot(file))
    assert pickle.loads(kept) == lab.load_robot(file)
    file.write_text(file.read_text() + "\n# another\n")
    with pytest.raises(lab.LabError, match="changed since it was pickled"):
        pickle.loads(kept)


def test_measurements_print_in_ten_lines_and_give_their_columns() -> None:
    data = session(poses=20, seed=3, targets=("p1", "p2")).measurements
    lines = str(data).splitlines()
    assert len(lines) == 10 and lines[0] == "20 poses of irb120, targets p1, p2" and lines[-1] == "and 13 further poses"
    columns = data.columns()
    assert [*columns][:10] == ["id", "q1", "q2", "q3", "q4", "q5", "q6", "p1.x", "p1.y", "p1.z"]
    np.testing.assert_array_equal(columns["p2.z"], data.points[:, 1, 2])
    pandas = pytest.importorskip("pandas")
    assert isinstance(data.to_frame(), pandas.DataFrame) and len(data.to_frame()) == 20


def test_measurements_and_results_are_arrow_tables() -> None:
    result = calibration(poses=20, seed=3, targets=("p1", "p2"))
    for each in (result.measurements, result):
        table, columns = pyarrow.table(each), each.columns()
        assert table.column_names == [*columns] and table.num_rows == len(next(iter(columns.values())))
    table = pyarrow.table(result.measurements)
    np.testing.assert_array_equal(table["p2.z"].to_numpy(), result.measurements.points[:, 1, 2])


def test_a_run_gives_back_its_estimate_and_its_calibrated_robot(run: Path) -> None:
    loaded = lab.load_run(run)
    assert loaded.estimate == lab.load_estimate(run) and isinstance(loaded.estimate, lab.Estimate)
    robot = lab.load_robot(loaded)
    assert robot == lab.load_robot(run) != lab.load_robot("irb120")
    apart = [
        np.linalg.norm(np.diff(each.points(np.array([[0.0] * 6, [0.5] * 6]))[:, 0], axis=0))
        for each in (robot, loaded.estimate)
    ]
    assert apart[0] == pytest.approx(apart[1], abs=1e-9)  # base and tool aside, the arms are one


def test_what_is_no_robot_and_no_measurements_is_refused_by_name() -> None:
    with pytest.raises(lab.LabError, match="a robot is given as int; give a name, a path, or a loaded robot"):
        lab.load_robot(3)  # type: ignore[arg-type]
    with pytest.raises(lab.LabError, match=r"measurements are given as ndarray; .* lab\.measurements"):
        lab.identify(np.zeros((3, 6)))  # type: ignore[arg-type]


def test_a_loaded_robot_is_as_good_as_its_name(tmp_path: Path) -> None:
    file = tmp_path / "points.csv"
    file.write_text("q1_deg,q2_deg\n0,-30\n90,0\n")
    calls: list[Callable[[Any], Any]] = [
        lambda robot: lab.trajectory(file, robot=robot),
        lambda robot: lab.solve_kinematics(robot, joints=(10.0, 20.0)),
        lambda robot: lab.inspect(robot),
    ]
    for call in calls:
        assert call(lab.load_robot("course2r")).to_dict() == call("course2r").to_dict()
    box = "carrier/cartesian"
    assert lab.workspace([lab.load_robot(box)], places=120) == lab.workspace(box, places=120)


class FakeViewer:
    """The widget of rerun-notebook, which keeps what it is sent."""

    def __init__(self, **size: object) -> None:
        self.size, self.sent = size, list[bytes]()

    def send_rrd(self, data: bytes) -> None:
        self.sent.append(data)


@pytest.mark.thorough
@pytest.mark.figures
def test_a_notebook_shows_the_recording_of_a_result_and_of_its_run(monkeypatch, tmp_path: Path) -> None:
    """Both are the file of the run, to the last number (its chunks have identifiers of their own)."""
    monkeypatch.setitem(sys.modules, "rerun_notebook", SimpleNamespace(Viewer=FakeViewer))
    result = lab.calibrate("irb120", poses=12, seed=3)
    folder = result.save(tmp_path / "run")
    (made,), (read,) = result.recording().sent, lab.load_run(folder).recording().sent
    assert read == (folder / "recording.rrd").read_bytes()
    (tmp_path / "made.rrd").write_bytes(made)
    done = rrd(os.environ, "compare", "--unordered", folder / "recording.rrd", tmp_path / "made.rrd")
    assert done.returncode == 0, done.stderr


def test_what_no_notebook_can_show_is_said_in_one_line(monkeypatch, run: Path, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "rerun_notebook", None)  # as where it is not installed
    loaded = lab.load_run(run)
    for make, message in (
        (loaded.recording, r"rerun_notebook.*not installed.*\[notebook\]"),
        (replace(loaded, folder=tmp_path).recording, "recording.rrd: cannot be read"),
        (lab.inspect("irb120").recording, "lab inspect has no recording"),
    ):
        with pytest.raises(lab.LabError, match=message) as caught:
            make()
        assert "\n" not in str(caught.value)
