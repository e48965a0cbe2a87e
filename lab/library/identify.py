"""Run one campaign: simulate or read the measurements, identify, validate and judge."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from lab.calibration.estimator import LEAST_SQUARES, Estimator, own_estimator
from lab.calibration.fit_options import FitOptions
from lab.calibration.fitter import Fitter
from lab.calibration.identification import spread
from lab.calibration.on_arrays import refuse_degrees
from lab.calibration.validation import TruthComparison, Validation, compare_with_truth, errors_of, validate_file
from lab.calibration.weights import Noise
from lab.core.checks import Check
from lab.core.errors import LabError, error_context, option_name
from lab.core.measurements import Measurements, setups, thinned, without_copies
from lab.core.progress import Stage, stages
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.core.values import Value
from lab.formats.measurement_csv import read_measurements
from lab.kinematics.effects.effect_registry import CAMPAIGN_SPECIFIC, own_columns
from lab.library.calibration_result import CalibrationResult
from lab.library.hand_load import HandLoad, carrying
from lab.library.virtual_arm import (
    draw_conditions,
    fresh_poses,
    perturbed_arm,
    poses_to_measure,
    requested_conditions,
    truth_of,
)
from lab.noise.instruments import observing
from lab.options.call_options import options_of, takes
from lab.options.measured_campaign import MeasuredCampaign
from lab.options.named_instruments import named_instrument
from lab.options.option_groups import Fitting
from lab.options.plan_settings import filled_in
from lab.options.task_region import task_region
from lab.options.virtual_campaign import VirtualCampaign
from lab.robots.config_file import robot_of_file
from lab.robots.load_robot import load_robot, load_virtual
from lab.robots.robot import Robot
from lab.sensors.sensor_registry import sensor_named
from lab.simulation.effects import true_parameters
from lab.simulation.sampler import Sampler, own_sampler
from lab.simulation.tracking import VirtualMeasurement
from lab.simulation.true_robot import TrueOpenRobot, TrueRobot
from lab.verdict.fit_checks import note
from lab.verdict.fitted import Fitted, Judging
from lab.verdict.pipeline import FITTING, STEPS, PipelineOptions, run_steps, start

__all__ = [
    "CalibrationResult", "MeasurementSession", "calibrate", "checked", "identify", "measurement_session", "robot_of",
    "simulate",
]  # fmt: skip


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
    loaded, sampler = load_virtual(robot), _own(options, "sampler", own_sampler)
    requested = options_of("lab.simulate", VirtualCampaign, {"robot": loaded.source, **options}, _OF_THE_FIT)
    return measurement_session(requested, loaded.placed_in(requested.cell), sampler)[0]


def measurement_session(
    options: VirtualCampaign, robot: Robot, sampler: Sampler | None = None
) -> tuple[MeasurementSession, Mapping[str, Array]]:
    """The measurement session of these options, with a robot that ``load_virtual`` gave.

    Args:
        sampler: of the arm, in place of that of the options.

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
    real = perturbed_arm(robot, options, sampler)
    joints, set_there, notes = poses_to_measure(robot, options)
    requested = requested_conditions(robot, options)
    conditions = draw_conditions(real, options, len(joints), rng_for(options.seed, "conditions"), requested) | set_there
    noise = rng_for(options.seed, "noise")
    planned = options.plan is not None
    poses = VirtualMeasurement(real, joints, options.targets, device, noise, options.readings, conditions, planned)
    found = sensor.simulate(poses, options)
    named = frozenset(np.array(found.measurements.ids)[found.bad].tolist())
    session = MeasurementSession(
        options, robot, replace(found.measurements, warnings=notes, robot=robot.source), real, named
    )
    return session, found.placed


_UNITS_PER_M = {"mm": 1000.0, "cm": 100.0, "inches": 39.37}
_NEAR_A_UNIT = 1.25  # factor within which a ratio is that of a unit
_ANOTHER_UNIT = 100.0  # a ratio above is that of another unit, whichever
_LEAST_SPREAD_M = 1.0  # no error of a robot is as large
_LEAST_ROWS = 3
_SPREAD_OF = 4_000  # of more poses the spread of so many is as good


def robot_of(call: str, data: Measurements | str | Path, robot: str | Path | Robot | None) -> Robot:
    """Return the robot of measurements in memory or of a file: the given one, else the one that they name.

    A file names the robot of the run in whose folder it lies.

    Raises:
        LabError: neither names a robot, it cannot be loaded, or its joints are others; it begins with ``call``.
    """
    if not isinstance(data, Measurements):
        if not isinstance(data, str | Path):
            raise LabError(
                f"{call}: measurements are given as {type(data).__name__}; give a file, or make them by "
                "lab.measurements(joints, points, robot=...)"
            )
        named = robot_of_file(Path(data)) if robot is None else robot
        if named is None:
            raise LabError(f"{call}: {data} names no robot; give robot=")
        return load_robot(named)
    if robot is None and not data.robot:
        raise LabError(f"{call}: the measurements name no robot; give robot=")
    loaded = load_robot(data.robot if robot is None else robot)
    _refuse_other_joints(call, data, loaded)
    return loaded


