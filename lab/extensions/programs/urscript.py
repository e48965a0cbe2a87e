"""Write and read URScript, the language of Universal Robots' controllers.

A pose ``p[x, y, z, rx, ry, rz]`` is in m and a rotation vector (rad) in the controller's base, a list ``[...]`` of six
numbers joint positions in rad (Universal Robots, The URScript Programming Language, "movej", "movel", "set_tcp",
"pose_trans", "get_inverse_kin"). No configuration is written: the controller takes the IK solution that is nearest to
the arm's position. Scripts are read for poses, joint positions and the tool.
"""

import re
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.programs import language
from lab.extensions.programs.aggregate import arguments, closing, numbers_in, read_value
from lab.formats.programs.program_text import (
    ROTATION_VECTOR,
    Motion,
    Number,
    Outside,
    ProgramReader,
    ProgramText,
    TargetText,
    Uncorrected,
    line_of,
    masked,
    values_of,
)
from lab.formats.programs.protocol import MeasuringTour, PathMoves, TargetMoves

__all__ = ["UrScript"]

_ASSIGNED = re.compile(r"^[ \t]*(?:(?:global|local)\s+)?(\w+)(\[[^\]\n]*\])?[ \t]*=(?!=)[ \t]*", re.MULTILINE)
_CALL = re.compile(r"(?<![\w.])(def[ \t]+)?(move[jlpc]|servoj|set_tcp)[ \t]*\(")
_GOES_ON = re.compile(r"[ \t]*[-+*/\[]")
_NESTED = re.compile(r"(get_inverse_kin|pose_trans)\s*\(")
_BASE = "base of the robot"


@dataclass
class _Literal:
    """A pose or a list of joint positions in the text."""

    line: int
    numbers: tuple[Number, ...]
    is_pose: bool

    @cached_property
    def pose(self) -> Array:
        """Pose ``(4, 4)`` (m)."""
        return ROTATION_VECTOR.pose(values_of(self.numbers))


@dataclass
class _Named(language.Destination):
    """The literals of a name, or the one literal of a line, and the moves to it."""

    literals: list[_Literal] = field(default_factory=list)


@dataclass
class _UrScriptReader(ProgramReader):
    """Reader of a script."""

    code: str
    tool: str = "tcp"
    named: dict[str, _Named] = field(default_factory=dict)
    inline: list[_Named] = field(default_factory=list)
    unknown: set[str] = field(default_factory=set)

    def read(self) -> ProgramText:
        self.frames = {_BASE: np.eye(4), **self.outside.posed(ROTATION_VECTOR)}
        for match in _ASSIGNED.finditer(self.code):
            literal = None if match[2] else self._literal(match.end())
            if literal is None:
                self.unknown.add(match[1])
            else:
                self.named.setdefault(match[1], _Named(match[1])).literals.append(literal)
        last = 0
        for match in _CALL.finditer(self.code):
            if match.start() >= last and not match[1]:
                last = self._closing(match.end())
                self._call(match[2], arguments(self.code, match.end(), last), match.start(2))
        return self._targets()

    def _closing(self, at: int) -> int:
        """Return the position of the bracket that closes a call open at a character."""
        end = closing(self.code, at)
        if end is None:
            raise LabError(f"line {line_of(self.text, at)}: a bracket is not closed; mend the text")
        return end

    def _literal(self, at: int) -> _Literal | None:
        """Return the six numbers of a pose or a list that begins at a character."""
        is_pose = self.code[at : at + 1] == "p"
        read = read_value(self.code, at + is_pose) if self.code[at + is_pose : at + is_pose + 1] == "[" else None
        numbers = None if read is None else numbers_in(read[0], 6)
        if read is None or numbers is None or _GOES_ON.match(self.code, read[1]):
            return None
        return _Literal(line_of(self.text, numbers[0].start), numbers, is_pose)

    def _call(self, kind: str, parts: list[tuple[int, str]], begins: int) -> None:
        if kind == "set_tcp":
            self._take_tool(parts[0], begins)
            return
        motion: Motion = "joints" if kind in ("movej", "servoj") else "line"
        for at, part in parts[: 2 if kind == "movec" else 1]:
            self._reach(at, part, _BASE, motion, begins)

    def _take_tool(self, argument: tuple[int, str], begins: int) -> None:
        pose = self._frame(*argument)
        self.tool = self.outside.alias(argument[1] if re.fullmatch(r"\w+", argument[1]) else "tcp")
        if pose is not None:
            self.tool = f"tcp of line {line_of(self.text, begins)}"
            self._describe(self.tool, pose)

    def _frame(self, at: int, part: str) -> Array | None:
        """Return the pose ``(4, 4)`` (m) of an argument, where the text has exactly one."""
        literal, named = self._literal(at), self.named.get(part)
        if literal is None and part not in self.unknown and named is not None and len(named.literals) == 1:
            literal = named.literals[0]
        if literal is None or not literal.is_pose:
            return None
        return literal.pose

    def _reach(self, at: int, part: str, base: str, motion: Motion, begins: int) -> None:
        """Record a move to an argument."""
        self._count_move()
        line = line_of(self.text, begins)
        if nested := _NESTED.match(part):
            inner = arguments(self.code, at + nested.end(), self._closing(at + nested.end()))
            if nested[1] == "get_inverse_kin":
                self._reach(*inner[0], base, motion, begins)
                return
            frame, name = self._frame(*inner[0]), f"frame of line {line}"
            if len(inner) == 2 and frame is not None and base == _BASE:
                known = inner[0][1] if re.fullmatch(r"\w+", inner[0][1]) else name
                self._describe(known, frame)
                self._reach(*inner[1], known, motion, begins)
                return
        literal = self._literal(at)
        if literal is not None:
            destination = _Named(f"line {line}", [literal])
            self.inline.append(destination)
        elif part in self.unknown or part not in self.named:
            self._leave(begins, f"{_shortened(part)} is computed")
            return
        else:
            destination = self.named[part]
        destination.reach((self.tool, base), line, motion)

    def _targets(self) -> ProgramText:
        known = [named for name, named in self.named.items() if name not in self.unknown]
        moved = [(literal, named) for named in (*known, *self.inline) if named.moves for literal in named.literals]
        for literal, named in sorted(moved, key=lambda pair: pair[0].numbers[0].start):
            if literal.is_pose and len(named.frames) > 1:
                self.uncorrected.append(Uncorrected(literal.line, named.conflict))
                continue
            target = TargetText(named.name, literal.line, literal.numbers, per_rad=(1.0,) * 6)
            if literal.is_pose:
                ((tool, base),) = named.frames
                target = TargetText(named.name, literal.line, literal.numbers, ROTATION_VECTOR, tool, base)
            self._add(target, named.moves)
        return self._read()


