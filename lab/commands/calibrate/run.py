"""One campaign: plan, measure, identify, assess; on a virtual arm, or on measurements of a real one."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from lab.calibration.prediction_check import check_prediction
from lab.calibration.validation import (
    TruthComparison,
    Validation,
    compare_with_truth,
    errors_of,
    hold_out,
    hold_out_last,
    shared_rows,
    validate_file,
    validate_folds,
    validate_rows,
)
from lab.calibration.verdict import verdict
from lab.calibration.weights import Noise
from lab.calibration.workspace_prediction import own_tolerance
from lab.campaign.instruments import named_instrument
from lab.campaign.options import VirtualCampaign
from lab.campaign.robot import Robot, load_robot, load_virtual
from lab.campaign.virtual_robot import (
    truth_of,
)
from lab.commands.calibrate.fit import Fitter
from lab.commands.calibrate.fit_result import FitReport
from lab.commands.calibrate.joint_signs import of_joint_signs
from lab.commands.calibrate.measured_rows import read_rows, robot_of
from lab.commands.calibrate.options import MeasuredCampaign
from lab.commands.calibrate.plausibility import (
    doubted,
    in_other_numbers_or_poses,
    noise_in_another_unit,
    points_in_another_scale,
)
from lab.commands.calibrate.regions import bounds_at, regions_of, spread_of_later
from lab.commands.calibrate.result import CalibrationResult
from lab.commands.calibrate.simulate import MeasuringDay, measuring_day
from lab.commands.calibrate.warnings import (
    of_elsewhere,
    of_excluded,
    of_limits,
    of_several_sessions,
    of_validation_beyond,
)
from lab.commands.keywords import options_of, takes
from lab.commands.payload.known_payload import carrying
from lab.core.errors import LabError, error_context
from lab.core.measurements import Measurements
from lab.core.progress import Progress
from lab.core.se3 import Array
from lab.core.wording import be
from lab.kinematics.effects.effect import SessionInfo
from lab.kinematics.effects.registry import CAMPAIGN_SPECIFIC
from lab.noise.instruments import observing
from lab.render.progress import Stage, status
from lab.simulation.effects import true_parameters
from lab.simulation.true_robot import TrueRobot

__all__ = ["CalibrationResult", "calibrate", "identify"]


@takes(VirtualCampaign)
def calibrate(robot: str | Path | Robot | VirtualCampaign = "irb120", **options: Any) -> CalibrationResult:
    """Run a virtual campaign: simulate a measuring day, identify the robot from it, and validate it on new poses.

    Args:
        robot: a model's name, a path, or a loaded robot; or all options in one object.
        options: those of ``lab calibrate``, by name: ``poses``, ``seed``, ``targets``, ``instrument``, ``model`` and
            so on; ``instrument`` may be a name, a file, or an ``Instrument``.

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
    with status("calibrating") as stage:
        stage("1 of 3, simulating the measurements")
        if isinstance(robot, VirtualCampaign):
            return _of_a_virtual_robot(*measuring_day(robot, load_virtual(robot.robot, robot.cell)), stage)
        known = load_virtual(robot)
        asked = options_of("lab.calibrate", VirtualCampaign, {"robot": known.source, **options})
        return _of_a_virtual_robot(*measuring_day(asked, known.placed_in(asked.cell)), stage)


def _of_a_virtual_robot(day: MeasuringDay, placed: Mapping[str, Array], stage: Stage) -> CalibrationResult:
    """Identify from a measuring day, and validate on poses that were not measured, against the truth."""
    options, robot, data, real = day.options, day.robot, day.measurements, day.true_robot
    device = named_instrument(options.instrument)
    started = time.perf_counter()
    noise = Noise(device, readings=options.readings)
    if options.noise_mm is not None:
        noise = Noise(None, options.noise_mm / 1e3)
    kind = options.kind()
    if options.noise_mm is None:
        kind = kind.weighed_by(device, data)
    fitter = Fitter(robot, options.targets, data, kind, noise, options.fitting, options.seed)
    rows = _visible(fitter.observed())
    stage("2 of 3, identifying the parameters")
    with error_context(options.plan or f"--poses {options.poses}"):
        fit = fitter(rows)
    stage("3 of 3, validating")
    identification = fit.identification
    validation = _judged_by_fresh(day, fitter, fit)
    truth = truth_of(real, robot.arm(options.targets))
    if truth is not None:
        truth = kind.observed_truth(replace(truth, effects=true_parameters(real.effects)), identification, real, placed)
    if truth is None:
        hidden = "what is aliased on the nominal model is not on this robot: its parameters have no single truth"
        validation = replace(validation, warnings=(*validation.warnings, hidden))
    comparison = None if truth is None else compare_with_truth(identification, truth)
    seconds = time.perf_counter() - started
    return _outcome(
        fitter,
        fit,
        validation,
        options,
        seconds,
        real=real,
        comparison=comparison,
        bad=day.outliers,
    )


