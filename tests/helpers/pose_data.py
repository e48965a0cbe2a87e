"""Virtual poses of an arm, for the tests of what is observed."""

from dataclasses import replace

import numpy as np

from lab.core import se3
from lab.core.measurements import Measurements, measured
from lab.core.se3 import Array
from lab.kinematics.gauge import base_set
from lab.kinematics.serial.serial_arm import SerialArm
from lab.sensors.full_pose import QUATERNION, Poses


def off_by(
    observation, values: Array, rng: np.random.Generator, metres: float = 0.5e-3, radians: float = 1e-3
) -> Array:
    """The identifiable parameters of the links and the tool off by normal draws; a true arm in its gauge."""
    angular = np.array([each.is_angle for each in observation.parameters])
    draws = np.where(angular, radians, metres) * rng.normal(size=len(values))
    links = [i for i in base_set(observation, values).identifiable if observation.names[i].startswith(("link", "tool"))]
    true = values.copy()
    true[links] += draws[links]
    return true


def measured_poses(
    arm: SerialArm, count: int, seed: int, sigma_m: float = 0.0, sigma_rad: float = 0.0
) -> tuple[Poses, Measurements, Array]:
    """The observation, its measurements with noise, and the true values."""
    rng = np.random.default_rng(seed)
    observation = Poses(arm, "p1")
    start = observation.nominal(arm.nominal())
    start[:3], start[-3:] = rng.normal(size=3), 0.5 * rng.normal(size=3)
    start[3:6] = se3.log(se3.exp(rng.normal(size=3)))
    true = off_by(observation, start, rng)
    joints = arm.chain.random_joints(count, rng)
    points = arm.points(joints, true[:-3])
    points = points + sigma_m * rng.normal(size=points.shape)
    rotation = arm.flange(joints, true[:-3])[:, :3, :3] @ se3.exp(true[-3:])
    rotation = rotation @ se3.exp(sigma_rad * rng.normal(size=(count, 3)))
    quaternion = se3.quaternion_from_rotation(rotation)
    both = np.concatenate([points, np.zeros((count, 1, 3))], axis=1)
    data = measured(arm.chain.joint_names, joints, observation.targets, both)
    turned = {f"p1_{part}": quaternion[:, i] for i, part in enumerate(QUATERNION)}
    return observation, replace(data, conditions=turned), true
