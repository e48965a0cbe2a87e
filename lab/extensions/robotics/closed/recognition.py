"""Recognize a 2-RPR, a 3-RPR or a Delta in a nominal model, with the parameters of its closed forms.

It is read off its frames at passive values of zero: there slides have their directions, and each leg its two ends.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import product

import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.robotics.closed.delta import Delta
from lab.extensions.robotics.closed.planar_platforms import Distances, ThreeLegs, TwoLegs, left, wrapped
from lab.kinematics.closed.loop_closure import Configuration, Tree
from lab.kinematics.closed.mechanism import Mechanism, platform_poses

__all__ = [
    "ClassicalModel",
    "WorkingMode",
    "assembly_modes",
    "classical_model_of",
    "passive_values_of",
    "working_modes",
]

_ALIKE = 1e-9  # m, and of unit vectors: nominal dimensions that differ by less are one

_Motion = tuple[int, int]  # frame and step


@dataclass(frozen=True)
class ClassicalModel(ABC):
    """A mechanism's closed form, in the mechanism's own joint positions and passive values.

    Joint positions are ``(n, joints)`` and passive values ``(n, z)`` of the mechanism. The kind of the closed form
    answers by its methods.

    Attributes:
        order: ``(legs,)`` the joint of each leg of the closed form; others, as one that turns the tool in the platform,
            move none.
        sense, zero: ``(legs,)`` what the closed form takes of a leg's joint is zero + sense x joint position.
        axes, origin: ``(z, z)`` and ``(z,)``: the closed form's pose is axes @ (passive - origin).
        middle: ``(joints,)`` positions of joints that turn are given within half a turn of these.
        nominal: ``(z,)`` passive values of a platform that turns are given within half a turn of these.
    """

    order: tuple[int, ...]
    sense: Array
    zero: Array
    axes: Array
    origin: Array
    middle: Array
    nominal: Array

    @property
    @abstractmethod
    def name(self) -> str:
        """Common name of the mechanism."""

    @property
    @abstractmethod
    def is_planar(self) -> bool:
        """The mechanism moves in a plane."""

    @property
    @abstractmethod
    def dimensions(self) -> dict[str, Array]:
        """Its dimensions by name, which ends in the unit: ``_m`` or ``_rad``."""

    @property
    def singularities(self) -> tuple[str, ...]:
        """The kinds of singularities that it has, as ``Distances`` names them."""
        return Distances._fields[:2] if self.is_planar else Distances._fields

    @abstractmethod
    def modes(self, joints: Array) -> Array:
        """Passive values ``(n, m, z)`` of every way to assemble it; NaN where there are fewer, or none."""

    @abstractmethod
    def inverse_solutions(self, passive: Array) -> Array:
        """Joint positions ``(n, w, joints)``: a leg's are in a column, one solution below the other, NaN if none."""

    @abstractmethod
    def distances(self, joints: Array, passive: Array) -> Distances:
        """Compute the distances from singularities, at passive values that go with the joint positions."""

    def side(self, joints: Array, passive: Array) -> Array:
        """``(n,)`` on which side of parallel singularities it is, 1 or -1: the sign of det A; else 0 or NaN."""
        with np.errstate(invalid="ignore"):  # of what is not closed
            return np.asarray(np.sign(np.linalg.det(self._parallel_matrix(joints, passive))))

    @abstractmethod
    def _parallel_matrix(self, joints: Array, passive: Array) -> Array:
        """A ``(n, k, k)`` of A dX + B dq = 0."""

    def _of_legs(self, joints: Array) -> Array:
        """Convert joint positions to the closed form's leg coordinates, ``(n, legs)``."""
        return self.zero + self.sense * joints[:, self.order]

    def _of_joints(self, legs: Array) -> Array:
        """Joint positions ``(..., joints)`` of what the closed form gives of the legs; of others, their middle."""
        joints = np.broadcast_to(self.middle, (*legs.shape[:-1], len(self.middle))).copy()
        joints[..., self.order] = (legs - self.zero) * self.sense
        return joints

    def _pose(self, passive: Array) -> Array:
        """The closed form's pose ``(n, z)``."""
        return np.asarray((passive - self.origin) @ self.axes.T)

    def _passive(self, poses: Array) -> Array:
        """Passive values ``(..., z)`` of the closed form's poses."""
        return np.asarray(poses @ self.axes + self.origin)


@dataclass(frozen=True)
class ClassicalLegs(ClassicalModel):
    """A mechanism of legs in a plane, whose lengths are the joint positions."""

    model: TwoLegs | ThreeLegs
    is_planar = True

    def inverse_solutions(self, passive: Array) -> Array:
        """Return the one solution: the lengths of the legs."""
        return self._of_joints(self.model.inverse(self._pose(passive))[:, None])

    def distances(self, joints: Array, passive: Array) -> Distances:
        """Compute the distances from singularities, from the pose alone."""
        return self.model.distances(self._pose(passive))

    def _parallel_matrix(self, joints: Array, passive: Array) -> Array:
        return self.model.matrices(self._pose(passive))[0]


