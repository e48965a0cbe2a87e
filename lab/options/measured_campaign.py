"""Options of a calibration from measurements; ``lab.options.virtual_campaign`` has those of a virtual one."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from lab.core.errors import LabError
from lab.core.units import MM
from lab.options.option_groups import Fitting
from lab.options.option_types import Names, NoRecording
from lab.options.task_region import REGION_HELP, task_region
from lab.options.virtual_campaign import VirtualCampaign, check_common, check_region
from lab.robots.config_file import robot_of_file
from lab.sensors.sensor_options import FitInputs, SensorOptions
from lab.sensors.sensor_registry import SensorName, configured_sensor

if TYPE_CHECKING:
    from lab.calibration.sensor import Sensor
    from lab.core.measurements import Measurements
    from lab.verdict.fitted import Judging

__all__ = ["MeasuredCampaign", "VirtualCampaign", "judging_of"]


@dataclass(frozen=True)
class _MeasurementFile:
    """A measurement file, how its points are weighed, and what the fit is validated on."""

    file: tyro.conf.Positional[Path]
    """Measurements, CSV."""
    robot: str | None = None
    """A model's name, or a path to an MJCF, a URDF, or a TOML table or mechanism. By default that of the run in whose
    folder the file lies, else irb120."""
    cell: Path | None = None
    """The cell (obstacles, payload, narrower limits, instrument's position): TOML."""
    seed: int = 0
    """Of the split into poses to fit and poses to validate on."""
    instrument: str | None = None
    """Weigh points or poses by the noise of exact, uniform-8um, leica-at960, leica-at500, faro-vantage, optical-cmm or
    krypton-k600, with its head at the file's origin; or of the TOML file of a tracker."""
    noise_mm: float | None = None
    """Weigh the points by this noise (1σ per axis); without either it is estimated."""
    holdout: float | None = None
    """Hold out this share of the poses, at random, and validate on them."""
    holdout_last: float | None = None
    """Hold out this share of the poses, the last by time_s or else in the file, and validate on them."""
    validate: Path | None = None
    """Judge by this file."""
    refit: Names = ()
    """What each session of that file may place anew: base, tool, or base,tool."""
    gate_mm: float | None = None
    """A larger mean error on poses not fitted is a bad result; by default the result is judged without a gate."""
    region: Annotated[str, tyro.conf.arg(help=REGION_HELP)] = "measured"
    require: Literal["good"] | None = None
    """Exit with 3 where the verdict is doubtful or nothing was validated; a bad one exits with 1 in any case."""
    date: str | None = None
    """The day of the measurements, YYYY-MM-DD, by which lab history puts runs in order."""
    serial: str | None = None
    """The serial number of the arm; whatever is built on the run inherits it, and refuses another arm's."""
    no_recording: NoRecording = False
    observe: SensorName = "points"
    """Which of the file's columns are the measurements."""


@dataclass(frozen=True)
class MeasuredCampaign(SensorOptions, _MeasurementFile):
    """A calibration from a measurement file."""

    fitting: tyro.conf.OmitArgPrefixes[Fitting] = field(default_factory=Fitting)
    """How parameters are fitted."""

    @property
    def robot_named(self) -> str:
        """The robot that is given, or else the one of the run in whose folder the file lies, or else irb120."""
        return self.robot or robot_of_file(self.file) or "irb120"

    def check(self) -> None:
        """Refuse options that make no sense or contradict each other, with a LabError that names them."""
        check_common(self.fitting, self.seed, self.gate_mm, self.noise_mm, self.date, self.serial)
        if self.noise_mm is not None and self.instrument is not None:
            raise LabError("--instrument and --noise-mm both set the noise; give one")
        judging = {"--holdout": self.holdout, "--holdout-last": self.holdout_last, "--validate": self.validate}
        if len(given := [flag for flag, value in judging.items() if value is not None]) > 1:
            raise LabError(f"{given[0]} and {given[1]} both set the validation data; give one")
        if self.refit and self.validate is None:
            raise LabError("--refit sets what a validation file fits anew; give --validate FILE too")
        check_region(self.region, self.kind())

    def kind(self) -> "Sensor":
        """The kind of observation that is asked for, with its options.

        Raises:
            LabError: there is no such kind, or an option of it makes no sense or is of another kind.
        """
        fit = FitInputs(
            self.noise_mm, self.fitting.prior == "on", self.instrument is not None, self.validate is not None
        )
        return configured_sensor(self.observe, self, fit)


def judging_of(options: VirtualCampaign | MeasuredCampaign, other: "Measurements | None" = None) -> "Judging":
    """Return the options of the judgement in SI units.

    Args:
        other: the rows of the file to validate on.

    Raises:
        LabError: the region cannot be read.
    """
    from lab.verdict.fitted import Judging

    judging = Judging(
        gate_m=None if options.gate_mm is None else MM.to_si(options.gate_mm),
        region=task_region(options.region),
        region_name=f"--region {options.region}",
    )
    if isinstance(options, VirtualCampaign):
        return judging
    return replace(
        judging,
        holdout=options.holdout,
        holdout_last=options.holdout_last,
        other=other,
        other_source=str(options.validate),
        refit=options.refit,
    )
