"""Score candidate models of one set of measurements: all that groups of parameters make.

Near a solution every nested model is linear. One orthogonal factorization of the large model's whitened Jacobian beside
the residual holds each nested one's sum of squares, and one for each fold the predictions of the other poses.

A wave of which less than half lies in its joint's measured range looks like a slope and a curvature there, and
diverges outside of it together with other slow waves. So such a wave is fitted only where it is determined as surely as
a wave of a gear, and so is a ratio, the slope itself.

Groups of single joints or links, of which there are hundreds, are searched on the linearized problem: all are tried by
how much of the residual they explain beyond what is fitted (the score test), the best is taken, and so on (orthogonal
matching pursuit: Pati, Rezaiifar & Krishnaprasad 1993). The level is that of the whole search. The largest fall of the
squares by chance is found by flipping the signs of whole configurations' residuals (Hemerik, Goeman & Finos 2020), so
the level holds also for joint scatter, heavy tails and variances that differ over the workspace.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.calibration.fit_options import FitOptions
from lab.calibration.gauss_newton import RANK_TOLERANCE, ExtraResiduals, Observations
from lab.calibration.identification import WEAK, Identification, identify
from lab.calibration.observation import Observation, WeighsPriors, observation_of
from lab.calibration.prior import prior_of
from lab.calibration.row_groups import configurations, cv_groups_of, folds
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.calibration.statistics.linearized import ClusteredRows, ClusterTest, cluster_sums, clusters_first, jackknifed
from lab.calibration.weights import Noise, constraint_rows, joined, weigh, weighted_constraints
from lab.core.errors import LabError, option_name
from lab.core.linear_model import least_squares, p_value_of_squares, unit_columns
from lab.core.measurements import Measurements
from lab.core.probability import t_sf
from lab.core.random import rng_for
from lab.core.recent import recent
from lab.core.se3 import Array
from lab.core.significance import TERM_SEARCH
from lab.core.values import Deferred, DeferredField
from lab.kinematics.effects.effect import PAYLOAD, Effect, Wave
from lab.kinematics.gauge import STRUCTURE_POSES, base_set, independent_columns, named
from lab.kinematics.model import Model
from lab.kinematics.parameter import Kind, Parameter, names_of

__all__ = [
    "LEAST_SIGMA_M",
    "TELLING",
    "FoundTerm",
    "FullModel",
    "HeldOutGain",
    "ModelWith",
    "NestedModels",
    "NominalOf",
    "Score",
    "SelectionTask",
    "TermSearch",
    "TermTable",
    "largest_useful_std",
]

_Labels = NDArray[np.int_]


@dataclass(frozen=True)
class Score:
    """Score of a nested model.

    Attributes:
        errors: ``(m,)`` lengths (m) of held-out errors, one per observed thing.
        bic: Bayes' information criterion (Schwarz 1978), lower is better.
    """

    parameters: int
    squares: float
    errors: DeferredField[Array] = DeferredField()  # noqa: RUF009
    bic: float = float("nan")


@dataclass(frozen=True)
class HeldOutGain:
    """Estimate how far the error at held-out configurations falls, each configuration counted once.

    Attributes:
        dof: of that standard error: configurations less one.
    """

    mean_m: float
    std_m: float
    dof: int

    @property
    def p(self) -> float:
        """The chance of as large a gain if there is none: Student's t, one-sided."""
        if self.dof < 1 or not self.std_m > 0:
            return 1.0
        return float(t_sf(self.mean_m / self.std_m, self.dof))


