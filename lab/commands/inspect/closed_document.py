"""What a person reads of a mechanism's nominal model and shape."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from lab.commands.values import limits_and_speed, printed, with_joint
from lab.kinematics.closed.loop_closure import SINGULAR as REFUSED
from lab.render.document import Block, Bullets, Paragraph, Table

__all__ = ["closed_blocks"]


def closed_blocks(values: Mapping[str, Any]) -> tuple[Block, ...]:
    """The joints, the frames and what closes the loops as tables, then the shape."""
    closers = [_counted(len(values[kind]), kind[:-1]) for kind in ("rods", "pins") if values[kind]]
    signs = {joint["name"]: joint["sign"] for joint in values["joints"]}
    joints = tuple((joint["name"], joint["offset"], *limits_and_speed(joint)) for joint in values["joints"])
    paths = [", ".join(_step(step, signs) for step in frame["path"]) or "–" for frame in values["frames"]]
    frames = tuple((frame["name"], frame["on"], path) for frame, path in zip(values["frames"], paths, strict=True))
    rods = tuple((rod["name"], " – ".join(rod["between"]), _length(rod, signs)) for rod in values["rods"])
    pins = tuple(
        (pin["name"], " – ".join(pin["between"]), f"meet in {' '.join(pin['along'])}") for pin in values["pins"]
    )
    return (
        Paragraph(
            f"{values['robot']}: a mechanism with loops: {_counted(len(values['joints']), 'measured joint')}, "
            f"{_counted(values['passive'], 'passive value')}, {' and '.join(closers)}; mobility {values['mobility']}; "
            "mm and °"
        ),
        Table(("joint", "moves", "limits", "speed per s"), joints),
        Table(("frame", "on", "path"), frames),
        Table(("rod" if rods else "pin", "between", "length"), rods + pins),
        *_shape(values),
    )


def _step(step: dict[str, Any], signs: dict[str, int]) -> str:
    """A step of a path: its constant, the joint that adds to it, or that it is passive."""
    value = step["value_deg"] if len(step["kind"]) == 2 else step["value_mm"]
    if step["passive"]:
        return f"{step['kind']} passive ({printed(value)})"
    if step["joint"] is not None:
        return f"{step['kind']} {with_joint(step['joint'], signs[step['joint']], value)}"
    return f"{step['kind']} {printed(value)}{' exact' if step['exact'] else ''}"


def _length(rod: dict[str, Any], signs: dict[str, int]) -> str:
    if rod["joint"] is not None:
        return with_joint(rod["joint"], signs[rod["joint"]], rod["length_mm"])
    return f"{printed(rod['length_mm'])}{' exact' if rod['exact'] else ''}"


def _gruebler(count: Mapping[str, Any]) -> str:
    """The count of bodies and joints, as textbooks print it."""
    most, internal = (3, "") if count["planar"] else (6, f" − {count['internal']} internal")
    turns = "" if count["planar"] or not count["internal"] else "; each rod turns about itself"
    bodies, joints = f"{most} × {count['bodies']} bodies", f"{most} × {count['joints']} joints"
    freedoms = f"{count['joint_freedoms']} freedoms of the joints"
    return f"Grübler's count {count['mobility']} = {bodies} − {joints} + {freedoms}{internal}{turns}"


def _shape(values: Mapping[str, Any]) -> tuple[Block, ...]:
    """Freedoms, modes, workspace, and singularities."""
    count = f"{_counted(len(values['joints']), 'joint')} + {_counted(values['passive'], 'passive value')}"
    closures = _counted(values["closures"], "closure")
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
            f"at the nominal joint positions it can be assembled in {_counted(values['assembly_modes'], 'way')}; "
            f"its legs reach the nominal pose in {_counted(values['working_modes'], 'way')}"
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
        Bullets(tuple(_singularity(values, each) for each in values["singularities"])),
    )


def _singularity(values: Mapping[str, Any], each: dict[str, Any]) -> str:
    units = {" mm" if joint["type"] == "prismatic" else "°" for joint in values["joints"]}
    unit = units.pop() if len(units) == 1 else " mm and °"
    at = f"at ({_rounded(each['example'])}){unit}, {values['platform']} at ({_rounded(each['platform_mm'])}) mm"
    near = f"reached, e.g. {at}" if each["within_limits"] else f"no nearer than {each['distance']:#.2g}, {at}"
    return f"{each['name']}, where {each['where']}: {near}"


def _dimensions(form: dict[str, Any]) -> str:
    """Of a closed form, in words."""
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


def _counted(count: int, thing: str) -> str:
    return f"{count} {thing}{'' if count == 1 else 's'}"
