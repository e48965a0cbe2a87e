"""Find base, flange and tools that a program's numbers refer to, and predict the errors of its corrected targets.

A target of a program is a pose of the tool in the base; the text places the tool in the flange. The base of the
calibrated arm follows from the first joint's axis and zero by the nominal first link, the flange from
``lab.compensation.flange``. The controller's arm has the nominal links, base and flange.

The error of a target has three parts: the calibrated model's (covariance of its parameters, model discrepancy), the
flange's, which moves every tool alike in the last frame, and the base's, which moves all targets alike. The last two
are not measured; their sizes are the tolerances of the last and first link. Errors of targets relative to each other
are those after the best rigid motion of all.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from lab.calibration.prior import Tolerance, alias_matrix, standard_deviations
from lab.compensation.flange import Flange, located_flange, point_rows
from lab.core import se3
from lab.core.linear_model import covariance_root, matched_dof
from lab.core.probability import f_isf
from lab.core.progress import Progress, no_progress
from lab.core.se3 import Array
from lab.core.units import MM, MRAD
from lab.formats.programs.program_text import ArmShape, Move, ProgramText, TargetText
from lab.kinematics.gauge import base_set
from lab.kinematics.inverse.branches import NominalInverse, nearest_whole_turns
from lab.kinematics.inverse.newton_inverse import PoseTarget
from lab.kinematics.joints import JointSpec
from lab.kinematics.serial.serial_arm import DEFAULT_TOOL, SerialArm
from lab.library.load_run import CalibrationRun
from lab.pose_selection.tour import FreePath
from lab.prediction.estimate import Estimate, EstimatedParameter
from lab.simulation.collisions import collides, describe_collisions
from lab.simulation.free_path import path_check
from lab.simulation.robot_model import RobotModel, at_zero, site_pose

__all__ = [
    "ProgramErrors", "ProgramReference", "frames_of", "paths_touched", "program_errors", "program_reference",
    "requested_solutions",
]  # fmt: skip

_BASE, _FLANGE = "base", "flange"  # frames of the controller in the lab's frame 0 and last frame
_GIVEN_DOF = 2  # as many links the tolerances as they are given weigh beside those that were identified
_POSE_M = (
    0.05  # along the axes of a measured pose are points that stand for it: 0.2 mrad where they are stated to 10 um
)
_WELL_DETERMINED = 0.5  # of its tolerance: a parameter measured better shows how large the arm's tolerances are


@dataclass(frozen=True)
class ProgramReference:
    """The calibrated arm with the points of a program's tools.

    Attributes:
        run: the run; behind its targets the arm has the controller's flange and a point for each tool, and its nominal
            values have the identified base and the tools as stated.
    """

    run: CalibrationRun
    flange: Flange  # in the last frame
    sigma: Array  # (6,) tolerances of the first and the last link (m, rad), as large as this arm's are
    dof: float  # degrees of freedom of sigma
    target: int  # target of the arm that stands for the flange
    points: Mapping[str, int]  # targets of the arm by the tools' names
    gain: Array  # (6, f) how the flange's motion in the last frame follows the identified parameters

    @cached_property
    def nominal(self) -> NominalInverse:
        """The controller's arm, which brings its flange somewhere."""
        return self.run.estimate.nominal_inverse(self.target)

    def point_of(self, read: ProgramText, target: TargetText) -> int:
        """The arm's target that stands for a program's target: its tool; of joint positions the only one, if so."""
        return self.points[_tool_of(read, target)]

    def offsets(self, points: NDArray[np.int_]) -> Array:
        """Places ``(n, 3)`` m of points in the flange."""
        return np.asarray(self.nominal.tools[points])

    @cached_property
    def first_origin(self) -> Array:
        """Origin ``(3,)`` m of the frame behind the first joint, in the instrument's frame."""
        chain = self.nominal.arm.dh_chain(self.nominal.values)
        assert chain is not None
        T_instrument_frame0 = self.nominal.arm.T_tracker_frame0(self.nominal.values)
        part = SerialArm(chain.first(1))
        origin = part.flange(np.zeros((1, 1)), part.nominal())[:, :3, 3]
        return np.asarray(se3.transform(T_instrument_frame0, origin)[0])

    @property
    def measured_targets(self) -> tuple[str, ...]:
        """The points that were measured."""
        return self.run.estimate.arm.targets[: self.target]

    @property
    def stated(self) -> tuple[str, ...]:
        """Measured points whose places in the flange are stated.

        Those of the default tool count only if the measurements agree with them.
        """
        tool, names = self.run.robot.tool, _stated(self.run.robot.tool, self.measured_targets)
        default = all(
            name in DEFAULT_TOOL and np.allclose(tool[name], DEFAULT_TOOL[name], rtol=0, atol=1e-9) for name in names
        )
        return () if default and not self.flange.uses_stated else names