@dataclass(frozen=True)
class NestedModels:
    """The large model, linearized.

    Attributes:
        columns: the parameters (of the large model) that some nested model fits, c of them.
        scale: ``(c,)`` the norms that their columns had.
        away: ``(c,)`` how far each of them, scaled, stands from its nominal value, which it has where it is not fitted.
        whole: ``(<= c + 1, c + 1)`` triangle of the scaled whitened Jacobian and, last, the residual.
        parts: ``(<= c + 1, c + 1)`` triangles of each fold's own rows.
        beside: rows of what is known beside the measurements, in every fold.
        held: ``(m_f, d, c + 1)`` of each fold: derivatives and residual of its things, in m.
        cluster: ``(m,)`` what each thing of the folds, one after the other, was held out together with.
        floor: the least standard deviation that a whitened residual may have: 1 where sigma is known.
        witnesses: the scaled rows themselves, residual last, by the poses whose errors may go together.
    """

    columns: tuple[int, ...]
    scale: Array
    away: Array
    whole: Array
    parts: tuple[Array, ...]
    beside: Array
    held_out: tuple[Array, ...]
    cluster: _Labels
    rows: int
    floor: float
    witnesses: ClusteredRows

    def score(self, fitted: Sequence[int]) -> Score:
        """Score the nested model that fits these columns, held-out errors predicted from the other folds.

        BIC = N log s^2 + RSS / s^2 + p log N, with s^2 = RSS / N but never below what the noise is known to be:
        the likelihood's maximum under that bound, so that a sigma given too small does not let every column in.
        """
        squares = float(np.sum(self._left(self.whole, fitted).left ** 2))
        errors = Deferred(partial(self._held_out_errors, fitted))
        return Score(len(fitted), squares, errors, self._bic(squares, len(fitted)))

    @cached_property
    def training(self) -> tuple[Array, ...]:
        """Triangles as ``whole`` of all folds but one each."""
        others = ((*self.parts[:fold], *self.parts[fold + 1 :]) for fold in range(len(self.parts)))
        return tuple(_triangle([*rest, self.beside]) for rest in others)

    def _held_out_errors(self, fitted: Sequence[int]) -> Array:
        lengths = [
            np.linalg.norm(left_out @ self._left(triangle, fitted).weights, axis=1)
            for triangle, left_out in zip(self.training, self.held_out, strict=True)
        ]
        return np.concatenate(lengths)

    def bic_without(self, fitted: Sequence[int], parts: Sequence[Sequence[int]]) -> Array:
        """BIC of the models that fit these columns less one of the parts each, as by ``score``, all at once.

        What holding a part b at its nominal value adds to the squares is d' (C_bb)^-1 d, with d how far the fit moves
        it from there and C the covariance of unit noise (Seber & Lee 2003, section 4.3).
        """
        index = self._places(fitted)
        weights, left, back = self._left(self.whole, fitted)
        moved = self.away[index] - weights[index]
        found = []
        for part in parts:
            own = [k for k, i in enumerate(fitted) if i in part]
            rise = moved[own] @ np.linalg.lstsq(back[own] @ back[own].T, moved[own], rcond=None)[0]
            squares = float(left @ left + rise)
            found.append(self._bic(squares, len(index) - len(own)))
        return np.array(found)

    def _bic(self, squares: float, parameters: int) -> float:
        variance = max(squares / self.rows, self.floor**2)
        return float(self.rows * np.log(variance) + squares / variance + parameters * np.log(self.rows))

    def std(self, fitted: Sequence[int]) -> Array:
        """Standard deviations of the parameters that are fitted; of noise as large as the residuals, or as is known."""
        index = self._places(fitted)
        _, left, back = self._left(self.whole, fitted)
        variance = max(float(left @ left) / max(self.rows - len(index), 1), self.floor**2)
        std: Array = np.sqrt(variance * (back**2).sum(axis=1)) / self.scale[index]
        return std

    def p_value(self, small: Score, big: Score) -> float:
        """Return the p-value of the fall in squares from ``small`` to ``big``.

        The larger of the F-test's and of the chi squared test's by the known sigma (Seber & Lee 2003, section
        4.3): a sigma given too small makes the second one far too sure, and one that says that the smaller model
        is adequate already must not be overruled by the first.
        """
        added, dof = big.parameters - small.parameters, self.rows - big.parameters
        fall = max(small.squares - big.squares, 0.0)
        by_noise = p_value_of_squares(fall, added, variance=self.floor**2)
        by_residuals = p_value_of_squares(fall, added, dof, max(big.squares / dof, 1e-300))
        return float(max(by_noise, by_residuals))

    def test_by_configurations(self, fitted: Sequence[int], added: Sequence[int]) -> ClusterTest | None:
        """Test what columns explain beyond those fitted, with errors that are correlated within a configuration.

        Unlike ``p_value`` it does not take the targets or repeats of a pose for independent; None where there is one
        of each, as there is nothing to allow for.
        """
        if not self.witnesses.shared:
            return None
        return self.witnesses.test(self._places(fitted), self._places(added))

    def gain(self, before: Score, after: Score) -> HeldOutGain:
        """Return the paired fall of the held-out error: a configuration counts once, however often it was measured."""
        count = np.bincount(self.cluster)
        fall = (np.bincount(self.cluster, before.errors - after.errors) / np.maximum(count, 1))[count > 0]
        spread = float(fall.std(ddof=1)) if len(fall) > 1 else 0.0
        return HeldOutGain(float(fall.mean()), spread / np.sqrt(len(fall)), len(fall) - 1)

    @cached_property
    def _place(self) -> dict[int, int]:
        return {parameter: place for place, parameter in enumerate(self.columns)}

    def _places(self, parameters: Sequence[int]) -> list[int]:
        """Return the columns of parameters."""
        return [self._place[i] for i in parameters]

    def _left(self, triangle: Array, fitted: Sequence[int]) -> "_Nested":
        """Fit these columns of a triangle, the others at their nominal values."""
        index = self._places(fitted)
        weights = np.append(self.away, 1.0)
        weights[index] = 0.0
        solution, back = least_squares(triangle[:, index], (triangle @ weights)[:, None], RANK_TOLERANCE)
        weights[index] = -solution[:, 0]
        return _Nested(weights, triangle @ weights, back)


