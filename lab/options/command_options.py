"""Options of the commands that need no libraries of the lab to be parsed."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from lab.core.errors import LabError
from lab.core.limits import (
    CANDIDATES,
    CLOCK_DRIFT_PPM,
    CLOCKS_S,
    CONFIGURATIONS,
    DAYS,
    PATIENCE_S,
    SEED,
    TARGETS,
    check_serial,
    checked_name,
    checked_target,
    day,
    positive,
    whole,
)
from lab.options.option_types import Flag, Names, NoRecording, Numbers

__all__ = [
    "By",
    "CertifyOptions",
    "ExampleOptions",
    "HistoryOptions",
    "ImportOptions",
    "InspectOptions",
    "NextOptions",
    "PredictOptions",
    "StudyOptions",
    "VerifyOptions",
]

By = Literal["auto", "name", "order", "time"]


@dataclass(frozen=True)
class ImportOptions:
    """Files to merge, and how."""

    points: tyro.conf.Positional[Path]
    """The tracker's export: SpatialAnalyzer, PolyWorks or Leica text, or plain name, x, y, z; or corners in pictures:
    time, corner, u, v, camera, board."""
    joints: Path
    """The controller's file: joint positions, a row for each pose, or a log over time."""
    robot: str = "irb120"
    """A model's name, or a path to an MJCF, a URDF, or a TOML table or mechanism."""
    by: By = "auto"
    """How points find their poses: by name, order or time; auto: names if both have them, else times, else order."""
    targets: Names = ("p1",)
    """The measured points of each pose, in the order of measurement."""
    unit: Literal["mm", "m", "in"] | None = None
    """The tracker's unit of lengths, if its file does not state it."""
    joint_unit: Literal["deg", "rad"] | None = None
    """The unit of joints that turn, if the controller's file does not state it."""
    coverage: float = 1.0
    """Coverage factor of the tracker's uncertainties: 2 if they are expanded with k = 2."""
    columns: Path | None = None
    """A TOML file that names the columns if the header does not."""
    clock_offset_s: float | None = None
    """By how much the tracker's clock is ahead of the controller's, at the first point. Without it they are taken to
    agree; where the points contradict that, the error proposes an offset."""
    clock_drift_ppm: float = 0.0
    """By how many millionths the tracker's clock runs faster than the controller's: up to 100."""
    still_deg_s: float = 0.1
    """In a log: the largest speed of a joint at rest, °/s (mm/s of a slide)."""
    settled_s: float = 0.5
    """In a log: the shortest rest at a pose."""
    station: str | None = None
    """The instrument's station, if there are several: it fills the column station and starts each id."""

    def check(self) -> None:
        """Refuse numbers and names that make no sense, with a LabError that names the option."""
        for flag in ("coverage", "still_deg_s", "settled_s"):
            positive(f"--{flag.replace('_', '-')}", getattr(self, flag))
        if not self.targets or len(set(self.targets)) < len(self.targets):
            raise LabError("--targets: give one name or more, each once, e.g. p1,p2,p3")
        TARGETS("--targets", self.targets)
        for name in self.targets:
            checked_target("--targets", name)
        if self.station is not None:
            checked_name("--station", self.station)
        if self.clock_offset_s is not None and abs(self.clock_offset_s) not in CLOCKS_S:
            raise LabError("--clock-offset-s: give the seconds between two clocks")
        CLOCK_DRIFT_PPM("--clock-drift-ppm: its size", abs(self.clock_drift_ppm))


@dataclass(frozen=True)
class PredictOptions:
    """Joint positions of a calibrated arm."""

    run: tyro.conf.Positional[Path]
    """The folder of a run of lab calibrate or lab identify."""
    file: tyro.conf.Positional[Path]
    """Joint positions and the model's conditions, in the columns of a measurement file: CSV."""
    force: Flag = False
    """Also accept a run whose verdict is bad or not judged. The result repeats the reasons of a doubtful verdict."""
    accept_edited: Flag = False
    """Also accept a run whose files were edited after writing."""
    load: Path | None = None
    """The folder of a run of lab payload: what the arm carries in each pose (as heavy as payload_kg, where given)."""


