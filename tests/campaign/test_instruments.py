"""Instruments by name: presets, and files."""

from pathlib import Path

import pytest

from lab.campaign.instruments import named_instrument
from lab.core.errors import LabError
from lab.core.instruments import INSTRUMENTS


def test_a_name_is_a_preset_which_states_no_systematic_errors() -> None:
    assert all(named_instrument(name) is device and not device.errors.stated for name, device in INSTRUMENTS.items())
    with pytest.raises(LabError, match="'ruler' is unknown"):
        named_instrument("ruler")


def test_a_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "ours.toml"
    path.write_text("[noise]\nradial_um = 2\ntransverse_um = 5\n")
    assert named_instrument(str(path)).transverse_m == pytest.approx(5e-6)
