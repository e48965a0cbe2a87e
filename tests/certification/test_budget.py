"""Uncertainty budgets, against cases that have a closed form."""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from lab.certification.budget import Budget, InputQuantity, Measurand, budget_of, propagated
from lab.core.probability import Uncertain
from lab.core.se3 import Array
from lab.core.units import MICRONS, MRAD, PPM

POSITIONS = np.random.default_rng(0).normal(size=(40, 3))
EACH = np.broadcast_to(np.eye(3), (40, 3, 3))
X = EACH[..., :1]


def quantity(uncertainty: Uncertain, columns: Array, *, anew: bool = False) -> InputQuantity:
    return InputQuantity("instrument", "thing", "test", MICRONS, uncertainty, columns, anew)


def budget(measurand: Measurand, *quantities: InputQuantity) -> Budget:
    return budget_of(measurand, quantities, POSITIONS, lambda shift: POSITIONS, np.random.default_rng(1))


def test_one_normal_number_has_the_factor_of_the_normal() -> None:
    found = budget("position", quantity(Uncertain(2e-6), X))
    assert found.combined_m == pytest.approx(2e-6) and np.isinf(found.dof)
    assert found.coverage_factor == pytest.approx(1.96, abs=1e-3) and found.agrees
    assert found.drawn_m == pytest.approx(found.propagated_m, abs=5 * found.drawn_std_m)
    assert found.lines[0].sensitivity == pytest.approx(1.0) and found.lines[0].share == pytest.approx(1.0)


def test_three_equal_coordinates_have_the_factor_of_chi_squared() -> None:
    found = budget("position", quantity(Uncertain(2e-6), EACH))
    assert found.combined_m == pytest.approx(2e-6 * np.sqrt(3))
    assert found.coverage_factor == pytest.approx(np.sqrt(stats.chi2.ppf(0.95, 3) / 3), rel=1e-4)


def test_where_one_rectangular_number_rules_what_was_drawn_is_stated() -> None:
    """Its 95 % are 0.95 of the limit, 1.645 standard uncertainties; the law of propagation says 1.96."""
    found = budget("position", quantity(Uncertain.within(3e-6), X))
    assert not found.agrees and found.coverage_factor < 1.7
    assert found.propagated_m == pytest.approx(1.96 * np.sqrt(3) * 1e-6, rel=1e-3)
    assert found.expanded_m == found.drawn_m == pytest.approx(0.95 * 3e-6, rel=0.005)


def test_degrees_of_freedom_are_those_of_welch_and_satterthwaite() -> None:
    """Two equal variances, of 5 degrees of freedom and of infinitely many: 4 times 5.

    By Supplement 1 the first is Student's t, whose tails are longer than this allows for.
    """
    found = budget("position", quantity(Uncertain(1e-6, dof=5), X), quantity(Uncertain(1e-6), X))
    assert found.dof == pytest.approx(20)
    assert found.propagated_m / found.combined_m == pytest.approx(stats.t.ppf(0.975, 20), rel=1e-3)
    tail = stats.t.ppf((np.arange(100_000) + 0.5) / 100_000, 5)
    within = found.drawn_m / 1e-6
    covered = (stats.norm.cdf(within - tail) - stats.norm.cdf(-within - tail)).mean()
    assert covered == pytest.approx(0.95, abs=0.003) and not found.agrees


def test_an_estimated_spread_is_one_for_all_components() -> None:
    """The length of three numbers of one estimated variance: 3 F(3, 6)."""
    found = budget("position", quantity(Uncertain(1e-6, dof=6), EACH))
    exact = 1e-6 * np.sqrt(3 * stats.f.ppf(0.95, 3, 6))
    assert found.propagated_m == pytest.approx(exact, rel=1e-4)
    assert found.drawn_m == pytest.approx(exact, abs=5 * found.drawn_std_m)


def test_distances_feel_neither_shifts_nor_turns_but_growth_and_what_is_anew() -> None:
    shift = quantity(Uncertain(1e-6), EACH)
    turn = np.cross(np.eye(3)[None], POSITIONS[:, None]).transpose(0, 2, 1)
    with_growth = [shift, quantity(Uncertain(1e-6), turn), quantity(Uncertain(1e-6), POSITIONS[..., None])]
    found = propagated("distance", with_growth, POSITIONS, np.random.default_rng(1))
    assert np.sqrt(found.variances[:2]).max() < 1e-20 + 1e-15 * found.combined_m
    assert 1e-6 < found.combined_m < 4e-6  # of distances of 2.2 m on average
    anew = budget("distance", quantity(Uncertain(1e-6), EACH, anew=True))
    assert anew.combined_m == pytest.approx(np.sqrt(2) * 1e-6)
    assert anew.coverage_factor == pytest.approx(1.96, abs=1e-3)


@pytest.mark.parametrize("bend_per_m", [0.0, 2e5])
def test_what_is_not_linear_in_the_parameters_is_in_what_is_stated(bend_per_m: float) -> None:
    """A parameter x moves positions by x along one axis and by b x^2 along another: the 95 % of |x| says both."""
    sigma = 2e-6
    one = InputQuantity("parameters", "x", "test", MICRONS, Uncertain(sigma), X, shifts=np.ones((1, 1)))

    def moved(shift: Array) -> Array:
        return POSITIONS + np.array([shift[0], bend_per_m * shift[0] ** 2, 0.0])

    found = budget_of("position", [one], POSITIONS, moved, np.random.default_rng(1))
    reached = found.kinematics.linear_m
    assert reached == pytest.approx(1.96 * sigma, rel=0.15)  # 400 draws
    assert found.kinematics.full_m == pytest.approx(np.hypot(reached, bend_per_m * reached**2), rel=1e-6)
    assert found.is_linear == (not bend_per_m)
    grown = found.kinematics.full_m / reached if bend_per_m else 1.0
    assert found.expanded_m == pytest.approx(grown * found.propagated_m, rel=0.01)


def test_distances_through_kinematics_are_those_of_moved_positions() -> None:
    """Positions that grow by x: distances do likewise, and a turn by much leaves them as they are."""
    grows = InputQuantity("parameters", "x", "test", PPM, Uncertain(1e-5), POSITIONS[..., None], shifts=np.ones((1, 1)))
    found = budget_of("distance", [grows], POSITIONS, lambda s: POSITIONS * (1 + s[0]), np.random.default_rng(1))
    assert found.kinematics.full_m == pytest.approx(found.kinematics.linear_m, rel=1e-9) and found.is_linear
    turned = np.cross([0.0, 0.0, 1.0], POSITIONS)

    def rotated(shift: Array) -> Array:
        return POSITIONS @ Rotation.from_rotvec([0, 0, float(shift[0])]).as_matrix().T

    turn = InputQuantity("parameters", "x", "test", MRAD, Uncertain(0.3), turned[..., None], shifts=np.ones((1, 1)))
    noise = quantity(Uncertain(1e-3), EACH, anew=True)
    found = budget_of("distance", [turn, noise], POSITIONS, rotated, np.random.default_rng(1))
    assert found.kinematics.full_m == pytest.approx(1.96 * np.sqrt(2) * 1e-3, rel=0.1)
