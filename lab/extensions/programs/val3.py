"""Write and read VAL 3, the language of Stäubli's controllers (CS8, CS9).

Joint positions are in degrees, lengths in mm; Rx turns about x, Ry about the new y, Rz about the new z (VAL 3 Reference
Manual, Stäubli, "trsf type"). A written file is a program to be added to an application that has the usual motion
descriptor mNomSpeed. The layout follows public applications, and could not be verified against Stäubli's schema; a
comment in the file states so.

Data (.dtx) and programs (.pgx) are read for points, joint positions, tools and frames. Points, tools and frames name
their father (``fatherId``); the world is the robot's base, and the flange the tools'. In a point's configuration the
elbow is the sign of joint 3 and the wrist that of joint 5 ("config"). The right shoulder depends on the arm and is not
used: of the remaining IK solutions the nearest to the point before is taken.
"""

import re
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.limits import PROGRAM_FRAMES
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.programs import language
from lab.extensions.programs.aggregate import numbers_in, read_value
from lab.formats.programs.program_text import (
    MOVING_XYZ,
    NUMBER,
    Allowed,
    ArmShape,
    Motion,
    Move,
    Number,
    Outside,
    ProgramReader,
    ProgramText,
    TargetText,
    line_of,
    masked,
    values_of,
)
from lab.formats.programs.protocol import PROGRAM, MeasuringTour, PathMoves, TargetMoves

__all__ = ["Val3"]

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
class _Val3Reader(ProgramReader):
    """Reader of an application's file."""

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
        for name, attributes, numbers, line in self.points:
            values = tuple(numbers[key] for key in _PLACE)
            base = self.outside.alias(_plain(attributes.get("fatherId", "world")))
            self._add(TargetText(name, line, values, MOVING_XYZ, tool, base, allowed=_allowed(attributes)), ())
        self._program()
        return self._read()

    def _data(self, head: dict[str, str], data: "re.Match[str]") -> None:
        """Read the values of a variable."""
        kind = head.get("type", "")
        if kind not in ("jointRx", "pointRx", "tool", "frame", "joint", "point"):
            return
        values = list(_VALUE.finditer(self.code, data.start(2), data.end(2)))
        for value in values:
            attributes = dict(_ATTRIBUTE.findall(value[1]))
            index = attributes.get("key", "0")
            name = head.get("name", "") + ("" if len(values) == 1 and index == "0" else f"[{index}]")
            self._value(kind, name, attributes, value)

    def _value(self, kind: str, name: str, attributes: dict[str, str], value: "re.Match[str]") -> None:
        """Read joint positions, a point, or a tool or a frame in its father."""
        numbers = {
            attribute[1]: Number(value.start(1) + attribute.start(2), attribute[2])
            for attribute in _ATTRIBUTE.finditer(value[1])
            if re.fullmatch(NUMBER, attribute[2])
        }
        wanted = _JOINTS if kind.startswith("joint") else _PLACE
        if missing := set(wanted) - set(numbers):
            self._leave(value.start(), f"{name} leaves out {', '.join(sorted(missing))}")
        elif kind.startswith("joint"):
            line = line_of(self.text, value.start())
            self._add(TargetText(name, line, tuple(numbers[key] for key in _JOINTS)), ())
        elif kind.startswith("point"):
            self.points.append((name, attributes, numbers, line_of(self.text, value.start())))
        else:
            T = MOVING_XYZ.pose(values_of([numbers[key] for key in _PLACE]))
            self._tool_or_frame(kind, name, attributes, T)

    def _tool_or_frame(self, kind: str, name: str, attributes: dict[str, str], T_father: Array) -> None:
        """Record the pose of a tool or a frame in its father."""
        father = attributes.get("fatherId", "world" if kind == "frame" else "flange")
        self.fathers[name] = _plain(father), T_father
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
                for link in reversed(chain):
                    father, T = self.fathers[link]
                    known[link] = known[father] @ T

    def _program(self) -> None:
        """Read joint positions that a program assigns, and its moves."""
        declared = map(dict, map(_ATTRIBUTE.findall, _LOCAL.findall(self.code)))
        kinds = {variable.get("name"): variable.get("type") for variable in declared}
        for code in _CODE.finditer(self.code):
            if code[2] is not None:
                return
            assigned: dict[str, int] = {}
            events = [*_GIVEN.finditer(self.code, *code.span(1)), *_MOVE.finditer(self.code, *code.span(1))]
            for match in sorted(events, key=lambda event: event.start()):
                if match.re is _GIVEN:
                    self._assign(match, kinds.get(match[1]), assigned)
                elif (target := assigned.get(match[2].strip())) is not None:
                    motion: Motion = "joints" if match[1] == "movej" else "line"
                    self.moves.append(Move(line_of(self.text, match.start()), target, motion))
                else:
                    self._leave(match.start(), f"{match[2].strip()} is not in this file, or computed")

    def _assign(self, match: "re.Match[str]", kind: str | None, assigned: dict[str, int]) -> None:
        """Read an assignment of numbers in braces."""
        read = read_value(self.listed, match.end())
        numbers = None if read is None else numbers_in(read[0], 6)
        assigned.pop(match[1], None)
        if numbers is None or kind not in ("joint", "jointRx") or match[2]:
            if kind != "trsf" or match[2]:
                self._leave(match.start(1), f"{match[1]}{match[2]} is computed, or has no frame here")
            return
        assigned[match[1]] = len(self.targets)
        line = line_of(self.text, match.start(1))
        self._add(TargetText(f"{match[1]} of line {line}", line, numbers), ())


