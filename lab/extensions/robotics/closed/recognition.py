"""Recognize a 2-RPR, a 3-RPR or a Delta in a nominal model, with the parameters of its closed forms.

The closed form is read off the mechanism's frames at passive values of zero: there slides have their directions, and
each leg its two ends.
"""

from dataclasses import dataclass, fields
from itertools import product

import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.robotics.closed.classical_mechanisms import Delta, Distances, ThreeLegs, TwoLegs, left, wrapped
from lab.kinematics.closed.loop_closure import Configuration, Tree
from lab.kinematics.closed.mechanism import Mechanism, platform_poses

__all__ = [
    "ClassicalModel",
    "MeasuredLegs",
    "assembly_modes",
    "classical_model_of",
    "measured_legs_of",
    "passive_values_of",
    "working_modes",
]

_ALIKE = 1e-9  # m, and of unit vectors: nominal dimensions that differ by less are one

_Motion = tuple[int, int]  # frame and step


@dataclass(frozen=True)
class ClassicalModel:
    """A mechanism's closed form, in the mechanism's own joint positions and passive values.

    Joint positions are ``(n, joints)`` and passive values ``(n, z)`` of the mechanism.

    Attributes:
        model: the closed form; of legs in a plane the joint positions are their lengths.
        order: ``(legs,)`` the joint of each leg of the closed form; others, as one that turns the tool in the platform,
            move none.
        sense, zero: ``(legs,)`` the leg coordinate of the closed form is zero + sense x joint position.
        axes, origin: ``(z, z)`` and ``(z,)``: the closed form's pose is axes @ (passive - origin).
        middle: ``(joints,)`` positions of joints that turn are given within half a turn of these.
        nominal: ``(z,)`` passive values of a platform that turns are given within half a turn of these.
    """

    model: TwoLegs | ThreeLegs | Delta
    order: tuple[int, ...]
    sense: Array
    zero: Array
    axes: Array
    origin: Array
    middle: Array
    nominal: Array

    @property
    def name(self) -> str:
        """Common name of the mechanism."""
        return {TwoLegs: "2-RPR", ThreeLegs: "3-RPR", Delta: "Delta"}[type(self.model)]

    @property
    def is_planar(self) -> bool:
        """The mechanism moves in a plane."""
        return not isinstance(self.model, Delta)

    @property
    def dimensions(self) -> dict[str, Array]:
        """Dimensions by name, which ends in the unit: ``_m`` or ``_rad``."""
        if isinstance(self.model, TwoLegs):
            return {"span_m": np.array(self.model.span_m)}
        if isinstance(self.model, ThreeLegs):
            return {"anchors_m": self.model.base, "pins_m": self.model.platform}
        return {field.name: np.array(getattr(self.model, field.name)) for field in fields(self.model)}

    @property
    def singularities(self) -> tuple[str, ...]:
        """The kinds of singularities of the mechanism, as ``Distances`` names them."""
        return Distances._fields[:2] if self.is_planar else Distances._fields

    def modes(self, joints: Array) -> Array:
        """Return passive values ``(n, m, z)`` of all assembly modes, and NaN where there are fewer.

        A platform that turns is turned as near to the nominal position as it can be.
        """
        passive = np.asarray(self.model.direct(self._of_legs(joints)) @ self.axes + self.origin)
        if isinstance(self.model, ThreeLegs):
            passive[..., 2] = self.nominal[2] + wrapped(passive[..., 2] - self.nominal[2])
        return passive

    def inverse_solutions(self, passive: Array) -> Array:
        """Return joint positions ``(n, w, joints)``: each column has its leg's solutions, and NaN where there is none.

        Joints that move no leg are in the middle of their limits.
        """
        legs = self.model.inverse(self._pose(passive))
        if self.is_planar:
            legs = legs[:, None]
        joints = np.broadcast_to(self.middle, (*legs.shape[:-1], len(self.middle))).copy()
        joints[..., self.order] = (legs - self.zero) * self.sense
        return joints if self.is_planar else np.asarray(self.middle + wrapped(joints - self.middle))

    def distances(self, joints: Array, passive: Array) -> Distances:
        """Compute the distances from singularities, at passive values that go with the joint positions."""
        if isinstance(self.model, Delta):
            return self.model.distances(self._pose(passive), self._of_legs(joints))
        return self.model.distances(self._pose(passive))

    def side(self, joints: Array, passive: Array) -> Array:
        """Return the side ``(n,)`` of parallel singularities, the sign of det A of A dX + B dq = 0: 1, -1, 0 or NaN."""
        pose = self._pose(passive)
        with np.errstate(invalid="ignore"):  # of what is not closed
            if isinstance(self.model, Delta):
                A, _ = self.model.matrices(pose, self._of_legs(joints))
            else:
                A, _ = self.model.matrices(pose)
            return np.asarray(np.sign(np.linalg.det(A)))

    def _of_legs(self, joints: Array) -> Array:
        return self.zero + self.sense * joints[:, self.order]

    def _pose(self, passive: Array) -> Array:
        return np.asarray((passive - self.origin) @ self.axes.T)


