"""Mechanisms with loops: their structure, their configuration, and the solution of their closure equations.

The structure is a tree of elementary slides and hinges, closed by rods and pins. Every value in the tree is a constant
plus a joint's position, or passive, solved from the closures. All have the same kind of derivative, an axis or an axis
x lever.

Vectors are rows x y z x y of n poses, ``(5, n)``, or ``(5, 1)`` if equal in all poses: a cross product is three calls
on views.

A mechanism assembles in several modes, and Newton's method from afar may end in any. So passive values are continued
from a solved pose, in steps that shrink until Newton's corrections do: Deuflhard's monotonicity test (Newton Methods
for Nonlinear Problems, 2004, section 5.1) requires corrections of at most a quarter of the one before. First
corrections of radians, which may end a turn away, are refused. Without a singularity on the way the determinant of the
closures' derivatives keeps its sign.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.core.se3 import Array, exp
from lab.kinematics.serial.walk import padded, turned

__all__ = [
    "BASE",
    "CLOSED_M",
    "CONTRACTED",
    "FIRST_STEP",
    "LEAST_STEP",
    "MOST_CORRECTIONS",
    "ROUNDING_M",
    "SINGULAR",
    "Assembly",
    "Closed",
    "Configuration",
    "Dimensions",
    "Frame",
    "Kind",
    "Pin",
    "Rod",
    "SolvedPoses",
    "Step",
    "Tree",
    "crossed",
]

Kind = Literal["x", "y", "z", "rx", "ry", "rz"]
BASE = -1  # index of the base as a frame


@dataclass(frozen=True)
class Step:
    """An elementary motion: a slide along, or a turn about, an axis of the frame after the previous steps.

    Attributes:
        value: its constant (m, rad); of a passive step, its nominal value.
        exact: True if the constant is no parameter.
        joint: the joint (from 0) whose position, times its sign, adds to the constant.
    """

    kind: Kind
    value: float
    exact: bool = False
    joint: int | None = None
    passive: bool = False

    @property
    def is_turn(self) -> bool:
        """True for a rotation."""
        return len(self.kind) == 2

    @property
    def moves(self) -> bool:
        """True if it is passive, or a joint moves it."""
        return self.passive or self.joint is not None

    @property
    def axis(self) -> int:
        """0, 1 or 2 for x, y or z."""
        return "xyz".index(self.kind[-1])


@dataclass(frozen=True)
class Frame:
    """A frame at the end of a path of steps ``on`` another (its index, or ``BASE``)."""

    name: str
    on: int
    path: tuple[Step, ...]


@dataclass(frozen=True)
class Rod:
    """A distance between the origins of two frames: a rod with ball ends, or a leg whose length a joint sets.

    Attributes:
        length_m: constant, to which a joint's position adds.
    """

    name: str
    ends: tuple[int, int]
    length_m: float
    exact: bool = False
    joint: int | None = None


@dataclass(frozen=True)
class Pin:
    """A joint at which two frames' origins meet along some base axes (0, 1, 2): two in a planar mechanism."""

    name: str
    ends: tuple[int, int]
    axes: tuple[int, ...]


class _Opening(NamedTuple):
    """A step (its frame, and its index in the path) that moves the first (sign +1) or second end of a closure."""

    step: tuple[int, int]
    end: int
    sign: float