@dataclass(frozen=True)
class ClassicalRpr2(ClassicalLegs):
    """A mechanism that is a 2-RPR."""

    model: TwoLegs
    name = "2-RPR"

    @property
    def dimensions(self) -> dict[str, Array]:
        """Distance between the anchors."""
        return {"span_m": np.array(self.model.span_m)}

    def modes(self, joints: Array) -> Array:
        """Both, mirrored at the line through the anchors."""
        return self._passive(self.model.direct(self._of_legs(joints)))


@dataclass(frozen=True)
class ClassicalRpr3(ClassicalLegs):
    """A mechanism that is a 3-RPR."""

    model: ThreeLegs
    name = "3-RPR"

    @property
    def dimensions(self) -> dict[str, Array]:
        """The anchors in the base and the pins on the platform, in its plane."""
        return {"anchors_m": self.model.base, "pins_m": self.model.platform}

    def modes(self, joints: Array) -> Array:
        """Up to six, the platform turned as near to the nominal position as it can be."""
        found = self._passive(self.model.direct(self._of_legs(joints)))
        found[..., 2] = self.nominal[2] + wrapped(found[..., 2] - self.nominal[2])
        return found


@dataclass(frozen=True)
class ClassicalDelta(ClassicalModel):
    """A mechanism that is a Delta."""

    model: Delta
    name = "Delta"
    is_planar = False

    @property
    def dimensions(self) -> dict[str, Array]:
        """Radii of the base and the platform, lengths of the arms and the rods, and where the arms are."""
        lengths = ("base_radius_m", "platform_radius_m", "arm_m", "rod_m")
        return {name: np.array(getattr(self.model, name)) for name in lengths} | {
            "azimuths_rad": self.model.azimuths_rad
        }

    def modes(self, joints: Array) -> Array:
        """Both, with the platform on either side of the elbows."""
        return self._passive(self.model.direct(self._of_legs(joints)))

    def inverse_solutions(self, passive: Array) -> Array:
        """Both ways of each leg, within half a turn of the limits' middle."""
        joints = self._of_joints(self.model.inverse(self._pose(passive)))
        return np.asarray(self.middle + wrapped(joints - self.middle))

    def distances(self, joints: Array, passive: Array) -> Distances:
        """Compute the distances from singularities, from the pose and its arm angles."""
        return self.model.distances(self._pose(passive), self._of_legs(joints))

    def _parallel_matrix(self, joints: Array, passive: Array) -> Array:
        return self.model.matrices(self._pose(passive), self._of_legs(joints))[0]


def classical_model_of(mechanism: Mechanism) -> ClassicalModel | None:
    """The closed form of a mechanism, wherever it is placed; None where it is none of the three."""
    tree = mechanism.tree
    zeros = np.zeros((1, mechanism.size)), np.zeros((len(tree.passive), 1))
    configuration = Configuration.of(tree, mechanism.dimensions(mechanism.nominal_values), *zeros)
    legs = [_leg(tree, configuration, rod.ends) for rod in tree.rods]
    found = [leg for leg in legs if leg is not None]
    if tree.pins or not found or len(found) < len(legs):
        return None
    slides = tuple(tree.step(*step).is_turn for step in tree.passive)
    directions = np.stack([configuration.steps[f][s][0][:3, 0] for f, s in tree.passive])
    if not np.allclose(directions[:3] @ directions[:3].T, np.eye(min(len(slides), 3)), atol=_ALIKE):
        return None
    try:
        if slides == (False, False) and len(found) == 2:
            return _two_legs(mechanism, found, directions)
        if slides == (False, False, True) and len(found) == 3:
            return _three_legs(mechanism, found, directions, _origin(configuration, tree.passive[2]))
        if slides == (False, False, False) and len(found) == 3:
            return _delta(mechanism, configuration, found, directions)
    except LabError:  # dimensions that the model refuses
        return None
    return None


@dataclass(frozen=True)
class _Leg:
    """A rod: its end nearer to the base ``(3,)`` m, the motions that move it, and its end on the platform."""

    near: Array
    moves: tuple[_Motion, ...]
    far: Array


