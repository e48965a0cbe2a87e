"""Blocks on a robot's nominal model, its shape and its resolution."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lab.core.errors import counted
from lab.kinematics.closed.loop_closure import SINGULAR as REFUSED
from lab.library.result import printed
from lab.report.document import Block, Bullets, Paragraph, Table, guarded

__all__ = ["closed_blocks", "resolution_blocks", "serial_blocks", "tree_blocks"]


def _limits_and_speed(joint: dict[str, Any]) -> tuple[str, str]:
    unit = "mm" if joint["type"] == "prismatic" else "deg"
    speed = joint[f"speed_{unit}_per_s"]
    limits = f"{printed(joint[f'lower_{unit}'])} … {printed(joint[f'upper_{unit}'])}"
    return limits, "–" if speed is None else printed(speed)


def _with_joint(joint: str, sign: int, offset: float) -> str:
    """A value to which a joint's position adds, by its sign: the joint and the offset."""
    position = joint if sign > 0 else f"−{joint}"
    return position if offset == 0 else f"{position} {'−' if offset < 0 else '+'} {printed(abs(offset))}"


@guarded
def tree_blocks(values: Mapping[str, Any]) -> tuple[Block, ...]:
    """The Denavit-Hartenberg table of each tip's chain, with limits, and its reach."""
    blocks = list[Block]()
    for tip in values["tips"]:
        mount = tip["mount"]
        stands = ""
        if mount is not None:
            at, turn = (", ".join(printed(x) for x in mount[key]) for key in ("position_mm", "rotation_vector_deg"))
            stands = f"; its frame 0 stands at ({at}) mm, turned by ({turn})°, in that of {values['tips'][0]['name']}"
        reach = printed(tip["reach_mm"])
        blocks += [
            Paragraph(
                f"{values['robot']} to {tip['name']}: Denavit-Hartenberg, {tip['convention']}, "
                f"{_ORDERS[tip['convention']]}; mm and °; reach {reach} mm from axis 1 to the last frame{stands}"
            ),
            Table(
                ("link", "θ", "d", "a", "α", "limits", "speed per s"),
                tuple(
                    (joint["link"], *row[1:]) for joint, row in zip(tip["joints"], _rows(tip["joints"]), strict=True)
                ),
            ),
        ]
    return tuple(blocks)


_NEAREST = "a pose is met in its place, and in its rotation as near as these can"
_ORDERS = {"distal": "Rz(θ) Tz(d) Tx(a) Rx(α)", "craig": "Rx(α) Tx(a) Rz(θ) Tz(d)"}


@guarded
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
        moved = _with_joint(joint["name"], joint["sign"], joint["d_mm" if slides else "theta_deg"])
        theta, d = (theta, moved) if slides else (moved, d)
        lengths = printed(joint["a_mm"]), printed(joint["alpha_deg"])
        rows.append((str(i + 1), theta, d, *lengths, *_limits_and_speed(joint)))
    return tuple(rows)


@guarded
def _frames(khalil: Mapping[str, Mapping[str, Any]]) -> tuple[Block, ...]:
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


@guarded
def _singularities(values: Mapping[str, Any]) -> tuple[Block, ...]:
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


@guarded
def closed_blocks(values: Mapping[str, Any]) -> tuple[Block, ...]:
    """The joints, the frames and what closes the loops as tables, then the shape."""
    closers = [counted(len(values[kind]), kind[:-1]) for kind in ("rods", "pins") if values[kind]]
    signs = {joint["name"]: joint["sign"] for joint in values["joints"]}
    joints = tuple((joint["name"], joint["offset"], *_limits_and_speed(joint)) for joint in values["joints"])
    frames = tuple((frame["name"], frame["on"], _path_text(frame["path"], signs)) for frame in values["frames"])
    return (
        Paragraph(
            f"{values['robot']}: a mechanism with loops: {counted(len(values['joints']), 'measured joint')}, "
            f"{counted(values['passive'], 'passive value')}, {' and '.join(closers)}; mobility {values['mobility']}; "
            "mm and °"
        ),
        Table(("joint", "moves", "limits", "speed per s"), joints),
        Table(("frame", "on", "path"), frames),
        _closers(values, signs),
        *_shape(values),
    )


def _closers(values: Mapping[str, Any], signs: dict[str, int]) -> Table:
    """Tabulate the rods and pins that close the loops."""
    rods = [(rod["name"], " – ".join(rod["between"]), _length(rod, signs)) for rod in values["rods"]]
    pins = [(pin["name"], " – ".join(pin["between"]), f"meet in {' '.join(pin['along'])}") for pin in values["pins"]]
    return Table(("rod" if rods else "pin", "between", "length"), (*rods, *pins))


def _path_text(path: Sequence[dict[str, Any]], signs: dict[str, int]) -> str:
    return ", ".join(_step_text(step, signs) for step in path) or "–"


def _step_text(step: dict[str, Any], signs: dict[str, int]) -> str:
    value = step["value_deg"] if len(step["kind"]) == 2 else step["value_mm"]
    if step["passive"]:
        return f"{step['kind']} passive ({printed(value)})"
    if step["joint"] is not None:
        return f"{step['kind']} {_with_joint(step['joint'], signs[step['joint']], value)}"
    return f"{step['kind']} {printed(value)}{' exact' if step['exact'] else ''}"


def _length(rod: dict[str, Any], signs: dict[str, int]) -> str:
    if rod["joint"] is not None:
        return _with_joint(rod["joint"], signs[rod["joint"]], rod["length_mm"])
    return f"{printed(rod['length_mm'])}{' exact' if rod['exact'] else ''}"


