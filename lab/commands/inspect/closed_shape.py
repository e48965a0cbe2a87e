"""What the shape of a mechanism with loops says before anything is measured: freedoms, places, what is singular."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.closed.classical.singularity import Distances
from lab.kinematics.closed.classical_recognition import ClassicalModel, classical_model_of
from lab.kinematics.closed.configuration import Configuration
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.closed.modes import platform_poses
from lab.kinematics.joints import JointSpec
from lab.kinematics.workspace.membership import ByLegs
from lab.kinematics.workspace.reach import extents

__all__ = ["SINGULAR", "ClosedShape", "closed_shape_of"]

TAKES = 4000  # random readings by which extents are found
GRID = 60_000  # poses, at most, of the count of what is reachable
WALKERS, STEPS = 32, 150  # of the search for singular poses
FIRST, SHRINKING = 0.05, 0.9  # its first step, beside the limits' width, and what each makes of the next
SINGULAR = 1e-3  # a distance below which a pose is at a singularity
RANK = 1e-9  # of the largest singular value


@dataclass(frozen=True)
class Nearest:
    """How near the drawn mode comes to a kind of singularity, within the limits.

    Attributes:
        distance: 0 at one, 1 at best (``Distances``).
        joints: ``(n,)`` readings of the pose that is nearest to one.
        place: ``(3,)`` m, where the platform's origin is there in the base.
    """

    kind: str
    distance: float
    joints: Array
    place: Array


@dataclass(frozen=True)
class ClosedShape:
    """Of a drawing, in the drawn mode.

    Attributes:
        mobility: joints and passive values less the closures' equations.
        freedoms: joints and passive values less the rank of what they do to the closures at home.
        course: its closed form, if it has one; without, what follows from it is None or empty.
        modes: ways to assemble it at the readings of home.
        working: ways of its legs to reach the pose of home.
        share: of readings within the limits those at which the loops close.
        extents: ``(3, 2)`` least and largest coordinates (m) of the platform's origin in the base.
        reachable: area (m^2) of a planar robot, else volume (m^3), that the platform gets to by its passive slides.
        conditions: of the closures by the passive values: the least, the middle and the largest.
    """

    mobility: int
    freedoms: int
    course: ClassicalModel | None
    modes: int | None
    working: int | None
    share: float
    extents: Array
    reachable: float | None
    conditions: Array
    singularities: tuple[Nearest, ...]


def closed_shape_of(mechanism: Mechanism) -> ClosedShape:
    """The shape of a mechanism as drawn."""
    taken = JointSpec.random_joints(mechanism, TAKES, rng_for(0, "structure"))
    closed = mechanism.assembled(taken, mechanism.nominal_values)
    joints, passive = taken[closed.fits], closed.configuration.passive.T[closed.fits]
    home = mechanism.assembled(mechanism.home[None], mechanism.nominal_values).configuration
    course, places = classical_model_of(mechanism), _places(mechanism, joints, passive)
    search = None if course is None else _Search(mechanism, course, joints, passive)
    found = () if search is None else search.singularities()
    extents = _extents(mechanism, joints, places, [each.place for each in found])
    modes = None if course is None else np.isfinite(course.modes(mechanism.home[None])).all(axis=2).sum()
    ways = None if course is None else course.inverse_solutions(home.passive.T)[..., course.order]
    working = None if ways is None else np.isfinite(ways).sum(axis=1).prod()
    return ClosedShape(
        mobility=mechanism.size + len(mechanism.tree.passive) - mechanism.tree.equations,
        freedoms=mechanism.size + len(mechanism.tree.passive) - _rank(home),
        course=course,
        modes=None if modes is None else int(modes),
        working=None if working is None else int(working),
        share=float(closed.fits.mean()),
        extents=extents,
        reachable=None if search is None else search.reachable(),
        conditions=np.quantile(closed.condition[closed.fits], [0.0, 0.5, 1.0]),
        singularities=found,
    )


def _extents(mechanism: Mechanism, joints: Array, places: Array, others: Sequence[Array]) -> Array:
    """The least and largest coordinates ``(3, 2)`` m of the platform's origin, within the limits."""

    def places_of(tried: Array) -> Array:
        closed = mechanism.assembled(tried, mechanism.nominal_values, quickly=True)
        fits, found = closed.fits, np.full((len(tried), 3), np.nan)
        found[fits] = _places(mechanism, tried[fits], closed.configuration.passive.T[fits])
        return found

    return extents(mechanism, places_of, joints, places, others)


