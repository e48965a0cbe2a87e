"""Doubt a robot's description by its sizes: a length or a limit in another unit.

A URDF has metres and radians, an MJCF metres, and degrees unless its compiler says radians. What may be right is a
warning.
"""

from collections.abc import Sequence

import numpy as np

from lab.core.random import rng_for
from lab.core.units import MM
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm

__all__ = ["implausible_robot"]

_FAR_M = 20.0  # no arm reaches as far
_NEAR_M = 0.01  # nor as near
_MOST_TURNS = 4.0  # 1440°: an angle of 26° or more, read as radians, is beyond
_POSES = 50


def implausible_robot(chains: Sequence[Chain], description: str) -> tuple[str, ...]:
    """Warn of joint limits that look like degrees, and of a reach that is no arm's.

    Args:
        chains: from the base to each tip.
        description: its file, in messages.
    """
    warnings = dict[str, None]()
    for chain in chains:
        limits = np.abs([chain.lower, chain.upper]).max(axis=0)
        wide = [
            f"{chain.joint_names[j]} (±{np.rad2deg(limits[j]):,.0f}°)"
            for j in range(chain.size)
            if not chain.prismatic[j] and limits[j] > _MOST_TURNS * 2 * np.pi
        ]
        if wide:
            warnings[
                f"{description}: limits that look like degrees, of {', '.join(wide)}; a URDF has radians, an MJCF the "
                "unit of its compiler's angle"
            ] = None
        joints = chain.random_joints(_POSES, rng_for(0, "structure"))
        arm = SerialArm(chain, ("flange",))
        ends = arm.points(joints, arm.nominal({"flange": np.zeros(3)}))[:, 0]
        reach = float(np.linalg.norm(ends, axis=1).max())
        if reach > _FAR_M:
            warnings[
                f"{description}: the arm reaches {reach:,.0f} m from its base; a URDF or an MJCF has lengths in m: "
                "divide them by 1000 if they are in mm"
            ] = None
        elif reach < _NEAR_M:
            warnings[
                f"{description}: the arm reaches {MM.text(reach)} from its base; a URDF or an MJCF has lengths in m"
            ] = None
    return tuple(warnings)
