"""Elastic links as beams: displacements of a link's end by Euler, Bernoulli and Saint-Venant.

A link is clamped at its near end, on the axis of its joint, and runs in straight segments to its far end, whose
displacement is the torsor u = (dx, dy, dz, rx, ry, rz) (Benmisra 2007, section 3-2-3), in the link's axes. For a
segment of length L under a force F and a moment M across at its end and a load w per metre, the deflection is F L^3 /
3EI + M L^2 / 2EI + w L^4 / 8EI, the slope F L^2 / 2EI + M L / EI + w L^3 / 6EI, the twist M L / GJ and the extension F
L / EA.

A link's own mass is uniform along its segments, with one offset that gives its centre of mass. A load that grows along
the segment, as in motion, adds 11 w L^4 / 120 EI and w L^3 / 8EI.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array

__all__ = ["COMPLIANCES", "MATERIALS", "Beam", "LinkSections", "Material", "loads_on", "tube"]

COMPLIANCES = ("ei_y", "ei_z", "gj", "ea")  # 1/EI about y and about z, 1/GJ, 1/EA, in this order everywhere
_PARALLEL = 1e-6  # sine of the angle of a segment along the joint's axis
_LOADS = 18  # force, moment, pull at the near end, gradient of the pull


@dataclass(frozen=True)
class Beam:
    """A link as a beam, in its own axes: origin at the near end on the joint's axis, which is z.

    A segment's axes: x from its near to its far end, z across in the plane of x and of the link's z, y completes them;
    for a segment along the link's z, its y is the link's x. ``ei_y`` is the stiffness against bending about y.

    Attributes:
        path: ``(k + 1, 3)`` m, corners of its line from the near end to the far end.
        centre_m: ``(3,)`` m, centre of mass.
    """

    path: Array
    mass_kg: float
    centre_m: Array

    def __post_init__(self) -> None:
        if self.path.ndim != 2 or self.path.shape[1] != 3 or len(self.path) < 2 or not np.isfinite(self.path).all():
            raise LabError(f"a link's path of shape {self.path.shape}: give finite points (k, 3), two at least")
        if not self._lengths.all():
            raise LabError("a link's path: two of its points after each other are the same; leave one out")

    @property
    def length_m(self) -> float:
        """Length of its line."""
        return float(self._lengths.sum())

    @property
    def beside_m(self) -> Array:
        """Offset ``(3,)`` m of the mass from the line, uniform along it."""
        middles = (self.path[1:] + self.path[:-1]) / 2
        return np.asarray(self.centre_m - self._lengths @ middles / self.length_m)

    @property
    def second_moment(self) -> Array:
        """Integral of r r' dm ``(3, 3)`` kg m^2, about the centre of mass."""
        total, centre = np.zeros((3, 3)), self.centre_m - self.beside_m
        for near, far, _ in self._segments():
            a, b = near - centre, far - centre
            total += np.linalg.norm(far - near) * (np.outer(a, a) + np.outer(b, b) + np.outer(a + b, a + b)) / 6
        return np.asarray(self.mass_kg / self.length_m * total)

    @cached_property
    def by_loads(self) -> Array:
        """Torsors ``(18, 4, 6)`` under unit loads (``loads_on``) with unit ``COMPLIANCES``."""
        return self._displacements(np.eye(_LOADS))

    def torsor(self, loads: Array, compliances: Array) -> Array:
        """Return the torsor ``(..., 6)`` (m, rad) under loads ``(..., 18)`` with ``(4,)`` 1/EI, 1/EI, 1/GJ, 1/EA."""
        return np.asarray(loads @ np.tensordot(self.by_loads, compliances, axes=(1, 0)))

    @property
    def _lengths(self) -> Array:
        return np.asarray(np.linalg.norm(np.diff(self.path, axis=0), axis=1))

    def _segments(self) -> Iterator[tuple[Array, Array, Array]]:
        """Yield the segments from the far end inward: near and far end ``(3,)``, and the axes as rows ``(3, 3)``."""
        for near, far in zip(self.path[-2::-1], self.path[:0:-1], strict=True):
            x = (far - near) / np.linalg.norm(far - near)
            y = np.cross([0.0, 0.0, 1.0], x)
            y = np.array([1.0, 0.0, 0.0]) if np.linalg.norm(y) < _PARALLEL else y / np.linalg.norm(y)
            yield near, far, np.stack([x, y, np.cross(x, y)])

    def _displacements(self, loads: Array) -> Array:
        force, moment, pull = loads[:, :3], loads[:, 3:6], loads[:, 6:9]
        change = loads[:, 9:].reshape(-1, 3, 3)
        density, beside = self.mass_kg / self.length_m, self.beside_m
        total = np.zeros((len(loads), 4, 6))
        for near, far, axes in self._segments():
            first, last = (density * (pull + change @ (end + beside - self.path[0])) for end in (near, far))
            spread = _Spread(float(np.linalg.norm(far - near)), first, last, beside)
            torsors = spread.displacements(force, moment, axes)
            torsors[..., :3] += np.cross(torsors[..., 3:], self.path[-1] - far)  # at the far end of the link
            total += torsors
            moment = moment + np.cross(far - near, force) + spread.moment_about_near(far - near)
            force = force + spread.resultant
        return total


