"""Resolution of a robot at its tool: how far one count of each encoder moves it, over the workspace."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from lab.core.errors import LabError
from lab.core.limits import POSITIVE_OPTION
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import DEGREES, MM
from lab.kinematics.joints import Encoders, JointSpec
from lab.kinematics.model import RigidArm
from lab.library.result import number

__all__ = ["encoders_of", "resolution"]

_POSES = 500  # random ones within the limits


def encoders_of(chain: JointSpec, steps: Sequence[float]) -> Encoders | None:
    """Return the encoders of given increments of the joints, else those of the robot's table; None without any.

    Args:
        steps: degrees (mm of a slide), one for all joints or one for each; empty for those of the table.

    Raises:
        LabError: there are not as many as joints, or one is not above zero.
    """
    if not steps:
        return chain.encoders
    if len(steps) not in (1, chain.size) or not all(each in POSITIVE_OPTION for each in steps):
        raise LabError(f"--joint-steps: give one number above zero for all joints, or {chain.size} of them")
    size = np.broadcast_to(np.array(steps), chain.size) * np.where(chain.prismatic, 1e-3, np.pi / 180)
    return Encoders(np.ones(chain.size), np.eye(chain.size), 2 * np.pi / size)


def resolution(arm: RigidArm, values: Array, encoders: Encoders) -> dict[str, Any]:
    """Return the motion of the first target by one count of each encoder, at random poses, mm and degrees.

    The target moves by |J N^-1 e_k| with the Jacobian J and the counts N of the encoders per position of the joints:
    of a coupled drive other joints move, too. Rounding to whole counts moves it by sqrt(tr(J C J')), C = (N'N)^-1 / 12.

    Args:
        values: parameters ``(p,)`` of the arm.
    """
    joints = arm.chain.random_joints(_POSES, rng_for(0, "structure"))
    jacobian = arm.tool(joints, values)[1]  # (m, 6, n)
    by_count = jacobian @ np.linalg.inv(encoders.counts)
    moved, turned = (np.linalg.norm(by_count[:, part], axis=1) for part in (slice(0, 3), slice(3, 6)))  # (m, n)
    place = jacobian[:, :3]
    rounding = np.sqrt(np.einsum("mij,jk,mik->m", place, encoders.covariance, place))
    largest = moved.max(axis=1)
    coarsest = int(largest.argmax())
    return {
        "target": arm.targets[0],
        "poses": _POSES,
        "encoders": [
            {"joint": name, **_sizes("mm", MM.of(moved[:, k])), **_sizes("deg", DEGREES.of(turned[:, k]))}
            for k, name in enumerate(arm.chain.joint_names)
        ],
        **{f"step_{key}": value for key, value in _sizes("mm", MM.of(largest)).items()},
        "coarsest_encoder": arm.chain.joint_names[int(moved[coarsest].argmax())],
        **{f"rounding_{key}": value for key, value in _sizes("mm", MM.of(rounding)).items()},
    }


def _sizes(unit: str, found: Array) -> dict[str, float | None]:
    return {
        f"{name}_{unit}": number(float(of(found))) for name, of in (("min", np.min), ("mean", np.mean), ("max", np.max))
    }
