"""Decide whether a robot reaches positions and poses within joint limits: by a closed form, else by a search."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.robotics.closed.recognition import ClassicalModel, classical_model_of
from lab.extensions.robotics.inverse.first_joints import ThreeJoints
from lab.extensions.robotics.workspace.search import Search
from lab.kinematics.closed.loop_closure import Configuration
from lab.kinematics.closed.mechanism import Mechanism, platform_poses
from lab.kinematics.inverse.closed_form import Axes, ClosedForm, Solutions, closed_form_of
from lab.kinematics.inverse.newton import FREEDOMS, PoseTarget
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.kinematics.reach import extents
from lab.kinematics.serial.chain import Chain

__all__ = [
    "ByLegs",
    "ByRods",
    "Domain",
    "Membership",
    "anyhow",
    "by_closed_form",
    "domain_of",
    "memberships",
    "turns_about_z",
    "within_turns",
]

_SLACK_M = 1e-9  # beyond a limit


@dataclass(frozen=True)
class ByRods:
    """Such a mechanism and the point of its tool.

    The lengths from the base to the platform are distances of points, so that each pose has one set of joint positions
    (e.g. Merlet 2006, Parallel Robots, section 3.1). Of two poses with the same lengths that one counts which is on the
    same side of the parallel singularities as the nominal position.

    Attributes:
        anchors: ``(6, 3)`` m, the rods' ends in the base, and ``corners`` in the platform's frame.
        zeros: ``(6,)`` m, the rods' lengths at joint positions zero.
        order: ``(6,)`` the joint that measures each rod.
        tool: ``(3,)`` m in the platform's frame.
    """

    mechanism: Mechanism
    anchors: Array
    corners: Array
    zeros: Array
    order: NDArray[np.int_]
    T_home: Array
    tool: Array
    exact: bool = True

    @classmethod
    def of(cls, mechanism: Mechanism, tool: Array) -> "ByRods | None":
        """Such a mechanism with a point ``(3,)`` m of its platform; None of another."""
        tree = mechanism.tree
        joints = [rod.joint for rod in tree.rods]
        if tree.pins or len(joints) != FREEDOMS or None in joints or len(set(joints)) != mechanism.size:
            return None
        if any({step[0] for step in tree.passive} - {tree.platform} for _ in tree.passive):
            return None
        home, dimensions = mechanism.home[None], mechanism.dimensions(mechanism.nominal_values)
        passive = mechanism.assembled(home, mechanism.nominal_values).configuration.passive
        at = Configuration.of(tree, dimensions, home, passive)
        axes, origin = at.frames[tree.platform]
        T = se3.pose(np.stack([_flat(axis) for axis in axes], axis=1), _flat(origin))
        moves = [[tree.loose[end] for end in rod.ends] for rod in tree.rods]
        if any(sum(each) != 1 for each in moves):
            return None
        ends = np.array([[_flat(at.frames[end][1]) for end in rod.ends] for rod in tree.rods])
        rows, held = np.arange(FREEDOMS), np.array([each.index(False) for each in moves])
        corners = se3.transform(se3.inverse(T), ends[rows, 1 - held])
        order = np.array(joints, dtype=np.int_)
        return cls(mechanism, ends[rows, held], corners, np.array(dimensions.lengths), order, T, tool)

    def reached(self, wanted: PoseTarget) -> tuple[NDArray[np.bool_], Array]:
        """Decide whether poses ``(n,)`` are reached; joint positions ``(n, joints)`` of those that are, else NaN."""
        Ts = se3.pose(wanted.rotations, wanted.positions - wanted.rotations @ self.tool)
        lengths, sides = self._seen(Ts)
        joints = np.empty((len(wanted), FREEDOMS))
        joints[:, self.order] = (lengths - self.zeros) * self.mechanism.sign[self.order]
        reached = ~self.mechanism.beyond_limits(joints, _SLACK_M).any(axis=1) & (sides == self._side)
        return reached, np.where(reached[:, None], joints, np.nan)

    def solutions(self, wanted: PoseTarget) -> Array:
        """The one."""
        return self.reached(wanted)[1][:, None]

    @cached_property
    def _side(self) -> float:
        return float(self._seen(self.T_home[None])[1][0])

    def _seen(self, Ts: Array) -> tuple[Array, Array]:
        """Lengths ``(n, 6)`` m of the rods at poses ``(n, 4, 4)``, and the sign of the determinant of their lines."""
        levers = np.einsum("nij,kj->nki", Ts[:, :3, :3], self.corners)
        rods = levers + Ts[:, None, :3, 3] - self.anchors
        lengths = np.linalg.norm(rods, axis=2)
        lines = np.concatenate([rods, np.cross(levers, rods)], axis=2)
        return lengths, np.sign(np.linalg.det(lines))


def _flat(vector: Array) -> Array:
    """The first three rows of a vector of one pose, ``(3,)``."""
    return np.broadcast_to(vector[:3].reshape(3, -1), (3, 1))[:, 0].copy()


_SLACK = 1e-9  # rad or m beyond a limit
_STARTS_WITH_LOOPS = 5_000


class Membership(Protocol):
    """Says what is reached."""

    @property
    def exact(self) -> bool:
        """Membership is exact, by a closed form that misses no solution."""

    def reached(self, wanted: PoseTarget) -> tuple[NDArray[np.bool_], Array]:
        """Decide whether targets ``(n,)`` are reached; joint positions ``(n, joints)`` of those that are, else NaN."""

    def solutions(self, wanted: PoseTarget) -> Array:
        """Return some or all joint positions ``(n, k, joints)`` that reach targets, NaN where there are fewer."""


def memberships(arm: RigidArm, values: Array) -> tuple[Membership, Membership]:
    """Return the membership tests of a robot's workspace: for positions, and for poses.

    Args:
        values: parameters ``(p,)`` with one target.
    """
    chain = arm.dh_chain(values)
    if chain is not None:
        search = Search(arm, values, turn_first=turns_about_z(chain))
        form = closed_form_of(chain, values[-3:])
        if form is None:
            return search, search
        exact = _BySolutions(chain, form, values[-3:])
        return (exact if form.by_point else search), (search if form.by_point else exact)
    mechanism = arm.chain
    assert isinstance(mechanism, Mechanism)
    classical, search = classical_model_of(mechanism), Search(arm, values, _STARTS_WITH_LOOPS)
    if (rods := ByRods.of(mechanism, values[-3:])) is not None:
        return search, rods
    if classical is None or any(mechanism.tree.step(*step).is_turn for step in mechanism.tree.passive):
        return search, search
    if values[-3:].any() and len(classical.order) < mechanism.size:  # a joint beside those of the legs carries the tool
        return search, search
    return _ByPlatform(mechanism, ByLegs(mechanism, classical), values[-3:]), search


def turns_about_z(chain: Chain) -> bool:
    """Decide whether joint 1, or after a slide along z joint 2, makes a whole turn about z of frame 0.

    Then the arm's workspace is a solid of revolution.
    """
    axes, hinges = Axes.of(chain), [i for i, slides in enumerate(chain.prismatic) if not slides]
    if not hinges or hinges[0] > 1:
        return False
    turn = hinges[0]
    along_z = np.abs(axes.directions[: turn + 1, 2]) > 1 - _SLACK
    on_z = np.abs(axes.origins[turn, :2]).max() < _SLACK
    return bool(along_z.all() and on_z and chain.upper[turn] - chain.lower[turn] >= 2 * np.pi - _SLACK)


def within_turns(joints: JointSpec, found: Array) -> NDArray[np.bool_]:
    """``(..., n)`` whether joint positions are within the limits, hinges by some number of whole turns."""
    low, high = joints.lower - _SLACK - found, joints.upper + _SLACK - found
    turn = 2 * np.pi
    by_turns = np.floor(high / turn) >= np.ceil(low / turn)
    return np.asarray(np.where(joints.prismatic, (low <= 0) & (high >= 0), by_turns))


def by_closed_form(form: ClosedForm, chain: Chain, Ts_frame0_last: Array) -> tuple[NDArray[np.bool_], Array]:
    """Decide whether a serial arm reaches poses ``(n, 4, 4)`` of its last frame within limits; joint positions too."""
    found, fits = _solved(form, chain, Ts_frame0_last)
    return np.asarray(fits.any(axis=1)), np.take_along_axis(found.joints, fits.argmax(axis=1)[:, None, None], 1)[:, 0]


def _solved(form: ClosedForm, chain: Chain, Ts: Array) -> tuple[Solutions, NDArray[np.bool_]]:
    """Return all solutions of poses ``(n, 4, 4)``, and whether each ``(n, k)`` is within the limits."""
    found = form.solve(Ts, nearest=False) if isinstance(form, ThreeJoints) else form.solve(Ts)
    fits = (found.gap_m == 0) & within_turns(chain, found.joints).all(axis=2)
    if not form.by_point:
        fits &= found.tilt_rad <= _SLACK
    return found, fits


@dataclass(frozen=True)
class _BySolutions:
    """A serial arm's closed form."""

    chain: Chain
    form: ClosedForm
    tool: Array
    exact: bool = True

    def reached(self, wanted: PoseTarget) -> tuple[NDArray[np.bool_], Array]:
        """Test all solutions; for an arm that positions a point only, whatever the rotation."""
        reached, joints = by_closed_form(self.form, self.chain, self._last_frames(wanted))
        return reached, np.where(reached[:, None], _turned_within(self.chain, joints), np.nan)

    def solutions(self, wanted: PoseTarget) -> Array:
        """Return all solutions within the limits."""
        found, fits = _solved(self.form, self.chain, self._last_frames(wanted))
        return np.where(fits[:, :, None], _turned_within(self.chain, found.joints), np.nan)

    def _last_frames(self, wanted: PoseTarget) -> Array:
        rotations = np.where(wanted.turned[:, None, None], wanted.rotations, np.eye(3))
        return se3.pose(rotations, wanted.positions - rotations @ self.tool)


