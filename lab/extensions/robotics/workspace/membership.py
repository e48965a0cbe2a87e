"""Decide whether a robot reaches positions and poses within joint limits: by a closed form, else by a search.

The search takes as starts those of many random joint positions that bring the tool nearest. From each a projected
Newton's method goes on: joints at a limit that would have to pass it are fixed there, the others take a damped step
(Levenberg 1944; Bertsekas 1982 for the fixed ones), and every step ends within the limits. A place counts as reached
if one of the starts converges; a place that is reached may be missed, never the other way round.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # its parts are loaded at their first use
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.robotics.closed.recognition import (
    ClassicalModel,
    MeasuredLegs,
    classical_model_of,
    measured_legs_of,
)
from lab.extensions.robotics.inverse.first_joints import ThreeJoints
from lab.kinematics.closed.mechanism import Mechanism, platform_poses
from lab.kinematics.differential import WEIGHTS
from lab.kinematics.inverse.closed_form import ClosedForm, Solutions, ZeroAxes, closed_form_of
from lab.kinematics.inverse.newton_inverse import PoseTarget, pose_landmarks, tool_at
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.kinematics.reach import extents
from lab.kinematics.serial.chain import Chain

__all__ = [
    "ByLegs",
    "ByRods",
    "Domain",
    "Membership",
    "Search",
    "anyhow",
    "by_closed_form",
    "domain_of",
    "memberships",
    "turns_about_z",
    "within_turns",
]

_STARTS, _STARTS_TURNED = 5, 20  # places are sampled more densely than poses
_STEPS = 20
_ARRIVED = 1e-7  # m, and a radian as ``ROTATION_M``
_LEAST_DAMPING, _LARGEST_DAMPING = 1e-7, 1.0  # beside singular values in m
_ROUNDING = 1e-15  # of the squares' sum: less damping would be lost in them
_AT_LIMIT = 1e-12  # rad or m
_STUCK = 0.15  # of the error: a step that reduces it by less ends the search within the limits


class Membership(ABC):
    """A test of whether a robot reaches targets.

    Attributes:
        exact: True if a closed form decides, which misses no solution.
    """

    exact = True

    @abstractmethod
    def solutions(self, wanted: PoseTarget) -> Array:
        """Return some or all joint positions ``(n, k, joints)`` that reach targets, NaN where there are fewer."""

    def reached(self, wanted: PoseTarget) -> tuple[NDArray[np.bool_], Array]:
        """Decide whether targets ``(n,)`` are reached; joint positions ``(n, joints)`` of reached ones, else NaN."""
        found = _first(self.solutions(wanted))
        return ~np.isnan(found[:, 0]), found


@dataclass(frozen=True)
class Search(Membership):
    """A bounded search for a nominal robot and the point of its tool.

    Attributes:
        values: parameters ``(p,)`` with one target.
        count: of random joint positions among which searches start; half of it where loops have to be closed.
        turn_first: whether joint 1 makes whole turns about z, so that a start may be turned towards the target.
    """

    arm: RigidArm
    values: Array
    count: int = 20_000
    turn_first: bool = False
    exact = False

    @cached_property
    def samples(self) -> tuple[Array, Array]:
        """Random joint positions ``(k, n)`` within the limits, and the tool's poses ``(k, 4, 4)`` m there."""
        joints = JointSpec.random_joints(self.arm.chain, self.count, rng_for(0, "structure"))
        Ts = self.arm.tool(joints, self.values)[0]
        stands = np.isfinite(Ts).all(axis=(1, 2))
        return joints[stands], Ts[stands]

    def reached(self, wanted: PoseTarget) -> tuple[NDArray[np.bool_], Array]:
        """Decide whether targets ``(n,)`` are reached; joint positions ``(n, joints)`` of reached ones, else NaN."""
        found = np.full((len(wanted), self.arm.chain.size), np.nan)
        if not len(wanted):
            return np.zeros(0, dtype=np.bool_), found
        starts = self._starts(wanted)
        for some in (starts[:, :1], starts[:, 1:]):  # most are reached from the first one
            rows = np.flatnonzero(np.isnan(found[:, 0]))
            found[rows] = _first(self._from(wanted.take(rows), some[rows]))
        return ~np.isnan(found[:, 0]), found

    def solutions(self, wanted: PoseTarget) -> Array:
        """Return joint positions ``(n, k, joints)`` from all starts, NaN where a start does not converge."""
        found: Array = self._from(wanted, self._starts(wanted))
        return found

    def _from(self, wanted: PoseTarget, starts: Array) -> Array:
        """Search from starts ``(n, k, joints)``; return the solutions, NaN where a start does not converge."""
        count, each = starts.shape[:2]
        rows = np.repeat(np.arange(count), each)
        joints, arrived = self._bounded(wanted.take(rows), starts.reshape(len(rows), starts.shape[2]))
        return np.where(arrived[:, None], joints, np.nan).reshape(starts.shape)

    def _starts(self, wanted: PoseTarget) -> Array:
        """Return joint positions ``(n, k, joints)`` that bring the tool near, the nearest first."""
        joints, Ts = self.samples
        turned = bool(wanted.turned.all())
        if self.turn_first and not turned:
            radii = np.hypot(Ts[:, 0, 3], Ts[:, 1, 3])
            tree = scipy.spatial.cKDTree(np.stack([radii, Ts[:, 2, 3]], axis=1))
            places = wanted.positions
            near = tree.query(np.stack([np.hypot(places[:, 0], places[:, 1]), places[:, 2]], axis=1), k=_STARTS)[1]
            starts: Array = joints[near]
            towards = np.arctan2(places[:, 1], places[:, 0])[:, None] - np.arctan2(Ts[near, 1, 3], Ts[near, 0, 3])
            first, chain = starts[:, :, 0], self.arm.chain
            turn = first + chain.sign[0] * towards
            low = chain.lower[0]
            starts[:, :, 0] = np.minimum(low + (turn - low) % (2 * np.pi), chain.upper[0])
            return starts
        tree = scipy.spatial.cKDTree(pose_landmarks(Ts[:, :3, 3], Ts[:, :3, :3], turned))
        count = _STARTS_TURNED if turned else _STARTS
        return np.asarray(joints[tree.query(pose_landmarks(wanted.positions, wanted.rotations, turned), k=count)[1]])

    def _bounded(self, wanted: PoseTarget, start: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Run the projected Newton's method from joint positions ``(n, joints)``; return its end and convergence."""
        chain, joints = self.arm.chain, start.copy()
        damping = np.full(len(wanted), _LEAST_DAMPING)
        error, jacobian = self._at(wanted, joints)
        size = np.linalg.norm(error, axis=1)
        for _ in range(_STEPS):
            going = np.flatnonzero((size > _ARRIVED) & (damping <= _LARGEST_DAMPING))
            if not going.size:
                break
            e, J, at = error[going], jacobian[going], joints[going]
            slope = np.einsum("nij,ni->nj", J, e)
            low, high = at <= chain.lower + _AT_LIMIT, at >= chain.upper - _AT_LIMIT
            free = ~((low & (slope < 0)) | (high & (slope > 0)))
            J = J * free[:, None, :]
            square = J @ J.swapaxes(1, 2)
            least = _ROUNDING * np.trace(square, axis1=1, axis2=2)[:, None]  # near a singularity of loops J is large
            square[:, np.arange(6), np.arange(6)] += np.maximum(damping[going, None] ** 2, least)
            step = np.einsum("nij,ni->nj", J, np.linalg.solve(square, e[:, :, None])[:, :, 0])
            moved = np.clip(at + step, chain.lower, chain.upper)
            there, ahead = self._at(wanted.take(going), moved)
            now = np.linalg.norm(there, axis=1)
            better = now < size[going]
            retained, worse = going[better], going[~better]
            little = now[better] > (1 - _STUCK) * size[retained]
            joints[retained], error[retained], jacobian[retained] = moved[better], there[better], ahead[better]
            size[retained] = now[better]
            damping[retained] = np.where(little, np.inf, np.maximum(damping[retained] / 10, _LEAST_DAMPING))
            damping[worse] = np.maximum(10 * damping[worse], 1e-3)
        return joints, size <= _ARRIVED

    def _at(self, wanted: PoseTarget, joints: Array) -> tuple[Array, Array]:
        """Return the residual ``(n, 6)`` and the Jacobian ``(n, 6, joints)``, in metres; rotations where requested."""
        Ts, jacobian = tool_at(self.arm, joints, self.values)
        weight = WEIGHTS * np.where(wanted.turned[:, None], 1.0, np.arange(6) < 3)
        return weight * wanted.errors(Ts), weight[:, :, None] * jacobian


def _first(solutions: Array) -> Array:
    """Return the first IK solution of ``(n, k, joints)``, NaN where there is none."""
    there = np.isfinite(solutions[:, :, 0])
    return np.asarray(np.take_along_axis(solutions, there.argmax(axis=1)[:, None, None], axis=1)[:, 0])


_SLACK_M = 1e-9  # beyond a limit


@dataclass(frozen=True)
class ByRods(Membership):
    """A platform on six rods of measured lengths from the base, and the point of its tool.

    The lengths from the base to the platform are distances of points, so that each pose has one set of joint positions
    (e.g. Merlet 2006, Parallel Robots, section 3.1). Of two poses with the same lengths that one counts which is on the
    same side of the parallel singularities as the nominal position.

    Attributes:
        legs: the rods.
        T_home: ``(4, 4)`` (m) the platform's pose at the nominal position.
        tool: ``(3,)`` m in the platform's frame.
    """

    mechanism: Mechanism
    legs: MeasuredLegs
    T_home: Array
    tool: Array

    @classmethod
    def of(cls, mechanism: Mechanism, tool: Array) -> "ByRods | None":
        """Return the closed form for a point ``(3,)`` m of the platform; None where the mechanism is another."""
        legs = measured_legs_of(mechanism)
        if legs is None:
            return None
        home = mechanism.home[None]
        passive = mechanism.assembled(home, mechanism.nominal_values).configuration.passive.T
        return cls(mechanism, legs, platform_poses(mechanism, home, passive)[0], tool)

    def solutions(self, wanted: PoseTarget) -> Array:
        """Return the one solution."""
        Ts = se3.pose(wanted.rotations, wanted.positions - wanted.rotations @ self.tool)
        joints = self.legs.joints(Ts)
        reached = ~self.mechanism.beyond_limits(joints, _SLACK_M).any(axis=1) & (self._sides(Ts) == self._side)
        return np.where(reached[:, None], joints, np.nan)[:, None]

    @cached_property
    def _side(self) -> float:
        return float(self._sides(self.T_home[None])[0])

    def _sides(self, Ts: Array) -> Array:
        """Return the sign ``(n,)`` of the determinant of the rods' lines at poses ``(n, 4, 4)``."""
        levers = np.einsum("nij,kj->nki", Ts[:, :3, :3], self.legs.far)
        rods = levers + Ts[:, None, :3, 3] - self.legs.near
        return np.asarray(np.sign(np.linalg.det(np.concatenate([rods, np.cross(levers, rods)], axis=2))))


_SLACK = 1e-9  # rad or m beyond a limit
_STARTS_WITH_LOOPS = 5_000


def memberships(arm: RigidArm, values: Array) -> tuple[Membership, Membership]:
    """Return the membership tests of a robot's workspace: for positions, and for poses.

    Args:
        values: parameters ``(p,)`` with one target.
    """
    chain = arm.dh_chain(values)
    if chain is not None:
        return _memberships_of_chain(chain, Search(arm, values, turn_first=turns_about_z(chain)), values[-3:])
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


def _memberships_of_chain(chain: Chain, search: "Search", tool: Array) -> tuple[Membership, Membership]:
    """Return a serial arm's tests: the closed form is for points or for poses."""
    form = closed_form_of(chain, tool)
    if form is None:
        return search, search
    exact = _BySolutions(chain, form, tool)
    return (exact, search) if form.by_point else (search, exact)


def turns_about_z(chain: Chain) -> bool:
    """Decide whether joint 1, or after a slide along z joint 2, makes a whole turn about z of frame 0.

    Then the arm's workspace is a solid of revolution.
    """
    axes, hinges = ZeroAxes.of(chain), [i for i, slides in enumerate(chain.prismatic) if not slides]
    if not hinges or hinges[0] > 1:
        return False
    turn = hinges[0]
    along_z = np.abs(axes.directions[: turn + 1, 2]) > 1 - _SLACK
    on_z = np.abs(axes.origins[turn, :2]).max() < _SLACK
    return bool(along_z.all() and on_z and chain.upper[turn] - chain.lower[turn] >= 2 * np.pi - _SLACK)


def within_turns(joints: JointSpec, found: Array) -> NDArray[np.bool_]:
    """Mark joint positions ``(..., n)`` within the limits, hinges by some number of whole turns."""
    low, high = joints.lower - _SLACK - found, joints.upper + _SLACK - found
    turn = 2 * np.pi
    by_turns = np.floor(high / turn) >= np.ceil(low / turn)
    return np.asarray(np.where(joints.prismatic, (low <= 0) & (high >= 0), by_turns))


def by_closed_form(form: ClosedForm, chain: Chain, Ts: Array) -> tuple[Solutions, NDArray[np.bool_]]:
    """Return a serial arm's solutions of poses ``(n, 4, 4)``, and whether each ``(n, k)`` is within the limits."""
    found = form.solve(Ts, nearest=False) if isinstance(form, ThreeJoints) else form.solve(Ts)
    fits = (found.gap_m == 0) & within_turns(chain, found.joints).all(axis=2)
    if not form.by_point:
        fits &= found.tilt_rad <= _SLACK
    return found, fits


@dataclass(frozen=True)
class _BySolutions(Membership):
    """A serial arm's closed form."""

    chain: Chain
    form: ClosedForm
    tool: Array

    def solutions(self, wanted: PoseTarget) -> Array:
        """Return all solutions within the limits, with hinges shifted into them by whole turns."""
        chain, rotations = self.chain, np.where(wanted.turned[:, None, None], wanted.rotations, np.eye(3))
        found, fits = by_closed_form(self.form, chain, se3.pose(rotations, wanted.positions - rotations @ self.tool))
        turns = np.maximum(np.ceil((chain.lower - _SLACK - found.joints) / (2 * np.pi)), 0.0)
        turns += np.minimum(np.floor((chain.upper + _SLACK - found.joints) / (2 * np.pi)), 0.0)
        joints = np.where(chain.prismatic, found.joints, found.joints + 2 * np.pi * turns)
        return np.where(fits[:, :, None], joints, np.nan)


@dataclass(frozen=True)
class ByLegs:
    """The closed form of a mechanism with loops, by its legs, in the assembly mode of the nominal position."""

    mechanism: Mechanism
    classical: ClassicalModel

    def reached(self, passive: Array) -> tuple[NDArray[np.bool_], Array]:
        """Decide whether all legs reach passive values ``(n, z)``; joint positions ``(n, joints)``, too.

        Each leg takes the branch nearest to its limits' middle; beyond a parallel singularity it is another mode.
        """
        solutions = self.classical.inverse_solutions(passive)
        away = np.where(np.isfinite(solutions), np.abs(solutions - self.classical.middle), np.inf)
        joints = np.take_along_axis(solutions, away.argmin(axis=1)[:, None], axis=1)[:, 0]
        reached = np.array(np.isfinite(joints).all(axis=1))
        reached[reached] = ~self.mechanism.beyond_limits(joints[reached], 0.0).any(axis=1)
        reached[reached] = self.classical.side(joints[reached], passive[reached]) == self.side
        return reached, joints

    @cached_property
    def side(self) -> Array:
        """Side of the parallel singularities of the nominal position."""
        home = self.mechanism.home[None]
        passive = self.mechanism.assembled(home, self.mechanism.nominal_values).configuration.passive.T
        return self.classical.side(home, passive)


@dataclass(frozen=True)
class _ByPlatform(Membership):
    """The closed form of a mechanism whose platform moves by slides alone."""

    mechanism: Mechanism
    legs: ByLegs
    tool: Array

    def solutions(self, wanted: PoseTarget) -> Array:
        """Return one solution: each leg takes its branch nearest to the middle of its limits."""
        start, moved = self._places
        passive = np.asarray(np.linalg.lstsq(moved, (wanted.positions - start).T, rcond=None)[0].T, dtype=np.float64)
        missed = np.abs(start + passive @ moved.T - wanted.positions).max(axis=1) > _SLACK
        reached, joints = self.legs.reached(passive)
        return np.where((reached & ~missed)[:, None], joints, np.nan)[:, None]

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
_MARGIN = 0.03  # of the extents, which random walks underestimate a little
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
        """Number of coordinates."""
        return len(self.low)

    def places(self, coordinates: Array) -> Array:
        """Return places ``(n, 3)`` m in the base at coordinates ``(n, d)``; of a half plane those with y = 0."""
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
        """Return coordinates ``(n, d)`` of places ``(n, 3)`` m."""
        if self.kind == "space":
            return places
        if self.kind == "revolution":
            return np.stack([np.hypot(places[:, 0], places[:, 1]), places[:, 2]], axis=1)
        return places[:, self.axes]

    def weights(self, coordinates: Array) -> Array:
        """Return the volume element (m³; of a plane area, m²) at coordinates ``(n, d)``."""
        return 2 * np.pi * np.abs(coordinates[:, 0]) if self.kind == "revolution" else np.ones(len(coordinates))

    def spread(self, coordinates: Array, rng: np.random.Generator) -> Array:
        """Return places ``(n, 3)`` m at coordinates, of a solid of revolution each turned about z at random."""
        places = self.places(coordinates)
        if self.kind == "revolution":
            angle = rng.uniform(0, 2 * np.pi, len(places))
            places = np.stack([places[:, 0] * np.cos(angle), places[:, 0] * np.sin(angle), places[:, 2]], axis=1)
        return places

    def reached(self, membership: Membership, coordinates: Array) -> NDArray[np.bool_]:
        """Decide whether the places at coordinates ``(n, d)`` are reached, in some orientation."""
        return membership.reached(anyhow(self.places(coordinates)))[0]


def anyhow(places: Array) -> PoseTarget:
    """Return places ``(n, 3)`` m as targets of any orientation."""
    return PoseTarget(places, np.full((len(places), 3, 3), np.nan))


def domain_of(arm: RigidArm, values: Array) -> Domain:
    """Return the box around the places that a robot's point reaches within its limits.

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
            "lab inspect reports its reach"
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
