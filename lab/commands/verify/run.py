"""A calibrated arm and a few new measurements: is it within its predicted error?"""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.calibration.checks.fit import check_extrapolated
from lab.calibration.checks.mistakes import noise_beyond
from lab.calibration.extrapolation import MOST_UNCOVERED
from lab.calibration.gauss_newton import Observations
from lab.calibration.identify import PLAUSIBLE_SPREAD, spread
from lab.calibration.statistics.outliers import LEAST_SIGMA_M
from lab.calibration.weights import Noise
from lab.campaign.instruments import named_instrument
from lab.commands.calibrate.load_run import (
    CalibrationRun,
    calibrated_by,
    folder_of,
    read_calibrated,
)
from lab.commands.calibrate.run import checked
from lab.commands.command_line import options_of, takes
from lab.commands.verify.options import VerifyOptions
from lab.commands.verify.result import VerificationResult
from lab.core.errors import LabError, be, counted, error_context
from lab.core.limits import one_serial
from lab.core.measurements import Measurements, without_copies
from lab.core.progress import Progress
from lab.core.se3 import Array
from lab.formats.measurement_csv import read_measurements
from lab.noise.instruments import observing
from lab.render.phrases.registry import phrase, phrases
from lab.render.terminal import Stage, status
from lab.sensors.registry import sensor_named
from lab.verification.new_measurements import held_against
from lab.verification.prediction import CalibrationPrediction
from lab.verification.situation import another_unit
from lab.verification.test import Verified
from lab.verification.test import verify as test

if TYPE_CHECKING:
    from lab.commands.calibrate.run import CalibrationResult

__all__ = ["verify"]

_LEAST_SPREAD = 3  # poses whose spread says something
_PASSES = 2  # times that all rows are gone through where nothing has changed
_SPREAD_OF = 4_000  # of more poses the spread of so many is as good
_TOO_GOOD = 1 - 1e-4  # a p-value that says that the noise is given too large


@takes(VerifyOptions, file="measurements")
def verify(
    run: "str | Path | CalibrationResult | VerifyOptions",
    measurements: str | Path | Measurements | None = None,
    **options: Any,
) -> VerificationResult:
    """Test a few new measurements against a calibrated robot; where it is no longer good, say what has moved.

    Args:
        run: what calibrated the robot: a result of ``calibrate`` or ``identify``, or the folder of a run; or all
            options in one object.
        measurements: a CSV file, or measurements in memory, in the frame of the run (m) unless ``refit`` says that
            the base was set up anew.
        options: those of ``lab verify``, by name: ``refit``, ``instrument``, ``noise_mm``, ``force``.

    Returns:
        Whether the errors are those that the calibration predicts, and what would explain them if not.

    Raises:
        LabError: the run is not good, is of another robot, or did not identify what was measured.

    Example:
        >>> import lab
        >>> day = lab.simulate("irb120", poses=60, seed=7)
        >>> old, new = day.measurements.take(range(50)), day.measurements.take(range(50, 60))
        >>> result = lab.identify(old, robot="irb120", instrument="uniform-8um")
        >>> lab.verify(result, new).to_dict()["good"]
        True
    """
    if isinstance(run, VerifyOptions):
        run.check()
        with status("reading the run"):
            calibrated = read_calibrated(run.run, accept_edited=run.accept_edited)
        return _verified(run, calibrated)
    if measurements is None:
        raise LabError("lab.verify: give the new measurements, a file or in memory")
    in_memory = measurements if isinstance(measurements, Measurements) else None
    file = "measurements.csv" if in_memory is not None else str(measurements)
    asked = options_of("lab.verify", VerifyOptions, {**folder_of(run), "file": file, **options})
    asked.check()
    return _verified(asked, calibrated_by(run, asked.run, accept_edited=asked.accept_edited), in_memory)


def _verified(
    options: VerifyOptions, calibrated: CalibrationRun, given: Measurements | None = None
) -> VerificationResult:
    if not options.force:
        calibrated.refuse_unfit("a verification")
    stated = {str(calibrated.folder): calibrated.serial, "--serial": options.serial}
    one_serial(stated, "verify it against a run of its own")
    _refuse_unseen_base(calibrated, options)
    with status("verifying") as stage:
        return _tested(options, calibrated, given, stage)


