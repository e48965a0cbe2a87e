"""Define a virtual sensor: a sensor with its options and its simulation."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from lab.calibration.identification import Identification
from lab.calibration.sensor import ArmSensor
from lab.core.errors import LabError, option_name
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.extension_points import Part, numbers
from lab.kinematics.model import Model
from lab.kinematics.serial.axes_to_dh import Truth
from lab.sensors.sensor_options import FitInputs, SensorOptions, VirtualSetup
from lab.sensors.sensor_registry import OWN_SENSORS
from lab.simulation.robot_model import RobotModel
from lab.simulation.tracking import VirtualMeasurement
from lab.simulation.true_robot import TrueRobot

__all__ = ["PlannedReadings", "SimulatedReadings", "VirtualSensor"]


@dataclass(frozen=True)
class SimulatedReadings:
    """Readings of a virtual arm, and the true values that only the assessment may use.

    Attributes:
        measurements: in the columns that the sensor reads.
        bad: ``(n,)`` which poses' readings are outliers.
        placed: true values of what is identified beside the arm, by the owner of its parameters (``anchor.1``,
            ``plane.2``, ``tool``, ``cable``): three each (one of a cable), m and rad, in the instrument's frame; of a
            camera or board six and more, in the frame of its tip where it has one.
    """

    measurements: Measurements
    bad: NDArray[np.bool_]
    placed: Mapping[str, Array] = field(default_factory=dict)


class PlannedReadings(Protocol):
    """What a sensor will read of the nominal arm at poses that are still to be chosen."""

    def near(self, joints: Array) -> Model:
        """Return the model of the readings, whose structure is decided near poses ``(n, joints)`` in sight."""

    @property
    def values(self) -> Array:
        """Its nominal parameters ``(p,)``."""

    @property
    def noise(self) -> str:
        """What the readings' noise is, in words."""

    def sees(self, joints: Array) -> NDArray[np.bool_]:
        """Return whether the sensor reads anything at poses ``(n, joints)``."""

    def counts(self, joints: Array) -> NDArray[np.int_]:
        """Return the number of readings ``(n,)`` at poses ``(n, joints)``."""

    def readings(self, joints: Array, retained: tuple[int, ...]) -> Array:
        """Return derivatives ``(n, r, f)`` of the readings by f parameters, in units of their noise."""


@dataclass(frozen=True)
class VirtualSensor(ArmSensor, Part, ABC, kind=OWN_SENSORS):
    """A sensor that takes options, and that measures virtual arms.

    Attributes:
        flags: the dataclass of its own options; None without any.
        setup: the fields of ``VirtualSetup`` that its simulation reads.
        finds_poses: whether its simulation searches the joint positions in contact, near the given ones.
        combines: the sensors that it combines; none of a single one.
    """

    flags: ClassVar[type[Any] | None] = None
    setup: ClassVar[tuple[str, ...]] = ()
    finds_poses: ClassVar[bool] = False
    combines: ClassVar[tuple[type["VirtualSensor"], ...]] = ()

    @classmethod
    def configured(cls, options: SensorOptions, fit: FitInputs) -> Self:
        """Return the sensor with these options.

        Raises:
            LabError: an option of the sensor makes no sense, alone or beside the fit's.
        """
        return cls()

    @abstractmethod
    def simulate(self, poses: VirtualMeasurement, setup: VirtualSetup) -> SimulatedReadings:
        """Measure a virtual arm where these joint positions settle, or at the fixtures near them.

        Args:
            poses: of the arm, and its instrument.
            setup: of which a sensor reads the fields of ``VirtualSensor.setup``.

        Raises:
            LabError: the sensor cannot measure this arm.
        """

    def planned(self, robot: RobotModel) -> PlannedReadings:
        """Return what the sensor will read of the nominal arm, for a choice of its poses.

        Raises:
            LabError: poses cannot be chosen for this sensor, or not for this arm.
        """
        raise LabError(f"{option_name('observe')} {self.name}: poses are chosen for points and pixels alone")

    def observed_truth(
        self, truth: Truth, found: Identification, real: TrueRobot, placed: Mapping[str, Array]
    ) -> Truth | None:
        """Return the true parameters in the gauge of the observation of an identification.

        Args:
            truth: of the arm, measured by points.
            found: from the same targets.
            real: the arm.
            placed: true positions of fixtures (``SimulatedReadings.placed``).

        Returns:
            None where a mechanism is measured in another gauge than its own.
        """
        return truth

    def placed_truth(
        self, model: Model, truth: Truth, real: TrueRobot, placed: Mapping[str, Array], T_frame_instrument: Array
    ) -> dict[str, float]:
        """Return the true values of the parameters that the sensor adds to an arm, by their names: here, none.

        Args:
            model: of ``observation``.
            truth: of the arm, measured by points.
            placed: of ``SimulatedReadings``.
            T_frame_instrument: ``(4, 4)`` pose (m) of the instrument in the frame of the parameters.
        """
        return {}


def _simulated(where: str, returned: object, *_: object) -> SimulatedReadings:
    if not isinstance(returned, SimulatedReadings):
        raise LabError(f"{where} returns {type(returned).__name__}; return {__name__}.SimulatedReadings")
    return returned


def _observed(where: str, returned: Any, *_: object) -> tuple[Model, Measurements]:
    if not (isinstance(returned, tuple) and len(returned) == 2 and isinstance(returned[1], Measurements)):
        raise LabError(f"{where} returns {type(returned).__name__}; return a model, and the measurements of it")
    return returned


OWN_SENSORS.returned = {
    "simulate": _simulated,
    "observation": _observed,
    "readings": lambda where, readings, Ts, _: numbers(
        where, readings, (len(Ts), *(None,) * (np.ndim(readings) > 1)), "readings"
    ),
}
