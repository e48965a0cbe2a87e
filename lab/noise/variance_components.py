"""Estimate variance components by restricted likelihood, select the significant ones, and correct for small samples.

With whitened rows y = J b + e of covariance s V the restricted likelihood is that of the residuals (Patterson &
Thompson 1971): minus twice its logarithm is log|V| + log|J'V^-1 J| + (N - f) log s + Q / s, with Q = r'V^-1 r at the
generalized least squares. V = 1 + g S S' + U G U' + sum d_i D_i D_i': errors within each pose, a first-order
autoregressive shift (whose inverse covariance has one band: Rue & Held 2005, section 1.1), and lasting errors. So every
product with V^-1 takes a time linear in the number of poses.

Search: components are added one by one while the likelihood ratio is significant at ``VARIANCE_COMPONENTS``, with
Bonferroni's correction over the candidates. A variance of zero lies at a bound, where twice the log ratio is zero half
of the time (Self & Liang 1987).

Small samples: C(t) = (J'V(t)^-1 J)^-1 at estimated variances t of covariance W is too small twice: on average C(t^)
misses half of the curvature sum W_ij C_ij, and estimated weights cost as much precision again. To the first
order the covariance is C - sum W_ij C_ij with C_ij the second derivatives by the variances (Kenward & Roger 1997), and
the degrees of freedom of a parameter's interval are those of a chi squared with the variance of C(t^) (Satterthwaite
1946). An autoregressive correlation is too far from a normal distribution for the first: C is not corrected.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy  # its parts are loaded at their first use

from lab.core.linear_model import matched_dof
from lab.core.se3 import Array
from lab.core.significance import VARIANCE_COMPONENTS
from lab.noise.error_term import TERMS, Components, ErrorShapes, ErrorTerm, term_called, terms_with

__all__ = [
    "ComponentErrors",
    "ComponentTrial",
    "RestrictedProblem",
    "SmallSample",
    "VarianceEstimate",
    "best_components",
    "chosen_components",
    "small_sample",
]

_TINY = 1e-300


def _only_term(structure: str) -> ErrorTerm:
    """Return the term of a structure that the likelihood is solved with, of which there is one."""
    terms = [term for term in TERMS if term.structure == structure]
    if len(terms) != 1:
        raise RuntimeError(f"structure {structure} has {len(terms)} error terms, not 1; make a new one lasting")
    return terms[0]


_WITHIN, _IN_TIME = _only_term("pose"), _only_term("autoregressive")
_MIN_SHARE = 0.25  # of a given instrument's variance: half its noise
_MIN_GAP = 1e-8
_ROUNDING = 1e-14  # added to the normal equations of unit columns
_KINDS = tuple(term.kind for term in TERMS)
_VARIANCES = (1e-4, 1e3)  # bounds of a component's mean variance, in units of the instrument's
_CARRIES = (0.1, 0.995)  # bounds of the correlation from one pose to the next
_START_VARIANCES, _START_CARRIES = (0.05, 0.3, 2.0, 15.0, 300.0), (0.4, 0.85)
_MIN_GAIN = 1.0  # twice the log ratio at the best start: from less, no search reaches significance
_FAMILIES = ("moving", "wandering")  # that are left out, one in each search
_STEP = 0.1  # of the logarithm of a variance, and of a correlation's odds, for differences
_MAX_INFLATION = 0.5  # largest relative increase of a standard deviation
_MIN_CURVATURE = 0.05  # of a log-likelihood by the logarithm of a variance: below it is not identifiable


@dataclass(frozen=True)
class _Likelihood:
    """Restricted likelihood of some variance components.

    Attributes:
        deviance: minus twice the restricted log-likelihood, up to a constant, with the weak prior of a slow shift.
        scale: s, the instrument's variance in units of the assumed one.
        information: ``(f, f)`` J'V^-1 J of unit columns.
    """

    deviance: float
    scale: float
    information: Array


@dataclass(frozen=True)
class RestrictedProblem:
    """Whitened rows of n poses, residuals beside derivatives, with shapes of shared errors.

    Attributes:
        rows: ``(n, m, f + 1)`` derivatives of unit norm, then residuals; zero where nothing was observed.
        numbers: count of observed ones.
        shapes: of the errors.
        sigma_given: whether the instrument's variance is given, so that s is at most one.
        own: names of lasting terms that packages add.
    """

    rows: Array
    numbers: int
    shapes: ErrorShapes
    sigma_given: bool
    own: tuple[str, ...] = ()

    @property
    def dof(self) -> int:
        """Residual degrees of freedom."""
        return self.numbers - int(self.rows.shape[2]) + 1

    def likelihood(self, components: Components, scale: float | None = None) -> _Likelihood:
        """Return the restricted likelihood of some components, with the best s unless ``scale`` is given.

        A given instrument's variance is an upper bound, as some of its error may be autocorrelated.
        """
        squares, determinant = self._products(components)
        size = len(squares) - 1
        factor = np.linalg.cholesky(squares[:size, :size] + _ROUNDING * np.eye(size))
        pull = scipy.linalg.lapack.dtrtrs(factor, squares[:size, size], lower=1)[0]
        left = max(float(squares[size, size] - pull @ pull), _TINY)
        determinant = determinant + 2 * float(np.log(np.diag(factor)).sum())
        if scale is None:
            scale = float(np.clip(left / self.dof, _MIN_SHARE, 1.0)) if self.sigma_given else left / self.dof
        deviance = determinant + self.dof * np.log(scale) + left / scale - _log_prior(components)
        return _Likelihood(float(deviance), scale, squares[:size, :size])

    @cached_property
    def _lasting(self) -> tuple[ErrorTerm, ...]:
        return tuple(term for term in terms_with(self.own) if term.structure == "lasting")

    @cached_property
    def _rotated(self) -> "_Rotated":
        shapes = self.shapes
        within = _WITHIN.shape(shapes)
        sizes, axes = np.linalg.eigh(within @ np.swapaxes(within, 1, 2))
        turn = np.swapaxes(axes, 1, 2)
        lasting = {term.name: turn @ term.shape(shapes) for term in self._lasting}
        return _Rotated(turn @ self.rows, turn @ _IN_TIME.shape(shapes), lasting, np.maximum(sizes, 0.0))

    def _white(self, components: Components) -> tuple[Array, Array, Array, Array]:
        """Return rows, shift and lasting errors, ``(n, m, ...)``, and weights ``(n, m, 1)`` that whiten each pose."""
        rotated = self._rotated
        weight = 1 / np.sqrt(1 + components[_WITHIN.name] * rotated.sizes)[..., None]
        pairs = ((components[name], each) for name, each in rotated.lasting.items())
        lasting = [np.sqrt(size) * each for size, each in pairs if size]
        none = rotated.shift[..., :0]
        return rotated.rows, rotated.shift, np.concatenate(lasting or [none], axis=2), weight

    def _products(self, components: Components) -> tuple[Array, float]:
        """Return Z'V^-1 Z ``(f + 1, f + 1)`` of the rows Z, and log|V|."""
        rows, shift, lasting, weight = self._white(components)
        columns, count = rows.shape[2], lasting.shape[2]
        white = (np.concatenate([rows, lasting], axis=2) if count else rows) * weight
        squares, determinant = _gram(white), -2 * float(np.log(weight).sum())
        if components[_IN_TIME.name]:
            more, extra = self._autocorrelated(white, shift * weight, components)
            squares, determinant = squares - more, determinant + extra
        if not count:
            return squares, determinant
        inner = np.eye(count) + squares[columns:, columns:]
        cross = squares[columns:, :columns]
        return (
            squares[:columns, :columns] - cross.T @ np.linalg.solve(inner, cross),
            determinant + float(np.linalg.slogdet(inner)[1]),
        )

    def _autocorrelated(self, white: Array, shift: Array, components: Components) -> tuple[Array, float]:
        """Return an autoregressive (AR(1)) shift's reduction of the products, and its share of log|V| (Woodbury)."""
        order = np.argsort(self.shapes.times, kind="stable")
        white, shift = white[order], shift[order]
        carry = components.carry ** np.diff(self.shapes.times[order])
        own = np.maximum(1 - carry**2, _MIN_GAP)  # of two rows at one time
        diagonal = np.ones(len(order))
        diagonal[:-1] += carry**2 / own
        diagonal[1:] += carry**2 / own
        inner = components[_IN_TIME.name] * np.swapaxes(shift, 1, 2) @ shift
        axes = shift.shape[2]
        banded = np.zeros((axes + 1, axes * len(order)))
        for band in range(axes):
            for i in range(axes - band):
                banded[band, i::axes] = inner[:, i + band, i]
        banded[0] += np.repeat(diagonal, axes)
        banded[axes, : axes * len(carry)] = np.repeat(-carry / own, axes)
        factor = scipy.linalg.cholesky_banded(banded, lower=True, check_finite=False)
        pulls = np.sqrt(components[_IN_TIME.name]) * (np.swapaxes(shift, 1, 2) @ white).reshape(axes * len(order), -1)
        solved = scipy.linalg.cho_solve_banded((factor, True), pulls, check_finite=False)
        determinant = 2 * float(np.log(factor[0]).sum()) + axes * float(np.log(own).sum())
        return pulls.T @ solved, determinant


