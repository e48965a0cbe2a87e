"""The size of artefacts: its prior, how it weighs beside readings, and that an arm corrects a printed board."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120

import lab
from lab.calibration.fit_options import FitOptions
from lab.calibration.gauss_newton import fit
from lab.calibration.identification import Identification, fit_base_and_tool, identify
from lab.calibration.prior import prior_of
from lab.calibration.weights import Noise, weigh, weighted_constraints
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.extensions.cameras.board_observation import Pixels
from lab.extensions.cameras.pixels import PixelSensor
from lab.extensions.cameras.rig import Board, Camera, Rig
from lab.kinematics.parameter import SIZE
from lab.kinematics.serial.serial_arm import SerialArm
from lab.sensors.size import checked_size_u, drawn_size

ARM = SerialArm(IRB120.chain)
NOMINAL = ARM.nominal(IRB120.tool)
WITHOUT_PRIOR, AUTOMATIC = FitOptions(prior="off"), FitOptions(prior="auto")


@pytest.fixture(scope="module")
def pictures() -> Measurements:
    return lab.simulate("irb120", observe="pixels", poses=20, seed=4, size_u_percent=0.0).measurements


def observed(data: Measurements, percent: float | None) -> tuple[Pixels, Measurements]:
    model, rows = PixelSensor(Rig((Camera(),), (Board(size_u_percent=percent),))).observation(ARM, data, NOMINAL)
    assert isinstance(model, Pixels)
    return model, rows


def size_of(found: Identification) -> tuple[float, float]:
    """The share by which the board is larger than stated, and its standard deviation."""
    at = next(k for k, i in enumerate(found.fit.free) if found.model.parameters[i].group == SIZE)
    return float(found.values[found.fit.free[at]]), float(found.std[at])


@pytest.mark.parametrize("percent", [0.01, 0.5, 5.0])
def test_without_other_knowledge_a_size_is_as_uncertain_as_stated(pictures: Measurements, percent: float) -> None:
    model, rows = observed(pictures, percent)
    share, std = size_of(identify(model, rows, NOMINAL, options=WITHOUT_PRIOR))
    assert std == pytest.approx(percent / 100, rel=0.03) and abs(share) < 1e-3 * std


@pytest.mark.parametrize("options", [WITHOUT_PRIOR, AUTOMATIC])
def test_the_noise_that_residuals_show_weighs_as_the_same_noise_given(
    pictures: Measurements, options: FitOptions
) -> None:
    """Values, covariance and condition number are those of a fit to which the noise was told."""
    model, rows = observed(pictures, 0.5)
    found = identify(model, rows, NOMINAL, options=options)
    told = identify(model, rows, NOMINAL, Noise(sigma_m=found.sigma_m), options)
    np.testing.assert_allclose(found.values, told.values, atol=2e-8)
    np.testing.assert_allclose(found.std, told.std, rtol=1e-3)
    assert found.fit.condition == pytest.approx(told.fit.condition, rel=1e-2)
    exact = identify(*observed(pictures, 0.0), NOMINAL)
    assert found.fit.condition == pytest.approx(exact.fit.condition, rel=0.05)  # no prior makes it worse


def test_further_rows_beside_a_fit_are_those_of_the_whole_fit(pictures: Measurements) -> None:
    """A second statement of the board's size, half a standard deviation larger: the fit of both at once."""
    model, rows = observed(pictures, 0.05)
    weights, _ = weigh(model, rows, Noise(sigma_m=1e-4))
    free = identify(model, rows, NOMINAL, Noise(sigma_m=1e-4), WITHOUT_PRIOR).fit.free
    stated = weighted_constraints(model.weighed(1e-4), weights)

    def stated_twice(values: Array) -> tuple[Array, Array]:
        residual, jacobian = stated(values)
        return np.concatenate([residual, residual + 0.5]), np.concatenate([jacobian, jacobian])

    start = fit_base_and_tool(model, weights, model.nominal(NOMINAL))
    once, twice = (fit(model, weights, free, start, extra_residuals=extra) for extra in (stated, stated_twice))
    residual, jacobian = stated_twice(once.values)
    beside, moved = once.beside(residual[1:], jacobian[1:])
    assert twice.values[-1] == pytest.approx(0.25 * 5e-4, rel=1e-3)
    np.testing.assert_allclose(beside.values, twice.values, atol=1e-6)  # to first order in a change of 0.01 %
    np.testing.assert_allclose(beside.unit_covariance(), twice.unit_covariance(), rtol=1e-2, atol=1e-12)
    assert moved == pytest.approx(0.25, rel=1e-2)  # of the first statement; no reading moves


