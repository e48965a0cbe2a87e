"""VAL 3 data (.dtx) and programs (.pgx), read for points, joint positions, tools and frames.

Lengths are in mm; Rx turns about x, Ry about the new y, Rz about the new z. Points, tools and frames name their father
(``fatherId``); the world is the robot's base, and the flange the tools'. Of a point's configuration the elbow says the
sign of joint 3 and the wrist that of joint 5 (Stäubli, VAL 3 Reference Manual, "config"); which shoulder is the right
one depends on the arm and is not used: of the solutions left the one is taken that is nearest to the point before. The
layout follows public applications, and could not be verified against Stäubli's schema.
"""

import re
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lab.core.limits import PROGRAM_FRAMES
from lab.core.se3 import Array
from lab.formats.programs.postures import ArmShape
from lab.formats.programs.reading.aggregate import numbers_in, read_value
from lab.formats.programs.reading.numbers import NUMBER, Number, line_of, masked, values_of
from lab.formats.programs.reading.program_text import (
    Allowed,
    Motion,
    Move,
    Outside,
    ProgramReader,
    ProgramText,
    TargetText,
)
from lab.formats.programs.reading.spelling import MOVING_XYZ

__all__ = ["read_val3"]

# A <Data> that ends with "/>" has no values.
_DATA = re.compile(r"<Data\b([^<>]*[^/<>])>(.*?)(?:</Data\s*>|(\Z))", re.DOTALL)
_VALUE = re.compile(r"<Value\b([^<>]*?)/?>", re.DOTALL)
_ATTRIBUTE = re.compile(r'(?<![\w:])([\w:]+)\s*=\s*"([^"]*)"')
_CODE = re.compile(r"<Code\b[^<>]*>(.*?)(?:</Code\s*>|(\Z))", re.DOTALL)
_LOCAL = re.compile(r"<(?:Local|Parameter)\b([^<>]*?)/?>")
_GIVEN = re.compile(r"^[ \t]*(\w+)((?:\.\w+)*)[ \t]*=[ \t]*(?=\{)", re.MULTILINE)
_MOVE = re.compile(r"\b(move[jlc])\s*\(([^,()]+),[^,()]+,")
_PLACE, _JOINTS = ("x", "y", "z", "rx", "ry", "rz"), tuple(f"j{i}" for i in range(1, 7))
_SIGNS = {"epositive": (2, 1), "enegative": (2, -1), "wpositive": (4, 1), "wnegative": (4, -1)}
_SLACK_RAD = np.deg2rad(0.05)


