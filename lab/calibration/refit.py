"""Place base and tool anew by some poses, also where these poses determine only a part of them.

Poses along a line or on a plane, with one orientation, do not separate a target's place on the flange from the base's.
Undetermined parameters are fixed: columns of the Jacobian are taken one after the other, the base's first, and one that
the columns before it explain belongs to a fixed parameter. Predictions at poses of the same kind do not depend on it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lab.calibration.gauss_newton import Fit, Observations, fit
from lab.calibration.identifiability import scaled_condition
from lab.calibration.initial_guess import columns_of, initial_guess
from lab.core.errors import LabError
from lab.core.linear_model import unit_columns
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.kinematics.model import Model

__all__ = ["DETERMINED", "dependent_columns", "placed_anew"]

DETERMINED = 1e-6  # of a column's length that those before it leave unexplained: less, and it is not determined
_SHARES = ((1e-3, 0.03), (DETERMINED, 1e-4))  # undetermined by less, and what validated poses may feel of that
_CLEAR = 1e3  # condition number from which on a guess of all at once may lead astray
_STEPS = 40  # of a fit that may be ill-conditioned


@dataclass(frozen=True)
class _Placed:
    """Base and tool as some poses place them.

    Attributes:
        fixed: names of the parameters that those poses do not determine, and that stay as they were.
    """

    values: Array
    fixed: tuple[str, ...]


def placed_anew(
    model: Model, reference: Measurements, test: Measurements, values: Array, refit: Sequence[str], where: str
) -> _Placed:
    """Place base, tool or both by the reference rows.

    Args:
        reference: the rows that place them.
        test: rows of the same session on which is validated.
        values: ``(p,)`` of the arm, whose links stay.

    Raises:
        LabError: the rows determine too little: predictions at ``test`` depend on what stays undetermined.
    """
    ones = np.ones(reference.points.shape[:2])
    observed = Observations(reference.inputs(model.conditions), reference.points, ones)
    free, linear = columns_of(model, refit), "base" not in refit
    start = values if linear else initial_guess(model, observed, values, ("base",))
    slopes = observed.apply(model.observe(observed.inputs, start)[1])
    if scaled_condition(slopes[:, free]) < _CLEAR or linear:
        found = fit(model, observed, free, initial_guess(model, observed, values, refit))
        if _is_determined(found, len(free), reference, linear=linear):
            return _Placed(found.values, ())
    best: tuple[float, _Placed] | None = None
    for share, largest_effect in _SHARES:  # the fewest parameters first: from there the others are near
        fixed = tuple(free[j] for j in dependent_columns(slopes[:, free], share))
        retained = tuple(column for column in free if column not in fixed)
        found = fit(model, observed, retained, start if best is None else best[1].values, most_steps=_STEPS)
        slopes = observed.apply(model.observe(observed.inputs, found.values)[1])
        there = model.observe(test.inputs(model.conditions), found.values)[1].reshape(-1, len(values))
        sure = _is_determined(found, len(retained), reference, linear=False) and _unfelt(
            slopes, there, retained, fixed, largest_effect
        )
        if sure and (best is None or found.cost_trace[-1] < best[0]):
            best = found.cost_trace[-1], _Placed(found.values, tuple(model.names[i] for i in fixed))
    if best is None:
        raise _too_few(where, reference, refit, found.rank, len(free))
    return best[1]


def _too_few(where: str, reference: Measurements, refit: Sequence[str], rank: int, count: int) -> LabError:
    return LabError(
        f"{where}: {len(reference)} reference rows cannot place {', '.join(refit)} ({rank} of {count} parameters); "
        "mark more rows as reference"
    )


def _is_determined(found: Fit, count: int, reference: Measurements, *, linear: bool) -> bool:
    """Decide whether a fit determined all parameters; a tool alone needs no more equations than coordinates."""
    equations = 3 * int(reference.seen.sum())
    enough = equations >= count if linear else equations > count
    return found.rank == count and found.status == "converged" and enough


def dependent_columns(columns: Array, tolerance: float) -> tuple[int, ...]:
    """Return the columns ``(N, h)`` that earlier ones explain, up to a share of their length."""
    unit, scale = unit_columns(columns)
    basis = np.zeros((len(columns), 0))
    found = []
    for j in range(columns.shape[1]):
        rest = unit[:, j] - basis @ (basis.T @ unit[:, j])
        rest -= basis @ (basis.T @ rest)  # twice, for rounding
        size = float(np.linalg.norm(rest))
        if size <= tolerance or scale[j] == 0.0 or basis.shape[1] == len(columns):
            found.append(j)
        else:
            basis = np.column_stack([basis, rest / size])
    return tuple(found)


def _unfelt(slopes: Array, there: Array, retained: Sequence[int], fixed: Sequence[int], largest_effect: float) -> bool:
    """Check whether predictions hardly change with a fixed parameter when the others are refitted."""
    if not fixed:
        return True
    known = ~np.isnan(there).any(axis=1)
    make_up = np.linalg.lstsq(slopes[:, list(retained)], slopes[:, list(fixed)], rcond=1e-12)[0]
    alone = there[known][:, list(fixed)]
    left = alone - there[known][:, list(retained)] @ make_up
    return bool((np.linalg.norm(left, axis=0) <= largest_effect * np.linalg.norm(alone, axis=0)).all())
