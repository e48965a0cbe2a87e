"""EAIK's part of ``scripts/experiments/peers.py``: the works that are timed."""

import numpy as np
from eaik.IK_DH import DhRobot


def inverse(given):
    """All solutions by subproblems: pose by pose, and by its batch on one thread."""
    turn, d, a, alpha = given["table"].T
    robot, Ts, few = DhRobot(alpha, a, d), given["poses"], int(given["few"])

    def padded(each):
        found = np.full((len(each), 8, 6), np.nan)
        for row, solution in zip(found, each, strict=True):
            exact = np.asarray(solution.Q)[~np.asarray(solution.is_LS, dtype=bool)]
            row[: len(exact)] = exact - turn
        return found

    return {
        "all solutions, one pose a call": (lambda: [robot.IK(T) for T in Ts[:few]], padded),
        "all solutions, one batch": (lambda: robot.IK_batched(Ts, 1), padded),
    }


if __name__ == "__main__":
    from run_jobs import run

    run(inverse=inverse)
