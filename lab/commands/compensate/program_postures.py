"""Which of the inverse's solutions a program asks for, and whether the ways between its targets are free."""

from collections.abc import Sequence
from functools import partial
from itertools import pairwise, product

import numpy as np

from lab.core import se3
from lab.core.kept_pieces import Columns, Keep, at_once
from lab.core.progress import Progress, no_progress
from lab.core.se3 import Array
from lab.formats.programs.postures import ArmShape
from lab.formats.programs.program_text import Move, TargetText
from lab.kinematics.inverse.branches import NominalInverse, nearest_whole_turns
from lab.kinematics.inverse.newton import PoseTarget
from lab.kinematics.joints import JointSpec
from lab.pose_selection.tour import FreePath
from lab.simulation.collisions import collides, collisions_in_words
from lab.simulation.free_path import path_check
from lab.simulation.model import RobotModel

__all__ = ["asked_for", "ways_touched"]

_REACHED_M = 1e-6  # a pose that a solution misses by less is reached
_STEP_M, _STEP_RAD = 0.01, np.deg2rad(2.0)  # along a line of the tool, between two looks
_MOST_LOOKS = 400
_BLOCK = 200  # ways that are looked at, and kept, together
_LOOKED_AGAIN = 200  # along a way of all joints that is not free, for words
_JUMP_RAD = 0.5  # of a joint between two looks on a line: it passes a singularity


def asked_for(
    nominal: NominalInverse, wanted: PoseTarget, targets: Sequence[TargetText]
) -> tuple[Array, dict[int, str]]:
    """The joint positions at which the controller's arm is at each target, as far as the text says it.

    Of the solutions that have the configuration that is asked for, the nearest to the target before; where none is
    asked for, the nearest of all.

    Args:
        wanted: of the measured point, in the instrument's frame.

    Returns:
        ``(n, 6)`` rad, NaN where no solution reaches the target; and why some have none, by row.
    """
    chain = nominal.arm.chain
    found, refused = np.full((len(targets), chain.size), np.nan), dict[int, str]()
    if not targets:
        return found, refused
    nominal_chain = nominal.arm.dh_chain(nominal.values)
    assert nominal_chain is not None
    shape, last = ArmShape.of(nominal_chain), chain.home
    ways = nominal.ways(wanted, np.broadcast_to(chain.home, found.shape))
    for i, target in enumerate(targets):
        if target.spelling is None:
            found[i] = last = target.joints
            continue
        some = ways.joints[i][ways.gap_m[i] < _REACHED_M]
        if target.allowed is None:
            some = np.concatenate([some, _from(nominal, wanted.take(np.array([i])), last)])
        if not len(some):
            continue
        turned = _with_turns(chain, some)
        turned = turned[~chain.beyond_limits(turned, 1e-9).any(axis=1)]
        fits = turned if target.allowed is None else turned[target.allowed(shape, turned)]
        if not len(fits):
            refused[i] = (
                f"{target.name}: no solution of the nominal arm within its limits has the configuration that the text "
                "asks for; are joint zeros and signs those of the controller?"
            )
            continue
        found[i] = last = fits[np.abs(fits - last).max(axis=1).argmin()]
    return found, refused


def _from(nominal: NominalInverse, wanted: PoseTarget, start: Array) -> Array:
    """The solution ``(0 or 1, 6)`` to which Newton's method leads from joint positions."""
    joints, _ = nominal.again(wanted, start[None], np.array([-1]))
    missed = np.linalg.norm(wanted.errors(nominal.tool(joints)[0])[0])
    return joints if missed < _REACHED_M else joints[:0]


def _with_turns(chain: JointSpec, joints: Array) -> Array:
    """Joint positions ``(k, n)``, and those a whole turn of some joints away."""
    wide = [
        (0.0,) if slides or upper - lower < 2 * np.pi else (-2 * np.pi, 0.0, 2 * np.pi)
        for slides, lower, upper in zip(chain.prismatic, chain.lower, chain.upper, strict=True)
    ]
    turns = np.array(list(product(*wide)))
    return np.asarray((joints[:, None] + turns).reshape(-1, chain.size))


