"""Corrected targets: typed, and as plain values for their JSON files."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from lab.calibration.checks.fit import check_extrapolated
from lab.calibration.extrapolation import MOST_UNCOVERED
from lab.calibration.prior import Tolerance
from lab.calibration.verdict import MOST_TOLERANCES
from lab.calibration.workspace_prediction import tolerance_rms
from lab.commands.calibrate.load_run import CalibrationRun
from lab.commands.compensate.options import CompensateOptions
from lab.commands.compensate.program import CorrectedProgram, flange_values, flange_words, stated_words, used_tools
from lab.commands.compensate.program_reference import ProgramErrors, ProgramReference, program_errors
from lab.commands.result import Result, exit_code_of, joint_values
from lab.commands.run_folder import VIA, Stops, joint_columns, provenance_section, write_config, write_json
from lab.compensation.compensator import NEAR_RAD, Compensation
from lab.compensation.flange import point_rows
from lab.core.linear_model import covariance_root
from lab.core.measurements import evenly
from lab.core.se3 import Array
from lab.formats.programs.registry import refusal
from lab.formats.target_csv import Targets
from lab.kinematics.inverse.newton import PoseTarget
from lab.kinematics.joints import JointSpec
from lab.render.charts.chart import cube
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
from lab.render.phrases.registry import phrases
from lab.render.plots import MOST_POINTS, SizeMap, Spread, histograms, size_maps, spread_by_size
from lab.render.style import AFTER, BEFORE, HATCH_AFTER, HATCH_BEFORE, MARK_AFTER, MARK_BEFORE

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure

    from lab.render.document import Document

__all__ = ["CompensationResult", "NearSingular"]

_BLOCK = 2_000  # targets whose derivatives are held at a time


@dataclass(frozen=True)
class NearSingular:
    """A target that is reached within 1 degree of a singularity.

    Attributes:
        joint: the one that would have to move most to get there.
        distance: how far (rad; m where that joint slides).
    """

    id: str
    joint: str
    distance: float
    slides: bool

    def to_dict(self) -> dict[str, Any]:
        """Return plain values: degrees, or mm of a prismatic joint."""
        unit, scale = ("mm", 1e3) if self.slides else ("deg", 180 / np.pi)
        return {"id": self.id, "joint": self.joint, f"distance_{unit}": scale * self.distance}


def _near_singular(found: Compensation, chain: JointSpec, ids: Sequence[str]) -> tuple[NearSingular, ...]:
    """The targets that are reached within 1 degree of a singularity.

    Args:
        ids: of all targets, ``(n,)``.
    """
    rows = np.flatnonzero(found.converged & (found.singular_rad < NEAR_RAD))
    return tuple(
        NearSingular(
            ids[i],
            chain.joint_names[found.singular_joint[i]],
            float(found.singular_rad[i]),
            chain.prismatic[found.singular_joint[i]],
        )
        for i in rows.tolist()
    )


@dataclass(frozen=True, repr=False, eq=False)
class CompensationResult(Result):
    """Compensation result of a list of targets.

    Attributes:
        options: of the command.
        run: the run that calibrated the arm.
        targets: those of the file.
        wanted: the targets, with the rotations of the last frame, in the frame in which the arm was measured.
        found: the corrected targets.
        arm_inputs: ``(n, joints + conditions)`` of the arm at its corrected joint positions.
        without_effects_m: error of geometry alone there (root mean square), which is all that an exported
            arm holds; None where there is nothing else.
        stops: waypoints: the reached targets, in their order; where it was checked, home before and after them and what
            is passed on the way.
        checked: whether waypoints and the paths between them were checked for collisions.
        notes: warnings on the inputs.
        program: the program that the targets are of; None where they are of a file of targets.
        reference: of a program, the base, flange and tools that its numbers are relative to.
        points: ``(n,)`` of a program, which target of the arm is aimed at each; of a file of targets it is one alone.
    """

    options: CompensateOptions
    run: CalibrationRun
    targets: Targets
    wanted: PoseTarget
    found: Compensation
    arm_inputs: Array
    without_effects_m: float | None
    stops: Stops
    checked: bool
    notes: tuple[str, ...]
    program: CorrectedProgram | None = None
    reference: ProgramReference | None = None
    points: NDArray[np.int_] | None = None

    @property
    def exit_code(self) -> int:
        """1 where a target is not reached or a way touches; 3 where good is required and it is doubtful; else 0."""
        touched = self.program is not None and (self.program.ways or len(self.program.rows) < len(self.program.targets))
        if touched or not self.found.converged.all():
            return 1
        return exit_code_of(_verdict_of(self), self.options.require)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings for the reader."""
        gate_mm, (mean_mm, _) = self.run.options.gate_mm, self.mean_and_max_mm(self._model_m)
        far: tuple[str, ...] = ()
        if gate_mm is not None and mean_mm is not None and mean_mm > gate_mm:
            far = (f"the expected error is {mean_mm:.3g} mm: these targets are far from where the arm was measured",)
        of_program = () if self.program is None else self.program.warnings
        tools = tuple(each.words for each in used_tools(self) if each.disagrees)
        without = () if self._no_program is None else (self._no_program,)
        return (*tools, *self.notes, *far, *self._beyond, *self._unchecked, *without, *of_program)

    @property
    def _beyond(self) -> tuple[str, ...]:
        """Warnings on targets outside the measured range of the run."""
        sizes, ids = self.beyond_m[self.reached], [self.targets.ids[i] for i in np.flatnonzero(self.extrapolated)]
        said = list(phrases(check_extrapolated("targets", ids, len(sizes))))
        if count := int((sizes > 0).sum()):
            said.append(
                f"{count} of {len(sizes)} targets are beyond what the run measured: of their expected errors, up to "
                f"{1e3 * sizes.max():.2g} mm (1σ) is what the model may lack there"
            )
        return tuple(said)

    @cached_property
    def extrapolated(self) -> NDArray[np.bool_]:
        """``(n,)`` which targets are reached where no fitted pose is near and the model lacks something."""
        joints = self.arm_inputs[:, : self.run.robot.chain.size]
        return np.asarray(self.run.estimate.extrapolated(joints) & self.found.converged)

    @property
    def _extrapolated_share(self) -> float:
        """Share of extrapolated targets among those that are reached."""
        return float(self.extrapolated.sum()) / max(len(self.reached), 1)

    @property
    def _no_program(self) -> str | None:
        """Reason for having no program for the controller; None where there is one."""
        if self.program is not None:
            return None
        return refusal(self.run.robot.chain, self.options.controller, len(self.targets))

    @property
    def _unchecked(self) -> tuple[str, ...]:
        """Warnings on moves not checked for collisions, or checked by assumed shapes only."""
        model = self.run.robot.model
        if self.checked:
            return ("collisions were checked with links drawn as rods",) if model.shapes_assumed else ()
        return (f"nothing was checked for collisions: {'--no-check' if self.options.no_check else model.missing}",)

    @property
    def passed_over(self) -> tuple[tuple[str, str], ...]:
        """The targets that are reached by another solution of the inverse than the nearest: id, and why."""
        found = zip(self.targets.ids, self.found.passed_over, self.found.converged, strict=True)
        return tuple((name, reason) for name, reason, reached in found if reason and reached)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons to check the corrected targets before use."""
        of_run, run = self.run.result, list(filter(None, [flange_words(self)]))
        if of_run.verdict != "good":
            run += [f"the run is {of_run.verdict}: {reason}" for reason in of_run.reasons or (of_run.reason,)]
        if self._extrapolated_share > MOST_UNCOVERED:
            share = f"{100 * self._extrapolated_share:.0f} % of the targets"
            run.append(f"{share} are extrapolated: not covered by measured poses; measure where the robot is to work")
        moved, usual = self.correction_m[self.reached], self._tolerance_m[self.reached]
        if not (far := moved > MOST_TOLERANCES * usual).any():
            return tuple(run)
        worst = int(np.argmax(moved / usual))
        words = (
            f"{int(far.sum())} targets are moved by more than {MOST_TOLERANCES:g} tolerances, "
            f"{self.targets.ids[self.reached[worst]]} by {1e3 * moved[worst]:.3g} mm, which is "
            f"{moved[worst] / usual[worst]:.3g}: is the nominal model that of this robot?"
        )
        return (words, *run)

    @cached_property
    def _tolerance_m(self) -> Array:
        """``(n,)`` how far the tolerances of the links let each target be missed (m, RMS)."""
        fitting = self.run.options.fitting
        tolerance = Tolerance(fitting.tolerance_mm / 1e3, fitting.tolerance_mrad / 1e3)
        parts = [tolerance_rms(self.run.estimate.arm, jacobian, tolerance) for jacobian in self._sensitivities()]
        return np.concatenate(parts)

    @cached_property
    def better_left(self) -> dict[int, str]:
        """Rows of a program's targets expected to be better uncorrected, and why.

        An uncorrected target has the error of an arm that was never calibrated, by its tolerances; base and flange add
        the same to both.
        """
        assert self.reference is not None
        tolerance = Tolerance(self.reference.sigma[0], self.reference.sigma[3])
        usual = np.concatenate(
            [tolerance_rms(self.run.estimate.arm, each, tolerance) for each in self._sensitivities()]
        )
        return {
            i: (
                f"{self.targets.ids[i]}: the expected error is {1e3 * self._model_m[i]:.3g} mm with the correction and "
                f"{1e3 * usual[i]:.3g} mm without: too far from the measured poses"
            )
            for i in self.reached.tolist()
            if self._model_m[i] > usual[i]
        }

    def _sensitivities(self) -> Iterator[Array]:
        """Derivatives ``(some, 3, p)`` of the aimed point by the parameters, of some targets at a time."""
        run = self.run
        return (_of_points(run.estimate.arm.observe(each, run.estimate.values)[1], at) for each, at in self._blocks())

    def _by_identified(self) -> Iterator[tuple[Array, Array]]:
        """Derivatives ``(some, 3, f)`` of the aimed point by the identified parameters, the flange's with the tool's.

        And ``(some, 3, 3)`` by the point's place in the last frame.
        """
        names, reference = self.run.estimate.arm.names, self.reference
        columns = list(self.run.estimate.free)
        for (_, at), jacobian in zip(self._blocks(), self._sensitivities(), strict=True):
            places = [
                [names.index(f"tool.{self.run.estimate.arm.targets[k]}.{axis}") for axis in "xyz"] for k in at.tolist()
            ]
            by_tool = np.take_along_axis(jacobian, np.array(places)[:, None], axis=2)
            found = jacobian[..., columns]
            if reference is not None:
                found = found + by_tool @ point_rows(reference.offsets(at)) @ reference.gain
            yield found, by_tool

    def _blocks(self) -> Iterator[tuple[Array, NDArray[np.int_]]]:
        """Inputs of the arm, and which of its targets are aimed, of some targets at a time."""
        aimed = np.full(len(self.arm_inputs), self.target) if self.points is None else self.points
        for first in range(0, len(self.arm_inputs), _BLOCK):
            yield self.arm_inputs[first : first + _BLOCK], aimed[first : first + _BLOCK]

    @cached_property
    def reached(self) -> NDArray[np.int_]:
        """The rows of the targets that are reached."""
        return np.flatnonzero(self.found.converged)

    @property
    def failed(self) -> tuple[tuple[str, str], ...]:
        """The targets that are not reached: id, and why."""
        pairs = zip(self.targets.ids, self.found.reasons, strict=True)
        return tuple((name, reason) for name, reason in pairs if reason)

    @property
    def model(self) -> str:
        """The model's groups, joined by +."""
        return self.run.estimate.model

    def mean_and_max_mm(self, lengths: Array) -> tuple[float | None, float | None]:
        """Mean and largest (mm) of lengths ``(n,)`` (m) over the targets that are reached; None without any."""
        values = 1e3 * lengths[self.reached]
        finite = values[np.isfinite(values)]
        return (float(finite.mean()), float(finite.max())) if len(finite) else (None, None)

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints and ``result.json`` holds: lengths in mm."""
        values = self._values
        return {**values, "stops": list(values["stops"])}

    @property
    def _values(self) -> dict[str, Any]:
        """Values of the result with lazy waypoints, given one by one: a list of a million takes 1 GB."""
        chain = self.run.robot.chain
        return {
            "run": str(self.run.folder),
            "robot": self.run.robot.name,
            "serial": self.run.serial,
            "verdict": _verdict_of(self),
            "reasons": list(self.reasons),
            "run_verdict": self.run.result.to_dict(),
            "tool": self.targets.tool,
            "model": self.model,
            "targets": len(self.targets),
            "converged": len(self.reached),
            "failed": [{"id": name, "reason": reason} for name, reason in self.failed],
            "checked": self.checked,
            "other_solution": [{"id": name, "reason": reason} for name, reason in self.passed_over],
            "stops": self.stops.rows(chain),
            "correction_mm": dict(zip(("mean", "max"), self.mean_and_max_mm(self.correction_m), strict=True)),
            "predicted_mm": dict(zip(("mean", "max"), self.mean_and_max_mm(self.predicted_m), strict=True)),
            "judged_mm": None if (after := self.run.result.after_mm) is None else after["mean"],
            "schemes_apart_mm": self.mean_and_max_mm(self.found.scheme_disagreement_m)[1],
            "extrapolated": {
                "share": self._extrapolated_share,
                "ids": [self.targets.ids[i] for i in np.flatnonzero(self.extrapolated)],
            },
            "near_singular": [
                each.to_dict() for each in _near_singular(self.found, self.run.robot.chain, self.targets.ids)
            ],
            "without_effects_mm": None if self.without_effects_m is None else 1e3 * self.without_effects_m,
            "warnings": list(self.warnings),
            **({} if self.program is None else {"program": self._program_values}),
        }

    @property
    def _program_values(self) -> dict[str, Any]:
        """Values that ``result.json`` holds of the program."""
        program, expected, reference = self.program, self.expected, self.reference
        assert program is not None and expected is not None and reference is not None
        lines = [program.targets[row].line for row in program.rows]
        return {
            "file": program.name,
            "language": program.language.lower(),
            "corrected": [
                {
                    "id": self.targets.ids[i],
                    "line": lines[i],
                    "shape_95_mm": 1e3 * float(expected.shape_95_m[i]),
                    "base_95_mm": 1e3 * float(expected.base_95_m[i]),
                }
                for i in self.reached
            ],
            "uncorrected": [{"line": each.line, "reason": each.reason} for each in program.uncorrected],
            "ways": [{"line": line, "reason": words} for line, words in program.ways],
            "tools": [each.to_dict() for each in used_tools(self)],
            "flange": flange_values(reference),
            "expected_95_mm": {
                name: dict(zip(("mean", "max"), self.mean_and_max_mm(lengths), strict=True))
                for name, lengths in (
                    ("shape", expected.shape_95_m),
                    ("base", expected.base_95_m),
                    ("flange", expected.flange_95_m),
                )
            },
            "rounding_mm": program.rounding_mm,
            "rounding_deg": program.rounding_deg,
        }

    def document(self) -> "Document":
        """Build the document: the compensated targets, their corrections, and targets not reached."""
        return _compensation_document(self)

    def columns(self) -> Mapping[str, Sequence[Any] | Array]:
        """A row for each target that is reached: id, joint positions (deg or mm), correction and predicted error."""
        rows, chain = self.reached, self.run.robot.chain
        return {
            "id": [self.targets.ids[i] for i in rows],
            **joint_columns(chain, self.found.joints[rows]),
            "correction_mm": 1e3 * self.correction_m[rows],
            "predicted_mm": 1e3 * self.predicted_m[rows],
            "extrapolated": self.extrapolated[rows].tolist(),
        }

    def plot(self) -> "MatplotlibFigure":
        """Draw how far the targets are moved and the error to expect, as histograms.

        Raises:
            LabError: no target is reached.
        """
        from lab.core.errors import LabError

        if not len(self.reached):
            raise LabError("no target is reached: there is nothing to draw; see failed for the reasons")
        return _corrections_picture(self).draw()

    def write(self, folder: Path) -> None:
        """Write tables, programs, the calibrated arm, ``result.json``, ``recording.rrd`` and ``report.html``."""
        from lab.commands.compensate.run import write_files

        write_config(folder, "compensate", self.options, self.run.robot.sha256)
        write_files(folder, self)
        write_json(folder / "result.json", self._values)
        if len(self.reached) and not self.options.no_recording:
            from lab.commands.compensate.recording import record_compensation

            record_compensation(folder / "recording.rrd", self)
        self.report(folder / "report.html")

    @cached_property
    def correction_m(self) -> Array:
        """Correction ``(n,)``: how far each target is moved for the controller (m); NaN where it is not reached."""
        return np.asarray(np.linalg.norm(self.found.positions - self.wanted.positions, axis=1))

    @cached_property
    def predicted_m(self) -> Array:
        """Predicted error ``(n,)`` at each target (m, RMS), from the covariance, the lack of fit and shared errors.

        Of a program's targets with the part of the flange, relative to the identified base.
        """
        flange_m = 0.0 if self.expected is None else self.expected.flange_m
        return np.asarray(np.sqrt(self._model_m**2 + flange_m**2))

    @cached_property
    def _model_m(self) -> Array:
        """The part ``(n,)`` of the predicted error that is the calibrated model's (m, RMS)."""
        by_measured = (self._by_measured**2).sum(axis=(1, 2))
        return np.asarray(np.sqrt(by_measured + self._independent_m**2))

    @cached_property
    def _by_measured(self) -> Array:
        """Derivatives ``(n, 3, f)`` of the aimed points by what was measured, in standard deviations.

        None of the columns where an arm's offsets are predicted too.
        """
        estimate = self.run.estimate
        if estimate.process is not None:
            return np.empty((len(self.arm_inputs), 3, 0))
        root = np.sqrt(estimate.discrepancy().inflation) * covariance_root(estimate.free_covariance)
        return np.concatenate([slopes @ root for slopes, _ in self._by_identified()])

    @cached_property
    def _mean_squares(self) -> dict[str, Array]:
        """Mean squares ``(n,)`` (m^2) of the predicted error of the aimed points, by cause."""
        estimate, causes = self.run.estimate, ("identified", "discrepancy", "extrapolation", "visit")
        found: dict[str, list[Array]] = {name: [] for name in causes}
        for inputs, at in self._blocks():
            predicted = estimate.predict(inputs, at)
            for name in causes:
                found[name].append(np.trace(getattr(predicted, name)[:, 0], axis1=1, axis2=2))
        return {name: np.concatenate(parts) for name, parts in found.items()}

    @cached_property
    def _independent_m(self) -> Array:
        """The part ``(n,)`` of the predicted error that differs from target to target (m, RMS)."""
        squares = self._mean_squares
        known = squares["identified"] if self.run.estimate.process is not None else 0.0
        rest = squares["discrepancy"] + squares["extrapolation"] + squares["visit"]
        return np.asarray(np.sqrt(known + rest + self.load_m**2))

    @cached_property
    def expected(self) -> ProgramErrors | None:
        """Expected errors of a program's targets in the robot's base and relative to each other."""
        if self.reference is None or self.points is None:
            return None
        dof = self.run.estimate.discrepancy().dof
        by_tool = np.concatenate([slopes for _, slopes in self._by_identified()])
        return program_errors(
            self.reference,
            self.wanted.positions,
            self.reference.offsets(self.points),
            by_tool,
            self._by_measured,
            self._independent_m,
            dof,
        )

    @cached_property
    def beyond_m(self) -> Array:
        """The part ``(n,)`` of the predicted error that is what the model may lack where nothing was measured (m)."""
        return np.asarray(np.sqrt(self._mean_squares["extrapolation"]))

    @cached_property
    def load_m(self) -> Array:
        """The part ``(n,)`` of the predicted error that is the uncertainty of an identified payload (m, RMS)."""
        return self.run.estimate.load_errors(self.arm_inputs, [self.target])[:, 0]

    @property
    def target(self) -> int:
        """The index of the arm's target that is aimed."""
        return self.run.estimate.arm.targets.index(self.targets.tool)


