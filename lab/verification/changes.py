"""Find what has changed since a calibration, or is wrong with a new file: the hypotheses of the diagnosis, compared.

Movements of base, tool and joint zeros since the calibration are directions of the arm's parameters: fitted by
Gauss-Newton, beside the prior covariance of the run, however far they go. What moved within the file, and what scales,
couples or drifts, are columns beside the arm; an outlier is a pose with an error of its own. All are compared by
Schwarz's criterion (1978).
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.calibration.guess import columns_of
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.core import se3
from lab.core.checks import Check, Outcome
from lab.core.measurements import Measurements, seen_mask
from lab.core.se3 import Array
from lab.diagnosis.continuous import Space, lasting_mistakes, steps_of
from lab.diagnosis.hypothesis import Finding, Hypothesis
from lab.diagnosis.scores import score, scores_of_poses, scores_of_steps
from lab.kinematics.effects.arm_with_effects import Arm
from lab.verification.predicted_points import FULL_RANK, RefitSolution, VerificationProblem
from lab.verification.split_test import ChangeTest, change_test, explained, freed, split_test

__all__ = [
    "Displacement", "PossibleChange", "displacement", "equivalent", "is_whole_base", "movements", "outlying",
    "possible_changes", "refitted",
]  # fmt: skip

_GAP = 6.0  # of the criterion: less is equivalent to the best (Kass & Raftery 1995: "strong")
_UNUSUAL = 2 * _GAP  # by which a mistake within the file is less likely beforehand than a movement before it
_LEAST_POSES = 6  # among which something may change
_COMPARED = 5  # mistakes within the file, by their scores
_MOST_POSES = 20_000  # among which such mistakes are looked for
_KINDS = {
    "base_step": "base",
    "tool_step": "tool",
    "target_step": "tool",
    "joint_step": "joint",
    "range_constant": "range",
    "outliers": "reading",
}


@dataclass(frozen=True)
class Displacement:
    """Size of a change, each with its standard deviation; NaN where that does not apply or is not observable."""

    shift_m: float = float("nan")
    shift_std_m: float = float("nan")
    turn_rad: float = float("nan")
    turn_std_rad: float = float("nan")

    @classmethod
    def of(cls, sizes: Array, covariance: Array, units: Sequence[str]) -> "Displacement":
        """Return the size of numbers with their covariance, each in ``m``, ``rad``, or as a ratio."""
        parts = [np.array([each == unit for each in units]) for unit in ("m", "rad")]
        return cls(*(number for part in parts for number in _sized(sizes[part], covariance[np.ix_(part, part)])))


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


def _is_unusual(hypothesis: Hypothesis) -> bool:
    """Decide whether something is wrong within the file, rather than moved since the calibration, or an outlier."""
    return hypothesis.name not in _KINDS or "row" in dict(hypothesis.data)


@dataclass(frozen=True)
class PossibleChange:
    """A hypothesis of what has changed, fitted to the measurements.

    Attributes:
        finding: the hypothesis with its sizes; its evidence is against no change.
        extent: how large it is.
        parameters: number of its parameters that the measurements determine.
        chi2: what it leaves of r' S^-1 r.
        p: the chance of leaving more, if it is right.
        bic: Schwarz's criterion, with twice the logarithm of how many of its kind were tried.
        explains: whether what it leaves is not rejected.
    """

    finding: Finding
    extent: Displacement
    parameters: int
    chi2: float
    p: float
    bic: float
    explains: bool

    @property
    def of(self) -> tuple[str, ...]:
        """What the hypothesis applies to."""
        return self.finding.hypothesis.of

    @property
    def kind(self) -> str:
        """``base``, ``tool``, ``joint``, ``range`` since the calibration, ``reading``; else the hypothesis' name."""
        unusual = _is_unusual(self.finding.hypothesis)
        return self.finding.name if unusual else _KINDS[self.finding.name]

    @property
    def check(self) -> Check:
        """Test of the remaining statistic; passed where it is not rejected."""
        outcome: Outcome = "passed" if self.explains else "failed"
        if _is_unusual(self.finding.hypothesis):
            return replace(self.finding.check, outcome=outcome, statistic=self.chi2, p=self.p)
        data = {"of": self.of, **dict(self.finding.hypothesis.data), **asdict(self.extent)}
        return Check(f"changed.{self.finding.name}", outcome, self.chi2, self.p, data=data)


def refitted(arm: Arm, refit: Sequence[str]) -> Array:
    """Directions ``(p, h)`` of everything that is fitted anew."""
    return np.eye(len(arm.names))[:, list(columns_of(arm, refit))]


