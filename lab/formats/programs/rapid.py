"""A measuring tour and compensated targets as modules in RAPID, the language of ABB's controllers (IRC5, OmniCore)."""

import itertools
import re
from collections.abc import Iterator, Sequence

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.formats.programs.protocol import ANY_DIGITS, PAUSE_S, MeasuringTour, PathMoves, TargetMoves
from lab.formats.programs.reading.program_text import Outside, ProgramText
from lab.formats.programs.reading.rapid import read_rapid
from lab.formats.programs.reading.spelling import QUATERNION
from lab.formats.programs.steps import path_steps
from lab.kinematics.joints import JointSpec

__all__ = ["Rapid"]

_AXES = 6
_SPEED = "v200"
_LONGEST_NAME = 32
_LONGEST_ID = 60  # characters of an id in a comment
_PREFIX = "j_"  # of joint targets: no reserved word and nothing of the controller begins so
_TOOL, _WORK_OBJECT = "calibration_tool", "instrument_frame"
_PATH_TOOL = "path_tool"
_LOAD = "[1,[0,0,1],[1,0,0,0],0,0,0]"  # a controller moves no tool without a mass and a centre
_SAME = "[[0,0,0],[1,0,0,0]]"  # the object's frame is the user's
_NO_AXES = "[" + ",".join(["9E+09"] * _AXES) + "]"  # external axes that are not there


class Rapid:
    """Modules for robots with six revolute axes, which is what a joint target of RAPID holds."""

    name = "RAPID"
    suffix = ".mod"
    reads = (".mod", ".modx", ".prg", ".sys", ".sysx")
    spelling = QUATERNION
    most_digits = ANY_DIGITS
    makers = ("abb", "irb")
    speed = _SPEED

    def refusal(self, joints: JointSpec) -> str | None:
        """None for six revolute joints; else the reason."""
        if joints.size == _AXES and not any(joints.prismatic):
            return None
        kinds = "".join("P" if slides else "R" for slides in joints.prismatic)
        return f"no RAPID module: a joint target has six revolute axes, robot {joints.name} has {kinds}"

    def read(self, text: str, outside: Outside) -> ProgramText:
        """The targets and moves of a program in it."""
        return read_rapid(text, outside)

    def measuring_tour(self, tour: MeasuringTour) -> bytes:
        """A module with a procedure ``measure_poses_from_1`` (the first id): home, every pose with a wait, home."""
        ids = tour.ids
        routine = f"measure_poses_from_{ids[0]}"
        names, moves = ["home"], ["    TPErase;", _move("home", "tool0")]
        pose, via = 0, 0
        for is_pose in tour.measured[1:-1] >= 0:
            if not is_pose:
                via += 1
                names.append(f"via{via:03d}")
                moves.append(_move(names[-1], "tool0"))
                continue
            names.append(f"pose{int(ids[pose]):03d}")
            moves += [
                _move(names[-1], "tool0"),
                f'    TPWrite "Pose {ids[pose]}: {pose + 1} of {len(ids)}";',
                f"    WaitTime {PAUSE_S};",
            ]
            pose += 1
        targets = [_joint_target(name, row) for name, row in zip(names, _degrees(tour.stops), strict=False)]
        moves += [_move("home", "tool0"), '    TPWrite "All poses measured";']
        head = [
            f"  ! {len(ids)} poses to measure, ids as in plan.csv, in an order that is short at full joint speed.",
            _checked(tour.checked),
            "  ! Joint zeros and signs are the model's: compare one pose with the pendant before the first run.",
            f"  ! Declare the tool's load in place of tool0. Call {routine} from your main routine.",
        ]
        name = _name(f"plan_{tour.robot}", f"_from_{ids[0]}")  # so that a plan and what extends it can both be loaded
        return _module(name, [*head, *targets], routine, moves)

    def target_moves(self, moves: TargetMoves) -> bytes:
        """A module with a procedure ``move_to_targets`` through joint targets, and with the frames they are of."""
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
            f"  PERS tooldata {_TOOL}:=[TRUE,{_pose(moves.T_last_tool)},{_LOAD}];",
            f'  PERS wobjdata {_WORK_OBJECT}:=[FALSE,TRUE,"",{_pose(moves.T_frame0_instrument)},{_SAME}];',
        ]
        names = _target_names(ids)
        targets, lines, via = [], ["    TPErase;"], 0
        for i, degrees in zip(moves.which.tolist(), _degrees(moves.stops), strict=True):
            via += i < 0
            name = names[i] if i >= 0 else f"via{via:03d}"
            targets += [f"  ! id {_shortened(ids[i])!a}"] if i >= 0 and name != _PREFIX + ids[i] else []
            targets.append(_joint_target(name, degrees))
            lines.append(_move(name, _TOOL))
            lines += [f'    TPWrite "{name}: {i + 1} of {len(ids)}";'] if i >= 0 else []
        return _module(_name(f"program_{moves.robot}"), [*head, *data, *targets], "move_to_targets", lines)

    def path_moves(self, moves: PathMoves) -> bytes:
        """A module with a procedure ``move_along_path``: joint targets, and of lines and circles their robtargets."""
        head = [
            f"  ! A path of {moves.robot!a} through {len(moves.ids)} points, {np.nansum(moves.seconds):.3f} s planned.",
            *(["  ! The correction is in the joint angles at the points."] if moves.corrected else []),
            _checked(moves.checked),
            "  ! Joint zeros and signs are the model's: compare one pose with the pendant before the first run.",
            "  ! The load is a placeholder: declare the real one.",
            f"  PERS tooldata {_PATH_TOOL}:=[TRUE,{_pose(moves.T_last_tool)},{_LOAD}];",
        ]
        targets, lines, via = [], list[str](), ""
        names = _target_names([f"{i + 1}_{each}" for i, each in enumerate(moves.ids)])
        for step, name, degrees in zip(path_steps(moves), names, _degrees(moves.stops), strict=True):
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
    """What was checked, as a comment."""
    if not checked:
        return "  ! NOT CHECKED FOR COLLISIONS: run it slowly first, in manual mode."
    return "  ! Checked free of collisions in the lab's model only: run it slowly first, in manual mode."


