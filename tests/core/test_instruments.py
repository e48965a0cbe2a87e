"""Instruments: the noise they draw is the noise they weigh by, and what they see."""

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.core.instruments import INSTRUMENTS, FieldOfView, instrument

POINTS = np.array([[2.0, 1.0, 0.5], [0.0, 0.0, 3.0], [-1.0, 4.0, -2.0]])


@pytest.mark.parametrize("name", INSTRUMENTS)
@pytest.mark.parametrize("readings", [1, 4])
def test_the_covariance_is_that_of_the_samples(name: str, readings: int) -> None:
    """40,000 samples: each element within 5 standard errors, sqrt(2 / 40,000) of the largest variance at most."""
    device, count = INSTRUMENTS[name], 40_000
    points = np.broadcast_to(POINTS, (count, 3, 3))
    off = device.sample(points, np.random.default_rng(0), readings) - points
    found = np.einsum("nki,nkj->kij", off, off) / count
    expected = device.covariance(POINTS, readings)
    assert np.abs(found - expected).max() <= 5 * np.sqrt(2 / count) * expected.max()


def test_an_unknown_instrument_lists_those_there_are() -> None:
    with pytest.raises(LabError, match=r"'ruler' is unknown: .*leica-at960"):
        instrument("ruler")


def test_a_field_of_view_by_hand() -> None:
    view = FieldOfView(1.0, 5.0, np.deg2rad(-10), np.deg2rad(45), np.deg2rad(30))
    towards, away = np.array([-1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
    cases = {(2.0, 0.0, 0.0): True, (0.5, 0.0, 0.0): False, (6.0, 0.0, 0.0): False, (2.0, 0.0, 2.5): False}
    for point, inside in cases.items():
        assert view.admits(np.array(point), towards) == inside
        assert not view.admits(np.array(point), away)
    assert FieldOfView().admits(np.array([0.0, 9.0, 9.0]), away)