def _judged_by_fresh(day: MeasuringDay, fitter: Fitter, fit: FitReport) -> Validation:
    """On exact points at poses that were not measured; what was measured at fixtures has its base placed there."""
    fresh, identification = day.validation, fit.identification
    said = [*_impossible("validation poses", fresh)]
    if fitter.kind.in_instrument_frame:
        if not day.options.occlusion:
            said = [*_impossible("poses", day.measurements), *said]
        return Validation("fresh", errors_of(identification, fresh), tuple(said), fresh)
    model = fitter.robot.arm_with(fresh.targets, [group for group in fit.groups if group not in CAMPAIGN_SPECIFIC])
    model = model if fit.process is None else fit.process.added_to(model)
    found = validate_file(identification, model, fresh, ("base",))
    return replace(found, judged_by="fresh", warnings=tuple(said))


@takes(MeasuredCampaign, file="measurements")
def identify(
    measurements: str | Path | Measurements | MeasuredCampaign,
    robot: str | Path | Robot | None = None,
    **options: Any,
) -> CalibrationResult:
    """Identify a robot from measurements, and validate it: on held-out poses, another file, or by cross-validation.

    Args:
        measurements: a CSV file, or measurements in memory (joint positions in rad or m, points in m in any one
            frame); or all options in one object.
        robot: the nominal model: a name, a path, or a loaded robot; by default the one that measurements in memory
            name, and of a file ``irb120``.
        options: those of ``lab identify``, by name: ``instrument``, ``noise_mm``, ``holdout``, ``model`` and so on;
            ``validate`` may be measurements in memory, too, and ``instrument`` an ``Instrument``.

    Returns:
        The identified parameters, with base and points in the frame of the measurements, and how well they predict.

    Raises:
        LabError: an option or the file cannot be used, or measurements in memory name no robot, have other joints than
            the robot, or points in another unit; the message says where, and what is valid.

    Example:
        >>> import lab
        >>> day = lab.simulate("irb120", poses=40, seed=7)
        >>> result = lab.identify(day.measurements, robot="irb120", instrument="uniform-8um")
        >>> result.to_dict()["rank"]
        27
    """
    if isinstance(measurements, MeasuredCampaign):
        with status("identifying") as stage:
            return _of_measurements(measurements, load_robot(measurements.robot, measurements.cell), stage)
    if isinstance(measurements, Measurements):
        robot = robot_of("lab.identify", measurements, robot)
    known, given = load_robot(MeasuredCampaign.robot if robot is None else robot), {}
    named = {"file": measurements, "validate": options.pop("validate", None)}
    for option, value in named.items():
        if isinstance(value, Measurements):
            given[option] = value
            named[option] = f"{option} in memory"
    asked = options_of("lab.identify", MeasuredCampaign, {**named, "robot": known.source, **options})
    with status("identifying") as stage:
        return _of_measurements(asked, known.placed_in(asked.cell), stage, given)


def _of_measurements(
    options: MeasuredCampaign, robot: Robot, stage: Stage, given: Mapping[str, Measurements] = MappingProxyType({})
) -> CalibrationResult:
    """Identify from the files that the options name, or from measurements in memory, by the options' names."""
    options.check()
    stage("1 of 3, reading the measurements")
    robot, load = carrying(robot, options.fitting.load, accept_edited=options.fitting.accept_edited)
    read = read_rows(robot, options.file, options, load, given.get("file"))
    other = (
        None
        if options.validate is None
        else _visible(read_rows(robot, options.validate, options, load, given.get("validate")))
    )
    with error_context(options.file):
        fitter = _fitter(robot, read, options)
        data, observed = fitter.data, fitter.observed()
    judging: list[tuple[Measurements, tuple[str, ...]]] = [(data.only("test"), ())] if "test" in data.use else []
    judging += [] if other is None else [(other, CAMPAIGN_SPECIFIC)]
    fitter = replace(fitter, judged_by=tuple(judging))
    rows, test = _visible(observed.only("calibrate")), _visible(observed.only("test"))
    if not len(rows):
        raise LabError(f"{options.file}: no row with use = calibrate has a measured point; mark or measure some")
    if "test" in data.use and not len(test):
        raise LabError(f"{options.file}: no row with use = test has a measured point; mark or measure some")
    _refuse_gaps(options, rows)

    started = time.perf_counter()
    held = test if len(test) else None
    if options.holdout is not None:
        rows, held = hold_out(fitter.model_with(()), rows, options.holdout, options.seed)
    if options.holdout_last is not None:
        rows, held = hold_out_last(fitter.model_with(()), rows, options.holdout_last)
    stage("2 of 3, fitting")
    with error_context(options.file):
        fit = fitter(rows, held)
    validating = partial(stage, "3 of 3, validating")
    validating()
    if other is not None:
        validation = _judged_by_file(fitter, fit, other, options)
    else:
        validation = _judged_by_rows(fitter, fit, rows, held, options, validating)
    return _outcome(fitter, fit, validation, options, time.perf_counter() - started)


