"""Targets from a file: positions, orientations where they matter, joints where they are given."""

from pathlib import Path

import numpy as np
import pytest

from lab.core import se3
from lab.core.errors import LabError
from lab.formats.target_csv import Targets, read_targets


def read(folder: Path, text: str, meaning=None) -> Targets:
    path = folder / "targets.csv"
    path.write_text(text)
    return read_targets(path, ["a", "slide"], [False, True], meaning)


def test_a_position_is_enough(tmp_path: Path) -> None:
    targets = read(tmp_path, "id,x_mm,y_mm,z_mm,use\nA,1,2,3,test\nB,4,5,6,skip\nC,7,8,9,test\n")
    assert len(targets) == 2 and targets.ids == ("A", "C") and targets.lines == (2, 4)
    np.testing.assert_allclose(targets.positions, [[1e-3, 2e-3, 3e-3], [7e-3, 8e-3, 9e-3]])
    assert np.isnan(targets.rotations).all() and np.isnan(targets.joints).all()


def test_orientations_and_joints_where_a_row_has_them(tmp_path: Path) -> None:
    text = (
        "a_deg,slide_mm,tip_x_mm,tip_y_mm,tip_z_mm,tip_rx_deg,tip_ry_deg,tip_rz_deg\n90,100,0,0,0,90,0,0\n,,1,1,1,,,\n"
    )
    targets = read(tmp_path, text, "fixed-xyz")
    assert targets.tool == "tip"
    np.testing.assert_allclose(targets.joints[0], [np.pi / 2, 0.1])
    np.testing.assert_allclose(targets.rotations[0], se3.exp(np.array([np.pi / 2, 0, 0])), atol=1e-12)
    assert np.isnan(targets.joints[1]).all() and np.isnan(targets.rotations[1]).all()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x_mm,y_mm,z_mm\n1,2,\n", "line 2"),
        ("a_deg,slide_mm,x_mm,y_mm,z_mm\n1,,1,2,3\n", "line 2, column slide_mm|slide.*all of them or none"),
        ("p1_x_mm,p1_y_mm,p1_z_mm,p2_x_mm,p2_y_mm,p2_z_mm\n1,2,3,4,5,6\n", "targets of p1, p2"),
        ("x_mm,y_mm,z_mm,use\n1,2,3,skip\n", "every row has use = skip"),
    ],
)
def test_what_is_no_file_of_targets(text: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(LabError, match=says):
        read(tmp_path, text)
