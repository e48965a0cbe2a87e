"""The dynamic parameters of an arm: typed, and as plain values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.campaign.robot import Robot
from lab.commands.result import Result
from lab.commands.values import number, plain_numbers
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.dynamics.arm.base_parameters import BaseParameters, Formula, random_states, regrouping_formulas
from lab.extensions.dynamics.arm.estimate import DynamicsEstimate
from lab.extensions.dynamics.arm.options import DynamicsOptions
from lab.extensions.dynamics.arm.physical import PhysicalFit
from lab.extensions.dynamics.load_files import write_loads
from lab.extensions.dynamics.load_samples import PayloadSamples
from lab.extensions.dynamics.payload.estimate import LoadEstimate
from lab.extensions.dynamics.payload.plausibility import Implausibility
from lab.formats.drives_toml import Drives
from lab.kinematics.dynamics.arm_dynamics import ArmDynamics

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lab.render.document import Document

MOTION_CSV, ANOTHER_CSV = "motion.csv", "another.csv"  # of a rehearsed day, in the run's folder
STATES = 200  # over which the conditioning is looked at

__all__ = ["DynamicsResult", "RehearsedDay", "estimate_to_dict", "load_to_dict", "physical_to_dict"]


@dataclass(frozen=True)
class RehearsedDay:
    """What was read on a virtual measuring day, and what is true there.

    Attributes:
        other: along another path.
        truth: ``(b,)`` base parameters.
        load: ``(10,)`` phi of the load at the flange; None without one.
    """

    samples: PayloadSamples
    other: PayloadSamples
    truth: Array
    load: Array | None


@dataclass(frozen=True, repr=False, eq=False)
class DynamicsResult(Result):
    """An arm's dynamic parameters: which ones its torques determine, and what they are.

    Attributes:
        options: what was asked.
        arm: the inverse dynamic model.
        base: its base parameters.
        drives: how they turn the joints, where that was given.
        day: the virtual measuring day, where it was rehearsed.
        samples: what was read; None where only the base parameters were asked for.
        estimate: what was identified of that.
        physical: the nearest parameters that an arm can have; None where not every base parameter was identified.
        implausible: why arm or load cannot be what they were identified as.
    """

    options: DynamicsOptions
    robot: Robot
    arm: ArmDynamics
    base: BaseParameters
    drives: Drives | None
    day: RehearsedDay | None
    samples: PayloadSamples | None
    estimate: DynamicsEstimate | None
    physical: PhysicalFit | None
    warnings: tuple[str, ...]
    implausible: tuple[Implausibility, ...] = ()

    @cached_property
    def formulas(self) -> tuple[Formula, ...]:
        """What each base parameter is made of."""
        return regrouping_formulas(self.arm, self.base, rng_for(0, "structure", 1))

    @cached_property
    def singular_values(self) -> Array:
        """``(b,)`` of the base regressor with unit columns over random states, largest first."""
        states = random_states(self.arm, STATES, rng_for(0, "structure", 2))
        columns = self.arm.regressor(*states)[..., self.base.kept].reshape(-1, self.base.size)
        return np.asarray(np.linalg.svd(columns / np.linalg.norm(columns, axis=0), compute_uv=False))

    @property
    def values(self) -> Array:
        """``(b,)`` base parameters: least squares', or with --physical the nearest that an arm can have.

        Raises:
            LabError: nothing was measured.
        """
        if self.estimate is None:
            raise LabError("nothing was measured: give a file")
        return self.physical.base if self.options.physical and self.physical is not None else self.estimate.values

    @property
    def exit_code(self) -> int:
        """0 where nothing was measured, or where the residuals are what noise explains of what can be; else 1."""
        return 1 if self.implausible or (self.estimate and self.estimate.verdict.adequate is False) else 0

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints, SI units: base parameters with their formulas, values and intervals."""
        base = self.base
        described = {
            "robot": self.robot.name,
            "serial": self.options.serial,
            "gravity_m_per_s2": plain_numbers(self.arm.gravity),
            "standard_parameters": len(base.names),
            "base_parameters": base.size,
            "inertial_base_parameters": base.inertial,
            "formulas": {formula.label: formula.words() for formula in self.formulas},
            "without_effect": [base.names[i] for i in base.without_effect],
        }
        strange = {"implausible": [each.words for each in self.implausible]}
        measured = {} if self.estimate is None else estimate_to_dict(self.estimate) | strange
        bodies = {} if self.physical is None else {"physical": physical_to_dict(base, self.physical)}
        true = {} if self.day is None else {"true": dict(zip(base.labels, self.day.truth.tolist(), strict=True))}
        return described | measured | bodies | true | {"warnings": list(self.warnings)}

    def document(self) -> "Document":
        """What a person reads: the base parameters, and what is grouped into each."""
        from lab.extensions.dynamics.arm.document import dynamics_document

        return dynamics_document(self)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each base parameter: its name, formula and unit, and what was identified of it."""
        names = [formula.name for formula in self.formulas]
        table: dict[str, Sequence[Any]] = {
            "parameter": [formula.label for formula in self.formulas],
            "formula": [formula.words() for formula in self.formulas],
            "unit": list(self.arm.units(names)),
        }
        if self.estimate is not None:
            table |= {"value": self.values.tolist(), "half_width_95": self.estimate.half_width.tolist()}
            table["relative_std_percent"] = (100 * self.estimate.relative_sigma).tolist()
        return table

    def plot(self) -> "Figure":
        """Draw the first drive's torque, measured and explained; without measurements, the singular values."""
        from lab.extensions.dynamics.arm.document import singular_values_picture, torque_pictures

        return (singular_values_picture(self) if self.estimate is None else torque_pictures(self)[0]).draw()

    def write(self, folder: Path) -> None:
        """Write ``config.json``, ``result.json`` and ``report.html``; of measurements ``recording.rrd`` too."""
        from lab.commands.run_folder import write_config, write_json

        write_config(folder, "dynamics", self.options, self.robot.sha256)
        write_json(folder / "result.json", self.to_dict())
        self.report(folder / "report.html")
        if self.day is not None:
            for name, samples in ((MOTION_CSV, self.day.samples), (ANOTHER_CSV, self.day.other)):
                self._write_motion(folder / name, samples)
        if self.samples is not None and not self.options.no_recording:
            from lab.extensions.dynamics.arm.recording import record_dynamics

            record_dynamics(folder / "recording.rrd", self)

    def _write_motion(self, path: Path, samples: PayloadSamples) -> None:
        """A file as ``lab dynamics`` reads it: with motor currents where the drives' gains are known."""
        chain, drives = self.robot.chain, self.drives
        if drives is not None and drives.torque_nm_per_a is not None and samples.torques is not None:
            currents = samples.torques / drives.torques(np.ones((1, chain.size)))
            samples = replace(samples, torques=currents, currents=True)
        write_loads(path, samples, chain.joint_names, chain.prismatic)


