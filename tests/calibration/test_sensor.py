"""A sensor that is no part of the package: identification needs nothing of it but the interface."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from helpers.robots import IRB120

from lab.calibration.identification import identify
from lab.calibration.sensor import ArmSensor, SensorTerms
from lab.core.measurements import Measurements, measured
from lab.core.se3 import Array
from lab.formats.measurement_csv import ObservedColumns
from lab.kinematics.model import Model
from lab.kinematics.serial.serial_arm import SerialArm

ARM = SerialArm(IRB120.chain)


@dataclass(frozen=True)
class ShiftedPoints(ArmSensor):
    """Points in a frame that is a metre above the instrument's."""

    name: ClassVar[str] = "shifted"
    words: ClassVar[SensorTerms] = SensorTerms("points", "point", "position error", "base and tool", True)
    columns: ClassVar[ObservedColumns] = ObservedColumns()
    in_instrument_frame: ClassVar[bool] = True

    def observation(self, arm: Model, data: Measurements, nominal: Array) -> tuple[Model, Measurements]:
        return arm, replace(data, points=data.points + np.array([0.0, 0.0, 1.0]))


def test_a_sensor_of_a_stranger_is_identified() -> None:
    sensor, rng = ShiftedPoints(), np.random.default_rng(0)
    true = ARM.nominal() + 1e-3 * rng.standard_normal(len(ARM.names))
    joints = IRB120.chain.random_joints(30, rng)
    data = measured(IRB120.chain.joint_names, joints, ("p1",), ARM.points(joints, true))
    model, seen = sensor.observation(ARM, data, ARM.nominal())
    found = identify(model, seen, ARM.nominal())
    assert found.status == "converged"
    np.testing.assert_allclose(ARM.points(joints, found.values), seen.points, atol=1e-12)  # m, rounding alone