def _of_points(values: Array, points: NDArray[np.int_]) -> Array:
    """Select from values ``(n, k, …)`` of an arm's targets the one of each pose, ``(n, …)``."""
    return np.asarray(values[np.arange(len(values)), points])


def _verdict_of(result: CompensationResult) -> Literal["good", "doubtful", "bad"]:
    """``bad`` where a target is not reached, ``doubtful`` where there are reasons for that, else ``good``."""
    return "bad" if result.failed else "doubtful" if result.reasons else "good"


_NEAR = 2.0  # times half the edge of the targets' cube: what is farther off is not drawn
_SHAPED = 4  # targets: fewer are brought onto each other by a rigid motion, whatever their errors are, or nearly
_MOST_LISTED = 100  # targets, in each table


def _compensation_document(result: CompensationResult) -> Document:
    """The totals, the targets that are not reached and why, how far the others were moved, and every target."""
    failed = len(result.failed)
    verdict = Badge(f"{failed:,} not reached" if failed else "all reached", _verdict_of(result))
    count = f"{len(result.reached):,} of {len(result.targets):,}"
    return Document(
        f"{result.run.called}: {count} targets of {result.targets.tool} corrected",
        (
            Paragraph((verdict, f" ({'doubtful; ' if result.reasons else ''}the run is {result.run.result.words})")),
            Bullets(tuple(map(capital, result.reasons))),
            Paragraph(_lead(result), "lead"),
            Warnings(result.warnings),
            Section(
                "What became of the targets",
                (
                    *_totals(result),
                    _failed(result),
                    _other_solutions(result),
                    _near(result),
                    _extrapolated(result),
                    *_moves(result),
                ),
            ),
            *_program(result),
            Section("How far they were moved", (*_histograms(result), *_map(result))),
            Section("Every target", _every_target(result), shown_in=PAGE),
            provenance_section("compensate", result.options, result.run.robot.sha256, result.run.serial),
        ),
    )