def _judged_by_rows(
    fitter: Fitter,
    fit: FitReport,
    rows: Measurements,
    held: Measurements | None,
    options: MeasuredCampaign,
    progress: Progress,
) -> Validation:
    """By all rows held out, else by folds of all rows with the same groups of parameters.

    Outliers among them are errors like the others: who leaves them out of the fit does not leave them out here.
    """
    if held is not None:
        placed, judged, said = [], np.ones(len(held), dtype=bool), list[str]()
        if fitter.course.stations:
            placed.append(("station", held.stations, fitter.course.stations))
        if "sessions" in fit.groups:
            placed.append(("session", held.sessions, fitter.course.sessions))
        for what, names, known in placed:
            judged &= [name in known for name in names]
            said += [
                f"{what} {name} was not fitted, so the place of its frame is unknown: not used for validation"
                for name in set(names) - set(known)
            ]
        if not judged.any():
            return Validation(None, None, tuple(sorted(said)))
        validation = validate_rows(fit.identification, held.take(np.flatnonzero(judged)))
        validation = replace(validation, warnings=(*validation.warnings, *sorted(said)))
        return validation.naming([pose.id for pose in fit.outliers if pose.held_out])
    with error_context(options.file):
        some = fitter.knowing(fit.noise.shared)
        again = partial(some.predicting, groups=fit.groups, held=fit.unshown, process=fit.process)
        validation = validate_folds(again, fit.identification, rows, options.seed, progress)
        return validation.naming([pose.id for pose in fit.outliers])


def _judged_by_file(fitter: Fitter, fit: FitReport, other: Measurements, options: MeasuredCampaign) -> Validation:
    with error_context(options.validate):
        course = _stations_of(other, fitter, options.refit)
    lasting = [group for group in fit.groups if group not in CAMPAIGN_SPECIFIC]
    model = fitter.robot.arm_with(other.targets, lasting, course)
    model = model if fit.process is None else fit.process.added_to(model)
    with error_context(options.validate):
        validation = validate_file(fit.identification, model, other, options.refit)
        validation = replace(validation, fitted_share=shared_rows(other, fit.rows))
    if set(CAMPAIGN_SPECIFIC) & set(fit.groups) and "base" not in options.refit:
        said = f"{options.validate}: validated in the frame as it was at the start; --refit base if it has moved since"
        validation = replace(validation, warnings=(*validation.warnings, said))
    if (
        "payload_kg" in model.conditions
        and "payload_kg" in fit.rows.conditions
        and "payload_kg" not in other.conditions
    ):
        said = f"{options.validate}: no column payload_kg: the flange is assumed to carry nothing in any pose"
        return replace(validation, warnings=(*validation.warnings, said))
    return validation


def _stations_of(other: Measurements, fitter: Fitter, refit: Sequence[str]) -> SessionInfo:
    """The stations whose places a fit found, where the rows of another file are validated from these.

    Raises:
        LabError: a station of the file was not fitted, and no base is placed anew for it.
    """
    known, named = fitter.course.stations, set(other.stations)
    if "base" in refit or (len(known) < 2 and len(named) < 2):
        return SessionInfo()
    if strange := sorted(named - set(known)):
        raise LabError(
            f"station '{strange[0]}' was not fitted, so its place is unknown; --refit base places every station anew"
        )
    return SessionInfo(stations=known)


def _fitter(robot: Robot, data: Measurements, options: MeasuredCampaign) -> Fitter:
    """How the file is to be fitted."""
    kind = options.kind()
    device = None if options.instrument is None else observing(named_instrument(options.instrument), kind.name)
    noise = Noise(device, None if options.noise_mm is None else options.noise_mm / 1e3)
    if device is not None:
        kind = kind.weighed_by(device, data)
    targets = kind.targets(data)
    arm = robot.arm(targets)
    data = kind.with_sessions(arm, data, arm.nominal(robot.tool))
    return Fitter(robot, targets, data, kind, noise, options.fitting, options.seed)


