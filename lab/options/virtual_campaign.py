"""Define the options of a virtual campaign and of a design, for commands and studies."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from lab.core.errors import LabError
from lab.core.limits import (
    CANDIDATE_POINTS,
    CANDIDATES,
    DESIGN_POINTS,
    FIXTURES,
    OPTION_SIZE,
    PAYLOAD_KG,
    POSES,
    READINGS,
    SEED,
    STARTS,
    TARGETS,
    check_serial,
    day,
    positive,
    whole,
)
from lab.core.units import MM
from lab.formats.programs.languages import Controller
from lab.options.judging import Judging
from lab.options.option_groups import Effects, Fitting
from lab.options.option_types import Flag, Names, NoRecording, Numbers
from lab.prediction.task_region import task_region
from lab.sensors.sensor_options import FitInputs, SensorOptions, VirtualSetup
from lab.sensors.sensor_registry import SensorName, configured_sensor, sensor_named, sensors_with
from lab.simulation.free_path import CLEARANCE_MM, Clearances

if TYPE_CHECKING:
    from lab.sensors.virtual_sensor import VirtualSensor

__all__ = ["DesignOptions", "VirtualCampaign", "check_common"]


@dataclass(frozen=True)
class _VirtualSession:
    """Options of a virtual arm, its measurement and its fit."""

    robot: str = "irb120"
    """A model's name, or a path to an MJCF, a URDF, or a TOML table or mechanism."""
    cell: Path | None = None
    """The cell (obstacles, payload, narrower limits, instrument's position): TOML."""
    poses: int = 50
    """How many random collision-free poses to measure; without effect beside a plan."""
    plan: Path | None = None
    """Measure the poses of this CSV instead."""
    seed: int = 0
    """Random seed of the arm, the tracker, the poses and the noise."""
    targets: Names = ("p1",)
    """Measured points of the tool."""
    instrument: str = "uniform-8um"
    """The instrument: exact, uniform-8um, leica-at960, leica-at500, faro-vantage, laser-tracker, optical-cmm,
    krypton-k600, draw-wire, ball-in-socket, touch-probe or dial-indicator; or the TOML file of a tracker, with its
    systematic errors."""
    observe: SensorName = "points"
    """What is measured."""
    readings: int = 1
    """Readings that each measurement is the mean of."""
    noise_mm: float | None = None
    """The noise that the identifier assumes (1σ per axis), instead of the instrument's."""
    position_sigma_mm: float = 0.5
    """Position error of base, links and flange, per axis (1σ)."""
    rotation_sigma_mrad: float = 1.5
    """Rotation error of base, links and flange, per axis (1σ)."""
    offset_sigma_mrad: float = 0.0
    """Error of the joints' zeros (mm for a slide, 1σ)."""
    sampler: str = "normal"
    """Distribution of these errors: normal. Packages may add others."""
    dh_only: Flag = False
    """Perturb nothing but the Denavit-Hartenberg parameters."""
    date: str | None = None
    """The date of the measurements, YYYY-MM-DD, by which lab history orders runs."""
    serial: str | None = None
    """The serial number of the arm; whatever is built on the run inherits it, and refuses another arm's."""
    no_recording: NoRecording = False
    fitting: tyro.conf.OmitArgPrefixes[Fitting] = field(default_factory=Fitting)
    """How parameters are fitted."""
    effects: tyro.conf.OmitArgPrefixes[Effects] = field(default_factory=Effects)
    """Effects of the arm beside its geometry."""


