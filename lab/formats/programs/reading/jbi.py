"""Yaskawa's jobs (JBI), read for the positions behind ``//POS``.

Positions are motor pulses (``///PULSE``), whose number per degree is the controller's, or places in mm with Rx, Ry and
Rz in degrees about the fixed x, y and z (``///RECTAN``), in the frame that ``///POSTYPE`` names, of the tool that
``///TOOL`` numbers. ``///RCONF`` says which solution of the inverse is meant: wrist flipped (1 where joint 4 is more
than 90 degrees from zero), lower elbow, wrist behind, and joints 4, 6 and 1 beyond half a turn (manuals NX100
HW0481924, section 4.1, and DX100 HW0482494; which half of joint 4 is the flipped one is in the manipulator's manual).
"""

import re
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.programs.postures import ArmShape
from lab.formats.programs.reading.numbers import NUMBER, Number, line_of
from lab.formats.programs.reading.program_text import (
    Allowed,
    Motion,
    Move,
    Outside,
    ProgramReader,
    ProgramText,
    TargetText,
)
from lab.formats.programs.reading.spelling import FIXED_XYZ

__all__ = ["read_jbi"]

_LINE = re.compile(r"[^\r\n]+")
_POSITION = re.compile(r"^(C|P)(\d+)\s*=\s*(.*?)\s*$")
_MOVE = re.compile(r"^\s*\+?(MOV[JLCS]|IMOV|REFP|SMOVL?)\s+(?:\d+\s+)?((?:C|P|LP)(?:\d+|\[\w+\]))?")
_SHIFTED = re.compile(r"^\s*(SFTON|MFRAME|SFTOF)\b")
_SLACK_RAD = np.deg2rad(0.05)
_QUARTER = np.pi / 2


@dataclass
class _Reader(ProgramReader):
    """A job being read, line by line."""

    targets: dict[str, TargetText] = field(default_factory=dict)
    moves: list[tuple[int, str, Motion]] = field(default_factory=list)
    relative: set[str] = field(default_factory=set)
    state: dict[str, str] = field(default_factory=dict)

    def read(self) -> ProgramText:
        frames = {name: np.eye(4) for name in ("ROBOT", "TOOL[0]")} | self.outside.posed(FIXED_XYZ)
        for found in _LINE.finditer(self.text):
            line = found[0]
            if pseudo := re.match(r"^///?/?(\w+)\s*(.*?)\s*$", line):
                self._pseudo(pseudo[1], pseudo[2])
            elif position := _POSITION.match(line):
                self._position(position, found.start())
            elif not line.lstrip().startswith("'"):
                self._instruction(line, found.start())
        for name in self.relative:
            self.targets.pop(name, None)
        order = list(self.targets)
        moves = tuple(Move(line, order.index(name), how) for line, name, how in self.moves if name in self.targets)
        return ProgramText(tuple(self.targets.values()), moves, frames, tuple(self.uncorrected))

    def _pseudo(self, key: str, value: str) -> None:
        """What holds for the positions that follow."""
        if key in ("PULSE", "RECTAN"):
            self.state["form"] = key
        elif key in ("TOOL", "USER", "POSTYPE", "RCONF"):
            self.state[key] = value

    def _position(self, found: "re.Match[str]", at: int) -> None:
        kind, name, begin = self.state.get("POSTYPE", ""), found[1] + found[2], at + found.start(3)
        numbers = tuple(Number(begin + each.start(), each[0]) for each in re.finditer(NUMBER, found[3]))
        line = line_of(self.text, at)
        if len(numbers) < 6 or not re.fullmatch(rf"\s*{NUMBER}(?:\s*,\s*{NUMBER})*", found[3]):
            self._leave(at, f"{name} has not six numbers")
        elif self.state.get("form") == "PULSE" or kind == "PULSE":
            per_deg = self.outside.pulses_per_deg
            if not per_deg:
                raise LabError(f"line {line}: {name} is in pulses; give --pulses-per-deg S,L,U,R,B,T of the controller")
            per_rad = tuple(np.rad2deg(each) for each in per_deg)
            self.targets[name] = TargetText(name, line, numbers[:6], per_rad=per_rad)
        elif kind not in ("BASE", "ROBOT", "USER"):
            self._leave(at, f"{name} is in the frame {kind or 'of no POSTYPE'}, which moves or is not known")
        else:
            base = f"USER[{_numbered(self.state.get('USER'))}]" if kind == "USER" else "ROBOT"
            tool = f"TOOL[{_numbered(self.state.get('TOOL'))}]"
            alias, allowed = self.outside.alias, _allowed(self.state.get("RCONF", ""))
            self.targets[name] = TargetText(
                name, line, numbers[:6], FIXED_XYZ, alias(tool), alias(base), allowed=allowed
            )

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
        elif name not in self.targets:
            self._leave(at, f"{name or 'its position'} is a variable, or computed")
        else:
            self.moves.append((line_of(self.text, at), name, "joints" if found[1] == "MOVJ" else "line"))


def read_jbi(text: str, outside: Outside) -> ProgramText:
    """Read a job.

    Raises:
        LabError: frames that are given have not the numbers of Yaskawa's, or pulses are there without their number
            per degree.
    """
    return _Reader(text, outside).read()


def _numbered(text: str | None) -> str:
    """The number of a tool or a frame, without leading zeros; that of the first group."""
    found = re.match(r"\d+", text or "")
    return str(int(found[0])) if found else "?"


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
