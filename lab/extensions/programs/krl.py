"""Write and read KRL, the language of KUKA's controllers (KR C).

Joint positions are in degrees, lengths in mm; A turns about z, B about the new y, C about the new x (KUKA System
Software, Operating and Programming Instructions for System Integrators, "FRAME").

Modules and data lists are read for their positions, axis positions, tools and bases. S and T of a position select the
IK solution: bit 0 of S is one where the wrist is behind axis 1, and bits 0 to 5 of T are one where axes 1 to 6 are
negative ("Status and Turn"). The other bits of S follow from these, except for arms that can bend their elbow both ways
with equal signs; then the nearest solution to the position before is taken. A tool or a base that is set in a line is
called $TOOL@LINE or $BASE@LINE.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.extensions.programs import language
from lab.extensions.programs.aggregate import arguments
from lab.formats.programs.program_text import (
    MOVING_ZYX,
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
    values_of,
    whole_number,
)
from lab.formats.programs.protocol import PROGRAM, MeasuringTour, PathMoves, TargetMoves

__all__ = ["Krl"]

_STATEMENT = re.compile(r"[^\r\n]+")
_MOVE = re.compile(
    r"^\s*(S?PTP|S?LIN|S?CIRC|PTP_REL|LIN_REL|S?SPL|CIRC_REL|SPTP_REL|SLIN_REL)\b\s*(.*)$", re.IGNORECASE
)
_GIVEN = re.compile(
    r"^\s*(?:(?:GLOBAL|DECL|CONST)\s+)*(?:(E6POS|POS|FRAME|E6AXIS|AXIS|FDAT)\s+)?(\$?[\w.]+(?:\[\d+\])?)\s*=\s*(.+)$",
    re.IGNORECASE,
)
_PART = re.compile(rf"\b([A-Z]\w*)\s+({NUMBER})(?![\w.])", re.IGNORECASE)
_BAS = re.compile(r"^\s*BAS\s*\(\s*#(TOOL|BASE)\s*,\s*(\d+)\s*\)", re.IGNORECASE)
_FORM = re.compile(r"\bFDAT\s+F([\w.]*(?:\[\d+\])?)\s*=\s*\{([^{}]*)\}", re.IGNORECASE)
_PLACE, _AXES = tuple("XYZABC"), tuple(f"A{i}" for i in range(1, 7))
_SLACK_RAD = np.deg2rad(0.05)


@dataclass
class _Position(language.Destination):
    """A position of the text, by its name or its line."""

    line: int
    parts: dict[str, Number]

    @property
    def is_pose(self) -> bool:
        return set(_PLACE) <= set(self.parts)

    @property
    def is_axes(self) -> bool:
        return set(_AXES) <= set(self.parts) and "X" not in self.parts


@dataclass
class _KrlReader(ProgramReader):
    """Reader of a module, line by line: KRL's statements end with the line."""

    code: str
    tool: str = "$TOOL"
    base: str = "$BASE"
    forms: dict[str, str] = field(default_factory=dict)  # contents of inline forms, by name without the F
    positions: dict[str, _Position] = field(default_factory=dict)
    assigned: set[str] = field(default_factory=set)

    def read(self) -> ProgramText:
        root = {name: np.eye(4) for name in ("$NULLFRAME", "$WORLD", "$ROBROOT")}
        self.frames = root | {name.upper(): T for name, T in self.outside.posed(MOVING_ZYX).items()}
        for statement in self._statements():
            if assignment := _GIVEN.match(statement[0]):
                self._declare(assignment, statement.start())
        for statement in self._statements():
            if moved := _MOVE.match(statement[0]):
                self._move(moved[1].upper(), moved[2].strip(), statement.start() + moved.start(2))
            elif bas := _BAS.match(statement[0]):
                self._take(bas[1], f"{bas[1].upper()}_DATA[{whole_number(bas[2])}]")
            elif (assignment := _GIVEN.match(statement[0])) and assignment[2].upper() in ("$TOOL", "$BASE"):
                self._take(assignment[2][1:], assignment[3], statement.start() + assignment.start(3))
        return self._targets()

    def _statements(self) -> Iterator["re.Match[str]"]:
        """Yield the lines that are not blank."""
        return (match for match in _STATEMENT.finditer(self.code) if not match[0].isspace())

    def _take(self, what: str, source: str, at: int = 0) -> None:
        """Set the tool or the base from here on."""
        name = _named(self.outside.alias(re.sub(r"\s", "", source).upper()))
        if name.startswith("{"):
            parts = self._parts(source, at)
            name = self._in_line(what, at)
            if set(_PLACE) <= set(parts):
                self._describe(name, MOVING_ZYX.pose(values_of([parts[key] for key in _PLACE])))
        elif name not in self.frames and re.search(r"[^\w$\[\].]", name):
            name = self._in_line(what, at)
        if what.upper() == "TOOL":
            self.tool = name
        else:
            self.base = name

    def _in_line(self, what: str, at: int) -> str:
        """Return the name of the tool or base to which a line assigns a value."""
        line = line_of(self.text, at)
        name = f"${what.upper()}@{line}"
        self.computed[name] = line
        return name

    def _parts(self, source: str, at: int) -> dict[str, Number]:
        """Return the named numbers of a structure that begins at a character."""
        return {part[1].upper(): Number(at + part.start(2), part[2]) for part in _PART.finditer(source)}

    def _declare(self, assignment: "re.Match[str]", at: int) -> None:
        kind, name, source = (assignment[1] or "").upper(), assignment[2].upper(), assignment[3].rstrip()
        if kind == "FDAT" or name in ("$TOOL", "$BASE", "$H_POS"):
            return
        whole = source.startswith("{") and source.endswith("}")
        parts = self._parts(source, at + assignment.start(3)) if whole else {}
        position = _Position(assignment[2], line_of(self.text, at), parts)
        if position.is_pose and _may_be_frame(kind, name):
            self._declare_frame(name, position)
            if kind != "FRAME":  # which may be a position besides
                return
        self._declare_position(name, position, at)

    def _declare_frame(self, name: str, position: _Position) -> None:
        """Record the first value of a tool or a base."""
        if name not in self.frames:
            self._describe(name, MOVING_ZYX.pose(values_of([position.parts[key] for key in _PLACE])))

    def _declare_position(self, name: str, position: _Position, at: int) -> None:
        """Record a position; one that is declared twice, or of which a part is assigned, is computed."""
        head = name.split(".")[0]
        if name == head and (position.is_pose or position.is_axes):
            if name in self.positions:
                self.assigned.add(name)
            self.positions.setdefault(name, position)
        elif head in self.positions:
            self.assigned.add(head)
            self._leave(at, f"{position.name} is computed")

    def _move(self, kind: str, source: str, at: int) -> None:
        if kind.endswith("_REL"):
            self._leave(at, f"{kind} is relative to where the arm is")
            return
        motion: Motion = "joints" if kind in ("PTP", "SPTP") else "line"
        wanted = 2 if kind in ("CIRC", "SCIRC") else 1
        for begin, part in arguments(source, 0, len(source))[:wanted]:
            self._reach(part, at + begin, motion)

    def _reach(self, part: str, at: int, motion: Motion) -> None:
        """Record a move to an argument: a structure, or a name."""
        self._count_move()
        line = line_of(self.text, at)
        structure = re.match(r"\{[^{}]*\}", part)
        name = re.match(r"[\w$.]+(?:\[\d+\])?", part)
        begins = structure or name
        if begins and part[begins.end() :].lstrip().startswith(":"):
            self._leave(at, f"{part} is computed")
            return
        if structure:
            self._reach_structure(structure[0], line, at, motion)
            return
        known = self.positions.get(name[0].upper()) if name else None
        if known is None or known.name.upper() in self.assigned:
            self._leave(at, f"{name[0] if name else part} is {'computed' if known else 'not in this file'}")
            return
        known.reach((self.tool, self.base), line, motion)

    def _reach_structure(self, source: str, line: int, at: int, motion: Motion) -> None:
        """Record a position that is written in the line that moves to it."""
        position = _Position(f"line {line}", line, self._parts(source, at))
        if not position.is_pose and not position.is_axes:
            self._leave(at, "what this position leaves out is kept from where the arm is")
            return
        position.reach((self.tool, self.base), line, motion)
        self.positions[f"line {line} {at}"] = position

    def _of_data(self, name: str) -> set[tuple[str, str]]:
        """Return tool and base of a position's inline form: F and its name without the X."""
        form = self.forms.get(name[1:], "") if name.startswith("X") else ""
        numbers = dict(re.findall(r"\b(TOOL_NO|BASE_NO)\s+(\d+)", form))
        if len(numbers) < 2 or "#TCP" in form:
            return set()
        tool, base = (f"{key}_DATA[{numbers[f'{key}_NO']}]" for key in ("TOOL", "BASE"))
        return {(_named(self.outside.alias(tool)), _named(self.outside.alias(base)))}

    def _targets(self) -> ProgramText:
        for form in _FORM.finditer(self.code):
            self.forms.setdefault(form[1].upper(), form[2].upper())
        for key, position in sorted(self.positions.items(), key=lambda item: item[1].line):
            if key in self.assigned:
                self.uncorrected.append(Uncorrected(position.line, f"{position.name} is computed"))
            elif position.is_axes:
                numbers = tuple(position.parts[axis] for axis in _AXES)
                moves: list[tuple[int, Motion]] = [(line, "joints") for line, _ in position.moves]
                self._add(TargetText(position.name, position.line, numbers), moves)
            else:
                self._add_pose(key, position)
        return self._read()

    def _add_pose(self, key: str, position: _Position) -> None:
        """Add a position as a target, where moves to it agree on tool and base."""
        frames = self._of_data(key) or position.frames
        if not frames and "S" in position.parts:
            frames = {("$TOOL", "$BASE")}  # of a data list without inline forms
        if len(frames) == 1:
            ((tool, base),) = frames
            numbers = tuple(position.parts[part] for part in _PLACE)
            allowed = _allowed(position)
            target = TargetText(position.name, position.line, numbers, MOVING_ZYX, tool, base, allowed=allowed)
            self._add(target, position.moves)
        elif frames:
            self.uncorrected.append(Uncorrected(position.line, position.conflict))


