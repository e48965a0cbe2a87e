"""A measuring tour and compensated targets as JBI, the jobs of Yaskawa Motoman's controllers in INFORM.

Joint positions of a job are motor pulses, whose number per degree is the controller's. So positions are Cartesian
(``///RECTAN``) by the nominal model: mm, and Rx, Ry, Rz in degrees about the fixed x, y and z. ``///RCONF`` says which
of the inverse's solutions is meant: wrist not flipped while joint 4 is within 90 degrees of zero, upper elbow, wrist
in front, and of joints 4, 6 and 1 whether they are within 180 degrees. Layout and ``RCONF`` follow the manuals NX100
"Interface with an Easy Offline Teaching System" (HW0481924, section 4.1) and DX100 (HW0482494); which half of joint 4
a manipulator calls flipped is in its own manual and could not be verified for each. No date is known here, so the
job's is the first of the century. Controllers take places to 0.001 mm and angles to 0.0001 degrees (YRC1000, Ethernet
function, position data); whether a job may have more is not known. No job was tried on a controller.
"""

from collections.abc import Sequence
from textwrap import wrap

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.formats.programs.postures import Postures
from lab.formats.programs.protocol import MeasuringTour, PathMoves, TargetMoves
from lab.formats.programs.reading.jbi import read_jbi
from lab.formats.programs.reading.program_text import Outside, ProgramText
from lab.formats.programs.reading.spelling import FIXED_XYZ
from lab.formats.programs.steps import (
    SixAxisLanguage,
    Step,
    ascii_words,
    checked_words,
    move_steps,
    numbers,
    path_steps,
    tour_steps,
)

__all__ = ["Jbi"]

_DIGITS_MM, _DIGITS_DEG = 3, 4
_PER_CENT = 20
_LONGEST = 32  # characters of a comment
_HALF, _QUARTER = np.pi, np.pi / 2
_NOTES = (
    "RCONF AS IN THE NX100 MANUAL",
    "FRAME 0 IS THE ROBOT FRAME",
    "COMPARE ONE POSE FIRST",
)


class Jbi(SixAxisLanguage):
    """Jobs for robots with six revolute axes."""

    name = "JBI"
    suffix = ".jbi"
    reads = (".jbi",)
    spelling = FIXED_XYZ
    most_digits = (_DIGITS_MM, _DIGITS_DEG)
    makers = ("motoman", "yaskawa", "gp", "hc", "mh")
    speed = f"{_PER_CENT} % of the joints' speed"

    def read(self, text: str, outside: Outside) -> ProgramText:
        """The targets and moves of a program in it."""
        return read_jbi(text, outside)

    def measuring_tour(self, tour: MeasuringTour) -> bytes:
        """A job ``PLAN``: home, every pose with a wait, home; of the flange (tool 0), in the robot's frame."""
        notes = [f"{len(tour.ids)} POSES OF THE FLANGE", "TOOL 0 HAS TO BE ZERO"]
        steps, postures = tour_steps(tour), _known(tour.postures)
        head = ["///TOOL 0", "///POSTYPE ROBOT"]
        return _job("PLAN", head, [*notes, *_checked(tour.checked)], steps, postures, postures.Ts_frame0_last)

    def target_moves(self, moves: TargetMoves) -> bytes:
        """A job ``PROGRAM`` in user frame 1 with tool 1; both as comments, to be entered by hand."""
        frames = [
            *(f"TOOL 1 {each}" for each in _frame(moves.T_last_tool)),
            *(f"USER 1 {each}" for each in _frame(moves.T_frame0_instrument)),
        ]
        postures = _known(moves.postures)
        Ts = se3.inverse(moves.T_frame0_instrument) @ postures.Ts_frame0_last @ moves.T_last_tool
        notes = [f"{len(moves.ids)} TARGETS", *_checked(moves.checked), *frames]
        head = ["///USER 1", "///TOOL 1", "///POSTYPE USER"]
        return _job("PROGRAM", head, notes, move_steps(moves), postures, Ts)

    def path_moves(self, moves: PathMoves) -> bytes:
        """A job ``PATH`` in user frame 1 with tool 1; a circle begins with the position that it starts at."""
        frames = [
            *(f"TOOL 1 {each}" for each in _frame(moves.T_last_tool)),
            *(f"USER 1 {each}" for each in _frame(moves.T_frame0_base)),
        ]
        correction = ["CORRECTION IS IN THE POSITIONS"] if moves.corrected else []
        notes = [f"{len(moves.ids)} POINTS", *correction, *_checked(moves.checked), *frames]
        head = ["///USER 1", "///TOOL 1", "///POSTYPE USER"]
        return _job("PATH", head, notes, path_steps(moves), _known(moves.postures), moves.Ts_base_tool)