class _Nested(NamedTuple):
    """The fit of a nested model.

    Attributes:
        weights: ``(c + 1,)`` of columns and residual in what is left.
        left: what is left of the triangle's rows.
        back: ``(f, r)`` from an orthonormal basis of the fitted columns to their parameters.
    """

    weights: Array
    left: Array
    back: Array


def _triangle(parts: Sequence[Array]) -> Array:
    return np.asarray(np.linalg.qr(np.concatenate(parts), mode="r"))


TELLING = 1e-4  # rad or m: a less certain effect of one joint is not used beyond the measured poses
_USEFUL: dict[Kind, float] = {"ratio": TELLING, "compliance": 1e-4, "section": 1e-4, "mass": 1.0}  # else WEAK
_SUPPORTED = 0.5  # of a wave's length, in the measured range


def largest_useful_std(parameters: Sequence[Parameter], joints: Array) -> Array:
    """Return the largest standard deviation ``(p,)``, in each one's unit, with which it is worth fitting.

    Args:
        joints: ``(n, joints)`` measured positions (rad, m of a slide).
    """
    turns = np.ptp(joints, axis=0) / (2 * np.pi)
    return np.array([TELLING if _is_slow(each, turns) else _USEFUL.get(each.kind, WEAK) for each in parameters])


def _is_slow(wave: Parameter, turns: Array) -> bool:
    """Check whether less than half of a parameter's wave lies in the measured range, ``(joints,)`` turns."""
    turning = wave.joint if wave.turning is None else wave.turning
    return bool(wave.wave and turning is not None and wave.wave * turns[turning] < _SUPPORTED)


LEAST_SIGMA_M = 1e-9  # a sigma below which residuals are those of the fit's arithmetic

ModelWith = Callable[[Sequence[str]], Model]
NominalOf = Callable[[Model], Array]


@dataclass(frozen=True)
class SelectionTask:
    """Identification task of a model selection, common to all models.

    Attributes:
        model_with: the arm with groups of effects, by name; a LabError where a group cannot be built.
    """

    model_with: ModelWith
    nominal_of: NominalOf
    data: Measurements
    noise: Noise
    options: FitOptions

    def identified(
        self, groups: Sequence[str], fixed: Sequence[str] = (), near: Identification | None = None
    ) -> Identification:
        """Identify with these groups less the parameters held; requests for other groups are left out."""
        model = self.model_with(groups)
        options = self.options.of(observation_of(model).within(self.data).model.names)
        start = {} if near is None else dict(zip(near.model.names, near.values.tolist(), strict=True))
        also_fixed = replace(options, fix=(*options.fix, *fixed), near=start, estimator=None)
        return identify(model, self.data, self.nominal_of(model), self.noise, also_fixed)

    def refusal(self, group: str) -> LabError | None:
        """Return the reason why a group cannot be tried; None if it can."""
        try:
            self.data.inputs(observation_of(self.model_with([group])).model.conditions)
        except LabError as error:
            return error
        return None

    def refuse_unknown_wishes(self, groups: Sequence[str]) -> None:
        """Refuse patterns that match no parameter of geometry or of groups that can be built."""
        if not (self.options.fix or self.options.free):
            return
        names: dict[str, None] = {}
        for group in ([], *([name] for name in groups)):
            with suppress(LabError):
                names |= dict.fromkeys(observation_of(self.model_with(group)).within(self.data).model.names)
        for option, patterns in ((option_name("fix"), self.options.fix), (option_name("free"), self.options.free)):
            named(tuple(names), option, patterns)

    def parameters(self, group: str) -> set[str]:
        """Names of those that a group adds."""
        with_it, without = (observation_of(self.model_with(g)).within(self.data).model.names for g in ([group], []))
        return set(with_it) - set(without)

    def derivatives(self, group: str, near: Identification) -> Array:
        """Derivatives ``(n, k, d, p)`` of what is observed by a group's parameters, near a model without it.

        Raises:
            LabError: the group cannot be built, or lacks a column.
        """
        made = self.model_with([group])
        observation = observation_of(made).within(self.data)
        model = observation.model
        values = _filled(observation.nominal(self.nominal_of(made)), model, near.model, near.values)
        own = [i for i, name in enumerate(model.names) if name not in near.model.names]
        inputs = weigh(observation, self.data, self.noise)[0].inputs
        return np.asarray(model.observe(inputs, values)[1][..., own])


