"""Correct the joints, so that the real arm reaches what the nominal one should."""

import numpy as np

import lab

rng = np.random.default_rng(2)
robot = lab.load_robot("irb120")
nominal = robot.parameter_values(targets=["p1"])
real = nominal + 5e-4 * rng.standard_normal(len(nominal))
planned = np.deg2rad([10, 20, 30, 40, 50, 60])
wanted = robot.poses(planned, target="p1")

joints = planned.copy()
for step in range(4):
    there = robot.poses(joints, real, target="p1")
    turn = wanted[:3, :3] @ there[:3, :3].T
    angle = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    missed = np.concatenate([wanted[:3, 3] - there[:3, 3], angle])
    print(f"step {step}: {1e3 * np.linalg.norm(missed[:3]):.6f} mm, {1e3 * np.linalg.norm(missed[3:]):.6f} mrad")
    joints += np.linalg.solve(robot.jacobian(joints, target="p1"), missed)
