"""Characteristics of ISO 9283:1998, as far as the measurements of a calibration determine them.

A position is commanded through the calibrated model. Accuracy
and repeatability are those of the positions alone, of each pose and target.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.compensation import iso9283
from lab.core.se3 import Array

__all__ = [
    "CHARACTERISTICS",
    "Accuracy",
    "Conformity",
    "PoseAccuracy",
    "Repeats",
    "conformity_of",
    "distance_errors",
    "pose_accuracy",
    "repeats_of",
]

CHARACTERISTICS = (
    "multi-directional pose accuracy variation",
    "distance repeatability",
    "position stabilization time",
    "position overshoot",
    "drift of pose characteristics",
    "exchangeability",
    "path accuracy and repeatability",
    "path accuracy on reorientation",
    "cornering deviations",
    "path velocity characteristics",
    "minimum posing time",
    "static compliance",
    "weaving deviations",
)  # of the standard's clauses 7 to 10, that a calibration does not measure
_MOST_PAIRS = 50_000


@dataclass(frozen=True)
class Accuracy:
    """Statistics over poses, m."""

    mean_m: float
    largest_m: float

    @classmethod
    def of(cls, lengths: Array) -> "Accuracy":
        """Return mean and maximum of lengths, NaN left out."""
        return cls(float(np.nanmean(lengths)), float(np.nanmax(lengths)))


@dataclass(frozen=True)
class PoseAccuracy:
    """Pose accuracy (7.2.1) of positions.

    Attributes:
        accuracy: AP, from where a pose is commanded to the mean of the positions attained.
        cycles: the fewest and the most visits to one.
    """

    accuracy: Accuracy
    poses: int
    cycles: tuple[int, int]


@dataclass(frozen=True)
class Repeats:
    """Pose repeatability (7.2.2) of positions, by the poses that were measured more than once.

    Attributes:
        repeatability: RP, mean and three standard deviations of the distances from the mean of a pose's positions.
        poses: how many were repeated.
        cycles: the fewest and the most visits to one of these.
        scatter_m: standard deviation of one coordinate between visits to a pose, with ``dof``.
        span: the largest share of the campaign, by place in the file, between two visits to one pose.
    """

    repeatability: Accuracy
    poses: int
    cycles: tuple[int, int]
    scatter_m: float
    dof: int
    span: float


def pose_accuracy(errors: Array, labels: NDArray[np.int_]) -> PoseAccuracy:
    """Compute the accuracy from errors ``(n, k, 3)`` m, measured less commanded; rows of a pose share a label.

    Coordinates are NaN where not measured.
    """
    visits = [off for _, off in _visits(errors, labels)]
    lengths = [iso9283.accuracy(off[:, None], np.zeros((1, 3)))[0] for off in visits]
    counts = [len(off) for off in visits]
    return PoseAccuracy(Accuracy.of(np.array(lengths)), len(np.unique(labels)), (min(counts), max(counts)))


def repeats_of(errors: Array, labels: NDArray[np.int_], places: Array) -> Repeats | None:
    """Compute the repeatability from errors ``(n, k, 3)`` m; None where no label has several measured rows.

    It is the scatter of a pose's errors about their own mean, which model discrepancy does not change: it is the same
    at each visit, also where the model was fitted to these rows.

    Args:
        labels: ``(n,)`` rows of a pose share one.
        places: ``(n,)`` of the rows in their campaign, from 0 to 1.
    """
    found = [(rows, off) for rows, off in _visits(errors, labels) if len(off) > 1]
    if not found:
        return None
    lengths = np.array([iso9283.repeatability(off[:, None])[0] for _, off in found])
    counts, dof = [len(off) for _, off in found], sum(3 * (len(off) - 1) for _, off in found)
    squares = sum(float(3 * off.var(axis=0).mean() * len(off)) for _, off in found)
    span = max(float(np.ptp(places[rows])) for rows, _ in found)
    scatter = float(np.sqrt(squares / dof))
    poses = len({int(labels[rows[0]]) for rows, _ in found})
    return Repeats(Accuracy.of(lengths), poses, (min(counts), max(counts)), scatter, dof, span)


def _visits(errors: Array, labels: NDArray[np.int_]) -> Iterator[tuple[NDArray[np.int_], Array]]:
    """Yield, for each pose and target, the rows where it was measured, and the errors ``(m, 3)`` there."""
    for label in np.unique(labels):
        rows = np.flatnonzero(labels == label)
        for off in np.moveaxis(errors[rows], 1, 0):
            if (seen := np.isfinite(off).all(axis=1)).any():
                yield rows[seen], off[seen]


def distance_errors(measured: Array, commanded: Array, labels: NDArray[np.int_], rng: np.random.Generator) -> Array:
    """AD (7.3.2): measured less commanded distances ``(pairs,)`` m between positions of a target in two poses.

    Of all pairs, or of many random ones. They need no base: a distance is the same in every frame.

    Args:
        measured: ``(n, k, 3)`` m, NaN where not measured.
        labels: rows of a pose share one.
    """
    count = len(measured)
    if count * (count - 1) // 2 <= _MOST_PAIRS:
        first, second = np.triu_indices(count, 1)
    else:
        first = rng.integers(count, size=_MOST_PAIRS)
        second = (first + rng.integers(1, count, _MOST_PAIRS)) % count
    other = labels[first] != labels[second]
    first, second = first[other], second[other]
    lengths = [np.linalg.norm(points[first] - points[second], axis=2) for points in (measured, commanded)]
    found = (lengths[0] - lengths[1]).ravel()
    return np.asarray(found[np.isfinite(found)])


_DecisionRule = Literal["guard-band", "simple"]
_Decision = Literal["conforms", "does not conform", "not decided"]
_RULES = {
    "simple": (
        "simple acceptance (JCGM 106:2012, 8.2): it conforms where the value is not above the tolerance; the risk of a "
        "wrong statement is shared, and is up to 50 % for a value at the tolerance"
    ),
    "guard-band": (
        "guard band of the expanded uncertainty (JCGM 106:2012, 8.3; ILAC-G8:09/2019; stricter than the default of "
        "ISO 14253-1:2017, 1.65 standard uncertainties): it conforms where the value with the expanded uncertainty is "
        "not above the tolerance, and does not conform where the value without it is above; between, nothing is decided"
    ),
}


@dataclass(frozen=True)
class Conformity:
    """Statement of conformity of a value to a tolerance."""

    value_m: float
    tolerance_m: float
    expanded_m: float
    rule: _DecisionRule
    decision: _Decision

    @property
    def rule_text(self) -> str:
        """Text of the rule."""
        return _RULES[self.rule]


def conformity_of(value_m: float, tolerance_m: float, expanded_m: float, rule: _DecisionRule) -> Conformity:
    """Return the statement on a value with an expanded uncertainty (m), by a rule."""
    guard = expanded_m if rule == "guard-band" else 0.0
    decision: _Decision = "not decided"
    if value_m + guard <= tolerance_m:
        decision = "conforms"
    elif value_m - guard > tolerance_m:
        decision = "does not conform"
    return Conformity(value_m, tolerance_m, expanded_m, rule, decision)
