"""What the help of commands says of what may be given."""

import re
from pathlib import Path

import pytest
from helpers.robots import ROOT

from lab.core.instruments import INSTRUMENTS, observers
from lab.pose_selection.criteria import CRITERIA

OPTIONS = [
    "lab/campaign/options.py",
    "lab/commands/calibrate/options.py",
    "lab/commands/verify/options.py",
]


@pytest.mark.parametrize("path", OPTIONS)
def test_help_names_the_instruments_that_there_are(path: str) -> None:
    """The texts are typed by hand, so that a command line is parsed without numpy."""
    text = " ".join(Path(ROOT / path).read_text(encoding="utf-8").split())
    lists = re.findall(r"(?:exact, )?uniform-8um, [^\"]*? or [a-z0-9-]+", text)
    assert lists
    for listed in lists:
        named = INSTRUMENTS if "draw-wire" in listed else observers("points")
        possible = [name for name in named if name != "exact" or listed.startswith("exact")]
        assert listed == f"{', '.join(possible[:-1])} or {possible[-1]}"


def test_help_names_the_criteria_that_there_are() -> None:
    source = Path(ROOT / "lab/campaign/options.py").read_text(encoding="utf-8")
    assert f"{', '.join(CRITERIA[:-1])} or {CRITERIA[-1]}." in source
