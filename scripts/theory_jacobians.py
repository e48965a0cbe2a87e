"""Every column of a Jacobian is an axis, or an axis times a lever; differences confirm it."""

import numpy as np

import lab

robot = lab.load_robot("irb120")
joints = np.deg2rad([10, 20, 30, 40, 50, 60])
names, nominal = robot.parameter_names(), robot.parameter_values()
exact = robot.parameter_jacobian(joints)[0]

for name in ("link3.theta", "link3.a", "link2.beta"):
    step = 1e-6 * np.eye(len(names))[names.index(name)]
    ahead, behind = robot.points(joints, nominal + step)[0], robot.points(joints, nominal - step)[0]
    column = exact[:, names.index(name)]
    error = np.abs((ahead - behind) / 2e-6 - column).max()
    print(f"{name:11} ({column[0]:+.4f}, {column[1]:+.4f}, {column[2]:+.4f}), differences agree: {error < 1e-8}")
