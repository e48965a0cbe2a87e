"""A tracker's file: what it says in SI units, and one line for what makes no sense."""

from pathlib import Path

import numpy as np
import pytest

import lab
from lab.core.errors import LabError
from lab.formats.instrument_toml import read_instrument

NOISE = "[noise]\nradial_um = 2\nradial_um_per_m = 0.5\ntransverse_um = 7.5\ntransverse_um_per_m = 3\n"
SYSTEMATIC = """
[systematic]
two_face = true
transit_tilt_urad = { standard = 5, freedom = 20 }
azimuth_eccentricity_urad = { limit = 6, distribution = "arcsine" }
temperature_gradient_k_per_m = { limit = 0.5 }
nest_um = { standard = 3 }
"""


def test_a_file_is_read_in_si_units(tmp_path: Path) -> None:
    path = tmp_path / "ours.toml"
    path.write_text("name = 'Tracker 7'\n" + NOISE + "[field_of_view]\nlowest_deg = -45\n" + SYSTEMATIC)
    device = read_instrument(path)
    numbers = device.radial_m, device.radial_per_m, device.transverse_m, device.transverse_per_m
    np.testing.assert_allclose(numbers, (2e-6, 0.5e-6, 7.5e-6, 3e-6))
    assert device.name == "Tracker 7" and device.field_of_view.lowest_rad == pytest.approx(-np.pi / 4)
    errors = device.errors
    assert errors.two_face and [term.name for term in errors.stated] == [
        "transit_tilt", "azimuth_eccentricity", "temperature_gradient", "nest",
    ]  # fmt: skip
    assert (errors.transit_tilt.standard, errors.transit_tilt.dof) == (5e-6, 20)
    assert errors.azimuth_eccentricity.limit == pytest.approx(6e-6)
    assert errors.temperature_gradient.standard == pytest.approx(0.5 / np.sqrt(3))


def test_a_range_that_is_found_anew_is_one_of_the_errors_that_a_file_states(tmp_path: Path) -> None:
    """An old file, without the line, has none; with it the covariance grows along the beam alone."""
    old, new = tmp_path / "old.toml", tmp_path / "new.toml"
    old.write_text(NOISE)
    new.write_text(NOISE + "[systematic]\nlock_on_um = { limit = 9 }\n")
    assert not read_instrument(old).errors.stated
    assert read_instrument(new).errors.lock_on.standard == pytest.approx(9e-6 / np.sqrt(3))
    point = np.array([[0.0, 2.0, 0.0]])
    grown = read_instrument(new).covariance(point, 4) - read_instrument(old).covariance(point, 4)
    np.testing.assert_allclose(grown[0], np.diag([0.0, 27e-12, 0.0]), atol=1e-18)


WRONG = {
    "": "is empty",
    "[noise]\nradial_um = 1\n": "transverse_um",
    NOISE.replace("7.5", "-1"): "transverse_um is -1",
    NOISE.replace("7.5", "0").replace("3\n", "0\n"): "zero along or across",
    NOISE.replace("7.5", "'x'"): "give a number",
    "colour = 'red'\n" + NOISE: "colour: unknown",
    "name = 7\n" + NOISE: "name: give up to 60 letters",
    NOISE + "[field_of_view]\nnearest_m = 5\nfarthest_m = 2\n": "is empty",
    NOISE + "[systematic]\ntransit_tilt = { standard = 5 }\n": "transit_tilt: unknown; there are two_face, transit_off",
    NOISE + "[systematic]\ntransit_tilt_urad = 5\n": r"is 5; give \{ standard",
    NOISE + "[systematic]\ntransit_tilt_urad = {}\n": "give either standard",
    NOISE + "[systematic]\ntransit_tilt_urad = { standard = 1, limit = 2 }\n": "give either standard",
    NOISE + "[systematic]\ntransit_tilt_urad = { standard = -1 }\n": "-1 is not an uncertainty",
    NOISE + "[systematic]\ntransit_tilt_urad = { standard = nan }\n": "finite|nan",
    NOISE + "[systematic]\ntransit_tilt_urad = { limit = 1, freedom = 9 }\n": "freedom goes with standard",
    NOISE + "[systematic]\ntransit_tilt_urad = { standard = 1, freedom = 1 }\n": "give 3 or more",
    NOISE + "[systematic]\ntransit_tilt_urad = { limit = 1, distribution = 'normal' }\n": "no limits",
    NOISE + "[systematic]\ntransit_tilt_urad = { limit = 1, distribution = 'flat' }\n": "one of normal",
    NOISE + "[systematic]\ntwo_face = 1\n": "give true or false",
    NOISE + "[systematic]\nlock_on_um = { standard = -5 }\n": "lock_on_um: -5 is not an uncertainty",
    NOISE + "[systematic]\nlock_on_um = 5\n": r"lock_on_um is 5; give \{ standard",
    "systematic = 3\n" + NOISE: "a section",
}


@pytest.mark.parametrize(("text", "said"), WRONG.items(), ids=range(len(WRONG)))
def test_what_makes_no_sense_is_one_line(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "ours.toml"
    path.write_text(text)
    with pytest.raises(LabError, match=said) as caught:
        read_instrument(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_a_file_that_is_missing_is_told() -> None:
    with pytest.raises(LabError, match=r"nowhere\.toml"):
        read_instrument(Path("nowhere.toml"))


def test_a_virtual_campaign_draws_one_error_for_all_its_poses(tmp_path: Path) -> None:
    """Beside the same noise: a scale of the range moves each point along its ray by as much of it."""
    plain, scaled = tmp_path / "plain.toml", tmp_path / "scaled.toml"
    plain.write_text(NOISE)
    scaled.write_text(NOISE + "[systematic]\nrange_scale_ppm = { limit = 100 }\n")
    without, with_it = (
        lab.simulate("irb120", poses=5, seed=3, instrument=str(path)).measurements.points for path in (plain, scaled)
    )
    exact = lab.simulate("irb120", poses=5, seed=3, instrument="exact").measurements.points
    ratios = (with_it - without) / exact
    np.testing.assert_allclose(ratios, ratios[0, 0, 0], rtol=1e-6)
    assert 0 < abs(ratios[0, 0, 0]) <= 100e-6
