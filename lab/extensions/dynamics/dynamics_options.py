"""Options of ``lab payload``, ``lab dynamics`` and their simulated measurement session."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import tyro

from lab.core.errors import LabError
from lab.core.limits import (
    FRICTION_PERCENT,
    HOLDOUT,
    POSES,
    POSITION_MM,
    ROUNDS,
    SEED,
    SIMULATION_S,
    SIMULATION_SIZE,
    check_serial,
    positive,
    whole,
)
from lab.options.option_types import Flag, Names, Numbers

__all__ = ["DynamicsOptions", "PayloadOptions", "SimulationOptions"]

_PARTS = ("motor-inertia", "friction", "offsets")  # of the model, beside the links


@dataclass(frozen=True)
class SimulationOptions:
    """The simulated session."""

    simulate: Flag = False
    """Simulate in MuJoCo: design a path, drive it, write its files, and evaluate them."""
    seed: int = 0
    """Random seed."""
    seconds: float = 10.0
    """Duration of each path; it begins and ends at rest."""
    rate_hz: float = 500.0
    """Sampling rate of the measurements."""
    noise_percent: float = 0.5
    """Noise of the torques, % of each joint's largest torque."""
    friction_percent: float = 5.0
    """Coulomb friction, % of each joint's largest torque; viscous friction is as large at full speed."""
    motor_inertia_kgm2: float = 0.05
    """Inertia of each motor, as its joint feels it (kg of a slide)."""
    lag_ms: float = 0.0
    """Delay of the torques."""
    filter_hz: float = 0.0
    """Low-pass filter of the torques alone; 0 is none."""
    base_tilt_deg: Numbers = ()
    """Tilt of the base about x and y, hidden from the evaluation: x,y."""
    payload_kg: float | None = None
    """Mass of the payload, an aluminium ball; lab payload has 1 kg, lab dynamics none."""
    payload_mm: Numbers = (10.0, -5.0, 60.0)
    """Position of its centre of mass in the last frame: x,y,z."""
    rounds: int = 1
    """Effort of the path search: ascents from the best of some random paths."""

    def check(self) -> None:
        """Refuse impossible values, with a LabError that names the option."""
        for flag in ("seconds", "rate_hz"):
            positive(f"--{flag.replace('_', '-')}", getattr(self, flag))
        if self.seconds < SIMULATION_S.least:
            raise LabError(f"--seconds {self.seconds:g}: give {SIMULATION_S.least:g} or more, or too little shows")
        whole("--seed", self.seed, 0, SEED)
        POSES("--seconds times --rate-hz", round(self.seconds * self.rate_hz))
        whole("--rounds", self.rounds, 0, ROUNDS)
        self._check_errors()
        if self.payload_kg is not None:
            positive("--payload-kg", self.payload_kg)
        _check_numbers("--payload-mm", self.payload_mm, 3)
        _check_numbers("--base-tilt-deg", self.base_tilt_deg or (0.0, 0.0), 2)
        usual = SimulationOptions()
        given = [name for name, value in vars(self).items() if value != getattr(usual, name)]
        if not self.simulate and given:
            raise LabError(f"--{given[0].replace('_', '-')} needs --simulate: give it too, or leave this out")

    def _check_errors(self) -> None:
        """Refuse impossible sizes of simulated errors."""
        for flag in ("noise_percent", "friction_percent", "motor_inertia_kgm2", "lag_ms", "filter_hz"):
            if getattr(self, flag) not in SIMULATION_SIZE:
                raise LabError(f"--{flag.replace('_', '-')} {getattr(self, flag):g}: give a number from 0 to 1000")
        if self.friction_percent not in FRICTION_PERCENT:
            raise LabError(f"--friction-percent {self.friction_percent:g}: give 30 at most, or little torque is left")
        if 0 < self.filter_hz < 1 / self.seconds:
            raise LabError(
                f"--filter-hz {self.filter_hz:g}: slower than --seconds {self.seconds:g} last; give 0 for none"
            )


def _check_numbers(flag: str, values: Sequence[float], count: int) -> None:
    if len(values) != count or not all(abs(value) in POSITION_MM for value in values):
        raise LabError(f"{flag}: give {count} numbers, separated by commas")


def _first_given(options: Mapping[str, object]) -> str | None:
    """Return the first option that is given, by its flag."""
    return next((flag for flag, value in options.items() if value is not None), None)


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
    rehearsal: SimulationOptions = field(default_factory=SimulationOptions)
    """The simulated session."""

    def check(self) -> None:
        """Refuse impossible combinations, with a LabError that names the option."""
        check_serial(self.serial)
        self.rehearsal.check()
        if (self.file is None) != self.rehearsal.simulate:
            raise LabError("give a FILE of measurements, or --simulate; one of the two")
        if self.rehearsal.simulate and (self.run is not None or self.sensor is not None):
            raise LabError("--simulate simulates its own torques or wrist sensor; leave --run, --sensor out")
        positive("--stiffness-nm-per-rad", self.stiffness_nm_per_rad)
        given: dict[str, object] = {"--sensor": self.sensor, "--method": self.method}
        given |= {f"--{name}": getattr(self, name) or None for name in ("friction", "delay", "tilt", "turn")}
        if self.run is not None and (other := _first_given(given)):
            raise LabError(f"--run is of an arm that sags, {other} of torques or a wrench; give one")


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
    symbolic: Flag = False
    """Print the inverse dynamics in letters: Newton and Euler's recursion with the base parameters, as a program."""
    serial: str | None = None
    """The serial number of the arm."""
    rehearsal: SimulationOptions = field(default_factory=SimulationOptions)
    """The simulated session."""

    def check(self) -> None:
        """Refuse impossible values, with a LabError that names the option."""
        check_serial(self.serial)
        self.rehearsal.check()
        for part in self.without:
            if part not in _PARTS:
                raise LabError(f"--without {part}: there are {', '.join(_PARTS)}")
        positive("--band-hz", self.band_hz)
        if self.holdout not in HOLDOUT:
            raise LabError(f"--holdout {self.holdout:g}: give a share of the path from 0 to 0.8")
        self._check_measurements()

    def _check_measurements(self) -> None:
        """Refuse options of measurements without them, and measurements beside a simulation."""
        files: dict[str, object] = {"--validate": self.validate, "--sensor": self.sensor}
        if self.rehearsal.simulate:
            if stray := _first_given({"FILE": self.file} | files):
                raise LabError(f"--simulate makes the measurements itself: leave {stray} out")
            return
        rest = {"--holdout": self.holdout or None, "--delay": self.delay or None, "--physical": self.physical or None}
        if self.file is None and (stray := _first_given({"--load": self.load} | files | rest)):
            raise LabError(f"{stray} is for measurements: give a FILE, or --simulate")
