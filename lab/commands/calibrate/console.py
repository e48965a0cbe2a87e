"""What the commands print for a person: millimetres and degrees."""

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from lab.commands.calibrate.result import summary
from lab.commands.calibrate.run import CalibrationResult


def print_outcome(outcome: CalibrationResult, folder: Path) -> None:
    """The campaign in a few lines: before and after, what was identified, where the run is."""
    console, result = Console(markup=False), summary(outcome)
    console.print(
        f"{result['robot']}: {result['poses']} poses, targets {', '.join(result['targets'])}: "
        f"{result['rank']} of {result['parameters']} parameters identified in {result['iterations']} steps, "
        f"condition {result['condition']:.1f}"
    )
    _print_errors(console, result)
    if result["noise_mm"] is not None:
        turned = "" if result["noise_mrad"] is None else f" and {result['noise_mrad']:.3g} mrad"
        console.print(
            f"noise {1e3 * result['noise_mm']:,.4g} µm{turned} per axis, "
            f"{'given' if result['noise_known'] else 'estimated'}"
        )
    if (truth := result.get("truth")) and truth["max_abs_z"] is not None:
        console.print(
            f"against the truth: the largest error is {truth['max_abs_z']:.2f} σ, "
            f"NEES {truth['nees_per_parameter']:.2f} a parameter, "
            f"{100 * truth['coverage_95']:.0f} % of the 95 % intervals hold"
        )
    if truth and truth["bad_readings"]:
        console.print(f"of {truth['bad_readings']} bad readings {truth['bad_named']} are named")
    _print_groups(console, result["groups"])
    for joint, stiffness in result["stiffness_nm_per_rad"].items():
        unsure = result["stiffness_std_nm_per_rad"][joint]
        give = "" if unsure is None else f" ± {unsure:,.0f}"
        console.print(f"stiffness of {joint}: {stiffness:,.0f}{give} Nm/rad{'' if unsure is None else ' (1σ)'}")
    console.print(result["adequacy"])
    _print_outliers(console, result)
    doubt = ", but the model is not adequate (above)" if result["adequate"] is False else ""
    console.print(f"verdict: {result['verdict']}" + (f" ({result['reason']})" if result["reason"] else "") + doubt)
    console.print(f"run: {folder}", soft_wrap=True)


def _print_errors(console: Console, result: dict[str, Any]) -> None:
    """Before and after."""
    if result["after_mm"] is not None:
        console.print(f"position error in mm, judged by {_JUDGED[result['judged_by']]}:")
        table = Table()
        for heading in ("", "mean", "rms", "95 %", "max", "points"):
            table.add_column(heading, justify="right")
        for name in ("before", "after"):
            errors = result[f"{name}_mm"]
            numbers = [f"{errors[key]:.4f}" for key in ("mean", "rms", "p95", "max")]
            table.add_row(name, *numbers, str(errors["count"]))
        console.print(table)


def _print_outliers(console: Console, result: dict[str, Any]) -> None:
    """Poses that are off, the largest first."""
    for outlier in result["outliers"][:MOST_OUTLIERS]:
        line = f" (line {outlier['line']})" if "line" in outlier else ""
        did = "left out" if result["outliers_left_out"] else "fitted all the same"
        if outlier["held_out"]:
            did = "held out, and not judged by" if result["outliers_left_out"] else "held out, and judged by"
        console.print(f"outlier: pose {outlier['id']}{line} is off by {outlier['size_mm']:.3f} mm, {did}")
    if (more := len(result["outliers"]) - MOST_OUTLIERS) > 0:
        console.print(f"and {more} more outliers, in result.json")


def _print_groups(console: Console, groups: list[dict[str, Any]]) -> None:
    """What each group of parameters bought."""
    if not groups:
        return
    table = Table(title="what each group of parameters buys")
    for heading in ("group", "parameters", "held-out mm", "p", "BIC", ""):
        table.add_column(heading, justify="right")
    for group in groups:
        shown = ["" if group[key] is None else f"{group[key]:{form}}" for key, form in _GROUP_FORMATS.items()]
        table.add_row(group["name"], str(group["parameters"]), *shown, _verdict_on(group))
    console.print(table)


def _verdict_on(group: dict[str, Any]) -> str:
    """Whether a group was chosen, and in short why not (or, if it was asked for, what speaks against it)."""
    reason: str = group["why_not"].removeprefix(f"--model {group['name']}: ").split(":")[0].split(";")[0]
    return ", but ".join(part for part in ("chosen" if group["chosen"] else "", reason) if part)


MOST_OUTLIERS = 5  # that are printed
_GROUP_FORMATS = {"holdout_mm": ".4f", "f_p": ".1e", "bic": ".0f"}
_JUDGED = {
    "fresh": "fresh poses, without noise",
    "holdout": "poses held out, with the instrument's noise",
    "file": "the validation file, with the instrument's noise",
    "cross-validation": "five-fold cross-validation, with the instrument's noise",
}
