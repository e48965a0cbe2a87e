"""The drawing and the shape of a mechanism with loops: as plain values, and in words."""

from functools import partial
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from lab.commands.inspect.closed_shape import SINGULAR, closed_shape_of
from lab.commands.inspect.format import joint_kind, joint_limits, limits_and_speed, printed, tidy, with_reading
from lab.commands.values import number
from lab.core.se3 import Array
from lab.kinematics.closed.loop_closure import SINGULAR as REFUSED
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.closed.structure import BASE, Step

_OF_LEGS = {"serial": "a leg's length is zero"}
_WHERE = {
    "2-RPR": {**_OF_LEGS, "parallel": "the legs are in line"},
    "3-RPR": {**_OF_LEGS, "parallel": "the legs' lines meet in a point or are parallel"},
    "Delta": {
        "parallel": "all rods are along one plane",
        "serial": "an arm is in line with its rod, seen along its axis",
        "constraint": "the parallelograms let the platform tilt",
    },
}


def drawn_closed(mechanism: Mechanism) -> dict[str, Any]:
    """Joints with limits, the paths to the frames, and what closes the loops."""
    tree, joints = mechanism.tree, range(mechanism.size)
    names = [frame.name for frame in tree.frames]
    return {
        "joints": [
            {**joint_kind(mechanism, i), "offset": mechanism.offset_of(i), **joint_limits(mechanism, i)} for i in joints
        ],
        "frames": [
            {
                "name": frame.name,
                "on": "base" if frame.on == BASE else names[frame.on],
                "path": [_step(mechanism, step) for step in frame.path],
            }
            for frame in tree.frames
        ],
        "platform": names[tree.platform],
        "rods": [
            {
                "name": rod.name,
                "between": [names[end] for end in rod.ends],
                "length_mm": tidy(1e3 * rod.length_m),
                "joint": None if rod.joint is None else mechanism.joint_names[rod.joint],
                "exact": rod.exact,
            }
            for rod in tree.rods
        ],
        "pins": [
            {
                "name": pin.name,
                "between": [names[end] for end in pin.ends],
                "along": "".join("xyz"[a] for a in pin.axes),
            }
            for pin in tree.pins
        ],
        "passive": len(tree.passive),
        "closures": tree.equations,
    }


def _step(mechanism: Mechanism, step: Step) -> dict[str, Any]:
    unit, scale = ("deg", 180 / np.pi) if step.is_turn else ("mm", 1e3)
    return {
        "kind": step.kind,
        f"value_{unit}": tidy(step.value * scale),
        "joint": None if step.joint is None else mechanism.joint_names[step.joint],
        "passive": step.passive,
        "exact": step.exact,
    }


def shape_closed(mechanism: Mechanism) -> dict[str, Any]:
    """Freedoms, modes, where it gets, and how near it comes to being singular."""
    shape = closed_shape_of(mechanism)
    flat = shape.course is not None and shape.course.is_planar
    reached = None if shape.reachable is None else number(shape.reachable)
    return {
        "mobility": shape.mobility,
        "freedoms_at_home": shape.freedoms,
        "closed_form": None if shape.course is None else {"of": shape.course.name, **_numbers(shape.course.dimensions)},
        "assembly_modes": shape.modes,
        "working_modes": shape.working,
        "share_closing": tidy(shape.share),
        "extents_mm": {axis: _mm(ends) for axis, ends in zip("xyz", shape.extents, strict=True)},
        "area_m2": reached if flat else None,
        "volume_m3": None if flat else reached,
        "closures_condition": dict(zip(("least", "middle", "largest"), map(number, shape.conditions), strict=True)),
        "singularities": None
        if shape.course is None
        else [
            {
                "name": each.kind,
                "where": _WHERE[shape.course.name][each.kind],
                "distance": number(each.distance),
                "within_limits": each.distance < SINGULAR,
                "example": [tidy(value) for value in each.joints * np.where(mechanism.prismatic, 1e3, 180 / np.pi)],
                "platform_mm": _mm(each.place),
            }
            for each in shape.singularities
        ],
    }


def _numbers(dimensions: dict[str, Array]) -> dict[str, Any]:
    """Dimensions of a closed form, in mm and degrees."""
    found: dict[str, Any] = {}
    for name, value in dimensions.items():
        if name.endswith("_rad"):
            found[f"{name.removesuffix('_rad')}_deg"] = [tidy(angle) for angle in np.degrees(value)]
        else:
            found[f"{name.removesuffix('_m')}_mm"] = (
                [_mm(point) for point in value] if value.ndim else tidy(1e3 * float(value))
            )
    return found


def _mm(lengths: Array) -> list[float]:
    return [tidy(value) for value in 1e3 * lengths]