def _corrections_picture(result: CompensationResult) -> Picture:
    """Draw histograms of the corrections and of the expected errors."""
    moved, expected = (_finite(result, lengths) for lengths in (result.correction_m, result.predicted_m))
    spreads = [Spread(moved, BEFORE, ("moved by: mean", float(moved.mean())), HATCH_BEFORE, MARK_BEFORE)]
    if len(expected):
        mark = ("expected error: mean", float(expected.mean()))
        spreads.append(Spread(expected, AFTER, mark, HATCH_AFTER, MARK_AFTER))
    return histograms("moved", spreads, "length", result.run.result.gate_mm)


def _lead(result: CompensationResult) -> str:
    targets = f"{len(result.targets):,} targets for the arm that {result.run.folder} calibrated"
    if not len(result.reached):
        return f"{targets}: none of them is reached."
    if result.failed:
        targets = f"{len(result.reached):,} of {targets}"
    mean, largest = result.mean_and_max_mm(result.correction_m)
    if result.expected is not None:
        in_base = short(result.mean_and_max_mm(result.expected.base_95_m)[1])
        text = (
            f"{targets} were moved by {short(mean)} mm on average, {short(largest)} mm at most. 95 % of the errors to "
            f"expect in the robot's base are below {in_base} mm, with what the first link adds to all targets alike"
        )
        if len(result.reached) < _SHAPED:
            return f"{text}."
        return (
            f"{text}, relative to each other below {short(result.mean_and_max_mm(result.expected.shape_95_m)[1])} mm."
        )
    expected, _ = result.mean_and_max_mm(result.predicted_m)
    text = f"{targets} were moved by {short(mean)} mm on average, {short(largest)} mm at most"
    if expected is not None:
        text += f"; the error to expect there is {short(expected)} mm"
    after = result.run.result.after_mm
    return text + ("." if after is None else f" (at the run's validation poses it was {short(after['mean'])} mm).")


