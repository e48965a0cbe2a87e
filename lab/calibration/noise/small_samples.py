"""What estimated variance components add to the covariance of the parameters, and its degrees of freedom.

C(t) = (J'V(t)^-1 J)^-1 at estimated variances t of covariance W is too small twice: on average C(t^) misses half of
the curvature sum W_ij C_ij, and the estimate with wrong weights is as much less precise. To the first order the
covariance is C - sum W_ij C_ij with C_ij the second derivatives by the variances (Kenward & Roger 1997), and the
degrees of freedom of a parameter's interval are those of a chi squared with the variance of C(t^) (Satterthwaite
1946). A wandering base's correlation is too far from a normal distribution for the first: C is taken as it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lab.calibration.noise.error_term import Components
from lab.calibration.noise.estimation import Estimate
from lab.calibration.noise.likelihood import LEAST_SHARE, RestrictedProblem
from lab.calibration.noise.terms import TERMS
from lab.core.linear_model import matched_dof
from lab.core.se3 import Array

__all__ = ["ComponentErrors", "SmallSample", "small_sample"]

_STEP = 0.1  # of the logarithm of a variance, and of a correlation's odds, for differences
_LARGEST = 0.5  # of a standard deviation: no correction beyond is to be believed
_LEAST_CURVATURE = 0.05  # of a log-likelihood by the logarithm of a variance: below, the residuals say nothing of it


@dataclass(frozen=True)
class ComponentErrors:
    """How well estimated variance components are known, and what hangs on them.

    Attributes:
        names: ``(c,)`` of the terms, and ``scale`` for the instrument's variance; as logarithms, ``carry`` as that
            of its odds.
        covariance: ``(c, c)`` of these.
        slopes: ``(c, f)`` the derivative of each parameter's standard deviation, as a logarithm, by each of them.
    """

    names: tuple[str, ...]
    covariance: Array
    slopes: Array

    def to_dict(self) -> dict[str, Any]:
        """Return them as ``result.json`` holds them."""
        return {
            "names": list(self.names),
            "covariance": self.covariance.tolist(),
            "slopes": self.slopes.tolist(),
        }

    def without(self, name: str) -> "ComponentErrors":
        """The same where one of the variances is known after all."""
        kept = [i for i, each in enumerate(self.names) if each != name]
        names = tuple(self.names[i] for i in kept)
        return ComponentErrors(names, self.covariance[np.ix_(kept, kept)], self.slopes[kept])

    def of(self, parameters: Sequence[int]) -> "ComponentErrors":
        """The same of some of the parameters."""
        return replace(self, slopes=self.slopes[:, list(parameters)])


@dataclass(frozen=True)
class SmallSample:
    """Corrections of the parameters' covariance.

    Attributes:
        factor: ``(f, f)``: the covariance C becomes ``factor C factor'``, in unit columns.
        dof: ``(f,)`` degrees of freedom of each parameter's interval.
        components: how well the variances are known that they stand on.
    """

    factor: Array
    dof: Array
    components: ComponentErrors


def small_sample(problem: RestrictedProblem, estimate: Estimate) -> SmallSample:
    """The corrections at an estimate with at least one component.

    Derivatives are differences in the logarithms of the variances and in the correlation's odds.
    """
    at = _Point.of(estimate, known=problem.known)
    count, middle = len(at.values), at.look(problem, at.values)
    steps = _STEP * np.eye(count)
    ahead, behind = ([at.look(problem, at.values + sign * step) for step in steps] for sign in (1, -1))
    first = [(plus.covariance - minus.covariance) / (2 * _STEP) for plus, minus in zip(ahead, behind, strict=True)]
    bend = np.zeros((count, count))
    second = np.zeros((count, count, *middle.covariance.shape))
    for i in range(count):
        bend[i, i] = (ahead[i].deviance + behind[i].deviance - 2 * middle.deviance) / _STEP**2
        second[i, i] = (ahead[i].covariance + behind[i].covariance - 2 * middle.covariance) / _STEP**2 - first[i]
        for j in range(i):
            for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
                corner = at.look(problem, at.values + a * steps[i] + b * steps[j])
                bend[i, j] += a * b * corner.deviance / (4 * _STEP**2)
                second[i, j] += a * b * corner.covariance / (4 * _STEP**2)
            bend[j, i], second[j, i] = bend[i, j], second[i, j]
    sizes, axes = np.linalg.eigh(bend / 2)  # half of the deviance is minus the log-likelihood
    spread = (axes / np.maximum(sizes, _LEAST_CURVATURE)) @ axes.T
    slopes = np.stack([np.diag(each) for each in first])
    components = ComponentErrors(at.names, spread, slopes / np.diag(middle.covariance) / 2)
    variance = np.einsum("if,ij,jf->f", slopes, spread, slopes)
    dof = np.minimum(matched_dof(np.diag(middle.covariance), variance), 1e9)
    if "carry" in at.names:
        return SmallSample(np.eye(len(dof)), dof, components)
    more = -np.einsum("ij,ijfg->fg", spread, second)
    return SmallSample(_bounded(middle.covariance, more), dof, components)


@dataclass(frozen=True)
class _Look:
    """At some variances: the covariance ``(f, f)`` of the parameters, and the deviance."""

    covariance: Array
    deviance: float


@dataclass(frozen=True)
class _Point:
    """The estimated variances as logarithms.

    Attributes:
        names: of the components; ``scale`` is the instrument's variance.
        values: their logarithms; of the correlation that of its odds.
        scale: the instrument's variance where it is at a bound.
    """

    names: tuple[str, ...]
    values: Array
    scale: float

    @staticmethod
    def of(estimate: Estimate, *, known: bool) -> "_Point":
        components, scale = estimate.components, estimate.likelihood.scale
        at_bound = known and not LEAST_SHARE < scale < 1.0
        found = {} if at_bound else {"scale": float(np.log(scale))}
        for term in TERMS:
            if (variance := components[term.name]) > 0:
                found[term.name] = float(np.log(variance * scale))
            if term.structure == "autoregressive" and (carry := components.carry) > 0:
                found["carry"] = float(np.log(carry / (1 - carry)))
        return _Point(tuple(found), np.array(list(found.values())), scale)

    def look(self, problem: RestrictedProblem, values: Array) -> _Look:
        """Covariance and deviance at other values."""
        found = dict(zip(self.names, np.exp(values).tolist(), strict=True))
        scale, odds = found.pop("scale", self.scale), found.pop("carry", 0.0)
        components = Components({name: value / scale for name, value in found.items()}, odds / (1 + odds))
        there = problem.at(components, scale)
        return _Look(scale * np.linalg.inv(there.information), there.deviance)


def _bounded(covariance: Array, more: Array) -> Array:
    """The factor by which the covariance grows by ``more``, in each direction as far as that is to be believed."""
    root = np.linalg.cholesky(covariance)
    inner = np.linalg.solve(root, np.linalg.solve(root, more).T)
    sizes, axes = np.linalg.eigh((inner + inner.T) / 2)
    grown = (axes * np.sqrt(1 + np.clip(sizes, 0.0, (1 + _LARGEST) ** 2 - 1))) @ axes.T
    return np.asarray(root @ grown @ np.linalg.inv(root))
