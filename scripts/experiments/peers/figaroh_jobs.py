"""FIGAROH's part of ``scripts/experiments/peers.py``: three jobs, and the works that are timed."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin
from figaroh.calibration.base_calibration import BaseCalibration
from figaroh.calibration.calibration_tools import calc_updated_fkm
from figaroh.optimal.base_optimal_calibration import SOCPOptimizer
from figaroh.tools.load_robot import load_robot

URDF = str(Path(sys.argv[1]).with_name("arm.urdf"))
shutil.copy(Path(__file__).with_name("figaroh.yaml"), "figaroh.yaml")


class Points(BaseCalibration):
    """A calibration by points, with unknown base and target."""

    def __init__(self, robot, file):
        super().__init__(robot, file)
        self.calib_config |= {"known_baseframe": False, "known_tipframe": False}

    def cost_function(self, var):
        """Return predicted less measured coordinates."""
        return calc_updated_fkm(self.model, self.data, var, self.q_measured, self.calib_config) - self.PEE_measured


class Distances(Points):
    """A calibration by the distances between successive points, of which the base is no part."""

    def __init__(self, robot, file):
        super().__init__(robot, file)
        self.calib_config["known_baseframe"] = True

    def cost_function(self, var):
        """Return predicted less measured distances."""
        found = calc_updated_fkm(self.model, self.data, var, self.q_measured, self.calib_config)
        predicted, measured = (each.reshape(3, -1) for each in (found, self.PEE_measured))
        return np.linalg.norm(np.diff(predicted), axis=0) - np.linalg.norm(np.diff(measured), axis=0)


def calibration(joints, points, kind=Points):
    """Identify from a file of these arrays, which is how data are given."""
    names = [f"q{i + 1}" for i in range(joints.shape[1])]
    table = pd.DataFrame(np.column_stack([joints, points]), columns=[*names, "x1", "y1", "z1"])
    table.to_csv("arrays.csv", index=False)
    found = kind(load_robot(URDF), "figaroh.yaml")
    found.initialize()
    found.solve(enable_logging=False)
    return found


def predicted(found, joints, values):
    """Return the points at new joint positions."""
    points = calc_updated_fkm(found.model, found.data, values, joints, {**found.calib_config, "NbSample": len(joints)})
    return points.reshape(3, -1).T


def fit(joints, points, new_joints, new_points):
    """From arrays to a fit: the mean error (mm) at poses that were not fitted."""
    found = calibration(joints, points)
    return 1e3 * np.linalg.norm(predicted(found, new_joints, found.LM_result.x) - new_points, axis=1).mean()


def own_residual(joints, points, new_joints, new_points):
    """Fit the distances between successive points: the mean error (mm) of new distances."""
    found = calibration(joints, points, Distances)
    distances, new = (
        np.linalg.norm(np.diff(each, axis=0), axis=1)
        for each in (predicted(found, new_joints, found.LM_result.x), new_points)
    )
    return 1e3 * np.abs(distances - new).mean()


def study():
    """Calibrate five simulated robots from 20 and from 40 poses: the mean errors (mm) at new poses."""
    errors = {20: [], 40: []}
    for seed in range(5):
        rng, model = np.random.default_rng(seed), load_robot(URDF).model
        for i in range(1, model.njoints):
            off = pin.SE3(pin.exp3(rng.normal(scale=1.5e-3, size=3)), rng.normal(scale=0.5e-3, size=3))
            model.jointPlacements[i] = model.jointPlacements[i] * off
        base = pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3])), np.array([0.5, 0.2, 0.1]))
        data, p1 = model.createData(), model.getFrameId("p1")
        for count, found in errors.items():
            joints = rng.uniform(-2, 2, (count + 100, 6))
            points = np.empty((len(joints), 3))
            for i, q in enumerate(joints):
                pin.framesForwardKinematics(model, data, q)
                points[i] = base.act(data.oMf[p1].translation)
            noisy = points[:count] + rng.normal(scale=8e-6 / np.sqrt(3), size=(count, 3))
            fitted = calibration(joints[:count], noisy)
            new = predicted(fitted, joints[count:], fitted.LM_result.x)
            found.append(1e3 * np.linalg.norm(new - points[count:], axis=1).mean())
    return {count: np.mean(found) for count, found in errors.items()}


class PlainPoints(BaseCalibration):
    """The same with FIGAROH's own cost function."""

    def __init__(self, robot, file):
        super().__init__(robot, file)
        self.calib_config |= {"known_baseframe": False, "known_tipframe": False}


def identify(given):
    """Fit by the difference of positions, and by FIGAROH's own cost function; loading is not timed."""
    found = {}
    for name, kind in (("identify", Points), ("identify, own cost", PlainPoints)):
        ready = calibration(given["joints"], given["points"], kind)
        found[name] = (
            lambda ready=ready: ready.solve_optimisation()[0],
            lambda result, ready=ready: predicted(ready, given["new_joints"], result.x),
        )
    return found


def select(given):
    """Weights of the convex problem, of which the largest are taken."""
    J, count = given["pool"], int(given["count"])
    pool = dict(enumerate(np.einsum("nrp,nrq->npq", J, J)))

    choose = lambda: list(SOCPOptimizer(pool, {"NbSample": len(J)}).solve()[1])[:count]  # noqa: E731
    return {"choose poses": (choose, np.array)}


def predict(given):
    """Fit, and predict the points at new joint positions."""

    def found():
        calibrated = calibration(given["joints"], given["points"])
        return predicted(calibrated, given["new_joints"], calibrated.LM_result.x)

    return {"predict": (found, np.array)}


if __name__ == "__main__":
    from run_jobs import run

    run(fit, own_residual, study, identify=identify, select=select, predict=predict)
