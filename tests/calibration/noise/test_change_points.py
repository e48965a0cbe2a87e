"""A base that moved at once: the scan against least squares, what is told, and what is not to be taken for one."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

import lab
from lab.calibration.identification import identify
from lab.calibration.noise_search import NoiseSearch, search_noise
from lab.calibration.observation import observation_of
from lab.calibration.weights import Noise, weigh
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.probability import f_sf
from lab.formats.noise_model import noise_model_from_dict, noise_model_to_dict
from lab.noise.change_points import APART, BaseChange, before_and_after, likeliest_change
from lab.noise.error_model import ErrorModel, row_times
from lab.robots.load_robot import load_robot

ROBOT = load_robot("irb120")
ARM = ROBOT.arm(("p1",))
NOMINAL = ARM.nominal(ROBOT.tool)
DIRECTION = np.array([0.6, 0.0, -0.8])


@pytest.fixture(scope="module")
def day() -> Measurements:
    return lab.simulate("irb120", seed=5, poses=60, targets=("p1",)).measurements


def moved(data: Measurements, along: Sequence[float] | np.ndarray) -> Measurements:
    """The points moved row by row, by so many m along one direction."""
    return replace(data, points=data.points + np.asarray(along)[:, None, None] * DIRECTION)


def searched(data: Measurements) -> NoiseSearch:
    return search_noise(identify(ARM, data, NOMINAL, Noise()), data, Noise())


def shared_by(data: Measurements) -> ErrorModel:
    found = searched(data).shared
    assert found is not None
    return found


@pytest.mark.parametrize("sessions", [1, 2])
def test_the_scan_is_the_F_test_of_least_squares_at_every_row(sessions: int) -> None:
    rng, n = np.random.default_rng(0), 36
    times = np.arange(n, dtype=float) + APART * (np.arange(n) * sessions // n)
    white, shift = rng.standard_normal((n, 3, 5)), rng.standard_normal((n, 3, 3))
    shuffled = rng.permutation(n)  # rows need not stand in the order of time
    found = likeliest_change(white[shuffled], shift[shuffled], times[shuffled])
    assert found is not None
    best, count = (0.0, BaseChange(0.0, 0.0)), 0
    for row in range(1, n):
        own = times // APART == times[row] // APART
        if min((own & (times < times[row])).sum(), (own & (times >= times[row])).sum()) < 8:
            continue
        count += 1
        after = times >= times[row]
        centred = after - after.mean()
        columns, errors = white[..., :-1].reshape(3 * n, 4), white[..., -1].ravel()
        both = np.concatenate([columns, (centred[:, None, None] * shift).reshape(3 * n, 3)], axis=1)
        plain, more = (np.linalg.lstsq(each, errors, rcond=None)[1][0] for each in (columns, both))
        f = (plain - more) / 3 / (more / (3 * n - 7))
        best = max(best, (f, BaseChange(times[row] - 0.5, pytest.approx(after.mean()))), key=lambda b: b[0])
    assert found.f == pytest.approx(best[0]) and found.change == best[1] and found.candidates == count
    assert found.p == pytest.approx(min(1.0, count * float(f_sf(best[0], 3, 3 * n - 7))))


def test_a_base_that_moved_is_told_with_its_rows_and_size(day: Measurements) -> None:
    shared = shared_by(moved(day, 50e-6 * (np.arange(60) >= 41)))
    assert shared.kinds == ("step",)
    (move,) = shared.moves
    assert (move.before, move.after) == ("40", "41") and move.size_m == pytest.approx(50e-6, rel=0.1)
    assert shared.step_m * np.sqrt(3) == pytest.approx(50e-6, rel=0.15)  # three coefficients of one variance


@pytest.mark.parametrize(
    ("along", "kind"),
    [
        (np.zeros(60), None),
        (np.linspace(-40e-6, 40e-6, 60), "drift"),
        (20e-6 * np.sin(np.arange(60) / 4.0), "wandering"),
        (1e-3 * (np.arange(60) < 2), None),  # two bad readings at the beginning; outliers are no part of this
    ],
    ids=["nothing", "a drift", "wandering", "bad readings"],
)
def test_what_is_no_change_is_not_called_one(day: Measurements, along: np.ndarray, kind: str | None) -> None:
    rows = np.flatnonzero(np.abs(along) < 5e-4)  # as the search has them, outliers aside
    shared = searched(moved(day, along)[rows]).shared
    assert (shared is None) if kind is None else (shared is not None and kind in shared.kinds)
    assert shared is None or not shared.moves


def test_a_new_session_is_no_change_and_one_within_it_lasts(day: Measurements) -> None:
    two = replace(day, sessions=("a",) * 30 + ("b",) * 30)
    assert not shared_by(moved(two, 50e-6 * (np.arange(60) >= 30))).moves
    later = shared_by(moved(two, 80e-6 * (np.arange(60) >= 15)))
    (move,) = later.moves
    part = before_and_after(row_times(two, later.clock), [move.change])[:, 0]
    np.testing.assert_allclose(part, np.repeat([-0.75, 0.25], [15, 45]))


def covariance(data: Measurements, shared: ErrorModel) -> np.ndarray:
    """Of the x of these rows, m^2, the instrument's noise left out."""
    observed = weigh(observation_of(ARM), data, Noise(shared=shared))[0].correlation
    assert observed is not None
    return observed.trend[:, 0] @ observed.trend[:, 0].T * shared.sigma_m**2


def test_rows_held_out_stand_on_their_side_and_on_another_day_all_are_off_by_one_shift(day: Measurements) -> None:
    timed = replace(day, conditions={"time_s": 1.7e9 + 30.0 * np.arange(60) + 5.0 * (np.arange(60) % 7)})
    shared = shared_by(moved(timed, 50e-6 * (np.arange(60) >= 41)))
    held = timed[[2, 40, 41, 58]]  # of another spacing than the whole
    after = 19 / 60
    side = np.array([-after, -after, 1 - after, 1 - after])
    np.testing.assert_allclose(covariance(held, shared), shared.step_m**2 * np.outer(side, side), rtol=1e-9)
    kept = noise_model_to_dict(shared)
    assert kept is not None and kept["moves"] == [
        {"before": "40", "after": "41", "size_mm": pytest.approx(0.05, rel=0.1)}
    ]
    tomorrow = noise_model_from_dict(kept, shared.values)
    assert tomorrow is not None and tomorrow.step_m == pytest.approx(shared.step_m)
    np.testing.assert_allclose(covariance(held, tomorrow), np.full((4, 4), shared.step_m**2), rtol=1e-9)
    assert noise_model_from_dict({key: kept[key] for key in kept if key != "step_mm"}, {}).step_m == 0  # an older run
    with pytest.raises(LabError, match="below zero"):
        noise_model_from_dict(kept | {"step_mm": -1.0}, {})