def _refuse_other_joints(what: str | Path, data: Measurements, robot: Robot) -> None:
    """A LabError for measurements in memory whose joints are not the robot's: by number, name, or type where known."""
    chain, names = robot.chain, data.joint_names
    plain = tuple(f"q{j + 1}" for j in range(chain.size))
    if len(names) != chain.size or (names != chain.joint_names and plain not in (names, chain.joint_names)):
        raise LabError(
            f"{what}: joints {', '.join(names)} were measured, but robot {robot.name} has "
            f"{', '.join(chain.joint_names)}; take the right robot"
        )
    slides = chain.prismatic if data.robot in ("", robot.source) else _slides(data.robot)
    if slides is not None and tuple(slides) != tuple(chain.prismatic):
        j = [a == b for a, b in zip(slides, chain.prismatic, strict=True)].index(False)
        kinds = ("a slide", "revolute") if slides[j] else ("revolute", "a slide")
        raise LabError(
            f"{what}: joint {names[j]} is {kinds[0]} of robot {data.robot}, which was measured, but {kinds[1]} of "
            f"robot {robot.name}; take the right robot"
        )


def _read_rows(
    robot: Robot, path: Path, options: MeasuredCampaign, load: HandLoad | None, given: Measurements | None = None
) -> Measurements:
    """The rows of a file, or those given in memory, with what the robot carries there."""
    chain, sensor = robot.chain, sensor_named(options.observe)
    positions = sensor.in_instrument_frame
    if given is None:
        columns = sensor.columns.with_conditions(own_columns(options.fitting.groups, chain, robot.loads))
        read = read_measurements(path, chain.joint_names, chain.prismatic, columns=columns)
        read = options.kind().with_files(replace(read, robot=robot.source), path.parent)
    else:
        read = checked(path, given, robot, points=positions)
    robot.refuse_impossible(path, read[[use != "skip" for use in read.use]])
    read = without_copies(path, read) if positions else read
    return read if load is None else load.with_payload(read)


def checked(what: str | Path, data: Measurements, robot: Robot, *, points: bool = True) -> Measurements:
    """Return measurements in memory as those of a robot, where they can be.

    Raises:
        LabError: the joints are not the robot's or are in degrees, or the points spread so much further than the
            robot's that they are in another unit; it begins with ``what``.
    """
    _refuse_other_joints(what, data, robot)
    slides = np.array(robot.chain.prismatic, dtype=np.bool_)
    refuse_degrees(data.joints[:, ~slides], str(what), "joints in memory are in rad: give np.deg2rad(joints)")
    if points:
        _refuse_another_unit(what, data, robot)
    return replace(data, robot=robot.source)


def _slides(robot: str) -> tuple[bool, ...] | None:
    """Return which joints of a robot are prismatic; None if the robot can no longer be loaded."""
    try:
        return load_robot(robot).chain.prismatic
    except LabError:
        return None


def _refuse_another_unit(what: str | Path, data: Measurements, robot: Robot) -> None:
    some = thinned(data[data.seen.any(axis=1) & (np.array(data.use) != "skip")], _SPREAD_OF)
    arm, ratios = robot.arm(data.targets), list[float]()
    predicted = arm.points(some.joints, arm.nominal(robot.tool))
    predicted = np.where(np.isnan(some.points), np.nan, predicted)
    placed = setups(some)
    for each in dict.fromkeys(placed):  # each in a frame of its own
        rows = [i for i, setup in enumerate(placed) if setup == each]
        measured_m, robot_m = spread(some.points[rows]), spread(predicted[rows])
        if len(rows) >= _LEAST_ROWS and measured_m > _LEAST_SPREAD_M:
            ratios.append(measured_m / max(robot_m, 1e-9))
    if not ratios:
        return
    times = float(np.median(ratios))
    unit, factor = min(_UNITS_PER_M.items(), key=lambda each: abs(np.log(times / each[1])))
    near = max(times / factor, factor / times) <= _NEAR_A_UNIT
    if near or times > _ANOTHER_UNIT:
        remedy = f"divide them by {factor:g}, since they are in {unit}" if near else "convert them"
        raise LabError(
            f"{what}: the points spread {times:,.0f} times as far as the robot's do in these poses; points in memory "
            f"are in m: {remedy}"
        )


