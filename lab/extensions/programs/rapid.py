"""Write and read modules in RAPID, the language of ABB's controllers (IRC5, OmniCore).

Modules are read for their robtargets and jointtargets, tools and work objects. In a robtarget, trans is in mm, rot is
a quaternion q1..q4 (wxyz), and robconf has the quarter turns of axes 1, 4 and 6 and cfx, which is odd where axis 5 is
negative, and 4 or more where the wrist is behind axis 1 (ABB, Technical reference manual RAPID Instructions, Functions
and Data types, "robtarget", "confdata", "tooldata", "wobjdata").
"""

import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.programs import language
from lab.extensions.programs.aggregate import Value, arguments, numbers_in, read_value
from lab.formats.programs.program_text import (
    QUATERNION,
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
)
from lab.formats.programs.protocol import PAUSE_S, MeasuringTour, PathMoves, TargetMoves

__all__ = ["Rapid"]

_DECLARED = re.compile(
    r"\b(?:CONST|VAR|PERS)\s+(robtarget|jointtarget|tooldata|wobjdata)\s+(\w+)\s*(\{[^{}]*\})?\s*(:=)?", re.IGNORECASE
)
_MOVE = re.compile(
    r"\b(Move(?:AbsJ|[JLC])\w*|(?:Trigg|Arc|Spot|Search|Paint)[JLC]\w*)\b(?!\s*:=)([^;]*);", re.IGNORECASE
)
_LINEAR = re.compile(r"(?:move|trigg|arc|spot|search|paint)[lc]")
_DISPLACED = re.compile(r"\b(PDispOn|PDispSet|EOffsOn|EOffsSet)\b", re.IGNORECASE)
_ASSIGNED = re.compile(
    r"(?:^[^\S\n]*|(?:;|\bTHEN|\bDO|\bELSE)\s*)(\w+)\s*(?:\{[^{}]*\}(?:\.\w+)*\s*|(?:\.\w+)+\s*)?:=",
    re.IGNORECASE | re.MULTILINE,
)
_OF_WORK_OBJECT = re.compile(r"\\\s*WObj\s*:=\s*([\w{}]+)", re.IGNORECASE)
_CALL = re.compile(r"(\w+)\s*\(")
_NAME = re.compile(r"[^{\s]*")
_SLACK_RAD = np.deg2rad(0.5)  # of a quarter turn: taught poses are rounded
_NO_AXIS = 9e8


@dataclass
class _Declared(language.Destination):
    """A robtarget, a jointtarget or an array of them, and the tools and objects of its moves."""

    kind: str
    line: int
    entries: list[Value]


