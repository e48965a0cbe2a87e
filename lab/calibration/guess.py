"""Estimate initial values of base, targets and stations of the instrument from measurements.

With nominal links the flange's pose in the base is known at each measured pose. The base's rotation, its position and
the targets then enter linearly, if the nine entries of the rotation are taken as free (the direct linear transform);
the nearest rotation is the initial value.
"""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.core import se3
from lab.core.errors import LabError
from lab.core.linear_model import least_squares
from lab.core.measurements import STATION, Measurements
from lab.core.se3 import Array
from lab.kinematics.effects.sessions import at_first_station, further_stations
from lab.kinematics.model import Model
from lab.kinematics.parameter import indices_of_groups

__all__ = [
    "STATION_POINTS",
    "columns_of",
    "few_points_of_a_station",
    "flange_poses",
    "in_first_frame",
    "initial_guess",
    "named_stations",
    "station_poses",
]

STATION_POINTS: Final = 3  # the fewest that place a station
_AXES = np.arange(3)
_DEPENDENT = 1e-9  # of the largest singular value: one below is zero


def columns_of(model: Model, groups: Sequence[str]) -> tuple[int, ...]:
    """Return indices of the parameters of these groups, e.g. ``("base", "tool")``."""
    return indices_of_groups(model.parameters, groups)


def initial_guess(
    model: Model, observed: Observations, values: Array, groups: Sequence[str] = ("base", "tool")
) -> Array:
    """Return values ``(p,)`` with base, targets, or both near enough for Gauss-Newton.

    Args:
        observed: positions of its targets, m in the instrument's frame.
        values: ``(p,)``: the links, and whichever of base and targets ``groups`` leaves as it is.
        groups: what is to be placed: base, tool, or both; with the base also the stations of the instrument, if it
            had several.
    """
    if "base" in groups and (further := further_stations(model.parameters)):
        return _of_stations(model, observed, values, groups, further)
    return _of_one_station(model, observed, values, groups)


def _of_one_station(model: Model, observed: Observations, values: Array, groups: Sequence[str]) -> Array:
    base, tool = list(columns_of(model, ("base",))), list(columns_of(model, ("tool",)))
    placed, offsets = values.copy(), values[tool].reshape(-1, 3)  # (k, 3)
    placed[base] = 0.0
    pose, target = np.nonzero(observed.seen)
    origins, rotations = (each[pose, target] for each in flange_poses(model, observed.inputs, placed, tool))
    measured = observed.points[pose, target]
    columns = _columns(rotations, target, len(offsets))
    if "base" not in groups:
        starts = se3.exp(values[None, base[3:]])
    else:
        about_mean = measured - measured.mean(0)
        moments = [_moment(origins + (rotations @ offsets[target, :, None])[:, :, 0], about_mean)]
        if "tool" in groups:
            moments.append(_direct_rotation(columns, origins, about_mean))
        starts = se3.nearest_rotation(np.array(moments))
    known = np.concatenate([values[base[:3]], offsets.ravel()])
    rotation, position, targets = _with_the_rest(starts, columns, origins, measured, known, groups)
    placed[base] = np.concatenate([position, se3.log(rotation)]) if "base" in groups else values[base]
    placed[tool] = targets
    return placed


def _of_stations(
    model: Model,
    observed: Observations,
    values: Array,
    groups: Sequence[str],
    further: Mapping[str, tuple[int, ...]],
) -> Array:
    """Guess with several stations: each gives the base in its own frame, with the tool from the one of most points."""
    first = observed.inputs.shape[1] - len(model.conditions)
    columns = [first + model.conditions.index(condition) for condition in further]
    within = observed.inputs[:, columns] > 0
    station = np.where(within.any(axis=1), within.argmax(axis=1) + 1, 0)
    inputs = at_first_station(model.conditions, observed.inputs)
    base, tool = list(columns_of(model, ("base",))), list(columns_of(model, ("tool",)))
    counts = np.bincount(station, observed.seen.sum(axis=1), minlength=len(columns) + 1)
    most = int(counts.argmax())
    found, Ts_base_station = values.copy(), [np.eye(4)] * len(counts)
    for which in sorted(range(len(counts)), key=lambda each: each != most):
        here = Observations(inputs[station == which], observed.points[station == which], np.ones(1))
        placed = _of_one_station(model, here, found, groups if which == most else ("base",))
        found[tool] = placed[tool]
        T_station_base = se3.pose(se3.exp(placed[base][3:]), placed[base][:3])
        Ts_base_station[which] = se3.inverse(T_station_base)
        if which == 0:
            found[base] = placed[base]
    for which, own in enumerate(further.values(), start=1):
        T_first_station = se3.inverse(Ts_base_station[0]) @ Ts_base_station[which]
        found[list(own)] = np.concatenate([T_first_station[:3, 3], se3.log(T_first_station[:3, :3])])
    return found


