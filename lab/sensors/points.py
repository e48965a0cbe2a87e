"""Measure points: positions of the tool's targets in an instrument's frame, the usual observation."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from lab.calibration.sensor import SensorTerms
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.formats.measurement_csv import ObservedColumns
from lab.kinematics.model import Model
from lab.sensors.full_pose import Poses
from lab.sensors.sensor_options import VirtualSetup
from lab.sensors.virtual_sensor import SimulatedReadings, VirtualSensor
from lab.simulation.tracking import VirtualMeasurement, track_with_errors, visible_targets

__all__ = ["PointSensor"]


@dataclass(frozen=True)
class PointSensor(VirtualSensor):
    """Positions of targets, of which the arm itself is the model (``observation.Points``)."""

    name: ClassVar[str] = "points"
    terms: ClassVar[SensorTerms] = SensorTerms(
        measured="points", reading="measured point", error="position error", placed="base and tool", names_targets=True
    )
    columns: ClassVar[ObservedColumns] = ObservedColumns()
    in_instrument_frame: ClassVar[bool] = True
    read_by: ClassVar[str] = "points"
    setup: ClassVar[tuple[str, ...]] = ("occlusion",)

    def with_orientation(self, arm: Model, target: str) -> Poses:
        """Return the model of the arm by full poses of the target."""
        return Poses(arm, target)

    def observation(self, arm: Model, data: Measurements, nominal: Array) -> tuple[Model, Measurements]:
        """Return the arm and the file's points as they are."""
        return arm, data

    def simulate(self, poses: VirtualMeasurement, setup: VirtualSetup) -> SimulatedReadings:
        """Measure points of the targets, of all or of those that the instrument sees."""
        data, bad, _ = track_with_errors(poses)
        if setup.occlusion:
            data = replace(data, points=np.where(visible_targets(poses)[..., None], data.points, np.nan))
        return SimulatedReadings(data, bad)
