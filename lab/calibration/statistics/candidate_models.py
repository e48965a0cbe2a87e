"""One set of measurements, and every model that groups of parameters make for it: what can be tried at all."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lab.calibration.gauss_newton import ExtraResiduals, Observations
from lab.calibration.identify import Identification, IdentifyOptions, identify
from lab.calibration.observation import Observation, observation_of
from lab.calibration.prior import prior_of
from lab.calibration.statistics.nested_models import Labels, NestedModels, nested_at
from lab.calibration.statistics.useful_parameters import largest_useful_std
from lab.calibration.validation import configurations, cv_groups_of, folds
from lab.calibration.weights import Noise, joined, weighed, weighted_constraints
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.effects.conditions import PAYLOAD
from lab.kinematics.gauge import STRUCTURE_POSES, base_set, independent_columns, named
from lab.kinematics.model import Model

__all__ = ["LEAST_SIGMA_M", "FullModel", "ModelWith", "NominalOf", "SelectionTask"]

LEAST_SIGMA_M = 1e-9  # a sigma below which residuals are those of the fit's arithmetic

ModelWith = Callable[[Sequence[str]], Model]
NominalOf = Callable[[Model], Array]


@dataclass(frozen=True)
class SelectionTask:
    """What is to be identified, whatever the model.

    Attributes:
        model_with: the arm with groups of effects, by name; a LabError where a group cannot be built.
        nominal_of: the nominal parameters of such a model.
    """

    model_with: ModelWith
    nominal_of: NominalOf
    data: Measurements
    noise: Noise
    request: IdentifyOptions

    def identified(
        self, groups: Sequence[str], held: Sequence[str] = (), near: Identification | None = None
    ) -> Identification:
        """With these groups less the parameters held; requests that are of other groups' are left out.

        Args:
            near: a neighbouring model's, to start from.
        """
        model = self.model_with(groups)
        request = self.request.of(observation_of(model).within(self.data).model.names)
        start = {} if near is None else dict(zip(near.model.names, near.values.tolist(), strict=True))
        held_too = replace(request, fix=(*request.fix, *held), near=start)
        return identify(model, self.data, self.nominal_of(model), self.noise, held_too)

    def refusal(self, group: str) -> LabError | None:
        """Why a group cannot be tried; None if it can."""
        try:
            self.data.inputs(observation_of(self.model_with([group])).model.conditions)
        except LabError as error:
            return error
        return None

    def refuse_unknown_wishes(self, groups: Sequence[str]) -> None:
        """A LabError for patterns that mean no parameter of geometry or of any of the groups that can be built."""
        names: dict[str, None] = {}
        for group in ([], *([name] for name in groups)):
            with suppress(LabError):
                names |= dict.fromkeys(observation_of(self.model_with(group)).within(self.data).model.names)
        for option, patterns in (("--fix", self.request.fix), ("--free", self.request.free)):
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
        inputs = weighed(observation, self.data, self.noise)[0].inputs
        return np.asarray(model.observe(inputs, values)[1][..., own])


@dataclass(frozen=True)
class FullModel:
    """The model with all groups that can be tried, in which every other one is nested.

    Attributes:
        start: the nominal parameters.
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
    folds: Labels
    clusters: Labels
    configurations: Labels
    loads: Array
    extra_residuals: ExtraResiduals
    floor: float

    @classmethod
    def of(cls, task: SelectionTask, groups: Sequence[str], alone: Identification, seed: int) -> "FullModel":
        """With the base and the tool of geometry alone."""
        made = task.model_with(groups)
        observation = observation_of(made).within(task.data)
        model, start = observation.model, observation.nominal(task.nominal_of(made))
        observed, known = weighed(observation, task.data, task.noise)
        at = model.rank_point(_filled(start, model, alone.model, alone.nominal_aligned))
        anywhere = model.structure_joints(STRUCTURE_POSES, rng_for(0, "structure"))
        structure, measured = (model.observe(inputs, at)[1] for inputs in (anywhere, observed.inputs))
        extra_residuals = observation.extra_residuals(at)[1]
        held = named(model.names, "--fix", task.request.of(model.names).fix)
        own = {name: task.parameters(name) for name in groups}
        clusters = cv_groups_of(made, task.data)
        return cls(
            observation=observation,
            start=start,
            observed=observed,
            groups={
                name: tuple(i for i, parameter in enumerate(model.names) if parameter in own[name] and i not in held)
                for name in groups
            },
            structure=_triangle(structure.reshape(-1, len(model.names)), extra_residuals),
            measured=_triangle(measured[observed.seen].reshape(-1, len(model.names)), extra_residuals),
            folds=folds(clusters, seed),
            clusters=clusters,
            configurations=configurations(task.data.joints),
            loads=np.nan_to_num(task.data.conditions.get(PAYLOAD, np.zeros(len(task.data)))),
            extra_residuals=_known(task, observation, observed, start, at, alone, alone.sigma_m if not known else 1.0),
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
        """All nested models near an identified one."""
        values = _filled(self.start, self.observation.model, found.model, found.values)
        effects = [i for group in self.groups.values() for i in group]
        columns = sorted({*self.fitted(found), *effects})
        nominal = np.array([self.start[i] if i in effects else values[i] for i in columns])
        kinds = self.folds, self.clusters
        return nested_at(
            self.observation,
            self.observed,
            values,
            columns,
            nominal,
            *kinds,
            self.extra_residuals,
            self.floor,
            self.configurations,
        )

    def fitted(self, found: Identification) -> tuple[int, ...]:
        """What an identification fitted, as indices of this model."""
        return self._indices(found, found.fit.free)

    def added(self, table: NestedModels, found: Identification, group: str) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Parameters of a group that say what an identified model does not, and those of them to be fitted.

        Left out are those that these poses do not tell apart, and, the least known first, those whose standard
        deviation would be larger than such an effect: fitted all the same, they run off to where the model is not
        linear, for nothing.
        """
        fitted = self.fitted(found)
        new = self._new(self.structure, self._indices(found, found.base_set.kept), self.groups[group])
        shown = list(self._new(self.measured, fitted, new))
        while shown:
            unsure = table.std([*fitted, *shown])[len(fitted) :] / self._useful[shown]
            if unsure.max() <= 1:
                break
            del shown[int(unsure.argmax())]
        return new, tuple(shown)

    def least_known(self, table: NestedModels, found: Identification) -> int | None:
        """The parameter of a group that an identified model knows too badly for any use; None where it has none."""
        fitted = self.fitted(found)
        effects = {i for group in self.groups.values() for i in group}
        unsure = np.where([i in effects for i in fitted], table.std(fitted) / self._useful[list(fitted)], 0.0)
        return fitted[int(unsure.argmax())] if unsure.max(initial=0.0) > 1 else None

    @cached_property
    def _useful(self) -> Array:
        """``(p,)`` the largest standard deviations that are worth fitting."""
        joints = self.observed.inputs[:, : self.observed.inputs.shape[1] - len(self.observation.model.conditions)]
        return largest_useful_std(self.observation.model.parameters, joints)

    def _indices(self, found: Identification, parameters: Sequence[int]) -> tuple[int, ...]:
        names = self.observation.model.names
        return tuple(names.index(found.model.names[i]) for i in parameters)

    @staticmethod
    def _new(triangle: Array, known: Sequence[int], wanted: Sequence[int]) -> tuple[int, ...]:
        """Those of the wanted columns that the known ones and those before them do not span."""
        kept = independent_columns(triangle, [*known, *wanted])
        return tuple(i for i in wanted if i in kept)


def _known(
    task: SelectionTask,
    observation: Observation,
    observed: Observations,
    start: Array,
    at: Array,
    alone: Identification,
    sigma: float,
) -> ExtraResiduals:
    """What is known beside the measurements: of the observation, and the whole model's prior if one is requested.

    An automatic prior is that of geometry alone.
    """
    beside = weighted_constraints(observation, observed)
    if task.request.tolerance is None:
        return beside
    if task.request.automatic:
        return beside if alone.prior is None else joined(beside, alone.prior.rows(sigma, observation.model.names))
    structure = base_set(observation.model, at, known=observation.extra_residuals(at)[1])
    return joined(beside, prior_of(observation.model, structure, start, task.request.tolerance).rows(sigma))


def _triangle(jacobian: Array, extra_residuals: Array) -> Array:
    """As few rows with the same inner products."""
    return np.asarray(np.linalg.qr(np.concatenate([jacobian, extra_residuals]), mode="r"))


def _filled(start: Array, model: Model, source: Model, values: Array) -> Array:
    """``start`` with the values that another model has for the same names."""
    known = dict(zip(source.names, values, strict=True))
    return np.array([known.get(name, value) for name, value in zip(model.names, start, strict=True)])