@dataclass(frozen=True)
class FullModel:
    """The model with all groups that can be tried, in which every other one is nested.

    Attributes:
        observed: the measurements as the model's observation has them, weighted.
        groups: indices of each one's parameters, less those to be held on request.
        structure, measured: triangles of its Jacobian at the nominal model, over all its limits and at the
            measured poses.
        folds, clusters: ``(n,)`` labels: rows of a fold, and rows that are held out as one.
        configurations: ``(n,)`` labels: rows of one pose, whose errors may go together.
        loads: ``(n,)`` payloads (kg); zero where none is said.
        extra_residuals: what is known beside the measurements, a prior too.
        floor: the least standard deviation of a whitened residual.
    """

    observation: Observation
    start: Array
    observed: Observations
    groups: dict[str, tuple[int, ...]]
    structure: Array
    measured: Array
    folds: _Labels
    clusters: _Labels
    configurations: _Labels
    loads: Array
    extra_residuals: ExtraResiduals
    floor: float

    @classmethod
    def of(cls, task: SelectionTask, groups: Sequence[str], alone: Identification, seed: int) -> "FullModel":
        """Build the full model, linearized with the base and the tool of geometry alone."""
        # the model with all groups, and its measurements
        made = task.model_with(groups)
        observation = observation_of(made).within(task.data)
        if isinstance(observation, WeighsPriors) and isinstance(alone.model, WeighsPriors):
            observation = observation.weighed(alone.model.sigma)
        model, start = observation.model, observation.nominal(task.nominal_of(made))
        observed, known = weigh(observation, task.data, task.noise)
        # its Jacobian at the nominal arm, anywhere and at the measured poses
        at = model.rank_point(_filled(start, model, alone.model, alone.nominal_aligned))
        anywhere = model.structure_joints(STRUCTURE_POSES, rng_for(0, "structure"))
        both = model.observe(np.concatenate([anywhere, observed.inputs]), at)[1]
        structure, measured = both[: len(anywhere)], both[len(anywhere) :]
        prior_rows = constraint_rows(observation, observed, at)
        # the parameters of each group
        fixed = named(model.names, option_name("fix"), task.options.of(model.names).fix)
        own = {name: task.parameters(name) for name in groups}
        # what is known beside the measurements
        clusters, sigma = cv_groups_of(made, task.data), 1.0 if known else alone.sigma_m
        prior = weighted_constraints(observation, observed)
        if task.options.prior == "on":
            base = base_set(model, at, prior_rows=prior_rows)
            prior = joined(prior, prior_of(model, base, start, task.options.tolerance).rows(sigma))
        elif task.options.prior == "auto" and alone.prior is not None:  # an automatic one is geometry's alone
            prior = joined(prior, alone.prior.rows(sigma, model.names))
        return cls(
            observation=observation,
            start=start,
            observed=observed,
            groups={
                name: tuple(i for i, parameter in enumerate(model.names) if parameter in own[name] and i not in fixed)
                for name in groups
            },
            structure=_triangle([structure.reshape(-1, len(model.names)), prior_rows]),
            measured=_triangle([measured[observed.seen].reshape(-1, len(model.names)), prior_rows]),
            folds=folds(clusters, seed),
            clusters=clusters,
            configurations=configurations(task.data.joints),
            loads=np.nan_to_num(task.data.conditions.get(PAYLOAD, np.zeros(len(task.data)))),
            extra_residuals=prior,
            floor=1.0 if known else LEAST_SIGMA_M,
        )

    @cached_property
    def least_rows(self) -> int:
        """Numbers that the largest fold leaves to fit, repeats of a configuration under one load counted once.

        None where there is one fold only.
        """
        states = np.unique(np.column_stack([self.configurations, self.loads]), axis=0, return_inverse=True)[1]
        seen = np.zeros((states.max(initial=-1) + 1, self.observed.seen.shape[1]), dtype=np.bool_)
        np.logical_or.at(seen, states, self.observed.seen)
        first = np.unique(states, return_index=True)[1]
        sizes = np.bincount(self.folds[first], seen.sum(axis=1) * self.observed.points.shape[2])
        return int(sizes.sum() - sizes.max())

    def around(self, found: Identification) -> NestedModels:
        """Return all nested models near an identified one."""
        # the parameters that some nested model fits, and where the others are fixed
        observation, observed = self.observation, self.observed
        values = _filled(self.start, observation.model, found.model, found.values)
        effects = [i for group in self.groups.values() for i in group]
        columns = sorted({*self.fitted(found), *effects})
        nominal = np.array([self.start[i] if i in effects else values[i] for i in columns])
        count = int(self.folds.max()) + 1
        # whitened derivatives and, last, residuals, in unit columns
        predicted, jacobian = observation.model.observe(observed.inputs, values)
        both = np.concatenate([jacobian[..., columns], (observed.points - predicted)[..., None]], axis=3)
        rows, mask = observed.apply(both), observed.seen
        scale = np.append(np.linalg.norm(rows[:, :-1], axis=0), 1.0)
        scale[scale == 0] = 1.0
        residual, slopes = self.extra_residuals(values)
        beside = np.column_stack([slopes[:, columns], residual]) / scale
        # triangles of each fold's rows, and the rows themselves in m, which the other folds predict
        fold = np.repeat(self.folds[np.nonzero(mask)[0]], observed.points.shape[2])
        parts = [_triangle([rows[fold == f] / scale]) for f in range(count)]
        in_m = (both / observation.units[:, None, None])[:, : observation.positions or None]
        inside = [mask[:, : in_m.shape[1]] & (self.folds == f)[:, None] for f in range(count)]
        return NestedModels(
            columns=tuple(columns),
            scale=scale[:-1],
            away=(values[columns] - nominal) * scale[:-1],
            whole=_triangle([*parts, beside]),
            parts=tuple(parts),
            beside=beside,
            held_out=tuple(in_m[part] / scale for part in inside),
            cluster=np.concatenate([self.clusters[np.nonzero(part)[0]] for part in inside]),
            rows=len(rows) + len(residual),
            floor=self.floor,
            witnesses=ClusteredRows.of(
                np.concatenate([rows / scale, beside]), self.configurations[np.nonzero(mask)[0]], both.shape[2]
            ),
        )

    def fitted(self, found: Identification) -> tuple[int, ...]:
        """Return the parameters that an identification fitted, as indices of this model."""
        return self._indices(found, found.fit.free)

    def added(self, table: NestedModels, found: Identification, group: str) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Return the parameters of a group that add to an identified model, and those of them to be fitted.

        Left out are those that are not identifiable in these poses, and, the least certain first, those whose standard
        deviation would be larger than such an effect: fitted all the same, they run off to where the model is not
        linear, for nothing.
        """
        fitted = self.fitted(found)
        new = self._new(self.structure, self._indices(found, found.base_set.identifiable), self.groups[group])
        shown = list(self._new(self.measured, fitted, new))
        while shown:
            unsure = table.std([*fitted, *shown])[len(fitted) :] / self._useful[shown]
            if unsure.max() <= 1:
                break
            del shown[int(unsure.argmax())]
        return new, tuple(shown)

    def most_uncertain(self, table: NestedModels, found: Identification) -> int | None:
        """Return the parameter of a group that is too uncertain in an identified model; None if there is none."""
        fitted = self.fitted(found)
        effects = {i for group in self.groups.values() for i in group}
        unsure = np.where([i in effects for i in fitted], table.std(fitted) / self._useful[list(fitted)], 0.0)
        return fitted[int(unsure.argmax())] if unsure.max(initial=0.0) > 1 else None

    @cached_property
    def _useful(self) -> Array:
        joints = self.observed.inputs[:, : self.observed.inputs.shape[1] - len(self.observation.model.conditions)]
        return largest_useful_std(self.observation.model.parameters, joints)

    def _indices(self, found: Identification, parameters: Sequence[int]) -> tuple[int, ...]:
        names = self.observation.model.names
        return tuple(names.index(found.model.names[i]) for i in parameters)

    @staticmethod
    def _new(triangle: Array, known: Sequence[int], wanted: Sequence[int]) -> tuple[int, ...]:
        independent = independent_columns(triangle, [*known, *wanted])
        return tuple(i for i in wanted if i in independent)


def _filled(start: Array, model: Model, source: Model, values: Array) -> Array:
    """``start`` with the values that another model has for the same names."""
    known = dict(zip(source.names, values, strict=True))
    return np.array([known.get(name, value) for name, value in zip(model.names, start, strict=True)])


_FLIPS = 999  # of signs: the level is exact for so many and one
_FLIPS_AT_ONCE = 128  # whose falls stay in the processor's cache
_STAGE = 8  # groups that are taken before all others are looked at anew
_POOL = 48  # groups that a stage chooses from
_PRIOR_ERROR = 3.0  # standard deviations: the largest error of a prior
_LEFT = 1e-3  # share of a column's squares that what is fitted has to leave
_TIE = 1e-3  # share of a fall by which groups that are equivalent beside geometry differ: the table's first is taken
_ONE_COLUMN = 1e-9  # share of their squares that two columns have apart, where they are one
_APART = 1e-3  # share of the squares that two columns of a group have apart


@dataclass(frozen=True)
class FoundTerm:
    """A group that the search takes.

    Attributes:
        p: the chance of as large a fall by noise alone, were it the only group that is tried.
    """

    name: str
    p: float


@dataclass(frozen=True)
class TermTable:
    """Effects of each group on the joints, or on the far ends of links, at some poses.

    Attributes:
        functions: ``(n, p)`` rad or m a unit of each of their parameters.
        motion: ``(p,)`` what that moves: a joint, from 0, or, beyond the joints, one of six motions of each link's far
            end.
        owner: ``(p,)`` the group that each parameter is of; one has one parameter or two.
        parameters: the names of each group's parameters.
    """

    names: tuple[str, ...]
    functions: Array
    motion: NDArray[np.int_]
    joints: int
    owner: NDArray[np.int_]
    parameters: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, effects: Mapping[str, Effect], data: Measurements) -> "TermTable":
        """Build from effects that are linear in their parameters, each of which moves one joint or one link's end."""
        size = data.joints.shape[1]
        layout = _layout(effects, size)
        functions, motion = np.empty((len(data), len(layout.owner))), layout.motion.copy()
        functions[:, layout.of_waves] = Wave.together(layout.waves, data.joints).reshape(len(data), -1)
        for own, first, effect in layout.others:
            conditions = data.inputs(effect.conditions)[:, size:]
            moved = effect.offsets(data.joints, conditions, np.zeros(len(effect.parameters)))[1]
            component = np.abs(moved).sum(axis=0).argmax(axis=0)
            functions[:, own] = moved[:, component, range(len(own))]
            motion[own] = first + component
        return cls(tuple(effects), functions, motion, size, layout.owner, layout.parameters)

    @cached_property
    def showing_ends(self) -> dict[int, int]:
        """First group with each motion of a link's end, by motion."""
        found: dict[int, int] = {}
        for column in np.flatnonzero(self.motion >= self.joints).tolist():
            found.setdefault(int(self.motion[column]), int(self.owner[column]))
        return found

    def slopes(self, model: Model, with_ends: Model, observed: Observations, values: Array) -> Array:
        """Derivatives ``(n, k, d, motions)`` of what is observed by each motion; zero where no group has it.

        Args:
            with_ends: the model with the groups ``showing_ends`` beside, whose columns are a motion times waves: they
                give the motion by least squares, pose by pose.
            values: ``(p,)`` of the model.
        """
        by_joints = by_joint_positions(model, observed.inputs, values, self.joints)
        if not self.showing_ends:
            return by_joints
        start = dict(zip(model.names, values.tolist(), strict=True))
        at = np.array([start.get(name, 0.0) for name in with_ends.names])
        jacobian = with_ends.observe(observed.inputs, at)[1]
        slopes = np.zeros((*by_joints.shape[:3], max(self.showing_ends) + 1))
        slopes[..., : self.joints] = by_joints
        for motion, group in self.showing_ends.items():
            functions = self.functions[:, self.owner == group]
            columns = jacobian[..., [with_ends.names.index(name) for name in self.parameters[group]]]
            weights = functions / (functions**2).sum(axis=1, keepdims=True)
            slopes[..., motion] = np.einsum("nkdp,np->nkd", columns, weights)
        return slopes


