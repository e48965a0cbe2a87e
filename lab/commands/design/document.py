"""What a person reads of a plan: the predicted error, the tour, and how good the choice of poses is."""

from typing import Any

from lab.commands.design.day import MeasuringDayLength
from lab.commands.design.figures import curve_pictures, pose_pictures
from lab.commands.design.result import DesignResult
from lab.commands.provenance import provenance_section
from lab.formats.programs.protocol import PAUSE_S
from lab.formats.programs.registry import PLAN, language_of, plan_or_refusal, refusal
from lab.render.document import (
    NARROW,
    PAGE,
    TERMINAL,
    Block,
    Document,
    Figure,
    Paragraph,
    Section,
    Table,
    Warnings,
)
from lab.render.format import fixed, sentence, short

__all__ = ["design_document"]

_INDICES = {
    "o1": "O1, information per pose",
    "o2": "O2, smallest over largest σ",
    "o3": "O3, smallest σ",
    "o4": "O4, noise amplification",
    "o5": "O5, 1 / Σ 1/σ",
    "condition": "condition number",
    "a": "A, Σ 1/σ²",
    "g": "G, worst predicted variance",
    "i": "I, mean predicted variance",
}
_CURVE = "Predicted error against the number of poses, the RMS over simulated calibrations. The line is this plan."
_O1 = " Beside it the index O1, which is information per pose: it flattens while the error still falls."
_POSES = (
    "The targets at the poses, numbered in the order of the tour from first (dark) to last (light), and below the "
    "position of each joint in its range."
)
_OF = {
    "designs": "Each number is of a design of so many poses.",
    "continuous design": "The numbers are of the certificate's continuous design, which shares any number of poses out "
    "among the candidates. Designs of whole poses are worse, near the fewest by more than twice; --curve designs each.",
}
_BOUND = "With 95 % confidence, 95 % of the validation poses have an error below the 95 %/95 % tolerance bound."


def design_document(result: DesignResult) -> Document:
    """The predicted error, the tour, the certificate and the indices of the choice."""
    values = result.to_dict()
    return Document(
        f"{values['robot']}: {values['poses']} poses to measure",
        (
            Paragraph(f"{_chosen(values)} {_predicted(values)}", "lead"),
            Warnings(result.warnings),
            Section(
                "Number of poses",
                (
                    Figure("curve-figure", curve_pictures(result), _CURVE + _O1 * result.options.curve),
                    _steps(values),
                    Paragraph(f"{_BOUND} {_OF[values['curve_of']]}", "note"),
                ),
            ),
            Section(
                "Poses and tour",
                (
                    Figure("poses-figure", pose_pictures(result), _POSES),
                    Paragraph(_tour(result)),
                    Paragraph(MeasuringDayLength.of(result.tour).words),
                    Paragraph(_candidates(values)),
                    *_reflector(values),
                    *_stations(values),
                    *_files(result),
                ),
            ),
            Section("Quality of the choice", (Paragraph(_certificate(values)), *_indices(values))),
            provenance_section("design", result.options, result.problem.robot.sha256),
        ),
    )


def _chosen(values: dict[str, Any]) -> str:
    """What was chosen, for what."""
    already = f", added to {values['measured_already']} measured already" if values["measured_already"] else ""
    return (
        f"{values['poses']} poses{already}, targets {', '.join(values['targets'])}, {values['instrument']}: "
        f"{values['parameters']} parameters, criterion {values['criterion']}."
    )


def _predicted(values: dict[str, Any]) -> str:
    predicted = values["predicted_mm"]
    return (
        f"The predicted error on validation poses is {predicted['rms']:.4f} mm RMS over all poses and "
        f"{predicted['max']:.4f} mm RMS at the worst pose; its 95 %/95 % tolerance bound is "
        f"{values['promise_mm']:.4f} mm. Only the instrument's noise is counted, and the robot is taken to be rigid."
    )


def _steps(values: dict[str, Any]) -> Table:
    """The curve as a table, with O1 where each number was designed: else it is the same for any."""
    designed = values["curve_of"] == "designs"
    rows = tuple(
        (
            str(step["poses"]),
            *(short(step[key]) for key in ("rms_mm", "worst_mm", "promise_mm")),
            *((fixed(step["o1"], 2),) if designed else ()),
        )
        for step in values["curve"]
    )
    columns = ("poses", "RMS, mm", "worst pose, mm", "95 %/95 % bound, mm", *(("O1",) if designed else ()))
    return Table(columns, rows, "Predicted error on validation poses")