def _may_be_frame(kind: str, name: str) -> bool:
    """Decide whether a declared pose may be a tool or a base."""
    return kind == "FRAME" or "_DATA[" in name or name.startswith("$")


def _named(name: str) -> str:
    """Rename tool 0 and base 0, which are the flange and the world."""
    return "$NULLFRAME" if name in ("TOOL_DATA[0]", "BASE_DATA[0]") else name


def _allowed(position: _Position) -> Allowed | None:
    """Return the test of the signs of the axes, and of the side of axis 1."""
    if "T" not in position.parts and "S" not in position.parts:
        return None
    status = int(values_of([position.parts["S"]])[0]) if "S" in position.parts else None
    turn = int(values_of([position.parts["T"]])[0]) if "T" in position.parts else None

    def allowed(shape: ArmShape, joints: Array) -> NDArray[np.bool_]:
        fits = np.ones(len(joints), dtype=np.bool_)
        if status is not None:
            fits &= shape.in_front(joints) == (status & 1 == 0)
        if turn is not None:
            for axis in range(6):
                negative = bool(turn >> axis & 1)
                fits &= joints[:, axis] <= _SLACK_RAD if negative else joints[:, axis] >= -_SLACK_RAD
        return np.asarray(fits)

    return allowed


_DIGITS = 6
_PER_CENT = 20


