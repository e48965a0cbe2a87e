"""What a set of measurements says: the model asked for or found, the poses that are off, and how far to trust it."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from lab.calibration.extrapolation import measured_range
from lab.calibration.identify import Identification, IdentifyOptions, identify
from lab.calibration.noise.plausibility import NoiseFinding, changes_in_time, shared_error_findings
from lab.calibration.noise.search import NoiseSearch
from lab.calibration.observation import observation_of, only_positions
from lab.calibration.prior import Tolerance
from lab.calibration.residual.estimation import with_residual
from lab.calibration.residual.process import GROUP, JointProcess
from lab.calibration.sensor import Sensor
from lab.calibration.stations import named_stations
from lab.calibration.statistics.candidate_models import ModelWith, SelectionTask
from lab.calibration.statistics.goodness_of_fit import NOT_TESTED, GoodnessOfFit
from lab.calibration.statistics.joint_lag import moves_before
from lab.calibration.statistics.linearized import NoiseDistribution
from lab.calibration.statistics.model_selection import Selection, follow, select
from lab.calibration.statistics.outliers import Outliers
from lab.calibration.statistics.replicates import repeats
from lab.calibration.weights import Noise, weighed
from lab.campaign.option_groups import Fitting
from lab.campaign.robot import Robot
from lab.commands.calibrate.fit_result import FitReport, named_poses
from lab.commands.calibrate.last_made import EachMade, LastMade
from lab.commands.calibrate.noise import noise_of
from lab.commands.calibrate.off_poses import off_among_fitted, off_among_held, tail_of
from lab.commands.calibrate.residuals import adequacy_of, with_intervals_of_poses, with_own_intervals
from lab.commands.calibrate.warnings import (
    of_approaches,
    of_export,
    of_groups,
    of_held_out,
    of_instrument,
    of_joints,
    of_nominal,
    of_outliers,
    of_prior,
    of_residual,
    of_size,
    of_stuck_search,
    of_twist,
    of_weakness,
)
from lab.core.errors import LabError
from lab.core.measurements import Measurements, thinned
from lab.core.se3 import Array
from lab.kinematics.effects.arm import Arm
from lab.kinematics.effects.backlash import approached_groups
from lab.kinematics.effects.conditions import CHANGING_WITH_TIME
from lab.kinematics.effects.effect import ArmFacts, SessionInfo
from lab.kinematics.effects.registry import CANDIDATES, expected_terms, said_of_term, searched_terms
from lab.kinematics.encoders import Encoders
from lab.kinematics.model import Model
from lab.kinematics.serial.arm import SerialArm
from lab.noise.error_model import ErrorModel

__all__ = ["Fitter"]

_CLEANINGS = 5  # of the poses and what they are validated on
_BALANCINGS = 3  # of the weights of poses and the choice of groups by each other
_MOST_NAMED = 3  # effects that a model lacks, in a sentence: more are not looked for
_MOST_TESTED = 1_000  # poses by which such effects are looked for: of more than that each shows hardly more
_MOST_CHOSEN_BY = 8_000  # poses by which groups are chosen: 1 GB


@dataclass(frozen=True)
class Fitter:
    """How measurements of one arm are fitted.

    Attributes:
        targets: of the arm: those of ``kind`` in ``data``.
        data: all measurements, as the file holds them.
        kind: of observation, with its options.
        judged_by: further rows that the model must be able to answer, with the groups that it does without there.
    """

    robot: Robot
    targets: tuple[str, ...]
    data: Measurements
    kind: Sensor
    noise: Noise
    options: Fitting
    seed: int
    judged_by: tuple[tuple[Measurements, tuple[str, ...]], ...] = ()
    _arms: EachMade[Arm] = field(default_factory=EachMade, repr=False, compare=False)
    _last_fit: LastMade = field(default_factory=LastMade, repr=False, compare=False)
    _last_outliers: LastMade = field(default_factory=LastMade, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Refuse what no identification of these measurements has.

        Raises:
            LabError: the group ``residual`` is asked of something else than measured points of a serial arm.
        """
        if not self.options.residual:
            return
        instead = "" if self.kind.name == "points" else f"--observe {self.kind.name}"
        instead = instead if isinstance(self.robot.arm(self.targets), SerialArm) else "a mechanism with loops"
        if instead:
            raise LabError(f"--model residual: it takes measured points of a serial arm, not {instead}; leave it out")

    def model_with(self, groups: Sequence[str]) -> Model:
        """The arm with groups of effects, as it is observed."""
        arm = self._arm_with(groups)
        return self.kind.observation(arm, self.data, arm.nominal(self.robot.tool))[0]

    def _arm_with(self, groups: Sequence[str]) -> Arm:
        return self._arms(lambda: self.robot.arm_with(self.targets, groups, self.course), tuple(groups))

    @cached_property
    def course(self) -> SessionInfo:
        """Of the measurements that are to be fitted."""
        rows = self.data.only("calibrate")
        rows = rows.take(np.flatnonzero(self.kind.rows(rows)))
        time_s = rows.conditions.get("time_s", np.zeros(1))
        given = time_s[np.isfinite(time_s)]
        started = float(given[0]) if len(given) else 0.0
        stations = named_stations(rows, self.robot.model.stations) if self.kind.in_instrument_frame else ()
        sessions = tuple(dict.fromkeys(rows.sessions))
        return SessionInfo(sessions, started, timed="time_s" in rows.conditions, stations=stations)

    def observed(self) -> Measurements:
        """What is observed of the measurements."""
        arm = self.robot.arm(self.targets)
        return self.kind.observation(arm, self.data, arm.nominal(self.robot.tool))[1]

    def nominal(self, model: Model) -> Array:
        """The nominal parameters of one of these models."""
        arm = self.robot.arm(self.targets)
        known = dict(zip(arm.names, arm.nominal(self.robot.tool), strict=True))
        return np.array([known.get(name, 0.0) for name in model.names])

    @property
    def request(self) -> IdentifyOptions:
        """What is asked of the identification."""
        chosen = self.options
        automatic = chosen.prior == "auto"  # what the joints' offsets explain is fitted to parameters without a prior
        tolerance = self.tolerance if chosen.prior == "on" or (automatic and not chosen.residual) else None
        return IdentifyOptions(chosen.fix, chosen.free, tolerance, automatic, self.kind.solve)

    @property
    def tolerance(self) -> Tolerance:
        """Of manufacture."""
        return Tolerance(self.options.tolerance_mm / 1e3, self.options.tolerance_mrad / 1e3)

    def modelled(self, groups: Sequence[str], held: Sequence[str]) -> tuple[Model, IdentifyOptions]:
        """The arm with these groups less the parameters held, and what is asked of its identification."""
        model = self.model_with(groups)
        request = self.request if self.options.parametric == "geometric" else self.request.of(model.names)
        return model, replace(request, fix=(*request.fix, *held))

    def identified(
        self, rows: Measurements, groups: Sequence[str], held: Sequence[str] = ()
    ) -> tuple[Identification, Measurements, Outliers | None]:
        """One identification of the arm with these groups, the rows that it comes from, and what was left out.

        Args:
            held: parameters of the groups that the selection found these poses not to show.
        """
        found, clean, outliers = self.identified_with(rows, groups, held), rows, None
        model, request = self.modelled(groups, held)
        for _ in range(_CLEANINGS if self.options.robust else 0):  # a prior weighs by a sigma that outliers inflate
            before, outliers = outliers, self.outliers_of(found, rows)
            if before is not None and set(before.rows) == set(outliers.rows):
                break
            clean = rows.take(np.setdiff1d(np.arange(len(rows)), outliers.rows))
            found = self.identified_from(model, clean, request)
        return found, clean, outliers

    def identified_with(self, rows: Measurements, groups: Sequence[str], held: Sequence[str]) -> Identification:
        """One identification of the arm with these groups from all these rows."""

        def make() -> Identification:
            model, request = self.modelled(groups, held)
            return self.identified_from(model, rows, request)

        return self._last_fit(make, rows, groups, held, self.kind, self.noise.shared)

    def __call__(self, rows: Measurements, held: Measurements | None = None) -> FitReport:
        """Everything that the rows say.

        Args:
            rows, held: some of what is observed; ``held`` are poses held out, by which lack of fit can be tested.
        """
        fitter, selection, search = self._balanced_selection(rows)
        return fitter._report(rows, held, selection, search)

    def _balanced_selection(self, rows: Measurements) -> tuple["Fitter", Selection | None, NoiseSearch]:
        """The model that the rows call for, and their noise: each is chosen with the other."""
        fitter, selection, search = self._balanced(rows)
        if selection is None or not (doubted := self._doubted_by_time(selection)):
            return fitter, selection, search
        rest = tuple(name for name in selection.chosen if name not in doubted)
        without = noise_of(_OneModel(self, rest, selection.held_of(rest)), rows)
        if without.shared is None or not without.shared.wandering_m:
            return fitter, selection, search
        again = self.knowing(without.shared)._selected(rows)
        if again is None or set(doubted) <= set(again.chosen):
            return fitter, selection, search
        return self._with_own_noise(again, rows)

    def _doubted_by_time(self, selection: Selection) -> tuple[str, ...]:
        """The groups that ``auto`` chose for what follows time, as errors that wander do, too.

        Beside such a group the errors wander less, and it is then believed too readily: it has to stand beside the
        wandering that is found without it.
        """
        if self.options.parametric != "auto":
            return ()
        return tuple(
            name for name in selection.chosen if set(CHANGING_WITH_TIME) & set(self._arm_with([name]).conditions)
        )

    def _with_own_noise(self, selection: Selection, rows: Measurements) -> tuple["Fitter", Selection, NoiseSearch]:
        """A selection with the noise that its model leaves."""
        search = noise_of(_OneModel.of(self, selection), rows)
        return self.knowing(search.shared), selection, search

    def _balanced(self, rows: Measurements) -> tuple["Fitter", Selection | None, NoiseSearch]:
        """The same, where no group is doubted."""
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

    def knowing(self, shared: ErrorModel | None) -> "Fitter":
        """The fitter with the errors that its measurements share."""
        return replace(self, noise=replace(self.noise, shared=shared))

    def _report(
        self, rows: Measurements, held: Measurements | None, selection: Selection | None, search: NoiseSearch
    ) -> FitReport:
        groups, unshown = (selection.chosen, selection.held) if selection else ((), ())
        found, clean, outliers = self.identified(rows, groups, unshown)
        observation, robust, model = observation_of(found.model), self.options.robust, self.options.parametric
        observations, known = weighed(observation, clean, self.noise)
        outliers = outliers or self.outliers_of(found, rows)
        off, tail = named_poses(rows, outliers), tail_of(found, clean, self.noise)
        if held is not None and observation.positions:
            off += named_poses(held, off_among_held(found, clean, held, self.noise, tail), held_out=True)
        judged_by = held if held is None or not robust else held.without([pose.id for pose in off])
        judged = adequacy_of(found, clean, judged_by, self.noise, self._shape)
        warnings = [judged.words] if judged.adequate is False and not self.options.residual else []
        warnings += [] if robust else of_outliers(found, observations, outliers, model)
        trusted = search.corrected(found)
        cause: list[str] = []  # of intervals that are those of whole poses
        if search.undecided and found.prior is None and not self.options.residual:
            trusted, cause = with_intervals_of_poses(found, observations, model)
        elif only_positions(observation) and search.shared is None:
            believed = known or found.prior is not None
            trusted, cause = with_own_intervals(found, observations, self.noise, model, believed)
        warnings += cause
        warnings += of_held_out(off)
        warnings += of_stuck_search(outliers) + of_groups(groups, selection, self.data)
        if model == "auto" or "backlash" in self.options.groups:
            warnings += of_approaches(self.robot.chain, self.data, searched=model == "auto")
        if model == "auto":
            refused = {name: self.unanswerable(name) for name in self._approached(CANDIDATES)}
            warnings += [f"{name} is not tried, for rows to judge by: {why}" for name, why in refused.items() if why]
            if len(rows) > _MOST_CHOSEN_BY:
                warnings.append(f"groups were chosen by {_MOST_CHOSEN_BY:,} of the {len(rows):,} poses, taken evenly")
        if self.options.prior == "on":
            warnings += of_prior(found, self.nominal(found.model), self.tolerance)
        warnings += of_nominal(found, self.nominal(found.model))
        warnings += of_size(found)
        if only_positions(observation):
            warnings += of_instrument(self.noise.instrument, clean.points)
            warnings += of_weakness(self.robot, self.targets, groups, found, observations.inputs, self.course)
        moves, encoders = moves_before(self.data, clean.ids), self.robot.chain.encoders
        omitted = partial(self._derivatives_by_others, found, groups)
        warnings += of_joints(found, observations, clean, moves, encoders, omitted)
        warnings += of_twist(self.robot, found)
        slopes = not self.options.residual  # whose process says itself what it does not know beyond an end
        measured = measured_range(found, observations, self.robot.chain.prismatic, slopes=slopes)
        if self.options.residual:
            trusted, judged = with_residual(found, clean), NOT_TESTED
            search, tail = replace(search, shared=None), float("inf")  # the process has its own
            warnings += of_residual(trusted)
        warnings += of_export(self.robot, trusted, (*groups, *[GROUP] * self.options.residual), observations.inputs)
        findings = () if self.options.residual else self._findings(found, clean, search.shared, judged, selection)
        said = tuple(warnings)
        return FitReport(
            trusted, clean, groups, unshown, off, robust, judged, selection, said, search, tail, measured, findings
        )

    def _findings(
        self,
        found: Identification,
        rows: Measurements,
        shared: ErrorModel | None,
        adequacy: GoodnessOfFit,
        selection: Selection | None,
    ) -> tuple[NoiseFinding, ...]:
        """Findings about the errors of an identification from these rows."""
        observation = observation_of(found.model)
        if not only_positions(observation) or found.status != "converged":
            return ()
        findings = shared_error_findings(found, rows, shared, adequacy, repeats(rows))
        tested = self.options.parametric == "auto" or (adequacy.by == "chi2" and adequacy.adequate is True)
        beside = None if tested else self._with_missing_effects(rows, selection)
        if not any(each.kind in ("step", "drift", "correlated") for each in findings):
            fullest = found if beside is None else beside.identification  # what an effect explains did not change
            observed, _ = weighed(observation_of(fullest.model), rows, self.noise.independent)
            findings += changes_in_time(fullest, observed, rows)
        first = [each for each in findings if each.between] + ([] if beside is None else [_missing(beside)])
        first.sort(key=lambda each: -each.size_m)
        return (*first, *(each for each in findings if not each.between))

    def _with_missing_effects(self, rows: Measurements, selection: Selection | None) -> Selection | None:
        """Search the first effects that ``auto`` would add to the model, a test of lack of fit; None if there are none.

        Args:
            selection: of the model's groups; None for geometry alone.
        """
        groups, held = (selection.chosen, selection.held) if selection else ((), ())
        others = [name for name in self._approached(CANDIDATES) if name not in groups]
        request, some = self.modelled(groups, held)[1], thinned(rows, _MOST_TESTED)
        plain = self.knowing(self.noise.independent.shared)
        try:
            beside = plain._searched(lambda more: self.model_with((*groups, *more)), some, request, others, _MOST_NAMED)
        except LabError:  # too few rows to add anything
            return None
        return beside if beside.chosen else None

    def _searched(
        self,
        model_with: ModelWith,
        rows: Measurements,
        request: IdentifyOptions,
        candidates: Sequence[str],
        enough: int | None = None,
    ) -> Selection:
        """Select groups and single joints' terms for some rows.

        Args:
            enough: how many groups end the search; None where nothing does.
        """
        facts = ArmFacts(self.robot.chain, self.robot.loads, self.course)
        return select(
            model_with,
            rows,
            self.nominal,
            self.noise,
            request,
            candidates=candidates,
            terms=searched_terms(facts),
            expected=expected_terms(facts),
            seed=self.seed,
            enough=enough,
        )

    def _derivatives_by_others(self, found: Identification, groups: Sequence[str], rows: Measurements) -> list[Array]:
        """Derivatives of what rows observe by the parameters of each candidate group that is not in the model."""
        task = SelectionTask(self.model_with, self.nominal, rows, self.noise, self.request)
        made = []
        for name in CANDIDATES:
            if name not in groups:
                with suppress(LabError):  # a group that the arm or the columns do not allow
                    made.append(task.derivatives(name, found))
        return made

    def predicting(
        self, rows: Measurements, groups: Sequence[str], held: Sequence[str], process: JointProcess | None = None
    ) -> Identification:
        """One identification, outliers left out if asked for, with what no group explains where that is asked for.

        Args:
            process: of all rows, whose variances are taken.
        """
        found, clean, _ = self.identified(rows, groups, held)
        return with_residual(found, clean, process) if self.options.residual else found

    def _selected(self, rows: Measurements) -> Selection | None:
        """The groups that the rows call for, or that are asked for; None for geometry alone."""
        if self.options.parametric == "geometric":
            return None
        groups, task = (
            self._approached(self.options.groups),
            SelectionTask(self.model_with, self.nominal, rows, self.noise, self.request),
        )
        task.refuse_unknown_wishes(CANDIDATES if self.options.parametric == "auto" else groups)
        found, clean, outliers = self.identified(rows, groups)
        if self.options.parametric != "auto":
            model_with = self._weighed_as(found).model_with
            return follow(model_with, clean, self.nominal, groups, self.noise, self.request, seed=self.seed)
        selection = self._chosen(found, clean)
        if outliers is None or not len(outliers.rows):
            return selection
        other = self._chosen(found, rows)  # a few poses that alone show an effect look like outliers without it
        if set(other.chosen) == set(selection.chosen):
            return selection
        kept = [len(self.identified(rows, s.chosen, s.held)[1]) for s in (selection, other)]
        return other if kept[1] > kept[0] else selection

    def _chosen(self, found: Identification, rows: Measurements) -> Selection:
        """The groups that some rows call for; of poses, weighed as geometry and then the groups balance them.

        Of very many, as many as bound the memory, evenly: each is held with the columns of all groups and waves.
        """
        selection, rows = None, thinned(rows, _MOST_CHOSEN_BY)
        for _ in range(_BALANCINGS):
            before, weighed_so = selection, self._weighed_as(found)
            tried = [name for name in self._approached(CANDIDATES) if not self.unanswerable(name)]
            selection = self._searched(weighed_so.model_with, rows, self.request, tried)
            if weighed_so is self or (before and before.chosen == selection.chosen):
                break
            found, _, _ = self.identified(rows, selection.chosen, selection.held)
        assert selection is not None
        return selection

    def _approached(self, groups: Sequence[str]) -> tuple[str, ...]:
        """The groups, with backlash of those joints alone whose direction of approach the file has, if it has some."""
        play = approached_groups(self.robot.chain, self.data.conditions)
        return tuple(dict.fromkeys(each for name in groups for each in (play if name == "backlash" else (name,))))

    def unanswerable(self, group: str) -> str:
        """What is missing for a group in the rows that are to be judged by; empty if nothing is."""
        for rows, without in self.judged_by:
            if group not in without:
                with suppress(LabError):  # a group that cannot be built says so elsewhere
                    conditions = self._arm_with([group]).conditions
                    try:
                        rows.inputs(conditions)
                    except LabError as error:
                        return str(error)
        return ""

    def _weighed_as(self, found: Identification) -> "Fitter":
        """The fitter with the weights that an identification estimated; itself where nothing is estimated."""
        kind = self.kind.weighed_as(found.model)
        return self if kind == self.kind else replace(self, kind=kind)

    @property
    def _shape(self) -> NoiseDistribution:
        """Of the assumed noise; what was estimated beside an instrument's bounded one has tails."""
        shared, device = self.noise.shared, self.noise.instrument if self.noise.sigma_m is None else None
        uniform = device is not None and device.kind == "uniform" and (shared is None or shared.is_known)
        return NoiseDistribution("uniform", self.noise.readings) if uniform else NoiseDistribution()

    def identified_from(self, model: Model, rows: Measurements, request: IdentifyOptions) -> Identification:
        """The parameters of a model from all these rows."""
        model = self.kind.balanced(model, rows, self.nominal(model), request)
        return identify(model, rows, self.nominal(model), self.noise, request)

    def outliers_of(self, start: Identification, rows: Measurements) -> Outliers:
        """The rows that are off, by a search that starts from an identification."""
        return self._last_outliers(
            lambda: off_among_fitted(start, rows, self.noise, self._shape, self.seed), start, rows, self.noise.shared
        )


