"""The part of MuJoCo and its ``minimize`` in ``peers.py``: three jobs, and the works that are timed."""

import sys
from pathlib import Path

import mujoco
import numpy as np
from mujoco import minimize

ROBOT = Path(sys.argv[1]).with_name("arm.xml")


class Arm:
    """The nominal model, whose bodies and target are moved by a vector of parameters."""

    def __init__(self):
        self.model = mujoco.MjModel.from_xml_path(str(ROBOT))
        self.data = mujoco.MjData(self.model)
        self.pos, self.quat, self.p1 = self.model.body_pos.copy(), self.model.body_quat.copy(), self.model.site("p1").id
        self.tool = self.model.site_pos[self.p1].copy()
        self.size = 6 * (self.model.nbody - 1) + 3

    def points(self, joints, change):
        """Positions of the target with changed bodies, whose base comes first, and a changed target."""
        moved = change[:-3].reshape(-1, 6)
        for i, (shift, turn) in enumerate(zip(moved[:, :3], moved[:, 3:], strict=True), 1):
            self.model.body_pos[i] = self.pos[i] + shift
            self.model.body_quat[i] = self.quat[i]
            mujoco.mju_quatIntegrate(self.model.body_quat[i], turn, 1.0)
        self.model.site_pos[self.p1] = self.tool + change[-3:]
        found = np.empty((len(joints), 3))
        for i, self.data.qpos[:] in enumerate(joints):
            mujoco.mj_kinematics(self.model, self.data)
            found[i] = self.data.site_xpos[self.p1]
        return found

    def aligned(self, joints, points):
        """Place the base so that the target is near the measured points."""
        predicted = self.points(joints, np.zeros(self.size))
        U, _, Vt = np.linalg.svd((predicted - predicted.mean(0)).T @ (points - points.mean(0)))
        R = Vt.T @ np.diag([1, 1, np.sign(np.linalg.det(U @ Vt))]) @ U.T
        turn = np.empty(4)
        mujoco.mju_mat2Quat(turn, R.ravel())
        mujoco.mju_mulQuat(self.quat[1], turn, self.quat[1].copy())
        self.pos[1] = points.mean(0) - R @ predicted.mean(0) + R @ self.pos[1]

    def fitted(self, residual):
        """Minimize a residual of one vector of parameters."""
        many = lambda x: np.stack([residual(each) for each in x.T], axis=1)  # noqa: E731
        return minimize.least_squares(np.zeros(self.size), many, verbose=0)[0]


def fit(joints, points, new_joints, new_points):
    """From arrays to a fit: the mean error (mm) at poses that were not fitted."""
    arm = Arm()
    arm.aligned(joints, points)
    found = arm.fitted(lambda x: (arm.points(joints, x) - points).ravel())
    return 1e3 * np.linalg.norm(arm.points(new_joints, found) - new_points, axis=1).mean()


def own_residual(joints, points, new_joints, new_points):
    """Fit the distances between successive points: the mean error (mm) of new distances."""
    arm = Arm()
    measured, new = (np.linalg.norm(np.diff(each, axis=0), axis=1) for each in (points, new_points))
    distances = lambda joints, x: np.linalg.norm(np.diff(arm.points(joints, x), axis=0), axis=1)  # noqa: E731
    found = arm.fitted(lambda x: distances(joints, x) - measured)
    return 1e3 * np.abs(distances(new_joints, found) - new).mean()


def study():
    """Calibrate five simulated robots from 20 and from 40 poses: the mean errors (mm) at new poses."""
    errors = {20: [], 40: []}
    for seed in range(5):
        rng, real = np.random.default_rng(seed), Arm()
        off = np.append(rng.normal(size=(7, 6)) * ([0.5e-3] * 3 + [1.5e-3] * 3), np.zeros(3))
        off[:6] += [0.5, 0.2, 0.1, 0.1, 0.2, 0.3]
        for count, found in errors.items():
            joints, arm = rng.uniform(-2, 2, (count + 100, 6)), Arm()
            points = real.points(joints, off)
            noisy = points[:count] + rng.normal(scale=8e-6 / np.sqrt(3), size=(count, 3))
            arm.aligned(joints[:count], noisy)
            x = arm.fitted(lambda x, arm=arm, rows=joints[:count], y=noisy: (arm.points(rows, x) - y).ravel())
            found.append(1e3 * np.linalg.norm(arm.points(joints[count:], x) - points[count:], axis=1).mean())
    return {count: np.mean(found) for count, found in errors.items()}


def identify(given):
    """Place the base and minimize over all bodies and the target."""
    joints, points = given["joints"], given["points"]

    def found():
        arm = Arm()
        arm.aligned(joints, points)
        return arm, arm.fitted(lambda x: (arm.points(joints, x) - points).ravel())

    return {"identify": (found, lambda both: both[0].points(given["new_joints"], both[1]))}


def kinematics(given):
    """Positions of the target, and their derivatives by the joints, pose by pose."""
    arm, found, J = Arm(), {}, np.empty((3, 6))
    nothing = np.zeros(arm.size)

    def jacobians(joints):
        every = np.empty((len(joints), 3, 6))
        for i, arm.data.qpos[:] in enumerate(joints):
            mujoco.mj_kinematics(arm.model, arm.data)
            mujoco.mj_comPos(arm.model, arm.data)
            mujoco.mj_jacSite(arm.model, arm.data, J, None, arm.p1)
            every[i] = J
        return every

    def positions(joints):
        every = np.empty((len(joints), 3))
        for i, arm.data.qpos[:] in enumerate(joints):
            mujoco.mj_kinematics(arm.model, arm.data)
            every[i] = arm.data.site_xpos[arm.p1]
        return every

    arm.points(given["joints"][:1], nothing)
    for n in given["counts"]:
        q = given["many"][:n]
        found[f"positions, {n}"] = (lambda q=q: positions(q), lambda points: points)
        found[f"joint Jacobian, {n}"] = (lambda q=q: jacobians(q), lambda J: J)
    return found


def inverse(given):
    """One solution by ``minimize`` from a given start."""
    arm, few = Arm(), int(given["few"])
    body = arm.model.body("link6").id

    def one(T, q):
        def residual(x):
            out = np.empty((6, x.shape[1]))
            for k, arm.data.qpos[:] in enumerate(x.T):
                mujoco.mj_kinematics(arm.model, arm.data)
                R = arm.data.xmat[body].reshape(3, 3)
                out[:3, k] = arm.data.xpos[body] - T[:3, 3]
                out[3:, k] = 0.5 * np.cross(T[:3, :3].T, R.T).sum(0)
            return out

        return minimize.least_squares(q, residual, verbose=0)[0]

    solve = lambda: [one(T, q) for T, q in zip(given["poses"][:few], given["near"], strict=False)]  # noqa: E731
    return {"one solution": (solve, lambda each: np.array(each)[:, None])}


if __name__ == "__main__":
    from run_jobs import run

    run(fit, own_residual, study, identify=identify, kinematics=kinematics, inverse=inverse)
