"""Elementary motions along a serial chain, for all poses at once, with elastic links.

Vectors are stored as rows x y z x y of length n: a cross product is three calls on views, without copies.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from lab.core.se3 import Array, exp, left_jacobian
from lab.kinematics.parameter import BASE_PARAMETERS
from lab.kinematics.serial.chain import Chain

__all__ = [
    "RIGID",
    "Axes",
    "Displaced",
    "ElementaryMotion",
    "Torsors",
    "along",
    "chunks",
    "fill",
    "padded",
    "some_poses",
    "turned",
]

_CHUNK = 2048  # poses at a time, for the processor's cache

Torsors = Mapping[int, Array]
"""Displacements ``(n, 6)`` (dx dy dz rx ry rz, m and rad) of links' far ends in the links' axes, by link from 0."""

RIGID: Torsors = MappingProxyType({})


@dataclass(frozen=True)
class ElementaryMotion:
    """An elementary motion: parameter ``column`` turns about or slides along ``axis``.

    ``axis`` and ``origin`` are ``(5, n)`` (``(5, 1)`` before the first joint) in the tracker's frame; ``origin`` is
    None for a slide, ``joint`` the joint with this motion.
    """

    column: int
    axis: Array
    origin: Array | None
    joint: int | None = None


Axes = tuple[Array, Array, Array]


@dataclass(frozen=True)
class Displaced:
    """Displacements of elastic links' ends, and the first column of their derivatives."""

    torsors: Torsors = field(default_factory=lambda: RIGID)
    column: int = 0

    def end(
        self, link: int, motions: list[ElementaryMotion], frame: Axes, at: Array, origin: Array
    ) -> tuple[Axes, Array]:
        """Return axes and an origin moved by the link's end, T_flex = Rot Trans (Benmisra 2007, eq. 3.34).

        Args:
            motions: the six motions are appended.
            frame: the link's axes.
            at: position of the end, ``(5, n)``.
            origin: ``(5, n)``, moved with the end.
        """
        if link not in self.torsors:
            return frame, origin
        torsor = self.torsors[link]
        first = self.column + 6 * list(self.torsors).index(link)
        moves = bool(torsor.any())
        turns = _combined(frame, left_jacobian(torsor[:, 3:])) if moves else frame
        bent = _combined(frame, exp(torsor[:, 3:])) if moves else frame
        motions += [ElementaryMotion(first + i, axis, None) for i, axis in enumerate(bent)]
        motions += [ElementaryMotion(first + 3 + i, axis, at) for i, axis in enumerate(turns)]
        if not moves:
            return frame, origin
        x, y, z = frame
        lever = (origin - at)[:3]
        local = [(axis[:3] * lever).sum(axis=0) + torsor[:, i] for i, axis in enumerate((x, y, z))]
        moved: Array = at + sum(part * axis for part, axis in zip(local, bent, strict=True))
        return bent, moved


def chunks(count: int, targets: int) -> Iterator[slice]:
    """Split poses into parts that fit the processor's cache."""
    size = max(1, _CHUNK // targets)
    return (slice(start, min(start + size, count)) for start in range(0, count, size))


def some_poses(torsors: Torsors, part: slice) -> Torsors:
    """Return the torsors of some poses."""
    return {link: torsor[part] for link, torsor in torsors.items()} if torsors else RIGID


def along(
    chain: Chain, frame: Axes, origin: Array, table: Array, joints: Array, flexible: Displaced | None = None
) -> tuple[list[ElementaryMotion], Axes, Array]:
    """Return the links' elementary motions from frame 0 outward, and the last frame's axes and origin.

    Args:
        frame, origin: of frame 0, rows x y z x y, ``(5, ...)`` each.
        table: ``(links, 5)``, or ``(links, 5, ...)`` for many arms.
        joints: ``(joints, ...)``.
        flexible: displaced ends of links; rigid by default.
    """
    flexible = flexible or Displaced()
    x, y, z = frame
    motions: list[ElementaryMotion] = []
    column = len(BASE_PARAMETERS)
    for i, (theta, d, a, alpha, beta) in enumerate(table):
        # the reading adds to theta of a hinge, to d of a slide
        slides, parallel = chain.prismatic[i], chain.parallel[i]
        reading = chain.sign[i] * joints[i]
        angle, slide = (theta, d + reading) if slides else (theta + reading, d)
        at = column
        column += 5 if parallel else 4
        if chain.convention == "distal":  # theta and d about z, then a and alpha about x, and beta about y
            motions.append(ElementaryMotion(at, z, origin, None if slides else i))
            motions.append(ElementaryMotion(at + 1, z, None, i if slides else None))
            x, y = turned(x, y, angle)
            origin = origin + slide * z + a * x
            motions.append(ElementaryMotion(at + 2, x, None))
            (x, y, z), origin = flexible.end(i, motions, (x, y, z), origin, origin)
            motions.append(ElementaryMotion(at + 3, x, origin))
            y, z = turned(y, z, alpha)
            if parallel:
                motions.append(ElementaryMotion(at + 4, y, origin))
                z, x = turned(z, x, beta)
        else:  # a and alpha about x, and beta about y, then theta and d about z
            motions.append(ElementaryMotion(at + 2, x, None))
            if i:
                (x, y, z), origin = flexible.end(i - 1, motions, (x, y, z), origin + a * x, origin)
            motions.append(ElementaryMotion(at + 3, x, origin))
            y, z = turned(y, z, alpha)
            origin = origin + a * x
            if parallel:
                motions.append(ElementaryMotion(at + 4, y, origin))
                z, x = turned(z, x, beta)
            motions.append(ElementaryMotion(at, z, origin, None if slides else i))
            motions.append(ElementaryMotion(at + 1, z, None, i if slides else None))
            x, y = turned(x, y, angle)
            origin = origin + slide * z
    if chain.convention != "distal":
        (x, y, z), origin = flexible.end(len(table) - 1, motions, (x, y, z), origin, origin)
    return motions, (x, y, z), origin


def padded(vector: Array) -> Array:
    """Return ``(3,)`` as rows x y z x y, ``(5, 1)``."""
    return np.concatenate([vector, vector[:2]])[:, None]


def turned(u: Array, v: Array, angle: Array) -> tuple[Array, Array]:
    """Turn the axes u, v by an angle from u towards v."""
    c, s = np.cos(angle), np.sin(angle)
    return c * u + s * v, c * v - s * u


def fill(jacobian: Array, motions: Sequence[ElementaryMotion], points: Array) -> None:
    """Write the derivatives of ``points`` ``(5, k, ...)`` by the motions into ``(parameters, 3, k, ...)``."""
    origin: Array | None = None
    lever = product = points
    product = np.empty_like(points[:3])
    for motion in motions:
        axis = motion.axis[:, None]
        if motion.origin is None:
            jacobian[motion.column] = axis[:3]
            continue
        if motion.origin is not origin:
            origin = motion.origin
            lever = points - origin[:, None]
        np.multiply(axis[1:4], lever[2:5], out=jacobian[motion.column])
        np.multiply(axis[2:5], lever[1:4], out=product)
        jacobian[motion.column] -= product


def _combined(frame: Axes, weights: Array) -> Axes:
    x, y, z = frame
    first, second, third = (weights[:, 0, i] * x + weights[:, 1, i] * y + weights[:, 2, i] * z for i in range(3))
    return first, second, third
