"""Measurements in memory: the robot follows from them or is asked for, and points in another unit are refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.campaigns import identification, run_of, session

import lab
from lab.cli.main import main
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured


@pytest.fixture(scope="module")
def days() -> dict[str, Measurements]:
    return {name: session(name, poses=30, seed=3).measurements for name in ("irb120", "rx130", "versatran")}


def of_nobody(data: Measurements) -> Measurements:
    """The same as a program has them that made them itself: it knows no more than arrays."""
    return measured(data.joint_names, data.joints, data.targets, data.points)


def test_identify_takes_the_robot_that_was_measured(days: dict[str, Measurements]) -> None:
    robot = "versatran"
    found = lab.identify(days[robot][:29], instrument="uniform-8um")
    assert found.to_dict()["robot"] == robot and found.to_dict()["after_mm"]["mean"] < 0.1
    assert found.measurements.robot == robot


def test_identify_asks_for_a_robot_that_nobody_names(days: dict[str, Measurements]) -> None:
    with pytest.raises(lab.LabError, match=r"^lab.identify: .* give robot="):
        lab.identify(of_nobody(days["rx130"]))


@pytest.mark.parametrize("robot", ["scara", "hexapod", "irb120"])
def test_another_robot_is_refused(days: dict[str, Measurements], robot: str, tmp_path) -> None:
    """By the number of its joints, their names, or what kind they are."""
    for call in (lab.identify, lambda data, robot: lab.write_measurements(tmp_path / "day.csv", data, robot)):
        with pytest.raises(lab.LabError, match=r"take the right robot$") as caught:
            call(days["versatran"], robot)
        assert "\n" not in str(caught.value) and not list(tmp_path.iterdir())


def test_slides_are_written_as_lengths(days: dict[str, Measurements], tmp_path) -> None:
    file, data = tmp_path / "day.csv", days["versatran"]
    lab.write_measurements(file, data)
    assert file.read_text().startswith("q1_rad,q2_mm,q3_mm,q4_rad")
    read = lab.read_measurements(file, "versatran")
    assert read.robot == "versatran" and (read.joints == data.joints).all()
    with pytest.raises(lab.LabError, match=r"^lab.write_measurements: .* robot"):
        lab.write_measurements(file, of_nobody(data))
    before = file.read_bytes()
    lab.write_measurements(file, of_nobody(data), "versatran")
    assert file.read_bytes() == before


@pytest.mark.parametrize(
    ("per_m", "message"),
    [
        (1000, "divide them by 1000, since they are in mm"),
        (100, "divide them by 100, since they are in cm"),
        (1 / 0.0254, r"divide them by 39\.37, since they are in inches"),
        (1e6, "are in m: convert them"),
    ],
)
def test_points_in_another_unit_are_refused(days: dict[str, Measurements], per_m: float, message: str) -> None:
    data = days["irb120"]
    other = replace(data, points=per_m * data.points)
    for call in (
        lambda: lab.identify(data, validate=other),
        lambda: lab.verify(identification(data, instrument="uniform-8um"), other),
        lambda: lab.measurements(other.joints, other.points, robot="irb120"),
    ):
        with pytest.raises(lab.LabError, match=rf"points in memory .*{message}") as caught:
            call()
        assert "\n" not in str(caught.value)
    assert lab.verify(identification(data, instrument="uniform-8um"), data).good


@pytest.mark.parametrize(("per_m", "unit"), [(1000, "mm"), (100, "cm"), (1 / 0.0254, "inches")])
def test_points_in_another_unit_are_named_and_undone_by_consent(
    days: dict[str, Measurements], per_m: float, unit: str
) -> None:
    data = days["irb120"]
    other = replace(data, points=per_m * data.points)
    found = lab.identify(other, instrument="uniform-8um")
    assert found.verdict.word == "bad" and [each.hypothesis.key for each in found.diagnosis] == [f"point_unit:{unit}"]
    undone = lab.identify(other, instrument="uniform-8um", accept="point_unit")
    assert undone.values == pytest.approx(identification(data, instrument="uniform-8um").values, abs=1e-9)


def test_points_in_feet_that_no_unit_explains_are_left_to_the_verdict(days: dict[str, Measurements]) -> None:
    feet = replace(days["irb120"], points=days["irb120"].points / 0.3048)
    assert lab.identify(feet, instrument="uniform-8um").to_dict()["verdict"] == "bad"


def test_joints_in_degrees_and_of_no_number_are_refused(days: dict[str, Measurements]) -> None:
    data = days["versatran"]
    slides = np.array(lab.load_robot("versatran").chain.prismatic)
    degrees = replace(data, joints=np.where(slides, data.joints, np.rad2deg(data.joints)))
    for call in (lambda: lab.identify(degrees), lambda: lab.identify(data, validate=degrees)):
        with pytest.raises(lab.LabError, match=r"memory: .* give np\.deg2rad\(joints\)") as caught:
            call()
        assert "\n" not in str(caught.value)
    with pytest.raises(lab.LabError, match=r"joints\[0, 0\] \(q1\) is nan; give a finite number"):
        replace(data, joints=np.full_like(data.joints, np.nan))


@pytest.mark.parametrize("call", ["identify", "fit", "validate", "verify"])
def test_no_rows_are_refused_in_a_line(days: dict[str, Measurements], call: str) -> None:
    none, day = days["irb120"][0:0], days["irb120"]
    with pytest.raises(lab.LabError, match=r"the measurements have no rows; give some$"):
        match call:
            case "identify":
                lab.identify(none)
            case "fit":
                lab.fit(none)
            case "validate":
                lab.identify(day, validate=none)
            case "verify":
                lab.verify(identification(day), none, force=True)


def test_complex_points_are_refused(days: dict[str, Measurements]) -> None:
    with pytest.raises(lab.LabError, match="points are complex numbers; give real ones"):
        replace(days["irb120"], points=days["irb120"].points + 0j)


def test_a_frame_that_is_far_away_is_no_other_unit(days: dict[str, Measurements]) -> None:
    """Points are compared by how they spread in each session and from each station, not by where they are."""
    data, half = days["irb120"], np.arange(30) < 15
    away = np.where(half[:, None, None], [0.0, 0, 0], [900.0, 0, 0])
    apart = replace(data, points=data.points + away, other={"station": tuple(np.where(half, "A", "B").tolist())})
    assert lab.identify(apart, instrument="uniform-8um").to_dict()["after_mm"]["mean"] < 0.1


@pytest.mark.thorough
def test_a_file_of_a_run_has_the_run_s_robot_and_another_one_is_asked_for(tmp_path: Path) -> None:
    """By calls and by the command; the default robot is none of data that name theirs."""
    file = run_of("versatran", poses=30, seed=3) / "measurements.csv"
    assert lab.read_measurements(file).robot == "versatran"
    found = lab.identify(file, holdout=0.3)
    assert found.robot.name == "versatran" and found.options.robot == "versatran"
    assert main(["identify", str(file), "--no-recording", "--out", str(tmp_path / "again")]) in (0, 3)
    assert lab.load_run(tmp_path / "again").options.robot == "versatran"
    with pytest.raises(LabError, match=r"versatran|joint"):
        lab.identify(file, robot="irb120")
    bare = tmp_path / "bare.csv"
    bare.write_bytes(file.read_bytes())
    for call in (lab.identify, lab.read_measurements, lab.dynamics, lab.payload):
        with pytest.raises(LabError, match=rf"^lab\.{call.__name__}: .*bare.csv names no robot; give robot="):
            call(bare)
    with pytest.raises(LabError, match=r"^lab.import_measurements: .* names no robot; give robot="):
        lab.import_measurements(bare, joints=bare)
