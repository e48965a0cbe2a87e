"""Fine mistakes: continuous ones, by score tests beside a marginal model, and refits of the best few.

Without a hypothesis its mistake sits in a variance, so that a score test alone finds too little: the best few columns
are fitted, each with all variances estimated again. The best is accepted and freed, and the search repeated; in the end
each finding is tested again beside the others.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.guess import columns_of
from lab.calibration.identification import Identification
from lab.calibration.observation import observation_of
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.core.measurements import Measurements, evenly
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.diagnosis.continuous import FITTED_ANYWAY, Space, Steps, lasting_mistakes, steps_of
from lab.diagnosis.hypothesis import Finding, Hypothesis
from lab.diagnosis.marginal import MarginalFit, Problem, compressed, estimated, rotated
from lab.diagnosis.scores import score, scores_of_steps
from lab.kinematics.effects.range_errors import SCALE
from lab.noise.error_model import row_times

__all__ = ["Fine", "fine_mistakes"]

_MOST_POSES = 400
_MOST_NUMBERS = 30  # of a pose: of more, those in which anything shows
_MOST_FINDINGS = 5
_REFITTED = 5  # hypotheses of a search
_WORTH_A_REFIT = 0.4  # of what a hypothesis has to reach, by its score
_EVIDENCE = 18.0  # of twice the log-likelihood, beside its price: very strong (Kass & Raftery 1995)
_NEAR_RIVAL = 6.0
_LIKE_EFFECTS = ("joint_gain", "joint_coupling", "joint_lag", "shear", "drift", "growth")
_FOLDS = 5
_WANDERING = 12  # orders of an error that wanders with time
_WAVES = 8  # of the smooth error, by joint
_LEAST_SIGMA_M = 1e-7


@dataclass(frozen=True)
class Fine:
    """Fine mistakes of a campaign.

    Attributes:
        findings: the one that explains most first.
        outliers: poses that are far off beside them, by their ids: root mean square length of their errors (m).
        fit: the marginal model with the findings in it.
    """

    findings: tuple[Finding, ...]
    outliers: Mapping[str, float]
    fit: MarginalFit


def fine_mistakes(
    found: Identification,
    observed: Observations,
    rows: Measurements,
    effects: Sequence[Array] = (),
    *,
    moves: Array | None = None,
    several_a_pose: bool = False,
) -> Fine:
    """Find continuous mistakes in the measurements of a fit.

    Args:
        found: a fit of the arm's geometry.
        observed: its rows, weighted, without errors that were estimated of the residuals.
        rows: the same.
        effects: derivatives ``(n, k, d, c)`` of the observed numbers by the parameters of effects that the model lacks.
        moves: ``(n, joints)`` from the pose measured before each row; None where nobody knows them.
        several_a_pose: whether consecutive rows with equal joint positions are of one pose.
    """
    poses = _poses(rows, several=several_a_pose)
    some = evenly(int(poses.max(initial=-1)) + 1, _MOST_POSES)
    if some is not None:
        taken = np.flatnonzero(np.isin(poses, some))
        observed, rows, effects = observed.take(taken), rows[taken], [each[taken] for each in effects]
        poses = np.unique(poses[taken], return_inverse=True)[1]
        moves = None if moves is None else moves[taken]
    search = _Search.of(found, observed, rows, effects, _Blocks.of(poses, observed), moves)
    fit, findings = search.run()
    outlying = np.flatnonzero(fit.variances.outlying[: len(search.ids)])
    errors_m = np.sqrt((fit.left**2).sum(axis=1) / np.maximum(fit.problem.mask.sum(axis=1) / 3, 1)) * search.metres
    far = {search.ids[i]: float(errors_m[i]) for i in outlying}
    return Fine(tuple(findings), far, fit)


def _poses(rows: Measurements, *, several: bool) -> NDArray[np.int_]:
    """Return the number ``(n,)`` of each row's pose."""
    if not several:
        return np.arange(len(rows))
    moved = (np.diff(rows.joints, axis=0) != 0).any(axis=1)
    return np.concatenate([[0], np.cumsum(moved)])


