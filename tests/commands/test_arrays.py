"""From arrays: the same answers as from files, and wrong arrays refused in one line."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow
import pytest
from helpers.campaigns import session

import lab
from lab.core.measurements import Measurements
from lab.library.given_measurements import measurements, robot_from_dh

TABLE = [
    [0, 290, 0, -90], [-90, 0, 270, 0], [0, 0, 70, -90], [0, 302, 0, 90], [0, 0, 0, -90], [180, 72, 0, 0],
]  # fmt: skip


@pytest.fixture(scope="module")
def day() -> Measurements:
    return session(poses=30, seed=3).measurements


def test_arrays_in_other_units_and_shapes_are_the_same_measurements(day: Measurements) -> None:
    in_mm, in_degrees = 1e3 * day.points[:, 0], np.rad2deg(day.joints)
    own = measurements(in_degrees.tolist(), in_mm, robot="irb120", unit="mm", joint_unit="deg")
    np.testing.assert_allclose(own.joints, day.joints, atol=1e-14)
    np.testing.assert_allclose(own.points, day.points, atol=1e-14)
    assert own.robot == day.robot and own.targets == day.targets
    same = measurements(day.joints, day.points, robot=lab.load_robot("irb120"))
    assert same.points.shape == (30, 1, 3) and (same.points == day.points).all()


def test_slides_are_in_the_unit_of_lengths() -> None:
    day = session("versatran", poses=30, seed=3).measurements
    slides = np.array(lab.load_robot("versatran").chain.prismatic)
    scaled = np.where(slides, 1e3 * day.joints, np.rad2deg(day.joints))
    own = measurements(scaled, 1e3 * day.points, robot="versatran", unit="mm", joint_unit="deg")
    np.testing.assert_allclose(own.joints, day.joints, atol=1e-13)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("observe", ["pose", "cable", "plane"])
def test_other_observations_are_made_of_arrays(observe: str) -> None:
    day = session(poses=60, seed=5, observe=observe).measurements
    given = {"points": day.points} if day.targets else {}
    if observe == "pose":
        quaternions = np.array([[float(x) for x in day.other[f"p1_q{c}"]] for c in "wxyz"]).T
        given["orientations"] = lab.core.se3.rotation_from_quaternion(quaternions)
    else:
        given["columns"] = dict(day.other)
    assert measurements(day, robot="irb120") == day, "as one table"
    own = measurements(day.joints, robot="irb120", conditions=day.conditions, sessions=day.sessions, **given)
    ours, theirs = (lab.identify(each, observe=observe).identification.values for each in (own, day))
    np.testing.assert_allclose(ours, theirs, atol=1e-8)


def test_missing_points_and_what_is_told_of_rows(day: Measurements) -> None:
    points = day.points[:, 0].copy()
    points[3, 1] = np.nan
    own = measurements(
        day.joints, points, robot="irb120", targets=["nest"], ids=range(10, 40), use=["calibrate"] * 25 + ["test"] * 5,
        sessions=["a"] * 30, sigma=0.01, conditions={"temp_C": 20.0},
    )  # fmt: skip
    assert own.targets == ("nest",) and own.ids[0] == "10" and own.marked and not own.seen[3, 0]
    assert (own.sigma_m == 0.01).all() and (own.conditions["temp_C"] == 20).all() and own.sessions[0] == "a"
    assert len(own.only("test")) == 5


@pytest.mark.parametrize("robot", ["irb120", "versatran"])
def test_a_table_of_columns_is_read_back_the_same(robot: str) -> None:
    """By a mapping, by Arrow, and by the columns of a file."""
    day = session(robot, poses=30, seed=3).measurements
    points = day.points.copy()
    points[3] = np.nan
    day = replace(
        day, points=points, use=("calibrate", "test") * 15, marked=True, ids=tuple(f"P{i}" for i in range(30)),
        sessions=("", "b") * 15, sigma_m=np.linspace(1e-5, 3e-5, 30), other={"station": ("A",) * 30},
        conditions={"temp_C": np.linspace(20, 25, 30), "approach_q1": np.tile([1.0, -1.0], 15)}, warnings=(),
    )  # fmt: skip
    for table in (day.columns(), pyarrow.table(day), day):
        assert measurements(table, robot=robot) == day
    in_mm = {name: 1e3 * column if "." in name else column for name, column in day.columns().items()}
    with pytest.raises(lab.LabError, match=r"divide them by 1000"):
        measurements(in_mm, robot=robot)


def test_a_table_is_read_as_the_file_that_it_is_written_to(day: Measurements, tmp_path: Path) -> None:
    lab.write_measurements(tmp_path / "day.csv", day)
    lines = [line.split(",") for line in (tmp_path / "day.csv").read_text().splitlines()]
    table = {name: [*map(float, cells)] for name, cells in zip(lines[0], zip(*lines[1:], strict=True), strict=True)}
    table["humidity"] = list(range(30))
    own = measurements(table, robot="irb120", ids=range(5, 35), conditions={"temp_C": 20.0})
    np.testing.assert_array_equal(own.joints, day.joints)
    np.testing.assert_allclose(own.points, day.points, rtol=1e-15)
    assert own.ids[0] == "5" and own.conditions["temp_C"][3] == 20
    assert own.conditions["humidity"].tolist() == list(range(30)), "numbers of an effect of one's own"


WRONG_TABLES = {
    "no joint": ({"q2": None}, r"^lab.measurements: joint q2 is missing; .* give q2_rad or q2_deg"),
    "joint in another unit": ({"q2": None, "q2_mm": 0.0}, "joint q2 is a revolute joint, in deg or rad"),
    "joint without a number": ({"q2": np.nan}, r"^lab.measurements: row 0, column q2_rad: the cell is empty"),
    "infinite joint": ({"q2": np.inf}, r"row 0, column q2_rad: 'inf' is not a finite number"),
    "joint in words": ({"q2": "left"}, r"row 0, column q2_rad: 'left' is not a number"),
    "axis missing": ({"p1.y": None}, r"^lab.measurements: target p1 has no y; give p1_y_mm"),
    "half a point": ({"p1.y": np.nan}, r"row 0, column p1_y_m: empty beside other coordinates"),
    "point in inches": ({"p1.y": None, "p1_y_in": 1.0}, "column p1_y_in: unknown unit or axis"),
    "unknown use": ({"use": "fit"}, r"row 0, column use: 'fit' is unknown"),
    "one id": ({"id": "a"}, "row 1, column id: 'a' is also the id of row 0"),
    "no noise": ({"sigma_m": 0.0}, "row 0, column sigma_mm: not above zero"),
    "payload in grams": ({"payload_kg": 2500.0}, r"row 0, column payload_kg: outside 0 to 1,000 kg"),
    "two rows": ({"use": np.array(["test"] * 2)}, "columns have 2 and 30 rows"),
    "a matrix": ({"temp_C": np.zeros((30, 2))}, r"column temp_C has shape \(30, 2\)"),
}


@pytest.mark.parametrize("wrong", WRONG_TABLES)
def test_a_wrong_table_is_refused_as_a_file_is(day: Measurements, wrong: str) -> None:
    change, message = WRONG_TABLES[wrong]
    table = {name: column for name, column in day.columns().items() if name not in change}
    for name, cell in change.items():
        if cell is not None:
            table[name] = cell if isinstance(cell, np.ndarray) else np.array([cell] * 30)
    with pytest.raises(lab.LabError, match=message) as caught:
        measurements(table, robot="irb120")
    assert "\n" not in str(caught.value)


def test_a_table_in_degrees_is_told_so(day: Measurements) -> None:
    names = day.joint_names
    degrees = {**day.columns(), **{name: np.rad2deg(day[name]) for name in names}}
    assert np.allclose(measurements(degrees, robot="irb120", joint_unit="deg").joints, day.joints, atol=1e-14)
    with pytest.raises(lab.LabError, match="give joint_unit='deg'"):
        measurements(degrees, robot="irb120")
    with pytest.raises(lab.LabError, match="leave out targets"):
        measurements(day, robot="irb120", targets=("p1",))


WRONG = {
    "another number of joints": ({"joints": np.zeros((30, 5))}, r"robot .* has 6 joints; give one row of 6 numbers"),
    "no pose": ({"joints": np.zeros((0, 6)), "points": np.zeros((0, 3))}, r"joints have no rows; give one row of 6"),
    "complex points": ({"points": np.full((30, 3), 1j)}, "^points: complex numbers; give real ones"),
    "infinite points": ({"points": np.full((30, 3), np.inf)}, r"points\[0\] is not finite; give NaN"),
    "another number of rows": ({"points": np.zeros((29, 3))}, r"points have shape \(29, 3\); give \(30, 3\)"),
    "a flat array": ({"points": np.zeros(90)}, r"points have shape \(90,\)"),
    "ragged rows": ({"joints": [[0.0], [1.0, 2.0]]}, r"^joints: not numbers in rows of one length"),
    "not finite": ({"joints": np.full((30, 6), np.nan)}, r"joints\[0, 0\] is nan"),
    "words": ({"points": [["a", "b", "c"]] * 30}, r"^points: not numbers"),
    "an unknown unit": ({"unit": "inch"}, r"^unit is 'inch'; give 'm' or 'mm'"),
    "names": ({"targets": ("a", "b")}, r"targets are a, b, but points have 1"),
    "uses": ({"use": ["fit"] * 30}, r"use 'fit' is unknown"),
    "ids": ({"ids": ["1"]}, r"ids has 1 entries; give 30"),
    "orientations": ({"orientations": np.zeros((30, 3, 3))}, r"orientations\[0\] is no rotation matrix"),
    "mirrored ones": ({"orientations": np.broadcast_to(-np.eye(3), (30, 3, 3))}, r"is no rotation matrix"),
    "noise": ({"sigma": np.zeros(7)}, r"sigma has shape \(7,\)"),
    "a robot that is not there": ({"robot": "irb12"}, r"irb120"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_arrays_are_refused_in_a_line(day: Measurements, wrong: str) -> None:
    given, message = WRONG[wrong]
    with pytest.raises(lab.LabError, match=message) as caught:
        measurements(**{"joints": day.joints, "points": day.points, "robot": "irb120", **given})
    assert "\n" not in str(caught.value)


def test_other_units_than_those_said_are_refused(day: Measurements) -> None:
    with pytest.raises(lab.LabError, match=r"in another unit|divide them by 1000"):
        measurements(day.joints, 1e3 * day.points, robot="irb120")
    with pytest.raises(lab.LabError, match=r"joint_unit='deg'"):
        measurements(np.rad2deg(day.joints), day.points, robot="irb120")


def test_a_robot_of_a_table_is_that_of_its_file(tmp_path: Path) -> None:
    tool = {"p1": [60.0, 0.0, 40.0]}
    arm = robot_from_dh(TABLE, unit="mm", joint_unit="deg", tool=tool, path=tmp_path / "own.toml", name="own")
    in_metres = np.array(TABLE) * [np.pi / 180, 1e-3, 1e-3, np.pi / 180]
    again = robot_from_dh(in_metres, tool={"p1": [0.06, 0.0, 0.04]})
    np.testing.assert_allclose(again.serial_model.chain.table, arm.serial_model.chain.table, atol=1e-15)
    assert lab.load_robot(tmp_path / "own.toml") == arm and arm.name == "own"
    assert lab.calibrate(arm, poses=40, seed=1).to_dict()["verdict"] == "good"


def test_a_robot_of_a_table_moves_as_the_one_that_has_it() -> None:
    """Distances between poses of a target, which no base changes."""
    known = lab.load_robot("irb120")
    chain = known.serial_model.chain
    own = robot_from_dh(
        chain.table[:, :4], convention=chain.convention, tool=dict(known.tool),
        limits=np.stack([chain.lower, chain.upper], axis=1),
    )  # fmt: skip
    assert (chain.sign == 1).all() and (own.chain.lower == chain.lower).all()
    joints = np.random.default_rng(0).uniform(-1, 1, (8, 6))
    ours, theirs = (
        np.linalg.norm(np.diff(arm.points(joints, arm.nominal(robot.tool))[:, 0], axis=0), axis=1)
        for robot in (own, known)
        for arm in (robot.arm(("p1",)),)
    )
    np.testing.assert_allclose(ours, theirs, atol=1e-14)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"table": np.zeros((6, 3))}, r"shape \(6, 3\); give a row of four finite numbers"),
        ({"convention": "denavit"}, r"give 'distal' or 'craig'"),
        ({"prismatic": [True] * 6}, r"a slide needs its limits"),
        ({"prismatic": [True]}, r"prismatic has 1 entries"),
        ({"limits": np.zeros((6, 2))}, r"the lower limit and then the upper one"),
        ({"tool": {"p1": [0.0]}}, r"tool\['p1'\] has shape \(1,\)"),
        ({"path": "/nowhere/at/all.toml"}, r"cannot be written"),
    ],
)
def test_wrong_tables_are_refused_in_a_line(given: dict[str, object], message: str) -> None:
    with pytest.raises(lab.LabError, match=message) as caught:
        robot_from_dh(**{"table": np.array(TABLE) * 1e-3, **given})  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


@pytest.mark.thorough
def test_a_robot_without_a_path_leaves_no_file_as_python_ends(tmp_path: Path) -> None:
    code = "import lab; [lab.robot_from_dh([[0, 0.4, 0, 1], [0, 0, 0.3, 0]]) for _ in range(2)]"
    subprocess.run([sys.executable, "-c", code], env=os.environ | {"TMPDIR": str(tmp_path)}, check=True)
    assert list(tmp_path.iterdir()) == []
