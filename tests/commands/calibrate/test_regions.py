"""The regions of a run, and how its predictions meet the validation's errors."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.campaigns import TWO, calibration, identification, session

import lab
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.phrases.phrase import in_one_line
from lab.prediction.workspace_prediction import bounds_at


@pytest.fixture(scope="module")
def day() -> Measurements:
    return session(poses=60, seed=3, targets=TWO).measurements


def held_out(day: Measurements) -> lab.CalibrationResult:
    return identification(day, robot="irb120", instrument="uniform-8um", holdout=0.3)


def test_predictions_meet_the_errors_at_poses_held_out_at_random_and_last(day: Measurements) -> None:
    last = lab.identify(day, robot="irb120", instrument="uniform-8um", holdout_last=0.3)
    for found in (held_out(day).to_dict(), last.to_dict()):
        bounds, region = found["validation_bounds"], found["prediction"]
        assert 0.7 < bounds["predicted_95_mm"] / bounds["observed_95_mm"] < 1.5
        assert bounds["inside_low"] <= bounds["inside_share"] <= bounds["inside_high"]
        assert bounds["inside_high"] >= 0.92 and bounds["inside_share"] > 0.85
        assert region["region"] == "measured" and region["poses"] == 42
        assert region["p95_mm"] < bounds["predicted_95_mm"]  # the arm's own errors, without the instrument's noise
        assert 0 < found["prediction_elsewhere"]["extrapolated_share"] < 0.6


def test_the_last_rows_are_held_out_by_command_and_call(day: Measurements) -> None:
    result = lab.identify(day, robot="irb120", instrument="uniform-8um", holdout_last=0.25)
    assert result.validation.rows is not None and result.validation.rows.ids == day.ids[45:]
    assert result.fitted.ids == day.ids[:45] and result.validation.judged_by == "holdout"
    for other in ({"holdout": 0.3}, {"validate": day}):
        with pytest.raises(LabError, match="both set the validation data"):
            lab.identify(day, robot="irb120", holdout_last=0.25, **other)
    with pytest.raises(LabError, match=r"--holdout-last 1\.5"):
        lab.identify(day, robot="irb120", holdout_last=1.5)


@pytest.mark.thorough
def test_later_rows_of_another_place_are_extrapolated_and_said_to_be() -> None:
    """An arm with harmonics, measured in one half of joint 1 first: the other half is named, not promised."""
    chain, arm = lab.load_robot("irb120").chain, lab.load_robot("irb120").arm(("p1",))
    rng = np.random.default_rng(0)
    joints = chain.random_joints(160, rng)
    joints[:, 0] = np.where(np.arange(160) < 110, -np.abs(joints[:, 0]), np.abs(joints[:, 0]) + 0.3)
    joints[:, 0] = np.clip(joints[:, 0], chain.lower[0], chain.upper[0])
    off = 2e-3 * np.sin(2 * joints + 1) * np.array([1, 1, 1, 0, 0, 0])
    values = arm.nominal(lab.load_robot("irb120").tool)
    points = arm.points(joints + off, values) + 1e-5 * rng.normal(size=(160, 1, 3))
    data = measured(chain.joint_names, joints, ("p1",), points)
    found = lab.identify(data, robot="irb120", holdout_last=50 / 160)
    bounds = found.to_dict()["validation_bounds"]
    assert bounds["extrapolated_share"] > 0.5
    assert any("of 50 validation poses are" in each for each in found.warnings)


@pytest.mark.thorough
def test_a_region_is_that_of_the_task(day: Measurements, tmp_path: Path) -> None:
    """Targets near measured points, given as a file in their frame; a box that holds nothing is refused."""
    near = 1e3 * (day.points[:20, 0] + 0.01)
    (tmp_path / "task.csv").write_text("x_mm,y_mm,z_mm\n" + "\n".join(",".join(map(str, row)) for row in near) + "\n")
    for option, kind in ((str(tmp_path / "task.csv"), "targets"), ("250,400,-150,150,300,600", "box")):
        result = lab.identify(day, robot="irb120", instrument="uniform-8um", holdout=0.3, region=option)
        region = result.to_dict()["prediction"]
        assert region["region"] == kind and 0 < region["p95_mm"] < 0.05 and region["poses"] >= 15
    with pytest.raises(LabError, match="--region 9000,9100,0,100,0,100: "):
        lab.identify(day, robot="irb120", instrument="uniform-8um", holdout=0.3, region="9000,9100,0,100,0,100")


def test_a_campaign_in_a_corner_names_where_its_verdict_holds() -> None:
    chain, arm = lab.load_robot("irb120").chain, lab.load_robot("irb120").arm(("p1",))
    rng, middle = np.random.default_rng(1), (chain.lower + chain.upper) / 2
    joints = middle + 0.15 * (chain.random_joints(60, rng) - middle)
    values = arm.nominal(lab.load_robot("irb120").tool) + 3e-4 * rng.normal(size=len(arm.names))
    points = arm.points(joints, values) + 1e-5 * rng.normal(size=(60, 1, 3))
    data = measured(chain.joint_names, joints, ("p1",), points)
    found = lab.identify(data, robot="irb120", noise_mm=0.01, holdout=0.3)
    assert found.verdict.word == "good"
    assert any("100 % of the workspace is extrapolated" in w for w in found.warnings)
    whole = lab.identify(data, robot="irb120", noise_mm=0.01, holdout=0.3, region="workspace", gate_mm=0.05)
    assert whole.verdict.word == "doubtful" and "over the workspace" in in_one_line(whole.verdict.reasons)


def test_without_validation_or_positions_nothing_is_compared(day: Measurements) -> None:
    result = held_out(day)
    left, found = result.state.residual_spread, result.identification
    nothing = replace(result.validation, rows=None)
    assert bounds_at(found, left, nothing, result.state.measured, result.state.fitter.options.tolerance) is None


@pytest.mark.parametrize("observe", ["points", "points+cable"])
def test_a_box_is_predicted_of_several_sensors_too(observe: str) -> None:
    result = calibration(observe=observe, poses=40, seed=1, region="200,400,-100,100,200,400")
    region = result.verdict.region
    assert region.kind == "box" and region.anew == () and 1e-6 < region.p95_m < 3e-5