def movements(arm: Arm, values: Array) -> list[tuple[Hypothesis, Array]]:
    """Return what may have moved since the calibration, with the directions ``(p, h)`` in which it moves parameters.

    The steps of the diagnosis, of the parameters themselves: base or instrument, whose shift alone is simpler; the
    tool, shifted or also turned (by little: v + w x t), or each target by its own; single targets; zeros of joints.
    """
    own, chain = np.eye(len(arm.names)), arm.rigid.chain
    by_joint = arm.rigid.joint_derivatives(own)
    steps = [each.hypothesis for each in steps_of(arm, own[None, None], by_joint[None, None], chain.joint_names)]
    found = list[tuple[Hypothesis, Array]]()
    for of in steps:
        assert of.columns is not None
        columns, alike = of.columns[0, 0], sum(each.name == of.name for each in steps)
        of = replace(of, columns=None, alternatives=alike)
        if of.name == "base_step":
            found.append((replace(of, units=of.units[:3]), columns[:, :3]))
        if of.name == "joint_step":
            joint = chain.joint_names.index(of.of[0])
            of = replace(of, units=("m" if chain.prismatic[joint] else "rad",), data=(("number", joint + 1),))
        found.append((of, columns))
    if len(arm.targets) > 1:
        tool = refitted(arm, ("tool",))
        places = values[list(columns_of(arm, ("tool",)))].reshape(-1, 3)
        turned = -se3.skew(places - places.mean(axis=0))  # (k, 3, 3) of w x t
        as_one = np.concatenate([np.tile(np.eye(3), (len(places), 1)), turned.reshape(-1, 3)], axis=1)
        found.append((Hypothesis("tool_step", units=("m",) * 3 + ("rad",) * 3), tool @ as_one))
        found.append((Hypothesis("tool_step", arm.targets, units=("m",) * tool.shape[1]), tool))
    return found


def displacement(
    arm: Arm, of: tuple[Hypothesis, Array], before: Array, after: Array, covariance: Array
) -> Displacement:
    """Return the size of a movement.

    Args:
        before, after: all parameters ``(p,)``.
        covariance: ``(p, p)`` of ``after``.
    """
    sizes, spread = _sizes(arm, of, before, after, covariance)
    return Displacement.of(sizes, spread, of[0].units)


def is_whole_base(hypothesis: Hypothesis) -> bool:
    """Decide whether a movement is that of the base in all six coordinates, not its shift alone."""
    return hypothesis.name == "base_step" and len(hypothesis.units) == 6


def _sizes(
    arm: Arm, of: tuple[Hypothesis, Array], before: Array, after: Array, covariance: Array
) -> tuple[Array, Array]:
    hypothesis, directions = of
    back = np.linalg.pinv(directions, rcond=1e-9)
    sizes, spread = back @ (after - before), back @ covariance @ back.T
    if is_whole_base(hypothesis):
        turning = list(columns_of(arm, ("base",)))[3:]
        old, new = se3.exp(before[turning]), se3.exp(after[turning])
        sizes[3:] = se3.log(new @ old.T)
        local = np.eye(6)
        local[3:, 3:] = se3.left_jacobian(after[turning])
        spread = local @ spread @ local.T
    return sizes, spread


def possible_changes(
    problem: VerificationProblem,
    fit: RefitSolution,
    refit: Sequence[str],
    rows: Measurements,
    more: Sequence[Hypothesis] = (),
) -> list[PossibleChange]:
    """Return the hypotheses that measurements determine, the likeliest first.

    Args:
        fit: with what is fitted anew.
        refit: what is: it cannot be what has moved since the calibration.
        rows: the measurements, as they are called.
        more: mistakes of the whole file that the instrument brings.
    """
    task = _Comparison(problem, fit, tuple(refit), rows)
    found = [change for of in movements(problem.prediction.arm, fit.values) if (change := task.moved(of)) is not None]
    mistakes = [task.worst_pose(), *task.mistakes(more)]
    found += [change for of in mistakes if (change := task.beside(of)) is not None]
    return sorted(found, key=lambda each: each.bic)


def outlying(
    problem: VerificationProblem, fit: RefitSolution, refit: Sequence[str], rows: Measurements, which: Sequence[int]
) -> list[PossibleChange]:
    """Return the hypothesis that some poses are outliers, as far as the measurements determine it."""
    task = _Comparison(problem, fit, tuple(refit), rows)
    change = task.beside(task.outliers(which, float(len(task.rows)) ** len(which)))
    return [] if change is None else [change]


def equivalent(found: Sequence[PossibleChange], numbers: int) -> list[PossibleChange]:
    """Return the hypotheses equivalent to the best one: the best of each kind, all of joints.

    A larger movement does not pay for being larger: a base that turned about the first axis is as simple a thing
    as that axis' zero, and looks the same.
    """
    explaining = [each for each in found if each.explains]
    if not explaining:
        return []
    best = explaining[0]
    alike: list[PossibleChange] = []
    for each in explaining:
        more = 0 if _is_unusual(each.finding.hypothesis) else each.parameters - best.parameters
        pays = max(0, more) * np.log(numbers)
        new = each.kind == "joint" or each.kind not in {other.kind for other in alike}
        if new and each.bic - pays <= best.bic + _GAP:
            alike.append(each)
    return alike


