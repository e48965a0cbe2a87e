"""Assignment of poses to the instrument's stations, by the names in the cell and the plan."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.measurements import STATION, Measurements
from lab.core.se3 import Array
from lab.simulation.model import RobotModel

__all__ = ["refuse_idle_stations", "station_columns", "stations_in"]


def stations_in(path: Path, rows: Measurements, model: RobotModel) -> NDArray[np.int_]:
    """Return the station ``(n,)``, from 0, of each row of a plan.

    Args:
        path: of the plan, for errors.
        rows: of it.
        model: in its cell.

    Raises:
        LabError: a row of a cell with several stations names none of them.
    """
    if len(model.stations) < 2:
        return np.zeros(len(rows), dtype=np.int_)
    valid = {name: i for i, name in enumerate(model.stations)}
    for i, name in enumerate(rows.stations):
        if name not in valid:
            text = f"station '{name}' is none of the cell's" if name else "the station is missing"
            raise LabError(f"{path}: {rows.where(i)}: {text}; write one of {', '.join(valid)} into the column station")
    return np.array([valid[name] for name in rows.stations], dtype=np.int_)


def station_columns(model: RobotModel, stations: NDArray[np.int_]) -> dict[str, Array]:
    """Return the conditions ``(n,)`` of each pose's station, from 0; none for a single station."""
    return {STATION + name: (stations == k).astype(np.float64) for k, name in enumerate(model.stations) if k}


def refuse_idle_stations(model: RobotModel, stations: NDArray[np.int_], least: int) -> None:
    """Refuse poses ``(n,)``, by the station that measures each, of which one measures fewer than ``least``.

    Raises:
        LabError: it names that station.
    """
    counts = np.bincount(stations, minlength=max(len(model.stations), 1))
    if len(model.stations) > 1 and counts.min() < least:
        raise LabError(
            f"{model.path}: station '{model.stations[int(counts.argmin())]}' measures {counts.min()} of "
            f"{len(stations)} poses, because others see the rest better, and needs {least} at least to be placed; "
            "leave it out, move it, or ask for more poses"
        )
