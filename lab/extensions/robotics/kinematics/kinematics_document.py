"""Document of an arm's direct and inverse kinematics."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lab.core.errors import counted
from lab.core.number_text import capital, fixed, short
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.robotics.kinematics.nominal_models import Placement, Reached
from lab.library.result import joint_values
from lab.report.blocks import joint_cells, joint_headings
from lab.report.document import (
    EVERYWHERE,
    NARROW,
    PAGE,
    Badge,
    Block,
    Bullets,
    Card,
    Document,
    Figure,
    Paragraph,
    Picture,
    Row,
    Scene,
    Section,
    Table,
    Warnings,
    guarded,
)
from lab.report.scene import placement_picture, skeleton
from lab.report.view import View

if TYPE_CHECKING:
    from lab.report.page_scene import ArmScene
from lab.extensions.robotics.kinematics.kinematics_result import (
    MOST_DRAWN,
    KinematicsResult,
    coordinates,
    frames_of,
    pose_values,
)

__all__ = ["VIEW", "kinematics_document", "main_picture"]

VIEW = View(f"{__name__}:kinematics_document", f"{__name__}:main_picture")

_NOTHING = 1e-15  # of a determinant (SI): it is zero
_MOST_ROWS = 50  # of a table of placements
_POSE = ("x, mm", "y", "z", "rx, °", "ry", "rz")
_TWIST = ("vx", "vy", "vz", "ωx", "ωy", "ωz")


def main_picture(result: KinematicsResult) -> Picture:
    """Return the main figure."""
    return _placement_pictures(result)[0]


def kinematics_document(result: KinematicsResult) -> Document:
    """Build the document of the result."""
    first, arm = next(iter(result.placements), None), _arm_section(result)
    at = "" if len(result.placements) < 2 else f" at {first.name}" if first is not None else ""
    return Document(
        _title(result),
        (
            _card(result),
            Warnings(result.warnings),
            *arm,
            Section(
                "Solutions" if result.reached else "Poses",
                (*_reached_blocks(result), *_placements(result)),
                shown_in=NARROW if arm else EVERYWHERE,
            ),
            Section("Assembly modes", (_modes(result),)),
            Section(f"Differential model{at}", () if first is None else _differential(result, first)),
            Section(f"Link matrices{at}", _matrices(result)),
            Section(
                "Models in letters",
                () if result.letters is None else result.letters.blocks(result.robot.chain.joint_names),
            ),
            Section("The frames of the links", (_figure(result),)),
        ),
    )


@guarded
def _card(result: KinematicsResult) -> Card:
    """Summarise the placements: how many solutions there are, how far from a singularity, and what to do."""
    placed, chain = result.placements, result.robot.chain
    first = next(iter(placed), None)
    badge, numbers = _reach_facts(result) if result.reached else _pose_facts(placed)
    if first is not None and np.isfinite(first.jacobian).all():
        most = min(len(_TWIST), len(chain.joint_names))
        numbers.append((f"rank at {first.name}" if len(placed) > 1 else "rank", f"{first.rank} of {most}", ""))
        numbers.append(("manipulability", _size(first.manipulability), ""))
        if first.rank < most:
            badge = Badge("singular", "doubtful")
    about = "Rank and manipulability are those of the Jacobian in m and rad."
    return Card(("Pose: " if result.reached else "Joints: ", badge), tuple(numbers), about, _next(result, first))


def _reach_facts(result: KinematicsResult) -> tuple[Badge, list[tuple[str, str, str]]]:
    """Return whether wanted poses are in reach, and the numbers of solutions."""
    within = sum(not each.beyond for each in result.placements)
    numbers = [("solutions", str(len(result.placements)), "after"), ("within the limits", str(within), "")]
    lost = [each for each in result.reached if not each.solutions]
    if not lost:
        return Badge("in reach", "good"), numbers
    if np.isfinite(lost[0].gap_m):
        numbers.append(("nearest place", f"{short(MM.of(lost[0].gap_m))} mm away", ""))
    many = f"{len(lost)} of {len(result.reached)} poses out of reach"
    return Badge("out of reach" if len(result.reached) == 1 else many, "bad"), numbers


def _pose_facts(placed: Sequence[Placement]) -> tuple[Badge, list[tuple[str, str, str]]]:
    """Return whether given joint positions are within their limits, and where a single one takes the tool."""
    beyond = any(each.beyond for each in placed)
    badge = Badge("beyond a limit", "doubtful") if beyond else Badge("within the limits", "good")
    if len(placed) == 1 and np.isfinite(placed[0].T_base_tool).all():
        at = ", ".join(fixed(value, 1) for value in MM.of(placed[0].T_base_tool[:3, 3]))
        return badge, [("the tool is at x, y, z, mm", at, "after")]
    return badge, [("poses", str(len(placed)), "after")]


def _next(result: KinematicsResult, first: Placement | None) -> str:
    """Return what to do with the solutions."""
    if result.reached and not all(each.solutions for each in result.reached):
        return "Move the pose nearer to the robot, or turn it; lab workspace shows what is reached."
    if first is not None and first.rank < min(len(_TWIST), len(result.robot.chain.joint_names)):
        return "Keep motions away from here: at a singularity some joints turn however slowly the tool moves."
    if any(each.beyond for each in result.placements):
        return "Take a solution within the limits; the remarks name the joints that are beyond them."
    if len(result.placements) > 1 and result.reached:
        return "Choose the configuration that the motion keeps, and give its joints to lab trajectory."
    return "Plan a motion from here with lab trajectory."


@guarded
def _arm_section(result: KinematicsResult) -> tuple[Section, ...]:
    """Show the arm at its placements, beside the solutions and their configurations; nothing where none closes."""
    shown = [each for each in result.placements if np.isfinite(each.T_base_tool).all()][:MOST_DRAWN]
    if not shown:
        return ()
    more = f" The first {MOST_DRAWN} are shown." if len(result.placements) > MOST_DRAWN else ""
    caption = (
        "The arm in each solution, the others see-through." if len(shown) > 1 else "The arm at this pose."
    ) + more
    scene = Scene("placements-scene", lambda: _page_scene(result, shown), caption)
    title = "The arm in its solutions" if result.reached else "The arm at its poses"
    blocks = (scene, *_reached_blocks(result), *_placements(result))
    return (Section(title, blocks, shown_in=PAGE),)


def _page_scene(result: KinematicsResult, shown: Sequence[Placement]) -> "ArmScene":
    """The arm at placements, all of them at a time."""
    from lab.report.page_scene import posed_arm  # which imports MuJoCo

    arm, model = result.robot.arm(("p1",)), result.robot.whole.model
    joints = np.array([each.joints for each in shown])
    values = arm.nominal({"p1": result.options.tool_m})
    posed = posed_arm(model, arm, values, joints, [each.name or "pose" for each in shown])
    kind = "solution" if result.reached else "pose"
    ghosts = f"all {kind}s" if len(shown) > 1 else ""
    return replace(posed, kind=kind, all_text="", ghosts_text=ghosts)


def _configuration_text(configuration: Mapping[str, str]) -> str:
    """Format a configuration as ``elbow +, wrist −``."""
    return ", ".join(f"{name} {sign.replace('-', '−')}" for name, sign in configuration.items())


def _placement_pictures(result: KinematicsResult) -> tuple[Picture, ...]:
    """Draw the robot with its frames in each of the first placements, all to one scale."""
    shown = [each for each in result.placements if np.isfinite(each.T_base_tool).all()][:MOST_DRAWN]
    if not shown:
        return ()
    arm = result.robot.arm(("p1",))
    values = arm.nominal({"p1": result.options.tool_m})
    rows = np.array([each.joints for each in shown])
    lines, frames = skeleton(arm, values, rows).lines, frames_of(arm, values, rows)
    Ts = np.array([each.T_base_tool for each in shown])[:, None]
    frames = np.concatenate([frames, Ts], axis=1)
    titles = [
        f"{each.name}: {_configuration_text(each.configuration)}" if each.configuration else each.name for each in shown
    ]
    return tuple(placement_picture(i, titles[i], lines, frames) for i in range(len(shown)))


def _title(result: KinematicsResult) -> str:
    count = len(result.placements)
    if len(result.reached) == 1:
        return f"{result.robot.name}: {counted(count, 'solution')} of the pose"
    if result.reached:
        return f"{result.robot.name}: {counted(count, 'solution')} of {len(result.reached)} poses"
    return f"{result.robot.name}: {counted(count, 'pose')} by the direct model"


@guarded
def _reached_blocks(result: KinematicsResult) -> tuple[Block, ...]:
    """Report the number of solutions of each pose, and the method that found them."""
    lines = []
    for pose in result.reached[:_MOST_ROWS]:
        at = ", ".join(fixed(MM.of(value), 3) for value in pose.position)
        turned = "" if np.isfinite(pose.rotation).all() else ", the orientation is free"
        missed = f"; {pose.away}" if pose.away else ""
        name = f"{pose.name}: " if pose.name else ""
        modes = f"; {pose.reassembled} more in another assembly mode" if pose.reassembled else ""
        solutions = counted(len(pose.solutions), "solution")
        lines.append(f"{name}({at}) mm{turned}: {solutions} {_how(pose)}{modes}{missed}")
    return (Bullets(tuple(lines)),)


def _how(pose: Reached) -> str:
    """Describe the method that solved a pose, and whether there are other solutions."""
    if pose.how != "closed form":
        return "by search: there may be " + ("others" if pose.solutions else "some")
    if pose.others:
        return f"in closed form: {pose.others} more in other configurations"
    return "in closed form: " + ("there are no others" if pose.solutions else "there is none")


@guarded
def _placements(result: KinematicsResult) -> tuple[Block, ...]:
    """Tabulate joint positions, and the pose of the tool's point or the configuration of each solution."""
    chain, placed = result.robot.chain, result.placements
    numbers = ", ".join(f"{value:g}".replace("-", "−") for value in result.options.tool_mm)
    point = f"({numbers}) mm in its frame" if numbers else "its frame's origin"
    caption = f"The tool is the {'platform' if chain.has_loops else 'last frame'}; its point is {point}."
    joints = tuple((each.name, *joint_cells(chain, each.joints)) for each in placed)
    poses = tuple((each.name, *_pose_cells(each.T_base_tool)) for each in placed)
    tables = [
        _placement_table(("", *joint_headings(chain)), joints, "Joint positions"),
        *_coordinates(placed, result.options.coordinates),
        _solutions(placed) if result.reached else _placement_table(("", *_POSE), poses, caption),
    ]
    return tuple(each for each in tables if len(each.columns) > 1)


