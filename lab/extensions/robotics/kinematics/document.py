"""What a person reads of a robot's models: poses, solutions, the Jacobian with what is singular, and matrices."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from lab.commands.provenance import provenance_section
from lab.commands.values import joint_values
from lab.core.se3 import Array
from lab.core.wording import counted
from lab.extensions.robotics.kinematics.placement import Placement
from lab.extensions.robotics.kinematics.result import KinematicsResult, pose_values
from lab.kinematics.serial.arm import SerialArm
from lab.render.document import Block, Bullets, Document, Figure, Paragraph, Picture, Row, Section, Table, Warnings
from lab.render.format import capital, fixed, short
from lab.render.placements import placement_picture
from lab.render.skeleton import skeleton

if TYPE_CHECKING:
    from lab.kinematics.model import RigidArm

__all__ = ["MOST_DRAWN", "frames_of", "kinematics_document", "placement_pictures", "side_words"]

MOST_DRAWN = 12  # placements in a page's figure
_SHORT_ENTRY = 14  # characters, of which four stand side by side on a terminal and on a phone
_NOTHING = 1e-15  # of a determinant (SI): it is zero
MOST_ROWS = 50  # of a table of placements
_POSE = ("x, mm", "y", "z", "rx, °", "ry", "rz")
_TWIST = ("vx", "vy", "vz", "ωx", "ωy", "ωz")


def kinematics_document(result: KinematicsResult) -> Document:
    """Poses or solutions, then the models at the first of them, then matrices where asked for."""
    first = next(iter(result.placements), None)
    at = "" if len(result.placements) < 2 else f" at {first.name}" if first is not None else ""
    return Document(
        _title(result),
        (
            Warnings(result.warnings),
            Section("Solutions" if result.reached else "Poses", (*_reached(result), *_placements(result))),
            Section("Assembly modes", _modes(result)),
            Section(f"Differential model{at}", () if first is None else _differential(result, first)),
            Section(f"Link matrices{at}", _matrices(result)),
            Section("Matrices in letters", _letters(result)),
            Section("Placements", (_figure(result),)),
            provenance_section("kinematics", result.options, result.robot.sha256),
        ),
    )


def side_words(configuration: Mapping[str, str]) -> str:
    """A configuration as ``elbow +, wrist −``."""
    return ", ".join(f"{name} {sign.replace('-', '−')}" for name, sign in configuration.items())


def placement_pictures(result: KinematicsResult) -> tuple[Picture, ...]:
    """The robot with its frames in each of the first placements, all to one scale."""
    shown = [each for each in result.placements if np.isfinite(each.T_base_tool).all()][:MOST_DRAWN]
    if not shown:
        return ()
    arm = result.robot.arm(("p1",))
    values = arm.nominal({"p1": result.options.tool_m})
    rows = np.array([each.joints for each in shown])
    lines, frames = skeleton(arm, values, rows).lines, frames_of(arm, values, rows)
    Ts = np.array([each.T_base_tool for each in shown])[:, None]
    frames = np.concatenate([frames, Ts], axis=1)
    titles = [f"{each.name}: {side_words(each.configuration)}" if each.configuration else each.name for each in shown]
    return tuple(placement_picture(i, titles[i], lines, frames) for i in range(len(shown)))


def frames_of(arm: "RigidArm", values: Array, joints: Array) -> Array:
    """Poses ``(n, f, 4, 4)`` (m) of the frames to draw in the base: of a serial arm those of its table."""
    base = np.tile(np.eye(4), (len(joints), 1, 1))
    if not isinstance(arm, SerialArm):
        return base[:, None]
    sizes = range(1, arm.chain.size + 1)
    return np.stack([base, *(arm.frame(joints, values, size) for size in sizes)], axis=1)


def _title(result: KinematicsResult) -> str:
    count = len(result.placements)
    if len(result.reached) == 1:
        return f"{result.robot.name}: {counted(count, 'solution')} of the pose"
    if result.reached:
        return f"{result.robot.name}: {counted(count, 'solution')} of {len(result.reached)} poses"
    return f"{result.robot.name}: {counted(count, 'pose')} by the direct model"


def _reached(result: KinematicsResult) -> tuple[Block, ...]:
    """How many solutions each pose has, and how they were found."""
    lines = []
    for each in result.reached:
        at = ", ".join(fixed(1e3 * value, 3) for value in each.position)
        turned = "" if np.isfinite(each.rotation).all() else ", the orientation is free"
        missed = f"; {each.away}" if each.away else ""
        none = "there are no others" if each.solutions else "there is none"
        others = f"{each.others} more in other configurations" if each.others else none
        more = "there may be others" if each.solutions else "there may be some"
        how = f"in closed form: {others}" if each.how == "closed form" else f"by search: {more}"
        name = f"{each.name}: " if each.name else ""
        modes = f"; {each.reassembled} more in another assembly mode" if each.reassembled else ""
        lines.append(f"{name}({at}) mm{turned}: {counted(len(each.solutions), 'solution')} {how}{modes}{missed}")
    return (Bullets(tuple(lines[:MOST_ROWS])),)


def _placements(result: KinematicsResult) -> tuple[Block, ...]:
    """Joint positions, and beside them the pose of the tool's point, or the configuration of each solution."""
    chain, placed = result.robot.chain, result.placements
    pairs = zip(chain.joint_names, chain.prismatic, strict=True)
    names = tuple(f"{name}, {'mm' if slides else '°'}" for name, slides in pairs)
    joints = tuple(
        (each.name, *(fixed(value, 3) for value in joint_values(chain.prismatic, each.joints))) for each in placed
    )
    numbers = _numbers(result.options.tool_mm)
    point = f"({numbers}) mm in its frame" if numbers else "its frame's origin"
    caption = f"The tool is the {'platform' if chain.has_loops else 'last frame'}; its point is {point}."
    poses = tuple((each.name, *_pose_cells(each.T_base_tool)) for each in placed)
    told = tuple((each.name, side_words(each.configuration), _note(each)) for each in placed)
    said: list[Block] = [Table(("", *names), joints, "Joint positions", most_rows=MOST_ROWS, rest_in="--json")]
    if not result.reached:
        said.append(Table(("", *_POSE), poses, caption, most_rows=MOST_ROWS, rest_in="--json"))
    elif any(configuration or note for _, configuration, note in told):
        said.append(_table_of_configurations(told))
    return tuple(said)


