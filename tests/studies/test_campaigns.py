"""Campaigns of a study: the noise that is drawn is the noise by which points are weighed."""

import numpy as np
import pytest

from lab.core.random import rng_for
from lab.library.virtual_arm import perturbed_arm
from lab.noise.instruments import INSTRUMENTS
from lab.options.virtual_campaign import VirtualCampaign
from lab.robots.load_robot import load_virtual
from lab.simulation.collisions import random_poses
from lab.simulation.tracking import track
from lab.studies.campaigns import _measured, _noisy, cell_poses, run_task
from lab.studies.grid import Study, Task


@pytest.mark.parametrize("name", ["leica-at960", "faro-vantage"])
def test_a_trackers_campaigns_have_the_errors_that_their_covariance_predicts(name: str) -> None:
    """NEES a parameter is one: 100 campaigns of 27 parameters have a standard error of sqrt(2 / 2,700)."""
    study = Study(
        robots=2, draws=50, fresh=10, factors={"criterion": ("random",), "instrument": (name,), "poses": (20,)}
    )
    found = run_task(study, Task(0, 0, 2), cell_poses(study, study.cells[0]))
    assert found["nees"].mean() == pytest.approx(1.0, abs=5 * np.sqrt(2 / 2700))


def test_a_draw_is_that_of_one_campaign_alone() -> None:
    robot = load_virtual("irb120")
    asked = VirtualCampaign(seed=3, instrument="leica-at960")
    real, device = perturbed_arm(robot, asked), INSTRUMENTS["leica-at960"]
    joints = random_poses(robot.model, 10, rng_for(0, "poses"))
    drawn = _measured(real, device, asked, joints, 2, real.points(joints, asked.targets))
    for draw in range(2):
        alone = track(real, joints, asked.targets, device, rng_for(3, "noise", draw))
        np.testing.assert_allclose(drawn[draw], alone.points, atol=1e-15)
    assert np.abs(drawn[0] - drawn[1]).max() > 1e-6


@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_a_multiple_of_the_noise_is_one_of_nest_and_range_too(noise: float) -> None:
    device = INSTRUMENTS["leica-at960"]
    points = np.array([[2.0, 1.0, 0.5], [-3.0, 2.0, 1.0]])
    grown = _noisy(device, noise).covariance(points)
    np.testing.assert_allclose(grown, noise**2 * device.covariance(points), atol=1e-24)
