"""A calibrated arm, read back from the folder of the run that identified it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lab.calibration.extrapolation import MeasuredRange
from lab.calibration.pose_cover import PoseCover
from lab.calibration.residual.process import GROUP, JointProcess, PredictedBy
from lab.campaign.config_file import RunInputs
from lab.campaign.instruments import named_instrument
from lab.campaign.options import VirtualCampaign
from lab.campaign.robot import Robot, load_robot, load_virtual
from lab.commands.calibrate.exports import ArmExport, lasting_arm
from lab.commands.calibrate.range_dict import measured_range_from_dict, read_cover
from lab.commands.calibrate.residual_file import read_residual
from lab.commands.calibrate.run_files import Campaign, SavedParameter, read_run_files
from lab.commands.calibrate.run_findings import Findings
from lab.commands.payload.known_payload import HandLoad, carrying
from lab.commands.run_folder import LOAD_FILE
from lab.core import se3
from lab.core.errors import LabError, error_context
from lab.core.se3 import Array
from lab.core.serials import called
from lab.formats.noise_model import component_errors_from_dict, noise_model_from_dict
from lab.formats.structured import structured
from lab.kinematics.effects.arm import Arm
from lab.kinematics.inverse.branches import NominalInverse
from lab.kinematics.model import RigidArm
from lab.noise.error_model import ErrorModel
from lab.noise.instruments import Instrument
from lab.noise.variance_components import ComponentErrors
from lab.sensors.registry import sensor_named

if TYPE_CHECKING:
    from lab.commands.calibrate.result import CalibrationResult

__all__ = ["Calibrated", "calibrated_by", "folder_of", "read_calibrated"]

_TURN = ("tool.rx", "tool.ry", "tool.rz")


@dataclass(frozen=True)
class Calibrated:
    """What a run found out about an arm, as far as it holds on another day.

    Attributes:
        folder: of the run.
        arm: as it was identified, without the groups of effects that say nothing of another day.
        values: ``(p,)`` of the arm, as exported: the most likely ones of those that predict the same.
        nominal_aligned: ``(p,)`` nominal links with the base and tool that suit them best.
        R_last_tool: rotation ``(3, 3)`` of the measured tool in the last frame; one where no orientation was measured.
        left_out: groups of effects of the run's own day.
        identified: the parameters that ``covariance`` ``(f, f)`` is of.
        result: what ``result.json`` holds.
        options: of the run.
        inputs: that it was made from; None of a result in memory, whose are at hand.
        load: at the flange, where that was identified.
        estimates: ``(f,)`` of the identified parameters: ``values`` share aliased errors among more of them.
        process: the offsets of its joints that no group explains; None where they were not asked for.
        cover: the poses that were fitted; None of a run of an older version.
        edits: what is said of its files if they were changed since the run was written.
    """

    folder: Path
    robot: Robot
    arm: Arm
    values: Array
    nominal_aligned: Array
    R_last_tool: Array
    identified: tuple[str, ...]
    covariance: Array
    left_out: tuple[str, ...]
    result: Findings
    options: Campaign
    load: HandLoad | None
    estimates: Array
    inputs: RunInputs | None = None
    edits: tuple[str, ...] = ()
    process: JointProcess | None = None
    cover: PoseCover | None = None

    def with_targets(self, targets: tuple[str, ...]) -> Arm:
        """The arm with other targets."""
        arm = self.robot.arm_with(targets, [name for name in self.groups if name != GROUP])
        return arm if self.process is None else self.process.added_to(arm)

    @cached_property
    def predicted_by(self) -> PredictedBy | None:
        """What says how sure predicted points are, where the arm's offsets that no group explains are predicted too."""
        if self.process is None:
            return None
        measured = self.arm.targets[: self.process.seen.shape[1]]  # behind them there may be points that were not
        arm = self.robot.arm_with(measured, [name for name in self.groups if name != GROUP])
        free = tuple(arm.names.index(name) for name in self.identified)
        named = dict(zip(self.arm.names, self.values.tolist(), strict=True))
        return PredictedBy(self.process, arm, np.array([named[name] for name in arm.names]), free)

    @property
    def serial(self) -> str | None:
        """The serial number of the arm; None where the run was given none."""
        return self.options.serial

    @property
    def called(self) -> str:
        """The arm as a person names it."""
        return called(self.robot.name, self.serial)

    def export(self, inputs: Array) -> ArmExport:
        """The arm for ``calibrated.py``, which is checked at inputs ``(n, joints + conditions)``."""
        kind = sensor_named(self.options.observe)
        return ArmExport(
            self.robot,
            self.arm,
            self.values,
            self.left_out,
            self.R_last_tool,
            0.0 if self.load is None else self.load.mass_kg,
            "" if kind.in_instrument_frame else kind.name,
            self.result.words,
            inputs,
        )

    @property
    def geometry(self) -> tuple[RigidArm, Array]:
        """The arm without its effects, and its parameters."""
        arm = self.arm.rigid
        return arm, self.values[: len(arm.names)]

    def nominal_inverse(self, target: int) -> NominalInverse:
        """What its controller computes with, to bring a target somewhere."""
        arm = self.arm.rigid
        return NominalInverse(arm, self.nominal_aligned[: len(arm.names)], target)

    @property
    def compliance(self) -> Array:
        """The joints' compliances ``(joints,)`` rad/Nm (m/N) that were identified; zero of joints without one."""
        found = dict(zip(self.arm.names, self.values.tolist(), strict=True))
        return np.array([found.get(f"joint{i + 1}.compliance", 0.0) for i in range(self.robot.chain.size)])

    @property
    def groups(self) -> tuple[str, ...]:
        """Of effects that the arm has."""
        return self.arm.groups

    def lacking(self, sigma_m: float) -> tuple[float, float, int | None]:
        """What the model lacks (m a coordinate), a factor of its covariance, and sigma's degrees of freedom.

        Where the run's residuals were more than its noise, or that was estimated, they are the measure.

        Args:
            sigma_m: noise of new measurements.
        """
        result = self.result
        if result.noise_model is not None:  # it says itself how large the residuals are
            return 0.0, 1.0, result.freedom
        if result.noise_known and result.adequate is not False:
            return 0.0, 1.0, None
        residual_m = (result.residual_mm or 0.0) / 1e3
        noise_m = (result.noise_mm or 0.0) / 1e3 if result.noise_known else sigma_m
        by_noise = result.noise_known and not result.cluster_robust
        larger = (residual_m / noise_m) ** 2 if by_noise else 1.0
        return float(np.sqrt(max(residual_m**2 - noise_m**2, 0.0))), larger, result.freedom

    @property
    def prior_took_part(self) -> bool:
        """True where tolerances of manufacture took part in the fit."""
        found = self.result.prior
        return self.options.fitting.prior == "on" if found is None else found.acts_in > 0

    @property
    def shared(self) -> ErrorModel | None:
        """Errors that the numbers of a measurement share, beside the instrument's."""
        values = dict(zip(self.arm.names, self.values.tolist(), strict=True))
        return noise_model_from_dict(self.result.noise_model, values)

    @property
    def component_errors(self) -> ComponentErrors | None:
        """How well the variances of these are known; its slopes are of ``identified``."""
        return component_errors_from_dict(self.result.noise_model)

    @cached_property
    def measured(self) -> MeasuredRange | None:
        """The joint positions that were fitted, and what the model may lack beyond them."""
        result = self.result
        return measured_range_from_dict(result.measured_range, result.extrapolation, self.robot.chain, self.cover)

    def extrapolated(self, joints: Array) -> NDArray[np.bool_]:
        """``(n,)`` which positions ``(n, joints)`` no fitted pose is near, where the model is known to lack something.

        Nowhere for a run of an older version, which does not keep its poses.
        """
        measured = self.measured
        if measured is None or not (measured.is_worse_beyond or self.process is not None):
            return np.zeros(len(joints), dtype=np.bool_)
        return measured.uncovered(joints)

    @cached_property
    def instrument(self) -> Instrument | None:
        """The instrument by whose noise the run weighed its measurements; None where it was given none.

        Raises:
            LabError: its file is not that of the run.
        """
        name = self.options.instrument
        if name in (None, "exact"):
            return None
        return named_instrument(str(name if self.inputs is None else self.inputs.path(name)))

    @property
    def readings(self) -> int:
        """How many readings each measurement is the mean of."""
        return self.options.readings if isinstance(self.options, VirtualCampaign) else 1

    @property
    def warnings(self) -> tuple[str, ...]:
        """What whoever builds on the run should be told of it."""
        result, said = self.result, [*self.robot.warnings, *self.edits]
        if result.schema == 0 or result.migrated:
            said.append(f"{self.folder}: an older version of the lab made this run, and judged it by other rules")
        if result.verdict != "good":
            why = f" ({'; '.join(result.reasons) or result.reason})" if result.reason else ""
            belief = "may be too small" if result.usable else "is not to be believed"
            said.append(f"the verdict of the run is '{result.verdict}'{why}: its predicted error {belief}")
        if result.adequate is False:
            said.append(f"of the run: {result.adequacy}: what the model lacked is taken for noise")
        if self.left_out:
            said.append(f"of the run: {', '.join(self.left_out)} was of its own day, and is left out")
        return tuple(said)

    @property
    def named_warnings(self) -> tuple[str, ...]:
        """The same, each with the run's folder: for who looks at several runs."""
        own = f"{self.folder}: "
        return tuple(said if said.startswith(own) else own + said for said in self.warnings)

    def refuse_unfit(self, what: str) -> None:
        """A LabError for a run whose verdict is bad or not judged: ``what`` is not to be built on it."""
        word, reason = self.result.verdict, self.result.reason
        if not self.result.usable:
            why = f" ({reason})" if reason else ""
            mend = "measure poses to validate it on" if word == "not judged" else "mend what is bad"
            raise LabError(
                f"{self.folder}: the verdict of this run is '{word}'{why}, so {what} is refused; {mend}, or say --force"
            )

    def refuse_unplaced(self, what: str) -> None:
        """A LabError for a run whose observations give ``what`` (a plural) no frame: of cables, sockets or planes."""
        if not sensor_named(observed := self.options.observe).in_instrument_frame:
            raise LabError(
                f"{self.folder}: identified with --observe {observed}, so in which frame {what} would be it does not "
                "say; identify from points or poses"
            )