def classical_model_of(mechanism: Mechanism) -> ClassicalModel | None:
    """Return the closed form of a mechanism, wherever it is placed; None where it is none of the three."""
    tree = mechanism.tree
    zeros = np.zeros((1, mechanism.size)), np.zeros((len(tree.passive), 1))
    configuration = Configuration.of(tree, mechanism.dimensions(mechanism.nominal_values), *zeros)
    legs = _legs(tree, configuration)
    if tree.pins or not legs or len(legs) < len(tree.rods):
        return None
    directions = np.stack([configuration.steps[f][s][0][:3, 0] for f, s in tree.passive])
    if not np.allclose(directions[:3] @ directions[:3].T, np.eye(min(len(directions), 3)), atol=_ALIKE):
        return None
    try:
        return _of_kind(mechanism, configuration, legs, directions)
    except LabError:  # dimensions that the model refuses
        return None


def _of_kind(
    mechanism: Mechanism, configuration: Configuration, legs: "list[_Leg]", directions: Array
) -> ClassicalModel | None:
    """Return the closed form of legs to a platform with these passive slides and turns."""
    turns = tuple(mechanism.tree.step(*step).is_turn for step in mechanism.tree.passive)
    if turns == (False, False) and len(legs) == 2:
        return _two_legs(mechanism, legs, directions)
    if turns == (False, False, True) and len(legs) == 3:
        return _three_legs(mechanism, legs, directions, _origin(configuration, mechanism.tree.passive[2]))
    if turns == (False, False, False) and len(legs) == 3:
        return _delta(mechanism, configuration, legs, directions)
    return None


@dataclass(frozen=True)
class _Leg:
    """A rod: its end nearer to the base ``(3,)`` m, the motions that move it, and its end on the platform."""

    near: Array
    moves: tuple[_Motion, ...]
    far: Array


def _legs(tree: Tree, configuration: Configuration) -> list[_Leg]:
    """Return the rods that are legs from what no passive value moves to the platform."""
    return [leg for rod in tree.rods if (leg := _leg(tree, configuration, rod.ends)) is not None]


def _leg(tree: Tree, configuration: Configuration, ends: tuple[int, int]) -> _Leg | None:
    """Return a rod whose one end no passive value moves, and whose other end all of them move, but no joint."""
    near, far = sorted(ends, key=lambda end: tree.loose[end])
    if tree.loose[near] or _motions(tree, far) != tree.passive:
        return None
    places = [configuration.frames[end][1][:3, 0] for end in (near, far)]
    return _Leg(places[0], _motions(tree, near), places[1])


def _motions(tree: Tree, frame: int) -> tuple[_Motion, ...]:
    """Return the joints and passive values that move a frame."""
    return tuple(
        step for step in tree.ancestry(frame) if tree.step(*step).passive or tree.step(*step).joint is not None
    )


def _origin(configuration: Configuration, step: _Motion) -> Array:
    """Return a point ``(3,)`` on a turn's axis."""
    origin = configuration.steps[step[0]][step[1]][1]
    assert origin is not None
    return np.asarray(origin[:3, 0])