def _tested(
    options: VerifyOptions, calibrated: CalibrationRun, given: Measurements | None, stage: Stage
) -> VerificationResult:
    """The test, of a file unless measurements are given."""
    chain = calibrated.robot.chain
    stage("1 of 2, reading the measurements")
    if given is None:
        read = read_measurements(options.file, chain.joint_names, chain.prismatic)
    else:
        read = checked("measurements in memory", given, calibrated.robot)
    if calibrated.load is not None and "payload_kg" in calibrated.estimate.arm.conditions:
        read = calibrated.load.weighed(read)
    read = without_copies(Path(options.file), read)
    rows = read.only("calibrate", "reference", "test")
    rows = rows.with_points()
    calibrated.robot.refuse_impossible(options.file, rows)
    if not len(rows):
        raise LabError(f"{options.file}: no row to be used has a measured point; mark fewer with use = skip")
    if len(stations := dict.fromkeys(rows.stations)) > 1:
        raise LabError(
            f"{options.file}: measured from stations {', '.join(stations)}; verify the rows of each alone, with "
            "--refit base"
        )
    fitted = _if_fitted(calibrated, options, rows) if given is None else []
    tested = f"2 of 2, testing {len(rows):,} rows, twice or more"
    stage(tested)
    noise, stated = _noise(calibrated, options), options.noise_mm is not None or options.instrument is not None
    if not np.isfinite(calibrated.estimate.free_covariance).all():
        raise LabError(
            f"{options.run}: its covariance is unknown, as its poses left no residuals to say the noise; "
            "identify again with more poses, or with --noise-mm"
        )
    with error_context(options.file):
        known_m = calibrated.estimate.residual_m
        noisy = noise_beyond(options.noise_mm, rows, known_m, "the run's residuals")
        _refuse_strange(calibrated, rows, options)
        observations, prediction = held_against(calibrated.estimate, rows, noise, given=stated)
        _refuse_implausible(prediction, observations)
        names = [rows.where(i) for i in range(len(rows))]
        verified = test(prediction, observations, options.refit, names, _counted(stage, tested))
    lone = [rows.ids[i] for i in np.flatnonzero(calibrated.estimate.extrapolated(rows.joints))]
    said = [*_warnings(calibrated, read, rows, verified), *phrases(check_extrapolated("poses", lone, len(rows)))]
    said += fitted
    warnings = (*phrases(noisy), *said, *_repeat_where_measured(len(lone), len(rows), verified))
    return VerificationResult(options, calibrated, rows, verified, warnings)


def _counted(stage: Stage, words: str) -> Progress:
    """Shows what is done of all rows as often as they are gone through: twice, or as often as a change asks for."""
    passed = 0

    def progress(done: int, of: int) -> None:
        nonlocal passed
        stage(words, passed * of + done, max(_PASSES, passed + 1) * of)
        passed += done == of

    return progress


def _refuse_unseen_base(calibrated: CalibrationRun, options: VerifyOptions) -> None:
    observed = calibrated.options.observe
    if sensor_named(observed).in_instrument_frame:
        return
    if "base" not in options.refit:
        raise LabError(
            f"{options.run}: identified with --observe {observed}, so where the base is in an instrument's frame it "
            "does not say; add --refit base"
        )
    if options.instrument is None and options.noise_mm is None:
        raise LabError(
            f"{options.run}: identified with --observe {observed}, so what noise points have it does not say; "
            "add --instrument or --noise-mm"
        )


def _refuse_strange(calibrated: CalibrationRun, rows: Measurements, options: VerifyOptions) -> None:
    """Refuse targets that were not identified, unless the tool is fitted anew."""
    known = calibrated.estimate.arm.targets
    strange = [target for target in rows.targets if target not in known]
    if strange and "tool" not in options.refit:
        raise LabError(
            f"target {strange[0]} was not identified (those of the run are {', '.join(known)}); "
            "rename it, or add --refit tool"
        )
    if strange and calibrated.estimate.process is not None:
        raise LabError(
            f"target {strange[0]} was not identified, and {options.run} has the group residual, which is of its "
            "own targets; measure one of these, or identify again without residual"
        )