class Krl(language.SixAxisLanguage):
    """Modules for robots with six revolute axes."""

    name = "KRL"
    suffix = ".src"
    reads = (".src", ".dat", ".sub")
    spelling = MOVING_ZYX
    makers = ("kuka", "kr", "agilus")
    speed = f"{_PER_CENT} % of the joints' speed"

    def read(self, text: str, outside: Outside) -> ProgramText:
        """Read the targets and moves of a module (.src) or a data list (.dat)."""
        return _KrlReader(text, outside, masked(text, r"[;&][^\r\n]*")).read()

    def measuring_tour(self, tour: MeasuringTour) -> bytes:
        """Write the program of the file's name: home, every pose with a wait, home."""
        head = [
            *(f"; {note}" for note in language.tour_notes(tour)),
            "; Declare the tool's load before.",
        ]
        return _module(tour.file_name, head, [], language.tour_steps(tour))

    def target_moves(self, moves: TargetMoves) -> bytes:
        """Write ``program`` through axis positions, with their tool and base."""
        head = [
            *(f"; {note}" for note in language.move_notes(moves, "axes")),
            "; $TOOL and $BASE suit the controller's nominal links best. They hold where its flange is the last",
            "; frame of the lab's table, and its robot root is frame 0 of it. Declare the tool's load before.",
        ]
        frames = [f"$TOOL = {_frame(moves.T_last_tool)}", f"$BASE = {_frame(moves.T_frame0_instrument)}"]
        return _module(PROGRAM, head, frames, language.move_steps(moves))

    def path_moves(self, moves: PathMoves) -> bytes:
        """Write ``program``; lines and circles are of the tool in the points' base."""
        head = [
            *(f"; {note}" for note in language.path_notes(moves)),
            "; $TOOL and $BASE hold where the flange is the last frame of the lab's table, and the robot root is",
            "; frame 0 of it. Declare the tool's load before.",
        ]
        frames = [f"$TOOL = {_frame(moves.T_last_tool)}", f"$BASE = {_frame(moves.T_frame0_base)}"]
        frames += ["$ORI_TYPE = #VAR", "$CIRC_TYPE = #BASE"]
        return _module(PROGRAM, head, frames, language.path_steps(moves))


