"""A first calibration: a virtual IRB 120 misses by millimetres, is measured, identified, and hits to microns."""

import numpy as np

from lab.calibration.identify import identify
from lab.calibration.validation import errors_at
from lab.calibration.weights import Noise
from lab.campaign.robot import load_robot
from lab.core.instruments import instrument
from lab.core.random import rng_for
from lab.simulation.collisions import random_poses
from lab.simulation.observations.points import track
from lab.simulation.true_robot import random_perturbation, random_tracker, true_robot

SEED = 7

robot = load_robot("irb120")
model, arm = robot.model, robot.arm(("p1",))  # the drawing, in MuJoCo and as equations
tracker = instrument("uniform-8um")

# The "real" robot: every body off by 0.5 mm and 1.5 mrad, before a tracker set up somewhere.
off = random_perturbation(model, 0.5e-3, 1.5e-3, rng_for(SEED, "arm"))
real = true_robot(model, off, random_tracker(model, rng_for(SEED, "tracker")))

# The measuring day: 50 poses that touch nothing, one reading each.
poses = random_poses(model, 50, rng_for(SEED, "poses"))
data = track(real, poses, arm.targets, tracker, rng_for(SEED, "noise"))

# The identifier knows the drawing and the measurements, not where base and tool are.
found = identify(arm, data, arm.nominal(robot.tool), Noise(tracker))
print(f"{found.fit.rank} of {len(arm.names)} parameters in {found.fit.iterations} steps: {found.status}")

# Judged at 1,000 poses that it has not seen, without noise.
fresh = random_poses(model, 1000, rng_for(SEED, "fresh"))
errors = errors_at(found, fresh, real.points(fresh, arm.targets))
for name, size in (("before", errors.before), ("after", errors.after)):
    print(f"{name:6}: {1e3 * np.mean(size):.4f} mm mean, {1e3 * np.max(size):.4f} mm max")
