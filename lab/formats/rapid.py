"""A measuring tour and corrected targets as modules in RAPID, the language of ABB's controllers."""

import itertools
import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec

AXES = 6
SPEED, WAIT_S = "v200", 3
_LONGEST_NAME = 32
_PREFIX = "j_"  # of joint targets: no reserved word and nothing of the controller begins so
_TOOL, _WORK_OBJECT = "calibration_tool", "instrument_frame"
_LOAD = "[1,[0,0,1],[1,0,0,0],0,0,0]"  # a controller moves no tool without a mass and a centre
_SAME = "[[0,0,0],[1,0,0,0]]"  # the object's frame is the user's
_NO_AXES = "[" + ",".join(["9E+09"] * AXES) + "]"  # external axes that are not there


def why_no_rapid(chain: JointSpec) -> str | None:
    """None for six revolute joints, which is what a RAPID joint target holds; else the reason."""
    if chain.size == AXES and not any(chain.prismatic):
        return None
    kinds = "".join("P" if slides else "R" for slides in chain.prismatic)
    return f"no RAPID module: a joint target has six revolute axes, robot {chain.name} has {kinds}"


def rapid_module(robot: str, stops: Array, measured: NDArray[np.int_], ids: Sequence[str]) -> str:
    """A module with a procedure ``measure_poses_from_1`` (the first id): home, every pose with a wait, home.

    Args:
        stops: ``(s, 6)`` rad, the tour from home to home.
        measured: ``(s,)``, negative where a stop is only passed.
        ids: what ``plan.csv`` calls the measured poses, in the order of the tour.
    """
    routine = f"measure_poses_from_{ids[0]}"
    names, moves = ["home"], ["    TPErase;", _move("home", "tool0")]
    pose, via = 0, 0
    for is_pose in measured[1:-1] >= 0:
        if not is_pose:
            via += 1
            names.append(f"via{via:03d}")
            moves.append(_move(names[-1], "tool0"))
            continue
        names.append(f"pose{int(ids[pose]):03d}")
        moves += [
            _move(names[-1], "tool0"),
            f'    TPWrite "Pose {ids[pose]}: {pose + 1} of {len(ids)}";',
            f"    WaitTime {WAIT_S};",
        ]
        pose += 1
    targets = [_joint_target(name, at) for name, at in zip(names, stops, strict=False)]
    moves += [_move("home", "tool0"), '    TPWrite "All poses measured";']
    head = [
        f"  ! {len(ids)} poses to measure, ids as in plan.csv, in an order that is short at full joint speed.",
        "  ! Checked free of collisions in the lab's model only: run it slowly first, in manual mode.",
        "  ! Joint zeros and signs are the model's: compare one pose with the pendant before the first run.",
        f"  ! Declare the tool's load in place of tool0. Call {routine} from your main routine.",
    ]
    name = _name(f"plan_{robot}", f"_from_{ids[0]}")  # so that a plan and what extends it can both be loaded
    return _module(name, [*head, *targets], routine, moves)


def program_module(
    robot: str, ids: Sequence[str], joints: Array, T_last_tool: Array, T_frame0_instrument: Array
) -> str:
    """A module with a procedure ``move_to_targets`` through corrected joint targets, and with the frames they are of.

    Args:
        ids: what the targets' file calls them, ``(n,)``.
        joints: ``(n, 6)`` rad, the readings at which the calibrated arm is at the targets.
        T_last_tool: pose ``(4, 4)`` (m) of the tool in the table's last frame, of the nominal arm that fits best.
        T_frame0_instrument: pose ``(4, 4)`` of the instrument's frame in that arm's frame 0.
    """
    head = [
        f"  ! {len(ids)} corrected joint targets. The correction is in the joint angles: move with MoveAbsJ.",
        "  ! Not checked for collisions: run it slowly first, in manual mode.",
        f"  ! {_TOOL} and {_WORK_OBJECT} suit the controller's nominal links best. They hold where tool0 is",
        "  ! the last frame of the lab's table, and world is frame 0 of it.",
        f"  ! CalcRobT(<a target>, {_TOOL} \\WObj:={_WORK_OBJECT}) makes a robtarget of one, with its",
        "  ! configuration, by the controller's own nominal model: the same joint angles, so as well corrected.",
    ]
    data = [
        "  ! The load is a placeholder: declare the real one.",
        f"  PERS tooldata {_TOOL}:=[TRUE,{_pose(T_last_tool)},{_LOAD}];",
        f'  PERS wobjdata {_WORK_OBJECT}:=[FALSE,TRUE,"",{_pose(T_frame0_instrument)},{_SAME}];',
    ]
    names = _target_names(ids)
    targets, moves = [], ["    TPErase;"]
    for i, (name, each, at) in enumerate(zip(names, ids, joints, strict=True), start=1):
        targets += [] if name == _PREFIX + each else [f"  ! id {each!a}"]
        targets.append(_joint_target(name, at))
        moves += [_move(name, _TOOL), f'    TPWrite "{name}: {i} of {len(ids)}";']
    return _module(_name(f"program_{robot}"), [*head, *data, *targets], "move_to_targets", moves)


def _target_names(ids: Sequence[str]) -> list[str]:
    """A legal name for each id; RAPID does not tell small letters from capitals."""
    names: dict[str, str] = {}
    for each in ids:
        tries = (_name(_PREFIX + each, f"_{i}" if i > 1 else "") for i in itertools.count(1))
        name = next(name for name in tries if name.lower() not in names)
        names[name.lower()] = name
    return list(names.values())


def _name(text: str, end: str = "") -> str:
    """A legal name that begins like ``text``, which begins with a letter, and has this end."""
    return re.sub(r"[^A-Za-z0-9_]", "_", text)[: _LONGEST_NAME - len(end)] + end


def _module(name: str, declarations: Sequence[str], routine: str, moves: Sequence[str]) -> str:
    body = [*declarations, "", f"  PROC {routine}()", *moves, "  ENDPROC"]
    return "\n".join([f"MODULE {name}", *body, "ENDMODULE"]) + "\n"


def _joint_target(name: str, joints: Array) -> str:
    return f"  LOCAL CONST jointtarget {name}:=[{_degrees(joints)},{_NO_AXES}];"


def _move(target: str, tool: str) -> str:
    return f"    MoveAbsJ {target},{SPEED},fine,{tool};"


def _degrees(joints: Array) -> str:
    """Six angles; a millionth of a degree moves a point 1 m away by 17 nm."""
    return _list(np.rad2deg(joints), 6)


def _pose(matrix: Array) -> str:
    """A pose ``(4, 4)`` (m) in millimetres and as a quaternion wxyz."""
    quaternion = se3.quaternion_from_rotation(matrix[:3, :3])
    return f"[{_list(1e3 * matrix[:3, 3], 6)},{_list(quaternion, 9)}]"


def _list(values: Array, digits: int) -> str:
    return "[" + ",".join(f"{value + 0.0:.{digits}f}" for value in values.round(digits)) + "]"
