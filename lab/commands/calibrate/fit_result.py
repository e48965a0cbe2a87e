"""What a set of measurements was found to say."""

from dataclasses import dataclass
from functools import cached_property

from lab.calibration.extrapolation import MeasuredRange
from lab.calibration.identify import Identification
from lab.calibration.noise.plausibility import NoiseFinding
from lab.calibration.noise.rigid_distances import InstrumentNoise, instrument_noise
from lab.calibration.noise.search import NoiseSearch
from lab.calibration.observation import observation_of, only_positions
from lab.calibration.residual.estimation import ExpectedGain, expected_gain
from lab.calibration.residual.process import JointProcess, PredictedBy
from lab.calibration.residual_spread import ResidualSpread, residual_spread
from lab.calibration.statistics.explained_error import ExplainedError, explained_errors
from lab.calibration.statistics.goodness_of_fit import GoodnessOfFit
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.calibration.statistics.model_selection import Selection
from lab.calibration.statistics.outliers import HeldOut, Outliers
from lab.calibration.statistics.remaining_error import NEARLY, RemainingError, remaining_error
from lab.calibration.validation import configurations
from lab.core.measurements import Measurements
from lab.kinematics.effects.arm import ArmWithEffects
from lab.kinematics.serial.arm import SerialArm
from lab.noise.error_model import row_times

__all__ = ["FitReport", "Named", "named_poses"]


@dataclass(frozen=True)
class Named:
    """A pose that the test of outliers names.

    Attributes:
        id, line: of its row; no line where there is no file.
        size_m: how far its farthest target is from where the other poses say it is.
        p: the chance that noise alone makes any pose of a campaign stand out as far.
        held_out: whether it was not fitted, but is judged by.
    """

    id: str
    line: int | None
    size_m: float
    p: float
    held_out: bool


@dataclass(frozen=True)
class FitReport:
    """What a set of measurements says.

    Attributes:
        rows: those that the parameters come from.
        groups: of the model.
        unshown: parameters of these that the selection found the poses not to show: held at zero.
        outliers: poses that are off: left out if asked for, else fitted all the same.
        left_out: whether they were.
        selection: of the model's groups, where that was asked for.
        noise: which errors the measurements share.
        tail_dof: degrees of freedom of Student's t that the noise's tails are like; infinite where Gaussian's will do.
        measured: the joint positions of ``rows``, and what the model may lack beyond them; None where no points were
            observed.
        findings: about the errors, beyond independent noise: steps, drift, scatter, effects that the model lacks.
    """

    identification: Identification
    rows: Measurements
    groups: tuple[str, ...]
    unshown: tuple[str, ...]
    outliers: tuple[Named, ...]
    left_out: bool
    adequacy: GoodnessOfFit
    selection: Selection | None
    warnings: tuple[str, ...]
    noise: NoiseSearch
    tail_dof: float
    measured: MeasuredRange | None = None
    findings: tuple[NoiseFinding, ...] = ()

    @property
    def process(self) -> JointProcess | None:
        """The joints' offsets that no group explains; None where they were not asked for."""
        found = self.identification.process
        return found.process if isinstance(found, PredictedBy) else None

    @cached_property
    def residual_spread(self) -> ResidualSpread:
        """What the fit leaves of the measured positions, with configurations as clusters."""
        shared, lacks = self.noise.shared, self.adequacy.adequate is False
        independent_m = None if shared is None else shared.independent_m
        labels = configurations(self.rows.joints)
        return residual_spread(self.identification, labels, lack_of_fit=lacks, independent_m=independent_m)

    @cached_property
    def remaining(self) -> RemainingError | None:
        """What the remaining error is made of; None where no points were observed, or nothing is left over."""
        return _remaining(self)

    @cached_property
    def gain(self) -> ExpectedGain | None:
        """What the group residual would gain, where residuals of neighbouring joint positions are alike."""
        if self.remaining is None or self.remaining.over_joints is None or not self.remaining.over_joints.is_shown:
            return None
        is_serial = isinstance(self.identification.model, SerialArm | ArmWithEffects)
        return expected_gain(self.identification, self.rows) if is_serial else None

    @cached_property
    def explained(self) -> dict[str, ExplainedError]:
        """What each group of the model explains; nothing where no points were observed, or beside a process."""
        found = self.identification
        if not only_positions(observation_of(found.model)) or found.process is not None:
            return {}
        own = {name: [each.name for each in found.model.parameters if each.group == name] for name in self.groups}
        each = explained_errors(found.model, self.rows, found.values, found.fit.free, own)
        return {one.group: one for one in each}

    @cached_property
    def instrument(self) -> InstrumentNoise | None:
        """The instrument's noise as distances between targets say it; None where they say nothing."""
        if not only_positions(observation_of(self.identification.model)):
            return None
        return instrument_noise(self.rows.points)


def _remaining(report: FitReport) -> RemainingError | None:
    """The residuals of a report, taken apart."""
    found, rows = report.identification, report.rows
    if not only_positions(observation_of(found.model)) or found.process is not None:
        return None
    instrument_m = found.sigma_m if found.sigma_known else float("nan")
    if not found.sigma_known and report.instrument is not None and report.instrument.is_rigid:
        instrument_m = report.instrument.sigma_m
    shared = report.noise.shared
    if shared is not None and found.sigma_known:
        instrument_m = shared.independent_m
    groups = () if report.selection is None else report.selection.groups
    size = rows.joints.shape[1]
    return remaining_error(
        found.residuals,
        rows.joints,
        row_times(rows),
        found.dof,
        instrument_m=instrument_m,
        shared=shared,
        scatter_slopes=by_joint_positions(found.model, rows.inputs(found.model.conditions), found.values, size),
        nearly=tuple(group.name for group in groups if not group.chosen and group.f_p < NEARLY),
        searched=report.selection is not None and report.selection.searched,
    )


def named_poses(rows: Measurements, found: Outliers | HeldOut, *, held_out: bool = False) -> tuple[Named, ...]:
    """What the test found, by the rows' own names."""
    lines = [rows.lines[i] if rows.lines else None for i in found.rows]
    parts = zip(found.rows, lines, found.sizes_m, found.p_values, strict=True)
    return tuple(Named(rows.ids[i], line, float(size), float(p), held_out) for i, line, size, p in parts)
