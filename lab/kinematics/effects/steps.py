"""Steps within a campaign: a base, a tool or a joint's zero that moved between two poses.

The parameters are of the rows before a step: the arm without them is the one after the last step, which a user has now.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from lab.core.measurements import BEFORE
from lab.core.se3 import Array
from lab.kinematics.effects.effect import AXES, Effect, Moves, Step
from lab.kinematics.parameter import Parameter, joint_parameter, placed_parameters

__all__ = ["STEPS", "steps"]

STEPS = ("base_step", "tool_step", "joint_step")
"""What may have moved; each is the name of a group of parameters, too."""
_MOVES: dict[str, Moves] = {"base_step": "frame", "tool_step": "links", "joint_step": "joints"}
_FRAME, _TORSOR = 7, 6


def steps(found: Sequence[Step], joints: int) -> tuple[Effect, ...]:
    """Return the groups of what moved between the rows of a campaign; none where nothing did."""
    kinds = dict.fromkeys(step.kind for step in found)
    return tuple(_steps(kind, tuple(found), joints) for kind in kinds)


def _steps(kind: str, found: tuple[Step, ...], joints: int) -> Effect:
    """Return the group of all steps of one kind."""
    numbered = [(i, step) for i, step in enumerate(found, start=1) if step.kind == kind]
    parameters = tuple(each for i, step in numbered for each in _parameters(kind, i, step.joint))
    rows = {"base_step": _FRAME, "tool_step": _TORSOR, "joint_step": joints}[kind]
    offsets = partial(_offsets, [_directions(kind, rows, step.joint) for _, step in numbered])
    conditions = tuple(f"{BEFORE}{step.place!r}" for _, step in numbered)
    links = (joints - 1,) if kind == "tool_step" else ()
    again = partial(_steps, kind, found, joints)
    return Effect(kind, parameters, offsets, conditions, _MOVES[kind], links=links, made_by=again)


def _parameters(kind: str, number: int, joint: int) -> tuple[Parameter, ...]:
    if kind == "joint_step":
        return (joint_parameter(kind, joint, f"step{number}"),)
    axes = AXES if kind == "base_step" else AXES[:3]
    return placed_parameters(f"step{number}", kind, axes, scaled=True)


def _directions(kind: str, rows: int, joint: int) -> Array:
    """Return how the numbers ``(rows, c)`` of a motion follow a step's parameters."""
    if kind == "joint_step":
        return np.eye(rows)[:, joint : joint + 1]
    return np.eye(rows)[:, : 6 if kind == "base_step" else 3]


def _offsets(moved: Sequence[Array], _: Array, before: Array, values: Array) -> tuple[Array, Array]:
    """Return the motions ``(n, rows)`` before each step, and their derivatives."""
    columns = [before[:, i, None, None] * directions for i, directions in enumerate(moved)]
    derivative = np.concatenate(columns, axis=2)
    return derivative @ values, derivative