@dataclass
class _RapidReader(ProgramReader):
    """Reader of a module: its text without comments, and without strings too."""

    data: str
    code: str
    declared: dict[str, _Declared] = field(default_factory=dict)

    def read(self) -> ProgramText:
        self.frames = {"tool0": np.eye(4), "wobj0": np.eye(4), **_lower(self.outside.posed(QUATERNION))}
        names = {match.start(2): match for match in _DECLARED.finditer(self.code)}
        assigned = {match[1].lower() for match in _assigned(self.code) if match.start(1) not in names}
        for match in names.values():
            self._declare(match, match[2].lower() in assigned)
        for match in _DISPLACED.finditer(self.code):
            self._leave(match.start(), f"{match[1]} displaces what follows, which is corrected where it is written")
        for match in _MOVE.finditer(self.code, 0, self.code.rfind(";") + 1):
            self._move(match)
        return self._targets()

    def _declare(self, match: "re.Match[str]", assigned: bool) -> None:
        kind, name, at = match[1].lower(), match[2], match.start(2)
        is_target = kind in ("robtarget", "jointtarget")
        read = read_value(self.data, match.end()) if match[4] else None
        if read is None or assigned:
            self._leave_computed(match, is_target, "is computed" if read is None else "is computed by an assignment")
        elif is_target:
            entries = _flat(read[0], match[3].count(",") + 1) if match[3] else [read[0]]
            self.declared[name.lower()] = _Declared(name, kind, line_of(self.text, at), entries)
        elif name.lower() not in self.frames:
            self._declare_frame(kind, name, read[0], at)

    def _leave_computed(self, match: "re.Match[str]", is_target: bool, how: str) -> None:
        """Leave a declared name whose value the text does not have."""
        name, at = match[2], match.start(2)
        if not is_target:
            self.computed[name.lower()] = line_of(self.text, at)
        if match[4]:
            self._leave(at, f"{name} {how}")
        elif is_target:
            self._leave(at, f"{name} has no value here: it is computed")

    def _declare_frame(self, kind: str, name: str, value: Value, at: int) -> None:
        """Record the pose of a tool or a work object."""
        posed = _tool(value) if kind == "tooldata" else _work_object(value)
        if posed is None:
            what = "is not held by the robot" if kind == "tooldata" else "is moved by another unit"
            self._leave(at, f"{name} {what}, or cannot be read: give it by --frames")
        else:
            self._describe(name.lower(), posed)

    def _move(self, match: "re.Match[str]") -> None:
        kind, parts = match[1].lower(), arguments(self.code, match.start(2), match.end(2))
        placed = [(at, part) for at, part in parts if not part.startswith("\\")]
        heads = [part.partition("\\")[0].rstrip() for _, part in placed]
        usual = kind.startswith("move")
        wanted = 2 if re.search(r"(?:move|trigg|arc|paint|search)c", kind) else 1
        at_targets = self._arguments_of_targets(heads, usual)[:wanted]
        if not usual and len(at_targets) < wanted:
            self._leave(match.start(), f"{match[1]}: its target is not in this module")
            return
        if len(heads) < wanted + 2:
            self._leave(match.start(), f"{match[1]} cannot be read")
            return
        frames = (self.outside.alias(heads[-1]).lower(), self._work_object_of(match))
        motion: Motion = "line" if _LINEAR.match(kind) else "joints"
        for i in at_targets:
            self._reach(placed[i][0], heads[i], frames, motion, match.start())

    def _arguments_of_targets(self, heads: list[str], usual: bool) -> list[int]:
        """Return which arguments may be targets: any of the usual instructions."""
        return [i for i, head in enumerate(heads) if usual or self._is_target(head)]

    def _work_object_of(self, match: "re.Match[str]") -> str:
        """Return the work object of a move."""
        base = _OF_WORK_OBJECT.search(self.code, match.start(2), match.end(2))
        return self.outside.alias(base[1]).lower() if base else "wobj0"

    def _is_target(self, head: str) -> bool:
        return head.startswith("[") or bool(_CALL.match(head)) or self._named(head) is not None

    def _named(self, head: str) -> _Declared | None:
        """Return the declaration of the name with which an argument begins."""
        name = _NAME.match(head)
        return self.declared.get(name[0].lower()) if name else None

    def _reach(self, at: int, head: str, frames: tuple[str, str], motion: Motion, begins: int) -> None:
        """Record a move to an argument."""
        self._count_move()
        line = line_of(self.text, begins)
        if call := _CALL.match(head):
            inner = re.findall(r"\w+", head)[1:2]
            known = self.declared.get(inner[0].lower()) if inner else None
            follows = f"; it follows the correction of {known.name}" if known else ""
            self._leave(begins, f"{call[1]}(...) is computed{follows}")
            if known:
                known.frames.add(frames)
            return
        if head.startswith("["):
            read = read_value(self.data, at)
            if read is None:
                self._leave(begins, "a target with computed numbers")
                return
            joint = isinstance(read[0], list) and len(read[0]) == 2
            inline = _Declared(f"line {line}", "jointtarget" if joint else "robtarget", line, [read[0]])
            inline.reach(frames, line, motion)
            self.declared[f"line {line} {at}"] = inline
            return
        known = self._named(head)
        if known is None:
            self._leave(begins, f"{head}: its value is not in this module")
            return
        known.reach(frames, line, motion)

    def _targets(self) -> ProgramText:
        for declared in sorted(self.declared.values(), key=lambda declared: declared.line):
            if declared.kind == "robtarget" and len(declared.frames) != 1:
                why = declared.conflict if declared.frames else f"{declared.name} is not moved to in this module"
                self.uncorrected.append(Uncorrected(declared.line, why))
                continue
            for i, entry in enumerate(declared.entries):
                name = declared.name if len(declared.entries) == 1 else f"{declared.name}{{{i + 1}}}"
                target = self._target(declared, name, entry)
                if target is None:
                    self.uncorrected.append(Uncorrected(declared.line, f"{name} cannot be read as a {declared.kind}"))
                    continue
                self._add(target, declared.moves if len(declared.entries) == 1 else ())
        return self._read()

    def _target(self, declared: _Declared, name: str, entry: Value) -> TargetText | None:
        if not isinstance(entry, list):
            return None
        line = declared.line if not (first := _first(entry)) else line_of(self.text, first.start)
        if declared.kind == "robtarget":
            return self._robtarget(declared, name, line, entry)
        joints = numbers_in(entry[0], 6) if len(entry) == 2 else None
        return None if joints is None else TargetText(name, line, joints)

    def _robtarget(self, declared: _Declared, name: str, line: int, entry: list[Value]) -> TargetText | None:
        """Read ``[trans, rot, robconf, extax]``; None where it is something else."""
        counts = (3, 4, 4, 6)
        if len(entry) != len(counts):
            return None
        parts = [numbers for part, count in zip(entry, counts, strict=True) if (numbers := numbers_in(part, count))]
        if len(parts) < len(counts):
            return None
        place, turn, configuration, others = parts
        if not 0.99 < np.linalg.norm(values_of(turn)) < 1.01:
            return None
        if (values_of(others) < _NO_AXIS).any():
            self.uncorrected.append(
                Uncorrected(line, f"{name} has external axes: they stay, and are taken not to move the robot")
            )
        ((tool, base),) = declared.frames
        return TargetText(name, line, (*place, *turn), QUATERNION, tool, base, allowed=_allowed(configuration))


