"""What the help of commands says of what may be given."""

from pathlib import Path

import pytest
from helpers.robots import ROOT

from lab.core.instruments import INSTRUMENTS
from lab.pose_selection.criteria import CRITERIA

OPTIONS = [
    "lab/campaign/options.py",
    "lab/commands/calibrate/options.py",
    "lab/commands/verify/options.py",
]


@pytest.mark.parametrize("path", OPTIONS)
def test_help_names_the_instruments_that_there_are(path: str) -> None:
    """The texts are typed by hand, so that a command line is parsed without numpy."""
    source = Path(ROOT / path).read_text(encoding="utf-8")
    lines = [line for line in source.splitlines() if "leica-at500" in line]
    assert lines
    for line in lines:
        possible = [name for name in INSTRUMENTS if name != "exact" or "exact, " in line]
        assert f"{', '.join(possible[:-1])} or {possible[-1]}" in line


def test_help_names_the_criteria_that_there_are() -> None:
    source = Path(ROOT / "lab/campaign/options.py").read_text(encoding="utf-8")
    assert f"{', '.join(CRITERIA[:-1])} or {CRITERIA[-1]}." in source
