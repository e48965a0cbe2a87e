"""What the first three joints of an arm with a spherical wrist have in common: joint 1 turns all the rest.

A vector is an array of three rows, a pose in each column; one in a plane is a complex number. Angles and lengths here
are those of the axes: joint positions times their signs.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.robotics.inverse.khalil_one_unknown import TINY, Roots, type_2
from lab.kinematics.inverse.closed_form import Axes, Term, in_plane

__all__ = ["Carried", "Carrier", "FirstJoint", "Named", "turned_back"]

Named = tuple[str, Sequence[Term]]


@dataclass(frozen=True)
class FirstJoint:
    """Joint 1.

    Attributes:
        axis: ``(3,)`` of the joint, through ``root`` ``(3,)`` (m).
        plane: ``(3, 3)`` rows e, f and w: in which the joints after it move, and across it.
        parts: ``(9, 3)``: of a vector the part along the axis, the one across it, and the latter turned by 90
            degrees, each by its coordinates in the plane.
    """

    axis: Array
    root: Array
    plane: Array
    parts: Array

    @classmethod
    def of(cls, axes: Axes, plane: Array) -> "FirstJoint":
        """Joint 1 of a nominal model."""
        axis = axes.directions[0]
        along = np.outer(axis, axis)
        parts = [plane @ part for part in (along, np.eye(3) - along, se3.skew(axis))]
        return cls(axis, axes.origins[0], plane, np.concatenate(parts))

    @property
    def level(self) -> complex:
        """W x axis: what the wrist's centre is far from axis 1 along, if it is far from it."""
        return in_plane(self.plane, np.cross(self.plane[2], self.axis))

    def split(self, vector: Array) -> tuple[Array, Array, Array]:
        """The three parts of a vector ``(3, n)``, in the plane."""
        first, second, third = (self.parts @ vector).reshape(3, 3, -1)
        return first, second, third

    def facing(self, split: tuple[Array, Array, Array], offset: float, liked: Array) -> Roots:
        """Joint 1 such that a place comes to be at ``offset`` (m) along w: w . Rot(axis, -t) p = offset."""
        along, across, quarter = split
        return type_2(-quarter[2], across[2], offset - along[2], TINY, liked)


@dataclass(frozen=True)
class Carried:
    """What the first three joints do to directions, at their roots.

    Attributes:
        first: cosine and sine of joint 1 ``(2, n)``.
        lifted: of the turn about w ``(elbows, 2, n)``; None where no joint turns about it.
    """

    column: FirstJoint
    first: tuple[Array, Array]
    lifted: tuple[Array, Array] | None = None

    def back(self, vector: Array) -> list[Array]:
        """A vector ``(3, n)`` turned back by these joints, along e, f and w."""
        e, f, w = turned_back(self.column.split(vector), self.first)
        if self.lifted is None:
            return [e, f, w]
        cosine, sine = self.lifted
        return [cosine * e + sine * f, cosine * f - sine * e, w]


def turned_back(split: tuple[Array, Array, Array], first: tuple[Array, Array]) -> list[Array]:
    """A vector turned back by joint 1, in the plane."""
    cosine, sine = first
    return [fixed + cosine * level - sine * ahead for fixed, level, ahead in zip(*split, strict=True)]


class Carrier(Protocol):
    """The first three joints."""

    @property
    def column(self) -> FirstJoint:
        """Joint 1."""

    @property
    def elbows(self) -> int:
        """How many roots there are for each of joint 1's two."""

    def solve(self, position: Array, liked: Array, angles: Array, gap: Array, free: NDArray[np.bool_]) -> Carried:
        """Fill in what brings the wrist's centre to places ``(3, n)`` in frame 0.

        Args:
            liked: ``(3, n)`` what free joints take.
            angles, free: ``(3, wrists, elbows, 2, n)``; ``gap`` ``(wrists, elbows, 2, n)`` m.
        """

    def factors(self, sign: Array) -> tuple[float, list[float], list[Named]]:
        """Of the determinant of the axes' three columns of the Jacobian at the wrist's centre.

        Returns:
            Its sign, lengths (m), and factors with their names, for joint positions that have these signs.
        """
