"""Verify a calibrated arm with a few new measurements, and find what moved if the test rejects.

The test compares measured less predicted, r, with its predicted covariance S = noise + J C J' (``prediction``). One chi
squared over all numbers loses its power as these grow, so whitened r is split into its part in the span of S^-1/2 J,
with J the columns of the identified parameters, and the rest. A change of the arm shows in the first part, an outlier
or larger noise in the second. Both are independent, so each is tested at 1 - (1 - a)^(1/2) (Sidak 1967). The first
part is also how much less r' S^-1 r is where every identified parameter is refitted (Seber & Lee 2003, section 4.1).
Where the measurements are no more than the parameters, one test at a is left.

Where the test rejects, each movement alone is fitted by generalized least squares, and compared by Schwarz's criterion
(1978).
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.guess import columns_of
from lab.core import se3
from lab.core.checks import Check, Outcome
from lab.core.errors import LabError, counted
from lab.core.linear_model import LinearModel
from lab.core.measurements import seen_mask
from lab.core.progress import Progress, no_progress
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.significance import VERIFICATION
from lab.kinematics.effects.arm_with_effects import Arm
from lab.prediction.validation import dependent_columns
from lab.verification.predicted_points import (
    DRAWS,
    FULL_RANK,
    CalibrationPrediction,
    RefitSolution,
    VerificationProblem,
)
from lab.verification.situation import situation

__all__ = ["Displacement", "Hypothesis", "Verified", "change_test", "refitted", "split_test", "verify"]

_Kind = Literal["base", "tool", "joint", "reading"]


@dataclass(frozen=True)
class _PartTest:
    """Part of the test statistic r' S^-1 r.

    Attributes:
        p: the chance of a larger one, if nothing has changed; 1 where it has no degrees of freedom.
    """

    square: float
    numbers: int
    p: float


@dataclass(frozen=True)
class _ChangeTest:
    """Test for a change of the arm, by both parts of the statistic.

    Attributes:
        along: the part that the identified parameters span.
    """

    along: _PartTest
    rest: _PartTest

    @property
    def square(self) -> float:
        """Total statistic r' S^-1 r."""
        return self.along.square + self.rest.square

    @property
    def tests(self) -> int:
        """Number of parts that have degrees of freedom."""
        return sum(part.numbers > 0 for part in (self.along, self.rest))

    @property
    def p(self) -> float:
        """The chance of a smaller p of either part, if nothing has changed."""
        least = min(self.along.p, self.rest.p)
        return least if self.tests < 2 else float(-np.expm1(2 * np.log1p(-least))) if least < 1 else 1.0

    @property
    def changed(self) -> bool:
        """Check whether the test rejects at its level."""
        return self.p < VERIFICATION

    @property
    def level(self) -> float:
        """Level of each part."""
        return VERIFICATION if self.tests < 2 else float(-np.expm1(np.log1p(-VERIFICATION) / 2))


def _freed(fit: RefitSolution, free: tuple[int, ...]) -> RefitSolution:
    """Refit every identified parameter too, linearized at ``fit``; ``square`` stays that of ``fit``."""
    directions = np.concatenate([fit.directions, np.eye(len(fit.values))[:, list(free)]], axis=1)
    model = LinearModel.of(fit.there.white(fit.there.jacobian @ directions), FULL_RANK)
    return replace(fit, model=model, directions=directions)


def change_test(prediction: CalibrationPrediction, fit: RefitSolution) -> _ChangeTest:
    """Test for a change by the statistic that remains at ``fit``."""
    return split_test(prediction, (fit.square, fit.dof), _explained(fit, _freed(fit, prediction.free)))


def _explained(fit: RefitSolution, opened: RefitSolution) -> tuple[float, int]:
    """Return the fall of r' S^-1 r when the parameters are freed, and its degrees of freedom."""
    residual = fit.there.white(fit.there.residual)
    pulls = (float((each.model.coordinates(residual) ** 2).sum()) for each in (opened, fit))
    return next(pulls) - next(pulls), opened.rank - fit.rank


