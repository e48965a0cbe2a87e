"""Where the frames of a mechanism stand, how far its closures are from closed, and how each step moves both.

Vectors are rows x y z x y of n poses each, ``(5, n)``, or ``(5, 1)`` where they are the same in all poses: what no
joint position and no passive value moves is computed once, and a cross product is three calls on views (``serial``).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lab.core.se3 import Array, exp
from lab.kinematics.closed.structure import BASE, Rod, Tree
from lab.kinematics.serial.walk import padded, turned

__all__ = ["Configuration", "Dimensions", "crossed"]

Axes = tuple[Array, Array, Array]


@dataclass(frozen=True)
class Dimensions:
    """The numbers of a mechanism, by which it may differ from its nominal model.

    Attributes:
        base: ``(6,)`` place and rotation vector of the base in the tracker's frame.
        steps: of each frame's path, the constants (m, rad).
        lengths: of the rods (m).
        scale: the sign with which each joint's position counts.
    """

    base: Array
    steps: tuple[Array, ...]
    lengths: Array
    scale: Array


@dataclass
class Configuration:
    """A mechanism at n poses.

    Attributes:
        joint_values: ``(joints, n)`` joint positions (rad, m) times their sign.
        passive: ``(z, n)``.
        frames: axes and origin of each frame.
        steps: axis, and origin (None of a slide), of each frame's steps.
    """

    tree: Tree
    dimensions: Dimensions
    joint_values: Array
    passive: Array
    base: tuple[Axes, Array]
    frames: list[tuple[Axes, Array]]
    steps: list[list[tuple[Array, Array | None]]]

    @staticmethod
    def of(tree: Tree, dimensions: Dimensions, joints: Array, passive: Array) -> "Configuration":
        """At joint positions ``(n, joints)`` and passive values ``(z, n)``."""
        x, y, z = (padded(column) for column in exp(dimensions.base[3:]).T)
        count = len(tree.frames)
        empty: tuple[Axes, Array] = ((x, y, z), padded(dimensions.base[:3]))
        joint_values = dimensions.scale[:, None] * joints.T
        found = Configuration(
            tree, dimensions, joint_values, passive, empty, [empty] * count, [[] for _ in range(count)]
        )
        for frame in range(count):
            found._walk(frame)
        return found

    def move(self, passive: Array) -> None:
        """To other passive values ``(z, n)``."""
        self.passive = passive
        for frame, loose in enumerate(self.tree.loose):
            if loose:
                self._walk(frame)

    def _walk(self, frame: int) -> None:
        described = self.tree.frames[frame]
        (x, y, z), origin = self.base if described.on == BASE else self.frames[described.on]
        steps: list[tuple[Array, Array | None]] = []
        for s, step in enumerate(described.path):
            value = self.dimensions.steps[frame][s]
            if step.joint is not None:
                value = value + self.joint_values[step.joint]
            elif step.passive:
                value = self.passive[self.tree.column[frame, s]]
            axis = (x, y, z)[step.axis]
            if not step.is_turn:
                steps.append((axis, None))
                origin = origin + value * axis
                continue
            steps.append((axis, origin))
            if step.axis == 0:
                y, z = turned(y, z, value)
            elif step.axis == 1:
                z, x = turned(z, x, value)
            else:
                x, y = turned(x, y, value)
        self.frames[frame], self.steps[frame] = ((x, y, z), origin), steps

    def lengths(self) -> list[Array]:
        """Of the rods, ``(n,)`` or one number each (m)."""
        return [
            self.dimensions.lengths[i] + (0.0 if rod.joint is None else self.joint_values[rod.joint])
            for i, rod in enumerate(self.tree.rods)
        ]

    def closures(self) -> tuple[list[Array], list[Array]]:
        """How far each closure is from closed (m), and the direction ``(5, n)`` in which its first end opens it.

        Of a rod from b to a it is (|a - b|^2 - l^2) / 2 l, whose direction is (a - b) / l: unlike a distance
        it is of second order in the frames' places, and smooth where the ends meet.
        """
        gaps: list[Array] = []
        directions: list[Array] = []
        for rod, length in zip(self.tree.rods, self.lengths(), strict=True):
            between = self._between(rod)
            directions.append(between / length)
            gaps.append(((between[:3] ** 2).sum(axis=0) / length - length) / 2)
        for pin in self.tree.pins:
            a, b = (self.frames[end][1] for end in pin.ends)
            for axis in pin.axes:
                direction = self.base[0][axis]
                directions.append(direction)
                gaps.append(((a - b)[:3] * direction[:3]).sum(axis=0))
        return gaps, directions

    def _between(self, rod: Rod) -> Array:
        a, b = (self.frames[end][1] for end in rod.ends)
        return a - b

    def slope(self, step: tuple[int, int], point: Array, direction: Array) -> Array:
        """How a step moves a point ``(5, n)`` that it carries, along a direction ``(5, n)``."""
        axis, origin = self.steps[step[0]][step[1]]
        if origin is None:
            return _dot(axis, direction)
        return _dot(axis, crossed(point - origin, direction))

    def motion(self, step: tuple[int, int], points: Array) -> Array:
        """How a step moves points ``(5, k, n)`` that it carries, ``(3, k, n)``."""
        axis, origin = self.steps[step[0]][step[1]]
        return axis[:3, None] if origin is None else crossed(axis[:, None], points - origin[:, None])

    def by_passive(self, directions: Sequence[Array]) -> Array:
        """Derivatives of the closures by the passive values, ``(n, closures, z)``."""
        size, count = len(self.tree.passive), self.passive.shape[1]
        out = np.zeros((size, size, count))
        for i, opening in enumerate(self.tree.openings):
            for step, end, sign in opening:
                if (column := self.tree.column.get(step)) is not None:
                    out[i, column] = sign * self.slope(step, self.frames[end][1], directions[i])
        return out.transpose(2, 0, 1)


def _dot(u: Array, v: Array) -> Array:
    """Of vectors ``(3 or 5, n)``, ``(n,)``."""
    product: Array = u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
    return product


def crossed(u: Array, v: Array) -> Array:
    """The cross products of vectors ``(5, n)``, ``(3, n)``."""
    return u[1:4] * v[2:5] - u[2:5] * v[1:4]