def _assigned(code: str) -> Iterator["re.Match[str]"]:
    """Find assignments to names; each is matched between its := and the text before it."""
    last, at = 0, code.find(":=")
    while at >= 0:
        if match := _ASSIGNED.search(code, max(code.rfind(";", last, at), last), at + 2):
            yield match
        last, at = at + 2, code.find(":=", at + 2)


def _lower(frames: dict[str, Array]) -> dict[str, Array]:
    """Return frames by names in lower case: RAPID ignores case."""
    return {name.lower(): T for name, T in frames.items()}


def _flat(value: Value, depth: int) -> list[Value]:
    """Return the entries of an array of so many dimensions."""
    if depth == 0 or not isinstance(value, list):
        return [value]
    return [entry for part in value for entry in _flat(part, depth - 1)]


def _first(value: Value) -> Number | None:
    """Return the first number."""
    while isinstance(value, list) and value:
        value = value[0]
    return value if isinstance(value, Number) else None


def _pose(value: Value) -> Array | None:
    """Return a pose ``(4, 4)`` (m) from ``[[x,y,z],[q1,q2,q3,q4]]``."""
    if not isinstance(value, list) or len(value) != 2:
        return None
    place, turn = numbers_in(value[0], 3), numbers_in(value[1], 4)
    if place is None or turn is None or not np.linalg.norm(values_of(turn)) > 0:
        return None
    return QUATERNION.pose(values_of((*place, *turn)))


def _tool(value: Value) -> Array | None:
    """Return the frame of ``[robhold, tframe, tload]``; None unless the robot holds it."""
    if not isinstance(value, list) or len(value) != 3 or str(value[0]).upper() != "TRUE":
        return None
    return _pose(value[1])


def _work_object(value: Value) -> Array | None:
    """Return the frame of ``[robhold, ufprog, ufmec, uframe, oframe]``; None unless it is fixed."""
    if not isinstance(value, list) or len(value) != 5:
        return None
    if (str(value[0]).upper(), str(value[1]).upper(), value[2]) != ("FALSE", "TRUE", '""'):
        return None
    user, of_user = _pose(value[3]), _pose(value[4])
    return None if user is None or of_user is None else np.asarray(user @ of_user)


def _allowed(configuration: Sequence[Number]) -> Allowed:
    """Return the test of the quarter turns of axes 1, 4 and 6, the sign of axis 5, and the side of axis 1."""
    *quarters, last = values_of(configuration).tolist()
    cfx = int(last)

    def allowed(shape: ArmShape, joints: Array) -> NDArray[np.bool_]:
        fits = np.ones(len(joints), dtype=np.bool_)
        for axis, quarter in zip((0, 3, 5), quarters, strict=True):
            low = quarter * np.pi / 2
            fits &= (joints[:, axis] >= low - _SLACK_RAD) & (joints[:, axis] <= low + np.pi / 2 + _SLACK_RAD)
        fits &= np.where(cfx % 2, joints[:, 4] <= _SLACK_RAD, joints[:, 4] >= -_SLACK_RAD)
        return np.asarray(fits & (shape.in_front(joints) == (cfx < 4)))

    return allowed


_AXES = 6
_SPEED = "v200"
_MAX_NAME = 32
_MAX_FIRST = 12  # characters of the first id in a name
_MAX_ID = 60  # characters of an id in a comment
_PREFIX = "j_"  # of joint targets: no reserved word and nothing of the controller begins so
_TOOL, _WORK_OBJECT = "calibration_tool", "instrument_frame"
_PATH_TOOL = "path_tool"
_LOAD = "[1,[0,0,1],[1,0,0,0],0,0,0]"  # a controller moves no tool without a mass and a centre
_SAME = "[[0,0,0],[1,0,0,0]]"  # the object's frame is the user's
_NO_AXES = "[" + ",".join(["9E+09"] * _AXES) + "]"  # external axes that are not there