def program_reference(run: CalibrationRun, read: ProgramText) -> ProgramReference:
    """Find base and flange of the calibrated arm, and give it the points of a program's tools."""
    sigma, dof = _own_tolerance(run)
    flange, gain = _flange(run, sigma, dof)
    estimate, targets = run.estimate, run.estimate.arm.targets
    measured = len(targets)
    T_flange_last = se3.inverse(flange.T_last_flange)
    in_flange = se3.transform(T_flange_last, _tools(run, estimate.values))
    names = dict.fromkeys(_tool_of(read, each) for each in read.targets)
    places = [in_flange[0] if not name else frames_of(read, name)[0][:3, 3] for name in names]
    new = _named(targets, ["controller flange", *(name or f"{targets[0]} in flange" for name in names)])
    arm = estimate.with_targets((*targets, *new))
    tools = np.stack([np.zeros(3), *places])
    real = {**_by_name(run, estimate.values), **_points_by_name(new, se3.transform(flange.T_last_flange, tools))}
    nominal = {**_by_name(run, estimate.nominal), **_points_by_name(new, tools)}
    nominal |= {name: real[name] for name in arm.names if name.startswith("base.")}
    nominal |= _points_by_name(targets, in_flange)
    rows = _extended(estimate, real, nominal, flange)
    extended = replace(run, estimate=replace(estimate, rigid=arm.rigid, rows=rows))
    points = {name: measured + 1 + i for i, name in enumerate(names)}
    return ProgramReference(extended, flange, sigma, dof, measured, points, gain)


def _extended(
    estimate: Estimate, real: Mapping[str, float], nominal: Mapping[str, float], flange: Flange
) -> tuple[EstimatedParameter, ...]:
    """Return rows of an arm with further points, whose measured tool is the flange."""
    turn = dict(zip(("tool.rx", "tool.ry", "tool.rz"), se3.log(flange.T_last_flange[:3, :3]).tolist(), strict=True))
    rows = {row.name: row for row in estimate.rows}
    for name, value in {**real, **turn}.items():
        row = rows.get(name, EstimatedParameter(name=name, nominal=value, estimate=value, exported=value))
        rows[name] = replace(row, nominal=nominal.get(name, value), exported=value)
    return tuple(rows.values())


def frames_of(read: ProgramText, tool: str, base: str = "") -> tuple[Array, Array]:
    """Poses ``(4, 4)`` (m) of a tool of a program in the last frame, and of a base in frame 0."""
    flange, frame0 = (read.frames.get(name, np.eye(4)) for name in (_FLANGE, _BASE))
    return flange @ read.frames[tool], frame0 @ read.frames[base] if base else frame0


def _tool_of(read: ProgramText, target: TargetText) -> str:
    """The name of a target's tool; "" of joint positions, where the program's poses have not one tool alone."""
    if target.spelling is not None:
        return target.tool
    tools = {each.tool for each in read.targets if each.spelling is not None}
    return tools.pop() if len(tools) == 1 else ""


