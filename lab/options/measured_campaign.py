"""Options of a calibration from measurements; ``lab.options.virtual_campaign`` has those of a virtual one."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from lab.core.errors import LabError
from lab.options.judging import ValidatedJudging
from lab.options.option_groups import Fitting
from lab.options.option_types import NoRecording
from lab.options.virtual_campaign import VirtualCampaign, check_common
from lab.robots.config_file import robot_of_file
from lab.sensors.sensor_options import FitInputs, SensorOptions
from lab.sensors.sensor_registry import SensorName, configured_sensor

if TYPE_CHECKING:
    from lab.calibration.sensor import ArmSensor

__all__ = ["MeasuredCampaign", "VirtualCampaign"]


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
    """Weigh points or poses by the noise of exact, uniform-8um, leica-at960, leica-at500, faro-vantage, laser-tracker,
    optical-cmm or krypton-k600, with its head at the file's origin; or of the TOML file of a tracker."""
    noise_mm: float | None = None
    """Weigh the points by this noise (1σ per axis); without either it is estimated."""
    date: str | None = None
    """The day of the measurements, YYYY-MM-DD, by which lab history puts runs in order."""
    serial: str | None = None
    """The serial number of the arm; whatever is built on the run inherits it, and refuses another arm's."""
    no_recording: NoRecording = False
    observe: SensorName = "points"
    """Which of the file's columns are the measurements."""


@dataclass(frozen=True)
class MeasuredCampaign(SensorOptions, ValidatedJudging, _MeasurementFile):
    """A calibration from a measurement file."""

    fitting: tyro.conf.OmitArgPrefixes[Fitting] = field(default_factory=Fitting)
    """How parameters are fitted."""

    @property
    def robot_named(self) -> str:
        """The robot that is given, or else the one of the run in whose folder the file lies, or else irb120."""
        return self.robot or robot_of_file(self.file) or "irb120"

    def check(self) -> None:
        """Refuse options that make no sense or contradict each other, with a LabError that names them."""
        check_common(self.fitting, self.seed, self.noise_mm, self.date, self.serial)
        if self.noise_mm is not None and self.instrument is not None:
            raise LabError("--instrument and --noise-mm both set the noise; give one")
        self.check_judging(self.kind())

    def kind(self) -> "ArmSensor":
        """The kind of observation that is asked for, with its options.

        Raises:
            LabError: there is no such kind, or an option of it makes no sense or is of another kind.
        """
        fit = FitInputs(
            self.noise_mm, self.fitting.prior == "on", self.instrument is not None, self.validate is not None
        )
        return configured_sensor(self.observe, self, fit)