@takes(VirtualCampaign)
def calibrate(robot: str | Path | Robot | VirtualCampaign = "irb120", **options: Any) -> CalibrationResult:
    """Run a virtual campaign: simulate a measurement session, identify the robot from it, and validate it on new poses.

    Args:
        robot: a model's name, a path, or a loaded robot; or all options in one object.
        options: those of ``lab calibrate``, by name: ``poses``, ``seed``, ``targets``, ``instrument``, ``model`` and
            so on; ``instrument`` may be a name, a file, or an ``Instrument``, ``effects`` is a ``lab.Effects``,
            ``estimator`` may be an ``Estimator``, and ``sampler`` a ``Sampler``.

    Returns:
        The identified parameters, with base and points in the instrument's frame, and how well they predict.

    Raises:
        LabError: an option is unknown or makes no sense; the message says what is valid.

    Example:
        >>> import lab
        >>> result = lab.calibrate("irb120", poses=50, seed=7, targets=("p1", "p2"))
        >>> result.to_dict()["verdict"]
        'good'
    """
    own, sampler = _own(options, "estimator", own_estimator), _own(options, "sampler", own_sampler)
    with stages("calibrating") as stage:
        stage("1 of 3, simulating the measurements")
        if isinstance(robot, VirtualCampaign):
            return _of_a_virtual_robot(*measurement_session(robot, load_virtual(robot.robot, robot.cell)), stage)
        loaded = load_virtual(robot)
        requested = options_of("lab.calibrate", VirtualCampaign, {"robot": loaded.source, **options})
        session = measurement_session(requested, loaded.placed_in(requested.cell), sampler)
        return _of_a_virtual_robot(*session, stage, own)


_Part = TypeVar("_Part", Estimator, Sampler)


def _own(options: dict[str, Any], name: str, own_part: Callable[[object], _Part]) -> _Part | None:
    """Return the part that options hold as an object, and leave its name in its place; None without one.

    Raises:
        LabError: it is no such part, or has the name of one of the lab's.
    """
    if isinstance(options.get(name, ""), str):
        return None
    own = own_part(options[name])
    options[name] = own.name
    return own


def _fit_options(fitting: Fitting, own: Estimator | None) -> FitOptions:
    """Return the options of the fit, by the estimator that they name unless one is given."""
    if own is None:
        return fitting.of_fit
    return replace(replace(fitting, estimator=LEAST_SQUARES).of_fit, estimator=own)


def _of_a_virtual_robot(
    session: MeasurementSession, placed: Mapping[str, Array], stage: Stage, own: Estimator | None = None
) -> CalibrationResult:
    """Identify from a measurement session, and validate on poses that were not measured, against the truth."""
    options, robot, data, real = session.options, session.robot, session.measurements, session.true_robot
    device = named_instrument(options.instrument)
    fit, kind = _fit_options(options.fitting, own), options.kind()
    noise = Noise(device, readings=options.readings, error_terms=fit.error_terms)
    if options.noise_mm is not None:
        noise = Noise(None, MM.to_si(options.noise_mm), error_terms=fit.error_terms)
    else:
        kind = kind.weighted_by(device, data)
    fitter = Fitter(robot, kind.targets(data), data, kind, kind.noise(noise), fit, options.seed)
    state = Fitted(
        fitter, fitter.observed().with_points(), judging=_judging(options), checks=tuple(map(note, robot.warnings))
    )
    started = time.perf_counter()
    stage("2 of 3, identifying the parameters")
    with error_context(options.plan or f"{option_name('poses')} {options.poses}"):
        state = run_steps(state, FITTING)
    stage("3 of 3, validating")
    state, comparison = _against_truth(session, placed, state)
    seconds = time.perf_counter() - started
    state = run_steps(state, {name: STEPS[name] for name in ("judge", "check validation")})
    return CalibrationResult(options, robot, state, seconds, real, comparison, session.outliers)


def _against_truth(
    session: MeasurementSession, placed: Mapping[str, Array], state: Fitted
) -> tuple[Fitted, TruthComparison | None]:
    """Validate on exact points at poses that were not measured, and compare with the truth where it is single."""
    state, found, real = _judged_by_fresh(session, state), state.identification, session.true_robot
    truth = truth_of(real, session.robot.arm(session.options.targets))
    if truth is not None:
        truth = replace(truth, effects=true_parameters(real.effects))
        truth = session.options.kind().observed_truth(truth, found, real, placed)
    if truth is None:
        return state.with_checks([Check("truth.aliased", "noted")]), None
    return state, compare_with_truth(found, truth)