class Rapid(language.SixAxisLanguage):
    """Modules for robots with six revolute axes, as joint targets of RAPID have."""

    name = "RAPID"
    suffix = ".mod"
    reads = (".mod", ".modx", ".prg", ".sys", ".sysx")
    spelling = QUATERNION
    makers = ("abb", "irb")
    speed = _SPEED
    _refused = "no {} module: a joint target has six revolute axes"

    def read(self, text: str, outside: Outside) -> ProgramText:
        """Read the targets and moves of a module."""
        data = masked(text, r"![^\r\n]*")
        return _RapidReader(text, outside, data, masked(data, '"[^"\r\n]*"', retained="$^")).read()

    def measuring_tour(self, tour: MeasuringTour) -> bytes:
        """Write the procedure ``measure_poses_from_1`` (the first id): home, every pose with a wait, home."""
        ids = tour.ids
        end = f"_from_{_name(ids[0])[:_MAX_FIRST]}"  # so that a plan and what extends it can both be loaded
        routine = _name("measure_poses", end)
        names, moves = ["home"], ["    TPErase;", _move("home", "tool0")]
        pose_names = _distinct_names([_pose_stem(each) for each in ids])
        pose, via = 0, 0
        for is_pose in tour.measured[1:-1] >= 0:
            if not is_pose:
                via += 1
                names.append(f"via{via:03d}")
                moves.append(_move(names[-1], "tool0"))
                continue
            names.append(pose_names[pose])
            moves += [
                _move(names[-1], "tool0"),
                f'    TPWrite "Pose {language.ascii_text(ids[pose])}: {pose + 1} of {len(ids)}";',
                f"    WaitTime {PAUSE_S};",
            ]
            pose += 1
        waypoints = tour.waypoints[:-1]  # the last is home again
        targets = [_joint_target(name, row) for name, row in zip(names, _degrees(waypoints), strict=True)]
        moves += [_move("home", "tool0"), '    TPWrite "All poses measured";']
        head = [
            f"  ! {len(ids)} poses to measure, ids as in plan.csv, in an order that is short at full joint speed.",
            _checked(tour.checked),
            f"  ! {language.COMPARE_ONE_POSE}",
            f"  ! Declare the tool's load in place of tool0. Call {routine} from your main routine.",
        ]
        name = _name(f"plan_{tour.robot}", end)
        return _module(name, [*head, *targets], routine, moves)

    def target_moves(self, moves: TargetMoves) -> bytes:
        """Write the procedure ``move_to_targets`` through joint targets, and their frames."""
        ids = moves.ids
        head = [
            f"  ! {len(ids)} corrected joint targets. The correction is in the joint angles: move with MoveAbsJ.",
            _checked(moves.checked),
            f"  ! {_TOOL} and {_WORK_OBJECT} suit the controller's nominal links best. They hold where tool0 is",
            "  ! the last frame of the lab's table, and world is frame 0 of it.",
            f"  ! CalcRobT(<a target>, {_TOOL} \\WObj:={_WORK_OBJECT}) makes a robtarget of one, with its",
            "  ! configuration, by the controller's own nominal model: the same joint angles, so as well corrected.",
        ]
        data = [
            "  ! The load is a placeholder: declare the real one.",
            f"  PERS tooldata {_TOOL}:=[TRUE,{_pose_text(moves.T_last_tool)},{_LOAD}];",
            f'  PERS wobjdata {_WORK_OBJECT}:=[FALSE,TRUE,"",{_pose_text(moves.T_frame0_instrument)},{_SAME}];',
        ]
        names = _distinct_names([_PREFIX + each for each in ids])
        targets, lines, via = [], ["    TPErase;"], 0
        for i, degrees in zip(moves.which.tolist(), _degrees(moves.waypoints), strict=True):
            via += i < 0
            name = names[i] if i >= 0 else f"via{via:03d}"
            targets += [f"  ! id {_shortened(ids[i])!a}"] if i >= 0 and name != _PREFIX + ids[i] else []
            targets.append(_joint_target(name, degrees))
            lines.append(_move(name, _TOOL))
            lines += [f'    TPWrite "{name}: {i + 1} of {len(ids)}";'] if i >= 0 else []
        return _module(_name(f"program_{moves.robot}"), [*head, *data, *targets], "move_to_targets", lines)

    def path_moves(self, moves: PathMoves) -> bytes:
        """Write the procedure ``move_along_path``: joint targets, with robtargets of lines and circles."""
        head = [
            f"  ! A path of {moves.robot!a} through {len(moves.ids)} points, {np.nansum(moves.seconds):.3f} s planned.",
            *(["  ! The correction is in the joint angles at the points."] if moves.corrected else []),
            _checked(moves.checked),
            f"  ! {language.COMPARE_ONE_POSE}",
            "  ! The load is a placeholder: declare the real one.",
            f"  PERS tooldata {_PATH_TOOL}:=[TRUE,{_pose_text(moves.T_last_tool)},{_LOAD}];",
        ]
        targets, lines, via = [], list[str](), ""
        names = _distinct_names([f"{_PREFIX}{i + 1}_{each}" for i, each in enumerate(moves.ids)])
        for step, name, degrees in zip(language.path_steps(moves), names, _degrees(moves.waypoints), strict=True):
            targets.append(_joint_target(name, degrees))
            robtarget = f"CalcRobT({name},{_PATH_TOOL})"
            if step.kind == "via":
                via = robtarget
            elif step.pace is None:
                lines.append(_move(name, _PATH_TOOL))
            else:
                to = {"joint": f"MoveAbsJ {name}", "line": f"MoveL {robtarget}", "circle": f"MoveC {via},{robtarget}"}
                lines.append(f"    {to[step.kind]},{_SPEED}\\T:={step.pace.seconds:.4f},fine,{_PATH_TOOL};")
        return _module(_name(f"path_{moves.robot}"), [*head, *targets], "move_along_path", lines)