def _table_of_configurations(told: Sequence[tuple[str, str, str]]) -> Table:
    """Name, configuration and remark of each solution, without a column that is empty in all."""
    heads = ("", "configuration", "remark")
    kept = [i for i in range(len(heads)) if i == 0 or any(row[i] for row in told)]
    rows = tuple(tuple(row[i] for i in kept) for row in told)
    return Table(tuple(heads[i] for i in kept), rows, "", most_rows=MOST_ROWS, rest_in="--json")


def _pose_cells(T: Array) -> tuple[str, ...]:
    values = pose_values(T)
    if values["position_mm"] is None:
        return ("–",) * 6
    return tuple(fixed(value, 3) for value in (*values["position_mm"], *values["fixed_xyz_deg"]))


def _note(each: Placement) -> str:
    free = f"singular: {' and '.join(each.free)} may have any position" if each.free else ""
    return "; ".join(part for part in (each.beyond, free) if part)


def _modes(result: KinematicsResult) -> tuple[Block, ...]:
    """Where else the platform can be at the first joint positions."""
    rows = tuple((str(i + 1), *_pose_cells(T)) for i, T in enumerate(result.assembly_modes))
    caption = "Every pose of the tool's point at the first joint positions, in closed form; limits aside."
    return (Table(("", *_POSE), rows, caption),)


def _differential(result: KinematicsResult, first: Placement) -> tuple[Block, ...]:
    """The Jacobian, its determinant, and what is singular; rates and twist where asked for."""
    if not np.isfinite(first.jacobian).all():
        return ()
    names, axes = result.robot.chain.joint_names, "the base" if result.options.frame == "base" else "the tool"
    table = Table(
        ("", *names),
        tuple(
            (name, *(fixed(value, 4) for value in row))
            for name, row in zip(_TWIST, _clean(first.jacobian), strict=True)
        ),
        f"Jacobian in the axes of {axes}, m and rad: velocity of the tool's point, then angular velocity",
    )
    width = f"manipulability {_size(first.manipulability)}"
    size = "" if first.determinant is None else f", determinant{_part_of(len(names))} {_size(first.determinant)}"
    factors = "; ".join(f"{name} factor {_size(value)}" for name, value in first.factors.items())
    said = f"rank {first.rank} of {min(6, len(names))}, {width}{size}{f' ({factors})' if factors else ''} (m, rad)"
    free = [f"self-motion: {_parts(names, row)}" for row in first.self_motions]
    lost = (
        [f"no joint moves the tool along {_parts(_TWIST, row / np.abs(row).max())}" for row in first.lost]
        if len(names) >= 6
        else []
    )
    return (table, Paragraph(capital(said)), Bullets((*free, *lost)), *_rates(result, first))


