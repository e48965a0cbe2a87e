"""Run ``lab verify``: of measured points, or of daily touches of a socket, whichever the file holds."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from lab.core.errors import LabError
from lab.core.limits import one_serial
from lab.core.measurements import Measurements
from lab.core.progress import stages
from lab.formats.measurement_csv import ObservedColumns, read_measurements
from lab.library.load_run import CalibrationRun, calibrated_by, folder_of, load_run
from lab.library.measurement_checks import checked
from lab.library.point_verification import VerificationResult, verified_points
from lab.library.touch_plan import TouchPlan
from lab.library.touch_verification import TouchesResult, verified_touches
from lab.options.call_options import options_of, takes
from lab.options.command_options import VerifyOptions
from lab.sensors.sensor_registry import sensor_named

if TYPE_CHECKING:
    from lab.library.calibration_result import CalibrationResult

__all__ = ["verify"]


@takes(VerifyOptions, file="measurements")
def verify(
    run: "str | Path | CalibrationResult | VerifyOptions",
    measurements: str | Path | Measurements | None = None,
    **options: Any,
) -> VerificationResult | TouchesResult | TouchPlan:
    """Test a few new measurements against a calibrated robot; if it is no longer good, report what moved.

    Args:
        run: what calibrated the robot: a result of ``calibrate`` or ``identify``, or the folder of a run; or all
            options in one object.
        measurements: a CSV file, or measurements in memory: points in the frame of the run (m) unless ``refit`` says
            that the base was set up anew; or, without points, joint positions with a ball in a socket, the day of each
            row in ``session``.
        options: those of ``lab verify``, by name: ``refit``, ``instrument``, ``noise_mm``, ``force``; of touches
            ``reference``, ``since``, ``plan``.

    Returns:
        Whether the errors are those that the calibration predicts, and what would explain them if not; with ``plan``
        the configurations that are proposed.

    Raises:
        LabError: the run is not good, is of another robot, or did not identify what was measured.

    Example:
        >>> import lab
        >>> day = lab.simulate("irb120", poses=60, seed=7)
        >>> old, new = day.measurements[:50], day.measurements[50:60]
        >>> result = lab.identify(old, robot="irb120", instrument="uniform-8um")
        >>> lab.verify(result, new).to_dict()["good"]
        True
    """
    if isinstance(run, VerifyOptions):
        run.check()
        with stages("reading the run"):
            calibrated = load_run(run.run, accept_edited=run.accept_edited)
        return _verified(run, calibrated)
    if measurements is None:
        raise LabError("lab.verify: give the new measurements, a file or in memory")
    in_memory = measurements if isinstance(measurements, Measurements) else None
    file = "measurements.csv" if in_memory is not None else str(measurements)
    requested = options_of("lab.verify", VerifyOptions, {**folder_of(run), "file": file, **options})
    requested.check()
    by = calibrated_by(run, requested.run, accept_edited=requested.accept_edited)
    return _verified(requested, by, in_memory)


def _verified(
    options: VerifyOptions, calibrated: CalibrationRun, given: Measurements | None = None
) -> VerificationResult | TouchesResult | TouchPlan:
    if not options.force:
        calibrated.refuse_unfit("a verification")
    stated = {str(calibrated.folder): calibrated.serial, "--serial": options.serial}
    one_serial(stated, "verify it against a run of its own")
    if given is not None:
        touches = options.of_touches or not given.targets
        read = checked("measurements in memory", given, calibrated.robot, points=not touches)
    else:
        read, touches = _read(options, calibrated)
    options.refuse_others(touches=touches)
    if touches:
        return verified_touches(options, calibrated, read)
    return verified_points(options, calibrated, read, from_file=given is None)


def _read(options: VerifyOptions, calibrated: CalibrationRun) -> tuple[Measurements, bool]:
    """Read the file; and decide whether it holds touches: it has no points, but days or sockets."""
    chain, conditions = calibrated.robot.chain, calibrated.estimate.arm.conditions

    def read(columns: ObservedColumns) -> Measurements:
        with_conditions = columns.with_conditions(conditions)
        return read_measurements(options.file, chain.joint_names, chain.prismatic, columns=with_conditions)

    touches = options.of_touches
    if not touches and options.observe is None:
        found = read(ObservedColumns(required=False))
        if found.targets:
            return found, False
        touches = any(found.sessions) or "socket" in found.other
    return (read(sensor_named("socket").columns), True) if touches else (read(ObservedColumns()), False)