def _gruebler(count: Mapping[str, Any]) -> str:
    most, internal = (3, "") if count["planar"] else (6, f" − {count['internal']} internal")
    turns = "" if count["planar"] or not count["internal"] else "; each rod turns about itself"
    bodies, joints = f"{most} × {count['bodies']} bodies", f"{most} × {count['joints']} joints"
    freedoms = f"{count['joint_freedoms']} freedoms of the joints"
    return f"Grübler's count {count['mobility']} = {bodies} − {joints} + {freedoms}{internal}{turns}"


@guarded
def _shape(values: Mapping[str, Any]) -> tuple[Block, ...]:
    count = f"{counted(len(values['joints']), 'joint')} + {counted(values['passive'], 'passive value')}"
    closures = counted(values["closures"], "closure")
    lines = [
        f"mobility {values['mobility']} = {count} − {closures}; by the rank at the nominal position, "
        f"{values['freedoms_at_home']}",
        _gruebler(values["grubler"]),
    ]
    if values["closed_form"] is None:
        lines.append("no closed form of it is known, so its modes are not counted")
    else:
        lines.append(f"it is a {values['closed_form']['of']}: {_dimensions(values['closed_form'])}")
        lines.append(
            f"at the nominal joint positions it can be assembled in {counted(values['assembly_modes'], 'way')}; "
            f"its legs reach the nominal pose in {counted(values['working_modes'], 'way')}"
        )
    ends = ", ".join(f"{axis} {_ends(pair)}" for axis, pair in values["extents_mm"].items())
    size = ""
    if values["area_m2"] is not None:
        size = f", an area of {values['area_m2']:.3g} m²"
    elif values["volume_m3"] is not None:
        size = f", a volume of {values['volume_m3']:.3g} m³"
    lines.append(f"the origin of {values['platform']} reaches {ends}{size}")
    least, middle, largest = (values["closures_condition"][key] for key in ("least", "middle", "largest"))
    lines.append(
        f"its loops close at {100 * values['share_closing']:.3g} % of random joint positions within the limits, with a "
        f"condition number of {least:.2g} to {largest:.2g}, mostly {middle:.2g} (1 is best, {REFUSED:g} refused)"
    )
    if values["singularities"] is None:
        lines.append("where it is singular is not known, but by that condition number, which grows there")
        return (Bullets(tuple(lines)),)
    return (
        Bullets(tuple(lines)),
        Paragraph("Singularities within the limits (distance from 0, singular, to 1):"),
        Bullets(tuple(_singularity_text(values, each) for each in values["singularities"])),
    )


def _singularity_text(values: Mapping[str, Any], each: dict[str, Any]) -> str:
    units = {" mm" if joint["type"] == "prismatic" else "°" for joint in values["joints"]}
    unit = units.pop() if len(units) == 1 else " mm and °"
    at = f"at ({_rounded(each['example'])}){unit}, {values['platform']} at ({_rounded(each['platform_mm'])}) mm"
    near = f"reached, e.g. {at}" if each["within_limits"] else f"no nearer than {each['distance']:#.2g}, {at}"
    return f"{each['name']}, where {each['where']}: {near}"


def _dimensions(form: dict[str, Any]) -> str:
    if "span_mm" in form:
        return f"anchors {printed(form['span_mm'])} mm apart"
    if "anchors_mm" in form:
        ends = (", ".join(f"({_rounded(point)})" for point in form[f"{name}_mm"]) for name in ("anchors", "pins"))
        return "anchors {} and, on the platform, pins {} mm".format(*ends)
    return (
        f"arms of {printed(form['arm_mm'])} mm at {', '.join(map(printed, form['azimuths_deg']))}°, rods of "
        f"{printed(form['rod_mm'])} mm; hips {printed(form['base_radius_mm'])} mm from the centre, rods' ends "
        f"{printed(form['platform_radius_mm'])} mm"
    )


def _ends(pair: list[float]) -> str:
    low, high = (printed(round(value)) for value in pair)
    return f"{low} … {high} mm" if low != high else f"{low} mm"


def _rounded(values: list[float]) -> str:
    return ", ".join(f"{value:.1f}" for value in np.round(values, 1) + 0.0).replace("-", "−")


@guarded
def resolution_blocks(values: Mapping[str, Any] | None) -> tuple[Block, ...]:
    """Return the resolution as a paragraph and a table by encoder; of unknown encoders a note."""
    if values is None:
        text = (
            "The resolution is not given: the increments of the encoders are not known. Give --joint-steps, or "
            "counts_per_turn of each drive in the robot's table."
        )
        return (Paragraph(text, "note"),)
    largest, mean, rms, most = (
        _um(values[key]) for key in ("step_max_mm", "step_mean_mm", "rounding_mean_mm", "rounding_max_mm")
    )
    text = (
        f"One count of an encoder moves {values['target']} by up to {largest} µm ({values['coarsest_encoder']}). Over "
        f"{values['poses']} random poses the coarsest one moves it by {mean} µm in the mean. Rounding to whole counts "
        f"displaces it by {rms} µm (RMS), at the worst pose by {most} µm (RMS)."
    )
    rows = tuple(
        (each["joint"], *(_um(each[f"{name}_{unit}"]) for unit in ("mm", "deg") for name in ("min", "mean", "max")))
        for each in values["encoders"]
    )
    heads = ("encoder of", "least, µm", "mean", "most", "least, m°", "mean", "most")
    caption = "Motion of the target by one count of each encoder: least, mean and largest over the poses."
    return Paragraph(text), Table(heads, rows, caption)


def _um(size: float | None) -> str:
    return "–" if size is None else f"{1e3 * size:.3g}"
