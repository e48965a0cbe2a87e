"""The linear map of a fit, against fits of measurements that are displaced."""

from functools import cache

import numpy as np
import pytest
from helpers.robots import IRB120

from lab.calibration.gauss_newton import Observations, fit
from lab.calibration.observation import observation_of
from lab.certification.budget import Propagation, RandomErrors, RandomScatter, quantities_of, temperature_of
from lab.core.linear_model import whitening
from lab.core.probability import Uncertain
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.gauge import base_set
from lab.kinematics.serial.serial_arm import SerialArm
from lab.noise.instruments import SYSTEMATIC_ERRORS, TrackerErrors, instrument

ARM = SerialArm(IRB120.chain, ("p1", "p2"))
TRUTH = ARM.nominal({"p1": (0.03, 0.02, 0.1), "p2": (-0.025, 0.03, 0.08)})
TRUTH[:3] = 2.0, 1.0, 0.3
FREE = base_set(ARM, TRUTH).identifiable
ASKED = ARM.structure_joints(200, rng_for(0, "structure"))


@cache
def observed() -> Observations:
    poses = ARM.structure_joints(30, np.random.default_rng(2))
    points = ARM.points(poses, TRUTH)
    return Observations(poses, points, whitening(instrument("leica-at960").covariance(points)))


@cache
def propagation() -> Propagation:
    return Propagation.of(observation_of(ARM), observed(), TRUTH, FREE)


def fitted_positions(points: Array) -> Array:
    found = fit(ARM, Observations(observed().inputs, points, observed().whiten), FREE, TRUTH, tolerance_m=1e-13)
    return ARM.points(ASKED, found.values)[:, 0]


@pytest.mark.parametrize("name", ["transit_offset", "collimation", "temperature_gradient"])
def test_a_displaced_measurement_moves_positions_as_the_map_says(name: str) -> None:
    """Of a micrometre or so: what is of second order is a millionth of that."""
    term = next(term for term in SYSTEMATIC_ERRORS if term.name == name)
    moved = TrackerErrors().displacements(term, observed().points)
    size = 1e-6 / np.abs(moved).max()
    found = fitted_positions(observed().points + size * moved[..., 0]) - propagation().positions
    expected = size * propagation().columns_of(propagation().shifts_by(moved))[..., 0]
    np.testing.assert_allclose(found, expected, atol=1e-10)
    assert np.abs(expected).max() > 1e-7


def test_a_shift_of_all_points_shifts_all_positions() -> None:
    alike = np.broadcast_to(np.eye(3), (*observed().points.shape, 3))
    columns = propagation().columns_of(propagation().shifts_by(alike))
    np.testing.assert_allclose(columns, np.broadcast_to(np.eye(3), (200, 3, 3)), atol=1e-9)


def test_the_covariance_of_independent_errors_is_that_of_dense_algebra() -> None:
    part, n = propagation(), observed().points.size
    errors = TrackerErrors(centring_lateral=Uncertain(3e-6), nest=Uncertain(2e-6))
    blocks = errors.placement_covariance(observed().points).reshape(-1, 3, 3)
    dense = np.zeros((n, n))
    for i, block in enumerate(blocks):
        dense[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = block
    columns = np.eye(n).reshape(*observed().points.shape, n)
    gain = part.gain @ observed().apply(columns)
    expected = gain @ dense @ gain.T
    np.testing.assert_allclose(
        part.covariance_of(errors.placement_covariance(observed().points)),
        expected,
        rtol=1e-6,
        atol=1e-9 * expected.max(),
    )


def test_the_noise_that_is_known_gives_the_covariance_of_the_fit() -> None:
    found = fit(ARM, observed(), FREE, TRUTH).values
    slopes = observed().apply(ARM.observe(observed().inputs, found)[1][..., list(FREE)])
    expected = np.linalg.inv(slopes.T @ slopes)
    independent = instrument("leica-at960").covariance(observed().points)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        propagation().covariance_of(independent) / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-6
    )


@pytest.mark.parametrize("placement", ["in the noise", "beside", "in the residuals"])
def test_how_the_reflector_is_placed_counts_once(placement: str) -> None:
    """In the noise it is taken out of the parameters' line; beside it adds; in the residuals it has no line."""
    errors, part = TrackerErrors(nest=Uncertain(4e-6)), propagation()
    noise = part.gain @ part.gain.T
    nest = part.covariance_of(errors.placement_covariance(observed().points))
    whole = noise + nest if placement == "in the noise" else noise
    noise_m = RandomScatter(5e-6, np.inf, "test")
    chance = RandomErrors(whole, noise_m, placement, None, False, None)  # type: ignore[arg-type]
    found = quantities_of(part, errors, "test", chance)
    squares = sum(each.uncertainty.standard**2 * each.columns @ np.swapaxes(each.columns, 1, 2) for each in found)
    total = noise if placement == "in the residuals" else noise + nest
    expected = part.slopes @ total @ np.swapaxes(part.slopes, 1, 2)
    np.testing.assert_allclose(squares, expected, rtol=1e-6, atol=1e-9 * expected.max())


def test_a_warm_robot_is_longer_from_its_foot() -> None:
    found = temperature_of(propagation(), TRUTH[:3], Uncertain(2.0), 12e-6)
    np.testing.assert_allclose(found.columns[..., 0], 12e-6 * (propagation().positions - TRUTH[:3]))


def test_shifted_parameters_move_positions_by_the_full_kinematics() -> None:
    """For small shifts as the linear map says, for large ones not; against the arm's own positions."""
    part, rng = propagation(), np.random.default_rng(4)
    shift = rng.standard_normal(len(FREE))
    small = part.moved(1e-6 * shift) - part.positions
    np.testing.assert_allclose(small, part.columns_of(1e-6 * shift[:, None])[..., 0], atol=1e-10)
    values = TRUTH.copy()
    values[list(FREE)] += 0.1 * shift
    far = part.moved(0.1 * shift)
    np.testing.assert_allclose(far, ARM.points(ASKED, values)[:, 0], atol=1e-12)
    assert np.abs(far - part.positions - part.columns_of(0.1 * shift[:, None])[..., 0]).max() > 1e-3
