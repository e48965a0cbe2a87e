"""Arms of five joints: all solutions of the poses that they can take, and where others come near, starts for a search.

A pose has six freedoms, and five joints give it five. The shapes that are known here are a planar arm between two
joints (``five_axes_planar``: two or three parallel axes), a planar arm after two joints (``five_axes_planar_end``), a
wrist of two axes that meet on any three joints (``five_axes_wrist``), and hinges of which two neighbouring axes are
parallel (``five_axes_pair``); and all held the other way round, at the last frame, which puts the two meeting axes, the
planar arm or the pair at the base's end. Each gives candidates by the equations
that it needs; those that meet the whole pose, to rounding after a few steps of Gauss and Newton, are its solutions.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.robotics.inverse.first_joint import Named
from lab.extensions.robotics.inverse.five_axes_pair import ParallelPair
from lab.extensions.robotics.inverse.five_axes_planar import PlanarMiddle
from lab.extensions.robotics.inverse.five_axes_planar_end import PlanarEnd
from lab.extensions.robotics.inverse.five_axes_wrist import TwoAxisWrist
from lab.kinematics.inverse.closed_form import EXACT, Axes, Candidates, Determinant, Solutions, determinant
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.chain import Chain

__all__ = ["FiveAxes"]

_STEPS = 4
_NEAR = 1e-2  # of a pose (m, rad): a candidate farther off is no solution
_EXACTLY = 1e-13
_REACHED = 1e-11
_SAME = 1e-7
_CHUNK = 4096  # poses at a time: what fits the processor's cache


class Shape(Protocol):
    """What five joints are, and the equations that follow from it."""

    @property
    def axes(self) -> Axes:
        """The joints'."""

    @property
    def roots(self) -> int:
        """How many candidates a pose has."""

    @property
    def repeats(self) -> bool:
        """Whether a few steps may lead two candidates of any pose to one solution."""

    @property
    def centre(self) -> Array:
        """The point ``(3,)`` of the last frame (m) that the determinant is of."""

    def candidates(self, Ts: Array, liked: Array) -> Iterator[Candidates]:
        """Candidates for poses ``(n, 4, 4)``, those together that have as many.

        Args:
            liked: ``(5, n)`` what free joints take.
        """

    def factors(self) -> tuple[list[float], list[Named]]:
        """Of the determinant, but for its sign: lengths (m), and named factors."""

    def moved(self, backwards: bool) -> str:
        """What motions the determinant is of, for an arm that is held at its base or at its last frame."""

    def rows(self, jacobian: Array) -> Array:
        """The square part of a Jacobian ``(6, 5)`` of the centre, whose determinant it is."""


