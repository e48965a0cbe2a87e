"""Uncertainty budgets, against cases that have a closed form."""

import numpy as np
import pytest
from scipy import stats

from lab.certification.budget import Budget, InputQuantity, Measurand, budget_of, propagated
from lab.core.distributions import Uncertain
from lab.core.se3 import Array

POSITIONS = np.random.default_rng(0).normal(size=(40, 3))
EACH = np.broadcast_to(np.eye(3), (40, 3, 3))
X = EACH[..., :1]


def quantity(uncertainty: Uncertain, columns: Array, *, anew: bool = False) -> InputQuantity:
    return InputQuantity("instrument", "thing", "test", "µm", 1e6, uncertainty, columns, anew)


def budget(measurand: Measurand, *quantities: InputQuantity) -> Budget:
    return budget_of(measurand, quantities, POSITIONS, np.random.default_rng(1))


def test_one_normal_number_has_the_factor_of_the_normal() -> None:
    found = budget("position", quantity(Uncertain(2e-6), X))
    assert found.combined_m == pytest.approx(2e-6) and np.isinf(found.freedom)
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
    found = budget("position", quantity(Uncertain(1e-6, freedom=5), X), quantity(Uncertain(1e-6), X))
    assert found.freedom == pytest.approx(20)
    assert found.propagated_m / found.combined_m == pytest.approx(stats.t.ppf(0.975, 20), rel=1e-3)
    tail = stats.t.ppf((np.arange(100_000) + 0.5) / 100_000, 5)
    within = found.drawn_m / 1e-6
    covered = (stats.norm.cdf(within - tail) - stats.norm.cdf(-within - tail)).mean()
    assert covered == pytest.approx(0.95, abs=0.003) and not found.agrees


def test_an_estimated_spread_is_one_for_all_components() -> None:
    """The length of three numbers of one estimated variance: 3 F(3, 6)."""
    found = budget("position", quantity(Uncertain(1e-6, freedom=6), EACH))
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