@dataclass(frozen=True)
class _Rotated:
    """A problem in the axes of each pose's own errors.

    Attributes:
        rows: ``(n, m, f + 1)``.
        shift: ``(n, m, 3)`` the shape of the autoregressive term.
        lasting: those of the lasting terms, by name.
        sizes: ``(n, m)`` the variances of the pose's own errors along these axes.
    """

    rows: Array
    shift: Array
    lasting: Mapping[str, Array]
    sizes: Array


def _log_prior(components: Components) -> float:
    """Return twice the logarithm of a weak prior, sqrt(1 - carry): a campaign does not show slower shifts."""
    return float(np.log1p(-components.carry)) if components[_IN_TIME.name] else 0.0


def _gram(rows: Array) -> Array:
    flat = rows.reshape(-1, rows.shape[2])
    return np.asarray(flat.T @ flat)


@dataclass(frozen=True)
class VarianceEstimate:
    """Maximum of the restricted likelihood for some kinds of components.

    Attributes:
        kinds: of its components.
        components: their variances, in units of the instrument's.
        likelihood: there.
        problem: of the rows.
    """

    kinds: tuple[str, ...]
    components: Components
    likelihood: _Likelihood
    problem: RestrictedProblem

    @property
    def deviance(self) -> float:
        """Minus twice the restricted log-likelihood."""
        return self.likelihood.deviance


