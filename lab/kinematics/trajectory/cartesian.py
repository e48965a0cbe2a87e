"""Straight lines and circles of the tool in space, with its orientation, as fast as the joints can.

A path is p(s), R(s) for s from 0 to 1. The orientation turns about one fixed axis, evenly with s (Khalil & Dombre 2002,
section 13.4). The joints follow it by Newton's method from pose to pose; s then runs with that trapezoid of
speed which is the quickest of all that keep every joint's speed q' ds/dt and acceleration q'' (ds/dt)^2 + q' d2s/dt2
within its limits.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.inverse.newton import FREEDOMS, PoseTarget, reach
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm

__all__ = ["CartesianPath", "Feed", "PathMove", "arc", "line", "path_move"]

_COARSE, _NODES = 33, 129  # places on a path at which the joints are solved, one after the other, then all at once
_FINE = 1025  # places at which the limits are kept
_TRIED = 100  # shapes of the trapezoid, of which the quickest is taken
_JUMP = 0.3  # rad or m: between neighbouring nodes a joint that moves more passes a singularity
_MISSED_M = 1e-8  # m or rad: a pose missed by more is not reached
_LEAST_M = 1e-9  # points nearer than this are one
_TOGETHER = 1 - 1e-12  # of a limit, so that rounding does not pass it


@dataclass(frozen=True)
class CartesianPath:
    """p(s) = origin + s along + cos(s angle) cosine + sin(s angle) sine, and R(s) = exp(s turn) R(0).

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
        """Of the path."""
        return float(np.linalg.norm(self.along) + self.angle * np.linalg.norm(self.cosine))

    @property
    def turn_rad(self) -> float:
        """By how much the orientation turns."""
        return float(np.linalg.norm(self.turn))

    def poses(self, s: Array) -> Array:
        """The poses ``(k, 4, 4)`` (m) at ``s`` ``(k,)``."""
        angle = (s * self.angle)[:, None]
        places = self.origin + s[:, None] * self.along + np.cos(angle) * self.cosine + np.sin(angle) * self.sine
        return se3.pose(se3.exp(s[:, None] * self.turn) @ self.rotation, places)


def line(T_start: Array, T_end: Array) -> CartesianPath:
    """The straight line from one pose ``(4, 4)`` (m) to another."""
    zero = np.zeros(3)
    along = T_end[:3, 3] - T_start[:3, 3]
    turn = se3.log(T_end[:3, :3] @ T_start[:3, :3].T)
    return CartesianPath(T_start[:3, 3], along, zero, zero, 0.0, turn, T_start[:3, :3])