def _checked(checked: bool) -> str:
    return f"  ! {language.check_comment(checked).removesuffix('.')}, in manual mode."


def _shortened(text: str) -> str:
    """Shorten a text for a controller's line length."""
    return text if len(text) <= _MAX_ID else text[: _MAX_ID - 3] + "..."


def _pose_stem(id_: str) -> str:
    """Return the name of a pose to measure: ``pose012`` of 12, ``pose001_2`` of the second visit 1_2."""
    number, rest = re.match(r"(\d*)(.*)", id_, re.DOTALL).groups()  # type: ignore[union-attr]
    return f"pose{number:>03}{rest}"


def _distinct_names(texts: Sequence[str]) -> list[str]:
    """Return a legal name for each text, none twice; RAPID ignores case."""
    names: dict[str, str] = {}
    next_of: dict[str, int] = {}  # next number, of texts with equal beginnings
    for each in texts:
        stem = _name(each)
        for i in itertools.count(next_of.get(stem.lower(), 1)):
            name = _name(each, f"_{i}" if i > 1 else "")
            if name.lower() not in names:
                break
        next_of[stem.lower()] = i + 1
        names[name.lower()] = name
    return list(names.values())


def _name(text: str, end: str = "") -> str:
    """Return a legal name that begins like ``text``, which begins with a letter, and has this end."""
    return re.sub(r"[^A-Za-z0-9_]", "_", text)[: _MAX_NAME - len(end)] + end


def _module(name: str, declarations: Sequence[str], routine: str, moves: Sequence[str]) -> bytes:
    """Write a module's file: ASCII, with the line ends of controllers."""
    body = [*declarations, "", f"  PROC {routine}()", *moves, "  ENDPROC"]
    return ("\r\n".join([f"MODULE {name}", *body, "ENDMODULE"]) + "\r\n").encode("ascii")


def _joint_target(name: str, degrees: str) -> str:
    return f"  LOCAL CONST jointtarget {name}:=[{degrees},{_NO_AXES}];"


def _move(target: str, tool: str) -> str:
    return f"    MoveAbsJ {target},{_SPEED},fine,{tool};"


def _degrees(waypoints: Array) -> Iterator[str]:
    """Write six angles of each waypoint ``(s, 6)``; a millionth of a degree moves a point 1 m away by 17 nm."""
    degrees = np.rad2deg(waypoints).round(6) + 0.0
    return (f"[{','.join(f'{value:.6f}' for value in row)}]" for row in degrees.tolist())


def _pose_text(matrix: Array) -> str:
    """Write a pose ``(4, 4)`` (m) in millimetres and as a quaternion wxyz."""
    quaternion = se3.quaternion_from_rotation(matrix[:3, :3])
    return f"[{_list(MM.of(matrix[:3, 3]), 6)},{_list(quaternion, 9)}]"


def _list(values: Array, digits: int) -> str:
    return "[" + ",".join(f"{value + 0.0:.{digits}f}" for value in values.round(digits)) + "]"
