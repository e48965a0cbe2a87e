"""A measuring tour and compensated targets in VAL 3, the language of Stäubli's controllers (CS8, CS9).

Joint positions are in degrees, lengths in mm; of a frame Rx turns about x, Ry about the new y, Rz about the new z
(VAL 3 Reference Manual, Stäubli, "trsf type"). The file is a program of an application, to be added to one that has
the usual motion descriptor mNomSpeed; its layout is that of programs in public, and the file says so.
"""

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.formats.programs.protocol import MeasuringTour, PathMoves, TargetMoves
from lab.formats.programs.reading.program_text import Outside, ProgramText
from lab.formats.programs.reading.spelling import MOVING_XYZ
from lab.formats.programs.reading.val3 import read_val3
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

__all__ = ["Val3"]

_DIGITS = 6
_SPACE = "http://www.staubli.com/robotics/VAL3/Program/2"
_INSTANCE = "http://www.w3.org/2001/XMLSchema-instance"
_NOTE = "  // The layout of this file follows public programs: add it to an application that has mNomSpeed."


class Val3(SixAxisLanguage):
    """Programs for robots with six revolute axes."""

    name = "VAL3"
    suffix = ".pgx"
    reads = (".pgx", ".dtx")
    spelling = MOVING_XYZ
    makers = ("staubli", "tx", "tx2", "rx")
    speed = "mNomSpeed"

    def read(self, text: str, outside: Outside) -> ProgramText:
        """The targets and moves of a program in it."""
        return read_val3(text, outside)

    def measuring_tour(self, tour: MeasuringTour) -> bytes:
        """A program ``measurePoses``: home, every pose with a wait, home."""
        head = [
            *(f"  // {note}" for note in tour_notes(tour)),
            "  // Joint zeros and signs are the model's: compare one pose with the pendant before the first run.",
        ]
        return _program("measurePoses", {"jTo": "joint"}, head, tour_steps(tour))

    def target_moves(self, moves: TargetMoves) -> bytes:
        """A program ``moveToTargets`` through joint positions, with the tool and the frame that they are of."""
        head = [
            *(f"  // {note}" for note in move_notes(moves)),
            "  // Tool and frame suit the controller's nominal links best. They hold where its flange is the last",
            "  // frame of the lab's table, and its world is frame 0 of it.",
            f"  trTool={_frame(moves.T_last_tool)}",
            f"  trFrame={_frame(moves.T_frame0_instrument)}",
        ]
        local = {"jTo": "joint", "trTool": "trsf", "trFrame": "trsf"}
        return _program("moveToTargets", local, head, move_steps(moves))

    def path_moves(self, moves: PathMoves) -> bytes:
        """A program ``moveAlongPath``; points of lines and circles are made from joint positions by the controller."""
        head = [
            *(f"  // {note}" for note in path_notes(moves)),
            "  // Joint zeros and signs are the model's: compare one pose with the pendant before the first run.",
            f"  tPath.trsf={_frame(moves.T_last_tool)}",
            "  mPath=mNomSpeed",
        ]
        local = {"jTo": "joint", "pVia": "point", "pTo": "point", "tPath": "tool", "mPath": "mdesc"}
        return _program("moveAlongPath", local, head, path_steps(moves))


def _program(name: str, local: dict[str, str], head: list[str], steps: list[Step]) -> bytes:
    lines = ["begin", *head, _NOTE]
    for step in steps:
        joints = ",".join(numbers(np.rad2deg(step.joints), _DIGITS))
        lines += [f"  // {step.words}", f"  jTo={{{joints}}}", *(f"  {each}" for each in _move(step))]
        lines += [f"  delay({step.wait_s:.1f})"] if step.wait_s else []
    code = "\n".join([*lines, "end"])
    variables = [f'      <Local name="{key}" type="{kind}" xsi:type="array" size="1" />' for key, kind in local.items()]
    text = [
        '<?xml version="1.0" encoding="utf-8" ?>',
        f'<Programs xmlns:xsi="{_INSTANCE}" xmlns="{_SPACE}">',
        f'  <Program name="{name}">',
        "    <Locals>",
        *variables,
        "    </Locals>",
        f"    <Code><![CDATA[{code}]]></Code>",
        "  </Program>",
        "</Programs>",
    ]
    return ("\n".join(text) + "\n").encode("ascii")


def _move(step: Step) -> list[str]:
    """The instructions that go to ``jTo``, or keep it as the point that a circle passes."""
    if step.kind == "via":
        return ["pVia=jointToPoint(tPath,world,jTo)"]
    if step.pace is None:
        return ["movej(jTo,flange,mNomSpeed)", "waitEndMove()"]
    if step.kind == "joint":
        return [f"mPath.vel={step.pace.per_cent}", "movej(jTo,flange,mPath)", "waitEndMove()"]
    move = "movec(pVia,pTo,tPath,mPath)" if step.kind == "circle" else "movel(pTo,tPath,mPath)"
    return [
        "mPath.vel=100",
        f"mPath.tvel={step.pace.mm_s:.2f}",
        "pTo=jointToPoint(tPath,world,jTo)",
        move,
        "waitEndMove()",
    ]


def _frame(matrix: Array) -> str:
    """A pose ``(4, 4)`` (m) in mm and degrees: R = Rx Ry Rz is the inverse of a roll, pitch and yaw turned back."""
    back = se3.roll_pitch_yaw(matrix[:3, :3].T)
    values = [*(1e3 * matrix[:3, 3]), *np.rad2deg(-back)]
    return "{" + ",".join(numbers(values, _DIGITS)) + "}"