@dataclass(frozen=True)
class _OneModel:
    """How one model of a fitter fits any rows."""

    fitter: Fitter = field(compare=False)
    groups: tuple[str, ...]
    held: tuple[str, ...]

    @staticmethod
    def of(fitter: Fitter, selection: Selection | None) -> "_OneModel":
        """That a selection ended with; geometry alone without one."""
        return _OneModel(fitter, *((selection.chosen, selection.held) if selection else ((), ())))

    @property
    def noise(self) -> Noise:
        """Of the instrument."""
        return self.fitter.noise

    @property
    def encoders(self) -> Encoders | None:
        """Of the robot's table."""
        return self.fitter.robot.chain.encoders

    def fitted(self, rows: Measurements, shared: ErrorModel | None) -> Identification:
        """The identification from all these rows."""
        return self.fitter.knowing(shared).identified_with(rows, self.groups, self.held)

    def outliers(self, found: Identification, rows: Measurements, shared: ErrorModel | None) -> Outliers:
        """The poses that are off."""
        return self.fitter.knowing(shared).outliers_of(found, rows)


def _missing(beside: Selection) -> NoiseFinding:
    """The finding of effects that a model lacks.

    Args:
        beside: the selection that found them.
    """
    before, after = beside.groups[0].holdout_m, beside.groups[len(beside.chosen)].holdout_m
    named = ", ".join(said_of_term(name) or name for name in beside.chosen)
    words = (
        f"lack of fit: {named} would explain errors that are called noise (mean error of held-out poses "
        f"{1e3 * before:.3g} mm without, {1e3 * after:.3g} mm with): fit with --model auto"
    )
    return NoiseFinding("missing", float(np.sqrt(max(before**2 - after**2, 0.0))), False, words)


def _kinds(shared: ErrorModel | None) -> tuple[str, ...]:
    """Which errors are shared."""
    return () if shared is None else shared.kinds
