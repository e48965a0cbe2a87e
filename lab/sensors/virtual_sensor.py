"""A sensor with its simulation: what every sensor of this room has beside what identification needs of it."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from lab.calibration.identify import Identification
from lab.calibration.sensor import Sensor
from lab.core.errors import LabError, option_name
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.kinematics.serial.axes_to_dh import Truth
from lab.noise.instruments import Instrument
from lab.sensors.options import FitInputs, SensorOptions, VirtualSetup
from lab.simulation.true_robot import TrueRobot

__all__ = ["SimulatedReadings", "VirtualSensor", "refuse_several_targets"]


@dataclass(frozen=True)
class SimulatedReadings:
    """Readings of a virtual arm, and the truth that only the assessment may use.

    Attributes:
        measurements: in the columns that the sensor reads.
        bad: ``(n,)`` which poses' readings are outliers.
        placed: what is identified beside the arm, by the owner of its parameters (``anchor.1``, ``plane.2``, ``tool``,
            ``cable``): three parameters each (one of a cable), m and rad, in the instrument's frame.
    """

    measurements: Measurements
    bad: NDArray[np.bool_]
    placed: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class VirtualSensor(Sensor, ABC):
    """A sensor that takes options, and that measures virtual arms.

    Attributes:
        flags: the dataclass of its own options; None where it has none.
        setup: the fields of ``VirtualSetup`` that its simulation reads.
        finds_poses: whether its simulation finds the joint positions itself, those in contact near the given ones.
    """

    flags: ClassVar[type[Any] | None] = None
    setup: ClassVar[tuple[str, ...]] = ()
    finds_poses: ClassVar[bool] = False

    @classmethod
    def configured(cls, options: SensorOptions, fit: FitInputs) -> Self:
        """Return the sensor with these options.

        Raises:
            LabError: an option of the sensor makes no sense, alone or beside the fit's.
        """
        return cls()

    @abstractmethod
    def simulate(
        self,
        real: TrueRobot,
        joints: Array,
        targets: tuple[str, ...],
        instrument: Instrument,
        rng: np.random.Generator,
        readings: int,
        conditions: Mapping[str, Array],
        setup: VirtualSetup,
    ) -> SimulatedReadings:
        """Measure a virtual arm where these joint positions settle, or at the fixtures near them.

        Args:
            real: the arm as it truly is, before its instrument.
            joints: ``(n, joints)`` rad or m.
            targets: of the tool.
            instrument: whose noise the readings have.
            rng: of the noise, the scatter, the outliers and the fixtures.
            readings: how many each measurement is the mean of.
            conditions: what is set at each pose, ``(n,)`` each.
            setup: how the arm is measured.

        Raises:
            LabError: such an arm cannot be measured so.
        """

    def observed_truth(
        self, truth: Truth, found: Identification, real: TrueRobot, placed: Mapping[str, Array]
    ) -> Truth | None:
        """Return the true parameters in the gauge of the observation that an identification is of.

        Args:
            truth: of the arm, measured by points.
            found: from the same targets.
            real: the arm.
            placed: where fixtures truly are (``SimulatedReadings.placed``).

        Returns:
            None where a mechanism is measured in another gauge than its own.
        """
        return truth


def refuse_several_targets(sensor: str, targets: tuple[str, ...]) -> None:
    """Refuse other targets than the one that touches or is tied.

    Raises:
        LabError: they are not ``p1`` alone, by which name the observation knows it.
    """
    if targets != ("p1",):
        raise LabError(
            f"{option_name('observe')} {sensor} is of one point of the tool, p1: leave out "
            f"{option_name('targets')} {','.join(targets)}"
        )
