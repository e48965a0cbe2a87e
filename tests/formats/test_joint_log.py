"""Joint positions of controllers: columns and units by their names, and one line for what cannot be told."""

from pathlib import Path

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.formats.joint_log import JointLog, read_joint_log
from lab.formats.loose_table import JointColumns

TWO, TURN = ("shoulder", "elbow"), (False, False)


def read(tmp_path: Path, text: str, columns: JointColumns = JointColumns(), unit: str | None = None) -> JointLog:  # noqa: B008
    (tmp_path / "log.csv").write_text(text)
    return read_joint_log(tmp_path / "log.csv", TWO, TURN, columns, unit)


@pytest.mark.parametrize(
    "header",
    ["shoulder_deg,elbow_deg", "q1 [deg],q2 [deg]", "J1 (°),J2 (°)", "A1 deg,A2 deg", "Joint 1 (deg),Joint 2 (deg)",
     "rax_1_deg,rax_2_deg"],
)  # fmt: skip
def test_joints_by_the_names_of_many_controllers(header: str, tmp_path: Path) -> None:
    log = read(tmp_path, f"name,{header}\nA,10,-20\nB,30,40\n")
    np.testing.assert_allclose(np.rad2deg(log.joints), [[10, -20], [30, 40]])
    assert log.names == ("A", "B")


def test_universal_robots_real_time_data_is_in_radians(tmp_path: Path) -> None:
    log = read(tmp_path, "timestamp actual_q_0 actual_q_1\n100.5 0.5 -0.25\n101.0 0.75 0.5\n")
    np.testing.assert_array_equal(log.joints, [[0.5, -0.25], [0.75, 0.5]])
    np.testing.assert_array_equal(log.seconds, [100.5, 101.0])


def test_a_slide_is_in_lengths(tmp_path: Path) -> None:
    (tmp_path / "l.csv").write_text("a_deg,b_mm\n10,250\n20,300\n")
    log = read_joint_log(tmp_path / "l.csv", ("a", "b"), (False, True), JointColumns(), None)
    np.testing.assert_allclose(log.joints[:, 1], [0.25, 0.3])


GOOD = "name,q1_deg,q2_deg\nA,10,20\nB,30,40\nC,5,6\n"
WRONG = {
    "no header": ("1,2\n3,4\n", {}, None, "no header"),
    "unit not said": ("q1,q2\n1,2\n3,4\n", {}, None, "--joint-unit"),
    "unit said twice": (GOOD, {}, "rad", "leave out"),
    "not a unit of angles": ("q1_mm,q2_mm\n1,2\n3,4\n", {}, None, "not a unit of angle"),
    "a joint is missing": ("q1_deg,q3_deg\n1,2\n3,4\n", {}, None, "no column is joint elbow"),
    "degrees as radians": ("q1_rad,q2_rad\n1,2\n90,4\n", {}, None, "header of the joints' columns to deg"),
    "radians as degrees": ("q1_deg,q2_deg\n1,2\n0.5,0.7\n-1,1\n", {}, None, "header of the joints' columns to rad"),
    "degrees given as radians": ("q1,q2\n1,2\n90,4\n", {}, "rad", "give --joint-unit deg"),
    "radians given as degrees": ("q1,q2\n1,2\n0.5,0.7\n-1,1\n", {}, "deg", "give --joint-unit rad"),
    "an empty cell": ("name,q1_deg,q2_deg,t\nA,10,20,1\nB,30,,2\n", {}, None, "line 3"),
    "one joint of two": (GOOD, {"joints": ("q1_deg",)}, None, "names 1 joints"),
    "one column twice": (GOOD, {"joints": ("2", "2")}, None, "two joints"),
    "no such column": (GOOD, {"joints": ("q1_deg", "q9")}, None, "no column 'q9'"),
    "no column of that number": (GOOD, {"joints": ("2", "7")}, None, "from 1 to 3"),
    "two of a joint": ("q1_deg,q1_deg,q2_deg\n1,2,3\n3,4,9\n", {}, None, "2 columns may be joint"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_be_understood_is_told_in_one_line(name: str, tmp_path: Path) -> None:
    text, columns, unit, told = WRONG[name]
    with pytest.raises(LabError) as error:
        read(tmp_path, text, JointColumns(**columns), unit)
    assert told in str(error.value) and "\n" not in str(error.value)


def test_the_advice_of_a_refused_unit_is_not_refused(tmp_path: Path) -> None:
    """Degrees under a header in rad: the option contradicts the header, so the header is to be corrected."""
    text = "q1_rad,q2_rad\n1,2\n90,4\n"
    with pytest.raises(LabError, match="correct the unit in the header"):
        read(tmp_path, text, JointColumns(), None)
    log = read(tmp_path, text.replace("_rad", "_deg"), JointColumns(), None)
    np.testing.assert_allclose(np.rad2deg(log.joints[1]), [90.0, 4.0])