@dataclass(frozen=True)
class VirtualCampaign(SensorOptions, VirtualSetup, Judging, _VirtualSession):
    """A campaign on a virtual arm."""

    def kind(self) -> "VirtualSensor":
        """Return the requested sensor, with its options.

        Raises:
            LabError: there is no such sensor, or an option of it makes no sense or is of another sensor.
        """
        return configured_sensor(self.observe, self, FitInputs(self.noise_mm, self.fitting.prior == "on"))

    def check(self) -> None:
        """Refuse numbers that make no sense, with a LabError that names the option."""
        self.kind()
        self._check_setup()
        self.effects.check()
        whole("--poses", self.poses, 1, POSES)
        whole("--readings", self.readings, 1, READINGS)
        TARGETS("--targets", self.targets)
        check_common(self.fitting, self.seed, self.noise_mm, self.date, self.serial)
        self.check_judging(self.kind())
        spreads = {
            "--position-sigma-mm": self.position_sigma_mm,
            "--rotation-sigma-mrad": self.rotation_sigma_mrad,
            "--offset-sigma-mrad": self.offset_sigma_mrad,
        }
        for flag, value in spreads.items():
            if value not in OPTION_SIZE:
                raise LabError(f"{flag} {value:g}: give a standard deviation from 0 to {OPTION_SIZE.most:g}")

    def _check_setup(self) -> None:
        """Refuse a setup that makes no sense, or is of another sensor, with a LabError that names the option."""
        if not 0 < self.orientation_share <= 1:
            raise LabError(f"--orientation-share {self.orientation_share:g}: give a share above 0, up to 1")
        whole("--fixtures", self.fixtures, 1, FIXTURES)
        positive("--artefact-mm", self.artefact_mm)
        for each in fields(VirtualSetup):
            if each.name not in sensor_named(self.observe).setup and getattr(self, each.name) != each.default:
                flag, able = "--" + each.name.replace("_", "-"), sensors_with(each.name)
                raise LabError(f"{flag} is of --observe {', '.join(able)}; give one of these, or leave it out")


_DESIGN_REGION_HELP = (
    "Where the error is predicted: workspace (within the joints' limits), a box x0,x1,y0,y1,z0,z1 in mm in the robot's "
    "frame 0, or a CSV file of targets in the instrument's frame, as lab compensate takes"
)


