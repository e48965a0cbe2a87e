"""Certify a calibration: uncertainty of its positions, and performance of the robot before and after."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.calibration.observation import observation_of
from lab.calibration.row_groups import SAME_CONFIGURATION
from lab.calibration.statistics.goodness_of_fit import repeats
from lab.certification.budget import (
    LARGEST_SCALE_ERROR,
    MEASURANDS,
    Budget,
    InputQuantity,
    Propagation,
    RandomErrors,
    budget_of,
    lack_of_fit_of,
    motion_of,
    propagated,
    quantities_of,
    scale_of,
    temperature_of,
    unseen_move_of,
)
from lab.certification.certificate_plausibility import CampaignFacts, implausibilities
from lab.certification.characteristics import (
    Conformity,
    Repeats,
    conformity_of,
    distance_errors,
    pose_accuracy,
    repeats_of,
)
from lab.certification.lack_of_fit import LackOfFit, lack_of_fit
from lab.core.errors import LabError
from lab.core.measurements import PLACE, Measurements
from lab.core.probability import Uncertain
from lab.core.progress import Stage, stages
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.certificate_toml import CertificateDetails, read_certificate_details
from lab.library.certificate_inputs import (
    FittedRows,
    digests_of,
    fitted_motions,
    fitted_rows,
    instrument_noise_m,
    motions_found,
    random_errors,
    validation_errors,
    without_range,
)
from lab.library.certificate_result import Certificate, RobotFound, Unseen, missing_text
from lab.library.load_run import CalibrationRun, load_run
from lab.noise.instruments import INSTRUMENTS, Instrument, TrackerErrors
from lab.options.call_options import options_of, takes
from lab.options.command_options import CertifyOptions
from lab.options.named_instruments import named_instrument
from lab.options.virtual_campaign import VirtualCampaign
from lab.phrases.phrase import phrases

__all__ = ["certify"]

_SPANNING = 0.5  # of a campaign, between two visits to a pose: they show whether base or instrument moved


@takes(CertifyOptions)
def certify(run: str | Path | CertifyOptions, **options: Any) -> Certificate:
    """Evaluate the uncertainty budget of a run, and the performance of its robot.

    Args:
        run: the folder of a run of ``lab calibrate`` or ``lab identify``; or all options in one object.
        options: those of ``lab certify``, by name: ``details``, ``instrument``, ``tolerance_mm`` and so on.

    Returns:
        The certificate: budget, performance, statement of conformity and what is missing in its details.

    Raises:
        LabError: the run cannot be read, its verdict is bad or not judged, or a file makes no sense.

    Example:
        >>> import lab, pathlib, tempfile
        >>> folder = pathlib.Path(tempfile.mkdtemp()) / "run"
        >>> result = lab.calibrate("irb120", seed=7, gate_mm=0.1, no_recording=True)
        >>> lab.certify(result.save(folder)).to_dict()["conformity"]["decision"]
        'conforms'
    """
    requested = run
    if not isinstance(requested, CertifyOptions):
        requested = options_of("lab.certify", CertifyOptions, {"run": run, **options})
    requested.check()
    with stages("certifying") as stage:
        return _certified(requested, stage)


def _certified(options: CertifyOptions, stage: Stage) -> Certificate:
    stage("1 of 3, reading the run")
    details = CertificateDetails() if options.details is None else read_certificate_details(options.details)
    calibrated = load_run(options.run, accept_edited=options.accept_edited, whole=True)
    if not options.force:
        calibrated.refuse_unfit("a certificate")
    details = details.of_arm(calibrated.serial, str(options.details), str(options.run))
    _refuse_unknown_covariance(calibrated)
    fitted = fitted_rows(calibrated)
    stage("2 of 3, evaluating the robot's performance and the quantities of the budget")
    device = fitted.instrument if options.instrument is None else named_instrument(options.instrument)
    robot = _found(calibrated, fitted)
    propagation = _propagation(calibrated, fitted)
    chance = random_errors(calibrated, fitted, device, details.robot.repeatability_mm, robot.repeats)
    source = str(options.instrument or calibrated.options.instrument or "")
    quantities = _quantities(calibrated, fitted, device, Path(source).name, details, propagation, chance)
    shown = validation_errors(
        calibrated, fitted, propagation, quantities, chance, instrument_noise_m(calibrated, fitted, device)
    )
    validation = None if shown is None else lack_of_fit(shown)
    quantities += _lack_of_fit(calibrated, propagation, validation)
    budgets = _budgets(quantities, propagation, stage)
    unseen = tuple(_unseen(device, details, propagation, chance, robot.repeats))
    totals = _with_unseen(quantities, unseen, propagation, budgets)
    facts = _facts(calibrated, source, robot)
    implausible = implausibilities(details, facts)
    issued = all(check.outcome != "failed" for check in implausible)
    expanded_m = totals[0] if device is None else budgets[0].expanded_m
    statement = _conformity(options, calibrated, expanded_m) if issued else None
    warnings = [*phrases(implausible), *_warnings(calibrated, device, details, chance, robot, validation)]
    return Certificate(
        options,
        calibrated,
        details,
        device,
        tuple(budgets),
        robot,
        statement,
        tuple(dict.fromkeys(warnings)),
        len(fitted.rows),
        implausible,
        validation,
        unseen,
        totals,
        digests_of(options.run),
    )


def _lack_of_fit(
    calibrated: CalibrationRun, propagation: Propagation, validation: LackOfFit | None
) -> list[InputQuantity]:
    """Return the errors on validation poses that the rest of the budget does not explain, where there are any."""
    if validation is None or not validation.sigma_m:
        return []
    where = f"validation on {validation.poses:,} poses, {calibrated.result.judged_by}"
    return [lack_of_fit_of(propagation, validation.sigma_m, validation.dof, where)]


def _refuse_unknown_covariance(calibrated: CalibrationRun) -> None:
    if not np.isfinite(calibrated.estimate.free_covariance).all():
        raise LabError(
            f"{calibrated.folder}: its covariance is unknown, because it has too few poses to estimate the noise; "
            "identify again with more poses, or with --noise-mm"
        )


def _budgets(quantities: Sequence[InputQuantity], propagation: Propagation, stage: Stage) -> list[Budget]:
    """Propagate the quantities into the budget of each measurand."""
    budgets = list[Budget]()
    for i, measurand in enumerate(MEASURANDS):
        stage("3 of 3, propagating the budgets", i, len(MEASURANDS))
        rng = rng_for(0, "null", i)
        budgets.append(budget_of(measurand, quantities, propagation.positions, propagation.moved, rng))
    return budgets


def _propagation(calibrated: CalibrationRun, fitted: FittedRows) -> Propagation:
    free = calibrated.estimate.free
    return Propagation.of(
        observation_of(calibrated.estimate.arm),
        fitted.observed,
        calibrated.estimate.values,
        free,
        without_range(calibrated.estimate) if calibrated.prior_took_part else None,
    )


def _found(calibrated: CalibrationRun, fitted: FittedRows) -> RobotFound:
    """Evaluate the robot at the measured points, commanded through the calibrated and the nominal model.

    Accuracy is that of rows that were not fitted; where there are none, only the nominal model has one.
    """
    estimate, unfitted = calibrated.estimate.as_measured, fitted.unfitted(calibrated)
    arm = estimate.arm
    rows = fitted.rows if unfitted is None else unfitted
    columns = [rows.targets.index(name) for name in arm.targets]
    measured, labels = rows.points[:, columns], _poses(rows)
    inputs = rows.inputs(arm.conditions)
    after, before = (arm.points(inputs, values) for values in (estimate.values, estimate.nominal))
    pairs = [distance_errors(measured, points, labels, rng_for(0, "split")) for points in (before, after)]
    of_fitted_rows = unfitted is None
    return RobotFound(
        pose_accuracy(measured - before, labels),
        None if of_fitted_rows else pose_accuracy(measured - after, labels),
        pairs[0],
        pairs[1][:0] if of_fitted_rows else pairs[1],
        *_repeated(calibrated, fitted),
    )


def _repeated(calibrated: CalibrationRun, fitted: FittedRows) -> tuple[Repeats | None, tuple[str, ...]]:
    """The repeats of all rows, fitted or not, and which rows have any."""
    estimate = calibrated.estimate.as_measured
    arm, errors, labels, places, where = (
        estimate.arm,
        list[Array](),
        list[NDArray[np.int_]](),
        list[Array](),
        list[str](),
    )
    targets = [name for name in arm.targets if all(name in rows.targets for rows in fitted.sets.values())]
    first = 0
    for name, rows in fitted.sets.items():
        inputs, poses = rows.inputs((*arm.conditions, PLACE)), _poses(rows)
        points = arm.points(inputs[:, :-1], estimate.values)
        measured = rows.points[:, [rows.targets.index(target) for target in targets]]
        errors.append(measured - points[:, [arm.targets.index(target) for target in targets]])
        labels.append(poses + first)
        places.append(inputs[:, -1])
        first += int(poses.max()) + 1
        if len(np.unique(poses)) < len(poses):
            where.append(name)
    if not where or not targets:
        return None, ()
    return repeats_of(np.concatenate(errors), np.concatenate(labels), np.concatenate(places)), tuple(where)


def _poses(rows: Measurements) -> NDArray[np.int_]:
    """Labels ``(n,)`` of poses; along a dense path, where neighbours are near and ends are not, each row is a pose."""
    labels = repeats(rows)
    for label in np.flatnonzero(np.bincount(labels) > 1):
        here = np.flatnonzero(labels == label)
        if np.ptp(rows.joints[here], axis=0).max() > SAME_CONFIGURATION:
            labels[here[1:]] = labels.max() + 1 + np.arange(len(here) - 1)
    return labels


def _quantities(
    calibrated: CalibrationRun,
    fitted: FittedRows,
    device: Instrument | None,
    source: str,
    details: CertificateDetails,
    propagation: Propagation,
    chance: RandomErrors,
) -> list[InputQuantity]:
    errors = TrackerErrors() if device is None else device.errors
    found = list(quantities_of(propagation, errors, source, chance))
    motions = *motions_found(calibrated), *fitted_motions(calibrated, fitted.rows, propagation.positions)
    found += [motion_of(propagation, motion) for motion in motions]
    if (temperature := details.robot_temperature) is not None:
        values = dict(zip(calibrated.estimate.arm.names, calibrated.estimate.values.tolist(), strict=True))
        base = np.array([values.get(f"base.{axis}", 0.0) for axis in "xyz"])
        found.append(temperature_of(propagation, base, *temperature))
    if details.scale is not None:
        found.append(scale_of(propagation, details.scale, "scale_ppm of [instrument]"))
    return found


def _unseen(
    device: Instrument | None,
    details: CertificateDetails,
    propagation: Propagation,
    chance: RandomErrors,
    found: Repeats | None,
) -> Iterator[Unseen]:
    """Yield the effects that neither measurements nor instrument specification covers, with their largest size."""
    if details.scale is None and (device is None or not device.errors.range_scale.standard):
        quantity = scale_of(propagation, Uncertain.within(LARGEST_SCALE_ERROR), "neither measured nor specified")
        remedy = "measure a scale bar, or state range_scale_ppm of the tracker or scale_ppm of [instrument]"
        yield Unseen(quantity, 1e2 * LARGEST_SCALE_ERROR, "%", remedy)
    if found is None or found.span < _SPANNING:
        own = chance.model, chance.repeatability
        squares = [each.sigma_m**2 for each in own if each is not None]
        quantity = unseen_move_of(propagation, float(np.sqrt(sum(squares, chance.noise.sigma_m**2))))
        remedy = "measure the first pose again half way and at the end (lab design --reference-every)"
        yield Unseen(quantity, MM.of(quantity.uncertainty.limit), "mm", remedy)


def _with_unseen(
    quantities: Sequence[InputQuantity], unseen: Sequence[Unseen], propagation: Propagation, budgets: Sequence[Budget]
) -> tuple[float, ...]:
    """The expanded uncertainty (m) of each measurand with what the measurements do not show, too."""
    whole = [*quantities, *(each.quantity for each in unseen)]
    expanded = [propagated(each, whole, propagation.positions, rng_for(0, "null")).expanded_m for each in MEASURANDS]
    return tuple(max(more, own.expanded_m) for more, own in zip(expanded, budgets, strict=True))


def _facts(calibrated: CalibrationRun, source: str, robot: RobotFound) -> CampaignFacts:
    measured_mm = None if robot.repeats is None else MM.of(robot.repeats.repeatability.mean_m)
    instrument = source if source in INSTRUMENTS else ""
    return CampaignFacts(calibrated.robot.name, instrument, calibrated.options.date or "", measured_mm)


def _conformity(options: CertifyOptions, calibrated: CalibrationRun, expanded_m: float) -> Conformity | None:
    result = calibrated.result
    tolerance = result.gate_mm if options.tolerance_mm is None else options.tolerance_mm
    if tolerance is None or result.after_mm is None:
        return None
    value = float(result.after_mm[options.statistic])
    return conformity_of(MM.to_si(value), MM.to_si(tolerance), expanded_m, options.decision_rule)


def _no_repeatability(*, repeated: bool) -> str:
    if repeated:
        return "repeated poses scatter no more than the instrument's noise, so the budget has no repeatability term"
    return (
        "the robot's repeatability was neither measured nor stated, so the budget lacks it; measure poses several "
        "times, or state repeatability_mm of [robot] in --details"
    )


def _warnings(
    calibrated: CalibrationRun,
    device: Instrument | None,
    details: CertificateDetails,
    chance: RandomErrors,
    robot: RobotFound,
    validation: LackOfFit | None,
) -> Iterator[str]:
    if validation is not None and validation.sigma_m:
        yield (
            f"the validation error is {MM.text(validation.observed_rms_m, 2)} (RMS), but the rest of the budget "
            f"predicts {MM.text(validation.expected_rms_m, 2)}: U includes the difference as lack of fit"
        )
    yield from calibrated.warnings
    if moved := calibrated.estimate.left_out:
        yield (
            f"{' and '.join(moved)}: base or instrument moved during the session, and on another day the robot may be "
            "as far from a calibrated position: U includes that as stability"
        )
    if isinstance(calibrated.options, VirtualCampaign):
        yield "the robot is virtual: nothing was measured, and this certificate is an example"
    if device is None or not device.errors.lasting:
        name = "the instrument is not known" if device is None else f"no systematic errors are stated of {device.name}"
        yield f"{name}, so the budget lacks systematic errors; give --instrument with the TOML file of a tracker"
    if chance.repeatability is None:
        yield _no_repeatability(repeated=robot.repeats is not None)
    if details.robot_temperature is None:
        yield "the robot's temperature is not stated, so the budget lacks it; state it in [environment] of --details"
    if missing := details.missing:
        yield f"the certificate is not traceable: --details does not state {missing_text(missing)}"
