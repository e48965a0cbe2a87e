"""Validation of a calibration: errors on validation poses, which were not fitted, and against a truth.

*Before* is the nominal model with base and targets fitted to the same measurements as *after*, the estimated one.

Reference rows of another session place base and tool anew. Poses along a line or on a plane, with one orientation, do
not separate a target's place on the flange from the base's. Undetermined parameters are fixed: columns of the Jacobian
are taken one after the other, the base's first, and one that the columns before it explain belongs to a fixed
parameter. Predictions at poses of the same kind do not depend on it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Fit, Observations, fit
from lab.calibration.guess import columns_of, few_points_of_a_station, initial_guess
from lab.calibration.identifiability import scaled_condition
from lab.calibration.identification import Identification
from lab.calibration.observation import observation_of
from lab.calibration.row_groups import FOLDS, ROWS_PER_PARAMETER, cv_groups_of, folds
from lab.core import se3
from lab.core.checks import Check
from lab.core.errors import LabError, option_name
from lab.core.linear_model import unit_columns
from lab.core.measurements import Measurements, setups
from lab.core.progress import Progress, no_progress
from lab.core.se3 import Array
from lab.kinematics.model import Model
from lab.kinematics.parameter import frame_rotations, targets_of
from lab.kinematics.serial.axes_to_dh import Truth

__all__ = [
    "DETERMINED",
    "MOST_OUTLIERS",
    "Errors",
    "JudgedBy",
    "TruthComparison",
    "Validation",
    "compare_with_truth",
    "dependent_columns",
    "error_tangent",
    "errors_at",
    "errors_of",
    "placed_anew",
    "poses_to_validate",
    "shared_rows",
    "validate_file",
    "validate_folds",
    "validate_rows",
]

_UNIDENTIFIED = Check("validation.unidentified", "not tested")
_LEAST_FOLDS = 3
MOST_OUTLIERS = 0.05  # of the validation poses, without a doubt about all of them
DETERMINED = 1e-6  # of a column's length that those before it leave unexplained: less, and it is not determined
_SHARES = ((1e-3, 0.03), (DETERMINED, 1e-4))  # undetermined by less, and what validated poses may feel of that
_CLEAR = 1e3  # condition number from which on a guess of all at once may lead astray
_STEPS = 40  # of a fit that may be ill-conditioned
_REFERENCE_EVERY = 3  # the rows that place base or tool anew where a file does not mark them

_Rows = NDArray[np.int_]
_Identify = Callable[[Measurements], Identification]
JudgedBy = Literal["fresh", "holdout", "file", "cross-validation"]


@dataclass(frozen=True)
class Errors:
    """Lengths of errors (m) at poses that were not fitted, one per measured point, NaN elsewhere.

    Attributes:
        before: ``(n, k)`` of the nominal model.
        after: ``(n, k)`` of the estimated one.
    """

    before: Array
    after: Array

    @staticmethod
    def joined(parts: "Sequence[Errors]") -> "Errors":
        """Return the errors of several sets of poses, one below the other."""
        return Errors(np.concatenate([each.before for each in parts]), np.concatenate([each.after for each in parts]))


@dataclass(frozen=True)
class Validation:
    """Validation of a calibration.

    Attributes:
        errors: at those poses; None where it was not validated.
        checks: of the validation: poses that it lacks, fits that did not converge, notes of the measurements.
        rows: those poses; None where their base or tool was placed anew, or their model is another.
        fitted_share: of the poses, that were fitted too, so that they validate nothing.
        outlier_share: of those poses, that the test of outliers names.
        robust: the errors without these; None where none is named.
    """

    judged_by: JudgedBy | None
    errors: Errors | None
    checks: tuple[Check, ...] = ()
    rows: Measurements | None = None
    fitted_share: float = 0.0
    outlier_share: float = 0.0
    robust: Errors | None = None

    def naming(self, outliers: Sequence[str]) -> "Validation":
        """Add the share of the poses that are outliers, by their ids, and the errors of the others."""
        if self.errors is None or self.rows is None:
            return self
        off = set(outliers)
        others = np.array([name not in off for name in self.rows.ids], dtype=np.bool_)
        if others.all() or not others.any():
            return self
        robust = Errors(self.errors.before[others], self.errors.after[others])
        return replace(self, outlier_share=float(1 - others.mean()), robust=robust)

    def without_few(self, outliers: Sequence[str]) -> "Validation":
        """Return the same without outliers, by their ids, where they are few: one, or up to 5 % of the poses."""
        if self.robust is None or self.rows is None:
            return self
        off = set(outliers)
        others = [i for i, name in enumerate(self.rows.ids) if name not in off]
        if len(self.rows) - len(others) > max(1, int(MOST_OUTLIERS * len(self.rows))):
            return self
        return replace(self, errors=self.robust, rows=self.rows[others])


@dataclass(frozen=True)
class TruthComparison:
    """Errors of the estimates against a virtual arm's truth, in the canonical gauge.

    Attributes:
        error: ``(f,)`` estimate less truth (m, rad); the base's rotation as log(R_truth' R_estimate).
        z: ``(f,)`` in standard deviations.
        nees_per_parameter: e' C^-1 e / f, one on average.
        coverage_95: share of the 95 % intervals that hold the truth.
    """

    error: Array
    z: Array
    nees_per_parameter: float
    coverage_95: float


def errors_at(identification: Identification, inputs: Array, points: Array) -> Errors:
    """Return the errors of the nominal and the estimated model where the targets are given.

    Args:
        inputs: ``(n, joints + conditions)``.
        points: ``(n, k, 3)`` m, the targets in the instrument's frame.
    """
    model = identification.model
    lengths = (np.linalg.norm(model.points(inputs, v) - points, axis=2) for v in _both_arms(identification))
    return Errors(*lengths)


def _both_arms(identification: Identification) -> tuple[Array, Array]:
    """Return the parameters of the nominal arm and of the estimated one."""
    return identification.nominal_aligned, identification.values


def errors_of(identification: Identification, test: Measurements) -> Errors:
    """Return errors at rows that were not fitted, as their observation counts them."""
    observation = observation_of(identification.model)
    return Errors(*(observation.errors(test, values) for values in _both_arms(identification)))


def shared_rows(test: Measurements, fitted: Measurements) -> float:
    """Return the share of rows that were fitted too: equal joint positions and points, to a nanometre."""
    common = [target for target in test.targets if target in fitted.targets]

    def rows(data: Measurements) -> list[bytes]:
        points = data.points[:, [data.targets.index(target) for target in common]].reshape(len(data), -1)
        return [row.tobytes() for row in np.round(np.concatenate([data.joints, points], axis=1), 9) + 0.0]

    known = set(rows(fitted))
    return float(np.mean([row in known for row in rows(test)])) if common and len(test) else 0.0


def validate_rows(identification: Identification, test: Measurements) -> Validation:
    """Validate on rows that were held out, or that the file itself keeps for this (``use`` = ``test``)."""
    return Validation("holdout", errors_of(identification, test), rows=test)


def poses_to_validate(identifiable: int, numbers_per_pose: float) -> int:
    """Return how many poses cross-validation needs, to fit so many parameters without a fifth of them."""
    fitted = int(np.ceil(ROWS_PER_PARAMETER * identifiable / numbers_per_pose))
    return next(count for count in range(fitted, 2 * fitted + FOLDS) if count - -(-count // FOLDS) >= fitted)


def validate_folds(
    identify: _Identify, identification: Identification, data: Measurements, seed: int, progress: Progress = no_progress
) -> Validation:
    """Five-fold cross-validation by configuration or fixture; none where a fold would leave too little to fit.

    Args:
        data: the rows ``(n,)``.
    """
    rows = folds(cv_groups_of(identification.model, data), seed)
    count = int(rows.max()) + 1
    if (missing := _missing_for_folds(identification, data, rows, count)) is not None:
        return Validation(None, None, (missing,))
    shape = errors_of(identification, data).after.shape
    before, after = np.full(shape, np.nan), np.full(shape, np.nan)
    unconverged = 0
    for fold in range(count):
        try:
            part = identify(data[rows != fold])
        except LabError as error:  # the other poses are too few for what all of them are enough for
            return Validation(None, None, (_not_without_a_fold(str(error)),))
        unconverged += part.status != "converged"
        errors = _errors_of_fold(part, data, np.flatnonzero(rows == fold))
        if errors is None:
            return Validation(None, None, (_UNIDENTIFIED,))
        before[rows == fold], after[rows == fold] = errors.before, errors.after
        progress(fold + 1, count)
    if np.isnan(after).all():
        return Validation(None, None, (_UNIDENTIFIED,))
    stuck = Check("validation.convergence", "failed", data={"stuck": unconverged, "count": count})
    return Validation("cross-validation", Errors(before, after), (stuck,) if unconverged else (), rows=data)


def _missing_for_folds(identification: Identification, data: Measurements, rows: _Rows, count: int) -> Check | None:
    """Return what a cross-validation lacks; None where each fold leaves enough to fit.

    Args:
        rows: ``(n,)`` the fold of each row, of so many folds.
    """
    for fold in range(count):
        if why := few_points_of_a_station(identification.model, data[rows != fold]):
            return _not_without_a_fold(why)
    numbers, points = data.points.shape[2], data.seen.sum(axis=1)
    identifiable = len(identification.base_set.identifiable) - len(identification.fit.aside)
    fewest = min(numbers * int(points[rows != fold].sum()) for fold in range(count))
    if count >= _LEAST_FOLDS and fewest >= ROWS_PER_PARAMETER * identifiable:
        return None
    wanted = poses_to_validate(identifiable, numbers * float(points.mean()))
    return Check("validation.poses", "not tested", data={"wanted": wanted})


def _errors_of_fold(part: Identification, data: Measurements, test: _Rows) -> Errors | None:
    """Return the errors at a fold's rows by the fit of the others; None where these leave parameters open.

    Targets that only this fold's poses measured have no errors.
    """
    unobservable = {part.model.names[i] for i in part.unobservable}
    only_here = [k for k, target in enumerate(data.targets) if f"tool.{target}.x" in unobservable]
    if len(unobservable) > 3 * len(only_here):
        return None
    errors = errors_of(part, data[test])
    errors.before[:, only_here] = errors.after[:, only_here] = np.nan
    return errors


def _not_without_a_fold(why: str) -> Check:
    return Check("validation.fold", "not tested", data={"why": why})


def validate_file(identification: Identification, model: Model, data: Measurements, refit: Sequence[str]) -> Validation:
    """Validate on another file, where each session may place its base or its targets anew.

    The rows with use ``reference`` (every third one where the file does not mark them) place ``refit``, the same rows
    for before and after; errors come from the other rows. What these rows do not determine stays as it was, and is
    named in a warning.

    Args:
        model: the arm with the targets of ``data``.

    Raises:
        LabError: a target is unknown, or a session's reference rows cannot place what is to be refitted.
    """
    _refuse_unknown_targets(identification, model, refit)
    checks = [Check("note", "noted", data={"text": text}) for text in data.warnings]
    if not refit and data.marked and "reference" in data.use:
        checks.append(Check("validation.references", "noted"))
    # the errors of each setup: stations are known, or placed anew
    together = np.array([_setup_name(setup if refit else (setup[0], "")) for setup in setups(data)])
    errors, order = list[Errors](), list[int]()
    for setup in dict.fromkeys(together.tolist()):
        of_setup = np.flatnonzero(together == setup)
        part, where = data[of_setup], setup or "the validation file"
        reference, test = _reference_and_test(part, refit, setup)
        own_errors, fixed = _errors_of_setup(identification, model, part[reference], part[test], refit, where)
        errors.append(own_errors)
        order += of_setup[test].tolist()
        if fixed:
            checks.append(Check("validation.placement", "noted", data={"where": where, "parameters": fixed}))
    comparable = not refit and model.names == identification.model.names
    return Validation("file", Errors.joined(errors), tuple(checks), data[order] if comparable else None)


def _errors_of_setup(
    identification: Identification,
    model: Model,
    reference: Measurements,
    test: Measurements,
    refit: Sequence[str],
    where: str,
) -> tuple[Errors, tuple[str, ...]]:
    """Return the errors at the test rows of one setup, and the parameters that its reference rows do not place."""
    both = [_transfer(identification.model, model, values) for values in _both_arms(identification)]
    fixed: tuple[str, ...] = ()
    if refit:
        placed = [placed_anew(model, reference, test, values, refit, where) for values in both]
        both = [arm.values for arm in placed]
        fixed = placed[1].fixed or placed[0].fixed
    inputs = test.inputs(model.conditions)
    lengths = (np.linalg.norm(model.points(inputs, values) - test.points, axis=2) for values in both)
    return Errors(*lengths), fixed


def compare_with_truth(identification: Identification, truth: Truth) -> TruthComparison:
    """Compare the fitted parameters with the truth, in SI units and in standard deviations.

    Args:
        truth: that arm's parameters, in the canonical gauge.
    """
    model, free = identification.model, list(identification.fit.free)
    truly = truth.of(model.names)
    difference = identification.values - truly
    for rotation in frame_rotations(model.parameters):
        estimate, true = (se3.exp(values[rotation]) for values in (identification.values, truly))
        difference[rotation] = se3.log(true.T @ estimate)
    error = difference[free]
    local = error_tangent(model, identification.values)[np.ix_(free, free)]
    covariance = local @ identification.covariance @ local.T
    std = np.sqrt(np.diag(covariance))
    if not (np.isfinite(std).all() and (std > 0).all()):
        return TruthComparison(error, np.full(len(free), np.nan), float("nan"), float("nan"))
    z = error / std
    nees = float((error / std) @ np.linalg.solve(covariance / np.outer(std, std), error / std)) / len(free)
    return TruthComparison(error, z, nees, float(np.mean(np.abs(z) <= identification.half_width_95)))


def error_tangent(model: Model, values: Array) -> Array:
    """Derivatives ``(p, p)`` of errors by parameters: one, but for rotations of frames, whose error is a logarithm."""
    tangent = np.eye(len(model.names))
    for rotation in frame_rotations(model.parameters):
        tangent[np.ix_(rotation, rotation)] = se3.left_jacobian(-values[rotation])
    return tangent


def _refuse_unknown_targets(identification: Identification, model: Model, refit: Sequence[str]) -> None:
    if unknown_groups := set(refit) - {"base", "tool"}:
        raise LabError(f"{option_name('refit')} {sorted(unknown_groups)[0]}: unknown; give base, tool or base,tool")
    known = targets_of(identification.model.parameters)
    unknown = [target for target in model.targets if target not in known]
    if unknown and "tool" not in refit:
        raise LabError(
            f"target {unknown[0]} of the validation file was not identified (those are "
            f"{', '.join(known)}); rename it, or add {option_name('refit')} tool"
        )


def _reference_and_test(part: Measurements, refit: Sequence[str], setup: str) -> tuple[list[int], list[int]]:
    """Split the rows of one setup into those that place what is refitted, and those to validate on.

    Raises:
        LabError: one of them would be empty.
    """
    rows = [i for i, use in enumerate(part.use) if use != "skip"]
    every = rows[::_REFERENCE_EVERY] if refit else []
    reference = [i for i in rows if part.use[i] == "reference"] if part.marked else every
    test = sorted(set(rows) - set(reference))
    where = f"{setup} of the validation file" if setup else "the validation file"
    if refit and not reference:
        raise LabError(f"{where} has no row with use = reference to refit {', '.join(refit)}; mark one")
    if not test:
        raise LabError(f"{where} has no row left to validate on; mark fewer rows as reference")
    return reference, test


def _setup_name(setup: tuple[str, str]) -> str:
    """Return the name of a session and a station; "" where neither has a name."""
    kinds = zip(("session", "station"), setup, strict=True)
    return ", ".join(f"{kind} '{name}'" for kind, name in kinds if name)


def _transfer(source: Model, target: Model, values: Array) -> Array:
    known = dict(zip(source.names, values, strict=True))
    return np.array([known.get(name, 0.0) for name in target.names])


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
    # all parameters at once, where these poses determine them clearly
    start = values if linear else initial_guess(model, observed, values, ("base",))
    slopes = observed.apply(model.observe(observed.inputs, start)[1])
    if scaled_condition(slopes[:, free]) < _CLEAR or linear:
        whole = fit(model, observed, free, initial_guess(model, observed, values, refit))
        if _is_determined(whole, len(free), reference, linear=linear):
            return _Placed(whole.values, ())
    # else the determined ones, the fewest first: from where they lead the others are near
    costs, arms = list[float](), list[_Placed]()
    for share, largest_effect in _SHARES:
        fixed = tuple(free[j] for j in dependent_columns(slopes[:, free], share))
        retained = tuple(column for column in free if column not in fixed)
        part = fit(model, observed, retained, arms[int(np.argmin(costs))].values if arms else start, most_steps=_STEPS)
        slopes = observed.apply(model.observe(observed.inputs, part.values)[1])
        of_test = model.observe(test.inputs(model.conditions), part.values)[1].reshape(-1, len(values))
        determined = _is_determined(part, len(retained), reference, linear=False)
        if determined and _unfelt(slopes, of_test, retained, fixed, largest_effect):
            costs.append(part.cost_trace[-1])
            arms.append(_Placed(part.values, tuple(model.names[i] for i in fixed)))
    if not arms:
        raise _too_few(where, reference, refit, part.rank, len(free))
    return arms[int(np.argmin(costs))]


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
