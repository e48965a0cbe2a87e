"""A verification as plain values for its JSON files, and in print."""

from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from lab.commands.calibrate.result import number, statistics
from lab.commands.run_folder import config, write_json
from lab.commands.verify.options import VerifyOptions
from lab.commands.verify.run import VerifiedRun
from lab.core.significance import VERIFICATION
from lab.verification.hypotheses import Displacement
from lab.verification.test import Hypothesis

MOST_HYPOTHESES = 6  # that are printed
_ADVICE = {
    "base": "--refit base says where it is now, and whether the rest of the arm is good",
    "tool": "--refit tool says where it is now, and whether the rest of the arm is good",
    "joint": "set that zero anew, or calibrate anew",
    "reading": "measure that pose again, or mark its row use = skip",
}


def verification_summary(run: VerifiedRun) -> dict[str, Any]:
    """What ``result.json`` holds and ``--json`` prints. Lengths in mm, angles in mrad."""
    found = run.verified
    return {
        "run": str(run.calibrated.folder),
        "robot": run.calibrated.robot.name,
        "poses": len(run.rows),
        "targets": list(run.rows.targets),
        "good": found.good,
        "p": found.p,
        "level": VERIFICATION,
        "statistic": found.statistic,
        "freedom": found.numbers,
        "sigma_freedom": found.sigma_freedom,
        "observed_mm": statistics(found.errors),
        "promised_mm": 1e3 * found.promised_m,
        "moved": list(found.moved),
        "words": found.words,
        "hypotheses": [_of_hypothesis(each) for each in found.hypotheses],
        "refit": {name: _of_extent(extent) for name, extent in found.refit},
        "would_notice": {f"{name}_{_unit(run, name)}": number(1e3 * size) for name, size in found.would_notice},
        "warnings": list(run.warnings),
    }


def _of_hypothesis(each: Hypothesis) -> dict[str, Any]:
    """What may have changed."""
    return {
        "kind": each.kind,
        "words": each.words,
        **_of_extent(each.extent),
        "parameters": each.parameters,
        "chi2": each.chi2,
        "p": each.p,
        "bic": each.bic,
        "explains": each.explains,
    }


def _of_extent(extent: Displacement) -> dict[str, float | None]:
    """How far something went; null where that does not apply or is not told."""
    return {
        "shift_mm": number(1e3 * extent.shift_m),
        "shift_std_mm": number(1e3 * extent.shift_std_m),
        "turn_mrad": number(1e3 * extent.turn_rad),
        "turn_std_mrad": number(1e3 * extent.turn_std_rad),
    }


def _unit(run: VerifiedRun, what: str) -> str:
    """In what a person reads how far something moved: the base, a target, or a joint's zero."""
    joint = what.removeprefix("joint")
    turns = joint.isdigit() and not run.calibrated.robot.chain.prismatic[int(joint) - 1]
    return "mrad" if turns else "mm"


def write_verification(folder: Path, run: VerifiedRun, options: VerifyOptions) -> None:
    """What was asked, and what came out."""
    write_json(folder / "config.json", config("verify", options, run.calibrated.robot.sha256))
    write_json(folder / "result.json", verification_summary(run))


def print_verification(run: VerifiedRun, folder: Path) -> None:
    """The verdict, what may have moved, and what was fitted anew."""
    console, found = Console(markup=False), run.verified
    robot, targets = run.calibrated.robot, ", ".join(run.rows.targets)
    console.print(f"{robot.name}: {len(run.rows)} poses, targets {targets}, against {run.calibrated.folder}")
    errors = statistics(found.errors)
    console.print(
        f"position error in mm: mean {errors['mean']:.4f}, rms {errors['rms']:.4f} (promised "
        f"{1e3 * found.promised_m:.4f}), 95 % {errors['p95']:.4f}, max {errors['max']:.4f}"
    )
    for name, extent in found.refit:
        console.print(f"fitted anew: {name}, moved by {extent.words}")
    if found.hypotheses:
        console.print(_table(found.hypotheses))
    console.print(found.words)
    if found.good:
        seen = [f"{name} {1e3 * size:.2g} {_unit(run, name)}" for name, size in found.would_notice if np.isfinite(size)]
        console.print(f"in 95 of 100 such files it would be noticed if one of these were off by: {', '.join(seen)}")
    elif len(found.moved) == 1:
        console.print(_ADVICE[found.moved[0]])
    console.print(f"run: {folder}", soft_wrap=True)


def _table(hypotheses: tuple[Hypothesis, ...]) -> Table:
    """What may have changed, the best first."""
    table = Table(title="what alone would explain it")
    for heading in ("", "chi2 left", "p", "BIC", "explains"):
        table.add_column(heading, justify="left" if not heading else "right")
    for each in hypotheses[:MOST_HYPOTHESES]:
        shown = f"{each.chi2:.1f}", f"{each.p:.1e}", f"{each.bic:.1f}", "yes" if each.explains else "no"
        table.add_row(each.words, *shown)
    return table
