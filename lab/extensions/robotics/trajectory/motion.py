"""Plan a motion through the points of a file: joint positions of each point, and the moves between them.

A motion is a sequence of moves of several kinds: phases of the joints, and paths of the tool.

Elastic errors of an arm by its segments, and the joint positions that make up for them (Benmisra 2007, 3.21-3.38).

The rigid arm's tool is at X_R, the deformed arm's at X_D = F_d(q, u), with u the torsors of its segments: the elastic
error is dX = X_D - X_R (eq. 3.21), in all and by segment. Sent to X_C = X_R - dX (eq. 3.36 b) the deformed arm gets to
X_R: joints move by -J+ dX (eq. 3.37, 3.38), again and again where the error is large. An arm with fewer than six
joints leaves out the components of dX that no joint can make.

Tracking errors of an identified arm along a trajectory, and the joint positions that make up for them.

Quasi-static (Benmisra 2007, figure 3.7): at each instant joints and links bear gravity, a payload and the inertia of
the arm as it moves rigidly by q, q', q''. Vibration is left out.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError, error_context
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.robotics.kinematics.models import Solver
from lab.extensions.robotics.trajectory.cartesian import CartesianPath, arc, line, path_move
from lab.extensions.robotics.trajectory.options import TrajectoryOptions
from lab.extensions.robotics.trajectory.path_csv import PathRows
from lab.kinematics.differential import SINGULAR_M, WEIGHTS, rates
from lab.kinematics.dynamics.gravity import LinkLoads
from lab.kinematics.effects.arm import Arm, ArmWithEffects
from lab.kinematics.inverse.newton import PoseTarget
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.walk import RIGID, Torsors
from lab.kinematics.trajectory.trajectory import blended, common_phases, independent, own_phases, through

__all__ = [
    "Correction",
    "ElasticErrors",
    "Leg",
    "Motion",
    "Move",
    "ToolAt",
    "Tracking",
    "bent_links",
    "compensated",
    "elastic_errors",
    "greville",
    "planned",
    "tracking",
]


class Move(Protocol):
    """A part of a motion: ``Trajectory`` and ``PathMove`` are such."""

    @property
    def seconds(self) -> float:
        """Duration, s."""

    @property
    def end(self) -> Array:
        """Joint positions ``(n,)`` at the end."""

    @property
    def peaks(self) -> tuple[Array, Array]:
        """The largest magnitudes ``(n,)`` of the joints' speeds and accelerations."""

    @property
    def peak_jerk(self) -> Array:
        """The largest magnitudes ``(n,)`` of the joints' jerks; infinite where accelerations change at once."""

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Joint positions, speeds and accelerations ``(k, n)`` at times ``(k,)`` since its start."""

    def jerks_at(self, times: Array) -> Array:
        """Jerks ``(k, n)`` at times ``(k,)`` since its start."""


@dataclass(frozen=True)
class Motion:
    """Moves one after the other, of which each starts where the one before it ends."""

    moves: Sequence[Move]

    @cached_property
    def starts(self) -> Array:
        """When each move starts, and when the last one ends, ``(m + 1,)`` s."""
        return np.append(0.0, np.cumsum([move.seconds for move in self.moves]))

    @property
    def seconds(self) -> float:
        """Total duration, s."""
        return float(self.starts[-1])

    @cached_property
    def peaks(self) -> tuple[Array, Array]:
        """The largest magnitudes ``(n,)`` of the joints' speeds and accelerations."""
        speeds, accelerations = zip(*(move.peaks for move in self.moves), strict=True)
        return np.max(speeds, axis=0), np.max(accelerations, axis=0)

    @cached_property
    def peak_jerk(self) -> Array:
        """The largest magnitudes ``(n,)`` of the joints' jerks; infinite where accelerations change at once."""
        return np.asarray(np.max([move.peak_jerk for move in self.moves], axis=0))

    def times(self, step_s: float) -> Array:
        """Times ``(k,)`` from 0 to the end, a step apart, with the end itself."""
        whole = np.arange(0.0, self.seconds, step_s)
        return np.append(whole[self.seconds - whole > 1e-9], self.seconds)

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Joint positions, speeds and accelerations ``(k, n)`` at times ``(k,)`` since the start."""
        which, size = self._which(times), len(self.moves[0].end)
        out = np.empty((len(times), size)), np.empty((len(times), size)), np.empty((len(times), size))
        for i, move in enumerate(self.moves):
            rows = np.flatnonzero(which == i)
            if rows.size:
                for whole, part in zip(out, move.at(times[rows] - self.starts[i]), strict=True):
                    whole[rows] = part
        return out

    def jerks_at(self, times: Array) -> Array:
        """Jerks ``(k, n)`` at times ``(k,)`` since the start."""
        which, out = self._which(times), np.empty((len(times), len(self.moves[0].end)))
        for i, move in enumerate(self.moves):
            out[which == i] = move.jerks_at(times[which == i] - self.starts[i])
        return out

    def _which(self, times: Array) -> NDArray[np.int_]:
        """The number ``(k,)`` of the move that each time is in."""
        return np.clip(np.searchsorted(self.starts, times, side="right") - 1, 0, len(self.moves) - 1)


_LAWS = {"common": common_phases, "own": own_phases, "independent": independent}
_HAD_M = 1e-6  # m/s or rad/s: of a velocity at a point, by how much the joints may miss it


@dataclass(frozen=True)
class Leg:
    """A part of a motion.

    Attributes:
        kind: how the tool or the joints move.
        points: ids of the points from its start to its end.
        waypoints: ``(k, n)`` joint positions at these points; of points that are passed at a distance, those they pass.
        move: how it moves.
        length_m, turn_rad: of the tool's path; NaN of moves of the joints.
        speed_m_s: the tool's largest one on it; NaN of moves of the joints.
    """

    kind: Literal["joint", "line", "circle"]
    points: tuple[str, ...]
    waypoints: Array
    move: Move
    length_m: float = float("nan")
    turn_rad: float = float("nan")
    speed_m_s: float = float("nan")


def planned(options: TrajectoryOptions, arm: RigidArm, values: Array, chain: JointSpec, rows: PathRows) -> list[Leg]:
    """The legs of the motion through all points.

    Args:
        chain: the joints, with their speeds and accelerations.

    Raises:
        LabError: naming the file and the point that cannot be reached, or passed like that.
    """
    planner = _Planner(options, arm, values, chain, rows)
    with error_context(options.points):
        start = planner.joints_of(0, np.full(chain.size, np.nan))
        planner.at(0, start)
        i = 1
        while i < len(rows):
            i = planner.joint_leg(i) if rows.moves[i] == "joint" else planner.path_leg(i)
    return planner.legs


@dataclass
class _Planner:
    """Goes through the points one after the other; ``here`` are the joint positions ``(n,)`` that it has come to."""

    options: TrajectoryOptions
    arm: RigidArm
    values: Array
    chain: JointSpec
    rows: PathRows
    legs: list[Leg] = field(default_factory=list)

    def at(self, i: int, joints: Array) -> None:
        """Stand at a point."""
        self.here, self.point = joints, self.rows.ids[i]

    def joints_of(self, i: int, near: Array) -> Array:
        """Joint positions ``(n,)`` of a point, in the configuration nearest to some.

        Raises:
            LabError: there are none, or they are beyond the limits.
        """
        joints, name = self.rows.joints[i], self.rows.ids[i]
        if not np.isnan(self.rows.positions[i]).any():
            wanted = PoseTarget(self.rows.positions[i : i + 1], self.rows.rotations[i : i + 1])
            reference = joints if np.isfinite(joints).all() else near
            found = Solver(self.arm, self.values)(wanted, reference[None])[0]
            if not found.solutions:
                far = "" if np.isnan(found.gap_m) else f" by {MM.text(found.gap_m, 4)}"
                raise LabError(f"point {name} is out of reach{far}; move it")
            joints = found.solutions[0].joints
        excess = self.chain.excess(joints)
        if excess.max() > 1e-9:
            j = int(np.argmax(excess))
            raise LabError(f"point {name}: {self.chain.limit_note(j, joints[j])}; move it within them")
        return np.asarray(joints)

    def joint_leg(self, i: int) -> int:
        """Moves of the joints from point ``i - 1`` on, as far as they go on; the next point's row."""
        last = i
        while last < len(self.rows) and self.rows.moves[last] == "joint":
            last += 1
        points, ids = [self.here], [self.point]
        for row in range(i, last):
            points.append(self.joints_of(row, points[-1]))
            ids.append(self.rows.ids[row])
        speeds = np.array([self._speeds(row, joints) for row, joints in zip(range(i - 1, last), points, strict=True)])
        self._add(points, ids, speeds)
        self.at(last - 1, points[-1])
        return last

    def _add(self, points: Sequence[Array], ids: Sequence[str], speeds: Array) -> None:
        allowed, law = self.options.blend(self.chain), _LAWS[self.options.law]
        waypoints = np.array(points)
        if allowed is not None and len(points) > 2:
            if speeds.any():
                raise LabError("points with a velocity are passed exactly; leave out --blend-deg and --blend-mm")
            self.legs.append(Leg("joint", tuple(ids), waypoints, blended(self.chain, waypoints, allowed)))
            return
        for k in range(len(points) - 1):
            move = through(self.chain, waypoints[k : k + 2], speeds[k : k + 2], law)
            self.legs.append(Leg("joint", tuple(ids[k : k + 2]), waypoints[k : k + 2], move))

    def _speeds(self, row: int, joints: Array) -> Array:
        """Speeds ``(n,)`` of the joints at a point, by the file's or by the tool's velocity there."""
        speeds, velocity = self.rows.speeds[row], self.rows.velocities[row]
        if not velocity.any():
            return np.asarray(speeds)
        name = self.rows.ids[row]
        if speeds.any():
            raise LabError(f"point {name} has a velocity of the tool and speeds of the joints; give one")
        jacobian = self.arm.tool(joints[None], self.values)[1]
        if self.chain.size < 6:  # its rotation follows
            jacobian = np.concatenate([jacobian[:, :3], np.zeros_like(jacobian[:, 3:])], axis=1)
        found = rates(jacobian, np.concatenate([velocity, np.zeros(3)])[None])
        if np.abs(found.missing).max() > _HAD_M:
            raise LabError(f"point {name}: the arm cannot have that velocity there, where it is singular; mend it")
        return np.asarray(found.joints[0])

    def path_leg(self, i: int) -> int:
        """A line or a circle from the last point on; the next point's row."""
        circle = self.rows.moves[i] == "via"
        end = i + 1 if circle else i
        T_start = self.arm.tool(self.here[None], self.values)[0][0]
        path = self._arc(T_start, i) if circle else line(T_start, self._pose(end, T_start))
        ids = (self.point, *self.rows.ids[i : end + 1])
        if any(self.rows.velocities[row].any() or self.rows.speeds[row].any() for row in range(i - 1, end + 1)):
            raise LabError(f"point {ids[-1]}: lines and circles start and end at rest; leave out the velocities there")
        with error_context(f"the {'circle' if circle else 'line'} to point {ids[-1]}"):
            move = path_move(self.arm, self.values, self.chain, path, self.here, self.options.feed)
        places = np.array([0.0, path.place_of(self._pose(i, T_start)[:3, 3]), 1.0] if circle else [0.0, 1.0])
        speed = path.length_m * float(move.pace.peak_speed[0])
        kind: Literal["line", "circle"] = "circle" if circle else "line"
        self.legs.append(Leg(kind, ids, move.joints_at(places), move, path.length_m, path.turn_rad, speed))
        self.at(end, move.end)
        return end + 1

    def _arc(self, T_start: Array, i: int) -> CartesianPath:
        via = self._pose(i, T_start)[:3, 3]
        with error_context(f"the circle to point {self.rows.ids[i + 1]}"):
            return arc(T_start, via, self._pose(i + 1, T_start))

    def _pose(self, i: int, T_before: Array) -> Array:
        """The pose ``(4, 4)`` of a point; without an orientation of its own it keeps the one before."""
        if np.isnan(self.rows.positions[i]).any():
            return np.asarray(self.arm.tool(self.rows.joints[i : i + 1], self.values)[0][0])
        rotation = self.rows.rotations[i]
        return se3.pose(rotation if np.isfinite(rotation).all() else T_before[:3, :3], self.rows.positions[i])


