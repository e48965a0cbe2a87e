"""Probabilities against scipy.stats, far into the tails."""

import numpy as np
import pytest
from scipy import stats

from lab.core import probability as p

X = np.array([-1.0, 0.0, 1e-12, 0.3, 1.0, 4.0, 60.0, 500.0, np.inf])[:, None]
CHANCES = np.array([1e-12, 1e-3, 0.025, 0.3, 0.5, 0.99, 1 - 1e-9])[:, None]
DOF = np.array([0.7, 1.0, 2.0, 7.5, 123.0, 1e6])


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        (p.normal_sf(X), stats.norm.sf(X)),
        (p.normal_ppf(CHANCES), stats.norm.ppf(CHANCES)),
        (p.t_sf(X, DOF), stats.t.sf(X, DOF)),
        (p.t_ppf(CHANCES, DOF), stats.t.ppf(CHANCES, DOF)),
        (p.t_isf(CHANCES, DOF), stats.t.isf(CHANCES, DOF)),
        (p.chi2_sf(X, DOF), stats.chi2.sf(X, DOF)),
        (p.chi2_isf(CHANCES, DOF), stats.chi2.isf(CHANCES, DOF)),
        (p.chi2_ppf(CHANCES, DOF), stats.chi2.ppf(CHANCES, DOF)),
        (p.f_sf(X, DOF, 9.0), stats.f.sf(X, DOF, 9.0)),
        (p.f_sf(X, 3.0, DOF), stats.f.sf(X, 3.0, DOF)),
        (p.f_cdf(X, DOF, 9.0), stats.f.cdf(X, DOF, 9.0)),
        (stats.f.sf(p.f_isf(CHANCES, DOF, 9.0), DOF, 9.0), CHANCES + 0 * DOF),  # its own isf loses the tail's digits
        (stats.f.sf(p.f_isf(CHANCES, 3.0, DOF), 3.0, DOF), CHANCES + 0 * DOF),
        (p.beta_ppf(CHANCES, DOF, 9.0), stats.beta.ppf(CHANCES, DOF, 9.0)),
        (p.binomial_cdf(np.arange(-1, 31), 30, 0.95), stats.binom.cdf(np.arange(-1, 31), 30, 0.95)),
    ],
)
def test_they_are_those_of_scipy_stats(ours: np.ndarray, theirs: np.ndarray) -> None:
    np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-300)


def test_without_degrees_of_freedom_there_is_no_probability() -> None:
    assert np.isnan([p.t_sf(1.0, 0.0), p.t_ppf(0.9, 0.0), p.f_sf(1.0, 3.0, 0.0), p.t_ppf(np.nan, 3.0)]).all()
