"""Predict the points of a calibrated arm at joint positions, with all effects and their uncertainty."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError, error_context
from lab.core.measurements import Measurements, measured
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.csv_table import write_columns
from lab.formats.measurement_csv import ObservedColumns, read_measurements
from lab.library.load_run import CalibrationRun, calibrated_by, condition_notes, folder_of, load_run
from lab.library.result import Result, number, plain_numbers
from lab.library.run_folder import joint_columns
from lab.options.call_options import options_of, takes
from lab.options.command_options import PredictOptions
from lab.phrases.phrase import phrases
from lab.prediction.point_errors import PredictedPoints
from lab.verdict.fit_checks import check_extrapolated, check_limits

if TYPE_CHECKING:
    from lab.library.calibration_result import CalibrationResult

__all__ = ["PREDICTED_FILE", "PredictionResult", "predict"]

PREDICTED_FILE = "predicted.csv"
_PAIRS = ((0, 0, "xx"), (0, 1, "xy"), (0, 2, "xz"), (1, 1, "yy"), (1, 2, "yz"), (2, 2, "zz"))


@dataclass(frozen=True, repr=False, eq=False)
class PredictionResult(Result):
    """Predicted points of a calibrated arm at given joint positions.

    Attributes:
        run: the run that calibrated the arm.
        rows: the joint positions, with their conditions.
        inputs: ``(n, joints + conditions)`` of the arm.
        predicted: the measured points in the frame in which the arm was measured, with covariances.
        R_instrument_last: rotations ``(n, 3, 3)`` of the last frame there.
        without_effects_m: error of geometry alone at these poses (root mean square); None where there is nothing
            else.
        notes: warnings on the inputs.
    """

    command = "predict"
    robot_at = "run.robot"

    options: PredictOptions
    run: CalibrationRun
    rows: Measurements
    inputs: Array
    predicted: PredictedPoints
    R_instrument_last: Array
    without_effects_m: float | None
    notes: tuple[str, ...]

    @property
    def points(self) -> Array:
        """``(n, k, 3)`` m, in the frame in which the arm was measured; NaN where loops of a mechanism do not close."""
        return self.predicted.points

    @property
    def exit_code(self) -> int:
        """0 where every pose is predicted, else 1."""
        return 0 if np.isfinite(self.points).all() else 1

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings for the reader."""
        ids = [self.rows.ids[i] for i in np.flatnonzero(self.extrapolated)]
        lost = np.flatnonzero(~np.isfinite(self.points).all(axis=(1, 2)))
        messages = []
        if len(lost):
            messages = [f"{len(lost)} poses are out of reach of the calibrated arm (first: {self.rows.ids[lost[0]]})"]
        return (*self.notes, *phrases(check_extrapolated("poses", ids, len(self.rows))), *messages)

    @cached_property
    def extrapolated(self) -> NDArray[np.bool_]:
        """``(n,)`` which poses no fitted pose is near, where the model is known to lack something."""
        return self.run.estimate.extrapolated(self.inputs[:, : self.run.robot.chain.size])

    @property
    def T_instrument_base(self) -> Array:
        """Pose ``(4, 4)`` (m) of the arm's base, frame 0 of its table, in the frame of the measurements."""
        rigid, values = self.run.estimate.geometry
        return rigid.T_tracker_frame0(values)

    @property
    def points_in_base(self) -> Array:
        """``(n, k, 3)`` m: the points in the arm's base."""
        return np.asarray(se3.transform(se3.inverse(self.T_instrument_base), self.points))

    @property
    def rotations(self) -> Array:
        """``(n, 3, 3)`` of the tool: as measured where orientations were, else of the last frame."""
        return np.asarray(self.R_instrument_last @ self.run.estimate.R_last_tool)

    @cached_property
    def radii_95(self) -> dict[str, Array]:
        """``(n, k)`` m: lengths that 95 % of the errors do not exceed: parameters, unmodelled, visit, together."""
        return self.predicted.radii_95()

    @property
    def radius_statistics_mm(self) -> dict[str, dict[str, float | None]]:
        """Mean and largest of these over all poses and points."""
        found = {}
        for name, lengths in self.radii_95.items():
            sizes = MM.of(lengths[np.isfinite(lengths)])
            found[name] = {
                "mean": number(float(sizes.mean())) if sizes.size else None,
                "max": number(float(sizes.max())) if sizes.size else None,
            }
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints and ``result.json`` holds: lengths in mm."""
        T, errors = self.T_instrument_base, self.without_effects_m
        return {
            "run": str(self.run.folder),
            "robot": self.run.robot.name,
            "run_verdict": self.run.result.to_dict(),
            "model": self.run.estimate.model,
            "poses": len(self.rows),
            "frames": {
                "instrument": "the frame in which the arm was measured",
                "base": "frame 0 of the arm's table",
                "base_in_instrument": {
                    "position_mm": plain_numbers(MM.of(T[:3, 3])),
                    "quaternion_wxyz": plain_numbers(se3.quaternion_from_rotation(T[:3, :3])),
                },
            },
            "radius_95_mm": self.radius_statistics_mm,
            "without_effects_mm": None if errors is None else number(MM.of(errors)),
            "predictions": self._predictions(),
            "warnings": list(self.warnings),
        }

    def _predictions(self) -> list[dict[str, Any]]:
        points, base = plain_numbers(MM.of(self.points)), plain_numbers(MM.of(self.points_in_base))
        covariances = plain_numbers(1e6 * self.predicted.covariance)
        radii = {name: plain_numbers(MM.of(lengths)) for name, lengths in self.radii_95.items()}
        here, there = (plain_numbers(se3.quaternion_from_rotation(R)) for R in self._both_rotations)
        return [
            {
                "id": self.rows.ids[i],
                "extrapolated": bool(self.extrapolated[i]),
                "quaternion_wxyz": {"instrument": here[i], "base": there[i]},
                "points": {
                    target: {
                        "instrument_mm": points[i][k],
                        "base_mm": base[i][k],
                        "covariance_mm2": covariances[i][k],
                        "radius_95_mm": {name: lengths[i][k] for name, lengths in radii.items()},
                    }
                    for k, target in enumerate(self.run.estimate.arm.targets)
                },
            }
            for i in range(len(self.rows))
        ]

    @property
    def _both_rotations(self) -> tuple[Array, Array]:
        return self.rotations, np.asarray(self.T_instrument_base[:3, :3].T @ self.rotations)

    def write_files(self, folder: Path) -> None:
        """Write ``predicted.csv``."""
        write_columns(folder / PREDICTED_FILE, dict(self.columns()))

    def columns(self) -> Mapping[str, Sequence[Any] | Array]:
        """A row a pose: joints and conditions; then points, orientation, and how sure each point is."""
        chain = self.run.robot.chain
        columns: dict[str, Sequence[Any] | Array] = {"id": list(self.rows.ids)}
        columns |= joint_columns(chain, self.rows.joints)
        columns |= {
            name: self.rows.conditions[name]
            for name in self.run.estimate.arm.conditions
            if name in self.rows.conditions
        }
        for name, R in zip(("", "base_"), self._both_rotations, strict=True):
            parts = zip("wxyz", se3.quaternion_from_rotation(R).T, strict=True)
            columns |= {f"{name}q{part}": values for part, values in parts}
        for k, target in enumerate(self.run.estimate.arm.targets):
            columns |= self._columns_of(k, target)
        return {**columns, "extrapolated": self.extrapolated.tolist()}

    def _columns_of(self, k: int, target: str) -> dict[str, Array]:
        """Return a target's positions in both frames (mm), its 95 % radii by cause (mm), and its covariance (mm²)."""
        columns = dict[str, Array]()
        for places, end in ((self.points, "mm"), (self.points_in_base, "base_mm")):
            columns |= {f"{target}_{axis}_{end}": MM.of(places[:, k, i]) for i, axis in enumerate("xyz")}
        for name, lengths in self.radii_95.items():
            cause = "" if name == "together" else f"_{name}"
            columns[f"{target}_radius_95{cause}_mm"] = MM.of(lengths[:, k])
        covariance_mm2 = 1e6 * self.predicted.covariance[:, k]
        return columns | {f"{target}_cov_{pair}_mm2": covariance_mm2[:, i, j] for i, j, pair in _PAIRS}


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
        by = load_run(joints.run, joints.load, accept_edited=joints.accept_edited)
        return _predicted(joints, by, _read(joints.file, by))
    file = str(joints) if isinstance(joints, str | Path) else "joints in memory"
    requested = options_of("lab.predict", PredictOptions, {"file": file, **folder_of(run), **options})
    by = calibrated_by(run, requested.run, requested.load, accept_edited=requested.accept_edited)
    if isinstance(joints, str | Path):
        if conditions is not None:
            raise LabError("lab.predict: conditions apply to joints in memory; a file gives them in columns")
        return _predicted(requested, by, _read(requested.file, by))
    rows = joints if isinstance(joints, Measurements) else _in_memory(joints, by)
    return _predicted(requested, by, _with_conditions(rows, conditions or {}))


