"""Write and read JBI, the jobs of Yaskawa Motoman's controllers in INFORM.

Positions are motor pulses (``///PULSE``), whose number per degree depends on the controller, or positions in mm with
Rx, Ry and Rz in degrees about the fixed x, y and z (``///RECTAN``), in the frame ``///POSTYPE``, of the tool number
``///TOOL``. ``///RCONF`` selects the IK solution: wrist flipped (1 where joint 4 is more than 90 degrees from zero),
lower elbow, wrist behind, and joints 4, 6 and 1 beyond half a turn. Layout and ``RCONF`` follow the manuals NX100
"Interface with an Easy Offline Teaching System" (HW0481924, section 4.1) and DX100 (HW0482494); the flipped half of
joint 4 is defined in each manipulator's manual and could not be verified.

Written positions are Cartesian by the nominal model, to 0.001 mm and 0.0001 degrees, as controllers take them (YRC1000,
Ethernet function, position data). The date of a job is the first of the century. No job was tried on a controller.
Jobs are read for the positions behind ``//POS``.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import islice
from textwrap import wrap

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
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
    Postures,
    ProgramReader,
    ProgramText,
    TargetText,
    line_of,
    whole_number,
)
from lab.formats.programs.protocol import MeasuringTour, PathMoves, TargetMoves

__all__ = ["Jbi"]

_LINE = re.compile(r"[^\r\n]+")
_POSITION = re.compile(r"^(C|P)(\d+)\s*=\s*(.*)$")
_PSEUDO = re.compile(r"^///?/?(\w+)\s*(.*)$")
_SIX_OR_MORE = re.compile(rf"{NUMBER}(?:\s*,\s*{NUMBER}){{5,}}")
_MOVE = re.compile(r"^\s*\+?(MOV[JLCS]|IMOV|REFP|SMOVL?)\s+(?:\d+\s+)?((?:C|P|LP)(?:\d+|\[\w+\]))?")
_SHIFTED = re.compile(r"^\s*(SFTON|MFRAME|SFTOF)\b")
_SLACK_RAD = np.deg2rad(0.05)
_QUARTER = np.pi / 2


@dataclass
class _JbiReader(ProgramReader):
    """Reader of a job, line by line."""

    positions: dict[str, TargetText] = field(default_factory=dict)
    reached: dict[str, list[tuple[int, Motion]]] = field(default_factory=dict)
    relative: set[str] = field(default_factory=set)
    state: dict[str, str] = field(default_factory=dict)
    allowed: Allowed | None = None

    def read(self) -> ProgramText:
        self.frames = {name: np.eye(4) for name in ("ROBOT", "TOOL[0]")} | self.outside.posed(FIXED_XYZ)
        for match in _LINE.finditer(self.text):
            line = match[0]
            if pseudo := _PSEUDO.match(line):
                self._pseudo(pseudo[1], pseudo[2].rstrip())
            elif position := _POSITION.match(line):
                self._position(position, match.start())
            elif not line.lstrip().startswith("'"):
                self._instruction(line, match.start())
        for name, target in self.positions.items():
            if name not in self.relative:
                self._add(target, self.reached.get(name, ()))
        return self._read()

    def _pseudo(self, key: str, value: str) -> None:
        """Read a pseudo instruction that applies to the positions that follow."""
        if key in ("PULSE", "RECTAN"):
            self.state["form"] = key
        elif key == "POSTYPE":
            self.state[key] = value
        elif key in ("TOOL", "USER"):
            self.state[key] = f"{key}[{_numbered(value)}]"
        elif key == "RCONF":
            self.allowed = _allowed(value)

    def _position(self, match: "re.Match[str]", at: int) -> None:
        kind, name, begin = self.state.get("POSTYPE", ""), match[1] + match[2], at + match.start(3)
        first = islice(re.finditer(NUMBER, match[3]), 6)
        numbers = tuple(Number(begin + each.start(), each[0]) for each in first)
        line = line_of(self.text, at)
        if not _SIX_OR_MORE.fullmatch(match[3].rstrip()):
            self._leave(at, f"{name} has not six numbers")
        elif self.state.get("form") == "PULSE" or kind == "PULSE":
            per_deg = self.outside.pulses_per_deg
            if not per_deg:
                raise LabError(f"line {line}: {name} is in pulses; give --pulses-per-deg S,L,U,R,B,T of the controller")
            per_rad = tuple(np.rad2deg(each) for each in per_deg)
            self.positions[name] = TargetText(name, line, numbers, per_rad=per_rad, whole=True)
        elif kind not in ("BASE", "ROBOT", "USER"):
            self._leave(at, f"{name} is in the frame {kind or 'of no POSTYPE'}, which moves or is not known")
        else:
            base = self.outside.alias(self.state.get("USER", "USER[?]") if kind == "USER" else "ROBOT")
            tool = self.outside.alias(self.state.get("TOOL", "TOOL[?]"))
            self.positions[name] = TargetText(name, line, numbers, FIXED_XYZ, tool, base, allowed=self.allowed)

    def _instruction(self, line: str, at: int) -> None:
        if shifted := _SHIFTED.match(line):
            self._leave(at, f"{shifted[1]} shifts what follows, which is corrected where it is written")
            return
        match = _MOVE.match(line)
        if not match:
            return
        name = match[2] or ""
        if match[1] == "IMOV":
            self.relative.add(name)
            self._leave(at, f"{name} is relative (IMOV): it stays")
        elif name not in self.positions:
            self._leave(at, f"{name or 'its position'} is a variable, or computed")
        else:
            motion: Motion = "joints" if match[1] == "MOVJ" else "line"
            self.reached.setdefault(name, []).append((line_of(self.text, at), motion))


def _numbered(text: str) -> str:
    """Return the number of a tool or a frame, without leading zeros; that of the first group."""
    match = re.match(r"\d+", text)
    return whole_number(match[0]) if match else "?"


def _allowed(configuration: str) -> Allowed | None:
    """Return the test of flip, elbow, side, and of joints 4, 6 and 1 beyond half a turn."""
    bits = [each.strip() == "1" for each in configuration.split(",")][:6]
    if len(bits) < 6:
        return None

    def allowed(shape: ArmShape, joints: Array) -> NDArray[np.bool_]:
        within = np.abs((joints[:, 3] + np.pi) % (2 * np.pi) - np.pi)
        fits = within >= _QUARTER - _SLACK_RAD if bits[0] else within <= _QUARTER + _SLACK_RAD
        fits &= shape.elbow_up(joints) != bits[1]
        fits &= shape.in_front(joints) != bits[2]
        for axis, beyond in zip((3, 5, 0), bits[3:], strict=True):
            angle = np.abs(joints[:, axis])
            fits &= angle >= np.pi - _SLACK_RAD if beyond else angle <= np.pi + _SLACK_RAD
        return np.asarray(fits)

    return allowed


_DIGITS_MM, _DIGITS_DEG = 3, 4
_PER_CENT = 20
_MAX_LENGTH = 32  # characters of a comment
_HALF = np.pi
_USER_HEAD = ["///USER 1", "///TOOL 1", "///POSTYPE USER"]
_NOTES = (
    "RCONF AS IN THE NX100 MANUAL",
    "FRAME 0 IS THE ROBOT FRAME",
    "COMPARE ONE POSE FIRST",
)


class Jbi(language.SixAxisLanguage):
    """Jobs for robots with six revolute axes."""

    name = "JBI"
    suffix = ".jbi"
    reads = (".jbi",)
    spelling = FIXED_XYZ
    most_digits = (_DIGITS_MM, _DIGITS_DEG)
    makers = ("motoman", "yaskawa", "gp", "hc", "mh")
    speed = f"{_PER_CENT} % of the joints' speed"

    def read(self, text: str, outside: Outside) -> ProgramText:
        """Read the targets and moves of a job."""
        return _JbiReader(text, outside).read()

    def measuring_tour(self, tour: MeasuringTour) -> bytes:
        """Write the job of the file's name: home, every pose with a wait, home; of the flange (tool 0)."""
        notes = [f"{len(tour.ids)} POSES OF THE FLANGE", "TOOL 0 HAS TO BE ZERO"]
        steps, postures = language.tour_steps(tour), _postures(tour.postures)
        head = ["///TOOL 0", "///POSTYPE ROBOT"]
        return _job(
            language.program_name(tour.file_name).upper(),
            head,
            [*notes, *_checked(tour.checked)],
            steps,
            postures,
            postures.Ts_frame0_last,
        )

    def target_moves(self, moves: TargetMoves) -> bytes:
        """Write ``PROGRAM`` in user frame 1 with tool 1; both are comments, to be entered by hand."""
        frames = _frames(moves.T_last_tool, moves.T_frame0_instrument)
        postures = _postures(moves.postures)
        Ts = se3.inverse(moves.T_frame0_instrument) @ postures.Ts_frame0_last @ moves.T_last_tool
        notes = [f"{len(moves.ids)} TARGETS", *_checked(moves.checked), *frames]
        return _job("PROGRAM", _USER_HEAD, notes, language.move_steps(moves), postures, Ts)

    def path_moves(self, moves: PathMoves) -> bytes:
        """Write ``PROGRAM`` in user frame 1 with tool 1; a circle begins with its start position."""
        frames = _frames(moves.T_last_tool, moves.T_frame0_base)
        correction = ["CORRECTION IS IN THE POSITIONS"] if moves.corrected else []
        notes = [f"{len(moves.ids)} POINTS", *correction, *_checked(moves.checked), *frames]
        steps, postures = language.path_steps(moves), _postures(moves.postures)
        return _job("PROGRAM", _USER_HEAD, notes, steps, postures, moves.Ts_base_tool)


