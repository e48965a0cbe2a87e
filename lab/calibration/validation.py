"""How good a calibration is: errors on poses it has not seen, against a truth, and the verdict.

*Before* is nominal links with base and targets fitted to the same measurements as *after*.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from lab.calibration.gauss_newton import Observations, fit
from lab.calibration.identify import Identification
from lab.calibration.initial_guess import columns_of, initial_guess
from lab.calibration.observations.protocol import observation_of
from lab.core import se3
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.model import Model
from lab.kinematics.serial.axes_to_dh import Truth

SAME_CONFIGURATION = 0.01  # rad (m for a slide): readings this near are repeats of one configuration
FOLDS, LEAST_FOLDS = 5, 3
ROWS_PER_PARAMETER = 1.5  # what each fold must leave to fit
UNUSED_REFERENCES = "the validation file has reference rows, which only --refit uses: sessions set up anew need it"
REFERENCE_EVERY = 3  # the rows that place base or tool anew where a file does not say which

Rows = NDArray[np.int_]
Identify = Callable[[Measurements], Identification]
JudgedBy = Literal["fresh", "holdout", "file", "cross-validation"]


@dataclass(frozen=True)
class Errors:
    """Lengths of position errors (m) at poses that were not fitted, one a seen point, NaN elsewhere."""

    before: Array  # (n, k)
    after: Array  # (n, k)


@dataclass(frozen=True)
class Validation:
    """By what a calibration was judged, and the errors found there; ``errors`` is None if by nothing."""

    judged_by: JudgedBy | None
    errors: Errors | None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class TruthComparison:
    """How far the estimates are from a virtual arm's truth, in the canonical gauge.

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
    """Errors of the identified and the nominal arm at ``inputs``, where the targets are at ``points`` (n, k, 3)."""
    model, both = identification.model, (identification.nominal_aligned, identification.values)
    before, after = (np.linalg.norm(model.points(inputs, v) - points, axis=2) for v in both)
    return Errors(before, after)


def errors_of(identification: Identification, test: Measurements) -> Errors:
    """Errors at rows that were not fitted, as their kind of sighting counts them."""
    observation = observation_of(identification.model)
    return Errors(
        observation.errors(test, identification.nominal_aligned), observation.errors(test, identification.values)
    )


def configurations(joints: Array) -> Rows:
    """``(n,)`` labels: rows within 0.01 rad of each other in every joint share one, transitively."""
    pairs = cKDTree(joints).query_pairs(SAME_CONFIGURATION, p=np.inf, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(joints), len(joints)))
    labels: Rows = connected_components(links, directed=False)[1].astype(np.int_)
    return labels


def kept_together(model: Model, data: Measurements) -> Rows:
    """``(n,)`` labels of rows that are fitted or held out as one: of a place, or repeats of a configuration."""
    labels = observation_of(model).cv_groups(data)
    return configurations(data.joints) if labels is None else labels


def split_by_label(labels: Rows, share: float, seed: int) -> tuple[Rows, Rows]:
    """Rows to fit and rows to hold out: all rows of a label, labels at random, until the share is reached."""
    order = rng_for(seed, "split").permutation(labels.max() + 1)
    sizes = np.bincount(labels)[order]
    held = order[np.cumsum(sizes) - sizes < share * len(labels) - 0.5]
    test = np.isin(labels, held)
    return np.flatnonzero(~test), np.flatnonzero(test)


def folds(labels: Rows, seed: int) -> Rows:
    """``(n,)`` the fold of each row, five or as many as there are labels: all rows of a label, labels at random."""
    order = rng_for(seed, "split").permutation(labels.max() + 1)
    fold_of = np.empty(len(order), dtype=np.int_)
    fold_of[order] = np.arange(len(order)) % FOLDS
    return np.asarray(fold_of[labels])


def hold_out(model: Model, data: Measurements, share: float, seed: int) -> tuple[Measurements, Measurements]:
    """The rows to fit, and those to judge by."""
    if not 0 < share < 1:
        raise LabError(f"--holdout {share:g}: give a share between 0 and 1, e.g. 0.3")
    fitted, held = split_by_label(kept_together(model, data), share, seed)
    if not len(held) or not len(fitted):
        raise LabError(f"--holdout {share:g}: {len(data)} poses leave nothing to fit or to judge; change the share")
    return data.take(fitted), data.take(held)


def validate_rows(identification: Identification, test: Measurements) -> Validation:
    """Judge on rows that were held out, or that the file itself keeps for this (``use`` = ``test``)."""
    return Validation("holdout", errors_of(identification, test))


