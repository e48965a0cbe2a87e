"""Which variance components the residuals show, by restricted likelihood, and how large they are.

One component after another is taken where the likelihood ratio says so at ``VARIANCE_COMPONENTS``, Bonferroni's over
those that could be taken. A variance of zero lies at the edge of what is possible, where twice the log ratio is half
of the time zero (Self & Liang 1987).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to

from lab.calibration.noise.likelihood import Components, Likelihood, RestrictedProblem
from lab.core.probabilities import chi2_sf
from lab.core.se3 import Array
from lab.core.significance import VARIANCE_COMPONENTS

__all__ = ["ComponentTrial", "Estimate", "Kind", "best_components", "chosen_components"]

Kind = Literal["scatter", "wandering", "drift"]
KINDS: tuple[Kind, ...] = ("scatter", "wandering", "drift")
_VARIANCES = (1e-4, 1e3)  # bounds of a component's mean variance, in units of the instrument's
_CARRIES = (0.1, 0.995)  # bounds of the correlation from one pose to the next
_START_VARIANCES, _START_CARRIES = (0.05, 0.3, 2.0, 15.0, 300.0), (0.4, 0.85)
_HOPELESS = 1.0  # twice the log ratio at the best start: where it gains less, no search brings what a test asks for
_CORRELATIONS = 3.0  # how many independent correlations are as good as tried


@dataclass(frozen=True)
class Estimate:
    """Where the restricted likelihood of some kinds of components is largest.

    Attributes:
        kinds: which ones are in it.
        components: their variances, in units of the instrument's.
        likelihood: there.
    """

    kinds: tuple[Kind, ...]
    components: Components
    likelihood: Likelihood


@dataclass(frozen=True)
class ComponentTrial:
    """A component that was tried beside those taken before it.

    Attributes:
        ratio: twice the log of the likelihood ratio.
        p: the chance of a larger one where there is none, without Bonferroni's factor.
        taken: whether it was taken.
    """

    kind: Kind
    ratio: float
    p: float
    taken: bool


def chosen_components(
    problem: RestrictedProblem, kinds: Sequence[Kind] = KINDS
) -> tuple[Estimate, tuple[ComponentTrial, ...]]:
    """The components that the residuals show, and all that were tried in the end."""
    found = best_components(problem, ())
    trials: dict[Kind, ComponentTrial] = {}
    while True:
        left = [
            kind for kind in kinds if kind not in found.kinds and not {kind, *found.kinds} >= {"wandering", "drift"}
        ]
        hopeless = found.likelihood.deviance - _HOPELESS
        tried = [best_components(problem, (*found.kinds, kind), hopeless) for kind in left]
        for kind, each in zip(left, tried, strict=True):
            ratio = found.likelihood.deviance - each.likelihood.deviance
            trials[kind] = ComponentTrial(kind, ratio, _p_value(kind, ratio), taken=False)
        shown = [
            (each, kind)
            for kind, each in zip(left, tried, strict=True)
            if trials[kind].p * len(kinds) < VARIANCE_COMPONENTS
        ]
        if not shown:
            return found, tuple(trials.values())
        found, kind = min(shown, key=lambda pair: pair[0].likelihood.deviance)
        trials[kind] = replace(trials[kind], taken=True)


def best_components(problem: RestrictedProblem, kinds: tuple[Kind, ...], hopeless: float = np.inf) -> Estimate:
    """The components of these kinds that have the largest restricted likelihood.

    Args:
        hopeless: a deviance; where every start's is larger, the best start is given.
    """
    if not kinds:
        return Estimate(kinds, Components(), problem.likelihood(Components()))
    units = _units(problem)

    def components(point: Array) -> Components:
        variances = dict(zip(kinds, np.exp(np.clip(point[: len(kinds)], *np.log(_VARIANCES))), strict=True))
        carry = 0.0
        if "wandering" in kinds:
            low, high = _CARRIES
            carry = low + (high - low) / (1 + np.exp(-np.clip(point[-1], -30, 30)))
        return Components(
            scatter=variances.get("scatter", 0.0) / units.scatter,
            shift=variances.get("wandering", 0.0) / units.shift,
            carry=float(carry),
            trend=variances.get("drift", 0.0) / units.trend,
        )

    def deviance(point: Array) -> float:
        return problem.likelihood(components(point)).deviance

    starts = [np.full(len(kinds), np.log(size)) for size in _START_VARIANCES]
    if "wandering" in kinds:
        at = [(carry - _CARRIES[0]) / (_CARRIES[1] - carry) for carry in _START_CARRIES]
        starts = [np.append(start, np.log(odds)) for start in starts for odds in at]
    heights = [deviance(start) for start in starts]
    start = starts[int(np.argmin(heights))]
    if min(heights) > hopeless:
        found = components(start)
        return Estimate(kinds, found, problem.likelihood(found))
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
    return Estimate(kinds, found, problem.likelihood(found))


def _units(problem: RestrictedProblem) -> Components:
    """The mean variance of a number that a component of one makes."""
    shapes = problem.shapes
    scatter, shift, trend = (
        max(float((shape**2).sum()) / problem.numbers, 1e-300) for shape in (shapes.scatter, shapes.shift, shapes.trend)
    )
    return Components(scatter=scatter, shift=shift, trend=trend)


def _p_value(kind: Kind, ratio: float) -> float:
    """Of a likelihood ratio: half of a chi squared's; of a wandering base with a correlation of its own."""
    if ratio <= 0:
        return 1.0
    if kind == "wandering":
        return min(1.0, _CORRELATIONS * 0.5 * float(chi2_sf(ratio, 1)))
    return 0.5 * float(chi2_sf(ratio, 1))
