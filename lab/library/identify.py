"""Identify a robot from measurements of a file or in memory, validate and judge."""

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from lab.core.errors import error_context
from lab.core.measurements import Measurements, without_copies
from lab.core.progress import Stage, stages
from lab.formats.measurement_csv import read_measurements
from lab.kinematics.effects.effect_registry import own_columns
from lab.library.calibration_result import CalibrationResult
from lab.library.hand_load import HandLoad, carrying
from lab.library.measurement_checks import checked, robot_of
from lab.options.call_options import options_of, takes
from lab.options.measured_campaign import MeasuredCampaign
from lab.options.named_instruments import noise_of
from lab.options.plan_settings import filled_in
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot
from lab.sensors.sensor_registry import sensor_named
from lab.verdict.fit_checks import note
from lab.verdict.pipeline import Step, chosen_steps, judged, refuse_missing_steps, run_steps, start

__all__ = ["identify"]


@takes(MeasuredCampaign, file="measurements")
def identify(
    measurements: str | Path | Measurements | MeasuredCampaign,
    robot: str | Path | Robot | None = None,
    *,
    steps: Mapping[str, Step] | None = None,
    **options: Any,
) -> CalibrationResult:
    """Identify a robot from measurements, and validate it: on held-out poses, another file, or by cross-validation.

    Args:
        measurements: a CSV file, or measurements in memory (joint positions in rad or m, points in m in any one
            frame); or all options in one object.
        robot: the nominal model: a name, a path, or a loaded robot; by default the one that measurements in memory
            name, and of a file the one of the run in whose folder it lies.
        steps: of the identification, by their names, in place of ``lab.verdict.pipeline.STEPS``: without one, or with
            one of your own, a function from state to state. Their names are the stages of the progress.
        options: those of ``lab identify``, by name: ``instrument``, ``noise_mm``, ``holdout``, ``model`` and so on;
            ``validate`` may be measurements in memory, too, ``instrument`` an ``Instrument``, and ``estimator`` an
            ``Estimator``.

    Returns:
        The identified parameters, with base and points in the frame of the measurements, and how well they predict.

    Raises:
        LabError: an option or the file cannot be used, no robot is given or named, or measurements in memory have other
            joints than the robot, or points in another unit; the message says where, and what is valid.

    Example:
        >>> import lab
        >>> day = lab.simulate("irb120", poses=40, seed=7)
        >>> result = lab.identify(day.measurements, robot="irb120", instrument="uniform-8um")
        >>> result.to_dict()["rank"]
        27
    """
    given = dict[str, Measurements]()
    if isinstance(measurements, MeasuredCampaign):
        requested = filled_in(measurements, measurements.file)[0]
        requested = replace(requested, robot=requested.robot_named)
        loaded = load_robot(requested.robot_named, requested.cell)
    else:
        loaded, named = robot_of("lab.identify", measurements, robot), {"file": measurements}
        named["validate"] = options.pop("validate", None)
        given = {option: value for option, value in named.items() if isinstance(value, Measurements)}
        named |= {option: f"{option} in memory" for option in given}
        requested = options_of("lab.identify", MeasuredCampaign, {**named, "robot": None, **options})
        if robot is None and "file" not in given:
            requested = filled_in(requested, requested.file)[0]
        requested = replace(requested, robot=loaded.source)
        loaded = loaded.placed_in(requested.cell)
    with stages("identifying") as stage:
        return _identified(requested, loaded, given, chosen_steps(steps), stage)


def _identified(
    options: MeasuredCampaign,
    robot: Robot,
    given: Mapping[str, Measurements],
    steps: Mapping[str, Step],
    stage: Stage,
) -> CalibrationResult:
    """Identify from the files that the options name, or from measurements in memory, by the options' names."""
    options.check()
    stage("read the measurements")
    robot, load = carrying(robot, options.fitting.load, accept_edited=options.fitting.accept_edited)
    data, other = _read_rows(robot, options.file, options, load, given.get("file")), None
    if options.validate is not None:
        other = _read_rows(robot, options.validate, options, load, given.get("validate"), validates=True).with_points()
    sensor = options.kind()
    noise = noise_of(options, sensor)
    fit, judging = options.fitting.to_si(), options.judgement(other)
    refuse_missing_steps(steps, fit, judging)
    with error_context(options.file):
        state = start(robot, data, sensor, noise, fit, judging, seed=options.seed)
    state = replace(state, source=str(options.file), checks=tuple(map(note, robot.warnings)))
    started = time.perf_counter()
    state = judged(run_steps(state, steps, stage))
    return CalibrationResult(options, robot, state, time.perf_counter() - started)


def _read_rows(
    robot: Robot,
    path: Path,
    options: MeasuredCampaign,
    load: HandLoad | None,
    given: Measurements | None,
    *,
    validates: bool = False,
) -> Measurements:
    """The rows of a file, or those given in memory, with what the robot carries there.

    Args:
        validates: whether they validate a fit: the unit of those that are fitted is left to the diagnosis.
    """
    chain, sensor = robot.chain, sensor_named(options.observe)
    positions = sensor.in_instrument_frame
    if given is None:
        columns = sensor.columns.with_conditions(own_columns(options.fitting.groups, chain, robot.loads))
        read = read_measurements(path, chain.joint_names, chain.prismatic, columns=columns)
        read = options.kind().with_files(replace(read, robot=robot.source), path.parent)
    else:
        read = checked(path, given, robot, points=positions and validates)
    robot.refuse_impossible(path, read[read.used])
    read = without_copies(path, read) if positions else read
    return read if load is None else load.with_payload(read)