def ways_touched(
    model: RobotModel,
    nominal: NominalInverse,
    joints: Array,
    moves: Sequence[Move],
    names: Sequence[str],
    progress: Progress = no_progress,
    keep: Keep = at_once,
) -> tuple[tuple[int, str], ...]:
    """What the arm touches on the moves from target to target in the order of the text, by line.

    Args:
        joints: ``(t, 6)`` rad at each target of the text, corrected or as it stays; NaN where they are not known.
        names: of the targets.
        progress: told how many ways were looked at.
        keep: how what was found on them is kept.
    """
    free, pairs, found = path_check(model), list(pairwise(moves)), list[tuple[int, str]]()

    def touched(first: int) -> Columns:
        said = list[tuple[int, str]]()
        for done, (before, move) in enumerate(pairs[first : first + _BLOCK], start=first):
            progress(done, len(pairs))
            start, end = joints[before.target], joints[move.target]
            if not np.isfinite([start, end]).all() or before.target == move.target:
                continue
            line = move.motion == "line"
            words = _on_line(model, nominal, start, end) if line else _of_joints(model, free, start, end)
            if words:
                said.append((move.line, f"on the way from {names[before.target]} to {names[move.target]}, {words}"))
        lines, texts = [line for line, _ in said], [words for _, words in said]
        return {"lines": np.array(lines, dtype=np.int_), "texts": np.array(texts, dtype=np.str_)}

    for first in range(0, len(pairs), _BLOCK):
        piece = keep("program", [np.array([first]), joints], partial(touched, first))
        found += zip(piece["lines"].tolist(), piece["texts"].tolist(), strict=True)
    return tuple(found)


def _of_joints(model: RobotModel, free: FreePath, start: Array, end: Array) -> str:
    """What is touched on a straight line of all joints; "" if nothing is."""
    if free(start, end):
        return ""
    looks = start + np.linspace(0, 1, _LOOKED_AGAIN)[:, None] * (end - start)
    return next((words for words in collisions_in_words(model, looks) if words), "something is touched")


def _on_line(model: RobotModel, nominal: NominalInverse, start: Array, end: Array) -> str:
    """What is touched while the tool moves on a straight line; "" if nothing is."""
    looks = _line_of_tool(nominal, start, end)
    even = np.abs(np.diff(looks, axis=0)).max() <= _JUMP_RAD and np.abs(looks[-1] - end).max() <= _JUMP_RAD
    if not even:
        return "a straight line of the tool leads through a singularity or out of reach"
    touched = collides(model, looks)
    return next(iter(collisions_in_words(model, looks[touched][:1])), "")


def _line_of_tool(nominal: NominalInverse, start: Array, end: Array) -> Array:
    """Joint positions ``(k, 6)`` rad on the way of a tool that moves and turns evenly from one pose to another.

    Of the nominal arm's solutions the nearest to those before, in closed form where there is one; NaN where none is.
    """
    T_start, T_end = nominal.tool(np.array([start, end]))[0]
    turn = se3.log(T_start[:3, :3].T @ T_end[:3, :3])
    along = T_end[:3, 3] - T_start[:3, 3]
    steps = max(np.linalg.norm(along) / _STEP_M, np.linalg.norm(turn) / _STEP_RAD, 1.0)
    shares = np.linspace(0, 1, min(int(np.ceil(steps)), _MOST_LOOKS) + 1)
    wanted = PoseTarget(T_start[:3, 3] + shares[:, None] * along, T_start[:3, :3] @ se3.exp(shares[:, None] * turn))
    found = start + shares[:, None] * (end - start)
    if nominal.closed_form is None:
        return nominal.again(wanted, found, np.full(len(found), -1))[0]
    ways = nominal.ways(wanted, found)
    last = start
    for i, some in enumerate(ways.joints):
        turned = nearest_whole_turns(nominal.arm.chain, some[ways.gap_m[i] < _REACHED_M], last)
        found[i] = last = (
            turned[np.abs(turned - last).max(axis=1).argmin()] if len(turned) else np.full_like(start, np.nan)
        )
    return found
