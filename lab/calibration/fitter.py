"""Fit measurements of one arm: models with groups of effects, their identification, outliers, model and noise."""

from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol, TypeVar

import numpy as np

from lab.calibration.fit_options import FitOptions
from lab.calibration.guess import named_stations
from lab.calibration.identification import Identification, identify
from lab.calibration.noise_search import NoiseSearch, noise_of, outliers_among_fitted
from lab.calibration.residual.estimation import with_residual
from lab.calibration.residual.gaussian_process import JointProcess
from lab.calibration.sensor import ArmSensor
from lab.calibration.statistics.candidate_models import ModelWith, SelectionTask
from lab.calibration.statistics.linearized import NoiseDistribution
from lab.calibration.statistics.model_selection import Selection, follow, select
from lab.calibration.statistics.outliers import Outliers
from lab.calibration.weights import Noise
from lab.core.errors import LabError, option_name
from lab.core.measurements import Measurements, thinned
from lab.core.se3 import Array
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.effects.arm_with_effects import Arm
from lab.kinematics.effects.backlash import approached_groups
from lab.kinematics.effects.effect import CHANGING_WITH_TIME, ArmFacts, SessionInfo, Step
from lab.kinematics.effects.effect_registry import expected_terms, searched_terms
from lab.kinematics.effects.range_errors import CONSTANT
from lab.kinematics.joints import Encoders, JointSpec
from lab.kinematics.model import Model, RigidArm
from lab.noise.error_model import ErrorModel

__all__ = ["MOST_CHOSEN_BY", "Fitter", "NominalRobot"]

_CONTRADICTED = 3.0  # standard deviations between a stated range constant and that of the rows
_CLEANINGS = 5  # of the poses and what they are validated on
_BALANCINGS = 3  # of the weights of poses and the choice of groups by each other
_MOST_NAMED = 3  # effects that a model lacks, in a sentence: more are not looked for
_MOST_TESTED = 1_000  # poses by which such effects are searched
MOST_CHOSEN_BY = 8_000  # poses by which groups are chosen: 1 GB

_T = TypeVar("_T")


class NominalRobot(Protocol):
    """Nominal model of a robot, as a fit needs it."""

    @property
    def chain(self) -> JointSpec:
        """Joints of the robot."""

    @property
    def tool(self) -> dict[str, Array]:
        """Positions ``(3,)`` (m) of the targets, in the last frame or the platform's."""

    @property
    def loads(self) -> Loads | None:
        """Masses of the links; None where unknown."""

    @property
    def stations(self) -> tuple[str, ...]:
        """Stations of the instrument that the robot's cell names."""

    @property
    def stored_file(self) -> str:
        """The file that describes its identified geometry."""

    def arm(self, targets: tuple[str, ...]) -> RigidArm:
        """Return the arm's geometry, with these targets."""

    def arm_with(self, targets: tuple[str, ...], groups: Sequence[str], session: SessionInfo = ...) -> Arm:
        """Return the arm with groups of effects, for measurements of such sessions."""


class _LastResult:
    """Cache of the last result of a function, by the identity of its arguments; pickled empty."""

    def __init__(self) -> None:
        self._arguments: tuple[object, ...] = ()
        self._result: Any = None

    def __call__(self, make: Callable[[], _T], *arguments: object) -> _T:
        known = self._arguments
        if len(arguments) != len(known) or any(a is not b for a, b in zip(arguments, known, strict=True)):
            self._result, self._arguments = make(), arguments
        result: _T = self._result
        return result

    def __reduce__(self) -> tuple[type["_LastResult"], tuple[()]]:
        return _LastResult, ()


