"""Tutorials check what they claim; messages that pages explain are the lab's."""

import json
import re
from functools import cache
from pathlib import Path

import pytest
from helpers.pages import PAGES
from helpers.robots import ROOT

TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.ipynb"))


def cells(path: Path, kind: str) -> list[str]:
    """The cells of one kind of a notebook."""
    content = json.loads(path.read_text(encoding="utf-8"))
    return ["".join(cell["source"]) for cell in content["cells"] if cell["cell_type"] == kind]


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_a_tutorial_checks_what_it_claims_and_is_stored_without_results(path: Path) -> None:
    code = cells(path, "code")
    assert sum("assert " in cell for cell in code) >= 2
    content = json.loads(path.read_text(encoding="utf-8"))
    assert not any(cell.get("outputs") for cell in content["cells"])
    index = (path.parent / "index.md").read_text(encoding="utf-8")
    assert f"({path.name})" in index


def test_links_of_tutorials_lead_to_pages() -> None:
    assert TUTORIALS
    for path in TUTORIALS:
        for cell in cells(path, "markdown"):
            for link in re.findall(r"\]\(([^)#]+)", cell):
                assert (path.parent / link).exists(), (path.stem, link)


@cache
def messages() -> str:
    """The code of the lab, with sentences that go on in the next line joined."""
    paths = [path for folder in ("lab", "scripts") for path in (ROOT / folder).rglob("*.py")]
    return re.sub(r'"\s+f?"', "", "\n".join(path.read_text(encoding="utf-8") for path in paths))


WRONG = re.compile(r"^\| the message says \| it means \| do this \|\n\|[-|]+\n((?:\|.*\n)+)", re.MULTILINE)


def test_messages_that_pages_explain_are_the_labs() -> None:
    rows = "".join(each for page in PAGES for each in WRONG.findall(page.text)).splitlines()
    rows += [row for page in PAGES if page.name.endswith("troubleshooting.md") for row in page.text.splitlines()]
    quoted = [row.split("`")[1] for row in rows if row.startswith("| `")]
    assert quoted and not [each for each in quoted if each not in messages()]
