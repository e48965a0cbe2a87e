"""Identify an arm's parameters from measured target positions.

Identification uses an arm only through ``Model``: joints and parameters in, points and derivatives out.

The canonical gauge fixes some parameters at nominal, and errors of these go into others (``most_likely`` spreads them).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from lab.calibration.estimator import EstimationProblem, Estimator, estimated
from lab.calibration.fit_options import PLAIN, FitOptions
from lab.calibration.gauss_newton import ExtraResiduals, Fit, Observations, Status, fit, settled
from lab.calibration.guess import columns_of, few_points_of_a_station
from lab.calibration.identifiability import poses_needed, scaled_condition
from lab.calibration.observation import (
    Observation,
    UnscaledObservation,
    UnsizedObservation,
    WeighsPriors,
    observation_of,
)
from lab.calibration.prior import (
    ActingPrior,
    Prior,
    PriorDirections,
    directions_of,
    prior_of,
)
from lab.calibration.weights import (
    Noise,
    constraint_rows,
    joined,
    root_mean_square_sigma,
    weigh,
    weighted_constraints,
)
from lab.core import se3
from lab.core.checks import Check
from lab.core.errors import LabError, option_name
from lab.core.linear_model import WELL_CONDITIONED, condition_bound, triangle_of
from lab.core.measurements import Measurements, seen_mask
from lab.core.probability import t_ppf
from lab.core.se3 import Array
from lab.kinematics.gauge import BaseSet, base_set, independent_columns, structure_jacobian
from lab.kinematics.model import Model
from lab.kinematics.parameter import SIZE, frame_rotations

__all__ = [
    "COLLAPSED",
    "PLAUSIBLE_SPREAD",
    "WEAK",
    "Identification",
    "component_variances",
    "fit_base_and_tool",
    "identify",
    "needs_no_prior",
    "spread",
]

_FIRST_POSES = 4_000  # of very many, for initial values and, mostly, the identifiable parameters
_PRIOR_ROUNDS = 4  # of the directions and the scale of an automatic prior, and the fit by these
_SETTLED_SCALE = 0.05  # of itself, by which the scale of the tolerances still changes
_LEAST_SIGMA = 1e-9  # m: residuals below are those of the arithmetic
_LEAST_WEIGHING = 1e-7  # m: by less noise no prior weighs, so that it stays above rounding
_EXACT_M = 1e-9  # root mean square of points: moved by less, they are where they were
_UNMOVED = 0.1  # standard deviations of a reading, root mean square: moved by less, directions are as they were
_SETTLED_NOISE, _NOISE_ROUNDS = 0.01, 3  # of itself, by which the noise that priors weigh by still changes
_MOST_NAMED = 8  # weak parameters in a warning
COLLAPSED = (20e-3, np.deg2rad(10))  # m and rad of a link from nominal: beyond, it is another arm's
WEAK = 1e-3  # m or rad: a parameter with a larger standard deviation is weak
PLAUSIBLE_SPREAD = (0.5, 2.0)  # of the measured points, to those of the nominal model in the same poses


class _PredictedCovariance(Protocol):
    """Covariances of the errors of predicted points, where they are not those of the parameters alone."""

    def covariances(self, inputs: Array, targets: int | None = None) -> Array:
        """Return ``(n, k, 3, 3)`` m^2 at poses ``(n, joints + conditions)``, each point alone; of the first targets."""

    def covariance(self, inputs: Array, targets: int | None = None) -> Array:
        """Return ``(n k 3, n k 3)`` m^2 of all points together."""


@dataclass(frozen=True)
class Identification:
    """Identification of an arm from one set of measurements.

    Attributes:
        nominal_aligned: ``(p,)`` the nominal links, with base and targets fitted to the same measurements, all of the
            same weight: the errors of nominal links are no instrument's noise.
        values: the identified parameters ``(p,)`` in the order of ``model.names``.
        base_set: which parameters are identifiable by the arm's structure.
        fit: of the parameters identifiable from these poses; ``fit.free`` are their indices.
        sigma_m: noise of a coordinate, given (a root mean square) or estimated; NaN if unknown.
        residual_sigma_m: noise of a coordinate, estimated from the residuals; NaN where nothing is left over.
        covariance: ``(f, f)`` of the free parameters; NaN where sigma is unknown.
        extra_residuals: information beside the measurements, weighted as they are: constraints, a prior.
        dof_each: ``(f,)`` of each parameter's interval, where the covariance is not that of one sigma alone.
        process: covariances of predicted points, where what the parameters do not explain is predicted too.
        prior: the prior that takes part in the fit; None where none does.
        residuals: ``(n, k, d)`` measured less predicted (m of points), NaN where not observed.
        checks: notes of the measurements; of convergence, and of parameters that are not determined.
        spread: of the measured points, to that of the nominal model's in the same poses: a wrong unit shows here.
    """

    model: Model
    nominal_aligned: Array
    values: Array
    base_set: BaseSet
    fit: Fit
    sigma_m: float
    sigma_given: bool
    residual_sigma_m: float
    dof: int
    covariance: Array
    residuals: Array
    spread: float
    checks: tuple[Check, ...]
    extra_residuals: ExtraResiduals
    dof_each: Array | None = None
    process: _PredictedCovariance | None = None
    prior: ActingPrior | None = None

    @property
    def status(self) -> Status:
        """Convergence status of Gauss-Newton."""
        return self.fit.status

    @property
    def std(self) -> Array:
        """Standard deviations ``(f,)`` of the free parameters."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def half_width_95(self) -> Array:
        """Half of each 95 % interval ``(f,)`` in standard deviations: Student's t where sigma was estimated."""
        if self.sigma_given and self.dof_each is None:
            return np.full(len(self.fit.free), 1.959963984540054)
        dof = np.full(len(self.fit.free), self.dof) if self.dof_each is None else self.dof_each
        return np.asarray(np.where(dof > 0, t_ppf(0.975, np.maximum(dof, 1)), np.nan))

    @property
    def plain_condition(self) -> float:
        """The condition number of the measurements' Jacobian; of the fit's it is another where a prior takes part."""
        return self.fit.condition if self.prior is None else self.prior.plain_condition

    @property
    def plausible(self) -> bool:
        """Check whether the measured points spread as the nominal model's do."""
        return PLAUSIBLE_SPREAD[0] <= self.spread <= PLAUSIBLE_SPREAD[1]

    @property
    def weak(self) -> tuple[str, ...]:
        """Names of the fitted parameters that are uncertain by more than a millimetre or milliradian."""
        parameters = (self.model.parameters[i] for i in self.fit.free)
        each = zip(parameters, self.std, strict=True)
        return tuple(parameter.name for parameter, std in each if parameter.unit.si in ("m", "rad") and std > WEAK)

    @property
    def unobservable(self) -> tuple[int, ...]:
        """Identifiable parameters that these poses do not determine, held at nominal."""
        return tuple(i for i in self.base_set.identifiable if i not in self.fit.free)

    @property
    def unplaced(self) -> tuple[str, ...]:
        """Groups that points place anew where no instrument's frame was observed: the base, and an unseen tool."""
        identified = any(self.model.parameters[i].group == "tool" for i in self.fit.free)
        return ("base",) if identified else ("base", "tool")

    @property
    def collapsed(self) -> tuple[str, ...]:
        """Links that are those of another arm, where readings alone constrain their sizes: errors then shrink with it.

        Contacts, pictures and lengths of a cable may be explained by an arm that hardly moves, or moves in a plane.
        """
        if observation_of(self.model).positions:
            return ()
        off, found = np.abs(self.values - self.nominal_aligned), list[tuple[float, str]]()
        for parameter, size in zip(self.model.parameters, off.tolist(), strict=True):
            most = COLLAPSED[parameter.is_angle]
            if parameter.is_link and parameter.symbol != "theta" and not size <= most:
                found.append((size / most, parameter.name))
        return tuple(name for _, name in sorted(found, reverse=True))

    @property
    def lacks_size(self) -> bool:
        """True if the readings determine the arm's shape, but not its size: one length stays nominal."""
        model = self.model
        return (
            isinstance(model, UnsizedObservation)
            and model.unsized
            and model.scale_link not in self.base_set.identifiable
        )


