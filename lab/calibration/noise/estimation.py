"""Which variance components the residuals show, by restricted likelihood, and how large they are.

One component after another is taken where the likelihood ratio says so at ``VARIANCE_COMPONENTS``, Bonferroni's over
those that could be taken. A variance of zero lies at the edge of what is possible, where twice the log ratio is half
of the time zero (Self & Liang 1987). A change point is taken by the F test of a scan over the rows; beside others it
stands with a likelihood in which it is equally likely at every row.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to

from lab.calibration.noise.error_term import Components
from lab.calibration.noise.likelihood import Likelihood, RestrictedProblem
from lab.calibration.noise.terms import TERMS, term_called
from lab.core.se3 import Array
from lab.core.significance import VARIANCE_COMPONENTS

__all__ = ["ComponentTrial", "Estimate", "best_components", "chosen_components"]

KINDS = tuple(term.kind for term in TERMS)
_VARIANCES = (1e-4, 1e3)  # bounds of a component's mean variance, in units of the instrument's
_CARRIES = (0.1, 0.995)  # bounds of the correlation from one pose to the next
_START_VARIANCES, _START_CARRIES = (0.05, 0.3, 2.0, 15.0, 300.0), (0.4, 0.85)
_HOPELESS = 1.0  # twice the log ratio at the best start: where it gains less, no search brings what a test asks for
_EITHER = tuple(  # kinds that are left out, one way each
    tuple(term.kind for term in TERMS if term.family == family) for family in ("moving", "wandering")
)
_MOST_CHANGES = 3  # of more the base rather wanders


@dataclass(frozen=True)
class Estimate:
    """Where the restricted likelihood of some kinds of components is largest.

    Attributes:
        kinds: which ones are in it.
        components: their variances, in units of the instrument's.
        likelihood: there.
        problem: what it is of, with the change points.
        candidates: rows at which each of these may have been.
    """

    kinds: tuple[str, ...]
    components: Components
    likelihood: Likelihood
    problem: RestrictedProblem
    candidates: tuple[int, ...] = ()

    @property
    def deviance(self) -> float:
        """Minus twice the restricted log-likelihood, with every change point equally likely at every row."""
        return self.likelihood.deviance + 2 * float(np.log(self.candidates).sum())


@dataclass(frozen=True)
class ComponentTrial:
    """A component that was tried beside those taken before it.

    Attributes:
        ratio: twice the log of the likelihood ratio; of a change point the F statistic.
        p: the chance of a larger one where there is none, without Bonferroni's factor over the kinds.
        taken: whether it was taken.
    """

    kind: str
    ratio: float
    p: float
    taken: bool


def chosen_components(
    problem: RestrictedProblem, kinds: Sequence[str] = KINDS
) -> tuple[Estimate, tuple[ComponentTrial, ...]]:
    """The components that the residuals show, and all that were tried in the end.

    A drift and changes look like a base that wanders, and the reverse: either is tried without the other, with scatter
    beside it, and the likelier one is believed.
    """
    search = _Search(problem, VARIANCE_COMPONENTS / len(kinds))
    ways = [search.along([kind for kind in kinds if kind not in others]) for others in _EITHER]
    found, trials = min(ways, key=lambda way: way[0].deviance)
    tried = {trial.kind: replace(trial, taken=False) for _, each in ways for trial in each}
    return found, tuple((tried | {trial.kind: trial for trial in trials}).values())


class _Search:
    """Components that are taken one after another; what was tried once is not tried again."""

    def __init__(self, problem: RestrictedProblem, level: float) -> None:
        """The level is that of one kind."""
        self._level = level
        self._alone = best_components(problem, ())
        self._known: dict[tuple[str, ...], Estimate] = {}

    def along(self, kinds: Sequence[str]) -> tuple[Estimate, list[ComponentTrial]]:
        """The components of some kinds that the residuals show, and all that were tried."""
        found, trials = self._alone, dict[str, ComponentTrial]()
        while True:
            shown = []
            for kind in kinds:
                scanned = term_called(kind).scanned
                if kind in found.kinds and (not scanned or len(found.candidates) == _MOST_CHANGES):
                    continue
                each, trial = self._changed(found, kind) if scanned else self._extended(found, kind)
                if kind not in found.kinds:
                    trials[kind] = trial
                if each is not None and trial.p < self._level:
                    shown.append((each, kind))
            if not shown:
                return found, list(trials.values())
            found, kind = min(shown, key=lambda pair: pair[0].deviance)
            trials[kind] = replace(trials[kind], taken=True)

    def _extended(self, found: Estimate, kind: str) -> tuple[Estimate, ComponentTrial]:
        """An estimate with one kind more."""
        kinds, hopeless = (*found.kinds, kind), found.likelihood.deviance - _HOPELESS
        each = self._known.get(kinds)
        if each is None or found.candidates:
            each = replace(best_components(found.problem, kinds, hopeless), candidates=found.candidates)
            self._known |= {} if found.candidates else {kinds: each}
        ratio = found.likelihood.deviance - each.likelihood.deviance
        return each, ComponentTrial(kind, ratio, term_called(kind).p_value(ratio), taken=False)

    def _changed(self, found: Estimate, kind: str) -> tuple[Estimate | None, ComponentTrial]:
        """An estimate with one change point more; None where the rows do not show one at the level."""
        scan = found.problem.likeliest_change(found.components)
        if scan is None:
            return None, ComponentTrial(kind, 0.0, 1.0, taken=False)
        trial = ComponentTrial(kind, scan.f, scan.p, taken=False)
        if scan.p >= self._level:
            return None, trial
        problem = found.problem.changed_at((*found.problem.shapes.changes, scan.change))
        kinds: tuple[str, ...] = found.kinds if kind in found.kinds else (*found.kinds, kind)
        return replace(best_components(problem, kinds), candidates=(*found.candidates, scan.candidates)), trial


def best_components(problem: RestrictedProblem, kinds: tuple[str, ...], hopeless: float = np.inf) -> Estimate:
    """The components of these kinds that have the largest restricted likelihood.

    Args:
        hopeless: a deviance; where every start's is larger, the best start is given.
    """
    if not kinds:
        return Estimate(kinds, Components(), problem.likelihood(Components()), problem)
    terms = [term_called(kind) for kind in kinds]
    in_time = any(term.structure == "autoregressive" for term in terms)
    units = {term.name: max(float((term.shape(problem.shapes) ** 2).sum()) / problem.numbers, 1e-300) for term in terms}

    def components(point: Array) -> Components:
        sizes = np.exp(np.clip(point[: len(kinds)], *np.log(_VARIANCES))).tolist()
        carry = 0.0
        if in_time:
            low, high = _CARRIES
            carry = low + (high - low) / (1 + np.exp(-np.clip(point[-1], -30, 30)))
        variances = {term.name: size / units[term.name] for term, size in zip(terms, sizes, strict=True)}
        return Components(variances, float(carry))

    def deviance(point: Array) -> float:
        return problem.likelihood(components(point)).deviance

    starts = [np.full(len(kinds), np.log(size)) for size in _START_VARIANCES]
    if in_time:
        at = [(carry - _CARRIES[0]) / (_CARRIES[1] - carry) for carry in _START_CARRIES]
        starts = [np.append(start, np.log(odds)) for start in starts for odds in at]
    heights = [deviance(start) for start in starts]
    start = starts[int(np.argmin(heights))]
    if min(heights) > hopeless:
        found = components(start)
        return Estimate(kinds, found, problem.likelihood(found), problem)
    if len(start) == 1:
        inside = (max(start[0] - 3.5, np.log(_VARIANCES[0])), min(start[0] + 7.0, np.log(_VARIANCES[1])))
        best = scipy.optimize.minimize_scalar(
            lambda size: deviance(np.array([size])), bounds=inside, method="bounded", options={"xatol": 1e-3}
        )
        point = np.array([float(best.x)])
    else:
        simplex = start + np.concatenate([np.zeros((1, len(start))), 0.7 * np.eye(len(start))])
        options = {"initial_simplex": simplex, "xatol": 5e-3, "fatol": 1e-3, "maxfev": 80 * len(start)}
        point = scipy.optimize.minimize(deviance, start, method="Nelder-Mead", options=options).x
    found = components(point)
    return Estimate(kinds, found, problem.likelihood(found), problem)
