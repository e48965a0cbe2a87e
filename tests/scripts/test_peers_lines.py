"""The lines that jobs take with the lab and its peers: the rule of counting, and the table of the page."""

import json
import sys

import peers_lines
import pytest
from helpers.robots import ROOT

SOURCE = '''
"""Do jobs."""

import numpy

SIZE = 3


class Own:
    """A class."""

    def size(self):
        """Return the size."""
        return SIZE  # of it


def helper(x):
    # a comment
    return x


def job():
    """Do it."""
    found = [
        helper(1),
        Own(),
    ]

    return found


def other():
    return helper(2)
'''


def test_a_job_has_its_lines_and_those_of_what_it_uses() -> None:
    assert peers_lines.lines_of(SOURCE, "other") == 2 + 2
    assert peers_lines.lines_of(SOURCE, "job") == 6 + 2 + 3 + 1  # with the helper, the class and the constant
    assert peers_lines.lines_of(SOURCE, "helper") == 2


def test_the_page_has_the_lines_of_the_scripts() -> None:
    page = (ROOT / "docs" / "which_tool.md").read_text(encoding="utf-8").splitlines()
    for peer, lines in peers_lines.counted().items():
        row = next(line for line in page if line.startswith("| ") and peer in line.split("|")[1].lower())
        assert [int(cell.split()[0]) for cell in row.split("|")[2:5]] == list(lines.values()), row


@pytest.mark.thorough
def test_the_lab_does_the_jobs(capsys: pytest.CaptureFixture[str]) -> None:
    assert peers_lines.main([f"lab={sys.executable}", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["lab"]
    assert (
        found["fit"]["mm"] < 0.005 and found["own_residual"]["mm"] < 0.01 and max(found["study"]["mm"].values()) < 0.02
    )
