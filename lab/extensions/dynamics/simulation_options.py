"""Options of a measurement session simulated in MuJoCo."""

from dataclasses import dataclass

from lab.campaign.option_types import Flag, Numbers
from lab.core.errors import LabError
from lab.core.limits import (
    FRICTION_PERCENT,
    POSES,
    POSITION_MM,
    ROUNDS,
    SEED,
    SIMULATION_S,
    SIMULATION_SIZE,
    positive,
    whole,
)

__all__ = ["SimulationOptions"]


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
        """Refuse what makes no sense, with a LabError that names the option."""
        for flag in ("seconds", "rate_hz"):
            positive(f"--{flag.replace('_', '-')}", getattr(self, flag))
        if self.seconds < SIMULATION_S.least:
            raise LabError(f"--seconds {self.seconds:g}: give {SIMULATION_S.least:g} or more, or too little shows")
        whole("--seed", self.seed, 0, SEED)
        POSES("--seconds times --rate-hz", round(self.seconds * self.rate_hz))
        whole("--rounds", self.rounds, 0, ROUNDS)
        for flag in ("noise_percent", "friction_percent", "motor_inertia_kgm2", "lag_ms", "filter_hz"):
            if getattr(self, flag) not in SIMULATION_SIZE:
                raise LabError(f"--{flag.replace('_', '-')} {getattr(self, flag):g}: give a number from 0 to 1000")
        if self.friction_percent not in FRICTION_PERCENT:
            raise LabError(f"--friction-percent {self.friction_percent:g}: give 30 at most, or little torque is left")
        if 0 < self.filter_hz < 1 / self.seconds:
            raise LabError(
                f"--filter-hz {self.filter_hz:g}: slower than --seconds {self.seconds:g} last; give 0 for none"
            )
        if self.payload_kg is not None:
            positive("--payload-kg", self.payload_kg)
        for name, values, count in (
            ("--payload-mm", self.payload_mm, 3),
            ("--base-tilt-deg", self.base_tilt_deg or (0.0, 0.0), 2),
        ):
            if len(values) != count or not all(abs(each) in POSITION_MM for each in values):
                raise LabError(f"{name}: give {count} numbers, separated by commas")

    def refuse_unasked(self) -> None:
        """Refuse options of a simulation without ``simulate``.

        Raises:
            LabError: one is given without --simulate.
        """
        usual = SimulationOptions()
        given = [name for name, value in vars(self).items() if value != getattr(usual, name)]
        if not self.simulate and given:
            raise LabError(f"--{given[0].replace('_', '-')} needs --simulate: give it too, or leave this out")
