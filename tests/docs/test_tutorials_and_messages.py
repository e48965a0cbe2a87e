"""Tutorials check what they claim; messages that pages explain are the lab's."""

import json
import re
from functools import cache
from pathlib import Path

import pytest
from helpers.pages import PAGES, Page
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


def test_there_are_eight_and_each_leads_to_a_page_that_exists() -> None:
    assert len(TUTORIALS) == 8
    for path in TUTORIALS:
        for cell in cells(path, "markdown"):
            for link in re.findall(r"\]\(([^)#]+)", cell):
                assert (path.parent / link).exists(), (path.stem, link)


@cache
def messages() -> str:
    """The code of the lab, with sentences that go on in the next line joined."""
    paths = [path for folder in ("lab", "scripts") for path in (ROOT / folder).rglob("*.py")]
    return re.sub(r'"\s+f?"', "", "\n".join(path.read_text(encoding="utf-8") for path in paths))


def test_messages_of_the_troubleshooting_page_are_the_labs() -> None:
    page = next(page for page in PAGES if page.name.endswith("troubleshooting.md")).text
    quoted = [row.split("`")[1] for row in page.splitlines() if row.startswith("| `")]
    assert len(quoted) >= 20
    assert not [each for each in quoted if each not in messages()]


WRONG = re.compile(r"^\| the message says \| it means \| do this \|\n\|[-|]+\n((?:\|.*\n)+)", re.MULTILINE)
HOW_TO = [page for page in PAGES if page.name.startswith("docs/how_to/") and WRONG.search(page.text)]


@pytest.mark.parametrize("page", HOW_TO, ids=lambda page: page.name)
def test_messages_that_a_page_explains_are_the_labs(page: Page) -> None:
    rows = "".join(WRONG.findall(page.text)).splitlines()
    quoted = [row.split("`")[1] for row in rows]
    assert not [each for each in quoted if each not in messages()]