def _turned_within(chain: Chain, joints: Array) -> Array:
    """Joint positions by whole turns within the limits where some are."""
    turns = np.maximum(np.ceil((chain.lower - _SLACK - joints) / (2 * np.pi)), 0.0)
    turns += np.minimum(np.floor((chain.upper + _SLACK - joints) / (2 * np.pi)), 0.0)
    return np.where(chain.prismatic, joints, joints + 2 * np.pi * turns)


@dataclass(frozen=True)
class ByLegs:
    """The closed form of a mechanism with loops: what its legs reach in the mode of the nominal position."""

    mechanism: Mechanism
    classical: ClassicalModel

    def reached(self, passive: Array) -> tuple[NDArray[np.bool_], Array]:
        """``(n,)`` whether all legs reach passive values ``(n, z)``, and their joint positions ``(n, joints)``.

        Each leg takes the way nearest to its limits' middle; beyond a parallel singularity it is another mode.
        """
        ways = self.classical.inverse_solutions(passive)
        away = np.where(np.isfinite(ways), np.abs(ways - self.classical.middle), np.inf)
        joints = np.take_along_axis(ways, away.argmin(axis=1)[:, None], axis=1)[:, 0]
        reached = np.array(np.isfinite(joints).all(axis=1))
        reached[reached] = ~self.mechanism.beyond_limits(joints[reached], 0.0).any(axis=1)
        reached[reached] = self.classical.side(joints[reached], passive[reached]) == self.side
        return reached, joints

    @cached_property
    def side(self) -> Array:
        """On which side of the parallel singularities the nominal position is."""
        home = self.mechanism.home[None]
        passive = self.mechanism.assembled(home, self.mechanism.nominal_values).configuration.passive.T
        return self.classical.side(home, passive)


