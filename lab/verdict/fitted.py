"""State that the steps of an identification pass on: measurements, fit, checks, validation, verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from lab.calibration.fitter import Fitter
from lab.calibration.gauss_newton import Observations
from lab.calibration.identification import Identification
from lab.calibration.noise_search import NoiseSearch
from lab.calibration.observation import observation_of, only_positions
from lab.calibration.residual.estimation import ExpectedGain, expected_gain
from lab.calibration.residual.gaussian_process import JointProcess, PredictedBy
from lab.calibration.row_groups import configurations
from lab.calibration.statistics.goodness_of_fit import lack_of_fit_not_tested
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.calibration.statistics.model_selection import Selection
from lab.calibration.statistics.outliers import HeldOut, Outliers
from lab.calibration.weights import weigh
from lab.core.checks import Check
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.progress import Progress, no_progress
from lab.diagnosis.hypothesis import Finding
from lab.diagnosis.range_constant import FittedRange, fitted_range
from lab.kinematics.effects.arm_with_effects import ArmWithEffects
from lab.kinematics.serial.serial_arm import SerialArm
from lab.noise.error_model import row_times
from lab.noise.rigid_distances import CoordinateNoise, instrument_noise
from lab.prediction.extrapolation import MeasuredRange
from lab.prediction.residual_spread import ResidualSpread, residual_spread
from lab.prediction.task_region import TaskRegion
from lab.prediction.validation import TruthComparison, Validation
from lab.prediction.workspace_prediction import ValidationBounds
from lab.verdict.remaining_error import (
    NEARLY,
    ExplainedError,
    RemainingError,
    explained_errors,
    remaining_error,
)
from lab.verdict.verdict import Verdict

__all__ = ["UNJUDGED", "Fitted", "JudgementOptions", "Named", "named_poses", "one_each"]


@dataclass(frozen=True)
class Named:
    """Pose that the test of outliers names.

    Attributes:
        id, line: of its row; no line where there is no file.
        size_m: distance of its farthest target from the prediction by the other poses.
        p: the chance that noise alone makes any pose of a campaign stand out as far.
        held_out: whether it was not fitted, but is judged by.
        whole: number of the picture that it is off with; -1 where it is off alone.
    """

    id: str
    line: int | None
    size_m: float
    p: float
    held_out: bool
    whole: int = -1


class _Missing:
    def __init__(self, part: str, step: str) -> None:
        self._why = f"the pipeline has no {part} yet: run the step '{step}' before this one"

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise LabError(self._why)


_NO_FIT: Any = _Missing("fit", "fit")
_NO_VERDICT: Any = _Missing("verdict", "judge")
_NO_SEARCH = NoiseSearch(None, (), float("nan"))
_NOT_VALIDATED = Validation(None, None)
_NOT_TESTED = lack_of_fit_not_tested("left out")


@dataclass(frozen=True)
class JudgementOptions:
    """Options of the judgement of a fit, in SI units.

    Attributes:
        gate_m: a larger mean error at poses not fitted is bad; None for no such limit.
        region: where the arm has to be known; None for where poses were measured.
        region_name: what errors call it.
        holdout: share of the poses to hold out at random; None for none.
        holdout_last: share of the last poses to hold out; None for none.
        other: further measurements to validate on; None where there are none.
        other_source: their file, as errors name it.
        refit: what each session of those may place anew: base, tool.
    """

    gate_m: float | None = None
    region: TaskRegion | None = None
    region_name: str = "region"
    holdout: float | None = None
    holdout_last: float | None = None
    other: Measurements | None = None
    other_source: str = ""
    refit: tuple[str, ...] = ()


UNJUDGED = JudgementOptions()  # by no gate, validated by folds


@dataclass(frozen=True)
class Fitted:
    """State of an identification: measurements and options, and what each step of the pipeline added.

    Attributes:
        fitter: of the arm; after the model is selected with the errors that the measurements share.
        given: the rows to fit.
        source: file of the measurements, as errors name it.
        progress: takes how many parts of the present step are done, of how many.
        selection: of the model's groups, on request.
        unshown: parameters of these that are not observable in these poses: fixed at zero.
        rows: those that the parameters come from.
        weighted: the fit, with the covariance that follows from its weights.
        observations: ``rows``, weighted as they were fitted.
        identification: the fit, with the intervals that the residuals support.
        outlier_search: the search for outliers that a robust fit ended with; None before one.
        outliers: left out of the fit on request.
        tail_dof: degrees of freedom of Student's t that the noise's tails are like; infinite where Gaussian's will do.
        measured: the joint positions of ``rows``, and what the model may lack beyond them; None where no points were
            observed.
        far: single poses that are far off, by their ids: root mean square length of their errors (m).
        diagnosis: mistakes in the measurements that a refit confirmed, the foremost first.
        findings: about the errors, beyond independent noise: steps, drift, scatter, effects that the model lacks.
        prediction: observed against predicted errors at the validation poses; None where they were not compared.
        bounds: predicted and observed 95 % errors at the validation poses; None where there are none.
        comparison: with the true parameters; None of a real arm, and where the true ones are not unique.
    """

    fitter: Fitter
    given: Measurements
    held_out: Measurements | None = None
    judging: JudgementOptions = UNJUDGED
    source: str = ""
    progress: Progress = field(default=no_progress, repr=False, compare=False)
    checks: tuple[Check, ...] = ()
    far: Mapping[str, float] = field(default_factory=dict)
    diagnosis: tuple[Finding, ...] = ()
    selection: Selection | None = None
    groups: tuple[str, ...] = ()
    unshown: tuple[str, ...] = ()
    noise: NoiseSearch = _NO_SEARCH
    rows: Measurements = _NO_FIT
    weighted: Identification = _NO_FIT
    observations: Observations = _NO_FIT
    identification: Identification = _NO_FIT
    outlier_search: Outliers | None = None
    outliers: tuple[Named, ...] = ()
    tail_dof: float = float("inf")
    adequacy: Check = _NOT_TESTED
    measured: MeasuredRange | None = None
    findings: tuple[Check, ...] = ()
    validation: Validation = _NOT_VALIDATED
    prediction: Check | None = None
    bounds: ValidationBounds | None = None
    comparison: TruthComparison | None = None
    verdict: Verdict = _NO_VERDICT

    def with_checks(self, checks: Sequence[Check]) -> "Fitted":
        """Return the state with further checks."""
        return replace(self, checks=(*self.checks, *checks))

    @property
    def misread(self) -> bool:
        """Check whether the readings have a gross mistake that nobody has accepted."""
        return any(each.is_discrete and not each.accepted for each in self.diagnosis)

    @property
    def left_out(self) -> bool:
        """Check whether outliers were left out of the fit."""
        return self.fitter.options.robust

    def with_fit(self, found: Identification, rows: Measurements) -> "Fitted":
        """Return the state with a fit of these rows."""
        observations = weigh(observation_of(found.model), rows, self.fitter.noise)[0]
        state = replace(self, rows=rows, weighted=found, observations=observations, identification=found)
        return state.with_checks(found.checks)

    @property
    def process(self) -> JointProcess | None:
        """Joint offsets that no group explains; None where they were not requested."""
        found = self.identification.process
        return found.process if isinstance(found, PredictedBy) else None

    @cached_property
    def residual_spread(self) -> ResidualSpread:
        """Spread of the residuals of the measured positions, with configurations as clusters."""
        shared, lacks = self.noise.shared, self.adequacy.outcome == "failed"
        independent_m = None if shared is None else shared.independent_m
        labels = configurations(self.rows.joints)
        return residual_spread(self.identification, labels, lack_of_fit=lacks, independent_m=independent_m)

    @cached_property
    def range(self) -> FittedRange | None:
        """Range errors of the instrument; None where its head's position is unknown."""
        return fitted_range(self.identification)

    @cached_property
    def remaining(self) -> RemainingError | None:
        """Sources of the remaining error; None where no points were observed, or no residuals are left."""
        found, rows = self.identification, self.rows
        if not only_positions(observation_of(found.model)) or found.process is not None:
            return None
        groups = () if self.selection is None else self.selection.groups
        size = rows.joints.shape[1]
        return remaining_error(
            found.residuals,
            rows.joints,
            row_times(rows),
            found.dof,
            instrument_m=self._instrument_m,
            shared=self.noise.shared,
            scatter_slopes=by_joint_positions(found.model, rows.inputs(found.model.conditions), found.values, size),
            nearly=tuple(group.name for group in groups if not group.chosen and group.f_p < NEARLY),
            searched=self.selection is not None and self.selection.searched,
        )

    @property
    def _instrument_m(self) -> float:
        """The instrument's noise of a coordinate (m): given, else by distances between targets; NaN where unknown."""
        if self.identification.sigma_given:
            shared = self.noise.shared
            return self.identification.sigma_m if shared is None else shared.independent_m
        distances = self.instrument
        return distances.sigma_m if distances is not None and distances.is_rigid else float("nan")

    @cached_property
    def gain(self) -> ExpectedGain | None:
        """Expected gain of the group residual; None unless residuals of neighbouring joint positions are correlated."""
        if self.remaining is None or self.remaining.over_joints is None or not self.remaining.over_joints.is_shown:
            return None
        is_serial = isinstance(self.identification.model, SerialArm | ArmWithEffects)
        return expected_gain(self.identification, self.rows) if is_serial else None

    @cached_property
    def explained(self) -> dict[str, ExplainedError]:
        """Error explained by each group of the model; empty where no points were observed, or beside a process."""
        found = self.identification
        if not only_positions(observation_of(found.model)) or found.process is not None:
            return {}
        own = {name: [each.name for each in found.model.parameters if each.group == name] for name in self.groups}
        each = explained_errors(found.model, self.rows, found.values, found.fit.free, own)
        return {one.group: one for one in each}

    @cached_property
    def instrument(self) -> CoordinateNoise | None:
        """Instrument noise estimated from distances between targets; None where these do not determine it."""
        if not only_positions(observation_of(self.identification.model)):
            return None
        return instrument_noise(self.rows.points)


def one_each(outliers: Sequence[Named]) -> tuple[Named, ...]:
    """Return the outliers with each picture that is off as a whole once: its corner that is farthest off."""
    first = dict[tuple[bool, object], Named]()
    for pose in outliers:
        first.setdefault((pose.held_out, pose.id if pose.whole < 0 else pose.whole), pose)
    return tuple(first.values())


def named_poses(rows: Measurements, found: Outliers | HeldOut, *, held_out: bool = False) -> tuple[Named, ...]:
    """Return the poses that the outlier test found, by the rows' own names."""
    lines = [rows.lines[i] if rows.lines else None for i in found.rows]
    wholes = found.wholes.tolist() if len(found.wholes) else [-1] * len(found.rows)
    parts = zip(found.rows, lines, found.sizes_m, found.p_values, wholes, strict=True)
    return tuple(Named(rows.ids[i], line, float(size), float(p), held_out, of) for i, line, size, p, of in parts)
