"""Path errors of a compliant arm along a trajectory, and joint positions that correct them (Benmisra 2007, 3.21-3.38).

The rigid arm's tool is at X_R, the deformed arm's at X_D = F_d(q, u), with u the torsors of its segments: the elastic
error is dX = X_D - X_R (eq. 3.21), in all and by segment. Sent to X_C = X_R - dX (eq. 3.36 b) the deformed arm gets to
X_R: joints move by -J+ dX (eq. 3.37, 3.38), again and again where the error is large. An arm with fewer than six
joints corrects the part of dX that its joints make at that pose: the directions of its position, then those of its
rotation at a fixed position. The rest remains, and is reported.

The model is quasi-static (Benmisra 2007, figure 3.7): at each instant joints and links bear gravity, a payload and the
inertia of the arm as it moves rigidly by q, q', q''. Vibration is left out.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import DEGREES, MM
from lab.extensions.robotics.trajectory.trajectory_options import TrajectoryOptions
from lab.kinematics.differential import SINGULAR_M, WEIGHTS
from lab.kinematics.dynamics.beam import COMPLIANCES
from lab.kinematics.dynamics.gravity import LinkLoads
from lab.kinematics.effects.arm_with_effects import Arm, ArmWithEffects
from lab.kinematics.effects.effect import PAYLOAD, absent, approach_of, last_move_of, rates_of
from lab.kinematics.joints import JointSpec
from lab.kinematics.serial.serial_arm import SerialArm
from lab.kinematics.serial.walk import RIGID, Torsors
from lab.library.hand_load import HandLoad, carrying
from lab.library.load_run import CalibrationRun
from lab.phrases.fit_phrases import listed
from lab.robots.robot import Robot

__all__ = [
    "Correction",
    "TrackedArm",
    "Tracking",
    "bent_links",
    "compensated",
    "elastic_errors",
    "greville",
    "tracked_arm",
    "tracking",
    "tracking_along",
    "tracking_warnings",
]

_Tool = Callable[[Array], tuple[Array, Array]]  # joint positions (n, joints): poses (n, 4, 4), Jacobians (n, 6, joints)
_PLACE, _TURN = slice(0, 3), slice(3, 6)
_STRUCTURE = 20  # random poses, in one of which the arm moves its tool every way if it ever does
_LIMIT_SLACK = 1e-9  # rad or m: rounding
_GROUPS = ("bending", "torsion", "extension")
_BENT = (".ei_y", ".ei_z", ".gj")
_FAR_RAD = np.deg2rad(1.0)  # a larger correction of a joint indicates a singularity
_UNCORRECTED = 1e-8  # m or rad: a larger error after the correction is reported
_MAX_ROUNDS = 30
_SETTLED = 1e-12  # m, a radian as ``ROTATION_M``: remaining error of the corrected components
_LEAST = 1e-9  # of the matrix's norm: a smaller new part of a column is none
_POINTS = 12  # of each straight part of a link


@dataclass(frozen=True)
class _ElasticErrors:
    """Deviation of the deformed arm's tool from the rigid one's, m and rad (a rotation vector), in the tracker's frame.

    Attributes:
        total: ``(n, 6)``.
        by_link: ``(n, links, 6)``, of each link alone, all others rigid; they add up to first order.
        links: numbers of those links, from 0.
    """

    total: Array
    by_link: Array
    links: tuple[int, ...]


@dataclass(frozen=True)
class Correction:
    """Joint positions that let the deformed arm's tool be where the rigid arm's would be, as far as its joints can.

    Attributes:
        joints: ``(n, joints)`` q_C, within the limits.
        left: ``(n, 6)`` remaining error, m and rad.
        missed: ``(n, 6)`` its part in directions that the joints make but at singularities and limits; zero where the
            correction is complete.
        directions: number of directions, of three each, in which the joints move the tool, and turn it in its place.
        reasons: why a correction is not complete, one each: ``singular``, ``limit of <joint>`` or ``not settled``;
            empty where it is complete.
        rounds: number of iterations.
    """

    joints: Array
    left: Array
    missed: Array
    directions: tuple[int, int]
    reasons: tuple[str, ...]
    rounds: int

    @property
    def complete(self) -> NDArray[np.bool_]:
        """Mask ``(n,)`` of complete corrections."""
        return np.array([not reason for reason in self.reasons], dtype=np.bool_)


def elastic_errors(arm: SerialArm, values: Array, joints: Array, torsors: Torsors, target: int = 0) -> _ElasticErrors:
    """Return the elastic errors of a target at joint positions ``(n, joints)``, for parameters ``(p,)``."""
    rigid = arm.tool(joints, values, target)[0]
    alone = [_error_between(rigid, arm.tool(joints, values, target, {link: each})[0]) for link, each in torsors.items()]
    total = _error_between(rigid, arm.tool(joints, values, target, torsors)[0])
    return _ElasticErrors(total, np.stack(alone, axis=1) if alone else np.zeros((len(joints), 0, 6)), tuple(torsors))


def compensated(rigid: _Tool, joints: Array, deformed: _Tool, chain: JointSpec) -> Correction:
    """Correct joint positions ``(n, joints)`` so that the deformed arm's tool is where the rigid arm's would be.

    Along each principal direction of the Jacobian joints move by half their distance from its singularity at most: by
    s / (2 s_1) with its singular value s, the largest being s_1. So none is crossed, and at one nothing moves along it.
    A joint that would pass its limit stays there, and the others correct what they can.

    Args:
        rigid: returns the rigid arm's tool ``(n, 4, 4)`` at joint positions, and its Jacobian ``(n, 6, joints)``.
        deformed: the same of the deformed arm.
        chain: the joints, with their limits.
    """
    wanted, jacobian = rigid(joints)
    made = _Made.of(jacobian, rigid(chain.random_joints(_STRUCTURE, rng_for(0, "structure")))[1])
    moved, stopped, rounds = joints.astype(np.float64), np.zeros(joints.shape, dtype=np.bool_), 0
    while True:
        Ts, jacobian = deformed(moved)
        left = _error_between(wanted, Ts)
        ahead, capped = made.step(jacobian, left, moved - joints, stopped)
        ahead += joints
        stopped |= chain.beyond_limits(ahead, _LIMIT_SLACK)
        ahead = np.where(stopped, np.clip(ahead, chain.lower, chain.upper), ahead)
        change = np.abs(WEIGHTS * (jacobian @ (ahead - moved)[:, :, None])[:, :, 0]).max(axis=1, initial=0.0)
        if rounds == _MAX_ROUNDS or not (change > _SETTLED).any():
            break
        moved, rounds = ahead, rounds + 1
    missed = made.part(left)
    reasons = ["" if short <= _UNCORRECTED else "not settled" for short in np.abs(WEIGHTS * missed).max(axis=1)]
    for i in np.flatnonzero(reasons).tolist():
        if stopped[i].any():
            reasons[i] = f"limit of {chain.joint_names[int(stopped[i].argmax())]}"
        elif capped[i]:
            reasons[i] = "singular"
    return Correction(moved, left, missed, made.directions, tuple(reasons), rounds)


@dataclass(frozen=True)
class _Made:
    """Directions in which joints correct errors at n poses.

    Attributes:
        moves: ``(n, 3, p)`` of the tool's position.
        turns: ``(n, 3, r)`` of its rotation, by joint moves that keep the position.
        singular: ``(n,)`` poses at which the joints move it in fewer directions than elsewhere.
    """

    moves: Array
    turns: Array
    singular: NDArray[np.bool_]

    @property
    def directions(self) -> tuple[int, int]:
        """The numbers p and r."""
        return self.moves.shape[2], self.turns.shape[2]

    @classmethod
    def of(cls, jacobian: Array, elsewhere: Array) -> "_Made":
        """Return those of Jacobians ``(n, 6, joints)``, as many as there are at these poses or at others."""
        every = np.nan_to_num(np.concatenate([jacobian, elsewhere]))
        sides, sizes, rows = np.linalg.svd(every[:, :3])
        moves = int((sizes > SINGULAR_M).sum(axis=1).max())
        turning = every[:, 3:] @ rows[:, moves:].swapaxes(1, 2)
        axes, turned, _ = np.linalg.svd(turning)
        turns = int((turned > SINGULAR_M).sum(axis=1).max(initial=0))
        least = np.minimum(sizes[:, :moves].min(axis=1, initial=1.0), turned[:, :turns].min(axis=1, initial=1.0))
        count = len(jacobian)
        return cls(sides[:count, :, :moves], axes[:count, :, :turns], least[:count] <= SINGULAR_M)

    def part(self, error: Array) -> Array:
        """Project errors ``(n, 6)`` on the directions; where the arm is singular all of an error counts."""
        parts = [
            (each @ (each.swapaxes(1, 2) @ error[:, rows, None]))[:, :, 0]
            if each.shape[2]
            else np.zeros((len(error), 3))
            for each, rows in ((self.moves, _PLACE), (self.turns, _TURN))
        ]
        return np.where(self.singular[:, None], error, np.concatenate(parts, axis=1))

    def step(
        self, jacobian: Array, left: Array, moved: Array, stopped: NDArray[np.bool_]
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return corrections ``(n, joints)`` of commanded joint positions, and a mask ``(n,)`` of bounded ones.

        Args:
            jacobian: ``(n, 6, joints)`` of the deformed arm.
            left: ``(n, 6)`` its error.
            moved: ``(n, joints)`` the correction so far.
            stopped: ``(n, joints)`` joints at their limits.
        """
        free = np.where(stopped[:, None], 0.0, jacobian)
        first, second = (each.swapaxes(1, 2) for each in (self.moves, self.turns))
        wanted = (free @ moved[:, :, None])[:, :, 0] - left
        P, R = first @ free[:, :3], second @ free[:, 3:]
        by_place, still, capped = _bounded(P, (first @ wanted[:, :3, None])[:, :, 0])
        rest = (second @ wanted[:, 3:, None] - R @ by_place[:, :, None])[:, :, 0]
        by_turn, _, also = _bounded(R @ still, rest)
        found = by_place + (still @ by_turn[:, :, None])[:, :, 0]
        return np.where(stopped, moved, found), capped | also