def _part_of(joints: int) -> str:
    """Of what part of the Jacobian a determinant is, where it is not of the whole."""
    return " of the rows by which the closed form solves the pose" if joints < len(_TWIST) else ""


def _rates(result: KinematicsResult, first: Placement) -> tuple[Block, ...]:
    """Rates, and the twist that they give; what of a wanted twist cannot be had."""
    if first.rates is None or first.twist is None:
        return ()
    chain = result.robot.chain
    names = zip(chain.joint_names, chain.prismatic, strict=True)
    units = tuple(f"{name}, {'mm' if slides else '°'}/s" for name, slides in names)
    scale = np.repeat([1e3, 180 / np.pi], 3)
    heads = tuple(f"{name}, {'mm' if i < 3 else '°'}/s" for i, name in enumerate(_TWIST))
    rows: list[Row] = [("twist", *(fixed(value, 3) for value in _clean(scale * first.twist)))]
    if first.missing is not None and np.abs(first.missing).max() > 0:
        rows.append(("cannot be had", *(fixed(value, 3) for value in _clean(scale * first.missing))))
    joints = tuple(fixed(value, 3) for value in _clean(joint_values(chain.prismatic, first.rates)))
    return Table(("", *units), (("rates", *joints),)), Table(("", *heads), tuple(rows))


def _matrices(result: KinematicsResult) -> tuple[Block, ...]:
    """T_i-1,i and T_0,i, and what ``--between`` names, with positions in mm."""
    options, matrices, tables = result.options, result.matrices, []
    if options.matrices:
        tables += [_matrix(f"T{i},{i + 1}", T) for i, T in enumerate(matrices.links)]
        tables += [_matrix(f"T0,{i + 1}", matrices.product(0, i + 1)) for i in range(1, len(matrices.links))]
    if options.between is not None:
        first, last = options.between
        tables.append(_matrix(f"T{first},{last}", matrices.product(first, last)))
    return tuple(tables)


def _matrix(name: str, T: Array) -> Table:
    scale = np.where(np.arange(4) == 3, 1e3, 1.0)
    rows = [[fixed(value, 6 if j < 3 else 3) for j, value in enumerate(row)] for row in _clean(T[:3] * scale)]
    return Table(("", "", "", ""), tuple(tuple(row) for row in (*rows, ["0", "0", "0", "1"])), f"{name}, mm")


def _letters(result: KinematicsResult) -> tuple[Block, ...]:
    """Each matrix, and what the letters stand for."""
    matrices = result.matrices.texts()
    if not matrices:
        return ()
    letters = ", ".join(
        f"{name.rpartition('_')[0]} = {value:.6g} {'mm' if name.endswith('mm') else '°'}".replace("-", "−")
        for name, value in result.matrices.letter_values().items()
    )
    names = ", ".join(
        f"q{i + 1} is {name}" for i, name in enumerate(result.robot.chain.joint_names) if name != f"q{i + 1}"
    )
    said = f"Here c1 is cos q1, s23 is sin(q2 + q3){f'; {names}' if names else ''}"
    return (
        Paragraph(f"{said}. {letters}." if letters else f"{said}."),
        *(_matrix_in_letters(name, rows) for name, rows in matrices.items()),
    )


def _matrix_in_letters(name: str, rows: Sequence[Sequence[str]]) -> Table:
    """A matrix as it is written; one with long entries as a list of these."""
    if max(len(entry) for row in rows for entry in row) <= _SHORT_ENTRY:
        return Table(("", "", "", ""), tuple(tuple(row) for row in rows), name)
    entries = tuple((f"{name}({i + 1},{j + 1})", rows[i][j]) for i in range(3) for j in range(4))
    return Table(("", ""), entries, name)


def _figure(result: KinematicsResult) -> Figure:
    more = f" The first {MOST_DRAWN} are drawn." if len(result.placements) > MOST_DRAWN else ""
    caption = f"The robot as lines with its frames (x red, y green, z blue), seen from above at an angle.{more}"
    return Figure("placements", placement_pictures(result), caption)


def _size(value: float) -> str:
    """Of a product that rounding may keep from being zero."""
    return short(0.0 if abs(value) < _NOTHING else value)


def _parts(names: Sequence[str], row: Array) -> str:
    """The parts of a direction that are not zero."""
    return " ".join(
        f"{value:+.4g} {name}" for name, value in zip(names, row, strict=True) if abs(value) > 1e-9
    ).replace("-", "−")


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}".replace("-", "−") for value in values)


def _clean(values: Array) -> Array:
    """Without what rounding left, and without minus zero."""
    return np.where(np.abs(values) < 1e-12 * max(1.0, float(np.abs(values).max(initial=0.0))), 0.0, values)
