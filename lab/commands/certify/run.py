"""A calibration's certificate: what its positions are worth, and how the robot was found."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from lab.calibration.observations.protocol import observation_of
from lab.calibration.statistics.replicates import repeats
from lab.campaign.instruments import named_instrument
from lab.campaign.options import VirtualCampaign
from lab.certification.budget import MEASURANDS, Budget, InputQuantity, budget_of
from lab.certification.characteristics import distance_errors, pose_characteristics
from lab.certification.conformity import Conformity, conformity_of
from lab.certification.propagation import Propagation
from lab.certification.quantities import RandomErrors, quantities_of, temperature_of
from lab.commands.calibrate.load_run import Calibrated, read_calibrated
from lab.commands.certify.chance import random_errors
from lab.commands.certify.fitted import FittedRows, fitted_rows
from lab.commands.certify.options import CertifyOptions
from lab.commands.certify.result import Certificate, RobotFound
from lab.core.errors import LabError
from lab.core.instruments import Instrument
from lab.core.random import rng_for
from lab.core.tracker_errors import TrackerErrors
from lab.formats.certificate_toml import CertificateDetails, read_certificate_details
from lab.render.progress import Stage, status

__all__ = ["certify"]


def certify(options: CertifyOptions) -> Certificate:
    """Work out the uncertainty budget of a run, and what its measurements say of the robot.

    Raises:
        LabError: the run cannot be read, its verdict is bad or not judged, or a file makes no sense.
    """
    with threadpool_limits(1), status("certifying") as stage:  # one thread: the bits stay the same
        return _certified(options, stage)


def _certified(options: CertifyOptions, stage: Stage) -> Certificate:
    options.check()
    stage("1 of 3, reading the run")
    details = CertificateDetails() if options.details is None else read_certificate_details(options.details)
    calibrated = read_calibrated(options.run, accept_edited=options.accept_edited)
    if not options.force:
        calibrated.refuse_unfit("a certificate")
    if not np.isfinite(calibrated.covariance).all():
        raise LabError(
            f"{options.run}: its covariance is unknown, as its poses left no residuals to say the noise; identify "
            "again with more poses, or with --noise-mm"
        )
    fitted = fitted_rows(calibrated)
    stage("2 of 3, the robot as it was found, and the quantities of the budget")
    device = fitted.instrument if options.instrument is None else named_instrument(options.instrument)
    robot = _found(calibrated, fitted)
    propagation = _propagation(calibrated, fitted)
    chance = random_errors(calibrated, fitted, device, details.robot.repeatability_mm, robot.after)
    source = str(options.instrument or calibrated.options.instrument or "")
    quantities = _quantities(calibrated, device, Path(source).name, details, propagation, chance)
    budgets = []
    for i, each in enumerate(MEASURANDS):
        stage("3 of 3, budgets, propagated and drawn", i, len(MEASURANDS))
        budgets.append(budget_of(each, quantities, propagation.positions, propagation.moved, rng_for(0, "null", i)))
    return Certificate(
        options,
        calibrated,
        details,
        device,
        tuple(budgets),
        robot,
        _conformity(options, calibrated, budgets[0]),
        tuple(dict.fromkeys(_warnings(calibrated, device, details, chance))),
        len(fitted.rows),
    )


def _propagation(calibrated: Calibrated, fitted: FittedRows) -> Propagation:
    free = tuple(calibrated.arm.names.index(name) for name in calibrated.identified)
    return Propagation.of(
        observation_of(calibrated.arm),
        fitted.observed,
        calibrated.values,
        free,
        calibrated.covariance if calibrated.options.fitting.prior else None,
    )


def _found(calibrated: Calibrated, fitted: FittedRows) -> RobotFound:
    """What the measured points say of the robot, commanded through the calibrated and the nominal model."""
    rows, arm = fitted.reported, calibrated.arm
    columns = [rows.targets.index(name) for name in arm.targets]
    measured, labels = rows.points[:, columns], repeats(rows)
    inputs = rows.inputs(arm.conditions)
    after, before = (arm.points(inputs, values) for values in (calibrated.values, calibrated.nominal_aligned))
    pairs = [distance_errors(measured, points, labels, rng_for(0, "split")) for points in (before, after)]
    return RobotFound(
        pose_characteristics(measured - before, labels),
        pose_characteristics(measured - after, labels),
        pairs[0],
        pairs[1],
        of_fitted_rows=fitted.judged is None,
    )


def _quantities(
    calibrated: Calibrated,
    device: Instrument | None,
    source: str,
    details: CertificateDetails,
    propagation: Propagation,
    chance: RandomErrors,
) -> list[InputQuantity]:
    errors = TrackerErrors() if device is None else device.errors
    found = list(quantities_of(propagation, errors, source, chance))
    if (known := details.robot_temperature) is not None:
        values = dict(zip(calibrated.arm.names, calibrated.values.tolist(), strict=True))
        foot = np.array([values.get(f"base.{axis}", 0.0) for axis in "xyz"])
        found.append(temperature_of(propagation, foot, *known))
    return found


def _conformity(options: CertifyOptions, calibrated: Calibrated, budget: Budget) -> Conformity | None:
    """The statement, where there is a tolerance and a value."""
    result = calibrated.result
    tolerance = result.gate_mm if options.tolerance_mm is None else options.tolerance_mm
    if tolerance is None or result.after_mm is None:
        return None
    value = float(result.after_mm[options.statistic])
    return conformity_of(value / 1e3, tolerance / 1e3, budget.expanded_m, options.decision_rule)


def _warnings(
    calibrated: Calibrated, device: Instrument | None, details: CertificateDetails, chance: RandomErrors
) -> Iterator[str]:
    """What a reader should be told: of the run, and what the budget does not have."""
    yield from calibrated.warnings
    if isinstance(calibrated.options, VirtualCampaign):
        yield "the robot is virtual: nothing was measured, and this certificate is an example"
    if device is None or not device.errors.lasting:
        name = "the instrument is not known" if device is None else f"of {device.name} no systematic errors are stated"
        yield f"{name}: the budget has none; give --instrument with the TOML file of a tracker"
    if chance.repeatability is None:
        yield (
            "the robot's repeatability was neither measured nor stated: the budget has none; measure poses several "
            "times, or state repeatability_mm of [robot] in --details"
        )
    if details.robot_temperature is None:
        yield "the robot's temperature is not stated: the budget has none; state it in [environment] of --details"
    if (at := details.certificate.date) and at < (checked := details.instrument.certificate_date):
        yield f"the certificate's date, {at}, is before that of the instrument's certificate, {checked}: mend --details"
    if missing := details.missing:
        yield f"not traceable as it is: {', '.join(missing)} missing in --details"
