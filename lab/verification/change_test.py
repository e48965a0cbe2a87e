"""Verify a calibrated arm with a few new measurements, and find what moved if the test rejects.

Before anything is tested, mistakes of reading are named as in every new file (``lab.diagnosis.gross``), with the
calibrated arm as the nominal one. ``split_test`` says how the test is made, ``changes`` what may have changed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.core.checks import Check, Outcome
from lab.core.errors import LabError, counted
from lab.core.measurements import Measurements, measured, thinned
from lab.core.progress import Progress, no_progress
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.significance import VERIFICATION
from lab.diagnosis.gross import Gross, gross_mistakes
from lab.diagnosis.hypothesis import Hypothesis
from lab.diagnosis.placement import placed
from lab.kinematics.effects.arm_with_effects import Arm
from lab.prediction.validation import dependent_columns
from lab.verification.changes import (
    Displacement,
    PossibleChange,
    displacement,
    equivalent,
    is_whole_base,
    movements,
    outlying,
    possible_changes,
    refitted,
)
from lab.verification.predicted_points import (
    DRAWS,
    FULL_RANK,
    CalibrationPrediction,
    RefitSolution,
    VerificationProblem,
)
from lab.verification.split_test import ChangeTest, change_test, freed

__all__ = ["Verified", "misread", "verify"]

_STRUCTURE_POSES = 50
_MOST_POSES = 1_000  # by which mistakes of reading are compared
_LARGE_M = 2e-3  # errors that are no change of an arm in use
_LARGE = 10.0  # times the predicted errors
_NORMAL = 3.0  # times the predicted errors: as predicted
_ALIEN = 5.0  # times the predicted errors, which no new base and tool bring down
_LIKE_NOMINAL = 0.25  # of the nominal model's errors: a calibration of this arm leaves far less


@dataclass(frozen=True)
class Verified:
    """Result of a verification.

    Attributes:
        good: whether the test does not reject, and no mistake of reading was found.
        statistic: r' S^-1 r, without what was fitted anew.
        p_of_all: the chance of a larger one, if nothing has changed.
        numbers: its degrees of freedom.
        sigma_dof: degrees of freedom with which sigma was estimated; None where it was given.
        test: by both parts of the statistic.
        values: ``(p,)`` of the arm as the run has them, with what was fitted anew.
        errors: ``(n, k)`` lengths of measured less predicted (m), NaN where not observed.
        expected_m: predicted root mean square length of the errors here.
        hypotheses: the best first; none where the arm is good.
        moved: the kinds among which the measurements cannot choose; none where the arm is good, or nothing explains.
        refit: displacement of what was fitted anew, by its name.
        undetermined: parameters of it that these poses do not determine, and that stay as the run has them.
        situation: a mistake of reading, or what large errors come from where that is no change of the arm; None if
            neither.
        check: of the whole, with all that its sentence needs.
        would_notice: what the test finds in 95 of 100 such files, in the worst direction (m, rad); infinite if nothing.
    """

    good: bool
    statistic: float
    p_of_all: float
    numbers: int
    sigma_dof: int | None
    test: ChangeTest
    values: Array
    errors: Array
    expected_m: float
    hypotheses: tuple[PossibleChange, ...]
    moved: tuple[str, ...]
    refit: tuple[tuple[str, Displacement], ...]
    undetermined: tuple[str, ...]
    would_notice: tuple[tuple[str, float], ...]
    situation: Check | None
    check: Check

    @property
    def p(self) -> float:
        """Chance of as much evidence against the arm, if nothing has changed."""
        return self.test.p


def misread(prediction: CalibrationPrediction, rows: Measurements) -> Gross:
    """Find mistakes of reading in new measurements, and their outliers, with the calibrated arm as the nominal one."""
    arm = prediction.arm.rigid
    return gross_mistakes(None, arm, thinned(rows, _MOST_POSES), prediction.values[: len(arm.names)])


def verify(
    prediction: CalibrationPrediction,
    observed: Observations,
    refit: Sequence[str] = (),
    rows: Measurements | None = None,
    progress: Progress = no_progress,
    gross: Gross | None = None,
    more: Sequence[Hypothesis] = (),
) -> Verified:
    """Test new measurements against a run's prediction; where it rejects, find what has moved.

    Args:
        observed: weighted by a given sigma, or by the one that the run estimated.
        refit: ``base``, ``tool`` or both: fitted anew, so that they cannot be what has moved.
        rows: of ``observed``, as messages name them; by their numbers where not given.
        progress: takes how many poses were worked out of how many, each time that all are gone through.
        gross: mistakes of reading that nobody has accepted; searched where not given.
        more: mistakes of the instrument for the whole file.

    Raises:
        LabError: the measurements are too few for what is to be fitted anew.
    """
    problem = VerificationProblem(prediction, observed, progress)
    rows = _numbered(prediction, observed) if rows is None else rows
    gross = misread(prediction, rows) if gross is None else gross
    # place base and tool anew, then test what is left
    fit, undetermined = _refit(problem, refit)
    test = change_test(prediction, fit)
    expected = problem.expected_m(fit)
    errors = _errors(prediction, observed, fit.values)
    # what is wrong, where a mistake of reading is named or the test rejects
    found = _Diagnosis(tuple(each.check for each in gross.findings), ())
    if test.changed and not gross.findings:
        found = _Search.beside(gross, problem, fit, refit, rows).diagnosis(more, expected)
    alike = equivalent(found.changes, fit.numbers)
    check = _check(prediction, fit, test, errors, expected, found, alike)
    return Verified(
        good=check.outcome == "passed",
        statistic=fit.square,
        p_of_all=prediction.p(fit.square, fit.dof),
        numbers=fit.dof,
        sigma_dof=prediction.dof,
        test=test,
        values=fit.values,
        errors=errors,
        expected_m=expected,
        hypotheses=found.changes,
        moved=tuple(dict.fromkeys(each.kind for each in alike)),
        refit=_placed_anew(prediction, fit, refit),
        undetermined=undetermined,
        would_notice=_would_notice(prediction, fit, test, refit),
        situation=found.cause,
        check=check,
    )


def _check(
    prediction: CalibrationPrediction,
    fit: RefitSolution,
    test: ChangeTest,
    errors: Array,
    expected_m: float,
    found: "_Diagnosis",
    alike: Sequence[PossibleChange],
) -> Check:
    """Return the check of a verification, with all that its sentence needs."""
    data = {
        "rms_m": float(np.sqrt(np.nanmean(errors**2))),
        "predicted_m": expected_m,
        "parts": tuple((part.numbers, part.p) for part in (test.along, test.rest) if part.numbers > 0),
        "sigma_dof": prediction.dof,
        "tail_dof": prediction.tail_dof,
        "draws": DRAWS,
        "cause": found.cause,
        "alike": tuple(each.check for each in alike),
    }
    outcome: Outcome = "failed" if test.changed or found.causes else "passed"
    return Check("verification", outcome, fit.square, test.p, VERIFICATION, data)


def _numbered(prediction: CalibrationPrediction, observed: Observations) -> Measurements:
    """Return the measurements of observations, as rows with numbers."""
    names = prediction.arm.rigid.chain.joint_names
    return measured(names, observed.inputs[:, : len(names)], prediction.arm.targets, observed.points)


def _errors(prediction: CalibrationPrediction, observed: Observations, values: Array) -> Array:
    """Return the lengths ``(n, k)`` of measured less predicted (m)."""
    predicted = (prediction.arm.points(block.inputs, values) for block in observed.blocks())
    return np.asarray(np.linalg.norm(observed.points - np.concatenate(list(predicted)), axis=2))


def _refit(problem: VerificationProblem, refit: Sequence[str]) -> tuple[RefitSolution, tuple[str, ...]]:
    """Place base, tool or both anew; return the names of their parameters that these poses do not determine.

    Raises:
        LabError: the measurements are too few.
    """
    prediction, observed = problem.prediction, problem.observed
    anew = refitted(prediction.arm, refit)
    fit = problem.placed(prediction.values, anew, refit)
    if not refit:
        return fit, ()
    requested = _structural_rank(prediction, anew)
    dependent = dependent_columns(fit.there.jacobian @ anew, FULL_RANK) if fit.rank < requested else ()
    if dependent:  # these stay as the run has them, and nothing here depends on them
        fit = problem.placed(prediction.values, np.delete(anew, dependent, axis=1), refit)
    if fit.dof < 1 or fit.numbers <= requested:
        count = counted(len(observed.points), "pose")
        raise LabError(
            f"{count} cannot place {' and '.join(refit)} anew and also test the arm: measure more, or refit less"
        )
    return fit, tuple(prediction.arm.names[int(np.argmax(anew[:, j]))] for j in dependent)


def _structural_rank(prediction: CalibrationPrediction, directions: Array) -> int:
    """Return the number of ``directions`` ``(p, h)`` that enough poses would determine."""
    inputs = prediction.arm.structure_joints(_STRUCTURE_POSES, rng_for(0, "structure"))
    _, jacobian = prediction.arm.observe(inputs, prediction.values)
    columns = jacobian.reshape(-1, len(directions)) @ directions
    return int(np.linalg.matrix_rank(columns / np.linalg.norm(columns, axis=0), rtol=FULL_RANK))


@dataclass(frozen=True)
class _Diagnosis:
    """What makes a file differ from the prediction.

    Attributes:
        causes: of large errors, the foremost first: mistakes of reading, or what was set up anew.
        changes: that may explain them, the likeliest first.
    """

    causes: tuple[Check, ...]
    changes: tuple[PossibleChange, ...]

    @property
    def cause(self) -> Check | None:
        """The foremost cause."""
        return self.causes[0] if self.causes else None


@dataclass(frozen=True)
class _Search:
    """Search for what makes a file differ from the prediction, without the outliers that are named already."""

    problem: VerificationProblem
    fit: RefitSolution
    refit: tuple[str, ...]
    rows: Measurements
    far: tuple[int, ...]

    @classmethod
    def beside(
        cls, gross: Gross, problem: VerificationProblem, fit: RefitSolution, refit: Sequence[str], rows: Measurements
    ) -> "_Search":
        """Return the search beside the outliers of a reading."""
        far = tuple(i for i, name in enumerate(rows.ids) if name in gross.outliers)
        return cls(problem, fit, tuple(refit), rows, far)

    @cached_property
    def _kept(self) -> NDArray[np.int_]:
        """Numbers of the rows that are no outliers."""
        return np.setdiff1d(np.arange(len(self.rows)), self.far)

    @cached_property
    def _rest(self) -> tuple[VerificationProblem, RefitSolution, Measurements]:
        """The problem without outliers, its fit, and its rows."""
        if not self.far:
            return self.problem, self.fit, self.rows
        rest = replace(self.problem, observed=self.problem.observed.take(self._kept))
        return rest, _refit(rest, self.refit)[0], self.rows[self._kept]

    def diagnosis(self, more: Sequence[Hypothesis], expected_m: float) -> _Diagnosis:
        """Return the possible changes; where they are movements of base or tool alone, or none, the situation, too."""
        changes = self._changes(more)
        kinds = {each.kind for each in equivalent(changes, self.fit.numbers)}
        cause = self._situation(expected_m) if kinds <= {"base", "tool"} else None
        return _Diagnosis(() if cause is None else (cause,), tuple(changes))

    def _changes(self, more: Sequence[Hypothesis]) -> list[PossibleChange]:
        """Return what may have changed, the likeliest first; the outliers, where nothing else has."""
        problem, fit, rows = self._rest
        if self.far and not change_test(problem.prediction, fit).changed:
            return outlying(self.problem, self.fit, self.refit, self.rows, self.far)
        of_rows = [each if each.columns is None else replace(each, columns=each.columns[self._kept]) for each in more]
        return possible_changes(problem, fit, self.refit, rows, of_rows)

    def _situation(self, expected_m: float) -> Check | None:
        """Return the check that names the cause of large errors: set up anew, another tool, another arm.

        The errors of a calibrated arm are a small part of a millimetre. Those of many millimetres are no change of it.

        Args:
            expected_m: root mean square error that the run predicts.
        """
        (problem, fit, _), arm = self._rest, self.problem.prediction.arm
        prediction, observed = problem.prediction, problem.observed
        if np.nanmedian(_errors(prediction, observed, fit.values)) <= max(_LARGE_M, _LARGE * expected_m):
            return None
        for kind, groups in (("setup", {"base"}), ("tool", {"tool"}), ("setup_and_tool", {"base", "tool"})):
            named = tuple(sorted(groups | set(self.refit)))
            if set(named) == set(self.refit):
                continue
            there = problem.placed(fit.values, refitted(arm, named), named)
            left_m = float(np.sqrt(np.nanmean(_errors(prediction, observed, there.values) ** 2)))
            if there.dof > 0 and left_m <= _NORMAL * expected_m:
                return Check(f"situation.{kind}", "failed", data={"refit": named, "left_m": left_m})
        nominal = arm.nominal({target: np.zeros(3) for target in arm.targets})
        some = observed.thinned(_MOST_POSES)
        misses = [placed(arm, some.inputs, some.points, v, rng_for(0, "null")).misses for v in (fit.values, nominal)]
        left_m, by_nominal_m = (float(np.sqrt(3) * np.nanmedian(each)) for each in misses)
        if left_m < max(_ALIEN * expected_m, _LIKE_NOMINAL * by_nominal_m):
            return None
        return Check("situation.another_arm", "failed", data={"left_m": left_m, "by_nominal_m": by_nominal_m})


def _placed_anew(
    prediction: CalibrationPrediction, fit: RefitSolution, refit: Sequence[str]
) -> tuple[tuple[str, Displacement], ...]:
    """Return the displacements of base and targets that were fitted anew, without targets that the run did not have."""
    arm = prediction.arm
    whole = fit.rank == refitted(arm, refit).shape[1]
    found = list[tuple[str, Displacement]]()
    for name, of in _single(arm, prediction.values):
        if name.split(".")[0] not in refit or name.removeprefix("tool.") in prediction.strange:
            continue
        moved = displacement(arm, of, prediction.values, fit.values, fit.covariance) if whole else Displacement()
        found.append((name, moved))
    return tuple(found)


def _single(arm: Arm, values: Array) -> Iterator[tuple[str, tuple[Hypothesis, Array]]]:
    """Yield the movements of one thing each by their names: ``base``, ``tool.p1``, ``joint2``."""
    for of in movements(arm, values):
        hypothesis, _ = of
        if is_whole_base(hypothesis):
            yield "base", of
        elif hypothesis.name == "target_step" or (hypothesis.name == "tool_step" and len(arm.targets) == 1):
            yield f"tool.{(hypothesis.of or arm.targets)[0]}", of
        elif hypothesis.name == "joint_step":
            yield f"joint{dict(hypothesis.data)['number']}", of


def _would_notice(
    prediction: CalibrationPrediction, fit: RefitSolution, test: ChangeTest, refit: Sequence[str]
) -> tuple[tuple[str, float], ...]:
    """Return the smallest detectable movement of base, target or a joint's zero, in the worst direction.

    The part of the test that detects it first counts; of a base, its shift.
    """
    along = freed(fit, prediction.free).model
    # the length of a whitened change that each part of the test detects
    bounds = [
        float(np.sqrt(prediction.noticeable(part.numbers, test.level))) if part.numbers > 0 else np.inf
        for part in (test.along, test.rest)
    ]
    noticed = []
    for name, (_, directions) in _single(prediction.arm, fit.values):
        if name.split(".")[0] in refit:
            continue
        shifted = directions[:, :3]
        whole = np.linalg.norm(fit.there.white(fit.there.jacobian @ shifted))
        columns = fit.beyond(shifted)
        parts = zip(bounds, (along.coordinates(columns), along.residual(columns)), strict=True)
        noticed.append((name, min(_noticed(bound, part, float(FULL_RANK * whole)) for bound, part in parts)))
    return tuple(noticed)


def _noticed(bound: float, columns: Array, rounding: float) -> float:
    """Return the size of movements along ``columns`` whose least visible one has this length; infinite if invisible."""
    if len(columns) < columns.shape[1]:
        return float("inf")
    least = np.linalg.svd(columns, compute_uv=False).min(initial=np.inf)
    return float(bound / least) if least > rounding else float("inf")