def _of_measured_lengths(mechanism: Mechanism, legs: list[_Leg]) -> tuple[tuple[int, ...], Array, Array] | None:
    """Return order, sense and zero of legs whose lengths are the joint positions; None of other legs."""
    rods = mechanism.tree.rods
    order = tuple(rod.joint for rod in rods if rod.joint is not None)
    if len(order) < len(rods) or any(leg.moves for leg in legs):
        return None
    return order, mechanism.sign[list(order)], np.array([rod.length_m for rod in rods])


def _two_legs(mechanism: Mechanism, legs: list[_Leg], directions: Array) -> ClassicalModel | None:
    """Recognize a 2-RPR: the platform does not turn, so that all legs go to one pin, from shifted anchors."""
    measured = _of_measured_lengths(mechanism, legs)
    anchors = np.stack([leg.near - leg.far for leg in legs])
    if measured is None or np.abs(anchors @ np.cross(*directions)).max() > _ALIKE:
        return None
    first, second = anchors @ directions.T
    model = TwoLegs(float(np.hypot(*(second - first))))
    along = (second - first) / model.span_m
    return ClassicalModel(model, *measured, np.stack([along, left(along)]), first, *_ranges(mechanism))


def _three_legs(mechanism: Mechanism, legs: list[_Leg], directions: Array, pivot: Array) -> ClassicalModel | None:
    """Recognize a 3-RPR, with the platform's frame at the pivot of its turn."""
    measured = _of_measured_lengths(mechanism, legs)
    normal = np.cross(*directions[:2])
    heights = np.array([(leg.near - leg.far) @ normal for leg in legs])
    if measured is None or max(np.abs(heights).max(), 1 - abs(directions[2] @ normal)) > _ALIKE:
        return None
    base = np.stack([(leg.near - pivot) @ directions[:2].T for leg in legs])
    platform = np.stack([(leg.far - pivot) @ directions[:2].T for leg in legs])
    turn = np.sign(directions[2] @ normal)
    model = ThreeLegs(base, platform)
    return ClassicalModel(model, *measured, np.diag([1.0, 1.0, turn]), np.zeros(3), *_ranges(mechanism))


def _delta(
    mechanism: Mechanism, configuration: Configuration, legs: list[_Leg], directions: Array
) -> ClassicalModel | None:
    """Recognize a Delta: hips on a circle, rod ends on another, and arms that turn about tangents of the first."""
    tree, lengths = mechanism.tree, [rod.length_m for rod in mechanism.tree.rods]
    # arms of one length, which turn about axes in a plane
    movers = _turning_arms(tree, legs)
    if len(movers) < 3 or np.ptp(lengths) > _ALIKE:
        return None
    axes, arms, hips, ends = _arms(configuration, legs, movers)
    sizes = np.linalg.norm(arms, axis=1)
    ranges = _ranges(mechanism)
    up = _upward(axes, ends[0] + ranges[1] @ directions - hips[0])
    if up is None or np.ptp(sizes) > _ALIKE:
        return None
    # hips and rod ends on circles, of which the axes of the arms are tangents
    circles = _circles(hips, ends, np.cross(axes, up))
    if circles is None:
        return None
    outward, (centre, base_radius), (middle, platform_radius) = circles
    # azimuths, senses and zeros of the arms in a frame whose z leads away from the platform
    x = np.eye(3)[np.argmin(np.abs(up[:2]))]
    x = (x - (x @ up) * up) / np.linalg.norm(x - (x @ up) * up)
    y = np.cross(up, x)
    azimuths = np.arctan2(outward @ y, outward @ x)
    order = tuple(joint for mover in movers if (joint := tree.step(*mover).joint) is not None)
    sense = np.sign((axes * np.cross(up, outward)).sum(axis=1)) * mechanism.sign[list(order)]
    zero = np.arctan2(-(arms @ up), (arms * outward).sum(axis=1))
    model = Delta(base_radius, platform_radius, float(sizes[0]), float(lengths[0]), azimuths)
    rows = np.stack([x, y, up]) @ directions.T
    return ClassicalModel(model, order, sense, zero, rows, -directions @ (middle - centre), *ranges)