def _placement_table(columns: tuple[str, ...], rows: tuple[Row, ...], caption: str = "") -> Table:
    return Table(columns, rows, caption, most_rows=_MOST_ROWS, rest_in="--json")


def _coordinates(placed: Sequence[Placement], system: str | None) -> tuple[Table, ...]:
    """Tabulate the tool's place in cylindrical or polar coordinates, where one of these is wanted."""
    heads = {"cylindrical": ("", "θ1, °", "L, mm", "z"), "polar": ("", "θ1, °", "θ2, °", "R, mm")}
    if system not in heads:
        return ()
    places = [(each.name, coordinates(each.T_base_tool)[system] or ()) for each in placed]
    rows = tuple((name, *(fixed(value, 3) for value in values)) for name, values in places)
    return (_placement_table(heads[system], rows, f"The tool's place in {system} coordinates of the base"),)


def _solutions(placed: Sequence[Placement]) -> Table:
    """Tabulate configurations and remarks of solutions; a column that is empty is left out."""
    columns = {
        "": [each.name for each in placed],
        "configuration": [_configuration_text(each.configuration) for each in placed],
        "remark": [_note(each) for each in placed],
    }
    filled = {head: cells for head, cells in columns.items() if not head or any(cells)}
    return _placement_table(tuple(filled), tuple(zip(*filled.values(), strict=True)))