def estimate_to_dict(found: DynamicsEstimate) -> dict[str, Any]:
    """Plain values of what was identified, SI units; None is what was not."""
    values = {
        name: {"value": number(value), "half_width_95": number(half), "relative_std": number(relative)}
        for name, value, half, relative in zip(
            found.names, found.values, found.half_width, found.relative_sigma, strict=True
        )
    }
    return {
        "identified": values,
        "numbers": found.rows,
        "noise": plain_numbers(found.noise),
        "relative_error": number(found.relative_error),
        "adequate": found.verdict.adequate,
        "adequacy": found.verdict.words,
        "p": number(found.verdict.p),
        "delay_s": None if found.delay is None else _with_width(found.delay.value, found.delay.half_width),
        "load": None if found.load is None else load_to_dict(found.load),
        "load_by_difference": None if found.by_difference is None else load_to_dict(found.by_difference),
        "predictions": [
            {
                "of": each.of,
                "rows": each.rows,
                "relative_error": number(each.total_relative),
                "noise_ratio": number(each.total_noise_ratio),
                "relative_error_of_drives": plain_numbers(each.relative),
                "noise_ratio_of_drives": plain_numbers(each.noise_ratio),
            }
            for each in found.predictions
        ],
    }


def physical_to_dict(base: BaseParameters, found: PhysicalFit) -> dict[str, Any]:
    """Plain values of the nearest parameters that an arm can have, SI units."""
    return {
        "physical": found.physical,
        "distance_sigma": number(found.distance),
        "p": number(found.p),
        "base": dict(zip(base.labels, found.base.tolist(), strict=True)),
        "standard": dict(zip(base.names, found.standard.tolist(), strict=True)),
    }


def load_to_dict(load: LoadEstimate) -> dict[str, Any]:
    """Plain values of a load at the flange, SI units."""
    return {
        "mass_kg": _with_width(load.mass_kg, load.mass_half_width_kg),
        "com_m": _with_width(load.com_m, load.com_half_width),
        "inertia_about_com_kgm2": _with_width(load.inertia_com_kgm2, load.inertia_com_half_width),
        "physical": load.physical,
    }


def _with_width(value: Array | float, half_width: Array | float) -> dict[str, Any]:
    return {"value": plain_numbers(value), "half_width_95": plain_numbers(half_width)}
