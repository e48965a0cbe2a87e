"""Instruments by name: presets, and files."""

from dataclasses import replace
from pathlib import Path

import pytest

import lab
from lab.core.errors import LabError
from lab.noise.instruments import INSTRUMENTS
from lab.options.named_instruments import name_of, named_instrument


def test_a_name_is_a_preset_which_states_no_errors_that_last() -> None:
    assert all(named_instrument(name) is device and not device.errors.lasting for name, device in INSTRUMENTS.items())
    with pytest.raises(LabError, match="instrument ruler: unknown"):
        named_instrument("ruler")


def test_a_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "ours.toml"
    path.write_text("[noise]\nradial_um = 2\ntransverse_um = 5\n")
    assert named_instrument(str(path)).transverse_m == pytest.approx(5e-6)


@pytest.fixture
def ours(tmp_path: Path) -> Path:
    path = tmp_path / "ours.toml"
    path.write_text("[noise]\nradial_um = 20\ntransverse_um = 50\n")
    return path


def test_the_call_takes_a_name_a_file_and_an_instrument(ours: Path) -> None:
    device = lab.instrument("leica-at960")
    assert device is INSTRUMENTS["leica-at960"] is lab.instrument(device)
    assert lab.instrument(ours) == lab.instrument(str(ours)) and lab.instrument(ours).transverse_m == pytest.approx(
        5e-5
    )
    for name, says in (("ruler", "instrument ruler: unknown"), (f"{ours}.toml", "ours.toml.toml")):
        with pytest.raises(LabError, match=says) as caught:
            lab.instrument(name)
        assert "\n" not in str(caught.value)


def test_an_instrument_is_an_option_as_its_name_is(ours: Path) -> None:
    for name in ("leica-at960", str(ours)):
        expected = lab.simulate(poses=3, instrument=name)
        for given in (lab.instrument(name), Path(name)):
            day = lab.simulate(poses=3, instrument=given)
            assert day.options == expected.options and (day.measurements.points == expected.measurements.points).all()
    result = lab.identify(lab.simulate(poses=20, seed=3).measurements, instrument=lab.instrument(ours))
    assert result.options.instrument == str(ours)


def test_an_instrument_in_memory_is_taken_by_value(ours: Path) -> None:
    """One whose file was changed since it was read is not what its path says; one with a preset's name is refused."""
    noisier, read = replace(lab.instrument("leica-at500"), radial_m=1e-4), lab.instrument(ours)
    assert name_of(read) == str(ours)
    ours.write_text("[noise]\nradial_um = 2\ntransverse_um = 5\n")
    assert lab.simulate(poses=3, instrument=read).options.instrument == read.name
    with pytest.raises(LabError, match="instrument 'leica-at500': the lab has one of that name; give yours another"):
        lab.simulate(poses=3, instrument=noisier)
    with pytest.raises(LabError, match=r"'instrument' is 8; give a name, or a lab.Instrument"):
        lab.simulate(poses=3, instrument=8)


def test_a_file_that_weighs_one_direction_too_much_is_told(tmp_path: Path) -> None:
    """Interferometers read ranges to 0.5 µm/m; the nest that holds the reflector is no better than some micrometres."""
    said = {}
    for nest in ("", "nest_um = { standard = 3 }\nlock_on_um = { standard = 5 }"):
        path = tmp_path / f"ours{len(said)}.toml"
        noise = "radial_um = 0\nradial_um_per_m = 0.25\ntransverse_um = 5\ntransverse_um_per_m = 4"
        path.write_text(f"[noise]\n{noise}\n[systematic]\n{nest}\n")
        day = lab.simulate(poses=30, seed=3, instrument=path)
        warnings = lab.identify(day.measurements, instrument=path).warnings
        said[bool(nest)] = [each for each in warnings if "state nest_um and lock_on_um" in each]
    assert len(said[False]) == 1 and not said[True]
