"""Result of ``lab dynamics``: values, document and pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from lab.campaign.robot import Robot
from lab.commands.result import Result, number, plain_numbers
from lab.core.checks import Check
from lab.core.errors import LabError
from lab.core.limits import called
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.significance import PAYLOAD_RESIDUALS
from lab.extensions.dynamics.arm.base_parameters import BaseParameters, Formula, random_states, regrouping_formulas
from lab.extensions.dynamics.arm.identify import DynamicsEstimate, PhysicalFit
from lab.extensions.dynamics.arm.newton_euler import NewtonEuler, newton_euler
from lab.extensions.dynamics.load_files import PayloadSamples, write_loads
from lab.extensions.dynamics.options import DynamicsOptions
from lab.extensions.dynamics.payload.estimate import LoadEstimate
from lab.extensions.dynamics.payload.result import FIT_BADGES, fit_pictures, parameter_rows, true_values, with_width
from lab.extensions.dynamics.phrases import phrase
from lab.formats.drives_toml import Drives
from lab.formats.formula_program import FILE_ENDS, function_name, programs_text
from lab.kinematics.dynamics.rigid_body import ArmDynamics
from lab.render.charts.chart import axes_picture, log_ticks
from lab.render.charts.marks import Axes
from lab.render.document import (
    EVERYWHERE,
    PAGE,
    Block,
    Document,
    Figure,
    Paragraph,
    Picture,
    Section,
    Table,
    Warnings,
    digits_of,
    fixed,
    sentence,
    short,
)
from lab.render.style import PREDICTED

__all__ = ["DynamicsResult", "SimulatedSession"]

_MOTION_CSV, _ANOTHER_CSV = "motion.csv", "another.csv"  # of a simulated session, in the run's folder
_STATES = 200  # over which the conditioning is computed
_ROUNDING = 1e-12  # of true values, SI


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
    shown_by = "lab.extensions.dynamics.arm.result:_dynamics_document"
    drawn_by = "lab.extensions.dynamics.arm.result:_main_picture"
    recorded_by = "lab.extensions.dynamics.recording:record_dynamics"

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

    @property
    def is_recorded(self) -> bool:
        """False where nothing was measured."""
        return self.samples is not None

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


def _main_picture(result: DynamicsResult) -> Picture:
    return _singular_values_picture(result) if result.estimate is None else _torque_pictures(result)[0]


def _dynamics_document(result: DynamicsResult) -> Document:
    base, found = result.base, result.estimate
    grouping = (Paragraph(_counts(result)), _formulas(result), Paragraph(_without(result)))
    name = called(result.robot.name, result.options.serial)
    return Document(
        f"{name}: {base.size} base parameters of {len(base.names)} standard ones",
        (
            *(
                ()
                if found is None
                else (Paragraph((FIT_BADGES[found.adequate], f" {sentence(phrase(found.verdict))}")),)
            ),
            Warnings(result.warnings),
            *(() if found is None else _identified(result, found)),
            Section("Base parameters", grouping, shown_in=EVERYWHERE if found is None else PAGE),
            Section("Inverse dynamics in letters", _letters(result)),
            Section("Conditioning", (_conditioning(result),), shown_in=EVERYWHERE if found is None else PAGE),
        ),
    )


def _letters(result: DynamicsResult) -> tuple[Block, ...]:
    """Tabulate the steps of Newton and Euler's recursion."""
    found = result.in_letters
    if found is None:
        return ()
    letters = ", ".join(f"{name} = {value:.6g}" for name, value in found.letters.items()).replace("-", "−")
    count = f"{found.multiplications} multiplications and {found.additions} additions"
    units = "q1, qd1 and qdd1 are joint 1's position, speed and acceleration (SI, rad)"
    torques = tuple((f"torque {j}", each) for j, each in enumerate(found.torques, 1))
    return (
        Paragraph(f"Newton and Euler's recursion with the base parameters: {count}. Here {units}. {letters}."),
        Table(("", ""), (*found.steps, *torques)),
    )


def _identified(result: DynamicsResult, found: DynamicsEstimate) -> tuple[Section, ...]:
    caption = "Measured torques, and what the parameters make of them."
    return (
        Section("Identified parameters", (_values(result, found), Paragraph(_noise(result, found)))),
        Section("Physical consistency", (Paragraph(_physical(result)),)),
        Section("Predicted torques", (_predictions(result, found),)),
        Section("The load", _loads(result, found)),
        Section("Measured and explained", (Figure("torques", _torque_pictures(result), caption),), shown_in=PAGE),
    )


def _values(result: DynamicsResult, found: DynamicsEstimate) -> Table:
    """Round values to the second digit of their half-widths."""
    units = result.arm.units([formula.name for formula in result.formulas])
    rows: list[tuple[str, ...]] = []
    for name, unit, value, half, relative in zip(
        found.names, units, result.values, found.half_width, found.relative_sigma, strict=True
    ):
        if not np.isfinite(value):
            rows.append((name, "–", "–", "–", unit))
            continue
        digits = digits_of(half, 9)
        rows.append((name, fixed(value, digits), fixed(half, digits), f"{short(100 * relative)} %", unit))
    caption = "With half-widths of 95 % intervals and relative standard deviations."
    columns: tuple[str, ...] = ("base parameter", "value", "±", "relative σ", "unit")
    if result.session is not None:
        columns = (*columns, "true")
        rows = [
            (*row, short(true if abs(true) > _ROUNDING else 0.0))
            for row, true in zip(rows, result.session.truth.tolist(), strict=True)
        ]
    return Table(columns, tuple(rows), caption)


