"""Do three jobs with the lab, for ``scripts/peers_lines.py``: a fit from arrays, an own residual, an own study."""

import sys
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

import lab

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


if __name__ == "__main__":
    from run_jobs import run

    run(fit, own_residual, study)