def _judged_by_fresh(session: MeasurementSession, state: Fitted) -> Fitted:
    """Validate on exact points at poses that were not measured.

    The base of an arm at fixtures is fitted first, with the tool where no reading shows it.
    """
    fresh, found, fitter = session.validation, state.identification, state.fitter
    checks = _impossible("validation poses", fresh)
    if fitter.kind.in_instrument_frame:
        if not (session.options.occlusion or isinstance(session.true_robot, TrueOpenRobot)):  # it reaches all poses
            checks = _impossible("poses", session.measurements) + checks
        validation = Validation("fresh", errors_of(found, fresh), rows=fresh)
    else:
        groups = [group for group in state.groups if group not in CAMPAIGN_SPECIFIC]
        arm = session.robot.arm_with(fresh.targets, groups)
        model = arm if state.process is None else state.process.added_to(arm)
        validation = replace(validate_file(found, model, fresh, found.unplaced), judged_by="fresh", checks=())
    return replace(state, validation=validation).with_checks(checks)


@takes(MeasuredCampaign, file="measurements")
def identify(
    measurements: str | Path | Measurements | MeasuredCampaign, robot: str | Path | Robot | None = None, **options: Any
) -> CalibrationResult:
    """Identify a robot from measurements, and validate it: on held-out poses, another file, or by cross-validation.

    Args:
        measurements: a CSV file, or measurements in memory (joint positions in rad or m, points in m in any one
            frame); or all options in one object.
        robot: the nominal model: a name, a path, or a loaded robot; by default the one that measurements in memory
            name, and of a file the one of the run in whose folder it lies.
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
    if isinstance(measurements, MeasuredCampaign):
        measurements = filled_in(measurements, measurements.file)[0]
        named_there = replace(measurements, robot=measurements.robot_named)
        with stages("identifying") as stage:
            return _of_measurements(named_there, load_robot(named_there.robot_named, named_there.cell), stage)
    own = _own(options, "estimator", own_estimator)
    loaded, given = robot_of("lab.identify", measurements, robot), {}
    named = {"file": measurements, "validate": options.pop("validate", None)}
    for option, value in named.items():
        if isinstance(value, Measurements):
            given[option] = value
            named[option] = f"{option} in memory"
    requested = options_of("lab.identify", MeasuredCampaign, {**named, "robot": None, **options})
    if robot is None and "file" not in given:
        requested = filled_in(requested, requested.file)[0]
    requested = replace(requested, robot=loaded.source)
    with stages("identifying") as stage:
        return _of_measurements(requested, loaded.placed_in(requested.cell), stage, given, own)


def _of_measurements(
    options: MeasuredCampaign,
    robot: Robot,
    stage: Stage,
    given: Mapping[str, Measurements] = MappingProxyType({}),
    own: Estimator | None = None,
) -> CalibrationResult:
    """Identify from the files that the options name, or from measurements in memory, by the options' names."""
    options.check()
    stage("1 of 3, reading the measurements")
    robot, load = carrying(robot, options.fitting.load, accept_edited=options.fitting.accept_edited)
    data, other = _read_rows(robot, options.file, options, load, given.get("file")), None
    if options.validate is not None:
        other = _read_rows(robot, options.validate, options, load, given.get("validate")).with_points()
    kind, device = options.kind(), options.instrument
    requested = PipelineOptions(
        kind,
        _fit_options(options.fitting, own),
        None if device is None else observing(named_instrument(device), kind.read_by or kind.name),
        None if options.noise_mm is None else MM.to_si(options.noise_mm),
        replace(
            _judging(options),
            holdout=options.holdout,
            holdout_last=options.holdout_last,
            other=other,
            refit=options.refit,
        ),
        options.seed,
    )
    with error_context(options.file):
        state = start(robot, data, requested)
    validating = partial(stage, "3 of 3, validating")
    state = replace(state, progress=validating, checks=tuple(map(note, robot.warnings)))
    started, steps = time.perf_counter(), dict(STEPS)
    state = steps.pop("hold out")(state)
    stage("2 of 3, fitting")
    with error_context(options.file):
        state = run_steps(state, {name: steps.pop(name) for name in FITTING})
    validating()
    with error_context(options.file if options.validate is None else options.validate):
        state = steps.pop("validate")(state)
    seconds = time.perf_counter() - started
    return CalibrationResult(options, robot, run_steps(state, steps), seconds)


def _judging(options: VirtualCampaign | MeasuredCampaign) -> Judging:
    gate_m = None if options.gate_mm is None else MM.to_si(options.gate_mm)
    return Judging(gate_m=gate_m, region=task_region(options.region), region_name=f"--region {options.region}")


def _impossible(what: str, data: Measurements) -> list[Check]:
    """Report poses that the nominal model reaches and the real robot does not; assembly-mode jumps do not count."""
    if not (lost := np.flatnonzero(~data.seen.any(axis=1))).size:
        return []
    where = {"what": what, "lost": len(lost), "count": len(data), "first": data.ids[lost[0]]}
    return [Check("validation.singular", "noted", data=where)]
