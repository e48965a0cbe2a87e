"""Document of a compensation: the corrected targets, their corrections, and the targets that are not reached."""

from dataclasses import replace

import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.number_text import capital, fixed, short
from lab.core.se3 import Array
from lab.core.units import MM
from lab.formats.programs.languages import path_file, refusal
from lab.library.compensation_result import CompensationResult
from lab.library.corrected_program import stated_positions_note
from lab.library.run_folder import VIA
from lab.prediction.ellipsoids import ellipsoids
from lab.report import document as doc
from lab.report.blocks import joint_cells, joint_headings
from lab.report.page_scene import ArmScene, Arrows, posed_arm
from lab.report.plots import Spread, histograms
from lab.report.scene import drawn_rows, error_factor, magnified, moved, reach_of
from lab.report.style import BEFORE, rgb

__all__ = ["compensation_document", "corrections_picture", "page_scene"]

_SCENE = (
    "The arm at the corrected targets. Orange arrows lead from each target to where the arm goes without correction; "
    "ellipsoids show the error to expect with it. The darker a point, the larger that error."
)
_SHAPED = 4  # targets: fewer are brought onto each other by a rigid motion, whatever their errors are, or nearly
_MOST_LISTED = 100  # targets, in each table


def compensation_document(result: CompensationResult) -> doc.Document:
    """The totals, the targets that are not reached and why, how far the others were moved, and every target."""
    lost = len(result.failed)
    failed = result.failed if result.program is None else ()  # those of a program are listed by line
    count = f"{len(result.reached):,} of {len(result.targets):,}"
    verdict = doc.Badge(f"{lost:,} not reached" if lost else "all reached", result.verdict)
    standing = f" ({'doubtful; ' if result.reasons else ''}the run is {result.run.result.description})"
    scene = (doc.Scene("targets-scene", lambda: page_scene(result), _SCENE),) * bool(len(result.reached))
    return doc.Document(
        f"{result.run.called}: {count} targets of {result.targets.tool} corrected",
        (
            _card(result, ("Targets: ", verdict, standing)),
            doc.Paragraph((verdict, standing), shown_in=doc.NARROW),
            doc.Bullets(tuple(map(capital, result.reasons))),
            doc.Paragraph(_lead(result), "lead", shown_in=doc.NARROW),
            doc.Warnings(result.warnings),
            doc.Section(
                "Results of the targets",
                (
                    *scene,
                    doc.Paragraph(_lead(result), shown_in=doc.PAGE),
                    *_totals(result),
                    doc.Table(("target", "why it is not reached"), failed, most_rows=_MOST_LISTED),
                    doc.Table(
                        ("target", "reached by another IK solution: reason against the nearest one"),
                        result.passed_over,
                        most_rows=_MOST_LISTED,
                    ),
                    _near(result),
                    _extrapolated(result),
                    *_moves(result),
                ),
            ),
            *_program(result),
            doc.Section("Every target", _every_target(result), shown_in=doc.PAGE),
        ),
    )


@doc.guarded
def _card(result: CompensationResult, verdict: doc.Text) -> doc.Card:
    """Summarise the correction: targets reached, errors without and with it, and the next step."""
    reached, numbers = result.reached, list[tuple[str, str, str]]()
    if len(reached):
        before = float(MM.of(np.linalg.norm(result.uncorrected_errors[reached], axis=1).mean()))
        after, _ = result.mean_and_max_mm(result.predicted_m)
        numbers.append(("error without correction", short(before, "mm"), "before"))
        if after is not None:
            numbers.append(("expected with it", short(after, "mm"), "after"))
            if before > after > 0:
                numbers.append(("smaller by a factor of", short(before / after), ""))
    about = (
        "Means over the targets that are reached, by the identified model: where the arm goes with the nominal joint "
        "positions, and the error to expect with the corrected ones (1σ)."
        if len(reached)
        else "The arm reaches none of the targets."
    )
    return doc.Card(verdict, tuple(numbers), about, _next(result), _histograms(result))


def _next(result: CompensationResult) -> doc.Text:
    """Return what to do after a correction."""
    if len(result.far_away) == len(result.failed) > 0:
        return (
            "Check the frame of the targets that are out of reach, or move them (see the warning); then correct again."
        )
    if result.failed:
        (name, reason), *others = result.failed
        more = f", and {len(others)} more," if others else ""
        return f"Move or leave out target {name}{more} ({reason}); then correct again."
    if result.reasons:
        return "Mend the first reason below; then correct again."
    file = path_file(result.run.robot.chain, result.options.controller)
    if result.program is not None:
        file = result.program.name
    elif refusal(result.run.robot.chain, result.options.controller, len(result.targets)) is not None:
        file = None
    steps = "Bring the arm to the joint positions of joints.csv" if file is None else f"Run {file}"
    return f"{steps}, slowly at first; then measure one target to confirm the error."