@dataclass(frozen=True)
class VerifyOptions:
    """A few new measurements, or daily touches of a socket, against a calibrated arm."""

    run: tyro.conf.Positional[Path]
    """The folder of the run that calibrated the arm."""
    file: tyro.conf.Positional[Path]
    """New measurements, CSV. Or all touches of a socket so far: joint positions with the ball in it, the day in session
    (YYYY-MM-DD)."""
    observe: Literal["points", "socket"] | None = None
    """What the file holds; by default points, where it has columns of them."""
    refit: Names = ()
    """What was set up anew, and is fitted: base, tool, or base,tool."""
    accept: Names = ()
    """Undo these mistakes of reading, which the diagnosis found: their names, e.g. joint_sign or joint_sign:q3."""
    instrument: str | None = None
    """Whose noise these measurements have: uniform-8um, leica-at960, leica-at500, faro-vantage, laser-tracker,
    optical-cmm or krypton-k600, with its head at the file's origin; by default what the run took it for.
    Or the TOML file of a tracker."""
    noise_mm: float | None = None
    """Their noise (1σ per axis) instead."""
    serial: str | None = None
    """The serial number of the arm that was measured; refused where the run is of another one."""
    date: str | None = None
    """The day of the measurements, YYYY-MM-DD, by which lab history puts verifications in order."""
    require: Literal["good"] | None = None
    """Exit with 3 unless the verdict is good: the run is not good itself, several causes explain a change of the
    touches, or none of them is tested yet."""
    reference: int | None = None
    """Of touches: how many checks, from the first, show how they repeat, 10 by default; the next one is tested."""
    since: str | None = None
    """Of touches: leave out those before this day, YYYY-MM-DD: when something was repaired or set up anew."""
    plan: int | None = None
    """Of touches: verify nothing, propose so many configurations at the sockets of the file, and write plan.csv."""
    no_recording: NoRecording = False
    force: Flag = False
    """Verify against a run too whose verdict is bad or not judged, and by rows that it was identified from."""
    accept_edited: Flag = False
    """Build on a run too whose files were changed since it was written."""

    def check(self) -> None:
        """Refuse options that make no sense or contradict each other, with a LabError that names them."""
        if stray := sorted(set(self.refit) - {"base", "tool"}):
            raise LabError(f"--refit {stray[0]}: unknown; give base, tool or base,tool")
        check_serial(self.serial)
        if self.date is not None:
            day("--date", self.date)
        if self.noise_mm is not None:
            positive("--noise-mm", self.noise_mm)
            if self.instrument is not None:
                raise LabError("--instrument and --noise-mm both set the noise; give one")
        if self.instrument == "exact":
            raise LabError("--instrument exact: without noise there is nothing to test by; give --noise-mm")
        if self.reference is not None:
            whole("--reference", self.reference, 5, DAYS)
        if self.plan is not None:
            whole("--plan", self.plan, 4, CONFIGURATIONS)
        if self.since is not None:
            day("--since", self.since)

    @property
    def of_touches(self) -> bool:
        """True where the options say that the file holds touches."""
        return self.observe == "socket" or self.plan is not None

    def refuse_others(self, *, touches: bool) -> None:
        """Refuse options of measured points for touches, and the other way round, with a LabError."""
        if touches:
            given, what = {"refit": self.refit, "instrument": self.instrument, "noise-mm": self.noise_mm}, "points"
        else:
            given, what = {"reference": self.reference, "since": self.since, "plan": self.plan}, "touches of a socket"
        if stray := [name for name, value in given.items() if value not in (None, ())]:
            raise LabError(f"--{stray[0]} is of {what}, which {self.file} does not hold; leave it out")


@dataclass(frozen=True)
class CertifyOptions:
    """A calibration to certify."""

    run: tyro.conf.Positional[Path]
    """The folder of a run of lab calibrate or lab identify."""
    details: Path | None = None
    """TOML file that states who measured what, when, where and with which instrument. Missing entries are listed."""
    instrument: str | None = None
    """The TOML file of the tracker with its systematic errors; by default the instrument of the run."""
    tolerance_mm: float | None = None
    """Tolerance for the statement of conformity; by default the run's gate, if it had one."""
    statistic: Literal["mean", "p95", "max"] = "mean"
    """Statistic of the position errors on validation poses to compare with the tolerance."""
    decision_rule: Literal["guard-band", "simple"] = "guard-band"
    """Subtract the expanded uncertainty from the tolerance (guard-band), or neglect it (simple)."""
    force: Flag = False
    """Also certify a run whose verdict is bad or not judged."""
    accept_edited: Flag = False
    """Also read a run whose files were changed since it was written."""

    def check(self) -> None:
        """Refuse numbers that make no sense, with a LabError that names the option."""
        if self.tolerance_mm is not None:
            positive("--tolerance-mm", self.tolerance_mm)


