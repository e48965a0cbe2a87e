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

# The forward kinematics and its derivatives by all parameters, at one configuration or many.
arm = robot.arm(("p1",))
start = result.identification.nominal_aligned
points, jacobian = arm.observe(measured.joints, start)
print(f"points {points.shape}, Jacobian {jacobian.shape}, {len(arm.parameters)} parameters")


# The same residuals and derivatives in a fit of your own: scipy moves the parameters that the lab found identifiable.
def values_of(change):
    """All parameters, the free ones moved."""
    values = start.copy()
    values[free] += change
    return values


def residuals(change):
    """Predicted less measured points (m)."""
    return (arm.points(measured.joints, values_of(change)) - measured.points).ravel()


def derivatives(change):
    """Derivatives of the residuals by the free parameters."""
    return arm.observe(measured.joints, values_of(change))[1][..., free].reshape(-1, len(free))


free = list(result.identification.fit.free)
fit = scipy.optimize.least_squares(residuals, np.zeros(len(free)), derivatives, x_scale="jac")
left = np.linalg.norm(residuals(fit.x).reshape(-1, 3), axis=1)
print(f"fitted with scipy: {1e3 * left.mean():.4f} mm on average at the {len(left)} poses")
