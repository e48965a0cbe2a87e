"""What an uncertain load costs where an arm sags under it: how far a point that is corrected for it may be off."""

import numpy as np

from lab.core.se3 import Array
from lab.kinematics.dynamics.rigid_body import torque_regressor
from lab.kinematics.serial.arm import SerialArm

__all__ = ["sag_uncertainty"]


def sag_uncertainty(
    arm: SerialArm, values: Array, compliance: Array, joints: Array, gravity: Array, covariance: Array, target: int = 0
) -> Array:
    """Root mean square displacement ``(n,)`` m of a target by the uncertainty of the load's mass and first moment.

    The joints give way by C W (m, mc), with W the first four columns of the load's regressor at rest, so the target
    moves by J C W (m, mc); to first order.

    Args:
        compliance: C ``(joints,)`` rad/Nm (m/N of a slide).
        joints: readings ``(n, joints)``.
        gravity: ``(3,)`` m/s^2 in frame 0.
        covariance: ``(4, 4)`` of mass and first moment.
    """
    still = np.zeros_like(joints)
    static = torque_regressor(arm, values, joints, still, still, gravity)[:, :, :4]
    lever = arm.joint_jacobian(joints, values)[:, target]
    moved = lever @ (compliance[:, None] * static)
    return np.asarray(np.sqrt(np.einsum("nif,fg,nig->n", moved, covariance, moved)))
