"""The first three joints of an arm with a spherical wrist: what joint positions bring the wrist's centre somewhere.

Joint 1 turns all the rest about a column (``column``). Then follow

* an ``Elbow``: two hinges with parallel axes (an equation of type 2 for joint 1, of type 8 for the others);
* a ``Telescope``: a hinge, and a slide across it (types 2 and 5);
* a ``Lift``: a slide along the column, and one across it (types 1 and 5).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.extensions.robotics.inverse.first_joint import Carried, FirstJoint, Named, turned_back
from lab.extensions.robotics.inverse.khalil_one_unknown import TINY, Roots, type_1
from lab.extensions.robotics.inverse.khalil_two_unknowns import type_5, type_8
from lab.kinematics.inverse.closed_form import EXACT, Axes, Term, in_plane, plane_across, real_part

__all__ = ["BEND", "Elbow", "Lift", "Telescope", "slid"]

BEND = 0.03  # rad, from the straight elbow: a start for Newton's method where the nominal model does not reach


@dataclass(frozen=True)
class Elbow:
    """Hinges 2 and 3 have parallel axes.

    Attributes:
        turning: 1 where axis 3 points as axis 2 does, else -1.
        shoulder, upper, fore: in the plane (m): axis 2 from the root, axis 3 from axis 2, and the wrist's centre
            from axis 3.
        offset: the wrist's centre from the root, along w (m).
    """

    column: FirstJoint
    turning: float
    shoulder: complex
    upper: complex
    fore: complex
    offset: float
    elbows: int = 2

    @classmethod
    def of(cls, axes: Axes, centre: Array) -> "Elbow | None":
        """The first three joints of a nominal model, if they are such."""
        if any(axes.prismatic[:3]) or axes.parallel(0, 1) or not axes.parallel(1, 2):
            return None
        (_, w, third), (root, second, elbow) = axes.directions[:3], axes.origins[:3]
        plane = plane_across(w)
        shoulder, upper, fore = (in_plane(plane, v) for v in (second - root, elbow - second, centre - elbow))
        if min(abs(upper), abs(fore)) < EXACT:
            return None
        offset = float(w @ (centre - root))
        return cls(FirstJoint.of(axes, plane), float(np.sign(w @ third)), shoulder, upper, fore, offset)

    def solve(self, position: Array, liked: Array, angles: Array, gap: Array, free: NDArray[np.bool_]) -> Carried:
        """See ``Carrier``."""
        split = self.column.split(position - self.column.root[:, None])
        (first,), gap_1, (free[0],) = self.column.facing(split, self.offset, liked[0])
        turned = np.cos(first), np.sin(first)
        e, f, _ = turned_back(split, turned)
        bent = float(np.angle(self.upper))
        (shoulder, elbow), gap_8, (free[1], _) = type_8(
            abs(self.upper), abs(self.fore), e - self.shoulder.real, f - self.shoulder.imag, TINY,
            (liked[1] + bent, 0.0), BEND,
        )  # fmt: skip
        angles[0], angles[1] = first, shoulder - bent
        angles[2] = self.turning * (elbow + bent - np.angle(self.fore))
        gap[:] = np.maximum(gap_1, gap_8)
        lifted = shoulder + elbow - np.angle(self.fore)  # the turn about w of joints 2 and 3 together
        return Carried(self.column, turned, (np.cos(lifted), np.sin(lifted)))

    def factors(self, sign: Array) -> tuple[float, list[float], list[Named]]:
        """See ``Carrier``."""
        second, third = (1, float(sign[1])), (2, float(self.turning * sign[2]))
        across = np.conj(self.upper) * self.fore / abs(self.upper)
        elbow = real_part(-1j * across, [third])[::-1]
        level = np.conj(self.column.level)
        shoulder = [
            *real_part(level * self.shoulder, []),
            *real_part(level * self.upper, [second]),
            *real_part(level * self.fore, [second, third]),
        ]
        return self.turning, [abs(self.upper)], [("elbow", elbow), ("shoulder", shoulder)]


@dataclass(frozen=True)
class Telescope:
    """Joint 2 is a hinge, joint 3 a slide across it, along e.

    Attributes:
        shoulder, upper: in the plane (m): axis 2 from the root, and the wrist's centre from axis 2, drawn in.
        offset: the wrist's centre from the root, along w (m).
    """

    column: FirstJoint
    shoulder: complex
    upper: complex
    offset: float
    elbows: int = 2

    @classmethod
    def of(cls, axes: Axes, centre: Array) -> "Telescope | None":
        """The first three joints of a nominal model, if they are such."""
        if axes.prismatic[:3] != (False, False, True) or axes.parallel(0, 1) or not axes.square(1, 2):
            return None
        (_, w, slide), (root, second, _) = axes.directions[:3], axes.origins[:3]
        plane = plane_across(w, slide)
        shoulder, upper = in_plane(plane, second - root), in_plane(plane, centre - second)
        return cls(FirstJoint.of(axes, plane), shoulder, upper, float(w @ (centre - root)))

    def solve(self, position: Array, liked: Array, angles: Array, gap: Array, free: NDArray[np.bool_]) -> Carried:
        """See ``Carrier``."""
        split = self.column.split(position - self.column.root[:, None])
        (first,), gap_1, (free[0],) = self.column.facing(split, self.offset, liked[0])
        turned = np.cos(first), np.sin(first)
        e, f, _ = turned_back(split, turned)
        reached = slid(e - self.shoulder.real, f - self.shoulder.imag, self.upper, liked[1], liked[2])
        (second, slide), gap_5, (free[1], free[2]) = reached
        angles[0], angles[1], angles[2] = first, second, slide
        gap[:] = np.maximum(gap_1, gap_5)
        return Carried(self.column, turned, (np.cos(second), np.sin(second)))

    def factors(self, sign: Array) -> tuple[float, list[float], list[Named]]:
        """See ``Carrier``."""
        second, level = (1, float(sign[1])), np.conj(self.column.level)
        slide = [Term(float(sign[2]), slides=(2,)), Term(self.upper.real)]
        shoulder = [
            *real_part(level * self.shoulder, []),
            *real_part(level * self.upper, [second]),
            *real_part(level * sign[2], [second], slides=(2,)),
        ]
        return -1.0, [], [("slide", slide), ("shoulder", shoulder)]


@dataclass(frozen=True)
class Lift:
    """Joint 2 is a slide along the column, joint 3 one across it, along e; w is the column.

    Attributes:
        up: 1 where joint 2 slides as axis 1 points, else -1.
        middle: the wrist's centre from the root, drawn in, in the plane (m), and ``height`` along w.
    """

    column: FirstJoint
    up: float
    middle: complex
    height: float
    elbows: int = 1

    @classmethod
    def of(cls, axes: Axes, centre: Array) -> "Lift | None":
        """The first three joints of a nominal model, if they are such."""
        if axes.prismatic[:3] != (False, True, True) or not axes.parallel(0, 1) or not axes.square(0, 2):
            return None
        (w, up, slide), root = axes.directions[:3], axes.origins[0]
        plane = plane_across(w, slide)
        height = float(w @ (centre - root))
        return cls(FirstJoint.of(axes, plane), float(np.sign(w @ up)), in_plane(plane, centre - root), height)

    def solve(self, position: Array, liked: Array, angles: Array, gap: Array, free: NDArray[np.bool_]) -> Carried:
        """See ``Carrier``."""
        e, f, w = self.column.plane @ (position - self.column.root[:, None])
        (first, slide), gap_5, (free[0], free[2]) = slid(e, f, self.middle, liked[0], liked[2])
        first = first[None]  # (elbows, 2, n)
        angles[0], angles[1], angles[2] = first, type_1(self.up, w - self.height).values[0][0], slide
        gap[:] = gap_5
        return Carried(self.column, (np.cos(first), np.sin(first)))

    def factors(self, sign: Array) -> tuple[float, list[float], list[Named]]:
        """See ``Carrier``."""
        return self.up, [], [("shoulder", [Term(float(sign[2]), slides=(2,)), Term(self.middle.real)])]


def slid(e: Array, f: Array, drawn_in: complex, turn_liked: Array, slide_liked: Array) -> Roots:
    """A turn and a slide along e after it that bring a place from where it is drawn in to (e, f): type 5.

    With (e, f) = size exp(i direction) and s = direction - turn: size sin s = Im drawn_in, and size cos s = Re
    drawn_in + slide.
    """
    size, direction = np.hypot(e, f), np.arctan2(f, e)
    (slide, rest), gap, (slide_free, rest_free) = type_5(
        size, drawn_in.imag, 0.0, size, drawn_in.real, 1.0, TINY, (slide_liked, direction - turn_liked)
    )
    return Roots((direction - rest, slide), gap, (rest_free, slide_free))