def _bounded(matrix: Array, wanted: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Solve ``(n, r, c)`` x = ``(n, r)`` by the pseudo-inverse, each principal part of x at most s / (2 s_1).

    Returns:
        x ``(n, c)``, the null space ``(n, c, c - r)``, and a mask ``(n,)`` of solutions with a bounded part.
    """
    sides, sizes, rows = np.linalg.svd(matrix)
    count = sizes.shape[1]
    along = (sides.swapaxes(1, 2) @ wanted[:, :, None])[:, :count, 0]
    parts = np.where(sizes > SINGULAR_M, along / np.maximum(sizes, SINGULAR_M), 0.0)
    most = sizes / np.maximum(2 * sizes.max(axis=1, initial=SINGULAR_M), SINGULAR_M)[:, None]
    capped = (np.abs(parts) > most) | (sizes <= SINGULAR_M)
    kept = np.clip(parts, -most, most)
    found: Array = (rows[:, :count].swapaxes(1, 2) @ kept[:, :, None])[:, :, 0]
    return found, rows[:, count:].swapaxes(1, 2), capped.any(axis=1)


def greville(matrix: Array) -> Array:
    """Return the pseudo-inverse ``(c, r)`` of a matrix ``(r, c)``, column by column (Greville 1960).

    With d = A+ a the coordinates of the next column a among those before, and c = a - A d what is new in it, the next
    row b is c' / c'c, or d' A+ / (1 + d'd) where nothing is new; the rows above become A+ - d b.
    """
    rows, columns = matrix.shape
    inverse = np.zeros((0, rows))
    least = _LEAST * max(float(np.linalg.norm(matrix)), 1e-300)
    for k in range(columns):
        column = matrix[:, k]
        among = inverse @ column
        new = column - matrix[:, :k] @ among
        if np.linalg.norm(new) > least:
            row = new / (new @ new)
        else:
            row = among @ inverse / (1 + among @ among) if k else np.zeros(rows)
        inverse = np.concatenate([inverse - np.outer(among, row), row[None]])
    return inverse


def _error_between(rigid: Array, deformed: Array) -> Array:
    """Return X_D - X_R of poses ``(n, 4, 4)``: ``(n, 6)`` m, and the rotation vector (rad) in the tracker's frame."""
    turned = se3.log(deformed[:, :3, :3] @ rigid[:, :3, :3].swapaxes(1, 2))
    return np.concatenate([deformed[:, :3, 3] - rigid[:, :3, 3], turned], axis=1)


