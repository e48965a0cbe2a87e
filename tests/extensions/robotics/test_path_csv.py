"""Files of points: joint positions or positions of the tool, each with its move and its velocity."""

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.extensions.robotics.trajectory.motion import read_path

JOINTS = ("q1", "q2"), (False, True)


def test_rows_of_joints_and_of_targets_are_read_in_their_units(tmp_path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("id,move,q1_deg,q2_mm,speed_q1_deg_per_s,speed_q2_mm_per_s\na,,90,100,,\nb,line,0,50,180,5\n")
    rows = read_path(path, *JOINTS)
    assert len(rows) == 2 and rows.moves == ("joint", "line") and not rows.warnings
    np.testing.assert_allclose(rows.joints, [[np.pi / 2, 0.1], [0, 0.05]])
    np.testing.assert_allclose(rows.speeds, [[0, 0], [np.pi, 0.005]])
    assert np.isnan(rows.positions).all() and not rows.velocities.any()
    path.write_text(
        "move,x_mm,y_mm,z_mm,vx_mm_per_s,use\n,1,2,3,,\nvia,0,0,0,,skip\n,4,5,6,7,\n".replace(",\n", ",test\n")
    )
    rows = read_path(path, *JOINTS)
    np.testing.assert_allclose(rows.positions, [[1e-3, 2e-3, 3e-3], [4e-3, 5e-3, 6e-3]])
    np.testing.assert_allclose(rows.velocities, [[0, 0, 0], [7e-3, 0, 0]])
    assert (
        rows.moves == ("joint", "joint") and np.isnan(rows.joints).all()
    )  # the row that is skipped takes its move along


def test_half_a_circle_is_refused(tmp_path) -> None:
    path = tmp_path / "points.csv"
    for moves in (("joint", "circle"), ("joint", "via", "line"), ("joint", "via"), ("via", "circle")):
        path.write_text("move,q1_deg,q2_mm\n" + "".join(f"{move},{i},{i}\n" for i, move in enumerate(moves)))
        with pytest.raises(LabError, match="circle"):
            read_path(path, *JOINTS)
