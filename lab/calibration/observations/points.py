"""Measured points: positions of the tool's targets in an instrument's frame, the usual kind of observation."""

from dataclasses import dataclass
from typing import ClassVar

from lab.calibration.observations.kind import ObservationKind, ObservationWords
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.formats.measurement_csv import ObservedColumns
from lab.kinematics.model import Model

__all__ = ["PointsKind"]


@dataclass(frozen=True)
class PointsKind(ObservationKind):
    """Positions of targets, of which the arm itself is the model (``protocol.Points``)."""

    name: ClassVar[str] = "points"
    words: ClassVar[ObservationWords] = ObservationWords(
        measured="points", reading="measured point", error="position error", placed="base and tool", names_targets=True
    )
    columns: ClassVar[ObservedColumns] = ObservedColumns()
    in_instrument_frame: ClassVar[bool] = True

    def observation(self, arm: Model, data: Measurements, nominal: Array) -> tuple[Model, Measurements]:
        """The arm and the file's points as they are."""
        return arm, data
