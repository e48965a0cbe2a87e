"""The nominal model and the shape of a mechanism with loops, as plain values."""

from typing import Any

import numpy as np

from lab.commands.inspect.closed_shape import closed_shape_of
from lab.commands.values import joint_kind, joint_limits, joint_values, number, tidy
from lab.core.se3 import Array
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.closed.mobility import SINGULAR, body_count
from lab.kinematics.closed.structure import BASE, Step

__all__ = ["closed_nominal", "closed_shape"]


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
                [_mm(point) for point in value] if value.ndim else tidy(1e3 * float(value))
            )
    return found


def _mm(lengths: Array) -> list[float]:
    return [tidy(value) for value in 1e3 * lengths]
