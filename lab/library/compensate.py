"""Compensate targets: from a run and a file of targets to joint values and corrected targets."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.compensation.compensator import REQUESTED_BRANCH, Compensation, Compensator
from lab.core.errors import LabError, error_context
from lab.core.measurements import LAST_MOVE, condition_column, last_moves
from lab.core.progress import stages
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import DEGREES, MICRONS, MM
from lab.formats.measurement_csv import ObservedColumns
from lab.formats.target_csv import Targets, read_targets
from lab.kinematics.effects.effect import PAYLOAD
from lab.kinematics.inverse.branches import nearest_whole_turns
from lab.kinematics.inverse.newton_inverse import PLACES, PoseTarget
from lab.library.compensation_result import CompensationResult
from lab.library.corrected_program import OpenProgram, open_program
from lab.library.load_run import CalibrationRun, calibrated_by, condition_notes, folder_of, load_run
from lab.library.program_reference import paths_touched
from lab.library.run_folder import Waypoints
from lab.options.call_options import options_of, takes
from lab.options.compensation import CompensateOptions
from lab.phrases.fit_phrases import listed
from lab.planning.reachability import ReachabilityGraph, free_home, reachability, refusals
from lab.pose_selection.tour import rated, waypoints_in_order
from lab.simulation.collisions import collides, random_poses

if TYPE_CHECKING:
    from lab.library.calibration_result import CalibrationResult

__all__ = ["compensate"]

_HUBS = 100  # free poses tried as ones to pass through on the way to others
_CONFIGURATION_REASON = "the program's configuration asks for this solution"
_UNTURNED_RAD = 1e-6  # a rotation that is missed by more is reported
_UNPLACED_M = 1e-7  # and a position


@takes(CompensateOptions)
def compensate(
    targets: str | Path | Targets | CompensateOptions | None = None,
    run: "str | Path | CalibrationResult | None" = None,
    **options: Any,
) -> CompensationResult:
    r"""Correct targets for a calibrated robot, so that its controller, which computes with nominal values, meets them.

    Args:
        targets: a CSV file, or targets in memory: where the tool is to be, in the frame in which the robot was
            measured (m); or all options in one object; None with ``program``.
        run: what calibrated the robot: a result of ``calibrate`` or ``identify``, or the folder of a run.
        options: those of ``lab compensate``, by name: ``program``, ``orientation``, ``force``, ``load``.

    Returns:
        Joint positions (rad or m) and corrected targets (m, in the frame of the targets), and the error to expect.

    Raises:
        LabError: the run is not good, or the targets are not for its tool; the message says how to go on.

    Example:
        >>> import lab, pathlib, tempfile
        >>> result = lab.calibrate("irb120", seed=7)
        >>> file = pathlib.Path(tempfile.mkdtemp()) / "targets.csv"
        >>> x, y, z = 1e3 * result.measurements.points[0, 0]
        >>> _ = file.write_text(f"p1_x_mm,p1_y_mm,p1_z_mm\n{x},{y},{z}\n")
        >>> lab.compensate(file, run=result).to_dict()["targets"]
        1
    """
    if isinstance(targets, CompensateOptions):
        targets.refuse_conflicts()
        return _compensated(
            targets, load_run(targets.run, targets.load, targets.cell, accept_edited=targets.accept_edited)
        )
    in_memory = targets if isinstance(targets, Targets) else None
    file = "targets.csv" if in_memory is not None else str(targets)
    named = {} if targets is None else {"targets": file}
    requested = options_of("lab.compensate", CompensateOptions, {**named, **folder_of(run), **options})
    requested.refuse_conflicts()
    by = calibrated_by(run, requested.run, requested.load, requested.cell, accept_edited=requested.accept_edited)
    return _compensated(requested, by, in_memory)


def _compensated(options: CompensateOptions, run: CalibrationRun, given: Targets | None = None) -> CompensationResult:
    if not options.force:
        run.refuse_unfit("compensation")
    if options.program is not None:
        return _of_program(options, run)
    chain, targets = run.robot.chain, given
    if targets is None:
        columns = ObservedColumns(orientations=True).with_conditions(run.estimate.arm.conditions)
        targets = read_targets(options.source, chain.joint_names, chain.prismatic, options.orientation, columns)
    return _corrected(options, run, targets, _access(options, run))


def _of_program(options: CompensateOptions, run: CalibrationRun) -> CompensationResult:
    program = open_program(options, run)
    done = _corrected_program(options, program)
    if left := done.better_left:
        program = program.without(left)
        done = _corrected_program(options, program)
    configurations = np.full((len(program.read.targets), run.robot.chain.size), np.nan)
    configurations[program.rows] = (
        program.targets.joints
    )  # those that are not corrected stay in the text, and are moved to
    configurations[program.rows[done.reached]] = done.found.joints[done.reached]
    paths: tuple[tuple[int, str], ...] = ()
    if done.checked:
        names = [each.name for each in program.read.targets]
        with stages("checking") as stage:
            paths = paths_touched(
                run.robot.model, program.nominal, configurations, program.read.moves, names, partial(stage, "ways")
            )
    assert done.program is not None
    return replace(done, program=replace(done.program, touching_paths=paths))


def _corrected_program(options: CompensateOptions, program: OpenProgram) -> CompensationResult:
    """Correct a program's targets: the result, in which they are where the tools are.

    Compensation brings the flange to its pose; where that is met, so is the tool on it, wherever that is.
    """
    reference, points = program.reference, program.points
    done = _corrected(options, reference.run, program.targets, None, program)
    R_last_flange, offsets = reference.flange.T_last_flange[:3, :3], reference.offsets(points)[:, :, None]
    turned = program.targets.rotations
    moved, in_flange = done.found.rotations, done.found
    targets = replace(
        program.targets,
        tool=reference.run.estimate.arm.targets[points[0]],
        positions=program.targets.positions + (turned @ offsets)[..., 0],
    )
    found = replace(
        in_flange, positions=in_flange.positions + (moved @ offsets)[..., 0], rotations=moved @ R_last_flange.T
    )
    wanted = PoseTarget(targets.positions, done.wanted.rotations)
    return replace(done, targets=targets, wanted=wanted, found=found, reference=reference, points=points)


def _corrected(
    options: CompensateOptions,
    run: CalibrationRun,
    targets: Targets,
    access: ReachabilityGraph | None,
    program: OpenProgram | None = None,
) -> CompensationResult:
    """Correct targets for the arm of a run."""
    source = str(options.source)
    _refuse_impossible(run, targets, source)
    conditions, warnings = _conditions(run, targets, source)
    target = run.estimate.arm.targets.index(targets.tool)
    wanted = PoseTarget(targets.positions, targets.rotations @ run.estimate.R_last_tool.T)
    may_not = refusals(run.robot.model, access) if (checked := _is_checked(options, run)) else None
    bound = REQUESTED_BRANCH if program is None else _CONFIGURATION_REASON
    compensator = Compensator(
        run.estimate.nominal_inverse(target), run.estimate.arm, run.estimate.values, may_not, bound
    )
    found, conditions = _in_their_order(compensator, wanted, conditions, targets)
    corrected = None
    if program is not None:
        corrected, found = program.rewritten(found, options.digits)
    inputs = np.concatenate([found.joints, conditions], axis=1)
    without = run.estimate.geometry_error(inputs[found.converged], target)
    if without is not None:
        warnings.append(
            f"the exported arm cannot store {', '.join(listed(run.estimate.groups))}; used alone it is "
            f"{MM.text(without, 2)} off at these targets"
        )
    warnings += _left_out(run, targets, found)
    messages = (*run.warnings, *targets.warnings, *warnings)
    rows = np.flatnonzero(found.converged)
    path, which = found.joints[rows], np.arange(len(rows))
    if access is not None:
        with stages("checking") as stage:
            rates, told = rated(run.robot.chain)[0], partial(stage, "ways")
            path, which = waypoints_in_order(path, access.hubs, rates, access.free, told)
    waypoints = Waypoints(path, which, [targets.ids[i] for i in rows], "target")
    done = CompensationResult(
        options, run, targets, wanted, found, inputs, without, waypoints, checked, messages, corrected
    )
    return replace(done, notes=(*messages, *_of_load(done)))


def _of_load(done: CompensationResult) -> tuple[str, ...]:
    """Describe the share of an identified payload in the expected error; nothing without one."""
    load, reached = done.run.load, done.found.converged
    if load is None or not reached.any():
        return ()
    size = float(np.sqrt((done.load_m[reached] ** 2).mean()))
    if not size:
        why = "the run has no compliance, or no target carries them"
        return (f"{load.mass_kg:.4g} kg at the flange make no difference: {why}",)
    return (f"of the error to expect, {MICRONS.text(size, 2)} (1σ, root mean square) is the load's uncertainty",)


def _left_out(run: CalibrationRun, targets: Targets, found: Compensation) -> list[str]:
    size, messages = run.robot.chain.size, []
    if found.unturned_rad.max() > _UNTURNED_RAD:
        worst = int(found.unturned_rad.argmax())
        missed = f"rotations missed by up to {DEGREES.text(found.unturned_rad[worst], 2)} (target {targets.ids[worst]})"
        met = "positions are met, " if size >= PLACES else ""
        messages.append(
            f"{run.robot.name} has {size} joints, which cannot give the tool every orientation: {met}{missed}"
        )
    if found.unplaced_m.max() > _UNPLACED_M:
        worst = int(found.unplaced_m.argmax())
        messages.append(
            f"{run.robot.name} has {size} joints, which cannot bring the tool to every place: it comes as near as they "
            f"can, to within {MM.text(found.unplaced_m[worst], 2)} (target {targets.ids[worst]})"
        )
    return messages


def _access(options: CompensateOptions, run: CalibrationRun) -> ReachabilityGraph | None:
    """Build the graph of collision-free poses and paths; None if not requested, or shapes are unknown."""
    model = run.robot.model
    if not _is_checked(options, run):
        return None
    free = random_poses(model, _HUBS, rng_for(0, "poses"))
    home = free_home(model, free)
    near = nearest_whole_turns(model.chain, free, home)  # the same poses, without a turn of a joint on the way
    return reachability(model, home, near, lambda joints: ~collides(model, joints), _HUBS)


def _is_checked(options: CompensateOptions, run: CalibrationRun) -> bool:
    return not (options.no_check or run.robot.model.missing)


def _refuse_impossible(run: CalibrationRun, targets: Targets, source: str) -> None:
    """Refuse targets without a frame, beyond the limits, or of a tool that was not identified, with a LabError."""
    run.refuse_unplaced("targets")
    outside = run.robot.chain.beyond_limits(targets.joints, 1e-9)
    if outside.any():
        row, joint = np.argwhere(outside)[0].tolist()
        message = run.robot.chain.limit_note(joint, targets.joints[row, joint])
        raise LabError(f"{source}: line {targets.lines[row]}, {message}; mend it, or leave the row's joints empty")
    if targets.tool not in run.estimate.arm.targets:
        raise LabError(
            f"{source}: tool {targets.tool} was not identified in {run.folder}, which has "
            f"{', '.join(run.estimate.arm.targets)}; rename the columns, or measure that point"
        )


def _in_their_order(
    compensator: Compensator, wanted: PoseTarget, conditions: Array, targets: Targets
) -> tuple[Compensation, Array]:
    """The corrected targets, and what the arm's effects ask for there, with where the joints come from."""
    with stages("correcting") as stage:
        found = replace(compensator, progress=partial(stage, "targets"))(wanted, conditions, targets.joints)
    columns = [i for i, name in enumerate(compensator.arm.conditions) if name.startswith(LAST_MOVE)]
    if not columns:
        return found, conditions
    moved = conditions.copy()
    moved[:, columns] = last_moves(found.uncorrected)
    with stages("correcting once more, with the joints' last moves") as stage:
        return replace(compensator, progress=partial(stage, "targets"))(wanted, moved, targets.joints), moved


def _conditions(run: CalibrationRun, targets: Targets, source: str) -> tuple[Array, list[str]]:
    """The conditions of the arm's effects at each target ``(n, c)``, and notes of what is assumed of them."""
    given, conditions = targets.conditions, run.estimate.arm.conditions
    notes = condition_notes(run, source, list(given), "target", "corrected")
    if run.load is not None and PAYLOAD in conditions and PAYLOAD not in given:
        given = {**given, PAYLOAD: np.full(len(targets), run.load.mass_kg)}
    with error_context(source):
        columns = [
            np.zeros(len(targets))  # until it is known where the joints come from
            if name.startswith(LAST_MOVE)
            else condition_column(given, name, len(targets), lambda row: f"line {targets.lines[row]}")
            for name in conditions
        ]
    return np.stack(columns, axis=1) if columns else np.empty((len(targets), 0)), notes
