"""The pictures of recordings in README and pages: the command beside each, and the headline that it prints."""

import struct
import zlib

import pytest
from helpers.pages import PAGES
from helpers.recordings import needs_vulkan
from helpers.robots import ROOT
from recording_pictures import PICTURES, Options, Shown, answer

from lab.core.errors import LabError

FOLDER = ROOT / "docs" / "pictures"


def words_in(name: str) -> dict[str, str]:
    """The texts that a PNG holds, by keyword (PNG specification, 11.3.3)."""
    data, at, found = (FOLDER / name).read_bytes(), 8, {}
    while at < len(data):
        (size,) = struct.unpack(">I", data[at : at + 4])
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + size]
        key, _, rest = body.partition(b"\0")
        if kind == b"tEXt":
            found[key.decode("latin-1")] = rest.decode("latin-1")
        if kind == b"iTXt":
            text = rest[2:].split(b"\0", 2)[2]
            found[key.decode("latin-1")] = (zlib.decompress(text) if rest[0] else text).decode("utf-8")
        at += size + 12
    return found


@pytest.mark.parametrize("name", PICTURES)
def test_a_page_shows_the_picture_beside_its_command(name: str) -> None:
    assert words_in(name)["Description"] == PICTURES[name].command
    shown = [page for page in PAGES if f"pictures/{name}" in page.text]
    assert shown and any(PICTURES[name].command in page.text for page in shown)


@pytest.mark.thorough
@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_shows_the_numbers_that_its_command_prints(name: str, tmp_path) -> None:
    """Where this fails, scripts/recording_pictures.py makes the pictures again."""
    assert words_in(name)["Title"] == PICTURES[name].record(tmp_path)[1]


@pytest.mark.thorough
@pytest.mark.figures
@needs_vulkan
def test_the_script_makes_a_picture(tmp_path, monkeypatch) -> None:
    few = Shown("lab calibrate --robot scara --poses 15", 1.0)
    monkeypatch.setattr("recording_pictures.PICTURES", {"scara.png": few})
    made = answer(Options(tmp_path, ("scara.png",)))
    assert (tmp_path / "scara.png").stat().st_size > 100_000 and made.values["scara.png"].startswith("scara: ")


def test_wrong_names_are_told(tmp_path) -> None:
    with pytest.raises(LabError, match="no picture 'other'; there are first_calibration"):
        answer(Options(tmp_path, ("other",)))
    with pytest.raises(LabError, match="is no folder"):
        answer(Options(tmp_path / "none"))