def _refuse_implausible(prediction: CalibrationPrediction, observations: Observations) -> None:
    """Points that spread unlike the robot's are of another unit, or of another robot."""
    some = observations.thinned(_SPREAD_OF)
    predicted = prediction.arm.points(some.inputs, prediction.values)
    spreads = [spread(np.where(np.isnan(some.points), np.nan, points)) for points in (some.points, predicted)]
    if (
        len(observations.inputs) >= _LEAST_SPREAD
        and not PLAUSIBLE_SPREAD[0] <= spreads[0] / spreads[1] <= PLAUSIBLE_SPREAD[1]
    ):
        other = another_unit(prediction, observations)
        raise LabError(
            f"the measured points spread {spreads[0] / spreads[1]:.3g} times as far as the robot's do in these poses: "
            f"{'wrong unit, or another robot' if other is None else phrase(other)}"
        )


def _noise(calibrated: CalibrationRun, options: VerifyOptions) -> Noise:
    """Return the noise of the new measurements: given, else assumed by the run, else estimated by the run."""
    shared = calibrated.estimate.shared
    given = None if shared is None else replace(shared, independent_share=1.0)
    if options.noise_mm is not None:
        return Noise(sigma_m=options.noise_mm / 1e3, shared=given)
    if options.instrument is not None:
        return Noise(observing(named_instrument(options.instrument), "points"), shared=given)
    if (known_mm := calibrated.options.noise_mm) is not None:
        return Noise(sigma_m=known_mm / 1e3, shared=shared)
    if calibrated.instrument is not None:
        return Noise(calibrated.instrument, readings=calibrated.readings, shared=shared)
    return Noise(sigma_m=max(calibrated.estimate.noise_m, LEAST_SIGMA_M), shared=given)


def _if_fitted(calibrated: CalibrationRun, options: VerifyOptions, rows: Measurements) -> list[str]:
    """Refuse rows that the run was identified from, to the last digit: of these it says nothing new.

    Returns:
        What is to be told where ``--force`` takes them all the same; mostly nothing.
    """
    own = calibrated.folder / "measurements.csv"
    if not own.is_file():
        return []
    chain = calibrated.robot.chain
    fitted = read_measurements(own, chain.joint_names, chain.prismatic)
    if fitted.targets != rows.targets:
        return []
    known = {row.tobytes() for row in _numbers(fitted)}
    again = [i for i, row in enumerate(_numbers(rows)) if row.tobytes() in known]
    if not again:
        return []
    said = (
        f"{options.file}: {len(again)} of {counted(len(rows), 'row')} {be(len(again))} among those that the "
        f"run was identified from (the first: {rows.where(again[0])}), which verify nothing new; measure poses again"
    )
    if not options.force:
        raise LabError(f"{said}, or say --force")
    return [said]


def _numbers(rows: Measurements) -> Array:
    numbers: Array = np.column_stack([rows.joints, rows.points.reshape(len(rows), -1)])
    return numbers


def _warnings(calibrated: CalibrationRun, read: Measurements, rows: Measurements, verified: Verified) -> list[str]:
    """Collect the warnings for the reader."""
    chain, said = calibrated.robot.chain, [*calibrated.warnings, *read.warnings]
    if blank := len(read.only("calibrate", "reference", "test")) - len(rows):
        said.append(f"{blank} rows have no measured point and are left out")
    outside = chain.beyond_limits(rows.joints, 1e-3)
    said += [
        f"joint {name}: {rows.where(int(np.argmax(beyond)))} is beyond its limits; check units, signs and offsets"
        for name, beyond in zip(chain.joint_names, outside.T, strict=True)
        if beyond.any()
    ]
    if len(sessions := list(dict.fromkeys(rows.sessions))) > 1:
        said.append(f"sessions {', '.join(sessions)} are taken for one setup; verify each alone if one was set up anew")
    if "payload_kg" in calibrated.estimate.arm.conditions and "payload_kg" not in rows.conditions:
        said.append("no column payload_kg: the flange is assumed to carry nothing in any pose")
    if verified.undetermined:
        names = ", ".join(verified.undetermined)
        said.append(
            f"these poses do not determine {names}, which stay as the run has them; the test does not depend on it"
        )
    if verified.p_of_all > _TOO_GOOD:
        said.append(
            f"errors are much smaller than predicted (p = {verified.p_of_all:.6f}): the noise is given too large"
        )
    return said


def _repeat_where_measured(lone: int, count: int, verified: Verified) -> list[str]:
    """Advise what to do if a change is found mostly by extrapolated poses."""
    if verified.good or lone <= MOST_UNCOVERED * count:
        return []
    return [
        "most of these poses are where the run fitted none, so what its model lacks there may look like a change; "
        "measure again at poses of the run before the arm is called changed"
    ]
