"""Result of ``lab payload``: values, document and pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lab.core.checks import Check
from lab.core.se3 import Array
from lab.core.units import MICRONS
from lab.extensions.dynamics.dynamics_options import PayloadOptions
from lab.extensions.dynamics.dynamics_phrases import phrase
from lab.extensions.dynamics.load_files import WRENCH, Mounting, PayloadSamples, write_loads, write_mounting
from lab.extensions.dynamics.payload.payload_estimate import LoadEstimate
from lab.kinematics.dynamics.rigid_body import inertia_about_centre
from lab.library.result import Result, number, plain_numbers
from lab.robots.robot import Robot

__all__ = ["PayloadResult", "UncertaintyCost", "channels_of", "parameter_rows", "wild_sample", "with_width"]

_LOAD_CSV, _SENSOR_TOML = "load.csv", "sensor.toml"  # of a simulated session, in the run's folder
_WILD = 7.0  # standard deviations, exceeded by one in 4e11 samples


@dataclass(frozen=True)
class UncertaintyCost:
    """Position error of a point corrected for a payload, from the payload's uncertainty.

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
        options: of the command.
        samples: of the file; None where the payload was identified from sag.
        mounting: of the base and a wrist sensor.
        estimate: by least squares, or the nearest physical one, where that was requested (``moved``).
        cost: position error from its uncertainty.
        targets: the tracked points, where the payload was identified from sag.
        implausible: failed checks of plausibility.
        truth: ``(10,)`` phi of the virtual payload, where the session was simulated.
    """

    command = "payload"

    options: PayloadOptions
    robot: Robot
    samples: PayloadSamples | None
    mounting: Mounting
    estimate: LoadEstimate
    cost: UncertaintyCost
    warnings: tuple[str, ...]
    targets: tuple[str, ...] = ()
    implausible: tuple[Check, ...] = ()
    truth: Array | None = None

    @property
    def model_sha256(self) -> str:
        """Digest of the robot's description."""
        return self.robot.sha256

    @property
    def exit_code(self) -> int:
        """0 if mass and centre of mass are identified and plausible, without lack of fit or outliers; else 1."""
        identified = np.isfinite(self.estimate.phi[:4]).all() and not self.implausible
        return 0 if identified and self.estimate.adequate is not False and not wild_sample(self.estimate) else 1

    def to_dict(self) -> dict[str, Any]:
        """Return the output of ``--json`` and ``result.json``: SI units; None for values not identified."""
        found, samples, true = self.estimate, self.samples, {}
        if self.truth is not None:
            true["true"] = {
                "mass_kg": number(self.truth[0]),
                "com_m": plain_numbers(self.truth[1:4] / self.truth[0]),
                "inertia_about_com_kgm2": plain_numbers(inertia_about_centre(self.truth)),
            }
        return {
            "robot": self.robot.name,
            "serial": self.options.serial,
            "method": found.method,
            "frame": found.frame,
            "rank": found.rank,
            "parameters": found.columns,
            "identified": list(found.identified),
            "mass_kg": with_width(found.mass_kg, found.mass_half_width_kg),
            "com_m": with_width(found.com_m, found.com_half_width),
            "inertia_kgm2": with_width(found.inertia_kgm2, found.inertia_half_width_kgm2),
            "inertia_about_com_kgm2": with_width(found.inertia_com_kgm2, found.inertia_com_half_width),
            "adequate": found.adequate,
            "adequacy": phrase(found.verdict),
            "p": number(found.verdict.p),
            "implausible": [phrase(check) for check in self.implausible],
            "physical": found.physical,
            "made_physical": found.moved,  # least squares found what no body has
            "unseen": list(found.unidentified),
            "also_fitted": [
                {"name": each.name, **with_width(each.value, each.half_width), "unit": each.unit}
                for each in found.nuisance
            ],
            "numbers": found.rows,
            "rows": None if samples is None else {"loaded": int(samples.loaded.sum()), "all": len(samples)},
            "noise": [number(sigma) for sigma in found.sigma],
            "cost_um": number(MICRONS.of(self.cost.rms_m)),
            "stiffness_nm_per_rad": [number(1 / soft) if soft else None for soft in self.cost.compliance],
            "warnings": list(self.warnings),
        } | true

    def write_files(self, folder: Path) -> None:
        """Write the payload for ``--load``, and what a simulated session measured."""
        if np.isfinite(self.estimate.com_m).all():
            self.estimate.hand_load.write(folder)
        if self.truth is not None and self.samples is not None:
            write_loads(folder / _LOAD_CSV, self.samples, self.robot.chain.joint_names, self.robot.chain.prismatic)
            write_mounting(folder / _SENSOR_TOML, self.mounting)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """Return a row for each identified parameter: name, value, half-width of its 95 % interval, and unit."""
        names, values, widths, units = zip(*parameter_rows(self.estimate), strict=True)
        return {"parameter": names, "value": values, "half_width_95": widths, "unit": units}


def channels_of(result: PayloadResult) -> tuple[tuple[str, str], ...]:
    """Return names and units of the columns that a payload was identified from."""
    chain = result.robot.chain
    if result.samples is None:
        return tuple((f"{target} {axis}", "m") for target in result.targets for axis in "xyz")
    if result.estimate.method.startswith("wrench"):
        return tuple((name.partition("_")[0], "N" if name.startswith("f") else "Nm") for name in WRENCH)
    pairs = zip(chain.joint_names, chain.prismatic, strict=True)
    return tuple((name, "N" if slides else "Nm") for name, slides in pairs)


def wild_sample(estimate: LoadEstimate) -> tuple[Check, ...]:
    """Return the largest residual, where noise does not explain it."""
    spread = np.maximum(np.sqrt((estimate.residual**2).mean(axis=0)), 1e-300)
    size = np.abs(estimate.residual) / spread
    if size.max() < _WILD:
        return ()
    row, channel = np.unravel_index(int(size.argmax()), size.shape)
    data = {"column": channel + 1, "sigmas": size.max(), "part": row / max(len(size) - 1, 1)}
    return (Check("sample.wild", "failed", data=data),)


def with_width(value: Array | float, half_width: Array | float) -> dict[str, Any]:
    """Return plain values of a quantity and its interval."""
    return {"value": plain_numbers(value), "half_width_95": plain_numbers(half_width)}


def parameter_rows(found: LoadEstimate) -> list[tuple[str, float, float, str]]:
    """Return name, value, half-width of the 95 % interval and unit (lengths: mm) of every identified parameter."""
    rows = [("mass", found.mass_kg, found.mass_half_width_kg, 1.0, "kg")]
    for i, axis in enumerate("xyz"):
        rows.append((f"centre of mass, {axis}", found.com_m[i], found.com_half_width[i], 1e3, "mm"))
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        value, width = found.inertia_com_kgm2[i, j], found.inertia_com_half_width[i, j]
        rows.append((f"I{'xyz'[i]}{'xyz'[j]} about the centre of mass", value, width, 1e4, "kg cm²"))
    identified = [row for row in rows if np.isfinite(row[1])]
    return [(name, float(scale * value), float(scale * width), unit) for name, value, width, scale, unit in identified]
