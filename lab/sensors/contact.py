"""Simulate readings at fixtures: random errors of each row, and joint positions in contact, by Newton's method."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError, option_name
from lab.core.measurements import measured
from lab.core.newton import newton
from lab.core.se3 import Array, exp, inverse, transform
from lab.kinematics.effects.effect import BUMPED, ShapesNoise, TrackerMotion
from lab.kinematics.tree import point_of
from lab.sensors.virtual_sensor import SimulatedReadings
from lab.simulation.collisions import collides, random_poses
from lab.simulation.tracking import VirtualMeasurement
from lab.simulation.true_robot import TrueOpenRobot

__all__ = ["POINT", "TOUCHING", "DrawnContacts", "FixtureSimulation", "without_gaps"]

POINT = "p1"  # of a tool, that touches or is tied
TOUCHING = "target"  # column of that point, of a robot with several tips
_DRAWN = 200  # poses, among whose points fixtures are chosen
_NEAR, _FAR = 0.4, 0.8  # shares of those by distance from the base, between which a fixture is placed: within reach
_TOUCHING_M = 1e-12
_DIFFERENCE = 1e-6  # rad or m of a joint
_LONGEST_STEP = 0.3  # rad or m of a joint
_SETTLED_M = 1e-8  # of a gap before the last step
_AROUND = 0.5  # rad or m of a joint: spread of the starts near a fixture
_STEPS, _ROUNDS = 12, 60
_PLACES, _PLACING_ROUNDS = 6, 12  # candidates for each frame, and how often each of its features is tried


@dataclass(frozen=True)
class DrawnContacts:
    """Fixtures placed at random about a virtual arm, and the contacts that it is to make, a row each.

    Attributes:
        near: ``(n, joints)`` joint positions that lead near each row's fixture.
        gap: distances ``(m, d)`` m of points ``(m, k, 3)`` of some rows ``(m,)`` from their fixtures: zero in contact;
            None where the arm stays where it is near.
        placed: true values of the fixtures, as in ``SimulatedReadings``.
        texts, numbers: columns of the file, ``(n,)`` each.
        sessions: ``(n,)``, where a fixture is one.
    """

    near: Array
    gap: Callable[[Array, NDArray[np.int_]], Array] | None
    placed: Mapping[str, Array]
    texts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    numbers: Mapping[str, Array] = field(default_factory=dict)
    sessions: tuple[str, ...] = ()

    @classmethod
    def at(
        cls,
        places: Array,
        near: Array,
        placed: Mapping[str, Array],
        texts: Mapping[str, tuple[str, ...]],
        numbers: Mapping[str, Array],
    ) -> Self:
        """Return contacts in which the point is at places ``(n, 3)`` m."""
        return cls(near, lambda points, rows: np.asarray(points[:, 0] - places[rows]), placed, texts, numbers)


@dataclass(frozen=True)
class FixtureSimulation:
    """A virtual arm at fixtures, with the random errors of its readings.

    Attributes:
        robot: the arm.
        targets: that touch or are tied.
        joints: ``(n, joints)``, the requested ones.
        conditions: set at each row, ``(n,)`` each, without sessions: there is no tracker to be bumped.
        noise: ``(n, d)`` m, the instrument's.
        displaced: ``(n, 3)`` m, displacement of the point of an outlier.
        bad: ``(n,)`` which rows are outliers.
        scatter: ``(n, joints)`` random joint errors.
        rng: of the fixtures.
    """

    robot: TrueOpenRobot
    targets: tuple[str, ...]
    joints: Array
    conditions: Mapping[str, Array]
    noise: Array
    displaced: Array
    bad: NDArray[np.bool_]
    scatter: Array
    rng: np.random.Generator

    @classmethod
    def of_one_point(cls, sensor: str, poses: VirtualMeasurement, numbers: int) -> Self:
        """Draw the errors of an arm that touches by one point, without a tracker, by so many ``numbers`` a row.

        Raises:
            LabError: other targets than one ``p1`` are to be measured, the robot has loops, or its effects move a
                tracker.
        """
        if len(poses.targets) != 1 or point_of(poses.targets[0]) != POINT:
            raise LabError(
                f"{option_name('observe')} {sensor} is of one point of the tool, p1: leave out "
                f"{option_name('targets')} {','.join(poses.targets)}"
            )
        robot, rng, count = poses.robot, poses.rng, len(poses.joints)
        if not isinstance(robot, TrueOpenRobot):
            raise LabError(
                f"robot {robot.robot.chain.name} has loops: a virtual one is measured by "
                f"{option_name('observe')} points or pose"
            )
        effects = robot.effects
        if any(map(_is_of_a_tracker, effects.parts)):
            raise LabError(
                "drift, bumps and steps are of a tracker, and this kind of observation has none: leave them out"
            )
        scattering, failing, shaping = rng.spawn(3)
        scatter = effects.scatter(count, scattering)
        displaced, bad = effects.displacements(count, failing)
        noise = poses.instrument.sample(np.zeros((count, 1, numbers)), rng, poses.readings)
        noise = effects.shaped_noise(noise, shaping)[:, 0]
        conditions = {name: column for name, column in poses.conditions.items() if name != BUMPED}
        return cls(robot, poses.targets, poses.joints, conditions, noise, displaced, bad, scatter, rng.spawn(1)[0])

    def points(self, joints: Array) -> Array:
        """Return places ``(n, 3)`` m of the point at the joint positions of all rows, displaced if an outlier."""
        return np.asarray(self.robot.points(joints, self.targets, self.conditions, self.scatter)[:, 0] + self.displaced)

    def reachable_points(self, count: int) -> tuple[Array, Array]:
        """Draw places that the tool's point reaches, neither folded nor stretched.

        Returns:
            Places ``(count, 3)`` m in the instrument's frame, and joint positions ``(count, joints)`` that lead there.
        """
        poses = random_poses(self.robot.robot, _DRAWN, self.rng)
        points = self.robot.points(poses, self.targets)[:, 0]
        order = np.argsort(np.linalg.norm(transform(inverse(self.T_tracker_base), points), axis=1))
        within = order[int(_NEAR * _DRAWN) : int(_FAR * _DRAWN)]
        chosen = self.rng.permutation(within)[:count]
        return points[chosen], poses[chosen]

    @property
    def T_tracker_base(self) -> Array:
        """Nominal pose ``(4, 4)`` (m) of the base in the instrument's frame."""
        return np.asarray(inverse(self.robot.T_world_tracker) @ self.robot.robot.T_world_frame0)

    def joints_in_contact(self, gap: Callable[[Array, NDArray[np.int_]], Array], near: Array) -> Array:
        """Return joint positions ``(n, joints)`` in contact, within the limits and without a collision.

        They are searched from random poses, and every other time around those that lead near.

        Args:
            gap: distances ``(m, d)`` m of points ``(m, k, 3)`` of some rows ``(m,)`` from their fixtures.
            near: ``(n, joints)`` that lead near each row's fixture.

        Raises:
            LabError: the arm cannot touch some fixture in other poses.
        """

        def starts(number: int, missing: NDArray[np.int_]) -> Array:
            return self._starts(number, near[missing])

        found, missing = self._touching(gap, starts, np.arange(len(self.scatter)), _ROUNDS)
        if not len(missing):
            return found
        raise LabError(
            f"robot {self.robot.robot.chain.name} cannot touch in {len(missing)} of {len(found)} poses: take another "
            f"{option_name('seed')}, or fewer {option_name('fixtures')}"
        )

    def _starts(self, number: int, near: Array) -> Array:
        """Return joint positions ``(m, joints)`` to start from: random ones, and every other time around ``near``."""
        start = random_poses(self.robot.robot, len(near), self.rng)
        if number % 2:
            start = near + _AROUND * self.rng.standard_normal(start.shape)
        return start

    def _touching(
        self,
        gap: Callable[[Array, NDArray[np.int_]], Array],
        starts: Callable[[int, NDArray[np.int_]], Array],
        rows: NDArray[np.int_],
        rounds: int,
    ) -> tuple[Array, NDArray[np.int_]]:
        """Return joint positions ``(m, joints)`` in contact, and those of ``m`` without any.

        Args:
            gap: of points ``(k, targets, 3)`` at some of the ``m``, by their indices.
            starts: from the number of the round and indices of the ``m``.
            rows: ``(m,)`` of the measurements, whose conditions and random errors hold.
            rounds: how often each is tried.
        """
        robot = self.robot.robot
        found, missing = np.empty((len(rows), self.scatter.shape[1])), np.arange(len(rows))

        def gaps(joints: Array, some: NDArray[np.int_]) -> Array:
            at = rows[some]
            conditions = {name: column[at] for name, column in self.conditions.items()}
            points = self.robot.points(joints, self.targets, conditions, self.scatter[at])
            return np.nan_to_num(gap(points, some), nan=1.0)

        for number in range(rounds):
            moved = without_gaps(gaps, starts(number, missing), missing)
            far = np.abs(gaps(moved, missing)).max(axis=1)
            good = (far < _TOUCHING_M) & ~robot.chain.beyond_limits(moved, 0.0).any(axis=1)
            good[good] = ~collides(robot, moved[good])
            found[missing[good]] = moved[good]
            missing = missing[~good]
            if not len(missing):
                break
        return found, missing

    def frames_within_reach(self, count: int, features: Array, *, upright: bool) -> tuple[Array, Array]:
        """Place frames at random where the tool's point reaches all of their features.

        Args:
            features: ``(f, 3)`` m, in a frame.
            upright: whether a frame is only turned about the base's z axis, as what stands on a table.

        Returns:
            Poses ``(count, 4, 4)`` m in the instrument's frame, and joint positions ``(count, joints)`` at them.

        Raises:
            LabError: there are not as many places.
        """
        at, near = self.reachable_points(_PLACES * count)
        axis = np.array([0.0, 0.0, 1.0]) if upright else _unit(self.rng.standard_normal(at.shape))
        poses = np.tile(np.eye(4), (len(at), 1, 1))
        poses[:, :3, :3] = self.T_tracker_base[:3, :3] @ exp(self.rng.uniform(-np.pi, np.pi, (len(at), 1)) * axis)
        poses[:, :3, 3] = at
        there = transform(poses, features[None]).reshape(-1, 3)

        def gap(points: Array, some: NDArray[np.int_]) -> Array:
            return np.asarray(points[:, 0] - there[some])

        rows, near_features = np.arange(len(there)) % len(self.scatter), np.repeat(near, len(features), axis=0)

        def starts(number: int, some: NDArray[np.int_]) -> Array:
            return self._starts(number, near_features[some])

        _, missing = self._touching(gap, starts, rows, _PLACING_ROUNDS)
        reached = np.setdiff1d(np.arange(len(at)), missing // len(features))[:count]
        if len(reached) < count:
            raise LabError(
                f"robot {self.robot.robot.chain.name} reaches all of what it is to touch at {len(reached)} of {count} "
                f"places: take another {option_name('seed')}, fewer {option_name('fixtures')}, or a smaller artefact"
            )
        return poses[reached], near[reached]

    def readings(self, contacts: DrawnContacts) -> SimulatedReadings:
        """Return the readings of contacts, at joint positions that are searched where there is a gap to be closed.

        Raises:
            LabError: the arm cannot touch some fixture in other poses.
        """
        joints = contacts.near if contacts.gap is None else self.joints_in_contact(contacts.gap, contacts.near)
        names, texts = self.robot.robot.chain.joint_names, dict(contacts.texts)
        if len(self.targets) == 1 and self.targets != (POINT,):
            texts[TOUCHING] = self.targets * len(joints)
        data = measured(names, self.robot.effects.shown(joints), (), np.empty((len(joints), 0, 3)))
        data = replace(data, conditions={**self.conditions, **contacts.numbers}, other=texts)
        if contacts.sessions:
            data = replace(data, sessions=contacts.sessions)
        return SimulatedReadings(data, self.bad, contacts.placed)


def _is_of_a_tracker(effect: object) -> bool:
    if isinstance(effect, TrackerMotion) and effect.motion.any():
        return True
    return isinstance(effect, ShapesNoise) and effect.is_of_a_tracker


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def without_gaps(gaps: Callable[[Array, NDArray[np.int_]], Array], start: Array, rows: NDArray[np.int_]) -> Array:
    """Return the joint positions where Newton's steps, the shortest ones, end.

    Args:
        gaps: distances ``(m, d)`` m at joint positions ``(m, joints)`` of some rows.
        start: ``(n, joints)``.
        rows: ``(n,)`` their numbers.
    """

    def step(joints: Array, going: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        near, some = joints[going], rows[going]
        here = gaps(near, some)
        slopes = np.empty((*here.shape, joints.shape[1]))
        for j in range(joints.shape[1]):
            moved = near.copy()
            moved[:, j] += _DIFFERENCE
            slopes[..., j] = (gaps(moved, some) - here) / _DIFFERENCE
        change, settled = np.zeros_like(joints), np.zeros_like(going)
        change[going] = -(np.linalg.pinv(slopes, rcond=1e-6) @ here[..., None])[..., 0]
        settled[going] = np.abs(here).max(axis=1) < _SETTLED_M  # the next gap is a millionth of it
        return np.clip(change, -_LONGEST_STEP, _LONGEST_STEP), settled

    return newton(step, start, _STEPS).values
