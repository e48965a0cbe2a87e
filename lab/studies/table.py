"""A study's campaigns in order: rows by cell, robot and draw, and cells that belong together."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.studies.grid import ANY, FACTORS, Cell

__all__ = ["KEYS", "RESAMPLES", "CampaignArray", "CellGroup", "groups"]

KEYS = ("cell", "robot", "draw", "converged")  # the columns that are no metrics
RESAMPLES = 9999


@dataclass(frozen=True)
class CellGroup:
    """Cells that agree in all factors but some.

    Attributes:
        free: the factors in which they differ.
        shared: the others' levels, of the factors that vary in the study.
        cells: their numbers.
    """

    free: tuple[str, ...]
    shared: Mapping[str, Any]
    cells: tuple[int, ...]


def groups(cells: Sequence[Cell], free: Collection[str]) -> tuple[CellGroup, ...]:
    """Cells that agree in all factors but the free ones; a cell whose level is "any" is in each group it agrees with.

    Groups that are a part of another one are not told.
    """
    rest = [name for name in FACTORS if name not in free]
    varying = [name for name in rest if len({getattr(cell, name) for cell in cells}) > 1]
    found: dict[tuple[int, ...], CellGroup] = {}
    for key in dict.fromkeys(tuple(getattr(cell, name) for name in rest) for cell in cells):
        wanted = dict(zip(rest, key, strict=True))
        members = tuple(i for i, cell in enumerate(cells) if _agrees(cell, wanted))
        shared = {name: wanted[name] for name in varying}
        found.setdefault(members, CellGroup(tuple(free), shared, members))
    return tuple(each for each in found.values() if not any(set(each.cells) < set(other) for other in found))


def _agrees(cell: Cell, wanted: Mapping[str, Any]) -> bool:
    return all(getattr(cell, name) in (level, ANY) for name, level in wanted.items())


@dataclass(frozen=True)
class CampaignArray:
    """A study's rows by cell, robot and draw, in whatever order they came, and how robots are resampled.

    Attributes:
        columns: as they came.
        place: ``(rows,)`` of each row in an array of the shape (cells, robots, draws).
        weights: ``(resamples, robots)`` how often each robot was drawn, the same in every cell.
    """

    cells: tuple[Cell, ...]
    columns: Mapping[str, NDArray[Any]]
    shape: tuple[int, int, int]
    place: NDArray[np.int_]
    weights: Array

    @classmethod
    def of(
        cls, columns: Mapping[str, NDArray[Any]], cells: Sequence[Cell], seed: int = 0, resamples: int = RESAMPLES
    ) -> "CampaignArray":
        """From the columns ``cell``, ``robot``, ``draw``, ``converged`` and metrics.

        Raises:
            LabError: a column is missing, a cell is unknown, or a campaign is there twice.
        """
        if missing := [name for name in KEYS if name not in columns]:
            raise LabError(f"campaigns: column '{missing[0]}' is missing; there are {', '.join(columns) or 'none'}")
        cell = np.asarray(columns["cell"], dtype=int)
        if not len(cell):
            raise LabError("campaigns: there are none; run the study first")
        if cell.min() < 0 or cell.max() >= len(cells):
            raise LabError(f"campaigns: cell {cell.max()} is unknown; the study has {len(cells)}, counted from 0")
        robots, robot = np.unique(columns["robot"], return_inverse=True)
        draws, draw = np.unique(columns["draw"], return_inverse=True)
        shape = (len(cells), len(robots), len(draws))
        place = np.ravel_multi_index((cell, robot, draw), shape)
        if len(np.unique(place)) < len(place):
            raise LabError("campaigns: a cell's robot and draw is there twice; give each campaign once")
        drawn = rng_for(seed, "bootstrap").multinomial(len(robots), np.full(len(robots), 1 / len(robots)), resamples)
        return cls(tuple(cells), columns, shape, place, drawn.astype(float))

    def values(self, metric: str) -> Array:
        """A metric ``(cells, robots, draws)``; NaN where there is no campaign, it did not converge or is not finite.

        Raises:
            LabError: the metric is unknown.
        """
        if metric not in self.columns:
            raise LabError(f"metric '{metric}' is unknown; there are {', '.join(self.columns)}")
        given = np.asarray(self.columns[metric], dtype=float)
        good = np.asarray(self.columns["converged"], dtype=bool) & np.isfinite(given)
        return self._arranged(np.where(good, given, np.nan), np.nan)

    def present(self) -> NDArray[np.bool_]:
        """Whether there is a campaign ``(cells, robots, draws)``."""
        return self._arranged(np.ones(len(self.place)), 0.0).astype(bool)

    def not_converged(self) -> NDArray[np.int_]:
        """Campaigns that did not, by cell."""
        failed = ~np.asarray(self.columns["converged"], dtype=bool)
        return np.asarray(self._arranged(failed.astype(float), 0.0).sum((1, 2)), dtype=int)

    def _arranged(self, given: Array, empty: float) -> Array:
        flat = np.full(np.prod(self.shape), empty)
        flat[self.place] = given
        return flat.reshape(self.shape)