class _Layout(NamedTuple):
    """Where the functions of a table's groups are, whatever the poses.

    Attributes:
        waves: the groups that are waves, whose columns are ``of_waves``, two each.
        others: columns, first motion and effect of each other group.
        motion: as of the table, for the waves.
    """

    waves: tuple[Wave, ...]
    of_waves: NDArray[np.int_]
    others: tuple[tuple[NDArray[np.int_], int, Effect], ...]
    motion: NDArray[np.int_]
    owner: NDArray[np.int_]
    parameters: tuple[tuple[str, ...], ...]


@recent(4)
def _layout(effects: Mapping[str, Effect], joints: int) -> _Layout:
    """Lay out a table of effects of an arm with so many joints."""
    counts = [len(effect.parameters) for effect in effects.values()]
    motion, last = np.zeros(sum(counts), np.int_), 0
    waves, of_waves, others = list[Wave](), list[int](), list[tuple[NDArray[np.int_], int, Effect]]()
    for effect, count in zip(effects.values(), counts, strict=True):
        assert effect.moves in ("joints", "links") and len(effect.links) <= 1 and count <= 2
        own, last = np.arange(last, last + count), last + count
        first = joints + 6 * effect.links[0] if effect.links else 0
        if effect.wave is None:
            others.append((own, first, effect))
            continue
        waves.append(effect.wave)
        of_waves += own.tolist()
        motion[own] = first + effect.wave.component
    parameters = tuple(names_of(effect.parameters) for effect in effects.values())
    owner = np.repeat(np.arange(len(counts)), counts)
    return _Layout(tuple(waves), np.array(of_waves, np.int_), tuple(others), motion, owner, parameters)