def _leg(tree: Tree, configuration: Configuration, ends: tuple[int, int]) -> _Leg | None:
    """A rod between what passive values do not move and what all of them move, and no joint."""
    near, far = sorted(ends, key=lambda end: tree.loose[end])
    on_the_platform = [step for step in tree.ancestry(far) if _moves(tree, step)]
    if tree.loose[near] or on_the_platform != list(tree.passive):
        return None
    places = [configuration.frames[end][1][:3, 0] for end in (near, far)]
    return _Leg(places[0], tuple(step for step in tree.ancestry(near) if _moves(tree, step)), places[1])


def _moves(tree: Tree, step: _Motion) -> bool:
    described = tree.step(*step)
    return described.passive or described.joint is not None


def _origin(configuration: Configuration, step: _Motion) -> Array:
    """Return a point ``(3,)`` on a turn's axis."""
    origin = configuration.steps[step[0]][step[1]][1]
    assert origin is not None
    return np.asarray(origin[:3, 0])


def _of_measured_lengths(mechanism: Mechanism, legs: list[_Leg]) -> tuple[tuple[int, ...], Array, Array] | None:
    """Order, sense and zero of legs whose lengths the joints are; None where they are not."""
    rods = mechanism.tree.rods
    order = tuple(rod.joint for rod in rods if rod.joint is not None)
    if len(order) < len(rods) or any(leg.moves for leg in legs):
        return None
    return order, mechanism.sign[list(order)], np.array([rod.length_m for rod in rods])


def _two_legs(mechanism: Mechanism, legs: list[_Leg], directions: Array) -> ClassicalModel | None:
    """The platform does not turn, so that legs to different places on it are legs to one pin from moved anchors."""
    measured = _of_measured_lengths(mechanism, legs)
    anchors = np.stack([leg.near - leg.far for leg in legs])
    if measured is None or np.abs(anchors @ np.cross(*directions)).max() > _ALIKE:
        return None
    first, second = anchors @ directions.T
    model = TwoLegs(float(np.hypot(*(second - first))))
    along = (second - first) / model.span_m
    return ClassicalRpr2(*measured, np.stack([along, left(along)]), first, *_ranges(mechanism), model)


def _three_legs(mechanism: Mechanism, legs: list[_Leg], directions: Array, pivot: Array) -> ClassicalModel | None:
    """The platform's frame is where it turns about."""
    measured = _of_measured_lengths(mechanism, legs)
    normal = np.cross(*directions[:2])
    heights = np.array([(leg.near - leg.far) @ normal for leg in legs])
    if measured is None or max(np.abs(heights).max(), 1 - abs(directions[2] @ normal)) > _ALIKE:
        return None
    base, platform = (np.stack([(end - pivot) @ directions[:2].T for end in ends])
                      for ends in ([leg.near for leg in legs], [leg.far for leg in legs]))  # fmt: skip
    turn = np.sign(directions[2] @ normal)
    model = ThreeLegs(base, platform)
    return ClassicalRpr3(*measured, np.diag([1.0, 1.0, turn]), np.zeros(3), *_ranges(mechanism), model)


def _delta(
    mechanism: Mechanism, configuration: Configuration, legs: list[_Leg], directions: Array
) -> ClassicalModel | None:
    """Hips on a level circle about its centre, rods' ends on another, arms that turn about tangents of the first."""
    tree, lengths = mechanism.tree, [rod.length_m for rod in mechanism.tree.rods]
    movers = [leg.moves[0] for leg in legs if len(leg.moves) == 1 and tree.step(*leg.moves[0]).is_turn]
    if len(movers) < 3 or np.ptp(lengths) > _ALIKE:
        return None
    axes = np.stack([configuration.steps[f][s][0][:3, 0] for f, s in movers])
    levers = np.stack([leg.near - _origin(configuration, mover) for leg, mover in zip(legs, movers, strict=True)])
    arms = levers - (levers * axes).sum(axis=1, keepdims=True) * axes
    hips, ends = np.stack([leg.near for leg in legs]) - arms, np.stack([leg.far for leg in legs])
    sizes = np.linalg.norm(arms, axis=1)
    normals = np.cross(axes[[0, 1, 2]], axes[[1, 2, 0]])
    up = normals[np.argmax(np.linalg.norm(normals, axis=1))]
    if np.ptp(sizes) > _ALIKE or np.linalg.norm(up) < _ALIKE:
        return None
    drawn = np.array([tree.step(*step).value for step in tree.passive])
    up = up / np.linalg.norm(up) * (-1.0 if (ends[0] + drawn @ directions - hips[0]) @ up > 0 else 1.0)
    if np.abs(axes @ up).max() > _ALIKE:
        return None
    for signs in product((1.0, -1.0), repeat=3):
        outward = np.array(signs)[:, None] * np.cross(axes, up)
        centre, base_radius = _circle(hips, outward)
        middle, platform_radius = _circle(ends, outward)
        if base_radius >= 0 and platform_radius >= 0:
            break
    else:
        return None
    x = np.eye(3)[np.argmin(np.abs(up[:2]))]
    x = (x - (x @ up) * up) / np.linalg.norm(x - (x @ up) * up)
    y = np.cross(up, x)
    azimuths = np.arctan2(outward @ y, outward @ x)
    order = tuple(joint for mover in movers if (joint := tree.step(*mover).joint) is not None)
    sense = np.sign((axes * np.cross(up, outward)).sum(axis=1)) * mechanism.sign[list(order)]
    zero = np.arctan2(-(arms @ up), (arms * outward).sum(axis=1))
    model = Delta(base_radius, platform_radius, float(sizes[0]), float(lengths[0]), azimuths)
    rows = np.stack([x, y, up]) @ directions.T
    return ClassicalDelta(order, sense, zero, rows, -directions @ (middle - centre), *_ranges(mechanism), model)


