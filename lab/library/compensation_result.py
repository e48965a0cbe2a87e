"""Result of a compensation: corrected targets with their expected errors, as values and as files."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.calibration.prior import Tolerance
from lab.compensation.compensator import NEAR_RAD, Compensation
from lab.compensation.flange import point_rows
from lab.core import se3
from lab.core.linear_model import covariance_root
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM, MRAD, Unit
from lab.formats.calibrated_module import MODULE_FILE
from lab.formats.csv_table import write_columns
from lab.formats.programs.languages import refusal, target_files
from lab.formats.programs.program_text import postures_of
from lab.formats.programs.protocol import TargetMoves
from lab.formats.target_csv import Targets
from lab.kinematics.inverse.newton_inverse import PoseTarget
from lab.library.arm_files import GeometryFiles, comment_on_missing_effects, geometry_files
from lab.library.corrected_program import CorrectedProgram, UsedTool, flange_note, flange_values, used_tools
from lab.library.load_run import CalibrationRun
from lab.library.program_reference import ProgramErrors, ProgramReference, program_errors
from lab.library.result import Result, exit_code_of
from lab.library.run_folder import Waypoints, joint_columns
from lab.options.compensation import CompensateOptions
from lab.phrases.phrase import phrases
from lab.prediction.extrapolation import MOST_UNCOVERED
from lab.prediction.workspace_prediction import tolerance_rms
from lab.verdict.fit_checks import check_extrapolated
from lab.verdict.verdict import MOST_TOLERANCES

__all__ = ["CompensationResult"]

_JOINTS, _CARTESIAN, _NOMINAL = "joints.csv", "cartesian.csv", "nominal.toml"
_FAR_M = 0.01  # from a target: where the arm comes no nearer, its frame is in doubt
_MOST_NAMED = 5
_TRIED = 500  # random joint positions that show how far the arm reaches
_BLOCK = 2_000  # targets whose derivatives are held at a time


class _NearSingular(NamedTuple):
    id: str  # of a target within 1 degree of a singularity
    joint: str  # that would have to move most to get there
    distance: float  # rad or m
    unit: Unit


@dataclass(frozen=True, repr=False, eq=False)
class CompensationResult(Result):
    """Compensation result of a list of targets.

    Attributes:
        run: the run that calibrated the arm.
        targets: those of the file.
        wanted: the targets, with the rotations of the last frame, in the frame in which the arm was measured.
        found: the corrected targets.
        arm_inputs: ``(n, joints + conditions)`` of the arm at its corrected joint positions.
        without_effects_m: error of geometry alone there (root mean square), which is all that an exported
            arm holds; None where there is nothing else.
        waypoints: the reached targets, in their order; where it was checked, home before and after them and what is
            passed on the way.
        checked: whether waypoints and the paths between them were checked for collisions.
        notes: warnings on the inputs.
        program: the program that the targets are of; None where they are of a file of targets.
        reference: of a program, the base, flange and tools that its numbers are relative to.
        points: ``(n,)`` of a program, which target of the arm is aimed at each; of a file of targets it is one alone.
    """

    command = "compensate"
    robot_at = "run.robot"

    options: CompensateOptions
    run: CalibrationRun
    targets: Targets
    wanted: PoseTarget
    found: Compensation
    arm_inputs: Array
    without_effects_m: float | None
    waypoints: Waypoints
    checked: bool
    notes: tuple[str, ...]
    program: CorrectedProgram | None = None
    reference: ProgramReference | None = None
    points: NDArray[np.int_] | None = None

    @property
    def serial(self) -> str | None:
        """Serial number of the arm; None where it is not given."""
        return self.run.serial

    @property
    def exit_code(self) -> int:
        """1 where a target is not reached or a way touches; 3 where good is required and it is doubtful; else 0."""
        touched = self.program is not None and (
            self.program.touching_paths or len(self.program.rows) < len(self.program.targets)
        )
        if touched or not self.found.converged.all():
            return 1
        return exit_code_of(self.verdict, self.options.require)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings for the reader."""
        gate_mm, (mean_mm, _) = self.run.options.gate_mm, self.mean_and_max_mm(self._model_m)
        far, of_program = tuple[str, ...](), tuple[str, ...]()
        if gate_mm is not None and mean_mm is not None and mean_mm > gate_mm:
            far = (f"the expected error is {mean_mm:.3g} mm: these targets are far from where the arm was measured",)
        if self.program is None:
            refused = refusal(self.run.robot.chain, self.options.controller, len(self.targets))
            of_program = () if refused is None else (refused,)
        else:
            of_program = self.program.warnings
        tools = tuple(each.description for each in self.tools if each.disagrees)
        left_out = self._geometry_files.messages
        return (*tools, *self._frame, *self.notes, *far, *self._beyond, *self._unchecked, *of_program, *left_out)

    @cached_property
    def _module(self) -> tuple[str, str | None]:
        """The text of ``calibrated.py``, and why it refuses."""
        return self.run.export(self.arm_inputs[self.found.converged]).module()

    @cached_property
    def _geometry_files(self) -> GeometryFiles:
        """The arm in every format."""
        run, (arm, values) = self.run, self.run.estimate.geometry
        lacking = comment_on_missing_effects(
            run.estimate.groups, self.without_effects_m, "at the corrected targets", module=self._module[1] is None
        )
        return geometry_files(run.robot, run.robot.description_files, arm.targets, values, lacking)

    @property
    def far_away(self) -> tuple[str, ...]:
        """Ids of the targets of a file that the arm comes nowhere near: their coordinates may be in another frame."""
        return tuple(self.targets.ids[i] for i in self._far)

    @cached_property
    def _far(self) -> NDArray[np.int_]:
        """The rows of these targets."""
        if self.program is not None:
            return np.empty(0, np.int_)
        arm, values = self.run.estimate.geometry
        nearest = arm.points(self.found.joints, values)[:, self.target]
        far = ~self.found.converged & (np.linalg.norm(nearest - self.targets.positions, axis=1) > _FAR_M)
        return np.flatnonzero(far)

    @cached_property
    def _frame(self) -> tuple[str, ...]:
        """Warn of targets that are far away, with the frame that their coordinates are taken to be in."""
        count = len(self._far)
        if not count:
            return ()
        arm, values = self.run.estimate.geometry
        T = arm.T_tracker_frame0(values)
        base = ", ".join(f"{MM.of(part):.0f}".replace("-", "−") for part in T[:3, 3] + 0.0)
        more = f" and {count - _MOST_NAMED} more" if count > _MOST_NAMED else ""
        text = (
            f"out of reach: {', '.join(self.far_away[:_MOST_NAMED])}{more}. Targets are in the frame of the instrument "
            f"that measured the arm; the robot's base is at {base} mm there"
        )
        tried = arm.chain.random_joints(_TRIED, rng_for(0, "poses"))
        reach = np.linalg.norm(arm.points(tried, values)[:, self.target] - T[:3, 3], axis=1).max()
        if (np.linalg.norm(self.targets.positions[self._far], axis=1) < reach).all():
            text += ". Their coordinates look like ones in the robot's base"
        return (text,)

    @property
    def _beyond(self) -> tuple[str, ...]:
        sizes, ids = (
            np.sqrt(self._mean_squares["extrapolation"])[self.reached],
            [self.targets.ids[i] for i in np.flatnonzero(self.extrapolated)],
        )
        messages = list(phrases(check_extrapolated("targets", ids, len(sizes))))
        if count := int((sizes > 0).sum()):
            messages.append(
                f"{count} of {len(sizes)} targets are beyond what the run measured: of their expected errors, up to "
                f"{MM.text(sizes.max(), 2)} (1σ) is what the model may lack there"
            )
        return tuple(messages)

    @cached_property
    def extrapolated(self) -> NDArray[np.bool_]:
        """``(n,)`` which targets are reached where no fitted pose is near and the model lacks something."""
        joints = self.arm_inputs[:, : self.run.robot.chain.size]
        return np.asarray(self.run.estimate.extrapolated(joints) & self.found.converged)

    @property
    def _extrapolated_share(self) -> float:
        return float(self.extrapolated.sum()) / max(len(self.reached), 1)

    @property
    def _unchecked(self) -> tuple[str, ...]:
        model = self.run.robot.model
        if self.checked:
            return ("collisions were checked with links drawn as rods",) if model.shapes_assumed else ()
        return (f"nothing was checked for collisions: {'--no-check' if self.options.no_check else model.missing}",)

    @property
    def passed_over(self) -> tuple[tuple[str, str], ...]:
        """The targets that are reached by another solution of the inverse than the nearest: id, and why."""
        rows = zip(self.targets.ids, self.found.passed_over, self.found.converged, strict=True)
        return tuple((name, reason) for name, reason, reached in rows if reason and reached)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons to check the corrected targets before use."""
        of_run, run = self.run.result, list[str]()
        if self.reference is not None and self.expected is not None:
            run += filter(None, [flange_note(self.reference, self.expected.flange_95_m[self.reached])])
        if of_run.verdict != "good":
            run += [f"the run is {of_run.verdict}: {reason}" for reason in of_run.reasons or (of_run.reason,)]
        if self._extrapolated_share > MOST_UNCOVERED:
            share = f"{100 * self._extrapolated_share:.0f} % of the targets"
            run.append(f"{share} are extrapolated: not covered by measured poses; measure where the robot is to work")
        moved, usual = self.correction_m[self.reached], self._tolerance_m[self.reached]
        if not (far := moved > MOST_TOLERANCES * usual).any():
            return tuple(run)
        worst = int(np.argmax(moved / usual))
        text = (
            f"{int(far.sum())} targets are moved by more than {MOST_TOLERANCES:g} tolerances, "
            f"{self.targets.ids[self.reached[worst]]} by {MM.text(moved[worst])}, which is "
            f"{moved[worst] / usual[worst]:.3g}: is the nominal model that of this robot?"
        )
        return (text, *run)

    @cached_property
    def _tolerance_m(self) -> Array:
        """``(n,)`` how far the tolerances of the links let each target be missed (m, RMS)."""
        fitting = self.run.options.fitting
        return self._missed_by(Tolerance(MM.to_si(fitting.tolerance_mm), MRAD.to_si(fitting.tolerance_mrad)))

    def _missed_by(self, tolerance: Tolerance) -> Array:
        parts = [tolerance_rms(self.run.estimate.arm, jacobian, tolerance) for jacobian in self._sensitivities()]
        return np.concatenate(parts)

    @cached_property
    def better_left(self) -> dict[int, str]:
        """Rows of a program's targets expected to be better uncorrected, and why.

        An uncorrected target has the error of an arm that was never calibrated, by its tolerances; base and flange add
        the same to both.
        """
        assert self.reference is not None
        usual = self._missed_by(Tolerance(self.reference.sigma[0], self.reference.sigma[3]))
        return {
            i: (
                f"{self.targets.ids[i]}: the expected error is {MM.text(self._model_m[i])} with the correction and "
                f"{MM.text(usual[i])} without: too far from the measured poses"
            )
            for i in self.reached.tolist()
            if self._model_m[i] > usual[i]
        }

    def _sensitivities(self) -> Iterator[Array]:
        """Derivatives ``(some, 3, p)`` of the aimed point by the parameters, of some targets at a time."""
        run = self.run
        for inputs, at in self._blocks():
            yield run.estimate.arm.observe(inputs, run.estimate.values)[1][np.arange(len(inputs)), at]

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
            by_identified = jacobian[..., columns]
            if reference is not None:
                by_identified = by_identified + by_tool @ point_rows(reference.offsets(at)) @ reference.gain
            yield by_identified, by_tool

    def _blocks(self) -> Iterator[tuple[Array, NDArray[np.int_]]]:
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
        values = MM.of(lengths[self.reached])
        finite = values[np.isfinite(values)]
        return (float(finite.mean()), float(finite.max())) if len(finite) else (None, None)

    def _mean_and_max(self, lengths: Array) -> dict[str, float | None]:
        return dict(zip(("mean", "max"), self.mean_and_max_mm(lengths), strict=True))

    @property
    def verdict(self) -> Literal["good", "doubtful", "bad"]:
        """``bad`` where a target is not reached, ``doubtful`` where there are reasons for that, else ``good``."""
        return "bad" if self.failed else "doubtful" if self.reasons else "good"

    @property
    def near_singular(self) -> tuple[_NearSingular, ...]:
        """The targets that are reached within 1 degree of a singularity."""
        found, chain = self.found, self.run.robot.chain
        rows = np.flatnonzero(found.converged & (found.singular_rad < NEAR_RAD)).tolist()
        joints = found.singular_joint.tolist()
        return tuple(
            _NearSingular(
                self.targets.ids[i], chain.joint_names[joints[i]], float(found.singular_rad[i]), chain.unit(joints[i])
            )
            for i in rows
        )

    @cached_property
    def tools(self) -> tuple[UsedTool, ...]:
        """The tools of a program's corrected targets; none of a file of targets."""
        if self.reference is None or self.points is None:
            return ()
        return used_tools(self.reference, self.points[self.reached])

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints and ``result.json`` holds: lengths in mm."""
        values = self.saved_dict()
        return {**values, "stops": list(values["stops"])}

    def write_files(self, folder: Path) -> None:
        """Write the corrected targets and the calibrated arm in every format."""
        run, rows = self.run, np.flatnonzero(self.found.converged)
        chain, ids = run.robot.chain, {"id": [self.targets.ids[i] for i in rows]}
        marks = ["yes" if extrapolated else "no" for extrapolated in self.extrapolated[rows]]
        conditions: dict[str, Any] = {name: column[rows] for name, column in self.targets.conditions.items()}
        conditions |= {"extrapolated": marks} if self.extrapolated.any() else {}
        # The corrected targets: joint positions of all waypoints, and poses of the targets.
        _write_csv(folder / _JOINTS, self, {**self.waypoints.columns(chain), **_waypoint_conditions(self)})
        at_targets = {**_cartesian_columns(self, rows), **joint_columns(chain, self.found.joints[rows])}
        _write_csv(folder / _CARTESIAN, self, {**ids, **at_targets, **conditions})
        # The controller's arm, and the calibrated one in every format.
        nominal_inverse = run.estimate.nominal_inverse(self.target)  # what the corrected targets are for
        exact = run.robot.description_files[-1]
        nominal = run.robot.description(exact, nominal_inverse.arm.targets, nominal_inverse.values)
        (folder / _NOMINAL).write_text(nominal, encoding="utf-8")
        for name, text in self._geometry_files.texts.items():
            (folder / name).write_text(text, encoding="utf-8")
        (folder / MODULE_FILE).write_text(self._module[0], encoding="utf-8")
        for name, content in self._programs().items():
            (folder / name).write_bytes(content)

    def _programs(self) -> Mapping[str, bytes]:
        """Return the corrected program, or those that move to the corrected targets, by their names."""
        if self.program is not None:
            return {self.program.name: self.program.content}
        chain, controller = self.run.robot.chain, self.options.controller
        if not len(self.reached) or refusal(chain, controller, len(self.targets)) is not None:
            return {}
        return target_files(chain, controller, _target_moves(self))

    def saved_dict(self) -> dict[str, Any]:
        """Return the values of ``result.json`` with the waypoints one by one: a list of a million takes 1 GB."""
        chain = self.run.robot.chain
        return {
            "run": str(self.run.folder),
            "robot": self.run.robot.name,
            "serial": self.run.serial,
            "verdict": self.verdict,
            "reasons": list(self.reasons),
            "run_verdict": self.run.result.to_dict(),
            "tool": self.targets.tool,
            "model": self.model,
            "targets": len(self.targets),
            "converged": len(self.reached),
            "failed": [{"id": name, "reason": reason} for name, reason in self.failed],
            "checked": self.checked,
            "other_solution": [{"id": name, "reason": reason} for name, reason in self.passed_over],
            "stops": self.waypoints.rows(chain),
            "correction_mm": self._mean_and_max(self.correction_m),
            "predicted_mm": self._mean_and_max(self.predicted_m),
            "judged_mm": None if (after := self.run.result.after_mm) is None else after["mean"],
            "schemes_apart_mm": self.mean_and_max_mm(self.found.scheme_disagreement_m)[1],
            "extrapolated": {
                "share": self._extrapolated_share,
                "ids": [self.targets.ids[i] for i in np.flatnonzero(self.extrapolated)],
            },
            "near_singular": [
                {"id": name, "joint": joint, f"distance_{unit.key}": unit.of(distance)}
                for name, joint, distance, unit in self.near_singular
            ],
            "without_effects_mm": None if self.without_effects_m is None else MM.of(self.without_effects_m),
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
                    "shape_95_mm": MM.of(float(expected.shape_95_m[i])),
                    "base_95_mm": MM.of(float(expected.base_95_m[i])),
                }
                for i in self.reached
            ],
            "uncorrected": [{"line": each.line, "reason": each.reason} for each in program.uncorrected],
            "ways": [{"line": line, "reason": text} for line, text in program.touching_paths],
            "tools": [each.to_dict() for each in self.tools],
            "flange": flange_values(reference),
            "expected_95_mm": {
                "shape": self._mean_and_max(expected.shape_95_m),
                "base": self._mean_and_max(expected.base_95_m),
                "flange": self._mean_and_max(expected.flange_95_m),
            },
            "rounding_mm": program.rounding_mm,
            "rounding_deg": program.rounding_deg,
        }

    def columns(self) -> Mapping[str, Sequence[Any] | Array]:
        """A row for each target that is reached: id, joint positions (deg or mm), correction and predicted error."""
        rows, chain = self.reached, self.run.robot.chain
        return {
            "id": [self.targets.ids[i] for i in rows],
            **joint_columns(chain, self.found.joints[rows]),
            "correction_mm": MM.of(self.correction_m[rows]),
            "predicted_mm": MM.of(self.predicted_m[rows]),
            "extrapolated": self.extrapolated[rows].tolist(),
        }

    @cached_property
    def correction_m(self) -> Array:
        """Correction ``(n,)``: how far each target is moved for the controller (m); NaN where it is not reached."""
        return np.asarray(np.linalg.norm(self.found.positions - self.wanted.positions, axis=1))

    @cached_property
    def uncorrected_errors(self) -> Array:
        """Error ``(n, 3)`` (m, instrument's frame) of the calibrated arm with the joint positions of the nominal model.

        NaN where a target is not reached.
        """
        rows, found = self.reached, self.found
        conditions = self.arm_inputs[rows, found.joints.shape[1] :]
        inputs = np.concatenate([found.uncorrected[rows], conditions], axis=1)
        points = self.run.estimate.arm.points(inputs, self.run.estimate.values)
        aimed = np.full(len(rows), self.target) if self.points is None else self.points[rows]
        errors = np.full(self.wanted.positions.shape, np.nan)
        errors[rows] = points[np.arange(len(rows)), aimed] - self.wanted.positions[rows]
        return errors

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
        squares: dict[str, list[Array]] = {name: [] for name in causes}
        for inputs, at in self._blocks():
            predicted = estimate.predict(inputs, at)
            for name in causes:
                squares[name].append(np.trace(getattr(predicted, name)[:, 0], axis1=1, axis2=2))
        return {name: np.concatenate(parts) for name, parts in squares.items()}

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
    def load_m(self) -> Array:
        """The part ``(n,)`` of the predicted error that is the uncertainty of an identified payload (m, RMS)."""
        return self.run.estimate.load_errors(self.arm_inputs, [self.target])[:, 0]

    @property
    def target(self) -> int:
        """The index of the arm's target that is aimed."""
        return self.run.estimate.arm.targets.index(self.targets.tool)


def _target_moves(result: CompensationResult) -> TargetMoves:
    """Return the moves of a controller's program, with the base and tool for the controller's nominal links."""
    run, nominal_inverse = result.run, result.run.estimate.nominal_inverse(result.target)
    T_instrument_frame0 = nominal_inverse.arm.T_tracker_frame0(nominal_inverse.values)
    T_last_tool, waypoints = se3.pose(run.estimate.R_last_tool, nominal_inverse.tools[result.target]), result.waypoints
    T_frame0_instrument = se3.inverse(T_instrument_frame0)
    postures = postures_of(nominal_inverse.arm, nominal_inverse.values, waypoints.joints)
    return TargetMoves(
        run.robot.name,
        waypoints.ids,
        waypoints.joints,
        waypoints.which,
        T_last_tool,
        T_frame0_instrument,
        result.checked,
        postures,
    )


def _cartesian_columns(result: CompensationResult, rows: NDArray[np.int_]) -> dict[str, Any]:
    positions, tool = MM.of(result.found.positions[rows]), result.targets.tool
    quaternions = se3.quaternion_from_rotation(result.found.rotations[rows] @ result.run.estimate.R_last_tool)
    columns = {f"{tool}_{axis}_mm": values for axis, values in zip("xyz", positions.T, strict=True)}
    return columns | {f"{tool}_q{part}": values for part, values in zip("wxyz", quaternions.T, strict=True)}


def _waypoint_conditions(result: CompensationResult) -> dict[str, list[Any]]:
    """Return the conditions of the targets among the waypoints; empty where a waypoint is no target."""
    rows, which = np.flatnonzero(result.found.converged), result.waypoints.which
    return {
        name: [column[rows[pose]] if pose >= 0 else "" for pose in which.tolist()]
        for name, column in result.targets.conditions.items()
    }


def _write_csv(path: Path, result: CompensationResult, columns: Mapping[str, Sequence[Any] | Array]) -> None:
    if not result.checked:
        columns = {**columns, "checked": ["no"] * len(columns["id"])}
    write_columns(path, columns)
