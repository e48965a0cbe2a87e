"""Which effects an arm has: the smallest adequate model, found by adding one group of parameters after another.

A group is taken if three things say so: an F-test (and a chi squared test where sigma is known) at 1 %, Bonferroni's
over the groups; BIC; and the error at held-out poses, which must fall by more than its own standard error. Residuals
of real arms are correlated and heavy-tailed, so that the first two alone say yes to nearly everything.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lab.calibration.identify import Identification, IdentifyOptions
from lab.calibration.observations.protocol import observation_of
from lab.calibration.statistics.candidate_models import FullModel, ModelWith, NominalOf, SelectionTask
from lab.calibration.statistics.nested_models import NestedModels, Score
from lab.calibration.validation import ROWS_PER_PARAMETER
from lab.calibration.weights import Noise
from lab.core.errors import IncompleteColumnError
from lab.core.measurements import Measurements
from lab.core.significance import MODEL_GROUPS
from lab.kinematics.effects.registry import CANDIDATES

__all__ = ["GroupTrial", "Selection", "follow", "objection", "select"]

_GEOMETRY = "geometric"
_BIC_FALL = 10.0  # what is very strong evidence (Kass & Raftery 1995, section 3.2)


@dataclass(frozen=True)
class GroupTrial:
    """What one group of parameters is worth.

    Attributes:
        name: of the group; ``geometry`` for the arm without any.
        parameters: how many it adds to those fitted.
        holdout_m: mean length of the error at held-out poses with it and what was taken before it; NaN if not tried.
        f_p: the chance of as large a fall in squares if it were not there (``NestedModels.p_value``), no Bonferroni's
            factor in it; NaN if not tried.
        bic: of that model; NaN if not tried.
        chosen: whether it is in the final model; the others are tried beside that.
        infeasibility_reason: why it is not; empty where it is.
        incomplete_data: whether that is because a column that it needs has gaps.
        held: its parameters that are not fitted, as these poses do not show them, or not to any use.
    """

    name: str
    parameters: int
    holdout_m: float
    f_p: float
    bic: float
    chosen: bool
    infeasibility_reason: str = ""
    held: tuple[str, ...] = ()
    incomplete_data: bool = False


@dataclass(frozen=True)
class Selection:
    """The smallest adequate model.

    Attributes:
        chosen: its groups, in the order in which they were taken.
        identification: of that model.
        groups: geometry alone, the chosen ones in their order, then the others.
    """

    chosen: tuple[str, ...]
    identification: Identification
    groups: tuple[GroupTrial, ...]

    @property
    def held(self) -> tuple[str, ...]:
        """Parameters of the chosen groups that are not fitted: to be fixed wherever this model is fitted again."""
        return tuple(name for group in self.groups if group.chosen for name in group.held)


def select(
    model_with: ModelWith,
    data: Measurements,
    nominal: NominalOf,
    noise: Noise | None = None,
    request: IdentifyOptions | None = None,
    *,
    candidates: Sequence[str] = CANDIDATES,
    seed: int = 0,
) -> Selection:
    """Identify with geometry alone, then with whatever groups the measurements call for.

    After each group the arm is identified anew and all others are tried around that; one taken earlier whose
    removal would now lower BIC is dropped.

    Args:
        model_with: the arm with groups of effects, by name; a LabError where a group cannot be built.
        nominal: the nominal parameters of such a model.
        candidates: groups to try, those of ``kinematics.effects`` or the caller's own.
        seed: of the folds.

    Raises:
        LabError: geometry alone cannot be identified.
    """
    task = SelectionTask(model_with, nominal, data, noise or Noise(), request or IdentifyOptions())
    task.refuse_unknown_wishes(candidates)
    alone = task.identified(())
    refused = {
        name: replace(_refused(name, str(why)), incomplete_data=isinstance(why, IncompleteColumnError))
        for name in candidates
        if (why := task.refusal(name)) is not None
    }
    large = FullModel.of(task, [name for name in candidates if name not in refused], alone, seed)
    taken, found, rows = _grown(task, large, alone)
    rows |= refused
    chosen = [replace(rows[name], chosen=True) for name in taken]
    return Selection(
        taken, found, (rows[_GEOMETRY], *chosen, *(rows[name] for name in candidates if name not in taken))
    )


def follow(
    model_with: ModelWith,
    data: Measurements,
    nominal: NominalOf,
    groups: Sequence[str],
    noise: Noise | None = None,
    request: IdentifyOptions | None = None,
    *,
    seed: int = 0,
) -> Selection:
    """Identify with the groups that are asked for, and say of each, in their order, what it buys.

    What speaks against a group is said in ``infeasibility_reason``, and does not keep it out.

    Args:
        model_with, nominal, seed: as for ``select``.

    Raises:
        LabError: a group cannot be built, or has no measurements to fit it by.
    """
    task = SelectionTask(model_with, nominal, data, noise or Noise(), request or IdentifyOptions())
    data.inputs(observation_of(model_with(groups)).model.conditions)
    task.refuse_unknown_wishes(groups)
    found = task.identified(())
    large = FullModel.of(task, groups, found, seed)
    table = large.around(found)
    rows = [_geometry(table.score(large.fitted(found)))]
    for count, name in enumerate(groups, start=1):
        rows.append(replace(_trial(large, table, found, name), chosen=True, held=()))
        found = task.identified(groups[:count])
        table = large.around(found)
    return Selection(tuple(groups), found, tuple(rows))


def _grown(
    task: SelectionTask, large: FullModel, found: Identification
) -> tuple[tuple[str, ...], Identification, dict[str, GroupTrial]]:
    """From an identification of geometry alone: the groups taken, the arm with them, and all rows of the table."""
    table = large.around(found)
    rows = {_GEOMETRY: _geometry(table.score(large.fitted(found)))}
    stuck: dict[str, GroupTrial] = {}
    taken: tuple[str, ...] = ()
    for _ in range(3 * len(large.groups) + 1):  # BIC falls at each step, rounding and curvature aside
        left = [name for name in large.groups if name not in (*taken, *stuck)]
        rows |= {name: _trial(large, table, found, name) for name in left}
        moved = _next(large, table, found, taken, [rows[name] for name in left])
        if moved == taken:
            break
        tried = task.identified(moved, [parameter for name in moved for parameter in rows[name].held])
        if tried.status != "converged" and len(moved) > len(taken):
            stuck[moved[-1]] = _refused(moved[-1], "Gauss-Newton does not converge with it")
            continue
        taken, found = moved, tried
        table = large.around(found)
    return taken, found, rows | stuck


def _next(
    large: FullModel, table: NestedModels, found: Identification, taken: tuple[str, ...], trials: Sequence[GroupTrial]
) -> tuple[str, ...]:
    """The groups taken, less one that is superfluous now, or with the best of those worth it; else the same."""
    fitted = large.fitted(found)
    bic = {name: table.score([i for i in fitted if i not in large.groups[name]]).bic for name in taken}
    if bic and bic[least := min(bic, key=bic.__getitem__)] < table.score(fitted).bic:
        return tuple(name for name in taken if name != least)
    worthy = [row for row in trials if not row.infeasibility_reason]
    return (*taken, min(worthy, key=lambda row: row.bic).name) if worthy else taken


def _trial(large: FullModel, table: NestedModels, found: Identification, name: str) -> GroupTrial:
    """What a group would add to an identified model."""
    new, shown = large.added(table, found, name)
    fitted = large.fitted(found)
    if not shown:
        return _refused(name, "these poses do not show it" if new else "it says nothing that the model does not say")
    if large.least_rows < ROWS_PER_PARAMETER * (len(fitted) + len(shown)):
        return _refused(name, f"too few poses for {len(fitted) + len(shown)} parameters")
    small, big = table.score(fitted), table.score([*fitted, *shown])
    p = table.p_value(small, big)
    why = objection(table, small, big, p * len(large.groups))
    held = tuple(large.observation.model.names[i] for i in new if i not in shown)
    return GroupTrial(name, len(shown), float(big.errors.mean()), p, big.bic, False, why, held)


def objection(table: NestedModels, small: Score, big: Score, p: float) -> str:
    """What speaks against an extension, with ``p`` of the tests of all groups together; empty if nothing does."""
    fall, error = table.gain(small, big)
    if p >= MODEL_GROUPS:
        return "not significant"
    if big.bic > small.bic - _BIC_FALL:
        return "BIC does not fall enough" if big.bic < small.bic else "BIC rises"
    return "" if fall > error else "the held-out error does not fall"


def _geometry(score: Score) -> GroupTrial:
    """The first row: no group."""
    return GroupTrial(_GEOMETRY, score.parameters, float(score.errors.mean()), np.nan, score.bic, True)


def _refused(name: str, why: str) -> GroupTrial:
    """A group that was not tried."""
    return GroupTrial(name, 0, np.nan, np.nan, np.nan, False, why)