@dataclass(frozen=True)
class _Blocks:
    """Numbers of rows, gathered by pose: one block a pose.

    Attributes:
        at: ``(n, m)`` where each number of a row stands in its block.
        poses: ``(n,)`` the block of each row.
        shape: how many blocks of poses, and how many numbers each has.
        observed: the rows.
    """

    at: NDArray[np.int_]
    poses: NDArray[np.int_]
    shape: tuple[int, int]
    observed: Observations

    @classmethod
    def of(cls, poses: NDArray[np.int_], observed: Observations) -> "_Blocks":
        """Gather rows by their poses."""
        n, k, d = observed.points.shape
        first = np.searchsorted(poses, poses)
        within = np.arange(n) - first
        at = within[:, None] * (k * d) + np.arange(k * d)
        return cls(at, poses, (int(poses.max()) + 1, int(within.max() + 1) * k * d), observed)

    def gathered(self, vectors: Array, sigma: float) -> Array:
        """Return vectors ``(n, k, d, c)`` in units of noise, as blocks ``(poses, m, c)``."""
        n, k, d = self.observed.points.shape
        rows = (self.observed.in_units_of_noise(np.nan_to_num(vectors)) / sigma).reshape(n, k * d, -1)
        blocks = np.zeros((*self.shape, rows.shape[2]))
        blocks[self.poses[:, None], self.at] = rows
        return blocks

    @property
    def mask(self) -> NDArray[np.bool_]:
        """``(poses, m)`` which numbers were observed."""
        mask = np.zeros(self.shape, dtype=np.bool_)
        mask[self.poses[:, None], self.at] = np.repeat(self.observed.seen, self.observed.points.shape[2], axis=1)
        return mask


@dataclass(frozen=True)
class _Candidate:
    """A hypothesis with its rotated columns ``(n, m, c)`` in units of noise."""

    hypothesis: Hypothesis
    columns: Array
    statistic: float = 0.0

    @property
    def price(self) -> float:
        """What its numbers and its alternatives cost of twice the log-likelihood."""
        return self.hypothesis.price(self.columns.shape[2], len(self.columns))


