"""How much a robot reaches, by Monte Carlo: a volume or an area with its standard error, and the voids in it.

The box is cut into equal cells, and two random places are looked at in each: the mean of what they say, summed over
the cells, estimates the size without bias, and half their difference in each cell estimates the error (stratified
sampling, Cochran 1977, section 5A.11). Cells that are reached all over add none, so that the error falls faster than
with places all over the box.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded at their first use
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.kinematics.workspace.domain import Domain
from lab.kinematics.workspace.membership import Membership

__all__ = ["Measured", "measured"]


@dataclass(frozen=True)
class Measured:
    """What was found of a workspace.

    Attributes:
        coordinates: ``(n, d)`` m, where it was looked at.
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


def measured(domain: Domain, membership: Membership, count: int, rng: np.random.Generator) -> Measured:
    """Measure what is reached of a domain.

    Args:
        count: of places, about.
    """
    edge = max(round((count / 2) ** (1 / domain.size)), 3)
    shape = (edge,) * domain.size
    step = (domain.high - domain.low) / edge
    corners = np.stack(np.meshgrid(*[np.arange(edge)] * domain.size, indexing="ij"), axis=-1).reshape(-1, domain.size)
    pairs = domain.low + (corners[:, None] + rng.random((len(corners), 2, domain.size))) * step
    flat = pairs.reshape(-1, domain.size)
    reached = domain.reached(membership, flat).reshape(-1, 2)
    weights = domain.weights(flat).reshape(-1, 2) * step.prod()
    parts = weights * reached
    return Measured(
        flat, reached.ravel(), weights.ravel() / 2, float(parts.mean(axis=1).sum()),
        float(np.sqrt(((parts[:, 0] - parts[:, 1]) ** 2).sum()) / 2),
        _voids(reached.reshape(*shape, 2), weights.reshape(*shape, 2), mirrored=domain.kind == "revolution"),
        float(step.max()),
    )  # fmt: skip


def _voids(reached: NDArray[np.bool_], weights: Array, *, mirrored: bool) -> tuple[float, ...]:
    """The sizes of what is enclosed, by cells ``(..., 2)`` none of whose places is reached, and their neighbours.

    A cell alone may be missed by chance: a void has one whose neighbours along all axes are empty, too.
    """
    if mirrored:  # what meets z is no border
        reached, weights = (np.concatenate([each[::-1], each], axis=0) for each in (reached, weights))
    empty = ~reached.any(axis=-1)
    labels, count = scipy.ndimage.label(empty)
    inner = np.zeros_like(empty)
    inner[(slice(1, -1),) * empty.ndim] = True
    open_ones = set(np.unique(labels[~inner]).tolist())
    sizes = []
    for label in set(range(1, count + 1)) - open_ones:
        void = labels == label
        if not scipy.ndimage.binary_erosion(void).any():
            continue
        around = scipy.ndimage.binary_dilation(void)
        sizes.append(float((weights * ~reached).mean(axis=-1)[around].sum()) / (2 if mirrored else 1))
    return tuple(sorted(sizes, reverse=True))
