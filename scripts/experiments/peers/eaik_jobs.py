"""EAIK's part of ``scripts/experiments/peers.py``: the works that are timed."""

import numpy as np
from eaik.IK_DH import DhRobot

SHOWN = 1000  # answers that are compared


def inverse(given):
    """All solutions by subproblems: of one pose, and by its batch on one thread."""
    turn, d, a, alpha = given["table"].T
    robot, poses = DhRobot(alpha, a, d), given["poses"]

    def padded(each):
        found = np.full((len(each), 8, 6), np.nan)
        for row, solution in zip(found, each, strict=True):
            exact = np.asarray(solution.Q)[~np.asarray(solution.is_LS, dtype=bool)]
            row[: len(exact)] = exact - turn
        return found

    found = {"all solutions, 1": (lambda: robot.IK(poses[0]), lambda one: padded([one]))}
    for n in given["counts"][1:]:
        Ts = poses[:n]
        found[f"all solutions, {n}"] = (lambda Ts=Ts: robot.IK_batched(Ts, 1), lambda each: padded(each[:SHOWN]))
    return found


if __name__ == "__main__":
    from run_jobs import run

    run(inverse=inverse)