def _totals(result: CompensationResult) -> tuple[Block, ...]:
    expected = [("expected error, mm", result.predicted_m)]
    if result.expected is not None:
        expected = [
            ("expected error in the robot's base (95 %), mm", result.expected.base_95_m),
            ("of it by the flange (95 %), mm", result.expected.flange_95_m),
            ("expected error relative to each other (95 %), mm", result.expected.shape_95_m),
        ][: None if len(result.reached) >= _SHAPED else 2]
    rows = tuple(
        (name, *map(short, result.mean_and_max_mm(lengths)))
        for name, lengths in [("moved by, mm", result.correction_m), *expected]
    )
    _, apart = result.mean_and_max_mm(result.found.scheme_disagreement_m)
    schemes = "" if apart is None else f"The three schemes to compute them end within {short(apart)} mm of each other. "
    note = Paragraph(f"{schemes}Model: {result.model.replace('+', ' + ')}.", "note")
    return Table(("", "mean", "largest"), rows), note


def _failed(result: CompensationResult) -> Table:
    """The targets that are not reached; those of a program are listed by line, with all else that stays."""
    if result.program is not None:
        return Table((), ())
    return Table(("target", "why it is not reached"), result.failed, most_rows=_MOST_LISTED)


def _other_solutions(result: CompensationResult) -> Table:
    header = ("target", "reached by another solution of the inverse: what is wrong with the nearest one")
    return Table(header, result.passed_over, most_rows=_MOST_LISTED)


