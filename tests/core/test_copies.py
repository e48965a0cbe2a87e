import numpy as np

from lab.core.measurements import copied_rows, describe_copies


def test_copies_are_found_with_the_first_row_that_is_alike() -> None:
    rows = np.array([[1.0, 2.0], [1.0, 3.0], [1.0, 2.0], [np.nan, 2.0], [1.0, 2.0], [1.0, 3.0 + 1e-15]])
    assert copied_rows(rows) == [(2, 0), (4, 0)]
    assert copied_rows(rows[:2]) == [] and copied_rows(rows[:0]) == []


def test_one_and_several_are_told() -> None:
    assert "day.csv: 1 row is a copy of an earlier one" in describe_copies("day.csv", 1, "line 9", "line 2")
    assert (
        "12 rows are copies" in (said := describe_copies("a", 12, "line 9", "line 2")) and "line 9, of line 2" in said
    )
