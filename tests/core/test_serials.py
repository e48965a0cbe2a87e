"""One arm has one serial number, which no two sources may state differently."""

import pytest

from lab.core.errors import LabError
from lab.core.limits import called, check_serial, one_serial


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
