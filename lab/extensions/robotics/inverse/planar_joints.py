"""Two or three joints that move in a plane, hinges across it and slides in it: all their positions for a place.

Vectors in the plane are complex numbers, and a hinge multiplies what comes after it by exp(i angle). The place of a
point is then an anchor, plus a length turned by each hinge, plus each slide's way turned by the hinges before it.
Where three joints are given a turn as well, the last hinge is what is left of it, and two unknowns remain: two hinges
(an equation of type 8), a hinge and a slide that it turns (type 5), a hinge and a slide beside it (types 10 and 1), or
two slides (Khalil & Dombre 2002, table 4.1).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.extensions.robotics.inverse.first_joint import Named
from lab.extensions.robotics.inverse.first_three_joints import BEND, slid
from lab.extensions.robotics.inverse.khalil_one_unknown import ROUNDING, TINY, type_10, unless_tiny
from lab.extensions.robotics.inverse.khalil_two_unknowns import type_8
from lab.kinematics.inverse.closed_form import EXACT, Axes, Term, in_plane, real_part

__all__ = ["PlanarJoints"]

Complex = NDArray[np.complex128]
_Pair = tuple[Array, Array, Array, NDArray[np.bool_], NDArray[np.bool_]]  # two unknowns, the gap, and which are free


@dataclass(frozen=True)
class PlanarJoints:
    """Such joints at zero joint positions; angles and ways here are along their axes.

    Attributes:
        joints: which of the arm's they are.
        turning: of each 1 where a hinge's axis points as the plane's normal does, else -1; 1 of a slide.
        places: of each hinge (m), from the plane's origin; ``ways`` of each slide, of unit length.
        hand: the point that is brought somewhere (m).
        turned: whether a turn is asked for beside the place.
    """

    joints: tuple[int, ...]
    prismatic: tuple[bool, ...]
    turning: tuple[float, ...]
    places: tuple[complex, ...]
    ways: tuple[complex, ...]
    hand: complex
    turned: bool

    @classmethod
    def of(
        cls, axes: Axes, joints: tuple[int, ...], plane: Array, hand: Array, origin: Array | float = 0.0
    ) -> "PlanarJoints | None":
        """Some joints of an arm, if they move in a plane (rows e, f, its normal) and bring a point anywhere there.

        Args:
            hand: the point ``(3,)`` m in frame 0; ``origin`` the plane's.
        """
        normal = plane[2]
        for joint in joints:
            direction = axes.directions[joint]
            across = np.linalg.norm(np.cross(direction, normal))
            if (abs(float(direction @ normal)) if axes.prismatic[joint] else float(across)) > EXACT:
                return None
        slides = tuple(axes.prismatic[joint] for joint in joints)
        if len(joints) not in (2, 3) or (len(joints) == 3 and all(slides)):
            return None
        turning = tuple(1.0 if axes.prismatic[j] else float(np.sign(axes.directions[j] @ normal)) for j in joints)
        places = tuple(in_plane(plane, axes.origins[j] - origin) for j in joints)
        ways = tuple(in_plane(plane, axes.directions[j]) for j in joints)
        made = cls(joints, slides, turning, places, ways, in_plane(plane, hand - origin), len(joints) == 3)
        lengths = [] if len(made._slides) == 1 and made._after(made._slides[0]) == 1 else map(abs, made._lengths)
        still = len(made._slides) == 2 and not made._between and _parallel(*(made.ways[i] for i in made._slides))
        return None if min(lengths, default=1.0) < EXACT or still else made

    # What the joints are

    @cached_property
    def _hinges(self) -> tuple[int, ...]:
        return tuple(i for i, slides in enumerate(self.prismatic) if not slides)

    @cached_property
    def _slides(self) -> tuple[int, ...]:
        return tuple(i for i, slides in enumerate(self.prismatic) if slides)

    @cached_property
    def _ends(self) -> tuple[complex, ...]:
        """The hinges' places, and the hand's."""
        return (*(self.places[i] for i in self._hinges), self.hand)

    @cached_property
    def _lengths(self) -> tuple[complex, ...]:
        """Those that unknown hinges turn."""
        every = [b - a for a, b in zip(self._ends, self._ends[1:], strict=False)]
        return tuple(every[:-1] if self.turned else every)

    @property
    def _between(self) -> bool:
        """Whether a hinge stands between two slides."""
        return len(self._slides) == 2 and self._slides[1] - self._slides[0] == 2

    def _after(self, slide: int) -> int:
        """How many hinges turn a slide."""
        return sum(hinge < slide for hinge in self._hinges)

    @property
    def roots(self) -> int:
        """How many solutions there are."""
        return 1 if len(self._slides) == 2 else 2

    # Their positions

    def solve(self, place: Complex, turn: Array | None, liked: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """All positions that bring the hand to places ``(...)``, turned by ``turn`` where that is asked for.

        Args:
            liked: ``(joints, ...)`` what free joints take.

        Returns:
            Positions ``(roots, joints, ...)``, the gap ``(...)`` m, and what is free ``(joints, ...)``.
        """
        rest = place - self._ends[0]
        last = np.zeros_like(place.real) if turn is None else turn
        if self.turned:
            rest = rest - np.exp(1j * last) * (self._ends[-1] - self._ends[-2])
        size = np.abs(place) + sum(map(abs, self._lengths), start=1e-3)
        pair = self._two_slides if len(self._slides) == 2 else self._one_slide if self._slides else self._no_slide
        first, second, gap, free_1, free_2 = pair(rest, last, liked, size)
        values = np.empty((self.roots, len(self.joints), *place.shape))
        free = np.zeros((len(self.joints), *place.shape), dtype=np.bool_)
        unknown = [*self._hinges[: len(self._lengths)], *self._slides]
        if not self._slides:  # two turns: of the first hinge, and of both
            values[:, unknown[0]], values[:, unknown[1]] = first, second - first
        else:
            values[:, unknown[0]], values[:, unknown[1]] = first, second
        free[unknown[0]], free[unknown[1]] = free_1, free_2
        if self.turned:
            others = [i for i in self._hinges if i != self._hinges[-1]]
            values[:, self._hinges[-1]] = last - values[:, others].sum(axis=1)
        return values * np.reshape(self.turning, (-1, *(1,) * place.ndim)), gap, free

    def _no_slide(self, rest: Complex, last: Array, liked: Array, size: Array) -> _Pair:
        """Two hinges: a triangle."""
        (x, y), hinge = self._lengths, self._hinges[0]
        bent, bent_2 = float(np.angle(x)), float(np.angle(y))
        favourite = liked[hinge] * self.turning[hinge] + bent
        (root, elbow), gap, (free, _) = type_8(abs(x), abs(y), rest.real, rest.imag, TINY, (favourite, 0.0), BEND)
        return root - bent, root + elbow - bent_2, gap, free, np.zeros_like(free)

    def _one_slide(self, rest: Complex, last: Array, liked: Array, size: Array) -> _Pair:
        """A hinge and a slide: a line across a circle."""
        hinge, slide, (length,) = self._hinges[0], self._slides[0], self._lengths
        way, favourite = self.ways[slide], liked[hinge] * self.turning[hinge]
        if self._after(slide) == 1:
            turned = rest * np.conj(way)
            roots = slid(turned.real, turned.imag, length * way.conjugate(), favourite, liked[slide])
            (turn, way_out), (turn_free, out_free) = roots.values, roots.free
            return turn, way_out, roots.gap, turn_free, out_free
        along = way * np.exp(1j * last) if self._after(slide) == 2 else np.broadcast_to(way, rest.shape)
        seen, start = rest * np.conj(along), np.angle(length * np.conj(along))
        (angle,), gap, (free,) = type_10(abs(length), seen.imag, TINY, favourite + start)
        gap = np.where(np.abs(seen.imag) - abs(length) <= ROUNDING * size, 0.0, gap)
        return angle - start, seen.real - abs(length) * np.cos(angle), gap, free, np.zeros_like(free)

    def _two_slides(self, rest: Complex, last: Array, liked: Array, size: Array) -> _Pair:
        """Two slides: a parallelogram, of which one side is as it is liked where they are parallel."""
        first, second = (
            self.ways[i] * np.exp(1j * last) if self._after(i) else np.broadcast_to(self.ways[i], rest.shape)
            for i in self._slides
        )
        across = np.imag(np.conj(first) * second)
        free = np.abs(across) <= TINY
        b = np.where(free, liked[self._slides[1]], np.imag(np.conj(first) * rest) / np.where(free, 1.0, across))
        left = np.conj(first) * (rest - b * second)
        gap = unless_tiny(np.where(free, np.abs(left.imag), 0.0), ROUNDING * size)
        return left.real[None], b[None], gap, free, free

    # Where they are singular

    def factors(self, sign: Array) -> tuple[list[float], list[Named]]:
        """Of the determinant of place and turn by these joints, but for its sign: lengths (m), and named factors.

        Args:
            sign: ``(n,)`` of all joint positions of the arm.
        """

        def angle(i: int) -> tuple[int, float]:
            return self.joints[i], float(self.turning[i] * sign[self.joints[i]])

        if not self._slides:
            (x, y), second = self._lengths, self._hinges[1]
            return [abs(x)], [("elbow", real_part(-1j * x.conjugate() * y / abs(x), [angle(second)])[::-1])]
        way = self.ways[self._slides[0]]
        if len(self._slides) == 2:
            other = self.ways[self._slides[1]]
            across = -1j * way.conjugate() * other
            if not self._between:
                return [abs(across.real)], []
            return [], [("slides", real_part(across, [angle(self._hinges[0])]))]
        (length,), slide, hinge = self._lengths, self._slides[0], self._hinges[0]
        joint = self.joints[slide]
        if self._after(slide) == 1:
            return [], [("slide", [Term(float(sign[joint]), slides=(joint,)), Term((length * way.conjugate()).real)])]
        if self._after(slide) == 0:
            return [], [("slide", real_part(way.conjugate() * length, [angle(hinge)]))]
        return [], [("slide", real_part(way * length.conjugate(), [angle(self._hinges[1])]))]

    def place_along(self, direction: complex, sign: Array) -> list[Term]:
        """Of the hand's place the part along a direction: Re(conj(direction) place)."""
        level, terms = direction.conjugate(), list[Term]()
        turned, ends = list[tuple[int, float]](), list(self._ends)
        terms += real_part(level * ends[0], [])
        for i, slides in enumerate(self.prismatic):
            joint = self.joints[i]
            if slides:
                terms += real_part(level * self.ways[i] * float(sign[joint]), turned, slides=(joint,))
            else:
                turned = [*turned, (joint, float(self.turning[i] * sign[joint]))]
                k = self._hinges.index(i)
                terms += real_part(level * (ends[k + 1] - ends[k]), turned)
        return terms


def _parallel(a: complex, b: complex) -> bool:
    return abs((a.conjugate() * b).imag) <= EXACT