def _tour(result: DesignResult) -> str:
    """How long the day is."""
    tour = result.tour
    via = f", {result.tour.via} of them by way of poses that are only passed" if result.tour.via else ""
    chain, controller = result.problem.robot.chain, result.options.controller
    language = None if refusal(chain, controller) else language_of(chain, controller)
    moving = f" {PLAN}{language.suffix} moves at {language.speed}, which takes longer." if language else ""
    return (
        f"The tour has {len(tour.stops) - 1} moves{via}. It takes {float(tour.seconds):.1f} s at full speed and "
        f"acceleration, home to home, and {PAUSE_S} s of waiting at each pose.{moving} {_checked(result)}"
    )


def _checked(result: DesignResult) -> str:
    """What was checked for collisions."""
    if result.options.no_check:
        return "Nothing was checked for collisions."
    options = result.options
    return (
        "Every stop and every move, each in a straight line of all joints, was checked for collisions with the arm "
        "itself and with the surroundings that the robot's model knows, reflectors and nests included. From the "
        f"surroundings they keep {options.clearance_mm:g} mm where no obstacle states another clearance, and links "
        f"that are not neighbours {options.self_clearance_mm:g} mm, or what they have at home."
    )


def _candidates(values: dict[str, Any]) -> str:
    """How many poses were examined, and why the others cannot be measured."""
    found, lost = values["candidates"], values["candidates"]["rejected"]
    singular = f"{lost['singularity']:,} near a parallel singularity, " if lost["singularity"] else ""
    return (
        f"{found['feasible']:,} feasible candidates of {found['drawn']:,} drawn; rejected: {lost['limits']:,} near a "
        f"joint limit, {singular}{lost['collision']:,} in collision, {lost['visibility']:,} not visible to the tracker."
    )


def _reflector(values: dict[str, Any]) -> tuple[Block, ...]:
    """How near the stops come to the largest angle that the reflectors take."""
    found = values["reflector"]
    if found is None:
        return ()
    return (
        Paragraph(
            f"The reflector takes beams up to {found['acceptance_deg']:.0f}° off its axis. At these poses they are up "
            f"to {found['largest_deg']:.0f}° off; {found['near']} of {values['poses']} poses are within "
            f"{found['near_deg']:.0f}° of the limit."
        ),
    )


def _stations(values: dict[str, Any]) -> tuple[Block, ...]:
    """Which of several stations measures how many poses."""
    stations = values["stations"]
    if not stations:
        return ()
    listed = ", then ".join(f"{each['poses']} from {each['name']}" for each in stations if each["poses"])
    rows = ((each["name"], str(each["poses"]), ", ".join(f"{x:.0f}" for x in each["head_mm"])) for each in stations)
    return (
        Paragraph(
            f"Each pose is measured from the station that sees it best: {listed}. Between two stations the arm waits "
            "at home until the instrument has been moved. Every point stays in the frame of its own station: where the "
            "stations are is identified with the robot."
        ),
        Table(("station", "poses", "head, mm, in the robot's frame"), tuple(rows)),
    )


def _files(result: DesignResult) -> tuple[Block, ...]:
    """The files to measure with, and why there is none for a controller."""
    chain = result.problem.robot.chain
    why = refusal(chain, result.options.controller)
    files = plan_or_refusal(chain, result.options.controller, result.problem.robot.model.stations).values()
    programs = "".join(f", {file} for the controller" for file in files if file.startswith((f"{PLAN}.", f"{PLAN}_")))
    return (
        Paragraph(f"Files: plan.csv with every stop, to measure or via{programs}.", shown_in=PAGE | TERMINAL),
        *((Paragraph(sentence(why), shown_in=PAGE | TERMINAL),) if why else ()),
    )


def _certificate(values: dict[str, Any]) -> str:
    """How far from the best possible."""
    return (
        f"The certified D-efficiency is {values['d_efficiency']:.3f}, against {values['pool']['what']} "
        f"(gap of the bound {100 * values['bound_gap']:.2f} %)."
    )


def _indices(values: dict[str, Any]) -> tuple[Block, ...]:
    """The observability indices, with what they are scaled by; in one line where there is little room."""
    found = values["indices"]
    line = ", ".join(
        f"{_INDICES[name].split(',')[0]} {_value(found[name])}" for name in ("o1", "o2", "o3", "o4", "o5", "condition")
    )
    rows = tuple((_INDICES[name], _value(index), index["scaling"]) for name, index in found.items())
    return (
        Paragraph(f"{line} ({found['o1']['scaling']}).", shown_in=NARROW),
        Table(("index", "value", "scaling"), rows, shown_in=PAGE),
        Paragraph("σ: the singular values of the scaled Jacobian of all poses.", "note", shown_in=PAGE),
    )


def _value(index: dict[str, Any]) -> str:
    return "∞" if index["value"] is None else short(index["value"])