def fit_base_and_tool(observation: Observation, observed: Observations, nominal: Array) -> Array:
    """Fit base and targets to the nominal links: the arm *before*, and the start of *after*."""
    model, placing = observation.model, columns_of(observation.model, observation.placed)
    constraints = weighted_constraints(observation, observed)
    start = observation.initial_guess(observed.thinned(_FIRST_POSES), nominal)
    placed = fit(model, observed, placing, start, tolerance_m=1e-7, extra_residuals=constraints)
    if not placed.ill_conditioned:
        return placed.values
    jacobian = structure_jacobian(model, nominal, 50)
    free = independent_columns(jacobian.reshape(-1, len(model.names)), placing)
    fixed = [column for column in placing if column not in free]
    start[fixed] = nominal[fixed]
    return fit(model, observed, free, start, tolerance_m=1e-7, extra_residuals=constraints).values


def identify(
    arm: Model,
    data: Measurements,
    nominal: Array,
    noise: Noise | None = None,
    options: FitOptions = PLAIN,
) -> Identification:
    """Identify an arm's base set from the rows of ``data``, from nominal links, without initial base and tool.

    Args:
        arm: the arm, measured by points; or an ``Observation``, a model of another kind of measurement.
        noise: of these rows; unknown where not given.
        nominal: the nominal parameters, at least the arm's; what is placed (base and tool) needs no guess.

    Raises:
        LabError: there are fewer poses than the base set needs, or what is requested cannot be had.
    """
    # weigh the measurements
    observation = observation_of(arm).within(data)
    observation, observed, sigma_given = _weighed(observation, data, noise or Noise())
    model, nominal = observation.model, observation.nominal(nominal)
    _refuse_impossible_or_few(observation, data, observed, nominal)
    # place base and tool by the nominal links
    aligned = fit_base_and_tool(observation, observed.alike, nominal)
    # find what is identifiable, by the structure of the arm and in these poses
    prior_rows = constraint_rows(observation, observed, model.rank_point(aligned))
    structure = base_set(model, aligned, fix=options.fix, free=options.free, prior_rows=prior_rows)
    free = _identifiable(model, observed, aligned, structure, prior_rows)
    _refuse_too_few_poses(model, data, aligned, structure, free, options)
    # fit the identifiable parameters, the others at nominal
    start = aligned.copy()
    start[list(structure.fixed)] = nominal[list(structure.fixed)]
    start[list(free)] = [options.near.get(model.names[i], start[i]) for i in free]
    solution = _solved(observation, observed, free, start, options)
    if not sigma_given:
        observation, solution = _with_weighed_priors(observation, observed, solution, options)
    model = observation.model
    constraints = weighted_constraints(observation, observed)
    if options.estimator is not None:
        solution = _estimated(
            options.estimator, observation, observed, structure, nominal, solution, start, options, sigma_given
        )
    solution = _canonical(model, solution)
    dof, unit_sigma = _residual_sigma(observation, observed, solution)
    # let tolerances of manufacture take part
    problem = _MAPProblem(observation, observed, structure, constraints, start, sigma_given)
    most_likely = problem.requested(options, nominal, solution, dof, unit_sigma)
    if most_likely is not None:
        solution, dof, unit_sigma = most_likely.fit, most_likely.dof, most_likely.sigma
        constraints = joined(constraints, most_likely.prior.rows(most_likely.weight))
    solution = replace(solution, aside=_sizes(model, solution.free))
    # the covariance, by the given noise or by the residuals
    given = root_mean_square_sigma(observed, observation.positions, observation.units) if sigma_given else 1.0
    scale = 1.0 if sigma_given else unit_sigma
    identified = Identification(
        model,
        aligned,
        solution.values,
        base_set=structure,
        fit=solution,
        sigma_m=given * scale,
        sigma_given=sigma_given,
        residual_sigma_m=given * unit_sigma,
        dof=dof,
        covariance=solution.unit_covariance() * max(scale, _least_scale(solution, observed)) ** 2,
        residuals=data.points - model.points(observed.inputs, solution.values),
        spread=_relative_spread(observation, observed, aligned, nominal),
        checks=tuple(Check("note", "noted", data={"text": text}) for text in data.warnings),
        extra_residuals=constraints,
        prior=None if most_likely is None else most_likely.prior,
    )
    return replace(identified, checks=(*identified.checks, *_checks(identified)))