def _postures(postures: Postures | None) -> Postures:
    assert postures is not None
    return postures


def _checked(checked: bool) -> list[str]:
    return wrap(language.check_comment(checked), _MAX_LENGTH)


def _job(
    name: str, head: list[str], notes: Sequence[str], steps: list[language.ProgramStep], postures: Postures, Ts: Array
) -> bytes:
    """Write a job through poses ``(s, 4, 4)`` (m) of the tool."""
    lines = ["/JOB", f"//NAME {name}", "//POS", f"///NPOS {len(steps)},0,0,0,0,0", *head, "///RECTAN"]
    last = None
    for i, (step, T) in enumerate(zip(steps, Ts, strict=True)):
        configuration = _configuration(step.joints, bool(postures.in_front[i]), bool(postures.elbow_up[i]))
        lines += [f"///RCONF {configuration}"] if configuration != last else []
        lines.append(f"C{i:05d}={','.join(_position(T))}")
        last = configuration
    lines += ["//INST", "///DATE 2000/01/01 00:00", "///ATTR SC,RW", "///GROUP1 RB1", "NOP"]
    lines += [f"'{each}" for each in (*notes, *_NOTES)]
    for i, step in enumerate(steps):
        lines += [f"'{language.ascii_text(step.comment)[: _MAX_LENGTH - 1]}", *_move(i, step)]
        lines += [f"TIMER T={step.wait_s:.2f}"] if step.wait_s else []
    return ("\r\n".join([*lines, "END"]) + "\r\n").encode("ascii")