@dataclass(frozen=True)
class Tracking:
    """Path errors of an arm along a trajectory at k times, and their correction.

    Attributes:
        wanted: ``(k, 4, 4)`` wanted poses of the tool, in the tracker's frame.
        total: ``(k, 6)`` errors (m; a rotation vector, rad) at the commanded joint positions.
        parts: ``(k, 6)`` each, the errors by geometry, joints and each link alone; they add up to first order. Parts
            that the arm does not have are left out.
        standing: ``(k, n)`` actual joint positions.
        torsors: displacements of the links' ends.
        corrected: the joint positions to command instead.
        movable: ``(6,)`` components of the tool's motion that some joint makes at some time.
    """

    wanted: Array
    total: Array
    parts: Mapping[str, Array]
    standing: Array
    torsors: Torsors
    corrected: Correction
    movable: NDArray[np.bool_]


def tracking(arm: Arm, values: Array, nominal: Array, joints: Array, rest: Array, target: int) -> Tracking:
    """Compute errors and correction along a trajectory.

    Args:
        arm: as identified, in motion (``Robot.arm_with``).
        values: its parameters ``(p,)``.
        nominal: ``(g,)`` of its geometry, by which the controller computes the wanted poses.
        joints: ``(k, joints)`` as commanded.
        rest: ``(k, c)`` values of the arm's ``conditions``.
        target: number of the tracked target of the tool.
    """
    rigid, inputs = arm.rigid, np.concatenate([joints, rest], axis=1)
    own = values[: len(rigid.names)]

    def drawn(there: Array) -> tuple[Array, Array]:
        return rigid.tool(there, nominal, target)

    def deformed(there: Array) -> tuple[Array, Array]:
        return arm.tool(np.concatenate([there, rest], axis=1), values, target)

    wanted, jacobian = drawn(joints)
    movable = np.any(np.abs(WEIGHTS[:, None] * jacobian) > SINGULAR_M, axis=(0, 2))
    standing, torsors = joints, RIGID
    if isinstance(arm, ArmWithEffects):
        standing, torsors = arm.standing(inputs, values), arm.torsors(inputs, values)
    exact, moved = (rigid.tool(each, own, target)[0] for each in (joints, standing))
    parts = {"geometry": _error_between(wanted, exact), "joints": _error_between(exact, moved)}
    if torsors and isinstance(rigid, SerialArm):
        each = elastic_errors(rigid, own, standing, torsors, target)
        parts |= {f"link {link + 1}": each.by_link[:, i] for i, link in enumerate(each.links)}
    total = _error_between(wanted, deformed(joints)[0])
    present = {name: part for name, part in parts.items() if part.any()}
    corrected = compensated(drawn, joints, deformed, rigid.chain)
    return Tracking(wanted, total, present, standing, torsors, corrected, movable)


