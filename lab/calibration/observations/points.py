"""Measured points: positions of the tool's targets in an instrument's frame, the usual kind of observation."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from lab.calibration.identify import IdentifyOptions, Solve
from lab.calibration.observations.kind import ObservationKind, ObservationWords
from lab.calibration.observations.options import FitInputs, ObservationOptions
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
    flags: ClassVar[type[Any] | None] = None
    in_instrument_frame: ClassVar[bool] = True

    @classmethod
    def configured(cls, options: ObservationOptions, fit: FitInputs) -> Self:
        """The kind has no options."""
        return cls()

    @property
    def solve(self) -> Solve | None:
        """None: all parameters are fitted at once."""
        return None

    def targets(self, data: Measurements) -> tuple[str, ...]:
        """The measured ones."""
        return data.targets

    def rows(self, data: Measurements) -> NDArray[np.bool_]:
        """``(n,)``: those with a measured target."""
        return np.asarray(data.seen.any(axis=1))

    def with_sessions(self, arm: Model, data: Measurements, nominal: Array) -> Measurements:
        """The measurements as they are: points do not tell where a session begins."""
        return data

    def observation(self, arm: Model, data: Measurements, nominal: Array) -> tuple[Model, Measurements]:
        """The arm and the file's points as they are."""
        return arm, data

    def balanced(self, model: Model, data: Measurements, nominal: Array, request: IdentifyOptions) -> Model:
        """The model as it is: all observed numbers are lengths."""
        return model

    def weighed_as(self, model: Model) -> Self:
        """The kind itself: nothing is estimated."""
        return self
