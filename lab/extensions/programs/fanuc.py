"""Write and read LS, the listing of FANUC's TP programs that controllers load.

Lengths are in mm; W, P and R turn about the fixed x, y and z. Joint positions are written in degrees with three
decimals, as controllers print them. The layout is that of public listings; the options that a controller needs to load
one are not known here, and a comment in the file states so. Joint 3 counts as in the model.

Listings are read for the positions behind ``/POS``. UF and UT number the user frame and the tool, which the controller
stores; 0 is none. The third letter of CONFIG is the side of axis 1 on which the wrist is (T in front, B behind), and
the numbers are the turns of axes 1, 4 and 6 (0 within half a turn). Public sources disagree on N, F, U and D, so these
are not used: of the remaining IK solutions the nearest to the position before is taken.
"""

import re
from dataclasses import dataclass, field
from textwrap import wrap

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.extensions.programs import language
from lab.formats.programs.program_text import (
    FIXED_XYZ,
    NUMBER,
    Allowed,
    ArmShape,
    Motion,
    Number,
    Outside,
    ProgramReader,
    ProgramText,
    TargetText,
    Uncorrected,
    line_of,
    masked,
    whole_number,
)
from lab.formats.programs.protocol import PROGRAM, MeasuringTour, PathMoves, TargetMoves

__all__ = ["FanucLs"]

_POSITION = re.compile(r'\bP\[(\d+)(?:\s*:\s*"[^"\r\n]*")?\s*\]\s*\{(.*?)(?:\}\s*;|(\Z))', re.DOTALL)
_GROUP = re.compile(r"\bGP(\d+)\s*:(.*?)(?=\bGP\d+\s*:|\Z)", re.DOTALL)
_FIELD = re.compile(rf"\b(X|Y|Z|W|P|R|J[1-6])\s*=\s*({NUMBER})\s*(?:mm|deg)")
_CONFIG = re.compile(r"CONFIG\s*:\s*'\s*(?:\w\s*(?:,\s*)?)*?([TB])\s*,\s*(-?\d+)\s*,\s*(-?\d+)\s*,\s*(-?\d+)")
_FRAMES = re.compile(r"UF\s*:\s*(\w+)\s*,\s*UT\s*:\s*(\w+)")
_REACHED = r"(P|PR)\[(?:([^\]]*)\]([^;]*)|[^\]]*\Z)"  # the last where no bracket closes any more
_MOVE = re.compile(rf"^[^\S\n]*\d*:\s*([JLCAS])\s+{_REACHED}", re.MULTILINE)
_SECOND = re.compile(rf"^[^\S\n]*(?:\d*:\s*)?:\s*{_REACHED}", re.MULTILINE)
_PLACE, _JOINTS = tuple("XYZWPR"), tuple(f"J{i}" for i in range(1, 7))
_SLACK_RAD = np.deg2rad(0.05)


@dataclass
class _FanucReader(ProgramReader):
    """Reader of a listing."""

    code: str
    reached: dict[str, list[tuple[int, Motion]]] = field(default_factory=dict)
    relative: set[str] = field(default_factory=set)

    def read(self) -> ProgramText:
        self.frames = {name: np.eye(4) for name in ("UFRAME[0]", "UTOOL[0]")} | self.outside.posed(FIXED_XYZ)
        end = self.code.find("/POS")
        for match in _MOVE.finditer(self.code, 0, len(self.code) if end < 0 else end):
            self._move(match[1], match[2], match[3], match[4], match.start(1))
        for match in _SECOND.finditer(self.code, 0, len(self.code) if end < 0 else end):
            self._move("C", match[1], match[2], match[3], match.start(1))
        for match in _POSITION.finditer(self.code, max(end, 0)):
            number = whole_number(match[1])
            target = self._target(number, match[2], match.start(2)) if match[3] is None else None
            if target is not None:
                self._add(target, self.reached.get(number, ()))
        return self._read()

    def _move(self, kind: str, what: str, number: str | None, options: str, at: int) -> None:
        if number is None:
            return
        name, plain = f"{what}[{number}]", re.match(r"\s*(\d+)\s*(?::|$)", number)
        if what == "PR" or not plain:
            self._leave(at, f"{name} is a register, or numbered by one: it is computed")
            return
        if re.search(r"\bINC\b", options):
            self.relative.add(whole_number(plain[1]))
            self._leave(at, f"{name} is relative (INC): it stays")
            return
        if offset := re.search(r"\b(Offset|Tool_Offset|VOFFSET|SOFT_FLOAT|COORD)\b", options, re.IGNORECASE):
            self._leave(at, f"{name} is moved with {offset[1]}, which stays; the position itself is corrected")
        motion: Motion = "joints" if kind == "J" else "line"
        self.reached.setdefault(whole_number(plain[1]), []).append((line_of(self.text, at), motion))

    def _target(self, number: str, content: str, at: int) -> TargetText | None:
        name, line = f"P[{number}]", line_of(self.text, at)
        if number in self.relative:
            return None
        inner, parts = _first_group(content, at)
        if set(_JOINTS) <= set(parts):
            return TargetText(name, line, tuple(parts[key] for key in _JOINTS))
        frames = _FRAMES.search(inner)
        if not set(_PLACE) <= set(parts) or not frames:
            self.uncorrected.append(Uncorrected(line, f"{name} has not six numbers"))
            return None
        base, tool = self.outside.alias(f"UFRAME[{frames[1]}]"), self.outside.alias(f"UTOOL[{frames[2]}]")
        numbers = tuple(parts[key] for key in _PLACE)
        return TargetText(name, line, numbers, FIXED_XYZ, tool, base, allowed=_allowed(inner))