def _shortened(text: str) -> str:
    """A text that leaves a line short enough for a controller."""
    return text if len(text) <= _LONGEST_ID else text[: _LONGEST_ID - 3] + "..."


def _target_names(ids: Sequence[str]) -> list[str]:
    """A legal name for each id; RAPID does not tell small letters from capitals."""
    names: dict[str, str] = {}
    next_of: dict[str, int] = {}  # where to go on, of ids that begin alike
    for each in ids:
        stem = _name(_PREFIX + each)
        for i in itertools.count(next_of.get(stem.lower(), 1)):
            name = _name(_PREFIX + each, f"_{i}" if i > 1 else "")
            if name.lower() not in names:
                break
        next_of[stem.lower()] = i + 1
        names[name.lower()] = name
    return list(names.values())


def _name(text: str, end: str = "") -> str:
    """A legal name that begins like ``text``, which begins with a letter, and has this end."""
    return re.sub(r"[^A-Za-z0-9_]", "_", text)[: _LONGEST_NAME - len(end)] + end


def _module(name: str, declarations: Sequence[str], routine: str, moves: Sequence[str]) -> bytes:
    """A module's file: ASCII, with the line ends that controllers write."""
    body = [*declarations, "", f"  PROC {routine}()", *moves, "  ENDPROC"]
    return ("\r\n".join([f"MODULE {name}", *body, "ENDMODULE"]) + "\r\n").encode("ascii")


def _joint_target(name: str, degrees: str) -> str:
    return f"  LOCAL CONST jointtarget {name}:=[{degrees},{_NO_AXES}];"


def _move(target: str, tool: str) -> str:
    return f"    MoveAbsJ {target},{_SPEED},fine,{tool};"


def _degrees(stops: Array) -> Iterator[str]:
    """Six angles of each stop ``(s, 6)``; a millionth of a degree moves a point 1 m away by 17 nm."""
    degrees = np.rad2deg(stops).round(6) + 0.0
    return (f"[{','.join(f'{value:.6f}' for value in row)}]" for row in degrees.tolist())


def _pose(matrix: Array) -> str:
    """A pose ``(4, 4)`` (m) in millimetres and as a quaternion wxyz."""
    quaternion = se3.quaternion_from_rotation(matrix[:3, :3])
    return f"[{_list(1e3 * matrix[:3, 3], 6)},{_list(quaternion, 9)}]"


def _list(values: Array, digits: int) -> str:
    return "[" + ",".join(f"{value + 0.0:.{digits}f}" for value in values.round(digits)) + "]"