@dataclass(frozen=True)
class _ByPlatform:
    """The closed form of a mechanism whose platform moves by slides alone."""

    mechanism: Mechanism
    legs: ByLegs
    tool: Array
    exact: bool = True

    def reached(self, wanted: PoseTarget) -> tuple[NDArray[np.bool_], Array]:
        """Whatever the rotation."""
        start, moved = self._places
        passive = np.asarray(np.linalg.lstsq(moved, (wanted.positions - start).T, rcond=None)[0].T, dtype=np.float64)
        missed = np.abs(start + passive @ moved.T - wanted.positions).max(axis=1) > _SLACK
        reached, joints = self.legs.reached(passive)
        reached &= ~missed
        return reached, np.where(reached[:, None], joints, np.nan)

    def solutions(self, wanted: PoseTarget) -> Array:
        """Return one solution: each leg takes its branch nearest to the middle of its limits."""
        return self.reached(wanted)[1][:, None]

    @cached_property
    def _places(self) -> tuple[Array, Array]:
        """Return the point at passive values zero ``(3,)``, and its displacement by each of them ``(3, z)``."""
        count = len(self.mechanism.tree.passive)
        rows = np.concatenate([np.zeros((1, count)), np.eye(count)])
        Ts = platform_poses(self.mechanism, np.tile(self.mechanism.home, (count + 1, 1)), rows)
        places = se3.transform(Ts, self.tool[None])[:, 0]
        return places[0], (places[1:] - places[0]).T


_POSES = 4000
_FLAT_M = 1e-9
_MARGIN = 0.03  # of the extents, which walks find to a little less than all
_RANK = 1e-9