def _pose_cells(T: Array) -> tuple[str, ...]:
    values = pose_values(T)
    if values["position_mm"] is None:
        return ("–",) * 6
    return tuple(fixed(value, 3) for value in (*values["position_mm"], *values["fixed_xyz_deg"]))


def _note(each: Placement) -> str:
    singular = "singular: " if each.rank < min(len(_TWIST), len(each.joints)) else ""
    free = f"{singular}{' and '.join(each.free)} may have any position" if each.free else ""
    return "; ".join(part for part in (each.beyond, free) if part)


def _modes(result: KinematicsResult) -> Table:
    rows = tuple((str(i + 1), *_pose_cells(T)) for i, T in enumerate(result.assembly_modes))
    caption = "Every pose of the tool's point at the first joint positions, in closed form; limits aside."
    return Table(("", *_POSE), rows, caption)


@guarded
def _differential(result: KinematicsResult, first: Placement) -> tuple[Block, ...]:
    if not np.isfinite(first.jacobian).all():
        return ()
    frame, names = result.options.frame, result.robot.chain.joint_names
    axes = f"frame {frame}" if frame.isdigit() else f"the {frame}"
    jacobian = zip(_TWIST, _clean(first.jacobian), strict=True)
    rows = tuple((name, *(fixed(value, 4) for value in row)) for name, row in jacobian)
    caption = f"Jacobian in the axes of {axes}, m and rad: velocity of the tool's point, then angular velocity"
    free = [f"self-motion: {_parts(names, row)}" for row in first.self_motions]
    directions = first.lost if len(names) >= 6 else ()
    lost = [f"no joint moves the tool along {_parts(_TWIST, row / np.abs(row).max())}" for row in directions]
    table = Table(("", *names), rows, caption)
    text = capital(_sizes_of_jacobian(first))
    return table, Paragraph(text), Bullets((*free, *lost)), *_inverse(result, first), *_rates(result, first)


