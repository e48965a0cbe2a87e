"""Predicted points of a calibrated arm: typed, and as plain values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lab.calibration.checks.fit import check_extrapolated
from lab.calibration.estimate import PredictedPoints
from lab.commands.calibrate.load_run import CalibrationRun
from lab.commands.predict.options import PredictOptions
from lab.commands.result import Result, number, plain_numbers
from lab.commands.run_folder import joint_columns
from lab.core import se3
from lab.core.errors import counted
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.formats.csv_table import write_columns
from lab.render.document import (
    PAGE,
    Badge,
    Block,
    Bullets,
    Document,
    Figure,
    Paragraph,
    Picture,
    Section,
    Table,
    Warnings,
    capital,
    fixed,
    short,
)
from lab.render.phrases.fit import listed, model_name
from lab.render.phrases.registry import phrases
from lab.render.plots import Spread, histograms
from lab.render.style import AFTER, BEFORE, HATCH_AFTER, HATCH_BEFORE, MARK_AFTER, MARK_BEFORE

if TYPE_CHECKING:
    from lab.render.document import Document

__all__ = ["PredictionResult"]

_PREDICTED_FILE = "predicted.csv"
_PAIRS = ((0, 0, "xx"), (0, 1, "xy"), (0, 2, "xz"), (1, 1, "yy"), (1, 2, "yz"), (2, 2, "zz"))


@dataclass(frozen=True, repr=False, eq=False)
class PredictionResult(Result):
    """Predicted points of a calibrated arm at given joint positions.

    Attributes:
        options: of the command.
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
    shown_by = "lab.commands.predict.result:_prediction_document"
    drawn_by = "lab.commands.predict.result:_radii_picture"

    options: PredictOptions
    run: CalibrationRun
    rows: Measurements
    inputs: Array
    predicted: PredictedPoints
    R_instrument_last: Array
    without_effects_m: float | None
    notes: tuple[str, ...]

    @property
    def model_sha256(self) -> str:
        """Digest of the robot's description."""
        return self.run.robot.sha256

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
        said = []
        if len(lost):
            said = [f"{len(lost)} poses cannot be taken by the calibrated arm (first: {self.rows.ids[lost[0]]})"]
        return (*self.notes, *phrases(check_extrapolated("poses", ids, len(self.rows))), *said)

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
            sizes = 1e3 * lengths[np.isfinite(lengths)]
            found[name] = {
                "mean": number(float(sizes.mean())) if sizes.size else None,
                "max": number(float(sizes.max())) if sizes.size else None,
            }
        return found

    @property
    def model(self) -> str:
        """The model's groups, joined by +."""
        return self.run.estimate.model

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints and ``result.json`` holds: lengths in mm."""
        T, off = self.T_instrument_base, self.without_effects_m
        return {
            "run": str(self.run.folder),
            "robot": self.run.robot.name,
            "run_verdict": self.run.result.to_dict(),
            "model": self.model,
            "poses": len(self.rows),
            "frames": {
                "instrument": "the frame in which the arm was measured",
                "base": "frame 0 of the arm's table",
                "base_in_instrument": {
                    "position_mm": plain_numbers(1e3 * T[:3, 3]),
                    "quaternion_wxyz": plain_numbers(se3.quaternion_from_rotation(T[:3, :3])),
                },
            },
            "radius_95_mm": self.radius_statistics_mm,
            "without_effects_mm": None if off is None else number(1e3 * off),
            "predictions": self._predictions(),
            "warnings": list(self.warnings),
        }

    def _predictions(self) -> list[dict[str, Any]]:
        """Predicted values of each pose."""
        points, base = plain_numbers(1e3 * self.points), plain_numbers(1e3 * self.points_in_base)
        covariances = plain_numbers(1e6 * self.predicted.covariance)
        radii = {name: plain_numbers(1e3 * lengths) for name, lengths in self.radii_95.items()}
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
        """Rotations of the tool, in the frame of the measurements and in the base."""
        return self.rotations, np.asarray(self.T_instrument_base[:3, :3].T @ self.rotations)

    def write_files(self, folder: Path) -> None:
        """Write ``predicted.csv``."""
        write_columns(folder / _PREDICTED_FILE, dict(self.columns()))

    def columns(self) -> Mapping[str, Sequence[Any] | Array]:
        """A row a pose: joints and conditions; then points, orientation, and how sure each point is."""
        chain = self.run.robot.chain
        found: dict[str, Sequence[Any] | Array] = {"id": list(self.rows.ids), **joint_columns(chain, self.rows.joints)}
        found |= {
            name: self.rows.conditions[name]
            for name in self.run.estimate.arm.conditions
            if name in self.rows.conditions
        }
        for name, R in zip(("", "base_"), self._both_rotations, strict=True):
            parts = zip("wxyz", se3.quaternion_from_rotation(R).T, strict=True)
            found |= {f"{name}q{part}": values for part, values in parts}
        covariances = 1e6 * self.predicted.covariance
        for k, target in enumerate(self.run.estimate.arm.targets):
            for places, end in ((self.points, "mm"), (self.points_in_base, "base_mm")):
                found |= {f"{target}_{axis}_{end}": 1e3 * places[:, k, i] for i, axis in enumerate("xyz")}
            for name, lengths in self.radii_95.items():
                cause = "" if name == "together" else f"_{name}"
                found[f"{target}_radius_95{cause}_mm"] = 1e3 * lengths[:, k]
            found |= {f"{target}_cov_{pair}_mm2": covariances[:, k, i, j] for i, j, pair in _PAIRS}
        return {**found, "extrapolated": self.extrapolated.tolist()}


_MOST_LISTED = 100  # poses in the table
_CAUSES = {
    "parameters": "uncertain parameters",
    "unmodelled": "what the model lacks",
    "visit": "scatter from visit to visit",
    "together": "together",
}


def _prediction_document(result: PredictionResult) -> Document:
    """The points' uncertainty by cause, and every pose with its points in both frames."""
    run = result.run.result
    return Document(
        f"{result.run.robot.name}: {counted(len(result.rows), 'pose')} predicted",
        (
            Paragraph((Badge(run.verdict, "good" if run.verdict == "good" else "doubtful"), " is the run's verdict")),
            Bullets(tuple(map(capital, run.reasons))),
            Paragraph(_lead(result), "lead"),
            Warnings(result.warnings),
            Section("Uncertainty", _uncertainty(result)),
            Section("Every pose", _every_pose(result), shown_in=PAGE),
        ),
    )


