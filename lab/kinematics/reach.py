"""Reach of a robot's tool: from the first axis, and along the axes of its base."""

from collections.abc import Callable, Sequence

import numpy as np
import scipy  # its parts are loaded at their first use

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm

__all__ = ["extents", "reach_from_axis"]

_STARTS = 12
_CLIMBERS, _CLIMBS, _FIRST_CLIMB = 12, 60, 0.15
_SHRINKING = 0.9  # of the step size


def reach_from_axis(chain: Chain, point: Array | None = None, *, least: bool = False) -> float:
    """Return the largest (or ``least``) distance (m) of a point from axis 1, or from frame 0 if joint 1 slides.

    Args:
        point: ``(3,)`` m in the last frame; its origin by default.
    """
    arm = SerialArm(chain, ("flange",))
    values = arm.nominal({"flange": np.zeros(3) if point is None else point})
    first = next(motion for motion in arm.motions(values) if motion.joint == 0)
    along, origin = np.zeros(3), np.zeros(3)
    if first.origin is not None:
        along, origin = first.axis[:3, 0], first.origin[:3, 0]
    sign = 1.0 if least else -1.0

    def square(joints: Array) -> tuple[float, Array]:
        point, jacobian = arm.points(joints[None], values)[0, 0], arm.joint_jacobian(joints[None], values)[0, 0]
        lever = point - origin
        across = lever - along * (along @ lever)
        return sign * float(across @ across), sign * 2 * jacobian.T @ across

    bounds = list(zip(chain.lower, chain.upper, strict=True))
    starts = chain.random_joints(_STARTS, rng_for(0, "structure"))
    found = [scipy.optimize.minimize(square, start, jac=True, bounds=bounds, method="L-BFGS-B") for start in starts]
    return float(np.sqrt(sign * min(each.fun for each in found)))


def extents(
    joints: JointSpec, places_of: Callable[[Array], Array], known: Array, places: Array, others: Sequence[Array] = ()
) -> Array:
    """Return the least and largest coordinates ``(3, 2)`` m of a robot's point, within the limits.

    By random walks with shrinking steps from the farthest known poses.

    Args:
        places_of: positions ``(m, 3)`` m at joint positions ``(m, joints)``; NaN if not possible.
        known, places: joint positions ``(n, joints)`` and their positions ``(n, 3)`` m.
        others: further positions ``(3,)`` m that are reached.
    """
    rng, outward = rng_for(0, "structure"), np.repeat(np.concatenate([np.eye(3), -np.eye(3)]), _CLIMBERS, axis=0)
    farthest = np.argsort(-places @ outward[::_CLIMBERS].T, axis=0)[:_CLIMBERS].T.ravel()
    at, far = known[farthest], (places[farthest] * outward).sum(axis=1)
    step = _FIRST_CLIMB * (joints.upper - joints.lower)
    for _ in range(_CLIMBS):
        tried = np.clip(at + step * rng.standard_normal(at.shape), joints.lower, joints.upper)
        there = (places_of(tried) * outward).sum(axis=1)
        farther = np.flatnonzero(there > far)  # NaN is not
        at[farther], far[farther], step = tried[farther], there[farther], _SHRINKING * step
    ends = np.max([far.reshape(6, _CLIMBERS).max(axis=1), *(outward[::_CLIMBERS] @ place for place in others)], axis=0)
    return np.stack([-ends[3:], ends[:3]], axis=1)
