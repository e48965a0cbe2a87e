"""Numbers in a text: where they are, what they say, and how others take their places in the same form."""

import re
from bisect import bisect_right
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from lab.core.errors import LabError
from lab.core.ranges import COORDINATE_SIZE, DIGITS
from lab.core.se3 import Array

__all__ = ["NUMBER", "Number", "line_of", "masked", "replaced", "values_of", "whole_number", "written"]

NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_MOST_DIGITS = int(DIGITS.most)
_NOTHING = 1e-9  # m, mm, rad, degrees or pulses: a change that is none
_ALIGNED = "  "  # before a number that is aligned to the right


class Number(NamedTuple):
    """A number as a text has it; a program has some hundred thousand.

    Attributes:
        start: of its first character in the text.
        text: as it is written.
    """

    start: int
    text: str

    @property
    def value(self) -> float:
        """What it says."""
        return float(self.text)

    @property
    def digits(self) -> int:
        """How many places behind the point it has, an exponent included."""
        mantissa, _, exponent = self.text.lower().partition("e")
        _, _, places = mantissa.partition(".")
        if not float(self.text):
            return len(places)
        return int(min(max(len(places) - float(exponent or 0), 0), _MOST_DIGITS))


def values_of(numbers: Sequence[Number]) -> Array:
    """What they say.

    Raises:
        LabError: one is so large that it is no number of a position.
    """
    values = [each.value for each in numbers]
    for each, value in zip(numbers, values, strict=True):
        if abs(value) not in COORDINATE_SIZE:
            odd = each.text if len(each.text) < 40 else each.text[:37] + "..."
            raise LabError(f"{odd} is too large for a position; mend the program")
    return np.array(values)


def written(number: Number, value: float, digits: int) -> str:
    """Another value in the form of a number; its own text where it says that already, to its last digit.

    Args:
        digits: places behind the point, at least; as many as the number has anyway.
    """
    least = max(number.digits, digits)
    if abs(value - number.value) <= max(0.5 * 10.0**-least, _NOTHING):
        return number.text
    text = f"{round(value, least) + 0.0:.{least}f}"
    mantissa = number.text.lower().partition("e")[0]
    if mantissa.endswith(".") and least == 0:
        text += "."
    if re.match(r"[+-]?\.", mantissa):
        text = re.sub(r"^(-?)0\.", r"\1.", text)
    return f"+{text}" if mantissa[0] == "+" and value >= 0 else text


def whole_number(digits: str) -> str:
    """Digits without leading zeros: 01 and 1 number the same tool."""
    return digits.lstrip("0") or "0"


def line_of(text: str, offset: int) -> int:
    """The line of a character, as an editor counts them."""
    return bisect_right(_ends_of_lines(text), offset) + 1


@lru_cache(maxsize=4)
def _ends_of_lines(text: str) -> list[int]:
    """Where lines end: the character behind each end."""
    return [found.end() for found in re.finditer(r"\r\n|\n|\r", text)]


def masked(text: str, hidden: str, kept: str = '"[^"\r\n]*"') -> str:
    """The text with what matches a pattern replaced by blanks, line ends kept: characters stay in their places.

    Args:
        kept: what is passed over, as a string in which a comment seems to begin.
    """

    def blank(found: re.Match[str]) -> str:
        if found["kept"] is not None:
            return found[0]
        return re.sub(r"[^\r\n]+", lambda line: " " * len(line[0]), found[0])

    return re.sub(f"(?P<kept>{kept})|(?:{hidden})", blank, text)


def replaced(text: str, edits: Sequence[tuple[Number, str]]) -> str:
    """The text with other numbers, and nothing else changed; what is aligned to the right stays so.

    Args:
        edits: numbers and what takes their places, none of them twice.
    """
    parts, last = list[str](), 0
    for number, new in sorted(edits, key=lambda edit: edit[0].start):
        between = text[last : number.start]
        longer = len(new) - len(number.text)
        if longer > 0 and between.endswith(_ALIGNED):
            room = len(between) - len(between.rstrip(" ")) - 1
            between = between[: len(between) - min(longer, room)]
        elif longer < 0 and between.endswith(_ALIGNED):
            between += " " * -longer
        parts += [between, new]
        last = number.start + len(number.text)
    assert all(a[0].start != b[0].start for a, b in pairwise(sorted(edits, key=lambda edit: edit[0].start)))
    return "".join([*parts, text[last:]])
