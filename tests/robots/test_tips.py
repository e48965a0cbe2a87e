"""Robots by base and tips: references, runs that keep them, and identification that judges every tip."""

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.robots import ROOT

import lab
from lab.calibration.gauss_newton import Observations
from lab.calibration.guess import initial_guess
from lab.cli.main import main
from lab.core.errors import LabError
from lab.core.limits import checked_target
from lab.robots.load_robot import load_robot
from lab.robots.robot_files import ends_of, joined, parted

TORSO = ROOT / "models" / "torso" / "robot.xml"
BOTH = ("left.p1", "right.p1")


@pytest.mark.parametrize(
    ("base", "tips", "reference"),
    [
        ("", ("a",), "x.urdf#a"),
        ("", ("a", "b"), "x.urdf#a,b"),
        ("hip", ("a",), "x.urdf#hip:a"),
        ("hip", (), "x.urdf#hip:"),
    ],
)
def test_a_reference_is_read_as_it_was_written(base: str, tips: tuple[str, ...], reference: str) -> None:
    assert joined("x.urdf", base, tips) == reference
    name, ends = parted(reference)
    assert name == "x.urdf" and ends_of(ends) == (base, tips)
    assert parted("x.urdf") == ("x.urdf", "") and joined("x.urdf", "", ()) == "x.urdf"


def test_a_file_whose_name_has_the_mark_is_itself(tmp_path: Path) -> None:
    path = tmp_path / "a#b.xml"
    path.write_text(TORSO.read_text(encoding="utf-8"), encoding="utf-8")
    assert parted(str(path)) == (str(path), "")
    assert load_robot(path).model.chain.tips == ("left", "right")


@pytest.mark.parametrize(
    ("robot", "base", "tips", "says"),
    [
        ("torso#left", "", ("right",), "names its tips already"),
        ("torso", "", ("left", "left"), "name each tip once"),
        ("torso", "", ("a,b",), "cannot name a base or a tip"),
        ("torso", "", ("",), "an empty name"),
        ("ur10", "", ("q1",), "is a table"),
    ],
)
def test_a_reference_that_cannot_be(robot: str, base: str, tips: tuple[str, ...], says: str) -> None:
    with pytest.raises(LabError, match=says):
        load_robot(robot, tips=tips, base=base)


def test_a_loaded_robot_has_its_tips() -> None:
    with pytest.raises(LabError, match="is loaded already"):
        load_robot(load_robot("torso"), tips=("left",))
    whole, one = load_robot("torso"), load_robot("torso", tips=("left",))
    assert whole.sha256 != one.sha256 and one.source == "torso#left"
    assert whole.on_tips(("p1", "left.p2")) == ("left.p1", "right.p1", "left.p2")
    assert one.on_tips(("p1",)) == ("p1",)


@pytest.mark.parametrize("name", ["left.p1", "left_tool0.p1", "p1"])
def test_names_of_targets(name: str) -> None:
    assert checked_target("file.csv", name) == name


@pytest.mark.parametrize("name", ["left.p1.x", "left.", ".p1", "a/b.p1", "=left.p1"])
def test_names_that_are_no_targets(name: str) -> None:
    with pytest.raises(LabError, match="name"):
        checked_target("file.csv", name)


@pytest.mark.thorough
def test_a_run_keeps_a_robot_with_tips(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The run holds a copy of the file, by which it is read when the file is gone."""
    given, out = tmp_path / "dual.xml", tmp_path / "run"
    given.write_text(TORSO.read_text(encoding="utf-8"), encoding="utf-8")
    tips = ["--tip", "left_hand", "--tip", "right_hand"]
    flags = ["--poses", "40", "--no-recording", "--out", str(out)]
    assert main(["calibrate", "--robot", str(given), *tips, *flags]) == 0
    assert json.loads((out / "config.json").read_text())["options"]["robot"] == f"{given}#left_hand,right_hand"
    given.unlink()
    capsys.readouterr()
    run = lab.load_run(out)
    assert run.robot.model.chain.tips == ("left_hand", "right_hand")
    joints = run.robot.chain.random_joints(3, np.random.default_rng(0))
    assert run.estimate.points(joints).shape == (3, 2, 3)
    wanted = run.estimate.points(joints)[:, 1]
    header = "id," + ",".join(f"right_hand.p1_{axis}_mm" for axis in "xyz")
    lines = [header, *(f"{i}," + ",".join(str(1e3 * x) for x in row) for i, row in enumerate(wanted))]
    (tmp_path / "targets.csv").write_text("\n".join(lines), encoding="utf-8")
    found = lab.compensate(tmp_path / "targets.csv", run=out, no_check=True)
    assert found.to_dict()["targets"] == 3 and all(found.found.converged)
    np.testing.assert_allclose(run.estimate.points(found.found.joints)[:, 1], wanted, atol=1e-8)


def test_both_tips_are_placed_without_initial_values() -> None:
    robot = load_robot("torso")
    arm = robot.arm(BOTH)
    rng = np.random.default_rng(1)
    values = arm.nominal(robot.tool)
    values[:6], values[-6:] = rng.standard_normal(6), 0.1 * rng.standard_normal(6)
    joints = robot.chain.random_joints(20, rng)
    points = arm.points(joints, values)
    points[::2, 0] = np.nan  # in turns
    points[1::2, 1] = np.nan
    observed = Observations(joints, points, np.ones(points.shape[:2]))
    found = initial_guess(arm, observed, arm.nominal())
    np.testing.assert_allclose(arm.points(joints, found), arm.points(joints, values), atol=1e-9)


@pytest.mark.thorough
def test_the_prediction_is_of_every_tip() -> None:
    """A hand that was measured in few poses is in what is predicted, whichever target is named first."""
    data = lab.simulate("torso", poses=60, seed=5, targets=BOTH).measurements
    points = data.points.copy()
    points[25:, 1] = np.nan
    predicted = []
    for given, order in ((data.points, (0, 1)), (points, (0, 1)), (points, (1, 0))):
        targets = tuple(data.targets[i] for i in order)
        rows = lab.measurements(data.joints, given[:, list(order)], targets=targets, robot="torso")
        predicted.append(lab.identify(rows, instrument="uniform-8um").to_dict()["predicted_95_mm"])
    assert predicted[1] > 1.2 * predicted[0]
    assert predicted[2] == pytest.approx(predicted[1], rel=1e-6)


@pytest.mark.thorough
def test_orientations_of_either_tip() -> None:
    """The tool's rotation is that of the tip of the target whose orientation is measured, and near its truth."""
    for targets in (BOTH, BOTH[::-1]):
        options = {"observe": "pose", "instrument": "leica-at960", "poses": 40, "seed": 2, "no_recording": True}
        values = lab.calibrate("torso", targets=targets, **options).to_dict()
        assert values["verdict"] == "good" and values["rank"] == 63 and values["truth"]["coverage_95"] > 0.8