def _shortened(text: str) -> str:
    return text if len(text) < 40 else text[:37] + "..."


_DIGITS = 8  # of a rad: 10 nm at 1 m
_SPEED, _ACCELERATION = 0.5, 0.8  # rad/s, rad/s^2


class UrScript(language.SixAxisLanguage):
    """Scripts for robots with six revolute axes."""

    name = "URScript"
    suffix = ".script"
    reads = (".script", ".urscript")
    spelling = ROTATION_VECTOR
    makers = ("ur3", "ur5", "ur7", "ur8", "ur10", "ur12", "ur15", "ur16", "ur20", "ur30")
    speed = f"{_SPEED:g} rad/s"

    def read(self, text: str, outside: Outside) -> ProgramText:
        """Read the targets and moves of a script."""
        code = masked(masked(text, r"#[^\r\n]*"), '"[^"\r\n]*"', retained="$^")
        return _UrScriptReader(text, outside, code).read()

    def measuring_tour(self, tour: MeasuringTour) -> bytes:
        """Write ``measure_poses``: home, every pose with a wait, home."""
        head = [
            *(f"  # {note}" for note in language.tour_notes(tour)),
        ]
        return _script("measure_poses", head, language.tour_steps(tour))

    def target_moves(self, moves: TargetMoves) -> bytes:
        """Write ``move_to_targets`` through joint positions, with their tool and frame."""
        head = [
            *(f"  # {note}" for note in language.move_notes(moves)),
            "  # Tool and frame suit the controller's nominal links best. They hold where its flange is the last frame",
            "  # of the lab's table, and its base is frame 0 of it.",
            f"  set_tcp({_pose(moves.T_last_tool)})",
            f"  global instrument_frame = {_pose(moves.T_frame0_instrument)}",
        ]
        return _script("move_to_targets", head, language.move_steps(moves))

    def path_moves(self, moves: PathMoves) -> bytes:
        """Write ``move_along_path``; the controller computes poses from joint positions."""
        head = [
            *(f"  # {note}" for note in language.path_notes(moves)),
            f"  set_tcp({_pose(moves.T_last_tool)})",
        ]
        return _script("move_along_path", head, language.path_steps(moves))


def _script(name: str, head: list[str], steps: list[language.ProgramStep]) -> bytes:
    lines = [f"def {name}():", *head]
    via = ""
    for step in steps:
        joints = f"[{', '.join(language.numbers(step.joints, _DIGITS))}]"
        lines.append(f"  # {step.comment}")
        if step.kind == "via":
            via = joints
            continue
        lines.append(f"  {_move(step, joints, via)}")
        lines += [f'  textmsg("{step.comment}")', f"  sleep({step.wait_s:.1f})"] if step.wait_s else []
    return ("\n".join([*lines, "end", f"{name}()"]) + "\n").encode("ascii")


def _move(step: language.ProgramStep, joints: str, via: str) -> str:
    """Return the instruction to move to joint positions; a circle has a speed, as it takes no time."""
    if step.pace is None:
        return f"movej({joints}, a={_ACCELERATION:g}, v={_SPEED:g})"
    if step.kind == "circle":
        return f"movec({via}, {joints}, v={step.pace.mm_s / 1e3:.4f}, mode=0)"
    return f"{'movel' if step.kind == 'line' else 'movej'}({joints}, t={step.pace.seconds:.4f})"


def _pose(matrix: Array) -> str:
    """Write a pose ``(4, 4)`` (m) as position and rotation vector."""
    values = np.concatenate([matrix[:3, 3], se3.log(matrix[:3, :3])])
    return f"p[{', '.join(language.numbers(values, _DIGITS))}]"