def _weighed(observation: Observation, data: Measurements, noise: Noise) -> tuple[Observation, Observations, bool]:
    """Weigh the measurements as ``weigh``, and an observation's own priors where the noise is given."""
    observed, sigma_given = weigh(observation, data, noise)
    if sigma_given and isinstance(observation, WeighsPriors):
        observation = observation.weighed(1 / observed.typical_weight)
    return observation, observed, sigma_given


def _least_scale(solution: Fit, observed: Observations) -> float:
    """Return the least standard deviation of whitened residuals by which priors of sizes weigh; 0 without any."""
    return _LEAST_WEIGHING * observed.typical_weight if solution.aside else 0.0


def _solved(
    observation: Observation, observed: Observations, free: Sequence[int], start: Array, options: FitOptions
) -> Fit:
    """Fit the free parameters by the requested method: by default by least squares of all at once."""
    if options.solve is not None:
        return options.solve(observation, observed, free, start)
    constraints = weighted_constraints(observation, observed)
    solution = fit(observation.model, observed, free, start, extra_residuals=constraints)
    solution = replace(solution, aside=_sizes(observation.model, free))
    return settled(observation.model, observed, solution, constraints)


def _with_weighed_priors(
    observation: Observation, observed: Observations, solution: Fit, options: FitOptions
) -> tuple[Observation, Fit]:
    """Return the observation whose priors weigh by the noise of the residuals, and its fit, from an earlier fit."""
    for _ in range(_NOISE_ROUNDS):
        if not isinstance(observation, WeighsPriors) or not len(observation.extra_residuals(solution.values)[0]):
            break
        # the noise that is left
        unit_sigma = _residual_sigma(observation, observed, solution)[1]
        sigma = max(unit_sigma / observed.typical_weight, _LEAST_WEIGHING)
        if not np.isfinite(unit_sigma) or abs(sigma / observation.sigma - 1) < _SETTLED_NOISE:
            break
        # the fit with priors of that weight, to first order; again where that moves the predictions
        before, observation = observation, observation.weighed(sigma)
        linear = _linearly_reweighed(before, observation, observed, solution)
        if linear is not None:
            return observation, linear
        solution = _solved(observation, observed, solution.free, solution.values, options)
    return observation, solution


