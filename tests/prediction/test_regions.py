"""The poses over which errors are predicted: measured configurations as new ones, tasks, hinges modulo a turn."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120

import lab
from lab.calibration.gauss_newton import Observations
from lab.calibration.identification import Identification, identify
from lab.calibration.weights import Noise
from lab.core.errors import LabError
from lab.core.measurements import measured
from lab.prediction.regions import measured_region, region_of_points, workspace_region

SIGMA = 2e-5
CHAIN = IRB120.chain
ARM = IRB120.arm(("p1",))
NOMINAL = ARM.nominal(IRB120.tool)
TURNING = np.ones(CHAIN.size, dtype=np.bool_)


def fitted(joints: np.ndarray, seed: int = 0) -> tuple[Identification, Observations]:
    points = ARM.points(joints, NOMINAL) + SIGMA * np.random.default_rng(seed).normal(size=(len(joints), 1, 3))
    rows = measured(CHAIN.joint_names, joints, ("p1",), points)
    found = identify(ARM, rows, NOMINAL, Noise(sigma_m=SIGMA))
    whiten = np.full((len(joints), 1), 1 / SIGMA)
    return found, Observations(rows.joints, rows.points, whiten)


def spread(found: Identification, joints: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Mean squares of the first target's predicted errors."""
    slopes = ARM.observe(joints, found.values)[1][:, 0][..., list(found.fit.free)]
    return np.trace(slopes @ covariance @ np.swapaxes(slopes, 1, 2), axis1=1, axis2=2)


@pytest.mark.parametrize("visits", [1, 3])
def test_a_measured_configuration_is_predicted_by_the_fit_of_all_others(visits: int) -> None:
    """Against the covariance of the normal equations without the rows of that configuration, all its visits."""
    joints = np.repeat(CHAIN.random_joints(24, np.random.default_rng(0)), visits, axis=0)
    found, observed = fitted(joints)
    region = measured_region(found, observed, TURNING)
    assert region.factors is not None and len(region.inputs) == 24
    columns = observed.whiten[..., None, None] * ARM.observe(joints, found.values)[1][..., list(found.fit.free)]
    for pose, factor in zip(region.inputs[:6], region.factors, strict=False):
        others = (joints != pose).any(axis=1)
        rows = columns[others].reshape(-1, columns.shape[-1])
        without = np.linalg.inv(rows.T @ rows)
        expected = spread(found, pose[None], without) / spread(found, pose[None], found.covariance)
        assert factor == pytest.approx(float(expected[0]), rel=1e-5) and factor > 1.2


def test_what_is_predicted_where_poses_were_measured_is_realised_at_new_poses_there() -> None:
    """Few poses, many parameters: as they were fitted, their errors are a quarter smaller than those of new ones."""
    rng, ratios, fitted_ratios = np.random.default_rng(3), [], []
    for seed in range(6):
        joints, new = CHAIN.random_joints(20, rng), CHAIN.random_joints(300, rng)
        found, observed = fitted(joints, seed)
        region = measured_region(found, observed, TURNING)
        assert region.factors is not None
        there = spread(found, new, found.covariance).mean()
        own = spread(found, region.inputs, found.covariance)
        ratios.append(np.sqrt((own * region.factors).mean() / there))
        fitted_ratios.append(np.sqrt(own.mean() / there))
    assert 0.9 < np.mean(ratios) < 1.15 and np.mean(fitted_ratios) < 0.85


def test_hinges_are_taken_modulo_a_turn_where_the_model_is() -> None:
    """A last joint of ±400° measured within a quarter turn of 300°; a gear's ratio tells turns apart."""
    limits = CHAIN.upper.copy()
    limits[5] = np.deg2rad(400)
    arm = IRB120.arm(("p1",))
    measured_joints = CHAIN.random_joints(30, np.random.default_rng(1))
    measured_joints[:, 5] = np.deg2rad(300) + np.random.default_rng(2).uniform(-1.5, 1.5, 30)
    region = workspace_region(arm, NOMINAL, measured_joints, TURNING)
    assert (np.abs(region.inputs[:, 5] - np.deg2rad(300)) < np.pi + 0.2).all()
    plain = workspace_region(arm, NOMINAL)
    np.testing.assert_allclose(arm.points(plain.inputs, NOMINAL), arm.points(region.inputs, NOMINAL), atol=1e-9)
    geared = IRB120.arm_with(("p1",), ["gear"])
    values = geared.nominal(IRB120.tool)
    values[geared.names.index("joint6.gear")] = 1e-3
    there = workspace_region(geared, values, measured_joints, TURNING)
    assert there.inputs[:, 5] == pytest.approx(workspace_region(geared, values).inputs[:, 5])


