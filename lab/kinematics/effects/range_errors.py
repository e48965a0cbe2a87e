"""Errors of a tracker's range that last through a campaign: a constant and a scale, fitted and simulated.

A tracker's head is the origin of its frame. A point p (m) at the range R = |p| is measured at (1 + s) p + c p / R: the
constant c is of the reflector's radius and the zero of the range, the scale s of the wavelength and the air. All
stations of an instrument have one constant and one scale. Both are the instrument's: an arm that is used has neither.

The scale is confounded with the size of the arm and its distance: only a prior tells it from these.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, Self

import numpy as np

from lab.core.se3 import Array
from lab.core.units import MM, PPM
from lab.kinematics.effects.effect import (
    ArmFacts,
    Effect,
    MovesTracker,
    PoseConditions,
    RangePrior,
    SimulatedEffect,
    VirtualEffect,
)
from lab.kinematics.parameter import Parameter

__all__ = [
    "CONSTANT",
    "RANGE",
    "SCALE",
    "RangeErrors",
    "TrueRangeErrors",
    "by_range_errors",
    "range_errors",
    "range_prior_rows",
    "with_range_errors",
]

RANGE = "range"  # the group of the parameters
CONSTANT, SCALE = "instrument.range", "instrument.scale"
_NEAREST_M = 1e-12  # a point at the head has no direction


def _ranges(points: Array) -> Array:
    """Return ranges ``(..., 1)`` m, which may be complex, of points ``(..., 3)``."""
    return np.asarray(np.maximum(np.sqrt((points * points).sum(axis=-1, keepdims=True)), _NEAREST_M))


def with_range_errors(points: Array, errors: Array) -> Array:
    """Return points ``(n, k, 3)`` m of the instrument's frame as they are measured.

    Args:
        errors: ``(n, 2)`` constant (m) and scale.
    """
    if not errors.any():
        return points
    constant, scale = errors[:, None, :1], errors[:, None, 1:]
    measured: Array = points * (1 + scale + constant / _ranges(points))
    return measured


def by_range_errors(points: Array, errors: Array, jacobian: Array) -> tuple[Array, Array]:
    """Return derivatives ``(n, k, 3, p)`` of the measured points, from those of the points, and by constant and scale.

    With the direction u = p / R, dm/dp = (1 + s + c / R) I - c / R u u', dm/dc = u and dm/ds = p.

    Args:
        points: ``(n, k, 3)`` m, without these errors.
        errors: ``(n, 2)``.
        jacobian: ``(n, k, 3, p)`` of the points.
    """
    by_errors = np.stack([points / _ranges(points), points], axis=-1)
    if not errors.any():
        return jacobian, by_errors
    constant, scale = errors[:, None, :1, None], errors[:, None, 1:, None]
    ranges = _ranges(points)[..., None]
    along = by_errors[..., :1]
    sideways = along * (along * jacobian).sum(axis=2, keepdims=True)
    return (1 + scale + constant / ranges) * jacobian - constant / ranges * sideways, by_errors


def range_errors(prior: RangePrior | None) -> tuple[Effect, ...]:
    """Return the fitted group of constant and scale; none where the head's position is unknown."""
    return () if prior is None else (_range_errors(prior),)


def _range_errors(prior: RangePrior) -> Effect:
    owner = CONSTANT.split(".")[0]
    parameters = (
        Parameter(owner, "range", RANGE, "length", MM, prior.constant_m),
        Parameter(owner, "scale", RANGE, "ratio", PPM, prior.scale),
    )
    return Effect(RANGE, parameters, _offsets, moves="range", made_by=partial(_range_errors, prior))


def _offsets(_: Array, within: Array, values: Array) -> tuple[Array, Array]:
    shape = (len(within), 2)
    return np.broadcast_to(values, shape), np.broadcast_to(np.eye(2), (*shape, 2))


def range_prior_rows(parameters: Sequence[Parameter], values: Array) -> tuple[Array, Array]:
    """Return the prior of constant and scale: residuals in its standard deviations, and derivatives of their model."""
    own = [i for i, each in enumerate(parameters) if each.group == RANGE]
    rows = np.zeros((len(own), len(parameters)))
    rows[range(len(own)), own] = [1 / parameters[i].scale for i in own]
    return -rows @ values, rows


@dataclass(frozen=True)
class TrueRangeErrors(SimulatedEffect, MovesTracker):
    """Range errors of a virtual instrument.

    Attributes:
        constant_m: added to every range.
        scale: of every range, relative.
    """

    constant_m: float
    scale: float
    seeing_order: ClassVar[int] = 1

    @classmethod
    def none(cls, joints: int) -> Self:
        """Return a true range."""
        return cls(0.0, 0.0)

    def true_parameters(self) -> dict[str, float]:
        """Return constant and scale."""
        return {CONSTANT: self.constant_m, SCALE: self.scale}

    def seen_after(self, points: Array, conditions: PoseConditions) -> Array:
        """Return the points ``(m, k, 3)`` as they are measured."""
        return with_range_errors(points, np.tile([self.constant_m, self.scale], (len(points), 1)))


@dataclass(frozen=True)
class RangeErrors(VirtualEffect):
    """Range errors of a virtual instrument beside those that its file states."""

    range_constant_mm: float = 0.0
    """How much too long the instrument measures every range: a reflector of another radius than it is told."""
    range_scale_ppm: float = 0.0
    """How much too long the instrument measures every range, relative: air or wavelength."""

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Return constant and scale as they are given."""
        return TrueRangeErrors(MM.to_si(self.range_constant_mm), PPM.to_si(self.range_scale_ppm))
