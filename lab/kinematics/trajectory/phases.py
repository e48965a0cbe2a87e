"""A trajectory of the joints as phases of constant jerk, or of constant acceleration where jerk has no limit.

Joint positions are in rad or m, times in s.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec

__all__ = ["EXACT", "Trajectory", "check_within", "joined"]

EXACT = 1e-9  # rad or m, or per s: by how much a joint position may pass its limit, or two ends miss each other


@dataclass(frozen=True)
class Trajectory:
    """How n joints move in m phases of constant jerk.

    Attributes:
        durations: ``(m,)`` s.
        accelerations: ``(m, n)`` rad/s^2 or m/s^2 at the start of each phase.
        start: ``(n,)`` joint positions, rad or m.
        start_speed: ``(n,)`` rad/s or m/s.
        jerks: ``(m, n)`` rad/s^3 or m/s^3; None where accelerations are constant and change at once.
    """

    durations: Array
    accelerations: Array
    start: Array
    start_speed: Array
    jerks: Array | None = None

    def __post_init__(self) -> None:
        shape = (len(self.durations), len(self.start))
        assert self.accelerations.shape == self.jerk.shape == shape and self.start_speed.shape == shape[1:]
        assert (self.durations >= 0).all() and np.isfinite(self.durations).all()
        parts = (self.accelerations, self.jerk, self.start, self.start_speed)
        assert all(np.isfinite(values).all() for values in parts)

    @property
    def jerk(self) -> Array:
        """The jerks ``(m, n)``, zero where accelerations are constant."""
        return np.zeros_like(self.accelerations) if self.jerks is None else self.jerks

    @cached_property
    def knots(self) -> tuple[Array, Array, Array]:
        """Times ``(m + 1,)``, joint positions and speeds ``(m + 1, n)`` between the phases and at the ends."""
        each, a, j = self.durations[:, None], self.accelerations, self.jerk
        speeds = np.cumsum(np.vstack([self.start_speed, (a + 0.5 * j * each) * each]), axis=0)
        moves = (speeds[:-1] + (0.5 * a + j * each / 6) * each) * each
        return np.append(0.0, np.cumsum(self.durations)), np.cumsum(np.vstack([self.start, moves]), axis=0), speeds

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return float(self.knots[0][-1])

    @property
    def end(self) -> Array:
        """Joint positions ``(n,)`` at the end."""
        return np.asarray(self.knots[1][-1])

    @property
    def end_speed(self) -> Array:
        """Speeds ``(n,)`` at the end."""
        return np.asarray(self.knots[2][-1])

    @property
    def peak_speed(self) -> Array:
        """The largest magnitudes ``(n,)`` of the speeds, also where an acceleration passes zero within a phase."""
        speeds = self.knots[2]
        inner = _at_zero(speeds[:-1], self.accelerations, self.jerk, self.durations)
        return np.asarray(np.abs(np.vstack([speeds, inner])).max(axis=0))

    @property
    def peaks(self) -> tuple[Array, Array]:
        """The largest magnitudes ``(n,)`` of the speeds and of the accelerations."""
        ends = self.accelerations + self.jerk * self.durations[:, None]
        return self.peak_speed, np.asarray(np.abs(np.vstack([self.accelerations, ends])).max(axis=0, initial=0.0))

    @property
    def peak_jerk(self) -> Array:
        """The largest magnitudes ``(n,)`` of the jerks; infinite where accelerations change at once."""
        if self.jerks is None:
            return np.full(len(self.start), np.inf)
        return np.asarray(np.abs(self.jerks).max(axis=0, initial=0.0))

    @property
    def extremes(self) -> tuple[Array, Array]:
        """The lowest and the highest joint positions ``(n,)``, where joints turn back between the ends too."""
        _, positions, speeds = self.knots
        v, a, j, each = speeds[:-1], self.accelerations, self.jerk, self.durations[:, None]
        half = -0.5 * (a + np.copysign(np.sqrt(np.maximum(a**2 - 2 * j * v, 0.0)), a))
        passed = [positions]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for t in (2 * half / j, v / half):  # where the speed v + a t + j t^2 / 2 passes zero
                inside = np.where((t > 0) & (t < each), t, 0.0)
                passed.append(positions[:-1] + (v + (0.5 * a + j * inside / 6) * inside) * inside)
        every = np.vstack(passed)
        return every.min(axis=0), every.max(axis=0)

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Joint positions, speeds and accelerations ``(k, n)`` at times ``(k,)`` since the start.

        Before the start all is as at the start, and after the end as at the end. Between two phases the acceleration
        is the next one's; from the end on it is zero.
        """
        _, positions, speeds = self.knots
        phase, since, jerk = self._phase(times)
        accelerations = np.vstack([self.accelerations, np.zeros_like(self.start)])[phase]
        now = accelerations + jerk * since
        moved = (speeds[phase] + (0.5 * accelerations + jerk * since / 6) * since) * since
        return positions[phase] + moved, speeds[phase] + 0.5 * (accelerations + now) * since, now

    def jerks_at(self, times: Array) -> Array:
        """Jerks ``(k, n)`` at times ``(k,)``; zero where accelerations are constant."""
        return self._phase(times)[2]

    def _phase(self, times: Array) -> tuple[NDArray[np.int_], Array, Array]:
        """The phase of each time, the seconds ``(k, 1)`` since it began, and its jerk ``(k, n)``."""
        knots = self.knots[0]
        held = np.clip(times, 0.0, self.seconds)
        phase = np.searchsorted(knots, held, side="right") - 1
        return phase, (held - knots[phase])[:, None], np.vstack([self.jerk, np.zeros_like(self.start)])[phase]


