"""Limits are stated once, documented, and refuse what is beyond them."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from helpers.robots import ROOT

from lab.core.errors import LabError
from lab.core.limits import LIMITS, PAYLOAD_KG, POSES, RANGES, checked_name


def test_each_limit_and_range_is_in_the_documentation_with_its_numbers() -> None:
    page = (ROOT / "docs" / "reference" / "limits.md").read_text()
    rows = dict(re.findall(r"^\| ([^|]+?) \| ([^|]+?) \|", page, re.MULTILINE))
    ours = {each.what: each.shown for each in (*LIMITS, *RANGES)}
    assert ours == {what: shown for what, shown in rows.items() if re.match("−?[0-9]", shown)}


def test_a_range_holds_its_ends_and_no_number_beyond_them() -> None:
    for each in RANGES:
        assert each.least in each and each.most in each and np.nan not in each and np.inf not in each
        assert np.nextafter(each.least, -np.inf) not in each and np.nextafter(each.most, np.inf) not in each
    PAYLOAD_KG("payload_kg", 1000.0)
    with pytest.raises(LabError, match=r"^payload_kg is -1; give 0 to 1,000 kg$"):
        PAYLOAD_KG("payload_kg", -1.0)
    assert PAYLOAD_KG.outside(np.array([-1.0, 0.0, 1e3, 1e4, np.nan])).tolist() == [True, False, False, True, False]


def is_numbers(value: ast.expr) -> bool:
    """Whether what is assigned is a number, or a few."""
    parts = value.elts if isinstance(value, ast.Tuple) else [value]
    return all(isinstance(each, ast.Constant) and isinstance(each.value, float | int) for each in parts)


def numbers_of(path: Path) -> Iterator[tuple[str, ast.If]]:
    """Where a module refuses something by a number that is written in it: the number, or the name that it has there."""
    tree = ast.parse(path.read_text())
    own = {
        name.id
        for line in tree.body
        if isinstance(line, ast.Assign | ast.AnnAssign) and line.value is not None and is_numbers(line.value)
        for target in (line.targets if isinstance(line, ast.Assign) else [line.target])
        for name in ast.walk(target)
        if isinstance(name, ast.Name)
    }
    for line in ast.walk(tree):
        if isinstance(line, ast.If) and any(isinstance(each, ast.Raise) for each in line.body):
            for part in (
                part for each in ast.walk(line.test) if isinstance(each, ast.Compare) for part in ast.walk(each)
            ):
                if isinstance(part, ast.Name) and part.id in own:
                    yield part.id, line
                if isinstance(part, ast.Constant) and isinstance(part.value, float | int) and abs(part.value) > 10:
                    yield str(part.value), line


COUNTED = {"LEAST_MOVING", "_FULL_TURNS", "hours", "seconds", "minutes", "12", "23", "59", "61"}  # rows, turns, clocks


@pytest.mark.parametrize("room", ["lab/formats", "lab/commands"])
def test_what_a_file_or_an_option_may_hold_is_in_the_table_alone(room: str) -> None:
    """A bound that a reader or an option has of its own would stand in no table."""
    files = [path for path in (ROOT / room).rglob("*.py") if room == "lab/formats" or path.name == "options.py"]
    found = [(str(path.relative_to(ROOT)), line.lineno, said) for path in files for said, line in numbers_of(path)]
    assert [each for each in found if each[2] not in COUNTED] == []


def test_a_limit_lets_pass_its_own_number_and_no_more() -> None:
    POSES("--poses", 100_000)
    with pytest.raises(LabError, match=r"--poses: 100,001 poses are too many; give at most 100,000"):
        POSES("--poses", 100_001)
    with pytest.raises(LabError, match=r"1e\+300"):
        POSES("--poses", 10**400)


@pytest.mark.parametrize("name", ["p1", "Ball 2", "tcp_left", "Ø-8", "a" * 100])
def test_names_that_every_file_can_hold(name: str) -> None:
    assert checked_name("arm.toml", name) == name


@pytest.mark.parametrize(
    "name", ["", " ", "a.b", "a/b", "a\\b", "a,b", "a;b", "a\nb", "\x1b[m", "=cmd", "@x", "a" * 101]
)
def test_names_that_some_file_cannot_hold(name: str) -> None:
    with pytest.raises(LabError, match=r"arm\.toml.*name"):
        checked_name("arm.toml", name)
