"""The nominal model and the shape of a serial arm, as plain values."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lab.commands.result import joint_kind, joint_limits, limits_and_speed, printed, tidy, with_joint
from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.kinematics.closed.mobility import mobility_of
from lab.kinematics.differential import rates
from lab.kinematics.inverse.closed_form import Factor, closed_form_of
from lab.kinematics.reach import reach_from_axis
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.chain import COLUMNS, Chain
from lab.kinematics.serial.khalil_frames import ANGULAR, khalil_frame
from lab.render.document import Block, Bullets, Paragraph, Table

__all__ = ["serial_blocks", "serial_frames", "serial_nominal", "serial_shape", "shape_of"]

_TRIES = 200  # poses from which a singular one is sought
ZERO = 1e-12  # of a factor (m, or a sine)
_LEAST = 1e-6  # of a joint's part in a combination


@dataclass(frozen=True)
class Singularity:
    """A singularity of a serial arm.

    Attributes:
        factor: the factor of the determinant that is zero there.
        joints: ``(n,)`` positions of an example; None where there is none within the limits.
        free: ``(k, n)`` combinations of the joints that move nothing in the example, the largest part 1.
    """

    factor: Factor
    joints: Array | None
    free: Array


@dataclass(frozen=True)
class SerialShape:
    """Structure of a serial nominal model.

    Attributes:
        reach_m: largest distance of the last frame from axis 1, within the limits; from frame 0 where joint 1 slides.
        branches: number of IK solutions of a pose; None where no closed form is implemented.
        determinant: of the Jacobian, in words; "" where no closed form is implemented.
        moved: the motions that the determinant refers to, in words.
    """

    reach_m: float
    branches: int | None
    determinant: str
    singularities: tuple[Singularity, ...]
    moved: str = ""


def shape_of(chain: Chain) -> SerialShape:
    """The shape of an arm as drawn."""
    form = closed_form_of(chain)
    if form is None:
        return SerialShape(reach_from_axis(chain), None, "", ())
    singularities = tuple(_singularity(chain, factor) for factor in form.determinant.factors if factor.terms)
    return SerialShape(reach_from_axis(chain), form.branches, form.determinant.text, singularities, form.moved)


def _singularity(chain: Chain, factor: Factor) -> Singularity:
    """An example of a singularity within the limits, by Newton's method on its factor."""
    joints = chain.random_joints(_TRIES, rng_for(0, "structure"))
    step = 1e-6
    for _ in range(20):
        value = factor.at(joints)
        slope = np.stack(
            [(factor.at(joints + move) - factor.at(joints - move)) / (2 * step) for move in step * np.eye(chain.size)],
            axis=1,
        )
        size = np.maximum((slope**2).sum(axis=1, keepdims=True), 1e-300)
        joints = joints - value[:, None] * slope / size
    fits = (np.abs(factor.at(joints)) < ZERO) & ~chain.beyond_limits(joints, 0.0).any(axis=1)
    if not fits.any():
        return Singularity(factor, None, np.empty((0, chain.size)))
    example = joints[np.flatnonzero(fits)[0]]
    arm = SerialArm(chain)
    found = rates(arm.tool(example[None], arm.nominal())[1], np.zeros((1, 6)))
    free = found.free[0, : chain.size - int(found.rank[0])]
    return Singularity(factor, example, free / np.abs(free).max(axis=1, keepdims=True))


def serial_nominal(chain: Chain) -> dict[str, Any]:
    """The table, its convention, and limits."""
    return {"convention": chain.convention, "joints": [_joint(chain, i) for i in range(chain.size)]}


def serial_frames(T_world_frame0: Array, tool: Mapping[str, Array]) -> dict[str, Any]:
    """Base and targets in Khalil and Kleinfinger's parameters, mm and degrees, with what is not determined.

    Args:
        T_world_frame0: ``(4, 4)`` m.
        tool: positions ``(3,)`` m of the targets in the last frame.
    """
    poses = {"Z": T_world_frame0, **{f"E.{name}": se3.pose(np.eye(3), place) for name, place in tool.items()}}
    return {"khalil": {name: _khalil(pose) for name, pose in poses.items()}}