@dataclass(frozen=True)
class Fitter:
    """Fitter of the measurements of one arm.

    Attributes:
        targets: of the arm: those of ``kind`` in ``data``.
        kind: of observation, with its options.
        judged_by: further rows that the model must predict, with the groups that are left out there.
        steps: that were found in the rows.
        frees_range: whether the range constant may be of any size, though the instrument's file states it.
    """

    robot: NominalRobot
    targets: tuple[str, ...]
    data: Measurements
    kind: ArmSensor
    noise: Noise
    options: FitOptions
    seed: int
    judged_by: tuple[tuple[Measurements, tuple[str, ...]], ...] = ()
    steps: tuple[Step, ...] = ()
    frees_range: bool = False
    _arms: dict[Hashable, Arm] = field(default_factory=dict, repr=False, compare=False)
    _last_fit: _LastResult = field(default_factory=_LastResult, repr=False, compare=False)
    _last_outliers: _LastResult = field(default_factory=_LastResult, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Refuse options that do not apply to any identification of these measurements.

        Raises:
            LabError: the group ``residual`` is requested for something else than measured points of a serial arm; or
                an estimator beside it or beside the sequential method, which are estimators themselves.
        """
        if self.options.estimator is not None and (self.options.residual or self.kind.solve is not None):
            option, value = ("model", "residual") if self.options.residual else ("method", "sequential")
            raise LabError(
                f"{option_name('estimator')} {self.options.estimator.name}: {option_name(option)} {value} estimates "
                "the parameters, too; leave one out"
            )
        if not self.options.residual:
            return
        instead = "" if self.kind.name == "points" else f"{option_name('observe')} {self.kind.name}"
        if beside := self.robot.chain.beside_serial:
            instead = "a mechanism with loops" if self.robot.chain.has_loops else f"a robot with {beside}"
        if instead:
            raise LabError(
                f"{option_name('model')} residual: it takes measured points of a serial arm, not {instead}; "
                f"leave it out"
            )

    def model_with(self, groups: Sequence[str]) -> Model:
        """Return the arm with groups of effects, as it is observed."""
        arm = self._arm_with(groups)
        return self.kind.observation(arm, self.data, arm.nominal(self.robot.tool))[0]

    def _arm_with(self, groups: Sequence[str]) -> Arm:
        if (key := tuple(groups)) not in self._arms:
            self._arms[key] = self.robot.arm_with(self.targets, groups, self.session)
        return self._arms[key]

    @cached_property
    def session(self) -> SessionInfo:
        """Session metadata of the measurements to be fitted."""
        rows = self.data.only("calibrate")
        rows = rows[self.kind.rows(rows)]
        time_s = rows.conditions.get("time_s", np.zeros(1))
        given = time_s[np.isfinite(time_s)]
        started = float(given[0]) if len(given) else 0.0
        in_frame, device = self.kind.in_instrument_frame, self.noise.instrument
        stations = named_stations(rows, self.robot.stations) if in_frame else ()
        sessions = tuple(dict.fromkeys(rows.sessions))
        prior = device.range_prior if in_frame and device is not None else None
        if prior is not None and self.frees_range:
            prior = prior.freed
        return SessionInfo(sessions, started, "time_s" in rows.conditions, stations, self.steps, prior)

    def with_credible_range(self, rows: Measurements) -> "Fitter":
        """Return the fitter with a free range constant where the rows contradict what the instrument's file states.

        The constant c of the rows alone, of variance v, is told from the fit with a prior, of variance p, by adding
        information. It contradicts the prior beyond three standard deviations of both, (v + p)^(1/2).
        """
        prior = self.session.range_prior
        if prior is None or not prior.is_stated:
            return self
        with suppress(LabError):  # too few rows are refused where they are fitted
            found = self.identified_with(rows, (), ())
            at = found.model.names.index(CONSTANT)
            if at not in found.fit.free:
                return self
            with_prior = float(found.covariance[found.fit.free.index(at), found.fit.free.index(at)])
            information = max(1 / with_prior - 1 / prior.constant_m**2, 0.0)
            constant = float(found.values[at]) / with_prior
            excess = max(found.residual_sigma_m / found.sigma_m, 1.0)
            if abs(constant) > _CONTRADICTED * np.hypot(excess * np.sqrt(information), information * prior.constant_m):
                return self._of_other_models(frees_range=True)
        return self

    def observed(self) -> Measurements:
        """Return the observed quantities of the measurements."""
        arm = self._rigid
        return self.kind.observation(arm, self.data, arm.nominal(self.robot.tool))[1]

    @cached_property
    def _rigid(self) -> RigidArm:
        return self.robot.arm(self.targets)

    @cached_property
    def _nominal(self) -> Mapping[str, float]:
        return dict(zip(self._rigid.names, self._rigid.nominal(self.robot.tool).tolist(), strict=True))

    def nominal(self, model: Model) -> Array:
        """Return the nominal parameters of one of these models."""
        return np.array([self._nominal.get(name, 0.0) for name in model.names])

    @property
    def fit_options(self) -> FitOptions:
        """Options of the fit of one model, by the method of this kind of measurement."""
        return self.options if self.kind.solve is None else replace(self.options, solve=self.kind.solve)

    def modelled(self, groups: Sequence[str], fixed: Sequence[str]) -> tuple[Model, FitOptions]:
        """Return the arm with these groups less the parameters held, and the options of its identification."""
        model = self.model_with(groups)
        options = self.fit_options if self.options.geometric else self.fit_options.of(model.names)
        return model, replace(options, fix=(*options.fix, *fixed)) if fixed else options

    def identified(
        self, rows: Measurements, groups: Sequence[str], fixed: Sequence[str] = ()
    ) -> tuple[Identification, Measurements, Outliers | None]:
        """Identify the arm with these groups; return also the fitted rows and the outliers that were left out.

        Args:
            fixed: parameters of the groups that the selection found not to be observable in these poses.
        """
        found, clean, outliers = self.identified_with(rows, groups, fixed), rows, None
        if not self.options.robust:
            return found, clean, outliers
        model, options = self.modelled(groups, fixed)
        for _ in range(_CLEANINGS):  # a prior weighs by a sigma that outliers inflate
            before, outliers = outliers, self.outliers_of(found, rows)
            if before is not None and set(before.rows) == set(outliers.rows):
                break
            clean = rows[np.setdiff1d(np.arange(len(rows)), outliers.rows)]
            found = self.identified_from(model, clean, options)
        return found, clean, outliers

    def identified_with(self, rows: Measurements, groups: Sequence[str], fixed: Sequence[str]) -> Identification:
        """Identify the arm with these groups from all these rows."""

        def make() -> Identification:
            model, options = self.modelled(groups, fixed)
            return self.identified_from(model, rows, options)

        return self._last_fit(make, rows, groups, fixed, self.kind, self.noise.shared)

    def selected_with_noise(self, rows: Measurements) -> tuple["Fitter", Selection | None, NoiseSearch]:
        """Return the selected model and its noise: each is chosen with the other."""
        fitter, selection, search = self._balanced(rows)
        if selection is None or not (doubted := self._doubted_by_time(selection)):
            return fitter, selection, search
        rest = tuple(name for name in selection.chosen if name not in doubted)
        without = noise_of(_OneModel(self, rest, selection.fixed_of(rest)), rows)
        if without.shared is None or not without.shared.autocorrelated_m:
            return fitter, selection, search
        again = self.knowing(without.shared)._selected(rows)
        if again is None or set(doubted) <= set(again.chosen):
            return fitter, selection, search
        return self._with_own_noise(again, rows)

    def _doubted_by_time(self, selection: Selection) -> tuple[str, ...]:
        """Return the groups that ``auto`` chose for errors over time, which autocorrelated errors explain, too.

        Beside such a group errors look less autocorrelated, and it is accepted too easily: it has to pass beside the
        autocorrelation that is found without it.
        """
        if not self.options.search:
            return ()
        return tuple(
            name for name in selection.chosen if set(CHANGING_WITH_TIME) & set(self._arm_with([name]).conditions)
        )

    def _with_own_noise(self, selection: Selection, rows: Measurements) -> tuple["Fitter", Selection, NoiseSearch]:
        search = noise_of(_OneModel.of(self, selection), rows)
        return self.knowing(search.shared), selection, search

    def _balanced(self, rows: Measurements) -> tuple["Fitter", Selection | None, NoiseSearch]:
        """Alternate selection and noise search until both settle, where no group is doubted."""
        fitter, selection = self, self._selected(rows)
        for _ in range(_BALANCINGS):
            model = _OneModel.of(self, selection)
            search = noise_of(model, rows)
            before, fitter = fitter.noise.shared, self.knowing(search.shared)
            if selection is None or _kinds(before) == _kinds(search.shared):
                break
            chosen, selection = selection.chosen, fitter._selected(rows)
            assert selection is not None
            if set(chosen) == set(selection.chosen):
                break
        if selection is not None and model != _OneModel.of(self, selection):  # it was not chosen in the end
            return self._with_own_noise(selection, rows)
        return fitter, selection, search

    def with_steps(self, steps: tuple[Step, ...]) -> "Fitter":
        """Return the fitter of an arm that moved between rows: each of its models has these steps."""
        return self._of_other_models(steps=steps)

    def _of_other_models(self, **changes: Any) -> "Fitter":
        """Return a changed fitter without the models and results of this one."""
        return replace(self, _arms={}, _last_fit=_LastResult(), _last_outliers=_LastResult(), **changes)

    def knowing(self, shared: ErrorModel | None) -> "Fitter":
        """Return the fitter with the errors that its measurements share."""
        return replace(self, noise=replace(self.noise, shared=shared))

    def with_missing_effects(self, rows: Measurements, selection: Selection | None) -> Selection | None:
        """Search the first effects that ``auto`` would add to the model, a test of lack of fit; None if there are none.

        Args:
            selection: of the model's groups; None for geometry alone.
        """
        groups, fixed = (selection.chosen, selection.fixed) if selection else ((), ())
        others = [name for name in self.approached(self.options.candidates) if name not in groups]
        options, some = self.modelled(groups, fixed)[1], thinned(rows, _MOST_TESTED)
        plain = self.knowing(self.noise.independent.shared)
        try:
            alone = None if options.estimator else plain.identified_with(some, groups, fixed)
            beside = plain._searched(
                lambda more: self.model_with((*groups, *more)), some, options, others, enough=_MOST_NAMED, alone=alone
            )
        except LabError:  # too few rows to add anything
            return None
        return beside if beside.chosen else None

    def _searched(
        self,
        model_with: ModelWith,
        rows: Measurements,
        options: FitOptions,
        candidates: Sequence[str],
        *,
        enough: int | None = None,
        alone: Identification | None = None,
    ) -> Selection:
        """Select groups and single joints' terms for some rows.

        Args:
            enough: how many groups end the search; None where nothing does.
            alone: the identification without any of them, where there is one already.
        """
        facts = ArmFacts(self.robot.chain, self.robot.loads, self.session)
        return select(
            model_with,
            rows,
            self.nominal,
            self.noise,
            options,
            candidates=candidates,
            terms=searched_terms(facts),
            expected=expected_terms(facts),
            seed=self.seed,
            enough=enough,
            alone=alone,
        )

    def derivatives_by_others(
        self, found: Identification, groups: Sequence[str], rows: Measurements, but: Collection[str] = ()
    ) -> list[Array]:
        """Derivatives of what rows observe by the parameters of each requested or candidate group outside the model.

        Args:
            but: candidates that are left out.
        """
        task = SelectionTask(self.model_with, self.nominal, rows, self.noise, self.fit_options)
        made = []
        for name in dict.fromkeys((*self.options.candidates, *self.options.groups)):
            if name not in (*groups, *but):
                with suppress(LabError):  # a group that the arm or the columns do not allow
                    made.append(task.derivatives(name, found))
        return made

    def predicting(
        self, rows: Measurements, groups: Sequence[str], fixed: Sequence[str], process: JointProcess | None = None
    ) -> Identification:
        """Identify the arm, without outliers on request, and add the residual process on request.

        Args:
            process: of all rows, whose variances are taken.
        """
        found, clean, _ = self.identified(rows, groups, fixed)
        return with_residual(found, clean, process) if self.options.residual else found

    def _selected(self, rows: Measurements) -> Selection | None:
        """Return the groups that the rows call for, or that are requested; None for geometry alone."""
        if self.options.geometric:
            return None
        for name in self.options.further:  # named, so that an arm or rows that cannot have it are refused
            rows.inputs(self._arm_with([name]).conditions)
        groups, task = (
            self.approached(self.options.groups),
            SelectionTask(self.model_with, self.nominal, rows, self.noise, self.fit_options),
        )
        task.refuse_unknown_wishes(self.options.candidates if self.options.search else groups)
        found, clean, outliers = self.identified(rows, groups)
        if not self.options.search:
            model_with = self.weighted_as(found).model_with
            return follow(model_with, clean, self.nominal, groups, self.noise, self.fit_options, seed=self.seed)
        selection = self._chosen(found, clean)
        if outliers is None or not len(outliers.rows):
            return selection
        other = self._chosen(found, rows)  # a few poses that alone show an effect look like outliers without it
        if set(other.chosen) == set(selection.chosen):
            return selection
        kept = [len(self.identified(rows, s.chosen, s.fixed)[1]) for s in (selection, other)]
        return other if kept[1] > kept[0] else selection

    def _chosen(self, found: Identification, rows: Measurements) -> Selection:
        """Return the groups that some rows call for; of poses, weighted as geometry and then the groups balance them.

        Of very many, as many as bound the memory, evenly: each is held with the columns of all groups and waves.
        """
        selection, rows = None, thinned(rows, MOST_CHOSEN_BY)
        for _ in range(_BALANCINGS):
            before, weighted = selection, self.weighted_as(found)
            tried = [name for name in self.approached(self.options.candidates) if not self.unanswerable(name)]
            selection = self._searched(weighted.model_with, rows, self.fit_options, tried)
            if weighted is self or (before and before.chosen == selection.chosen):
                break
            found, _, _ = self.identified(rows, selection.chosen, selection.fixed)
        assert selection is not None
        return selection

    def approached(self, groups: Sequence[str]) -> tuple[str, ...]:
        """Return the groups, with backlash only of joints with an approach column, if the file has some."""
        play = approached_groups(self.robot.chain, self.data.conditions)
        return tuple(dict.fromkeys(each for name in groups for each in (play if name == "backlash" else (name,))))

    def unanswerable(self, group: str) -> str:
        """Describe the data for a group that are missing in the rows to be judged by; empty if none."""
        for rows, without in self.judged_by:
            if group not in without:
                with suppress(LabError):  # a group that cannot be built is reported elsewhere
                    conditions = self._arm_with([group]).conditions
                    try:
                        rows.inputs(conditions)
                    except LabError as error:
                        return str(error)
        return ""

    def weighted_as(self, found: Identification) -> "Fitter":
        """Return the fitter whose sensor has the weights of an identification, and estimates none."""
        kind = self.kind.weighted_as(found.model)
        return self if kind == self.kind else replace(self, kind=kind)

    @property
    def noise_shape(self) -> NoiseDistribution:
        """Distribution of the assumed noise; heavy-tailed where it was estimated beside an instrument's bounded one."""
        shared, device = self.noise.shared, self.noise.instrument if self.noise.sigma_m is None else None
        uniform = device is not None and device.kind == "uniform" and (shared is None or shared.is_given)
        return NoiseDistribution("uniform", self.noise.readings) if uniform else NoiseDistribution()

    def identified_from(self, model: Model, rows: Measurements, options: FitOptions) -> Identification:
        """Identify the parameters of a model from all these rows."""
        nominal = self.nominal(model)
        model = self.kind.balanced(model, rows, nominal, options)
        return identify(model, rows, nominal, self.noise, options)

    def outliers_of(self, start: Identification, rows: Measurements) -> Outliers:
        """Find outliers among the rows, by a search that starts from an identification."""
        return self._last_outliers(
            lambda: outliers_among_fitted(start, rows, self.noise, self.noise_shape, self.seed),
            start,
            rows,
            self.noise.shared,
        )


@dataclass(frozen=True)
class _OneModel:
    """A model of a fitter, fitted to any rows."""

    fitter: Fitter = field(compare=False)
    groups: tuple[str, ...]
    fixed: tuple[str, ...]

    @staticmethod
    def of(fitter: Fitter, selection: Selection | None) -> "_OneModel":
        return _OneModel(fitter, *((selection.chosen, selection.fixed) if selection else ((), ())))

    @property
    def noise(self) -> Noise:
        return self.fitter.noise

    @property
    def encoders(self) -> Encoders | None:
        return self.fitter.robot.chain.encoders

    def fitted(self, rows: Measurements, shared: ErrorModel | None) -> Identification:
        return self.fitter.knowing(shared).identified_with(rows, self.groups, self.fixed)

    def outliers(self, found: Identification, rows: Measurements, shared: ErrorModel | None) -> Outliers:
        return self.fitter.knowing(shared).outliers_of(found, rows)


def _kinds(shared: ErrorModel | None) -> tuple[str, ...]:
    return () if shared is None else shared.kinds