def arc(T_start: Array, via: Array, T_end: Array) -> CartesianPath:
    """The arc of a circle from one pose ``(4, 4)`` (m) through a point ``(3,)`` to another pose.

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
    """How fast the tool may move along a path, beside the limits of the joints.

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
    """The joints on a path of the tool, from rest to rest.

    Attributes:
        arm, values: what moves; parameters ``(p,)`` with one target.
        path: of that target.
        turned: whether its orientation is kept, or free.
        nodes: ``(m,)`` values of s at which the joints were solved.
        joints: ``(m, n)`` there, rad or m.
        peak: largest ds/dt, 1/s.
        ramp: d2s/dt2 of the start and, negative, of the end, 1/s^2.
    """

    arm: RigidArm
    values: Array
    path: CartesianPath
    turned: bool
    nodes: Array
    joints: Array
    peak: float
    ramp: float

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return _seconds(self.peak, self.ramp)

    @property
    def end(self) -> Array:
        """Joint positions ``(n,)`` at the end."""
        return np.asarray(self.joints[-1])

    @cached_property
    def spline(self) -> CubicSpline:
        """The joints over s."""
        return CubicSpline(self.nodes, self.joints)

    @cached_property
    def peaks(self) -> tuple[Array, Array]:
        """The largest magnitudes ``(n,)`` of the joints' speeds and accelerations, of those at many times."""
        s, speed, change = self.along(np.linspace(0.0, self.seconds, _FINE))
        by_s, twice = self.spline(s, 1), self.spline(s, 2)
        pull = twice * speed[:, None] ** 2 + by_s * change[:, None]
        return np.abs(by_s * speed[:, None]).max(axis=0), np.abs(pull).max(axis=0)

    def along(self, times: Array) -> tuple[Array, Array, Array]:
        """s, ds/dt and d2s/dt2 ``(k,)`` at times ``(k,)`` since the start; held at both ends."""
        rising = self.peak / self.ramp
        t = np.clip(times, 0.0, self.seconds)
        left = self.seconds - t
        up, down = 0.5 * self.ramp * t**2, 1 - 0.5 * self.ramp * left**2
        s = np.select([t < rising, left < rising], [up, down], 0.5 * self.peak * rising + self.peak * (t - rising))
        speed = np.minimum(np.minimum(self.ramp * t, self.ramp * left), self.peak)
        change = np.select([t >= self.seconds, t < rising, left <= rising], [0.0, self.ramp, -self.ramp], 0.0)
        return s, speed, change

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Joint positions, speeds and accelerations ``(k, n)`` at times ``(k,)`` since the start.

        The joint positions are solved for the very poses; speeds and accelerations are those of a spline through the
        nodes.
        """
        s, speed, change = self.along(times)
        joints = _solved(self.arm, self.values, self.path.poses(s), self.turned, np.asarray(self.spline(s)))[0]
        by_s, twice = self.spline(s, 1), self.spline(s, 2)
        return joints, by_s * speed[:, None], twice * speed[:, None] ** 2 + by_s * change[:, None]


def path_move(
    arm: RigidArm, values: Array, chain: JointSpec, path: CartesianPath, start: Array, feed: Feed
) -> PathMove:
    """The quickest such move along a path, from joint positions ``start`` ``(n,)`` at its first pose.

    An arm of fewer than six joints keeps the orientation where it can, and else the position alone.

    Args:
        chain: the joints, with their speeds and accelerations.

    Raises:
        LabError: the arm does not reach a pose, passes a singularity or a limit, or nothing moves.
    """
    if max(path.length_m, path.turn_rad) < _LEAST_M:
        raise LabError("the path's start and end are the same; leave one out")
    turned, joints = True, _followed(arm, values, path, start, turned=True)
    if isinstance(joints, float) and chain.size < FREEDOMS:
        turned, joints = False, _followed(arm, values, path, start, turned=False)
    if isinstance(joints, float):
        raise LabError(f"the tool cannot follow the path beyond {joints:.0%} of it: out of reach, or singular, there")
    _refuse_beyond(chain, joints)
    nodes = np.linspace(0.0, 1.0, _NODES)
    peak, ramp = _quickest(chain, path, CubicSpline(nodes, joints), feed)
    return PathMove(arm, values, path, turned, nodes, joints, peak, ramp)


def _followed(arm: RigidArm, values: Array, path: CartesianPath, start: Array, *, turned: bool) -> Array | float:
    """The joints ``(m, n)`` at the nodes; else how far along the path they come."""
    coarse = np.linspace(0.0, 1.0, _COARSE)
    poses, joints = path.poses(coarse), np.empty((_COARSE, len(start)))
    last, before = start, start
    for i, T in enumerate(poses):
        found, missed = _solved(arm, values, T[None], turned, (2 * last - before)[None])
        if missed > _MISSED_M or (i and np.abs(found[0] - last).max() > _JUMP):
            return float(coarse[max(i - 1, 0)])
        before, last = (last if i else found[0]), found[0]
        joints[i] = last
    nodes = np.linspace(0.0, 1.0, _NODES)
    found, missed = _solved(arm, values, path.poses(nodes), turned, np.asarray(CubicSpline(coarse, joints)(nodes)))
    jumps = np.abs(np.diff(found, axis=0)).max(axis=1) > _JUMP
    return float(nodes[int(np.argmax(jumps))]) if missed > _MISSED_M or jumps.any() else found


def _solved(arm: RigidArm, values: Array, Ts: Array, turned: bool, near: Array) -> tuple[Array, float]:
    """Joint positions for poses ``(k, 4, 4)`` by Newton's method, and by how much the worst one is missed."""
    rotations = Ts[:, :3, :3] if turned else np.full((len(Ts), 3, 3), np.nan)
    found = reach(arm, values, PoseTarget(Ts[:, :3, 3], rotations), near, np.empty((len(Ts), 0)))
    return found.joints, float(np.abs(found.errors).max())


def _refuse_beyond(chain: JointSpec, joints: Array) -> None:
    excess = chain.excess(joints)
    row, joint = np.unravel_index(int(np.argmax(excess)), excess.shape)
    if excess[row, joint] > _LEAST_M:
        raise LabError(
            f"at {row / (len(joints) - 1):.0%} of the path {chain.said_beyond(int(joint), joints[row, joint])}; move "
            "the path, or start in another configuration"
        )


def _quickest(chain: JointSpec, path: CartesianPath, spline: CubicSpline, feed: Feed) -> tuple[float, float]:
    """The peak v of ds/dt and the ramp a of the trapezoid that takes the shortest time.

    A shape is r = v^2 / a, the part of the way on which the speed changes. Times scale: a shape with a = 1 needs
    accelerations q' + 2 s q'' at its start, r q'' on the way and -q' + 2 (1 - s) q'' at its end, and they grow with a.
    """
    s = np.linspace(0.0, 1.0, _FINE)[:, None]
    first, second = spline(s[:, 0], 1), spline(s[:, 0], 2)
    rising, falling = np.abs(first + 2 * s * second), np.abs(-first + 2 * (1 - s) * second)
    pace = [(path.length_m, feed.speed_m_s), (path.turn_rad, feed.turn_rad_s)]
    pull = [(path.length_m, feed.acceleration_m_s2), (path.turn_rad, feed.turn_rad_s2)]
    with np.errstate(divide="ignore"):
        fastest = min(
            float((chain.speed / np.abs(first)).min()), *(most / size for size, most in pace if size > _LEAST_M)
        )
    quickest = min((most / size for size, most in pull if size > _LEAST_M), default=np.inf)
    found = []
    for shape in np.linspace(0, 1, _TRIED + 1)[1:]:
        needed = np.where(s <= shape / 2, rising, np.where(s >= 1 - shape / 2, falling, shape * np.abs(second)))
        at_corners = np.maximum(rising[s[:, 0] <= shape / 2].max(axis=0), falling[s[:, 0] >= 1 - shape / 2].max(axis=0))
        most = float((np.maximum(needed.max(axis=0), at_corners) / chain.acceleration).max())
        ramp = min(_TOGETHER / most, _TOGETHER * fastest**2 / shape, quickest)
        found.append((float(np.sqrt(shape * ramp)), ramp))
    return min(found, key=lambda each: _seconds(*each))


def _seconds(peak: float, ramp: float) -> float:
    return 1 / peak + peak / ramp
