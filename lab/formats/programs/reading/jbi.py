"""Yaskawa's jobs (JBI), read for the positions behind ``//POS``.

Positions are motor pulses (``///PULSE``), whose number per degree is the controller's, or places in mm with Rx, Ry and
Rz in degrees about the fixed x, y and z (``///RECTAN``), in the frame that ``///POSTYPE`` names, of the tool that
``///TOOL`` numbers. ``///RCONF`` says which solution of the inverse is meant: wrist flipped (1 where joint 4 is more
than 90 degrees from zero), lower elbow, wrist behind, and joints 4, 6 and 1 beyond half a turn (manuals NX100
HW0481924, section 4.1, and DX100 HW0482494; which half of joint 4 is the flipped one is in the manipulator's manual).
"""

import re
from dataclasses import dataclass, field
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.programs.postures import ArmShape
from lab.formats.programs.reading.numbers import NUMBER, Number, line_of, whole_number
from lab.formats.programs.reading.program_text import (
    Allowed,
    Motion,
    Outside,
    ProgramReader,
    ProgramText,
    TargetText,
)
from lab.formats.programs.reading.spelling import FIXED_XYZ

__all__ = ["read_jbi"]

_LINE = re.compile(r"[^\r\n]+")
_POSITION = re.compile(r"^(C|P)(\d+)\s*=\s*(.*)$")
_PSEUDO = re.compile(r"^///?/?(\w+)\s*(.*)$")
_SIX_OR_MORE = re.compile(rf"{NUMBER}(?:\s*,\s*{NUMBER}){{5,}}")
_MOVE = re.compile(r"^\s*\+?(MOV[JLCS]|IMOV|REFP|SMOVL?)\s+(?:\d+\s+)?((?:C|P|LP)(?:\d+|\[\w+\]))?")
_SHIFTED = re.compile(r"^\s*(SFTON|MFRAME|SFTOF)\b")
_SLACK_RAD = np.deg2rad(0.05)
_QUARTER = np.pi / 2


@dataclass
class _Reader(ProgramReader):
    """A job being read, line by line."""

    positions: dict[str, TargetText] = field(default_factory=dict)
    reached: dict[str, list[tuple[int, Motion]]] = field(default_factory=dict)
    relative: set[str] = field(default_factory=set)
    state: dict[str, str] = field(default_factory=dict)
    allowed: Allowed | None = None

    def read(self) -> ProgramText:
        self.frames = {name: np.eye(4) for name in ("ROBOT", "TOOL[0]")} | self.outside.posed(FIXED_XYZ)
        for found in _LINE.finditer(self.text):
            line = found[0]
            if pseudo := _PSEUDO.match(line):
                self._pseudo(pseudo[1], pseudo[2].rstrip())
            elif position := _POSITION.match(line):
                self._position(position, found.start())
            elif not line.lstrip().startswith("'"):
                self._instruction(line, found.start())
        for name, target in self.positions.items():
            if name not in self.relative:
                self._add(target, self.reached.get(name, ()))
        return self._read()

    def _pseudo(self, key: str, value: str) -> None:
        """What holds for the positions that follow."""
        if key in ("PULSE", "RECTAN"):
            self.state["form"] = key
        elif key == "POSTYPE":
            self.state[key] = value
        elif key in ("TOOL", "USER"):
            self.state[key] = f"{key}[{_numbered(value)}]"
        elif key == "RCONF":
            self.allowed = _allowed(value)

    def _position(self, found: "re.Match[str]", at: int) -> None:
        kind, name, begin = self.state.get("POSTYPE", ""), found[1] + found[2], at + found.start(3)
        first = islice(re.finditer(NUMBER, found[3]), 6)
        numbers = tuple(Number(begin + each.start(), each[0]) for each in first)
        line = line_of(self.text, at)
        if not _SIX_OR_MORE.fullmatch(found[3].rstrip()):
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
        found = _MOVE.match(line)
        if not found:
            return
        name = found[2] or ""
        if found[1] == "IMOV":
            self.relative.add(name)
            self._leave(at, f"{name} is relative (IMOV): it stays")
        elif name not in self.positions:
            self._leave(at, f"{name or 'its position'} is a variable, or computed")
        else:
            motion: Motion = "joints" if found[1] == "MOVJ" else "line"
            self.reached.setdefault(name, []).append((line_of(self.text, at), motion))


def read_jbi(text: str, outside: Outside) -> ProgramText:
    """Read a job.

    Raises:
        LabError: frames that are given have not the numbers of Yaskawa's, or pulses are there without their number
            per degree.
    """
    return _Reader(text, outside).read()


def _numbered(text: str) -> str:
    """The number of a tool or a frame, without leading zeros; that of the first group."""
    found = re.match(r"\d+", text)
    return whole_number(found[0]) if found else "?"


def _allowed(configuration: str) -> Allowed | None:
    """Flip, elbow, side, and which of joints 4, 6 and 1 are beyond half a turn."""
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