def _impossible(what: str, data: Measurements) -> list[str]:
    """That the real robot cannot take poses that its nominal model can; a jump to another assembly mode is not one."""
    if not (lost := np.flatnonzero(~data.seen.any(axis=1))).size:
        return []
    return [
        f"{len(lost)} of {len(data)} {what} (the first is {data.ids[lost[0]]}) are beyond a parallel singularity of "
        "the real robot, which takes none of them in the nominal assembly mode: left out"
    ]


def _visible(data: Measurements) -> Measurements:
    """The rows where a target was measured."""
    return data.take(np.flatnonzero(data.seen.any(axis=1)))


def _refuse_gaps(options: MeasuredCampaign, rows: Measurements) -> None:
    """The rows to fit give sigma_mm all or none, unless an option says what the others' is."""
    given = np.isfinite(rows.sigma_m)
    if options.noise_mm is None and options.instrument is None and given.any() and not given.all():
        raise LabError(
            f"{options.file}: {rows.where(int(np.argmin(given)))}, column sigma_mm: empty, but other rows "
            "have it; fill it in, or say --noise-mm or --instrument for the empty ones"
        )


def _outcome(
    fitter: Fitter,
    fit: FitReport,
    validation: Validation,
    options: VirtualCampaign | MeasuredCampaign,
    seconds: float,
    *,
    real: TrueRobot | None = None,
    comparison: TruthComparison | None = None,
    bad: frozenset[str] = frozenset(),
) -> CalibrationResult:
    robot, data, identification = fitter.robot, fitter.data, fit.identification
    noisy = noise_in_another_unit(options.noise_mm, fit.rows, identification)
    gate_m = None if options.gate_mm is None else options.gate_mm / 1e3
    noise = fitter.knowing(fit.noise.shared).noise
    judged = validation.without_few([pose.id for pose in fit.outliers]) if fit.left_out else validation
    prediction = check_prediction(identification, judged, noise, fit.measured, seed=options.seed)
    poses, region = regions_of(fitter, fit, options.region)
    left = fit.residual_spread
    word = verdict(
        identification,
        judged,
        gate_m,
        goodness=fit.adequacy,
        tolerance=fitter.tolerance,
        measured=fit.measured,
        findings=fit.findings,
        prediction=prediction,
        poses=poses,
        region=region,
        left=left,
    )
    if real is None and word.word == "bad" and fitter.kind.name == "points" and len(fitter.course.stations) < 2:
        said = in_other_numbers_or_poses(robot, fit.rows)
        word = replace(word, reasons=(*said, *word.reasons))
    if isinstance(options, MeasuredCampaign) and options.holdout_last is not None:
        left = spread_of_later(fitter, fit, word.region.uncalibrated_rms_m)
    own = own_tolerance(identification, fitter.tolerance, poses)
    bounds = bounds_at(identification, left, validation, fit.measured, own)
    warnings = of_joint_signs(fitter, fit.rows) if real is None and word.word == "bad" else []
    warnings += [*robot.warnings, *identification.warnings, *fit.warnings, *validation.warnings]
    if blank := int((~fitter.kind.rows(data)).sum()):
        warnings.append(f"{blank} of {len(data)} rows {be(blank)} left out: no {fitter.kind.words.reading} is in them")
    warnings += of_limits(robot, data)
    warnings += of_validation_beyond(identification, fit.measured, validation.rows)
    warnings += of_elsewhere(word)
    warnings += of_excluded(fit.outliers) if judged is not validation else []
    if fitter.kind.in_instrument_frame and "sessions" not in fit.groups:
        warnings += of_several_sessions(fit.rows)
    if validation.errors is not None:
        before, after = (float(np.nanmean(e)) for e in (validation.errors.before, validation.errors.after))
        if after >= before:
            warnings.append(f"no improvement: {1e3 * after:.3g} mm after, {1e3 * before:.3g} mm before")
    return CalibrationResult(
        options,
        robot,
        fitter.kind,
        data,
        fit,
        fitter.nominal(identification.model),
        fitter.tolerance,
        validation,
        doubted(word, [*noisy, *points_in_another_scale(identification)]),
        seconds,
        tuple(dict.fromkeys(warnings)),
        real,
        comparison,
        bad,
        bounds,
    )