def _own_tolerance(run: CalibrationRun) -> tuple[Array, float]:
    """Tolerances ``(6,)`` (m, rad) of this arm's links, as its identified ones show them, and degrees of freedom.

    An identified parameter is off by its own error and by those of the parameters that it is aliased with
    (``lab.calibration.prior``), so it is counted in the standard deviation that tolerances give them all.
    """
    fitting = run.options.fitting
    tolerance = Tolerance(MM.to_si(fitting.tolerance_mm), MRAD.to_si(fitting.tolerance_mrad))
    arm, nominal = run.estimate.arm, run.estimate.nominal
    structure = base_set(arm, nominal)
    spread = standard_deviations(arm, tolerance)
    spread[~np.isfinite(spread)] = 0.0
    wide = np.sqrt(((alias_matrix(structure, len(arm.names)) * spread) ** 2).sum(axis=1))
    by_name = dict(zip((arm.names[i] for i in structure.identifiable), wide.tolist(), strict=True))
    deviation = np.sqrt(np.diag(run.estimate.free_covariance))
    deviations = dict(zip(run.estimate.free_names, deviation.tolist(), strict=True))
    estimates, drawn = {name: row.estimate for name, row in run.estimate.params.items()}, _by_name(run, nominal)
    sums, counts = {True: 0.0, False: 0.0}, {True: 0, False: 0}
    for each in arm.parameters:
        name = each.name
        if (
            not each.is_link
            or by_name.get(name, 0.0) == 0
            or not deviations.get(name, np.inf) < _WELL_DETERMINED * by_name[name]
        ):
            continue
        off = estimates[name] - drawn[name]
        if each.is_angle:
            off = float(np.remainder(off + np.pi, 2 * np.pi) - np.pi)
        sums[each.is_angle] += (off / by_name[name]) ** 2
        counts[each.is_angle] += 1
    scale = {kind: np.sqrt((_GIVEN_DOF + sums[kind]) / (_GIVEN_DOF + counts[kind])) for kind in sums}
    sigma = np.repeat([scale[False] * tolerance.length_m, scale[True] * tolerance.angle_rad], 3)
    return sigma, float(_GIVEN_DOF + min(counts.values()))


def _flange(run: CalibrationRun, sigma: Array, dof: float) -> tuple[Flange, Array]:
    """The flange, by the measured points whose places in it are stated; ``(6, f)`` how it follows the parameters."""
    stated = run.robot.tool
    known = _stated(stated, run.estimate.arm.targets)
    columns = [f"tool.{name}.{axis}" for name in known for axis in "xyz"]
    retained = [i for i, name in enumerate(columns) if name in run.estimate.free_names]
    at = [run.estimate.free_names.index(columns[i]) for i in retained]
    moved = np.eye(len(columns))  # how the points follow what was measured of them
    covariance = np.zeros_like(moved)
    covariance[np.ix_(retained, retained)] = run.estimate.free_covariance[np.ix_(at, at)]
    measured = _by_name(run, run.estimate.values)
    points = np.array([measured[name] for name in columns]).reshape(-1, 3)
    places = np.array([stated[name] for name in known]).reshape(-1, 3)
    if posed := run.options.observe == "pose" and len(known) == 1:
        ends = _POSE_M * np.eye(3)
        points = np.concatenate([points, points + ends @ run.estimate.R_last_tool.T])
        places = np.concatenate([places, places + ends @ _stated_turn(run, known[0]).T])
        moved = np.tile(moved, (4, 1))
    flange = located_flange(points, moved @ covariance @ moved.T, places, _prior(run, sigma), dof, posed=posed)
    flange = replace(flange, gain=flange.gain @ moved, deviation_m=flange.deviation_m[: len(known)])
    gain = np.zeros((6, len(run.estimate.free_names)))
    gain[:, at] = flange.gain[:, retained]
    return flange, gain


def _prior(run: CalibrationRun, sigma: Array) -> Array:
    """Covariance ``(6, 6)`` (m, rad) that tolerances ``(6,)`` give the flange in the last frame.

    The face is off the last link, and along and about its axis the last link is off, too.
    """
    arm, values = run.estimate.geometry
    T, jacobian = arm.tool(np.zeros((1, arm.chain.size)), values)
    axis = T[0, :3, :3].T @ jacobian[0, 3:, -1]
    along = np.outer(axis, axis) / (axis @ axis)
    nothing = np.zeros((3, 3))
    return np.asarray(
        np.diag(sigma**2) + np.block([[sigma[0] ** 2 * along, nothing], [nothing, sigma[3] ** 2 * along]])
    )


def _stated(tool: Mapping[str, Array], names: Sequence[str]) -> tuple[str, ...]:
    """The points whose places in the flange the robot's description or its cell has."""
    return tuple(name for name in names if name in tool)


