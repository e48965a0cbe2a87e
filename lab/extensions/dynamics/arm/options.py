"""Options of ``lab dynamics``."""

from dataclasses import dataclass, field
from pathlib import Path

import tyro

from lab.campaign.option_types import Flag, Names, NoRecording
from lab.core.errors import LabError
from lab.core.limits import HOLDOUT, check_serial, positive
from lab.extensions.dynamics.simulation_options import SimulationOptions

__all__ = ["PARTS", "DynamicsOptions"]

PARTS = ("motor-inertia", "friction", "offsets")  # of the model, beside the links


@dataclass(frozen=True)
class DynamicsOptions:
    """Whose dynamic parameters to identify, from what; without a file, which ones there are."""

    file: tyro.conf.Positional[Path | None] = None
    """CSV of a motion, at even times: positions of joints or motors, with torques or motor currents."""
    robot: str = "irb120"
    """A model's name, or a path to an MJCF, a URDF or a table; its masses are not used."""
    drives: Path | None = None
    """Gear ratios with their signs, couplings and drive gains, TOML: needed for motor positions and currents; those of
    the robot's table where not given."""
    sensor: Path | None = None
    """Mounting of the base, TOML: tilt and gravity."""
    load: Path | None = None
    """The load of the loaded run, TOML: mass, centre of mass, inertia; estimated if not given."""
    validate: Path | None = None
    """CSV of another path, whose torques are predicted."""
    holdout: float = 0.0
    """Predict this share at the end of the path, and do not fit it."""
    without: Names = ()
    """Leave out of the model: motor-inertia, friction, offsets."""
    delay: Flag = False
    """Fit the delay of the torques after the positions."""
    physical: Flag = False
    """Use the nearest physically possible parameters of an arm."""
    band_hz: float = 20.0
    """Of the filter that torques and regressor pass, half power there; an arm's torques change below 10 Hz."""
    serial: str | None = None
    """The serial number of the arm."""

    no_recording: NoRecording = False
    rehearsal: SimulationOptions = field(default_factory=SimulationOptions)
    """The simulated session."""

    def check(self) -> None:
        """Refuse what makes no sense, with a LabError that names the option."""
        check_serial(self.serial)
        self.rehearsal.check()
        self.rehearsal.refuse_unasked()
        for part in self.without:
            if part not in PARTS:
                raise LabError(f"--without {part}: there are {', '.join(PARTS)}")
        positive("--band-hz", self.band_hz)
        if self.holdout not in HOLDOUT:
            raise LabError(f"--holdout {self.holdout:g}: give a share of the path from 0 to 0.8")
        if self.rehearsal.simulate:
            both = {"FILE": self.file, "--validate": self.validate, "--sensor": self.sensor}
            if stray := [name for name, value in both.items() if value is not None]:
                raise LabError(f"--simulate makes the measurements itself: leave {stray[0]} out")
            return
        given: dict[str, object] = {"--load": self.load, "--validate": self.validate, "--sensor": self.sensor}
        given |= {"--holdout": self.holdout or None, "--delay": self.delay or None, "--physical": self.physical or None}
        if self.file is None and (stray := [name for name, value in given.items() if value is not None]):
            raise LabError(f"{stray[0]} is for measurements: give a FILE, or --simulate")
