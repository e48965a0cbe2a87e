"""Pictures are outliers as wholes; a corner is one only in a sound picture."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.campaigns import session

from lab.calibration.identification import Identification, identify
from lab.calibration.noise_search import outliers_among_fitted, outliers_among_held_out
from lab.calibration.statistics.linearized import NoiseDistribution
from lab.calibration.statistics.outliers import Outliers
from lab.calibration.weights import Noise
from lab.core.measurements import Measurements
from lab.extensions.cameras.pixels import PixelSensor

POSES = 25


def fitted(rows: Measurements, robot: str) -> tuple[Identification, Measurements]:
    sensor = PixelSensor()
    arm = session(robot, observe="pixels", poses=POSES, seed=3).robot.arm(sensor.targets(rows))
    model, observed = sensor.observation(arm, rows, arm.nominal())
    return identify(model, observed, model.nominal(arm.nominal()), Noise()), observed


def outliers(rows: Measurements, robot: str) -> tuple[Outliers, Measurements]:
    found, observed = fitted(rows, robot)
    return outliers_among_fitted(found, observed, Noise(), NoiseDistribution(), 0), observed


def spoilt(rows: Measurements, pictures: list[int], corners: list[int]) -> tuple[Measurements, np.ndarray]:
    """The arm was 0.5 deg elsewhere in some pictures, and some corners are 6 px off."""
    view = PixelSensor().pictures(rows).view
    joints = rows.joints + np.where(np.isin(view, pictures)[:, None], np.deg2rad(0.5), 0.0)
    u = rows.conditions["u_px"].copy()
    u[corners] += 6.0
    return replace(rows, joints=joints, conditions={**rows.conditions, "u_px": u}), view


@pytest.mark.thorough
@pytest.mark.parametrize("robot", ["irb120", "ur5e"])
def test_pictures_are_off_as_wholes_and_corners_in_sound_ones_alone(robot: str) -> None:
    rows = session(robot, observe="pixels", poses=POSES, seed=3).measurements
    wrong, view = spoilt(rows, [4, 17], [])
    sound = np.flatnonzero(~np.isin(view, [4, 17]))
    corners = sound[[10, 200, 400]].tolist()
    wrong, _ = spoilt(rows, [4, 17], [*corners, int(np.flatnonzero(view == 4)[0])])
    found, observed = outliers(wrong, robot)
    named = {observed.ids[i] for i, whole in zip(found.rows, found.wholes, strict=True) if whole >= 0}
    assert named == {rows.ids[i] for i in np.flatnonzero(np.isin(view, [4, 17]))}
    single = {observed.ids[i] for i, whole in zip(found.rows, found.wholes, strict=True) if whole < 0}
    assert single == {rows.ids[i] for i in corners}


@pytest.mark.thorough
@pytest.mark.parametrize("robot", ["irb120", "ur5e"])
def test_sound_pictures_have_no_outliers(robot: str) -> None:
    found, _ = outliers(session(robot, observe="pixels", poses=POSES, seed=3).measurements, robot)
    assert len(found.rows) == 0


@pytest.mark.thorough
def test_a_picture_that_was_held_out_is_off_as_a_whole() -> None:
    rows = session("ur5e", observe="pixels", poses=POSES, seed=3).measurements
    wrong, view = spoilt(rows, [22], [])
    found, observed = fitted(wrong[view < 18], "ur5e")
    arm = session("ur5e", observe="pixels", poses=POSES, seed=3).robot.arm(("p1",))
    _, held_out = PixelSensor().observation(arm, wrong[view >= 18], arm.nominal())
    off = outliers_among_held_out(found, observed, held_out, Noise(), np.inf)
    assert {held_out.ids[i] for i in off.rows} == {rows.ids[i] for i in np.flatnonzero(view == 22)}
    assert len(set(off.wholes.tolist())) == 1