def _moves(result: CompensationResult) -> tuple[Block, ...]:
    """Report which moves were checked for collisions, and the poses passed on the way."""
    if not result.checked or not len(result.reached):
        return ()
    if result.program is not None:
        return (
            Paragraph(
                f"The {len(result.reached)} corrected targets and the moves from each to the next one in the order of "
                "the text, whatever its loops and branches do, were checked for collisions with the arm itself and "
                "with the surroundings that the robot's model knows."
            ),
        )
    passed = sum(name.startswith(VIA) for name in result.stops.names if name not in result.targets.ids)
    text = (
        f"The {len(result.reached)} corrected targets and the {len(result.stops.joints) - 1} moves from home through "
        "all of them and back, each in a straight line of all joints, were checked for collisions with the arm itself "
        "and with the surroundings that the robot's model knows."
    )
    return (Paragraph(text + (f" {passed} stops are only passed, to get around something." if passed else "")),)


def _program(result: CompensationResult) -> tuple[Section, ...]:
    """Report the result for the program that contains the targets."""
    if (program := result.program) is None:
        return ()
    text = (
        f"{program.name} in the run's folder is the {program.language} program with the numbers of "
        f"{len(result.reached)} targets corrected, and nothing else changed."
    )
    in_base = (
        "The base is that of the calibrated arm, by the nominal first link. No measurement shows that link itself, so "
        "all targets together may be off as its tolerances let them be, with the correction as without it; relative to "
        "each other they are not."
    )
    tools = Bullets(tuple(capital(each.words) + "." for each in used_tools(result)))
    lines = tuple((str(each.line), each.reason) for each in program.uncorrected)
    ways = tuple((str(line), words) for line, words in program.ways)
    return (
        Section(
            "The program",
            (
                Paragraph(text),
                tools,
                Paragraph(() if result.reference is None else stated_words(result.reference)),
                Paragraph(in_base),
                Table(("line", "what stays as it is, or needs a look"), lines, most_rows=_MOST_LISTED),
                Table(("line", "ways that are not free"), ways, most_rows=_MOST_LISTED),
            ),
        ),
    )


