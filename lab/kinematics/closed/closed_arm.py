"""A mechanism with loops as a model.

The targets are h(q, z, p) with the passive values z that close the loops, c(q, z, p) = 0; by implicit differentiation
dh/dp = h_p - h_z c_z^-1 c_p. Each closure depends on few parameters, so that the product is made column by column.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array, exp, left_jacobian, pose
from lab.kinematics.closed.loop_closure import Closed, Configuration, crossed
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.model import Skeleton
from lab.kinematics.parameter import Parameter, names_of, tool_parameters
from lab.kinematics.serial.serial_arm import target_positions
from lab.kinematics.serial.walk import chunks, padded

__all__ = ["ClosedArm"]

_HALF_PARALLELOGRAM = 0.05  # half of the short side of a drawn parallelogram, relative to the rod
_STEP = 1e-5  # rad or m, of differences
_Place = tuple[int, int]  # a frame, and a step of its path


@dataclass(frozen=True)
class ClosedArm:
    """A mechanism with a base in the tracker's frame and measured targets on its platform.

    The parameters, in the order of ``names``: ``base.x y z rx ry rz`` (m; rotation vector, rad), the mechanism's own
    (``Mechanism.names``), ``tool.<target>.x y z`` (m, in the platform's frame). Points and derivatives are NaN if the
    loops cannot be closed in the nominal mode, or are singular.
    """

    chain: Mechanism
    targets: tuple[str, ...] = ("p1",)
    conditions: tuple[str, ...] = field(init=False, default=())

    def __post_init__(self) -> None:
        if not self.targets or len(set(self.targets)) < len(self.targets):
            raise LabError(f"targets {', '.join(self.targets) or '(none)'}: name at least one, and each once")

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the mechanism, then of the targets."""
        return (*self.chain.parameters, *tool_parameters(target_positions(self.targets)))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return names_of(self.parameters)

    def nominal(self, tool: dict[str, Array] | None = None) -> Array:
        """Return nominal parameters: base at the tracker's origin, targets of ``tool`` (m) or the default tool."""
        points = np.array(list(target_positions(self.targets, tool).values()))
        return np.concatenate([self.chain.nominal_values, np.ravel(points)])

    def tool_positions(self, values: Array) -> dict[str, Array]:
        """Return the target positions on the platform ``(3,)`` m, by name."""
        return dict(zip(self.targets, values[len(self.chain.names) :].reshape(-1, 3), strict=True))

    def T_tracker_frame0(self, values: Array) -> Array:
        """Pose ``(4, 4)`` of the base in the tracker's frame."""
        return pose(exp(values[3:6]), values[:3])

    def points(self, joints: Array, values: Array) -> Array:
        """Return target positions ``(n, k, 3)`` in the tracker's frame (m) at ``joints`` ``(n, joints)``, or NaN."""
        out = np.empty((3, len(self.targets), len(joints)))
        for part, closed in self._closed(joints, values):
            out[..., part] = self._targets(closed.configuration, values)[:3]
            out[..., part][..., ~closed.fits] = np.nan
        return out.transpose(2, 1, 0)

    def observe(self, joints: Array, values: Array) -> tuple[Array, Array]:
        """Return target positions ``(n, k, 3)`` and their derivatives ``(n, k, 3, parameters)``."""
        out = np.empty((3, len(self.targets), len(joints)))
        jacobian = np.zeros((len(self.names), 3, len(self.targets), len(joints)))
        for part, closed in self._closed(joints, values):
            points = self._targets(closed.configuration, values)
            out[..., part] = points[:3]
            self._fill(jacobian[..., part], closed, points)
            out[..., part][..., ~closed.fits] = np.nan
            jacobian[..., part][..., ~closed.fits] = np.nan
        return out.transpose(2, 1, 0), jacobian.transpose(3, 2, 1, 0)

    def joint_derivatives(self, jacobian: Array) -> Array:
        """Return the columns of derivatives ``(..., parameters)`` for the joint positions, ``(..., joints)``."""
        offsets = [self.names.index(self.chain.offset_of(joint)) for joint in range(self.chain.size)]
        return np.asarray(jacobian[..., offsets] * self.chain.sign)

    def tool(self, joints: Array, values: Array, target: int = 0) -> tuple[Array, Array]:
        """Return poses ``(n, 4, 4)`` of a target, with the platform's rotation, and its geometric Jacobian ``(n, 6,
        joints)``.

        The Jacobian is velocity (m), then angular velocity (rad), in the tracker's frame. NaN if not closed quickly
        (``Mechanism.assembled``).
        """
        Ts, jacobian = np.zeros((len(joints), 4, 4)), np.zeros((len(joints), 6, self.chain.size))
        Ts[:, 3, 3] = 1.0
        for part, closed in self._closed(joints, values, quickly=True):
            point = self._targets(closed.configuration, values)[:, target]
            for column, vector in enumerate((*closed.configuration.frames[self.chain.tree.platform][0], point)):
                Ts[part, :3, column] = vector[:3].T
            jacobian[part] = self._twists(closed, point)
            for out in (Ts, jacobian):
                out[part][~closed.fits] = np.nan
        return Ts, jacobian

    def platforms(self, joints: Array, values: Array) -> Array:
        """Return poses ``(n, 4, 4)`` of the platform in the tracker's frame, or NaN."""
        (x, y, z), origin = self.chain.assembled(joints, values).configuration.frames[self.chain.tree.platform]
        columns = [np.broadcast_to(vector[:3], (3, len(joints))).T for vector in (x, y, z)]
        return pose(np.stack(columns, axis=2), np.broadcast_to(origin[:3], (3, len(joints))).T)

    def legs(self, joints: Array, values: Array) -> list[Array]:
        """Return the frames' origins along each closure ``(n, c, 3)`` m, from its fixed end."""
        configuration = self.chain.assembled(joints, values).configuration
        ends = [rod.ends for rod in self.chain.tree.rods] + [pin.ends for pin in self.chain.tree.pins]
        return [self._along(configuration, sorted(pair, key=lambda end: self.chain.tree.loose[end])) for pair in ends]

    def rods(self, joints: Array, values: Array) -> Array:
        """Return the two ends of each rod ``(n, rods, 2, 3)`` m in the tracker's frame, the fixed one first."""
        configuration, loose = self.chain.assembled(joints, values).configuration, self.chain.tree.loose
        out = np.empty((len(joints), len(self.chain.tree.rods), 2, 3))
        for i, rod in enumerate(self.chain.tree.rods):
            for side, end in enumerate(sorted(rod.ends, key=lambda end: loose[end])):
                out[:, i, side] = configuration.frames[end][1][:3].T
        return out

    def _along(self, configuration: Configuration, ends: list[int]) -> Array:
        tree = self.chain.tree
        near, far = (list(dict.fromkeys(frame for frame, _ in tree.ancestry(end))) or [end] for end in ends)
        count = configuration.passive.shape[1]
        places = [np.broadcast_to(configuration.frames[frame][1][:3], (3, count)) for frame in (*near, *far[::-1])]
        return np.stack(places).transpose(2, 0, 1)

    def singular_distance(self, joints: Array, values: Array, target: int = 0) -> tuple[Array, NDArray[np.int_]]:
        """Return the first-order distance to the nearer serial or parallel singularity; zero if the loops do not close.

        The distance is the product of the singular values, over the length of its gradient by the joint positions
        (differences): of the target's Jacobian, and of the closures' derivatives by the passive values.
        """
        if not len(joints):
            return np.empty(0), np.empty(0, dtype=np.int_)
        moves = _STEP * np.eye(self.chain.size)
        sizes = [np.stack([self._sizes(joints + sign * move, values, target) for move in moves]) for sign in (1, -1)]
        slope = (sizes[0] - sizes[1]) / (2 * _STEP)  # (joints, 2, n), of logarithms
        steepest = np.nan_to_num(np.linalg.norm(slope, axis=0), nan=np.inf)
        which = steepest.argmax(axis=0)
        rows = np.arange(len(joints))
        steep = np.nan_to_num(np.abs(slope[:, which, rows]))
        return 1 / np.maximum(steepest[which, rows], 1e-300), np.asarray(steep.argmax(axis=0))

    def _sizes(self, joints: Array, values: Array, target: int) -> Array:
        """Return logarithms ``(2, n)`` of products of singular values: of target motions and of closures."""
        moved = self.tool(joints, values, target)[1][:, : min(3, self.chain.size)]
        closed = np.concatenate([each.inverse for _, each in self._closed(joints, values, quickly=True)])
        with np.errstate(all="ignore"):
            square = np.linalg.det(moved @ moved.swapaxes(1, 2))
            return np.stack([np.log(np.abs(square)) / 2, -np.log(np.abs(np.linalg.det(closed)))])

    @property
    def rigid(self) -> "ClosedArm":
        """The arm itself: it has no effects."""
        return self

    @property
    def groups(self) -> tuple[str, ...]:
        """Return no groups: the arm has no effects."""
        return ()

    def dh_chain(self, values: Array) -> None:
        """Return None: a mechanism with loops is no serial chain."""

    def skeleton(self, joints: Array, values: Array) -> Skeleton:
        """Return lines along the legs, in the frame of the base's parameters."""
        lines, platform = self.legs(joints, values), self.platforms(joints, values)[:, None, :3, 3]
        frames = np.concatenate([*lines, platform], axis=1)
        origins = np.concatenate([np.zeros((len(joints), 1, 3)), frames], axis=1)
        drawn, measured = list[Array](), list[bool]()
        for rod, ends, hinge in zip(
            self.chain.tree.rods, self.rods(joints, values).swapaxes(0, 1), self._hinges(joints, values), strict=True
        ):
            sides = [ends] if hinge is None else _parallelogram(ends, _HALF_PARALLELOGRAM * rod.length_m * hinge)
            drawn += sides
            measured += [rod.joint is not None] * len(sides)
        rods = np.stack(drawn, axis=1) if drawn else np.empty((len(joints), 0, 2, 3))
        return Skeleton(lines, frames, origins, rods, tuple(measured))

    def _hinges(self, joints: Array, values: Array) -> list[Array | None]:
        """Return the axis ``(n, 3)`` of the short sides of each parallelogram, or None for a rod.

        A platform that cannot turn, on rods with ball ends, is on parallelograms, whose short sides are parallel to the
        axes of the arms (Clavel's Delta).
        """
        tree = self.chain.tree
        turns = any(tree.step(*step).is_turn for step in tree.passive)
        if turns or len(tree.passive) < 3:
            return [None] * len(tree.rods)
        steps = self.chain.assembled(joints, values).configuration.steps
        found = list[Array | None]()
        for rod in tree.rods:
            near = min(rod.ends, key=lambda end: tree.loose[end])
            moved = [
                (f, s) for f, s in tree.ancestry(near) if tree.step(f, s).is_turn and tree.step(f, s).joint is not None
            ]
            axis = steps[moved[-1][0]][moved[-1][1]][0][:3] if moved else None
            found.append(None if axis is None else np.broadcast_to(axis, (3, len(joints))).T)
        return found

    def column_priority(self) -> tuple[int, ...]:
        """Return the base, the mechanism's parameters in order, then the targets."""
        return tuple(range(len(self.names)))

    def rank_point(self, values: Array) -> Array:
        """Return ``values`` with nominal dimensions: an imperfect copy may show what a symmetry hides."""
        nominal = self.chain.nominal_values
        return np.concatenate([values[:6], nominal[6:], values[len(nominal) :]])

    def structure_joints(self, count: int, rng: np.random.Generator) -> Array:
        """Draw joint positions for identifiability within the limits, where the loops close."""
        return self.chain.random_joints(count, rng)

    def _closed(self, joints: Array, values: Array, *, quickly: bool = False) -> Iterator[tuple[slice, Closed]]:
        if joints.ndim != 2 or joints.shape[1] != self.chain.size:
            raise LabError(
                f"joints of shape {joints.shape} do not fit robot '{self.chain.name}': give (poses, {self.chain.size})"
            )
        for part in chunks(len(joints), len(self.targets)):
            yield part, self.chain.assembled(joints[part], values, quickly=quickly)

    def _targets(self, configuration: Configuration, values: Array) -> Array:
        (x, y, z), origin = configuration.frames[self.chain.tree.platform]
        tool = values[len(self.chain.names) :].reshape(-1, 3)
        shape = (5, configuration.passive.shape[1])
        return np.stack([np.broadcast_to(origin + px * x + py * y + pz * z, shape) for px, py, pz in tool], axis=1)

    def _fill(self, jacobian: Array, closed: Closed, points: Array) -> None:
        """Write derivatives into zeros ``(parameters, 3, k, n)``."""
        configuration, tree = closed.configuration, self.chain.tree
        base = configuration.dimensions.base
        jacobian[:3] = np.eye(3)[:, :, None, None]
        lever = points - padded(base[:3])[:, None]
        for i, axis in enumerate(left_jacobian(base[3:]).T, start=3):
            jacobian[i] = crossed(padded(axis)[:, None], lever)
        steps = {step: i for i, step in enumerate(tree.constants, start=6)}
        rods = {rod: i for i, rod in enumerate(tree.lengths, start=6 + len(steps))}
        self._add(jacobian, closed, lambda step: configuration.motion(step, points), steps, rods)
        for axis, vector in enumerate(configuration.frames[tree.platform][0]):
            for k in range(len(self.targets)):
                jacobian[len(self.chain.names) + 3 * k + axis, :, k] = vector[:3]

    def _twists(self, closed: Closed, point: Array) -> Array:
        configuration, tree = closed.configuration, self.chain.tree
        count = configuration.passive.shape[1]

        def twist(step: _Place) -> Array:
            axis = configuration.steps[step[0]][step[1]][0][:3]
            moved = configuration.motion(step, point[:, None])[:, 0]
            turned = axis if tree.step(*step).is_turn else np.zeros((3, 1))
            return np.concatenate([np.broadcast_to(part, (3, count)) for part in (moved, turned)])

        steps = {step: joint for step in tree.constants if (joint := tree.step(*step).joint) is not None}
        rods = {i: rod.joint for i, rod in enumerate(tree.rods) if rod.joint is not None}
        out = np.zeros((self.chain.size, 6, count))
        self._add(out, closed, twist, steps, rods)
        return (out * self.chain.sign[:, None, None]).transpose(2, 1, 0)

    def _add(
        self,
        out: Array,
        closed: Closed,
        motion: Callable[[_Place], Array],
        steps: Mapping[_Place, int],
        rods: Mapping[int, int],
    ) -> None:
        """Add h_p - h_z c_z^-1 c_p to rows of ``out`` ``(rows, ..., n)``.

        Args:
            motion: h by a step that moves the platform, ``(..., n)``.
            steps, rods: rows of the steps' constants and the rods' lengths.
        """
        configuration, tree = closed.configuration, self.chain.tree
        carried = tree.ancestry(tree.platform)
        by_passive = np.zeros((len(tree.passive), *out.shape[1:]))
        for i, step in enumerate(tree.passive):
            if step in carried:
                by_passive[i] = motion(step)
        by_gaps = _by_gaps(closed, by_passive)
        for step in carried:
            if step in steps:
                out[steps[step]] += motion(step)
        for i, opening in enumerate(tree.openings):
            for step, end, sign in opening:
                if step in steps:
                    slope = configuration.slope(step, configuration.frames[end][1], closed.directions[i])
                    out[steps[step]] -= by_gaps[i] * (sign * slope)
        for rod, row in rods.items():
            out[row] += by_gaps[rod]


def _by_gaps(closed: Closed, motions: Array) -> Array:
    """Map motions ``(z, ..., n)`` by passive values to motions ``(closures, ..., n)`` by the closures' gaps."""
    inverse = closed.inverse.transpose(2, 1, 0)  # (closures, z, n)
    by_gaps = np.zeros_like(motions)
    for i, row in enumerate(inverse):
        for motion, part in zip(motions, row, strict=True):
            by_gaps[i] += motion * part
    return by_gaps


def _parallelogram(ends: Array, aside: Array) -> list[Array]:
    """Return the four sides ``(n, 2, 3)`` around a line; ``aside`` ``(n, 3)`` is half of a short one."""
    corners = np.stack([ends + aside[:, None], ends - aside[:, None]])  # side, pose, end
    return [*corners, *np.moveaxis(corners, (2, 0), (0, 2))]