def _at_zero(speeds: Array, accelerations: Array, jerks: Array, durations: Array) -> Array:
    """Speeds ``(m, n)`` where the acceleration passes zero within a phase; elsewhere those at its start."""
    crosses = (accelerations * (accelerations + jerks * durations[:, None]) < 0) & (jerks != 0)
    return np.where(crosses, speeds - 0.5 * accelerations**2 / np.where(crosses, jerks, 1.0), speeds)


def joined(parts: Sequence[Trajectory]) -> Trajectory:
    """One trajectory after the other.

    Raises:
        LabError: one begins elsewhere than the one before it ends, or at another speed.
    """
    for i, (first, second) in enumerate(pairwise(parts)):
        for what, end, start in (
            ("reading", first.end, second.start),
            ("speed", first.end_speed, second.start_speed),
        ):
            j = int(np.argmax(np.abs(end - start)))
            if abs(end[j] - start[j]) > EXACT:
                raise LabError(
                    f"trajectory {i + 2} begins where joint {j + 1} has a {what} of {start[j]:g}, but the one before "
                    f"it ends at {end[j]:g}; make them the same"
                )
    limited = any(part.jerks is not None for part in parts)
    return Trajectory(
        np.concatenate([part.durations for part in parts]),
        np.concatenate([part.accelerations for part in parts]),
        parts[0].start,
        parts[0].start_speed,
        np.concatenate([part.jerk for part in parts]) if limited else None,
    )


def check_within(chain: JointSpec, trajectory: Trajectory) -> None:
    """Refuse a trajectory that leaves the limits of the joint positions between its ends.

    Raises:
        LabError: naming the joint that goes the farthest beyond.
    """
    lowest, highest = trajectory.extremes
    beyond = np.array([chain.lower - lowest, highest - chain.upper])
    side, j = divmod(int(np.argmax(beyond)), chain.size)
    if beyond[side, j] > EXACT:
        ends = f"from {chain.shown(j, trajectory.start[j])} to {chain.shown(j, trajectory.end[j])}"
        raise LabError(
            f"on its way {ends} {chain.said_beyond(j, (lowest, highest)[side][j])}; lower its speeds at the ends, or "
            "move these away from the limit"
        )
