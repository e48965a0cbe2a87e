"""Copies of rows count for nothing, and a noise in another unit is refused; measurements as they are pass."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lab
from lab.commands.calibrate.plausibility import without_copies
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.core.se3 import Array


@pytest.fixture(scope="module")
def day() -> Measurements:
    return lab.simulate("scara", poses=30, seed=4).measurements


def doubled(data: Measurements, rows: list[int]) -> Measurements:
    more = data.take([*range(len(data)), *rows])
    return replace(more, ids=tuple(str(i) for i in range(len(more))))


def test_rows_that_are_copies_are_left_out_and_told(day: Measurements) -> None:
    plain = lab.identify(day, robot="scara", instrument="uniform-8um", holdout=0.2)
    again = lab.identify(doubled(day, list(range(30))), robot="scara", instrument="uniform-8um", holdout=0.2)
    assert again.identification.values == pytest.approx(plain.identification.values, abs=0)
    assert (again.identification.covariance == plain.identification.covariance).all()
    assert any("30 rows are copies of an earlier one" in each for each in again.warnings)
    assert not any("cop" in each for each in plain.warnings)


def test_what_is_measured_twice_is_no_copy() -> None:
    rng = np.random.default_rng(0)
    joints, points = np.zeros((6, 2)), rng.normal(size=(6, 1, 3))
    points[4] = points[5] = np.nan  # seen in neither
    data = measured(("q1", "q2"), joints, ("p1",), points)
    assert without_copies(Path("day.csv"), data) is data
    one = replace(data, points=np.where(np.arange(6)[:, None, None] == 2, points[1], points))
    kept = without_copies(Path("day.csv"), one)
    assert kept.ids == ("0", "1", "3", "4", "5")
    assert "1 row is a copy of an earlier one to the last digit (the first: row 2, of row 1)" in kept.warnings[-1]
    other = replace(one, sessions=("", "", "b", "", "", ""))
    assert without_copies(Path("day.csv"), other) is other
    warm = replace(one, conditions={"temp_C": np.arange(6.0)})
    assert without_copies(Path("day.csv"), warm) is warm


def test_a_noise_in_micrometres_is_refused_with_what_it_would_be(day: Measurements) -> None:
    with pytest.raises(LabError, match=r"--noise-mm 8: the residuals .* is it in µm\? That would be 0\.008 mm"):
        lab.identify(day, robot="scara", noise_mm=8.0, holdout=0.2)
    column = replace(day, sigma_m=np.full(len(day), 5e-3))
    with pytest.raises(LabError, match=r"column sigma_mm 5: .* That would be 0\.005 mm"):
        lab.identify(column, robot="scara", holdout=0.2)
    lab.identify(day, robot="scara", noise_mm=0.05, holdout=0.2)


def turned(data: Measurements, change: Callable[[Array], Array]) -> Measurements:
    return replace(data, joints=change(data.joints))


def negated(joints: Array) -> Array:
    return joints * [1, -1, 1, 1]


MISTAKES: dict[str, Callable[[Measurements], Measurements]] = {
    "joint 2 negated": lambda day: turned(day, negated),
    "joints a row late": lambda day: turned(day, lambda joints: np.roll(joints, 1, axis=0)),
    "radians taken for degrees": lambda day: turned(day, np.deg2rad),
    "points in metres taken for mm": lambda day: replace(day, points=day.points / 1e3),
    "x and y exchanged": lambda day: replace(day, points=day.points[..., [1, 0, 2]]),
    "half of the rows in another unit": lambda day: replace(
        day, points=np.where((np.arange(len(day)) % 2 == 0)[:, None, None], day.points, day.points / 1e3)
    ),
}


def mistaken(robust: bool) -> list[object]:
    """The cheapest with every change; searches for outliers among nonsense take long."""
    marks = [pytest.mark.slow if robust else pytest.mark.thorough] * len(MISTAKES)
    marks[0] = pytest.mark.thorough
    return [pytest.param(name, robust, marks=mark) for name, mark in zip(MISTAKES, marks, strict=True)]


@pytest.mark.parametrize(("mistake", "robust"), [*mistaken(True), *mistaken(False)])
def test_a_mistake_is_never_good(mistake: str, robust: bool, day: Measurements) -> None:
    """However many poses --robust would leave out to make the rest fit."""
    found = lab.identify(MISTAKES[mistake](day), robot="scara", instrument="uniform-8um", robust=robust)
    assert found.verdict.word == "bad" and found.exit_code == 1
