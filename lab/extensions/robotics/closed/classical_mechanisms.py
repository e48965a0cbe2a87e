"""Closed-form kinematics of the 2-RPR, the 3-RPR and the Delta: direct and inverse models, singularities.

Direct model of the 3-RPR: a polynomial of degree six. With z = exp(i phi) in place of t = tan(phi / 2) it needs no
case for phi = pi: the modes are its roots on the unit circle, and it loses degree only where two legs share a pin
(Gosselin, Sefrioui & Richard 1992 have it in t). The Delta follows Williams (The Delta Parallel Robot: Kinematics
Solutions, 2016).

Distances from singularities are numbers without a unit from 0 (singular) to 1. From the closure f(X, q) = 0 follows
A dX + B dq = 0 (Gosselin & Angeles 1990). Where A is singular the platform moves though the joints are locked (type 2,
*parallel*); where B is, a joint moves and the platform does not (type 1, *serial*); and where what holds the platform
upright is dependent, it gains a turn (*constraint*; Zlatanov 2002).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.newton import newton
from lab.core.se3 import Array

__all__ = ["AZIMUTHS_RAD", "Delta", "Distances", "SharedPin", "ThreeLegs", "TwoLegs", "left", "wrapped"]

_ROUNDING = 1e-12  # of a square's scale: circles that miss each other by less touch


def _real_root(square: Array, scale: Array | float) -> Array:
    """Return the root of a difference of terms of that scale: 0 where it is negative by rounding alone, else NaN."""
    root: Array = np.sqrt(np.where(square >= 0, square, np.where(square >= -_ROUNDING * scale, 0.0, np.nan)))
    return root


def _cross(a: Array, b: Array) -> Array:
    """Return a x b ``(...)`` of vectors ``(..., 2)``: positive where b is to the left of a."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def left(a: Array) -> Array:
    """Turn vectors ``(..., 2)`` by a quarter to the left."""
    return np.stack([-a[..., 1], a[..., 0]], axis=-1)


def _turned(angle: Array, vectors: Array) -> Array:
    """Turn vectors ``(..., 2)`` to the left by angles ``(...)`` (rad)."""
    turns: Array = np.cos(angle)[..., None] * vectors + np.sin(angle)[..., None] * left(vectors)
    return turns


def wrapped(angle: Array) -> Array:
    """Return an angle (rad) less whole turns, between -pi and pi."""
    return np.asarray(angle - 2 * np.pi * np.round(angle / (2 * np.pi)))


def _usable(lengths: Array) -> Array:
    """Return lengths, NaN where one is below zero."""
    lengths = np.asarray(lengths, dtype=np.float64)
    return np.where(lengths >= 0, lengths, np.nan)


def _circles_meet(a: Array, b: Array, radius_a: Array, radius_b: Array) -> Array:
    """Intersect circles about a and b ``(2,)``: ``(n, 2, 2)``, the point to the left of the line from a to b first."""
    apart = float(np.hypot(*(b - a)))
    along = (b - a) / apart
    base = (apart + (radius_a - radius_b) * (radius_a + radius_b) / apart) / 2
    height = _real_root((radius_a - base) * (radius_a + base), radius_a**2 + radius_b**2 + apart**2)
    heights = np.stack([height, -height], axis=1)
    points: Array = a + base[:, None, None] * along + heights[..., None] * left(along)
    return points


def _as_sorted(poses: Array) -> Array:
    """Sort the poses ``(n, m, 3)`` (x, y, angle) of each row by angle, NaN last."""
    order = np.argsort(poses[..., 2], axis=1)
    return np.take_along_axis(poses, order[..., None], axis=1)


class Distances(NamedTuple):
    """Distances from singularities, each ``(n,)``, 0 to 1; NaN out of reach.

    Attributes:
        parallel: the smallest singular value of A, its rows brought to unit length. A load of 1 on the
            platform takes forces of up to 1 / parallel in the legs (root of the sum of squares).
        serial: of the worst leg, the observability of the platform's motion in its joint.
        constraint: as parallel, of the moments that hold the platform upright; 1 in the plane, where none need to.
    """

    parallel: Array
    serial: Array
    constraint: Array


def _independence(rows: Array) -> Array:
    """Return the smallest singular value ``(n,)`` of square matrices ``(n, k, k)`` with rows of unit length at most.

    It is 0 where rows are dependent and 1 where they are of unit length and at right angles.
    """
    finite = np.asarray(np.isfinite(rows).all(axis=(1, 2)))
    least = np.full(len(rows), np.nan)
    least[finite] = np.linalg.svd(rows[finite], compute_uv=False)[:, -1]
    return least