def test_points_of_a_task_are_reached_near_the_measured_poses() -> None:
    joints = CHAIN.random_joints(40, np.random.default_rng(0))
    found, _ = fitted(joints)
    there = ARM.points(joints, found.values)[:, 0] + np.random.default_rng(1).uniform(-0.02, 0.02, (40, 3))
    named = {"model": ARM, "values": found.values, "inputs": joints, "joints": CHAIN, "name": "--region task.csv"}
    region = region_of_points("targets", there, **named)
    assert len(region.inputs) > 30
    reached = ARM.points(region.inputs, found.values)[:, 0]
    assert (np.abs(reached[:, None] - there).max(axis=2).min(axis=1) < 1e-5).all()
    assert not CHAIN.beyond_limits(region.inputs, 1e-5).any()
    with pytest.raises(LabError, match=r"--region task\.csv: the arm reaches none of its 2 points"):
        region_of_points("targets", np.array([[9.0, 0, 0], [0, 9.0, 0]]), **named)


def test_a_process_is_asked_between_the_measured_poses_which_it_follows() -> None:
    """Poses that it was conditioned on would be predicted too well."""
    joints = CHAIN.random_joints(60, np.random.default_rng(0))
    found, observed = fitted(joints)
    beside = replace(found, process=object())
    region = measured_region(beside, observed, TURNING)
    assert region.factors is None and len(region.inputs) == 200
    assert (region.inputs >= joints.min(axis=0)).all() and (region.inputs <= joints.max(axis=0)).all()
    assert np.abs(region.inputs[:, None] - joints).max(axis=2).min() > 1e-4


def moved_onto(points: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Points moved rigidly onto others, by least squares (Kabsch 1976)."""
    a, b = points - points.mean(axis=0), there - there.mean(axis=0)
    u, _, v = np.linalg.svd(a.T @ b)
    return a @ (u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v) + there.mean(axis=0)


@pytest.mark.parametrize(("observe", "instrument"), [("cable", "draw-wire"), ("dial", "dial-indicator")])
def test_without_an_instruments_frame_errors_are_predicted_with_the_base_placed_anew(observe, instrument) -> None:
    """Against arms drawn from the covariance, each moved onto the estimated one as measured points would move it."""
    result = lab.calibrate("irb120", observe=observe, instrument=instrument, poses=60, seed=2)
    found, predicted = result.identification, result.verdict.region
    assert found.unplaced == ("base",) and predicted.anew == ("base",)
    arm, rng = found.model.arm, np.random.default_rng(0)
    joints = result.measurements.joints
    size, free = len(arm.names), list(found.fit.free)
    there, squares = arm.points(joints, found.values[:size])[:, 0], []
    for error in rng.multivariate_normal(np.zeros(len(free)), found.covariance, 600, method="eigh"):
        values = found.values.copy()
        values[free] += error
        squares.append(((moved_onto(arm.points(joints, values[:size])[:, 0], there) - there) ** 2).sum(axis=1))
    factors = measured_region(found, result.state.observations, TURNING).factors
    assert factors is not None
    drawn = np.sqrt(np.mean(squares))
    assert drawn < predicted.rms_m < drawn * np.sqrt(factors.max()) * 1.06


@pytest.mark.thorough
def test_contacts_that_show_no_size_predict_nothing() -> None:
    result = lab.calibrate("irb120", observe="socket", poses=40, seed=2)
    assert np.isnan(result.verdict.region.p95_m) and result.verdict.word == "doubtful"
