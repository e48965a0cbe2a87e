"""Units in which people read quantities."""

import numpy as np
import pytest

from lab.core.units import DEGREES, MICRONS, MM, MRAD, PPM, Unit, short_length


def test_degrees_are_those_of_numpy() -> None:
    angles = np.linspace(-4, 4, 1001)
    np.testing.assert_array_equal(DEGREES.of(angles), np.rad2deg(angles))


@pytest.mark.parametrize("unit", [MM, MRAD, DEGREES, MICRONS, PPM])
def test_there_and_back(unit) -> None:
    sizes = np.array([0.0, -1.5e-3, 2.25, np.inf])
    np.testing.assert_allclose(unit.to_si(unit.of(sizes)), sizes, rtol=1e-15)  # two roundings
    assert unit.of(1.0) == unit.factor


def test_sizes_with_their_unit() -> None:
    assert (MM.text(2.5), MM.text(0.0012345), MM.text(0.9996)) == ("2,500 mm", "1.23 mm", "1,000 mm")
    assert (MM.text(0.0456789, 2), MM.text(0.15, 2), MM.text(-0.15)) == ("46 mm", "150 mm", "-150 mm")
    assert (DEGREES.text(np.pi / 6), MRAD.text(1e-4, 6), PPM.text(np.inf)) == ("30°", "0.1 mrad", "inf ppm")


def test_keys_of_units() -> None:
    units = (MM, DEGREES, MRAD, MICRONS, Unit("K/m", "K/m", 1.0))
    assert [unit.key for unit in units] == ["mm", "deg", "mrad", "um", "k_per_m"]


def test_short_lengths_choose_their_unit() -> None:
    assert [short_length(size) for size in (52.3e-6, 593e-6, 1.5e-3)] == ["52 µm", "590 µm", "1.5 mm"]
