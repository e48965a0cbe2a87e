"""The report of a plan: which poses, how good they are, and what accuracy they promise, on one page.

It takes in pictures that matplotlib drew, and nothing else of it.
"""

from pathlib import Path
from typing import Any

from lab.commands.design.console import candidates_line, certificate, headline, promise, tour_line
from lab.commands.design.result import plan_summary
from lab.commands.design.run import Plan
from lab.commands.provenance import how_it_was_made
from lab.formats.programs.registry import PLAN, planned_in
from lab.render.html import (
    Html,
    capital,
    figure,
    fixed,
    inline,
    paragraph,
    section,
    short,
    table,
    together,
    warnings_box,
    write_page,
)

_INDICES = {
    "o1": "O1, information per pose",
    "o2": "O2, smallest over largest σ",
    "o3": "O3, smallest σ",
    "o4": "O4, noise amplification",
    "o5": "O5, 1 / Σ 1/σ",
    "condition": "condition",
    "a": "A, Σ 1/σ²",
    "g": "G, worst predicted variance",
    "i": "I, mean predicted variance",
}


def write_plan_report(folder: Path, plan: Plan) -> None:
    """Write ``report.html`` beside the pictures ``curve.svg`` and ``poses.svg``, which it takes in."""
    seen = plan_summary(plan)
    programs = (f", and {PLAN}{language.suffix}, for the controller" for language in planned_in(seen)[0])
    files = "plan.csv, to measure" + "".join(programs)
    parts = [
        paragraph(f"{_sentence(headline(seen))} {_sentence(promise(seen))}", "lead"),
        warnings_box(seen["warnings"]),
        section("How many poses", [_picture(folder, "curve", _CURVE), _steps(seen)]),
        section("Where the poses are", [_picture(folder, "poses", _POSES), *map(paragraph, _tour(seen, files))]),
        section("How good the choice is", [paragraph(_sentence(certificate(seen))), _indices(seen)]),
        how_it_was_made("design", plan.options, plan.problem.robot.sha256),
    ]
    write_page(folder / "report.html", f"{seen['robot']}: {seen['poses']} poses to measure", parts)


_CURVE = (
    "Predicted accuracy against the number of poses (left axis, logarithmic), and the index O1 (right axis): O1 is "
    "information per pose, so it flattens while the accuracy still grows."
)
_POSES = "The targets at the poses, numbered in the order of the tour, and below where each joint stands in its range."


def _picture(folder: Path, name: str, caption: str) -> Html:
    drawing = (folder / f"{name}.svg").read_text(encoding="utf-8")
    return figure(f"{name}-figure", [inline(drawing, name, caption.split(",")[0])], caption)


def _tour(seen: dict[str, Any], files: str) -> list[str]:
    return [_sentence(tour_line(seen)), _sentence(candidates_line(seen)), f"Files: {files}."]


def _steps(seen: dict[str, Any]) -> Html:
    """The curve as a table."""
    rows = [
        [str(step["poses"]), *(short(step[key]) for key in ("rms_mm", "worst_mm", "promise_mm")), fixed(step["o1"], 2)]
        for step in seen["curve"]
    ]
    header = ["poses", "RMS, mm", "worst pose, mm", "promise, mm", "O1"]
    words = "Predicted position error on fresh poses; the promise holds for 95 % of them in 95 % of the campaigns"
    return table(header, rows, words)


def _indices(seen: dict[str, Any]) -> Html:
    """The observability indices, with what they are scaled by."""
    below = "σ: the singular values of the scaled Jacobian of all poses."
    rows = [
        [_INDICES[name], "∞" if index["value"] is None else short(index["value"]), index["scaling"]]
        for name, index in seen["indices"].items()
    ]
    return together([table(["index", "value", "scaling"], rows), paragraph(below, "note")])


def _sentence(text: str) -> str:
    return f"{capital(text)}."
