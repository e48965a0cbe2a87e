"""Steps within a campaign: a base, a tool or a joint's zero that moved between two poses.

The parameters are of the rows before a step: the arm without them is the one after the last step, which a user has now.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from lab.core.errors import LabError, option_name
from lab.core.measurements import BEFORE
from lab.core.se3 import Array
from lab.kinematics.effects.effect import AXES, ArmFacts, Effect, FittedGroup, Moves, SimulatedEffect, VirtualEffect
from lab.kinematics.parameter import Parameter, joint_parameter, placed_parameters

__all__ = ["STEP_GROUPS", "Steps"]

STEP_GROUPS = {"base_step": "base_steps", "tool_step": "tool_steps", "joint_step": "joint_steps"}
"""Fitted groups of steps by what moved."""
_MOVES: dict[str, Moves] = {"base_step": "frame", "tool_step": "links", "joint_step": "joints"}
_FRAME, _TORSOR = 7, 6


def _fitted(kind: str, arm: ArmFacts) -> Effect:
    """Return the fitted group of all steps of one kind."""
    numbered = [(i, step) for i, step in enumerate(arm.sessions.steps, start=1) if step.kind == kind]
    if not numbered:
        raise LabError(f"{option_name('model')} {STEP_GROUPS[kind]}: no such step was found in these measurements")
    group = STEP_GROUPS[kind]
    parameters = tuple(each for i, step in numbered for each in _parameters(group, kind, i, step.joint))
    rows = {"base_step": _FRAME, "tool_step": _TORSOR, "joint_step": arm.chain.size}[kind]
    offsets = partial(_offsets, [_directions(kind, rows, step.joint) for _, step in numbered])
    conditions = tuple(f"{BEFORE}{step.place!r}" for _, step in numbered)
    links = (arm.chain.size - 1,) if kind == "tool_step" else ()
    return Effect(group, parameters, offsets, conditions, _MOVES[kind], links=links)


def _parameters(group: str, kind: str, number: int, joint: int) -> tuple[Parameter, ...]:
    if kind == "joint_step":
        return (joint_parameter(group, joint, f"step{number}"),)
    axes = AXES if kind == "base_step" else AXES[:3]
    return placed_parameters(f"step{number}", group, axes, scaled=True)


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


@dataclass(frozen=True)
class Steps(VirtualEffect):
    """Steps of a campaign, which the diagnosis finds in its rows; a virtual arm has ``Bump``."""

    groups: ClassVar[tuple[FittedGroup, ...]] = tuple(
        FittedGroup(group, partial(_fitted, kind), "found by the diagnosis", of_one_campaign=True, is_candidate=False)
        for kind, group in STEP_GROUPS.items()
    )

    def simulated(self, arm: ArmFacts, rngs: Sequence[np.random.Generator]) -> SimulatedEffect | None:
        """Return no effect."""
        return None
