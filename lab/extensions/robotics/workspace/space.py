"""Compute a robot's workspace within its limits: its size, its sections and its boundary."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.core.progress import Progress, no_progress
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.whole_folder import Keep, at_once
from lab.extensions.robotics.workspace.boundary import boundary, carrier_volume, solid_volume
from lab.extensions.robotics.workspace.measure import Measured, measured
from lab.extensions.robotics.workspace.membership import Domain, Membership, domain_of, memberships
from lab.extensions.robotics.workspace.orientations import Orientations, orientation_shares, orientations_of
from lab.kinematics.model import RigidArm

__all__ = ["Section", "Workspace", "workspace_of"]

_AROUND = 72  # segments of a solid of revolution


@dataclass(frozen=True)
class Section:
    """A plane section of a workspace.

    Attributes:
        axes: which of x, y and z are drawn to the right and upward.
        level_m: the third coordinate.
        right, up: ``(n,)`` and ``(m,)`` m, coordinates of a grid.
        reached: ``(n, m)`` there.
        shares: ``(n, m)`` of the orientations, NaN where it is not reached; None where none were tested.
        vertices, segments: ``(k, 2)`` m and ``(f, 2)``, the boundary.
    """

    axes: tuple[int, int]
    level_m: float
    right: Array
    up: Array
    reached: NDArray[np.bool_]
    shares: Array | None
    vertices: Array
    segments: NDArray[np.int_]


@dataclass(frozen=True)
class Workspace:
    """The workspace of a nominal robot and the point of its tool.

    Attributes:
        values: parameters ``(p,)`` with one target.
        domain: of the sample points.
        by_place, by_pose: membership tests for places and poses.
        measured: by Monte Carlo.
        orientations: among which it can choose; None where it cannot.
    """

    arm: RigidArm
    values: Array
    domain: Domain
    by_place: Membership
    by_pose: Membership
    measured: Measured
    orientations: Orientations | None

    @property
    def _grid(self) -> tuple[int, int, int]:
        """Nodes of a section and of the boundary along each coordinate, and how often crossings are halved."""
        if self.by_place.exact:
            return 48, 32, 10
        return (24, 12, 0) if self.arm.chain.has_loops else (40, 20, 4)

    @cached_property
    def by_sections(self) -> float | None:
        """The volume by sections (m³) of three slides, and of solids of revolution by a closed form; None of others."""
        chain, domain = self.arm.dh_chain(self.values), self.domain
        if chain is not None and domain.kind == "space" and chain.size == 3 and all(chain.prismatic):
            return carrier_volume(chain, self.values[-3:], np.inf)
        if domain.kind != "revolution" or not self.by_place.exact:
            return None

        def reached(radius: Array, level: Array) -> NDArray[np.bool_]:
            return domain.reached(self.by_place, np.stack([radius, level], axis=1))

        return solid_volume(reached, (domain.low[1], domain.high[1]), domain.high[0])

    def shares(self, places: Array, count: int) -> Array:
        """Compute the share ``(n,)`` of its orientations that the robot reaches at places ``(n, 3)`` m.

        Args:
            count: of orientations, the same at all places.
        """
        assert self.orientations is not None
        return orientation_shares(self.by_pose, places, self.orientations.some(count, rng_for(0, "poses")))

    def section(self, axes: tuple[int, int], level_m: float, orientations: int = 0) -> Section:
        """A section across one of the base's axes.

        Args:
            axes: which of x, y and z are drawn to the right and upward.
            orientations: how many are tried at each node that is reached.
        """
        ends = self.domain.extents
        nodes, _, halvings = self._grid
        margin = 0.04 * float((ends[:, 1] - ends[:, 0]).max())
        middle, half = ends.mean(axis=1), float((ends[list(axes), 1] - ends[list(axes), 0]).max()) / 2 + margin
        right, up = (np.linspace(middle[i] - half, middle[i] + half, nodes) for i in axes)

        def places_of(drawn: Array) -> Array:
            places = np.full((len(drawn), 3), level_m)
            places[:, axes] = drawn
            return places

        def inside(drawn: Array) -> NDArray[np.bool_]:
            coordinates = self.domain.coordinates(places_of(drawn))
            different, back = np.unique(coordinates.round(12), axis=0, return_inverse=True)
            return np.asarray(self.domain.reached(self.by_place, different)[back.ravel()])

        reached, vertices, segments = boundary(inside, (right, up), halvings)
        shares = None
        if orientations and self.orientations is not None:
            shares = np.full(reached.shape, np.nan)
            drawn = np.stack(np.meshgrid(right, up, indexing="ij"), axis=-1)[reached]
            shares[reached] = self.shares(places_of(drawn), orientations)
        return Section(axes, level_m, right, up, reached, shares, vertices, segments)

    @cached_property
    def surface(self) -> tuple[Array, NDArray[np.int_]]:
        """The boundary of a volume as vertices ``(k, 3)`` m in the base and triangles ``(f, 3)``; empty of an area."""
        domain, (_, nodes, halvings) = self.domain, self._grid
        if domain.kind == "plane":
            return np.empty((0, 3)), np.empty((0, 3), dtype=np.int_)
        low, high = domain.low, domain.high
        axes = [np.linspace(a, b, nodes) for a, b in zip(low, high, strict=True)]
        if domain.kind == "revolution":  # z lies between two nodes, so that nothing is open there
            step = high[0] / nodes
            axes[0] = step * (np.arange(nodes + 1) - 0.5)

        def inside(coordinates: Array) -> NDArray[np.bool_]:
            return domain.reached(self.by_place, coordinates)

        _, vertices, faces = boundary(inside, tuple(axes), halvings)
        if domain.kind == "revolution":
            vertices, faces = _revolved(vertices, faces)
        return vertices, np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])


def _revolved(vertices: Array, segments: NDArray[np.int_]) -> tuple[Array, NDArray[np.int_]]:
    """Quadrilaterals of segments in a half plane, turned about z."""
    angles = 2 * np.pi * np.arange(_AROUND) / _AROUND
    radii = np.maximum(vertices[:, 0], 0.0)
    radii[radii < 1e-9] = 0.0
    x, y = np.multiply.outer(np.cos(angles), radii), np.multiply.outer(np.sin(angles), radii)
    z = np.broadcast_to(vertices[:, 1], x.shape)
    first = np.arange(_AROUND)[:, None] * len(vertices)
    after = (np.arange(1, _AROUND + 1)[:, None] % _AROUND) * len(vertices)
    start, end = segments.T
    quads = np.stack([first + start, after + start, after + end, first + end], axis=2)
    return np.stack([x, y, z], axis=2).reshape(-1, 3), quads.reshape(-1, 4)


def workspace_of(
    arm: RigidArm,
    values: Array,
    count: int | None,
    rng: np.random.Generator,
    progress: Progress = no_progress,
    keep: Keep = at_once,
) -> Workspace:
    """Measure a robot's workspace.

    Args:
        values: parameters ``(p,)`` with one target.
        count: of places that are looked at; by default what takes a few seconds.
        progress: told how many of them were.
        keep: how what was found of them is kept, of this robot alone.

    Raises:
        LabError: the point stays on a line or a surface, which has no volume.
    """
    domain = domain_of(arm, values)
    by_place, by_pose = memberships(arm, values)
    some = _places_in_seconds(arm, by_place) if count is None else count
    found = measured(domain, by_place, some, rng, progress, keep)
    return Workspace(arm, values, domain, by_place, by_pose, found, orientations_of(arm, values))


def _places_in_seconds(arm: RigidArm, by_place: Membership) -> int:
    """Return the default number of sampled places: mechanisms with loops take longer to solve."""
    if not arm.chain.has_loops or by_place.exact:
        return 8192
    return 2048 if arm.chain.size <= 3 else 1024
