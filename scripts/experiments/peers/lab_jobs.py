"""The lab's part of ``scripts/experiments/peers.py``: three jobs, and the works that are timed."""

import sys
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

import lab
from lab.pose_selection.criteria import criterion
from lab.pose_selection.exchange import exchange

ROBOT = Path(sys.argv[1]).with_name("arm.toml")
SHOWN = 1000  # answers that are compared


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
    """The fit alone: placement of the base, choice of parameters, fit and covariance; then all of it."""
    robot, new = lab.load_robot(ROBOT), given["new_joints"]
    rows = lab.measurements(given["joints"], given["points"], robot=robot)
    return {
        "identify": (lambda: lab.fit(rows, robot=robot), lambda estimate: estimate.points(new)[:, 0]),
        "identify, with verdict": (
            lambda: lab.identify(rows, robot=robot),
            lambda result: result.estimate.points(new)[:, 0],
        ),
    }


def kinematics(given):
    """Positions of the target, their derivatives by the joints, and by all parameters: one call for any number."""
    robot, found = lab.load_robot(ROBOT), {}
    for n in given["counts"]:
        q = given["many"][0] if n == 1 else given["many"][:n]
        found[f"positions, {n}"] = (lambda q=q: robot.points(q), lambda points: points.reshape(-1, 3))
        found[f"joint Jacobian, {n}"] = (lambda q=q: robot.jacobian(q), lambda J: J.reshape(-1, 6, 6)[:, :3])
        found[f"parameter derivatives, {n}"] = (
            lambda q=q: robot.parameter_jacobian(q),
            lambda J: J.reshape(-1, 3, J.shape[-1])[:SHOWN],
        )
    return found


def select(given):
    """Fedorov exchange from four starts, on derivatives that all packages are given."""
    J, count = given["pool"], int(given["count"])
    goal = criterion("O1", J.shape[2])
    choose = lambda: exchange(np.arange(len(J))[:, None], J, count, goal, np.random.default_rng(0))  # noqa: E731
    return {"choose poses": (choose, lambda design: design.rows)}


def inverse(given):
    """All solutions, and the one that is nearest to a given start: one call for any number of poses."""
    robot, poses, near = lab.load_robot(ROBOT), given["poses"] @ given["T_last_p1"], given["near"]
    found = {}
    for n in given["counts"]:
        Ts = poses[0] if n == 1 else poses[:n]
        found[f"all solutions, {n}"] = (lambda Ts=Ts: robot.inverse(Ts), lambda each: each.reshape(-1, 8, 6)[:SHOWN])
    found["one solution"] = (
        lambda: [robot.inverse(T, q) for T, q in zip(poses, near, strict=False)],
        lambda each: np.array(each)[:, None],
    )
    return found


if __name__ == "__main__":
    from run_jobs import run

    run(fit, own_residual, study, identify=identify, kinematics=kinematics, select=select, inverse=inverse)
