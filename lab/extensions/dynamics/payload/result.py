"""Result of ``lab payload``: values, document and pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lab.campaign.robot import Robot
from lab.commands.result import Result, number, plain_numbers
from lab.core.checks import Check
from lab.core.limits import called
from lab.core.se3 import Array
from lab.core.units import MICRONS, MM
from lab.extensions.dynamics.load_files import WRENCH, Mounting, PayloadSamples, write_loads, write_mounting
from lab.extensions.dynamics.options import PayloadOptions
from lab.extensions.dynamics.payload.estimate import LoadEstimate
from lab.extensions.dynamics.phrases import phrase
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

__all__ = [
    "FIT_BADGES",
    "PayloadResult",
    "UncertaintyCost",
    "channels_of",
    "fit_pictures",
    "parameter_rows",
    "true_values",
    "wild_sample",
    "with_width",
]

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
    shown_by = "lab.extensions.dynamics.payload.result:_payload_document"
    drawn_by = "lab.extensions.dynamics.payload.result:_main_picture"
    recorded_by = "lab.extensions.dynamics.recording:record_payload"

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

    @property
    def is_recorded(self) -> bool:
        """False where the payload was identified from sag."""
        return self.samples is not None

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


_MAX_DRAWN = 600  # rows
_UNITS = {"s": (1e3, "ms"), "rad": (180 / np.pi, "°")}  # by which a person reads a number of a unit
FIT_BADGES = {True: Badge("no lack of fit", "good"), False: Badge("lack of fit", "bad"), None: Badge("not judged")}


def _main_picture(result: PayloadResult) -> Picture:
    return _channel_pictures(result)[0]


def _channel_pictures(result: PayloadResult) -> tuple[Picture, ...]:
    return fit_pictures(channels_of(result), result.estimate.measured, result.estimate.residual, "channel", "{}")


def _payload_document(result: PayloadResult) -> Document:
    found = result.estimate
    mass = (
        f"{found.mass_kg:.4g} kg at the flange"
        if np.isfinite(found.mass_kg)
        else "a payload whose mass is not identifiable"
    )
    return Document(
        f"{called(result.robot.name, result.options.serial)}: {mass}",
        (
            Paragraph(f"{capital(found.method)}: {found.rank} of {found.columns} parameters identified.", "lead"),
            Paragraph((FIT_BADGES[found.adequate], f" {sentence(phrase(found.verdict))}")),
            Warnings(result.warnings),
            Section("The payload", _payload(result)),
            Section("Error due to its uncertainty", (Paragraph(_cost(result)),)),
            Section("Not identifiable", (Bullets(tuple(map(sentence, found.unidentified))),)),
            Section("Parameters fitted with it", (_nuisance_table(found),)),
            Section("Measured and explained", (Figure("explained", _channel_pictures(result), _CAPTION),)),
            Section("What is shown", (Bullets(_LEGEND),), shown_in=RECORDING),
        ),
    )


_CAPTION = "What the payload adds, as measured, and as the payload and what was fitted along explain it."
_LEGEND = (
    (Strong("green"), ": the payload, as the solid ellipsoid with its mass and inertia (a ball of steel where that is "
     "not known)"),
    (Strong("red"), ": its weight"),
    ("curves: ", Strong("green"), " with the payload, ", Strong("grey"), " without"),
)  # fmt: skip


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


def true_values(phi: Array) -> dict[str, float]:
    """Return the true values of a simulated payload, by the names of ``parameter_rows`` and in their units."""
    inertia = inertia_about_centre(phi)
    values = {"mass": float(phi[0])}
    values |= {f"centre of mass, {axis}": float(MM.of(phi[1 + i]) / phi[0]) for i, axis in enumerate("xyz")}
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    names = {(i, j): f"I{'xyz'[i]}{'xyz'[j]} about the centre of mass" for i, j in pairs}
    return values | {name: float(1e4 * inertia[cell]) for cell, name in names.items()}


def fit_pictures(
    channels: Sequence[tuple[str, str]], measured: Array, residual: Array, key: str, title: str
) -> tuple[Picture, ...]:
    """Plot each channel as measured and as fitted.

    Args:
        channels: names and units.
        key: of the pictures, before their number.
        title: of a picture, with ``{}`` for the channel's name.
    """
    every = max(1, len(measured) // _MAX_DRAWN)
    measured, residual = measured[::every], residual[::every]
    pictures = []
    for i, (name, unit) in enumerate(channels):

        def draw(axes: Axes, i: int = i, name: str = name, unit: str = unit) -> None:
            at = np.arange(len(measured)) * every
            axes.plot(at, measured[:, i], ".", color=MEASURED, markersize=3, label="measured")
            axes.plot(at, measured[:, i] - residual[:, i], "-", color=PREDICTED, linewidth=1, label="explained")
            axes.set(title=name, xlabel="row, as thinned", ylabel=unit)
            if i == 0:
                axes.legend(loc="best")

        label = f"{title.format(name)}, measured and explained"
        pictures.append(axes_picture(f"{key}{i}", label, (4.4, 2.3), draw, (0.7, 0.45, 0.1, 0.3)))
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
    """Round a value to the second digit of its half-width."""
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
