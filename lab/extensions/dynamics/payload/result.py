"""An identified payload: typed, and as plain values for its JSON files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.campaign.robot import Robot
from lab.commands.hand_load import HandLoad
from lab.commands.result import Result, number, plain_numbers
from lab.core.limits import called
from lab.core.se3 import Array
from lab.core.units import MICRONS, MM
from lab.extensions.dynamics.load_files import WRENCH, Mounting, PayloadSamples, write_loads, write_mounting
from lab.extensions.dynamics.payload.estimate import LoadEstimate, Nuisance
from lab.extensions.dynamics.payload.options import PayloadOptions
from lab.extensions.dynamics.payload.plausibility import Implausibility
from lab.kinematics.dynamics.rigid_body import inertia_about_centre
from lab.render.charts.chart import axes_picture
from lab.render.charts.marks import Axes
from lab.render.document import (
    RECORDING,
    Badge,
    Block,
    Bullets,
    Document,
    Figure,
    Paragraph,
    Picture,
    Section,
    Strong,
    Table,
    Warnings,
    capital,
    sentence,
    short,
)
from lab.render.style import MEASURED, PREDICTED

if TYPE_CHECKING:
    from lab.render.document import Document

__all__ = ["PayloadResult", "UncertaintyCost", "channels_of", "parameter_rows", "true_values", "wild_sample"]

LOAD_CSV, SENSOR_TOML = "load.csv", "sensor.toml"  # of a simulated session, in the run's folder
_WILD = 7.0  # standard deviations, which one in 4e11 samples passes


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
        options: what was asked.
        samples: what was read; None where the payload was identified from sag.
        mounting: how the base and a wrist sensor stand.
        estimate: by least squares, or the nearest that a body can have, where that was asked for (``moved``).
        cost: what its uncertainty costs.
        targets: the tracked points, where the payload was identified from sag.
        implausible: why it cannot be what it was identified as.
        truth: ``(10,)`` phi of the virtual payload, where the session was simulated.
    """

    command = "payload"
    shown_by = "lab.extensions.dynamics.payload.result:_payload_document"
    drawn_by = "lab.extensions.dynamics.payload.result:_main_picture"
    recorded_by = "lab.extensions.dynamics.payload.recording:record_payload"

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
    def model_sha256(self) -> str:
        """Digest of the robot's description."""
        return self.robot.sha256

    @property
    def _trusted(self) -> bool:
        """Reliability: mass and centre of mass are identified and plausible, without lack of fit or outliers."""
        identified = np.isfinite(self.estimate.phi[:4]).all() and not self.implausible
        return bool(identified and self.estimate.adequate is not False and wild_sample(self.estimate) is None)

    @property
    def exit_code(self) -> int:
        """0 where the payload may be trusted, else 1."""
        return 0 if self._trusted else 1

    @property
    def _load(self) -> HandLoad:
        """The payload as a load in gravity."""
        return self.estimate.hand_load

    def to_dict(self) -> dict[str, Any]:
        """Return the output of ``--json`` and ``result.json``: SI units; None for values not identified."""
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
            "adequacy": found.verdict.description,
            "p": number(found.verdict.p),
            "implausible": [each.description for each in self.implausible],
            "physical": found.physical,
            "made_physical": found.moved,  # least squares found what no body has
            "unseen": list(found.unidentified),
            "also_fitted": [_nuisance(each) for each in found.nuisance],
            "numbers": found.rows,
            "rows": None if samples is None else {"loaded": int(samples.loaded.sum()), "all": len(samples)},
            "noise": [number(sigma) for sigma in found.sigma],
            "cost_um": number(MICRONS.of(self.cost.rms_m)),
            "stiffness_nm_per_rad": [number(1 / soft) if soft else None for soft in self.cost.compliance],
            "warnings": list(self.warnings),
        } | ({} if self.truth is None else {"true": _true(self.truth)})

    @property
    def is_recorded(self) -> bool:
        """False where the payload is known by its weight and balance alone."""
        return self.samples is not None

    def write_files(self, folder: Path) -> None:
        """Write the payload for ``--load``, and what a simulated session measured."""
        if np.isfinite(self._load.centre_m).all():
            self._load.write(folder)
        if self.truth is not None and self.samples is not None:
            write_loads(folder / LOAD_CSV, self.samples, self.robot.chain.joint_names, self.robot.chain.prismatic)
            write_mounting(folder / SENSOR_TOML, self.mounting)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each identified parameter: name, value, half-width of its 95 % interval, and unit."""
        names, values, widths, units = zip(*parameter_rows(self.estimate), strict=True)
        return {"parameter": names, "value": values, "half_width_95": widths, "unit": units}


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
    if size.max() < _WILD:
        return None
    row, channel = np.unravel_index(int(size.argmax()), size.shape)
    part = row / max(len(size) - 1, 1)
    return (
        f"a sample of column {channel + 1} of what is explained is {size.max():.0f} standard deviations off, at "
        f"{part:.0%} of the rows: the intervals are invalid; fix it, or leave it out"
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


MOST_DRAWN = 600  # rows
_UNITS = {"s": (1e3, "ms"), "rad": (180 / np.pi, "°")}  # by which a person reads a number of a unit
_FIT = {True: Badge("no lack of fit", "good"), False: Badge("lack of fit", "bad"), None: Badge("not judged")}


def _main_picture(result: PayloadResult) -> Picture:
    """Return the first channel, measured and explained by the payload."""
    return _channel_pictures(result)[0]


def _payload_document(result: PayloadResult) -> Document:
    """The payload with its intervals, the goodness of fit, the cost of its uncertainty, and what was not identified."""
    found = result.estimate
    known = np.isfinite(found.mass_kg)
    mass = f"{found.mass_kg:.4g} kg at the flange" if known else "a payload whose mass is not identifiable"
    return Document(
        f"{called(result.robot.name, result.options.serial)}: {mass}",
        (
            Paragraph(f"{capital(found.method)}: {found.rank} of {found.columns} parameters identified.", "lead"),
            Paragraph((_FIT[found.adequate], f" {sentence(found.verdict.description)}")),
            Warnings(result.warnings),
            Section("The payload", _payload(result)),
            Section("Error due to its uncertainty", (Paragraph(_cost(result)),)),
            Section("Not identifiable", (Bullets(tuple(map(sentence, found.unidentified))),)),
            Section("Parameters fitted with it", (_nuisance_table(found),)),
            Section("Measured and explained", (_explained(result),)),
            Section("What is shown", (Bullets(_LEGEND),), shown_in=RECORDING),
        ),
    )


_LEGEND = (
    (Strong("green"), ": the payload, as the solid ellipsoid with its mass and inertia (a ball of steel where that is "
     "not known)"),
    (Strong("red"), ": its weight"),
    ("curves: ", Strong("green"), " with the payload, ", Strong("grey"), " without"),
)  # fmt: skip


def parameter_rows(found: LoadEstimate) -> list[tuple[str, float, float, str]]:
    """Name, value, half-width of the 95 % interval and unit (mm for lengths) of every parameter that is identified."""
    rows = [("mass", found.mass_kg, found.mass_half_width_kg, 1.0, "kg")]
    for i, axis in enumerate("xyz"):
        rows.append((f"centre of mass, {axis}", found.com_m[i], found.com_half_width[i], 1e3, "mm"))
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        value, width = found.inertia_com_kgm2[i, j], found.inertia_com_half_width[i, j]
        rows.append((f"I{'xyz'[i]}{'xyz'[j]} about the centre of mass", value, width, 1e4, "kg cm²"))
    identified = [row for row in rows if np.isfinite(row[1])]
    return [(name, float(scale * value), float(scale * width), unit) for name, value, width, scale, unit in identified]


def true_values(phi: Array) -> dict[str, float]:
    """Return the true values of a simulated payload, by the names of ``parameter_rows`` and in their units."""
    inertia = inertia_about_centre(phi)
    values = {"mass": float(phi[0])}
    values |= {f"centre of mass, {axis}": float(MM.of(phi[1 + i]) / phi[0]) for i, axis in enumerate("xyz")}
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    names = {(i, j): f"I{'xyz'[i]}{'xyz'[j]} about the centre of mass" for i, j in pairs}
    return values | {name: float(1e4 * inertia[cell]) for cell, name in names.items()}


def _channel_pictures(result: PayloadResult) -> tuple[Picture, ...]:
    """Plot each channel as measured and as fitted by the payload with the nuisance parameters."""
    found = result.estimate
    every = max(1, len(found.measured) // MOST_DRAWN)
    measured, left = found.measured[::every], found.residual[::every]
    pictures = []
    for i, (name, unit) in enumerate(channels_of(result)):

        def draw(axes: Axes, i: int = i, name: str = name, unit: str = unit) -> None:
            at = np.arange(len(measured)) * every
            axes.plot(at, measured[:, i], ".", color=MEASURED, markersize=3, label="measured")
            axes.plot(at, measured[:, i] - left[:, i], "-", color=PREDICTED, linewidth=1, label="explained")
            axes.set(title=name, xlabel="row, as thinned", ylabel=unit)
            if i == 0:
                axes.legend(loc="best")

        label = f"{name}, measured and explained"
        pictures.append(axes_picture(f"channel{i}", label, (4.4, 2.3), draw, (0.7, 0.45, 0.1, 0.3)))
    return tuple(pictures)


def _payload(result: PayloadResult) -> tuple[Block, ...]:
    found = parameter_rows(result.estimate)
    rows: tuple[tuple[str, ...], ...] = tuple(
        (name, *_rounded(value, width), unit) for name, value, width, unit in found
    )
    columns: tuple[str, ...] = ("", "value", "±", "unit")
    if result.truth is not None:
        columns = (*columns, "true")
        truth = true_values(result.truth)
        rows = tuple((*row, short(truth[row[0]])) for row in rows)
    caption = f"About and along the frame of the {result.estimate.frame}, with half-widths of 95 % intervals."
    physical = "No body has what least squares found: these are the nearest parameters that one has."
    note = Paragraph(physical if result.estimate.moved else "", "note")
    return Table(columns, rows, caption), note


def _rounded(value: float, half_width: float) -> tuple[str, str]:
    """A value to the second digit of its half-width."""
    digits = max(0, 1 - int(np.floor(np.log10(half_width)))) if half_width > 0 else 6
    return f"{value:.{min(digits, 9)}f}".replace("-", "−"), f"{half_width:.{min(digits, 9)}f}"


def _cost(result: PayloadResult) -> str:
    """Report the position error from the payload's uncertainty; empty where its weight was not identified."""
    if not np.isfinite(result.cost.rms_m):
        return ""
    soft = result.cost.compliance[result.cost.compliance > 0]
    alike = len(soft) and np.ptp(soft) < 1e-9 * soft[0]
    stiffness = f"joints of {1 / soft[0]:,.6g} Nm/rad" if alike else "joints of the identified stiffness"
    return (
        f"Its uncertainty moves a point that is corrected for it by {MICRONS.text(result.cost.rms_m, 2)} (1σ, root "
        f"mean square over the workspace, {stiffness})."
    )


def _nuisance_table(found: LoadEstimate) -> Table:
    rows = []
    for each in found.nuisance:
        scale, unit = _UNITS.get(each.unit, (1.0, each.unit))
        rows.append((each.name, short(scale * each.value), short(scale * each.half_width), unit))
    return Table(("", "value", "±", "unit"), tuple(rows))


def _explained(result: PayloadResult) -> Figure:
    caption = "What the payload adds, as measured, and as the payload and what was fitted along explain it."
    return Figure("explained", _channel_pictures(result), caption)
