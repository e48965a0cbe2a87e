"""A covariance is finite, symmetric and positive semidefinite, in whatever units its parameters are."""

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.core.linear_model import refuse_impossible_covariance


@pytest.mark.parametrize("seed", range(5))
def test_covariances_pass_and_what_is_none_is_refused(seed: int) -> None:
    rng = np.random.default_rng(seed)
    units = 10.0 ** rng.uniform(-9, 3, 6)
    factor = units[:, None] * rng.standard_normal((6, 4))  # of rank 4: semidefinite
    covariance = factor @ factor.T
    refuse_impossible_covariance("run", covariance)
    values, vectors = np.linalg.eigh(covariance / np.outer(units, units))
    turned = vectors @ np.diag([-0.01 * values[-1], *values[1:]]) @ vectors.T * np.outer(units, units)
    with pytest.raises(LabError, match=r"run: the covariance (is not positive|has a variance below)"):
        refuse_impossible_covariance("run", turned)
    other = covariance.copy()
    other[0, 1] += 1e-6 * units[0] * units[1]
    with pytest.raises(LabError, match="not symmetric"):
        refuse_impossible_covariance("run", other)


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_refused(number: float) -> None:
    with pytest.raises(LabError, match="not finite"):
        refuse_impossible_covariance("run", np.array([[1.0, number], [number, 1.0]]))


def test_what_has_no_variance_has_no_correlation() -> None:
    refuse_impossible_covariance("run", np.zeros((3, 3)))
    refuse_impossible_covariance("run", np.empty((0, 0)))
    with pytest.raises(LabError, match="what has no variance"):
        refuse_impossible_covariance("run", np.array([[1.0, 0.1], [0.1, 0.0]]))
    with pytest.raises(LabError, match="no square matrix"):
        refuse_impossible_covariance("run", np.zeros((2, 3)))
