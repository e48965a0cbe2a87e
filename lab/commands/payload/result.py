"""A load at the hand as plain values for its JSON files, and in print."""

from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from lab.commands.calibrate.result import number
from lab.commands.payload.options import PayloadOptions
from lab.commands.payload.run import PayloadResult
from lab.commands.run_folder import config, write_json
from lab.core.se3 import Array
from lab.formats.load_csv import WRENCH
from lab.payload_identification.estimate import LoadEstimate, Nuisance

AXES = "xyz"
_PEOPLE = {"s": (1e3, "ms"), "rad": (180 / np.pi, "°")}  # units that a person reads


def payload_summary(run: PayloadResult) -> dict[str, Any]:
    """What ``result.json`` holds and ``--json`` prints. SI units; null is what was not identified."""
    found = run.estimate
    rows = None if run.records is None else {"loaded": int(run.records.loaded.sum()), "all": len(run.records)}
    return {
        "robot": run.robot.name,
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
        "physical": found.physical,
        "made_physical": run.estimate is not run.fitted,
        "unseen": list(found.unidentified),
        "also_fitted": [_of_nuisance(each) for each in found.nuisance],
        "numbers": found.rows,
        "rows": rows,
        "noise": [number(sigma) for sigma in found.sigma],
        "cost_um": number(1e6 * run.cost_m),
        "stiffness_nm_per_rad": [number(1 / soft) if soft else None for soft in run.compliance],
        "warnings": list(run.warnings),
    }


def _with_width(value: Array | float, half_width: Array | float) -> dict[str, Any]:
    return {"value": _plain(value), "half_width_95": _plain(half_width)}


def _plain(value: Array | float) -> Any:
    """Nested lists, with null for what is not known."""
    array = np.asarray(value, dtype=np.float64)
    return number(float(array)) if array.ndim == 0 else [_plain(part) for part in array]


def _of_nuisance(each: Nuisance) -> dict[str, Any]:
    return {
        "name": each.name,
        "value": number(each.value),
        "half_width_95": number(each.half_width),
        "unit": each.unit,
    }


def write_payload(folder: Path, run: PayloadResult, options: PayloadOptions) -> None:
    """What was asked, what came out, and the load itself for ``--load``."""
    write_json(folder / "config.json", config("payload", options, run.robot.sha256))
    write_json(folder / "result.json", payload_summary(run))
    if np.isfinite(run.load.centre_m).all():
        run.load.write(folder)


def print_payload(run: PayloadResult, folder: Path) -> None:
    """The load with its intervals, what is not known, whether to believe it, and what its uncertainty costs."""
    console, found = Console(markup=False), run.estimate
    console.print(f"{run.robot.name}: {found.method}; {found.rank} of {found.columns} parameters identified")
    table = Table(title=f"load, in the frame of the {found.frame}, with 95 % intervals", title_justify="left")
    for heading in ("", "value", "±", "unit"):
        table.add_column(heading, justify="right" if heading in ("value", "±") else "left")
    for name, value, width, unit in rows_of(found):
        table.add_row(name, value, width, unit)
    console.print(table)
    for each in found.nuisance:
        factor, unit = display_unit(each.unit)
        console.print(f"  {each.name}: {factor * each.value:.4g} ± {factor * each.half_width:.2g} {unit}".rstrip())
    for words in found.unidentified:
        console.print(f"not told: {words}")
    console.print(found.verdict.words)
    if run.estimate is not run.fitted:
        console.print("no body has what least squares found: these are the nearest parameters that one has")
    if np.isfinite(run.cost_m):
        console.print(cost_words(run))
    console.print(f"run: {folder}", soft_wrap=True)


def rows_of(found: LoadEstimate) -> list[tuple[str, str, str, str]]:
    """Name, value, half-width and unit of what was told and a person wants to know; mm for lengths."""
    rows = [("mass", found.mass_kg, found.mass_half_width_kg, 1.0, "kg")]
    for i, axis in enumerate(AXES):
        rows.append((f"centre of mass, {axis}", found.com_m[i], found.com_half_width[i], 1e3, "mm"))
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        value, width = found.inertia_com_kgm2[i, j], found.inertia_com_half_width[i, j]
        rows.append((f"inertia {AXES[i]}{AXES[j]} about it", value, width, 1e4, "kg cm²"))
    told = [row for row in rows if np.isfinite(row[1])]
    return [(name, *_rounded(factor * value, factor * width), unit) for name, value, width, factor, unit in told]


def _rounded(value: float, half_width: float) -> tuple[str, str]:
    """A value to the second digit of its half-width."""
    digits = max(0, 1 - int(np.floor(np.log10(half_width)))) if half_width > 0 else 6
    return f"{value:.{min(digits, 9)}f}".replace("-", "−"), f"{half_width:.{min(digits, 9)}f}"


def channels(run: PayloadResult) -> list[tuple[str, str]]:
    """Names and units of the columns that the load was identified from."""
    chain = run.robot.chain
    if run.records is None:
        return [(f"{target} {axis}", "m") for target in run.targets for axis in AXES]
    if run.estimate.method.startswith("wrench"):
        return [(name.partition("_")[0], "N" if name.startswith("f") else "Nm") for name in WRENCH]
    return [(name, "N" if slides else "Nm") for name, slides in zip(chain.joint_names, chain.prismatic, strict=True)]


def display_unit(unit: str) -> tuple[float, str]:
    """By what to multiply a number of this unit, and the unit that a person reads then."""
    return _PEOPLE.get(unit, (1.0, unit))


def cost_words(run: PayloadResult) -> str:
    """What the load's uncertainty costs."""
    soft = run.compliance[run.compliance > 0]
    by = f"{1 / soft[0]:g} Nm/rad" if len(soft) and np.ptp(soft) < 1e-9 * soft[0] else "the identified stiffness"
    return (
        f"its uncertainty moves a point that is corrected for it by {1e6 * run.cost_m:.2g} µm (1σ, root mean square "
        f"over the workspace, joints of {by})"
    )
