"""A model with effects: the rigid arm, with further parameters."""

import itertools
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, Literal

import numpy as np

from lab.core import se3
from lab.core.errors import LabError, option_name
from lab.core.se3 import Array
from lab.kinematics.effects.effect import Effect, Moves, structure_values
from lab.kinematics.effects.range_errors import by_range_errors, with_range_errors
from lab.kinematics.model import RigidArm
from lab.kinematics.parameter import Parameter, names_of
from lab.kinematics.serial.serial_arm import BentArm, SequentialBatch, SerialArm, Stacked, StackedArm, stacked
from lab.kinematics.serial.walk import Torsors

__all__ = ["Arm", "ArmWithEffects", "affected"]

_PLACE = 3  # number of the first parameters: position of the base, about which the arm grows
_FRAMES: Final = ("frame", "station")


@dataclass(frozen=True)
class ArmWithEffects:
    """An arm with offsets of joints, displaced ends of links, motions of the frame, and range errors by its effects.

    Every effect depends on the readings, and their offsets add up: the effect of one on another is of second order (20
    nm of 1 mrad). The parameters are the arm's, then each effect's.
    """

    arm: RigidArm
    effects: tuple[Effect, ...]
    parameters: tuple[Parameter, ...] = field(init=False, repr=False)
    names: tuple[str, ...] = field(init=False)
    targets: tuple[str, ...] = field(init=False)
    conditions: tuple[str, ...] = field(init=False)
    links: tuple[int, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        parameters = (*self.arm.parameters, *itertools.chain.from_iterable(each.parameters for each in self.effects))
        names = names_of(parameters)
        conditions = dict.fromkeys(itertools.chain.from_iterable(effect.conditions for effect in self.effects))
        links = set(itertools.chain.from_iterable(effect.links for effect in self.effects))
        self._refuse_incompatible(names, links)
        object.__setattr__(self, "links", tuple(sorted(links)))
        object.__setattr__(self, "parameters", parameters)
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "targets", self.arm.targets)
        object.__setattr__(self, "conditions", tuple(conditions))

    def _refuse_incompatible(self, names: Sequence[str], links: Collection[int]) -> None:
        """Refuse two effects with one parameter, and bending links of a robot that is no serial arm."""
        if twice := [name for name, count in Counter(names).items() if count > 1]:
            groups = [effect.name for effect in self.effects if twice[0] in names_of(effect.parameters)]
            raise LabError(f"{option_name('model')} {'+'.join(groups)}: both have {twice[0]}; choose one of them")
        if links and not isinstance(self.arm, SerialArm):
            raise LabError(
                f"robot {self.arm.chain.name} has {self.arm.chain.beside_serial}, and its links do not bend here"
            )

    @property
    def rigid(self) -> RigidArm:
        """Rigid arm, whose parameters come first."""
        return self.arm

    @property
    def groups(self) -> tuple[str, ...]:
        """Names of its groups of effects."""
        return tuple(effect.name for effect in self.effects)

    def nominal(self, tool: dict[str, Array] | None = None) -> Array:
        """Return the arm's nominal parameters, and zero effects."""
        rigid = self.arm.nominal(tool)
        return np.concatenate([rigid, np.zeros(len(self.names) - len(rigid))])

    def points(self, inputs: Array, values: Array) -> Array:
        """Return target positions ``(n, k, 3)`` in the tracker's frame (m) at inputs ``(n, joints + conditions)``."""
        moved = self._moved(inputs, values, alone=True)
        arm = self._bent(moved) if self.links and moved["links"][0].any() else self.arm
        points = arm.points(moved["joints"][0], self._geometric(values))
        if self._size_changes:
            points = points + moved["size"][0][:, None] * (points - values[:_PLACE])
        for what in self._moving_frames:
            points = _seen_from(points, moved[what][0])
        return with_range_errors(points, moved["range"][0]) if "range" in moved else points

    def observe(self, inputs: Array, values: Array) -> tuple[Array, Array]:
        """Return the positions, and their derivatives ``(n, k, 3, parameters)``."""
        moved = self._moved(inputs, values)
        stands, by_joint = moved["joints"]
        points, rigid = self._bent(moved).observe(stands, self._geometric(values))
        first = len(self.arm.names)
        jacobian = np.empty((*points.shape, len(self.names)), dtype=np.result_type(rigid, stands))
        jacobian[..., :first] = rigid[..., :first]
        # by the chain rule: contiguous factors, which BLAS multiplies
        by_motion, by_effects = self.arm.joint_derivatives(rigid[..., :first]), by_joint
        if self.links:
            by_motion = np.concatenate([by_motion, rigid[..., first:]], axis=3)
            by_effects = np.concatenate([by_joint, moved["links"][1]], axis=1)
        n, k, _ = points.shape
        product = np.ascontiguousarray(by_motion).reshape(n, 3 * k, by_motion.shape[3]) @ by_effects
        jacobian[..., first:] = product.reshape(n, k, 3, by_effects.shape[2])
        if self._size_changes:
            growth, by_growth = moved["size"]
            jacobian *= 1 + growth[:, None, None]
            jacobian[..., range(_PLACE), range(_PLACE)] -= growth[:, None]
            jacobian[..., first:] += (points - values[:_PLACE])[..., None] @ by_growth[:, None]
            points = points + growth[:, None] * (points - values[:_PLACE])
        for frame, by_frame in (moved[what] for what in self._moving_frames):
            jacobian = _seen_from(jacobian.swapaxes(2, 3), frame, shifted=False).swapaxes(2, 3)
            jacobian[..., first:] += _by_frame(points, frame) @ by_frame[:, None]
            points = _seen_from(points, frame)
        if "range" in moved:
            errors, by_errors = moved["range"]
            jacobian, by_range = by_range_errors(points, errors, jacobian)
            jacobian[..., first:] += by_range @ by_errors[:, None]
            points = with_range_errors(points, errors)
        return points, jacobian

    def tool(self, inputs: Array, values: Array, target: int = 0) -> tuple[Array, Array]:
        """Return poses of a target and the geometric Jacobian, as ``RigidArm.tool``.

        The Jacobian is the rigid arm's at the true joint positions, without derivatives of the effects by the readings.
        """
        moved = self._moved(inputs, values)
        Ts, jacobian = self._bent(moved).tool(moved["joints"][0], self._geometric(values), target)
        if self._size_changes:
            Ts = Ts.copy()
            Ts[:, :3, 3] += moved["size"][0] * (Ts[:, :3, 3] - values[:_PLACE])
        for frame in (moved[what][0] for what in self._moving_frames):
            Ts = se3.pose(se3.exp(frame[:, 3:6]) @ Ts[:, :3, :3], _seen_from(Ts[:, None, :3, 3], frame)[:, 0])
        if "range" in moved:
            Ts = se3.pose(Ts[:, :3, :3], with_range_errors(Ts[:, None, :3, 3], moved["range"][0])[:, 0])
        return Ts, jacobian

    def standing(self, inputs: Array, values: Array) -> Array:
        """Return the true joint positions ``(n, joints)`` (rad or m) at inputs ``(n, joints + conditions)``."""
        return self._moved(inputs, values)["joints"][0]

    def torsors(self, inputs: Array, values: Array) -> Torsors:
        """Return the torsors of the links' ends (``serial.walk.Torsors``) at inputs ``(n, joints + conditions)``."""
        return self._by_link(self._moved(inputs, values)["links"][0]) if self.links else {}

    def column_priority(self) -> tuple[int, ...]:
        """Return the arm's order of preference, then the effects'."""
        return (*self.arm.column_priority(), *range(len(self.arm.names), len(self.names)))

    def rank_point(self, values: Array) -> Array:
        """Return ``values`` with nominal parallelism exact, and typical effects."""
        typical = [effect.typical or (0.0,) * len(effect.parameters) for effect in self.effects]
        return np.concatenate([self.arm.rank_point(self._geometric(values)), *typical])

    def structure_joints(self, count: int, rng: np.random.Generator) -> Array:
        """Draw readings within the limits, and conditions."""
        joints = self.arm.structure_joints(count, rng)
        columns = [structure_values(name, count, rng)[:, None] for name in self.conditions]
        return np.concatenate([joints, *columns], axis=1)

    @property
    def _moving_frames(self) -> tuple[Literal["frame", "station"], ...]:
        moving = {effect.moves for effect in self.effects}
        return tuple(what for what in _FRAMES if what in moving)

    @property
    def _size_changes(self) -> bool:
        return any(effect.moves == "size" for effect in self.effects)

    def _geometric(self, values: Array) -> Array:
        return values[: len(self.arm.names)]

    def _bent(self, moved: "_Moved") -> RigidArm | BentArm:
        if not isinstance(self.arm, SerialArm) or not self.links:
            return self.arm
        return BentArm(self.arm, self._by_link(moved["links"][0]))

    def _by_link(self, torsors: Array) -> Torsors:
        return {link: torsors[:, 6 * i : 6 * i + 6] for i, link in enumerate(self.links)}

    def _moved(self, inputs: Array, values: Array, *, alone: bool = False) -> "_Moved":
        """Return joints ``(n, joints)``, frame, station ``(n, 7)``, torsors ``(n, 6 links)`` and size ``(n, 1)``, if
        moved.

        Each comes with its derivatives by the effects' parameters.

        Args:
            alone: without derivatives, and without effects that are off.
        """
        size, first = self.arm.chain.size, len(self.arm.names)
        joints, conditions = inputs[:, :size], inputs[:, size:]
        kind = np.result_type(inputs, values)
        total = 0 if alone else len(self.names) - first
        # nothing has moved yet: the joints are where they are read
        sums: _Moved = {
            moves: (np.zeros((len(joints), count), dtype=kind), np.zeros((len(joints), count, total), dtype=kind))
            for moves, count in self._moved_sizes.items()
        }
        sums["joints"][0][:] = joints
        # each effect adds its offsets, and its columns of the derivatives
        at = 0
        for effect in self.effects:
            part = slice(at, at + len(effect.parameters))
            at = part.stop
            if alone and not values[first:][part].any():
                continue
            own_conditions = conditions[:, [self.conditions.index(name) for name in effect.conditions]]
            moved, derivative = effect.offsets(joints, own_conditions, values[first:][part])
            sum_of, by_effects = sums[effect.moves]
            own = self._columns_of(effect)
            sum_of[:, own] += moved
            if not alone:
                by_effects[:, own, part] = derivative
        return sums

    def _columns_of(self, effect: Effect) -> list[int] | slice:
        """Return which of the numbers of its kind of motion an effect changes: six of each of its links, or all."""
        own = [6 * self.links.index(link) + i for link in effect.links for i in range(6)]
        if not own:
            return slice(None)
        adjacent = own == list(range(own[0], own[0] + len(own)))
        return slice(own[0], own[0] + len(own)) if adjacent else own

    @cached_property
    def _moved_sizes(self) -> "dict[Moves, int]":
        """How many numbers each kind of motion has, of the kinds that there are."""
        size = self.arm.chain.size
        links = 6 * len(self.links)
        sizes: dict[Moves, int] = {"joints": size, "frame": 7, "links": links, "size": 1, "station": 7, "range": 2}
        needed = {"joints", *(effect.moves for effect in self.effects)}
        return {moves: count for moves, count in sizes.items() if moves in needed}


