"""Find joint positions at which a virtual arm's point touches a fixture, by Newton's method."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError, option_name
from lab.core.measurements import Measurements, measured
from lab.core.newton import newton
from lab.core.se3 import Array, inverse, transform
from lab.kinematics.effects.effect import BUMPED, ShapesNoise, TrackerMotion
from lab.noise.instruments import Instrument
from lab.simulation.collisions import collides, random_poses
from lab.simulation.true_robot import TrueRobot, TrueSerialRobot

__all__ = ["POINT", "Chance", "Contacts", "fixture_measurements", "reachable_points", "without_sessions"]

POINT = ("p1",)  # of the tool, that touches
_DRAWN = 200  # poses, among whose points fixtures are chosen
_NEAR, _FAR = 0.4, 0.8  # shares of those by distance from the base, between which a fixture is placed: within reach
_TOUCHING_M = 1e-12
_DIFFERENCE = 1e-6  # rad or m of a joint
_LONGEST_STEP = 0.3  # rad or m of a joint
_SETTLED_M = 1e-8  # of a gap before the last step
_AROUND = 0.5  # rad or m of a joint: spread of the starts near a fixture
_STEPS, _ROUNDS = 12, 60

_NO_TEXTS: Mapping[str, tuple[str, ...]] = MappingProxyType({})

Gap = Callable[[Array, NDArray[np.int_]], Array]
"""How far ``(m, d)`` m points ``(m, 3)`` of some rows ``(m,)`` are from their fixtures."""


def reachable_points(real: TrueRobot, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Places that the tool's point reaches, neither folded nor stretched.

    Returns:
        Places ``(count, 3)`` m in the instrument's frame, and joint positions ``(count, joints)`` that lead there.
    """
    poses = random_poses(real.robot, _DRAWN, rng)
    points = real.points(poses, POINT)[:, 0]
    T_tracker_base = inverse(real.T_world_tracker) @ real.robot.T_world_frame0
    order = np.argsort(np.linalg.norm(transform(inverse(T_tracker_base), points), axis=1))
    within = order[int(_NEAR * _DRAWN) : int(_FAR * _DRAWN)]
    chosen = rng.permutation(within)[:count]
    return points[chosen], poses[chosen]


@dataclass(frozen=True)
class Contacts:
    """An arm that is to touch at some rows.

    Attributes:
        conditions: what is set at each row, ``(n,)`` each.
        scatter: ``(n, joints)`` how far the joints stand off by chance.
        gap: what is to vanish.
        near: ``(n, joints)`` that lead near each row's fixture.
    """

    real: TrueRobot
    conditions: Mapping[str, Array]
    scatter: Array
    gap: Gap
    near: Array

    def joints(self, rng: np.random.Generator) -> Array:
        """Joint positions ``(n, joints)`` in contact, within the limits and without a collision.

        They are sought from random poses, and every other time around those that lead near.

        Raises:
            LabError: the arm cannot touch some fixture in other poses.
        """
        robot, count = self.real.robot, len(self.scatter)
        found, missing = np.empty_like(self.scatter), np.arange(count)
        for number in range(_ROUNDS):
            start = random_poses(robot, len(missing), rng)
            if number % 2:
                start = self.near[missing] + _AROUND * rng.standard_normal(start.shape)
            moved = self._moved(start, missing)
            far = np.abs(self._gaps(moved, missing)).max(axis=1)
            good = (far < _TOUCHING_M) & ~robot.chain.beyond_limits(moved, 0.0).any(axis=1)
            good[good] = ~collides(robot, moved[good])
            found[missing[good]] = moved[good]
            missing = missing[~good]
            if not len(missing):
                return found
        raise LabError(
            f"robot {robot.chain.name} cannot touch its fixtures in {len(missing)} of {count} poses: take another "
            f"{option_name('seed')}, or fewer {option_name('fixtures')}"
        )

    def _gaps(self, joints: Array, rows: NDArray[np.int_]) -> Array:
        set_there = {name: column[rows] for name, column in self.conditions.items()}
        points = self.real.points(joints, POINT, set_there, self.scatter[rows])[:, 0]
        return np.nan_to_num(self.gap(points, rows), nan=1.0)

    def _moved(self, start: Array, rows: NDArray[np.int_]) -> Array:
        """The joint positions where Newton's steps, the shortest ones, end."""

        def step(joints: Array, going: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
            near, some = joints[going], rows[going]
            gaps = self._gaps(near, some)
            slopes = np.empty((*gaps.shape, joints.shape[1]))
            for j in range(joints.shape[1]):
                moved = near.copy()
                moved[:, j] += _DIFFERENCE
                slopes[..., j] = (self._gaps(moved, some) - gaps) / _DIFFERENCE
            change, settled = np.zeros_like(joints), np.zeros_like(going)
            change[going] = -(np.linalg.pinv(slopes, rcond=1e-6) @ gaps[..., None])[..., 0]
            settled[going] = np.abs(gaps).max(axis=1) < _SETTLED_M  # the next gap is a millionth of it
            return np.clip(change, -_LONGEST_STEP, _LONGEST_STEP), settled

        return newton(step, start, _STEPS).values


@dataclass(frozen=True)
class Chance:
    """Random errors of the readings of some rows.

    Attributes:
        noise: ``(n, d)`` m, the instrument's.
        displaced: ``(n, 3)`` m, by how far the point of a bad reading is elsewhere.
        bad: ``(n,)`` which rows are bad.
        scatter: ``(n, joints)`` how far the joints stand off.
    """

    noise: Array
    displaced: Array
    bad: NDArray[np.bool_]
    scatter: Array

    @classmethod
    def of(
        cls, real: TrueRobot, instrument: Instrument, shape: tuple[int, int], rng: np.random.Generator, readings: int
    ) -> "Chance":
        """Draws for an arm that is measured without a tracker, ``shape`` rows and numbers a row.

        Raises:
            LabError: the robot has loops, or its effects move a tracker.
        """
        if not isinstance(real, TrueSerialRobot):
            raise LabError(
                f"robot {real.robot.chain.name} has loops: a virtual one is measured by "
                f"{option_name('observe')} points or pose"
            )
        parts = real.effects.parts
        if any(isinstance(part, TrackerMotion) and part.motion.any() for part in parts) or any(
            isinstance(part, ShapesNoise) and part.is_of_a_tracker for part in parts
        ):
            raise LabError(
                "drift, bumps and steps are of a tracker, and this kind of observation has none: leave them out"
            )
        effects, (scattering, failing, shaping) = real.effects, rng.spawn(3)
        scatter = effects.scatter(shape[0], scattering)
        displaced, bad = effects.displacements(shape[0], failing)
        noise = instrument.sample(np.zeros((shape[0], 1, shape[1])), rng, readings)
        return cls(effects.shaped_noise(noise, shaping)[:, 0], displaced, bad, scatter)


def without_sessions(conditions: Mapping[str, Array]) -> dict[str, Array]:
    """Return the conditions of each pose without sessions: there is no tracker to be bumped."""
    return {name: column for name, column in conditions.items() if name != BUMPED}


def fixture_measurements(
    real: TrueRobot, joints: Array, conditions: Mapping[str, Array], texts: Mapping[str, tuple[str, ...]] = _NO_TEXTS
) -> Measurements:
    """Measurements without points: joint positions, conditions and the texts that name the fixtures."""
    data = measured(real.robot.chain.joint_names, real.effects.shown(joints), (), np.empty((len(joints), 0, 3)))
    return replace(data, conditions=dict(conditions), other=dict(texts))