ToolAt = Callable[[Array], tuple[Array, Array]]
"""X_d = F_d(q, u): joint positions ``(n, joints)`` to the deformed arm's tool ``(n, 4, 4)`` there, and its Jacobian
``(n, 6, joints)`` (``SerialArm.tool``): a model of deformations, its loads in it."""

_ROUNDS = 30
_SETTLED = 1e-12  # m, a radian as ``ROTATION_M``: what is left of the components that can be made
_LEAST = 1e-9  # of a column beside those before it, that counts as none


@dataclass(frozen=True)
class ElasticErrors:
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
    """Joint positions that let the deformed arm's tool be where the rigid arm's would be.

    Attributes:
        joints: ``(n, joints)`` q_C.
        made: ``(6,)`` which components (x y z rx ry rz) are made up for; the others no joint can make as well.
        left: ``(n, 6)`` what is left of the elastic error, m and rad.
        rounds: how many iterations it took.
    """

    joints: Array
    made: NDArray[np.bool_]
    left: Array
    rounds: int


def elastic_errors(arm: SerialArm, values: Array, joints: Array, torsors: Torsors, target: int = 0) -> ElasticErrors:
    """The elastic errors of a target at joint positions ``(n, joints)``, for parameters ``(p,)``."""
    rigid = arm.tool(joints, values, target)[0]
    alone = [_error_between(rigid, arm.tool(joints, values, target, {link: each})[0]) for link, each in torsors.items()]
    total = _error_between(rigid, arm.tool(joints, values, target, torsors)[0])
    return ElasticErrors(total, np.stack(alone, axis=1) if alone else np.zeros((len(joints), 0, 6)), tuple(torsors))


