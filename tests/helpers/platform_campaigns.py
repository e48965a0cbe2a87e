"""Virtual robots with platforms, measured at random poses by three targets, and identified."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from lab.calibration.identify import Identification, IdentifyOptions, identify
from lab.calibration.weights import Noise
from lab.campaign.options import VirtualCampaign
from lab.campaign.robot import load_robot
from lab.campaign.virtual_robot import perturbed_arm
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.effects.arm import Arm
from lab.noise.instruments import Instrument
from lab.simulation.collisions import random_poses
from lab.simulation.tracking import track
from lab.simulation.true_robot import TrueRobot

POSES, FRESH = 50, 1000
DEVICE = Instrument("gaussian-5um", "gaussian", radial_m=5e-6)
OFFSETS = 0.5, 1.0  # mm and mrad
THREE = ("p1", "p2", "p3")
robot_of = cache(load_robot)


def drawn_real(robot: str, seed: int, off: tuple[float, float]) -> TrueRobot:
    """A virtual robot of this seed before its tracker."""
    asked = VirtualCampaign(robot, seed=seed, position_sigma_mm=off[0], rotation_sigma_mrad=off[1])
    return perturbed_arm(robot_of(robot), asked)


@dataclass(frozen=True)
class Bench:
    """A virtual robot, poses to measure, and fresh ones with where its targets are there (m)."""

    real: TrueRobot
    targets: tuple[str, ...]
    joints: Array
    fresh: Array
    points: Array

    @classmethod
    def of(cls, real: TrueRobot, targets: tuple[str, ...], seed: int) -> "Bench":
        """Poses by their seed."""
        joints = random_poses(real.robot, POSES, rng_for(seed, "poses"))
        fresh = random_poses(real.robot, FRESH, rng_for(seed, "fresh"))
        return cls(real, targets, joints, fresh, real.points(fresh, targets))

    def identified(
        self, model: Arm, request: IdentifyOptions, device: Instrument, seed: int
    ) -> tuple[Identification, dict[str, float]]:
        """The model fitted to measurements, and the largest error at fresh poses."""
        data = track(self.real, self.joints, self.targets, device, rng_for(seed, "noise"))
        found = identify(model, data, model.nominal(self.real.robot.tool), Noise(device), request)
        off = np.linalg.norm(model.points(self.fresh, found.values) - self.points, axis=2)
        return found, {
            "converged": found.status == "converged",
            "worst_um": 1e6 * float(np.nanmax(off)),
            "refused": int(np.isnan(off).any(axis=1).sum()),
        }