def _module(name: str, head: list[str], frames: list[str], steps: list[language.ProgramStep]) -> bytes:
    lines = [f"DEF {language.program_name(name)}()", *head, "BAS(#INITMOV, 0)", f"BAS(#VEL_PTP, {_PER_CENT})"]
    lines += frames
    via = ""
    for step in steps:
        lines.append(f"; {step.comment}")
        if step.kind == "via":
            via = _position(step)
            continue
        lines += _move(step, via)
        lines += [f"WAIT SEC {step.wait_s:.1f}"] if step.wait_s else []
    return ("\r\n".join(["&ACCESS RVO", *lines, "END"]) + "\r\n").encode("ascii")


def _move(step: language.ProgramStep, via: str) -> list[str]:
    """Return the instructions to move to a waypoint, after its speed."""
    if step.kind in ("line", "circle") and step.pace is not None:
        move = f"CIRC {via}, {_position(step)}" if step.kind == "circle" else f"LIN {_position(step)}"
        return [f"$VEL.CP = {step.pace.mm_s / 1e3:.4f}", move]
    angles = language.numbers(np.rad2deg(step.joints), _DIGITS)
    axes = ", ".join(f"A{i} {angle}" for i, angle in enumerate(angles, start=1))
    speed = [] if step.pace is None else [f"BAS(#VEL_PTP, {step.pace.per_cent})"]
    return [*speed, f"PTP {{AXIS: {axes}}}"]


def _position(step: language.ProgramStep) -> str:
    assert step.T is not None
    return _frame(step.T)


def _frame(matrix: Array) -> str:
    """Write a pose ``(4, 4)`` (m) in mm and degrees."""
    x, y, z, c, b, a = language.place_and_turns(matrix, _DIGITS)
    return f"{{X {x}, Y {y}, Z {z}, A {a}, B {b}, C {c}}}"
