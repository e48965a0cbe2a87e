"""Read a run of ``lab calibrate`` or ``lab identify`` back: its provenance, verdict and estimate."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Union

from lab.core.errors import LabError, error_context
from lab.core.limits import called
from lab.core.measurements import LAST_MOVE
from lab.core.se3 import Array
from lab.core.values import Value
from lab.extension_points import add
from lab.formats.noise_model import NoiseModel
from lab.formats.structured import read_structured, structured
from lab.kinematics.effects.effect import PAYLOAD
from lab.library.arm_files import ArmExport
from lab.library.hand_load import HandLoad, carrying
from lab.library.result import views
from lab.library.run_folder import check_edits, listed_files
from lab.noise.instruments import Instrument
from lab.options.measured_campaign import MeasuredCampaign
from lab.options.named_instruments import named_instrument
from lab.options.virtual_campaign import VirtualCampaign
from lab.phrases.verdict_phrases import gate_text
from lab.prediction.estimate import Estimate, IdentifiedSubset
from lab.prediction.estimate_files import (
    COVARIANCE_FILE,
    PARAMETERS_FILE,
    POSES_FILE,
    RESIDUAL_FILE,
    RESULT_FILE,
    read_estimate,
)
from lab.robots.config_file import CONFIG_FILE, LOAD_FILE, RunConfig, RunInputs, input_names, read_config
from lab.robots.load_robot import load_robot, load_virtual
from lab.robots.robot import Robot
from lab.sensors.sensor_registry import sensor_named

if TYPE_CHECKING:
    from lab.library.calibration_result import CalibrationResult

__all__ = [
    "CALIBRATIONS", "MEASUREMENTS_FILE", "READ_FILES", "CalibrationRun", "RunLike", "RunVerdict",
    "calibrated_by", "condition_notes", "folder_of", "load_estimate", "load_run",
    "read_header", "refuse_other_parameters",
]  # fmt: skip

_Campaign = VirtualCampaign | MeasuredCampaign
RunLike = Union["CalibrationResult", str, Path, None]
CALIBRATIONS: Mapping[str, type[_Campaign]] = {"calibrate": VirtualCampaign, "identify": MeasuredCampaign}
MEASUREMENTS_FILE = "measurements.csv"
READ_FILES = (
    CONFIG_FILE, RESULT_FILE, PARAMETERS_FILE, COVARIANCE_FILE, RESIDUAL_FILE, POSES_FILE, MEASUREMENTS_FILE, LOAD_FILE,
)  # fmt: skip
_MEND = "give the folder of a run of lab calibrate or lab identify, or make the run again"
_STATISTICS = {"mean", "rms", "p95", "max", "count"}


@dataclass(frozen=True)
class _NamedOutlier:
    """A pose that the test of outliers names, and whether it was held out."""

    id: str
    held_out: bool = False


@dataclass(frozen=True)
class RunVerdict:
    """Verdict of a run and the numbers behind it; keys of its ``result.json``.

    Attributes:
        after_mm, before_mm: errors after and before; None without a validation.
        noise_model: correlated errors of the measurements that the run estimated; None where there are none.
    """

    verdict: str
    reason: str
    adequacy: str
    after_mm: Mapping[str, float] | None = None
    before_mm: Mapping[str, float] | None = None
    judged_by: str | None = None  # the validation set; None without validation
    outliers: tuple[_NamedOutlier, ...] = ()  # poses that the test of outliers names
    outliers_left_out: bool = False  # whether these were excluded from the fit
    noise_model: NoiseModel | None = None
    reasons: tuple[str, ...] = ()
    gate_mm: float | None = None

    @property
    def usable(self) -> bool:
        """Decide whether others may build on the run: it is good, or doubtful for reported reasons."""
        return self.verdict in ("good", "doubtful")

    @property
    def description(self) -> str:
        """The verdict with its gate, for a person."""
        return f"{self.verdict}, {gate_text(self.gate_mm)}"

    def to_dict(self) -> dict[str, Any]:
        """Return what the result of whoever builds on the run holds of its verdict."""
        return {"verdict": self.verdict, "reasons": list(self.reasons), "gate_mm": self.gate_mm}

    def __post_init__(self) -> None:
        """Refuse lists of errors that lack one or have one below zero, with a LabError."""
        for name in ("after_mm", "before_mm"):
            if (sizes := getattr(self, name)) is not None and (missing := _STATISTICS - set(sizes)):
                raise LabError(f"{name}: '{min(missing)}' is missing")
            if min((sizes or {}).values(), default=0.0) < 0:
                raise LabError(f"{name}: a size of errors is not below zero")


@dataclass(frozen=True, eq=False, repr=False)
class CalibrationRun(Value):
    """A calibration with its provenance: who uses an estimate of a run takes it from here.

    ``lab.load_robot`` takes it for the calibrated robot, and ``Path`` for the folder.

    Attributes:
        folder: of the run.
        robot: the calibrated robot, with payloads where the load of the estimate hangs.
        estimate: parameters with their covariance, and the points that they predict.
        result: the verdict of the run, and whether it may be used.
        load: at the flange, as the estimate has it; None without one.
        inputs: inputs of the run; None of a result in memory.
        edits: sentences about files that were changed since the run was written.
    """

    folder: Path
    robot: Robot
    estimate: Estimate
    result: RunVerdict
    options: _Campaign
    load: HandLoad | None
    inputs: RunInputs | None = None
    edits: tuple[str, ...] = ()

    def __fspath__(self) -> str:
        """Return the folder of the run."""
        return str(self.folder)

    def _about(self) -> str:
        return f"{self.folder}, {self.robot.name}, {self.result.verdict}"

    def _facts(self) -> Mapping[str, str]:
        return {
            "run": str(self.folder),
            "robot": self.robot.name,
            "verdict": self.result.verdict,
            "identified parameters": str(len(self.estimate.identified)),
        }

    def recording(self) -> Any:
        """Show the run's recording in a notebook: return its viewer, which a cell shows as its last line.

        Raises:
            LabError: the run has no recording, or rerun-notebook is not installed (the extra ``notebook``).
        """
        path = self.folder / "recording.rrd"
        try:
            return views().viewer_of(path.read_bytes())
        except OSError as error:
            raise LabError(f"{path}: cannot be read ({error.strerror}); make the run without --no-recording") from error

    @property
    def serial(self) -> str | None:
        """The serial number of the arm; None where the run was given none."""
        return self.options.serial

    @property
    def called(self) -> str:
        """The arm as a person names it."""
        return called(self.robot.name, self.serial)

    def export(self, inputs: Array) -> ArmExport:
        """Return the arm for ``calibrated.py``, which is checked at inputs ``(n, joints + conditions)``."""
        kind = sensor_named(self.options.observe)
        observed = "" if kind.in_instrument_frame else kind.name
        return ArmExport(self.estimate, observed, self.result.description, inputs)

    @property
    def prior_took_part(self) -> bool:
        """True where tolerances of manufacture took part in the fit."""
        directions = self.estimate.prior_acts_in
        return self.options.fitting.prior == "on" if directions is None else directions > 0

    @cached_property
    def instrument(self) -> Instrument | None:
        """The instrument by whose noise the run weighted its measurements; None where it was given none.

        Raises:
            LabError: its file is not that of the run.
        """
        name = self.options.instrument
        if name in (None, "exact"):
            return None
        return named_instrument(str(name if self.inputs is None else self.inputs.path(name)))

    @property
    def readings(self) -> int:
        """The number of readings that each measurement is the mean of."""
        return self.options.readings if isinstance(self.options, VirtualCampaign) else 1

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings for whoever builds on the run."""
        return (*self.robot.warnings, *self.edits, *self._doubts)

    @property
    def named_warnings(self) -> tuple[str, ...]:
        """Warnings of the run, each with the run's folder, for commands that check several runs."""
        return (*self._named(self.robot.warnings), *self.edits, *self._named(self._doubts))

    def _named(self, messages: Sequence[str]) -> list[str]:
        return [f"{self.folder}: {each}" for each in messages]

    @property
    def _doubts(self) -> list[str]:
        result, messages = self.result, []
        if result.verdict != "good":
            why = f" ({'; '.join(result.reasons) or result.reason})" if result.reason else ""
            belief = "may be too small" if result.usable else "is implausible"
            messages.append(f"the verdict of the run is '{result.verdict}'{why}: its predicted error {belief}")
        if self.estimate.adequate is False:
            messages.append(f"of the run: {result.adequacy}: what the model lacked is taken for noise")
        if self.estimate.left_out:
            groups = ", ".join(self.estimate.left_out)
            messages.append(f"of the run: {groups} was of its session only: predicted positions are without it")
        return messages

    def refuse_unfit(self, what: str) -> None:
        """Refuse a run whose verdict is bad or not judged, with a LabError: ``what`` is not to be built on it."""
        word, reason = self.result.verdict, self.result.reason
        if not self.result.usable:
            why = f" ({reason})" if reason else ""
            mend = "measure poses to validate it on" if word == "not judged" else "mend what is bad"
            raise LabError(
                f"{self.folder}: the verdict of this run is '{word}'{why}, so {what} is refused; {mend}, or "
                "give --force"
            )

    def refuse_unplaced(self, what: str) -> None:
        """Refuse a run whose observations give ``what`` (a plural) no frame: of cables, sockets or planes."""
        if not sensor_named(observed := self.options.observe).in_instrument_frame:
            raise LabError(
                f"{self.folder}: identified with --observe {observed}, so in which frame {what} would be it does not "
                "say; identify from points or poses"
            )