@dataclass(frozen=True)
class DesignOptions:
    """Options of a choice of poses, and of its predicted accuracy."""

    robot: str = "irb120"
    """A model's name, or a path to an MJCF, a URDF, or a TOML table or mechanism."""
    cell: Path | None = None
    """The cell (obstacles, payload, narrower limits, instrument's position): TOML."""
    poses: int | None = None
    """Number of poses to choose; 30 unless an accuracy is given."""
    accuracy_mm: float | None = None
    """Choose the fewest poses with errors within this at 95 % of the validation poses, in 95 % of the campaigns."""
    criterion: str = "O1"
    """Criterion to optimize: O1, O2, O3, O4, O5, condition, A, G or I. Packages may add others."""
    model: str = "geometric"
    """Model to identify: geometric, or groups joined by + as in lab identify, e.g. geometric+compliance."""
    payload_kg: Numbers = ()
    """Payloads that the poses may carry: the design chooses one for each pose, and the tour changes them seldom."""
    region: Annotated[str, tyro.conf.arg(help=_DESIGN_REGION_HELP)] = "workspace"
    scaling: Literal["raw", "unit", "length", "whitened"] = "whitened"
    """Units of the indices: mm and rad, unit columns, a characteristic length, or tolerances and noise."""
    observe: Literal["points", "pixels"] = "points"
    """What is measured: points of the tool, or corners of boards in pictures, which needs --cameras."""
    cameras: Path | None = None
    """Cameras and boards of --observe pixels, each with its place: TOML, as for lab calibrate."""
    targets: Names = ("p1",)
    """Measured points of the tool."""
    instrument: str = "uniform-8um"
    """The instrument, for its noise and view: uniform-8um, leica-at960, leica-at500, faro-vantage, laser-tracker,
    optical-cmm or krypton-k600, or the TOML file of a tracker."""
    candidates: int = 2000
    """Number of feasible poses to choose from."""
    starts: int = 4
    """Number of random starts; the best result is taken."""
    curve: Flag = False
    """Draw the predicted error against the number of poses from a design of each number, which takes much longer."""
    check: Path | None = None
    """Plan nothing: check this plan.csv of an earlier run again, in the present cell."""
    extend: Path | None = None
    """Poses measured before (CSV), to which these are added."""
    home: Numbers = ()
    """Where the session starts and ends: joint positions in deg (mm of a slide); zero if not given, or the
    nominal configuration of a mechanism."""
    reference_every: int | None = None
    """Measure the first pose again after every so many poses, and last: its scatter is the repeatability."""
    controller: Controller | None = None
    """Language of the robot program; by default that of the robot's maker, found by the robot's name."""
    clearance_mm: float = CLEARANCE_MM
    """Clearance of arm and reflectors from their surroundings, unless an obstacle or the cell states one."""
    self_clearance_mm: float = CLEARANCE_MM
    """Clearance between links that are not neighbours, and reflectors; at most that at home."""
    no_check: Flag = False
    """Check neither poses nor the paths between them for collisions."""
    no_recording: NoRecording = False
    seed: int = 0
    """Random seed of the candidates, the starts and the test poses."""

    @property
    def clearances(self) -> Clearances:
        """Clearances of the plan."""
        return Clearances(MM.to_si(self.clearance_mm), MM.to_si(self.self_clearance_mm))

    def refuse_nonsense(self) -> None:
        """Refuse numbers that make no sense, with a LabError that names the option."""
        made = self.no_check or self.extend is not None or self.controller is not None
        if self.check is not None and made:
            raise LabError(
                "--check: leave out --no-check, --extend and --controller beside it; they are of plans that are made. "
                "For a program of the same poses run lab design --config, with the plan's config.json, and --controller"
            )
        self._refuse_those_of_points()
        whole("--seed", self.seed, 0, SEED)
        whole("--starts", self.starts, 1, STARTS)
        if self.reference_every is not None:
            whole("--reference-every", self.reference_every, 1, POSES)
        whole("--candidates", self.candidates, 1, CANDIDATES)
        TARGETS("--targets", self.targets)
        CANDIDATE_POINTS("--candidates times --targets", self.candidates * len(self.targets))
        self._refuse_impossible_models()
        for flag, value in (("--clearance-mm", self.clearance_mm), ("--self-clearance-mm", self.self_clearance_mm)):
            if value not in OPTION_SIZE:
                raise LabError(f"{flag} {value:g}: give a distance from 0 to {OPTION_SIZE.most:g} mm")
        if self.poses is not None:
            whole("--poses", self.poses, 1, POSES)
            if self.accuracy_mm is not None:
                raise LabError("--poses and --accuracy-mm both set the number of poses; give one")
        if self.accuracy_mm is not None:
            positive("--accuracy-mm", self.accuracy_mm)

    def _refuse_those_of_points(self) -> None:
        """Refuse options that make no sense with what is measured, with a LabError."""
        if self.observe == "points":
            if self.cameras is not None:
                raise LabError("--cameras: is of --observe pixels; give that too, or leave it out")
            return
        if self.cameras is None:
            raise LabError(
                f"--observe {self.observe}: give --cameras, a file that places each camera and board (position_mm, "
                "rotation_deg)"
            )
        for name in _OF_POINTS:
            if getattr(self, name) != getattr(DesignOptions, name):
                flag = "--" + name.replace("_", "-")
                raise LabError(f"{flag}: is of a design for measured points; leave it out beside --observe pixels")

    def _refuse_impossible_models(self) -> None:
        """Refuse a model, payloads or a region that make no sense, with a LabError."""
        fitting = Fitting(model=self.model)
        fitting.check()
        if fitting.searched or fitting.residual:
            raise LabError(
                f"--model {self.model}: a design needs the groups by name; give geometric, or groups joined by +"
            )
        if task_region(self.region).kind == "measured":
            raise LabError("--region measured: nothing is measured before the design; give workspace, a box or a file")
        for mass in self.payload_kg:
            if mass not in PAYLOAD_KG:
                raise LabError(f"--payload-kg {mass:g}: give {PAYLOAD_KG.shown}")
        if len(set(self.payload_kg)) < len(self.payload_kg):
            raise LabError("--payload-kg: name each payload once")
        points = self.candidates * len(self.targets) * max(len(self.payload_kg), 1)
        DESIGN_POINTS("--candidates times --targets and --payload-kg", points)


_OF_POINTS = ("instrument", "targets", "model", "payload_kg", "region", "scaling", "extend", "check")


def check_common(fitting: Fitting, seed: int, noise_mm: float | None, date: str | None, serial: str | None) -> None:
    """Refuse options of virtual and measured campaigns that make no sense, with a LabError that names the option."""
    fitting.check()
    whole("--seed", seed, 0, SEED)
    if noise_mm is not None:
        positive("--noise-mm", noise_mm)
    if date is not None:
        day("--date", date)
    check_serial(serial)
