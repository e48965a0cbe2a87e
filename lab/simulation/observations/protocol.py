"""What a simulated kind of observation is: a function that measures a virtual arm.

A kind is simulated by the module of its name in this package; ``lab.campaign.observation_kinds`` names the function.
"""

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core.instruments import Instrument
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.simulation.true_robot import TrueRobot

__all__ = ["Simulate"]


class Simulate(Protocol):
    """Measurements of a virtual arm by one kind of observation."""

    def __call__(
        self,
        real: TrueRobot,
        joints: Array,
        targets: tuple[str, ...],
        instrument: Instrument,
        rng: np.random.Generator,
        readings: int,
        conditions: Mapping[str, Array],
    ) -> tuple[Measurements, NDArray[np.bool_]]:
        """What the instrument reads where these joint positions settle.

        Args:
            real: the arm as it truly is, before its instrument.
            joints: ``(n, joints)`` rad or m.
            targets: of the tool.
            instrument: whose noise the readings have.
            rng: of the noise, the scatter and the bad readings.
            readings: how many each measurement is the mean of.
            conditions: what is set at each pose, ``(n,)`` each.

        Returns:
            The measurements, in the columns that the kind's observation reads, and ``(n,)`` which poses' readings are
            bad, for the assessment alone.
        """
