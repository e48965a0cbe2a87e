"""Base and targets from measurements, with no idea of either: the start of every fit.

With nominal links the flange's pose in the base is known at each measured pose. The base's rotation, its position and
the targets then enter linearly, if the nine entries of the rotation are taken as free (the direct linear transform);
the nearest rotation is the start.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.effects.stations import at_first_station, further_stations
from lab.kinematics.model import Model
from lab.kinematics.parameter import indices_of_groups

__all__ = ["columns_of", "initial_guess"]

Mask = NDArray[np.bool_]


def columns_of(model: Model, groups: Sequence[str]) -> tuple[int, ...]:
    """Indices of the parameters of these groups, e.g. ``("base", "tool")``."""
    return indices_of_groups(model.parameters, groups)


def initial_guess(
    model: Model, observed: Observations, values: Array, groups: Sequence[str] = ("base", "tool")
) -> Array:
    """Values ``(p,)`` with the base, the targets, or both placed anew, near enough for Gauss-Newton.

    Args:
        model: the arm, measured by points.
        observed: positions of its targets, m in the instrument's frame.
        values: ``(p,)``: the links, and whichever of base and targets ``groups`` leaves as it is.
        groups: what is to be placed: base, tool, or both; with the base also the stations of the instrument, if it
            had several.
    """
    if "base" in groups and (further := further_stations(model.parameters)):
        return _of_stations(model, observed, values, groups, further)
    return _of_one_station(model, observed, values, groups)


def _of_one_station(model: Model, observed: Observations, values: Array, groups: Sequence[str]) -> Array:
    """With one station, or with the rows of one that are taken for the first's."""
    base, tool = columns_of(model, ("base",)), columns_of(model, ("tool",))
    placed = values.copy()
    placed[list(base)] = 0.0
    origins, rotations = _flange_poses(model, observed.inputs, placed, tool)
    offsets = values[list(tool)].reshape(-1, 3)  # (k, 3)
    mask = observed.seen
    if "base" not in groups:
        starts = [se3.exp(values[list(base)][3:])]
    else:
        expected = origins[:, None] + np.einsum("nij,kj->nki", rotations, offsets)
        starts = [_kabsch(expected[mask], observed.points[mask])]
        if "tool" in groups:
            starts.append(_direct_rotation(origins, rotations, observed.points, mask))
    rotation, position, targets = _with_the_rest(
        np.array(starts), origins, rotations, observed.points, mask, (values[list(base[:3])], offsets), groups
    )
    placed[list(base)] = np.concatenate([position, se3.log(rotation)]) if "base" in groups else values[list(base)]
    placed[list(tool)] = targets.ravel()
    return placed


def _of_stations(
    model: Model,
    observed: Observations,
    values: Array,
    groups: Sequence[str],
    further: Mapping[str, tuple[int, ...]],
) -> Array:
    """With several stations: each places the base in its own frame, with the tool that the one of most points finds."""
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


def _flange_poses(model: Model, joints: Array, values: Array, tool: Sequence[int]) -> tuple[Array, Array]:
    """The last frame's origins ``(n, 3)`` and rotations ``(n, 3, 3)`` in the base.

    The derivatives of a target by its position in that frame are the frame's axes.
    """
    points, jacobian = model.observe(joints, values)
    rotations = jacobian[:, 0, :, list(tool[:3])].transpose(1, 2, 0)
    origins: Array = points[:, 0] - rotations @ values[list(tool[:3])]
    return origins, rotations


def _kabsch(source: Array, measured: Array) -> Array:
    """The rotation ``(3, 3)`` that takes ``source`` best into ``measured``, each ``(m, 3)`` about its mean."""
    moment: Array = (measured - measured.mean(0)).T @ (source - source.mean(0))
    return se3.nearest_rotation(moment)


def _direct_rotation(origins: Array, rotations: Array, points: Array, mask: Mask) -> Array:
    """The base's rotation ``(3, 3)`` from ``origin + R_flange t = A p + s``, linear in A, s and each t."""
    pose, target = np.nonzero(mask)
    measured = points[pose, target]
    m, k = len(pose), mask.shape[1]
    system = np.zeros((m, 3, 12 + 3 * k))
    for i in range(3):
        system[:, i, 3 * i : 3 * i + 3] = measured - measured.mean(0)
        system[:, i, 9 + i] = 1.0
    for t in range(k):
        chosen = target == t
        system[chosen, :, 12 + 3 * t : 15 + 3 * t] = -rotations[pose[chosen]]
    solution = np.linalg.lstsq(system.reshape(3 * m, -1), origins[pose].ravel(), rcond=1e-9)[0]
    return se3.nearest_rotation(np.array(solution[:9]).reshape(3, 3).T)


def _with_the_rest(
    starts: Array,
    origins: Array,
    rotations: Array,
    points: Array,
    mask: Mask,
    known: tuple[Array, Array],
    groups: Sequence[str],
) -> tuple[Array, Array, Array]:
    """Of the base's rotations ``(s, 3, 3)`` the one that leaves least, the base's position, and the targets ``(k, 3)``.

    Seen from the base, a measured point less the flange's origin is the base's position and the target turned by the
    flange, whatever the base's rotation is: one factorization for all rotations.

    Args:
        known: the base's position ``(3,)`` and the targets ``(k, 3)``, for what is not in ``groups``.
    """
    pose, target = np.nonzero(mask)
    m, k = len(pose), mask.shape[1]
    system = np.zeros((m, 3, 3 + 3 * k))
    system[:, :, :3] = np.eye(3)
    for t in range(k):
        chosen = target == t
        system[chosen, :, 3 + 3 * t : 6 + 3 * t] = rotations[pose[chosen]]
    flat = system.reshape(3 * m, -1)
    found = np.concatenate([starts.transpose(0, 2, 1) @ known[0], np.tile(known[1].ravel(), (len(starts), 1))], axis=1)
    free = np.concatenate([np.full(3, "base" in groups), np.full(3 * k, "tool" in groups)])
    if "base" in groups:
        found[:, :3] = 0.0
    wanted = (points[pose, target] @ starts - origins[pose]).reshape(len(starts), -1).T
    found[:, free] += np.linalg.lstsq(flat[:, free], wanted - flat @ found.T, rcond=1e-9)[0].T
    best = int(np.argmin(np.linalg.norm(wanted - flat @ found.T, axis=0)))
    return starts[best], starts[best] @ found[best, :3], found[best, 3:].reshape(k, 3)
