"""A kind of observation: one way to measure an arm, with all that the lab knows of it in one object.

Each kind has a module here with its model and its kind (``points``, ``full_pose``, ``cable``, ``socket``, ``plane``).
Its flags, if it has any, are in ``options``; its simulation is a module of the same name in
``lab.simulation.observations``; one line of ``lab.campaign.observation_kinds`` joins them.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from lab.calibration.identify import IdentifyOptions, Solve
from lab.calibration.observations.options import FitInputs, ObservationOptions
from lab.core.instruments import Instrument
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.formats.measurement_csv import ObservedColumns
from lab.kinematics.model import Model

__all__ = ["ObservationKind", "ObservationWords"]


@dataclass(frozen=True)
class ObservationWords:
    """What a person reads of a kind.

    Attributes:
        measured: what was measured, all of it: ``lengths of a cable``.
        reading: what one row of a file holds: ``length of the cable``.
        error: what is left of one after the fit: ``error of the cable's length``.
        placed: what has no nominal value and is fitted even before the links are: ``tool and anchors``.
        names_targets: whether the names of the targets say anything of what was measured.
    """

    measured: str
    reading: str
    error: str
    placed: str
    names_targets: bool


@dataclass(frozen=True)
class ObservationKind(ABC):
    """One way to measure an arm, with the options that it was given.

    What most kinds have in common is here: no options, every parameter fitted at once, the measured targets, and
    nothing that the observations tell of sessions or weights.

    Attributes:
        name: as ``--observe`` takes it.
        words: what a person reads of it.
        columns: what it reads of a measurement file.
        flags: the dataclass of its own options; None where it has none.
        in_instrument_frame: whether positions in the instrument's frame are observed: only then does a run say where
            the base is, and what noise a measured point has.
    """

    name: ClassVar[str]
    words: ClassVar[ObservationWords]
    columns: ClassVar[ObservedColumns]
    flags: ClassVar[type[Any] | None] = None
    in_instrument_frame: ClassVar[bool]

    @classmethod
    def configured(cls, options: ObservationOptions, fit: FitInputs) -> Self:
        """The kind with these options.

        Raises:
            LabError: an option of the kind makes no sense, alone or beside the fit's.
        """
        return cls()

    @property
    def solve(self) -> Solve | None:
        """Another way to fit the free parameters than all at once; None for that."""
        return None

    def targets(self, data: Measurements) -> tuple[str, ...]:
        """The targets that the arm needs to predict what ``data`` holds: the measured ones."""
        return data.targets

    def rows(self, data: Measurements) -> NDArray[np.bool_]:
        """``(n,)``: the rows of a file that hold something of this kind: here, a measured position."""
        return np.asarray(data.seen.any(axis=1))

    def with_sessions(self, arm: Model, data: Measurements, nominal: Array) -> Measurements:
        """The file's measurements, with the sessions that the observations themselves tell where the file names none.

        Args:
            arm: the arm, measured by points.
            data: the file's.
            nominal: ``(p,)`` nominal parameters of ``arm``.

        Returns:
            The measurements as they are, where observations do not tell where a session begins.
        """
        return data

    @abstractmethod
    def observation(self, arm: Model, data: Measurements, nominal: Array) -> tuple[Model, Measurements]:
        """The observation factory: the model that predicts what is observed, and the measurements of it.

        Args:
            arm: the arm, measured by points: those of ``targets(data)``.
            data: the file's.
            nominal: ``(p,)`` nominal parameters of ``arm``.

        Returns:
            The model, and the rows that have something of this kind with it as their ``points``.

        Raises:
            LabError: a column is missing, or a cell says what cannot be.
        """

    def balanced(self, model: Model, data: Measurements, nominal: Array, request: IdentifyOptions) -> Model:
        """A model of ``observation`` with the weights that its residuals call for, where they are to be estimated.

        Args:
            data: of ``observation``, those to be fitted.
            nominal: ``(p,)`` nominal parameters of ``model``.
            request: what is asked of the identification.

        Returns:
            The model as it is, where all observed numbers are lengths.
        """
        return model

    def weighed_by(self, instrument: Instrument, data: Measurements) -> Self:
        """The kind with the weights that an instrument's noise gives: the kind itself where all are lengths.

        Args:
            instrument: what observed.
            data: the file's.
        """
        return self

    def weighed_as(self, model: Model) -> Self:
        """The kind with the weights of this model given: the kind itself where nothing is estimated."""
        return self