def bent_links(links: LinkLoads, joints: Array, sag: Array, torsors: Torsors, factor: float) -> Mapping[int, Array]:
    """Return lines of the links ``(k, m, 3)`` m in frame 0, by link, from 0; links without a length have none.

    The deformations of all links and joints are magnified, and each carries the links beyond it. Between its ends a
    link is drawn as a beam that is loaded at its end: by the cubic through displacements and slopes there.

    Args:
        joints: ``(k, n)`` as commanded.
        sag: ``(k, n)`` deflections of the joints, rad or m.
        torsors: displacements of the links' ends.
        factor: of the magnification.
    """
    placed, chain = links.loads.frames(joints), links.loads.chain
    carried = np.tile(np.eye(4), (len(joints), 1, 1))  # how the magnified deformations inward of a link have moved it
    found = {}
    for j in range(chain.size):
        far = placed.end if j == chain.size - 1 else placed.anchors[:, j + 1]
        rotation, end = placed.rotations[:, j], links.ends[j]
        carried = carried @ _deflected_by(
            placed.axes[:, j], placed.anchors[:, j], factor * sag[:, j], chain.prismatic[j]
        )
        torsor = factor * torsors.get(j, np.zeros((len(joints), 6)))
        turn = se3.exp(torsor[:, 3:])
        shift = (turn @ torsor[:, :3, None])[..., 0]  # T_flex = Rot Trans
        if end.any():
            line = _along(links.beams[j].path if j in links.beams else np.stack([np.zeros(3), end]))
            Ts = carried @ se3.pose(rotation, far - rotation @ end)
            drawn = line + _deflection(line, end, shift, torsor[:, 3:])
            found[j] = drawn @ Ts[:, :3, :3].swapaxes(1, 2) + Ts[:, None, :3, 3]
        T_frame0_far = se3.pose(rotation, far)
        carried = carried @ T_frame0_far @ se3.pose(turn, shift) @ se3.inverse(T_frame0_far)
    return found