@dataclass(frozen=True)
class _Search:
    """Columns of all continuous mistakes beside one fit.

    Attributes:
        steps: what may move, as if before the first row; rotated.
        lasting: mistakes of the whole campaign; rotated.
        metres: of a number in units of noise.
    """

    problem: Problem
    steps: tuple[tuple[Steps, Array], ...]
    lasting: tuple[_Candidate, ...]
    ids: tuple[str, ...]
    order: NDArray[np.int_]
    metres: float

    @classmethod
    def of(
        cls,
        found: Identification,
        observed: Observations,
        rows: Measurements,
        effects: Sequence[Array],
        blocks: _Blocks,
        moves: Array | None = None,
    ) -> "_Search":
        """Build all columns, and rotate them pose by pose into the axes of the joint scatter."""
        model, values = found.model, found.values
        predicted, jacobian = model.observe(observed.inputs, values)
        slopes = by_joint_positions(model, observed.inputs, values, rows.joints.shape[1])
        heads = np.searchsorted(blocks.poses, np.arange(blocks.shape[0]))  # the first row of each pose
        times = row_times(rows)
        since = (times - times.min()) / max(float(np.ptp(times)), 1e-12) - 0.5
        placed = np.arange(predicted.shape[1]) < observation_of(model).positions  # other things are in no space
        base = columns_of(model, ("base",))
        at = values[list(base[:3])] if len(base) == 6 and placed.any() else None
        moved = jacobian[..., list(base)] if at is not None else None
        space = Space(predicted, placed, since, base=at, moved=moved)
        # columns of hypotheses, and of what may be off: links by tolerance, effects by kind, a smooth error
        stepping = list(steps_of(model, jacobian, slopes, rows.joint_names))
        lasting = list(lasting_mistakes(model, jacobian, slopes, rows, space, moves))
        parts, kinds = _random_columns(
            found, jacobian, [*effects, _smooth(rows.joints, slopes), _wandering(since, placed, predicted)]
        )
        # in units of noise, pose by pose
        sigma = max(1.0 if found.sigma_given else found.residual_sigma_m, _LEAST_SIGMA_M)
        is_link = np.array([each.is_link for each in model.parameters])
        off = jacobian @ ((values - found.nominal_aligned) * is_link)  # links are off from nominal, not from the fit
        residual = blocks.gathered((observed.points - predicted + off)[..., None], sigma)[..., 0]
        given = [each.hypothesis.columns for each in stepping] + [each.columns for each in lasting]
        every = [blocks.gathered(each, sigma) for each in (*parts, *given) if each is not None]
        turned, columns, sizes, known = rotated(residual, every, blocks.gathered(slopes, sigma), blocks.mask)
        if turned.shape[1] > _MOST_NUMBERS:
            turned, columns, sizes, known = compressed(turned, columns, sizes, known, _MOST_NUMBERS)
        own = columns[len(parts) :]
        joined = np.concatenate(columns[: len(parts)], axis=2)
        problem = Problem(turned, joined, kinds, sizes, known, found.sigma_given)
        return cls(
            problem=problem,
            steps=tuple(zip(stepping, own[: len(stepping)], strict=True)),
            lasting=tuple(_Candidate(each, part) for each, part in zip(lasting, own[len(stepping) :], strict=True)),
            ids=tuple(rows.ids[i] for i in heads),
            order=np.argsort(times[heads], kind="stable"),
            metres=sigma / observed.typical_weight,
        )

    def run(self) -> tuple[MarginalFit, list[Finding]]:
        """Accept the best hypothesis until none is left, then test each beside the others."""
        accepted = list[_Candidate]()
        fit = estimated(self.problem)
        rivals: dict[str, tuple[str, ...]] = {}
        while len(accepted) < _MOST_FINDINGS:
            best = self._best(fit, accepted)
            if best is None:
                break
            candidate, fit, near = best
            accepted.append(candidate)
            rivals[candidate.hypothesis.key] = near
        return fit, self._confirmed(fit, accepted, rivals)

    def _best(
        self, fit: MarginalFit, accepted: Sequence[_Candidate]
    ) -> tuple[_Candidate, MarginalFit, tuple[str, ...]] | None:
        """Return the hypothesis of most evidence with its refit, and its near rivals; None where none has enough."""
        tried = list[tuple[float, _Candidate, MarginalFit]]()
        before = fit.deviance_beside(_width(accepted))
        known = {each.hypothesis.key for each in accepted if "row" not in dict(each.hypothesis.data)}
        for candidate in self._scanned(fit):
            if candidate.hypothesis.key in known:
                continue
            refit = estimated(fit.problem.with_columns(candidate.columns), fit.variances)
            width = _width(accepted) + candidate.columns.shape[2]
            tried.append((before - refit.deviance_beside(width) - candidate.price, candidate, refit))
        tried.sort(key=lambda each: -each[0])
        if not tried or tried[0][0] < _EVIDENCE:
            return None
        evidence, candidate, refit = tried[0]
        near = dict.fromkeys(each.hypothesis.key for other, each, _ in tried[1:] if evidence - other < _NEAR_RIVAL)
        return candidate, refit, tuple(key for key in near if key != candidate.hypothesis.key)

    def _scanned(self, fit: MarginalFit) -> list[_Candidate]:
        """Return the hypotheses of the largest score, at most one of each kind and thing."""
        scanned = [self._likeliest_step(fit, steps, columns) for steps, columns in self.steps]
        scanned += [replace(each, statistic=score(fit, each.columns)) for each in self.lasting]
        scanned.sort(key=lambda each: each.price - each.statistic)
        worth = [each for each in scanned if each.statistic > _WORTH_A_REFIT * (each.price + _EVIDENCE)]
        return worth[:_REFITTED]

    def _likeliest_step(self, fit: MarginalFit, steps: Steps, columns: Array) -> _Candidate:
        """Return the step of one thing at the row where its score is largest."""
        scores = scores_of_steps(fit, columns, self.order)
        cut = int(np.argmax(scores))
        tried = len(self.ids) * sum(each.hypothesis.name == steps.hypothesis.name for each, _ in self.steps)
        after = np.zeros(len(self.ids), dtype=np.bool_)
        after[self.order[cut:]] = True
        ids = [self.ids[i] for i in self.order]
        hypothesis = steps.before(cut, ids, tried)
        return _Candidate(hypothesis, np.where(after[:, None, None], columns, 0.0), float(scores[cut]))

    def _confirmed(
        self, fit: MarginalFit, accepted: Sequence[_Candidate], rivals: dict[str, tuple[str, ...]]
    ) -> list[Finding]:
        """Return the findings that have their evidence beside the others, the one that explains most first."""
        findings = list[Finding]()
        whole = fit.deviance_beside(_width(accepted))
        for i, candidate in enumerate(accepted):
            others = [*accepted[:i], *accepted[i + 1 :]]
            problem = self.problem
            for other in others:
                problem = problem.with_columns(other.columns)
            without = estimated(problem, fit.variances)
            evidence = without.deviance_beside(_width(others)) - whole - candidate.price
            if evidence < _EVIDENCE or not self._predicts(candidate, without, fit):
                continue
            near = rivals[candidate.hypothesis.key]
            if near and candidate.hypothesis.name in FITTED_ANYWAY:  # fitted anyway, whichever it is
                continue
            first = len(self.problem.kinds) + _width(accepted[:i])
            finding = self._finding(fit, candidate, evidence, first, near)
            if finding.makes_sense:
                findings.append(finding)
        return sorted(findings, key=lambda each: -each.explains_m)

    def _predicts(self, candidate: _Candidate, without: MarginalFit, fit: MarginalFit) -> bool:
        """Check whether poses that were left out are predicted better with a mistake that looks like an effect."""
        if candidate.hypothesis.name not in _LIKE_EFFECTS:
            return True
        folds = np.array_split(rng_for(0, "null").permutation(len(self.ids)), _FOLDS)
        gains = list[Array]()
        for rows in folds:
            before, after = (np.sum(each.predicted_errors(rows) ** 2, axis=1) for each in (without, fit))
            gains.append(np.sqrt(before) - np.sqrt(after))
        gain = np.concatenate(gains)
        return bool(gain.mean() > gain.std() / np.sqrt(len(gain)))

    def _finding(
        self, fit: MarginalFit, candidate: _Candidate, evidence: float, first: int, rivals: tuple[str, ...]
    ) -> Finding:
        """Return the finding with its size from the refit, and what it explains beside what is fitted anyway."""
        own = slice(first, first + candidate.columns.shape[2])
        sizes, stds = fit.coefficients[own], np.sqrt(np.diag(fit.covariance)[own])
        made = candidate.columns @ sizes
        most = 0 if candidate.hypothesis.name in (*FITTED_ANYWAY, "scale") else 1  # beside base and tool, or links, too
        placed = self.problem.columns[..., self.problem.kinds < most][fit.problem.mask]
        plain = made[fit.problem.mask]
        left = plain - placed @ np.linalg.lstsq(placed, plain, rcond=1e-9)[0]
        explains_m = float(np.sqrt(3 * np.mean(left**2))) * self.metres
        hypothesis = replace(candidate.hypothesis, columns=None)  # which a result need not carry
        return Finding(hypothesis, evidence, tuple(sizes.tolist()), tuple(stds.tolist()), explains_m, rivals=rivals)