def test_the_tolerances_of_an_arm_correct_a_printed_board(pictures: Measurements) -> None:
    """A board that is stated 1 % too small: information of board and arm adds up, at the most likely size.

    The size of an arm whose lengths all grow by s is s L / tolerance away from nominal.
    """
    smaller = Board(size_u_percent=None, square_mm=20.0 / 1.01)
    model, rows = PixelSensor(Rig((Camera(),), (smaller,))).observation(ARM, pictures, NOMINAL)
    found = identify(model, rows, NOMINAL, options=AUTOMATIC)
    share, std = size_of(found)
    # the arm's own size: of all directions the one along which the lengths grow together
    prior = prior_of(found.model, found.base_set, NOMINAL, AUTOMATIC.tolerance, links_alone=True)
    lengths = np.array([found.model.parameters[i].kind == "length" for i in prior.of])
    grown = prior.whiten @ np.where(lengths, found.values[list(prior.of)], 0.0)
    assert found.prior is not None and found.prior.acts_in == 1
    own = found.prior.scale / np.linalg.norm(grown)
    assert own == pytest.approx(1e-3, rel=0.5)
    assert std == pytest.approx(1 / np.hypot(1 / own, 1 / 5e-3), rel=0.1)
    assert abs(share - 0.01) < 3 * std


def test_an_unknown_size_has_no_prior(pictures: Measurements) -> None:
    model, rows = observed(pictures, np.inf)
    assert len(model.extra_residuals(model.nominal(NOMINAL))[0]) == 0
    assert identify(model, rows, NOMINAL).lacks_size
    known, rows = observed(pictures, 0.5)
    assert not identify(known, rows, NOMINAL).lacks_size


def test_a_tracker_beside_a_camera_measures_the_board() -> None:
    """The simulated board is some 0.5 % off, and the tracker shows its size to a hundredth of that."""
    result = lab.calibrate("irb120", observe="points+pixels", poses=14, seed=2)
    share, std = size_of(result.identification)
    true = result.truth.comparison
    assert true is not None and true.coverage_95 > 0.8 and std < 1e-4
    assert abs(share) > 10 * std
    names = [check.name for check in result.checks]
    assert "size.artefact" in names and result.checks[names.index("size.artefact")].data["corrected"]


def test_sizes_are_drawn_as_stated_and_leave_other_draws_alone() -> None:
    rng = np.random.default_rng(0)
    drawn = np.array([drawn_size(5e-3, rng) for _ in range(2000)])
    assert np.std(drawn) == pytest.approx(5e-3, rel=0.06) and abs(drawn.mean()) < 4 * 5e-3 / np.sqrt(2000)
    assert rng.random() == np.random.default_rng(0).random()
    assert drawn_size(0.0, rng) == 0.0 and drawn_size(np.inf, rng) == 0.0


@pytest.mark.thorough
def test_a_distance_of_sockets_is_as_uncertain_as_stated() -> None:
    """The size is no direction of the readings, and the arm has it from the distance where that is good."""
    options = {"observe": "socket", "socket_distance_mm": 80.0, "size_u_percent": 0.01}
    result = lab.calibrate("irb120", poses=40, fixtures=3, seed=3, instrument="ball-in-socket", **options)
    share, std = size_of(result.identification)
    assert std == pytest.approx(1e-4, rel=0.05) and abs(share) < std
    parts = [name for direction in result.weak_directions for name, change in direction.parts if np.isfinite(change)]
    assert parts and "socket.scale" not in parts
    data = next(check.data for check in result.checks if check.name == "size.artefact")
    assert not data["corrected"] and data["stated"] == pytest.approx(1e-4)


@pytest.mark.thorough
def test_intervals_of_printed_boards_cover_in_simulations() -> None:
    """Errors of the sizes found in 12 campaigns, in their standard deviations: 1.7 of rms is beyond 1 in 1,000."""
    off = []
    for seed in range(12):
        result = lab.calibrate("irb120", observe="pixels", poses=16, seed=seed)
        comparison, names = result.truth.comparison, result.names
        assert comparison is not None
        at = [names[i] for i in result.identification.fit.free].index("board.board.scale")
        off.append(float(comparison.z[at]))
    assert np.abs(off).max() < 3.5 and np.sqrt(np.mean(np.square(off))) < 1.7


@pytest.mark.parametrize("percent", [-0.1, 101.0, np.nan, -np.inf])
def test_an_impossible_uncertainty_is_refused(percent: float) -> None:
    with pytest.raises(LabError, match=r"size_u_percent .*: give percent"):
        Board(size_u_percent=percent)
    assert checked_size_u("size_u_percent", None, 5e-3) == 5e-3
    assert replace(Board(), size_u_percent=0.0).size_u == 0.0
