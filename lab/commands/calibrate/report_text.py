"""The sentences and tables of a run's report, from the plain values of its ``result.json`` and ``parameters.json``."""

from typing import Any

from lab.calibration.identify import ILL_CONDITIONED
from lab.calibration.observations.kind import ObservationWords
from lab.commands.calibrate.result import human_unit
from lab.render.html import Html, capital, fixed, paragraph, section, short, table, together

MOST_LISTED = 12  # rows of a table
MOST_PARTS = 5  # parameters of a direction
JUDGED = {
    "fresh": "on {count} fresh poses without noise",
    "holdout": "on {count} points held out",
    "file": "on {count} points of another file",
    "cross-validation": "by cross-validation on {count} points",
}
_STATISTICS = ("mean", "rms", "p95", "max")


def headline(result: dict[str, Any]) -> str:
    """Robot, before and after, verdict: in one line."""
    if result["after_mm"] is None:
        return f"{result['robot']}: {'bad' if result['verdict'] == 'bad' else 'identified, not judged'}"
    before, after = (short(result[f"{name}_mm"]["mean"]) for name in ("before", "after"))
    return f"{result['robot']}: {before} → {after} mm, {result['verdict']}"


def lead(result: dict[str, Any], observed: ObservationWords) -> str:
    """The same in a sentence or two."""
    targets = ""
    if observed.names_targets:
        targets = f" of target{'s' * (len(result['targets']) > 1)} {', '.join(result['targets'])}"
    begun = (
        f"From {observed.measured}{targets} measured in {result['poses']:,} poses, {result['rank']} of "
        f"{result['parameters']} parameters were identified ({result['status']} in {result['iterations']} steps)."
    )
    if result["after_mm"] is None:
        return f"{begun} How far the robot now is from where it is sent was not judged on poses it had not seen."
    judged = JUDGED[result["judged_by"]].format(count=f"{result['after_mm']['count']:,}")
    before, after = (short(result[f"{name}_mm"]["mean"]) for name in ("before", "after"))
    drawn = f"was {before} mm with the drawing's dimensions"
    return f"{begun} The mean {observed.error} {judged} {drawn}, and is {after} mm now."


def errors_table(result: dict[str, Any], observed: ObservationWords) -> Html:
    """Before and after, mm."""
    if result["after_mm"] is None:
        return paragraph("Too few poses to hold any out: the accuracy on other poses is not judged.")
    rows = []
    for name in ("before", "after"):
        numbers = result[f"{name}_mm"]
        rows.append([name, *(short(numbers[key]) for key in _STATISTICS), f"{numbers['count']:,}"])
    judged = JUDGED[result["judged_by"]].format(count=f"{result['after_mm']['count']:,}")
    header = ["", "mean", "rms", "95 %", "max", "points"]
    below = f"Before: as drawn, with {observed.placed} fitted to the same measurements. After: all parameters."
    shown = table(header, rows, f"{capital(observed.error)}, mm, {judged}", ["before", "after"])
    return together([shown, paragraph(below, "note")])


def trust(result: dict[str, Any]) -> Html:
    """Model, adequacy, noise, stiffness, the truth of a virtual arm."""
    adequacy = result["adequacy"]
    parts = [
        paragraph(f"Model: {result['model'].replace('+', ' + ')}; {adequacy}."),
        paragraph(_noise(result)),
        _groups(result["groups"]),
        _stiffness(result),
        paragraph(_truth(result)),
    ]
    return section("How far to trust it", parts)


def _noise(result: dict[str, Any]) -> str:
    """Noise, and what accuracy it leaves."""
    if result["noise_mm"] is None:
        return "The noise is not known: nothing is said of how sure the parameters are."
    turned = "" if result["noise_mrad"] is None else f" and {short(result['noise_mrad'])} mrad"
    how = "given" if result["noise_known"] else "estimated from what the fit leaves over"
    said = f"Noise of a coordinate: {short(result['noise_mm'])} mm{turned} (1σ, {how})."
    if result["predicted_mm"] is not None:
        said += f" It leaves {short(result['predicted_mm'])} mm of position error, RMS over the workspace, by the "
        said += "parameters' covariance alone."
    return said


