"""Tables of results come from stored files, and numbers that texts quote are the stored ones."""

import json
import re
import sys
import tomllib
from importlib import import_module

import pytest
from helpers.pages import PAGES
from helpers.robots import ROOT

pytest.importorskip("sphinx")
pytestmark = pytest.mark.thorough  # sphinx is of the extra docs
DOCS = ROOT / "docs"
DOCUMENTS = {"peers", "leaderboard"}  # shown as their scripts print them
STORED = {
    path.stem: json.loads(path.read_text(encoding="utf-8"))
    for path in (DOCS / "results" / "stored").glob("*")
    if path.stem not in DOCUMENTS
}
QUOTED = tomllib.loads((DOCS / "results" / "quoted.toml").read_text(encoding="utf-8"))["quoted"]
SHOWN = {name: page for page in PAGES for name in re.findall(r"^```{stored-rows} (\w+)$", page.text, re.MULTILINE)}


@pytest.fixture(scope="module")
def tables():
    """The extension that shows them."""
    sys.path.insert(0, str(DOCS / "_extensions"))
    try:
        return import_module("stored_rows")
    finally:
        sys.path.remove(str(DOCS / "_extensions"))


def number_of(entry: dict, key: str) -> float:
    """The stored value that an entry quotes."""
    table, _, name = entry["row"].partition(":")
    (row,) = (row for row in STORED[table]["rows"] if row["name"] == name)
    column, _, change = key.partition(", ")
    value = row[column][0] if isinstance(row[column], list) else row[column]
    return {"beyond 1": value - 1, "below 1": 1 - value}.get(change, value)


def agrees(text: str, value: float) -> bool:
    """Whether a quoted number is the stored one at the digits that it has."""
    number = text.removesuffix(" %")
    stored = 100 * value if text.endswith("%") else value
    places = len(number.partition(".")[2])
    return float(number) == pytest.approx(stored, abs=0.5001 * 10**-places)


@pytest.mark.parametrize("entry", QUOTED, ids=lambda entry: f"{entry['page']}, {entry['row']}")
def test_quoted_numbers_are_the_stored_ones(entry: dict) -> None:
    (page,) = (page for page in PAGES if page.name == entry["page"])
    for key, numbers in entry.items():
        if key not in ("page", "row"):
            value = number_of(entry, key)
            for text in numbers:
                assert agrees(text, value), f"{text} is quoted, {value} is stored"
                assert re.search(rf"(?<![\d.]){re.escape(text)}(?![\d%])", page.text), f"{text} is not on the page"


@pytest.mark.parametrize("name", STORED)
def test_a_stored_table_is_dated_and_shown(name: str, tables) -> None:
    content = STORED[name]
    assert name in SHOWN, f"no page shows {name}"
    for row in content["rows"]:
        assert re.fullmatch(r"20\d\d-\d\d-\d\d", row["date"]) and row["machine"] and "command" in row
    names = [row["name"] for row in content["rows"]]
    assert names and len(set(names)) == len(names)
    shown = tables.cells(content)
    for row, texts in zip(content["rows"], shown, strict=True):
        for column, text in zip(content["columns"], texts[1:], strict=True):
            value = row.get(column["key"])
            middle = value[0] if isinstance(value, list) else value
            if isinstance(middle, float):
                assert float(re.match(r"[\d.,]+", text)[0].replace(",", "")) == pytest.approx(
                    100 * middle if text.endswith("%") else middle, rel=0.06, abs=0.006
                )


def test_how_values_are_shown(tables) -> None:
    assert [tables.shown(each, ".3g") for each in (0.0, 0.00605, 1314.0, 12.3, 1, None)] == [
        "0.00", "0.00605", "1,314", "12.3", "1", "",
    ]  # fmt: skip
    assert tables.shown([1.05, 1.044, 1.057], ".3f") == "1.050 (1.044 to 1.057)"
    assert tables.shown([0.951, 1.2], ".2f") == "0.95 to 1.20" and tables.shown(0.932, ".1%") == "93.2 %"
