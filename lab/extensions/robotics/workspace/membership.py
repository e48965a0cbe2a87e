"""Whether a robot brings its tool to places and poses within its joints' limits: by a closed form, else by a search."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.robotics.closed.recognition import ClassicalModel, classical_model_of
from lab.extensions.robotics.inverse.three_joints import ThreeJoints
from lab.extensions.robotics.workspace.rods import ByRods
from lab.extensions.robotics.workspace.search import Search
from lab.kinematics.closed.mechanism import Mechanism, platform_poses
from lab.kinematics.inverse.closed_form import Axes, ClosedForm, Solutions, closed_form_of
from lab.kinematics.inverse.newton import PoseTarget
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.kinematics.serial.chain import Chain

__all__ = ["ByLegs", "Membership", "by_closed_form", "memberships", "turns_about_z", "within_turns"]

_SLACK = 1e-9  # rad or m beyond a limit
_STARTS_WITH_LOOPS = 5_000


class Membership(Protocol):
    """Says what is reached."""

    @property
    def exact(self) -> bool:
        """Whether a closed form says so, which misses nothing."""

    def reached(self, wanted: PoseTarget) -> tuple[NDArray[np.bool_], Array]:
        """Which targets ``(n,)`` are reached, and joint positions ``(n, joints)`` that do, NaN where there are none."""

    def ways(self, wanted: PoseTarget) -> Array:
        """Some or all joint positions ``(n, k, joints)`` that reach targets, NaN where there are fewer."""


def memberships(arm: RigidArm, values: Array) -> tuple[Membership, Membership]:
    """What says which places a robot's tool reaches, and what says which poses.

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
    course, search = classical_model_of(mechanism), Search(arm, values, _STARTS_WITH_LOOPS)
    if (rods := ByRods.of(mechanism, values[-3:])) is not None:
        return search, rods
    if course is None or any(mechanism.tree.step(*step).is_turn for step in mechanism.tree.passive):
        return search, search
    if values[-3:].any() and len(course.order) < mechanism.size:  # a joint beside those of the legs carries the tool
        return search, search
    return _ByPlatform(mechanism, ByLegs(mechanism, course), values[-3:]), search


def turns_about_z(chain: Chain) -> bool:
    """Whether joint 1, or after a slide along z joint 2, makes a whole turn about z of frame 0.

    Then what the arm reaches is a solid of revolution.
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
    """Which poses ``(n, 4, 4)`` of the last frame a serial arm reaches within its limits, and joint positions."""
    found, fits = _solved(form, chain, Ts_frame0_last)
    return np.asarray(fits.any(axis=1)), np.take_along_axis(found.joints, fits.argmax(axis=1)[:, None, None], 1)[:, 0]


def _solved(form: ClosedForm, chain: Chain, Ts: Array) -> tuple[Solutions, NDArray[np.bool_]]:
    """All solutions of poses ``(n, 4, 4)``, and which of them ``(n, k)`` are within the limits."""
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
        """By all solutions; of an arm that brings a point alone to its place, whatever the rotation."""
        reached, joints = by_closed_form(self.form, self.chain, self._last_frames(wanted))
        return reached, np.where(reached[:, None], _turned_within(self.chain, joints), np.nan)

    def ways(self, wanted: PoseTarget) -> Array:
        """All solutions within the limits."""
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
    course: ClassicalModel

    def reached(self, passive: Array) -> tuple[NDArray[np.bool_], Array]:
        """``(n,)`` whether all legs reach passive values ``(n, z)``, and their joint positions ``(n, joints)``.

        Each leg takes the way nearest to its limits' middle; beyond a parallel singularity it is another mode.
        """
        ways = self.course.inverse_solutions(passive)
        away = np.where(np.isfinite(ways), np.abs(ways - self.course.middle), np.inf)
        joints = np.take_along_axis(ways, away.argmin(axis=1)[:, None], axis=1)[:, 0]
        reached = np.array(np.isfinite(joints).all(axis=1))
        reached[reached] = ~self.mechanism.beyond_limits(joints[reached], 0.0).any(axis=1)
        reached[reached] = self.course.side(joints[reached], passive[reached]) == self.side
        return reached, joints

    @cached_property
    def side(self) -> Array:
        """On which side of the parallel singularities the nominal position is."""
        home = self.mechanism.home[None]
        passive = self.mechanism.assembled(home, self.mechanism.nominal_values).configuration.passive.T
        return self.course.side(home, passive)


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

    def ways(self, wanted: PoseTarget) -> Array:
        """One: each leg takes the way nearest to its limits' middle."""
        return self.reached(wanted)[1][:, None]

    @cached_property
    def _places(self) -> tuple[Array, Array]:
        """Of the point at passive values zero ``(3,)``, and what each of them moves it by ``(3, z)``."""
        count = len(self.mechanism.tree.passive)
        rows = np.concatenate([np.zeros((1, count)), np.eye(count)])
        Ts = platform_poses(self.mechanism, np.tile(self.mechanism.home, (count + 1, 1)), rows)
        places = se3.transform(Ts, self.tool[None])[:, 0]
        return places[0], (places[1:] - places[0]).T