def compensated(rigid: tuple[Array, Array], joints: Array, deformed: ToolAt) -> Correction:
    """Bring the deformed arm's tool to where joint positions ``(n, joints)`` bring the rigid arm's.

    The components that are made up for are the first ones, in the order x y z rx ry rz, that are independent where the
    joints are: of a planar arm with two joints, x and y.

    Args:
        rigid: the rigid arm's tool ``(n, 4, 4)`` at the joint positions, and its Jacobian ``(n, 6, joints)``.
        deformed: the deformed arm's.
    """
    wanted, made = rigid[0], _can_be_made(rigid[1])
    moved, rounds = joints.astype(np.float64), 0
    while True:
        Ts, jacobian = deformed(moved)
        left = _error_between(wanted, Ts)
        if rounds == _ROUNDS or np.abs(left[:, made] * WEIGHTS[made]).max(initial=0.0) <= _SETTLED:
            return Correction(moved, made, left, rounds)
        weighted = WEIGHTS[made, None] * jacobian[:, made]
        inverse = np.stack([greville(each) for each in weighted])
        moved = moved - (inverse @ (WEIGHTS[made] * left[:, made])[:, :, None])[:, :, 0]
        rounds += 1


def greville(matrix: Array) -> Array:
    """The pseudo-inverse ``(c, r)`` of a matrix ``(r, c)``, column by column (Greville 1960).

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
    """DX = X_D - X_R of poses ``(n, 4, 4)``: ``(n, 6)`` m, and the rotation vector (rad) in the tracker's frame."""
    turned = se3.log(deformed[:, :3, :3] @ rigid[:, :3, :3].swapaxes(1, 2))
    return np.concatenate([deformed[:, :3, 3] - rigid[:, :3, 3], turned], axis=1)