@dataclass(frozen=True)
class ComponentTrial:
    """Test of a component beside those selected before it.

    Attributes:
        ratio: twice the log of the likelihood ratio.
        p: its p-value, without Bonferroni's factor over the kinds.
        taken: whether it was selected.
    """

    kind: str
    ratio: float
    p: float
    taken: bool


def chosen_components(
    problem: RestrictedProblem, kinds: Sequence[str] | None = None
) -> tuple[VarianceEstimate, tuple[ComponentTrial, ...]]:
    """Select the significant components; return them and all tests.

    Drift is confounded with an autoregressive shift: each family is searched without the other, with
    scatter beside it, and the likelier result is taken.

    Args:
        kinds: to select from; by default all of the lab, and the problem's own.
    """
    kinds = (*_KINDS, *problem.own) if kinds is None else kinds
    search = _Search(problem, VARIANCE_COMPONENTS / len(kinds))
    results = [search.along([kind for kind in kinds if term_called(kind).family != other]) for other in _FAMILIES]
    found, trials = min(results, key=lambda result: result[0].deviance)
    tried = {trial.kind: replace(trial, taken=False) for _, each in results for trial in each}
    return found, tuple((tried | {trial.kind: trial for trial in trials}).values())


class _Search:
    """Forward selection of components, with a cache of estimates."""

    def __init__(self, problem: RestrictedProblem, level: float) -> None:
        """Start a search at the significance level of one kind."""
        self._level = level
        self._alone = best_components(problem, ())
        self._known: dict[tuple[str, ...], VarianceEstimate] = {}

    def along(self, kinds: Sequence[str]) -> tuple[VarianceEstimate, list[ComponentTrial]]:
        """Return the significant components of some kinds, and all tests."""
        best, trials = self._alone, dict[str, ComponentTrial]()
        while True:
            significant = []
            for kind in kinds:
                if kind in best.kinds:
                    continue
                each, trials[kind] = self._extended(best, kind)
                if trials[kind].p < self._level:
                    significant.append((each, kind))
            if not significant:
                return best, list(trials.values())
            best, kind = min(significant, key=lambda pair: pair[0].deviance)
            trials[kind] = replace(trials[kind], taken=True)

    def _extended(self, found: VarianceEstimate, kind: str) -> tuple[VarianceEstimate, ComponentTrial]:
        kinds, hopeless = (*found.kinds, kind), found.likelihood.deviance - _MIN_GAIN
        each = self._known.get(kinds)
        if each is None:
            each = self._known[kinds] = best_components(found.problem, kinds, hopeless)
        ratio = found.likelihood.deviance - each.likelihood.deviance
        return each, ComponentTrial(kind, ratio, term_called(kind).p_value(ratio), taken=False)


