"""What a simulated kind of observation is: a function that measures a virtual arm.

A kind is simulated by the module of its name in this package; ``lab.campaign.observation_kinds`` names the function.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.instruments import Instrument
from lab.core.measurements import Measurements
from lab.core.orientation import AngleConvention
from lab.core.se3 import Array
from lab.simulation.true_robot import TrueRobot

__all__ = ["Setup", "Simulate", "SimulatedDay", "refuse_several_targets"]


@dataclass(frozen=True)
class Setup:
    """What of a measuring day is neither the arm's nor the instrument's; a kind reads what concerns it.

    Attributes:
        occlusion: whether targets that the instrument does not see are not measured.
        orientation_share: of the poses, whose orientation is measured.
        orientation: how an orientation is written down, as three angles; None for a quaternion.
        fixtures: how many anchors, locations or planes there are.
        socket_distance_m: between the two sockets of a location; None for the usual one, which nobody knows.
    """

    occlusion: bool = False
    orientation_share: float = 1.0
    orientation: AngleConvention | None = None
    fixtures: int = 4
    socket_distance_m: float | None = None


@dataclass(frozen=True)
class SimulatedDay:
    """What was measured of a virtual arm, and what only the assessment may know of it.

    Attributes:
        measurements: in the columns that the kind's observation reads.
        bad: ``(n,)`` which poses' readings are bad.
        placed: what is identified beside the arm, by the owner of its parameters (``anchor.1``, ``plane.2``, ``tool``,
            ``cable``): three parameters each (one of a cable), m and rad, in the instrument's frame.
    """

    measurements: Measurements
    bad: NDArray[np.bool_]
    placed: Mapping[str, Array] = field(default_factory=dict)


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
        setup: Setup,
    ) -> SimulatedDay:
        """What the instrument reads where these joint positions settle, or at the fixtures near them.

        Args:
            real: the arm as it truly is, before its instrument.
            joints: ``(n, joints)`` rad or m.
            targets: of the tool.
            instrument: whose noise the readings have.
            rng: of the noise, the scatter, the bad readings and the fixtures.
            readings: how many each measurement is the mean of.
            conditions: what is set at each pose, ``(n,)`` each.
            setup: of the measuring day.

        Raises:
            LabError: such an arm cannot be measured so.
        """


def refuse_several_targets(kind: str, targets: tuple[str, ...]) -> None:
    """Refuse other targets than the one that touches or is tied.

    Raises:
        LabError: they are not ``p1`` alone, by which name the observation knows it.
    """
    if targets != ("p1",):
        raise LabError(f"--observe {kind} is of one point of the tool, p1: leave out --targets {','.join(targets)}")