@dataclass
class TermSearch:
    """The linearized problem at an identified model, with every group of a table beside it.

    It changes as groups are taken: the basis grows, the residual shrinks.

    Attributes:
        columns: ``(r, p)`` whitened derivatives by the table's parameters, rows of one cluster after another's.
        basis: ``(r, f)`` orthonormal, of what is fitted.
        residual: ``(r,)`` what that leaves.
        starts: ``(clusters,)`` the first row of each cluster: rows whose errors may go together.
        allowed: ``(g,)`` the groups that may be taken.
        beside: number of the last rows, which are known beside the measurements: priors.
        largest_std: of a parameter that is of any use (rad, m).
        floor: the least standard deviation of a whitened residual.
    """

    table: TermTable
    columns: Array
    basis: Array
    residual: Array
    starts: NDArray[np.int_]
    allowed: NDArray[np.bool_]
    beside: int
    largest_std: float
    floor: float

    def __post_init__(self) -> None:
        count, owner = np.arange(len(self.table.names)), self.table.owner
        first, last = np.searchsorted(owner, count), np.searchsorted(owner, count, side="right") - 1
        self._pairs = np.stack([first, last], axis=1)  # of a single column twice the same
        self._single = first == last
        self._squares = _products_of_pairs(self.columns, self._pairs)
        self._shared = self.basis.T @ self.columns

    @classmethod
    def at(
        cls,
        table: TermTable,
        model: Model,
        with_ends: Model,
        observed: Observations,
        values: Array,
        free: Sequence[int],
        configurations: NDArray[np.int_],
        extra_residuals: ExtraResiduals,
        *,
        largest_std: float,
        floor: float,
    ) -> "TermSearch":
        """Build near ``values`` ``(p,)``, of which those ``free`` are fitted, without the terms of the model.

        Args:
            with_ends: the model with the table's groups ``showing_ends`` beside.
            configurations: ``(n,)`` labels of the poses from 0 on; repeats of one pose share theirs.
            floor: the least standard deviation of a whitened residual.
        """
        index, mask = list(free), observed.seen
        predicted, jacobian = model.observe(observed.inputs, values)
        known, slopes = extra_residuals(values)
        pose = np.repeat(np.nonzero(mask)[0], observed.points.shape[2])
        order, starts = clusters_first(configurations[pose], len(pose) + len(known))
        fitted = np.concatenate([observed.apply(jacobian[..., index]), slopes[:, index]])[order]
        left = np.concatenate([observed.apply(observed.points - predicted), known])[order]
        slope = observed.apply(table.slopes(model, with_ends, observed, values))
        columns = np.zeros((len(order), len(table.motion)))
        columns[: len(pose)] = slope[:, table.motion] * table.functions[pose]
        basis = np.linalg.qr(unit_columns(fitted)[0])[0]
        names = set(model.names)
        taken = [not names.isdisjoint(own) for own in table.parameters]
        return cls(
            table,
            columns[order],
            basis,
            left - basis @ (basis.T @ left),
            starts,
            ~np.array(taken, dtype=bool),
            len(known),
            largest_std,
            floor,
        )

    def run(
        self, rng: np.random.Generator, most: int, only: Sequence[str] | None = None, level: float = TERM_SEARCH
    ) -> tuple[FoundTerm, ...]:
        """Return the significant groups, at most so many, in the order in which they are taken.

        Args:
            only: names of those that are searched; all where None.
        """
        wanted = None if only is None else set(only)
        among = np.array([wanted is None or name in wanted for name in self.table.names], dtype=bool)
        taken: list[FoundTerm] = []
        while len(taken) < most:
            gram, scores = self._gram(), self._scores()
            useful = self._useful(gram) & among
            threshold = self._threshold(scores, gram, useful, rng, level)
            fall = np.where(useful, _quadratic((self.columns.T @ self.residual)[self._pairs], gram), 0.0)
            pool = [int(i) for i in np.argsort(-fall)[:_POOL] if fall[i] > threshold]
            new = self._stage(pool, threshold, min(_STAGE, most - len(taken)))
            if not new:
                break
            taken += new
        return tuple(taken)

    def _stage(self, pool: list[int], threshold: float, most: int) -> list[FoundTerm]:
        """Take significant groups of a pool, the one that lowers the squares most first."""
        found: list[FoundTerm] = []
        while pool and len(found) < most:
            index = self._pairs[pool].ravel()
            own = self.columns[:, index] - self.basis @ self._shared[:, index]
            pairs = np.arange(len(index)).reshape(-1, 2)
            gram, products = _products_of_pairs(own, pairs), (own.T @ self.residual)[pairs]
            fall = _quadratic(products, gram)
            best = min(np.flatnonzero(fall >= (1 - _TIE) * fall.max()).tolist(), key=pool.__getitem__)
            if fall[best] <= threshold:
                break
            scores = cluster_sums(own[:, pairs[best]] * jackknifed(self.residual, self.basis)[:, None], self.starts)
            usual = _quadratic(scores, np.broadcast_to(gram[:, best, None], (3, len(scores)))).sum()
            numbers = 1 if self._single[pool[best]] else 2
            p = float(p_value_of_squares(fall[best], numbers, variance=usual / numbers))
            found.append(FoundTerm(self.table.names[pool[best]], p))
            self.allowed[pool[best]] = False
            self._take(own[:, pairs[best][:numbers]])
            del pool[best]
        return found

    def _take(self, columns: Array) -> None:
        """Fit these columns, orthogonal to the basis, too."""
        more = np.linalg.qr(columns)[0]
        more = np.linalg.qr(more - self.basis @ (self.basis.T @ more))[0]
        self.basis = np.concatenate([self.basis, more], axis=1)
        self._shared = np.concatenate([self._shared, more.T @ self.columns])
        self.residual = self.residual - more @ (more.T @ self.residual)

    def _scores(self) -> Array:
        """Return the contribution ``(clusters, p)`` of each cluster to the columns' products, less the fitted part."""
        errors = jackknifed(self.residual, self.basis)
        known = slice(len(errors) - self.beside, None)  # the standard deviation of a prior is stated
        errors[known] = np.clip(errors[known], -_PRIOR_ERROR * self._sigma, _PRIOR_ERROR * self._sigma)
        errors = errors[:, None]
        raw, fitted = (cluster_sums(rows * errors, self.starts) for rows in (self.columns, self.basis))
        return np.asarray(raw - fitted @ self._shared)

    @property
    def _sigma(self) -> float:
        """Standard deviation of a whitened residual."""
        dof = max(len(self.residual) - self.basis.shape[1], 1)
        return max(float(np.sqrt(self.residual @ self.residual / dof)), self.floor)

    def _gram(self) -> Array:
        return self._squares - _products_of_pairs(self._shared, self._pairs)

    def _useful(self, gram: Array) -> NDArray[np.bool_]:
        """Check which groups are sufficiently independent of the fitted columns, and estimable."""
        free = (gram[[0, 2]] > _LEFT * np.maximum(self._squares[[0, 2]], 1e-300)).all(axis=0)
        apart = 1 - gram[1] ** 2 / np.maximum(gram[0] * gram[2], 1e-300)
        share = np.where(self._single, 1.0, np.maximum(apart, 0.0))
        least = np.sqrt(np.maximum(np.minimum(gram[0], gram[2]), 0.0) * share)
        return np.asarray(self.allowed & free & (share > _APART) & (self._sigma < self.largest_std * least))

    def _threshold(
        self, scores: Array, gram: Array, useful: NDArray[np.bool_], rng: np.random.Generator, level: float
    ) -> float:
        """Return the critical value of the largest fall of the squares at a level, by sign flips."""
        if not useful.any():
            return np.inf
        flips = rng.integers(0, 2, (_FLIPS, len(scores))).astype(np.float32) * 2 - 1  # rounding is no matter here
        first, second = _orthonormal_pairs(scores[:, self._pairs[useful]], gram[:, useful])
        size = float(max(np.abs(first).max(), np.abs(second).max())) or 1.0
        scaled = [(each / size).astype(np.float32) for each in (first, second)]
        largest = np.empty(_FLIPS, dtype=np.float32)
        for start in range(0, _FLIPS, _FLIPS_AT_ONCE):
            some = flips[start : start + _FLIPS_AT_ONCE]
            largest[start : start + len(some)] = (np.square(some @ scaled[0]) + np.square(some @ scaled[1])).max(axis=1)
        return float(np.sort(size**2 * largest.astype(np.float64))[-int(level * (_FLIPS + 1))])


