"""Values: equal where all that they hold is, and printed in one line."""

import operator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.core.values import Value, data_frame, same


@dataclass(frozen=True, eq=False, repr=False)
class Held(Value):
    numbers: np.ndarray
    names: tuple[str, ...] = ()
    seconds: float = field(default=0.0, compare=False)

    def _about(self) -> str:
        return f"{len(self.numbers)} numbers <&>"


class Plain:
    def __init__(self, numbers: np.ndarray) -> None:
        self.numbers = numbers


ONE = Held(np.array([1.0, np.nan]), ("a",))


def test_values_are_equal_where_all_that_is_compared_is() -> None:
    again = Held(np.array([1.0, np.nan]), ("a",), seconds=3.0)
    assert again == ONE and hash(again) == hash(ONE) and again in [ONE]
    for other in (
        replace(ONE, names=("b",)),
        replace(ONE, numbers=ONE.numbers[:1]),
        replace(ONE, numbers=ONE.numbers + 1),
    ):
        assert other != ONE
    assert ONE != "a" and ONE.__eq__("a") is NotImplemented


@pytest.mark.parametrize(
    ("first", "second", "equal"),
    [
        ([ONE, {"a": np.arange(3)}], [replace(ONE), {"a": np.arange(3)}], True),
        ({"a": 1}, {"b": 1}, False),
        ((1.0, 2.0), (1.0,), False),
        (float("nan"), float("nan"), True),
        (1, 1.0, False),
        (np.arange(3), np.arange(3.0), False),
        (np.array(["a", None]), np.array(["a", None]), True),
        (partial(operator.add, 1), partial(operator.add, 1), True),
        (partial(operator.add, 1), partial(operator.add, 2), False),
        (ONE.numbers.sum, ONE.numbers.max, False),
        (ONE._about, replace(ONE)._about, True),
        (Plain(np.arange(3)), Plain(np.arange(3)), True),
        (Plain(np.arange(3)), Plain(np.arange(4)), False),
    ],
)
def test_the_same_is_found_however_it_is_nested(first: object, second: object, equal: bool) -> None:
    assert same(first, second) is equal and same(second, first) is equal


def test_a_value_prints_in_one_line_and_a_notebook_shows_a_table() -> None:
    assert repr(ONE) == "<Held: 2 numbers <&>>"
    assert ONE._repr_html_() == "<table><tr><th>Held</th><td>2 numbers &lt;&amp;&gt;</td></tr></table>"


def test_a_frame_without_pandas_is_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(LabError, match="pip install pandas"):
        data_frame({"a": [1]})
