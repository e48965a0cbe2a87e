"""Measure a robot's workspace within its joint limits: its size, voids, sections, boundary and orientations.

The size is a Monte Carlo estimate. The box is cut into equal cells, and two random places are tested in each: the mean
of the two results, summed over the cells, estimates the size without bias, and half their difference in each cell
estimates the error (stratified sampling, Cochran 1977, section 5A.11). Cells that are reached all over add none, so
that the error falls faster than with places all over the box.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # its parts are loaded at their first use
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab.core import se3
from lab.core.progress import Progress, no_progress
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.robotics.workspace.boundary import boundary, carrier_volume, solid_volume
from lab.extensions.robotics.workspace.membership import Domain, Membership, domain_of, memberships
from lab.kinematics.differential import WEIGHTS
from lab.kinematics.inverse.newton_inverse import PoseTarget
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm

__all__ = ["PlaneSection", "Workspace", "measured", "workspace_of"]

_POSES = 200  # random ones, from which the orientations that can be chosen are found
_NO_ROTATION = 1e-6  # of the largest singular value
_BLOCK = 20_000  # places that are tested together, so that memory does not grow with their number
_SEGMENTS = 72  # of a solid of revolution


@dataclass(frozen=True)
class _Orientations:
    """Orientations among which a robot can choose at a place.

    Attributes:
        axis: ``(3,)`` in the base, about which alone the tool turns; None where it turns in any way.
        rotation: ``(3, 3)`` one that it can have.
    """

    axis: Array | None
    rotation: Array

    def some(self, count: int, rng: np.random.Generator) -> Array:
        """Draw rotations ``(count, 3, 3)``: uniformly at random of all, or evenly spread about the axis."""
        if self.axis is None:
            return np.asarray(Rotation.random(count, rng=rng).as_matrix())
        angles = 2 * np.pi * (np.arange(count) + 0.5) / count - np.pi
        return np.asarray(se3.exp(angles[:, None] * self.axis) @ self.rotation)


def _orientations_of(arm: RigidArm, values: Array) -> _Orientations | None:
    """Return the orientations a robot can choose; None where orientation follows from the place, or in part.

    Args:
        values: parameters ``(p,)`` with one target.
    """
    joints = JointSpec.random_joints(arm.chain, _POSES, rng_for(0, "structure"))
    Ts, jacobian = arm.tool(joints, values)
    stands = np.isfinite(Ts).all(axis=(1, 2))
    rotations, jacobian = Ts[stands, :3, :3], WEIGHTS[:, None] * jacobian[stands]
    freedoms, places = (_rank(each) for each in (jacobian, jacobian[:, :3]))
    turns = se3.log(rotations @ rotations[0].T)
    sizes, directions = np.linalg.svd(turns)[1:]
    kinds = int((sizes > _NO_ROTATION).sum())
    if kinds == 3 and freedoms == places + 3:
        return _Orientations(None, rotations[0])
    if kinds == 1 and freedoms == places + 1:
        return _Orientations(directions[0], rotations[0])
    return None


def _rank(jacobians: Array) -> int:
    sizes = np.linalg.svd(jacobians, compute_uv=False)
    return int((sizes > _NO_ROTATION * sizes[:, :1]).sum(axis=1).max(initial=0))


@dataclass(frozen=True)
class _Measured:
    """Monte Carlo estimate of a workspace.

    Attributes:
        coordinates: ``(n, d)`` m, of the sample points.
        reached: ``(n,)``.
        weights: ``(n,)`` of each, m³ or m².
        size, standard_error: m³, of a plane m².
        voids: sizes of what is enclosed and not reached, the largest first.
        cell_m: the largest edge of a cell: voids of less than three of them are not seen.
    """

    coordinates: Array
    reached: NDArray[np.bool_]
    weights: Array
    size: float
    standard_error: float
    voids: tuple[float, ...]
    cell_m: float

    def drawn(self, count: int, rng: np.random.Generator) -> Array:
        """Draw coordinates ``(count, d)`` of reached places, evenly spread over the workspace."""
        rows = np.flatnonzero(self.reached & (self.weights > 0))
        count = min(count, len(rows))
        chance = self.weights[rows] / self.weights[rows].sum()
        return np.asarray(self.coordinates[rng.choice(rows, count, replace=False, p=chance)])


def measured(
    domain: Domain,
    membership: Membership,
    count: int,
    rng: np.random.Generator,
    progress: Progress = no_progress,
) -> _Measured:
    """Estimate the size of the reached part of a domain.

    Args:
        count: approximate number of places.
        progress: receives the number of places tested so far.
    """
    edge = max(round((count / 2) ** (1 / domain.size)), 3)
    shape = (edge,) * domain.size
    step = (domain.high - domain.low) / edge
    corners = np.stack(np.meshgrid(*[np.arange(edge)] * domain.size, indexing="ij"), axis=-1).reshape(-1, domain.size)
    pairs = domain.low + (corners[:, None] + rng.random((len(corners), 2, domain.size))) * step
    flat = pairs.reshape(-1, domain.size)
    reached = _reached(domain, membership, flat, progress).reshape(-1, 2)
    weights = domain.weights(flat).reshape(-1, 2) * step.prod()
    parts = weights * reached
    return _Measured(
        flat, reached.ravel(), weights.ravel() / 2, float(parts.mean(axis=1).sum()),
        float(np.sqrt(((parts[:, 0] - parts[:, 1]) ** 2).sum()) / 2),
        _voids(reached.reshape(*shape, 2), weights.reshape(*shape, 2), mirrored=domain.kind == "revolution"),
        float(step.max()),
    )  # fmt: skip


def _reached(domain: Domain, membership: Membership, coordinates: Array, progress: Progress) -> NDArray[np.bool_]:
    """Test whether coordinates ``(n, d)`` are reached, in blocks."""
    reached = np.empty(len(coordinates), dtype=np.bool_)
    for first in range(0, len(coordinates), _BLOCK):
        progress(first, len(coordinates))
        some = coordinates[first : first + _BLOCK]
        reached[first : first + _BLOCK] = domain.reached(membership, some)
    return reached


def _voids(reached: NDArray[np.bool_], weights: Array, *, mirrored: bool) -> tuple[float, ...]:
    """Return the sizes of enclosed voids: cells ``(..., 2)`` none of whose places is reached, and their neighbours.

    A cell alone may be missed by chance: a void has one whose neighbours along all axes are empty, too.
    """
    if mirrored:  # what meets z is no border
        reached, weights = (np.concatenate([each[::-1], each], axis=0) for each in (reached, weights))
    empty = ~reached.any(axis=-1)
    labels, _ = scipy.ndimage.label(empty)
    inner = np.zeros_like(empty)
    inner[(slice(1, -1),) * empty.ndim] = True
    open_ones = set(np.unique(labels[~inner]).tolist())
    missed, sizes = (weights * ~reached).mean(axis=-1), []
    for label, box in enumerate(scipy.ndimage.find_objects(labels), start=1):
        if label in open_ones:
            continue
        near = tuple(slice(each.start - 1, each.stop + 1) for each in box)  # inside: it does not meet the border
        void = labels[near] == label
        if not scipy.ndimage.binary_erosion(void).any():
            continue
        sizes.append(float(missed[near][scipy.ndimage.binary_dilation(void)].sum()) / (2 if mirrored else 1))
    return tuple(sorted(sizes, reverse=True))


@dataclass(frozen=True)
class PlaneSection:
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
        orientations: among which the robot can choose; None where it cannot.
    """

    arm: RigidArm
    values: Array
    domain: Domain
    by_place: Membership
    by_pose: Membership
    measured: _Measured
    orientations: _Orientations | None

    @property
    def _grid(self) -> tuple[int, int, int]:
        """Nodes of a section and of the boundary along each coordinate, and bisections of each crossing."""
        if self.by_place.exact:
            return 48, 32, 10
        return (24, 12, 0) if self.arm.chain.has_loops else (40, 20, 4)

    @cached_property
    def by_sections(self) -> float | None:
        """Volume by sections (m³) of three slides, and of solids of revolution by a closed form; None of others."""
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
        rotations = self.orientations.some(count, rng_for(0, "poses"))
        wanted = PoseTarget(np.repeat(places, count, axis=0), np.tile(rotations, (len(places), 1, 1)))
        return np.asarray(self.by_pose.reached(wanted)[0].reshape(len(places), -1).mean(axis=1))

    def section(self, axes: tuple[int, int], level_m: float, orientations: int = 0) -> PlaneSection:
        """Compute a section across one of the base's axes.

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
        return PlaneSection(axes, level_m, right, up, reached, shares, vertices, segments)

    @cached_property
    def surface(self) -> tuple[Array, NDArray[np.int_]]:
        """Boundary of a volume as vertices ``(k, 3)`` m in the base and triangles ``(f, 3)``; empty of an area."""
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
    """Return quadrilaterals of segments in a half plane, turned about z."""
    angles = 2 * np.pi * np.arange(_SEGMENTS) / _SEGMENTS
    radii = np.maximum(vertices[:, 0], 0.0)
    radii[radii < 1e-9] = 0.0
    x, y = np.multiply.outer(np.cos(angles), radii), np.multiply.outer(np.sin(angles), radii)
    z = np.broadcast_to(vertices[:, 1], x.shape)
    first = np.arange(_SEGMENTS)[:, None] * len(vertices)
    after = (np.arange(1, _SEGMENTS + 1)[:, None] % _SEGMENTS) * len(vertices)
    start, end = segments.T
    quads = np.stack([first + start, after + start, after + end, first + end], axis=2)
    return np.stack([x, y, z], axis=2).reshape(-1, 3), quads.reshape(-1, 4)


def workspace_of(
    arm: RigidArm,
    values: Array,
    count: int | None,
    rng: np.random.Generator,
    progress: Progress = no_progress,
) -> Workspace:
    """Measure a robot's workspace.

    Args:
        values: parameters ``(p,)`` with one target.
        count: number of sampled places; by default as many as take a few seconds.
        progress: receives the number of places tested so far.

    Raises:
        LabError: the point stays on a line or a surface, which has no volume.
    """
    domain = domain_of(arm, values)
    by_place, by_pose = memberships(arm, values)
    some = _places_in_seconds(arm, by_place) if count is None else count
    found = measured(domain, by_place, some, rng, progress)
    return Workspace(arm, values, domain, by_place, by_pose, found, _orientations_of(arm, values))


def _places_in_seconds(arm: RigidArm, by_place: Membership) -> int:
    if not arm.chain.has_loops or by_place.exact:
        return 8192
    return 2048 if arm.chain.size <= 3 else 1024  # mechanisms with loops take longer
