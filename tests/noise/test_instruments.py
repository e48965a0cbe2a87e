"""Instruments: the noise they draw is the noise they weigh by, and what they see."""

from dataclasses import replace
from itertools import takewhile

import numpy as np
import pytest
from helpers.robots import ROOT

from lab.core.errors import LabError
from lab.core.probability import Uncertain
from lab.noise.instruments import INSTRUMENTS, FieldOfView, Instrument, TrackerErrors, instrument, is_isotropic

POINTS = np.array([[2.0, 1.0, 0.5], [0.0, 0.0, 3.0], [-1.0, 4.0, -2.0]])


def drawn(device: Instrument, points: np.ndarray, seed: int, readings: int = 1) -> np.ndarray:
    """Errors of one campaign: of the readings, and what they have in common."""
    rng = np.random.default_rng(seed)
    return device.sample(points, rng, readings) - points + device.errors.sample(points, rng.spawn(1)[0])


@pytest.mark.parametrize("name", {each.kind: name for name, each in INSTRUMENTS.items()}.values())
@pytest.mark.parametrize("readings", [1, 4])
def test_the_covariance_is_that_of_the_samples(name: str, readings: int) -> None:
    """40,000 samples: each element within 5 standard errors, sqrt(2 / 40,000) of the largest variance at most."""
    device, count = INSTRUMENTS[name], 40_000
    off = drawn(device, np.broadcast_to(POINTS, (count, 3, 3)), 0, readings)
    found = np.einsum("nki,nkj->kij", off, off) / count
    expected = device.covariance(POINTS, readings)
    assert np.abs(found - expected).max() <= 5 * np.sqrt(2 / count) * expected.max()


@pytest.mark.parametrize("readings", [1, 9])
@pytest.mark.parametrize("reach", [2.0, 5.0, 10.0])
def test_constants_of_nest_and_range_add_along_and_across_the_line_of_sight(reach: float, readings: int) -> None:
    """Variances add: readings share theirs, nest and lock-on do not. By hand, in µm; then 20,000 drawn errors."""
    errors = TrackerErrors(nest=Uncertain(3e-6), lock_on=Uncertain(5e-6), centring_lateral=Uncertain(2e-6))
    device = Instrument("t", "spherical", 1e-6, 0.25e-6, 7.5e-6, 3e-6, errors=errors)
    ray = np.array([2.0, -1.0, 2.0]) / 3
    across = np.linalg.svd(ray[None])[2][1:]
    along_um = np.sqrt((1 + 0.25 * reach) ** 2 / readings + 5**2 + 3**2)
    across_um = np.sqrt((7.5 + 3 * reach) ** 2 / readings + 2**2 + 3**2)
    covariance = device.covariance(reach * ray, readings)
    np.testing.assert_allclose(1e12 * ray @ covariance @ ray, along_um**2, rtol=1e-12)
    np.testing.assert_allclose(1e12 * across @ covariance @ across.T, across_um**2 * np.eye(2), atol=1e-9)
    plain = TrackerErrors(nest=errors.nest, lock_on=errors.lock_on)  # centring is one size for a campaign
    device = replace(device, errors=plain)
    off = 1e6 * drawn(device, np.tile(reach * ray, (20_000, 1)), 1, readings)
    assert np.std(off @ ray) == pytest.approx(along_um, rel=0.03)  # 5 standard errors are 2.5 %
    assert np.std(off @ across.T) == pytest.approx(np.sqrt(across_um**2 - 4), rel=0.03)


def test_a_nest_leaves_noise_isotropic_and_a_range_does_not() -> None:
    camera = Instrument("c", "gaussian", radial_m=4e-6, errors=TrackerErrors(nest=Uncertain(3e-6)))
    assert is_isotropic(camera) and camera.isotropic_sigma() == pytest.approx(5e-6)
    assert camera.isotropic_sigma(16) == pytest.approx(np.sqrt(10) * 1e-6)
    np.testing.assert_allclose(camera.covariance(POINTS, 16), np.broadcast_to(10e-12 * np.eye(3), (3, 3, 3)))
    ranging = Instrument("r", "gaussian", radial_m=4e-6, errors=TrackerErrors(lock_on=Uncertain(3e-6)))
    assert not is_isotropic(ranging)
    along = POINTS[0] / np.linalg.norm(POINTS[0])
    assert along @ ranging.covariance(POINTS)[0] @ along == pytest.approx(25e-12)