def _circle(points: Array, outward: Array) -> tuple[Array, float]:
    """Centre and radius of the circle that points ``(3, 3)`` lie on, in these directions; a radius of NaN if none."""
    unknowns = np.concatenate([np.tile(np.eye(3), (3, 1)), outward.reshape(9, 1)], axis=1)
    found = np.linalg.lstsq(unknowns, points.ravel(), rcond=None)[0]
    if np.abs(unknowns @ found - points.ravel()).max() > _ALIKE:
        return found[:3], np.nan
    return found[:3], 0.0 if abs(found[3]) < _ALIKE else float(found[3])


def _ranges(mechanism: Mechanism) -> tuple[Array, Array]:
    """Joint positions and passive values about which angles are given."""
    drawn = np.array([mechanism.tree.step(*step).value for step in mechanism.tree.passive])
    return (mechanism.lower + mechanism.upper) / 2, drawn


@dataclass(frozen=True)
class WorkingMode:
    """An IK solution of the legs for a pose.

    Attributes:
        joints: ``(joints,)`` joint positions, rad or m.
        branches: of each joint 0 or 1: the first or the second branch of its leg; of a leg with one branch 0.
    """

    joints: Array
    branches: tuple[int, ...]


def assembly_modes(mechanism: Mechanism, classical: ClassicalModel, joints: Array) -> Array:
    """The poses ``(m, 4, 4)`` of the platform in every assembly mode at joint positions ``(joints,)``."""
    passive = classical.modes(joints[None])[0]
    passive = passive[np.isfinite(passive).all(axis=1)]
    return platform_poses(mechanism, np.tile(joints, (len(passive), 1)), passive)


def passive_values_of(mechanism: Mechanism, T_base_platform: Array) -> tuple[Array, float]:
    """The passive values ``(z,)`` that bring the nominal platform nearest to a pose ``(4, 4)``, and what it misses.

    The platform moves by slides at right angles, and turns about one axis through its origin or not at all.

    Returns:
        The passive values, and by how much (m, a radian as a metre) the pose is missed.
    """
    tree = mechanism.tree
    turns = [i for i, step in enumerate(tree.passive) if tree.step(*step).is_turn]
    slides = [i for i in range(len(tree.passive)) if i not in turns]
    joints, found = mechanism.home[None], np.zeros(len(tree.passive))
    for i in turns:
        start, turned = (
            platform_poses(mechanism, joints, row[None])[0, :3, :3] for row in (found, np.eye(len(found))[i])
        )
        axis = se3.log(turned @ start.T)
        found[i] = float(axis @ se3.log(T_base_platform[:3, :3] @ start.T))
    start = platform_poses(mechanism, joints, found[None])[0, :3, 3]
    moved = [platform_poses(mechanism, joints, (found + np.eye(len(found))[i])[None])[0, :3, 3] - start for i in slides]
    found[slides] = np.linalg.lstsq(np.array(moved).T, T_base_platform[:3, 3] - start, rcond=None)[0]
    reached = platform_poses(mechanism, joints, found[None])[0]
    turned_off = se3.log(T_base_platform[:3, :3] @ reached[:3, :3].T)
    missed = np.concatenate([T_base_platform[:3, 3] - reached[:3, 3], turned_off])
    return found, float(np.linalg.norm(missed))


def working_modes(mechanism: Mechanism, course: ClassicalModel, passive: Array) -> list[WorkingMode]:
    """Return every IK solution for the pose of passive values ``(z,)``; none where a leg does not reach it."""
    ways = course.inverse_solutions(passive[None])[0]  # (w, joints)
    of_legs = [np.flatnonzero(np.isfinite(column)) for column in ways.T]
    choices = [found if j in course.order else found[:1] for j, found in enumerate(of_legs)]
    rows = np.arange(mechanism.size)
    return [WorkingMode(ways[list(each), rows], tuple(int(i) for i in each)) for each in product(*choices)]
