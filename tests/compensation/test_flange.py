"""The flange in the last frame: found by stated places, by tolerances, and how far it is off in either case."""

import numpy as np
import pytest

from lab.compensation.flange import located_flange, point_rows
from lab.core import se3
from lab.core.se3 import Array

SIGMA = np.repeat([0.4e-3, 1.5e-3], 3)  # m, rad
STATED = np.array([[0.04, 0, 0.06], [-0.025, 0.045, 0.05], [-0.03, -0.04, 0.07]])
NOISE_M = 5e-6


def measured(motion: Array, stated: Array, noise: Array | float = 0.0) -> Array:
    """Points of a flange that is moved by ``(6,)`` m and rad, in the last frame."""
    return se3.transform(se3.pose(se3.exp(motion[3:]), motion[:3]), stated) + noise


def located(points: Array, stated: Array):
    return located_flange(points, NOISE_M**2 * np.eye(points.size), stated, np.diag(SIGMA**2), 12.0)


def test_three_stated_places_show_how_the_flange_is_turned() -> None:
    """Within what noise of 5 um and places stated to 10 um leave; the prior alone would leave the whole motion."""
    motion = np.array([0.5e-3, -0.3e-3, 0.6e-3, 2e-3, -1e-3, 1.5e-3])
    flange = located(measured(motion, STATED), STATED)
    T = se3.inverse(se3.pose(se3.exp(motion[3:]), motion[:3])) @ flange.T_last_flange
    assert flange.uses_stated and flange.turned
    assert np.abs(T[:3, 3]).max() < 5e-6 and np.abs(se3.log(T[:3, :3])).max() < 5e-5  # shrunk to the prior by so much
    assert np.sqrt(np.diag(flange.covariance))[:3].max() < 20e-6


def test_targets_on_an_adapter_say_nothing_of_the_flange() -> None:
    """Their distances are right, all of them are 5 mm away: no tolerance explains that."""
    motion = np.array([0.1e-3, 0.1e-3, 0.1e-3, 1e-3, 0, 0])
    flange = located(measured(motion, STATED + np.array([0, 3e-3, 4e-3])), STATED)
    assert not flange.uses_stated and not flange.turned
    assert (flange.T_last_flange == np.eye(4)).all() and not flange.gain.any()
    np.testing.assert_allclose(flange.covariance, np.diag(SIGMA**2))
    np.testing.assert_allclose(flange.deviation_m, 5e-3, atol=0.3e-3)


def test_distances_show_that_places_are_stated_badly() -> None:
    """Each is off by millimetres on its own, with no rigid motion of all: tolerances alone say where the flange is."""
    rows, off = point_rows(STATED).reshape(9, 6), 1e-3 * np.array([3, -2, 1, -2, 1, 3, 0, 2, -4.0])
    off -= rows @ np.linalg.lstsq(rows, off, rcond=None)[0]
    flange = located(measured(np.zeros(6), STATED + off.reshape(3, 3)), STATED)
    assert not flange.turned
    assert (np.sqrt(np.diag(flange.covariance)) > 0.9 * SIGMA).all()


@pytest.mark.parametrize("count", [1, 2, 3])
def test_errors_are_as_large_as_their_covariance(count: int) -> None:
    """Mean square of 250 errors, whitened: six, to three and a half standard deviations of such a mean."""
    rng, stated = np.random.default_rng(count), STATED[:count]
    off, sizes = SIGMA[0] if count < 3 else 10e-6, []
    for motion in SIGMA * rng.standard_normal((250, 6)):
        points = measured(motion, stated + off * rng.standard_normal(stated.shape), 0.0)
        points += NOISE_M * rng.standard_normal(points.shape)
        flange = located(points, stated)
        if not flange.uses_stated:  # one in a hundred, rightly stated, and tested by its own level
            continue
        T = flange.T_last_flange
        error = np.concatenate([T[:3, 3] - motion[:3], se3.log(T[:3, :3]) - motion[3:]])
        whole = flange.covariance + NOISE_M**2 * flange.gain @ flange.gain.T
        sizes.append(error @ np.linalg.solve(whole, error))
    assert len(sizes) > 0.95 * 250
    # in the third case the stated places' variance is estimated, with four degrees of freedom, each time anew
    assert np.mean(sizes) == pytest.approx(6, abs=0.8) if count < 3 else 4 < np.mean(sizes) < 12


def test_rows_are_the_derivatives_of_a_moved_point() -> None:
    motion = 1e-7 * np.arange(1, 7)
    by_difference = measured(motion, STATED) - STATED
    np.testing.assert_allclose(point_rows(STATED) @ motion, by_difference, atol=1e-12)  # squares of 1e-7 left out
