"""Model selection: the smallest adequate set of effects, found by adding one group of parameters after another.

A group is taken if it passes three criteria. The first is a test at 1 % with Bonferroni's correction for the number of
groups: F, chi squared where sigma is given, and, where poses have repeats or several targets, a test by configurations
(``linearized``). The second is BIC. The third is the error at held-out configurations, which has to fall by more
than its standard error: residuals of real arms are correlated and heavy-tailed, and the first two alone accept nearly
everything. Where the configurations are too few for a test by them, the held-out gain has to be significant instead.

Groups of single joints, of which there are hundreds, are searched beside these, with one level for all of them
(``candidate_models``).

Last, a chosen group that bears loads is replaced by another one, and the arm identified anew. If that fits as well, by
the likelihood alone, it is an alternative, and the pose at which the two arms differ most would separate them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from lab.calibration.fit_options import PLAIN, FitOptions
from lab.calibration.identification import Identification
from lab.calibration.observation import observation_of
from lab.calibration.row_groups import ROWS_PER_PARAMETER, configurations
from lab.calibration.statistics.candidate_models import (
    LEAST_SIGMA_M,
    TELLING,
    FoundTerm,
    FullModel,
    HeldOutGain,
    ModelWith,
    NestedModels,
    NominalOf,
    Score,
    SelectionTask,
    TermSearch,
    TermTable,
)
from lab.calibration.statistics.linearized import ClusterTest
from lab.calibration.weights import Noise, weigh
from lab.core.errors import IncompleteColumnError
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.significance import MODEL_GROUPS, TERM_SEARCH
from lab.kinematics.effects.effect import Effect, absent
from lab.kinematics.effects.effect_registry import CANDIDATES
from lab.kinematics.effects.sessions import at_first_station

__all__ = ["GroupTrial", "Selection", "follow", "objection", "select"]

_GEOMETRY = "geometric"
_NOT_SIGNIFICANT = "not significant"
_NO_TERMS: Mapping[str, Effect] = MappingProxyType({})
_SEARCHES = 6  # of terms, each around what the one before found
_STRONG_EVIDENCE = 10.0  # of BIC or twice the log likelihood: very strong (Kass & Raftery 1995, section 3.2)
_LOADED_GROUPS = ("compliance", "bending", "torsion")
_POSES = 400


@dataclass(frozen=True)
class GroupTrial:
    """Trial of one group of parameters.

    Attributes:
        name: of the group; ``geometry`` for the arm without any.
        holdout_m: mean length of the error at held-out poses with it and what was taken before it; NaN if not tried.
        f_p: the chance of as large a fall in squares if it were not there (``NestedModels.p_value``), no Bonferroni's
            factor in it; NaN if not tried.
        configurations: the test by configurations; None where each is one reading of one target, or not tried.
        gain: the fall of the error at held-out configurations; None if not tried.
        chosen: whether it is in the final model; the others are tried beside that.
        infeasibility_reason: why it is not; empty where it is.
        incomplete_data: whether that is because a column that it needs has gaps.
        fixed: its parameters that are not fitted, as they are not or only weakly observable in these poses.
    """

    name: str
    parameters: int
    holdout_m: float
    f_p: float
    bic: float
    chosen: bool
    infeasibility_reason: str = ""
    fixed: tuple[str, ...] = ()
    incomplete_data: bool = False
    configurations: ClusterTest | None = None
    gain: HeldOutGain | None = None


@dataclass(frozen=True)
class _Alternative:
    """Another explanation that fits as well.

    Attributes:
        fit_rise: by how much twice the negative log likelihood rises with the other one instead; negative where that
            fits better.
        inputs: ``(joints + conditions,)`` the pose, of random ones, at which the two arms differ most.
    """

    chosen: str
    other: str
    fit_rise: float
    inputs: Array
    differ_m: float
    sigma_m: float

    @property
    def is_distinguishable(self) -> bool:
        """Check whether a measurement at that pose would distinguish the two models."""
        return self.differ_m > 3 * self.sigma_m


@dataclass(frozen=True)
class Selection:
    """The smallest adequate model.

    Attributes:
        chosen: its groups, in the order in which they were taken.
        groups: geometry alone, the chosen ones in their order, then the others.
        alternatives: other effects of loads that are confounded with the chosen ones.
        searched: whether the groups were searched for, or were given.
    """

    chosen: tuple[str, ...]
    identification: Identification
    groups: tuple[GroupTrial, ...]
    alternatives: tuple[_Alternative, ...] = ()
    searched: bool = True

    @property
    def fixed(self) -> tuple[str, ...]:
        """Parameters of the chosen groups that are not fitted: to be fixed wherever this model is fitted again."""
        return self.fixed_of(self.chosen)

    def fixed_of(self, groups: Sequence[str]) -> tuple[str, ...]:
        """Return the fixed parameters of some of the chosen groups."""
        return tuple(name for group in self.groups if group.name in groups for name in group.fixed)


def select(
    model_with: ModelWith,
    data: Measurements,
    nominal: NominalOf,
    noise: Noise | None = None,
    options: FitOptions = PLAIN,
    *,
    candidates: Sequence[str] = CANDIDATES,
    terms: Mapping[str, Effect] = _NO_TERMS,
    expected: Sequence[str] = (),
    seed: int = 0,
    enough: int | None = None,
    alone: Identification | None = None,
) -> Selection:
    """Identify with geometry alone, then with whatever groups the measurements call for.

    After each group the arm is identified anew and all others are tried around that; one taken earlier whose
    removal would now lower BIC is dropped.

    Args:
        model_with: the arm with groups of effects, by name; a LabError where a group cannot be built.
        candidates: groups to try, those of ``kinematics.effects`` or the caller's own.
        terms: groups of single joints to search, by names that ``model_with`` knows.
        expected: those of them that the search begins with.
        enough: how many groups end the search, where they only have to show that the model lacks something; all that
            the measurements call for where None. Groups that are not significant have no numbers then.
        alone: the identification with geometry alone, where there is one already.

    Raises:
        LabError: geometry alone cannot be identified.
    """
    task = SelectionTask(model_with, nominal, data, noise or Noise(), options)
    task.refuse_unknown_wishes(candidates)
    # grow the model from geometry alone, by groups and then by single joints' terms
    refused = _refusals(task, candidates)
    possible = tuple(name for name in candidates if name not in refused)
    growth = _Growth(task, possible, alone or task.identified(()), seed, enough)
    growth.grow()
    if terms:
        growth.search(terms, expected)
    # the table: geometry, what was chosen, all others
    rows = growth.rows | refused
    chosen = [replace(rows[name], chosen=True) for name in growth.taken]
    others = (rows[name] for name in candidates if name not in growth.taken)
    same = () if enough else _alternatives(growth)
    assert growth.geometry is not None
    geometry = _geometry(growth.geometry, brief=enough is not None and not growth.taken)
    return Selection(growth.taken, growth.found, (geometry, *chosen, *others), same)


def _refusals(task: SelectionTask, candidates: Sequence[str]) -> dict[str, GroupTrial]:
    """Return the rows of the groups that cannot be tried, with the reason."""
    refused = {}
    for name in candidates:
        if (why := task.refusal(name)) is not None:
            lacks_column = isinstance(why, IncompleteColumnError)
            refused[name] = replace(_refused(name, str(why)), incomplete_data=lacks_column)
    return refused


def follow(
    model_with: ModelWith,
    data: Measurements,
    nominal: NominalOf,
    groups: Sequence[str],
    noise: Noise | None = None,
    options: FitOptions = PLAIN,
    *,
    seed: int = 0,
) -> Selection:
    """Identify with the requested groups, and report the gain of each, in their order.

    What speaks against a group is said in ``infeasibility_reason``, and does not keep it out.

    Args:
        model_with, nominal, seed: as for ``select``.

    Raises:
        LabError: a group cannot be built, or has no measurements to fit it by.
    """
    task = SelectionTask(model_with, nominal, data, noise or Noise(), options)
    data.inputs(observation_of(model_with(groups)).model.conditions)
    task.refuse_unknown_wishes(groups)
    found = task.identified(())
    large = FullModel.of(task, groups, found, seed)
    table = large.around(found)
    rows = [_geometry(table.score(large.fitted(found)))]
    for count, name in enumerate(groups, start=1):
        small = table.score(large.fitted(found))
        rows.append(replace(_trial(large, table, found, name, small), chosen=True, fixed=()))
        found = task.identified(groups[:count])
        table = large.around(found)
    return Selection(tuple(groups), found, tuple(rows), searched=False)


@dataclass
class _Growth:
    """A model that grows from geometry alone.

    Attributes:
        candidates: groups that can be tried.
        enough: how many groups end the growth; None where nothing does.
        rows: of the table, by group.
        stuck: groups that the fit does not converge with.
        geometry: score of geometry alone.
    """

    task: SelectionTask
    candidates: tuple[str, ...]
    alone: Identification
    seed: int
    enough: int | None = None
    taken: tuple[str, ...] = ()
    rows: dict[str, GroupTrial] = field(default_factory=dict)
    stuck: dict[str, GroupTrial] = field(default_factory=dict)
    found: Identification = field(init=False)
    geometry: Score | None = None
    _large: tuple[tuple[str, ...], FullModel] | None = None
    _around: tuple[FullModel, Identification, NestedModels] | None = None
    _search: tuple[Identification, TermSearch] | None = None

    def __post_init__(self) -> None:
        self.found = self.alone

    def grow(self) -> None:
        large = self.large()
        table = self.around(large)
        if self.geometry is None:
            self.geometry = table.score(large.fitted(self.found))
        for _ in range(3 * len(large.groups) + 1):  # BIC falls at each step, rounding and curvature aside
            left = [name for name in large.groups if name not in (*self.taken, *self.stuck)]
            small = table.score(large.fitted(self.found))
            brief = self.enough is not None
            self.rows |= {name: _trial(large, table, self.found, name, small, brief=brief) for name in left}
            moved = _next(large, table, self.found, self.taken, [self.rows[name] for name in left], small)
            if moved == self.taken or not self.moved_to(moved):
                if moved == self.taken:
                    break
                continue
            if self.has_enough:
                break
            table = self.around(large)
        self.rows |= self.stuck

    @property
    def has_enough(self) -> bool:
        return self.enough is not None and len(self.taken) >= self.enough

    def moved_to(self, groups: tuple[str, ...]) -> bool:
        """Identify with these groups, if the fit converges; else the last one is stuck."""
        fixed = [parameter for name in groups for parameter in self.rows[name].fixed]
        tried = self.task.identified(groups, fixed, self.found)
        if tried.status != "converged" and len(groups) > len(self.taken):
            self.stuck[groups[-1]] = _refused(groups[-1], "Gauss-Newton does not converge with it")
            return False
        self.taken, self.found = groups, tried
        return True

    def around(self, large: FullModel) -> NestedModels:
        if self._around is None or self._around[0] is not large or self._around[1] is not self.found:
            self._around = large, self.found, large.around(self.found)
        return self._around[2]

    def large(self) -> FullModel:
        if self._large is None or self._large[0] != self.taken:
            self._large = self.taken, self._made_large()
        return self._large[1]

    def _made_large(self) -> FullModel:
        own = set(self.found.model.names)
        others = [name for name in self.candidates if name not in self.taken]
        shared = [name for name in others if self.task.parameters(name) & own]
        self.stuck |= {name: _refused(name, "a part of it is in the model") for name in shared}
        return FullModel.of(
            self.task, [*self.taken, *(name for name in others if name not in shared)], self.alone, self.seed
        )

    def search(self, terms: Mapping[str, Effect], expected: Sequence[str]) -> None:
        """Add the groups of single joints that the residuals show, and try the others anew around those.

        Expected ones are searched first, by themselves, at half of the level: beside what they explain, a group of
        several joints shows that would else be taken apart into its single ones.
        """
        table = TermTable.of(terms, self.task.data)
        if expected:
            self._search_some(table, expected, TERM_SEARCH / 2)
        self._search_some(table, None, TERM_SEARCH / 2 if expected else TERM_SEARCH)
        self._fix_superfluous()
        self._judge_terms(set(terms))

    def _search_some(self, table: TermTable, only: Sequence[str] | None, level: float) -> None:
        for _ in range(0 if self.has_enough else _SEARCHES):
            new = self._found_terms(table, only, level)
            self.rows |= {term.name: GroupTrial(term.name, 0, np.nan, term.p, np.nan, True) for term in new}
            if not new or not self.moved_to((*self.taken, *(term.name for term in new))):
                break
            if self.has_enough:
                break
            self.grow()

    def _fix_superfluous(self) -> None:
        """Hold, the worst first, parameters that were well determined when taken and no longer are."""
        while True:
            large = self.large()
            if (worst := large.most_uncertain(self.around(large), self.found)) is None:
                return
            owner = next(name for name in self.taken if worst in large.groups[name])
            fixed = (*self.rows[owner].fixed, large.observation.model.names[worst])
            self.rows[owner] = replace(self.rows[owner], fixed=fixed)
            empty = len(fixed) == len(self.task.parameters(owner))
            groups = tuple(name for name in self.taken if not (empty and name == owner))
            if not self.moved_to(groups):
                return

    def _found_terms(self, table: TermTable, only: Sequence[str] | None, level: float) -> tuple[FoundTerm, ...]:
        if self._search is None or self._search[0] is not self.found:
            self._search = self.found, self._search_at(table)
        room = self.large().least_rows / ROWS_PER_PARAMETER - len(self.found.fit.free)
        most = int(room) // 2 if self.enough is None else min(int(room) // 2, self.enough - len(self.taken))
        return self._search[1].run(rng_for(self.seed, "flips"), most, only, level)

    def _search_at(self, table: TermTable) -> TermSearch:
        task, found = self.task, self.found
        observed, known = weigh(observation_of(task.model_with(self.taken)).within(task.data), task.data, task.noise)
        ends = (table.names[group] for group in table.showing_ends.values())
        with_ends = observation_of(task.model_with(tuple(dict.fromkeys((*self.taken, *ends))))).within(task.data)
        return TermSearch.at(
            table,
            found.model,
            with_ends.model,
            observed,
            found.values,
            found.fit.free,
            configurations(task.data.joints),
            found.extra_residuals,
            largest_std=TELLING,
            floor=1.0 if known else LEAST_SIGMA_M,
        )

    def _judge_terms(self, terms: set[str]) -> None:
        """Fill in the rows of the terms: each with what was taken before it."""
        large = self.large()
        table, whole = self.around(large), large.fitted(self.found)
        fitted = [i for i in whole if not any(i in large.groups[name] for name in self.taken)]
        for name in self.taken:
            own = [i for i in large.groups[name] if i in whole]
            fitted += own
            if name in terms:
                score = table.score(fitted)
                self.rows[name] = replace(
                    self.rows[name], parameters=len(own), holdout_m=float(score.errors.mean()), bic=score.bic
                )


def _next(
    large: FullModel,
    table: NestedModels,
    found: Identification,
    taken: tuple[str, ...],
    trials: Sequence[GroupTrial],
    small: Score,
) -> tuple[str, ...]:
    """Drop a superfluous group, or add the best of those worth it; else return the groups as they are."""
    fitted = large.fitted(found)
    bic = table.bic_without(fitted, [large.groups[name] for name in taken])
    if taken and bic.min() < small.bic:
        return tuple(name for name in taken if name != taken[int(bic.argmin())])
    worthy = [row for row in trials if not row.infeasibility_reason]
    return (*taken, min(worthy, key=lambda row: row.bic).name) if worthy else taken


def _trial(
    large: FullModel, table: NestedModels, found: Identification, name: str, small: Score, *, brief: bool = False
) -> GroupTrial:
    """Try a group beside an identified model, whose score is ``small``.

    Args:
        brief: whether a group that is not significant needs no numbers.
    """
    new, shown = large.added(table, found, name)
    fitted = large.fitted(found)
    if not shown:
        return _refused(name, "these poses do not show it" if new else "it adds nothing to the model")
    if large.least_rows < ROWS_PER_PARAMETER * (len(fitted) + len(shown)):
        return _refused(name, f"too few poses for {len(fitted) + len(shown)} parameters")
    big = table.score([*fitted, *shown])
    p = table.p_value(small, big)
    if brief and p * len(large.groups) >= MODEL_GROUPS:
        return _refused(name, _NOT_SIGNIFICANT)
    gain, clustered = table.gain(small, big), table.test_by_configurations(fitted, shown)
    why = objection(small, big, gain, p * len(large.groups)) or _by_configurations(clustered, gain, len(large.groups))
    fixed = tuple(large.observation.model.names[i] for i in new if i not in shown)
    return GroupTrial(
        name,
        len(shown),
        float(big.errors.mean()),
        p,
        big.bic,
        False,
        why,
        fixed,
        configurations=clustered,
        gain=gain,
    )


def objection(small: Score, big: Score, gain: HeldOutGain, p: float) -> str:
    """Return the objection to an extension, with ``p`` of the tests of all groups together; empty if none."""
    if p >= MODEL_GROUPS:
        return _NOT_SIGNIFICANT
    if big.bic > small.bic - _STRONG_EVIDENCE:
        return "BIC does not fall enough" if big.bic < small.bic else "BIC rises"
    return "" if gain.mean_m > gain.std_m else "the held-out error does not fall"


def _by_configurations(test: ClusterTest | None, gain: HeldOutGain, groups: int) -> str:
    """Return the objection of the test by configurations to one of so many groups; empty if it has none."""
    if test is None or test.p * groups < MODEL_GROUPS:
        return ""
    if test.can_reject:
        return f"{_NOT_SIGNIFICANT}: p = {test.p:.1g} by configurations, within which errors may be correlated"
    if gain.p * groups < MODEL_GROUPS:
        return ""
    return (
        f"undecided: the test by configurations has {test.dof:.2g} degrees of freedom, and the held-out error falls "
        f"with p = {gain.p:.1g}; measure more configurations"
    )


def _geometry(score: Score, *, brief: bool = False) -> GroupTrial:
    holdout_m = np.nan if brief else float(score.errors.mean())
    return GroupTrial(_GEOMETRY, score.parameters, holdout_m, np.nan, score.bic, True)


def _refused(name: str, why: str) -> GroupTrial:
    return GroupTrial(name, 0, np.nan, np.nan, np.nan, False, why)


def _alternatives(growth: _Growth) -> tuple[_Alternative, ...]:
    """Return, for each chosen group that bears loads, the others that fit as well in its place."""
    others = [name for name in _LOADED_GROUPS if name in growth.candidates and name not in growth.taken]
    pairs = [(chosen, other) for chosen in growth.taken if chosen in _LOADED_GROUPS for other in others]
    found = (_alternative(growth, chosen, other) for chosen, other in pairs)
    return tuple(each for each in found if each is not None)


def _alternative(growth: _Growth, chosen: str, other: str) -> _Alternative | None:
    """Identify with another group in the place of a chosen one; None where that does not fit as well."""
    task, found = growth.task, growth.found
    groups = [other if name == chosen else name for name in growth.taken]
    known = (set(task.parameters(other)) | set(found.model.names)) - task.parameters(chosen)
    fixed = [name for row in growth.rows.values() for name in row.fixed if name in known]
    swapped = task.identified(groups, fixed)
    rise = _misfit(swapped) - _misfit(found)
    if swapped.status != "converged" or rise >= _STRONG_EVIDENCE:
        return None
    return _compared(chosen, other, rise, found, swapped)


def _misfit(found: Identification) -> float:
    """Return twice the negative log likelihood, but for the terms common to all models of the same measurements."""
    squares, rows = 2 * found.fit.cost_trace[-1], found.dof + len(found.fit.free)
    return float(squares if found.sigma_given else rows * np.log(max(squares, 1e-300)))


def _compared(chosen: str, other: str, rise: float, found: Identification, swapped: Identification) -> _Alternative:
    model = found.model
    inputs = at_first_station(model.conditions, model.structure_joints(_POSES, rng_for(0, "structure")))
    size = inputs.shape[1] - len(found.model.conditions)
    column = {name: inputs[:, size + i] for i, name in enumerate(found.model.conditions)}
    others = [column.get(name, absent(name, _POSES)) for name in swapped.model.conditions]
    there = np.column_stack([inputs[:, :size], *others])
    apart = np.linalg.norm(
        found.model.points(inputs, found.values) - swapped.model.points(there, swapped.values), axis=2
    )
    worst = int(apart.max(axis=1).argmax())
    return _Alternative(chosen, other, float(rise), inputs[worst], float(apart[worst].max()), found.sigma_m)