def _turning_arms(tree: Tree, legs: list[_Leg]) -> list[_Motion]:
    """Return the joint of each leg that one joint turns."""
    return [leg.moves[0] for leg in legs if len(leg.moves) == 1 and tree.step(*leg.moves[0]).is_turn]


def _arms(configuration: Configuration, legs: list[_Leg], movers: list[_Motion]) -> tuple[Array, Array, Array, Array]:
    """Return axes of the arms, arms across them from the axes to the rods, hips, and rod ends, ``(3, 3)`` m."""
    axes = np.stack([configuration.steps[f][s][0][:3, 0] for f, s in movers])
    levers = np.stack([leg.near - _origin(configuration, mover) for leg, mover in zip(legs, movers, strict=True)])
    arms = levers - (levers * axes).sum(axis=1, keepdims=True) * axes
    return axes, arms, np.stack([leg.near for leg in legs]) - arms, np.stack([leg.far for leg in legs])


def _upward(axes: Array, to_platform: Array) -> Array | None:
    """Return the direction across all axes ``(3, 3)`` that leads away from the platform; None where there is none."""
    normals = np.cross(axes[[0, 1, 2]], axes[[1, 2, 0]])
    normal = normals[np.argmax(np.linalg.norm(normals, axis=1))]
    if np.linalg.norm(normal) < _ALIKE:
        return None
    up = normal / np.linalg.norm(normal) * (-1.0 if to_platform @ normal > 0 else 1.0)
    return None if np.abs(axes @ up).max() > _ALIKE else np.asarray(up)


def _circles(
    hips: Array, ends: Array, tangents: Array
) -> tuple[Array, tuple[Array, float], tuple[Array, float]] | None:
    """Fit circles to hips and rod ends ``(3, 3)``; return directions outward and each one's centre and radius."""
    for signs in product((1.0, -1.0), repeat=3):
        outward = np.array(signs)[:, None] * tangents
        base, platform = _circle(hips, outward), _circle(ends, outward)
        if base[1] >= 0 and platform[1] >= 0:
            return outward, base, platform
    return None


def _circle(points: Array, outward: Array) -> tuple[Array, float]:
    """Fit a circle to points ``(3, 3)`` in these directions from its centre: centre and radius, or NaN."""
    unknowns = np.concatenate([np.tile(np.eye(3), (3, 1)), outward.reshape(9, 1)], axis=1)
    *centre, radius = np.linalg.lstsq(unknowns, points.ravel(), rcond=None)[0]
    if np.abs(unknowns @ [*centre, radius] - points.ravel()).max() > _ALIKE:
        return np.array(centre), np.nan
    return np.array(centre), 0.0 if abs(radius) < _ALIKE else float(radius)


def _ranges(mechanism: Mechanism) -> tuple[Array, Array]:
    """Return the joint positions and passive values about which angles are given."""
    drawn = np.array([mechanism.tree.step(*step).value for step in mechanism.tree.passive])
    return (mechanism.lower + mechanism.upper) / 2, drawn


@dataclass(frozen=True)
class _WorkingMode:
    """An IK solution of the legs for a pose.

    Attributes:
        joints: ``(joints,)`` joint positions, rad or m.
        branches: of each joint 0 or 1: the first or the second branch of its leg; of a leg with one branch 0.
    """

    joints: Array
    branches: tuple[int, ...]


@dataclass(frozen=True)
class MeasuredLegs:
    """Legs of measured lengths from a base to a platform with six degrees of freedom: each pose has one set of lengths.

    Attributes:
        near: ``(legs, 3)`` m, the legs' ends on the base.
        far: ``(legs, 3)`` m, those on the platform, in its frame.
        order, sense, zero: ``(legs,)`` a leg's length is zero + sense x the position of joint ``order``.
    """

    near: Array
    far: Array
    order: tuple[int, ...]
    sense: Array
    zero: Array

    def joints(self, Ts_base_platform: Array) -> Array:
        """Return the joint positions ``(..., joints)`` at poses ``(..., 4, 4)`` (m)."""
        lengths = np.linalg.norm(se3.transform(Ts_base_platform, self.far) - self.near, axis=-1)
        joints = np.empty(lengths.shape)
        joints[..., list(self.order)] = (lengths - self.zero) * self.sense
        return joints


