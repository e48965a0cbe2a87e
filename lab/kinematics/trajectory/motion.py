"""Moves of several kinds one after the other: phases of the joints, and paths of the tool."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array

__all__ = ["Motion", "Move"]


class Move(Protocol):
    """A part of a motion: ``Trajectory`` and ``PathMove`` are such."""

    @property
    def seconds(self) -> float:
        """How long it takes."""

    @property
    def end(self) -> Array:
        """Joint positions ``(n,)`` at the end."""

    @property
    def peaks(self) -> tuple[Array, Array]:
        """The largest magnitudes ``(n,)`` of the joints' speeds and accelerations."""

    @property
    def peak_jerk(self) -> Array:
        """The largest magnitudes ``(n,)`` of the joints' jerks; infinite where accelerations change at once."""

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Joint positions, speeds and accelerations ``(k, n)`` at times ``(k,)`` since its start."""

    def jerks_at(self, times: Array) -> Array:
        """Jerks ``(k, n)`` at times ``(k,)`` since its start."""


@dataclass(frozen=True)
class Motion:
    """Moves one after the other, of which each starts where the one before it ends."""

    moves: Sequence[Move]

    @cached_property
    def starts(self) -> Array:
        """When each move starts, and when the last one ends, ``(m + 1,)`` s."""
        return np.append(0.0, np.cumsum([move.seconds for move in self.moves]))

    @property
    def seconds(self) -> float:
        """How long all of it takes."""
        return float(self.starts[-1])

    @cached_property
    def peaks(self) -> tuple[Array, Array]:
        """The largest magnitudes ``(n,)`` of the joints' speeds and accelerations."""
        speeds, accelerations = zip(*(move.peaks for move in self.moves), strict=True)
        return np.max(speeds, axis=0), np.max(accelerations, axis=0)

    @cached_property
    def peak_jerk(self) -> Array:
        """The largest magnitudes ``(n,)`` of the joints' jerks; infinite where accelerations change at once."""
        return np.asarray(np.max([move.peak_jerk for move in self.moves], axis=0))

    def times(self, step_s: float) -> Array:
        """Times ``(k,)`` from 0 to the end, a step apart, with the end itself."""
        whole = np.arange(0.0, self.seconds, step_s)
        return np.append(whole[self.seconds - whole > 1e-9], self.seconds)

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Joint positions, speeds and accelerations ``(k, n)`` at times ``(k,)`` since the start."""
        which, size = self._which(times), len(self.moves[0].end)
        out = np.empty((len(times), size)), np.empty((len(times), size)), np.empty((len(times), size))
        for i, move in enumerate(self.moves):
            rows = np.flatnonzero(which == i)
            if rows.size:
                for whole, part in zip(out, move.at(times[rows] - self.starts[i]), strict=True):
                    whole[rows] = part
        return out

    def jerks_at(self, times: Array) -> Array:
        """Jerks ``(k, n)`` at times ``(k,)`` since the start."""
        which, out = self._which(times), np.empty((len(times), len(self.moves[0].end)))
        for i, move in enumerate(self.moves):
            out[which == i] = move.jerks_at(times[which == i] - self.starts[i])
        return out

    def _which(self, times: Array) -> NDArray[np.int_]:
        """The number ``(k,)`` of the move that each time is in."""
        return np.clip(np.searchsorted(self.starts, times, side="right") - 1, 0, len(self.moves) - 1)