def page_scene(result: CompensationResult) -> ArmScene:
    """The arm at the corrected targets: errors without the correction as arrows, expected ones as ellipsoids."""
    estimate, reached = result.run.estimate, result.reached
    rows = reached[drawn_rows(len(reached))]
    arm, values = estimate.geometry
    aimed = np.full(len(rows), result.target) if result.points is None else result.points[rows]
    names = [result.targets.ids[i] for i in rows]
    posed = posed_arm(result.run.robot.model, arm, values, result.found.joints[rows], names)
    T = result.run.robot.model.T_world_frame0 @ se3.inverse(arm.T_tracker_frame0(values))
    points, vectors = moved(T, result.wanted.positions[rows]), result.uncorrected_errors[rows] @ T[:3, :3].T
    reach = reach_of(result.run.robot.model.T_world_frame0, points, posed.legs)
    lengths = np.linalg.norm(vectors, axis=1)
    factor = error_factor(lengths, reach)
    covariance = estimate.predict(result.arm_inputs[rows], aimed).covariance[:, 0]
    known = bool(np.isfinite(covariance).all()) and covariance.any()
    return replace(
        posed,
        points=points,
        arrows=(Arrows("without correction", vectors, factor, rgb(BEFORE)),),
        columns={"without correction": lengths, "expected with it": result.predicted_m[rows]},
        ellipsoids=magnified(ellipsoids(covariance), points, T, reach) if known else None,
        ellipsoid_text="expected error with it (1σ half-axes)",
        kind="target",
        all_text="all targets",
    )


def corrections_picture(result: CompensationResult) -> doc.Picture:
    """Draw histograms of the corrections and of the expected errors.

    Raises:
        LabError: no target is reached.
    """
    if not len(result.reached):
        raise LabError("no target is reached: there is nothing to draw; see failed for the reasons")
    moved, expected = (_finite(result, lengths) for lengths in (result.correction_m, result.predicted_m))
    spreads = [Spread.before(moved, ("moved by: mean", float(moved.mean())))]
    if len(expected):
        mark = ("expected error: mean", float(expected.mean()))
        spreads.append(Spread.after(expected, mark))
    return histograms("moved", spreads, "length", result.run.result.gate_mm)


def _lead(result: CompensationResult) -> str:
    targets = f"{len(result.targets):,} targets for the arm that {result.run.folder} calibrated"
    if not len(result.reached):
        return f"{targets}: none of them is within reach."
    if result.failed:
        targets = f"{len(result.reached):,} of {targets}"
    mean, largest = result.mean_and_max_mm(result.correction_m)
    if result.expected is not None:
        in_base = short(result.mean_and_max_mm(result.expected.base_95_m)[1])
        text = (
            f"{targets} were moved by {short(mean)} mm on average, {short(largest)} mm at most. 95 % of the errors "
            f"to expect in the robot's base are below {in_base} mm, including the error of the first link, which all "
            "targets share"
        )
        if len(result.reached) < _SHAPED:
            return f"{text}."
        return (
            f"{text}, relative to each other below {short(result.mean_and_max_mm(result.expected.shape_95_m)[1])} mm."
        )
    expected, _ = result.mean_and_max_mm(result.predicted_m)
    text = f"{targets} were moved by {short(mean)} mm on average, {short(largest)} mm at most"
    if expected is not None:
        text += f"; the error to expect there is {short(expected)} mm"
    after = result.run.result.after_mm
    return text + ("." if after is None else f" (at the run's validation poses it was {short(after['mean'])} mm).")


@doc.guarded
def _totals(result: CompensationResult) -> tuple[doc.Block, ...]:
    expected = [("expected error, mm", result.predicted_m)]
    if result.expected is not None:
        expected = [
            ("expected error in the robot's base (95 %), mm", result.expected.base_95_m),
            ("part due to the flange (95 %), mm", result.expected.flange_95_m),
            ("expected error relative to each other (95 %), mm", result.expected.shape_95_m),
        ][: None if len(result.reached) >= _SHAPED else 2]
    rows = tuple(
        (name, *map(short, result.mean_and_max_mm(lengths)))
        for name, lengths in [("moved by, mm", result.correction_m), *expected]
    )
    _, apart = result.mean_and_max_mm(result.found.scheme_disagreement_m)
    schemes = "" if apart is None else f"The three correction schemes agree within {short(apart)} mm. "
    note = doc.Paragraph(f"{schemes}Model: {result.model.replace('+', ' + ')}.", "note")
    return doc.Table(("", "mean", "largest"), rows), note


