"""Options that campaigns share: how parameters are fitted, and what of a virtual arm is not geometry."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import tyro

from lab.core.errors import LabError
from lab.core.numbers import LARGEST, positive


def number(text: str) -> float:
    """A number as typed.

    Raises:
        LabError: it is none.
    """
    try:
        return float(text)
    except ValueError as error:
        raise LabError(f"'{text}' is not a number") from error


def whole_number(text: str) -> int:
    """A whole number as typed.

    Raises:
        LabError: it is none.
    """
    try:
        return int(text)
    except ValueError as error:
        raise LabError(f"'{text}' is not a whole number") from error


Names = Annotated[
    tuple[str, ...],
    tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="A,B,…",
        instance_from_str=lambda given: tuple(name.strip() for name in given[0].split(",") if name.strip()),
        is_instance=lambda instance: isinstance(instance, tuple) and all(isinstance(name, str) for name in instance),
        str_from_instance=lambda names: [",".join(names)],
    ),
]
Numbers = Annotated[
    tuple[float, ...],
    tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="X,Y,…",
        instance_from_str=lambda given: tuple(number(each) for each in given[0].split(",")),
        is_instance=lambda instance: isinstance(instance, tuple) and all(isinstance(x, float) for x in instance),
        str_from_instance=lambda numbers: [",".join(f"{each:g}" for each in numbers)],
    ),
]
Flag = tyro.conf.FlagCreatePairsOff[bool]


@dataclass(frozen=True)
class Fitting:
    """How parameters are fitted."""

    model: str = "geometric"
    """geometric; auto, which adds the groups that the data support; or groups joined by +: compliance, payload
    (compliance with an unknown mass at the flange), harmonics, harmonics2, gear, coupling, backlash, drift,
    sessions (a frame that was bumped between the sessions of the file)."""
    robust: Flag = False
    """Leave out poses that are off, found by a test that names one in 1 % of clean campaigns."""
    fix: Names = ()
    """Hold these parameters at nominal: names or patterns, e.g. link4.d,tool.*."""
    free: Names = ()
    """Identify these parameters, which are usually fixed, in the place of fixed ones."""
    prior: Flag = False
    """Weigh the drawing's tolerances as a prior (MAP): for what the measurements barely show."""
    tolerance_mm: float = 0.5
    """Manufacturing tolerance of lengths (1σ): of the prior, and by which aliased errors are shared in exports."""
    tolerance_mrad: float = 1.5
    """The same of angles."""
    load: Path | None = None
    """The folder of a run of lab payload: payloads hang where its load does, and rows without payload_kg carry it."""

    def check(self) -> None:
        """Refuse numbers that make no sense, with a LabError that names the option."""
        positive("--tolerance-mm", self.tolerance_mm)
        positive("--tolerance-mrad", self.tolerance_mrad)
        if not all(self.groups) or len(set(self.groups)) < len(self.groups):
            raise LabError(f"--model {self.model}: give geometric, auto, or different groups joined by +")

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups asked for by name; none for geometric and auto."""
        return () if self.model in ("geometric", "auto") else tuple(self.model.removeprefix("geometric+").split("+"))


@dataclass(frozen=True)
class ArmEffects:
    """What of the virtual arm is not geometry; all of it is off unless given."""

    stiffness_nm_per_rad: float | None = None
    """Stiffness of the joints that bear the arm's weight (2 and 3 of the IRB 120)."""
    payload_kg: Numbers = (0.0,)
    """Payloads at the flange, one of which each pose has."""
    harmonic_mrad: float = 0.0
    """Runout of each joint once a turn, with a random phase."""
    harmonic2_mrad: float = 0.0
    """The same twice a turn."""
    gear_ppm: float = 0.0
    """How far gear ratios are off (1σ)."""
    coupling_ppm: float = 0.0
    """How far wrist joints follow their neighbours (1σ)."""
    backlash_mrad: float = 0.0
    """Mean play of the joints."""
    repeatability_mrad: float = 0.0
    """How far a joint stands off from one visit to the next (1σ)."""
    lag: float = 0.0
    """Share of the last move that the readings still lack, from 0 to below 1."""
    bending_mrad_per_knm: float = 0.0
    """How far each link bends under the moment of what it carries."""
    drift_mm_per_h: float = 0.0
    """How fast the tracker creeps, in a random direction."""
    drift_mrad_per_h: float = 0.0
    """How fast it turns."""
    bump_mm: float = 0.0
    """How far the tracker is moved in the middle of the campaign: what follows is session 2."""
    bump_mrad: float = 0.0
    """How far it is turned then."""
    growth_ppm_per_h: float = 0.0
    """How fast the arm grows with its temperature."""
    hours: float | None = None
    """How long the campaign takes: an hour, if drift or growth need to know."""
    bad_share: float = 0.0
    """Share of the poses whose reading is bad."""
    bad_mm: Numbers = (1.0, 50.0)
    """Least and largest displacement of a bad reading."""

    def check(self) -> None:
        """Refuse numbers that make no sense, with a LabError that names the option."""
        for name in fields(self):
            value, flag = getattr(self, name.name), "--" + name.name.replace("_", "-")
            for each in value if isinstance(value, tuple) else (value,):
                if each is not None and not 0 <= each <= LARGEST:
                    raise LabError(f"{flag} {each:g}: give a number from 0 to {LARGEST:g}")
        if self.stiffness_nm_per_rad is not None:
            positive("--stiffness-nm-per-rad", self.stiffness_nm_per_rad)
        if self.hours is not None:
            positive("--hours", self.hours)
        if not self.lag < 1 or not self.bad_share <= 1:
            raise LabError("--lag is to be below 1 and --bad-share at most 1")
        if len(self.bad_mm) != 2 or not 0 < self.bad_mm[0] <= self.bad_mm[1]:
            raise LabError("--bad-mm: give the least and the largest displacement, e.g. 1,50")
        if self.bad_mm != ArmEffects.bad_mm and not self.bad_share:
            raise LabError("--bad-mm says how large bad readings are; give --bad-share too")
        if not self.payload_kg:
            raise LabError("--payload-kg: give at least one payload, e.g. 0,3")
