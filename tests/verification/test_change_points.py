"""The sequential test of a series of calibrations: its levels, what it finds, and what it names."""

import numpy as np
import pytest

from lab.core.significance import TREND_YEAR
from lab.prediction.estimate import IdentifiedSubset
from lab.verification.parameter_changes import CalibrationSeries, ChangeDirections, levels

COUNT = 8
SCALE = np.geomspace(1e-6, 1e-3, COUNT)
NAMES = tuple(f"link{i}.theta" for i in range(COUNT))
PARAMETERS = ChangeDirections(NAMES, np.eye(COUNT))


def calibrations(
    rng: np.random.Generator, shifts: np.ndarray, dof: int | None = None, poses: np.random.Generator | None = None
) -> list[IdentifiedSubset]:
    """Of an arm whose parameters are off by ``shifts``; each covariance is drawn from ``poses``."""
    estimates = []
    for shift in shifts:
        root = (poses or rng).normal(size=(COUNT, 2 * COUNT)) / np.sqrt(2 * COUNT)
        own = SCALE[:, None] * (root @ root.T) * SCALE
        draw = rng.multivariate_normal(shift, own, method="cholesky")
        share = 1.0 if dof is None else rng.chisquare(dof) / dof
        estimates.append(IdentifiedSubset(NAMES, draw, share * own, (True,) * COUNT, dof))
    return estimates


def series(
    rng: np.random.Generator, shifts: np.ndarray, days: list[float], dof: int | None = None
) -> CalibrationSeries:
    return CalibrationSeries(calibrations(rng, shifts, dof), days, PARAMETERS)


@pytest.mark.parametrize("days", [30.0, 1.0, 400.0, 0.0])
def test_the_levels_of_a_year_never_add_up_to_more_than_one_percent(days: float) -> None:
    at = [days * i for i in range(200)]
    of_year: dict[int, float] = {}
    for day, level in zip(at, levels(at), strict=True):
        of_year[int(day // 365.25)] = of_year.get(int(day // 365.25), 0.0) + level
    assert max(of_year.values()) < TREND_YEAR
    assert levels(at)[0] == 0 and min(levels(at)[1:]) > 0


@pytest.mark.parametrize("dof", [None, 20])
def test_years_without_a_change_raise_no_more_alarms_than_the_level(dof: int | None) -> None:
    rng, years = np.random.default_rng(0), 60
    days = [60.8 * i for i in range(6)]
    alarms = [bool(series(rng, np.zeros((6, COUNT)), days, dof).change_points()) for _ in range(years)]
    assert np.mean(alarms) <= TREND_YEAR + 3 * np.sqrt(TREND_YEAR / years)


def test_every_change_is_dated_named_and_sized() -> None:
    """Two changes of different parameters, each larger than its noise: where, which, and how far."""
    rng, right, inside = np.random.default_rng(1), [], []
    sizes = (20 * SCALE[2], -25 * SCALE[5])
    for _ in range(20):
        shifts = np.zeros((7, COUNT))
        shifts[2:, 2], shifts[5:, 5] = sizes
        found = series(rng, shifts, [30.0 * i for i in range(7)]).change_points()
        right.append([(each.after, each.named) for each in found] == [(1, NAMES[2:3]), (4, NAMES[5:6])])
        if right[-1]:
            off = [abs(each.changes[0] - size) / each.half_widths[0] for each, size in zip(found, sizes, strict=True)]
            inside += [each < 1 for each in off]
    assert sum(right) >= 18  # the rest are false alarms, and changes that chance makes look like two
    assert np.mean(inside) > 0.95 - 3 * np.sqrt(0.05 / len(inside))


def test_a_change_of_several_parameters_is_told_from_a_change_of_one() -> None:
    rng = np.random.default_rng(2)
    shifts = np.zeros((6, COUNT))
    shifts[3:, 1], shifts[3:, 6] = 25 * SCALE[1], 25 * SCALE[6]
    both = series(rng, shifts, [30.0 * i for i in range(6)]).change_points()
    assert both[0].several and {NAMES[1], NAMES[6]} <= set(both[0].named)
    shifts[3:, 6] = 0
    (one,) = series(rng, shifts, [30.0 * i for i in range(6)]).change_points()
    assert not one.several and one.named == (NAMES[1],)


def test_whole_turns_and_the_first_calibration_are_no_change() -> None:
    rng = np.random.default_rng(3)
    shifts = np.zeros((4, COUNT))
    shifts[2:, 4] = 2 * np.pi
    assert series(rng, shifts, [0.0, 1.0, 2.0, 3.0]).change_points() == ()


def test_a_minimum_detectable_change_is_found_in_95_of_100() -> None:
    """The next calibration of arms that moved by it, in the direction of one parameter, raises the alarm."""
    rng, alarms, years = np.random.default_rng(4), 0, 80
    for _ in range(years):
        days, five = [30.0 * i for i in range(6)], calibrations(rng, np.zeros((5, COUNT)))
        five[-1:] = calibrations(rng, np.zeros((1, COUNT)), poses=np.random.default_rng(5))
        before = CalibrationSeries(five, days[:5], PARAMETERS)
        size = before.detectable(np.eye(COUNT)[:, [3]], 0)[0]
        after = calibrations(rng, size * np.eye(COUNT)[[3]], poses=np.random.default_rng(5))  # the last one's
        alarms += bool(CalibrationSeries([*five, *after], days, PARAMETERS).change_points())
    assert alarms / years == pytest.approx(0.95, abs=3 * np.sqrt(0.05 * 0.95 / years))
    assert np.isinf(before.detectable(np.zeros((COUNT, 1)), 0)[0])
