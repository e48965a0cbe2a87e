"""Locate stations of an instrument, and count the points that each needs."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.measurements import STATION, Measurements
from lab.core.se3 import Array
from lab.kinematics.effects.sessions import further_stations
from lab.kinematics.model import Model

__all__ = ["STATION_POINTS", "few_points_of_a_station", "in_first_frame", "named_stations", "station_poses"]

STATION_POINTS: Final = 3  # the fewest that place a station


def station_poses(model: Model, values: Array, data: Measurements) -> dict[str, Array]:
    """Return poses ``(4, 4)`` (m) of all stations by name, in the frame of the first, which comes first.

    Args:
        model: with parameters ``(p,)`` of the poses of the others.
    """
    further = {
        condition.removeprefix(STATION): values[list(indices)]
        for condition, indices in further_stations(model.parameters).items()
    }
    first = next((name for name in data.stations if name not in further), "")
    return {first: np.eye(4), **{name: se3.pose(se3.exp(each[3:]), each[:3]) for name, each in further.items()}}


def in_first_frame(model: Model, values: Array, inputs: Array, points: Array) -> Array:
    """Return points ``(n, k, 3)`` m, each row from the frame of its station to the first one's frame.

    Args:
        model: with parameters ``(p,)`` of the poses of the others.
        inputs: ``(n, joints + conditions)``, with the station as a condition.
    """
    first = inputs.shape[1] - len(model.conditions)
    for condition, indices in further_stations(model.parameters).items():
        here = inputs[:, first + model.conditions.index(condition)] > 0
        position, turn = values[list(indices[:3])], values[list(indices[3:])]
        points = np.where(here[:, None, None], se3.transform(se3.pose(se3.exp(turn), position), points), points)
    return points


def few_points_of_a_station(model: Model, data: Measurements) -> str:
    """Describe the station that measured too few points for its pose; "" if none."""
    further = [name.removeprefix(STATION) for name in further_stations(model.parameters)]
    if not further:
        return ""
    labels, points = np.array(data.stations), data.seen.sum(axis=1)
    counts = {
        f"station '{name}'": int(points[labels == name].sum()) for name in dict.fromkeys([*data.stations, *further])
    }
    if set(data.stations) <= set(further):
        counts["the first station"] = 0
    least, name = min((count, name) for name, count in counts.items())
    if least >= STATION_POINTS:
        return ""
    return (
        f"{name} measured {least} points, too few to place it: measure {STATION_POINTS} or more from there, "
        "or leave its rows out (use = skip)"
    )


def named_stations(rows: Measurements, of_cell: Sequence[str]) -> tuple[str, ...]:
    """Return the stations of some rows: in the cell's order, else in that of the rows.

    Raises:
        LabError: some rows name a station, and one does not.
    """
    named = dict.fromkeys(rows.stations)
    names = (*(name for name in of_cell if name in named), *(name for name in named if name not in of_cell))
    if len(names) > 1 and "" in names:
        raise LabError(f"{rows.where(rows.stations.index(''))}, column station: empty; give the row's station")
    return names