@dataclass(frozen=True)
class Tree:
    """Frames, each on an earlier one, their closures, and the frame with the targets."""

    frames: tuple[Frame, ...]
    rods: tuple[Rod, ...]
    pins: tuple[Pin, ...]
    platform: int

    def __post_init__(self) -> None:
        assert 0 <= self.platform < len(self.frames)
        assert all(frame.on < i for i, frame in enumerate(self.frames))

    def step(self, frame: int, step: int) -> Step:
        """Return a step of a frame's path."""
        return self.frames[frame].path[step]

    @cached_property
    def passive(self) -> tuple[tuple[int, int], ...]:
        """Frame and step of each passive value."""
        return tuple((f, s) for f, frame in enumerate(self.frames) for s, step in enumerate(frame.path) if step.passive)

    @cached_property
    def column(self) -> dict[tuple[int, int], int]:
        """Index of the passive value of each passive step."""
        return {step: i for i, step in enumerate(self.passive)}

    @property
    def equations(self) -> int:
        """Number of closure equations."""
        return len(self.rods) + sum(len(pin.axes) for pin in self.pins)

    @cached_property
    def constants(self) -> tuple[tuple[int, int], ...]:
        """Frame and step of each constant that is a parameter."""
        every = [(f, s) for f, frame in enumerate(self.frames) for s in range(len(frame.path))]
        return tuple((f, s) for f, s in every if not (self.step(f, s).exact or self.step(f, s).passive))

    @cached_property
    def lengths(self) -> tuple[int, ...]:
        """Rods whose length, or its offset, is a parameter."""
        return tuple(i for i, rod in enumerate(self.rods) if not rod.exact)

    def name_of(self, frame: int, step: int) -> str:
        """Return the name of a step's constant."""
        return f"{self.frames[frame].name}.{self.step(frame, step).kind}"

    def ancestry(self, frame: int) -> tuple[tuple[int, int], ...]:
        """Return frame and step of every motion that moves a frame, from the base."""
        if frame == BASE:
            return ()
        own = tuple((frame, s) for s in range(len(self.frames[frame].path)))
        return (*self.ancestry(self.frames[frame].on), *own)

    @cached_property
    def loose(self) -> tuple[bool, ...]:
        """Flags for the frames that passive values move."""
        return tuple(any(self.step(f, s).passive for f, s in self.ancestry(frame)) for frame in range(len(self.frames)))

    @cached_property
    def openings(self) -> tuple[tuple[_Opening, ...], ...]:
        """Steps that open each closure: rods in order, then the pins' axes; not those that move both ends alike."""
        ends = [rod.ends for rod in self.rods] + [pin.ends for pin in self.pins for _ in pin.axes]
        found = []
        for a, b in ends:
            of_a, of_b = self.ancestry(a), self.ancestry(b)
            found.append(
                (
                    *(_Opening(step, a, 1.0) for step in of_a if step not in of_b),
                    *(_Opening(step, b, -1.0) for step in of_b if step not in of_a),
                )
            )
        return tuple(found)


_Axes = tuple[Array, Array, Array]


