"""Every way to write an orientation."""

import numpy as np
from helpers.observed_files import HEADER, read
from helpers.robots import IRB120

from lab.core import se3
from lab.formats.measurement_csv import write_measurements
from lab.kinematics.serial.serial_arm import SerialArm
from lab.sensors.full_pose import PoseSensor


def test_every_way_to_write_an_orientation(tmp_path) -> None:
    vector = np.array([0.2, -0.4, 0.7])
    rotation = se3.exp(vector)
    q = se3.quaternion_from_rotation(rotation)
    inner = np.rad2deg([np.arctan2(-rotation[1, 2], rotation[2, 2]), np.arcsin(rotation[0, 2]),
                        np.arctan2(-rotation[0, 1], rotation[0, 0])])  # fmt: skip
    outer = np.rad2deg([np.arctan2(rotation[2, 1], rotation[2, 2]), -np.arcsin(rotation[2, 0]),
                        np.arctan2(rotation[1, 0], rotation[0, 0])])  # fmt: skip
    ways = {
        None: ("qw,qx,qy,qz", q),
        "intrinsic-xyz": ("rx_deg,ry_deg,rz_deg", inner),
        "fixed-xyz": ("ball_rx_deg,ball_ry_deg,ball_rz_deg", outer),
        "rotation-vector": ("rx_deg,ry_deg,rz_deg", np.rad2deg(vector)),
    }
    for meaning, (columns, numbers) in ways.items():
        row = ",".join(repr(float(number)) for number in numbers)
        stem = "ball_" if columns.startswith("ball") else ""
        point = ",".join(f"{stem}{axis}_mm" for axis in "xyz")
        text = f"{HEADER},{point},{columns}\n0,0,0,0,0,0,1,2,3,{row}\n1,0,0,0,0,0,1,2,3{',' * len(numbers)}\n"
        data = read(tmp_path, text)
        assert not data.warnings
        arm = SerialArm(IRB120.chain, data.targets)
        observation, seen = PoseSensor(meaning).observation(arm, data, arm.nominal())
        turned = se3.rotation_from_quaternion(seen.inputs(observation.conditions)[0, -4:])
        np.testing.assert_allclose(turned, rotation, atol=1e-14)
        assert seen.seen.tolist() == [[True, True], [True, False]]
        write_measurements(tmp_path / "again.csv", data, IRB120.chain.prismatic)
        again = (tmp_path / "again.csv").read_text().splitlines()
        assert again[0].endswith(columns) and again[1].endswith(row)