def flange_poses(model: Model, joints: Array, values: Array, tool: list[int]) -> tuple[Array, Array]:
    """Return origins ``(n, k, 3)`` and rotations ``(n, k, 3, 3)`` in the base of the last frame of each target.

    The derivatives of a target by its position in that frame are the frame's axes.
    """
    points, jacobian = model.observe(joints, values)
    offsets = values[tool].reshape(-1, 3)
    rotations = np.stack([jacobian[:, k, :, tool[3 * k : 3 * k + 3]] for k in range(len(offsets))])  # (k, 3, n, 3)
    rotations = rotations.transpose(2, 0, 3, 1)
    origins: Array = points - (rotations @ offsets[:, :, None])[..., 0]
    return origins, rotations


def _moment(source: Array, measured: Array) -> Array:
    """Return a matrix ``(3, 3)`` whose nearest rotation takes ``source`` best into ``measured`` (Kabsch 1976).

    Args:
        source, measured: ``(m, 3)``, the second about its mean.
    """
    moment: Array = measured.T @ (source - source.mean(0))
    return moment


def _columns(rotations: Array, target: NDArray[np.int_], count: int) -> Array:
    """Derivatives ``(3 m, 3 + 3 count)`` of points on the flange, in the base, by its position and by the targets.

    Args:
        rotations: ``(m, 3, 3)`` of the flange, at each point.
        target: ``(m,)`` which one each is.
    """
    columns = np.zeros((len(target), 3, 1 + count, 3))
    columns[:, _AXES, 0, _AXES] = 1.0
    columns[np.arange(len(target)), :, 1 + target] = rotations
    return columns.reshape(3 * len(target), -1)


def _direct_rotation(columns: Array, origins: Array, measured: Array) -> Array:
    """A matrix ``(3, 3)`` near the base's rotation, from ``A p - s - R_flange t = origin``, linear in A, s and each t.

    Args:
        columns, origins, measured: of m points: as ``_columns`` has them; ``(m, 3)``; ``(m, 3)`` about their mean.
    """
    by_rotation = np.zeros((len(measured), 3, 3, 3))
    by_rotation[:, _AXES, _AXES] = measured[:, None]
    both = np.concatenate([by_rotation.reshape(len(columns), 9), columns], axis=1)
    return least_squares(both, origins.reshape(-1, 1), _DEPENDENT)[0][:9].reshape(3, 3).T


def _with_the_rest(
    starts: Array, columns: Array, origins: Array, measured: Array, known: Array, groups: Sequence[str]
) -> tuple[Array, Array, Array]:
    """Return the best of the base's rotations ``(s, 3, 3)``, the base's position, and the targets ``(3 k,)``.

    Seen from the base, a measured point less the flange's origin is the base's position and the target turned by the
    flange, whatever the base's rotation is: one factorization for all rotations.

    Args:
        columns, origins, measured: of m points, as ``_columns`` has them; ``(m, 3)``; ``(m, 3)``.
        known: ``(3 + 3 k,)`` the base's position and the targets, for what is not in ``groups``.
    """
    found = np.tile(known[:, None], len(starts))
    found[:3] = 0.0 if "base" in groups else (known[:3] @ starts).T
    free = slice(0 if "base" in groups else 3, None if "tool" in groups else 3)
    wanted = (measured @ starts - origins).reshape(len(starts), -1).T
    found[free] += least_squares(columns[:, free], wanted - columns @ found, _DEPENDENT)[0]
    best = int(np.argmin(((wanted - columns @ found) ** 2).sum(axis=0)))
    return starts[best], starts[best] @ found[:3, best], found[3:, best]


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