def load_run(
    folder: str | Path,
    load: Path | None = None,
    cell: Path | None = None,
    *,
    accept_edited: bool = False,
    whole: bool = False,
    parts: Iterable[object] = (),
) -> CalibrationRun:
    """Read a run of ``lab calibrate`` or ``lab identify``: its robot, estimate, verdict and options.

    Args:
        folder: of the run.
        load: the folder of a run of ``lab payload``, whose load the robot carries from now on; that of the run, if not
            given.
        cell: the file that describes the robot's cell; that of the run, if not given.
        accept_edited: whether its files may have been changed since it was written.
        whole: whether to check every file of the run for edits: page, recording and exports too, not only what is read.
        parts: effects and other parts of one's own, which the run names.

    Returns:
        The run: calibrated robot, estimate, verdict and options.

    Raises:
        LabError: it is no such run, lacks a file, or is of another robot than the one of that name here.

    Example:
        >>> import lab, pathlib, tempfile
        >>> result = lab.calibrate("irb120", seed=7, no_recording=True)
        >>> run = lab.load_run(result.save(pathlib.Path(tempfile.mkdtemp()) / "run"))
        >>> run.result.verdict, run.robot.name, len(run.estimate.identified)
        ('good', 'irb120', 27)
    """
    for part in parts:
        add(part)
    folder = Path(folder)
    config, verdict, options = read_header(folder)
    inputs = RunInputs(folder, config)
    robot = _robot_of_run(inputs, options, cell)
    payload_of = load or (folder if (folder / LOAD_FILE).is_file() else None)
    robot, payload = carrying(robot, payload_of, accept_edited=accept_edited)
    estimate = read_estimate(folder, robot, payload)
    names = dict.fromkeys((*READ_FILES, *input_names(folder), *(listed_files(folder) if whole else ())))
    edits = check_edits(folder, tuple(names), accept=accept_edited)
    return CalibrationRun(folder, robot, estimate, verdict, options, payload, inputs, edits)


