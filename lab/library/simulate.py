"""Simulate a measurement session: a perturbed robot, an instrument, and poses that touch nothing."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.values import Value
from lab.library.hand_load import carrying
from lab.library.virtual_arm import (
    draw_conditions,
    fresh_poses,
    perturbed_arm,
    poses_to_measure,
    requested_conditions,
)
from lab.noise.instruments import observing
from lab.options.call_options import options_of, takes
from lab.options.named_instruments import named_instrument
from lab.options.option_groups import Fitting
from lab.options.virtual_campaign import VirtualCampaign
from lab.prediction.validation import TruthComparison
from lab.robots.load_robot import load_virtual
from lab.robots.robot import Robot
from lab.simulation.tracking import VirtualMeasurement
from lab.simulation.true_robot import TrueRobot

__all__ = ["MeasurementSession", "SimulatedTruth", "measured_session", "measurement_session", "simulate"]


@dataclass(frozen=True, repr=False, eq=False)
class MeasurementSession(Value):
    """A simulated measurement session.

    Attributes:
        robot: the nominal model, the only input of an identification.
        measurements: points (m) in the instrument's frame, and joint positions (rad or m) as the controller has them.
        true_robot: what was measured: a robot that differs from its nominal model, and the instrument's pose.
        outliers: ids of the rows with an outlier.
    """

    options: VirtualCampaign
    robot: Robot
    measurements: Measurements
    true_robot: TrueRobot
    outliers: frozenset[str]

    @property
    def validation(self) -> Measurements:
        """Exact points (m, in the instrument's frame) at 1,000 random poses that were not measured."""
        fresh = fresh_poses(self.true_robot, self.options, requested_conditions(self.robot, self.options))
        return replace(fresh, robot=self.robot.source)

    def _about(self) -> str:
        return f"{len(self.measurements)} poses of {self.robot.name}, targets {', '.join(self.measurements.targets)}"


@dataclass(frozen=True)
class SimulatedTruth:
    """Truth of a virtual campaign, for its assessment alone.

    Attributes:
        robot: the arm that was measured, with the instrument's pose.
        outliers: ids of the rows with a simulated outlier.
        comparison: the identified parameters beside the true ones; None where these are not unique.
    """

    robot: TrueRobot
    outliers: frozenset[str] = frozenset()
    comparison: TruthComparison | None = None


_OF_THE_FIT = (  # options that a simulated session has no use for
    *(each.name for each in fields(Fitting) if each.name not in ("load", "accept_edited")),
    "noise_mm", "noise_mrad", "noise_px", "method", "gate_mm", "region", "require", "date", "serial", "no_recording",
)  # fmt: skip


@takes(VirtualCampaign, unused=_OF_THE_FIT)
def simulate(robot: str | Path | Robot | VirtualCampaign = "irb120", **options: Any) -> MeasurementSession:
    """Simulate a measurement session: perturb a robot, set up an instrument, and measure poses that touch nothing.

    Args:
        robot: a model's name, a path, or a loaded robot; or all options in one object.
        options: those of ``lab calibrate`` that make measurements, by name: ``poses``, ``seed``, ``targets``,
            ``instrument``, ``position_sigma_mm`` and so on; ``effects`` is a ``lab.Effects``, and ``sampler`` may be a
            ``Sampler``.

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
        return measurement_session(robot, load_virtual(robot.robot, robot.cell))[0]
    loaded = load_virtual(robot)
    requested = options_of("lab.simulate", VirtualCampaign, {"robot": loaded.source, **options}, _OF_THE_FIT)
    return measurement_session(requested, loaded.placed_in(requested.cell))[0]


def measurement_session(options: VirtualCampaign, robot: Robot) -> tuple[MeasurementSession, Mapping[str, Array]]:
    """The measurement session of these options, with a robot that ``load_virtual`` gave.

    Returns:
        The day, and what is identified beside the arm (``SimulatedReadings.placed``), for the assessment alone.

    Raises:
        LabError: an option makes no sense, or is of another robot, instrument or kind of observation.
    """
    options.check()
    robot, _ = carrying(robot, options.fitting.load, accept_edited=options.fitting.accept_edited)
    options = replace(options, targets=robot.on_tips(options.targets))
    robot.refuse_unknown(options.targets)
    sensor = options.kind()
    device = observing(named_instrument(options.instrument), sensor.read_by or options.observe)
    if options.plan is not None and sensor.finds_poses:
        raise LabError(f"--plan is not of --observe {options.observe}: where the arm touches follows from the fixtures")
    real = perturbed_arm(robot, options)
    joints, set_there, notes = poses_to_measure(robot, options)
    requested = requested_conditions(robot, options)
    conditions = draw_conditions(real, options, len(joints), rng_for(options.seed, "conditions"), requested) | set_there
    noise = rng_for(options.seed, "noise")
    planned = options.plan is not None
    poses = VirtualMeasurement(real, joints, options.targets, device, noise, options.readings, conditions, planned)
    return measured_session(options, robot, poses, notes)


def measured_session(
    options: VirtualCampaign, robot: Robot, poses: VirtualMeasurement, notes: tuple[str, ...] = ()
) -> tuple[MeasurementSession, Mapping[str, Array]]:
    """The session in which the sensor of the options measures a virtual arm, and what is identified beside the arm."""
    simulated = options.kind().simulate(poses, options)
    outliers = frozenset(np.array(simulated.measurements.ids)[simulated.bad].tolist())
    data = replace(simulated.measurements, warnings=notes, robot=robot.source)
    return MeasurementSession(options, robot, data, poses.robot, outliers), simulated.placed