def _places(mechanism: Mechanism, joints: Array, passive: Array) -> Array:
    """Of the platform's origin in the base ``(n, 3)`` m."""
    return platform_poses(mechanism, joints, passive)[:, :3, 3]


def _rank(configuration: Configuration) -> int:
    """Of the closures' derivatives by all that moves, in a configuration of one pose."""
    tree, directions = configuration.tree, configuration.closures()[1]
    rows = np.zeros((tree.equations, len(tree.passive) + len(configuration.joint_values)))
    for i, opening in enumerate(tree.openings):
        for step, end, sign in opening:
            described = tree.step(*step)
            if described.passive or described.joint is not None:
                slope = configuration.slope(step, configuration.frames[end][1], directions[i])
                moved = tree.passive.index(step) if described.joint is None else len(tree.passive) + described.joint
                rows[i, moved] += sign * float(np.ravel(slope)[0])
    for i, rod in enumerate(tree.rods):
        if rod.joint is not None:
            rows[i, len(tree.passive) + rod.joint] -= 1.0
    sizes = np.linalg.svd(rows, compute_uv=False)
    return int((sizes > RANK * sizes.max(initial=0.0)).sum())


@dataclass(frozen=True)
class _Search:
    """By a closed form, from readings ``(n, joints)`` and passive values ``(n, z)`` of some poses in the drawn mode.

    Poses on the other side of parallel singularities are of other modes.
    """

    mechanism: Mechanism
    course: ClassicalModel
    joints: Array
    passive: Array

    @cached_property
    def legs(self) -> ByLegs:
        """What its legs reach."""
        return ByLegs(self.mechanism, self.course)

    def reachable(self) -> float:
        """Area or volume, by counting the cells of a grid whose middle is reached, however the platform is turned."""
        low, high = self.passive.min(axis=0), self.passive.max(axis=0)
        count = int(GRID ** (1 / len(low)))
        margin = (high - low) / (count - 2) / 2
        edges = [np.linspace(*ends, count + 1) for ends in zip(low - margin, high + margin, strict=True)]
        grid = np.meshgrid(*[(edge[1:] + edge[:-1]) / 2 for edge in edges], indexing="ij")
        poses = np.stack([each.ravel() for each in grid], axis=1)
        reached = self.legs.reached(poses)[0].reshape(grid[0].shape)
        turns = [self.mechanism.tree.step(*step).is_turn for step in self.mechanism.tree.passive]
        cell = np.prod([edge[1] - edge[0] for edge, turn in zip(edges, turns, strict=True) if not turn])
        return float(cell * reached.any(axis=tuple(np.flatnonzero(turns))).sum())

    def singularities(self) -> tuple[Nearest, ...]:
        """Of each kind that the robot has."""
        return tuple(self._nearest(kind) for kind in self.course.singularities)

    def _nearest(self, kind: str) -> Nearest:
        """By walks from the nearest poses, with random steps that shrink; each is taken where it leads nearer."""
        mechanism, rng = self.mechanism, rng_for(0, "structure", Distances._fields.index(kind))
        starts = np.argsort(self._distance(kind, self.joints, self.passive))[:WALKERS]
        joints, passive = self.joints[starts], self.passive[starts]
        distance = self._distance(kind, joints, passive)
        step = FIRST * (mechanism.upper - mechanism.lower)
        for _ in range(STEPS):
            if distance.min() < SINGULAR:
                break
            tried = np.clip(joints + step * rng.standard_normal(joints.shape), mechanism.lower, mechanism.upper)
            closing = self._closing(tried, passive)
            found = self._distance(kind, tried, closing)
            nearer = (found < distance) & (self.course.side(tried, closing) == self.legs.side)
            joints[nearer], passive[nearer], distance[nearer] = tried[nearer], closing[nearer], found[nearer]
            step = SHRINKING * step
        best = int(np.argmin(distance))
        place = _places(mechanism, joints[best : best + 1], passive[best : best + 1])[0]
        return Nearest(kind, float(distance[best]), joints[best], place)

    def _closing(self, joints: Array, near: Array) -> Array:
        """Passive values ``(n, z)`` of the mode that is nearest to some; NaN where there is none."""
        modes = self.course.modes(joints)
        away = np.nan_to_num(np.abs(modes - near[:, None]).max(axis=2), nan=np.inf)
        return np.take_along_axis(modes, away.argmin(axis=1)[:, None, None], axis=1)[:, 0]

    def _distance(self, kind: str, joints: Array, passive: Array) -> Array:
        return np.asarray(getattr(self.course.distances(joints, passive), kind))