@dataclass(frozen=True)
class _Residuals:
    """Whitened residuals ``(n, m)`` of all poses, with the inverse covariance 1 - (J T)(J T)' that a fit leaves."""

    residual: Array
    jacobian: Array
    mask: NDArray[np.bool_]
    taken: Array

    @property
    def weights(self) -> Array:
        return self.mask.astype(np.float64)

    @cached_property
    def basis(self) -> Array:
        return np.asarray(self.jacobian @ self.taken)

    @cached_property
    def pulls(self) -> Array:
        return np.asarray(self.residual - self.basis @ np.einsum("nmc,nm->c", self.basis, self.residual))

    def explained(self, columns: Array) -> tuple[float, Array, Array, int]:
        """Fit columns ``(n, m, c)``: the fall of the statistic, sizes ``(c,)``, their covariance, and their rank."""
        flat, basis = columns.reshape(-1, columns.shape[2]), self.basis.reshape(-1, self.taken.shape[1])
        crossed = flat.T @ basis
        normal = flat.T @ flat
        scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
        eigenvalues, axes = np.linalg.eigh((normal - crossed @ crossed.T) * np.outer(scale, scale))
        free = eigenvalues > FULL_RANK
        root = scale[:, None] * axes[:, free] / np.sqrt(eigenvalues[free])
        along = root.T @ (flat.T @ self.pulls.ravel())
        return float(along @ along), root @ along, root @ root.T, int(free.sum())