@dataclass
class _Reader(ProgramReader):
    """A file of an application being read."""

    code: str
    listed: str  # its code with brackets for braces
    fathers: dict[str, tuple[str, Array]] = field(default_factory=dict)
    tools: list[str] = field(default_factory=list)
    points: list[tuple[str, dict[str, str], dict[str, Number], int]] = field(default_factory=list)

    def read(self) -> ProgramText:
        self.frames = {"world": np.eye(4), "flange": np.eye(4), **self.outside.posed(MOVING_XYZ)}
        for data in _DATA.finditer(self.code):
            if data[3] is None:
                self._data(dict(_ATTRIBUTE.findall(data[1])), data)
        self._chain(self.frames)
        tool = self.outside.alias("tool")
        if tool == "tool" and "tool" not in self.frames:
            tool = self.tools[0] if len(self.tools) == 1 else "tool"
        for name, words, numbers, line in self.points:
            values = tuple(numbers[key] for key in _PLACE)
            base = self.outside.alias(_plain(words.get("fatherId", "world")))
            self._add(TargetText(name, line, values, MOVING_XYZ, tool, base, allowed=_allowed(words)), ())
        self._program()
        return self._read()

    def _data(self, head: dict[str, str], data: "re.Match[str]") -> None:
        """The values of a variable."""
        kind = head.get("type", "")
        values = list(_VALUE.finditer(self.code, data.start(2), data.end(2)))
        for value in values:
            words = dict(_ATTRIBUTE.findall(value[1]))
            index = words.get("key", "0")
            name = head.get("name", "") + ("" if len(values) == 1 and index == "0" else f"[{index}]")
            numbers = {
                each[1]: Number(value.start(1) + each.start(2), each[2])
                for each in _ATTRIBUTE.finditer(value[1])
                if re.fullmatch(NUMBER, each[2])
            }
            wanted = _JOINTS if kind.startswith("joint") else _PLACE
            if kind not in ("jointRx", "pointRx", "tool", "frame", "joint", "point"):
                continue
            if not set(wanted) <= set(numbers):
                self._leave(value.start(), f"{name} leaves out {', '.join(sorted(set(wanted) - set(numbers)))}")
            elif kind.startswith("joint"):
                line = line_of(self.text, value.start())
                self._add(TargetText(name, line, tuple(numbers[key] for key in _JOINTS)), ())
            elif kind.startswith("point"):
                self.points.append((name, words, numbers, line_of(self.text, value.start())))
            else:
                T = MOVING_XYZ.pose(values_of([numbers[key] for key in _PLACE]))
                self.fathers[name] = (_plain(words.get("fatherId", "world" if kind == "frame" else "flange")), T)
                self.tools += [name] if kind == "tool" else []
                PROGRAM_FRAMES("the program", self.fathers)

    def _chain(self, known: dict[str, Array]) -> None:
        """Add the tools in the flange and the frames in the world whose fathers are all known."""
        tried = set[str]()
        for name in self.fathers:
            chain = list[str]()
            while name in self.fathers and name not in known and name not in tried:
                tried.add(name)
                chain.append(name)
                name = self.fathers[name][0]
            if name in known:
                for each in reversed(chain):
                    father, T = self.fathers[each]
                    known[each] = known[father] @ T

    def _program(self) -> None:
        """Joint positions that a program assigns, and its moves."""
        declared = map(dict, map(_ATTRIBUTE.findall, _LOCAL.findall(self.code)))
        kinds = {each.get("name"): each.get("type") for each in declared}
        for code in _CODE.finditer(self.code):
            if code[2] is not None:
                return
            given: dict[str, int] = {}
            events = [*_GIVEN.finditer(self.code, *code.span(1)), *_MOVE.finditer(self.code, *code.span(1))]
            for found in sorted(events, key=lambda each: each.start()):
                if found.re is _GIVEN:
                    self._given(found, kinds.get(found[1]), given)
                elif (target := given.get(found[2].strip())) is not None:
                    motion: Motion = "joints" if found[1] == "movej" else "line"
                    self.moves.append(Move(line_of(self.text, found.start()), target, motion))
                else:
                    self._leave(found.start(), f"{found[2].strip()} is not in this file, or computed")

    def _given(self, found: "re.Match[str]", kind: str | None, given: dict[str, int]) -> None:
        """An assignment of numbers in braces."""
        read = read_value(self.listed, found.end())
        numbers = None if read is None else numbers_in(read[0], 6)
        given.pop(found[1], None)
        if numbers is None or kind not in ("joint", "jointRx") or found[2]:
            if kind != "trsf" or found[2]:
                self._leave(found.start(1), f"{found[1]}{found[2]} is computed, or has no frame here")
            return
        given[found[1]] = len(self.targets)
        line = line_of(self.text, found.start(1))
        self._add(TargetText(f"{found[1]} of line {line}", line, numbers), ())


def read_val3(text: str, outside: Outside) -> ProgramText:
    """Read a file of an application.

    Raises:
        LabError: frames that are given have not the numbers of VAL 3's.
    """
    comments = masked(text, r"<!--[\s\S]*?(?:-->|\Z)|(?<!:)//[^\r\n]*", kept='"[^"\r\n]*"')
    return _Reader(text, outside, comments, comments.replace("{", "[").replace("}", "]")).read()


def _plain(name: str) -> str:
    """A variable's first entry by its name alone."""
    return name.removesuffix("[0]")


def _allowed(words: dict[str, str]) -> Allowed | None:
    """The signs of joints 3 and 5."""
    signs = [_SIGNS[words[key]] for key in ("elbow", "wrist") if words.get(key) in _SIGNS]
    if not signs:
        return None

    def allowed(shape: ArmShape, joints: Array) -> NDArray[np.bool_]:
        fits = np.ones(len(joints), dtype=np.bool_)
        for axis, sign in signs:
            fits &= sign * joints[:, axis] >= -_SLACK_RAD
        return fits

    return allowed
