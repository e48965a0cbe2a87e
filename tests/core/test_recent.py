"""Results that are kept are those of the same arguments alone."""

from dataclasses import dataclass

import numpy as np
import pytest

from lab.core.recent import recent


@dataclass(frozen=True)
class Unhashable:
    numbers: np.ndarray


def counted(results: int = 2, numbers: int = 10):
    calls: list[object] = []

    @recent(results, numbers)
    def double(owner: object, values: np.ndarray, times: float = 2.0) -> np.ndarray:
        calls.append(owner)
        return times * values

    return double, calls


def test_equal_arguments_are_computed_once_and_others_anew() -> None:
    double, calls = counted()
    owner, other = Unhashable(np.ones(1)), Unhashable(np.ones(1))
    values = np.arange(3.0)
    assert double(owner, values) is double(owner, values.copy())
    assert len(calls) == 1
    for arguments in ((other, values), (owner, values + 1), (owner, values.astype(np.int64)), (owner, values[None])):
        before = len(calls)
        np.testing.assert_array_equal(double(*arguments), 2.0 * arguments[1])
        assert len(calls) == before + 1


def test_an_array_changed_in_place_is_computed_anew() -> None:
    double, calls = counted()
    values = np.arange(3.0)
    double("a", values)
    values[0] = 7.0
    assert double("a", values)[0] == 14.0
    assert len(calls) == 2


def test_keywords_are_part_of_the_arguments() -> None:
    double, _ = counted()
    values = np.arange(3.0)
    assert double("a", values, times=3.0)[1] == 3.0
    assert double("a", values, times=4.0)[1] == 4.0


@pytest.mark.parametrize(("poses", "again"), [(10, 0), (11, 1)])
def test_large_arrays_are_not_kept(poses: int, again: int) -> None:
    double, calls = counted()
    for _ in range(2):
        double("a", np.ones(poses))
    assert len(calls) == 1 + again


def test_the_oldest_results_go() -> None:
    double, calls = counted(results=2)
    for name in "abcb":
        double(name, np.ones(2))
    assert calls == ["a", "b", "c"]
    double("a", np.ones(2))
    assert calls == ["a", "b", "c", "a"]


def test_errors_are_raised_again() -> None:
    @recent(2)
    def refuse(name: str) -> None:
        raise ValueError(name)

    for _ in range(2):
        with pytest.raises(ValueError, match="a"):
            refuse("a")