def read_calibrated(
    folder: Path, load: Path | None = None, cell: Path | None = None, *, accept_edited: bool = False
) -> Calibrated:
    """Read a run of ``lab calibrate`` or ``lab identify``.

    Args:
        accept_edited: whether its files may have been changed since it was written.
        load: the folder of a run of ``lab payload``, whose load it carries from now on; by default that which it was
            identified with, if any.
        cell: the file that describes the robot's cell; by default that which the run was made with, if any.

    Raises:
        LabError: it is no such run, lacks a file, or is of another robot than the one of that name here.
    """
    files = read_run_files(folder)
    options, inputs = files.options, files.inputs
    if cell is None and options.cell is not None:
        cell = inputs.path(options.cell)
    try:
        load_it = load_virtual if isinstance(options, VirtualCampaign) else load_robot
        robot = load_it(inputs.copy(options.robot) or options.robot, cell)
    except LabError as error:
        raise LabError(f"{folder}: the robot it is of cannot be loaded from here: {error}") from error
    if files.config.model_sha256 != robot.sha256:
        raise LabError(
            f"{folder}: is a run of another robot: the files of '{options.robot}' are not those that it was made with; "
            "identify again"
        )
    payload_of = load or (folder if (folder / LOAD_FILE).is_file() else None)
    robot, payload = carrying(robot, payload_of, accept_edited=accept_edited)
    covariance = (files.identified, files.covariance)
    found = _calibrated(folder, robot, files.parameters, covariance, files.findings, options, payload, None)
    found = replace(found, cover=read_cover(folder, robot.chain), inputs=inputs)
    with error_context(folder / "result.json"):  # what is wrong is told before work begins
        _ = found.shared, found.measured, found.component_errors
    return replace(found, edits=files.edits(accept=accept_edited))


