"""What the data do not show of a load, and which motion would, in words."""

import numpy as np

from lab.core.se3 import Array
from lab.kinematics.dynamics.rigid_body import LOAD, hand_jacobian
from lab.kinematics.serial.arm import SerialArm
from lab.payload_identification.least_squares import ChannelSolution

__all__ = ["excitation_advice"]

_AXES = "xyz"
_SHOWN = 200  # samples to tell by which joints turn the hand


def excitation_advice(
    solution: ChannelSolution, moving: bool, arm: SerialArm, values: Array, joints: Array
) -> tuple[str, ...]:
    """A sentence for each group of parameters that is not identified, or only to more than its own size."""
    identifiable, found = solution.identifiable[:10], []
    joints = joints[:: max(1, len(joints) // _SHOWN)]
    if not identifiable[:4].all():
        names = ", ".join(np.array(LOAD[:4])[~identifiable[:4]])
        found.append(f"{names}: not identifiable one by one; add poses that turn the hand about other horizontal axes")
    if not moving:
        found.append(
            "the inertia: static poses show mass and centre of mass alone; move the hand along a quick path that "
            f"turns it about all its axes ({_turned_by(arm, values, joints, range(3))})"
        )
        return tuple(found)
    vague = _vague(solution)
    for k in range(4, 10):
        if identifiable[k] and not vague[k - 4]:
            continue
        axes = sorted({_AXES.index(letter) for letter in LOAD[k][1:]})
        why = "shown only to more than the load's whole inertia" if identifiable[k] else "not shown by this path"
        about = " and ".join(_AXES[axis] for axis in axes)
        found.append(
            f"{LOAD[k]}: {why}; turn the hand faster about its {about} ({_turned_by(arm, values, joints, axes)}): "
            "the interval falls with the square of the speed"
        )
    return tuple(found)


def _vague(solution: ChannelSolution) -> Array:
    """``(6,)`` whether the interval of an element of the inertia is wider than the largest that is found."""
    widths = solution.half_widths(np.eye(len(solution.names)))[4:10]
    return np.asarray(widths > np.abs(solution.values[4:7]).max())


def _turned_by(arm: SerialArm, values: Array, joints: Array, axes: "range | list[int]") -> str:
    """The joints that turn the hand most about these of its axes, at the poses that there were."""
    turning = np.abs(hand_jacobian(arm, values, joints)[:, 3:]).mean(axis=0)  # (3, J)
    if not turning.any():
        return "no joint turns it"
    best = sorted({int(np.argmax(turning[axis])) for axis in axes if turning[axis].any()})
    return "joints " + ", ".join(arm.chain.joint_names[j] for j in best)
