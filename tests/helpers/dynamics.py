"""Inverse dynamics by MuJoCo."""

import mujoco
import numpy as np

from lab.core.se3 import Array
from lab.kinematics.dynamics.rigid_body import elements, inertia_about_centre
from lab.simulation.robot_model import RobotModel


def inverse_dynamics(robot: RobotModel, load: Array | None, motion: tuple[Array, Array, Array]) -> Array:
    """Torques ``(n, J)`` by MuJoCo, with a body of these parameters welded at the flange."""
    spec = robot.spec.copy()
    if load is not None:
        inner = inertia_about_centre(load)
        body = spec.body(robot.carrier).add_body(name="load", mass=load[0], ipos=load[1:4] / load[0])
        body.explicitinertial = True
        body.fullinertia = elements(inner)
    model = spec.compile()
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data = mujoco.MjData(model)
    torques = np.empty_like(motion[0])
    for i, (data.qpos[:], data.qvel[:], data.qacc[:]) in enumerate(zip(*motion, strict=True)):
        mujoco.mj_inverse(model, data)
        torques[i] = data.qfrc_inverse
    return torques