def _first_group(content: str, at: int) -> tuple[str, dict[str, Number]]:
    """Return the text of motion group 1, or of all where groups are not named, and its named numbers."""
    group = next((match for match in _GROUP.finditer(content) if match[1] == "1"), None)
    begin, inner = (at + group.start(2), group[2]) if group else (at, content)
    return inner, {part[1]: Number(begin + part.start(2), part[2]) for part in _FIELD.finditer(inner)}


def _allowed(inner: str) -> Allowed | None:
    """Return the test of the side of axis 1, and of the turns of axes 1, 4 and 6."""
    match = _CONFIG.search(inner)
    if not match:
        return None
    in_front, turns = match[1] == "T", [float(turn) for turn in match.groups()[1:]]

    def allowed(shape: ArmShape, joints: Array) -> NDArray[np.bool_]:
        fits = shape.in_front(joints) == in_front
        for axis, turn in zip((0, 3, 5), turns, strict=True):
            fits &= np.abs(joints[:, axis] - 2 * np.pi * turn) <= np.pi + _SLACK_RAD
        return np.asarray(fits)

    return allowed


_DIGITS = 3
_PER_CENT = 20
_MAX_LENGTH = 32  # characters of a comment
_NOTES = (
    "LOADING MAY TAKE AN OPTION",
    "J3 COUNTS AS IN THE MODEL",
    "COMPARE ONE POSE FIRST",
)


class FanucLs(language.SixAxisLanguage):
    """Listings for robots with six revolute axes."""

    name = "FANUC"
    suffix = ".ls"
    reads = (".ls",)
    spelling = FIXED_XYZ
    most_digits = (_DIGITS, _DIGITS)
    makers = ("fanuc", "lrmate", "crx", "m10", "m20", "m710", "m900", "r2000")
    speed = f"{_PER_CENT} % of the joints' speed"

    def read(self, text: str, outside: Outside) -> ProgramText:
        """Read the targets and moves of a listing."""
        return _FanucReader(text, outside, masked(text, r"(?<=[:\s])![^\r\n]*")).read()

    def measuring_tour(self, tour: MeasuringTour) -> bytes:
        """Write the program of the file's name: home, every pose with a wait, home."""
        name, notes = language.program_name(tour.file_name).upper(), [f"{len(tour.ids)} POSES"]
        return _listing(name, notes, tour.checked, language.tour_steps(tour))

    def target_moves(self, moves: TargetMoves) -> bytes:
        """Write ``PROGRAM`` through joint positions; tool and frame are comments, to be entered by hand."""
        frames = [
            *(f"UTOOL {each}" for each in _frame(moves.T_last_tool)),
            *(f"UFRAME {each}" for each in _frame(moves.T_frame0_instrument)),
        ]
        notes = [f"{len(moves.ids)} TARGETS", *frames]
        return _listing(PROGRAM.upper(), notes, moves.checked, language.move_steps(moves))

    def path_moves(self, moves: PathMoves) -> bytes:
        """Write ``PROGRAM``; positions are joint positions on lines and circles, too."""
        notes = [f"{len(moves.ids)} POINTS", *(f"UTOOL {each}" for each in _frame(moves.T_last_tool))]
        notes += ["CORRECTION IS IN THE JOINTS"] if moves.corrected else []
        return _listing(PROGRAM.upper(), notes, moves.checked, language.path_steps(moves))


def _listing(name: str, notes: list[str], checked: bool, steps: list[language.ProgramStep]) -> bytes:
    lines = [f"!{each}" for each in (*notes, *wrap(language.check_comment(checked), _MAX_LENGTH), *_NOTES)]
    for i, step in enumerate(steps, start=1):
        lines.append(f"!{language.ascii_text(step.comment)}")
        if step.kind != "via":
            lines.append(_move(i, step))
        lines += [f"WAIT {step.wait_s:6.2f}(sec)"] if step.wait_s else []
    numbered = [f"{i:4d}:{'' if line[0] in 'JLC' else '  '}{line} ;" for i, line in enumerate(lines, start=1)]
    head = [f"/PROG  {name}", "/ATTR", 'COMMENT = "lab";', f"LINE_COUNT = {len(numbered)};"]
    head += ["DEFAULT_GROUP = 1,*,*,*,*;", "/MN"]
    positions = [_position(i, step.joints) for i, step in enumerate(steps, start=1)]
    return ("\r\n".join([*head, *numbered, "/POS", *positions, "/END"]) + "\r\n").encode("ascii")


def _move(number: int, step: language.ProgramStep) -> str:
    """Return the instruction to move to a position; that of a circle takes two rows."""
    if step.pace is None:
        return f"J P[{number}] {_PER_CENT}% FINE"
    took = f"{max(int(np.ceil(1e3 * step.pace.seconds)), 1)}msec FINE"
    if step.kind == "circle":
        return f"C P[{number - 1}]\r\n    :  P[{number}] {took}"
    return f"{'L' if step.kind == 'line' else 'J'} P[{number}] {took}"


def _position(number: int, joints: Array) -> str:
    angles = [f"\tJ{i}= {each:>9} deg" for i, each in enumerate(language.numbers(np.rad2deg(joints), _DIGITS), start=1)]
    rows = [",".join(angles[:3]) + ",", ",".join(angles[3:])]
    return "\r\n".join([f"P[{number}]{{", "   GP1:", "\tUF : 0, UT : 1,", *rows, "};"])


def _frame(matrix: Array) -> list[str]:
    """Write a pose ``(4, 4)`` (m) in mm and degrees, one number in each comment, as comments are short."""
    return [f"{key} {value}" for key, value in zip("XYZWPR", language.place_and_turns(matrix, _DIGITS), strict=True)]