@dataclass(frozen=True)
class Domain:
    """A box in d coordinates around what a robot's point reaches.

    Attributes:
        kind: ``space`` (x, y, z), ``revolution`` (the distance from z, and z), or ``plane`` (two of x, y and z).
        low, high: ``(d,)`` m.
        axes: which of x, y and z the coordinates of a plane are.
        level_m: the third coordinate of a plane.
        extents: ``(3, 2)`` m, the least and largest coordinates that are reached.
    """

    kind: str
    low: Array
    high: Array
    axes: tuple[int, ...]
    level_m: float
    extents: Array

    @property
    def size(self) -> int:
        """The number of coordinates."""
        return len(self.low)

    def places(self, coordinates: Array) -> Array:
        """Places ``(n, 3)`` m in the base at coordinates ``(n, d)``; of a half plane those with y = 0."""
        if self.kind == "space":
            return coordinates
        found = np.zeros((len(coordinates), 3))
        if self.kind == "revolution":
            found[:, 0], found[:, 2] = np.abs(coordinates[:, 0]), coordinates[:, 1]
            return found
        found[:, self.axes] = coordinates
        found[:, 3 - sum(self.axes)] = self.level_m
        return found

    def coordinates(self, places: Array) -> Array:
        """Coordinates ``(n, d)`` of places ``(n, 3)`` m."""
        if self.kind == "space":
            return places
        if self.kind == "revolution":
            return np.stack([np.hypot(places[:, 0], places[:, 1]), places[:, 2]], axis=1)
        return places[:, self.axes]

    def weights(self, coordinates: Array) -> Array:
        """Return the volume element (m³; of a plane area, m²) at coordinates ``(n, d)``."""
        return 2 * np.pi * np.abs(coordinates[:, 0]) if self.kind == "revolution" else np.ones(len(coordinates))

    def spread(self, coordinates: Array, rng: np.random.Generator) -> Array:
        """Places ``(n, 3)`` m of coordinates, of a solid of revolution each turned about z at random."""
        places = self.places(coordinates)
        if self.kind == "revolution":
            angle = rng.uniform(0, 2 * np.pi, len(places))
            places = np.stack([places[:, 0] * np.cos(angle), places[:, 0] * np.sin(angle), places[:, 2]], axis=1)
        return places

    def reached(self, membership: Membership, coordinates: Array) -> NDArray[np.bool_]:
        """Decide whether the places at coordinates ``(n, d)`` are reached, in some orientation."""
        return membership.reached(anyhow(self.places(coordinates)))[0]


def anyhow(places: Array) -> PoseTarget:
    """Places ``(n, 3)`` m, turned in any way."""
    return PoseTarget(places, np.full((len(places), 3, 3), np.nan))


def domain_of(arm: RigidArm, values: Array) -> Domain:
    """The box around what a robot's point reaches within its limits.

    Args:
        values: parameters ``(p,)`` with one target.

    Raises:
        LabError: the point stays on a line or a surface in space, which has no volume.
    """
    joints = JointSpec.random_joints(arm.chain, _POSES, rng_for(0, "structure"))
    Ts, jacobian = arm.tool(joints, values)
    stands = np.isfinite(Ts).all(axis=(1, 2))
    joints, places, jacobian = joints[stands], Ts[stands, :3, 3], jacobian[stands, :3]

    def places_of(tried: Array) -> Array:
        return np.asarray(arm.tool(tried, values)[0][:, :3, 3])

    ends = extents(arm.chain, places_of, joints, places)
    sizes = np.linalg.svd(jacobian, compute_uv=False)
    rank = int((sizes > _RANK * max(float(sizes.max()), _RANK)).sum(axis=1).max())
    flat = np.flatnonzero(ends[:, 1] - ends[:, 0] < _FLAT_M)
    if rank < 2 or (rank == 2 and len(flat) != 1):
        raise LabError(
            f"robot '{arm.chain.name}': its point stays on a {'line' if rank < 2 else 'surface'}, which has no volume; "
            "lab inspect tells its reach"
        )
    margin = _MARGIN * (ends[:, 1] - ends[:, 0])
    low, high = ends[:, 0] - margin, ends[:, 1] + margin
    if len(flat):
        axes = tuple(i for i in range(3) if i != flat[0])
        return Domain("plane", low[list(axes)], high[list(axes)], axes, float(ends[flat[0]].mean()), ends)
    chain = arm.dh_chain(values)
    if chain is not None and turns_about_z(chain):
        radius = float(np.abs(ends[:2]).max()) * (1 + _MARGIN)
        return Domain("revolution", np.array([0.0, low[2]]), np.array([radius, high[2]]), (), 0.0, ends)
    return Domain("space", low, high, (0, 1, 2), 0.0, ends)
