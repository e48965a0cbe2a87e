"""The tour as a RAPID module, the language of ABB's controllers."""

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lab.frames import Array
from lab.geometry.chain import Chain

AXES = 6
SPEED, WAIT_S = "v200", 3
_LONGEST_NAME = 32
_NO_AXES = "[" + ",".join(["9E+09"] * AXES) + "]"  # external axes that are not there


def why_no_rapid(chain: Chain) -> str | None:
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
    names, moves = ["home"], ["    TPErase;", _move("home", "fine")]
    pose, via = 0, 0
    for is_pose in measured[1:-1] >= 0:
        if not is_pose:
            via += 1
            names.append(f"via{via:03d}")
            moves.append(_move(names[-1], "fine"))
            continue
        names.append(f"pose{int(ids[pose]):03d}")
        moves += [
            _move(names[-1], "fine"),
            f'    TPWrite "Pose {ids[pose]}: {pose + 1} of {len(ids)}";',
            f"    WaitTime {WAIT_S};",
        ]
        pose += 1
    targets = [
        f"  LOCAL CONST jointtarget {name}:=[{_degrees(at)},{_NO_AXES}];"
        for name, at in zip(names, stops, strict=False)
    ]
    moves += [_move("home", "fine"), '    TPWrite "All poses measured";']
    head = [
        f"  ! {len(ids)} poses to measure, ids as in plan.csv, in an order that is short at full joint speed.",
        "  ! Checked free of collisions in the lab's model only: run it slowly first, in manual mode.",
        "  ! Joint zeros and signs are the model's: compare one pose with the pendant before the first run.",
        f"  ! Declare the tool's load in place of tool0. Call {routine} from your main routine.",
    ]
    body = [*head, *targets, "", f"  PROC {routine}()", *moves, "  ENDPROC"]
    return "\n".join([f"MODULE {_module_name(robot, ids[0])}", *body, "ENDMODULE"]) + "\n"


def _module_name(robot: str, first: str) -> str:
    """Named by the first pose too, so that a plan and what extends it can both be loaded."""
    end = f"_from_{first}"
    return f"plan_{re.sub(r'[^A-Za-z0-9_]', '_', robot)}"[: _LONGEST_NAME - len(end)] + end


def _move(target: str, zone: str) -> str:
    return f"    MoveAbsJ {target},{SPEED},{zone},tool0;"


def _degrees(joints: Array) -> str:
    """Six angles; a millionth of a degree moves a point 1 m away by 17 nm."""
    return "[" + ",".join(f"{value + 0.0:.6f}" for value in np.rad2deg(joints).round(6)) + "]"