def _known(postures: Postures | None) -> Postures:
    """The nominal arm's postures, which every arm with six revolute joints has."""
    assert postures is not None
    return postures


def _checked(checked: bool) -> list[str]:
    return wrap(checked_words(checked), _LONGEST)


def _job(name: str, head: list[str], notes: Sequence[str], steps: list[Step], postures: Postures, Ts: Array) -> bytes:
    """A job through poses ``(s, 4, 4)`` (m) of the tool."""
    lines = ["/JOB", f"//NAME {name}", "//POS", f"///NPOS {len(steps)},0,0,0,0,0", *head, "///RECTAN"]
    last = None
    for i, (step, T) in enumerate(zip(steps, Ts, strict=True)):
        configuration = _configuration(step.joints, bool(postures.in_front[i]), bool(postures.elbow_up[i]))
        lines += [f"///RCONF {configuration}"] if configuration != last else []
        lines.append(f"C{i:05d}={','.join(_place(T))}")
        last = configuration
    lines += ["//INST", "///DATE 2000/01/01 00:00", "///ATTR SC,RW", "///GROUP1 RB1", "NOP"]
    lines += [f"'{each}" for each in (*notes, *_NOTES)]
    for i, step in enumerate(steps):
        lines += [f"'{ascii_words(step.words)[: _LONGEST - 1]}", *_move(i, step)]
        lines += [f"TIMER T={step.wait_s:.2f}"] if step.wait_s else []
    return ("\r\n".join([*lines, "END"]) + "\r\n").encode("ascii")


def _move(number: int, step: Step) -> list[str]:
    """The instructions that go to a position; none to one that is passed on the circle to the next."""
    if step.kind == "via":
        return []
    if step.pace is None or step.kind == "joint":
        return [f"MOVJ C{number:05d} VJ={_PER_CENT if step.pace is None else step.pace.per_cent:.2f}"]
    speed = f"V={step.pace.mm_s:.1f}"
    circle = [f"MOVC C{i:05d} {speed}" for i in (number - 2, number - 1, number)]
    return circle if step.kind == "circle" else [f"MOVL C{number:05d} {speed}"]


def _configuration(joints: Array, in_front: bool, elbow_up: bool) -> str:
    """Flip, elbow, side, and whether joints 4, 6 and 1 are beyond half a turn; two that the format leaves unused."""
    within = abs((joints[3] + _HALF) % (2 * _HALF) - _HALF) <= _QUARTER
    far = [int(abs(joints[i]) >= _HALF) for i in (3, 5, 0)]
    return ",".join(map(str, [int(not within), int(not elbow_up), int(not in_front), *far, 0, 0]))


def _place(matrix: Array) -> list[str]:
    """A pose ``(4, 4)`` (m) in mm and degrees."""
    turns = np.rad2deg(se3.roll_pitch_yaw(matrix[:3, :3]))
    return [*numbers(1e3 * matrix[:3, 3], _DIGITS_MM), *numbers(turns, _DIGITS_DEG)]


def _frame(matrix: Array) -> list[str]:
    """A pose ``(4, 4)`` (m), a number to a comment: these are short."""
    return [f"{key} {value}" for key, value in zip(("X", "Y", "Z", "RX", "RY", "RZ"), _place(matrix), strict=True)]
