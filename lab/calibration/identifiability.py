"""Identifiability: condition numbers, weakly observable directions, aliases, and the number of poses required."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lab.core.se3 import Array
from lab.kinematics.effects.range_errors import RANGE
from lab.kinematics.gauge import BaseSet, base_set, structure_jacobian
from lab.kinematics.model import Model

__all__ = [
    "WEAK_CONDITION",
    "Direction",
    "aliases",
    "column_scale",
    "condition_of",
    "enough_poses",
    "poses_needed",
    "scaled_condition",
    "weak_directions",
]

_ALIAS_FLOOR = 1e-9  # coefficients below this share of their row are rounding
WEAK_CONDITION = 100.0  # directions with less than this part of the largest singular value are weak
_RANK_FLOOR = 1e-12  # of the largest singular value with unit columns: below, there is none
_LARGEST_CONDITION = 1e9  # a condition number from which on poses do not identify every parameter
_MEMBER = 0.1  # the least share of a direction that names a parameter


@dataclass(frozen=True)
class _Alias:
    """A fixed parameter, and the identifiable ones that its error is aliased with.

    Attributes:
        into: (name, coefficient), the coefficient in the SI units of the two.
    """

    name: str
    into: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Direction:
    """A weakly observable change: parameters that together hardly move any observation.

    Attributes:
        singular_value: relative to the largest, of the Jacobian with unit columns.
        moved: root mean square change of an observed number (m of positions) by ``parts``.
        parts: (name, change) in SI units, the strongest first and by 1e-3.
    """

    singular_value: float
    moved: float
    parts: tuple[tuple[str, float], ...]


def weak_directions(
    names: Sequence[str], jacobian: Array, below: float = WEAK_CONDITION, rows: int | None = None
) -> tuple[Direction, ...]:
    """Return the weakly observable directions, weakest first.

    Args:
        names: of the parameters ``(f,)``.
        jacobian: ``(rows, f)``, or its R.
        below: directions are weak whose singular value times this is below the largest.
        rows: how many there are, where R is given.
    """
    scale = np.linalg.norm(jacobian, axis=0)
    _, sizes, vt = np.linalg.svd(np.linalg.qr(jacobian / np.where(scale > 0, scale, 1.0), mode="r"))
    found = []
    for size, row in zip(sizes[::-1], vt[::-1], strict=True):
        if size * below >= sizes[0]:
            break
        order = [int(i) for i in np.argsort(-np.abs(row)) if abs(row[i]) >= _MEMBER]
        change = row / scale
        unit = 1e-3 / change[order[0]]
        parts = tuple((names[i], float(unit * change[i])) for i in order)
        found.append(Direction(float(size / sizes[0]), float(abs(unit) * size / np.sqrt(rows or len(jacobian))), parts))
    return tuple(found)


def scaled_condition(jacobian: Array) -> float:
    """Return the condition number of a Jacobian ``(rows, p)`` with unit columns; infinite if rank-deficient."""
    sizes = np.linalg.svd(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300), compute_uv=False)
    full = len(sizes) == jacobian.shape[1] and sizes[-1] > _RANK_FLOOR * sizes[0]
    return float(sizes[0] / sizes[-1]) if full else float("inf")


def condition_of(model: Model, values: Array, inputs: Array) -> float:
    """Return the condition number of the base set's Jacobian, unit columns; infinite if rank-deficient.

    Args:
        values: ``(p,)``.
        inputs: ``(n, joints + conditions)`` where it is measured.
    """
    structure = base_set(model, values)
    _, jacobian = model.observe(inputs, model.rank_point(values))
    return scaled_condition(jacobian.reshape(-1, len(model.names))[:, list(structure.identifiable)])


def aliases(model: Model, structure: BaseSet, jacobian_scale: Array | None = None) -> tuple[_Alias, ...]:
    """Return the parameters that each fixed parameter is aliased with.

    A coefficient is dropped where its effect is rounding beside the others' of the same parameter.

    Args:
        jacobian_scale: ``(p,)`` the columns' norms, by which effects compare; ones if not given.
    """
    scale = np.ones(len(model.names)) if jacobian_scale is None else jacobian_scale
    result = []
    for column, fixed in enumerate(structure.fixed):
        coefficients = structure.alias[:, column]
        effects = np.abs(coefficients) * scale[list(structure.identifiable)]
        strong = effects > _ALIAS_FLOOR * max(effects.max(initial=0.0), 1e-300)
        into = tuple(
            (model.names[i], float(c))
            for i, c, keep in zip(structure.identifiable, coefficients, strong, strict=True)
            if keep
        )
        result.append(_Alias(model.names[fixed], into))
    return tuple(result)


def column_scale(model: Model, values: Array) -> Array:
    """Return norms ``(p,)`` of the Jacobian's columns at nominal links: moves of the targets by a unit of each."""
    scale: Array = np.linalg.norm(structure_jacobian(model, values, 50).reshape(-1, len(model.names)), axis=0)
    return scale


def poses_needed(model: Model, values: Array, structure: BaseSet | None = None) -> int:
    """Return the least number of generic poses that identify the base set, less range errors, which have a prior."""
    structure = structure or base_set(model, values)
    columns = [i for i in structure.identifiable if model.parameters[i].group != RANGE]
    jacobian = structure_jacobian(model, values, 5 * len(columns))
    return enough_poses(jacobian.reshape(len(jacobian), -1, len(model.names))[..., columns])


def enough_poses(jacobian: Array, measured: Array | None = None) -> int:
    """Return how many of the poses, from the first, identify every parameter; all if even these do not.

    Args:
        jacobian: ``(m, r, p)`` of the poses.
        measured: ``(n0, r, p)`` of poses that were measured already.
    """
    m, rows, p = (int(size) for size in jacobian.shape)
    before = np.empty((0, p)) if measured is None else measured.reshape(-1, p)
    for count in range(max(1, -(-(p - len(before)) // rows)), m):
        part = np.concatenate([before, jacobian[:count].reshape(-1, p)])
        if scaled_condition(part) < _LARGEST_CONDITION:
            return count
    return m
