"""The table of what the sources ask for: every row's command and test exist."""

import ast
import importlib.util
import re
import shlex
from pathlib import Path

import pytest
from helpers.robots import ROOT

from lab.cli.command_line import parsed
from lab.cli.commands import command_named
from lab.extensions.reproduction.item import source_named, sources

_SPEC = importlib.util.spec_from_file_location("stored_rows", ROOT / "docs" / "_extensions" / "stored_rows.py")
pytestmark = pytest.mark.thorough  # sphinx is of the extra docs


@pytest.fixture(scope="module")
def table():
    """The module that makes the table."""
    pytest.importorskip("sphinx")
    module = importlib.util.module_from_spec(_SPEC)
    _SPEC.loader.exec_module(module)
    return module


def functions(path: Path) -> set[str]:
    """The tests of a file, those of its classes as Class::test."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    for each in (node for node in tree.body if isinstance(node, ast.ClassDef)):
        found |= {f"{each.name}::{node.name}" for node in each.body if isinstance(node, ast.FunctionDef)}
    return found


def test_every_row_of_the_sources_is_there_once(table) -> None:
    rows = table.source_rows()
    assert len({(row.source, row.row) for row in rows}) == len(rows)
    assert {row.source for row in rows} == {*sources(), table.FURTHER}


def test_every_test_of_a_row_exists(table) -> None:
    """A node id names a test of a file; a row without one has no command either, and is shown as missing."""
    for row in table.source_rows():
        if not row.held_by:
            assert not row.shown_by, f"{row.row}: a command, but no test that holds it"
            continue
        path, _, name = row.held_by.partition("::")
        assert (ROOT / path).is_file(), f"{row.row}: there is no {path}"
        function = re.sub(r"\[.*\]$", "", name)
        assert function.startswith("test_") and function in functions(ROOT / path), f"{row.row}: no {name} in {path}"


def test_every_item_and_command_of_a_row_exists(table) -> None:
    for row in table.source_rows():
        if row.item:
            assert row.item in [item.number for item in source_named(row.source).items], row.row
        if not row.held_by:
            continue
        program, *arguments = shlex.split(row.shown_by)
        if program == "python":
            assert (ROOT / arguments[0]).is_file(), row.row
        else:
            assert program == "lab"
            parsed(command_named(arguments[0]), arguments[1:])
