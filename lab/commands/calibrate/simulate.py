"""A virtual measuring day: a robot that is off, an instrument that is somewhere, and what it measures."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lab.campaign.instruments import named_instrument
from lab.campaign.options import VirtualCampaign
from lab.campaign.robot import Robot, load_virtual
from lab.campaign.virtual_robot import asked_conditions, drawn_conditions, fresh_poses, perturbed_arm, poses_to_measure
from lab.commands.hand_load import carrying
from lab.commands.keywords import options_of, takes
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.noise.instruments import observing
from lab.simulation.true_robot import TrueRobot

__all__ = ["MeasuringDay", "measuring_day", "simulate"]


@dataclass(frozen=True, repr=False, eq=False)
class MeasuringDay:
    """What a virtual measuring day gives.

    Attributes:
        robot: the nominal model, which is all that an identification may know.
        measurements: points (m) in the instrument's frame, and joint positions (rad or m) as the controller has them.
        true_robot: what was measured: a robot that differs from its nominal model, and where the instrument stood.
        outliers: ids of the rows whose reading is bad.
    """

    options: VirtualCampaign
    robot: Robot
    measurements: Measurements
    true_robot: TrueRobot
    outliers: frozenset[str]

    @property
    def validation(self) -> Measurements:
        """Exact points (m, in the instrument's frame) at 1,000 random poses that were not measured."""
        fresh = fresh_poses(self.true_robot, self.options, asked_conditions(self.robot, self.options))
        return replace(fresh, robot=self.robot.source)

    def __repr__(self) -> str:
        rows = len(self.measurements)
        return f"<MeasuringDay: {rows} poses of {self.robot.name}, targets {', '.join(self.measurements.targets)}>"


@takes(VirtualCampaign)
def simulate(robot: str | Path | Robot | VirtualCampaign = "irb120", **options: Any) -> MeasuringDay:
    """Simulate a measuring day: perturb a robot, set up an instrument, and measure poses that touch nothing.

    Args:
        robot: a model's name, a path, or a loaded robot; or all options in one object.
        options: those of ``lab calibrate``, by name: ``poses``, ``seed``, ``targets``, ``instrument``,
            ``position_sigma_mm``, ``backlash_mrad`` and so on.

    Returns:
        The measurements (m, in the instrument's frame), the nominal robot and the true one. The same options give the
        same measurements as ``lab calibrate``.

    Raises:
        LabError: an option is unknown or makes no sense; the message says what is valid.

    Example:
        >>> import lab
        >>> day = lab.simulate("irb120", poses=20, seed=7)
        >>> day.measurements.points.shape  # poses, targets, x y z
        (20, 1, 3)
    """
    if isinstance(robot, VirtualCampaign):
        return measuring_day(robot, load_virtual(robot.robot, robot.cell))[0]
    known = load_virtual(robot)
    asked = options_of("lab.simulate", VirtualCampaign, {"robot": known.source, **options})
    return measuring_day(asked, known.placed_in(asked.cell))[0]


def measuring_day(options: VirtualCampaign, robot: Robot) -> tuple[MeasuringDay, Mapping[str, Array]]:
    """The measuring day of these options, with a robot that ``load_virtual`` gave.

    Returns:
        The day, and what is identified beside the arm (``SimulatedReadings.placed``), for the assessment alone.

    Raises:
        LabError: an option makes no sense, or is of another robot, instrument or kind of observation.
    """
    options.check()
    robot, _ = carrying(robot, options.fitting.load, accept_edited=options.fitting.accept_edited)
    robot.refuse_unknown(options.targets)
    sensor = options.kind()
    device = observing(named_instrument(options.instrument), options.observe)
    if options.plan is not None and sensor.finds_poses:
        raise LabError(f"--plan is not of --observe {options.observe}: where the arm touches follows from the fixtures")
    real = perturbed_arm(robot, options)
    joints, set_there, notes = poses_to_measure(robot, options)
    asked = asked_conditions(robot, options)
    conditions = drawn_conditions(real, options, len(joints), rng_for(options.seed, "conditions"), asked) | set_there
    noise = rng_for(options.seed, "noise")
    found = sensor.simulate(real, joints, options.targets, device, noise, options.readings, conditions, options)
    named = frozenset(np.array(found.measurements.ids)[found.bad].tolist())
    day = MeasuringDay(options, robot, replace(found.measurements, warnings=notes, robot=robot.source), real, named)
    return day, found.placed
