"""Numbers as a person reads them."""

import pytest

from lab.core.number_text import capital, digits_of, fixed, format_magnification, plus_minus, sentence, short


@pytest.mark.parametrize(
    ("value", "words"),
    [(1.35174, "1.35"), (0.0030569, "0.00306"), (3.4e-12, "3.4e−12"), (0.0, "0"), (12345.6, "12,346"), (-250.4, "−250"),
     (None, "–")],
)  # fmt: skip
def test_three_digits_count(value, words) -> None:
    assert short(value) == words


def test_a_value_has_two_digits_of_its_interval() -> None:
    halves = [0.0034, 0.034, 0.34, 3.4, 34.0, 1e-12, 0.0, float("nan")]
    assert [digits_of(half, 4) for half in halves] == [4, 3, 2, 1, 0, 4, 4, 4]


def test_an_interval_has_the_digits_of_its_value() -> None:
    found = [plus_minus(half, digits_of(half, 4)) for half in (0.00381, 0.0106, 0.111, 15.4, 0.99e-5)]
    assert found == ["± 0.0038", "± 0.011", "± 0.11", "± 15", "± 9.9e−06"]  # the last has more digits than are shown


def test_units_signs_and_capitals() -> None:
    assert short(1.5, "mm") == "1.50 mm" and fixed(-2.0, 2) == "−2.00" and fixed(2.0, 1, signed=True) == "+2.0"
    assert fixed(-1e-9, 2) == "0.00" and fixed(-1e-9, 2, signed=True) == "+0.00"
    assert capital("link4.theta is off") == "link4.theta is off" and capital("e.g. this") == "E.g. this"
    assert sentence("is it this?") == "Is it this?"
    assert capital("") == "" and sentence("this is one") == "This is one."
    assert format_magnification(20000.0) == "× 20,000" and format_magnification(0.5) == "× 0.5"
