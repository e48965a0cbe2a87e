"""A measuring tour and compensated targets as LS, the listing of FANUC's TP programs that controllers load.

Joint positions are in degrees with three decimals, as controllers print them; lengths in mm; W, P and R turn about the
fixed x, y and z. The layout is that of listings in public; which options a controller needs to load one is not known
here, and the file says so.
"""

from textwrap import wrap

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.formats.programs.protocol import MeasuringTour, PathMoves, TargetMoves
from lab.formats.programs.reading.fanuc import read_fanuc
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

__all__ = ["FanucLs"]

_DIGITS = 3
_PER_CENT = 20
_LONGEST = 32  # characters of a comment
_NOTES = (
    "LOADING MAY TAKE AN OPTION",
    "J3 COUNTS AS IN THE MODEL",
    "COMPARE ONE POSE FIRST",
)


class FanucLs(SixAxisLanguage):
    """Listings for robots with six revolute axes."""

    name = "FANUC"
    suffix = ".ls"
    reads = (".ls",)
    spelling = FIXED_XYZ
    most_digits = (_DIGITS, _DIGITS)
    makers = ("fanuc", "lrmate", "crx", "m10", "m20", "m710", "m900", "r2000")
    speed = f"{_PER_CENT} % of the joints' speed"

    def read(self, text: str, outside: Outside) -> ProgramText:
        """The targets and moves of a program in it."""
        return read_fanuc(text, outside)

    def measuring_tour(self, tour: MeasuringTour) -> bytes:
        """A program ``MEASURE_POSES``: home, every pose with a wait, home."""
        return _listing("MEASURE_POSES", [f"{len(tour.ids)} POSES"], tour.checked, tour_steps(tour))

    def target_moves(self, moves: TargetMoves) -> bytes:
        """A program ``MOVE_TO_TARGETS`` through joint positions; tool and frame as comments, to be entered by hand."""
        frames = [
            *(f"UTOOL {each}" for each in _frame(moves.T_last_tool)),
            *(f"UFRAME {each}" for each in _frame(moves.T_frame0_instrument)),
        ]
        return _listing("MOVE_TO_TARGETS", [f"{len(moves.ids)} TARGETS", *frames], moves.checked, move_steps(moves))

    def path_moves(self, moves: PathMoves) -> bytes:
        """A program ``MOVE_ALONG_PATH``; its positions are joint positions on lines and circles, too."""
        notes = [f"{len(moves.ids)} POINTS", *(f"UTOOL {each}" for each in _frame(moves.T_last_tool))]
        notes += ["CORRECTION IS IN THE JOINTS"] if moves.corrected else []
        return _listing("MOVE_ALONG_PATH", notes, moves.checked, path_steps(moves))


def _listing(name: str, notes: list[str], checked: bool, steps: list[Step]) -> bytes:
    lines = [f"!{each}" for each in (*notes, *wrap(checked_words(checked), _LONGEST), *_NOTES)]
    for i, step in enumerate(steps, start=1):
        lines.append(f"!{ascii_words(step.words)}")
        if step.kind != "via":
            lines.append(_move(i, step))
        lines += [f"WAIT {step.wait_s:6.2f}(sec)"] if step.wait_s else []
    numbered = [f"{i:4d}:{'' if line[0] in 'JLC' else '  '}{line} ;" for i, line in enumerate(lines, start=1)]
    head = [f"/PROG  {name}", "/ATTR", 'COMMENT = "lab";', f"LINE_COUNT = {len(numbered)};"]
    head += ["DEFAULT_GROUP = 1,*,*,*,*;", "/MN"]
    positions = [_position(i, step.joints) for i, step in enumerate(steps, start=1)]
    return ("\r\n".join([*head, *numbered, "/POS", *positions, "/END"]) + "\r\n").encode("ascii")


def _move(number: int, step: Step) -> str:
    """The instruction that goes to a position; that of a circle takes two rows."""
    if step.pace is None:
        return f"J P[{number}] {_PER_CENT}% FINE"
    took = f"{max(int(np.ceil(1e3 * step.pace.seconds)), 1)}msec FINE"
    if step.kind == "circle":
        return f"C P[{number - 1}]\r\n    :  P[{number}] {took}"
    return f"{'L' if step.kind == 'line' else 'J'} P[{number}] {took}"


def _position(number: int, joints: Array) -> str:
    angles = [f"\tJ{i}= {each:>9} deg" for i, each in enumerate(numbers(np.rad2deg(joints), _DIGITS), start=1)]
    rows = [",".join(angles[:3]) + ",", ",".join(angles[3:])]
    return "\r\n".join([f"P[{number}]{{", "   GP1:", "\tUF : 0, UT : 1,", *rows, "};"])


def _frame(matrix: Array) -> list[str]:
    """A pose ``(4, 4)`` (m) in mm and degrees, a number to a comment: these are short."""
    places = numbers(1e3 * matrix[:3, 3], _DIGITS)
    turns = numbers(np.rad2deg(se3.roll_pitch_yaw(matrix[:3, :3])), _DIGITS)
    return [f"{key} {value}" for key, value in zip("XYZWPR", [*places, *turns], strict=True)]