def _products_of_pairs(rows: Array, pairs: NDArray[np.int_]) -> Array:
    """Return ``(3, g)`` sums over rows ``(r, p)`` of each pair's squares and products: first, mixed, second."""
    first, last = (rows[:, column] for column in pairs.T)
    return np.stack([np.einsum("rg,rg->g", a, b) for a, b in ((first, first), (first, last), (last, last))])


def _orthonormal_pairs(products: Array, matrix: Array) -> tuple[Array, Array]:
    """Return y with y'y = x' M^-1 x, as ``_quadratic`` has it: both entries ``(..., g)`` of x ``(..., g, 2)``."""
    (a, b, d), (x, y) = matrix, np.moveaxis(products, -1, 0)
    along = b / np.maximum(a, 1e-300)
    apart = d - along * b  # the second column's square beside the first
    single = apart <= _ONE_COLUMN * d
    across = np.where(single, 0.0, y - along * x) / np.sqrt(np.where(single, 1.0, apart))
    return x / np.sqrt(np.maximum(a, 1e-300)), across


def _quadratic(products: Array, matrix: Array) -> Array:
    """Return x' M^-1 x ``(..., g)`` of x ``(..., g, 2)`` and M's entries ``(3, g)``; one column twice: x^2 / M."""
    (a, b, d), (x, y) = matrix, np.moveaxis(products, -1, 0)
    determinant = a * d - b**2
    single = determinant <= _ONE_COLUMN * a * d
    whole = (x**2 * d - 2 * x * y * b + y**2 * a) / np.where(single, 1.0, determinant)
    return np.asarray(np.where(single, x**2 / np.maximum(a, 1e-300), whole))
