"""Inverse kinematics of arms of five joints in closed form: all solutions of the poses that they can take.

A pose has six degrees of freedom, and five joints give it five; other poses get candidates, from which a search starts.
The shapes with a closed form are a planar arm between two joints (``PlanarMiddle``: two or three parallel axes), a
planar arm after two joints (``PlanarEnd``), a wrist of two axes that meet on any three joints (``_TwoAxisWrist``), and
hinges of which two neighbouring axes are parallel (``_ParallelPair``); and all of them fixed at the last frame, which
puts the two meeting axes, the planar arm or the pair at the base's end. Each gives candidates by its equations; those
that meet the whole pose, to rounding after a few Gauss-Newton steps, are its solutions.

Parallel pair: axes 1 and 2 or 2 and 3 of five hinges are parallel. They move what is between them in planes across
their direction n. With the third of joints 1 to 3, whose axis z is fixed beside them, they leave three numbers
unchanged: the angle between n and z, the height along n of a point of z, and the distance of the two parallel axes (a
square). Each is bilinear in the cosines and sines of joints 4 and 5 (Raghavan & Roth 1993 have such equations for six
joints): N(s) (1, cos t, sin t)' = 0, where s is the one of joints 4 and 5 that is farther from the parallel axes along
the loop, and t the other. So det N(s) = 0. It has degree 2 in the cosine and sine of s: t sees alike what s turns by
exp(i s) in the angle and in the height, so that the terms of degree 3 cancel. Its four roots are eigenvalues; the null
vector of N gives t, and joints 1 to 3 follow one after the other.

Two-axis wrist: joints 1 to 3 bring P to its place in closed form, whatever they are (``first_joints``). Then joint 4
turns axis 5, and joint 5 what is left. Where P comes onto a hinge's axis its place does not determine that joint; the
angle between axes 4 and 5 does, by an equation of type 2.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.robotics.inverse.first_joints import (
    Carrier,
    Named,
    ThreeJoints,
    carrier_of,
    fitted_factor,
    polynomial_roots,
)
from lab.extensions.robotics.inverse.five_axes_planar import PlanarEnd, PlanarMiddle, turn_between
from lab.extensions.robotics.inverse.khalil_equations import TINY, type_2
from lab.kinematics.compiled.kernels import parallel_pair, two_axes, with_fallback
from lab.kinematics.inverse.closed_form import (
    EXACT,
    Axes,
    Candidates,
    Determinant,
    Solutions,
    determinant,
    meeting_point,
    plane_across,
)
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.chain import Chain

__all__ = ["FiveAxes"]

_NODES = 5  # at which det N is evaluated: it has so many coefficients
_MORE_NODES = 9
_MIXED = np.array([[1.0, 0.6, -0.4], [-0.3, 1.0, 0.7]])  # two equations, where there are no more
_ROOTS = 4
_ALIKE = 1e-6  # of N's columns: below this they are one equation for t, with two roots
_LOOSE, _NOTHING = 1e-6, 1e-12  # of det N, or N, beside its usual size: s, or t, is nearly free, or free
_TRIED = 8  # positions of a joint that is nearly free, from its reference on


@dataclass(frozen=True)
class _ParallelPair:
    """Five hinges of which two neighbouring axes among the first three are parallel.

    Attributes:
        pair: the two joints with parallel axes, the one beside the third joint first; ``third`` is that joint.
        scale_m: of the arm.
        centre: ``(3,)`` m, a point of axis 5 in the last frame.
    """

    axes: Axes
    pair: tuple[int, int]
    third: int
    scale_m: float
    centre: Array
    repeats: bool = True

    @classmethod
    def of(cls, axes: Axes) -> "_ParallelPair | None":
        """Return the shape of an arm of five joints; None where it is another."""
        if any(axes.prismatic):
            return None
        for pair, third, beside in (((1, 2), 0, (0, 3)), ((1, 0), 2, (2,))):
            if not axes.parallel(*pair) or any(axes.parallel(pair[0], each) for each in beside):
                continue
            scale = float(np.abs(axes.origins - axes.origins[0]).max()) + 0.1
            along = 0.3 * scale * axes.directions[4]
            for point in (axes.origins[4], axes.origins[4] + along):  # the first may be on a parallel axis
                centre = se3.transform(se3.inverse(axes.T_frame0_last), point[None])[0]
                made = cls(axes, pair, third, scale, centre)
                if made._regular():
                    return made
        return None

    def _regular(self) -> bool:
        """Decide whether the parallel axes are apart, the equations determine joint s, and the centre can be moved."""
        apart = np.cross(self._n, self.axes.origins[self.pair[1]] - self.axes.origins[self.pair[0]])
        if np.linalg.norm(apart) <= EXACT or min(self._sizes) <= EXACT:
            return False
        joints = rng_for(0, "structure").uniform(-1.5, 1.5, (20, 5))
        return bool(np.abs(self._elbow(joints) * self._shoulder(joints)).max() > EXACT * self.scale_m**3)

    @cached_property
    def _sizes(self) -> tuple[float, float]:
        """Typical sizes of the coefficients of det N, and of the equation from its null vector."""
        joints = rng_for(0, "structure").uniform(-1.5, 1.5, (5, 40))
        equations = self._equations(self._moved(joints))
        one, two = (
            float(np.median(np.abs(each).max(axis=0)))
            for each in (self._polynomial(equations), self._of_two(equations))
        )
        return one, two

    @property
    def _last(self) -> tuple[int, int]:
        """Indices of joints s and t."""
        return (4, 3) if self.third == 0 else (3, 4)

    @property
    def roots(self) -> int:
        return _ROOTS

    # The equations

    @property
    def _n(self) -> Array:
        """Direction of the parallel axes."""
        return np.asarray(self.axes.directions[self.pair[1]])

    @cached_property
    def _coefficients(self) -> Array:
        """Coefficients of N's equations ``(27, 12)``: of (1, cos q4, sin q4) x (1, cos q5, sin q5) by ``_features``.

        A point p from the line of axis 3, through U along u, to that of axis 1, through W along w, seen by link 3 is
        k4 + R4 k5 + R4 R5 v, and w is R4 R5 y. Then u.w, u.p, w.p, p.p and p.(u x w) are bilinear in joints 4 and 5.
        """
        axes, size = self.axes, self.scale_m
        u, k4 = axes.directions[2], (axes.origins[3] - axes.origins[2]) / size
        k5 = (axes.origins[4] - axes.origins[3]) / size
        fourth, fifth = _turning(axes.directions[3]), _turning(axes.directions[4])

        def both(x: Array, K: Array) -> Array:  # x . R4 K R5 z
            return np.asarray(np.einsum("i,aij,jk,bkl->abl", x, fourth, K, fifth))

        angle, height, other, square, moment = (np.zeros((3, 3, 12)) for _ in range(5))
        angle[:, :, 1:4] = height[:, :, 4:7] = moment[:, :, 7:10] = both(u, np.eye(3))
        height[0, 0, 0] = u @ k4
        height[:, 0, 0] += u @ fourth @ k5
        other[:, :, 1:4] = both(k4, np.eye(3))
        other[0, :, 1:4] += k5 @ fifth
        other[0, 0, 10] = 1.0
        square[:, :, 4:7] = 2 * other[:, :, 1:4]
        square[:, 0, 0] = 2 * k4 @ fourth @ k5
        square[0, 0, 0] += k4 @ k4 + k5 @ k5
        square[0, 0, 11] = 1.0
        moment[:, :, 1:4] = -both(np.cross(u, k4), np.eye(3)) - both(u, se3.skew(k5))
        along, across = self._offset
        if self.third == 0:
            equations = np.stack([angle, height, square + 2 * along * other - 2 * across * moment])
        else:
            equations = np.stack([angle, other, square - 2 * along * height - 2 * across * moment])
        start = equations @ self._features(np.eye(4)[None])[0]
        equations[:, 0, 0, 0] -= start[:, :2, :2].sum(axis=(1, 2))  # at zero joint positions they hold
        return np.asarray(equations.reshape(27, 12))

    @property
    def _offset(self) -> tuple[float, float]:
        """Offset of the middle axis from the third joint's point, along its axis z and along z x n, by the scale."""
        z, root = self.axes.directions[self.third], self.axes.origins[self.third]
        frame = np.stack([z, np.cross(z, self._n), self._n], axis=1)
        along, across, _ = np.linalg.solve(frame, self.axes.origins[1] - root) / self.scale_m
        return float(along), float(across)

    def _features(self, moved: Array) -> Array:
        """Return linear features ``(n, 12)`` of the hand's displacements: 1, y, v, y x v, y.v and v.v."""
        w, root = self.axes.directions[0], self.axes.origins[0]
        back = moved[:, :3, :3].swapaxes(1, 2)
        y, v = back @ w, ((back @ (root - moved[:, :3, 3])[:, :, None])[:, :, 0] - self.axes.origins[4]) / self.scale_m
        inner = np.stack([(y * v).sum(axis=1), (v * v).sum(axis=1)], axis=1)
        return np.concatenate([np.ones((len(moved), 1)), y, v, np.cross(y, v), inner], axis=1)

    def _equations(self, moved: Array) -> Array:
        """Return equations ``(n, 3, 3, 3)`` of displacements: by equation, by (1, cos t, sin t), and likewise by s."""
        found = (self._features(moved) @ self._coefficients.T).reshape(-1, 3, 3, 3)
        return np.asarray(found if self.third == 0 else found.swapaxes(2, 3))

    def _polynomial(self, equations: Array) -> NDArray[np.complex128]:
        """Return the coefficients of det N ``(3, n)``: of exp(i k s) from k = 0 to 2."""
        N = equations @ _circle(_NODES)  # (n, 3, 3, nodes)
        det = (N[:, 0] * np.cross(N[:, 1], N[:, 2], axis=1)).sum(axis=1)
        return np.asarray(np.fft.fft(det, axis=1)[:, :3].T / _NODES)

    def _of_two(self, equations: Array) -> NDArray[np.complex128]:
        """Return the equation in s ``(5, n)`` from N's null vector of given length, where det N is zero everywhere."""
        first, second = (_MIXED @ (equations @ _circle(_MORE_NODES)).transpose(3, 0, 1, 2)).transpose(2, 0, 1, 3)
        null = np.cross(first, second)  # (nodes, n, 3)
        values = null[..., 1] ** 2 + null[..., 2] ** 2 - null[..., 0] ** 2
        return np.asarray(np.fft.fft(values, axis=0)[:5] / _MORE_NODES)

    def candidates(self, Ts: Array, preferred: Array) -> Iterator[Candidates]:
        """Poses that hardly determine joint 4 or 5 get more candidates."""
        plain, joints = self._plain(Ts, preferred)
        if (rows := np.flatnonzero(plain)).size:
            yield rows, joints[..., rows], np.zeros((*joints.shape[:2], rows.size), dtype=np.bool_)
        if (rows := np.flatnonzero(~plain)).size:
            yield rows, *self._loose(self._moved_by(Ts[rows]), preferred[:, rows])

    def _moved_by(self, Ts: Array) -> Array:
        """Return displacements of the hand from its pose at zero joint positions."""
        return np.asarray(Ts @ se3.inverse(self.axes.T_frame0_last))

    def _plain_by_numpy(self, Ts: Array, preferred: Array) -> tuple[NDArray[np.bool_], Array]:
        moved = self._moved_by(Ts)
        equations = self._equations(moved)
        found, size = self._found(equations)
        rest, single, _ = self._rest(equations, found, preferred[self._last[1]])
        return np.asarray(single.all(axis=0) & (size > _LOOSE)), self._joints(moved, found, rest[0])

    @with_fallback(_plain_by_numpy)
    def _plain(self, Ts: Array, preferred: Array) -> tuple[NDArray[np.bool_], Array]:
        """Decide where ``(n,)`` the equations determine joints 4 and 5, and return candidates ``(4, 5, n)``."""
        return parallel_pair(self._numbers, Ts)

    @cached_property
    def _numbers(self) -> Array:
        """Arm parameters of the compiled candidates."""
        axes, n = self.axes, self._n
        equations = self._coefficients.reshape(3, 3, 3, 12)
        parts = (
            equations if self.third == 0 else equations.swapaxes(1, 2), se3.inverse(axes.T_frame0_last)[:3],
            axes.directions[0], axes.origins[0], axes.directions, axes.origins,
            [self.scale_m, self._sizes[0], self.third],
            self.pair, [np.sign(n @ axes.directions[self.pair[0]])], plane_across(n)[0],
        )  # fmt: skip
        return np.concatenate([np.ravel(part).astype(np.float64) for part in parts])

    def _found(self, equations: Array) -> tuple[Array, Array]:
        """Return positions ``(4, n)`` of joint s, and the size ``(n,)`` of det N relative to its usual size."""
        polynomial = self._polynomial(equations)
        return _angles(polynomial), np.abs(polynomial).max(axis=0) / self._sizes[0]

    def _loose(self, moved: Array, preferred: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return candidates ``(k, 5, n)`` where joint s or t is free, or nearly; and which are free.

        A free joint s is at the reference, if the others allow it, else at places all around.
        """
        s, t = self._last
        equations = self._equations(moved)
        found, size = self._found(equations)
        around = preferred[s] + 2 * np.pi * np.arange(_TRIED)[:, None] / _TRIED
        rest, _, _ = self._rest(equations, around[:1], preferred[t])
        ones = np.ones_like(rest)
        of_s, of_t = (np.stack([ones, np.cos(each), np.sin(each)]) for each in (around[:1] + 0 * rest, rest))
        missing = np.abs(np.einsum("niab,amkn,bmkn->imkn", equations, of_t, of_s)).max(axis=0).min(axis=(0, 1))
        of_two = self._of_two(equations)
        at_will = (size <= _NOTHING) & (np.abs(of_two).max(axis=0) <= _NOTHING * self._sizes[1])
        found = np.where(at_will & (missing <= EXACT), around[:1], np.concatenate([found, _angles(of_two), around]))
        rest, _, silent = self._rest(equations, found, preferred[t])
        found = np.broadcast_to(found, rest.shape).reshape(-1, len(moved))
        joints = self._joints(moved, found, rest.reshape(found.shape))
        free = np.zeros(joints.shape, dtype=np.bool_)
        free[:, s], free[:, t] = at_will, np.concatenate([silent] * len(rest))
        return joints, free

    def _rest(
        self, equations: Array, found: Array, preferred: Array
    ) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
        """Solve joint t ``(3, k, n)`` for positions ``(k, n)`` of s: by all equations, and twice by the strongest.

        Returns:
            Also ``(k, n)`` where the first will do, and where no equation depends on t.
        """
        turned = np.stack([np.ones_like(found), np.cos(found), np.sin(found)])
        fixed, cosine, sine = np.einsum("niab,bkn->aikn", equations, turned)
        A, B, C = (cosine**2).sum(axis=0), (cosine * sine).sum(axis=0), (sine**2).sum(axis=0)
        right, ahead = -(cosine * fixed).sum(axis=0), -(sine * fixed).sum(axis=0)
        least = np.arctan2(A * ahead - B * right, C * right - B * ahead)
        along = np.arctan2(2 * B, A - C) / 2  # the direction that the equations determine best
        e, f = np.cos(along), np.sin(along)
        strongest = A * e * e + 2 * B * e * f + C * f * f
        silent = strongest <= _NOTHING**2
        height = (e * right + f * ahead) / np.where(silent, 1.0, strongest)
        (roots,), _, _ = type_2(f, e, height, TINY, preferred)
        roots = np.where(silent, preferred, roots)
        return np.concatenate([least[None], roots]), A * C - B * B > _ALIKE * (A + C) ** 2, silent

    def _joints(self, moved: Array, found: Array, rest: Array) -> Array:
        """Return joints ``(k, 5, n)`` for joints s and t ``(k, n)``: the third turns n, the pair does the rest."""
        axes, (s, t) = self.axes, self._last
        out = np.empty((len(found), 5, found.shape[1]))
        out[:, s], out[:, t] = found, rest
        left = moved @ self._turned(4, -out[:, 4]) @ self._turned(3, -out[:, 3])  # what joints 1 to 3 do
        z, n = axes.directions[self.third], self._n
        if self.third:
            left = se3.inverse(left)
        sense = -1.0 if self.third else 1.0
        first = _turn_between(z, n, left[..., :3, :3] @ n)
        out[:, self.third] = sense * first
        left = self._turned(self.third, -first) @ left
        end, root = axes.origins[self.pair[1]], axes.origins[self.pair[0]]
        there = left[..., :3, :3] @ end + left[..., :3, 3]
        second = _turn_between(n, end - root, there - root)
        across = plane_across(n)[0]
        whole = _turn_between(n, across, left[..., :3, :3] @ across)
        out[:, self.pair[0]] = sense * float(np.sign(n @ axes.directions[self.pair[0]])) * second
        out[:, self.pair[1]] = sense * (whole - second)
        return out

    def _turned(self, joint: int, amount: Array) -> Array:
        """Return displacements ``(..., 4, 4)`` by one joint."""
        R = se3.exp(amount[..., None] * self.axes.directions[joint])
        return se3.pose(R, self.axes.origins[joint] - R @ self.axes.origins[joint])

    def _moved(self, joints: Array) -> Array:
        """Return displacements ``(n, 4, 4)`` of the hand by joint positions ``(5, n)``."""
        out = np.broadcast_to(np.eye(4), (joints.shape[1], 4, 4))
        for joint in range(5):
            out = out @ self._turned(joint, joints[joint])
        return out

    # The determinant

    def factors(self) -> tuple[list[float], list[Named]]:
        """Factor by the distance of the centre from the parallel axes' plane, and the motion of the two other joints.

        The parallel axes do not turn about m, across n and axis 5, and move the centre across n only: the other two
        joints lift it along n.
        """
        named = ("elbow", self._elbow), ("shoulder", self._shoulder)
        return [], [(name, fitted_factor(value, self.axes.prismatic, (1, 2, 3))) for name, value in named]

    def _elbow(self, joints: Array) -> Array:
        """Return twice the area ``(n,)`` of the triangle of the parallel axes and the centre, at joints ``(n, 5)``."""
        moves, turns = self._motions(joints)
        first, second = self.pair
        return np.asarray((np.cross(moves[first], moves[second]) * turns[first]).sum(axis=1))

    def _shoulder(self, joints: Array) -> Array:
        """Return the lift of the centre by joint 4 and the third one, where together they do not turn about m."""
        moves, turns = self._motions(joints)
        n = turns[self.pair[0]]
        m = np.cross(n, turns[4])
        third, fourth = ([(part * along).sum(axis=1) for part, along in ((turns[joint], m), (moves[joint], n))]
                         for joint in (self.third, 3))  # fmt: skip
        return np.asarray(third[0] * fourth[1] - fourth[0] * third[1])

    def _motions(self, joints: Array) -> tuple[Array, Array]:
        """Return velocities of the centre and of the rotation by each joint, at ``(n, 5)``: ``(5, n, 3)`` each."""
        axes, moved = self.axes, np.broadcast_to(np.eye(4), (len(joints), 4, 4))
        places, turns = [], []
        for joint, amount in enumerate((joints * self.axes.sign).T):
            places.append(moved[:, :3, :3] @ axes.origins[joint] + moved[:, :3, 3])
            turns.append(moved[:, :3, :3] @ axes.directions[joint])
            moved = moved @ self._turned(joint, amount)
        end = se3.transform(axes.T_frame0_last, self.centre[None])[0]
        return np.cross(turns, moved[:, :3, :3] @ end + moved[:, :3, 3] - np.array(places)), np.array(turns)

    def moved(self, backwards: bool) -> str:
        seen = "axis 1, seen from the last frame," if backwards else "axis 5"
        return f"the displacements of a point of {seen} and the turn across it and the parallel axes"

    def rows(self, jacobian: Array) -> Array:
        """Return the place, and the turn about m, across axis 5 and the parallel axes, for joints 1 to 4."""
        m = np.cross(jacobian[3:, self.pair[0]], jacobian[3:, 4])
        return np.concatenate([jacobian[:3, :4], (m @ jacobian[3:, :4])[None]])


def _circle(count: int) -> Array:
    """Return 1, cosine and sine ``(3, count)`` of angles evenly spread over a turn."""
    nodes = 2 * np.pi * np.arange(count) / count
    return np.stack([np.ones(count), np.cos(nodes), np.sin(nodes)])


def _angles(polynomial: NDArray[np.complex128]) -> Array:
    """Return the roots ``(2 d, n)`` of trigonometric polynomials ``(d + 1, n)``; off the unit circle the angle."""
    return np.angle(polynomial_roots(np.concatenate([polynomial[:0:-1].conj(), polynomial])))


def _turning(axis: Array) -> Array:
    """Split a rotation about an axis into its constant, cosine and sine parts ``(3, 3, 3)``."""
    along = np.outer(axis, axis)
    return np.stack([along, np.eye(3) - along, se3.skew(axis)])


def _turn_between(axis: Array, start: Array, end: Array) -> Array:
    """Return turns ``(...)`` about an axis that bring a direction ``(3,)`` nearest to others ``(..., 3)``."""
    along, ahead = start - (start @ axis) * axis, np.cross(axis, start)
    return np.asarray(np.arctan2(end @ ahead, end @ along))


_ON_AXIS = 1e-6  # m: so near to a hinge's axis the place hardly determines its turn


@dataclass(frozen=True)
class _TwoAxisWrist:
    """Five joints of which 4 and 5 are hinges whose axes meet in a point P: a wrist without its last axis.

    Attributes:
        carrier: joints 1 to 3, where they are a classical carrier; ``three`` what else they are.
        start: P ``(3,)`` m in frame 0 at zero joint positions, and ``centre`` in the last frame.
    """

    axes: Axes
    carrier: Carrier | None
    three: ThreeJoints
    start: Array
    centre: Array
    repeats: bool = False

    @classmethod
    def of(cls, axes: Axes) -> "_TwoAxisWrist | None":
        """Return the shape of an arm of five joints; None where it is another."""
        if any(axes.prismatic[3:]) or axes.parallel(3, 4):
            return None
        start, missed = meeting_point(axes.origins[3:], axes.directions[3:])
        if missed > EXACT:
            return None
        three = ThreeJoints.by_axes(axes.first(3), start)
        if three is None:
            return None
        carrier = carrier_of(axes, start)
        centre = se3.transform(se3.inverse(axes.T_frame0_last), start[None])[0]
        return cls(axes, carrier, three, start, centre)

    @property
    def roots(self) -> int:
        return self.three.branches if self.carrier is None else 2 * self.carrier.elbows

    def candidates(self, Ts: Array, preferred: Array) -> Iterator[Candidates]:
        """Poses with P on a hinge's axis get more candidates."""
        place = (Ts[:, :3, :3] @ self.centre + Ts[:, :3, 3]).T
        first, free = self._placed(place, preferred[:3])  # (k, 3, n)
        found, near = self._with_wrist(Ts, first)
        if not near.any():
            yield slice(None), found, _never_free(free)
            return
        away, there = np.flatnonzero(~near), np.flatnonzero(near)
        yield away, found[..., away], _never_free(free[..., away])
        R = self._last_rotations(Ts[there])
        first, free = self._by_rotation(R, first[..., there], free[..., there])
        yield there, self._wrist(R, first), _never_free(free)

    def _wrist(self, R: Array, first: Array) -> Array:
        """Return candidates ``(k, 5, n)`` for their first three joints: axis 4 turns axis 5, which turns the rest."""
        back = self._turned(first).swapaxes(2, 3) @ R  # (k, n, 3, 3)
        a4, a5 = self.axes.directions[3:]
        fourth = turn_between(a4, np.broadcast_to(a5, back.shape[:-1]), back @ a5)
        left = se3.exp(-fourth[..., None] * a4) @ back
        fifth = turn_between(a5, np.broadcast_to(self._across, back.shape[:-1]), left @ self._across)
        return np.concatenate([first, fourth[:, None], fifth[:, None]], axis=1)

    @property
    def _across(self) -> Array:
        a5 = self.axes.directions[4]
        return np.asarray(np.cross(a5, np.eye(3)[np.argmin(np.abs(a5))]))

    def _last_rotations(self, Ts: Array) -> Array:
        """Return rotations ``(n, 3, 3)`` of the last link from its orientation at zero joint positions."""
        return np.asarray(Ts[:, :3, :3] @ self.axes.T_frame0_last[:3, :3].T)

    def _with_wrist_by_numpy(self, Ts: Array, first: Array) -> tuple[Array, NDArray[np.bool_]]:
        return self._wrist(self._last_rotations(Ts), first), self._near(first)

    @with_fallback(_with_wrist_by_numpy)
    def _with_wrist(self, Ts: Array, first: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return candidates ``(k, 5, n)`` for first three joints, and where P is on a hinge's axis ``(n,)``."""
        return two_axes(self._numbers, Ts, first)

    @cached_property
    def _numbers(self) -> Array:
        """Arm parameters of the compiled wrist."""
        back, axes = self.axes.T_frame0_last[:3, :3].T, self.axes
        vectors = (self.start, back @ axes.directions[4], back @ self._across, self._across)
        parts = (axes.prismatic[:3], axes.directions, axes.origins[:3], *vectors)
        return np.concatenate([np.ravel(part).astype(np.float64) for part in parts])

    def _placed(self, place: Array, preferred: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Solve joints 1 to 3 ``(k, 3, n)`` that bring P to places ``(3, n)``."""
        count = place.shape[1]
        if self.carrier is not None:
            shape = (1, self.carrier.elbows, 2, count)
            angles, gap, free = np.empty((3, *shape)), np.empty(shape), np.zeros((3, *shape), dtype=np.bool_)
            self.carrier.solve(place, preferred, angles, gap, free)
            return angles.reshape(3, -1, count).swapaxes(0, 1), free.reshape(3, -1, count).swapaxes(0, 1)
        Ts = se3.pose(np.broadcast_to(np.eye(3), (count, 3, 3)), place.T - self.start)
        sign = self.three.axes.sign
        found = self.three.solve(Ts, preferred.T * sign, nearest=False)
        return (found.joints * sign).transpose(1, 2, 0), found.free.transpose(1, 2, 0)

    def _by_rotation(self, R: Array, first: Array, free: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        """Add candidates where P is on a hinge's axis: that hinge by the angle between axes 4 and 5."""
        a4, a5 = self.axes.directions[3:]
        for joint in (0, 1):
            if self.axes.prismatic[joint] or not (near := self._on_axis(joint, first)).any():
                continue
            before, after = (self._turned(first, span) for span in (range(joint), range(joint + 1, 3)))
            axis = self.axes.directions[joint]
            carried, wanted = after @ a4, before.swapaxes(2, 3) @ R @ a5
            level = wanted - (wanted @ axis)[..., None] * axis
            x = -(np.cross(axis, wanted) * carried).sum(axis=-1)
            z = float(a4 @ a5) - (wanted @ axis) * (carried @ axis)
            (roots,), _, (still,) = type_2(x, (level * carried).sum(axis=-1), z, TINY, first[:, joint])
            more = np.stack([first, first])
            more[:, :, joint] = np.where(near, roots, more[:, :, joint])
            flags = np.stack([free, free])
            flags[:, :, joint] &= still | ~near
            first = np.concatenate([first, *more])
            free = np.concatenate([free, *flags])
        return first, free

    def _near(self, first: Array) -> NDArray[np.bool_]:
        """Mark poses ``(n,)`` with P on the axis of a hinge in a candidate."""
        near = np.zeros(first.shape[2], dtype=np.bool_)
        for joint in (0, 1):
            if not self.axes.prismatic[joint]:
                near |= self._on_axis(joint, first).any(axis=0)
        return near

    def _on_axis(self, joint: int, first: Array) -> NDArray[np.bool_]:
        """Mark ``(k, n)`` where P, carried by the joints after it, is on a hinge's axis."""
        at = np.broadcast_to(self.start[:, None], (3, first.shape[0] * first.shape[2]))
        rows = first.transpose(1, 0, 2).reshape(3, -1)
        for each in range(2, joint, -1):
            at = self.axes.carried(each, rows[each], at)
        lever = at - self.axes.origins[joint][:, None]
        off = np.linalg.norm(np.cross(self.axes.directions[joint], lever, axisb=0), axis=1)
        return np.asarray((off < _ON_AXIS).reshape(first.shape[0], -1))

    def _turned(self, first: Array, span: range = range(3)) -> Array:
        """Return rotations ``(k, n, 3, 3)`` by some joints."""
        R = np.broadcast_to(np.eye(3), (first.shape[0], first.shape[2], 3, 3))
        for joint in span:
            if not self.axes.prismatic[joint]:
                R = R @ se3.exp(first[:, joint, :, None] * self.axes.directions[joint])
        return np.asarray(R)

    def factors(self) -> tuple[list[float], list[Named]]:
        found = self.three.determinant
        return list(found.lengths), [(each.name, each.terms) for each in found.factors]

    def moved(self, backwards: bool) -> str:
        meet = "axes 1 and 2 meet, seen from the last frame" if backwards else "axes 4 and 5 meet"
        return f"the displacements of where {meet}"

    def rows(self, jacobian: Array) -> Array:
        return jacobian[:3, :3]


def _never_free(free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Extend free joints ``(k, 5, n)`` by the last two, which are never free."""
    return np.concatenate([free, np.zeros_like(free[:, :2])], axis=1)


_REACHED = 1e-11
_SAME = 1e-7
_CHUNK = 4096  # poses at a time: what fits the processor's cache


_Shape = PlanarMiddle | PlanarEnd | _TwoAxisWrist | _ParallelPair  # ``PlanarMiddle`` describes their methods


@dataclass(frozen=True)
class FiveAxes:
    """An arm of five joints with a closed form.

    Attributes:
        backwards: whether the shape is that of the arm fixed at its last frame.
    """

    chain: Chain
    arm: SerialArm
    shape: _Shape
    backwards: bool
    by_point: bool = False
    exact_only: bool = True
    numbered: bool = False

    @classmethod
    def of(cls, chain: Chain) -> "FiveAxes | None":
        """Return the closed form of a nominal model; None where its shape has none."""
        if chain.size != 5:
            return None
        forwards = Axes.of(chain)
        for kinds in ((PlanarMiddle, PlanarEnd, _TwoAxisWrist), (_ParallelPair,)):
            for backwards, fixed in ((False, forwards), (True, forwards.backwards)):
                shapes: Iterator[_Shape | None] = (kind.of(fixed) for kind in kinds)
                shape = next((each for each in shapes if each is not None), None)
                if shape is not None:
                    return cls(chain, SerialArm(chain), shape, backwards)
        return None

    @property
    def branches(self) -> int:
        """Largest number of solutions for a pose."""
        return self.shape.roots

    @property
    def determinant(self) -> Determinant:
        """Determinant of the place of the shape's centre and of the rotations its moving joints produce beside it.

        For an arm fixed at its last frame, the place is that of the centre in that frame.
        """
        lengths, factors = self.shape.factors()
        axes = self.shape.axes
        if self.backwards:
            factors = [
                (name, [replace(t, angle=tuple((4 - j, s) for j, s in t.angle), slides=tuple(4 - j for j in t.slides))
                        for t in terms])
                for name, terms in factors
            ]  # fmt: skip
        plain = determinant(self.chain.joint_names, 1.0, lengths, factors)
        joints = rng_for(0, "structure").uniform(-1.0, 1.0, 5)
        reordered = joints[::-1] if self.backwards else joints
        value = np.linalg.det(self.shape.rows(axes.jacobian(reordered, self.shape.centre)))
        return determinant(self.chain.joint_names, float(np.sign(value * plain.at(joints))), lengths, factors)

    @property
    def moved(self) -> str:
        """Description of the determinant's motions."""
        return f"{self.shape.moved(self.backwards)}; the other joints turn the rest"

    def nearest_rotations(self, Rs_frame0_last: Array) -> Array:
        """See ``ClosedForm``: the nearest rotation depends on the place, so that rotations stay unchanged."""
        return Rs_frame0_last

    def solve(self, Ts_frame0_last: Array, reference: Array | float = 0.0) -> Solutions:
        """See ``ClosedForm``. Poses that the arm cannot take get the gap and the tilt of candidates."""
        count, shape = len(Ts_frame0_last), (len(Ts_frame0_last), self.branches)
        preferred = np.broadcast_to(reference, (count, 5)) * self.chain.sign
        frees = np.empty((*shape, 5), dtype=np.bool_)
        whole = Solutions(np.empty((*shape, 5)), np.empty(shape), np.empty(shape), frees)
        for start in range(0, count, _CHUNK):
            part = slice(start, start + _CHUNK)
            Ts, near = Ts_frame0_last[part], preferred[part]
            targets = (se3.inverse(Ts), near[:, ::-1].T) if self.backwards else (Ts, near.T)
            for rows, joints, free in self.shape.candidates(*targets):
                found = self._judged(Ts[rows], joints.transpose(2, 0, 1), free.transpose(2, 0, 1))
                for name in ("joints", "gap_m", "tilt_rad", "free"):
                    getattr(whole, name)[part][rows] = getattr(found, name)
        return whole

    def _judged(self, Ts: Array, joints: Array, free: NDArray[np.bool_]) -> Solutions:
        """Polish candidates ``(n, k, 5)`` of poses ``(n, 4, 4)``, and return the solutions among them."""
        if self.backwards:
            joints, free = joints[:, :, ::-1], free[:, :, ::-1]
        joints, off = self.arm.settle(self._values, Ts, joints * self.chain.sign)
        return self._best(joints, off, free)

    @cached_property
    def _values(self) -> Array:
        """The arm's parameters, with the target in the last frame's origin."""
        return self.arm.nominal({self.arm.targets[0]: np.zeros(3)})

    def _best(self, joints: Array, off: Array, free: NDArray[np.bool_]) -> Solutions:
        """Return the ``branches`` nearest candidates, with their errors; repeated ones count once."""
        count, many = joints.shape[:2]
        gap, tilt, size = off[..., 0], off[..., 1], off.max(axis=2)
        meets = size <= np.where(size.min(axis=1, keepdims=True) <= _REACHED, _REACHED, EXACT)  # EXACT at singularities
        gap, tilt = np.where(meets, 0.0, gap), np.where(meets, 0.0, tilt)
        few = many <= self.branches
        if few and not self.shape.repeats:
            return Solutions(joints, gap, tilt, free)
        some = np.flatnonzero(meets.sum(axis=1) > 1) if few else np.arange(count)
        order = np.argsort(size[some], axis=1, kind="stable")  # of two equal ones the better one counts
        again = np.zeros((some.size, many), dtype=np.bool_)
        np.put_along_axis(again, order, self._again(np.take_along_axis(joints[some], order[..., None], axis=1)), axis=1)
        gap[some] = np.where(again, np.inf, gap[some])
        if few:
            return Solutions(joints, gap, tilt, free)
        rows = np.arange(count)[:, None]
        nearest = np.lexsort((size, again), axis=1)[:, : self.branches]
        return Solutions(joints[rows, nearest], gap[rows, nearest], tilt[rows, nearest], free[rows, nearest])

    def _again(self, joints: Array) -> NDArray[np.bool_]:
        """Mark candidates ``(n, k, 5)`` that repeat an earlier one, up to whole turns."""
        turns, again = np.where(self.chain.prismatic, 0.0, 2 * np.pi), np.zeros(joints.shape[:2], dtype=np.bool_)
        for i in range(1, joints.shape[1]):
            between = joints[:, :i] - joints[:, i : i + 1]
            between = np.abs(between - turns * np.round(between / (2 * np.pi))).max(axis=2)
            again[:, i] = (between < _SAME).any(axis=1)
        return again
