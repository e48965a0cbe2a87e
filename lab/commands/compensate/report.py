"""The report of corrected targets, one page: what became of them, how far each was moved, which are not reached.

It draws with matplotlib, which is slow to import: import this module where a report is written.
"""

from pathlib import Path
from typing import Any

import numpy as np

from lab.commands.calibrate.error_map import ErrorMap, thinned
from lab.commands.calibrate.figures import PROMISED, Spread, histograms, size_maps
from lab.commands.compensate.options import CompensateOptions
from lab.commands.compensate.result import correction_summary
from lab.commands.compensate.run import CompensationResult
from lab.commands.provenance import how_it_was_made
from lab.core.se3 import Array
from lab.render.html import (
    AFTER,
    Html,
    badge,
    figure,
    fixed,
    paragraph,
    section,
    short,
    table,
    together,
    warnings_box,
    write_page,
)
from lab.render.svg import cube

_NEAR = 2.0  # times half the edge of the targets' cube: what is farther off is not drawn
MOST_LISTED = 100  # targets, in each table


def write_correction_report(path: Path, done: CompensationResult, options: CompensateOptions) -> None:
    """Write the report of ``lab compensate``."""
    result = correction_summary(done)
    title = f"{result['robot']}: {result['converged']} of {result['targets']} targets corrected"
    failed = len(result["failed"])
    word = badge(f"{failed} not reached", "bad") if failed else badge("all reached", "good")
    parts = [
        paragraph(_lead(result), "lead"),
        paragraph(word),
        warnings_box(result["warnings"]),
        section("What became of the targets", [_totals(result), _failed(result), _near(result)]),
        section("How far they were moved", [_spread(done), _where(done)]),
        section("Every target", [_targets(done)]),
        how_it_was_made("compensate", options, done.run.robot.sha256),
    ]
    write_page(path, title, parts)


def _lead(result: dict[str, Any]) -> str:
    begun = f"{result['targets']} targets of {result['tool']} for the arm that {result['run']} calibrated"
    if not result["converged"]:
        return f"{begun}: none of them is reached."
    moved, expected = result["correction_mm"], result["predicted_mm"]["mean"]
    said = f"{begun} were moved by {short(moved['mean'])} mm on average, {short(moved['max'])} mm at most"
    if expected is not None:
        said += f"; the error to expect there is {short(expected)} mm"
    judged = result["judged_mm"]
    return f"{said}." if judged is None else f"{said} (at poses that the run had not seen it was {short(judged)} mm)."


def _totals(result: dict[str, Any]) -> Html:
    rows = [
        ["moved by, mm", *(short(result["correction_mm"][key]) for key in ("mean", "max"))],
        ["expected error, mm", *(short(result["predicted_mm"][key]) for key in ("mean", "max"))],
    ]
    apart = result["schemes_apart_mm"]
    said = "" if apart is None else f"The three ways to compute them end within {short(apart)} mm of each other."
    model = f"Model: {result['model'].replace('+', ' + ')}."
    return together([table(["", "mean", "largest"], rows), paragraph(f"{said} {model}", "note")])


def _failed(result: dict[str, Any]) -> Html:
    rows = [[each["id"], each["reason"]] for each in result["failed"][:MOST_LISTED]]
    return _listed(["target", "why it is not reached"], rows, len(result["failed"]))


def _near(result: dict[str, Any]) -> Html:
    near = result["near_singular"]
    rows = [[each["id"], _distance(each), each["joint"]] for each in near[:MOST_LISTED]]
    return _listed(["target", "near a singularity, by", "of joint"], rows, len(near))


def _distance(near: dict[str, Any]) -> str:
    """To a singularity, as the joint that leads there counts it."""
    return short(near["distance_deg"], "°") if "distance_deg" in near else short(near["distance_mm"], "mm")


def _listed(header: list[str], rows: list[list[str]], count: int) -> Html:
    """A table, and how many more there are; nothing for no rows."""
    if not rows:
        return Html("")
    more = f"and {count - len(rows)} more, in the files" if count > len(rows) else ""
    return together([table(header, rows), paragraph(more, "note")])


def _spread(done: CompensationResult) -> Html:
    moved, expected = (_reached(done, lengths) for lengths in (done.correction_m, done.predicted_m))
    if not len(moved):
        return Html("")
    spreads = [Spread(moved, PROMISED, ("moved by: mean", float(moved.mean())))]
    if len(expected):
        spreads.append(Spread(expected, AFTER, ("expected error: mean", float(expected.mean()))))
    caption = (
        "How far the targets are moved (blue): without this the arm would miss them by about as much. Green: the error "
        "to expect now."
    )
    return figure("moved-figure", [histograms("moved", spreads, "length")], caption)


def _reached(done: CompensationResult, lengths: Array) -> Array:
    reached = lengths[done.found.converged]
    return np.asarray(reached[np.isfinite(reached)])


def _where(done: CompensationResult) -> Html:
    reached = np.flatnonzero(done.found.converged)
    if not len(reached):
        return Html("")
    rows = reached[thinned(done.correction_m[reached])]
    off = done.targets.positions[~done.found.converged]
    middle, half = cube([done.targets.positions[reached]])
    near = (np.abs(off - middle) < _NEAR * half).all(axis=1)
    size, frame = "how far a target is moved", "targets"
    places = ErrorMap(done.targets.positions[rows], done.correction_m[rows], off[near], "", size, "not reached", frame)
    caption = "The targets in the frame of their file. The darker, the farther it is moved."
    if beyond := int((~near).sum()):
        caption += f" Not reached and too far off to be drawn: {beyond}."
    return figure("where", size_maps(places), caption)


def _targets(done: CompensationResult) -> Html:
    chain, found = done.run.robot.chain, done.found
    moved = 1e3 * (found.positions - done.targets.positions)
    units = ["mm" if slides else "°" for slides in chain.prismatic]
    scales = np.where(chain.prismatic, 1e3, 180 / np.pi)
    rows = [
        [
            done.targets.ids[i],
            *(fixed(value, 3) for value in scales * found.joints[i]),
            *(fixed(value, 3, signed=True) for value in moved[i]),
        ]
        for i in np.flatnonzero(found.converged)[:MOST_LISTED]
    ]
    joints = [f"{name}, {unit}" for name, unit in zip(chain.joint_names, units, strict=True)]
    header = ["target", *joints, *(f"Δ{axis}, mm" for axis in "xyz")]
    words = "Readings that bring the calibrated arm there, and how far the corrected target is from the one asked for."
    listed = _listed(header, rows, int(found.converged.sum()))
    return together([paragraph(words, "note"), listed]) if rows else Html("")
