"""Document of the pose to measure next."""

from dataclasses import replace
from typing import Any

import numpy as np

from lab.core.errors import counted
from lab.core.number_text import short
from lab.core.units import MM
from lab.library.next_pose import NEXT_FILE, NextPoseResult, length_mm
from lab.library.run_folder import VIA
from lab.report.blocks import joint_cells, joint_headings
from lab.report.document import (
    NARROW,
    PAGE,
    Badge,
    Block,
    Card,
    Code,
    Document,
    Paragraph,
    Scene,
    Section,
    Table,
    Text,
    Warnings,
    guarded,
    plain,
)
from lab.report.scene import MOST_POSES

__all__ = ["next_document"]

_SHOWN = "The arm at the pose to measure next, with the target's place there and at the poses measured so far."


def _page_scene(result: NextPoseResult) -> Any:
    """The arm at the proposed pose, where there is one, then at those that were measured."""
    from lab.report.page_scene import posed_arm  # which imports MuJoCo

    problem, proposed = result.planner.problem, result.proposal.joints
    measured = result.data.joints[result.data.seen.any(axis=1)][: MOST_POSES - 1]
    names = [f"measured {row}" for row in range(1, len(measured) + 1)]
    joints = measured.reshape(-1, problem.robot.chain.size)
    if proposed is not None:
        names, joints = ["next", *names], np.concatenate([proposed[None], joints])
    return posed_arm(problem.robot.model, problem.arm, problem.values, joints, names)


def next_document(result: NextPoseResult) -> Document:
    """Build the document of the proposed pose."""
    last, name = result.proposal, result.planner.problem.robot.name
    title = f"{name}: the wanted accuracy is reached" if last.joints is None else f"{name}: measure this pose next"
    shown = "The arm at the poses measured so far." if last.joints is None else _SHOWN
    scene = Scene("next-scene", lambda: _page_scene(result), shown, shown_in=PAGE)
    seen = last.joints is not None or bool(result.data.seen.any())
    way = _way(result)
    joints = ("joint", *(plain(row[0]) for row in way.rows))
    turned = tuple(zip(way.headings[1:], *(row[1:] for row in way.rows), strict=True)) if way.rows else ()
    return Document(
        title,
        (
            _card(result),
            Paragraph(_lead(result), "lead", shown_in=NARROW),
            Warnings(result.warnings),
            replace(way, shown_in=NARROW),
            Section("The arm", (*((scene,) * seen), Paragraph(_lead(result)), Table(joints, turned)), shown_in=PAGE),
            *_progress(result),
        ),
    )


def _lead(result: NextPoseResult) -> str:
    """Describe the accuracy so far, after the next pose, and how many more poses there are, and what for."""
    last, wanted = result.proposal, result.planner.accuracy_m
    so_far = "not all parameters are determined yet" if last.accuracy_m is None else (
        f"95 % of the validation poses are predicted within {MM.text(last.accuracy_m)} in 95 % of the calibrations"
    )  # fmt: skip
    lead = f"{counted(last.measured, 'pose')} measured: {so_far}."
    if last.joints is None:
        return f"{lead} Stop measuring, and run lab identify on the file."
    if last.next_m is not None:
        lead += f" With the next pose: {MM.text(last.next_m)}."
    if wanted is None or last.remaining is None:
        return lead
    further = counted(last.remaining, "further pose")
    if last.for_validation:
        return (
            f"{lead} The wanted {MM.text(wanted)} is predicted already. {further.capitalize()} make the "
            f"{result.planner.fewest} that a cross-validation needs to show it."
        )
    return f"{lead} About {further} reach {MM.text(wanted)}."


@guarded
def _card(result: NextPoseResult) -> Card:
    """Summarise the session: whether the accuracy is reached, how good it is, and what to do now."""
    last, wanted, fewest = result.proposal, result.planner.accuracy_m, result.planner.fewest
    badge = Badge("measure on")
    if last.joints is None:
        badge = Badge("accuracy reached", "good")
    elif last.for_validation:
        badge = Badge("accurate enough, too few poses to show it", "doubtful")
    numbers = [("poses measured", str(last.measured), "")]
    if last.accuracy_m is not None:
        numbers.append(("predicted now", MM.text(last.accuracy_m), "after"))
    if wanted is not None:
        numbers.append(("wanted", MM.text(wanted, 6), ""))
    if last.joints is not None and last.remaining is not None:
        why = "to go, for the cross-validation" if last.for_validation else "to go, about"
        numbers.append((why, counted(last.remaining, "pose"), ""))
    about = (
        "The error that 95 % of the validation poses keep in 95 % of such calibrations."
        if last.accuracy_m is not None
        else "The error is predicted as soon as the poses determine all parameters. "
        f"A cross-validation needs {counted(fewest, 'pose')}."
    )
    step: Text = "Stop measuring, and run lab identify on the file."
    if last.joints is not None:
        step = (
            "Move the arm by ",
            Code(NEXT_FILE),
            ", measure there, add the row to the file, and run lab next again.",
        )
    return Card(("Session: ", badge), tuple(numbers), about, step)


def _way(result: NextPoseResult) -> Table:
    """Tabulate the way to the next pose; no rows where there is none."""
    chain, waypoints = result.planner.problem.robot.chain, result.proposal.waypoints
    if waypoints is None:
        return Table(("stop",), ())
    rows = tuple(
        ("measure" if i == len(waypoints) - 1 else VIA, *joint_cells(chain, joints))
        for i, joints in enumerate(waypoints)
        if i
    )
    return Table(("stop", *joint_headings(chain)), rows)


@guarded
def _progress(result: NextPoseResult) -> tuple[Block, ...]:
    """Tabulate the predicted errors of a session that was followed."""
    if len(result.proposals) < 2:
        return ()
    table = Table(
        ("poses measured", "predicted, mm", "after the next pose, mm", "poses to go"),
        tuple(
            (str(each.measured), *(short(length_mm(size)) if size else "" for size in (each.accuracy_m, each.next_m)),
             "" if each.remaining is None else str(each.remaining))
            for each in result.proposals
        ),
    )  # fmt: skip
    return (Section("Session so far", (table,), shown_in=PAGE),)