def _near(result: CompensationResult) -> Table:
    close = _near_singular(result.found, result.run.robot.chain, result.targets.ids)
    rows = tuple((each.id, _distance(each), each.joint) for each in close)
    return Table(("target", "within 1° of a singularity, by", "of joint"), rows, most_rows=_MOST_LISTED)


def _extrapolated(result: CompensationResult) -> Table:
    """The targets that no measured pose is near, with the error to expect there."""
    rows = tuple(
        (result.targets.ids[i], short(1e3 * float(result.predicted_m[i]))) for i in np.flatnonzero(result.extrapolated)
    )
    return Table(
        ("target", "extrapolated: not covered by measured poses; expected error, mm"), rows, most_rows=_MOST_LISTED
    )


def _distance(near: NearSingular) -> str:
    """The distance to a singularity, in the unit of the joint that leads there."""
    return short(1e3 * near.distance, "mm") if near.slides else short(float(np.rad2deg(near.distance)), "°")


def _histograms(result: CompensationResult) -> tuple[Block, ...]:
    if not len(result.reached):
        return ()
    caption = (
        "How far the targets are moved (vermilion, hatched): without the correction the arm would miss them by about "
        "as much. Blue: the error to expect with it."
    )
    return (Figure("moved-figure", (_corrections_picture(result),), caption),)


