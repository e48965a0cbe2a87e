"""Measurements: rows are taken together, and a model's inputs are asked for by name."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.core.errors import LabError
from lab.core.measurements import copied_rows, measured, seen_mask

ROWS = 7


def example():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(ROWS, 2, 3))
    points[2, 1] = np.nan
    data = measured(("a", "b"), rng.normal(size=(ROWS, 2)), ("p1", "p2"), points)
    uses, sessions = ("calibrate", "test") * 3 + ("skip",), ("", "") + ("late",) * 5
    payload = np.arange(ROWS, dtype=float)
    return replace(data, use=uses, sessions=sessions, conditions={"payload_kg": payload}, lines=tuple(range(2, 9)))


@given(st.lists(st.integers(0, ROWS - 1), max_size=10), st.data())
def test_rows_of_rows_are_rows(rows: list[int], draw: st.DataObject) -> None:
    some = example().take(rows)
    again = draw.draw(st.lists(st.integers(0, len(rows) - 1), max_size=5)) if rows else []
    direct, twice = example().take([rows[i] for i in again]), some.take(again)
    np.testing.assert_array_equal(direct.joints, twice.joints)
    np.testing.assert_array_equal(direct.points, twice.points)
    np.testing.assert_array_equal(direct.conditions["payload_kg"], twice.conditions["payload_kg"])
    assert (direct.ids, direct.use, direct.lines) == (twice.ids, twice.use, twice.lines)


def test_what_was_seen_and_rows_by_use_and_name() -> None:
    data = example()
    assert np.array_equal(data.seen, seen_mask(data.points)) and data.seen.sum() == 2 * ROWS - 1
    assert data.only("test").ids == ("1", "3", "5") and data.without(["0", "6"]).ids == ("1", "2", "3", "4", "5")
    assert data.where(0) == "line 2" and replace(data, lines=()).where(0) == "row 0"


def test_inputs_stand_beside_the_joints() -> None:
    data = example()
    inputs = data.inputs(["payload_kg", "session late"])
    np.testing.assert_array_equal(inputs[:, 2], np.arange(ROWS))
    np.testing.assert_array_equal(inputs[:, 3], [0, 0, 1, 1, 1, 1, 1])
    assert not replace(data, conditions={}).inputs(["payload_kg"])[:, 2].any()
    with pytest.raises(LabError, match="column time_s is missing"):
        data.inputs(["time_s"])
    empty = replace(data, conditions={"time_s": np.where(np.arange(ROWS) == 3, np.nan, 1.0)})
    with pytest.raises(LabError, match="line 5, column time_s: empty"):
        empty.inputs(["time_s"])


def test_copies_are_found_with_the_first_row_that_is_alike() -> None:
    rows = np.array([[1.0, 2.0], [1.0, 3.0], [1.0, 2.0], [np.nan, 2.0], [1.0, 2.0], [1.0, 3.0 + 1e-15]])
    assert copied_rows(rows) == [(2, 0), (4, 0)]
    assert copied_rows(rows[:2]) == [] and copied_rows(rows[:0]) == []