def calibrated_by(
    run: "CalibrationResult | str | Path | None",
    folder: Path,
    load: Path | None = None,
    cell: Path | None = None,
    *,
    accept_edited: bool = False,
) -> Calibrated:
    """What a result in memory found out; of anything else what its folder says."""
    from lab.commands.calibrate.result import CalibrationResult

    if not isinstance(run, CalibrationResult):
        return read_calibrated(folder, load, cell, accept_edited=accept_edited)
    findings = structured(folder, Findings, run.to_dict(), extra=True)
    rows = {row.name: SavedParameter(row.name, row.nominal, row.exported, row.estimate) for row in run.parameters}
    robot, payload = carrying(run.robot.placed_in(cell), load or run.options.fitting.load)
    found = run.identification
    names = tuple(found.model.names[i] for i in found.fit.free)
    given = (names, found.covariance)
    in_memory = _calibrated(folder, robot, rows, given, findings, run.options, payload, run.fit.process)
    return in_memory if run.fit.measured is None else replace(in_memory, cover=run.fit.measured.cover)


def folder_of(run: "CalibrationResult | str | Path | None") -> dict[str, str]:
    """The option ``run``: a folder, or what a result in memory is called; nothing where none is given."""
    if run is None:
        return {}
    return {"run": str(run) if isinstance(run, str | Path) else "run-in-memory"}


