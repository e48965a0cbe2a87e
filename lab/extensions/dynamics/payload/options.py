"""Options of ``lab payload``."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import tyro

from lab.campaign.option_types import Flag, NoRecording
from lab.core.errors import LabError
from lab.core.limits import check_serial, positive
from lab.extensions.dynamics.simulation_options import SimulationOptions

__all__ = ["PayloadOptions"]


@dataclass(frozen=True)
class PayloadOptions:
    """Options for identifying a payload at the flange."""

    file: tyro.conf.Positional[Path | None] = None
    """Rows of a loaded and an unloaded run, CSV: joints with torques, a sensor's wrench, or tracked points."""
    robot: str = "irb120"
    """A model's name, or a path to an MJCF, a URDF or a table."""
    cell: Path | None = None
    """The cell (obstacles, payload, narrower limits, instrument's position): TOML."""
    sensor: Path | None = None
    """Mounting of base and wrist sensor, TOML: tilt and gravity, the sensor's sign and rotation."""
    run: Path | None = None
    """The folder of a calibrated arm with compliances: mass and its centre from how far it sags (tracked points)."""
    accept_edited: Flag = False
    """Also accept a run whose files were edited after writing."""
    method: Literal["torques", "wrench"] | None = None
    """What of the file to use, where it has both: the wrench, if not given."""
    friction: Flag = False
    """Fit the share of torque that each joint loses to friction (of torques)."""
    delay: Flag = False
    """Fit the delay of torques or wrench after the positions."""
    tilt: Flag = False
    """Fit the tilt of the base relative to --sensor (of a wrench)."""
    turn: Flag = False
    """Fit the rotation of the sensor relative to --sensor (of a wrench)."""
    physical: Flag = False
    """Use the nearest physically possible parameters of a body."""
    stiffness_nm_per_rad: float = 1e5
    """Of the joints that bear the arm, by which the cost of an uncertain load is reckoned."""
    serial: str | None = None
    """The serial number of the arm; refused where --run is of another one."""

    no_recording: NoRecording = False
    rehearsal: SimulationOptions = field(default_factory=SimulationOptions)
    """The simulated session."""

    def check(self) -> None:
        """Refuse what makes no sense together, with a LabError that names the option."""
        check_serial(self.serial)
        self.rehearsal.check()
        self.rehearsal.refuse_unasked()
        if (self.file is None) != self.rehearsal.simulate:
            raise LabError("give a FILE of measurements, or --simulate; one of the two")
        if self.rehearsal.simulate and (self.run is not None or self.sensor is not None):
            raise LabError("--simulate simulates its own torques or wrist sensor; leave --run, --sensor out")
        positive("--stiffness-nm-per-rad", self.stiffness_nm_per_rad)
        given = {"--sensor": self.sensor, "--method": self.method}
        given |= {f"--{name}": getattr(self, name) or None for name in ("friction", "delay", "tilt", "turn")}
        if self.run is not None and (both := [name for name, value in given.items() if value is not None]):
            raise LabError(f"--run is of an arm that sags, {both[0]} of torques or a wrench; give one")
