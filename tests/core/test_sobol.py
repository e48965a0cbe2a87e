"""Points that fill a cube evenly, against scipy's own."""

import numpy as np
import pytest
from scipy.stats import qmc

from lab.core.errors import LabError
from lab.core.random import MOST_DIMENSIONS, ScrambledSobol


@pytest.mark.parametrize("dimensions", [1, 2, 6, MOST_DIMENSIONS])
def test_points_are_those_of_scipy_bit_for_bit(dimensions: int) -> None:
    ours = ScrambledSobol(dimensions, np.random.default_rng(dimensions))
    theirs = qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng(dimensions))
    for _ in range(3):
        np.testing.assert_array_equal(ours.points(64), theirs.random(64))


def test_every_sixteenth_of_each_edge_has_as_many_points() -> None:
    points = ScrambledSobol(7, np.random.default_rng(1)).points(1024)
    for along in points.T:
        assert np.histogram(along, 16, (0, 1))[0].tolist() == [64] * 16
    chance = np.random.default_rng(1).random(1024)
    assert np.histogram(chance, 16, (0, 1))[0].tolist() != [64] * 16


def test_more_dimensions_than_there_are_numbers_for_are_refused() -> None:
    with pytest.raises(LabError, match=r"41 joints: .* up to 40; fix some"):
        ScrambledSobol(41, np.random.default_rng(1))
