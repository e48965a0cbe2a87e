"""The gate of every file that is read."""

import os
from pathlib import Path

import pytest

from lab.core.limits import TEXT_BYTES
from lab.formats.structured import read_text


def test_no_reader_waits_for_a_file_that_only_calls_itself_regular(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As /proc/kmsg does, which gives nothing until the kernel has something to say."""
    path, flags = tmp_path / "x.toml", []
    path.write_text("a = 1")
    real = os.open
    monkeypatch.setattr(os, "open", lambda name, how, *mode: flags.append(how) or real(name, how, *mode))
    assert read_text(path, TEXT_BYTES) == "a = 1"
    assert flags[0] & os.O_NONBLOCK