def _radii_picture(result: PredictionResult) -> Picture:
    """Radii of 95 % of the errors, all causes together and of the parameters alone, as histograms."""
    every, own = (lengths[np.isfinite(lengths)] for lengths in _two(result))
    spreads = [Spread(every, BEFORE, ("together: mean", float(every.mean())), HATCH_BEFORE, MARK_BEFORE)]
    spreads.append(Spread(own, AFTER, ("parameters: mean", float(own.mean())), HATCH_AFTER, MARK_AFTER))
    return histograms("radii", spreads, "radius of 95 % of the errors", result.run.result.gate_mm)


def _two(result: PredictionResult) -> tuple[np.ndarray, np.ndarray]:
    return result.radii_95["together"].ravel(), result.radii_95["parameters"].ravel()


def _lead(result: PredictionResult) -> str:
    points, size = ", ".join(result.run.estimate.arm.targets), result.radius_statistics_mm["together"]
    text = (
        f"Where {points} is" if len(result.run.estimate.arm.targets) == 1 else f"Where the points {points} are"
    ) + f" at {counted(len(result.rows), 'pose')} of the arm that {result.run.folder} calibrated"
    if size["mean"] is None or size["max"] is None:
        return text + ": it can take none of them."
    text += (
        f": 95 % of the errors are within {short(size['mean'])} mm on average, {short(size['max'])} mm at most, the "
        f"noise of a new measurement aside. Model: {model_name(result.run.estimate.groups)}."
    )
    if result.without_effects_m is None:
        return text
    lacking = ", ".join(listed(result.run.estimate.groups))
    return f"{text} Without {lacking} the points would be {1e3 * result.without_effects_m:.2g} mm off (rms)."


def _uncertainty(result: PredictionResult) -> tuple[Block, ...]:
    rows = tuple(
        (_CAUSES[name], *("" if size is None else short(size) for size in (sizes["mean"], sizes["max"])))
        for name, sizes in result.radius_statistics_mm.items()
    )
    note = (
        "Radius of the sphere that holds 95 % of the errors. Each point's covariance is in result.json and, with its "
        f"radii, in {_PREDICTED_FILE}."
    )
    table = Table(("cause of errors", "mean, mm", "largest, mm"), rows)
    if not np.isfinite(_two(result)[0]).any():
        return table, Paragraph(note, "note")
    caption = "Radii of all causes together (vermilion, hatched), and of uncertain parameters alone (blue)."
    return table, Paragraph(note, "note"), Figure("radii-figure", (_radii_picture(result),), caption)


def _every_pose(result: PredictionResult) -> tuple[Block, ...]:
    here, base, radius = 1e3 * result.points, 1e3 * result.points_in_base, 1e3 * result.radii_95["together"]
    rows = tuple(
        (
            result.rows.ids[i],
            target,
            *(fixed(float(value), 3) for value in (*here[i, k], *base[i, k])),
            short(float(radius[i, k])),
        )
        for i in range(min(len(result.rows), _MOST_LISTED))
        for k, target in enumerate(result.run.estimate.arm.targets)
        if np.isfinite(here[i, k]).all()
    )
    header = ("pose", "point", *(f"{axis}, mm" for axis in "xyz"), *(f"{axis} in the base, mm" for axis in "xyz"))
    note = "x, y and z are in the frame in which the arm was measured, then in its base (frame 0 of its table)."
    table = Table((*header, "radius, mm"), rows, most_rows=_MOST_LISTED, rest_in=_PREDICTED_FILE, count=here.shape[0])
    return (Paragraph(note, "note"), table) if rows else ()