def _khalil(pose: Array) -> dict[str, Any]:
    frame = khalil_frame(pose)
    units = (("deg", 180 / np.pi) if angular else ("mm", 1e3) for angular in ANGULAR)
    numbers = {f"{s}_{u}": tidy(f * x) for (s, x), (u, f) in zip(frame.named.items(), units, strict=True)}
    return {**numbers, "note": frame.note or None}


def serial_shape(chain: Chain) -> dict[str, Any]:
    """Reach, ways to a pose, the Jacobian's determinant, and an example of each singularity."""
    shape, names = shape_of(chain), chain.joint_names
    scale = np.where(chain.prismatic, 1e3, 180 / np.pi)
    return {
        "reach_mm": tidy(MM.of(shape.reach_m)),
        "ways": shape.branches,
        "freedoms": _freedoms(chain),
        "determinant": shape.determinant or None,
        "determinant_of": shape.moved or None,
        "singularities": [
            {
                "name": each.factor.name,
                "where": each.factor.text,
                "example": None if each.joints is None else [tidy(value) for value in each.joints * scale],
                "free": [
                    {name: tidy(part) for name, part in zip(names, parts, strict=True) if abs(part) > _LEAST}
                    for parts in each.free
                ],
            }
            for each in shape.singularities
        ],
    }


def _freedoms(chain: Chain) -> dict[str, Any]:
    """Mobility index, degrees of freedom, redundancy with the joints that it frees, and what no joint moves."""
    found = mobility_of(chain)
    return {
        "index": found.index,
        "degrees_of_freedom": found.freedoms,
        "redundancy": found.redundancy,
        "free": [name for name, moves in zip(chain.joint_names, found.moving, strict=True) if moves],
        "planar": found.planar,
        "missing_displacements": len(found.fixed_directions),
        "missing_turns": len(found.still),
    }


def _joint(chain: Chain, i: int) -> dict[str, Any]:
    """A joint's row of the table, with its limits."""
    cells = {
        f"{c}_{'mm' if c in 'da' else 'deg'}": tidy(chain.table[i, j] * (1e3 if c in "da" else 180 / np.pi))
        for j, c in enumerate(COLUMNS)
    }
    return {**joint_kind(chain, i), **cells, **joint_limits(chain, i)}


_NEAREST = "a pose is met in its place, and in its rotation as near as these can"
_ORDERS = {"distal": "Rz(θ) Tz(d) Tx(a) Rx(α)", "craig": "Rx(α) Tx(a) Rz(θ) Tz(d)"}


def serial_blocks(values: Mapping[str, Any]) -> tuple[Block, ...]:
    """The Denavit-Hartenberg table with limits, the reach, and the singularities."""
    convention = values["convention"]
    solutions = "" if values["ways"] is None else f"; {values['ways']} inverse-kinematics solutions of a pose"
    return (
        Paragraph(f"{values['robot']}: Denavit-Hartenberg, {convention}, {_ORDERS[convention]}; mm and °"),
        Table(("i", "θ", "d", "a", "α", "limits", "speed per s"), _rows(values["joints"])),
        Paragraph(f"reach {printed(values['reach_mm'])} mm from axis 1 to the last frame{solutions}"),
        Paragraph(_freedoms_text(values["freedoms"])),
        *_singularities(values),
        *_frames(values["khalil"]),
    )


def _freedoms_text(values: Mapping[str, Any]) -> str:
    """Joints and degrees of freedom, what is free and what cannot be moved, in a sentence."""
    index, freedoms = values["index"], values["degrees_of_freedom"]
    text = f"mobility index {index}, {freedoms} degrees of freedom of the last frame"
    if values["redundancy"]:
        text += f": redundant by {values['redundancy']}; {', '.join(values['free'])} can move while it stands still"
    else:
        text += ": not redundant but at singularities"
    if values["planar"]:
        turns = " and turns about its normal" if freedoms > 2 else ", and its turn follows from its place"
        return f"{text}; it moves in a plane{turns}"
    lacks = [f"{count} {name}" for count, name in ((values["missing_displacements"], "of its displacements"),
                                                   (values["missing_turns"], "of its turns")) if count]  # fmt: skip
    if not lacks:
        return text if freedoms >= 6 or index >= 6 else f"{text}; {_NEAREST}"
    return f"{text}; no joint makes {' and '.join(lacks)}; {_NEAREST}"


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