def _can_be_made(jacobian: Array) -> NDArray[np.bool_]:
    """``(6,)`` the first components that are independent of each other at most poses, of ``(n, 6, joints)``."""
    made = np.zeros(6, dtype=np.bool_)
    for component in range(6):
        made[component] = True
        ranks = np.linalg.matrix_rank(WEIGHTS[made, None] * jacobian[:, made], tol=SINGULAR_M)
        made[component] = bool(np.median(ranks) == made.sum())
    return made


@dataclass(frozen=True)
class Tracking:
    """An arm along a trajectory, at k times.

    Attributes:
        wanted: ``(k, 4, 4)`` where the tool is to be, in the tracker's frame.
        total: ``(k, 6)`` what it is off by (m; a rotation vector, rad) with the joints as they are commanded.
        parts: ``(k, 6)`` each, what of that is the geometry's, the joints' and each link's alone; they add up to first
            order. Parts that the arm does not have are left out.
        standing: ``(k, n)`` where the joints then are.
        torsors: how far the links' ends are displaced.
        corrected: the joint positions to command instead.
    """

    wanted: Array
    total: Array
    parts: Mapping[str, Array]
    standing: Array
    torsors: Torsors
    corrected: Correction


def tracking(arm: Arm, values: Array, wanted: tuple[Array, Array], joints: Array, rest: Array, target: int) -> Tracking:
    """Errors and correction along a trajectory.

    Args:
        arm: as identified, in motion (``Robot.arm_with``).
        values: its parameters ``(p,)``.
        wanted: where the controller's model brings the tool ``(k, 4, 4)``, and how its joints move it
            ``(k, 6, joints)``.
        joints: ``(k, joints)`` as commanded.
        rest: ``(k, c)`` what the arm's effects ask for, its ``conditions``.
        target: of the tool, which one is tracked.
    """

    def deformed(there: Array) -> tuple[Array, Array]:
        return arm.tool(np.concatenate([there, rest], axis=1), values, target)

    rigid, inputs = arm.rigid, np.concatenate([joints, rest], axis=1)
    own = values[: len(rigid.names)]
    standing, torsors = joints, RIGID
    if isinstance(arm, ArmWithEffects):
        standing, torsors = arm.standing(inputs, values), arm.torsors(inputs, values)
    exact, moved = (rigid.tool(each, own, target)[0] for each in (joints, standing))
    parts = {"geometry": _error_between(wanted[0], exact), "joints": _error_between(exact, moved)}
    if torsors and isinstance(rigid, SerialArm):
        each = elastic_errors(rigid, own, standing, torsors, target)
        parts |= {f"link {link + 1}": each.by_link[:, i] for i, link in enumerate(each.links)}
    total = _error_between(wanted[0], deformed(joints)[0])
    kept = {name: part for name, part in parts.items() if part.any()}
    return Tracking(wanted[0], total, kept, standing, torsors, compensated(wanted, joints, deformed))


