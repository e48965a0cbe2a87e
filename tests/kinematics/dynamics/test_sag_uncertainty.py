"""What an uncertain payload costs where joints give way."""

import numpy as np
from helpers.robots import IRB120

from lab.kinematics.dynamics.rigid_body import sag_uncertainty, torque_regressor
from lab.kinematics.serial.serial_arm import SerialArm

ARM = SerialArm(IRB120.serial_model.chain, ("p1",))
DOWN = np.array([0.0, 0.0, -9.81])


def test_it_is_the_spread_of_draws() -> None:
    """20,000 draws of mass and first moment: their RMS displacement to first order, within 3 %."""
    rng, values = np.random.default_rng(0), ARM.nominal(IRB120.tool)
    joints = ARM.chain.random_joints(5, rng)
    compliance, root = np.full(6, 1e-5), rng.normal(size=(4, 4)) * [[0.1], [0.01], [0.01], [0.01]]
    still = np.zeros_like(joints)
    torques = torque_regressor(ARM, values, joints, still, still, DOWN)[..., :4] @ (root @ rng.normal(size=(4, 20_000)))
    moved = ARM.joint_jacobian(joints, values)[:, 0] @ (compliance[:, None] * torques)
    spread = np.sqrt((moved**2).sum(axis=1).mean(axis=1))
    predicted = sag_uncertainty(ARM, values, compliance, joints, DOWN, root @ root.T)
    np.testing.assert_allclose(predicted, spread, rtol=0.03)
