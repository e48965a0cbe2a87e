"""Pinocchio's part of ``scripts/experiments/peers.py``: the works that are timed."""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

URDF = str(Path(sys.argv[1]).with_name("arm.urdf"))
WORLD = pin.LOCAL_WORLD_ALIGNED
SHOWN = 1000  # answers that are compared


class Arm:
    """A model, whose joints' places and target are moved by small twists."""

    def __init__(self):
        self.model = pin.buildModelFromUrdf(URDF)
        self.data, self.p1 = self.model.createData(), self.model.getFrameId("p1")

    def point(self, q):
        """Position of the target at one pose."""
        pin.forwardKinematics(self.model, self.data, q)
        return pin.updateFramePlacement(self.model, self.data, self.p1).translation

    def points(self, joints):
        """Positions of the target."""
        found = np.empty((len(joints), 3))
        for i, q in enumerate(joints):
            found[i] = self.point(q)
        return found

    def joint_jacobian(self, q):
        """Twist of the target by the joints, at one pose."""
        return pin.computeFrameJacobian(self.model, self.data, q, self.p1, WORLD)

    def joint_jacobians(self, joints):
        """Twists of the target by the joints."""
        found = np.empty((len(joints), 6, joints.shape[1]))
        for i, q in enumerate(joints):
            found[i] = self.joint_jacobian(q)
        return found

    def regressor(self, q, found):
        """Fill the derivatives by the places of all joints and by the target, at one pose; return its position."""
        pin.forwardKinematics(self.model, self.data, q)
        there = pin.updateFramePlacement(self.model, self.data, self.p1)
        found[:, -3:] = there.rotation
        found[:, :-3] = pin.computeFrameKinematicRegressor(self.model, self.data, self.p1, WORLD)[:3]
        return there.translation

    def regressors(self, joints):
        """Positions, and their derivatives by the places of all joints and by the target."""
        points, found = np.empty((len(joints), 3)), np.empty((len(joints), 3, 6 * (self.model.njoints - 1) + 3))
        for i, q in enumerate(joints):
            points[i] = self.regressor(q, found[i])
        return points, found

    def moved(self, x):
        """Move the places and the target by a step of these parameters."""
        for i in range(1, self.model.njoints):
            self.model.jointPlacements[i] = self.model.jointPlacements[i] * pin.exp6(x[6 * i - 6 : 6 * i])
        self.model.frames[self.p1].placement = self.model.frames[self.p1].placement * pin.SE3(np.eye(3), x[-3:])

    def aligned(self, joints, points):
        """Place the base so that the target is near the measured points."""
        predicted = self.points(joints)
        U, _, Vt = np.linalg.svd((predicted - predicted.mean(0)).T @ (points - points.mean(0)))
        R = Vt.T @ np.diag([1, 1, np.sign(np.linalg.det(U @ Vt))]) @ U.T
        self.model.jointPlacements[1] = (
            pin.SE3(R, points.mean(0) - R @ predicted.mean(0)) * self.model.jointPlacements[1]
        )


def identify(given):
    """Gauss-Newton steps on the kinematic regressor, each of least norm; Pinocchio has no fit of its own."""
    joints, points = given["joints"], given["points"]

    def found():
        arm = Arm()
        arm.aligned(joints, points)
        for _ in range(20):
            predicted, J = arm.regressors(joints)
            step = np.linalg.lstsq(J.reshape(-1, J.shape[2]), (points - predicted).ravel(), rcond=1e-9)[0]
            arm.moved(step)
            if np.abs(step).max() < 1e-9:
                break
        return arm

    return {"identify": (found, lambda arm: arm.points(given["new_joints"]))}


def kinematics(given):
    """Positions of the target, their derivatives by the joints, and by all parameters, pose by pose."""
    arm, q, J = Arm(), given["many"][0], np.empty((3, 39))
    found = {
        "positions, 1": (lambda: arm.point(q), lambda point: point[None]),
        "joint Jacobian, 1": (lambda: arm.joint_jacobian(q), lambda J: J[None, :3]),
        "parameter derivatives, 1": (lambda: arm.regressor(q, J), lambda _: J[None]),
    }
    for n in given["counts"][1:]:
        many = given["many"][:n]
        found[f"positions, {n}"] = (lambda many=many: arm.points(many), lambda points: points)
        found[f"joint Jacobian, {n}"] = (lambda many=many: arm.joint_jacobians(many), lambda J: J[:, :3])
        found[f"parameter derivatives, {n}"] = (lambda many=many: arm.regressors(many), lambda both: both[1][:SHOWN])
    return found


def inverse(given):
    """One solution by Newton steps from a given start, as in Pinocchio's example, with a line search by halves."""
    arm, few = Arm(), int(given["few"])
    flange = arm.model.getFrameId("flange")

    def error(q, T):
        pin.framesForwardKinematics(arm.model, arm.data, q)
        return pin.log6(arm.data.oMf[flange].actInv(T)).vector

    def one(T, q):
        T = pin.SE3(T)
        e = error(q, T)
        for _ in range(100):
            if np.abs(e).max() < 1e-10:
                break
            J = pin.computeFrameJacobian(arm.model, arm.data, q, flange, pin.LOCAL)
            J = pin.Jlog6(arm.data.oMf[flange].actInv(T).inverse()) @ J
            step = J.T @ np.linalg.solve(J @ J.T + 1e-12 * np.eye(6), e)
            share = 1.0
            while share > 1e-3 and np.linalg.norm(error(q + share * step, T)) > np.linalg.norm(e):
                share /= 2
            q = q + share * step
            e = error(q, T)
        return q

    solve = lambda: [one(T, q) for T, q in zip(given["poses"][:few], given["near"], strict=False)]  # noqa: E731
    return {"one solution": (solve, lambda each: np.array(each)[:, None])}


if __name__ == "__main__":
    from run_jobs import run

    run(identify=identify, kinematics=kinematics, inverse=inverse)
