"""Every script answers ``--help`` and does nothing else; bad input is one line."""

import os
import runpy
import sys
from pathlib import Path

import pytest
from helpers.robots import ROOT
from shared import run_script

SCRIPTS = sorted(path for path in (ROOT / "scripts").rglob("*.py") if "__main__" in path.read_text(encoding="utf-8"))
JOBS = {path for path in SCRIPTS if path.parent.name == "peers"}  # ``peers.py`` starts them with their arguments


def files() -> dict[str, int]:
    """When each file of the checkout was written last, but for what Python and the tests write."""
    found = {}
    for folder, folders, names in os.walk(ROOT):
        folders[:] = [name for name in folders if name != "__pycache__" and not name.startswith(".") and name != "runs"]
        found |= {f"{folder}/{name}": (Path(folder) / name).stat().st_mtime_ns for name in names}
    return found


@pytest.mark.thorough
def test_every_script_answers_help_and_does_nothing_else(monkeypatch, capsys) -> None:
    pytest.importorskip("matplotlib")
    pytest.importorskip("mpmath")
    before = files()
    for path in (each for each in SCRIPTS if each not in JOBS):
        monkeypatch.setattr(sys, "argv", [str(path), "--help"])
        with pytest.raises(SystemExit) as stop:
            runpy.run_path(str(path), run_name="__main__")
        printed = capsys.readouterr()
        assert not stop.value.code and path.name in printed.out and not printed.err, path
    assert files() == before


def test_bad_input_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        run_script("operations_year", ["--out", str(ROOT)])
    printed = capsys.readouterr()
    assert stop.value.code == 2 and printed.err.startswith("lab: ") and printed.err.count("\n") == 1 and not printed.out
