"""The script that stores results: rows take the place of those of their names, and nothing else changes."""

import json

import pytest
import stored_results
from stored_results import TABLES, Options, Row, StoredTable, answer

from lab.core.errors import LabError


@pytest.fixture
def store(tmp_path, monkeypatch):
    """A store with two rows of one table, of which measuring counts up."""
    count = iter(range(1, 100))

    def rows(options: Options):
        for name in ("a", "b"):
            yield Row(name, lambda: {"x": float(next(count))}, f"measure {name}")

    monkeypatch.setattr(stored_results, "STORED", tmp_path)
    monkeypatch.setattr(stored_results, "TABLES", {"t": StoredTable("name", (("x", "x", ".1f"),), rows)})
    return tmp_path / "t.json"


def values(path) -> dict[str, float]:
    """The stored values by row."""
    return {row["name"]: row["x"] for row in json.loads(path.read_text())["rows"]}


def test_a_row_that_is_measured_replaces_its_own_alone(store) -> None:
    assert answer(Options()).values["measured"] == {"t": ["a", "b"]}
    assert values(store) == {"a": 1.0, "b": 2.0}
    answer(Options(only="t:b"))
    assert values(store) == {"a": 1.0, "b": 3.0}
    row = json.loads(store.read_text())["rows"][1]
    assert row["command"] == "measure b" and row["date"] and row["machine"] and row["other_processes"] >= 0


def test_a_pattern_without_a_row_is_refused(store) -> None:
    with pytest.raises(LabError, match="selects no row"):
        answer(Options(only="t:c"))


def test_every_row_has_a_name_of_its_own(tmp_path) -> None:
    listed = answer(Options(list=True, data=tmp_path)).values["rows"]
    assert len(set(listed)) == len(listed) and {each.partition(":")[0] for each in listed} == set(TABLES)