def _groups(groups: list[dict[str, Any]]) -> Html:
    """What each group of parameters bought."""
    if not groups:
        return Html("")
    rows = [
        [
            group["name"],
            str(group["parameters"]),
            "" if group["holdout_mm"] is None else short(group["holdout_mm"]),
            "" if group["f_p"] is None else short(group["f_p"]),
            "" if group["bic"] is None else fixed(group["bic"], 0),
            _choice(group),
        ]
        for group in groups
    ]
    kinds = ["" if group["chosen"] else "quiet" for group in groups]
    header = ["group", "parameters", "held-out, mm", "p", "BIC", ""]
    return table(header, rows, "What each group of parameters bought", kinds)


def _choice(group: dict[str, Any]) -> str:
    """Whether a group was chosen, and why not (or, if it was asked for, what speaks against it)."""
    reason = group["why_not"].removeprefix(f"--model {group['name']}: ")
    return ", but ".join(part for part in ("chosen" if group["chosen"] else "", reason) if part)


def _stiffness(result: dict[str, Any]) -> Html:
    """Stiffness of the joints that bend."""
    rows = []
    for joint, value in result["stiffness_nm_per_rad"].items():
        std = result["stiffness_std_nm_per_rad"][joint]
        rows.append([joint, f"{value:,.0f}", "–" if std is None else f"± {std:,.0f}"])
    return table(["joint", "stiffness, Nm/rad", "1σ"], rows) if rows else Html("")


def _truth(result: dict[str, Any]) -> str:
    """How the estimates compare with a virtual arm's truth."""
    truth = result.get("truth")
    if truth is None or truth["max_abs_z"] is None:
        return ""
    said = (
        f"Against the truth of the virtual robot: the largest error is {truth['max_abs_z']:.2f} σ, "
        f"NEES {truth['nees_per_parameter']:.2f} a parameter (1 on average), "
        f"{100 * truth['coverage_95']:.0f} % of the 95 % intervals hold."
    )
    if truth["bad_readings"]:
        said += f" Of {truth['bad_readings']} bad readings {truth['bad_named']} are named."
    return said


def outliers_section(result: dict[str, Any]) -> Html:
    """Poses that are off."""
    off = result["outliers"]
    fate = "left out" if result["outliers_left_out"] else "fitted all the same"
    held = "not judged by" if result["outliers_left_out"] else "judged by all the same"
    filed = any("line" in each for each in off)
    rows = [
        [
            each["id"],
            *([str(each.get("line", ""))] if filed else []),
            short(each["size_mm"]),
            short(each["p"]),
            f"held out, {held}" if each["held_out"] else fate,
        ]
        for each in off
    ]
    header = ["pose", *(["line"] if filed else []), "off by, mm", "p", ""]
    return section(f"Poses that are off: {len(off)}", [_first_of(header, rows)] if rows else [])


def identifiability(result: dict[str, Any]) -> list[Html]:
    """What the arm's structure and these poses tell apart, in words and tables."""
    barely = "barely " if (result["condition"] or 0.0) > ILL_CONDITIONED else ""
    told = "all of these" if result["identifiable"] == result["rank"] else str(result["rank"])
    said = (
        f"Of {result['parameters']} parameters, {result['identifiable']} can be told apart on such a robot with such "
        f"measurements; these poses {barely}tell {told} apart"
    )
    if result["condition"] is not None:
        said += f" (condition {short(result['condition'])})"
    weak = [
        [f"1/{1 / each['singular_value']:,.0f}", _mixture(each["parts"]), f"{short(1e3 * each['moved_mm'])} µm"]
        for each in result["weak_directions"]
    ]
    pairs = [[" and ".join(each["parameters"]), fixed(each["correlation"], 3)] for each in result["correlated"]]
    none = "" if weak or pairs else "No two of them are strongly correlated, and no direction is nearly unseen."
    return [
        paragraph(f"{said}. {none}"),
        _first_of(["of the largest σ", "nearly unseen: a change of", "moves the targets by"], weak),
        _first_of(["parameters whose errors go together", "correlation"], pairs),
    ]


def _first_of(header: list[str], rows: list[list[str]]) -> Html:
    """A table of the first rows, and how many more there are; nothing for no rows."""
    more = f"and {len(rows) - MOST_LISTED} more, in result.json" if len(rows) > MOST_LISTED else ""
    return together([table(header, rows[:MOST_LISTED]), paragraph(more, "note")]) if rows else Html("")


def _mixture(parts: dict[str, float]) -> str:
    """A direction in words, in what a person reads."""
    shown = []
    for name, part in list(parts.items())[:MOST_PARTS]:
        scale, unit, _ = human_unit(name)
        shown.append(f"{short(scale * part)} {unit} of {name}")
    more = len(parts) - MOST_PARTS
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")
