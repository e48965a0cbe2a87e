"""Measurements are a table: rows as numpy indexes them, columns by name, and a model's inputs."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from lab.core.errors import LabError
from lab.core.measurements import Measurements, copied_rows, joined, measured, seen_mask

ROWS = 7


def example():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(ROWS, 2, 3))
    points[2, 1] = np.nan
    data = measured(("a", "b"), rng.normal(size=(ROWS, 2)), ("p1", "p2"), points)
    uses, sessions = ("calibrate", "test") * 3 + ("skip",), ("", "") + ("late",) * 5
    payload = np.arange(ROWS, dtype=float)
    return replace(data, use=uses, sessions=sessions, conditions={"payload_kg": payload}, lines=tuple(range(2, 9)))


def per_row(data: Measurements) -> dict[str, np.ndarray]:
    """Return every field that has a row a pose, as an array."""
    texts = {"ids": data.ids, "use": data.use, "sessions": data.sessions, "lines": data.lines, **data.other}
    numbers = {"joints": data.joints, "points": data.points, "sigma_m": data.sigma_m, **data.conditions}
    order = data._visited
    return numbers | {"place": order.place, "move": order.last_move} | {k: np.array(v) for k, v in texts.items()}


NUMBERS = st.integers(-ROWS - 2, ROWS + 1)
INDICES = st.one_of(
    NUMBERS,
    NUMBERS.map(np.int64),
    st.slices(ROWS),
    st.lists(NUMBERS, max_size=9),
    st.lists(st.booleans(), min_size=ROWS - 1, max_size=ROWS + 1),
    st.lists(NUMBERS, max_size=9).map(lambda rows: np.array(rows, dtype=np.int16)),
    arrays.arrays(bool, st.integers(ROWS - 1, ROWS + 1)),
    arrays.arrays(np.float64, st.integers(0, 3)),
    arrays.arrays(np.int64, st.just((2, 2)), elements=st.integers(0, 3)),
    st.lists(st.booleans() | NUMBERS, max_size=3),
    st.lists(st.text(max_size=2), max_size=3),
    st.tuples(NUMBERS, NUMBERS),
    st.sampled_from([None, Ellipsis, 1.5, {1}, slice("a"), True, [[0, 1], [2]], np.array(["a"]), np.array(2)]),
)


@given(INDICES)
def test_rows_are_those_of_numpy(rows: object) -> None:
    """Every field has the rows that numpy gives of it, one row as a table; any other index is refused in one line."""
    data = example()
    try:
        wanted = {name: column[rows] for name, column in per_row(data).items()}
    except (IndexError, TypeError, ValueError):
        wanted = {}
    if not wanted or np.ndim(wanted["place"]) > 1:
        with pytest.raises(LabError, match=r"^measurements") as caught:
            data[rows]
        assert "\n" not in str(caught.value)
        return
    part = data[rows]
    for name, column in per_row(part).items():
        expected = wanted[name] if np.ndim(wanted["place"]) else np.array([wanted[name]])
        np.testing.assert_array_equal(column, expected, err_msg=name)
    assert len(part) == len(part.joints) and part.joint_names == data.joint_names


@given(st.lists(st.integers(-ROWS, ROWS - 1), max_size=10), st.data())
def test_rows_of_rows_are_rows(rows: list[int], draw: st.DataObject) -> None:
    some = example()[rows]
    again = draw.draw(st.lists(st.integers(0, len(rows) - 1), max_size=5)) if rows else []
    assert example()[[rows[i] for i in again]] == some[again]


@given(st.lists(st.integers(0, ROWS), max_size=3).map(sorted))
def test_parts_of_a_table_joined_are_the_table(ends: list[int]) -> None:
    data = replace(example(), lines=())
    parts = [data[a:b] for a, b in zip([0, *ends], [*ends, ROWS], strict=True)]
    assert joined(parts) == data
    assert joined(list(data)) == data and data[:2] + data[2:] == data


def test_tables_of_two_campaigns_are_joined_with_ids_and_columns_of_their_own() -> None:
    first = replace(example(), robot="irb120")
    second = replace(first[:3], conditions={"temp_C": np.arange(3.0)}, other={"station": ("A",) * 3}, robot="")
    both = first + second
    assert both.ids == (*"0123456", "0_2", "1_2", "2_2") and both.lines == () and both.robot == "irb120"
    assert np.isnan(both["temp_C"][:ROWS]).all() and both["temp_C"][ROWS:].tolist() == [0, 1, 2]
    assert both["payload_kg"].tolist() == [*range(ROWS), 0, 0, 0], "a payload that is not given is zero"
    assert both.stations == ("",) * ROWS + ("A",) * 3
    twice = (first + first)._visited
    assert (np.diff(twice.place) >= 0).all() and twice.place[[0, -1]].tolist() == [0, 1]
    np.testing.assert_array_equal(twice.last_move[ROWS:], first._visited.last_move)
    thrice = joined([first, first, first]).ids
    assert len(set(thrice)) == 3 * ROWS and thrice[-1] == "6_3"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"joint_names": ("a", "c")}, "joints a, b and joints a, c are not joined"),
        ({"targets": ("p1", "p3")}, "targets p1, p2 and targets p1, p3"),
        ({"points": np.zeros((ROWS, 2, 6))}, "numbers for each target 3 and numbers for each target 6"),
        ({"robot": "ur10"}, "robot irb120 and robot ur10"),
    ],
)
def test_tables_of_other_robots_are_not_joined(change: dict, message: str) -> None:
    data = replace(example(), robot="irb120")
    with pytest.raises(LabError, match=message) as caught:
        data + replace(data, **change)
    assert "\n" not in str(caught.value)


def test_columns_are_had_by_name() -> None:
    data = replace(example(), marked=True, other={"station": ("A",) * ROWS}, sigma_m=np.full(ROWS, 1e-5))
    np.testing.assert_array_equal(data["b"], data.joints[:, 1])
    np.testing.assert_array_equal(data["p2.y"], data.points[:, 1, 1])
    assert list(data.columns())[:3] == ["id", "a", "b"] and data["session"].tolist() == list(data.sessions)
    assert data[data["use"] == "test"] == data.only("test") and data["station"][0] == "A"
    assert set(data.columns()) == {*"ab", "id", "use", "session", "station", "sigma_m", "payload_kg"} | {
        f"{target}.{axis}" for target in ("p1", "p2") for axis in "xyz"
    }
    with pytest.raises(LabError, match=r"no column 'q1'; there are id, a, b, p1\.x"):
        data["q1"]
    with pytest.raises(LabError, match="a table and no array"):
        np.asarray(data)


WRONG = {
    "another joint": ({"joints": np.zeros((ROWS, 3))}, r"joints has shape \(7, 3\); give \(7, 2\)"),
    "NaN joint": ({"joints": np.where(np.arange(2 * ROWS).reshape(ROWS, 2) == 5, np.nan, 0)}, r"joints\[2, 1\] \(b\)"),
    "flat points": ({"points": np.zeros((ROWS, 2))}, r"points have shape \(7, 2\)"),
    "a target more": ({"targets": ("p1",)}, r"points has shape \(7, 2, 3\); give \(7, 1, 3\)"),
    "an id less": ({"ids": ("0",)}, "ids has 1 entries; give 7"),
    "sigma": ({"sigma_m": np.zeros(3)}, r"sigma_m has shape \(3,\)"),
    "condition": ({"conditions": {"temp_C": np.zeros(3)}}, r"temp_C has shape \(3,\)"),
    "text": ({"other": {"station": ("A",)}}, "station has 1 entries"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_column_of_another_length_is_named(wrong: str) -> None:
    change, message = WRONG[wrong]
    with pytest.raises(LabError, match=message) as caught:
        replace(example(), **change)
    assert "\n" not in str(caught.value)


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
