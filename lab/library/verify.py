"""Verify a calibrated robot: by measured points, or by daily touches of a socket, which this also plans."""

from collections.abc import Mapping
from dataclasses import dataclass
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
from lab.library.touch_verification import TouchesResult, planned_touches, verified_touches
from lab.options.call_options import options_of, takes
from lab.options.command_options import VerifyOptions
from lab.sensors.sensor_registry import sensor_named

if TYPE_CHECKING:
    from lab.library.calibration_result import CalibrationResult

__all__ = ["plan_touches", "verification_of", "verify", "verify_touches"]


_OF_TOUCHES = ("reference", "since")  # options that only daily touches have a use for
_OF_POINTS = ("refit", "instrument", "noise_mm")


@takes(VerifyOptions, unused=("observe", "plan", *_OF_TOUCHES), file="measurements")
def verify(
    run: "str | Path | CalibrationResult | VerifyOptions",
    measurements: str | Path | Measurements | None = None,
    **options: Any,
) -> VerificationResult:
    """Test a few new measurements against a calibrated robot; if it is no longer good, report what moved.

    Args:
        run: what calibrated the robot: a result of ``calibrate`` or ``identify``, or the folder of a run; or all
            options in one object.
        measurements: a CSV file, or measurements in memory: points in the frame of the run (m) unless ``refit`` says
            that the base was set up anew. Daily touches of a socket are for ``lab.verify_touches``.
        options: those of ``lab verify`` for points, by name: ``refit``, ``accept``, ``instrument``, ``noise_mm``,
            ``force``.

    Returns:
        Whether the errors are those that the calibration predicts, and what would explain them if not.

    Raises:
        LabError: the run is not good, is of another robot, or did not identify what was measured.

    Example:
        >>> import lab
        >>> day = lab.simulate("irb120", poses=60, seed=7)
        >>> old, new = day.measurements[:50], day.measurements[50:]
        >>> result = lab.identify(old, robot="irb120", instrument="uniform-8um")
        >>> lab.verify(result, new).to_dict()["good"]
        True
    """
    new = _new_measurements("lab.verify", run, measurements, options)
    data = new.points()
    return verified_points(new.options, new.calibrated, data, from_file=new.in_memory is None)


@takes(VerifyOptions, unused=("observe", "plan", *_OF_POINTS), file="measurements")
def verify_touches(
    run: "str | Path | CalibrationResult | VerifyOptions",
    measurements: str | Path | Measurements | None = None,
    **options: Any,
) -> TouchesResult:
    """Test daily touches of a socket against a calibrated robot; if a check is out of the others, report what moved.

    Args:
        run: what calibrated the robot: a result of ``calibrate`` or ``identify``, or the folder of a run; or all
            options in one object.
        measurements: all touches so far, a CSV file or in memory: joint positions with a ball in the socket, the day of
            each row in ``session`` (YYYY-MM-DD).
        options: those of ``lab verify`` for touches, by name: ``reference``, ``since``, ``accept``, ``force``.

    Returns:
        Whether the checks repeat as the first ones did, and which joint, base or tool would explain a change.

    Raises:
        LabError: the run is not good or is of another robot, or the rows make no checks.

    Example:
        >>> import lab, numpy as np
        >>> result = lab.calibrate("irb120", poses=30, seed=1)
        >>> first = lab.measurements([[1.55, -1.1, 0.57, 1.05, -1.72, 0.29]], robot="irb120")
        >>> joints = np.tile(lab.plan_touches(result, first, 4).joints, (12, 1))
        >>> joints += np.random.default_rng(7).normal(0, 1e-5, joints.shape)  # rad: no two touches are the same
        >>> days = [f"2026-03-{1 + row // 4:02}" for row in range(len(joints))]
        >>> touches = lab.measurements(joints, robot="irb120", sessions=days)
        >>> lab.verify_touches(result, touches).verdict
        'good'
    """
    new = _new_measurements("lab.verify_touches", run, measurements, options)
    return verified_touches(new.options, new.calibrated, new.touches())


