"""A calibrated arm at joint positions: where its points are, with all effects, and how sure that is."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.calibration.checks.fit import check_limits
from lab.commands.calibrate.load_run import CalibrationRun, calibrated_by, condition_notes, folder_of, read_calibrated
from lab.commands.command_line import options_of, takes
from lab.commands.predict.options import PredictOptions
from lab.commands.predict.result import PredictionResult
from lab.core.errors import LabError, error_context
from lab.core.measurements import Measurements, measured
from lab.core.se3 import Array
from lab.formats.measurement_csv import read_measurements
from lab.render.phrases.registry import phrases

__all__ = ["predict"]

if TYPE_CHECKING:
    from lab.commands.calibrate.run import CalibrationResult


@takes(PredictOptions, file="joints")
def predict(
    joints: "str | Path | Measurements | Array | Sequence[Sequence[float]] | PredictOptions",
    run: "str | Path | CalibrationResult | None" = None,
    conditions: Mapping[str, Any] | None = None,
    **options: Any,
) -> PredictionResult:
    """Predict where the points of a calibrated robot are at joint positions, with all identified effects.

    Args:
        joints: a CSV file; or joint positions in memory, ``(n, joints)`` in rad (m of a slide), or measurements; or
            all options in one object.
        run: what calibrated the robot: a result of ``calibrate`` or ``identify``, or the folder of a run.
        conditions: of joint positions in memory, by the names of a file's columns: ``payload_kg``, ``temp_C``,
            ``approach_q1``; one number, or one for each pose.
        options: those of ``lab predict``, by name: ``force``, ``load``, ``accept_edited``.

    Returns:
        Points (m) in the frame in which the robot was measured and in its base, with the pose of the tool, and the
        covariance of each point's error, by its cause.

    Raises:
        LabError: the run is not good, joint positions are not the robot's, or a condition that the model asks for is
            missing.

    Example:
        >>> import lab
        >>> result = lab.calibrate("irb120", seed=7)
        >>> there = lab.predict([[0.1, 0.2, -0.3, 0.4, 0.5, 0.6]], run=result)
        >>> there.points.shape
        (1, 1, 3)
    """
    if isinstance(joints, PredictOptions):
        by = read_calibrated(joints.run, joints.load, accept_edited=joints.accept_edited)
        return _predicted(joints, by, _read(joints.file, by))
    file = str(joints) if isinstance(joints, str | Path) else "joints in memory"
    asked = options_of("lab.predict", PredictOptions, {"file": file, **folder_of(run), **options})
    by = calibrated_by(run, asked.run, asked.load, accept_edited=asked.accept_edited)
    if isinstance(joints, str | Path):
        if conditions is not None:
            raise LabError("lab.predict: conditions are for joints in memory; a file has them in its columns")
        return _predicted(asked, by, _read(asked.file, by))
    rows = joints if isinstance(joints, Measurements) else _in_memory(joints, by)
    return _predicted(asked, by, _with_conditions(rows, conditions or {}))


def _read(file: Path, run: CalibrationRun) -> Measurements:
    """The rows of a file that are not to be skipped."""
    chain = run.robot.chain
    data = read_measurements(file, chain.joint_names, chain.prismatic, points=False)
    return data.take([i for i, use in enumerate(data.use) if use != "skip"])


def _in_memory(joints: "Array | Sequence[Sequence[float]]", run: CalibrationRun) -> Measurements:
    chain = run.robot.chain
    try:
        rows = np.atleast_2d(np.asarray(joints, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise LabError(f"lab.predict: joints are no array of numbers ({error}); give (n, {chain.size})") from error
    if rows.ndim != 2 or rows.shape[1] != chain.size or not np.isfinite(rows).all():
        raise LabError(
            f"lab.predict: joints of shape {rows.shape} for robot {run.robot.name}; give (n, {chain.size}) finite "
            "positions in rad, of a slide in m"
        )
    return measured(chain.joint_names, rows, (), np.empty((len(rows), 0, 3)))


def _with_conditions(rows: Measurements, given: Mapping[str, Any]) -> Measurements:
    columns = dict(rows.conditions)
    for name, value in given.items():
        try:
            columns[name] = np.array(np.broadcast_to(np.asarray(value, dtype=np.float64), len(rows)))
        except (TypeError, ValueError) as error:
            raise LabError(f"lab.predict: condition {name}: give one number, or one for each pose") from error
    return replace(rows, conditions=columns)


def _predicted(options: PredictOptions, run: CalibrationRun, rows: Measurements) -> PredictionResult:
    """Predict the rows.

    Raises:
        LabError: the run is unfit or places no points, or a condition is missing.
    """
    if not options.force:
        run.refuse_unfit("prediction")
    run.refuse_unplaced("points")
    if not len(rows):
        raise LabError(f"{options.file}: holds no row to predict; give joint positions")
    run.robot.refuse_impossible(options.file, rows)
    estimate = run.estimate
    notes = [*run.warnings, *rows.warnings, *phrases(check_limits(run.robot.chain, rows))]
    notes += condition_notes(run, options.file, list(rows.conditions), "pose", "predicted")
    rows = rows if run.load is None else run.load.weighed(rows)
    with error_context(options.file):
        inputs = rows.inputs(estimate.arm.conditions)
    Ts, _ = estimate.arm.tool(inputs, estimate.values)
    off = estimate.geometry_error(inputs)
    return PredictionResult(options, run, rows, inputs, estimate.predict(inputs), Ts[:, :3, :3], off, tuple(notes))