@dataclass(frozen=True)
class _Comparison:
    """Hypotheses of one file, each beside what is fitted anew."""

    problem: VerificationProblem
    fit: RefitSolution
    refit: tuple[str, ...]
    rows: Measurements

    @property
    def _arm(self) -> Arm:
        return self.problem.prediction.arm

    @cached_property
    def _opened(self) -> RefitSolution:
        return freed(self.fit, self.problem.prediction.free)

    @cached_property
    def _left(self) -> _Residuals:
        """Residuals beside what is fitted anew."""
        mask = np.repeat(seen_mask(self.problem.observed.points), 3, axis=1)
        parts = [(residual, jacobian) for _, residual, jacobian in self.problem.parts(self.fit.values)]
        residual, jacobian = np.zeros(mask.shape), np.zeros((*mask.shape, len(self.fit.values)))
        residual[mask], jacobian[mask] = (np.concatenate(each) for each in zip(*parts, strict=True))
        return _Residuals(residual, jacobian, mask, self.fit.taken)

    @cached_property
    def _left_opened(self) -> _Residuals:
        """Residuals beside every identified parameter."""
        return replace(self._left, taken=self._opened.taken)

    @cached_property
    def _along(self) -> tuple[float, int]:
        """What the identified parameters explain of the statistic, and its degrees of freedom."""
        return explained(self.fit, self._opened)

    def moved(self, of: tuple[Hypothesis, Array]) -> PossibleChange | None:
        """Fit one movement since the calibration; None where the measurements do not determine it."""
        hypothesis, directions = of
        if _KINDS[hypothesis.name] in self.refit:
            return None
        anywhere = is_whole_base(hypothesis)
        columns = np.concatenate([refitted(self._arm, self.refit), directions], axis=1)
        groups = (*self.refit, "base") if anywhere else ()
        there = self.problem.placed(self.fit.values, columns, groups, self.fit.there)
        determined = there.rank - self.fit.rank
        if determined < 1:
            return None
        whole = determined == np.linalg.matrix_rank(directions)
        sizes = _sizes(self._arm, of, self.fit.values, there.values, there.covariance) if whole else None
        return self._judged(hypothesis, sizes, determined, change_test(self.problem.prediction, there))

    def beside(self, hypothesis: Hypothesis) -> PossibleChange | None:
        """Fit the columns of a hypothesis beside the arm; None where the measurements do not determine them."""
        assert hypothesis.columns is not None
        columns = self._white(hypothesis.columns)
        drop, sizes, covariance, determined = self._left.explained(columns)
        if determined < 1:
            return None
        # what the identified parameters would explain of what is left
        dropped, _, _, free = self._left_opened.explained(columns)
        square, numbers = self._along
        along = square - drop + dropped, numbers - determined + free
        left = split_test(self.problem.prediction, (self.fit.square - drop, self.fit.dof - determined), along)
        whole = (sizes, covariance) if determined == columns.shape[2] or hypothesis.name == "outliers" else None
        return self._judged(hypothesis, whole, determined, left)

    def _judged(
        self, hypothesis: Hypothesis, sizes: tuple[Array, Array] | None, determined: int, left: ChangeTest
    ) -> PossibleChange:
        prediction, numbers = self.problem.prediction, self.problem.numbers
        bic = prediction.deviance(left.square, numbers) + determined * np.log(numbers)
        bic += hypothesis.price_of_alternatives
        bic += _UNUSUAL * _is_unusual(hypothesis)
        evidence = prediction.deviance(self.fit.square, numbers) - bic
        finding = Finding(replace(hypothesis, columns=None), float(evidence))
        extent = Displacement()
        if sizes is not None:
            stds = np.sqrt(np.diag(sizes[1]))
            finding = replace(finding, sizes=tuple(sizes[0].tolist()), stds=tuple(stds.tolist()))
            extent = Displacement.of(*sizes, hypothesis.units)
            if hypothesis.columns is not None:
                made = (hypothesis.columns @ sizes[0])[self.problem.observed.seen]
                finding = replace(finding, explains_m=float(np.sqrt((made**2).sum(axis=1).mean())))
        return PossibleChange(finding, extent, determined, left.square, left.p, float(bic), not left.changed)

    def _white(self, columns: Array) -> Array:
        """Return columns ``(n, k, d, c)`` in units of noise, ``(n, m, c)``; zero where nothing was observed."""
        white = np.zeros((*self._left.mask.shape, columns.shape[3]))
        white[self._left.mask] = self.problem.observed.apply(np.nan_to_num(columns))
        return white

    def worst_pose(self) -> Hypothesis:
        """Return the pose without which the statistic is least, as an outlier of its own.

        Leaving out rows i lowers it by g_i' M_ii^-1 g_i, with M = S^-1 less what is fitted and g = M r (Cook &
        Weisberg 1982, section 2.2, for blocks).
        """
        scores = scores_of_poses(self._left, self._left.mask)
        scores[~self._left.mask.any(axis=1)] = -np.inf
        return self.outliers([int(np.argmax(scores))], int(self._left.mask.any(axis=1).sum()))

    def outliers(self, poses: Sequence[int], alternatives: float) -> Hypothesis:
        """Return poses that are each off on their own."""
        observed = self.problem.observed
        n, k, d = observed.points.shape
        columns = np.zeros((n, k, d, len(poses), k * d))
        for i, pose in enumerate(poses):
            columns[pose, :, :, i] = np.eye(k * d).reshape(k, d, k * d)
        seen = np.repeat(seen_mask(observed.points), d, axis=1)[list(poses)].ravel()
        columns = columns.reshape(n, k, d, -1)[..., seen]
        units, names = ("m",) * columns.shape[3], tuple(self.rows.where(i) for i in poses)
        return Hypothesis("outliers", names, alternatives, columns=columns, units=units)

    def mistakes(self, more: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Return the mistakes within the file of the largest scores: steps, and what lasts for the whole file."""
        if not _LEAST_POSES <= len(self.rows) <= _MOST_POSES:
            return []
        found = list[tuple[float, Hypothesis]]()
        for of in (*self._of_columns(), *more):
            assert of.columns is not None
            price = of.price(of.columns.shape[3], self.problem.numbers)
            found.append((price - score(self._left, self._white(of.columns)), of))
        return [of for cost, of in sorted(found, key=lambda each: each[0])[:_COMPARED] if cost < 0]

    def _of_columns(self) -> Iterator[Hypothesis]:
        arm, observed, values = self._arm, self.problem.observed, self.fit.values
        names = arm.rigid.chain.joint_names
        predicted, jacobian = arm.observe(observed.inputs, values)
        slopes = by_joint_positions(arm, observed.inputs, values, len(names))
        n = len(observed.inputs)
        # from which row on each would have moved
        of_steps = list(steps_of(arm, jacobian, slopes, names))
        for steps in of_steps:
            assert steps.hypothesis.columns is not None
            scores = scores_of_steps(self._left, self._white(steps.hypothesis.columns), np.arange(n))
            if scores.any():
                alike = sum(each.hypothesis.name == steps.hypothesis.name for each in of_steps)
                yield steps.from_row(int(np.argmax(scores)), self.rows.ids, n * alike)
        # what lasts: zeros are movements already, and links that were not identified explain nothing
        base, placed = values[list(columns_of(arm, ("base",)))[:3]], np.ones(len(arm.targets), dtype=np.bool_)
        space = Space(predicted, placed, np.linspace(0, 1, n), base, is_centred=False)
        lasting = lasting_mistakes(arm, jacobian, slopes, self.rows, space)
        free = {arm.names[i] for i in self.problem.prediction.free}
        for of in lasting:
            if of.name != "joint_zero" and (of.name != "link" or of.of[0] in free):
                yield of