def _random_columns(
    found: Identification, jacobian: Array, effects: Sequence[Array]
) -> tuple[list[Array], NDArray[np.int_]]:
    """Return the columns of parameters and effects, in their typical sizes, and the kind of each.

    What is placed has no prior (kind -1), links have their tolerances (0), effects the size of the residuals. The scale
    of an instrument's range is what a wrong scale is tested against: it has no column.
    """
    is_link = np.array([each.is_link for each in found.model.parameters])
    is_placed = np.array([not each.is_link and each.name != SCALE for each in found.model.parameters])
    scales = np.array([each.scale for each in found.model.parameters])
    parts = [jacobian[..., is_placed], jacobian[..., is_link] * scales[is_link]]
    kinds = [-1] * int(is_placed.sum()) + [0] * int(is_link.sum())
    for kind, columns in enumerate(effects, start=1):
        numbers = columns[..., 0].size
        size = np.sqrt(np.nansum(columns**2) / numbers)
        parts.append(columns * (found.residual_sigma_m / size if size > 0 else 0.0))
        kinds += [kind] * columns.shape[3]
    return parts, np.array(kinds)


def _width(candidates: Sequence[_Candidate]) -> int:
    return sum(each.columns.shape[2] for each in candidates)


def _wandering(since: Array, placed: NDArray[np.bool_], predicted: Array) -> Array:
    """Columns ``(n, k, d, c)`` of a place that wanders: cosines of time, the slow ones of the larger variance.

    Args:
        since: ``(n,)`` times, from -0.5 to 0.5.
        placed: ``(k,)`` which things are positions.
    """
    order = np.arange(1, min(_WANDERING, len(since) // 3) + 1)
    made = np.cos(np.pi * (since[:, None] + 0.5) * order) / order  # (n, w)
    axes = np.eye(predicted.shape[2]) * placed[:, None, None]  # (k, d, d)
    return (axes[None, ..., None] * made[:, None, None, None, :]).reshape(*predicted.shape, -1)


def _smooth(joints: Array, slopes: Array) -> Array:
    """Columns ``(n, k, d, c)`` of smooth joint errors: cosines of random combinations of the joint positions."""
    rng = rng_for(0, "null")
    count = joints.shape[1]
    waves = rng.standard_normal((count, _WAVES))
    made = np.cos(joints @ waves + rng.uniform(0, 2 * np.pi, _WAVES))  # (n, w)
    return (slopes[..., None] * made[:, None, None, None, :]).reshape(*slopes.shape[:3], -1)
