"""Read off an arm's points where the frame is that carries them: for sensors of whole poses, cameras and boards.

A target's position t in the last frame enters its measured position as o + R t: it moves by the frame's axes where t is
moved by one. So every model of points gives the frame of its tip, whatever effects it has.
"""

from collections.abc import Sequence

import numpy as np

from lab.core.se3 import Array
from lab.kinematics.gauge import placed_after_tool, scale_link
from lab.kinematics.model import Model
from lab.kinematics.parameter import Parameter

__all__ = ["longest_link", "tip_columns", "tip_frames", "tip_origins", "tip_rates", "tip_rotations", "with_tip"]


def tip_columns(arm: Model, target: int = 0) -> list[int]:
    """Return the indices of a target's three coordinates in its last frame."""
    name = arm.targets[target]
    return [i for i, each in enumerate(arm.parameters) if _locates(each, name)]


def _locates(parameter: Parameter, target: str) -> bool:
    return parameter.group == "tool" and parameter.target == target


def tip_rotations(arm: Model, inputs: Array, values: Array, points: Array, target: int = 0) -> Array:
    """Return the rotations ``(n, 3, 3)`` of the frame that carries a target, in the instrument's frame.

    Args:
        arm: the arm, measured by points.
        inputs: ``(n, joints + conditions)``.
        values: ``(p,)``.
        points: ``(n, k, 3)`` of the arm at ``values``.
        target: whose frame.
    """
    moved = [arm.points(inputs, there)[:, target] - points[:, target] for there in _moved_tools(arm, values, target)]
    stretched = np.stack(moved, axis=2)
    return np.asarray(stretched / np.sqrt((stretched**2).sum(axis=1, keepdims=True)))


def tip_origins(arm: Model, values: Array, points: Array, rotations: Array, target: int = 0) -> Array:
    """Return the origins ``(n, 3)`` m of the frames of ``tip_rotations``, in the instrument's frame."""
    return np.asarray(points[:, target] - rotations @ values[tip_columns(arm, target)])


def _moved_tools(arm: Model, values: Array, target: int) -> list[Array]:
    """Return the parameters with a target moved by one along each axis of its last frame."""
    return [values + np.eye(len(values))[column] for column in tip_columns(arm, target)]


def tip_rates(arm: Model, inputs: Array, values: Array, jacobian: Array, target: int = 0) -> tuple[Array, Array]:
    """Return the rotations ``(n, 3, 3)`` of a target's frame and their rates ``(n, 3, p)``, in the instrument's frame.

    The derivatives by t are the frame's axes r, and where t is moved by one axis's unit, every other derivative changes
    by dr. A rotation w makes dr = w x r, so w = (1/2) sum r x dr over the three axes.

    Args:
        arm: the arm, measured by points.
        inputs: ``(n, joints + conditions)``.
        values: ``(p,)``.
        jacobian: ``(n, k, 3, p)`` of the arm at ``values``.
        target: whose frame.
    """
    stretched = jacobian[:, target][..., tip_columns(arm, target)]
    size = np.sqrt((stretched**2).sum(axis=1, keepdims=True))  # 1, but in a frame that grows
    rotation = stretched / size
    rates = np.zeros((len(inputs), 3, len(values)), dtype=jacobian.dtype)
    for axis, moved in enumerate(_moved_tools(arm, values, target)):
        change = arm.observe(inputs, moved)[1][:, target] - jacobian[:, target]
        r = 0.5 * rotation[..., axis] / size[..., axis]
        for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
            rates[:, i] += r[:, j, None] * change[:, k] - r[:, k, None] * change[:, j]
    return rotation, rates


def tip_frames(arm: Model, inputs: Array, values: Array, target: int = 0) -> tuple[Array, Array, Array, Array]:
    """Return origins ``(n, 3)`` and rotations ``(n, 3, 3)`` of a target's frame, with the rates ``(n, 3, p)`` of each.

    Rates are the origin's velocity and the frame's angular velocity by each parameter, in the instrument's frame.
    """
    points, jacobian = arm.observe(inputs, values)
    rotation, turning = tip_rates(arm, inputs, values, jacobian, target)
    columns = tip_columns(arm, target)
    lever = rotation @ values[columns]
    moving = jacobian[:, target] - np.cross(turning, lever[:, :, None], axis=1)
    moving[..., columns] = 0.0
    return points[:, target] - lever, rotation, moving, turning


def with_tip(arm: Model, carried: Sequence[int], *, unsized: bool) -> tuple[int, ...]:
    """Return an arm's order of preference with what its tips carry after the target.

    Args:
        carried: indices of parameters that tips carry.
        unsized: whether nothing shows the arm's size: its longest link comes after these, so that it stays nominal.
    """
    return placed_after_tool(arm.parameters, arm.column_priority(), carried, longest_link(arm) if unsized else None)


def longest_link(arm: Model) -> int:
    """Return the index of the arm's longest nominal length, which stays nominal where nothing shows the arm's size."""
    return scale_link(arm, np.array([each.nominal for each in arm.parameters]))
