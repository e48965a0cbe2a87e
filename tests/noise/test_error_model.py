"""The errors that numbers share, term by term."""

from dataclasses import replace

import numpy as np
import pytest

from lab.noise.error_model import Clock, ErrorModel
from lab.noise.error_term import TERMS


def sample(scatter: float = 0.0, wandering: float = 0.0, drift: float = 0.0) -> ErrorModel:
    sizes = {"scatter": scatter, "shift": wandering, "trend": drift}
    return ErrorModel(5e-6, 1.0, sizes, Clock(10.0, 10.0), {"tool.p1.x": 0.1}, 0.8)


def test_names_keys_and_structures_of_terms_are_their_own() -> None:
    """One term is drawn anew at each pose, one is autoregressive: the likelihood takes no more of these."""
    assert len({term.name for term in TERMS}) == len({term.kind for term in TERMS}) == len(TERMS)
    keys = [term.key for term in TERMS if term.key]
    assert len(set(keys)) == len(keys)
    structures = [term.structure for term in TERMS]
    assert structures.count("pose") == structures.count("autoregressive") == 1


def test_a_model_has_the_terms_that_are_above_zero() -> None:
    of = sample(wandering=4e-6)
    assert of.kinds == ("wandering",) and of.sizes == {"shift": 4e-6} and not of.is_given
    assert of.common_m2 == pytest.approx(16e-12) and of.within_m2 == (pytest.approx(16e-12),)
    np.testing.assert_array_equal(sample(scatter=2e-6).joint_covariance(3), 4e-12 * np.eye(3))


def test_one_variance_is_moved_by_its_logarithm_and_a_correlation_by_its_odds() -> None:
    of = sample(scatter=30e-6, wandering=4e-6, drift=20e-6)
    for name in ("scatter", "shift", "trend"):
        moved = of.moved(name, 0.4)
        assert (moved.size(name) / of.size(name)) ** 2 == pytest.approx(np.exp(0.4))
        assert replace(moved, sizes={**moved.sizes, name: of.size(name)}) == of
    assert of.moved("scale", 0.4).independent_m ** 2 == pytest.approx(np.exp(0.4) * of.independent_m**2)
    carry = of.moved("carry", 0.4).carry
    assert np.log(carry / (1 - carry)) - np.log(0.8 / 0.2) == pytest.approx(0.4)