def _linearly_reweighed(before: Observation, after: Observation, observed: Observations, solution: Fit) -> Fit | None:
    """Return the fit with priors of another weight to first order; None where that is not exact."""
    old, (residual, rows) = (weighted_constraints(each, observed)(solution.values) for each in (before, after))
    ratio = np.linalg.norm(old[1], axis=1) / np.linalg.norm(rows, axis=1)
    if solution.status != "converged" or solution.other is not None or (ratio > 1).any():
        return None
    more = np.sqrt(1 - ratio**2)  # of each row, which had ``ratio`` of its weight already
    found, moved = solution.beside(more * residual, more[:, None] * rows)
    return found if moved < _EXACT_M * observed.typical_weight * np.sqrt(len(observed.inputs)) else None


def _refuse_too_few_poses(
    model: Model, data: Measurements, aligned: Array, structure: BaseSet, free: Sequence[int], options: FitOptions
) -> None:
    """Refuse fewer poses than the whole base set needs, where some of it is not identifiable and no prior helps."""
    helped = options.prior == "on" and options.estimator is None
    if helped or len(free) == len(structure.identifiable):
        return
    if len(data) < (needed := poses_needed(model, aligned, structure)):
        raise LabError(
            f"{len(data)} poses, but the {len(structure.identifiable)} identifiable parameters "
            f"need at least {needed}: measure more"
        )


def component_variances(
    observation: Observation, found: Identification, data: Measurements, groups: Sequence[int]
) -> Array:
    """Return the variance ``(g,)`` (m^2) of each group of observed quantities (Foerstner 1979).

    It is the sum of squares of a group's residuals over its own share of the degrees of freedom.

    Args:
        found: of ``observation``, with its units as weights, from ``data``.
        groups: ``(k,)`` the group of each observed quantity, from 0.

    Returns:
        NaN where a group has no degrees of freedom.
    """
    _, jacobian = observation.model.observe(data.inputs(observation.model.conditions), found.values)
    rows = jacobian[..., list(found.fit.free)] / observation.units[:, None, None]
    leverage = ((rows @ found.fit.unit_covariance()) * rows).sum(axis=-1)  # (n, k, d)
    measured, result = seen_mask(data.points), np.full(max(groups) + 1, np.nan)
    for group in range(len(result)):
        part = np.flatnonzero(np.array(groups) == group)
        squares = (found.residuals[:, part] / observation.units[part, None])[measured[:, part]] ** 2
        dof = float((1 - leverage[:, part][measured[:, part]]).sum())
        if dof > 0.5:
            result[group] = squares.sum() / dof
    return result


