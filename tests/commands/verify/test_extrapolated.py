"""Poses and targets where a run measured nothing, and its model lacks something, are named one by one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.robots import IRB120

import lab
from lab.core.measurements import Measurements, measured
from lab.library.calibration_result import CalibrationResult
from lab.library.load_run import CalibrationRun, calibrated_by

SIGMA = 2e-5
ARM = IRB120.arm(("p1",))
NOMINAL = ARM.nominal(IRB120.tool)


def patches(lack: float) -> tuple[Measurements, Measurements]:
    """Poses of an arm with errors between its joints: in twelve patches, apart those of two and two of a third."""
    rng = np.random.default_rng(2)
    middle, half = (IRB120.chain.lower + IRB120.chain.upper) / 2, (IRB120.chain.upper - IRB120.chain.lower) / 2
    centres = middle + np.minimum(half, 2.0) * rng.uniform(-0.8, 0.8, (12, 6))
    joints = np.repeat(centres, 20, axis=0) + rng.uniform(-0.3, 0.3, (240, 6))
    moved = joints.copy()
    for joint, first, second in ((0, 1, 2), (1, 0, 2), (2, 0, 1)):
        moved[:, joint] += lack * np.sin(2 * joints[:, first] + joint) * np.sin(1.5 * joints[:, second] - joint)
    points = ARM.points(moved, NOMINAL) + SIGMA * rng.standard_normal((240, 1, 3))
    data = measured(IRB120.chain.joint_names, joints, ("p1",), points)
    return data[:198], data[np.arange(198, 240)]


@pytest.fixture(scope="module")
def calibrated() -> CalibrationResult:
    return lab.identify(patches(1e-3)[0], robot="irb120")


@pytest.mark.thorough
def test_a_verification_marks_each_pose_where_nothing_was_fitted(calibrated: CalibrationResult) -> None:
    _, apart = patches(1e-3)
    mixed = apart[:8]  # the first two are of a patch that was fitted
    found = lab.verify(calibrated, mixed, force=True)
    said = found.to_dict()["extrapolated"]
    assert said["share"] == 0.75 and len(said["ids"]) == 6
    assert found.columns()["extrapolated"] == [False] * 2 + [True] * 6
    assert any("6 of 8 poses are extrapolated: not covered" in warning for warning in found.warnings)


def test_what_may_be_lacking_there_is_no_change_of_the_arm(calibrated: CalibrationResult) -> None:
    """Errors that the model misses by tenths of a millimetre in a region of its own are not taken for a change."""
    _, apart = patches(1e-3)
    few = apart[np.arange(2, 42, 8)]
    assert lab.verify(calibrated, few, force=True).good
    blind = calibrated_by(calibrated, Path("run-in-memory"))
    assert blind.estimate.measured is not None and blind.estimate.measured.growth > 0


def test_what_a_run_found_says_which_positions_are_extrapolated(calibrated: CalibrationResult) -> None:
    rows, apart = patches(1e-3)
    run: CalibrationRun = calibrated_by(calibrated, Path("run-in-memory"))
    assert run.estimate.extrapolated(apart.joints[2:]).all() and run.estimate.extrapolated(rows.joints).mean() < 0.1
    assert run.estimate.measured is not None
    older = replace(run.estimate, measured=replace(run.estimate.measured, cover=None))  # which keeps no poses
    assert not older.extrapolated(apart.joints).any()
    values = calibrated.to_dict()["extrapolation"]
    assert values["growth_mrad"] > 0.1 and 0 < values["workspace_extrapolated_share"] <= 1
