"""A measuring tour and compensated targets in URScript, the language of Universal Robots' controllers.

Joint positions are in rad, lengths in m, rotations as rotation vectors (The URScript Programming Language, Universal
Robots, "movej", "set_tcp", "pose").
"""

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.formats.programs.protocol import MeasuringTour, PathMoves, TargetMoves
from lab.formats.programs.reading.program_text import Outside, ProgramText
from lab.formats.programs.reading.spelling import ROTATION_VECTOR
from lab.formats.programs.reading.urscript import read_urscript
from lab.formats.programs.steps import (
    SixAxisLanguage,
    Step,
    move_notes,
    move_steps,
    numbers,
    path_notes,
    path_steps,
    tour_notes,
    tour_steps,
)

__all__ = ["UrScript"]

_DIGITS = 8  # of a rad: 10 nm at 1 m
_SPEED, _ACCELERATION = 0.5, 0.8  # rad/s, rad/s^2


class UrScript(SixAxisLanguage):
    """Scripts for robots with six revolute axes."""

    name = "URScript"
    suffix = ".script"
    reads = (".script", ".urscript")
    spelling = ROTATION_VECTOR
    makers = ("ur3", "ur5", "ur7", "ur8", "ur10", "ur12", "ur15", "ur16", "ur20", "ur30")
    speed = f"{_SPEED:g} rad/s"

    def read(self, text: str, outside: Outside) -> ProgramText:
        """The targets and moves of a program in it."""
        return read_urscript(text, outside)

    def measuring_tour(self, tour: MeasuringTour) -> bytes:
        """A function ``measure_poses``: home, every pose with a wait, home."""
        head = [
            *(f"  # {note}" for note in tour_notes(tour)),
            "  # Joint zeros and signs are the model's: compare one pose with the pendant before the first run.",
        ]
        return _script("measure_poses", head, tour_steps(tour))

    def target_moves(self, moves: TargetMoves) -> bytes:
        """A function ``move_to_targets`` through joint positions, with the tool and the frame that they are of."""
        head = [
            *(f"  # {note}" for note in move_notes(moves)),
            "  # Tool and frame suit the controller's nominal links best. They hold where its flange is the last frame",
            "  # of the lab's table, and its base is frame 0 of it.",
            f"  set_tcp({_pose(moves.T_last_tool)})",
            f"  global instrument_frame = {_pose(moves.T_frame0_instrument)}",
        ]
        return _script("move_to_targets", head, move_steps(moves))

    def path_moves(self, moves: PathMoves) -> bytes:
        """A function ``move_along_path``; poses are given by joint positions, from which the controller has them."""
        head = [
            *(f"  # {note}" for note in path_notes(moves)),
            "  # Joint zeros and signs are the model's: compare one pose with the pendant before the first run.",
            f"  set_tcp({_pose(moves.T_last_tool)})",
        ]
        return _script("move_along_path", head, path_steps(moves))


def _script(name: str, head: list[str], steps: list[Step]) -> bytes:
    lines = [f"def {name}():", *head]
    via = ""
    for step in steps:
        joints = f"[{', '.join(numbers(step.joints, _DIGITS))}]"
        lines.append(f"  # {step.words}")
        if step.kind == "via":
            via = joints
            continue
        lines.append(f"  {_move(step, joints, via)}")
        lines += [f'  textmsg("{step.words}")', f"  sleep({step.wait_s:.1f})"] if step.wait_s else []
    return ("\n".join([*lines, "end", f"{name}()"]) + "\n").encode("ascii")


def _move(step: Step, joints: str, via: str) -> str:
    """The instruction that goes to joint positions; a circle is given a speed, as it takes no time."""
    if step.pace is None:
        return f"movej({joints}, a={_ACCELERATION:g}, v={_SPEED:g})"
    if step.kind == "circle":
        return f"movec({via}, {joints}, v={step.pace.mm_s / 1e3:.4f}, mode=0)"
    return f"{'movel' if step.kind == 'line' else 'movej'}({joints}, t={step.pace.seconds:.4f})"


def _pose(matrix: Array) -> str:
    """A pose ``(4, 4)`` (m) as position and rotation vector."""
    values = np.concatenate([matrix[:3, 3], se3.log(matrix[:3, :3])])
    return f"p[{', '.join(numbers(values, _DIGITS))}]"
