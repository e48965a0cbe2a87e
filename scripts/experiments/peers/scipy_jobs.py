"""scipy's part of ``peers.py``: an arm of numpy alone, written for comparison, and the works that are timed."""

import numpy as np
from scipy.optimize import least_squares, minimize


class Arm:
    """A chain by standard Denavit-Hartenberg parameters, each link turned and moved besides by six small parameters.

    Parameters: six of the base, six of each link (of which many are redundant), three of the target.
    """

    def __init__(self, table, target):
        self.table, self.target, self.base = table, np.asarray(target, dtype=float), (np.eye(3), np.zeros(3))
        self.size = 6 + 6 * len(table) + 3

    def points(self, joints, x):
        """Positions ``(n, 3)`` of the target at joint positions ``(n, joints)``."""
        R, p = self.base[0] @ _turned(x[:3]), self.base[1] + x[3:6]
        R, p = np.broadcast_to(R, (len(joints), 3, 3)), np.broadcast_to(p, (len(joints), 3))
        for i, (theta, d, a, alpha) in enumerate(self.table):
            c, s = np.cos(joints[:, i] + theta), np.sin(joints[:, i] + theta)
            ca, sa, nothing = np.cos(alpha), np.sin(alpha), np.zeros(len(joints))
            own = np.stack([c, -s * ca, s * sa, s, c * ca, -c * sa, nothing, nothing + sa, nothing + ca], 1)
            p = p + np.einsum("nij,nj->ni", R, np.stack([a * c, a * s, nothing + d], 1))
            R = R @ own.reshape(-1, 3, 3)
            more = x[6 + 6 * i : 12 + 6 * i]
            p, R = p + R @ more[3:], R @ _turned(more[:3])
        return p + R @ (self.target + x[-3:])

    def aligned(self, joints, points):
        """Place the base, and the target where it is unknown (NaN), so that both are near the measured points."""
        unknown = bool(np.isnan(self.target).any())
        self.target = np.zeros(3) if unknown else self.target
        for _ in range(200 if unknown else 1):
            self.base = (np.eye(3), np.zeros(3))
            predicted = self.points(joints, np.zeros(self.size))
            U, _, Vt = np.linalg.svd((predicted - predicted.mean(0)).T @ (points - points.mean(0)))
            R = Vt.T @ np.diag([1, 1, np.sign(np.linalg.det(U @ Vt))]) @ U.T
            self.base = (R, points.mean(0) - R @ predicted.mean(0))
            if unknown:
                self.target = self.target + self._target_step(joints, points)

    def _target_step(self, joints, points):
        x = np.zeros(self.size)
        left = points - self.points(joints, x)
        columns = []
        for axis in range(3):
            x[-3:] = np.eye(3)[axis]
            columns.append(self.points(joints, x) - (points - left))
        J = np.stack(columns, 2)
        J, left = J - J.mean(0), left - left.mean(0)
        return np.linalg.lstsq(J.reshape(-1, 3), left.ravel(), rcond=None)[0]

    def fitted(self, joints, points, tolerance=1e-8):
        """The parameters of least squares, by finite differences, and their result."""
        residual = lambda x: 1e3 * (self.points(joints, x) - points).ravel()  # noqa: E731
        return least_squares(residual, np.zeros(self.size), xtol=tolerance, ftol=tolerance)

    def jacobian(self, joints, x, step=1e-6):
        """Derivatives ``(n, 3, parameters)`` by central differences."""
        return np.stack(
            [(self.points(joints, x + e) - self.points(joints, x - e)) / (2 * step) for e in step * np.eye(self.size)],
            2,
        )


def _turned(vector):
    angle = np.linalg.norm(vector)
    x, y, z = vector
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    if angle < 1e-8:
        return np.eye(3) + K + K @ K / 2
    return np.eye(3) + np.sin(angle) / angle * K + (1 - np.cos(angle)) / angle**2 * K @ K


def identify(given):
    """Place the base, and fit all links and the target."""
    joints, points = given["joints"], given["points"]

    def found():
        arm = Arm(given["table"], given["target"])
        arm.aligned(joints, points)
        return arm, arm.fitted(joints, points).x

    return {"identify": (found, lambda both: both[0].points(given["new_joints"], both[1]))}


def select(given):
    """Weights of the convex problem by ``minimize`` (L-BFGS-B), of which the largest are taken."""
    J, count = given["pool"], int(given["count"])

    def value(z):
        w = z**2 / (z @ z)
        M = np.einsum("n,nrp,nrq->pq", w, J, J)
        gain = np.einsum("nrp,pq,nrq->n", J, np.linalg.inv(M), J, optimize=True)
        return -np.linalg.slogdet(M)[1], -2 * z / (z @ z) * (gain - J.shape[2])

    def choose():
        found = minimize(value, np.ones(len(J)), jac=True, method="L-BFGS-B", options={"maxiter": 200})
        return np.argsort(-(found.x**2))[:count]

    return {"choose poses": (choose, np.array)}


if __name__ == "__main__":
    from run_jobs import run

    run(identify=identify, select=select)