def _move(number: int, step: language.ProgramStep) -> list[str]:
    """Return the instructions to move to a position; none to one on the circle to the next."""
    if step.kind == "via":
        return []
    if step.pace is None or step.kind == "joint":
        return [f"MOVJ C{number:05d} VJ={_PER_CENT if step.pace is None else step.pace.per_cent:.2f}"]
    speed = f"V={step.pace.mm_s:.1f}"
    circle = [f"MOVC C{i:05d} {speed}" for i in (number - 2, number - 1, number)]
    return circle if step.kind == "circle" else [f"MOVL C{number:05d} {speed}"]


def _configuration(joints: Array, in_front: bool, elbow_up: bool) -> str:
    """Return flip, elbow, side, joints 4, 6 and 1 beyond half a turn, and two unused numbers."""
    within = abs((joints[3] + _HALF) % (2 * _HALF) - _HALF) <= _QUARTER
    far = [int(abs(joints[i]) >= _HALF) for i in (3, 5, 0)]
    return ",".join(map(str, [int(not within), int(not elbow_up), int(not in_front), *far, 0, 0]))


def _position(matrix: Array) -> list[str]:
    """Write a pose ``(4, 4)`` (m) in mm and degrees."""
    return language.place_and_turns(matrix, _DIGITS_MM, _DIGITS_DEG)


def _frames(T_tool: Array, T_user: Array) -> list[str]:
    """Write two poses ``(4, 4)`` (m), one number in each comment, as comments are short."""
    return [
        f"{frame} 1 {key} {value}"
        for frame, T in (("TOOL", T_tool), ("USER", T_user))
        for key, value in zip(("X", "Y", "Z", "RX", "RY", "RZ"), _position(T), strict=True)
    ]