@doc.guarded
def _moves(result: CompensationResult) -> tuple[doc.Block, ...]:
    if not result.checked or not len(result.reached):
        return ()
    if result.program is not None:
        return (
            doc.Paragraph(
                f"The {len(result.reached)} corrected targets and the moves from each to the next one in the order "
                "of the text, regardless of its loops and branches, were checked for collisions with the arm itself "
                "and with the surroundings in the robot's model."
            ),
        )
    passed = sum(name.startswith(VIA) for name in result.waypoints.names if name not in result.targets.ids)
    text = (
        f"The {len(result.reached)} corrected targets and the {len(result.waypoints.joints) - 1} moves from home "
        "through all of them and back, each in a straight line of all joints, were checked for collisions with the "
        "arm itself and with the surroundings in the robot's model."
    )
    return (doc.Paragraph(text + (f" {passed} waypoints only lead around obstacles." if passed else "")),)


@doc.guarded
def _program(result: CompensationResult) -> tuple[doc.Section, ...]:
    if (program := result.program) is None:
        return ()
    text = (
        f"{program.name} in the run's folder is the {program.language} program with the numbers of "
        f"{len(result.reached)} targets corrected, and nothing else changed."
    )
    in_base = (
        "The base is that of the calibrated arm, by the nominal first link. No measurement shows that link. Its "
        "tolerances may displace all targets together, with or without the correction; relative positions are not "
        "affected."
    )
    tools = doc.Bullets(tuple(capital(each.description) + "." for each in result.tools))
    lines = tuple((str(each.line), each.reason) for each in program.uncorrected)
    paths = tuple((str(line), text) for line, text in program.touching_paths)
    return (
        doc.Section(
            "The program",
            (
                doc.Paragraph(text),
                tools,
                doc.Paragraph(() if result.reference is None else stated_positions_note(result.reference)),
                doc.Paragraph(in_base),
                doc.Table(("line", "not corrected, or to be checked"), lines, most_rows=_MOST_LISTED),
                doc.Table(("line", "paths that are not free of collisions"), paths, most_rows=_MOST_LISTED),
            ),
        ),
    )


def _near(result: CompensationResult) -> doc.Table:
    close = result.near_singular
    rows = tuple((each.id, short(each.unit.of(each.distance), each.unit.name), each.joint) for each in close)
    return doc.Table(("target", "within 1° of a singularity, by", "of joint"), rows, most_rows=_MOST_LISTED)


def _extrapolated(result: CompensationResult) -> doc.Table:
    rows = tuple(
        (result.targets.ids[i], short(MM.of(float(result.predicted_m[i])))) for i in np.flatnonzero(result.extrapolated)
    )
    return doc.Table(
        ("target", "extrapolated: not covered by measured poses; expected error, mm"), rows, most_rows=_MOST_LISTED
    )


def _histograms(result: CompensationResult) -> tuple[doc.Figure, ...]:
    if not len(result.reached):
        return ()
    caption = (
        "How far each target is moved (orange), which is about its error without correction, and the error to expect "
        "with it (blue). Dashed: the means."
    )
    return (doc.Figure("moved-figure", (corrections_picture(result),), caption),)


def _finite(result: CompensationResult, lengths: Array) -> Array:
    lengths = lengths[result.reached]
    return np.asarray(lengths[np.isfinite(lengths)])


@doc.guarded
def _every_target(result: CompensationResult) -> tuple[doc.Block, ...]:
    chain, found = result.run.robot.chain, result.found
    moved = MM.of(found.positions - result.targets.positions)
    rows = tuple(
        (
            result.targets.ids[i],
            *joint_cells(chain, found.joints[i]),
            *(fixed(value, 3, signed=True) for value in moved[i]),
        )
        for i in result.reached[:_MOST_LISTED]
    )
    header = ("target", *joint_headings(chain), *(f"Δ{axis}, mm" for axis in "xyz"))
    note = (
        "Joint positions that bring the calibrated arm there, and the distance from the wanted to the corrected target."
    )
    table = doc.Table(header, rows, most_rows=_MOST_LISTED, rest_in="joints.csv", count=len(result.reached))
    return (doc.Paragraph(note, "note"), table) if rows else ()