def _finite(result: CompensationResult, lengths: Array) -> Array:
    lengths = lengths[result.reached]
    return np.asarray(lengths[np.isfinite(lengths)])


def _map(result: CompensationResult) -> tuple[Block, ...]:
    reached, positions = result.reached, result.targets.positions
    if not len(reached):
        return ()
    rows = reached[spread_by_size(result.correction_m[reached])]
    off = positions[~result.found.converged]
    middle, half = cube([positions[reached]])
    near = (np.abs(off - middle) < _NEAR * half).all(axis=1)
    off, some = off[near], evenly(int(near.sum()), MOST_POINTS)
    crosses = off if some is None else off[some]
    shown = SizeMap(
        positions[rows], result.correction_m[rows], "how far a target is moved", crosses, "not reached", "targets"
    )
    caption = "The targets in the frame of their file. The darker a target, the farther it is moved."
    if beyond := int((~near).sum()):
        caption += f" Not reached, and too far off to be drawn: {beyond}."
    return (Figure("where", size_maps(shown), caption),)


def _every_target(result: CompensationResult) -> tuple[Block, ...]:
    chain, found = result.run.robot.chain, result.found
    moved = 1e3 * (found.positions - result.targets.positions)
    rows = tuple(
        (
            result.targets.ids[i],
            *(fixed(value, 3) for value in joint_values(chain.prismatic, found.joints[i])),
            *(fixed(value, 3, signed=True) for value in moved[i]),
        )
        for i in result.reached[:_MOST_LISTED]
    )
    units = ("mm" if slides else "°" for slides in chain.prismatic)
    joints = (f"{name}, {unit}" for name, unit in zip(chain.joint_names, units, strict=True))
    header = ("target", *joints, *(f"Δ{axis}, mm" for axis in "xyz"))
    note = (
        "Joint positions that bring the calibrated arm there, and how far the corrected target is from the wanted one."
    )
    table = Table(header, rows, most_rows=_MOST_LISTED, rest_in="joints.csv", count=len(result.reached))
    return (Paragraph(note, "note"), table) if rows else ()