def _robot_of_run(inputs: RunInputs, options: _Campaign, cell: Path | None) -> Robot:
    """Load the robot of a run, in the cell of the run unless one is given.

    Raises:
        LabError: it cannot be loaded here, or is another one than the run's.
    """
    if cell is None and options.cell is not None:
        cell = inputs.path(options.cell)
    try:
        load_it = load_virtual if isinstance(options, VirtualCampaign) else load_robot
        robot = load_it(inputs.copy(options.robot) or options.robot or "irb120", cell)
    except LabError as error:
        raise LabError(f"{inputs.folder}: the robot it is of cannot be loaded from here: {error}") from error
    if inputs.config.model_sha256 != robot.sha256:
        raise LabError(
            f"{inputs.folder}: is a run of another robot: the files of '{options.robot}' are not those that it was "
            "made with; identify again"
        )
    return robot


def read_header(folder: Path) -> tuple[RunConfig, RunVerdict, _Campaign]:
    """Read how a run was made and judged."""
    config = read_config(folder, _MEND)
    if config.command == "certify":
        certified = config.options.get("run", "RUN")
        raise LabError(f"{folder}: is a certificate, not a calibration; give the run that it certifies, {certified}")
    if config.command not in CALIBRATIONS:
        raise LabError(f"{folder}: is no run of lab calibrate or lab identify; give the folder of one")
    verdict = read_structured(folder / RESULT_FILE, RunVerdict, _MEND)
    options = structured(f"{folder / CONFIG_FILE}: options", CALIBRATIONS[config.command], config.options, extra=True)
    with error_context(folder / CONFIG_FILE):
        options.check()
    return config, verdict, options