def best_components(problem: RestrictedProblem, kinds: tuple[str, ...], hopeless: float = np.inf) -> VarianceEstimate:
    """Maximize the restricted likelihood of components of these kinds.

    Args:
        hopeless: a deviance; if every start's is larger, the best start is returned.
    """
    if not kinds:
        return VarianceEstimate(kinds, Components(), problem.likelihood(Components()), problem)
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

    starts = _starts(len(kinds), in_time=in_time)
    heights = [deviance(start) for start in starts]
    point = starts[int(np.argmin(heights))]
    if min(heights) <= hopeless:
        point = _minimized(deviance, point)
    best = components(point)
    return VarianceEstimate(kinds, best, problem.likelihood(best), problem)


def _starts(count: int, *, in_time: bool) -> list[Array]:
    """Return points to start from: logarithms of variances and, in time, of the odds of the correlation."""
    starts = [np.full(count, np.log(size)) for size in _START_VARIANCES]
    if not in_time:
        return starts
    at = [(carry - _CARRIES[0]) / (_CARRIES[1] - carry) for carry in _START_CARRIES]
    return [np.append(start, np.log(odds)) for start in starts for odds in at]


def _minimized(deviance: Callable[[Array], float], start: Array) -> Array:
    """Return the point of the least deviance near a start: by bounded search of one variance, else by a simplex."""
    if len(start) == 1:
        inside = (max(start[0] - 3.5, np.log(_VARIANCES[0])), min(start[0] + 7.0, np.log(_VARIANCES[1])))
        best = scipy.optimize.minimize_scalar(
            lambda size: deviance(np.array([size])), bounds=inside, method="bounded", options={"xatol": 1e-3}
        )
        return np.array([float(best.x)])
    simplex = start + np.concatenate([np.zeros((1, len(start))), 0.7 * np.eye(len(start))])
    options = {"initial_simplex": simplex, "xatol": 5e-3, "fatol": 1e-3, "maxfev": 80 * len(start)}
    return np.asarray(scipy.optimize.minimize(deviance, start, method="Nelder-Mead", options=options).x)


