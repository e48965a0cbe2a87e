"""Characteristics of ISO 9283:1998, as far as the measurements of a calibration tell them.

A position is commanded through the calibrated model: what the controller would have to be told to attain it. Accuracy
and repeatability are those of the positions alone, of each pose and target.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.compensation import iso9283
from lab.core.se3 import Array

__all__ = ["CHARACTERISTICS", "Accuracy", "PoseCharacteristics", "distance_errors", "pose_characteristics"]

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
        """Of lengths, NaN left out."""
        return cls(float(np.nanmean(lengths)), float(np.nanmax(lengths)))


@dataclass(frozen=True)
class PoseCharacteristics:
    """Pose accuracy (7.2.1) and repeatability (7.2.2) of positions.

    Attributes:
        accuracy: AP, from where a pose is commanded to the mean of the positions attained.
        repeatability: RP, mean and three standard deviations of the distances from that mean; None where no pose was
            repeated.
        poses: how many.
        cycles: the fewest and the most visits to one.
        scatter_m: standard deviation of one coordinate between visits to a pose, with ``freedom``; None likewise.
    """

    accuracy: Accuracy
    repeatability: Accuracy | None
    poses: int
    cycles: tuple[int, int]
    scatter_m: float | None
    freedom: int


def pose_characteristics(errors: Array, labels: NDArray[np.int_]) -> PoseCharacteristics:
    """Of errors ``(n, k, 3)`` m, measured less commanded, NaN where not measured; rows of a pose share a label."""
    aps, rps, counts, squares, freedom = [], [], [], 0.0, 0
    for label in np.unique(labels):
        for off in np.moveaxis(errors[labels == label], 1, 0):
            off = off[np.isfinite(off).all(axis=1)]
            if not len(off):
                continue
            visits = off[:, None]  # one pose
            aps.append(iso9283.accuracy(visits, np.zeros((1, 3)))[0])
            counts.append(len(off))
            if len(off) > 1:
                rps.append(iso9283.repeatability(visits)[0])
                squares, freedom = squares + float(3 * off.var(axis=0).mean() * len(off)), freedom + 3 * (len(off) - 1)
    scatter = float(np.sqrt(squares / freedom)) if freedom else None
    return PoseCharacteristics(
        Accuracy.of(np.array(aps)),
        Accuracy.of(np.array(rps)) if rps else None,
        len(np.unique(labels)),
        (min(counts), max(counts)),
        scatter,
        freedom,
    )


def distance_errors(measured: Array, commanded: Array, labels: NDArray[np.int_], rng: np.random.Generator) -> Array:
    """AD (7.3.2): measured less commanded distances ``(pairs,)`` m between positions of a target in two poses.

    Of all pairs, or of many random ones. They need no base: a distance is the same in every frame.

    Args:
        measured: ``(n, k, 3)`` m, NaN where not measured.
        commanded: the same.
        labels: rows of a pose share one.
        rng: of the pairs.
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