def _estimated(
    estimator: Estimator,
    observation: Observation,
    observed: Observations,
    structure: BaseSet,
    nominal: Array,
    plain: Fit,
    start: Array,
    options: FitOptions,
    sigma_given: bool,
) -> Fit:
    """Return the fit by an estimator of the parameters that least squares fitted, in units of the noise.

    Raises:
        LabError: the noise is unknown and no residuals are left to estimate it, or there is no valid estimate.
    """
    model, sigma = observation.model, 1.0
    if not sigma_given:
        _, sigma = _residual_sigma(observation, observed, plain)
        if not sigma > _LEAST_SIGMA:
            raise LabError(
                f"estimator '{estimator.name}': least squares leaves no residuals to estimate the noise; give "
                f"{option_name('noise_mm')}"
            )
    # the prior of the parameters, and the measurements in standard deviations of the noise
    free, information = list(plain.free), np.zeros((len(start), len(start)))
    if options.prior != "off":
        prior = prior_of(model, structure, nominal, options.tolerance, links_alone=options.prior == "auto")
        information[np.ix_(prior.of, prior.of)] = prior.whiten.T @ prior.whiten
    scaled = replace(observed, whiten=observed.whiten / sigma)
    problem = EstimationProblem(
        tuple(model.names[i] for i in free),
        start[free],
        information[np.ix_(free, free)],
        root_mean_square_sigma(scaled, observation.positions, observation.units),
        observed.inputs,
        observed.points,
        model,
        scaled,
        plain.free,
        start,
        weighted_constraints(observation, scaled),
    )
    return estimated(estimator, problem, plain, sigma)


@dataclass(frozen=True)
class _MAPFit:
    """A fit in which a prior takes part.

    Attributes:
        sigma: estimated from the residuals, in units of the weights.
        weight: the sigma by which the prior is weighted.
    """

    prior: ActingPrior
    fit: Fit
    dof: int
    sigma: float
    weight: float

    def acts_like(self, other: "_MAPFit | None") -> bool:
        """Check whether two priors act in as many directions, at nearly the same scale."""
        if other is None:
            return False
        same_scale = abs(other.prior.scale / self.prior.scale - 1) < _SETTLED_SCALE
        return self.prior.acts_in == other.prior.acts_in and same_scale


