"""What a person reads of a serial arm's nominal model and shape."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from lab.commands.values import limits_and_speed, printed, with_joint
from lab.render.document import Block, Bullets, Paragraph, Table

__all__ = ["serial_blocks"]

_ASKED = "a pose is met in its place, and in its rotation as near as these can"
_ORDERS = {"distal": "Rz(θ) Tz(d) Tx(a) Rx(α)", "craig": "Rx(α) Tx(a) Rz(θ) Tz(d)"}


def serial_blocks(values: Mapping[str, Any]) -> tuple[Block, ...]:
    """The Denavit-Hartenberg table with limits, the reach, and the singularities."""
    convention = values["convention"]
    solutions = "" if values["ways"] is None else f"; {values['ways']} inverse-kinematics solutions of a pose"
    return (
        Paragraph(f"{values['robot']}: Denavit-Hartenberg, {convention}, {_ORDERS[convention]}; mm and °"),
        Table(("i", "θ", "d", "a", "α", "limits", "speed per s"), _rows(values["joints"])),
        Paragraph(f"reach {printed(values['reach_mm'])} mm from axis 1 to the last frame{solutions}"),
        Paragraph(_freedoms(values["freedoms"])),
        *_singularities(values),
        *_frames(values["khalil"]),
    )


def _freedoms(values: Mapping[str, Any]) -> str:
    """Joints and degrees of freedom, what is free and what cannot be moved, in a sentence."""
    index, freedoms = values["index"], values["degrees_of_freedom"]
    said = f"mobility index {index}, {freedoms} degrees of freedom of the last frame"
    if values["redundancy"]:
        said += f": redundant by {values['redundancy']}; {', '.join(values['free'])} can move while it stands still"
    else:
        said += ": not redundant but at singularities"
    if values["planar"]:
        turns = " and turns about its normal" if freedoms > 2 else ", and its turn follows from its place"
        return f"{said}; it moves in a plane{turns}"
    lacks = [f"{count} {name}" for count, name in ((values["missing_displacements"], "of its displacements"),
                                                   (values["missing_turns"], "of its turns")) if count]  # fmt: skip
    if not lacks:
        return said if freedoms >= 6 or index >= 6 else f"{said}; {_ASKED}"
    return f"{said}; no joint makes {' and '.join(lacks)}; {_ASKED}"


def _rows(joints: list[dict[str, Any]]) -> tuple[tuple[str, ...], ...]:
    rows = []
    for i, joint in enumerate(joints):
        slides = joint["type"] == "prismatic"
        theta, d = printed(joint["theta_deg"]), printed(joint["d_mm"])
        moved = with_joint(joint["name"], joint["sign"], joint["d_mm" if slides else "theta_deg"])
        theta, d = (theta, moved) if slides else (moved, d)
        lengths = printed(joint["a_mm"]), printed(joint["alpha_deg"])
        rows.append((str(i + 1), theta, d, *lengths, *limits_and_speed(joint)))
    return tuple(rows)


def _frames(khalil: Mapping[str, Mapping[str, Any]]) -> tuple[Block, ...]:
    """Base and targets in Khalil and Kleinfinger's parameters, and what is not determined."""
    rows = tuple((name, *(printed(each[key]) for key in each if key != "note")) for name, each in khalil.items())
    notes = [f"{name}: {each['note']}".replace("-", "−") for name, each in khalil.items() if each["note"]]
    return (
        Paragraph(
            "base in the world and targets in the last frame, Khalil and Kleinfinger: "
            "Rz(γ) Tz(b) Rx(α) Tx(d) Rz(θ) Tz(r); mm and °"
        ),
        Table(("", "γ", "b", "α", "d", "θ", "r"), rows),
        *((Bullets(tuple(notes)),) if notes else ()),
    )


def _singularities(values: Mapping[str, Any]) -> tuple[Block, ...]:
    """The Jacobian's determinant, and an example of each singularity with its self-motion."""
    if values["determinant"] is None:
        return ()
    text = values["determinant"].replace("-", "−").replace("*", "·")
    lines = []
    for each in values["singularities"]:
        where = f"{each['name']}, {each['where']} = 0"
        if each["example"] is None:
            lines.append(f"{where}: not within the limits")
            continue
        parts = " or ".join(" ".join(f"{part:+.3g} {name}" for name, part in one.items()) for one in each["free"])
        at = ", ".join(f"{value:.1f}" for value in np.round(each["example"], 1) + 0.0)
        moves = (
            f"with the self-motion {parts}" if parts else "where one of these motions is lost, and nothing moves alone"
        )
        lines.append(f"{where}: e.g. at ({at}), {moves}")
    ends = "singular where a factor is zero:" if lines else "never singular."
    return (
        Paragraph(f"det J = {text} (m), of {values['determinant_of']}; {ends}"),
        Bullets(tuple(line.replace("-", "−").replace("self−motion", "self-motion") for line in lines)),
    )
