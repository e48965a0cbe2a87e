"""Copies of rows count for nothing, and a noise in another unit is refused; measurements as they are pass."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.campaigns import identification, session

import lab
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured, without_copies
from lab.core.se3 import Array
from lab.phrases.phrase import in_one_line, phrases


@pytest.fixture(scope="module")
def day() -> Measurements:
    return session("scara", poses=30, seed=4).measurements


def doubled(data: Measurements, rows: list[int]) -> Measurements:
    more = data[[*range(len(data)), *rows]]
    return replace(more, ids=tuple(str(i) for i in range(len(more))))


def test_rows_that_are_copies_are_left_out_and_told(day: Measurements) -> None:
    plain = identification(day, robot="scara", instrument="uniform-8um", holdout=0.2)
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
    assert "row 2, of row 1" in kept.warnings[-1]
    other = replace(one, sessions=("", "", "b", "", "", ""))
    assert without_copies(Path("day.csv"), other) is other
    warm = replace(one, conditions={"temp_C": np.arange(6.0)})
    assert without_copies(Path("day.csv"), warm) is warm


def test_a_noise_in_micrometres_is_refused_with_what_it_would_be(day: Measurements) -> None:
    with pytest.raises(LabError, match=r"--noise-mm 8: .* 0\.008 mm"):
        lab.identify(day, robot="scara", noise_mm=8.0, holdout=0.2)
    column = replace(day, sigma_m=np.full(len(day), 5e-3))
    with pytest.raises(LabError, match=r"column sigma_mm 5: .* 0\.005 mm"):
        lab.identify(column, robot="scara", holdout=0.2)
    lab.identify(day, robot="scara", noise_mm=0.05, holdout=0.2)


def test_a_noise_that_hides_errors_is_told_and_not_good(day: Measurements) -> None:
    sound = lab.identify(day, robot="scara", noise_mm=0.008, holdout=0.2)
    vague = lab.identify(day, robot="scara", noise_mm=0.2, holdout=0.2)
    assert sound.verdict.word == "good" and vague.verdict.word == "doubtful"
    assert vague.verdict.fit.standing == "doubtful"
    assert "--noise-mm 0.2 is " in in_one_line(vague.verdict.reasons)
    assert any("not detected" in each for each in lab.verify(sound, day, noise_mm=0.2).warnings)
    assert not any("not detected" in each for each in lab.verify(sound, day, noise_mm=0.01).warnings)


def turned(data: Measurements, change: Callable[[Array], Array]) -> Measurements:
    return replace(data, joints=change(data.joints))


def negated(joints: Array) -> Array:
    return joints * [1, -1, 1, 1]


MISTAKES: dict[str, tuple[Callable[[Measurements], Measurements], str]] = {  # with the finding
    "joint 2 negated": (lambda day: turned(day, negated), "joint_sign:q2"),
    "joints a row late": (lambda day: turned(day, lambda joints: np.roll(joints, 1, axis=0)), "rows_shifted:+1"),
    "radians taken for degrees": (lambda day: turned(day, np.deg2rad), "joint_unit:rad"),
    "points in metres taken for mm": (lambda day: replace(day, points=day.points / 1e3), "point_unit:m"),
    "x and y exchanged": (lambda day: replace(day, points=day.points[..., [1, 0, 2]]), "points_mirrored"),
}


@pytest.mark.thorough
@pytest.mark.parametrize("robust", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_bad_and_named(mistake: str, robust: bool, day: Measurements) -> None:
    """However many poses --robust would leave out to make the rest fit."""
    change, key = MISTAKES[mistake]
    found = lab.identify(change(day), robot="scara", instrument="uniform-8um", robust=robust)
    assert found.verdict.word == "bad" and found.exit_code == 1
    assert [each.hypothesis.key for each in found.diagnosis] == [key]


@pytest.mark.thorough
def test_a_negated_joint_is_named_whether_the_fit_shows_it_or_not() -> None:
    """A wrist with its fifth joint negated is the same arm, zeros of the fourth and sixth half a turn away."""
    day = session(poses=40, seed=1).measurements

    def named(data: Measurements) -> list[str]:
        found = lab.identify(data, robot="irb120", instrument="uniform-8um", holdout=0.2)
        assert found.verdict.word == ("good" if data is day else "bad")
        return [each.hypothesis.key for each in found.diagnosis]

    for joint in (1, 4):
        signs = np.where(np.arange(6) == joint, -1, 1)
        assert named(turned(day, lambda joints, signs=signs: joints * signs)) == [f"joint_sign:q{joint + 1}"]  # type: ignore[misc]
    assert named(day) == []
    assert named(replace(day, points=day.points[..., [1, 0, 2]])) == ["points_mirrored"]


def test_next_to_nothing_but_copies_is_refused(day: Measurements) -> None:
    with pytest.raises(LabError, match=r"39 rows are copies .* 1 row is left"):
        without_copies(Path("day.csv"), doubled(day[[0]], [0] * 39))
    assert len(without_copies(Path("day.csv"), doubled(day[:5], [0] * 39))) == 5


@pytest.mark.sampled(2)
@pytest.mark.parametrize("scale", [1.01, 0.985, 1.001, 1.0])
def test_points_in_another_scale_are_told_and_not_good(scale: float) -> None:
    """As of an instrument whose unit or whose air is wrong: all lengths grow together, and everything fits."""
    day = session(poses=40, seed=5).measurements
    found = lab.identify(replace(day, points=scale * day.points), robot="irb120", holdout=0.25)
    said = [reason for reason in phrases(found.verdict.reasons) if "check the scale of the points" in reason]
    assert bool(said) == (found.verdict.word != "good") == (abs(scale - 1) > 0.005)
    assert all(("longer" if scale > 1 else "shorter") in each for each in said)


@pytest.mark.thorough
def test_more_noise_than_a_bounded_one_is_no_outliers() -> None:
    """What is estimated beside an instrument's uniform noise has tails: hundreds of good poses were called off."""
    day = session(poses=300, seed=3).measurements
    noise = 80e-6 * np.random.default_rng(1).standard_normal(day.points.shape)
    found = lab.identify(replace(day, points=day.points + noise), robot="irb120", instrument="uniform-8um")
    assert any("lack of fit: the residuals are" in each for each in found.warnings)
    assert not any("outlier" in each for each in found.warnings)


def test_a_column_of_noise_in_two_units_is_told_and_not_good() -> None:
    day = session(poses=60, seed=5).measurements
    sigma = np.full(len(day), 8e-6 / np.sqrt(3))
    for factor in (1e3, 1.0):
        mixed = replace(day, sigma_m=np.where(np.arange(len(day)) % 3 == 0, factor * sigma, sigma))
        found = lab.identify(mixed, robot="irb120", holdout=0.25)
        assert (found.verdict.word == "good") == (factor == 1.0), phrases(found.verdict.reasons)
        assert any("sigma_mm" in each for each in phrases(found.verdict.reasons)) == (factor > 1)