@dataclass(frozen=True)
class Dimensions:
    """Dimensions of a mechanism.

    Attributes:
        base: ``(6,)`` position and rotation vector of the base in the tracker's frame.
        steps: constants of each frame's path (m, rad).
        lengths: of the rods (m).
        scale: sign of each joint's position.
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
    base: tuple[_Axes, Array]
    frames: list[tuple[_Axes, Array]]
    steps: list[list[tuple[Array, Array | None]]]

    @staticmethod
    def of(tree: Tree, dimensions: Dimensions, joints: Array, passive: Array) -> "Configuration":
        """Return the configuration at joint positions ``(n, joints)`` and passive values ``(z, n)``."""
        x, y, z = (padded(column) for column in exp(dimensions.base[3:]).T)
        count = len(tree.frames)
        empty: tuple[_Axes, Array] = ((x, y, z), padded(dimensions.base[:3]))
        joint_values = dimensions.scale[:, None] * joints.T
        found = Configuration(
            tree, dimensions, joint_values, passive, empty, [empty] * count, [[] for _ in range(count)]
        )
        for frame in range(count):
            found._walk(frame)
        return found

    def move(self, passive: Array) -> None:
        """Set the passive values ``(z, n)``."""
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
        """Return the lengths of the rods, ``(n,)`` or one number each (m)."""
        return [
            self.dimensions.lengths[i] + (0.0 if rod.joint is None else self.joint_values[rod.joint])
            for i, rod in enumerate(self.tree.rods)
        ]

    def closures(self) -> tuple[list[Array], list[Array]]:
        """Return the gap of each closure (m) and the direction ``(5, n)`` in which its first end opens it.

        The gap of a rod from b to a is (|a - b|^2 - l^2) / 2 l, in direction (a - b) / l: of second order in the
        frames' positions, and smooth where the ends meet.
        """
        gaps: list[Array] = []
        directions: list[Array] = []
        for rod, length in zip(self.tree.rods, self.lengths(), strict=True):
            a, b = (self.frames[end][1] for end in rod.ends)
            between = a - b
            directions.append(between / length)
            gaps.append(((between[:3] ** 2).sum(axis=0) / length - length) / 2)
        for pin in self.tree.pins:
            a, b = (self.frames[end][1] for end in pin.ends)
            for axis in pin.axes:
                direction = self.base[0][axis]
                directions.append(direction)
                gaps.append(((a - b)[:3] * direction[:3]).sum(axis=0))
        return gaps, directions

    def slope(self, step: tuple[int, int], point: Array, direction: Array) -> Array:
        """Return the speed along a direction ``(5, n)`` of a point ``(5, n)`` moved by a step."""
        axis, origin = self.steps[step[0]][step[1]]
        if origin is None:
            return _dot(axis, direction)
        return _dot(axis, crossed(point - origin, direction))

    def motion(self, step: tuple[int, int], points: Array) -> Array:
        """Return the derivative ``(3, k, n)`` of points ``(5, k, n)`` moved by a step."""
        axis, origin = self.steps[step[0]][step[1]]
        return axis[:3, None] if origin is None else crossed(axis[:, None], points - origin[:, None])

    def by_passive(self, directions: Sequence[Array]) -> Array:
        """Return derivatives of the closures by the passive values, ``(n, closures, z)``."""
        size, count = len(self.tree.passive), self.passive.shape[1]
        out = np.zeros((size, size, count))
        for i, opening in enumerate(self.tree.openings):
            for step, end, sign in opening:
                if (column := self.tree.column.get(step)) is not None:
                    out[i, column] = sign * self.slope(step, self.frames[end][1], directions[i])
        return out.transpose(2, 0, 1)


def _dot(u: Array, v: Array) -> Array:
    product: Array = u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
    return product


def crossed(u: Array, v: Array) -> Array:
    """Return the cross products ``(3, n)`` of vectors ``(5, n)``."""
    return u[1:4] * v[2:5] - u[2:5] * v[1:4]


SINGULAR = 1e3  # condition of the closures by the passive values: poses above are refused
CONTRACTED = 0.25  # largest ratio of successive corrections
_LARGEST_TURN = 0.5  # rad, of a first correction
CLOSED_M = 1e-9  # gaps below close to rounding by one more correction
ROUNDING_M = 1e-11  # corrections below are rounding
MOST_CORRECTIONS = 8
FIRST_STEP, LEAST_STEP = 0.5, 2.0**-6  # of the path from a solved pose


@dataclass(frozen=True)
class SolvedPoses:
    """Poses with solved passive values, all of one mode.

    Attributes:
        joints: joint positions ``(m, joints)``.
        passive: ``(z, m)``.
        sense: sign of the determinant of the closures' derivatives by the passive values.
    """

    joints: Array
    passive: Array
    sense: float

    def take(self, rows: NDArray[np.int_]) -> "SolvedPoses":
        """Return the poses of some rows."""
        return SolvedPoses(self.joints[rows], self.passive[:, rows], self.sense)


@dataclass(frozen=True)
class Assembly:
    """A mechanism of given dimensions, to be assembled.

    Attributes:
        lever_m: ``(z,)`` one for a slide; for a turn the length for comparing its corrections with a slide's.
        rotational: ``(z,)`` flags of turns.
    """

    tree: Tree
    dimensions: Dimensions
    lever_m: Array
    rotational: NDArray[np.bool_]

    def from_solved(self, joints: Array, solved: SolvedPoses, least_step: float = LEAST_STEP) -> "Closed":
        """Close the loops at joint positions ``(n, joints)``, each from a solved pose of its own.

        Args:
            least_step: smallest step of the continuation.
        """
        with np.errstate(all="ignore"):  # on a way to nowhere numbers may grow
            configuration, smooth = self._corrected(joints, solved.passive, 0.0)
            if not smooth.all():
                rows = np.flatnonzero(~smooth)
                passive = configuration.passive.copy()
                passive[:, rows] = self._followed(joints[rows], solved.take(rows), least_step)
                configuration.move(passive)
            return self.closed(configuration, solved.sense)

    def nearest(self, joints: Array, passive: Array) -> tuple[Array, Array]:
        """Find passive values ``(z,)`` near these that minimize the gaps ``(closures,)`` m of one pose ``(joints,)``;
        and the gaps.
        """
        configuration = Configuration.of(self.tree, self.dimensions, joints[None], passive[:, None])
        if not len(passive):
            return passive, np.empty(0)

        def gaps(values: Array) -> Array:
            configuration.move(values[:, None] / self.lever_m[:, None])
            return np.concatenate([np.atleast_1d(gap) for gap in configuration.closures()[0]])

        found = scipy.optimize.least_squares(gaps, passive * self.lever_m, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        return np.asarray(found.x / self.lever_m), gaps(found.x)

    def _corrected(
        self, joints: Array, start: Array, open_by: Array | float
    ) -> tuple[Configuration, NDArray[np.bool_]]:
        """Apply Newton's method from passive values ``(z, n)``; return a mask ``(n,)`` of success, too.

        A row ends with a step that is not much shorter than the one before; it succeeds if the loops close.

        Args:
            open_by: gaps ``(closures, n)`` m to leave.
        """
        configuration = Configuration.of(self.tree, self.dimensions, joints, start)
        smooth, before = np.ones(len(joints), dtype=bool), np.full(len(joints), np.inf)
        for _ in range(MOST_CORRECTIONS):
            gaps, directions = configuration.closures()
            opened = np.array([*gaps]).reshape(len(gaps), len(joints)) - open_by
            moved = _solved(configuration.by_passive(directions), opened.T).T
            configuration.move(configuration.passive - moved)
            size = np.sqrt(((moved * self.lever_m[:, None]) ** 2).sum(axis=0))
            smooth &= size <= np.maximum(CONTRACTED * before, ROUNDING_M)
            smooth &= (np.abs(moved[self.rotational]) < _LARGEST_TURN).all(axis=0)
            shut, before = np.abs(opened).max(axis=0, initial=0.0) < CLOSED_M, size
            if (shut | ~smooth).all():
                return configuration, smooth
        return configuration, smooth & shut

    def _followed(self, joints: Array, solved: SolvedPoses, least_step: float) -> Array:
        """Continue passive values ``(z, n)`` on straight paths from solved poses; NaN on failure.

        Gaps of these dimensions at a pose solved for others are closed in proportion on the way.
        """
        passive, reached = solved.passive.copy(), np.zeros(len(joints))
        step = np.full(len(joints), FIRST_STEP)
        gaps = np.array(Configuration.of(self.tree, self.dimensions, solved.joints, passive).closures()[0])
        while (rows := np.flatnonzero((reached < 1) & (step >= least_step))).size:
            to = np.minimum(reached[rows] + step[rows], 1.0)
            at = solved.joints[rows] + to[:, None] * (joints[rows] - solved.joints[rows])
            configuration, smooth = self._corrected(at, passive[:, rows], (1 - to) * gaps[:, rows])
            there = rows[smooth]
            passive[:, there], reached[there] = configuration.passive[:, smooth], to[smooth]
            step[rows[~smooth]] /= 2
        passive[:, reached < 1] = np.nan
        return passive

    def closed(self, configuration: Configuration, sense: float) -> "Closed":
        """Evaluate a configuration; its condition is inf unless the loops close in the assembly mode of this sense."""
        with np.errstate(all="ignore"):  # of what is not closed
            directions = configuration.closures()[1]
            matrix = configuration.by_passive(directions)
            inverse = _solved(matrix, np.broadcast_to(np.eye(len(self.lever_m)), matrix.shape))
            alike = matrix / self.lever_m, inverse * self.lever_m[:, None]
            sizes = [np.sqrt((part**2).sum(axis=(1, 2))) for part in alike]
            condition = sizes[0] * sizes[1] / max(len(self.lever_m), 1)
            same = np.sign(np.linalg.det(matrix)) == sense
        return Closed(configuration, directions, inverse, np.where(same & np.isfinite(condition), condition, np.inf))


@dataclass(frozen=True)
class Closed:
    """n poses with closed loops, if possible.

    Attributes:
        configuration: NaN if they cannot be closed in the mode of the solved poses.
        directions: of the closures (``Configuration.closures``).
        inverse: ``(n, z, closures)`` of the closures' derivatives by the passive values.
        condition: ``(n,)`` of these, one at best, with levers; inf for open loops.
    """

    configuration: Configuration
    directions: list[Array]
    inverse: Array
    condition: Array

    @property
    def fits(self) -> NDArray[np.bool_]:
        """Mask ``(n,)`` of poses that close, away from parallel singularities."""
        return np.asarray(self.condition < SINGULAR)


def _solved(matrix: Array, right: Array) -> Array:
    """Solve systems ``(n, z, z)``; NaN for singular ones."""
    vector = right.ndim == 2
    right = right[..., None] if vector else right
    try:
        found = np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        singular = np.linalg.det(matrix) == 0
        found = np.linalg.solve(np.where(singular[:, None, None], np.eye(matrix.shape[1]), matrix), right)
        found[singular] = np.nan
    return np.asarray(found[..., 0] if vector else found, dtype=np.float64)
