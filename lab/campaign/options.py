"""What can be asked of a campaign: the options of the commands, and of the library calls behind them."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import tyro

from lab.campaign.option_groups import LARGEST, ArmEffects, Fitting, Flag, Names, Numbers, positive, whole
from lab.core.errors import LabError


@dataclass(frozen=True)
class VirtualCampaign:
    """A campaign on a virtual arm."""

    robot: str = "irb120"
    """A model's name, or a path to an MJCF, a URDF, or a TOML table or mechanism."""
    poses: int = 50
    """How many random collision-free poses to measure; without effect beside a plan."""
    plan: Path | None = None
    """Measure the poses of this CSV instead."""
    seed: int = 0
    """Of the arm, the tracker, the poses and the noise, each its own stream."""
    targets: Names = ("p1",)
    """Measured points of the tool."""
    instrument: str = "uniform-8um"
    """Whose noise the tracker has: exact, uniform-8um, leica-at960, leica-at500, faro-vantage or optical-cmm."""
    readings: int = 1
    """Readings that each measured point is the mean of."""
    noise_mm: float | None = None
    """The noise that the identifier assumes (1σ per axis), instead of the instrument's."""
    position_sigma_mm: float = 0.5
    """How far base, links and flange are off, per axis."""
    rotation_sigma_mrad: float = 1.5
    """How far base, links and flange are turned, per axis."""
    offset_sigma_mrad: float = 0.0
    """How far joint readings are off (mm for a slide)."""
    dh_only: Flag = False
    """Perturb nothing but the Denavit-Hartenberg parameters."""
    gate_mm: float = 1.0
    """A larger mean error on fresh poses is a bad result."""
    fitting: tyro.conf.OmitArgPrefixes[Fitting] = field(default_factory=Fitting)
    """How parameters are fitted."""
    effects: tyro.conf.OmitArgPrefixes[ArmEffects] = field(default_factory=ArmEffects)
    """What of the arm is not geometry."""

    def check(self) -> None:
        """Refuse numbers that make no sense, with a LabError that names the option."""
        self.effects.check()
        for flag, count in (("--poses", self.poses), ("--readings", self.readings)):
            whole(flag, count, 1)
        _check_common(self)
        spreads = {
            "--position-sigma-mm": self.position_sigma_mm,
            "--rotation-sigma-mrad": self.rotation_sigma_mrad,
            "--offset-sigma-mrad": self.offset_sigma_mrad,
        }
        for flag, value in spreads.items():
            if not 0 <= value <= LARGEST:
                raise LabError(f"{flag} {value:g}: give a standard deviation from 0 to {LARGEST:g}")