def _read(file: Path, run: CalibrationRun) -> Measurements:
    chain, columns = run.robot.chain, ObservedColumns().with_conditions(run.estimate.arm.conditions)
    data = read_measurements(file, chain.joint_names, chain.prismatic, points=False, columns=columns)
    return data[[use != "skip" for use in data.use]]


def _in_memory(joints: "Array | Sequence[Sequence[float]]", run: CalibrationRun) -> Measurements:
    chain = run.robot.chain
    try:
        rows = np.atleast_2d(np.asarray(joints, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise LabError(f"lab.predict: joints are not an array of numbers ({error}); give (n, {chain.size})") from error
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
    """Predict the rows."""
    if not options.force:
        run.refuse_unfit("prediction")
    run.refuse_unplaced("points")
    if not len(rows):
        raise LabError(f"{options.file}: has no row to predict; give joint positions")
    run.robot.refuse_impossible(options.file, rows)
    estimate = run.estimate
    notes = [*run.warnings, *rows.warnings, *phrases(check_limits(run.robot.chain, rows))]
    notes += condition_notes(run, options.file, list(rows.conditions), "pose", "predicted")
    rows = rows if run.load is None else run.load.with_payload(rows)
    with error_context(options.file):
        inputs = rows.inputs(estimate.arm.conditions)
    Ts, _ = estimate.arm.tool(inputs, estimate.values)
    off = estimate.geometry_error(inputs)
    return PredictionResult(options, run, rows, inputs, estimate.predict(inputs), Ts[:, :3, :3], off, tuple(notes))
