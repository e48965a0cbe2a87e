"""What each kind of observation refuses to observe."""

import numpy as np
import pytest
from helpers.observed_files import HEADER, read
from helpers.robots import IRB120

from lab.core.errors import LabError
from lab.kinematics.serial.serial_arm import SerialArm
from lab.sensors.full_pose import PoseSensor
from lab.sensors.plane import PlaneSensor
from lab.sensors.sensor_options import FitInputs, SensorOptions
from lab.sensors.sensor_registry import configured_sensor, sensor_named

ARM = SerialArm(IRB120.chain)


POINT = "x_mm,y_mm,z_mm"


REFUSED = {
    "no orientation": (POINT, "1,2,3", "pose", None, "no orientation"),
    "no meaning": (f"{POINT},rx_deg,ry_deg,rz_deg", "1,2,3,4,5,6", "pose", None, "give --orientation intrinsic-xyz"),
    "norm": (f"{POINT},qw,qx,qy,qz", "1,2,3,1,0.1,0,0", "pose", None, r"line 2, columns qw to qz.*norm is 1\.00499"),
    "half": (f"{POINT},qw,qx,qy,qz", "1,2,3,1,0,,0", "pose", None, "line 2, column qy: empty"),
    "missing": (f"{POINT},qw,qx,qy", "1,2,3,1,0,0", "pose", None, "column p1_qz is missing beside qw"),
    "both": (f"{POINT},qw,qx,qy,qz,rx_deg,ry_deg,rz_deg", "1,2,3,1,0,0,0,1,2,3", "pose", "fixed-xyz", "both give"),
    "twice": ("p1_x_mm,p1_y_mm,p1_z_mm,qw,p1_qw,qx,qy,qz", "1,2,3,1,1,0,0,0", "pose", None, "qw are the same"),
    "no cable": (POINT, "1,2,3", "cable", None, "column cable_mm is missing"),
    "negative cable": ("cable_mm", "-3", "cable", None, "line 2, column cable_mm: a wire's length is above zero"),
    "one length": (
        "cable_mm",
        "300",
        "cable",
        None,
        "no anchor has more than 1 row; its own position takes 3 numbers.*at least 4",
    ),
    "no length": ("cable_mm,note", ",n", "cable", None, "no anchor has more than 0 rows"),
    "no socket": ("location", "a", "socket", None, "column socket is missing"),
    "once": ("location,socket", "a,0", "socket", None, "no socket has more than 1 row; .*at least 2 poses"),
    "plane": ("location", "a", "plane", None, "no plane has more than 1 row"),
}


@pytest.mark.parametrize(("columns", "row", "kind", "meaning", "what"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_observed_is_refused(columns, row, kind, meaning, what, tmp_path) -> None:
    data = read(tmp_path, f"{HEADER},{columns}\n1,2,3,4,5,6,{row}\n", kind)
    with pytest.raises(LabError, match=what):
        configured_sensor(kind, SensorOptions(orientation=meaning), FitInputs()).observation(ARM, data, ARM.nominal())


def test_two_orientations_and_two_targets_are_refused(tmp_path) -> None:
    names = [f"{t}_{c}" for t in ("p1", "p2") for c in ("x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz")]
    data = read(tmp_path, f"{HEADER},{','.join(names)}\n0,0,0,0,0,0,{','.join(['1,2,3,1,0,0,0'] * 2)}\n")
    arm = SerialArm(IRB120.chain, ("p1", "p2"))
    with pytest.raises(LabError, match="p1 and p2 have orientations"):
        PoseSensor().observation(arm, data, arm.nominal())
    with pytest.raises(LabError, match="--observe plane takes one target"):
        PlaneSensor().observation(arm, data, arm.nominal())


MIXED = "x_mm,y_mm,z_mm,qw,qx,qy,qz,cable_mm,location,socket"
ROWS_OF = {"points": (0, 1), "pose": (0, 1), "cable": (0, 2), "socket": (0, 3), "plane": (0, 1, 2, 3)}


@pytest.mark.parametrize("kind", ROWS_OF)
def test_a_file_of_several_kinds_tells_the_rows_of_each(kind: str, tmp_path) -> None:
    rows = ["1,2,3,1,0,0,0,500,a,0", "1,2,3,,,,,,,", ",,,,,,,400,,", ",,,,,,,,b,1"]
    data = read(tmp_path, f"{HEADER},{MIXED}\n" + "".join(f"{i},2,3,4,5,6,{row}\n" for i, row in enumerate(rows)), kind)
    assert np.flatnonzero(sensor_named(kind)().rows(data)).tolist() == list(ROWS_OF[kind])
