"""The nominal model and the shape of a serial arm, as plain values."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from lab.commands.inspect.serial_shape import LEAST, shape_of
from lab.commands.values import joint_kind, joint_limits, tidy
from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.mobility import mobility_of
from lab.kinematics.serial.chain import COLUMNS, Chain
from lab.kinematics.serial.khalil_frames import ANGULAR, khalil_frame

__all__ = ["serial_frames", "serial_nominal", "serial_shape"]


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
        "reach_mm": tidy(1e3 * shape.reach_m),
        "ways": shape.ways,
        "freedoms": _freedoms(chain),
        "determinant": shape.determinant or None,
        "determinant_of": shape.moved or None,
        "singularities": [
            {
                "name": each.factor.name,
                "where": each.factor.text,
                "example": None if each.joints is None else [tidy(value) for value in each.joints * scale],
                "free": [
                    {name: tidy(part) for name, part in zip(names, parts, strict=True) if abs(part) > LEAST}
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
        "missing_displacements": len(found.held),
        "missing_turns": len(found.still),
    }


def _joint(chain: Chain, i: int) -> dict[str, Any]:
    """A joint's row of the table, with its limits."""
    cells = {
        f"{c}_{'mm' if c in 'da' else 'deg'}": tidy(chain.table[i, j] * (1e3 if c in "da" else 180 / np.pi))
        for j, c in enumerate(COLUMNS)
    }
    return {**joint_kind(chain, i), **cells, **joint_limits(chain, i)}