def _along(path: Array) -> Array:
    """Return points ``(m, 3)`` along a line with corners ``(k, 3)``."""
    shares = np.linspace(0.0, 1.0, _POINTS)[1:, None]
    return np.concatenate([path[:1], *(a + shares * (b - a) for a, b in pairwise(path))])


def _deflection(line: Array, end: Array, shift: Array, turn: Array) -> Array:
    """Compute displacements ``(k, m, 3)`` of a link's points ``(m, 3)`` from shift and turn ``(k, 3)`` of its end."""
    lengths = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    s = (lengths / lengths[-1])[:, None]
    shape: Array = (3 * s**2 - 2 * s**3) * shift[:, None] + (s**3 - s**2) * np.cross(turn, end)[:, None]
    return shape


def _deflected_by(axes: Array, anchors: Array, by: Array, slides: bool) -> Array:
    """Return the motions ``(k, 4, 4)`` of joints that deflect."""
    if slides:
        return se3.pose(np.tile(np.eye(3), (len(by), 1, 1)), axes * by[:, None])
    turn = se3.exp(axes * by[:, None])
    return se3.pose(turn, anchors - (turn @ anchors[..., None])[..., 0])


@dataclass(frozen=True)
class TrackedArm:
    """An arm whose errors along a motion are modelled.

    Attributes:
        arm: in motion, with its effects.
        values: its parameters ``(p,)``.
        nominal: ``(g,)`` of its geometry, as the controller has it.
        payload_kg: carried all the way.
        warnings: for the user.
    """

    arm: Arm
    values: Array
    nominal: Array
    payload_kg: float
    warnings: tuple[str, ...]


def tracked_arm(options: TrajectoryOptions, robot: Robot, run: CalibrationRun | None) -> TrackedArm | None:
    """Return the arm of a run, else the nominal one with elastic links; None where it is rigid.

    Raises:
        LabError: a payload is given, but nothing bends under it.
    """
    if run is not None:
        return _of_run(options, run)
    robot, load = carrying(robot, options.load, accept_edited=options.accept_edited)
    sections = robot.link_compliances
    if sections is None:
        _refuse_payload(options, robot.name)
        return None
    compliances = {
        f"link{link + 1}.{symbol}": float(sections[link, i])
        for link in range(len(sections))
        for i, symbol in enumerate(COMPLIANCES)
    }
    arm = robot.arm_with(("p1",), _GROUPS, moving=True)
    values = arm.nominal({"p1": options.tool_m})
    values[len(arm.rigid.names) :] = [compliances[name] for name in arm.names[len(arm.rigid.names) :]]
    return TrackedArm(arm, values, values[: len(arm.rigid.names)], _payload_of(options, load), ())