def _unit(rows: Array) -> Array:
    """Scale rows ``(..., k)`` to unit length; zero rows stay zero."""
    size = np.linalg.norm(rows, axis=-1, keepdims=True)
    found: Array = rows / np.where(size == 0, 1.0, size)
    return found


@dataclass(frozen=True)
class TwoLegs:
    """A 2-RPR: anchors A1 = (0, 0) and A2 = (L, 0), from which P = (x, y) is rho1 and rho2 away (m).

    f1 = x^2 + y^2 - rho1^2 and f2 = (x - L)^2 + y^2 - rho2^2 are zero.

    Attributes:
        span_m: L.
    """

    span_m: float

    def __post_init__(self) -> None:
        if not 0 < self.span_m < np.inf:
            raise LabError(f"span_m is {self.span_m:g}: the anchors are a positive distance apart")

    def inverse(self, points: Array) -> Array:
        """Return the leg lengths ``(n, 2)`` m at points ``(n, 2)`` m."""
        return np.asarray(np.linalg.norm(self._legs(points), axis=2))

    def direct(self, lengths: Array) -> Array:
        """Return points ``(n, 2, 2)`` m of lengths ``(n, 2)``: y > 0 first; one twice where y = 0, NaN out of reach."""
        rho1, rho2 = _usable(lengths).T
        return _circles_meet(np.zeros(2), np.array([self.span_m, 0.0]), rho1, rho2)

    def matrices(self, points: Array) -> tuple[Array, Array]:
        """Return A = df/dP and B = df/drho ``(n, 2, 2)`` m of A dP + B drho = 0; det A = 4 L y."""
        return 2 * self._legs(points), -2 * self.inverse(points)[:, :, None] * np.eye(2)

    def distances(self, points: Array) -> Distances:
        """Compute singularity distances of points ``(n, 2)``. Serial is a zero leg, measured as rho / |(rho, L)|."""
        lengths = self.inverse(points)
        serial = (lengths / np.hypot(lengths, self.span_m)).min(axis=1)
        return Distances(_independence(_unit(self._legs(points))), serial, np.ones(len(lengths)))

    def _legs(self, points: Array) -> Array:
        """Return the vectors ``(n, 2, 2)`` from the anchors to P."""
        return np.asarray(np.asarray(points)[:, None, :] - np.array([[0.0, 0.0], [self.span_m, 0.0]]))


_MODES = 6  # at most
_SAMPLES = 8  # of a closure with harmonics up to the third
_NO_DEGREE = 1e-11  # of the largest coefficient: a leading one below it is none
_NEAR = 1e-3  # of | log |z| |, and of squared lengths: what misses by more is no mode
_CLOSED = 1e-14  # what a mode's squared lengths may miss
_SAME = 1e-6  # modes nearer to each other, also in rad, are one
_STEPS = 5  # of Newton; each leaves _DAMPING / (smallest singular value)^2 of what was missing
_DAMPING = 1e-13


