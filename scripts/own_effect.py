"""An effect of your own: gears that run out three times a turn, written as one function and found from measurements."""

import numpy as np

from lab.calibration.identify import identify
from lab.calibration.weights import Noise
from lab.campaign.robot import load_robot
from lab.core.measurements import measured
from lab.core.random import rng_for
from lab.kinematics.effects.arm import ArmWithEffects
from lab.kinematics.effects.effect import Effect
from lab.kinematics.parameter import joint_parameter
from lab.noise.instruments import instrument


def third_harmonics(joints, conditions, values):
    """How far joints 2 and 3 stand from their readings (n, joints), and the derivatives (n, joints, 4)."""
    derivative = np.zeros((*joints.shape, 4))
    for k, axis in enumerate((1, 2)):
        derivative[:, axis, 2 * k] = np.sin(3 * joints[:, axis])
        derivative[:, axis, 2 * k + 1] = np.cos(3 * joints[:, axis])
    return derivative @ values, derivative


parameters = tuple(joint_parameter("harmonics3", axis, wave) for axis in (1, 2) for wave in ("sin3", "cos3"))
robot, tracker = load_robot("irb120"), instrument("uniform-8um")
arm = ArmWithEffects(robot.arm(("p1",)), (Effect("harmonics3", parameters, third_harmonics),))

truth = arm.nominal(robot.tool)
truth[-4:] = 0.1e-3, -0.05e-3, 0.0, 0.08e-3  # rad
joints = robot.chain.random_joints(50, rng_for(1, "poses"))
points = tracker.sample(arm.points(joints, truth), rng_for(1, "noise"))
data = measured(robot.chain.joint_names, joints, ("p1",), points)

found = identify(arm, data, arm.nominal(robot.tool), Noise(tracker))
print(f"{found.fit.rank} of {len(arm.names)} parameters: {found.status}")
for name, true, value, std in zip(arm.names[-4:], truth[-4:], found.values[-4:], found.std[-4:], strict=True):
    print(f"{name}: {1e3 * value:+.4f} ± {1e3 * std:.4f} mrad, truly {1e3 * true:+.4f}")