def _refuse_payload(options: TrajectoryOptions, robot: str) -> None:
    """Refuse a payload that bends nothing."""
    if options.payload_kg is not None or options.load is not None:
        flag = "--load" if options.payload_kg is None else "--payload-kg"
        raise LabError(f"{flag}: nothing bends robot {robot} here; give --run, or a robot with [[link]] sections")


def _payload_of(options: TrajectoryOptions, load: HandLoad | None) -> float:
    """Return the payload (kg) along the path: the given one, else that of a load."""
    if options.payload_kg is not None:
        return options.payload_kg
    return 0.0 if load is None else load.mass_kg


def _of_run(options: TrajectoryOptions, run: CalibrationRun) -> TrackedArm:
    arm = run.robot.arm_with(run.estimate.arm.targets, run.estimate.groups, moving=True)
    payload, messages = _payload_of(options, run.load), list(run.warnings)
    if payload and PAYLOAD not in arm.conditions:
        messages.append(f"{payload:.4g} kg have no effect: the model of {run.folder} has no compliance")
    hidden = [name for name in arm.names if name.endswith(_BENT) and name not in run.estimate.free_names]
    if hidden:
        messages.append(
            f"{', '.join(hidden)} did not show at rest and is zero here, though inertia may load it; links that are "
            "round tubes of metal are identified whole by --model tubes"
        )
    unmoved = [name for name in run.estimate.groups if ".gravity" in name]
    if unmoved:
        messages.append(f"{', '.join(listed(unmoved))} deflects under unknown masses, whose inertia is left out")
    return TrackedArm(arm, run.estimate.values, run.estimate.nominal[: len(arm.rigid.names)], payload, tuple(messages))


def tracking_along(tracked: TrackedArm, joints: Array, speeds: Array, accelerations: Array, times: Array) -> Tracking:
    """Compute errors and correction at k times of a motion, from its joints ``(k, n)`` and their rates."""
    names = tracked.arm.rigid.chain.joint_names
    columns = dict(zip(rates_of(names), np.concatenate([speeds, accelerations], axis=1).T, strict=True))
    for column_of in (approach_of, last_move_of):
        columns |= {column_of(name): np.sign(speed) for name, speed in zip(names, speeds.T, strict=True)}
    columns |= {PAYLOAD: np.full(len(times), tracked.payload_kg)}
    rest = [columns.get(name, absent(name, len(times))) for name in tracked.arm.conditions]
    stacked = np.stack(rest, axis=1) if rest else np.empty((len(times), 0))
    return tracking(tracked.arm, tracked.values, tracked.nominal, joints, stacked, 0)


def tracking_warnings(tracked: TrackedArm, found: Tracking, joints: Array, times: Array) -> Sequence[str]:
    """Return warnings about corrections that are incomplete or large, at ``times`` ``(k,)`` s."""
    chain, corrected = tracked.arm.rigid.chain, found.corrected
    messages, count = list(tracked.warnings), len(joints)
    for reason in dict.fromkeys(filter(None, corrected.reasons)):
        rows = np.flatnonzero([each == reason for each in corrected.reasons])
        sizes = [float(np.linalg.norm(corrected.left[rows, part], axis=1).max()) for part in (_PLACE, _TURN)]
        remain = [unit.text(size, 3) for unit, size in zip((MM, DEGREES), sizes, strict=True) if size > _UNCORRECTED]
        messages.append(
            f"at {rows.size} of {count} times (first: {times[rows[0]]:.3f} s) the correction is incomplete: {reason}; "
            f"up to {' and '.join(remain)} remain"
        )
    far = (np.abs(corrected.joints - joints)[:, ~np.array(chain.prismatic)] > _FAR_RAD).any(axis=1)
    if (far & corrected.complete).any():
        messages.append(
            f"at {int((far & corrected.complete).sum())} of {count} times a joint is corrected by more than 1°"
        )
    return messages