def _calibrated(
    folder: Path,
    robot: Robot,
    rows: Mapping[str, SavedParameter],
    covariance: tuple[Sequence[str], Array],
    result: Findings,
    options: Campaign,
    load: HandLoad | None,
    process: JointProcess | None,
) -> Calibrated:
    """What a run found out, from the parts of its folder, or of a result.

    Args:
        rows: every parameter by its name.
        covariance: names ``(f)`` and matrix ``(f, f)`` of those that were identified.
        process: of a result in memory; None of a folder, whose file has it.
    """
    targets = tuple(name.split(".")[1] for name in rows if name.startswith("tool.") and name.endswith(".x"))
    if not targets:
        raise LabError(f"{folder}/parameters.json: has no tool (tool.p1.x…), so nothing is there to be aimed")
    chosen = [name for name in result.model.split("+") if name != "geometric"]
    if GROUP in chosen and process is None:
        rest, _ = lasting_arm(robot, targets, chosen, None)
        process = read_residual(folder, result.residual, robot.chain, rest.conditions, targets)
    arm, left_out = lasting_arm(robot, targets, chosen, process)
    if missing := [name for name in arm.names if name not in rows]:
        raise LabError(f"{folder}/parameters.json: has no {missing[0]}: it is of another robot, or was cut short")
    exported, nominal = (np.array([getattr(rows[n], key) for n in arm.names]) for key in ("exported", "nominal"))
    turn = np.array([rows[name].exported for name in _TURN]) if set(_TURN) <= set(rows) else np.zeros(3)
    labels, matrix = covariance
    kept = [i for i, name in enumerate(labels) if name in arm.names]
    names, part = tuple(labels[i] for i in kept), matrix[np.ix_(kept, kept)]
    estimates = np.array([rows[name].estimate for name in names])
    return Calibrated(
        folder,
        robot,
        arm,
        exported,
        nominal,
        se3.exp(turn),
        names,
        part,
        left_out,
        result,
        options,
        load,
        estimates,
        process=process,
    )