@dataclass(frozen=True)
class MeasuredCampaign:
    """A calibration from a measurement file."""

    file: tyro.conf.Positional[Path]
    """Measurements, CSV."""
    robot: str = "irb120"
    """A model's name, or a path to an MJCF, a URDF, or a TOML table or mechanism."""
    seed: int = 0
    """Of the split into poses to fit and poses to judge by."""
    instrument: str | None = None
    """Weigh the points by the noise of exact, uniform-8um, leica-at960, leica-at500, faro-vantage or optical-cmm,
    with its head at the file's origin."""
    noise_mm: float | None = None
    """Weigh the points by this noise (1σ per axis); without either it is estimated."""
    holdout: float | None = None
    """Hold out this share of the poses, and judge by them."""
    validate: Path | None = None
    """Judge by this file."""
    refit: Names = ()
    """What each session of that file may place anew: base, tool, or base,tool."""
    gate_mm: float = 1.0
    """A larger mean error on poses not fitted is a bad result."""
    observe: Literal["points", "pose", "cable", "socket", "plane"] = "points"
    """Which of the file's columns are the measurements."""
    orientation: Literal["intrinsic-xyz", "fixed-xyz", "rotation-vector"] | None = None
    """What the angles rx, ry, rz of a measured pose mean."""
    noise_mrad: float | None = None
    """Weigh measured orientations by this noise, beside --noise-mm; without both the ratio is estimated."""
    method: Literal["global", "sequential"] = "global"
    """Fit everything at once; or of poses the angles first, then the lengths."""
    socket_distance_mm: float | None = None
    """Known distance between the sockets of a location."""
    fitting: tyro.conf.OmitArgPrefixes[Fitting] = field(default_factory=Fitting)
    """How parameters are fitted."""

    def check(self) -> None:
        """Refuse options that make no sense or contradict each other, with a LabError that names them."""
        _check_common(self)
        if self.noise_mm is not None and self.instrument is not None:
            raise LabError("--instrument and --noise-mm both say what the noise is; give one")
        if self.holdout is not None and self.validate is not None:
            raise LabError("--holdout and --validate both say how to judge; give one")
        if self.refit and self.validate is None:
            raise LabError("--refit says what a validation file may fit anew; give --validate FILE too")
        if self.observe != "points" and (self.validate is not None or self.instrument is not None):
            raise LabError(f"--observe {self.observe}: --validate and --instrument are of points; leave them out")
        for flag, given, kind in (
            ("--orientation", self.orientation, "pose"),
            ("--noise-mrad", self.noise_mrad, "pose"),
            ("--method sequential", self.method == "sequential" or None, "pose"),
            ("--socket-distance-mm", self.socket_distance_mm, "socket"),
        ):
            if given is not None and self.observe != kind:
                raise LabError(f"{flag} is of --observe {kind}; give that too, or leave it out")
        if self.noise_mrad is not None and self.noise_mm is None:
            raise LabError("--noise-mrad says what orientations weigh beside positions; give --noise-mm too")
        if self.method == "sequential" and self.fitting.prior:
            raise LabError("--prior is of --method global: the sequential method takes none; leave one out")
        for flag, number in (("--noise-mrad", self.noise_mrad), ("--socket-distance-mm", self.socket_distance_mm)):
            if number is not None:
                positive(flag, number)


@dataclass(frozen=True)
class PlannedCampaign:
    """Which poses to measure, and what accuracy they promise."""

    robot: str = "irb120"
    """A model's name, or a path to an MJCF, a URDF, or a TOML table or mechanism."""
    poses: int | None = None
    """How many poses to choose: 30, if no accuracy is asked for."""
    accuracy_mm: float | None = None
    """Choose as few poses as keep 95 % of the fresh poses within this, in 95 % of the campaigns."""
    criterion: str = "O1"
    """What to make as good as can be: O1, O2, O3, O4, O5, condition, A, G or I."""
    scaling: Literal["raw", "unit", "length", "whitened"] = "whitened"
    """Units of the indices: mm and rad, unit columns, a characteristic length, or tolerances and noise."""
    targets: Names = ("p1",)
    """Measured points of the tool."""
    instrument: str = "uniform-8um"
    """Whose noise and sight the plan is for: uniform-8um, leica-at960, leica-at500, faro-vantage or optical-cmm."""
    candidates: int = 2000
    """How many feasible poses to choose from."""
    starts: int = 4
    """How many times to choose anew; the best is kept."""
    extend: Path | None = None
    """Poses measured already (CSV), to which these are added."""
    home: Numbers = ()
    """Where the measuring day starts and ends: readings in deg (mm of a slide); zero if not given, or the drawn
    position of a mechanism."""
    seed: int = 0
    """Of the candidates, the starts and the test poses."""

    def check(self) -> None:
        """Refuse numbers that make no sense, with a LabError that names the option."""
        whole("--seed", self.seed, 0)
        whole("--starts", self.starts, 1)
        if self.poses is not None:
            whole("--poses", self.poses, 1)
            if self.accuracy_mm is not None:
                raise LabError("--poses and --accuracy-mm both say how many poses to choose; give one")
        if self.accuracy_mm is not None and not self.accuracy_mm > 0:
            raise LabError(f"--accuracy-mm {self.accuracy_mm:g}: give an accuracy above zero")


