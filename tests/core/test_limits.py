"""Limits are stated once, documented, and refuse what is beyond them."""

import re
from datetime import date

import numpy as np
import pytest
from helpers.robots import ROOT

from lab.core.errors import LabError
from lab.core.limits import LIMITS, PAYLOAD_KG, POSES, RANGES, called, check_serial, checked_name, day, one_serial


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


def test_a_day_is_read() -> None:
    assert day("--date", "2028-02-29") == date(2028, 2, 29)


ELSEWHERE = "٢٠٢٦-٠٣-٠١"


@pytest.mark.parametrize(
    "text", ["2026-13-01", "2027-02-29", "1.3.2026", "20260301", "2026-W10-1", "2026-3-1", ELSEWHERE, "", "yesterday"]
)
def test_what_is_no_day_is_refused(text: str) -> None:
    with pytest.raises(LabError, match="is no day; write it as 2026-03-01"):
        day("--date", text)


def test_sources_agree_or_both_are_named() -> None:
    assert one_serial({"a": None, "b": None}, "") is None
    assert one_serial({"a": None, "b": "A-17", "c": "A-17"}, "") == "A-17"
    with pytest.raises(LabError, match="c: names the arm A-18, but a names A-17; choose one"):
        one_serial({"a": "A-17", "b": None, "c": "A-18"}, "choose one")


@pytest.mark.parametrize("serial", ["", " A", "A\n", "A" * 300])
def test_a_serial_is_one_line_without_blanks_around(serial: str) -> None:
    with pytest.raises(LabError, match="--serial"):
        check_serial(serial)


def test_an_arm_is_called_by_its_model_and_its_serial() -> None:
    check_serial("A 17/2")
    check_serial(None)
    assert (called("irb120", None), called("irb120", "A-17")) == ("irb120", "irb120 A-17")