_POINTS = 12  # of each straight part of a link


def bent_links(links: LinkLoads, joints: Array, sag: Array, torsors: Torsors, factor: float) -> Mapping[int, Array]:
    """Lines of the links ``(k, m, 3)`` m in frame 0, by link, from 0; links without a length have none.

    The deformations of all links and joints are magnified, and each carries the links beyond it. Between its ends a
    link is drawn as a beam that is loaded at its end: by the cubic through displacements and slopes there.

    Args:
        joints: ``(k, n)`` as commanded.
        sag: ``(k, n)`` how far the joints give way, rad or m.
        torsors: how far the links' ends are displaced.
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
    """Points ``(m, 3)`` along a line with corners ``(k, 3)``."""
    shares = np.linspace(0.0, 1.0, _POINTS)[1:, None]
    return np.concatenate([path[:1], *(a + shares * (b - a) for a, b in pairwise(path))])


def _deflection(line: Array, end: Array, shift: Array, turn: Array) -> Array:
    """Compute displacements ``(k, m, 3)`` of a link's points ``(m, 3)`` from shift and turn ``(k, 3)`` of its end."""
    lengths = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    s = (lengths / lengths[-1])[:, None]
    shape: Array = (3 * s**2 - 2 * s**3) * shift[:, None] + (s**3 - s**2) * np.cross(turn, end)[:, None]
    return shape


def _deflected_by(axes: Array, anchors: Array, by: Array, slides: bool) -> Array:
    """Motions ``(k, 4, 4)`` of joints that give way."""
    if slides:
        return se3.pose(np.tile(np.eye(3), (len(by), 1, 1)), axes * by[:, None])
    turn = se3.exp(axes * by[:, None])
    return se3.pose(turn, anchors - (turn @ anchors[..., None])[..., 0])