@dataclass(frozen=True)
class _MAPProblem:
    """The measurements of a base set, to be fitted with a prior of its links."""

    observation: Observation
    observed: Observations
    structure: BaseSet
    constraints: ExtraResiduals
    start: Array
    sigma_given: bool

    def requested(self, options: FitOptions, nominal: Array, plain: Fit, dof: int, sigma: float) -> _MAPFit | None:
        """Return the fit with the prior that the options request; None where none takes part.

        Args:
            plain: least squares without a prior; ``dof`` and ``sigma`` are of its residuals.
        """
        if options.prior == "off" or options.solve is not None or options.estimator is not None:
            return None
        model, automatic = self.observation.model, options.prior == "auto"
        prior = prior_of(model, self.structure, nominal, options.tolerance, links_alone=automatic)
        return self.automatically(prior, plain, dof, sigma) if automatic else self.with_whole(prior, dof, sigma)

    def with_whole(self, prior: Prior, dof: int, sigma: float) -> _MAPFit:
        if not (self.sigma_given or np.isfinite(sigma)):
            raise LabError(
                f"{option_name('prior')}: the measurements leave no residuals to estimate the noise; give "
                f"{option_name('noise_mm')}"
            )
        model, weight = self.observation.model, 1.0 if self.sigma_given else sigma
        rows = np.zeros((len(prior.of), len(model.names)))
        rows[:, list(prior.of)] = prior.whiten
        acting = ActingPrior(model.names, prior.mean, rows, 1.0, 0, len(rows), float("nan"), automatic=False)
        columns_of_fit = self.structure.identifiable
        solution = self._fitted(acting, weight, columns_of_fit, self.start)
        acting = replace(acting, plain_condition=scaled_condition(self._linear(columns_of_fit, solution.values)[0]))
        return _MAPFit(acting, solution, dof, sigma, weight)

    def automatically(self, prior: Prior, plain: Fit, dof: int, sigma: float) -> _MAPFit | None:
        """Fit with the prior along weakly observable directions; None where there are none.

        Directions, sigma and scale are taken at the fit that they lead to, and so found in a few rounds.

        Args:
            dof, sigma: of its residuals; a sigma of NaN where nothing is left over.
        """
        usable = plain.status == "converged"
        if needs_no_prior(prior, plain, self.structure, sigma, sigma_given=self.sigma_given):
            return None
        columns = tuple(i for i in self.structure.identifiable if i in plain.free or i in prior.of)
        values, earlier, known = self._beginning(plain, columns)
        best: _MAPFit | None = None
        for _ in range(_PRIOR_ROUNDS):
            # the directions in which the measurements determine less than the prior, at its likeliest scale
            weight = _prior_weight(sigma, sigma_given=self.sigma_given)
            acting, directions = self._acting(prior, known, columns, values, weight)
            if not acting.acts_in:
                return best
            # the fit with the prior along these
            near, moved = _with_prior(known, values, acting.rows(weight))
            solution = self._fitted(acting, weight, columns, near)
            solution = replace(solution, cost_trace=(*earlier, *solution.cost_trace))  # all steps that led there
            if solution.status != "converged" and (usable or best is not None):
                return best
            if not usable:
                left = directions.left_by_prior(acting.scale)
                dof, sigma = _residual_sigma(self.observation, self.observed, solution, left)
            before, best = best, _MAPFit(acting, solution, dof, sigma, weight)
            values, earlier, known = solution.values, solution.cost_trace[:-1], None
            if moved < self._unmoved * weight or best.acts_like(before):
                break
        return best

    def _beginning(self, plain: Fit, columns: Sequence[int]) -> tuple[Array, tuple[float, ...], Fit | None]:
        """Return where the fit begins, the costs of the steps before, and the fit of these columns that ended there."""
        if plain.status != "converged":
            return self.start, (), None
        return plain.values, plain.cost_trace[:-1], plain if set(columns) == set(plain.free) else None

    @property
    def _unmoved(self) -> float:
        """Whitened norm, in units of the noise, of a move of the predictions that changes no direction's weight."""
        return _UNMOVED * float(np.sqrt(seen_mask(self.observed.points).sum()))

    def _acting(
        self, prior: Prior, known: Fit | None, columns: Sequence[int], values: Array, weight: float
    ) -> tuple[ActingPrior, PriorDirections]:
        """Return the prior along the directions that are weakly observable at some values, and all directions.

        Args:
            known: the converged fit of these columns that ended at ``values``; None where there is none.
        """
        if known is None:
            triangle, right = self._linear(columns, values)
        else:
            columns, triangle, right = known.free, known.triangle * known.scale, np.zeros(len(known.free))
        directions = directions_of(prior, triangle / weight, right / weight, columns, values)
        scale, scale_from = directions.scale()
        weak = directions.weak(scale)
        acting = ActingPrior(
            names=self.observation.model.names,
            mean=prior.mean,
            rows_by_parameter=directions.by_parameter[weak] / scale,
            scale=scale,
            scale_from=scale_from,
            directions=len(weak),
            plain_condition=scaled_condition(np.delete(triangle, _sizes(self.observation.model, columns), axis=1)),
        )
        return acting, directions

    def _fitted(self, acting: ActingPrior, weight: float, columns: Sequence[int], start: Array) -> Fit:
        extra = joined(self.constraints, acting.rows(weight))
        model = self.observation.model
        return _canonical(model, fit(model, self.observed, columns, start, extra_residuals=extra))

    def _linear(self, columns: Sequence[int], values: Array) -> tuple[Array, Array]:
        """R ``(r, c)`` of the measurements' whitened rows and the constraints, and Q'r ``(r,)`` of their residuals."""
        index, more = list(columns), self.constraints(values)

        def parts() -> Iterator[Array]:
            for each in self.observed.blocks():
                points, slopes = self.observation.model.observe(each.inputs, values)
                yield np.column_stack([each.apply(slopes[..., index]), each.apply(each.points - points)])
            yield np.column_stack([more[1][:, index], more[0]])

        both = triangle_of(parts())
        return both[: len(index), :-1], both[: len(index), -1]


