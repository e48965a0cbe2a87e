"""Plain values as dataclasses: what is right comes through unchanged, what is wrong is named in one line."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.core.errors import LabError
from lab.formats.structured import structured


@dataclass(frozen=True)
class Inner:
    ratio: float = 1.0
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Outer:
    count: int
    path: Path | None = None
    kind: Literal["a", "b"] | None = None
    on: bool = False
    inner: Inner = field(default_factory=Inner)


INNER = st.builds(Inner, ratio=st.floats(allow_nan=False, allow_infinity=False), names=st.lists(st.text()).map(tuple))
OUTER = st.builds(
    Outer,
    count=st.integers(),
    path=st.none() | st.just(Path("a/b.csv")),
    kind=st.sampled_from(["a", "b", None]),
    on=st.booleans(),
    inner=INNER,
)


@given(value=OUTER)
def test_json_and_back_is_the_same(value: Outer) -> None:
    assert structured("file", Outer, json.loads(json.dumps(asdict(value), default=str))) == value


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({}, "f.json: 'count' is missing"),
        ({"count": 1.0}, "f.json: 1.0 is not a value of option 'count'; give a whole number"),
        ({"count": True}, "f.json: True is not a value of option 'count'; give a whole number"),
        ({"count": 1, "on": 1}, "give true or false"),
        ({"count": 1, "kind": "c"}, "'c' is not a value of option 'kind'; give one of a, b"),
        ({"count": 1, "inner": {"ratio": "1"}}, "'1' is not a value of option 'inner.ratio'; give a number"),
        (
            {"count": 1, "inner": {"names": "ab"}},
            "'ab' is not a value of option 'inner.names'; give a list, each a text",
        ),
        ({"count": 1, "inner": {"name": []}}, "inner: 'name' is no option; there are ratio, names"),
        ({"count": 1, "inner": 3}, "3 is not a value of option 'inner'; give a group"),
        ([], "f.json: \\[\\] is to be a group"),
    ],
)
def test_what_is_wrong_is_named(values: object, says: str) -> None:
    with pytest.raises(LabError, match=says) as caught:
        structured("f.json", Outer, values)
    assert "\n" not in str(caught.value)


def test_further_names_are_passed_over_where_they_may_be_there() -> None:
    assert structured("f", Outer, {"count": 1, "more": 2}, extra=True) == Outer(1)
