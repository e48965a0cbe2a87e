"""What a recording says in words, in mm and degrees: a summary that explains the picture, and the parameters."""

from typing import Any

from lab.calibration.identify import Identification
from lab.commands.calibrate.result import human_unit, parameters, summary
from lab.commands.calibrate.run import CalibrationResult
from lab.commands.calibrate.scene import Scene
from lab.core import se3
from lab.core.se3 import Array
from lab.render.format import format_magnification
from lab.render.markdown import to_inline
from lab.render.scene import legs_legend

MOST_NAMED = 5  # outliers in the summary
_JUDGED = {
    "fresh": "on {count} fresh poses, without noise",
    "holdout": "on {count} points held out",
    "file": "on {count} points of another file",
    "cross-validation": "by cross-validation, {count} points",
}


def wording(outcome: CalibrationResult, shown: Scene) -> str:
    """The summary, in markdown: what was done, how good it is, and what the picture magnifies."""
    result = summary(outcome)
    parts = [
        f"# {result['robot']}: {_headline(result)}",
        _errors(result),
        _done(result),
        _trust(result),
        _legend(outcome, shown),
    ]
    if result["warnings"]:
        parts.append("\n".join(["## Warnings", *(f"- {warning}" for warning in result["warnings"])]))
    return "\n\n".join(parts) + "\n"


def parameter_table(outcome: CalibrationResult) -> str:
    """Every parameter, in markdown: before, after, how far it moved and how sure it is."""
    lines = [
        "Lengths in mm, angles in degrees. *Before*: as drawn, base and tool fitted. ± is one standard deviation.",
        "",
        "| parameter | | before | identified | change | ± | status |",
        "|:--|:--|--:|--:|--:|--:|:--|",
    ]
    for row, moved in zip(parameters(outcome), _changes(outcome.identification), strict=True):
        scale, unit, digits = human_unit(row["name"], row["unit"])
        cells = [f"{scale * row['nominal']:.{digits}f}", "", "", "", _held(row)]
        if row["status"] == "identified":
            std = "" if row["std"] is None else f"{scale * row['std']:#.2g}"
            cells[1:] = [f"**{scale * row['estimate']:.{digits}f}**", f"{scale * moved:+.{digits}f}", std, "identified"]
        lines.append(f"| {row['name']} | {unit} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _changes(identification: Identification) -> Array:
    """Identified less before ``(p,)`` in m and rad; of the base's rotation, log(R_before' R_identified)."""
    names, before, after = identification.model.names, identification.nominal_aligned, identification.values
    turning = [names.index(f"base.{axis}") for axis in ("rx", "ry", "rz")]
    changes = after - before
    changes[turning] = se3.log(se3.exp(before[turning]).T @ se3.exp(after[turning]))
    return changes


def _held(row: dict[str, Any]) -> str:
    into = sorted(row["aliases"], key=lambda name: -abs(row["aliases"][name]))[:2]
    return f"{row['status']}; acts as {', '.join(into)}" if into else str(row["status"])


def _headline(result: dict[str, Any]) -> str:
    if result["after_mm"] is None:
        return "not judged"
    return f"{_mm(result['before_mm']['mean'])} → {_mm(result['after_mm']['mean'])} mm, {result['verdict']}"


def _errors(result: dict[str, Any]) -> str:
    """Before and after as a table."""
    if result["after_mm"] is None:
        return "Too few poses to hold any out: the accuracy on fresh poses is not judged."
    judged = _JUDGED[result["judged_by"]].format(count=f"{result['after_mm']['count']:,}")
    rows = [f"| error, mm ({judged}) | mean | rms | 95 % | max |", "|:--|--:|--:|--:|--:|"]
    for name in ("before", "after"):
        cells = " | ".join(_mm(result[f"{name}_mm"][key]) for key in ("mean", "rms", "p95", "max"))
        rows.append(f"| **{name}** | {cells} |")
    return "\n".join(rows) + (f"\n\n{result['reason']}" if result["reason"] else "")


def _done(result: dict[str, Any]) -> str:
    """What was measured and how the fit went, in a sentence."""
    targets = f"target{'s' * (len(result['targets']) > 1)} {', '.join(result['targets'])}"
    parts = [f"{result['poses']} poses, {targets}"]
    if result["noise_mm"] is not None:
        how = "assumed" if result["noise_known"] else "estimated"
        parts.append(f"noise {result['noise_mm']:.2g} mm a coordinate ({how})")
    parts.append(f"{result['identifiable']} of {result['parameters']} parameters identifiable")
    if result["condition"] is not None:
        parts.append(f"condition {result['condition']:,.0f}")
    return "; ".join([*parts, f"{result['status']} in {result['iterations']} steps"]) + "."


def _trust(result: dict[str, Any]) -> str:
    """What each group of parameters bought, whether the model is adequate, and which poses are off."""
    parts = [f"Model: {result['model'].replace('+', ' + ')}; {result['adequacy']}."]
    selected = [group for group in result["groups"] if group["chosen"] and group["holdout_mm"] is not None]
    if len(selected) > 1:
        steps = " → ".join(f"{group['name']} {_mm(group['holdout_mm'])}" for group in selected)
        parts.append(f"Held-out error, mm, group by group: {steps}.")
    if result["stiffness_nm_per_rad"]:
        found = (f"{joint} {value:,.0f}" for joint, value in result["stiffness_nm_per_rad"].items())
        parts.append(f"Stiffness, Nm/rad: {', '.join(found)}.")
    if off := result["outliers"]:
        did = "left out" if result["outliers_left_out"] else "fitted all the same"
        named = ", ".join(f"{each['id']} ({_mm(each['size_mm'])} mm)" for each in off[:MOST_NAMED])
        parts.append(f"{len(off)} poses are off, {did}: {named}{', …' if len(off) > MOST_NAMED else ''}.")
    return "\n\n".join(parts)


def _legend(outcome: CalibrationResult, shown: Scene) -> str:
    """What the colours mean and by how much each is magnified."""
    known = outcome.identification.sigma_known
    unit = "their effects in standard deviations" if known else "all points weigh alike"
    before, after = format_magnification(shown.factor_before), format_magnification(shown.factor_after)
    lines = [
        "## What is shown",
        "- **yellow**: measured points. Predicted ones: **red** before, **green** after; come close to see them part",
        f"- **arrows**: measured less predicted; **red** before, {before}; **green** after, {after}",
        "- **blue**, mapping ellipsoid: onto what J maps the unit ball of scaled parameters "
        f"({unit}), {format_magnification(shown.mapping.factor)}",
    ]
    if shown.uncertainty is not None:
        factor = format_magnification(shown.uncertainty.factor)
        lines.append(f"- **violet**, uncertainty ellipsoid: predicted 1σ of the position after calibration, {factor}")
    lines += ["- " + to_inline(legs_legend(shown.legs))] if shown.legs.measured else []
    if shown.off:
        lines.append("- **magenta**: poses that are off, joined to where they should be")
    if len(shown.rows) < len(outcome.fitted):
        drawn = f"{len(shown.rows)} of {len(outcome.fitted)} poses"
        lines.append(f"- {drawn} are drawn, evenly spaced; the plots have them all")
    return "\n".join(lines)


def _mm(value: float) -> str:
    """Three digits that count."""
    return f"{value:#.3g}".rstrip(".") if value >= 1e-4 else f"{value:.1e}"