def _stated_turn(run: CalibrationRun, name: str) -> Array:
    """Rotation ``(3, 3)`` of a target in the flange, as the robot's description or its cell has it."""
    model, arm = run.robot.model, run.robot.serial_arm(run.estimate.arm.targets)
    last = arm.flange(np.zeros((1, arm.chain.size)), arm.nominal())[0]
    target = site_pose(model.model, at_zero(model.model), name)
    return np.asarray((model.T_world_frame0 @ last)[:3, :3].T @ target[:3, :3])


def _tools(run: CalibrationRun, values: Array) -> Array:
    """Places ``(k, 3)`` m of the measured points in the last frame."""
    named = _by_name(run, values)
    return np.array([[named[f"tool.{name}.{axis}"] for axis in "xyz"] for name in run.estimate.arm.targets])


def _by_name(run: CalibrationRun, values: Array) -> dict[str, float]:
    return dict(zip(run.estimate.arm.names, values.tolist(), strict=True))


def _points_by_name(names: Sequence[str], places: Array) -> dict[str, float]:
    """The parameters of points ``(k, 3)`` m by their names."""
    return {
        f"tool.{name}.{axis}": value
        for name, place in zip(names, places.tolist(), strict=True)
        for axis, value in zip("xyz", place, strict=True)
    }


def _named(taken: Sequence[str], wished: Sequence[str]) -> list[str]:
    names = list[str]()
    for name in wished:
        plain = (
            "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in name).strip("_") or "tool"
        )
        plain = f"tool_{plain}" if plain.lower() in ("flange", "tracker") or plain[0].isdigit() else plain
        while plain in (*taken, *names):
            plain += "_"
        names.append(plain)
    return names


_SHARE = 0.05  # of the errors that are larger than the expected ones
_ENDLESS = 1e9  # degrees of freedom of what is known
_RANK = 1e-9  # of the largest singular value of rigid motions: targets on a line do not show all
_LEAST_M2 = 1e-24  # a mean square that is none


@dataclass(frozen=True)
class ProgramErrors:
    """Expected errors of n targets."""

    flange_m: Array  # (n,) the flange's part (RMS)
    flange_95_m: Array  # (n,) length that 95 % of the flange's part do not exceed
    base_95_m: Array  # (n,) length that 95 % of the errors in the robot's base do not exceed
    shape_95_m: Array  # (n,) length that 95 % of the errors do not exceed after the best rigid motion of all targets


def program_errors(
    reference: ProgramReference,
    positions: Array,
    offsets: Array,
    by_tool: Array,
    by_measured: Array,
    rest_m: Array,
    dof: float | None,
) -> ProgramErrors:
    """Predict the errors of corrected targets.

    Args:
        positions: ``(n, 3)`` m of the tools, in the instrument's frame.
        offsets: ``(n, 3)`` m of the tools, in the flange.
        by_tool: ``(n, 3, 3)`` derivatives of the positions by the tools' places in the last frame.
        by_measured: ``(n, 3, m)`` derivatives by what was measured, in standard deviations.
        rest_m: ``(n,)`` RMS of what is independent from target to target.
        dof: degrees of freedom of the measured part; None where its size is known.
    """
    by_flange = by_tool @ point_rows(offsets) @ covariance_root(reference.flange.covariance)
    by_base = point_rows(positions - reference.first_origin) * reference.sigma
    parts = (by_measured, by_flange, by_base)
    dofs = (_ENDLESS if dof is None else max(dof, 1.0), reference.flange.dof, reference.dof)
    rest = np.asarray(rest_m**2 / 3)
    whole = sum(each @ each.swapaxes(1, 2) for each in parts) + rest[:, None, None] * np.eye(3)
    return ProgramErrors(
        _sizes(by_flange),
        _length_95(by_flange @ by_flange.swapaxes(1, 2), [_sizes(by_flange) ** 2], [reference.flange.dof]),
        _length_95(whole, [_sizes(each) ** 2 for each in parts], dofs),
        _shape_95(positions, parts[:2], rest, dofs[:2]),
    )