_Moved = dict[Moves, tuple[Array, Array]]


def _seen_from(vectors: Array, frame: Array, *, shifted: bool = True) -> Array:
    """Return points (or, not shifted, differences of points) ``(n, k, ..., 3)`` in a frame that moved by ``(n, 7)``."""
    if not frame.any():
        return vectors
    axes = [1] * (vectors.ndim - 2)
    turn = se3.exp(frame[:, 3:6]).reshape(len(frame), *axes, 3, 3)
    stretch, shift = (part.reshape(len(frame), *axes, part.shape[1]) for part in (1 + frame[:, 6:], frame[:, :3]))
    before = vectors + shift if shifted else vectors
    seen: Array = stretch * (turn @ before[..., None])[..., 0]
    return seen


def _by_frame(points: Array, frame: Array) -> Array:
    """Return derivatives of points ``(n, k, 3)`` by the frame's seven numbers, ``(n, k, 3, 7)``."""
    seen, stretch = _seen_from(points, frame), 1 + frame[:, None, 6:]
    out = np.zeros((*points.shape, 7), dtype=seen.dtype)
    out[..., :3] = stretch[..., None] * se3.exp(frame[:, 3:6])[:, None]
    out[..., 3:6] = -se3.skew(seen) @ se3.left_jacobian(frame[:, 3:6])[:, None]
    out[..., 6] = seen / stretch
    return out


