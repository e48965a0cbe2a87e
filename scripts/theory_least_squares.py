"""Gauss-Newton by hand: an arm with errors, its measurements, four steps, and the covariance."""

import numpy as np

import lab

rng, sigma = np.random.default_rng(1), 5e-6
robot = lab.load_robot("irb120")
free, nominal = list(robot.identifiability().free), robot.parameter_values()
true = nominal.copy()
true[free] += 5e-4 * rng.standard_normal(len(free))
joints = rng.uniform(-1.5, 1.5, (60, 6))
exact = robot.points(joints, true)
measured = exact + sigma * rng.standard_normal(exact.shape)

values = nominal.copy()
for step in range(4):
    residual, jacobian = robot.residuals(joints, measured, values)
    print(f"step {step}: {1e3 * np.sqrt((residual**2).mean()):.6f} mm a coordinate (RMS)")
    values[free] -= np.linalg.lstsq(jacobian[:, free], residual, rcond=None)[0]

residual, jacobian = robot.residuals(joints, measured, values)
dof = len(residual) - len(free)
noise = np.sqrt(residual @ residual / dof)
covariance = noise**2 * np.linalg.inv(jacobian[:, free].T @ jacobian[:, free])
z = (values - true)[free] / np.sqrt(np.diag(covariance))
print(f"noise {1e6 * noise:.2f} um from {dof} degrees of freedom")
print(f"errors of the parameters in standard deviations: RMS {np.sqrt((z**2).mean()):.2f}")
