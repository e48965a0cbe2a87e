"""A working folder for commands."""

from pathlib import Path

import pytest
from helpers.bad_input import ARM_TOML, ARM_URDF, ARM_XML, csv


@pytest.fixture
def folder(nothing_drawn: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with a good robot of each kind and good measurements; nothing is drawn."""
    monkeypatch.chdir(tmp_path)
    for name, text in {"arm.toml": ARM_TOML, "arm.xml": ARM_XML, "arm.urdf": ARM_URDF, "good.csv": csv()}.items():
        (tmp_path / name).write_text(text)
    return tmp_path
