"""The study of noise models: its level and its intervals, on a few campaigns; the whole study is slow."""

import numpy as np
import pytest
from noise_models import CASES, of_one_arm


def summary(name: str, campaigns: int) -> dict[str, np.ndarray]:
    return of_one_arm(name, 0, campaigns)


@pytest.mark.thorough
def test_scatter_is_taken_and_its_intervals_hold() -> None:
    found = summary("joint scatter, 3 targets, 40 poses", 8)
    assert found["taken"].all() and not found["named"].any()
    assert found["covered"].mean() > 0.88 and 0.6 < found["nees"].mean() < 1.5
    assert (found["square"] / found["plain square"]).mean() > 0  # the errors of generalized least squares are ...
    assert found["square"].sum() < found["plain square"].sum()  # ... smaller than those of plain least squares


@pytest.mark.slow
@pytest.mark.parametrize("name", list(CASES))
def test_every_case_holds(name: str) -> None:
    found = summary(name, 150)
    easy = "1 target, 40" not in name or name.startswith("independent")
    assert found["covered"].mean() > (0.93 if easy else 0.92)
    assert found["nees"].mean() < (1.12 if easy else 1.25)
    assert found["named"].mean() <= (0.1 if "Student" in name else 0.05)
    assert found["alarmed"].mean() <= 0.05
    if name.startswith("independent"):
        assert found["taken"].mean() <= 0.05
