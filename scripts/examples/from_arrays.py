"""From numpy arrays to a calibration, and the same model in a fit of your own with scipy."""

import numpy as np
import scipy.optimize

import lab

# A robot by its Denavit-Hartenberg table: theta (deg), d (mm), a (mm), alpha (deg), a row a link.
table = [[0, 290, 0, -90], [-90, 0, 270, 0], [0, 0, 70, -90], [0, 302, 0, 90], [0, 0, 0, -90], [180, 72, 0, 0]]
robot = lab.robot_from_dh(table, unit="mm", joint_unit="deg", tool={"p1": [60, 0, 40]})

# Two arrays, as a program of yours may have them; here a virtual robot and its instrument make them.
day = lab.simulate(robot, poses=60, seed=7)
joints_deg, points_mm = np.rad2deg(day.measurements.joints), 1e3 * day.measurements.points[:, 0]

measured = lab.measurements(joints_deg, points_mm, robot=robot, unit="mm", joint_unit="deg")
result = lab.identify(measured, holdout=0.3)
print(f"identified: {result.verdict.word}, {1e3 * result.validation.errors.after.mean():.4f} mm at held-out poses")

# Forward kinematics, Jacobians and criteria: one configuration or many.
joints, points = measured.joints, measured.points
print(f"points {robot.points(joints[0]).shape} and {robot.points(joints).shape}, pose {robot.poses(joints[0]).shape}")
print(f"Jacobian {robot.jacobian(joints).shape}, by the parameters {robot.parameter_jacobian(joints).shape}")
shown = robot.identifiability()
indices = robot.criteria(joints)
print(f"{shown.rank} of {len(shown.parameters)} parameters identifiable; O1 = {indices['o1']:.3f}")

# Predicted errors: before any measurement, and by the estimate.
here = joints[:1]
planned = robot.planned_covariance(joints, here, sigma_m=8e-6 / np.sqrt(3))
predicted = result.estimate.predicted_covariance(here)
sizes = [1e6 * np.sqrt(np.trace(each[0, 0])) for each in (planned, predicted)]
print(f"error of a predicted point (1 sigma): planned {sizes[0]:.1f} um, by the estimate {sizes[1]:.1f} um")

# A fit of your own: scipy moves the identifiable parameters, from where the estimate's nominal base is.
free, start = list(shown.free), result.estimate.nominal


def values_of(change):
    """All parameters, the free ones moved."""
    values = start.copy()
    values[free] += change
    return values


def residuals(change):
    """Predicted less measured coordinates (m)."""
    return robot.residuals(joints, points, values_of(change)).values


def derivatives(change):
    """Derivatives of the residuals by the free parameters."""
    return robot.residuals(joints, points, values_of(change)).jacobian[:, free]


fit = scipy.optimize.least_squares(residuals, np.zeros(len(free)), derivatives, x_scale="jac")
left = np.linalg.norm(residuals(fit.x).reshape(-1, 3), axis=1)
print(f"fitted with scipy: {1e3 * left.mean():.4f} mm on average at the {len(left)} poses")
