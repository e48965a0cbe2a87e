"""The nominal model and the shape of a mechanism with loops, as plain values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lab.commands.result import (
    joint_kind,
    joint_limits,
    joint_values,
    limits_and_speed,
    number,
    printed,
    tidy,
    with_joint,
)
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extension_points import load_all
from lab.kinematics.closed.loop_closure import BASE, Configuration, Step
from lab.kinematics.closed.loop_closure import SINGULAR as REFUSED
from lab.kinematics.closed.mechanism import Mechanism, platform_poses
from lab.kinematics.closed.mobility import SINGULAR, ClosedFormShape, body_count
from lab.kinematics.joints import JointSpec
from lab.kinematics.reach import extents
from lab.render.document import Block, Bullets, Paragraph, Table

__all__ = ["ClosedShape", "closed_blocks", "closed_nominal", "closed_shape", "closed_shape_of"]

_TAKES = 4000  # random readings by which extents are found
_RANK = 1e-9  # of the largest singular value


@dataclass(frozen=True)
class ClosedShape:
    """Structure of a closed-loop nominal model, in the nominal assembly mode.

    Attributes:
        mobility: joints and passive values less the closures' equations.
        freedoms: joints and passive values less the rank of the closures' Jacobian at home.
        closed_form: parameters of its closed form, if it has one.
        share: of joint positions within the limits, those at which the loops close.
        extents: ``(3, 2)`` least and largest coordinates (m) of the platform's origin in the base.
        conditions: of the closures' Jacobian by the passive values: least, median and largest.
    """

    mobility: int
    freedoms: int
    closed_form: ClosedFormShape | None
    share: float
    extents: Array
    conditions: Array


def closed_shape_of(mechanism: Mechanism) -> ClosedShape:
    """The shape of a mechanism as drawn."""
    taken = JointSpec.random_joints(mechanism, _TAKES, rng_for(0, "structure"))
    closed = mechanism.assembled(taken, mechanism.nominal_values)
    joints, passive = taken[closed.fits], closed.configuration.passive.T[closed.fits]
    home = mechanism.assembled(mechanism.home[None], mechanism.nominal_values).configuration
    shapes = (find(mechanism, joints, passive) for find in load_all("lab.shapes").values())
    form: ClosedFormShape | None = next((shape for shape in shapes if shape is not None), None)
    others = () if form is None else [each.place for each in form.singularities]
    return ClosedShape(
        mobility=mechanism.size + len(mechanism.tree.passive) - mechanism.tree.equations,
        freedoms=mechanism.size + len(mechanism.tree.passive) - _rank(home),
        closed_form=form,
        share=float(closed.fits.mean()),
        extents=_extents(mechanism, joints, _places(mechanism, joints, passive), others),
        conditions=np.quantile(closed.condition[closed.fits], [0.0, 0.5, 1.0]),
    )


def _extents(mechanism: Mechanism, joints: Array, places: Array, others: Sequence[Array]) -> Array:
    """The least and largest coordinates ``(3, 2)`` m of the platform's origin, within the limits."""

    def places_of(tried: Array) -> Array:
        closed = mechanism.assembled(tried, mechanism.nominal_values, quickly=True)
        fits, found = closed.fits, np.full((len(tried), 3), np.nan)
        found[fits] = _places(mechanism, tried[fits], closed.configuration.passive.T[fits])
        return found

    return extents(mechanism, places_of, joints, places, others)


def _places(mechanism: Mechanism, joints: Array, passive: Array) -> Array:
    """Compute the platform's origin in the base ``(n, 3)`` m."""
    return platform_poses(mechanism, joints, passive)[:, :3, 3]


def _rank(configuration: Configuration) -> int:
    """Compute the rank of the closures' Jacobian by all moving parts, at a single pose."""
    tree, directions = configuration.tree, configuration.closures()[1]
    rows = np.zeros((tree.equations, len(tree.passive) + len(configuration.joint_values)))
    for i, opening in enumerate(tree.openings):
        for step, end, sign in opening:
            described = tree.step(*step)
            if described.passive or described.joint is not None:
                slope = configuration.slope(step, configuration.frames[end][1], directions[i])
                moved = tree.passive.index(step) if described.joint is None else len(tree.passive) + described.joint
                rows[i, moved] += sign * float(np.ravel(slope)[0])
    for i, rod in enumerate(tree.rods):
        if rod.joint is not None:
            rows[i, len(tree.passive) + rod.joint] -= 1.0
    sizes = np.linalg.svd(rows, compute_uv=False)
    return int((sizes > _RANK * sizes.max(initial=0.0)).sum())


def closed_nominal(mechanism: Mechanism) -> dict[str, Any]:
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
                "length_mm": tidy(MM.of(rod.length_m)),
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


def closed_shape(mechanism: Mechanism) -> dict[str, Any]:
    """Freedoms, modes, where it gets, and how near it comes to being singular."""
    shape, count = closed_shape_of(mechanism), body_count(mechanism.tree)
    form = shape.closed_form
    flat = form is not None and form.is_planar
    reached = None if form is None else number(form.reachable)
    return {
        "mobility": shape.mobility,
        "freedoms_at_home": shape.freedoms,
        "grubler": {
            "planar": count.planar,
            "bodies": count.bodies,
            "joints": len(count.freedoms),
            "joint_freedoms": sum(count.freedoms),
            "internal": count.internal,
            "mobility": count.mobility,
        },
        "closed_form": None if form is None else {"of": form.name, **_numbers(form.dimensions)},
        "assembly_modes": None if form is None else form.modes,
        "working_modes": None if form is None else form.working,
        "share_closing": tidy(shape.share),
        "extents_mm": {axis: _mm(ends) for axis, ends in zip("xyz", shape.extents, strict=True)},
        "area_m2": reached if flat else None,
        "volume_m3": None if flat else reached,
        "closures_condition": dict(zip(("least", "middle", "largest"), map(number, shape.conditions), strict=True)),
        "singularities": None
        if form is None
        else [
            {
                "name": each.kind,
                "where": each.where,
                "distance": number(each.distance),
                "within_limits": each.distance < SINGULAR,
                "example": [tidy(value) for value in joint_values(mechanism.prismatic, each.joints)],
                "platform_mm": _mm(each.place),
            }
            for each in form.singularities
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
                [_mm(point) for point in value] if value.ndim else tidy(MM.of(float(value)))
            )
    return found


def _mm(lengths: Array) -> list[float]:
    return [tidy(value) for value in MM.of(lengths)]


def closed_blocks(values: Mapping[str, Any]) -> tuple[Block, ...]:
    """The joints, the frames and what closes the loops as tables, then the shape."""
    closers = [_counted(len(values[kind]), kind[:-1]) for kind in ("rods", "pins") if values[kind]]
    signs = {joint["name"]: joint["sign"] for joint in values["joints"]}
    joints = tuple((joint["name"], joint["offset"], *limits_and_speed(joint)) for joint in values["joints"])
    paths = [", ".join(_step_text(step, signs) for step in frame["path"]) or "–" for frame in values["frames"]]
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


def _step_text(step: dict[str, Any], signs: dict[str, int]) -> str:
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
    """Describe the dimensions of a closed form."""
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