def _plain(name: str) -> str:
    return name.removesuffix("[0]")


def _allowed(attributes: dict[str, str]) -> Allowed | None:
    """Return the test of the signs of joints 3 and 5."""
    signs = [_SIGNS[attributes[key]] for key in ("elbow", "wrist") if attributes.get(key) in _SIGNS]
    if not signs:
        return None

    def allowed(shape: ArmShape, joints: Array) -> NDArray[np.bool_]:
        fits = np.ones(len(joints), dtype=np.bool_)
        for axis, sign in signs:
            fits &= sign * joints[:, axis] >= -_SLACK_RAD
        return fits

    return allowed


_DIGITS = 6
_SPACE = "http://www.staubli.com/robotics/VAL3/Program/2"
_INSTANCE = "http://www.w3.org/2001/XMLSchema-instance"
_NOTE = "  // The layout of this file follows public programs: add it to an application that has mNomSpeed."


class Val3(language.SixAxisLanguage):
    """Programs for robots with six revolute axes."""

    name = "VAL3"
    suffix = ".pgx"
    reads = (".pgx", ".dtx")
    spelling = MOVING_XYZ
    makers = ("staubli", "tx", "tx2", "rx")
    speed = "mNomSpeed"

    def read(self, text: str, outside: Outside) -> ProgramText:
        """Read the targets and moves of an application's file."""
        comments = masked(text, r"<!--[\s\S]*?(?:-->|\Z)|(?<!:)//[^\r\n]*", retained='"[^"\r\n]*"')
        return _Val3Reader(text, outside, comments, comments.replace("{", "[").replace("}", "]")).read()

    def measuring_tour(self, tour: MeasuringTour) -> bytes:
        """Write the program of the file's name: home, every pose with a wait, home."""
        head = [
            *(f"  // {note}" for note in language.tour_notes(tour)),
        ]
        return _program(tour.file_name, {"jTo": "joint"}, head, language.tour_steps(tour))

    def target_moves(self, moves: TargetMoves) -> bytes:
        """Write ``program`` through joint positions, with their tool and frame."""
        head = [
            *(f"  // {note}" for note in language.move_notes(moves)),
            "  // Tool and frame suit the controller's nominal links best. They hold where its flange is the last",
            "  // frame of the lab's table, and its world is frame 0 of it.",
            f"  trTool={_frame(moves.T_last_tool)}",
            f"  trFrame={_frame(moves.T_frame0_instrument)}",
        ]
        local = {"jTo": "joint", "trTool": "trsf", "trFrame": "trsf"}
        return _program(PROGRAM, local, head, language.move_steps(moves))

    def path_moves(self, moves: PathMoves) -> bytes:
        """Write ``program``; the controller computes points of lines and circles from joint positions."""
        head = [
            *(f"  // {note}" for note in language.path_notes(moves)),
            f"  tPath.trsf={_frame(moves.T_last_tool)}",
            "  mPath=mNomSpeed",
        ]
        local = {"jTo": "joint", "pVia": "point", "pTo": "point", "tPath": "tool", "mPath": "mdesc"}
        return _program(PROGRAM, local, head, language.path_steps(moves))


def _program(name: str, local: dict[str, str], head: list[str], steps: list[language.ProgramStep]) -> bytes:
    lines = ["begin", *head, _NOTE]
    for step in steps:
        joints = ",".join(language.numbers(np.rad2deg(step.joints), _DIGITS))
        lines += [f"  // {step.comment}", f"  jTo={{{joints}}}", *(f"  {each}" for each in _move(step))]
        lines += [f"  delay({step.wait_s:.1f})"] if step.wait_s else []
    code = "\n".join([*lines, "end"])
    variables = [f'      <Local name="{key}" type="{kind}" xsi:type="array" size="1" />' for key, kind in local.items()]
    text = [
        '<?xml version="1.0" encoding="utf-8" ?>',
        f'<Programs xmlns:xsi="{_INSTANCE}" xmlns="{_SPACE}">',
        f'  <Program name="{language.program_name(name)}">',
        "    <Locals>",
        *variables,
        "    </Locals>",
        f"    <Code><![CDATA[{code}]]></Code>",
        "  </Program>",
        "</Programs>",
    ]
    return ("\n".join(text) + "\n").encode("ascii")


def _move(step: language.ProgramStep) -> list[str]:
    """Return the instructions to move to ``jTo``, or to store it as the middle of a circle."""
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
    """Write a pose ``(4, 4)`` (m) in mm and degrees: R = Rx Ry Rz is the inverse of a reversed roll, pitch and yaw."""
    back = se3.roll_pitch_yaw(matrix[:3, :3].T)
    values = [*MM.of(matrix[:3, 3]), *np.rad2deg(-back)]
    return "{" + ",".join(language.numbers(values, _DIGITS)) + "}"
