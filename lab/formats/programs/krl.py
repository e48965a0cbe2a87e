"""A measuring tour and compensated targets in KRL, the language of KUKA's controllers (KR C).

Joint positions are in degrees, lengths in mm; of a frame A turns about z, B about the new y, C about the new x (KUKA
System Software, Operating and Programming Instructions for System Integrators, "FRAME").
"""

import re

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.formats.programs.protocol import MeasuringTour, PathMoves, TargetMoves
from lab.formats.programs.reading.krl import read_krl
from lab.formats.programs.reading.program_text import Outside, ProgramText
from lab.formats.programs.reading.spelling import MOVING_ZYX
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

__all__ = ["Krl"]

_DIGITS = 6
_PER_CENT = 20


class Krl(SixAxisLanguage):
    """Modules for robots with six revolute axes."""

    name = "KRL"
    suffix = ".src"
    reads = (".src", ".dat", ".sub")
    spelling = MOVING_ZYX
    makers = ("kuka", "kr", "agilus")
    speed = f"{_PER_CENT} % of the joints' speed"

    def read(self, text: str, outside: Outside) -> ProgramText:
        """The targets and moves of a program in it."""
        return read_krl(text, outside)

    def measuring_tour(self, tour: MeasuringTour) -> bytes:
        """A module ``measure_poses``: home, every pose with a wait, home."""
        head = [
            *(f"; {note}" for note in tour_notes(tour)),
            "; Axis zeros and signs are the model's: compare one pose with the pendant before the first run.",
            "; Declare the tool's load before.",
        ]
        return _module("measure_poses", head, [], tour_steps(tour))

    def target_moves(self, moves: TargetMoves) -> bytes:
        """A module ``move_to_targets`` through axis positions, with the tool and the base that they are of."""
        head = [
            *(f"; {note}" for note in move_notes(moves, "axes")),
            "; $TOOL and $BASE suit the controller's nominal links best. They hold where its flange is the last",
            "; frame of the lab's table, and its robot root is frame 0 of it. Declare the tool's load before.",
        ]
        frames = [f"$TOOL = {_frame(moves.T_last_tool)}", f"$BASE = {_frame(moves.T_frame0_instrument)}"]
        return _module("move_to_targets", head, frames, move_steps(moves))

    def path_moves(self, moves: PathMoves) -> bytes:
        """A module ``move_along_path``; lines and circles are of the tool in the base that the points are in."""
        head = [
            *(f"; {note}" for note in path_notes(moves)),
            "; Axis zeros and signs are the model's: compare one pose with the pendant before the first run.",
            "; $TOOL and $BASE hold where the flange is the last frame of the lab's table, and the robot root is",
            "; frame 0 of it. Declare the tool's load before.",
        ]
        frames = [f"$TOOL = {_frame(moves.T_last_tool)}", f"$BASE = {_frame(moves.T_frame0_base)}"]
        frames += ["$ORI_TYPE = #VAR", "$CIRC_TYPE = #BASE"]
        return _module("move_along_path", head, frames, path_steps(moves))


def _module(name: str, head: list[str], frames: list[str], steps: list[Step]) -> bytes:
    lines = [f"DEF {re.sub(r'[^A-Za-z0-9_]', '_', name)}()", *head, "BAS(#INITMOV, 0)", f"BAS(#VEL_PTP, {_PER_CENT})"]
    lines += frames
    via = ""
    for step in steps:
        lines.append(f"; {step.words}")
        if step.kind == "via":
            via = _place(step)
            continue
        lines += _move(step, via)
        lines += [f"WAIT SEC {step.wait_s:.1f}"] if step.wait_s else []
    return ("\r\n".join(["&ACCESS RVO", *lines, "END"]) + "\r\n").encode("ascii")


def _move(step: Step, via: str) -> list[str]:
    """The instructions that go to a stop, with the speed before."""
    if step.kind in ("line", "circle") and step.pace is not None:
        move = f"CIRC {via}, {_place(step)}" if step.kind == "circle" else f"LIN {_place(step)}"
        return [f"$VEL.CP = {step.pace.mm_s / 1e3:.4f}", move]
    axes = ", ".join(f"A{i} {each}" for i, each in enumerate(numbers(np.rad2deg(step.joints), _DIGITS), start=1))
    speed = [] if step.pace is None else [f"BAS(#VEL_PTP, {step.pace.per_cent})"]
    return [*speed, f"PTP {{AXIS: {axes}}}"]


def _place(step: Step) -> str:
    """Where the tool is at a stop."""
    assert step.T is not None
    return _frame(step.T)


def _frame(matrix: Array) -> str:
    """A pose ``(4, 4)`` (m) in mm and degrees."""
    places = numbers(1e3 * matrix[:3, 3], _DIGITS)
    turns = numbers(np.rad2deg(se3.roll_pitch_yaw(matrix[:3, :3])[::-1]), _DIGITS)
    return "{" + ", ".join(f"{key} {value}" for key, value in zip("XYZABC", [*places, *turns], strict=True)) + "}"