def _shape_95(positions: Array, parts: Sequence[Array], rest: Array, dofs: Sequence[float]) -> Array:
    """Lengths ``(n,)`` m that 95 % of the errors do not exceed after the best rigid motion of all targets."""
    count = len(positions)
    left, sizes, _ = np.linalg.svd(point_rows(positions - positions.mean(axis=0)).reshape(-1, 6), full_matrices=False)
    rigid = left[:, sizes > _RANK * sizes.max(initial=0.0)]
    own = rigid.reshape(count, 3, -1)
    moved = np.einsum("n,nik,nil->kl", rest, own, own)
    square = rest[:, None, None] * (np.eye(3) - 2 * own @ own.swapaxes(1, 2)) + own @ moved @ own.swapaxes(1, 2)
    squares = []
    for each in parts:
        flat = each.reshape(3 * count, -1)
        deformed = (flat - rigid @ (rigid.T @ flat)).reshape(each.shape)
        square = square + deformed @ deformed.swapaxes(1, 2)
        squares.append(_sizes(deformed) ** 2)
    return _length_95(square, squares, dofs)


def _length_95(squares: Array, of_parts: Sequence[Array], dofs: Sequence[float]) -> Array:
    """Lengths ``(n,)`` m that 95 % of errors with covariances ``(n, 3, 3)`` do not exceed (Satterthwaite 1946).

    Args:
        of_parts: mean squares ``(n,)`` of the parts whose sizes are known with so many degrees of freedom.
    """
    mean = np.maximum(np.trace(squares, axis1=1, axis2=2), _LEAST_M2)
    numbers = np.clip(matched_dof(mean, np.maximum(2 * (squares**2).sum(axis=(1, 2)), _LEAST_M2**2)), 1.0, 3.0)
    spread = sum(part**2 / dof for part, dof in zip(of_parts, dofs, strict=True))
    dof = mean**2 / np.maximum(spread, mean**2 / _ENDLESS)
    return np.asarray(np.sqrt(mean * f_isf(_SHARE, numbers, dof)))


def _sizes(slopes: Array) -> Array:
    """Root mean square ``(n,)`` m of errors with independent causes, by derivatives ``(n, 3, m)``."""
    return np.asarray(np.sqrt((slopes**2).sum(axis=(1, 2))))


_REACHED_M = 1e-6  # a pose that a solution misses by less is reached
_STEP_M, _STEP_RAD = 0.01, np.deg2rad(2.0)  # along a line of the tool, between two checked poses
_MAX_CHECKS = 400
_POSES_DESCRIBED = 200  # along a joint path that is not free
_JUMP_RAD = 0.5  # of a joint between two checked poses of a line: it passes a singularity


def requested_solutions(
    nominal: NominalInverse, wanted: PoseTarget, targets: Sequence[TargetText]
) -> tuple[Array, dict[int, str]]:
    """Solve for the joint positions of the controller's arm at each target of the text.

    Among the IK solutions with the requested configuration, or among all, the nearest to the target before is taken.

    Args:
        wanted: of the measured point, in the instrument's frame.

    Returns:
        ``(n, 6)`` rad, NaN where no solution reaches the target; and why some have none, by row.
    """
    chain = nominal.arm.chain
    joints, refused = np.full((len(targets), chain.size), np.nan), dict[int, str]()
    if not targets:
        return joints, refused
    nominal_chain = nominal.arm.dh_chain(nominal.values)
    assert nominal_chain is not None
    shape, last = ArmShape.of(nominal_chain), chain.home
    solutions = nominal.solutions(wanted, np.broadcast_to(chain.home, joints.shape))
    for i, target in enumerate(targets):
        if target.spelling is None:
            joints[i] = last = target.joints
            continue
        some = solutions.joints[i][solutions.gap_m[i] < _REACHED_M]
        if target.allowed is None:
            some = np.concatenate([some, _from(nominal, wanted.take(np.array([i])), last)])
        if not len(some):
            continue
        turned = _with_turns(chain, some)
        turned = turned[~chain.beyond_limits(turned, 1e-9).any(axis=1)]
        fits = turned if target.allowed is None else turned[target.allowed(shape, turned)]
        if not len(fits):
            refused[i] = (
                f"{target.name}: no solution of the nominal arm within its limits has the configuration in the text; "
                "compare joint zeros and signs with the controller"
            )
            continue
        joints[i] = last = fits[np.abs(fits - last).max(axis=1).argmin()]
    return joints, refused


