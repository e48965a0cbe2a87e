"""The nominal model and the shape of a serial arm, as plain values."""

from typing import Any

import numpy as np

from lab.commands.inspect.format import joint_kind, joint_limits, tidy
from lab.commands.inspect.serial_shape import LEAST, shape_of
from lab.kinematics.serial.chain import COLUMNS, Chain

__all__ = ["serial_nominal", "serial_shape"]


def serial_nominal(chain: Chain) -> dict[str, Any]:
    """The table, its convention, and limits."""
    return {"convention": chain.convention, "joints": [_joint(chain, i) for i in range(chain.size)]}


def serial_shape(chain: Chain) -> dict[str, Any]:
    """Reach, ways to a pose, the Jacobian's determinant, and an example of each singularity."""
    shape, names = shape_of(chain), chain.joint_names
    scale = np.where(chain.prismatic, 1e3, 180 / np.pi)
    return {
        "reach_mm": tidy(1e3 * shape.reach_m),
        "ways": shape.ways,
        "determinant": shape.determinant or None,
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


def _joint(chain: Chain, i: int) -> dict[str, Any]:
    """A joint's row of the table, with its limits."""
    cells = {
        f"{c}_{'mm' if c in 'da' else 'deg'}": tidy(chain.table[i, j] * (1e3 if c in "da" else 180 / np.pi))
        for j, c in enumerate(COLUMNS)
    }
    return {**joint_kind(chain, i), **cells, **joint_limits(chain, i)}
