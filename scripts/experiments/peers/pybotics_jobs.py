"""The part of pybotics in ``scripts/experiments/peers.py``: three jobs, and the works that are timed."""

import numpy as np
from pybotics.geometry import vector_2_matrix
from pybotics.optimization import OptimizationHandler, compute_absolute_errors, compute_relative_errors
from pybotics.robot import Robot
from scipy.optimize import least_squares

MDH = np.array(  # alpha, a, theta, d of the model that is given (mm, rad)
    [
        [0, 0, 0, 290], [-np.pi / 2, 0, -np.pi / 2, 0], [0, 270, 0, 0], [-np.pi / 2, 70, 0, 302],
        [np.pi / 2, 0, 0, 0], [-np.pi / 2, 0, np.pi, 72],
    ]
)  # fmt: skip
TOOL = [60, 0, 40]


def nominal():
    """Return the nominal robot."""
    robot = Robot.from_parameters(MDH)
    robot.tool.position = TOOL
    return robot


def aligned(robot, joints, points):
    """Place the robot's base so that its points are near the measured ones."""
    predicted = np.array([robot.fk(q)[:3, 3] for q in joints])
    U, _, Vt = np.linalg.svd((predicted - predicted.mean(0)).T @ (points - points.mean(0)))
    R = Vt.T @ np.diag([1, 1, np.sign(np.linalg.det(U @ Vt))]) @ U.T
    robot.world_frame = np.vstack([np.column_stack([R, points.mean(0) - R @ predicted.mean(0)]), [0, 0, 0, 1]])
    return robot


def fitted(joints, points, robot=None):
    """Identify all parameters of the chain, the base and the tool's position."""
    robot = aligned(robot or nominal(), joints, points)
    handler = OptimizationHandler(robot, True, [True] * 3 + [False] * 3, True)

    def residuals(vector):
        handler.apply_optimization_vector(vector)
        return np.concatenate([handler.robot.fk(q)[:3, 3] for q in joints]) - points.ravel()

    handler.apply_optimization_vector(least_squares(residuals, handler.generate_optimization_vector()).x)
    return handler.robot


def fit(joints, points, new_joints, new_points):
    """From arrays to a fit: the mean error (mm) at poses that were not fitted."""
    robot = fitted(joints, 1e3 * points)
    return compute_absolute_errors(new_joints, 1e3 * new_points, robot).mean()


def own_residual(joints, points, new_joints, new_points):
    """Fit the distances between successive points: the mean error (mm) of new distances."""
    handler = OptimizationHandler(nominal(), True, [True] * 3 + [False] * 3)
    measured, new = (1e3 * np.linalg.norm(np.diff(each, axis=0), axis=1) for each in (points, new_points))

    def residuals(vector):
        handler.apply_optimization_vector(vector)
        found = np.array([handler.robot.fk(q)[:3, 3] for q in joints])
        return np.linalg.norm(np.diff(found, axis=0), axis=1) - measured

    handler.apply_optimization_vector(least_squares(residuals, handler.generate_optimization_vector()).x)
    return compute_relative_errors(new_joints[:-1], new_joints[1:], new, handler.robot).mean()


def study():
    """Calibrate five simulated robots from 20 and from 40 poses: the mean errors (mm) at new poses."""
    errors = {20: [], 40: []}
    for seed in range(5):
        rng, real = np.random.default_rng(seed), nominal()
        chain = real.kinematic_chain.matrix
        real.kinematic_chain.matrix = chain + rng.normal(size=chain.shape) * [1.5e-3, 0.5, 1.5e-3, 0.5]
        real.world_frame = vector_2_matrix([500, 200, 100, 0.1, 0.2, 0.3])
        for count, found in errors.items():
            joints = rng.uniform(-2, 2, (count + 100, 6))
            points = np.array([real.fk(q)[:3, 3] for q in joints])
            noisy = points[:count] + rng.normal(scale=0.008 / np.sqrt(3), size=(count, 3))
            found.append(compute_absolute_errors(joints[count:], points[count:], fitted(joints[:count], noisy)).mean())
    return {count: np.mean(found) for count, found in errors.items()}


def identify(given):
    """Place the base, and fit all parameters of the chain, the base and the target's position."""
    joints, points = given["joints"], 1e3 * given["points"]
    answer = lambda robot: np.array([robot.fk(q)[:3, 3] for q in given["new_joints"]]) / 1e3  # noqa: E731
    return {"identify": (lambda: fitted(joints, points), answer)}


def kinematics(given):
    """Positions of the target, and their derivatives by the joints, pose by pose."""
    robot, found = nominal(), {}
    for n in given["counts"][:3]:
        many = given["many"][:n]
        found[f"positions, {n}"] = (
            lambda many=many: [robot.fk(q)[:3, 3] for q in many],
            lambda points: np.array(points) / 1e3,
        )
        found[f"joint Jacobian, {n}"] = (
            lambda many=many: [robot.jacobian_world(q)[:3] for q in many],
            lambda J: np.array(J) / 1e3,
        )
    return found


def inverse(given):
    """One solution from a given start."""
    robot, few = Robot.from_parameters(MDH), int(given["few"])
    Ts = given["poses"][:few] * np.array([[1, 1, 1, 1e3]] * 3 + [[1, 1, 1, 1]])

    def solve():
        found = [robot.ik(T, np.clip(q, -np.pi, np.pi)) for T, q in zip(Ts, given["near"], strict=False)]
        return [np.full(6, np.nan) if each is None else each for each in found]

    return {"one solution": (solve, lambda each: np.array(each)[:, None])}


def predict(given):
    """Fit a robot by its modified table and a first tool, and predict the points at new joint positions."""

    def found():
        robot = Robot.from_parameters(given["modified"] * [1, 1e3, 1, 1e3])
        robot.tool.position = 1e3 * given["target"]
        robot = fitted(given["joints"], 1e3 * given["points"], robot)
        return np.array([robot.fk(q)[:3, 3] for q in given["new_joints"]]) / 1e3

    return {"predict": (found, np.array)}


if __name__ == "__main__":
    from run_jobs import run

    run(fit, own_residual, study, identify=identify, kinematics=kinematics, inverse=inverse, predict=predict)