@takes(
    VerifyOptions, unused=("observe", "require", "accept", *_OF_POINTS, *_OF_TOUCHES), file="measurements", plan="count"
)
def plan_touches(
    run: "str | Path | CalibrationResult | VerifyOptions",
    measurements: str | Path | Measurements | None = None,
    count: int = 4,
    **options: Any,
) -> TouchPlan:
    """Propose configurations in which a robot touches a socket each day, by a first touch of each socket.

    Args:
        run: what calibrated the robot: a result of ``calibrate`` or ``identify``, or the folder of a run; or all
            options in one object.
        measurements: a touch of each socket, a CSV file or in memory: joint positions with a ball in the socket.
        count: number of configurations, 4 or more.
        options: those of ``lab verify``, by name: ``force``, ``accept_edited``, ``serial``.

    Returns:
        The configurations, and how well each joint's zero is seen in them.

    Raises:
        LabError: the run is not good or is of another robot, or no such configurations are found.

    Example:
        >>> import lab
        >>> result = lab.calibrate("irb120", poses=30, seed=1)
        >>> first = lab.measurements([[1.55, -1.1, 0.57, 1.05, -1.72, 0.29]], robot="irb120")
        >>> lab.plan_touches(result, first, 5).joints.shape
        (5, 6)
    """
    new = _new_measurements("lab.plan_touches", run, measurements, {**options, "plan": count})
    return planned_touches(new.options, new.calibrated, new.touches())


def verification_of(options: VerifyOptions) -> VerificationResult | TouchesResult | TouchPlan:
    """Run the command ``lab verify``: of points or of touches, whichever the file holds."""
    new = _new_measurements("lab.verify", options, None, {})
    data, touches = new.read()
    options.refuse_others(touches=touches)
    if options.plan is not None:
        return planned_touches(options, new.calibrated, data)
    if touches:
        return verified_touches(options, new.calibrated, data)
    return verified_points(options, new.calibrated, data, from_file=True)


@dataclass(frozen=True)
class _NewMeasurements:
    """New measurements, in memory or in a file, and the run that calibrated the robot."""

    options: VerifyOptions
    calibrated: CalibrationRun
    in_memory: Measurements | None

    def points(self) -> Measurements:
        """Return measured points.

        Raises:
            LabError: there are none.
        """
        if self.in_memory is None:
            read, touches = self.read()
        else:
            read, touches = self.in_memory, not self.in_memory.targets
        if touches:
            raise LabError(f"lab.verify: {self.options.file} holds touches of a socket; give it to lab.verify_touches")
        return read if self.in_memory is None else checked("measurements in memory", read, self.calibrated.robot)

    def touches(self) -> Measurements:
        """Return touches of a socket."""
        if self.in_memory is None:
            return self._read(sensor_named("socket").columns)
        return checked("measurements in memory", self.in_memory, self.calibrated.robot, points=False)

    def read(self) -> tuple[Measurements, bool]:
        """Read the file; and decide whether it holds touches: it has no points, but days or sockets."""
        touches = self.options.of_touches
        if not touches and self.options.observe is None:
            read = self._read(ObservedColumns(required=False))
            if read.targets:
                return read, False
            touches = any(read.sessions) or "socket" in read.other
        return (self._read(sensor_named("socket").columns), True) if touches else (self._read(ObservedColumns()), False)

    def _read(self, columns: ObservedColumns) -> Measurements:
        chain, conditions = self.calibrated.robot.chain, self.calibrated.estimate.arm.conditions
        with_conditions = columns.with_conditions(conditions)
        return read_measurements(self.options.file, chain.joint_names, chain.prismatic, columns=with_conditions)


def _new_measurements(
    call: str,
    run: "str | Path | CalibrationResult | VerifyOptions",
    measurements: str | Path | Measurements | None,
    options: Mapping[str, Any],
) -> _NewMeasurements:
    """Return what a call is given, after its options and the run are checked."""
    if isinstance(run, Measurements):
        raise LabError(f"{call}: the measurements are given first; give the run first, then the measurements")
    in_memory = measurements if isinstance(measurements, Measurements) else None
    if isinstance(run, VerifyOptions):
        requested = run
        requested.check()
        with stages("reading the run"):
            calibrated = load_run(run.run, accept_edited=run.accept_edited)
    elif measurements is None:
        raise LabError(f"{call}: give the new measurements, a file or in memory")
    else:
        file = "measurements.csv" if in_memory is not None else str(measurements)
        requested = options_of(call, VerifyOptions, {**folder_of(run), "file": file, **options})
        requested.check()
        calibrated = calibrated_by(run, requested.run, accept_edited=requested.accept_edited)
    if not requested.force:
        calibrated.refuse_unfit("a verification")
    stated = {str(calibrated.folder): calibrated.serial, "--serial": requested.serial}
    one_serial(stated, "verify it against a run of its own")
    return _NewMeasurements(requested, calibrated, in_memory)
