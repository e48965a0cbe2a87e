"""Define a sensor: how its readings of an arm are found in a file, modelled, weighted and named.

``lab.sensors`` has a module for each sensor; identification uses this interface alone.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from lab.calibration.fit_options import FitOptions, Solve
from lab.calibration.observation import Observation
from lab.calibration.weights import Noise
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.core.units import MM, Unit
from lab.formats.measurement_csv import ObservedColumns
from lab.kinematics.model import Model
from lab.noise.instruments import Instrument

__all__ = ["ArmSensor", "SensorTerms"]


@dataclass(frozen=True)
class SensorTerms:
    """Words of a sensor for a report.

    Attributes:
        measured: what was measured, all of it: ``lengths of a cable``.
        reading: what one row of a file holds: ``length of the cable``.
        error: what is left of one after the fit: ``error of the cable's length``.
        placed: what has no nominal value and is fitted even before the links are: ``tool and anchors``.
        names_targets: whether the names of the targets are informative.
        unit: of the noise of an observed number.
    """

    measured: str
    reading: str
    error: str
    placed: str
    names_targets: bool
    unit: Unit = MM


@dataclass(frozen=True)
class ArmSensor(ABC):
    """A sensor: one kind of measurement of an arm, with its options.

    What most sensors have in common is here: every parameter is fitted at once, the targets are those of the file, and
    the readings determine neither sessions nor weights.

    Attributes:
        name: as ``--observe`` takes it.
        words: its descriptions for a report.
        columns: the columns that it reads of a measurement file.
        in_instrument_frame: whether positions in the instrument's frame are observed: only then does a run give the
            pose of the base, and the noise of a measured point.
        read_by: name of the sensor whose instruments it takes; "" for its own name.
        several_a_pose: whether consecutive rows with equal joint positions are readings of one pose.
    """

    name: ClassVar[str]
    terms: ClassVar[SensorTerms]
    columns: ClassVar[ObservedColumns]
    in_instrument_frame: ClassVar[bool]
    read_by: ClassVar[str] = ""
    several_a_pose: ClassVar[bool] = False

    @property
    def solve(self) -> Solve | None:
        """The estimator of the free parameters; None for all at once."""
        return None

    def targets(self, data: Measurements) -> tuple[str, ...]:
        """Return the targets that the arm needs to predict what ``data`` holds: the measured ones."""
        return data.targets

    def rows(self, data: Measurements) -> NDArray[np.bool_]:
        """Return ``(n,)``: which rows of a file hold a reading of this sensor: here, a measured position."""
        return np.asarray(data.seen.any(axis=1))

    def with_files(self, data: Measurements, folder: Path) -> Measurements:
        """Return a file's measurements with the readings that it has in other files: here, none.

        Args:
            folder: of the file, from which paths in it lead.
        """
        return data

    def with_sessions(self, arm: Model, data: Measurements, nominal: Array) -> Measurements:
        """Return the file's measurements, with sessions detected in the readings where the file names none.

        Args:
            arm: the arm, measured by points.
            nominal: ``(p,)`` nominal parameters of ``arm``.

        Returns:
            The measurements as they are, where readings do not show where a session begins.
        """
        return data

    def with_orientation(self, arm: Model, target: str) -> Observation | None:
        """Return the model of the same arm whose orientation is read too; None where no sensor reads more.

        Args:
            arm: the arm, measured by points.
            target: whose pose is read.
        """
        return None

    @abstractmethod
    def observation(self, arm: Model, data: Measurements, nominal: Array) -> tuple[Model, Measurements]:
        """Return the model that predicts what is observed, and the measurements of it.

        Args:
            arm: the arm, measured by points: those of ``targets(data)``.
            nominal: ``(p,)`` nominal parameters of ``arm``.

        Returns:
            The model, an ``Observation`` or the arm itself, and the rows that have a reading, with it as ``points``.

        Raises:
            LabError: a column is missing, or a cell has an impossible value.
        """

    def balanced(self, model: Model, data: Measurements, nominal: Array, options: FitOptions) -> Model:
        """Return a model of ``observation`` with the weights that its residuals call for, where these are estimated.

        Args:
            data: of ``observation``, those to be fitted.
            nominal: ``(p,)`` nominal parameters of ``model``.

        Returns:
            The model as it is, where all observed numbers are lengths.
        """
        return model

    def noise(self, given: Noise) -> Noise:
        """Return the noise by which the readings are weighted: here, the one that is given."""
        return given

    def noises(self, model: Model, sigma_m: float) -> Mapping[Unit, float]:
        """Return the noise of one observed number (1 sigma) by its unit, in the units' SI units.

        Args:
            model: as fitted.
            sigma_m: its noise where the unit of a number is one.
        """
        return {self.terms.unit: sigma_m}

    def weighted_by(self, instrument: Instrument, data: Measurements) -> Self:
        """Return the sensor with the weights that an instrument's noise gives: itself where all are lengths."""
        return self

    def weighted_as(self, model: Model) -> Self:
        """Return the sensor with the weights of this model given: itself where nothing is estimated."""
        return self
