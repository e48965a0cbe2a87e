"""Result of ``lab dynamics``: values and files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from lab.core.checks import Check
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.dynamics.arm.base_parameters import BaseParameters, Formula, random_states, regrouping_formulas
from lab.extensions.dynamics.arm.identify_dynamics import DynamicsEstimate, PhysicalFit
from lab.extensions.dynamics.arm.newton_euler import NewtonEuler, newton_euler
from lab.extensions.dynamics.dynamics_options import DynamicsOptions
from lab.extensions.dynamics.dynamics_phrases import phrase
from lab.extensions.dynamics.load_files import PayloadSamples, write_loads
from lab.extensions.dynamics.payload.payload_estimate import LoadEstimate
from lab.extensions.dynamics.payload.payload_result import with_width
from lab.formats.drives_toml import Drives
from lab.formats.formula_program import FILE_ENDS, function_name, programs_text
from lab.kinematics.dynamics.rigid_body import ArmDynamics
from lab.library.result import Result, number, plain_numbers
from lab.robots.robot import Robot

__all__ = ["DynamicsResult", "SimulatedSession"]

_MOTION_CSV, _ANOTHER_CSV = "motion.csv", "another.csv"  # of a simulated session, in the run's folder
_STATES = 200  # over which the conditioning is computed


@dataclass(frozen=True)
class SimulatedSession:
    """A simulated measurement session with its true parameters.

    Attributes:
        other: samples along another path.
        truth: ``(b,)`` base parameters.
        load: ``(10,)`` phi of the load at the flange; None without one.
    """

    samples: PayloadSamples
    other: PayloadSamples
    truth: Array
    load: Array | None


@dataclass(frozen=True, repr=False, eq=False)
class DynamicsResult(Result):
    """An arm's base parameters, and their identified values.

    Attributes:
        options: of the command.
        arm: the inverse dynamic model.
        base: its base parameters.
        drives: gear ratios and couplings, where given.
        session: the simulated session, if any.
        samples: of the file; None where only the base parameters were requested.
        estimate: from the samples.
        physical: the nearest physical parameters; None where not every base parameter was identified.
        implausible: failed checks of plausibility.
    """

    command = "dynamics"

    options: DynamicsOptions
    robot: Robot
    arm: ArmDynamics
    base: BaseParameters
    drives: Drives | None
    session: SimulatedSession | None
    samples: PayloadSamples | None
    estimate: DynamicsEstimate | None
    physical: PhysicalFit | None
    warnings: tuple[str, ...]
    implausible: tuple[Check, ...] = ()

    @property
    def model_sha256(self) -> str:
        """Digest of the robot's description."""
        return self.robot.sha256

    @cached_property
    def formulas(self) -> tuple[Formula, ...]:
        """Formulas of the base parameters in the parameters grouped into them."""
        return regrouping_formulas(self.arm, self.base, rng_for(0, "structure", 1))

    @cached_property
    def in_letters(self) -> NewtonEuler | None:
        """Inverse dynamics in letters, where requested."""
        return newton_euler(self.arm, self.base) if self.options.symbolic else None

    @cached_property
    def singular_values(self) -> Array:
        """Singular values ``(b,)`` of the base regressor with unit columns over random states, largest first."""
        states = random_states(self.arm, _STATES, rng_for(0, "structure", 2))
        columns = self.arm.regressor(*states)[..., self.base.independent].reshape(-1, self.base.size)
        return np.asarray(np.linalg.svd(columns / np.linalg.norm(columns, axis=0), compute_uv=False))

    @property
    def values(self) -> Array:
        """Base parameters ``(b,)`` by least squares, or with --physical the nearest physical ones.

        Raises:
            LabError: nothing was measured.
        """
        if self.estimate is None:
            raise LabError("nothing was measured: give a file")
        return self.physical.base if self.options.physical and self.physical is not None else self.estimate.values

    @property
    def exit_code(self) -> int:
        """1 for an implausible estimate or lack of fit, else 0."""
        return 1 if self.implausible or (self.estimate and self.estimate.adequate is False) else 0

    def to_dict(self) -> dict[str, Any]:
        """Return the output of ``--json``, SI units: base parameters with their formulas, values and intervals."""
        base = self.base
        described = {
            "robot": self.robot.name,
            "serial": self.options.serial,
            "gravity_m_per_s2": plain_numbers(self.arm.gravity),
            "standard_parameters": len(base.names),
            "base_parameters": base.size,
            "inertial_base_parameters": base.inertial,
            "formulas": {formula.label: formula.text() for formula in self.formulas},
            "without_effect": [base.names[i] for i in base.without_effect],
        }
        implausible = {"implausible": [phrase(check) for check in self.implausible]}
        measured = {} if self.estimate is None else _estimate_to_dict(self.estimate) | implausible
        bodies = {} if self.physical is None else {"physical": _physical_to_dict(base, self.physical)}
        true = (
            {} if self.session is None else {"true": dict(zip(base.labels, self.session.truth.tolist(), strict=True))}
        )
        letters = {} if self.in_letters is None else {"newton_euler": self.in_letters.to_dict()}
        return described | measured | bodies | true | letters | {"warnings": list(self.warnings)}

    def write_files(self, folder: Path) -> None:
        """Write the motions of a simulated session, and the inverse dynamics in letters as programs."""
        if self.in_letters is not None:
            programs = (self.in_letters.program(function_name(self.robot.name)),)
            for language in FILE_ENDS:
                text = programs_text(programs, language)
                (folder / f"model.{FILE_ENDS[language]}").write_text(text, encoding="utf-8")
        if self.session is not None:
            for name, samples in ((_MOTION_CSV, self.session.samples), (_ANOTHER_CSV, self.session.other)):
                self._write_motion(folder / name, samples)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """Return a row for each base parameter: its name, formula and unit, and its identified value."""
        names = [formula.name for formula in self.formulas]
        table: dict[str, Sequence[Any]] = {
            "parameter": [formula.label for formula in self.formulas],
            "formula": [formula.text() for formula in self.formulas],
            "unit": list(self.arm.units(names)),
        }
        if self.estimate is not None:
            table |= {"value": self.values.tolist(), "half_width_95": self.estimate.half_width.tolist()}
            table["relative_std_percent"] = (100 * self.estimate.relative_sigma).tolist()
        return table

    def _write_motion(self, path: Path, samples: PayloadSamples) -> None:
        """Write a file as ``lab dynamics`` reads it: with motor currents where the drives' gains are given."""
        chain, drives = self.robot.chain, self.drives
        if drives is not None and drives.torque_nm_per_a is not None and samples.torques is not None:
            currents = samples.torques / drives.torques(np.ones((1, chain.size)))
            samples = replace(samples, torques=currents, currents=True)
        write_loads(path, samples, chain.joint_names, chain.prismatic)


def _estimate_to_dict(found: DynamicsEstimate) -> dict[str, Any]:
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
        "adequate": found.adequate,
        "adequacy": phrase(found.verdict),
        "p": number(found.verdict.p),
        "delay_s": None if found.delay is None else with_width(found.delay.value, found.delay.half_width),
        "load": None if found.load is None else _load_to_dict(found.load),
        "load_by_difference": None if found.by_difference is None else _load_to_dict(found.by_difference),
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


def _physical_to_dict(base: BaseParameters, found: PhysicalFit) -> dict[str, Any]:
    return {
        "physical": found.physical,
        "distance_sigma": number(found.distance),
        "p": number(found.p),
        "base": dict(zip(base.labels, found.base.tolist(), strict=True)),
        "standard": dict(zip(base.names, found.standard.tolist(), strict=True)),
    }


def _load_to_dict(load: LoadEstimate) -> dict[str, Any]:
    return {
        "mass_kg": with_width(load.mass_kg, load.mass_half_width_kg),
        "com_m": with_width(load.com_m, load.com_half_width),
        "inertia_about_com_kgm2": with_width(load.inertia_com_kgm2, load.inertia_com_half_width),
        "physical": load.physical,
    }
