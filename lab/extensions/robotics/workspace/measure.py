"""Estimate workspace size by Monte Carlo: a volume or an area with its standard error, and its voids.

The box is cut into equal cells, and two random places are tested in each: the mean of the two results, summed over
the cells, estimates the size without bias, and half their difference in each cell estimates the error (stratified
sampling, Cochran 1977, section 5A.11). Cells that are reached all over add none, so that the error falls faster than
with places all over the box.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded at their first use
from numpy.typing import NDArray

from lab.core.progress import Progress, no_progress
from lab.core.se3 import Array
from lab.core.whole_folder import Keep, at_once
from lab.extensions.robotics.workspace.membership import Domain, Membership

__all__ = ["Measured", "measured"]

_BLOCK = 20_000  # places that are looked at together, so that memory does not grow with all of them


@dataclass(frozen=True)
class Measured:
    """Monte Carlo estimate of a workspace.

    Attributes:
        coordinates: ``(n, d)`` m, of the sample points.
        reached: ``(n,)``.
        weights: ``(n,)`` of each, m³ or m².
        size, standard_error: m³, of a plane m².
        voids: sizes of what is enclosed and not reached, the largest first.
        cell_m: the largest edge of a cell: voids of less than three of them are not seen.
    """

    coordinates: Array
    reached: NDArray[np.bool_]
    weights: Array
    size: float
    standard_error: float
    voids: tuple[float, ...]
    cell_m: float

    def drawn(self, count: int, rng: np.random.Generator) -> Array:
        """Coordinates ``(count, d)`` of reached places, evenly spread over what is reached; fewer of less."""
        rows = np.flatnonzero(self.reached & (self.weights > 0))
        count = min(count, len(rows))
        chance = self.weights[rows] / self.weights[rows].sum()
        return np.asarray(self.coordinates[rng.choice(rows, count, replace=False, p=chance)])


def measured(
    domain: Domain,
    membership: Membership,
    count: int,
    rng: np.random.Generator,
    progress: Progress = no_progress,
    keep: Keep = at_once,
) -> Measured:
    """Measure what is reached of a domain.

    Args:
        count: of places, about.
        progress: told how many places were looked at.
        keep: how what was found of them is kept, of this robot alone.
    """
    edge = max(round((count / 2) ** (1 / domain.size)), 3)
    shape = (edge,) * domain.size
    step = (domain.high - domain.low) / edge
    corners = np.stack(np.meshgrid(*[np.arange(edge)] * domain.size, indexing="ij"), axis=-1).reshape(-1, domain.size)
    pairs = domain.low + (corners[:, None] + rng.random((len(corners), 2, domain.size))) * step
    flat = pairs.reshape(-1, domain.size)
    reached = _reached(domain, membership, flat, progress, keep).reshape(-1, 2)
    weights = domain.weights(flat).reshape(-1, 2) * step.prod()
    parts = weights * reached
    return Measured(
        flat, reached.ravel(), weights.ravel() / 2, float(parts.mean(axis=1).sum()),
        float(np.sqrt(((parts[:, 0] - parts[:, 1]) ** 2).sum()) / 2),
        _voids(reached.reshape(*shape, 2), weights.reshape(*shape, 2), mirrored=domain.kind == "revolution"),
        float(step.max()),
    )  # fmt: skip


def _reached(
    domain: Domain, membership: Membership, coordinates: Array, progress: Progress, keep: Keep
) -> NDArray[np.bool_]:
    """Test whether coordinates ``(n, d)`` are reached, in blocks."""
    reached = np.empty(len(coordinates), dtype=np.bool_)
    for first in range(0, len(coordinates), _BLOCK):
        progress(first, len(coordinates))
        some = coordinates[first : first + _BLOCK]
        piece = keep("places", [some], lambda some=some: {"reached": domain.reached(membership, some)})  # type: ignore[misc]
        reached[first : first + _BLOCK] = piece["reached"]
    return reached


def _voids(reached: NDArray[np.bool_], weights: Array, *, mirrored: bool) -> tuple[float, ...]:
    """The sizes of what is enclosed, by cells ``(..., 2)`` none of whose places is reached, and their neighbours.

    A cell alone may be missed by chance: a void has one whose neighbours along all axes are empty, too.
    """
    if mirrored:  # what meets z is no border
        reached, weights = (np.concatenate([each[::-1], each], axis=0) for each in (reached, weights))
    empty = ~reached.any(axis=-1)
    labels, _ = scipy.ndimage.label(empty)
    inner = np.zeros_like(empty)
    inner[(slice(1, -1),) * empty.ndim] = True
    open_ones = set(np.unique(labels[~inner]).tolist())
    missed, sizes = (weights * ~reached).mean(axis=-1), []
    for label, box in enumerate(scipy.ndimage.find_objects(labels), start=1):
        if label in open_ones:
            continue
        near = tuple(slice(each.start - 1, each.stop + 1) for each in box)  # inside: it does not meet the border
        void = labels[near] == label
        if not scipy.ndimage.binary_erosion(void).any():
            continue
        sizes.append(float(missed[near][scipy.ndimage.binary_dilation(void)].sum()) / (2 if mirrored else 1))
    return tuple(sorted(sizes, reverse=True))
