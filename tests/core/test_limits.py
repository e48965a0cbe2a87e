"""Limits are stated once, documented, and refuse what is beyond them."""

import re

import pytest
from helpers.robots import ROOT

from lab.core.errors import LabError
from lab.core.limits import LIMITS, POSES, checked_name


def test_each_limit_is_in_the_documentation_with_its_number() -> None:
    page = (ROOT / "docs" / "reference" / "limits.md").read_text()
    rows = dict(re.findall(r"^\| ([^|]+?) \| ([^|]+?) \|", page, re.MULTILINE))
    assert {limit.what: limit.shown for limit in LIMITS} == {k: v for k, v in rows.items() if v[:1].isdigit()}


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
