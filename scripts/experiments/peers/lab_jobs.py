"""The lab's part of ``scripts/experiments/peers.py``: three jobs, and the works that are timed."""

import sys
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

import lab
from lab.calibration.identification import identify as identified
from lab.kinematics.inverse.closed_form import closed_form_of
from lab.pose_selection.criteria import criterion
from lab.pose_selection.exchange import exchange

ROBOT = Path(sys.argv[1]).with_name("arm.toml")


def fit(joints, points, new_joints, new_points):
    """From arrays to a fit: the mean error (mm) at poses that were not fitted."""
    result = lab.identify(lab.measurements(joints, points, robot=ROBOT))
    return 1e3 * np.linalg.norm(result.estimate.points(new_joints)[:, 0] - new_points, axis=1).mean()


def own_residual(joints, points, new_joints, new_points):
    """Fit the distances between successive points: the mean error (mm) of new distances."""
    robot = lab.load_robot(ROBOT)
    measured, new = (np.linalg.norm(np.diff(each, axis=0), axis=1) for each in (points, new_points))

    def distances(joints, values):
        return np.linalg.norm(np.diff(robot.points(joints, values)[:, 0], axis=0), axis=1)

    found = least_squares(lambda x: distances(joints, x) - measured, robot.parameter_values(), x_scale="jac")
    return 1e3 * np.abs(distances(new_joints, found.x) - new).mean()


def study():
    """Calibrate five simulated robots from 20 and from 40 poses: the mean errors (mm) at new poses."""
    return {
        count: np.mean([lab.calibrate(ROBOT, poses=count, seed=seed).after.mean for seed in range(5)])
        for count in (20, 40)
    }


def identify(given):
    """The identification alone: placement of the base, choice of parameters, fit and covariance; then all of it."""
    robot, new = lab.load_robot(ROBOT), given["new_joints"]
    rows = lab.measurements(given["joints"], given["points"], robot=ROBOT)
    arm = robot.serial_arm(("p1",))
    return {
        "identify": (
            lambda: identified(arm, rows, arm.nominal(robot.tool)),
            lambda found: arm.points(new, found.values)[:, 0],
        ),
        "identify, with verdict": (
            lambda: lab.identify(rows, robot=ROBOT),
            lambda found: found.estimate.points(new)[:, 0],
        ),
    }


def kinematics(given):
    """Positions of the target, their derivatives by the joints, and by all parameters."""
    robot = lab.load_robot(ROBOT)
    arm = robot.serial_arm(("p1",))
    nominal, found = arm.nominal(robot.tool), {}
    for n in (1, 50, 1000):
        q = given["new_joints"][:n]
        found[f"positions, {n}"] = (lambda q=q: arm.points(q, nominal), lambda points: points[:, 0])
        found[f"joint Jacobian, {n}"] = (lambda q=q: arm.joint_jacobian(q, nominal), lambda J: J[:, 0])
        found[f"parameter derivatives, {n}"] = (lambda q=q: arm.observe(q, nominal), lambda both: both[1][:, 0])
    return found


def select(given):
    """Fedorov exchange from four starts, on derivatives that all packages are given."""
    J, count = given["pool"], int(given["count"])
    goal = criterion("O1", J.shape[2])
    choose = lambda: exchange(np.arange(len(J))[:, None], J, count, goal, np.random.default_rng(0))  # noqa: E731
    return {"choose poses": (choose, lambda design: design.rows)}


def inverse(given):
    """All solutions by the closed form, and the one of them that is nearest to a given start."""
    robot, Ts, few = lab.load_robot(ROBOT), given["poses"], int(given["few"])
    form = closed_form_of(robot.chain)
    nan = lambda found: np.where((found.gap_m > 0)[..., None], np.nan, found.joints)  # noqa: E731
    return {
        "all solutions, one pose a call": (
            lambda: [form.solve(T) for T in Ts[:few, None]],
            lambda each: np.concatenate([nan(found) for found in each]),
        ),
        "all solutions, one batch": (lambda: form.solve(Ts), nan),
        "one solution": (
            lambda: [_nearest(form.solve(T), q) for T, q in zip(Ts[:few, None], given["near"], strict=False)],
            lambda each: np.array(each)[:, None],
        ),
    }


def _nearest(found, q):
    turned = np.remainder(found.joints[0] - q + np.pi, 2 * np.pi) - np.pi
    return q + turned[np.argmin(np.where(found.gap_m[0] > 0, np.inf, np.abs(turned).sum(1)))]


if __name__ == "__main__":
    from run_jobs import run

    run(fit, own_residual, study, identify=identify, kinematics=kinematics, select=select, inverse=inverse)