def _from(nominal: NominalInverse, wanted: PoseTarget, start: Array) -> Array:
    """The solution ``(0 or 1, 6)`` to which Newton's method leads from joint positions."""
    joints, _ = nominal.again(wanted, start[None], np.array([-1]))
    missed = np.linalg.norm(wanted.errors(nominal.tool(joints)[0])[0])
    return joints if missed < _REACHED_M else joints[:0]


def _with_turns(chain: JointSpec, joints: Array) -> Array:
    """Joint positions ``(k, n)``, and those a whole turn of some joints away."""
    wide = [
        (0.0,) if slides or upper - lower < 2 * np.pi else (-2 * np.pi, 0.0, 2 * np.pi)
        for slides, lower, upper in zip(chain.prismatic, chain.lower, chain.upper, strict=True)
    ]
    turns = np.array(list(product(*wide)))
    return np.asarray((joints[:, None] + turns).reshape(-1, chain.size))


def paths_touched(
    model: RobotModel,
    nominal: NominalInverse,
    joints: Array,
    moves: Sequence[Move],
    names: Sequence[str],
    progress: Progress = no_progress,
) -> tuple[tuple[int, str], ...]:
    """Find the collisions on the moves from target to target in the order of the text, by line.

    Args:
        joints: ``(t, 6)`` rad at each target of the text, corrected or as it stays; NaN where they are unknown.
        names: of the targets.
        progress: receives the number of checked paths.
    """
    free, pairs, touched = path_check(model), list(pairwise(moves)), list[tuple[int, str]]()

    for done, (before, move) in enumerate(pairs):
        progress(done, len(pairs))
        start, end = joints[before.target], joints[move.target]
        if not np.isfinite([start, end]).all() or before.target == move.target:
            continue
        line = move.motion == "line"
        message = _on_line(model, nominal, start, end) if line else _of_joints(model, free, start, end)
        if message:
            touched.append((move.line, f"on the way from {names[before.target]} to {names[move.target]}, {message}"))
    return tuple(touched)


def _of_joints(model: RobotModel, free: FreePath, start: Array, end: Array) -> str:
    """Describe the collision on a straight line of all joints; "" if there is none."""
    if free(start, end):
        return ""
    poses = start + np.linspace(0, 1, _POSES_DESCRIBED)[:, None] * (end - start)
    return next((message for message in describe_collisions(model, poses) if message), "something is touched")


def _on_line(model: RobotModel, nominal: NominalInverse, start: Array, end: Array) -> str:
    """Describe the collision while the tool moves on a straight line; "" if there is none."""
    poses = _line_of_tool(nominal, start, end)
    even = np.abs(np.diff(poses, axis=0)).max() <= _JUMP_RAD and np.abs(poses[-1] - end).max() <= _JUMP_RAD
    if not even:
        return "a straight line of the tool passes a singularity or leaves the reach"
    touched = collides(model, poses)
    return next(iter(describe_collisions(model, poses[touched][:1])), "")


def _line_of_tool(nominal: NominalInverse, start: Array, end: Array) -> Array:
    """Joint positions ``(k, 6)`` rad of the nominal arm while its tool moves and turns evenly between two poses.

    Each is the IK solution nearest to the one before, in closed form where there is one; NaN where there is none.
    """
    T_start, T_end = nominal.tool(np.array([start, end]))[0]
    turn = se3.log(T_start[:3, :3].T @ T_end[:3, :3])
    along = T_end[:3, 3] - T_start[:3, 3]
    steps = max(np.linalg.norm(along) / _STEP_M, np.linalg.norm(turn) / _STEP_RAD, 1.0)
    shares = np.linspace(0, 1, min(int(np.ceil(steps)), _MAX_CHECKS) + 1)
    wanted = PoseTarget(T_start[:3, 3] + shares[:, None] * along, T_start[:3, :3] @ se3.exp(shares[:, None] * turn))
    joints = start + shares[:, None] * (end - start)
    if nominal.closed_form is None:
        return nominal.again(wanted, joints, np.full(len(joints), -1))[0]
    solutions = nominal.solutions(wanted, joints)
    last = start
    for i, some in enumerate(solutions.joints):
        turned = nearest_whole_turns(nominal.arm.chain, some[solutions.gap_m[i] < _REACHED_M], last)
        joints[i] = last = (
            turned[np.abs(turned - last).max(axis=1).argmin()] if len(turned) else np.full_like(start, np.nan)
        )
    return joints