@dataclass(frozen=True)
class _Spread:
    """A load along a segment of a length (m), linear from ``near`` to ``far`` ``(n, 3)`` N/m, with an offset."""

    length: float
    near: Array
    far: Array
    beside: Array

    @property
    def resultant(self) -> Array:
        return np.asarray(self.length * (self.near + self.far) / 2)

    def moment_about_near(self, along: Array) -> Array:
        lever: Array = np.cross(along, self.length * (self.near / 6 + self.far / 3))
        return lever + np.cross(self.beside, self.resultant)

    def displacements(self, force: Array, moment: Array, axes: Array) -> Array:
        """Return ``(n, 4, 6)`` of the far end, with a force and a moment there, by unit compliances."""
        L = self.length
        f, m, w, grows = (each @ axes.T for each in (force, moment, self.near, self.far - self.near))
        c, c_grows = (np.cross(self.beside, each) @ axes.T for each in (self.near, self.far - self.near))
        x = np.array([1.0, 0.0, 0.0])
        F, W, G = np.cross(x, f), np.cross(x, w), np.cross(x, grows)
        slope = L * m + L**2 / 2 * F + L**3 / 6 * W + L**3 / 8 * G + L**2 / 2 * c + L**2 / 3 * c_grows
        sag = L**2 / 2 * m + L**3 / 3 * F + L**4 / 8 * W + 11 * L**4 / 120 * G + L**3 / 3 * c + 5 * L**3 / 24 * c_grows
        longer = L * f[:, 0] + L**2 / 2 * w[:, 0] + L**2 / 3 * grows[:, 0]
        out = np.zeros((len(force), 4, 6))
        out[:, 0, 4], out[:, 0, 2] = slope[:, 1], -sag[:, 1]  # bent about y, the end goes towards -z
        out[:, 1, 5], out[:, 1, 1] = slope[:, 2], sag[:, 2]
        out[:, 2, 3], out[:, 3, 0] = slope[:, 0], longer
        return np.concatenate([out[..., :3] @ axes, out[..., 3:] @ axes], axis=-1)


def loads_on(force: Array, moment: Array, pull: Array, change: Array | None = None) -> Array:
    """Return the loads on a link as one vector ``(..., 18)``, in the link's axes.

    Args:
        force, moment: ``(..., 3)`` N and Nm at its far end.
        pull: ``(..., 3)`` m/s^2 at the near end: gravity less the acceleration, the force per mass.
        change: ``(..., 3, 3)`` 1/s^2, gradient of the pull; zero at rest.
    """
    grows = np.zeros((*force.shape[:-1], 9)) if change is None else change.reshape(*force.shape[:-1], 9)
    return np.concatenate([force, moment, pull, grows], axis=-1)


@dataclass(frozen=True)
class Material:
    """An elastic material: Young's modulus and the shear modulus, Pa."""

    young_pa: float
    shear_pa: float


MATERIALS: Mapping[str, Material] = {  # Gere & Goodno 2009, table H-2, the middle of each range
    "aluminium": Material(70e9, 26e9),
    "steel": Material(210e9, 80e9),
    "cast iron": Material(125e9, 50e9),
    "magnesium": Material(43e9, 16e9),
}


@dataclass(frozen=True)
class LinkSections:
    """Links of an arm as beams, from the robot's description.

    Attributes:
        compliances: ``(n, 4)`` of each link, as ``COMPLIANCES``; zero for a stiff link.
        paths: by link (from 0), ``(k, 3)`` m: corners of its line in its own axes, its far end last; others are
            straight.
    """

    compliances: Array
    paths: Mapping[int, Array]


def tube(outer_m: float, wall_m: float, material: Material) -> Array:
    """Return compliances ``(4,)`` (``COMPLIANCES``) of a round tube, by its outer diameter and its wall.

    I = pi (D^4 - d^4) / 64 about any axis across, the polar one twice that, and A = pi (D^2 - d^2) / 4.
    """
    inner = outer_m - 2 * wall_m
    area, second = np.pi * (outer_m**2 - inner**2) / 4, np.pi * (outer_m**4 - inner**4) / 64
    bending, twisting = material.young_pa * second, material.shear_pa * 2 * second
    return np.asarray(1 / np.array([bending, bending, twisting, material.young_pa * area]))