class _Sextic(NamedTuple):
    """Closure equations of a 3-RPR for n sets of leg lengths. All lengths are divided by the robot's size.

    With q the leg 1, the others are q + v_i, v_i = R b_i - a_i. So q^2 = rho1^2 and q . v_i = c_i =
    (rho_i^2 - rho1^2 - v_i^2) / 2. By the latter q = N / D with N = left(c_2 v_3 - c_3 v_2) and D = v_2 x v_3, hence
    N^2 - rho1^2 D^2 = 0: in tan(phi / 2) of degree eight, less an exact factor 1 + t^2, as harmonics end at the third.

    Attributes:
        base: anchors a_i ``(n, 3, 2)`` from the first.
        platform: attachments b_i ``(n, 3, 2)`` from the first, in its frame.
        lengths: ``(n, 3)``.
    """

    base: Array
    platform: Array
    lengths: Array

    def modes(self) -> Array:
        """Return all q and phi ``(n, 6, 3)``, by rising phi between -pi and pi, then NaN."""
        angles = self.roots()
        both = np.empty((len(angles), _MODES, 2, 3))
        both[..., :2], both[..., 2] = self.points(angles), angles[..., None]
        starts = both.reshape(len(angles), 2 * _MODES, 3)
        found = np.full_like(starts, np.nan)
        row, place = np.nonzero(np.isfinite(starts).all(axis=2))
        found[row, place] = _Sextic(*(each[row] for each in self)).polished(starts[row, place])
        return _as_sorted(_without_repeats(_as_sorted(found)))[:, :_MODES]

    def roots(self) -> Array:
        """Return the angles ``(n, 6)`` at which the legs close, or nearly; else NaN."""
        v, c = self.lines(np.broadcast_to(np.arange(_SAMPLES) * 2 * np.pi / _SAMPLES, (len(self.lengths), _SAMPLES)))
        N = c[..., :1] * v[..., 1, :] - c[..., 1:] * v[..., 0, :]
        D = _cross(v[..., 0, :], v[..., 1, :])
        upper = np.fft.rfft((N**2).sum(axis=-1) - self.lengths[:, :1] ** 2 * D**2)[:, : _MODES // 2 + 1]
        coefficients = np.concatenate([upper[:, :0:-1].conj(), upper], axis=1)  # (n, 7) of z^0 to z^6
        size = np.abs(upper)
        present = np.isfinite(size) & (size > _NO_DEGREE * size.max(axis=1, keepdims=True))
        degree = np.where(present, np.arange(4), 0).max(axis=1)
        found = np.full((len(upper), _MODES), np.nan)
        for half in range(1, _MODES // 2 + 1):
            rows = np.flatnonzero(degree == half)
            p = coefficients[rows, _MODES // 2 - half : _MODES // 2 + half + 1]
            companion = np.zeros((len(rows), 2 * half, 2 * half), dtype=np.complex128)
            companion[:, 1:, :-1] = np.eye(2 * half - 1)
            companion[:, :, -1] = -p[:, :-1] / p[:, -1:]
            z = np.linalg.eigvals(companion)
            found[rows, : 2 * half] = np.where(np.abs(np.abs(z) - 1) < _NEAR, np.angle(z), np.nan)
        return found

    def lines(self, angles: Array) -> tuple[Array, Array]:
        """Return v_i ``(n, k, 2, 2)`` and c_i ``(n, k, 2)`` of legs 2 and 3 at angles ``(n, k)``."""
        v = _turned(angles[..., None], self.platform[:, None, 1:]) - self.base[:, None, 1:]
        squares = self.lengths[:, None] ** 2
        return v, (squares[..., 1:] - squares[..., :1] - (v**2).sum(axis=-1)) / 2

    def points(self, angles: Array) -> Array:
        """Return both q ``(n, k, 2, 2)`` at angles ``(n, k)``: on the circle and the line of the longer v."""
        v, c = self.lines(angles)
        squares = (v**2).sum(axis=-1)
        longer = np.where(squares[..., :1] >= squares[..., 1:], 0, 1)  # (n, k, 1)
        v = np.take_along_axis(v, longer[..., None], axis=2)[..., 0, :]
        c, square = (np.take_along_axis(each, longer, axis=2) for each in (c, squares))
        square = np.where(square == 0, 1.0, square)
        height = np.sqrt(np.maximum(self.lengths[:, None, :1] ** 2 / square - (c / square) ** 2, 0.0))
        base, rise = c / square * v, height * left(v)
        return np.stack([base + rise, base - rise], axis=2)

    def polished(self, starts: Array) -> Array:
        """Refine each q and phi ``(n, 3)`` by damped Newton on (leg^2 - rho^2) / 2 = 0; NaN where that is not met."""

        def legs_at(found: Array) -> tuple[Array, Array, Array]:
            arms = _turned(found[:, None, 2], self.platform)
            legs = found[:, None, :2] + arms - self.base
            return arms, legs, ((legs**2).sum(axis=2) - self.lengths**2) / 2

        def step(found: Array, rows: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
            arms, legs, missing = legs_at(found)
            slopes = np.concatenate([legs, _cross(arms, legs)[..., None]], axis=2)
            across = slopes.swapaxes(1, 2)
            change = np.linalg.solve(across @ slopes + _DAMPING * np.eye(3), across @ missing[..., None])[..., 0]
            return -np.clip(change, -1.0, 1.0), np.zeros_like(rows)

        near = (np.abs(legs_at(starts)[2]) < _NEAR).all(axis=1, keepdims=True)
        found = newton(step, starts, _STEPS).values
        met = near & (np.abs(legs_at(found)[2]) < _CLOSED).all(axis=1, keepdims=True)
        found[:, 2] = wrapped(found[:, 2])
        return np.where(met, found, np.nan)


def _without_repeats(modes: Array) -> Array:
    """Return modes ``(n, m, 3)``, NaN where one nearly is an earlier one."""
    apart = np.abs(modes[:, :, None] - modes[:, None])  # (n, m, m, 3)
    apart[..., 2] = np.abs(wrapped(apart[..., 2]))
    repeated = np.tril(np.all(apart < _SAME, axis=-1), -1).any(axis=2, keepdims=True)
    return np.where(repeated, np.nan, modes)


@dataclass(frozen=True)
class ThreeLegs:
    """A 3-RPR: leg i goes from anchor a_i to p + R(phi) b_i on the platform; a pose is x, y of p (m) and phi (rad).

    Attributes:
        base: anchors ``(3, 2)`` m.
        platform: attachments ``(3, 2)`` m in the platform's frame.
    """

    base: Array
    platform: Array

    def __post_init__(self) -> None:
        for name in ("base", "platform"):
            points = np.asarray(getattr(self, name), dtype=np.float64)
            if points.shape != (3, 2) or not np.isfinite(points).all():
                raise LabError(f"{name} has shape {points.shape}: give three points (x, y), all finite")
            if not np.ptp(points, axis=0).any():
                raise LabError(f"{name}: its three points are one, so that the platform turns freely about it")
            object.__setattr__(self, name, points)
        if len(np.unique(np.hstack([self.base, self.platform]), axis=0)) < 3:
            raise LabError("base and platform: two legs share both ends, so that one of them holds nothing")

    def inverse(self, poses: Array) -> Array:
        """Return the leg lengths ``(n, 3)`` m at poses ``(n, 3)``."""
        return np.asarray(np.linalg.norm(self._legs(poses)[0], axis=2))

    def direct(self, lengths: Array) -> Array:
        """Return all poses ``(n, 6, 3)`` with lengths ``(n, 3)``, by rising phi between -pi and pi, then NaN.

        Modes that merge are given once. A platform that moves with its legs locked has no modes to list there.
        """
        lengths = _usable(lengths)
        reach = float(np.ptp(self.base, axis=0).max() + np.ptp(self.platform, axis=0).max())
        size = np.maximum(np.nanmax(lengths, axis=1, initial=0.0), reach)[:, None, None]  # (n, 1, 1)
        rows = (self.base - self.base[0]) / size, (self.platform - self.platform[0]) / size
        modes = _Sextic(*rows, lengths / size[:, 0]).modes()
        first = _turned(modes[..., 2], np.broadcast_to(self.platform[0], modes[..., :2].shape))
        return _as_sorted(np.concatenate([self.base[0] + modes[..., :2] * size - first, modes[..., 2:]], axis=2))

    def matrices(self, poses: Array) -> tuple[Array, Array]:
        """Return A, of rows (u_i, R b_i x u_i), and B = -I ``(n, 3, 3)`` of A dX + B drho = 0.

        u_i is leg i's direction. The third column of A is in m. A leg of length zero has a row of zeros.
        """
        legs, arms = self._legs(poses)
        u = _unit(legs)
        return np.concatenate([u, _cross(arms, u)[..., None]], axis=2), np.broadcast_to(-np.eye(3), (len(u), 3, 3))

    def distances(self, poses: Array) -> Distances:
        """Compute distances of poses ``(n, 3)`` from singularities, independent of the origin of the platform's frame.

        The platform turns about the centre of its attachments, and a radian counts as their distance r from it (root
        mean square). Serial is a leg that is zero, measured as rho / |(rho, r)|; it has no direction, so that
        parallel is 0 there too.
        """
        legs, arms = self._legs(poses)
        arms = arms - arms.mean(axis=1, keepdims=True)
        radius = np.sqrt(((self.platform - self.platform.mean(axis=0)) ** 2).sum(axis=1).mean())
        rows = np.concatenate([legs, _cross(arms, legs)[..., None] / radius], axis=2)
        lengths = np.linalg.norm(legs, axis=2)
        serial = (lengths / np.hypot(lengths, radius)).min(axis=1)
        return Distances(_independence(_unit(rows)), serial, np.ones(len(lengths)))

    def _legs(self, poses: Array) -> tuple[Array, Array]:
        """Return the legs' vectors and R b_i, both ``(n, 3, 2)`` in the base's axes."""
        poses = np.asarray(poses)
        arms = _turned(poses[:, None, 2], np.broadcast_to(self.platform, (len(poses), 3, 2)))
        return poses[:, None, :2] + arms - self.base, arms


@dataclass(frozen=True)
class SharedPin:
    """A 3-RPR whose platform is a bar from P, its origin, along x to the pin of leg 2; a pose is x, y of P and phi.

    Attributes:
        base: anchors ``(3, 2)`` m, the first and the third apart.
        bar_m: length L of the platform.
    """

    base: Array
    bar_m: float

    def __post_init__(self) -> None:
        if not 0 < self.bar_m < np.inf:
            raise LabError(f"bar_m is {self.bar_m:g}: give the platform a positive length")
        object.__setattr__(self, "base", self.legs.base)

    @property
    def legs(self) -> ThreeLegs:
        """This robot as a general 3-RPR."""
        return ThreeLegs(self.base, np.array([[0.0, 0.0], [self.bar_m, 0.0], [0.0, 0.0]]))

    def direct(self, lengths: Array) -> Array:
        """Return all poses ``(n, 4, 3)`` of lengths ``(n, 3)`` m by rising phi, then NaN: none, two or four.

        P is where circles 1 and 3 meet. With g = P - A2 and e the bar's direction, leg 2 is g + L e, so that
        g . e = k = (rho2^2 - L^2 - g^2) / 2L. Modes that merge are given twice.
        """
        rho1, rho2, rho3 = _usable(lengths).T
        points = _circles_meet(self.base[0], self.base[2], rho1, rho3)  # (n, 2, 2)
        g = points - self.base[1]
        square = (g**2).sum(axis=-1)
        k = (rho2[:, None] ** 2 - self.bar_m**2 - square) / (2 * self.bar_m)
        bend = np.arctan2(_real_root(square - k**2, square + k**2), k)
        angle = np.arctan2(g[..., 1], g[..., 0])[..., None] + np.stack([bend, -bend], axis=-1)  # (n, 2, 2)
        points = np.broadcast_to(points[:, :, None], (*angle.shape, 2))
        poses = np.concatenate([points, wrapped(angle)[..., None]], axis=-1)
        poses = np.where(np.isfinite(angle)[..., None], poses, np.nan)
        return _as_sorted(poses.reshape(len(rho1), 4, 3))

    def determinant(self, poses: Array) -> Array:
        """Compute det A ``(n,)`` m of ``ThreeLegs.matrices`` as -L (u1 x u3)(e x u2), u_i the legs' directions.

        Singular are legs 1 and 3 in line, and leg 2 in line with the bar.
        """
        poses = np.asarray(poses)
        e = np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)
        u1, u3 = (_unit(poses[:, :2] - self.base[i]) for i in (0, 2))
        u2 = _unit(poses[:, :2] + self.bar_m * e - self.base[1])
        return np.asarray(-self.bar_m * _cross(u1, u3) * _cross(e, u2))


AZIMUTHS_RAD = np.radians([-90.0, 30.0, 150.0])  # Williams' order
_UP = np.array([0.0, 0.0, 1.0])
_FLAT = 1e-12  # of the squared rod: sphere centres that span less lie on a line


@dataclass(frozen=True)
class Delta:
    """A Delta: three arms, each with a parallelogram of rods, move a platform that does not turn (Clavel 1988).

    The frame is the base's: z upward, the hips around the origin in the plane z = 0. A joint position of 0 has an arm
    level and outward; it counts downward.

    Attributes:
        base_radius_m: of the hips about the base's centre.
        platform_radius_m: of the rods' ends about the platform's centre P.
        arm_m, rod_m: lengths L and l.
        azimuths_rad: ``(3,)`` of the arms, about z from x.
    """

    base_radius_m: float
    platform_radius_m: float
    arm_m: float
    rod_m: float
    azimuths_rad: Array

    def __post_init__(self) -> None:
        for name in ("base_radius_m", "platform_radius_m"):
            if not 0 <= getattr(self, name) < np.inf:
                raise LabError(f"{name} is {getattr(self, name):g}: a radius is not below zero")
        for name in ("arm_m", "rod_m"):
            if not 0 < getattr(self, name) < np.inf:
                raise LabError(f"{name} is {getattr(self, name):g}: give it a positive length")
        azimuths = np.asarray(self.azimuths_rad, dtype=np.float64)
        if azimuths.shape != (3,) or not np.isfinite(azimuths).all():
            raise LabError(f"azimuths_rad has shape {azimuths.shape}: give three angles, all finite")
        object.__setattr__(self, "azimuths_rad", azimuths)

    @property
    def outward(self) -> Array:
        """Level directions e_i ``(3, 3)`` from the base's centre to the hips."""
        return np.stack([np.cos(self.azimuths_rad), np.sin(self.azimuths_rad), np.zeros(3)], axis=1)

    @property
    def hip_axes(self) -> Array:
        """Directions ``(3, 3)`` that the arms turn about to go down: z x e_i."""
        return np.cross(_UP, self.outward)

    def inverse(self, points: Array) -> Array:
        """Return joint positions ``(n, 2, 3)`` rad at P ``(n, 3)`` m: both branches of each leg, NaN out of reach.

        With d from the hip to the rod's end, d . (cos t e - sin t z) = K = (d^2 + L^2 - l^2) / 2L. The branch with
        the elbow further out comes first, as long as the platform is below.
        """
        d = np.asarray(points)[:, None] + (self.platform_radius_m - self.base_radius_m) * self.outward
        along, down = (d * self.outward).sum(axis=2), -d[..., 2]
        K = ((d**2).sum(axis=2) + self.arm_m**2 - self.rod_m**2) / (2 * self.arm_m)
        square = along**2 + down**2
        bend = np.arctan2(_real_root(square - K**2, square + K**2), K)
        toward = np.arctan2(down, along)
        return wrapped(np.stack([toward - bend, toward + bend], axis=1))

    def direct(self, joints: Array) -> Array:
        """Return P ``(n, 2, 3)`` m of joint positions ``(n, 3)`` rad, the lower first: three spheres of radius l meet.

        With u and v from their first centre to the others and n = u x v, the circle through all three has its centre at
        C1 + (u^2 v - v^2 u) x n / 2 n^2. One point twice where both merge, NaN where the spheres do not meet.
        """
        C = self._centres(joints)
        u, v = C[:, 1] - C[:, 0], C[:, 2] - C[:, 0]
        n = np.cross(u, v)
        square = (n**2).sum(axis=1, keepdims=True)
        square = np.where(square > (_FLAT * self.rod_m**2) ** 2, square, np.nan)
        rise = (u**2).sum(axis=1, keepdims=True) * v - (v**2).sum(axis=1, keepdims=True) * u
        from_first = np.cross(rise, n) / (2 * square)
        radius = (from_first**2).sum(axis=1, keepdims=True)
        height = _real_root(self.rod_m**2 - radius, self.rod_m**2) / np.sqrt(square)
        up = height * np.where(n[:, 2:] < 0, -n, n)  # in whatever order the arms are numbered
        return np.stack([C[:, 0] + from_first - up, C[:, 0] + from_first + up], axis=1)

    def matrices(self, points: Array, joints: Array) -> tuple[Array, Array]:
        """Return A, with rows s_i (m), and B, with s_i . dC_i/dq_i (m^2), of A dP = B dq; s_i is rod i."""
        rods = self._rods(points, joints)
        return rods, self.arm_m * (rods * self._tangents(joints)).sum(axis=2)[:, :, None] * np.eye(3)

    def distances(self, points: Array, joints: Array) -> Distances:
        """Compute the distances from singularities of P ``(n, 3)`` reached with joint positions ``(n, 3)``.

        Parallel: all rods are along one plane. Serial: the cosine between a rod and its elbow's motion is zero
        where the arm is in line with the rod as seen along the hip's axis. Constraint: the parallelogram of leg i holds
        the platform from turning about rod x hip axis, three of which have to be independent (and none zero).
        """
        s = self._rods(points, joints) / self.rod_m
        serial = np.abs((s * self._tangents(joints)).sum(axis=2)).min(axis=1)
        return Distances(_independence(s), serial, _independence(np.cross(s, self.hip_axes)))

    def _centres(self, joints: Array) -> Array:
        """Return C_i ``(n, 3, 3)``: P if the rod of leg i had no length."""
        q = np.asarray(joints)[..., None]
        centres: Array = (
            self.base_radius_m - self.platform_radius_m + self.arm_m * np.cos(q)
        ) * self.outward - self.arm_m * np.sin(q) * _UP
        return centres

    def _tangents(self, joints: Array) -> Array:
        """Return the unit directions ``(n, 3, 3)`` of the elbows' motions, dC_i/dq_i / L."""
        q = np.asarray(joints)[..., None]
        return np.asarray(-np.sin(q) * self.outward - np.cos(q) * _UP)

    def _rods(self, points: Array, joints: Array) -> Array:
        return np.asarray(np.asarray(points)[:, None] - self._centres(joints))