def _sizes_of_jacobian(placement: Placement) -> str:
    """Report rank, manipulability and determinant, with its factors."""
    count = len(placement.joints)
    part = " of the rows by which the closed form solves the pose" if count < len(_TWIST) else ""
    size = "" if placement.determinant is None else f", determinant{part} {_size(placement.determinant)}"
    factors = "; ".join(f"{name} factor {_size(value)}" for name, value in placement.factors.items())
    width = f"manipulability {_size(placement.manipulability)}"
    return f"rank {placement.rank} of {min(6, count)}, {width}{size}{f' ({factors})' if factors else ''} (m, rad)"


@guarded
def _inverse(result: KinematicsResult, first: Placement) -> tuple[Block, ...]:
    """Tabulate the inverse of the Jacobian or its pseudo-inverse."""
    inverse_jacobian = first.inverse_jacobian
    if inverse_jacobian is None or not result.options.inverse_jacobian:
        return ()
    rows = zip(result.robot.chain.joint_names, _clean(inverse_jacobian.matrix), strict=True)
    caption = {
        "blocks": "J⁻¹ by blocks, J = [A 0; C D]: A⁻¹, and below it −D⁻¹ C A⁻¹ and D⁻¹",
        "inverse": "J⁻¹",
        "left": "J⁺ = (JᵗJ)⁻¹Jᵗ: rates of the joints for a twist, by least squares",
        "right": "J⁺ = Jᵗ(JJᵗ)⁻¹: the smallest rates of the joints for a twist",
        "singular": "J⁺ by singular values, as the robot is singular here",
    }[inverse_jacobian.kind]
    return (Table(("", *_TWIST), tuple((name, *(fixed(v, 4) for v in row)) for name, row in rows), caption),)


@guarded
def _rates(result: KinematicsResult, first: Placement) -> tuple[Block, ...]:
    """Tabulate rates, their twist, and the part of a wanted twist that the robot cannot have."""
    if first.rates is None or first.twist is None:
        return ()
    chain = result.robot.chain
    scale = np.repeat([1e3, 180 / np.pi], 3)
    heads = tuple(f"{name}, {'mm' if i < 3 else '°'}/s" for i, name in enumerate(_TWIST))
    rows: list[Row] = [("twist", *(fixed(value, 3) for value in _clean(scale * first.twist)))]
    if first.missing is not None and np.abs(first.missing).max() > 0:
        rows.append(("cannot be had", *(fixed(value, 3) for value in _clean(scale * first.missing))))
    joints = tuple(fixed(value, 3) for value in _clean(joint_values(chain.prismatic, first.rates)))
    return Table(("", *joint_headings(chain, "/s")), (("rates", *joints),)), Table(("", *heads), tuple(rows))


@guarded
def _matrices(result: KinematicsResult) -> tuple[Block, ...]:
    """Tabulate T_i-1,i and T_0,i, and the product of ``--between``, with positions in mm."""
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


def _figure(result: KinematicsResult) -> Figure:
    more = f" The first {MOST_DRAWN} are drawn." if len(result.placements) > MOST_DRAWN else ""
    caption = f"The robot as lines with its frames (x red, y green, z blue), seen from above at an angle.{more}"
    return Figure("placements", _placement_pictures(result), caption)


def _size(value: float) -> str:
    """Format a product that rounding may keep from being zero."""
    return short(0.0 if abs(value) < _NOTHING else value)


def _parts(names: Sequence[str], row: Array) -> str:
    """Format the parts of a direction that are not zero."""
    return " ".join(
        f"{value:+.4g} {name}" for name, value in zip(names, row, strict=True) if abs(value) > 1e-9
    ).replace("-", "−")


def _clean(values: Array) -> Array:
    """Remove rounding errors and minus zeros."""
    return np.where(np.abs(values) < 1e-12 * max(1.0, float(np.abs(values).max(initial=0.0))), 0.0, values)
