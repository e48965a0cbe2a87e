"""Small measurement files of observations, for the tests of what is observed."""

from helpers.robots import IRB120, data_file
from lab.core.measurements import Measurements
from lab.formats.measurement_csv import read_measurements
from lab.kinematics.serial.serial_arm import SerialArm
from lab.sensors.sensor_registry import sensor_named

ARM = SerialArm(IRB120.chain)
NAMES = IRB120.chain.joint_names


HEADER = ",".join(f"q{i}_deg" for i in range(1, 7))


def read(tmp_path, lines: str, observe: str = "pose") -> Measurements:
    path = tmp_path / "m.csv"
    path.write_text(lines)
    return read_measurements(path, NAMES, IRB120.chain.prismatic, columns=sensor_named(observe).columns)


def cable_file() -> tuple[SerialArm, Measurements]:
    file = data_file("irb120_cable_robotcali_1042.csv")
    data = read_measurements(file, NAMES, IRB120.chain.prismatic, columns=sensor_named("cable").columns)
    assert len(data.warnings) == 1 and "points p1 are ignored" in data.warnings[0]
    return ARM, data