def _noise(result: DynamicsResult, found: DynamicsEstimate) -> str:
    noise = ", ".join(short(sigma) for sigma in found.noise)
    units = "Nm" if not any(result.robot.chain.prismatic) else "Nm (N of a slide)"
    late = ""
    if found.delay is not None:
        value, half = (short(1e3 * each) for each in (found.delay.value, found.delay.half_width))
        late = f" The torques are {value} ± {half} ms later than the positions."
    return (
        f"What is left of the torques is {short(100 * found.relative_error)} % of them. The noise of one reading is "
        f"{noise} {units} (1σ, estimated).{late}"
    )


def _physical(result: DynamicsResult) -> str:
    """State whether the parameters are physically consistent."""
    fit = result.physical
    if fit is None:
        return ""
    if fit.physical:
        return "Links, motors and joints can have these parameters."
    noise = "which the noise explains" if fit.p > PAYLOAD_RESIDUALS else "which the noise does not explain"
    taken = "the table has these" if result.options.physical else "--physical takes these"
    return (
        f"No arm has exactly what least squares found; the nearest that one has is {short(fit.distance)} standard "
        f"deviations away, {noise} (p = {fit.p:.2g}); {taken}."
    )


def _predictions(result: DynamicsResult, found: DynamicsEstimate) -> Table:
    """Return a row for each predicted path, and for each drive of it."""
    rows = []
    for each in found.predictions:
        rows.append((each.of, "all", short(100 * each.total_relative, "%"), short(each.total_noise_ratio)))
        for name, relative, ratio in zip(result.robot.chain.joint_names, each.relative, each.noise_ratio, strict=True):
            rows.append(("", name, short(100 * relative, "%"), short(ratio)))
    return Table(("torques of", "drive", "relative error", "error / noise"), tuple(rows))


def _loads(result: DynamicsResult, found: DynamicsEstimate) -> tuple[Block, ...]:
    """Compare the load by both methods."""
    if found.load is None:
        return ()
    first, *others = [parameter_rows(load) for load in (found.load, found.by_difference) if load is not None]
    if not first:
        return (Paragraph("The motion does not identify the load."),)
    rows = []
    true = None if result.session is None or result.session.load is None else true_values(result.session.load)
    for name, value, width, unit in first:
        cells = [_interval_text(row[1], row[2]) for rows_of_other in others for row in rows_of_other if row[0] == name]
        cells = [_interval_text(value, width), *cells]
        true_cell = () if true is None else (short(true[name]),)
        rows.append((name, *cells, *("–" for _ in range(2 - len(cells))), unit, *true_cell))
    caption = "About and along the frame of the flange, with half-widths of 95 % intervals."
    columns = ("", "with the arm at once", "by difference of the runs", "unit", *(() if true is None else ("true",)))
    return (Table(columns, tuple(rows), caption),)


def _interval_text(value: float, half_width: float) -> str:
    if not np.isfinite(half_width):
        return f"{short(value)} ± –"
    digits = digits_of(half_width, 6)
    return f"{fixed(value, digits)} ± {fixed(half_width, digits)}"


def _torque_pictures(result: DynamicsResult) -> tuple[Picture, ...]:
    found, chain = result.estimate, result.robot.chain
    assert found is not None
    drives = [(name, "N" if slides else "Nm") for name, slides in zip(chain.joint_names, chain.prismatic, strict=True)]
    return fit_pictures(drives, found.measured, found.residual, "torque", "Torque of {}")


def _singular_values_picture(result: DynamicsResult) -> Picture:
    """Plot singular values relative to the largest, from the best determined direction to the worst."""
    relative = result.singular_values / result.singular_values[0]

    def draw(axes: Axes) -> None:
        axes.plot(np.arange(1, len(relative) + 1), relative, "o", color=PREDICTED, markersize=4.5)
        log_ticks(axes, "y", relative.min() / 1.6, 1.7)
        axes.set(xlabel="direction, from the best determined to the worst", ylabel="relative singular value")

    text = "Singular values of the base regressor with unit columns"
    return axes_picture("singular-values", text, (5.6, 2.8), draw, (0.8, 0.5, 0.2, 0.15))


def _counts(result: DynamicsResult) -> str:
    base, others = result.base, result.base.size - result.base.inertial
    left = f" ({', '.join(result.options.without)} left out)" if result.options.without else ""
    return (
        f"The torques determine {base.inertial} parameters of links and motors, and {others} of friction and offsets"
        f"{left}. The rest is grouped into them, with these coefficients of the table's lengths:"
    )


def _formulas(result: DynamicsResult) -> Table:
    names = [formula.name for formula in result.formulas]
    units = result.arm.units(names)
    rows = tuple((formula.label, formula.text(), unit) for formula, unit in zip(result.formulas, units, strict=True))
    caption = (
        "XX to ZZ: inertia about and along the frame on the joint's axis; MX MY MZ: first moments; M: mass; Ia: motor "
        "inertia; Fc, Fv: Coulomb and viscous friction; off: offset. R: others are grouped into it."
    )
    return Table(("base parameter", "is", "unit"), rows, caption)


def _without(result: DynamicsResult) -> str:
    names = [result.base.names[i] for i in result.base.without_effect]
    return f"No torque depends on {', '.join(names)}." if names else ""


def _conditioning(result: DynamicsResult) -> Figure:
    condition = result.singular_values[0] / result.singular_values[-1]
    caption = f"Over random states, columns of unit length; the condition number is {condition:.0f}."
    return Figure("singular-values-figure", (_singular_values_picture(result),), caption)