def load_estimate(folder: str | Path, robot: str | Path | Robot | None = None) -> Estimate:
    """Load the estimate of a run: parameters with their covariance, and the points that they predict.

    Args:
        folder: of a run of ``calibrate`` or ``identify``; or one that ``lab.save_estimate`` wrote, with ``robot``.
        robot: the nominal robot, where the folder is no whole run.

    Returns:
        The estimate: parameters (m, rad), their covariance, and what predicts points (m).

    Raises:
        LabError: the folder holds no estimate, is of another robot, or was changed since it was written.

    Example:
        >>> import lab, numpy as np, pathlib, tempfile
        >>> folder = pathlib.Path(tempfile.mkdtemp()) / "run"
        >>> _ = lab.calibrate("irb120", seed=7).save(folder)
        >>> estimate = lab.load_estimate(folder)
        >>> f"{1e3 * estimate.params['link2.a'].value:.1f} mm"
        '270.5 mm'
        >>> there = estimate.predict(np.array([[0.1, 0.2, -0.3, 0.4, 0.5, 0.6]]))
        >>> there.points.shape, there.covariance.shape
        ((1, 1, 3), (1, 1, 3, 3))
    """
    if robot is None:
        return load_run(Path(folder)).estimate
    return read_estimate(Path(folder), load_robot(robot))


def calibrated_by(
    run: RunLike, folder: Path, load: Path | None = None, cell: Path | None = None, *, accept_edited: bool = False
) -> CalibrationRun:
    """Return the run of a result in memory; of anything else that of its folder."""
    from lab.library.calibration_result import CalibrationResult

    if not isinstance(run, CalibrationResult):
        return load_run(folder, load, cell, accept_edited=accept_edited)
    verdict = structured(folder, RunVerdict, run.to_dict(), extra=True)
    robot, payload = carrying(run.robot.placed_in(cell), load or run.options.fitting.load)
    estimate = replace(run.estimate, loads=robot.loads, load=payload)
    return CalibrationRun(folder, robot, estimate, verdict, run.options, payload)


def folder_of(run: RunLike) -> dict[str, str]:
    """Return the option ``run``: a folder, or a name for a result in memory; nothing where none is given."""
    if run is None:
        return {}
    return {"run": str(run) if isinstance(run, str | Path) else "run-in-memory"}


def refuse_other_parameters(runs: Sequence[CalibrationRun], subsets: Sequence[IdentifiedSubset]) -> None:
    """Refuse runs of another robot than the first, or with other compared parameters, with a LabError."""
    first, names = runs[0], set(subsets[0].names)
    for run, each in zip(runs[1:], subsets[1:], strict=True):
        if run.robot.sha256 != first.robot.sha256:
            raise LabError(f"{run.folder}: is of another robot than {first.folder}; compare runs of one robot")
        if other := set(each.names) ^ names:
            raise LabError(
                f"{run.folder}: {min(other)} was identified in it or in {first.folder}, but not in both: the others "
                "mean something else in each; identify both with the same --model, --fix and --free"
            )


def condition_notes(run: CalibrationRun, file: object, given: Sequence[str], row: str, verb: str) -> list[str]:
    """Describe what is assumed of the conditions of a run's model, where rows of a file have only ``given`` ones.

    Args:
        row: name of a row: pose, target.
        verb: of hysteresis: predicted, corrected.
    """
    requested, messages = run.estimate.arm.conditions, []
    if unused := [name for name in given if name not in requested]:
        messages.append(
            f"{file}: {', '.join(unused)} makes no difference: the model of {run.folder} does not ask for it"
        )
    if PAYLOAD in requested and PAYLOAD not in given:
        carried = f"the flange is assumed to carry nothing at any {row}"
        if run.load is not None:
            carried = f"every {row} carries the load that was identified, {run.load.mass_kg:.4g} kg"
        messages.append(f"{file}: no column payload_kg: {carried}")
    if any(name.startswith(LAST_MOVE) for name in requested):
        messages.append(f"{file}: hysteresis is {verb} for moves from each {row} to the next one there")
    return messages