@dataclass(frozen=True)
class ComponentErrors:
    """Errors of estimated variance components, and the parameters' sensitivity to them.

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
        """Return the errors as in ``result.json``."""
        return {"names": list(self.names), "covariance": self.covariance.tolist(), "slopes": self.slopes.tolist()}

    def without(self, name: str) -> "ComponentErrors":
        """Return the errors with one of the variances fixed."""
        kept = [i for i, each in enumerate(self.names) if each != name]
        names = tuple(self.names[i] for i in kept)
        return ComponentErrors(names, self.covariance[np.ix_(kept, kept)], self.slopes[kept])

    def of(self, parameters: Sequence[int]) -> "ComponentErrors":
        """Return the errors for some of the parameters."""
        return replace(self, slopes=self.slopes[:, list(parameters)])


@dataclass(frozen=True)
class SmallSample:
    """Corrections of the parameters' covariance.

    Attributes:
        factor: ``(f, f)``: the covariance C becomes ``factor C factor'``, in unit columns.
        dof: ``(f,)`` degrees of freedom of each parameter's interval.
        components: errors of the variance components.
    """

    factor: Array
    dof: Array
    components: ComponentErrors


def small_sample(problem: RestrictedProblem, estimate: VarianceEstimate) -> SmallSample:
    """Compute the corrections at an estimate with at least one component.

    Derivatives are differences in the logarithms of the variances and in the correlation's odds.
    """
    at = _Point.of(estimate, sigma_given=problem.sigma_given)
    count, middle = len(at.values), at.evaluate(problem, at.values)
    steps = _STEP * np.eye(count)
    ahead, behind = ([at.evaluate(problem, at.values + sign * step) for step in steps] for sign in (1, -1))
    first = [(plus.covariance - minus.covariance) / (2 * _STEP) for plus, minus in zip(ahead, behind, strict=True)]
    bend = np.zeros((count, count))
    second = np.zeros((count, count, *middle.covariance.shape))
    for i in range(count):
        bend[i, i] = (ahead[i].deviance + behind[i].deviance - 2 * middle.deviance) / _STEP**2
        second[i, i] = (ahead[i].covariance + behind[i].covariance - 2 * middle.covariance) / _STEP**2 - first[i]
        for j in range(i):
            for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
                corner = at.evaluate(problem, at.values + a * steps[i] + b * steps[j])
                bend[i, j] += a * b * corner.deviance / (4 * _STEP**2)
                second[i, j] += a * b * corner.covariance / (4 * _STEP**2)
            bend[j, i], second[j, i] = bend[i, j], second[i, j]
    sizes, axes = np.linalg.eigh(bend / 2)  # half of the deviance is minus the log-likelihood
    spread = (axes / np.maximum(sizes, _MIN_CURVATURE)) @ axes.T
    slopes = np.stack([np.diag(each) for each in first])
    components = ComponentErrors(at.names, spread, slopes / np.diag(middle.covariance) / 2)
    variance = np.einsum("if,ij,jf->f", slopes, spread, slopes)
    dof = np.minimum(matched_dof(np.diag(middle.covariance), variance), 1e9)
    if "carry" in at.names:
        return SmallSample(np.eye(len(dof)), dof, components)
    more = -np.einsum("ij,ijfg->fg", spread, second)
    return SmallSample(_bounded(middle.covariance, more), dof, components)


@dataclass(frozen=True)
class _Evaluation:
    """Covariance ``(f, f)`` of the parameters, and deviance, at some variances."""

    covariance: Array
    deviance: float


@dataclass(frozen=True)
class _Point:
    """The estimated variances as logarithms.

    Attributes:
        names: of the components; ``scale`` is the instrument's variance.
        values: their logarithms; for the correlation that of its odds.
        scale: the instrument's variance if it is at a bound.
    """

    names: tuple[str, ...]
    values: Array
    scale: float

    @staticmethod
    def of(estimate: VarianceEstimate, *, sigma_given: bool) -> "_Point":
        components, scale = estimate.components, estimate.likelihood.scale
        at_bound = sigma_given and not _MIN_SHARE < scale < 1.0
        found = {} if at_bound else {"scale": float(np.log(scale))}
        for term in terms_with(components.variances):
            if (variance := components[term.name]) > 0:
                found[term.name] = float(np.log(variance * scale))
            if term.structure == "autoregressive" and (carry := components.carry) > 0:
                found["carry"] = float(np.log(carry / (1 - carry)))
        return _Point(tuple(found), np.array(list(found.values())), scale)

    def evaluate(self, problem: RestrictedProblem, values: Array) -> _Evaluation:
        found = dict(zip(self.names, np.exp(values).tolist(), strict=True))
        scale, odds = found.pop("scale", self.scale), found.pop("carry", 0.0)
        components = Components({name: value / scale for name, value in found.items()}, odds / (1 + odds))
        there = problem.likelihood(components, scale)
        return _Evaluation(scale * np.linalg.inv(there.information), there.deviance)


def _bounded(covariance: Array, more: Array) -> Array:
    """Return the factor by which the covariance grows by ``more``, clipped in each direction."""
    root = np.linalg.cholesky(covariance)
    inner = np.linalg.solve(root, np.linalg.solve(root, more).T)
    sizes, axes = np.linalg.eigh((inner + inner.T) / 2)
    grown = (axes * np.sqrt(1 + np.clip(sizes, 0.0, (1 + _MAX_INFLATION) ** 2 - 1))) @ axes.T
    return np.asarray(root @ grown @ np.linalg.inv(root))
