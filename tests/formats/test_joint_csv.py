"""Files of joint positions: their rows in the robot's units, and what tells them from files of targets."""

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.formats.target_csv import holds_targets, read_joints

SCARA = ("q1", "q2", "q3", "q4"), (False, False, True, False)


def test_rows_are_read_in_their_units_and_skipped_where_the_file_says_so(tmp_path) -> None:
    path = tmp_path / "joints.csv"
    path.write_text(
        "id,use,q1_deg,q2_rad,q3_mm,q4_deg\na,,90,1.5,100,0\nb,skip,0,0,0,0\n,,-90,0,7,1\n".replace(",,", ",test,")
    )
    read = read_joints(path, *SCARA)
    assert read.ids == ("a", "2") and not read.warnings and not holds_targets(path)
    np.testing.assert_allclose(read.joints, [[np.pi / 2, 1.5, 0.1, 0], [-np.pi / 2, 0, 0.007, np.pi / 180]], rtol=1e-15)


@pytest.mark.parametrize("column", ["x_mm", "p1_x_m", "ball_x_mm"])
def test_a_column_of_positions_makes_it_a_file_of_targets(tmp_path, column: str) -> None:
    path = tmp_path / "targets.csv"
    path.write_text(f"id,{column}\na,1\n")
    assert holds_targets(path)
    with pytest.raises(LabError, match="joint q1 is missing"):
        read_joints(path, *SCARA)


def test_a_plan_whose_points_are_still_empty_is_a_file_of_joint_positions(tmp_path) -> None:
    path, rows = tmp_path / "plan.csv", "1,0,0,0,0,{}\n2,90,0,0,0,{}\n"
    header = "id,q1_deg,q2_deg,q3_mm,q4_deg,p1_x_mm,p1_y_mm,p1_z_mm\n"
    path.write_text(header + rows.format(",,", ",,"))
    assert not holds_targets(path) and len(read_joints(path, *SCARA).joints) == 2
    path.write_text(header + rows.format(",,", "1,2,3"))
    assert holds_targets(path)