def validate_folds(identify: Identify, identification: Identification, data: Measurements, seed: int) -> Validation:
    """Five-fold cross-validation by configuration or place; by nothing where a fold would leave too little to fit."""
    labels, numbers = kept_together(identification.model, data), data.points.shape[2]
    rows = folds(labels, seed)
    count = int(rows.max()) + 1
    kept, points = len(identification.base_set.kept), data.seen.sum(axis=1)
    enough = all(numbers * points[rows != fold].sum() >= ROWS_PER_PARAMETER * kept for fold in range(count))
    if count < LEAST_FOLDS or not enough:
        per_pose = points.mean()
        wanted = int(np.ceil(ROWS_PER_PARAMETER * kept / (numbers * per_pose) * FOLDS / (FOLDS - 1)))
        why = f"too few poses to hold any out: not judged on fresh poses, which takes about {wanted}"
        return Validation(None, None, (why,))
    shape = errors_of(identification, data).after.shape
    before, after = np.full(shape, np.nan), np.full(shape, np.nan)
    for fold in range(count):
        test = np.flatnonzero(rows == fold)
        part = identify(data.take(np.flatnonzero(rows != fold)))
        unseen = {part.model.names[i] for i in part.unobservable}
        blind = [k for k, target in enumerate(data.targets) if f"tool.{target}.x" in unseen]
        if len(unseen) > 3 * len(blind):
            return Validation(
                None, None, ("without a fold, the other poses do not tell all parameters apart: not judged",)
            )
        errors = errors_of(part, data.take(test))
        errors.before[:, blind] = errors.after[:, blind] = np.nan  # targets that only this fold's poses saw
        before[test], after[test] = errors.before, errors.after
    return Validation("cross-validation", Errors(before, after))


def validate_file(identification: Identification, model: Model, data: Measurements, refit: Sequence[str]) -> Validation:
    """Judge on another file, where each session may place its base or its targets anew.

    The rows with use ``reference`` (every third one where the file does not mark them) place
    ``refit``, the same for before and after; errors come from the other rows.

    Args:
        model: the identified arm with the targets of ``data``.
    """
    _refuse_unknown_targets(identification, model, refit)
    unused = () if refit or not (data.marked and "reference" in data.use) else (UNUSED_REFERENCES,)
    before: list[Array] = []
    after: list[Array] = []
    for session in dict.fromkeys(data.sessions):
        part = data.take([i for i, s in enumerate(data.sessions) if s == session])
        reference, test = _reference_and_test(part, refit)
        inputs, points = part.inputs(model.conditions)[test], part.points[test]
        for values, out in ((identification.nominal_aligned, before), (identification.values, after)):
            moved = _transfer(identification.model, model, values)
            if refit:
                moved = _placed(model, part.take(reference), moved, refit, session)
            out.append(np.linalg.norm(model.points(inputs, moved) - points, axis=2))
    return Validation("file", Errors(np.concatenate(before), np.concatenate(after)), (*data.warnings, *unused))


def compare_with_truth(identification: Identification, truth: Truth) -> TruthComparison:
    """Errors of the fitted parameters, in units and in standard deviations."""
    model, free = identification.model, list(identification.fit.free)
    turning = [model.names.index(f"base.{axis}") for axis in ("rx", "ry", "rz")]
    truly = truth.of(model.names)
    difference = identification.values - truly
    estimate, true = (se3.exp(values[turning]) for values in (identification.values, truly))
    difference[turning] = se3.log(true.T @ estimate)
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
    """Derivatives ``(p, p)`` of errors by parameters: one, but for the base's rotation, whose error is a logarithm."""
    turning = [model.names.index(f"base.{axis}") for axis in ("rx", "ry", "rz")]
    tangent = np.eye(len(model.names))
    tangent[np.ix_(turning, turning)] = se3.left_jacobian(-values[turning])
    return tangent


def _refuse_unknown_targets(identification: Identification, model: Model, refit: Sequence[str]) -> None:
    if stray := set(refit) - {"base", "tool"}:
        raise LabError(f"--refit {sorted(stray)[0]}: unknown; give base, tool or base,tool")
    unknown = [target for target in model.targets if target not in identification.model.targets]
    if unknown and "tool" not in refit:
        raise LabError(
            f"target {unknown[0]} of the validation file was not identified (those are "
            f"{', '.join(identification.model.targets)}); rename it, or add --refit tool"
        )


def _reference_and_test(part: Measurements, refit: Sequence[str]) -> tuple[list[int], list[int]]:
    rows = [i for i, use in enumerate(part.use) if use != "skip"]
    if part.marked:
        reference = [i for i in rows if part.use[i] == "reference"]
    else:
        reference = rows[::REFERENCE_EVERY] if refit else []
    test = [i for i in rows if i not in set(reference)]
    where = f"session '{part.sessions[0]}' of the validation file" if part.sessions[0] else "the validation file"
    if refit and not reference:
        raise LabError(f"{where} has no row with use = reference to refit {', '.join(refit)}; mark one")
    if not test:
        raise LabError(f"{where} has no row left to judge; mark fewer rows as reference")
    return reference, test


def _transfer(source: Model, target: Model, values: Array) -> Array:
    """Values by name from one model to another; targets that are new start at zero."""
    known = dict(zip(source.names, values, strict=True))
    return np.array([known.get(name, 0.0) for name in target.names])


def _placed(model: Model, reference: Measurements, values: Array, refit: Sequence[str], session: str) -> Array:
    ones = np.ones(reference.points.shape[:2])
    seen = Observations(reference.inputs(model.conditions), reference.points, ones)
    free = columns_of(model, refit)
    moved = initial_guess(model, seen, values, refit)
    solution = fit(model, seen, free, moved)
    equations = 3 * int(reference.seen.sum())
    linear = "base" not in refit  # a tool alone is found by as many equations as it has coordinates
    enough = equations >= len(free) if linear else equations > len(free)
    if solution.rank < len(free) or solution.status != "converged" or not enough:
        where = f"session '{session}'" if session else "the validation file"
        raise LabError(
            f"{where}: {len(reference)} reference rows cannot place {', '.join(refit)} "
            f"({solution.rank} of {len(free)} parameters); mark more rows as reference"
        )
    return solution.values