# Maximum permissible errors in µm at range R in m, along and across the line of sight, as the makers state them; of one
# standard deviation where none is stated. The range of the AT960: the interferometer's, and a lock-on, as squares.
PUBLISHED = {
    "leica-at960": (lambda reach: np.hypot(0.5 * reach, 10), lambda reach: 15 + 6 * reach),
    "leica-at500": (lambda reach: 10 + 0.3 * reach, lambda reach: 15 + 6 * reach),
    "faro-vantage": (lambda reach: 16 + 0.8 * reach, lambda reach: 20 + 5 * reach),
}
NEST_UM = 3.0


def along_and_across_um(name: str, reach: float) -> tuple[float, float]:
    """Standard deviations of a preset at a level point; across, the larger of two."""
    covariance = INSTRUMENTS[name].covariance(np.array([reach, 0.0, 0.0]))
    return 1e6 * float(np.sqrt(covariance[0, 0])), 1e6 * float(np.sqrt(max(covariance[1, 1], covariance[2, 2])))


@pytest.mark.parametrize("name", PUBLISHED)
@pytest.mark.parametrize("reach", [2.0, 5.0, 10.0])
def test_a_trackers_noise_is_half_of_the_published_error_and_a_nest(name: str, reach: float) -> None:
    expected = [np.hypot(published(reach) / 2, NEST_UM) for published in PUBLISHED[name]]
    np.testing.assert_allclose(along_and_across_um(name, reach), expected, rtol=1e-9)


def documented() -> dict[str, list[str]]:
    """The table of the presets in docs/reference/trackers.md: cells by name."""
    lines = (ROOT / "docs" / "reference" / "trackers.md").read_text(encoding="utf-8").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("| preset |"))
    table = takewhile(lambda line: line.startswith("|"), lines[start + 2 :])
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table]
    return {row[0]: row[1:] for row in rows}


def test_the_documented_table_has_every_preset() -> None:
    assert set(documented()) == set(INSTRUMENTS) - {"exact"}


@pytest.mark.parametrize("name", [name for name in INSTRUMENTS if name != "exact"])
def test_the_documented_table_is_that_of_the_presets(name: str) -> None:
    """To the digit that is written: half of the published error, and the noise, at 2, 5 and 10 m."""
    _, *cells = documented()[name]
    view = INSTRUMENTS[name].field_of_view
    for reach, half, noise in zip((2.0, 5.0, 10.0), cells[:3], cells[3:], strict=True):
        published = [f"{each(reach) / 2:.1f}" for each in PUBLISHED[name]] if name in PUBLISHED else None
        assert half == ("–" if published is None else "; ".join(published))
        seen = view.nearest_m <= reach <= view.farthest_m
        assert noise == ("; ".join(f"{size:.1f}" for size in along_and_across_um(name, reach)) if seen else "–")


@pytest.mark.parametrize("name", [name for name, each in INSTRUMENTS.items() if each.kind == "spherical"])
def test_no_preset_knows_a_range_far_better_than_a_nest_holds_a_reflector(name: str) -> None:
    """A range of 0.65 µm beside 15 µm across would weigh any constant of the reflector as if it were the arm's."""
    for reach in (1.0, 2.6, 10.0):
        for readings in (1, 100):
            covariance = INSTRUMENTS[name].covariance(np.array([reach, 0.0, 0.0]), readings)
            assert np.sqrt(covariance[0, 0]) >= NEST_UM * 1e-6


def test_an_unknown_instrument_lists_those_there_are() -> None:
    with pytest.raises(LabError, match=r"instrument ruler: unknown; give one of .*leica-at960"):
        instrument("ruler")


def test_a_field_of_view_by_hand() -> None:
    view = FieldOfView(1.0, 5.0, np.deg2rad(-10), np.deg2rad(45), np.deg2rad(30))
    towards, away = np.array([-1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
    cases = {(2.0, 0.0, 0.0): True, (0.5, 0.0, 0.0): False, (6.0, 0.0, 0.0): False, (2.0, 0.0, 2.5): False}
    for point, inside in cases.items():
        assert view.admits(np.array(point), towards) == inside
        assert not view.admits(np.array(point), away)
    assert FieldOfView().admits(np.array([0.0, 9.0, 9.0]), away)