def _with_prior(found: Fit | None, values: Array, prior: ExtraResiduals) -> tuple[Array, float]:
    """Return the parameters ``(p,)`` with a prior beside a fit, to first order, and how far that moves predictions.

    Without a fit, ``values`` and infinity.
    """
    if found is None:
        return values, np.inf
    beside, moved = found.beside(*prior(found.values))
    return beside.values, moved


def _sizes(model: Model, columns: Sequence[int]) -> tuple[int, ...]:
    """Return which of some columns are sizes of artefacts with a prior."""
    each = [model.parameters[i] for i in columns]
    return tuple(k for k, size in enumerate(each) if size.group == SIZE and np.isfinite(size.scale))


def needs_no_prior(prior: Prior, plain: Fit, structure: BaseSet, sigma: float, *, sigma_given: bool) -> bool:
    """Check whether a fit stays as it is: nothing has a prior, or all directions are determined better than by it.

    Where neither noise is given nor residuals are left, a prior has no weight.

    Args:
        plain: least squares without a prior; ``sigma`` is of its residuals, in units of the weights.
    """
    if not prior.of or not (sigma_given or sigma > 0):
        return True
    if plain.status != "converged" or set(plain.free) != set(structure.identifiable):
        return False
    weight = _prior_weight(sigma, sigma_given=sigma_given)
    if condition_bound(plain.triangle) < WELL_CONDITIONED:
        links = [plain.free.index(i) for i in prior.of]
        if prior.knows_less(weight**2 * plain.unit_covariance()[np.ix_(links, links)]):
            return True
    triangle = plain.triangle * plain.scale / weight
    directions = directions_of(prior, triangle, np.zeros(len(triangle)), plain.free, plain.values)
    return not directions.weak(directions.scale()[0]).any()


def _prior_weight(sigma: float, *, sigma_given: bool) -> float:
    """Return the sigma by which a prior is weighted: where given, more if the residuals are."""
    if sigma_given:
        return max(sigma, 1.0) if np.isfinite(sigma) else 1.0
    return max(sigma, _LEAST_SIGMA)


def _refuse_impossible_or_few(
    observation: Observation, data: Measurements, observed: Observations, nominal: Array
) -> None:
    """Refuse poses at which the nominal loops do not close, and fewer points than place a base."""
    missing = np.isnan(observation.model.points(observed.inputs, nominal)) & np.isfinite(observed.points)
    if (impossible := np.flatnonzero(missing.any(axis=(1, 2)))).size:
        raise LabError(
            f"{len(impossible)} of {len(data)} measured poses are impossible for the nominal robot, "
            f"{data.where(int(impossible[0]))} "
            "the first: its loops do not close there; mend the joint positions, or leave the pose out"
        )
    if why := few_points_of_a_station(observation.model, data):
        raise LabError(why)
    if (count := int(data.seen.sum())) < 3:
        needed = poses_needed(observation.model, nominal)
        raise LabError(f"{count} measured points: too few to place a base; measure at least {needed} poses")


def _residual_sigma(
    observation: Observation, observed: Observations, solution: Fit, by_prior: float = 0.0
) -> tuple[int, float]:
    """Return the residual degrees of freedom, and sigma by the least-squares residuals; NaN if none are left over.

    Args:
        by_prior: degrees of freedom of the parameters that a prior determines in the place of the measurements.
    """
    white = observed.apply(observed.points - observation.model.points(observed.inputs, solution.least_squares))
    constraints = weighted_constraints(observation, observed)(solution.values)[0]
    dof = len(white) + len(constraints) - len(solution.free)
    dof += int(by_prior)
    return dof, float(np.sqrt(white @ white / dof)) if dof > 0 else float("nan")


def _identifiable(
    model: Model, observed: Observations, aligned: Array, structure: BaseSet, prior_rows: Array
) -> tuple[int, ...]:
    identifiable, at = set(structure.identifiable), model.rank_point(aligned)
    order = [i for i in model.column_priority() if i in identifiable]
    few = observed.thinned(_FIRST_POSES)
    for some in (few, observed):
        parts = (model.observe(each.inputs, at)[1][each.seen].reshape(-1, len(model.names)) for each in some.blocks())
        rows = np.concatenate([next(parts) if some.in_one_block else triangle_of(parts), prior_rows])
        columns = independent_columns(rows, order)
        if some is observed or len(columns) == len(identifiable):
            break
    return columns