Arm = RigidArm | ArmWithEffects


def affected(arm: RigidArm, effects: Sequence[Effect]) -> Arm:
    """Return the arm with these effects, or the arm itself without any."""
    return ArmWithEffects(arm, tuple(effects)) if effects else arm


@dataclass(frozen=True)
class _StackedArmWithEffects:
    """A stack of serial arms with offsets of the joints, computed at once."""

    arm: ArmWithEffects
    rigid: StackedArm

    def points(self, joints: Array, values: Array) -> Array:
        """Return ``Stacked.points``."""
        return self.rigid.points(self._standing(joints, values)[0], values[:, : self._first])

    def observe(self, joints: Array, values: Array, free: Sequence[int]) -> tuple[Array, Array]:
        """Return ``Stacked.observe``."""
        standing, slopes = self._standing(joints, values)
        own, turning = [i for i in free if i < self._first], self.rigid.arm.joint_columns
        columns = [*own, *(i for i in turning if i not in own)]
        points, rigid = self.rigid.observe(standing, values[:, : self._first], columns)
        found = np.empty((len(values), len(free), *points.shape[1:])).transpose(1, 3, 2, 0, 4)
        found[[k for k, i in enumerate(free) if i < self._first]] = rigid[: len(own)]
        by_joint = rigid[[columns.index(i) for i in turning]] * self.rigid.arm.chain.sign[:, None, None, None, None]
        for k, i in enumerate(free):
            if i >= self._first:
                slope = slopes[i - self._first]  # (n, joints), or (b, n, joints)
                moved = np.flatnonzero(slope.any(axis=tuple(range(slope.ndim - 1))))
                found[k] = sum(by_joint[j] * slope[..., j] for j in moved)
        return points, found

    @cached_property
    def _first(self) -> int:
        return len(self.rigid.arm.names)

    def _standing(self, inputs: Array, values: Array) -> tuple[Array, list[Array]]:
        """Return true joint positions ``(b, n, joints)``, and their derivatives by each effect's parameters.

        These are ``(b, n, joints)`` each, or ``(n, joints)`` where all arms have the same.
        """
        size, at = self.rigid.arm.chain.size, self._first
        joints, conditions = np.ascontiguousarray(inputs[:, :size]), inputs[:, size:]
        standing, slopes = np.tile(joints, (len(values), 1, 1)), list[Array]()
        for effect in self.arm.effects:
            part = slice(at, at + len(effect.parameters))
            at = part.stop
            own_conditions = conditions[:, [self.arm.conditions.index(name) for name in effect.conditions]]
            moved, derivative = effect.offsets(joints, own_conditions, values[:, None, part])
            standing += moved
            slopes += list(np.moveaxis(derivative, -1, 0))
        return standing, slopes


@stacked.register
def _(arm: ArmWithEffects) -> Stacked:
    if isinstance(arm.arm, SerialArm) and all(each.stacks for each in arm.effects):
        return _StackedArmWithEffects(arm, StackedArm(arm.arm))
    return SequentialBatch(arm)