@dataclass(frozen=True)
class Correction:
    """Which targets to correct, for which calibrated arm."""

    targets: tyro.conf.Positional[Path]
    """Where the tool is to be, in the frame in which the arm was measured: CSV."""
    run: Path
    """The folder of a run of lab calibrate or lab identify."""
    orientation: Literal["intrinsic-xyz", "fixed-xyz", "rotation-vector"] | None = None
    """What the targets' angles rx, ry, rz mean."""
    force: Flag = False
    """Also for a run whose verdict is bad, or that was never judged on poses it had not seen."""
    load: Path | None = None
    """The folder of a run of lab payload: what the arm carries at each target (as heavy as payload_kg, where given)."""


@dataclass(frozen=True)
class PayloadTask:
    """Which load at the hand to identify, from what."""

    file: tyro.conf.Positional[Path]
    """Rows of a loaded and an unloaded run, CSV: joints with torques, a sensor's wrench, or tracked points."""
    robot: str = "irb120"
    """A model's name, or a path to an MJCF, a URDF or a table."""
    sensor: Path | None = None
    """How base and wrist sensor stand, TOML: tilt and gravity, the sensor's sign and rotation."""
    run: Path | None = None
    """The folder of a calibrated arm with compliances: mass and its centre from how far it sags (tracked points)."""
    method: Literal["torques", "wrench"] | None = None
    """What of the file to use, where it has both: the wrench, if not given."""
    friction: Flag = False
    """Fit what share of its torque each joint loses to friction (of torques)."""
    delay: Flag = False
    """Fit how much later torques or wrench are than the positions."""
    tilt: Flag = False
    """Fit how the base is tilted beyond what --sensor says (of a wrench)."""
    turn: Flag = False
    """Fit how the sensor is turned beyond what --sensor says (of a wrench)."""
    physical: Flag = False
    """Take the nearest parameters that some body has."""
    stiffness_nm_per_rad: float = 1e5
    """Of the joints that bear the arm, by which the cost of an uncertain load is reckoned."""

    def check(self) -> None:
        """Refuse what makes no sense together, with a LabError that names the option."""
        positive("--stiffness-nm-per-rad", self.stiffness_nm_per_rad)
        given = {"--sensor": self.sensor, "--method": self.method}
        given |= {f"--{name}": getattr(self, name) or None for name in ("friction", "delay", "tilt", "turn")}
        if self.run is not None and (both := [name for name, value in given.items() if value is not None]):
            raise LabError(f"--run is of an arm that sags, {both[0]} of torques or a wrench; give one")


@dataclass(frozen=True)
class Verification:
    """A few new measurements against a calibrated arm."""

    run: tyro.conf.Positional[Path]
    """The folder of the run that calibrated the arm."""
    file: tyro.conf.Positional[Path]
    """New measurements, CSV."""
    refit: Names = ()
    """What was set up anew, and is fitted: base, tool, or base,tool."""
    instrument: str | None = None
    """Whose noise these measurements have: uniform-8um, leica-at960, leica-at500, faro-vantage or optical-cmm,
    with its head at the file's origin; by default what the run took it for."""
    noise_mm: float | None = None
    """Their noise (1σ per axis) instead."""
    force: Flag = False
    """Verify against a run too whose verdict is not good."""

    def check(self) -> None:
        """Refuse options that make no sense or contradict each other, with a LabError that names them."""
        if stray := sorted(set(self.refit) - {"base", "tool"}):
            raise LabError(f"--refit {stray[0]}: unknown; give base, tool or base,tool")
        if self.noise_mm is not None:
            positive("--noise-mm", self.noise_mm)
            if self.instrument is not None:
                raise LabError("--instrument and --noise-mm both say what the noise is; give one")
        if self.instrument == "exact":
            raise LabError("--instrument exact: without noise there is nothing to test by; give --noise-mm")


def _check_common(options: VirtualCampaign | MeasuredCampaign) -> None:
    options.fitting.check()
    whole("--seed", options.seed, 0)
    positive("--gate-mm", options.gate_mm)
    if options.noise_mm is not None:
        positive("--noise-mm", options.noise_mm)


Options = VirtualCampaign | MeasuredCampaign | PlannedCampaign | Verification | Correction | PayloadTask
"""What a run's ``config.json`` holds."""
