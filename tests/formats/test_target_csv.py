"""Targets from a file: positions, orientations where they matter, joints where they are given."""

from pathlib import Path

import numpy as np
import pytest
from helpers.robots import IRB120

from lab.core import se3
from lab.core.errors import LabError
from lab.formats.target_csv import read_targets

HEADER = "id,x_mm,y_mm,z_mm"


def read(tmp_path: Path, text: str, meaning=None, joints=IRB120.chain.joint_names, slides=IRB120.chain.prismatic):
    path = tmp_path / "targets.csv"
    path.write_text(text, encoding="utf-8")
    return read_targets(path, joints, slides, meaning)


def test_positions_and_orientations_are_read(tmp_path) -> None:
    text = f"{HEADER},qw,qx,qy,qz,payload_kg\na,1,2,3,1,0,0,0,3\nb,4,5,6,,,,,0\n"
    found = read(tmp_path, text)
    assert found.ids == ("a", "b") and found.tool == "p1" and found.lines == (2, 3)
    np.testing.assert_array_equal(found.positions, [[1e-3, 2e-3, 3e-3], [4e-3, 5e-3, 6e-3]])
    np.testing.assert_array_equal(found.rotations[0], np.eye(3))
    assert np.isnan(found.rotations[1]).all() and np.isnan(found.joints).all()
    np.testing.assert_array_equal(found.conditions["payload_kg"], [3.0, 0.0])
    some = read(tmp_path, f"{HEADER},use,comment\na,1,2,3,skip,no\nb,4,5,6,calibrate,yes\n")
    assert some.ids == ("b",) and some.lines == (3,) and len(some.positions) == len(some.warnings) == 1
    named = read(tmp_path, "p2_x_m,p2_y_m,p2_z_m\n1,2,3\n")
    assert named.tool == "p2" and named.ids == ("0",) and named.positions[0].tolist() == [1.0, 2.0, 3.0]


def test_angles_need_a_meaning(tmp_path) -> None:
    text = f"{HEADER},rx_deg,ry_deg,rz_deg\na,0,0,0,10,20,30\n"
    with pytest.raises(LabError, match=r"targets\.csv: columns rx_deg, ry_deg, rz_deg are angles: give --orientation"):
        read(tmp_path, text)
    x, y, z = (se3.exp(np.deg2rad(angle) * np.eye(3)[i]) for i, angle in enumerate((10, 20, 30)))
    np.testing.assert_allclose(read(tmp_path, text, "fixed-xyz").rotations[0], z @ y @ x, atol=1e-15)
    np.testing.assert_allclose(read(tmp_path, text, "intrinsic-xyz").rotations[0], x @ y @ z, atol=1e-15)


def test_orientations_and_joints_where_a_row_has_them(tmp_path) -> None:
    text = (
        "a_deg,slide_mm,tip_x_mm,tip_y_mm,tip_z_mm,tip_rx_deg,tip_ry_deg,tip_rz_deg\n90,100,0,0,0,90,0,0\n,,1,1,1,,,\n"
    )
    targets = read(tmp_path, text, "fixed-xyz", ["a", "slide"], [False, True])
    assert targets.tool == "tip"
    np.testing.assert_allclose(targets.joints[0], [np.pi / 2, 0.1])
    np.testing.assert_allclose(targets.rotations[0], se3.exp(np.array([np.pi / 2, 0, 0])), atol=1e-12)
    assert np.isnan(targets.joints[1]).all() and np.isnan(targets.rotations[1]).all()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("id,x,y,z\na,1,2,3\n", "column x: unknown unit or axis"),
        ("id,x_in,y_in,z_in\na,1,2,3\n", "column x_in: unknown unit"),
        ("id,x_mm,y_mm\na,1,2\n", "target p1 has no z"),
        (f"{HEADER}\na,1,2,\n", "line 2, column z_mm: empty"),
        (f"{HEADER}\na,1,2,3\nb,,,\n", "line 3, column x_mm: empty; give every target a position"),
        (f"{HEADER}\na,1,2,3\na,1,2,3\n", "line 3, column id: 'a' is also the id of line 2"),
        (f"{HEADER},qw,qx,qy,qz\na,1,2,3,1,0.1,0,0\n", "line 2, columns qw to qz: the quaternion's norm is 1.00499"),
        (f"{HEADER},qw,qx,qy,qz\na,1,2,3,1,0,0,\n", "line 2, column qz: empty beside others"),
        (f"{HEADER},qw,qx,qy\na,1,2,3,1,0,0\n", "column p1_qz is missing beside qw"),
        ("p1_x_mm,p1_y_mm,p1_z_mm,p2_x_mm,p2_y_mm,p2_z_mm\n1,2,3,4,5,6\n", "targets of p1, p2: give those of one"),
        ("id,payload_kg\na,3\n", "no target, in columns like x_mm"),
        (f"{HEADER},payload_kg\na,1,2,3,-1\n", "payload_kg: outside 0"),
        (f"{HEADER},q1_deg\na,1,2,3,4\n", "joint q2 is missing"),
        (f"{HEADER},q1\na,1,2,3,4\n", "unknown unit"),
        (f"{HEADER},q7_deg\na,1,2,3,4\n", "q7_deg is no joint of the robot"),
        (
            f"{HEADER},{','.join(f'q{i}_deg' for i in range(1, 7))}\na,1,2,3,1,2,,4,5,6\n",
            "line 2, column q3: empty beside other joints",
        ),
        ("x_mm,y_mm,z_mm,use\n1,2,3,skip\n", "every row has use = skip"),
        ("", "the file is empty"),
    ],
)
def test_a_file_that_is_none_is_told_in_one_line(tmp_path, text: str, words: str) -> None:
    with pytest.raises(LabError) as told:
        read(tmp_path, text)
    assert words in str(told.value) and str(told.value).startswith(str(tmp_path)) and "\n" not in str(told.value)