@dataclass(frozen=True)
class HistoryOptions:
    """Runs of one arm to compare, or folders of the runs of one or many arms."""

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of runs of one arm, the earliest first; or folders that contain runs, at any depth."""
    kept: Names = ()
    """Parts that were not set up anew between the calibrations, to compare with the links: base, tool, or base,tool."""
    serial: str | None = None
    """Only the arm with this serial number."""
    every_days: int = 35
    """An arm is due this many days after its last calibration or verification (five weeks suit a monthly check), and a
    bad one at once."""
    on: str | None = None
    """Date of the state, YYYY-MM-DD, today by default; later runs are ignored."""
    require: Literal["good"] | None = None
    """Exit with code 3 if no arm is bad but one is not good."""
    force: Flag = False
    """Also compare calibrations whose verdict is bad or not judged."""
    accept_edited: Flag = False
    """Also read runs whose files were edited after writing."""
    out: Path | None = None
    """A folder for the page, history.csv, result.json and history.prom; by default nothing is written."""
    overwrite: Flag = False
    """Replace an earlier run in that folder."""

    def check(self) -> None:
        """Refuse options that make no sense, with a LabError that names them."""
        if not self.runs:
            raise LabError("lab history: give the folders of runs, or a folder that contains runs")
        if stray := sorted(set(self.kept) - {"base", "tool"}):
            raise LabError(f"--kept {stray[0]}: unknown; give base, tool or base,tool")
        check_serial(self.serial)
        whole("--every-days", self.every_days, 1, DAYS)
        if self.on is not None:
            day("--on", self.on)


@dataclass(frozen=True)
class StudyOptions:
    """A study of many simulated calibrations, where it is kept, and who works it out."""

    config: tyro.conf.Positional[Path]
    """The study, TOML."""
    out: Path | None = None
    """The study's folder: runs/study-NAME by default, numbered if taken."""
    resume: Flag = False
    """Resume the interrupted study in --out."""
    workers: int | None = None
    """Number of processes on this machine; one per core by default."""
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="PROTOCOL://HOST:PORT")] = None
    """Address of a dask.distributed scheduler whose workers run the study instead, e.g. tls://host:8786."""
    timeout_s: float = 600.0
    """Stop where the workers finish nothing for so long; a piece of work is up to 20 single campaigns."""

    def check(self) -> None:
        """Refuse options that contradict each other, with a LabError that names them."""
        if self.resume and self.out is None:
            raise LabError("--resume continues a study: give its folder by --out")
        if self.scheduler is not None and self.workers is not None:
            raise LabError("--workers sets processes on this machine, --scheduler a cluster; give one")
        positive("--timeout-s", self.timeout_s)


@dataclass(frozen=True)
class InspectOptions:
    """A robot, and what is to be identified of it."""

    robot: tyro.conf.Positional[str] = "irb120"
    """A model's name, or a path to an MJCF, a URDF, or a TOML table or mechanism."""
    cell: Path | None = None
    """The cell (obstacles, payload, narrower limits, instrument's position): TOML."""
    targets: Names = ("p1",)
    """Measured points of the tool."""
    tool_mm: Numbers = ()
    """Where the first of them is in the last frame; by default on the robot's tool."""
    joint_steps: Numbers = ()
    """Smallest increments of the joints that the encoders resolve, ° (mm of a slide); one for all, or one each; by
    default those of the robot's table."""
    model: str = "geometric"
    """geometric, or groups of effects joined by +."""
    fix: Names = ()
    """Fix these parameters at nominal: names or patterns."""
    free: Names = ()
    """Identify these parameters, which are usually fixed, in the place of fixed ones."""

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups of effects that are asked for.

        Raises:
            LabError: one is given twice, or they are to be chosen by measurements, which there are none of.
        """
        from lab.options.option_groups import Fitting  # slow to import

        fitting = Fitting(self.model, fix=self.fix, free=self.free)
        fitting.check()
        if fitting.searched:
            raise LabError(f"--model {self.model}: groups are chosen by measurements; name groups to inspect")
        return fitting.groups


@dataclass(frozen=True)
class ExampleOptions:
    """Measurements of a real robot that come with the lab."""

    name: tyro.conf.Positional[str | None] = None
    """The example to write, with its source and licence; without it all are listed."""
    out: Path | None = None
    """The folder to write into; the current one, if not given."""


@dataclass(frozen=True)
class NextOptions:
    """A measurement session that is planned while it is measured."""

    plan: tyro.conf.Positional[Path]
    """The folder of a run of lab design, whose robot, cell, instrument and targets are measured, or of lab identify."""
    file: tyro.conf.Positional[Path | None] = None
    """The measurements so far (CSV); those of the run of lab identify, if not given; nothing for lab design."""
    accuracy_mm: float | None = None
    """Stop when 95 % of the validation poses are predicted within this, in 95 % of the campaigns; that of the plan,
    if not given."""
    criterion: str = "I"
    """What the next pose is to make as good as can be: O1, O2, O3, O4, O5, condition, A, G or I. Packages may add
    others."""
    instrument: str | None = None
    """Whose noise and sight to count with; that of the run, if not given."""
    follow: Flag = False
    """Go on as the file grows, and propose a pose after each new row, until the accuracy is reached."""
    patience_s: float = 600.0
    """End following if the file has not grown for so long, s."""
    candidates: int = 2000
    """How many feasible poses to choose from."""
    no_recording: NoRecording = False
    seed: int = 0
    """Random seed of the candidates and of the validation poses."""

    def check(self) -> None:
        """Refuse numbers that make no sense, with a LabError that names the option."""
        whole("--seed", self.seed, 0, SEED)
        whole("--candidates", self.candidates, 1, CANDIDATES)
        if self.accuracy_mm is not None:
            positive("--accuracy-mm", self.accuracy_mm)
        PATIENCE_S("--patience-s", self.patience_s)
        if self.follow and self.file is None:
            raise LabError("--follow: give the measurement file that grows")