def print_closed(console: Console, seen: dict[str, Any]) -> None:
    """The drawing as tables, then its shape."""
    closers = [_counted(len(seen[kind]), kind[:-1]) for kind in ("rods", "pins") if seen[kind]]
    console.print(
        f"{seen['robot']}: a mechanism with loops: {_counted(len(seen['joints']), 'measured joint')}, "
        f"{_counted(seen['passive'], 'passive value')}, {' and '.join(closers)}; mobility {seen['mobility']}; mm and °",
        soft_wrap=True,
    )
    signs = {joint["name"]: joint["sign"] for joint in seen["joints"]}
    joints = [[joint["name"], joint["offset"], *limits_and_speed(joint)] for joint in seen["joints"]]
    _print_table(console, ("joint", "moves", "limits", "speed per s"), joints)
    paths = [", ".join(_said(step, signs) for step in frame["path"]) or "–" for frame in seen["frames"]]
    frames = [[frame["name"], frame["on"], path] for frame, path in zip(seen["frames"], paths, strict=True)]
    _print_table(console, ("frame", "on", "path"), frames)
    rods = [[rod["name"], " – ".join(rod["between"]), _length(rod, signs)] for rod in seen["rods"]]
    pins = [[pin["name"], " – ".join(pin["between"]), f"meet in {' '.join(pin['along'])}"] for pin in seen["pins"]]
    _print_table(console, ("rod" if rods else "pin", "between", "length"), rods + pins)
    _print_shape(console, seen)


def _print_table(console: Console, headings: tuple[str, ...], rows: list[list[str]]) -> None:
    table = Table()
    for heading in headings:
        table.add_column(heading, justify="right" if heading in ("limits", "length", "speed per s") else "left")
    for row in rows:
        table.add_row(*row)
    console.print(table)


def _said(step: dict[str, Any], signs: dict[str, int]) -> str:
    """A step: its constant, the joint that adds to it, or that it is passive."""
    value = step["value_deg"] if len(step["kind"]) == 2 else step["value_mm"]
    if step["passive"]:
        return f"{step['kind']} passive ({printed(value)})"
    if step["joint"] is not None:
        return f"{step['kind']} {with_reading(step['joint'], signs[step['joint']], value)}"
    return f"{step['kind']} {printed(value)}{' exact' if step['exact'] else ''}"


def _length(rod: dict[str, Any], signs: dict[str, int]) -> str:
    if rod["joint"] is not None:
        return with_reading(rod["joint"], signs[rod["joint"]], rod["length_mm"])
    return f"{printed(rod['length_mm'])}{' exact' if rod['exact'] else ''}"


def _print_shape(console: Console, seen: dict[str, Any]) -> None:
    """Freedoms, modes, where it gets, what is singular."""
    say = partial(console.print, soft_wrap=True)
    count = f"{_counted(len(seen['joints']), 'joint')} + {_counted(seen['passive'], 'passive value')}"
    closures = _counted(seen["closures"], "closure")
    say(f"mobility {seen['mobility']} = {count} − {closures}; by rank, as drawn, {seen['freedoms_at_home']}")
    if seen["closed_form"] is None:
        say("no closed form of it is known, so its modes are not counted")
    else:
        say(f"it is a {seen['closed_form']['of']}: {_dimensions(seen['closed_form'])}")
        say(
            f"at the drawn readings it can be assembled in {_counted(seen['assembly_modes'], 'way')}; "
            f"its legs reach the drawn pose in {_counted(seen['working_modes'], 'way')}"
        )
    ends = ", ".join(f"{axis} {_ends(pair)}" for axis, pair in seen["extents_mm"].items())
    size = ""
    if seen["area_m2"] is not None:
        size = f", an area of {seen['area_m2']:.3g} m²"
    elif seen["volume_m3"] is not None:
        size = f", a volume of {seen['volume_m3']:.3g} m³"
    say(f"the origin of {seen['platform']} gets to {ends}{size}")
    least, middle, largest = (seen["closures_condition"][key] for key in ("least", "middle", "largest"))
    say(
        f"its loops close at {100 * seen['share_closing']:.3g} % of random readings within the limits, "
        f"with a condition of {least:.2g} to {largest:.2g}, mostly {middle:.2g} (1 is best, {REFUSED:g} refused)"
    )
    if seen["singularities"] is None:
        say("where it is singular is not known, but by that condition, which grows there")
    else:
        say("singularities within the limits (distance from 0, singular, to 1):")
    units = [" mm" if joint["type"] == "prismatic" else "°" for joint in seen["joints"]]
    for each in seen["singularities"] or ():
        unit = units[0] if len(set(units)) == 1 else " mm and °"
        at = f"at ({_rounded(each['example'])}){unit}, {seen['platform']} at ({_rounded(each['platform_mm'])}) mm"
        near = f"reached, e.g. {at}" if each["within_limits"] else f"no nearer than {each['distance']:#.2g}, {at}"
        say(f"  {each['name']}, where {each['where']}: {near}")


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