def measured_legs_of(mechanism: Mechanism) -> MeasuredLegs | None:
    """Return the legs of a mechanism whose joints are their lengths, if six passive values move its platform."""
    tree = mechanism.tree
    drawn = _ranges(mechanism)[1][None]
    dimensions = mechanism.dimensions(mechanism.nominal_values)
    configuration = Configuration.of(tree, dimensions, np.zeros((1, mechanism.size)), drawn.T)
    legs = _legs(tree, configuration)
    alone = _motions(tree, tree.platform) == tree.passive
    if tree.pins or len(tree.passive) != 6 or not alone or not len(legs) == len(tree.rods) == mechanism.size:
        return None
    measured = _of_measured_lengths(mechanism, legs)
    if measured is None:
        return None
    T_base_platform = platform_poses(mechanism, mechanism.home[None], drawn)[0]
    far = se3.transform(se3.inverse(T_base_platform), np.stack([leg.far for leg in legs]))
    return MeasuredLegs(np.stack([leg.near for leg in legs]), far, *measured)


def assembly_modes(mechanism: Mechanism, classical: ClassicalModel, joints: Array) -> Array:
    """Return the platform's poses ``(m, 4, 4)`` in all assembly modes at joint positions ``(joints,)``."""
    passive = classical.modes(joints[None])[0]
    passive = passive[np.isfinite(passive).all(axis=1)]
    return platform_poses(mechanism, np.tile(joints, (len(passive), 1)), passive)


def passive_values_of(mechanism: Mechanism, T_base_platform: Array, joints: Array | None = None) -> tuple[Array, float]:
    """Find the passive values that bring the nominal platform nearest to a pose ``(4, 4)``.

    The platform moves by slides at right angles, and turns about one axis through its origin or not at all.

    Args:
        joints: ``(joints,)`` positions of those that turn the tool in the platform; by default all are at home.

    Returns:
        The passive values ``(z,)``, and by how much (m, a radian as a metre) the pose is missed.
    """
    tree = mechanism.tree
    turns = [i for i, step in enumerate(tree.passive) if tree.step(*step).is_turn]
    slides = [i for i in range(len(tree.passive)) if i not in turns]
    joints, passive = (mechanism.home if joints is None else joints)[None], np.zeros(len(tree.passive))
    for i in turns:
        start, turned = (
            platform_poses(mechanism, joints, row[None])[0, :3, :3] for row in (passive, np.eye(len(passive))[i])
        )
        axis = se3.log(turned @ start.T)
        passive[i] = float(axis @ se3.log(T_base_platform[:3, :3] @ start.T))
    start = platform_poses(mechanism, joints, passive[None])[0, :3, 3]
    moved = [
        platform_poses(mechanism, joints, (passive + np.eye(len(passive))[i])[None])[0, :3, 3] - start for i in slides
    ]
    passive[slides] = np.linalg.lstsq(np.array(moved).T, T_base_platform[:3, 3] - start, rcond=None)[0]
    reached = platform_poses(mechanism, joints, passive[None])[0]
    turned_off = se3.log(T_base_platform[:3, :3] @ reached[:3, :3].T)
    missed = np.concatenate([T_base_platform[:3, 3] - reached[:3, 3], turned_off])
    return passive, float(np.linalg.norm(missed))


def working_modes(mechanism: Mechanism, classical: ClassicalModel, passive: Array) -> list[_WorkingMode]:
    """Return every IK solution for the pose of passive values ``(z,)``; none where a leg does not reach it."""
    solutions = classical.inverse_solutions(passive[None])[0]  # (w, joints)
    of_legs = [np.flatnonzero(np.isfinite(column)) for column in solutions.T]
    choices = [branches if j in classical.order else branches[:1] for j, branches in enumerate(of_legs)]
    rows = np.arange(mechanism.size)
    return [_WorkingMode(solutions[list(mode), rows], tuple(map(int, mode))) for mode in product(*choices)]