@dataclass(frozen=True)
class FiveAxes:
    """An arm of five joints with a closed form.

    Attributes:
        backwards: whether the shape is that of the arm held at its last frame.
    """

    chain: Chain
    arm: SerialArm
    shape: Shape
    backwards: bool
    by_point: bool = False
    exact_only: bool = True
    numbered: bool = False

    @classmethod
    def of(cls, chain: Chain) -> "FiveAxes | None":
        """The closed form of a nominal model; None where its shape has none."""
        if chain.size != 5:
            return None
        forwards = Axes.of(chain)
        for kinds in ((PlanarMiddle, PlanarEnd, TwoAxisWrist), (ParallelPair,)):
            for backwards, held in ((False, forwards), (True, forwards.backwards)):
                shapes: Iterator[Shape | None] = (kind.of(held) for kind in kinds)
                shape = next((each for each in shapes if each is not None), None)
                if shape is not None:
                    return cls(chain, SerialArm(chain), shape, backwards)
        return None

    @property
    def branches(self) -> int:
        """How many solutions a pose has at most."""
        return self.shape.roots

    @property
    def determinant(self) -> Determinant:
        """Of the place of the shape's centre and of what of the rotation the joints that move it take beside it.

        Of an arm held at its last frame the place is that of the centre in that frame.
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
        held = joints[::-1] if self.backwards else joints
        value = np.linalg.det(self.shape.rows(axes.jacobian(held, self.shape.centre)))
        return determinant(self.chain.joint_names, float(np.sign(value * plain.at(joints))), lengths, factors)

    @property
    def moved(self) -> str:
        """What motions the determinant is of."""
        return f"{self.shape.moved(self.backwards)}; the other joints turn the rest"

    def nearest_rotations(self, Rs_frame0_last: Array) -> Array:
        """See ``ClosedForm``: which rotations are near depends on the place, so that they are left as they are."""
        return Rs_frame0_last

    def solve(self, Ts_frame0_last: Array, reference: Array | float = 0.0) -> Solutions:
        """See ``ClosedForm``. Of poses that the arm cannot take the gap and the tilt are those of candidates."""
        count, shape = len(Ts_frame0_last), (len(Ts_frame0_last), self.branches)
        liked = np.broadcast_to(reference, (count, 5)) * self.chain.sign
        whole = Solutions(
            np.empty((*shape, 5)), np.empty(shape), np.empty(shape), np.empty((*shape, 5), dtype=np.bool_)
        )
        for start in range(0, count, _CHUNK):
            part = slice(start, start + _CHUNK)
            Ts, near = Ts_frame0_last[part], liked[part]
            held = (se3.inverse(Ts), near[:, ::-1].T) if self.backwards else (Ts, near.T)
            for rows, joints, free in self.shape.candidates(*held):
                found = self._judged(Ts[rows], joints.transpose(2, 0, 1), free.transpose(2, 0, 1))
                for name in ("joints", "gap_m", "tilt_rad", "free"):
                    getattr(whole, name)[part][rows] = getattr(found, name)
        return whole

    def _judged(self, Ts: Array, joints: Array, free: NDArray[np.bool_]) -> Solutions:
        """The solutions of poses ``(n, 4, 4)`` among candidates ``(n, k, 5)``, made exact."""
        if self.backwards:
            joints, free = joints[:, :, ::-1], free[:, :, ::-1]
        compiled = self.arm.compiled(joints, Ts)
        if compiled is None:
            joints, off = self._settled(Ts, joints * self.chain.sign)
        else:
            joints, off = compiled.settle(self._values, Ts, joints * self.chain.sign)
        return self._best(joints, off, free)

    def _missing(self, Ts: Array, joints: Array) -> tuple[Array, Array]:
        """What is missing ``(m, 6)`` from poses ``(m, 4, 4)``, and the Jacobians ``(m, 6, 5)``."""
        there, jacobian = self.arm.tool(joints, self._values)
        turned = se3.log(Ts[:, :3, :3] @ there[:, :3, :3].swapaxes(1, 2))
        return np.concatenate([Ts[:, :3, 3] - there[:, :3, 3], turned], axis=1), jacobian

    def _settled(self, Ts: Array, joints: Array) -> tuple[Array, Array]:
        """Candidates ``(n, k, 5)`` after a few steps of Gauss and Newton where they are near; none leads away.

        Returns:
            Joint positions, and what they miss ``(n, k, 2)``: m and rad.
        """
        count, many = joints.shape[:2]
        flat, each = joints.reshape(-1, 5).copy(), np.repeat(np.arange(count), many)
        apart = Ts[:, None] - self.arm.flange(flat, self._values).reshape(count, many, 4, 4)
        chord = np.sqrt((apart[..., :3, :3] ** 2).sum(axis=(2, 3)) / 8)  # sin(angle / 2)
        off = np.stack([np.sqrt((apart[..., :3, 3] ** 2).sum(axis=2)), 2 * np.arcsin(np.minimum(chord, 1.0))], axis=2)
        size = off.reshape(-1, 2)
        rows = np.flatnonzero((size.max(axis=1) < _NEAR) & (size.max(axis=1) > _EXACTLY))
        missing, jacobian = self._missing(Ts[each[rows]], flat[rows])
        for _ in range(_STEPS):
            if not rows.size:
                break
            normal = jacobian.swapaxes(1, 2) @ jacobian
            normal[:, range(5), range(5)] += 1e-15 * np.trace(normal, axis1=1, axis2=2)[:, None]
            step = np.linalg.solve(normal, jacobian.swapaxes(1, 2) @ missing[:, :, None])[:, :, 0]
            left, ahead = self._missing(Ts[each[rows]], flat[rows] + step)
            better = np.linalg.norm(left, axis=1) < np.linalg.norm(missing, axis=1)
            rows, missing, jacobian = rows[better], left[better], ahead[better]
            flat[rows] += step[better]
            size[rows] = np.linalg.norm(missing.reshape(-1, 2, 3), axis=2)
            going = np.abs(missing).max(axis=1) > _EXACTLY
            rows, missing, jacobian = rows[going], missing[going], jacobian[going]
        hinges = ~np.array(self.chain.prismatic)
        flat[:, hinges] -= 2 * np.pi * np.round(flat[:, hinges] / (2 * np.pi))
        return flat.reshape(joints.shape), off

    @cached_property
    def _values(self) -> Array:
        """The arm's parameters, with the last frame's origin for a target."""
        return self.arm.nominal({self.arm.targets[0]: np.zeros(3)})

    def _best(self, joints: Array, off: Array, free: NDArray[np.bool_]) -> Solutions:
        """The ``branches`` nearest candidates, with what they miss; those that are twice there count once."""
        count, many = joints.shape[:2]
        gap, tilt, size = off[..., 0], off[..., 1], off.max(axis=2)
        meets = size <= np.where(size.min(axis=1, keepdims=True) <= _REACHED, _REACHED, EXACT)  # EXACT at singularities
        gap, tilt = np.where(meets, 0.0, gap), np.where(meets, 0.0, tilt)
        few = many <= self.branches
        if few and not self.shape.repeats:
            return Solutions(joints, gap, tilt, free)
        some = np.flatnonzero(meets.sum(axis=1) > 1) if few else np.arange(count)
        order = np.argsort(size[some], axis=1, kind="stable")  # of two that are the same the better one counts
        again = np.zeros((some.size, many), dtype=np.bool_)
        np.put_along_axis(again, order, self._again(np.take_along_axis(joints[some], order[..., None], axis=1)), axis=1)
        gap[some] = np.where(again, np.inf, gap[some])
        if few:
            return Solutions(joints, gap, tilt, free)
        rows = np.arange(count)[:, None]
        kept = np.lexsort((size, again), axis=1)[:, : self.branches]
        return Solutions(joints[rows, kept], gap[rows, kept], tilt[rows, kept], free[rows, kept])

    def _again(self, joints: Array) -> NDArray[np.bool_]:
        """Which of candidates ``(n, k, 5)`` are one of those before, but for whole turns."""
        turns, again = np.where(self.chain.prismatic, 0.0, 2 * np.pi), np.zeros(joints.shape[:2], dtype=np.bool_)
        for i in range(1, joints.shape[1]):
            between = joints[:, :i] - joints[:, i : i + 1]
            between = np.abs(between - turns * np.round(between / (2 * np.pi))).max(axis=2)
            again[:, i] = (between < _SAME).any(axis=1)
        return again
