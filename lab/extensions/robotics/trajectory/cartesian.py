"""Plan straight lines and circles of the tool, with its orientation, as fast as the joints can.

A path is p(s), R(s) for s from 0 to 1. The orientation turns about one fixed axis, evenly with s (Khalil & Dombre 2002,
section 13.4). The joints follow it by Newton's method from pose to pose; s then runs over time by the quickest law of
its kind that keeps every joint within its limits. With v and a the derivatives of s by time, and q1 and q2 those of a
joint by s, its speed is q1 v and its acceleration q2 v^2 + q1 a.

That law is the trapezoid of the speed which takes the shortest time within all limits. Its shape has one number: the
part of the way on which the speed changes. Times scale: at T times the duration speeds are T and accelerations T^2
times smaller, so that the shortest T of each shape is exact.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.core.units import MM
from lab.kinematics.inverse.newton_inverse import FREEDOMS, PoseTarget, reach
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.kinematics.trajectory.profiles import Trajectory

__all__ = ["CartesianPath", "Feed", "PathMove", "arc", "line", "path_move"]

_SHAPES = 20  # of the grid of shapes that are tried first
_AROUND, _ROUNDS = (-0.6, -0.3, 0.0, 0.3, 0.6), 3  # steps and rounds of the search around the best shape
_PACE_COARSE, _PACE_FINE = 33, 1025  # places in each phase at which limits are checked, to choose and at the end
_PLACES = 2049  # on the path, at which slopes are tabulated
_ROUNDING = 1 + 1e-12  # of a time, so that rounding exceeds no limit


def _quickest_pace(chain: JointSpec, joints: BSpline, rates: Sequence[tuple[float, float]]) -> Trajectory:
    """Return the quickest place s from 0 to 1 over time, from rest to rest, as a trajectory of one joint.

    Args:
        chain: the joints, with their speeds and accelerations.
        joints: their positions over s, of the fifth degree.
        rates: largest ds/dt and d2s/dt2 beside.
    """
    slopes = [joints.derivative(order) for order in (1, 2)]
    tabulated = [slope(np.linspace(0, 1, _PLACES)) for slope in slopes]

    def nearest(s: Array) -> list[Array]:
        return [each[np.rint(s * (_PLACES - 1)).astype(int)] for each in tabulated]

    def seconds(part: float) -> float:
        return _seconds(_unit(part), chain, nearest, rates, _PACE_COARSE)

    best = min(np.linspace(0, 1, _SHAPES + 1)[1:].tolist(), key=seconds)
    wide = 1 / _SHAPES
    for _ in range(_ROUNDS):
        best = min([min(max(best + wide * i, 1e-3), 1.0) for i in _AROUND], key=seconds)
        wide = 0.3 * wide
    unit = _unit(best)
    lasting = _ROUNDING * _seconds(unit, chain, lambda s: [slope(s) for slope in slopes], rates, _PACE_FINE)
    return Trajectory(unit.durations * lasting, unit.accelerations / lasting**2, unit.start, unit.start_speed)


def _unit(part: float) -> Trajectory:
    """Return the place over a second: the speed changes on a part of the way."""
    ramp = part / (1 + part)
    pull, still = 1 / (1 - ramp) / ramp, np.zeros(1)
    durations, accelerations = np.array([ramp, 1 - 2 * ramp, ramp]), np.array([pull, 0, -pull])
    return Trajectory(durations, accelerations[:, None], still, still)


def _seconds(
    unit: Trajectory,
    chain: JointSpec,
    slopes: Callable[[Array], list[Array]],
    rates: Sequence[tuple[float, float]],
    count: int,
) -> float:
    """Compute the minimum duration of a shape from the joints' limits at ``count`` points of each phase.

    Args:
        slopes: the first two derivatives ``(k, n)`` of the joints at s ``(k,)``.
    """
    t = np.linspace(0, 1, count)[:, None] * unit.durations  # (count, phases)
    _, places, speeds = unit.knots
    a = unit.accelerations[:, 0]
    s = places[:-1, 0] + (speeds[:-1, 0] + 0.5 * a * t) * t
    speed, pull = (np.broadcast_to(each, t.shape).reshape(-1, 1) for each in (speeds[:-1, 0] + a * t, a))
    first, second = slopes(np.clip(s.ravel(), 0.0, 1.0))
    needed = [
        float((np.abs(first * speed) / chain.speed).max()),
        float(np.sqrt((np.abs(second * speed**2 + first * pull) / chain.acceleration).max())),
    ]
    for fastest, quickest in rates:
        needed += [float(speed.max()) / fastest, float(np.sqrt(np.abs(pull).max() / quickest))]
    return max(needed)


_COARSE = 33  # places on a path at which the joints are solved, one after the other
_NODES = (129, 513, 2049)  # places at which they are then solved all at once: the fewest that suffice
_BETWEEN_RAD = 5e-6  # or m: largest distance of nodes from the spline through every second one
_FINE = 1025  # times at which peaks are sampled
_JUMP = 0.3  # rad or m: between neighbouring nodes a joint that moves more passes a singularity
_MISSED_M = 1e-8  # m or rad: a pose with a larger error is not reached
_NEAR_M = 1e-6  # m or rad: a pose with a smaller error lies next to one that is reached
_LEAST_M = 1e-9  # points nearer than this are one


@dataclass(frozen=True)
class CartesianPath:
    """A path p(s) = origin + s along + cos(s angle) cosine + sin(s angle) sine, R(s) = exp(s turn) R(0).

    Attributes:
        origin, along, cosine, sine: ``(3,)`` m; of a line the last two are zero, of a circle the second.
        angle: rad, of the arc.
        turn: ``(3,)`` rad, the rotation vector from the first orientation to the last, in the base.
        rotation: ``(3, 3)`` the first orientation.
    """

    origin: Array
    along: Array
    cosine: Array
    sine: Array
    angle: float
    turn: Array
    rotation: Array

    @property
    def length_m(self) -> float:
        """Length of the path, m."""
        return float(np.linalg.norm(self.along) + self.angle * np.linalg.norm(self.cosine))

    @property
    def turn_rad(self) -> float:
        """Angle by which the orientation turns, rad."""
        return float(np.linalg.norm(self.turn))

    def place_of(self, point: Array) -> float:
        """Return the s at which an arc passes a point ``(3,)`` m on it."""
        across, along = (point - self.origin) @ self.sine, (point - self.origin) @ self.cosine
        return float(np.arctan2(across, along) % (2 * np.pi) / self.angle)

    def poses(self, s: Array) -> Array:
        """Return the poses ``(k, 4, 4)`` (m) at ``s`` ``(k,)``."""
        angle = (s * self.angle)[:, None]
        places = self.origin + s[:, None] * self.along + np.cos(angle) * self.cosine + np.sin(angle) * self.sine
        return se3.pose(se3.exp(s[:, None] * self.turn) @ self.rotation, places)


def line(T_start: Array, T_end: Array) -> CartesianPath:
    """Return the straight line from one pose ``(4, 4)`` (m) to another."""
    zero = np.zeros(3)
    along = T_end[:3, 3] - T_start[:3, 3]
    turn = se3.log(T_end[:3, :3] @ T_start[:3, :3].T)
    return CartesianPath(T_start[:3, 3], along, zero, zero, 0.0, turn, T_start[:3, :3])


def arc(T_start: Array, via: Array, T_end: Array) -> CartesianPath:
    """Return the arc of a circle from one pose ``(4, 4)`` (m) through a point ``(3,)`` to another pose.

    Raises:
        LabError: the three points lie on a line, or two are the same.
    """
    first, last = T_start[:3, 3], T_end[:3, 3]
    a, b = via - first, last - first
    normal = np.cross(a, b)
    size = float(normal @ normal)
    if size <= (_LEAST_M * max(float(np.linalg.norm(a)), float(np.linalg.norm(b)), _LEAST_M)) ** 2:
        raise LabError("the start, the via point and the end of a circle lie on a line; move one, or take a line")
    centre = first + np.cross((a @ a) * b - (b @ b) * a, normal) / (2 * size)
    axis = normal / np.sqrt(size)
    u = first - centre
    v = np.cross(axis, u)
    angle = float(np.arctan2((last - centre) @ v, (last - centre) @ u) % (2 * np.pi))
    turn = se3.log(T_end[:3, :3] @ T_start[:3, :3].T)
    return CartesianPath(centre, np.zeros(3), u, v, angle, turn, T_start[:3, :3])


@dataclass(frozen=True)
class Feed:
    """Limits of the tool's motion along a path, beside the limits of the joints.

    Attributes:
        speed_m_s, acceleration_m_s2: of the tool's point.
        turn_rad_s, turn_rad_s2: of its orientation.
    """

    speed_m_s: float = np.inf
    acceleration_m_s2: float = np.inf
    turn_rad_s: float = np.inf
    turn_rad_s2: float = np.inf


@dataclass(frozen=True)
class PathMove:
    """A move of the joints along a path of the tool, from rest to rest.

    Attributes:
        arm, values: what moves; parameters ``(p,)`` with one target.
        path: of that target.
        turned: whether its orientation is followed, or free.
        nodes: ``(m,)`` values of s at which the joints were solved.
        joints: ``(m, n)`` there, rad or m.
        pace: s over time, as a trajectory of one joint.
    """

    arm: RigidArm
    values: Array
    path: CartesianPath
    turned: bool
    nodes: Array
    joints: Array
    pace: Trajectory

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return self.pace.seconds

    @property
    def end(self) -> Array:
        """Joint positions ``(n,)`` at the end."""
        return np.asarray(self.joints[-1])

    @cached_property
    def spline(self) -> BSpline:
        """Joint positions over s."""
        return make_interp_spline(self.nodes, self.joints, k=5)

    @cached_property
    def peaks(self) -> tuple[Array, Array]:
        """Largest magnitudes ``(n,)`` of the joints' speeds and accelerations, sampled at many times."""
        _, speeds, accelerations = self._followed(np.linspace(0.0, self.seconds, _FINE))
        return np.abs(speeds).max(axis=0), np.abs(accelerations).max(axis=0)

    def along(self, times: Array) -> tuple[Array, Array, Array]:
        """Return s, ds/dt and d2s/dt2 ``(k,)`` at times ``(k,)`` since the start; constant beyond both ends."""
        s, speed, change = (each[:, 0] for each in self.pace.at(times))
        return np.clip(s, 0.0, 1.0), speed, change

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Return joint positions, speeds and accelerations ``(k, n)`` at times ``(k,)`` since the start.

        The joint positions are solved for the very poses; speeds and accelerations are those of a spline through the
        nodes.
        """
        s, speeds, accelerations = self._followed(times)
        return self.joints_at(s), speeds, accelerations

    def joints_at(self, s: Array) -> Array:
        """Return joint positions ``(k, n)`` at places ``(k,)`` of the path."""
        return _solved(self.arm, self.values, self.path.poses(s), self.turned, np.asarray(self.spline(s)))[0]

    def _followed(self, times: Array) -> tuple[Array, Array, Array]:
        """Return s ``(k,)``, and speeds and accelerations ``(k, n)``."""
        s, speed, change = self.along(times)
        by_s, twice = self.spline(s, 1), self.spline(s, 2)
        return s, by_s * speed[:, None], twice * speed[:, None] ** 2 + by_s * change[:, None]


def path_move(
    arm: RigidArm, values: Array, chain: JointSpec, path: CartesianPath, start: Array, feed: Feed
) -> PathMove:
    """Plan the quickest move along a path, from joint positions ``start`` ``(n,)`` at its first pose.

    An arm of fewer than six joints keeps the orientation where it can, and else the position alone.

    Args:
        chain: the joints, with their speeds and accelerations.

    Raises:
        LabError: the arm does not reach a pose, passes a singularity or a limit, or nothing moves.
    """
    if max(path.length_m, path.turn_rad) < _LEAST_M:
        raise LabError("the path's start and end are the same; leave one out")
    turned, found = True, _joints_on(arm, values, path, start, turned=True)
    if isinstance(found, _Stop) and chain.size < FREEDOMS:
        turned, found = False, _joints_on(arm, values, path, start, turned=False)
    if isinstance(found, _Stop):
        raise LabError(found.description(path))
    nodes, joints = found
    _refuse_beyond(chain, joints)
    spline = make_interp_spline(nodes, joints, k=5)
    sizes = (
        (path.length_m, feed.speed_m_s, feed.acceleration_m_s2),
        (path.turn_rad, feed.turn_rad_s, feed.turn_rad_s2),
    )
    rates = [(speed / size, pull / size) for size, speed, pull in sizes if size > _LEAST_M]
    return PathMove(arm, values, path, turned, nodes, joints, _quickest_pace(chain, spline, rates))


@dataclass(frozen=True)
class _Stop:
    """Place at which the joints cannot follow a path any farther.

    Attributes:
        s: the last place reached.
        reached: whether the next one is in reach, so that they jump there.
    """

    s: float
    reached: bool

    def description(self, path: CartesianPath) -> str:
        at = ", ".join(f"{MM.of(each) + 0.0:.1f}" for each in path.poses(np.array([self.s]))[0, :3, 3])
        where = f"beyond {self.s:.0%} of it, at x, y, z = {at} mm"
        if self.reached:
            return (
                f"the joints cannot follow the path {where}: it passes a singularity there; move the points away from "
                "it, start in another configuration, or go on by a joint move"
            )
        return (
            f"the tool cannot follow the path {where}: what comes next is out of reach; move the points nearer, or "
            "turn the tool less"
        )


def _joints_on(
    arm: RigidArm, values: Array, path: CartesianPath, start: Array, *, turned: bool
) -> tuple[Array, Array] | _Stop:
    """Return nodes ``(m,)`` and the joints ``(m, n)`` there, or the place where they stop."""
    coarse = np.linspace(0.0, 1.0, _COARSE)
    poses, joints = path.poses(coarse), np.empty((_COARSE, len(start)))
    last, before = start, start
    for i, T in enumerate(poses):
        found, missed = _solved(arm, values, T[None], turned, (2 * last - before)[None])
        if missed > _MISSED_M or (i and np.abs(found[0] - last).max() > _JUMP):
            return _Stop(float(coarse[max(i - 1, 0)]), missed < _NEAR_M)
        before, last = (last if i else found[0]), found[0]
        joints[i] = last
    near, stop = CubicSpline(coarse, joints), 0.0
    for count in _NODES:
        nodes = np.linspace(0.0, 1.0, count)
        every, missed = _solved(arm, values, path.poses(nodes), turned, np.asarray(near(nodes)))
        jumps = np.abs(np.diff(every, axis=0)).max(axis=1) > _JUMP
        if missed > _MISSED_M or jumps.any():
            return _Stop(float(nodes[int(np.argmax(jumps))]), missed < _NEAR_M)
        off = np.abs(make_interp_spline(nodes[::2], every[::2], k=5)(nodes) - every).max(axis=1)
        if off.max() < _BETWEEN_RAD:
            return nodes, every
        near, stop = make_interp_spline(nodes, every, k=5), float(nodes[int(np.argmax(off))])
    return _Stop(stop, reached=True)


def _solved(arm: RigidArm, values: Array, Ts: Array, turned: bool, near: Array) -> tuple[Array, float]:
    """Return joint positions for poses ``(k, 4, 4)`` by Newton's method, and the largest error."""
    rotations = Ts[:, :3, :3] if turned else np.full((len(Ts), 3, 3), np.nan)
    found = reach(arm, values, PoseTarget(Ts[:, :3, 3], rotations), near, np.empty((len(Ts), 0)))
    return found.joints, float(np.abs(found.errors).max())


def _refuse_beyond(chain: JointSpec, joints: Array) -> None:
    excess = chain.excess(joints)
    row, joint = np.unravel_index(int(np.argmax(excess)), excess.shape)
    if excess[row, joint] > _LEAST_M:
        raise LabError(
            f"at {row / (len(joints) - 1):.0%} of the path {chain.limit_note(int(joint), joints[row, joint])}; move "
            "the path, or start in another configuration"
        )