def _canonical(model: Model, solution: Fit) -> Fit:
    """Limit the rotation vectors of frames to at most half a turn each, and transform their covariance."""
    for turning in frame_rotations(model.parameters):
        solution = _with_shortest_turn(solution, turning)
    return solution


def _with_shortest_turn(solution: Fit, turning: list[int]) -> Fit:
    """Limit one rotation vector, at these indices, to at most half a turn.

    Two vectors r and s of one rotation change it alike where J_l(r) dr = J_l(s) ds.
    """
    values = _shortest_turn(solution.values, turning)
    other = solution.other
    if other is not None:
        other = replace(other, least_squares=_shortest_turn(other.least_squares, turning))
    if np.abs(values - solution.values).max() <= 1.0:
        return replace(solution, values=values, other=other)
    if not set(turning) <= set(solution.free):  # held in part: another vector is another rotation
        return solution
    at = [solution.free.index(i) for i in turning]
    old, new = (se3.left_jacobian(v[turning]) for v in (solution.values, values))
    jacobian = solution.triangle * solution.scale
    jacobian[:, at] = jacobian[:, at] @ np.linalg.solve(old, new)
    scale = np.linalg.norm(jacobian, axis=0)
    triangle = np.asarray(np.linalg.qr(jacobian / scale, mode="r"))
    if other is not None:
        change = np.eye(len(solution.free))
        change[np.ix_(at, at)] = np.linalg.solve(new, old)
        other = replace(other, covariance=change @ other.covariance @ change.T)
    return replace(solution, values=values, triangle=triangle, scale=scale, other=other)


def _shortest_turn(values: Array, turning: list[int]) -> Array:
    """Parameters ``(p,)`` whose rotation vector, at these indices, is the same rotation by at most half a turn."""
    if values[turning] @ values[turning] <= np.pi**2:
        return values
    same = values.copy()
    same[turning] = se3.log(se3.exp(values[turning]))
    return same


def _relative_spread(observation: Observation, observed: Observations, aligned: Array, nominal: Array) -> float:
    """Return the spread of the measured points over that of the nominal model with its tool in the same poses.

    Fixtures are placed anew for that tool: those that were placed with another one would be elsewhere for it.
    """
    if isinstance(observation, UnscaledObservation) and observation.spreads_freely:
        return 1.0
    values, tool = aligned.copy(), list(columns_of(observation.model, ("tool",)))
    values[tool] = nominal[tool]
    if "tool" in observation.placed and "base" not in observation.placed:
        values = observation.initial_guess(observed, values)
    compared = observed.points[:, : observation.positions or None]
    predicted = observation.model.points(observed.inputs, values)[:, : observation.positions or None]
    if not (observation.positions or np.nan_to_num(compared).any()):  # places are touched: only zeros are observed
        return 1.0
    return spread(compared) / spread(np.where(np.isnan(compared), np.nan, predicted))


def spread(points: Array) -> float:
    """Return the root mean square distance (m) of points from their mean, NaN left out."""
    visible = points[seen_mask(points)]
    off = visible - visible.mean(axis=0)
    return float(np.sqrt(np.vdot(off, off) / len(off)))


def _checks(found: Identification) -> list[Check]:
    checks, steps, names = list[Check](), found.fit.iterations, found.model.names
    weak = [*found.weak[:_MOST_NAMED], *(["others"] if len(found.weak) > _MOST_NAMED else [])]
    if found.status == "in a valley":
        checks.append(Check("convergence.valley", "failed", data={"iterations": steps, "weak": weak}))
    elif found.status != "converged":
        checks.append(Check("convergence.failed", "failed", data={"iterations": steps}))
    if unobservable := [names[i] for i in found.unobservable]:
        checks.append(Check("parameters.unobservable", "failed", data={"parameters": unobservable}))
    elif found.status != "in a valley" and found.fit.ill_conditioned:
        data = {"weak": weak, "with_prior": found.prior is not None}
        checks.append(Check("parameters.condition", "failed", found.fit.condition, data=data))
    return checks
