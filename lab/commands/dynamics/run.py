"""The dynamic parameters of an arm."""

from pathlib import Path
from typing import Any

import numpy as np

from lab.campaign.robot import Robot, load_robot
from lab.commands.dynamics.options import DynamicsOptions
from lab.commands.dynamics.result import DynamicsResult
from lab.commands.keywords import options_of, takes
from lab.core.random import rng_for
from lab.kinematics.dynamics.arm_dynamics import ArmDynamics, khalil_chain
from lab.kinematics.dynamics.base_parameters import base_parameters, random_states
from lab.kinematics.dynamics.regrouping import regrouping_formulas
from lab.simulation.payload import drawn_mounting

__all__ = ["dynamics"]

STATES = 200  # over which the conditioning is looked at


@takes(DynamicsOptions)
def dynamics(robot: str | Path | Robot | DynamicsOptions = "irb120", **options: Any) -> DynamicsResult:
    """Say which dynamic parameters of an arm its torques determine, and what is grouped into each.

    Args:
        robot: the nominal model: a name, a path, or a loaded robot; or all options in one object.
        options: those of ``lab dynamics``, by name: ``without``.

    Returns:
        The base parameters, as formulas of the standard ones.

    Raises:
        LabError: the robot has loops, or there is no such robot.

    Example:
        >>> import lab
        >>> lab.dynamics("course2r").to_dict()["formulas"]["XXR2"]
        'XX2 − YY2'
    """
    if isinstance(robot, DynamicsOptions):
        robot.check()
        return _described(robot, load_robot(robot.robot))
    known = load_robot(robot)
    asked = options_of("lab.dynamics", DynamicsOptions, {"robot": known.source, **options})
    asked.check()
    return _described(asked, known)


def _described(options: DynamicsOptions, robot: Robot) -> DynamicsResult:
    model, left_out = robot.serial_model, set(options.without)
    arm = ArmDynamics(
        khalil_chain(model.chain),
        drawn_mounting(model).gravity,
        np.eye(model.chain.size),
        motor_inertia="motor-inertia" not in left_out,
        friction="friction" not in left_out,
        offsets="offsets" not in left_out,
    )
    base = base_parameters(arm, rng_for(0, "structure"))
    formulas = regrouping_formulas(arm, base, rng_for(0, "structure", 1))
    columns = arm.regressor(*random_states(arm, STATES, rng_for(0, "structure", 2)))[..., base.kept]
    flat = columns.reshape(-1, base.size)
    values = np.linalg.svd(flat / np.linalg.norm(flat, axis=0), compute_uv=False)
    return DynamicsResult(options, robot, arm, base, formulas, tuple(values.tolist()))
