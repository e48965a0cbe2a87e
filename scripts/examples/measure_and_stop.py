"""Measure until an accuracy is reached: every pose is proposed from all that were measured before it."""

import numpy as np

import lab

planner = lab.PosePlanner("irb120", accuracy_mm=0.015, instrument="uniform-8um", candidates=500)
real = lab.simulate("irb120", poses=1, seed=5).true_robot  # in the place of the robot and its tracker
rng = np.random.default_rng(0)
joints, points, data = [], [], None
while (proposal := planner.propose(data)).joints is not None:
    joints.append(proposal.joints)
    points.append(real.points(proposal.joints[None], ("p1",))[0, 0] + rng.uniform(-8e-6, 8e-6, 3))
    data = lab.measurements(joints, points, robot="irb120", unit="m", joint_unit="rad")
print(f"stopped after {proposal.measured} poses: {1e3 * proposal.accuracy_m:.4f} mm predicted")
print(lab.identify(data, instrument="uniform-8um", gate_mm=0.02).to_dict()["verdict"])
