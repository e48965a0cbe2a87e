"""An identified payload: typed, and as plain values for its JSON files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.campaign.robot import Robot
from lab.commands.hand_load import HandLoad
from lab.commands.result import Result
from lab.commands.values import number, plain_numbers
from lab.core.se3 import Array
from lab.extensions.dynamics.load_files import WRENCH, write_loads, write_mounting
from lab.extensions.dynamics.load_samples import Mounting, PayloadSamples
from lab.extensions.dynamics.payload.estimate import LoadEstimate, Nuisance
from lab.extensions.dynamics.payload.options import PayloadOptions
from lab.extensions.dynamics.payload.plausibility import Implausibility
from lab.kinematics.dynamics.rigid_body import inertia_about_centre

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lab.render.document import Document

__all__ = ["WILD", "PayloadResult", "UncertaintyCost", "channels_of", "wild_sample"]

LOAD_CSV, SENSOR_TOML = "load.csv", "sensor.toml"  # of a rehearsed day, in the run's folder
WILD = 7.0  # standard deviations, which one in 4e11 samples passes


@dataclass(frozen=True)
class UncertaintyCost:
    """How far a point that is corrected for a payload is off by the payload's uncertainty.

    Attributes:
        compliance: ``(joints,)`` rad/Nm (m/N).
        rms_m: root mean square over the workspace (1 sigma); NaN where the weight was not identified.
    """

    compliance: Array
    rms_m: float


@dataclass(frozen=True, repr=False, eq=False)
class PayloadResult(Result):
    """The payload at the flange, with its intervals.

    Attributes:
        options: what was asked.
        samples: what was read; None where the payload was identified from sag.
        mounting: how the base and a wrist sensor stand.
        estimate: by least squares, or the nearest that a body can have, where that was asked for (``moved``).
        cost: what its uncertainty costs.
        targets: the tracked points, where the payload was identified from sag.
        implausible: why it cannot be what it was identified as.
        truth: ``(10,)`` phi of the virtual payload, where the measuring day was rehearsed.
    """

    options: PayloadOptions
    robot: Robot
    samples: PayloadSamples | None
    mounting: Mounting
    estimate: LoadEstimate
    cost: UncertaintyCost
    warnings: tuple[str, ...]
    targets: tuple[str, ...] = ()
    implausible: tuple[Implausibility, ...] = ()
    truth: Array | None = None

    @property
    def _trusted(self) -> bool:
        """Whether mass and centre of mass are identified and can be, without lack of fit, and no sample is wild."""
        identified = np.isfinite(self.estimate.phi[:4]).all() and not self.implausible
        return bool(identified and self.estimate.adequate is not False and wild_sample(self.estimate) is None)

    @property
    def exit_code(self) -> int:
        """0 where the payload may be trusted, else 1."""
        return 0 if self._trusted else 1

    @property
    def _load(self) -> HandLoad:
        """What gravity acts on."""
        return self.estimate.hand_load

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints and ``result.json`` holds: SI units; None is what was not identified."""
        found, samples = self.estimate, self.samples
        return {
            "robot": self.robot.name,
            "serial": self.options.serial,
            "method": found.method,
            "frame": found.frame,
            "rank": found.rank,
            "parameters": found.columns,
            "identified": list(found.identified),
            "mass_kg": _with_width(found.mass_kg, found.mass_half_width_kg),
            "com_m": _with_width(found.com_m, found.com_half_width),
            "inertia_kgm2": _with_width(found.inertia_kgm2, found.inertia_half_width_kgm2),
            "inertia_about_com_kgm2": _with_width(found.inertia_com_kgm2, found.inertia_com_half_width),
            "adequate": found.adequate,
            "adequacy": found.verdict.words,
            "p": number(found.verdict.p),
            "implausible": [each.words for each in self.implausible],
            "physical": found.physical,
            "made_physical": found.moved,  # least squares found what no body has
            "unseen": list(found.unidentified),
            "also_fitted": [_nuisance(each) for each in found.nuisance],
            "numbers": found.rows,
            "rows": None if samples is None else {"loaded": int(samples.loaded.sum()), "all": len(samples)},
            "noise": [number(sigma) for sigma in found.sigma],
            "cost_um": number(1e6 * self.cost.rms_m),
            "stiffness_nm_per_rad": [number(1 / soft) if soft else None for soft in self.cost.compliance],
            "warnings": list(self.warnings),
        } | ({} if self.truth is None else {"true": _true(self.truth)})

    def document(self) -> "Document":
        """What a person reads: the payload with its intervals, goodness of fit, and what is not identifiable."""
        from lab.extensions.dynamics.payload.document import payload_document

        return payload_document(self)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each identified parameter: name, value, half-width of its 95 % interval, and unit."""
        from lab.extensions.dynamics.payload.document import parameter_rows

        names, values, widths, units = zip(*parameter_rows(self.estimate), strict=True)
        return {"parameter": names, "value": values, "half_width_95": widths, "unit": units}

    def plot(self) -> "Figure":
        """Draw the first channel, measured and explained by the payload."""
        from lab.extensions.dynamics.payload.document import channel_pictures

        return channel_pictures(self)[0].draw()

    def write(self, folder: Path) -> None:
        """Write ``config.json``, ``result.json``, the payload for ``--load``, ``report.html`` and ``recording.rrd``."""
        from lab.commands.run_folder import write_config, write_json

        write_config(folder, "payload", self.options, self.robot.sha256)
        write_json(folder / "result.json", self.to_dict())
        if np.isfinite(self._load.centre_m).all():
            self._load.write(folder)
        self.report(folder / "report.html")
        if self.truth is not None and self.samples is not None:
            write_loads(folder / LOAD_CSV, self.samples, self.robot.chain.joint_names, self.robot.chain.prismatic)
            write_mounting(folder / SENSOR_TOML, self.mounting)
        if self.samples is not None and not self.options.no_recording:
            from lab.extensions.dynamics.payload.recording import record_payload

            record_payload(folder / "recording.rrd", self)


def channels_of(result: PayloadResult) -> tuple[tuple[str, str], ...]:
    """Names and units of the columns that a payload was identified from."""
    chain = result.robot.chain
    if result.samples is None:
        return tuple((f"{target} {axis}", "m") for target in result.targets for axis in "xyz")
    if result.estimate.method.startswith("wrench"):
        return tuple((name.partition("_")[0], "N" if name.startswith("f") else "Nm") for name in WRENCH)
    pairs = zip(chain.joint_names, chain.prismatic, strict=True)
    return tuple((name, "N" if slides else "Nm") for name, slides in pairs)


def wild_sample(estimate: LoadEstimate) -> str | None:
    """The warning about a residual that no noise makes; None where there is none."""
    spread = np.maximum(np.sqrt((estimate.residual**2).mean(axis=0)), 1e-300)
    size = np.abs(estimate.residual) / spread
    if size.max() < WILD:
        return None
    row, channel = np.unravel_index(int(size.argmax()), size.shape)
    part = row / max(len(size) - 1, 1)
    return (
        f"a sample of column {channel + 1} of what is explained is {size.max():.0f} standard deviations off, at "
        f"{part:.0%} of the rows: the intervals are not to be believed; mend it, or leave it out"
    )


def _with_width(value: Array | float, half_width: Array | float) -> dict[str, Any]:
    return {"value": plain_numbers(value), "half_width_95": plain_numbers(half_width)}


def _true(phi: Array) -> dict[str, Any]:
    """Mass, centre of mass and inertia of the virtual payload, SI units."""
    return {
        "mass_kg": number(phi[0]),
        "com_m": plain_numbers(phi[1:4] / phi[0]),
        "inertia_about_com_kgm2": plain_numbers(inertia_about_centre(phi)),
    }


def _nuisance(each: Nuisance) -> dict[str, Any]:
    return {
        "name": each.name,
        "value": number(each.value),
        "half_width_95": number(each.half_width),
        "unit": each.unit,
    }
