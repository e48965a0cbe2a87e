"""FANUC's listings (LS), read for the positions behind ``/POS``.

Lengths are in mm; W, P and R turn about the fixed x, y and z. UF and UT number the user frame and the tool, which the
controller keeps; of both 0 is none. Of CONFIG the third letter says on which side of axis 1 the wrist is (T in front,
B behind), and the numbers how often axes 1, 4 and 6 have turned (0 within half a turn). What N, F, U and D mean for an
arm is told differently by public sources and could not be verified, so they are not used: of the solutions left the
one is taken that is nearest to the position before. Joint 3 counts as in the model.
"""

import re
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.formats.programs.postures import ArmShape
from lab.formats.programs.reading.numbers import NUMBER, Number, line_of, masked, whole_number
from lab.formats.programs.reading.program_text import (
    Allowed,
    Motion,
    Outside,
    ProgramReader,
    ProgramText,
    TargetText,
    Uncorrected,
)
from lab.formats.programs.reading.spelling import FIXED_XYZ

__all__ = ["read_fanuc"]

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
class _Reader(ProgramReader):
    """A listing being read."""

    code: str
    reached: dict[str, list[tuple[int, Motion]]] = field(default_factory=dict)
    relative: set[str] = field(default_factory=set)

    def read(self) -> ProgramText:
        self.frames = {name: np.eye(4) for name in ("UFRAME[0]", "UTOOL[0]")} | self.outside.posed(FIXED_XYZ)
        end = self.code.find("/POS")
        for found in _MOVE.finditer(self.code, 0, len(self.code) if end < 0 else end):
            self._move(found[1], found[2], found[3], found[4], found.start(1))
        for found in _SECOND.finditer(self.code, 0, len(self.code) if end < 0 else end):
            self._move("C", found[1], found[2], found[3], found.start(1))
        for found in _POSITION.finditer(self.code, max(end, 0)):
            number = whole_number(found[1])
            target = self._target(number, found[2], found.start(2)) if found[3] is None else None
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
        group = next((each for each in _GROUP.finditer(content) if each[1] == "1"), None)
        name, line = f"P[{number}]", line_of(self.text, at)
        if number in self.relative:
            return None
        begin, inner = (at + group.start(2), group[2]) if group else (at, content)
        parts = {part[1]: Number(begin + part.start(2), part[2]) for part in _FIELD.finditer(inner)}
        if set(_JOINTS) <= set(parts):
            return TargetText(name, line, tuple(parts[key] for key in _JOINTS))
        frames = _FRAMES.search(inner)
        if not set(_PLACE) <= set(parts) or not frames:
            self.uncorrected.append(Uncorrected(line, f"{name} has not six numbers"))
            return None
        base, tool = (
            self.outside.alias(f"{key}[{each}]") for key, each in zip(("UFRAME", "UTOOL"), frames.groups(), strict=True)
        )
        numbers = tuple(parts[key] for key in _PLACE)
        return TargetText(name, line, numbers, FIXED_XYZ, tool, base, allowed=_allowed(inner))


def read_fanuc(text: str, outside: Outside) -> ProgramText:
    """Read a listing.

    Raises:
        LabError: frames that are given have not the numbers of FANUC's.
    """
    return _Reader(text, outside, masked(text, r"(?<=[:\s])![^\r\n]*")).read()


def _allowed(inner: str) -> Allowed | None:
    """The side of axis 1, and the turns of axes 1, 4 and 6."""
    found = _CONFIG.search(inner)
    if not found:
        return None
    in_front, turns = found[1] == "T", [float(each) for each in found.groups()[1:]]

    def allowed(shape: ArmShape, joints: Array) -> NDArray[np.bool_]:
        fits = shape.in_front(joints) == in_front
        for axis, turn in zip((0, 3, 5), turns, strict=True):
            fits &= np.abs(joints[:, axis] - 2 * np.pi * turn) <= np.pi + _SLACK_RAD
        return np.asarray(fits)

    return allowed