def split_test(prediction: CalibrationPrediction, left: tuple[float, int], along: tuple[float, int]) -> _ChangeTest:
    """Return the change test of two statistics with their degrees of freedom.

    Args:
        left: statistic of all coordinates.
        along: the part of it that the identified parameters would explain.
    """
    square, numbers = max(along[0], 0.0), along[1]
    others = left[1] - numbers
    each = max(1, left[1] // max(numbers, 1))
    rest = max(left[0] - square, 0.0)
    return _ChangeTest(
        _PartTest(square, numbers, prediction.p(square, numbers, each)),
        _PartTest(rest, others, prediction.p(rest, others)),
    )


@dataclass(frozen=True)
class Displacement:
    """Size of a movement, each with its standard deviation; NaN where that does not apply or is not observable."""

    shift_m: float = float("nan")
    shift_std_m: float = float("nan")
    turn_rad: float = float("nan")
    turn_std_rad: float = float("nan")


@dataclass(frozen=True)
class _ChangeHypothesis:
    """Hypothesis of one change of an arm.

    Attributes:
        change: what it is, by the name of its phrase: ``base_shift``, ``base``, ``tool``, ``targets``, ``target`` or
            ``joint``.
        of: the target's name, or the joint's number and name.
        directions: ``(p, h)`` how its h numbers change the parameters.
        turns: number of these, the last ones, that are rotations (rad); the others are lengths (m).
        alike: number of movements of its kind that are tried.
    """

    kind: _Kind
    change: str
    of: tuple[str, ...]
    directions: Array
    turns: int = 0
    alike: int = 1


def refitted(arm: Arm, refit: Sequence[str]) -> Array:
    """Directions ``(p, h)`` of everything that is fitted anew."""
    return np.eye(len(arm.names))[:, list(columns_of(arm, refit))]


def _of_base(arm: Arm) -> list[_ChangeHypothesis]:
    """Return movements of base or instrument, which measurements do not tell apart."""
    one = refitted(arm, ("base",))
    return [
        _ChangeHypothesis("base", "base_shift", (), one[:, :3]),
        _ChangeHypothesis("base", "base", (), one, turns=3),
    ]


def _of_tool(arm: Arm, values: Array) -> list[_ChangeHypothesis]:
    """Return each target moved alone; of several, also the tool as one (by little: v + w x t), or each by its own."""
    one, count, found = refitted(arm, ("tool",)), len(arm.targets), _of_targets(arm)
    if count > 1:
        places = values[list(columns_of(arm, ("tool",)))].reshape(-1, 3)
        turned = -se3.skew(places - places.mean(axis=0))  # (k, 3, 3) of w x t
        as_one = np.concatenate([np.tile(np.eye(3), (count, 1)), turned.reshape(-1, 3)], axis=1)
        found.append(_ChangeHypothesis("tool", "tool", (), one @ as_one, turns=3))
        found.append(_ChangeHypothesis("tool", "targets", (), one))
    return found


def _of_targets(arm: Arm) -> list[_ChangeHypothesis]:
    one, count = refitted(arm, ("tool",)), len(arm.targets)
    return [
        _ChangeHypothesis("tool", "target", (target,), one[:, 3 * k : 3 * k + 3], alike=count)
        for k, target in enumerate(arm.targets)
    ]


def _of_joints(arm: Arm) -> list[_ChangeHypothesis]:
    """Return the zero offset of each joint: its position exceeds its reading."""
    chain, found = arm.rigid.chain, []
    directions = arm.rigid.joint_derivatives(np.eye(len(arm.names)))  # (p, joints)
    for k, slides in enumerate(chain.prismatic):
        of = str(k + 1), chain.joint_names[k]
        direction = directions[:, k : k + 1]
        found.append(_ChangeHypothesis("joint", "joint", of, direction, int(not slides), chain.size))
    return found


def _extent(arm: Arm, movement: _ChangeHypothesis, before: Array, after: Array, covariance: Array) -> Displacement:
    """Return the size of a movement.

    Args:
        before, after: all parameters ``(p,)``.
        covariance: ``(p, p)`` of ``after``.
    """
    back = np.linalg.pinv(movement.directions, rcond=1e-9)
    numbers, spread = back @ (after - before), back @ covariance @ back.T
    if movement.kind == "base" and movement.turns:
        turning = list(columns_of(arm, ("base",)))[3:]
        old, new = se3.exp(before[turning]), se3.exp(after[turning])
        numbers[3:] = se3.log(new @ old.T)
        local = np.eye(6)
        local[3:, 3:] = se3.left_jacobian(after[turning])
        spread = local @ spread @ local.T
    first = len(numbers) - movement.turns
    shift = _sized(numbers[:first], spread[:first, :first])
    turn = _sized(numbers[first:], spread[first:, first:])
    return Displacement(*shift, *turn)


def _sized(vector: Array, covariance: Array) -> tuple[float, float]:
    """Length of a vector ``(3 k,)``, or of the mean of k of them (root mean square), and its standard deviation.

    A single number keeps its sign. NaN where there is none.
    """
    if not len(vector):
        return float("nan"), float("nan")
    if len(vector) == 1:
        return float(vector[0]), float(np.sqrt(covariance[0, 0]))
    length = float(np.linalg.norm(vector))
    along = vector / length if length > 0 else np.full(len(vector), len(vector) ** -0.5)
    each = np.sqrt(len(vector) / 3)
    return length / each, float(np.sqrt(along @ covariance @ along)) / each


_GAP = 6.0  # of the criterion: less is equivalent to the best (Kass & Raftery 1995: "strong")
_STRUCTURE_POSES = 50


@dataclass(frozen=True)
class Hypothesis:
    """A possible change of the arm, fitted to the measurements.

    Attributes:
        change: what it is, by the name of its phrase.
        of: the target's name, the joint's number and name, or the pose's name.
        parameters: number of its parameters that the measurements determine.
        chi2: what it leaves of r' S^-1 r.
        p: the chance of leaving more, if it is right.
        bic: Schwarz's criterion, with twice the logarithm of how many of its kind were tried.
        explains: whether what it leaves is not rejected.
    """

    kind: _Kind
    change: str
    of: tuple[str, ...]
    extent: Displacement
    parameters: int
    chi2: float
    p: float
    bic: float
    explains: bool

    @property
    def check(self) -> Check:
        """Test of the remaining statistic; passed where it is not rejected."""
        data = {"of": self.of, **asdict(self.extent)}
        return Check(f"changed.{self.change}", "passed" if self.explains else "failed", self.chi2, self.p, data=data)


@dataclass(frozen=True)
class Verified:
    """Result of a verification.

    Attributes:
        statistic: r' S^-1 r, without what was fitted anew.
        p_of_all: the chance of a larger one, if nothing has changed.
        numbers: its degrees of freedom.
        sigma_freedom: those with which sigma was estimated; None where it was given.
        values: ``(p,)`` of the arm as the run has them, with what was fitted anew.
        errors: ``(n, k)`` lengths of measured less predicted (m), NaN where not observed.
        expected_m: predicted root mean square length of the errors here.
        hypotheses: the best first; none where the arm is good.
        moved: the kinds among which the measurements cannot choose; none where the arm is good, or nothing explains.
        refit: displacement of what was fitted anew, by its name.
        undetermined: parameters of it that these poses do not determine, and that stay as the run has them.
        situation: what large errors come from where that is no change of the arm; None if nothing of the kind.
        check: of the whole, with all that its sentence needs.
        would_notice: what the test finds in 95 of 100 such files, in the worst direction (m, rad); infinite if nothing.
    """

    good: bool
    statistic: float
    p_of_all: float
    numbers: int
    sigma_dof: int | None
    test: _ChangeTest
    values: Array
    errors: Array
    expected_m: float
    hypotheses: tuple[Hypothesis, ...]
    moved: tuple[_Kind, ...]
    refit: tuple[tuple[str, Displacement], ...]
    undetermined: tuple[str, ...]
    would_notice: tuple[tuple[str, float], ...]
    situation: Check | None
    check: Check

    @property
    def p(self) -> float:
        """Chance of as much evidence against the arm, if nothing has changed."""
        return self.test.p


def verify(
    prediction: CalibrationPrediction,
    observed: Observations,
    refit: Sequence[str] = (),
    poses: Sequence[str] = (),
    progress: Progress = no_progress,
) -> Verified:
    """Test new measurements against a run's prediction; where it rejects, find what has moved.

    Args:
        observed: weighted by a given sigma, or by the one that the run estimated.
        refit: ``base``, ``tool`` or both: fitted anew, so that they cannot be what has moved.
        poses: what each is called; by their numbers where not given.
        progress: takes how many poses were worked out of how many, each time that all are gone through.

    Raises:
        LabError: the measurements are too few for what is to be fitted anew.
    """
    arm, problem = prediction.arm, VerificationProblem(prediction, observed, progress)
    # place base and tool anew, then test what is left
    fit, undetermined = _refit(problem, refit)
    test = change_test(prediction, fit)
    expected = problem.expected_m(fit)
    # where it rejects: the changes that explain it, alike where no reading tells them apart, or a mistake
    explaining = _hypotheses(problem, fit, refit, poses) if test.changed else []
    alike = _equivalent(explaining, fit.numbers)
    small = any(hypothesis.kind in ("joint", "reading") for hypothesis in alike)
    cause = situation(prediction, observed, fit.values, expected, refit) if explaining and not small else None
    predicted = (arm.points(block.inputs, fit.values) for block in observed.blocks())
    errors = np.linalg.norm(observed.points - np.concatenate(list(predicted)), axis=2)
    data = {
        "rms_m": float(np.sqrt(np.nanmean(errors**2))),
        "predicted_m": expected,
        "parts": tuple((part.numbers, part.p) for part in (test.along, test.rest) if part.numbers > 0),
        "sigma_dof": prediction.dof,
        "tail_dof": prediction.tail_dof,
        "draws": DRAWS,
        "cause": cause,
        "alike": tuple(each.check for each in alike),
        "likeliest": None if alike or not test.changed else _likeliest_parameter(prediction, fit),
    }
    outcome: Outcome = "failed" if test.changed else "passed"
    return Verified(
        good=not test.changed,
        statistic=fit.square,
        p_of_all=prediction.p(fit.square, fit.dof),
        numbers=fit.dof,
        sigma_dof=prediction.dof,
        test=test,
        values=fit.values,
        errors=errors,
        expected_m=expected,
        hypotheses=tuple(explaining),
        moved=tuple(dict.fromkeys(each.kind for each in alike)),
        refit=_placed_anew(prediction, fit, refit),
        undetermined=undetermined,
        would_notice=_would_notice(prediction, fit, test, refit),
        situation=cause,
        check=Check("verification", outcome, fit.square, test.p, VERIFICATION, data),
    )


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


def _hypotheses(
    problem: VerificationProblem, fit: RefitSolution, refit: Sequence[str], poses: Sequence[str]
) -> list[Hypothesis]:
    arm = problem.prediction.arm
    tried = [] if "base" in refit else _of_base(arm)
    tried += [] if "tool" in refit else _of_tool(arm, fit.values)
    tried += _of_joints(arm)
    found = [each for movement in tried if (each := _tried(problem, fit, refit, movement)) is not None]
    return sorted([*found, *_bad_reading(problem, fit, poses)], key=lambda each: each.bic)


def _tried(
    problem: VerificationProblem, fit: RefitSolution, refit: Sequence[str], movement: _ChangeHypothesis
) -> Hypothesis | None:
    """Fit one movement beside what is fitted anew; None where the measurements do not determine it."""
    arm = problem.prediction.arm
    directions = np.concatenate([refitted(arm, refit), movement.directions], axis=1)
    anywhere = movement.kind == "base" and movement.turns > 0
    moved = problem.placed(fit.values, directions, (*refit, "base") if anywhere else (), fit.there)
    fitted_columns = moved.rank - fit.rank
    if fitted_columns < 1:
        return None
    whole = fitted_columns == np.linalg.matrix_rank(movement.directions)
    size = _extent(arm, movement, fit.values, moved.values, moved.covariance) if whole else Displacement()
    left, what = change_test(problem.prediction, moved), (movement.kind, movement.change, movement.of)
    return _judged(problem, what, size, fitted_columns, left, movement.alike)


def _bad_reading(problem: VerificationProblem, fit: RefitSolution, poses: Sequence[str]) -> list[Hypothesis]:
    """Return the pose without which r' S^-1 r is least, as an outlier of its own.

    With M = S^-1 less what is fitted and g = M r, leaving out rows i lowers it by g_i' M_ii^-1 g_i, and M_ii^-1 g_i
    is how far they are off, with covariance M_ii^-1 (Cook & Weisberg 1982, section 2.2, for blocks).
    """
    taken = fit.taken  # M = 1 - J taken (J taken)'
    shared, least, count = taken.T @ (fit.there.jacobian.T @ fit.there.residual), None, 0
    first = 0
    for block, residual, jacobian in problem.parts(fit.values):
        mask = np.repeat(seen_mask(block.points), 3, axis=1)
        rows, pulls = np.zeros((*mask.shape, taken.shape[1])), np.zeros(mask.shape)
        rows[mask] = jacobian @ taken
        pulls[mask] = residual - rows[mask] @ shared
        left = np.eye(mask.shape[1]) - rows @ np.swapaxes(rows, 1, 2)
        inverse = np.linalg.pinv(left, rcond=FULL_RANK, hermitian=True)
        drops = np.einsum("ni,nij,nj->n", pulls, inverse, pulls)
        drops[~mask.any(axis=1)] = -np.inf
        i, count = int(drops.argmax()), count + int(mask.any(axis=1).sum())
        if least is None or drops[i] > least[0]:
            there, of_pose = np.ix_(mask[i], mask[i]), _rows_of(mask, i)
            rows_there = residual[of_pose], jacobian[of_pose]
            units = np.zeros((len(residual), len(of_pose)))
            units[of_pose] = np.eye(len(of_pose))
            metres = block.in_metres(units)[of_pose]
            least = float(drops[i]), first + i, inverse[i][there], pulls[i][mask[i]], metres
        first += len(block.inputs)
    assert least is not None
    drop, i, dof, pull, metres = least
    determined = int(np.linalg.matrix_rank(dof, hermitian=True))
    if determined < 1:
        return []
    size = Displacement(*_sized(metres @ dof @ pull, metres @ dof @ metres.T))
    pose = poses[i] if poses else f"pose {i}"
    left = _without_reading(problem.prediction, fit, (drop, determined), rows_there)
    return [_judged(problem, ("reading", "reading", (pose,)), size, determined, left, count)]


def _without_reading(
    prediction: CalibrationPrediction, fit: RefitSolution, dropped: tuple[float, int], rows: tuple[Array, Array]
) -> _ChangeTest:
    """Test all numbers but those of one pose: what these lower, where the parameters are freed too.

    Args:
        dropped: by how much r' S^-1 r is less without them, and how many they are.
        rows: whitened residuals ``(m,)`` and derivatives ``(m, p)`` of the pose.
    """
    opened = _freed(fit, prediction.free)
    square, numbers = _explained(fit, opened)
    residual, jacobian = rows
    columns = jacobian @ opened.taken
    pull = residual - columns @ (opened.taken.T @ (fit.there.jacobian.T @ fit.there.residual))
    sizes, axes = np.linalg.eigh(np.eye(len(residual)) - columns @ columns.T)
    free = sizes > FULL_RANK  # of the pose's numbers those that the parameters cannot follow
    drop, determined = float(((axes[:, free].T @ pull) ** 2 / sizes[free]).sum()), int(free.sum())
    along = square - dropped[0] + drop, numbers - dropped[1] + determined
    return split_test(prediction, (fit.square - dropped[0], fit.dof - dropped[1]), along)


def _rows_of(mask: NDArray[np.bool_], pose: int) -> NDArray[np.int_]:
    """Return the rows of one pose among the observed coordinates; ``mask`` ``(n, ...)`` marks the observed ones."""
    of_pose = np.zeros(mask.shape, dtype=np.bool_)
    of_pose[pose] = mask[pose]
    return np.flatnonzero(of_pose[mask])


def _judged(
    problem: VerificationProblem,
    what: tuple[_Kind, str, tuple[str, ...]],
    size: Displacement,
    determined: int,
    left: _ChangeTest,
    alike: int,
) -> Hypothesis:
    """Return a hypothesis with its test; ``what`` is its kind, change and ``of``."""
    prediction, numbers = problem.prediction, problem.numbers
    bic = prediction.deviance(left.square, numbers) + determined * np.log(numbers) + 2 * np.log(alike)
    return Hypothesis(*what, size, determined, left.square, left.p, float(bic), not left.changed)


def _equivalent(found: Sequence[Hypothesis], numbers: int) -> list[Hypothesis]:
    """Return the hypotheses equivalent to the best one: the best of each kind, all of joints.

    A larger hypothesis does not pay for being larger: a base that turned about the first axis is as simple a thing
    as that axis' zero, and looks the same.
    """
    explaining = [each for each in found if each.explains]
    if not explaining:
        return []
    best = explaining[0]
    alike: list[Hypothesis] = []
    for each in explaining:
        pays = max(0, each.parameters - best.parameters) * np.log(numbers)
        new = each.kind == "joint" or each.kind not in {other.kind for other in alike}
        if new and each.bic - pays <= best.bic + _GAP:
            alike.append(each)
    return alike


def _likeliest_parameter(prediction: CalibrationPrediction, fit: RefitSolution) -> str | None:
    columns = fit.beyond(np.eye(len(fit.values))[:, list(prediction.free)])
    sizes = (columns**2).sum(axis=0)
    pulls = columns.T @ fit.there.white(fit.there.residual)
    drops = np.divide(pulls**2, sizes, out=np.zeros_like(sizes), where=sizes > 0)
    if not len(drops) or drops.max() <= 0:
        return None
    return prediction.arm.names[prediction.free[int(drops.argmax())]]


def _placed_anew(
    prediction: CalibrationPrediction, fit: RefitSolution, refit: Sequence[str]
) -> tuple[tuple[str, Displacement], ...]:
    """Return the displacements of base and targets that were fitted anew, without targets that the run did not have."""
    arm, tried = prediction.arm, []
    if "base" in refit:
        tried.append(("base", _of_base(arm)[1]))
    if "tool" in refit:
        tried += [(f"tool.{target}", each) for target, each in zip(arm.targets, _of_targets(arm), strict=True)]
    whole = fit.rank == refitted(arm, refit).shape[1]
    return tuple(
        (name, _extent(arm, each, prediction.values, fit.values, fit.covariance) if whole else Displacement())
        for name, each in tried
        if name.removeprefix("tool.") not in prediction.strange
    )


def _would_notice(
    prediction: CalibrationPrediction, fit: RefitSolution, test: _ChangeTest, refit: Sequence[str]
) -> tuple[tuple[str, float], ...]:
    """Return the smallest detectable movement of base, target or a joint's zero, in the worst direction.

    The part of the test that detects it first counts.
    """
    arm = prediction.arm
    tried = [] if "base" in refit else [("base", _of_base(arm)[0])]
    if "tool" not in refit:
        tried += [(f"tool.{target}", moved) for target, moved in zip(arm.targets, _of_targets(arm), strict=True)]
    tried += [(f"joint{k + 1}", moved) for k, moved in enumerate(_of_joints(arm))]
    along = _freed(fit, prediction.free).model
    # the length of a whitened change that each part of the test detects
    bounds = [
        float(np.sqrt(prediction.noticeable(part.numbers, test.level))) if part.numbers > 0 else np.inf
        for part in (test.along, test.rest)
    ]
    noticed = []
    for name, movement in tried:
        whole = np.linalg.norm(fit.there.white(fit.there.jacobian @ movement.directions))
        columns = fit.beyond(movement.directions)
        parts = zip(bounds, (along.coordinates(columns), along.residual(columns)), strict=True)
        noticed.append((name, min(_noticed(bound, part, float(FULL_RANK * whole)) for bound, part in parts)))
    return tuple(noticed)


def _noticed(bound: float, columns: Array, rounding: float) -> float:
    """Return the size of movements along ``columns`` whose least visible one has this length; infinite if invisible."""
    if len(columns) < columns.shape[1]:
        return float("inf")
    least = np.linalg.svd(columns, compute_uv=False).min(initial=np.inf)
    return float(bound / least) if least > rounding else float("inf")
