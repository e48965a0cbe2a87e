"""Tables IV.2 and IV.3 for any index, noise and seed: errors and chances by own formulas."""

from dataclasses import replace
from types import SimpleNamespace

import live_tables as script
import numpy as np
import pytest
from helpers.printed_irb120 import TABLE, frames
from live_tables import LiveTables, chances, commonest_order, live_tables

from lab.core.errors import LabError
from lab.extensions.reproduction.thesis_case import errors

LEFT_OUT = ((1, 1), (4, 1), (4, 2), (5, 0), (5, 3))  # d2, d5, a5, theta6, alpha6
KEPT = [(i, j) for i in range(6) for j in range(4) if (i, j) not in LEFT_OUT]
BIASED = [KEPT.index(each) for each in ((2, 1), (4, 0), (4, 3))]  # d3, theta5, alpha5
HIDDEN_MM = {(1, 1): 0.60, (4, 1): 0.93, (4, 2): 0.36}


def flange(table: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Positions ``(n, 3)`` of the flange's origin, mm."""
    return 1e3 * frames(table, q)[-1][:, :3, 3]


def column(q: np.ndarray, entry: tuple[int, int]) -> np.ndarray:
    """Derivative of all coordinates by an entry, mm per mm or mm per rad."""
    step = np.zeros((6, 4))
    step[entry] = 1e-6
    moved = (flange(TABLE + step, q) - flange(TABLE - step, q)) / 2e-6
    return (moved / 1e3 if entry[1] in (1, 2) else moved).ravel()


def best_of_random(name: str, seed: int, count: int, starts: int) -> SimpleNamespace:
    """The best of 12 random sets of poses by an index of the own derivatives: quick, and as good a set as any here."""
    sets = np.random.default_rng(seed).uniform(-np.pi, np.pi, (12, 20, 6))
    scores = []
    for q in sets:
        s = np.linalg.svd(np.stack([column(q, each) for each in KEPT], axis=1), compute_uv=False)
        scores.append(np.log(s).mean() if name == "O1" else s[-1] / s[0])
    return SimpleNamespace(joints=sets[int(np.argmax(scores))])


@pytest.fixture(scope="module")
def tables() -> LiveTables:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(script, "searched", best_of_random)
        return live_tables(("random", "O1", "condition", "O2"), 20.0, 3, 1500)


def test_errors_are_the_bias_and_the_noise_of_least_squares(tables: LiveTables) -> None:
    """Mean and standard deviation of each of the 19 errors, by own derivatives and uniform noise of ±20 µm."""
    for name in ("random", "O1"):
        q = tables.joints[name]
        J = np.stack([column(q, each) for each in KEPT], axis=1)
        inverse = np.linalg.inv(J.T @ J)
        bias = inverse @ J.T @ sum(size * column(q, each) for each, size in HIDDEN_MM.items())
        sigma = 0.020 / np.sqrt(3) * np.sqrt(np.diag(inverse))
        off = tables.errors[name]
        np.testing.assert_allclose(off.std(axis=0), sigma, rtol=0.08)
        assert (np.abs(off.mean(axis=0) - bias) < 4.5 * sigma / np.sqrt(len(off)) + 1e-7).all()
        rest = [i for i in range(19) if i not in BIASED]
        assert np.abs(bias[rest]).max() < 1e-6 < 0.004 < np.abs(bias[BIASED]).min()
        assert tables.expected[name] == pytest.approx(np.sqrt((sigma[rest] ** 2).mean()), rel=1e-4)
    np.testing.assert_allclose(
        tables.estimates(4)["O1"] - tables.errors["O1"][4], tables.estimates()["O1"] - tables.errors["O1"][0]
    )


def test_the_noise_of_the_thesis_gives_the_case_s_own_errors() -> None:
    found = live_tables(("random",), 8.0, 0, 50)
    np.testing.assert_allclose(found.errors["random"], errors(found.joints["random"], 50, 0), rtol=0, atol=1e-12)


def test_rows_and_shares_by_counting(tables: LiveTables) -> None:
    """RMS, MAE and RSD by hand; O2 and the condition number share their wins, with and without the three rows."""
    for all_rows in (True, False):
        rows = [i for i in range(19) if all_rows or i not in BIASED]
        rms = {name: np.sqrt((off[:, rows] ** 2).mean(axis=1)) for name, off in tables.errors.items()}
        found = tables.rows(all_rows=all_rows)
        for name, off in tables.errors.items():
            np.testing.assert_allclose(found["RMS"][name], rms[name])
            np.testing.assert_allclose(found["MAE"][name], np.abs(off[:, rows]).mean(axis=1))
            np.testing.assert_allclose(found["RSD"][name], off[:, rows].std(axis=1, ddof=1))
        shares = tables.shares(all_rows=all_rows)
        others = np.minimum(rms["random"], rms["O1"])
        assert shares["O2"] == shares["condition"] == pytest.approx((rms["O2"] < others).mean() / 2)
        assert sum(shares.values()) == pytest.approx(1.0)
        assert tables.scores["O1"]["O1"] == 1.0 > tables.scores["random"]["O1"]
    assert np.median(tables.rows(all_rows=True)["RMS"]["O1"]) == pytest.approx(0.60 / np.sqrt(19), rel=0.02)


@pytest.mark.thorough
def test_the_order_without_the_three_rows_is_that_of_expected_errors_and_the_bias_hides_it() -> None:
    """Random poses are the worst in most draws, which the 19 rows hide: the bias is the same for all poses."""
    search = live_tables(("O5", "random"), 8.0, 0, 400)
    assert commonest_order([search, replace(search, seed=1)]) == (("O5", "random"), 2)
    without, whole = (chances([search], all_rows=all_rows)["O5"] for all_rows in (False, True))
    assert without.mean > 0.6 > whole.mean and without.lower <= without.mean <= without.upper


def test_a_chance_has_the_interval_of_its_searches_or_of_its_draws(tables: LiveTables) -> None:
    """By Student's t over searches, and by the draws of a single one."""
    share = tables.shares(all_rows=False)["O1"]
    one = chances([tables], all_rows=False)["O1"]
    assert one.mean == share and one.upper - one.lower == pytest.approx(2 * 1.96 * np.sqrt(share * (1 - share) / 1500))
    halves = [replace(tables, errors={name: off[k::2] for name, off in tables.errors.items()}) for k in range(2)]
    shares = [each.shares(all_rows=False)["O1"] for each in halves]
    both = chances(halves, all_rows=False)["O1"]
    assert both.mean == pytest.approx(np.mean(shares))
    assert both.upper - both.mean == pytest.approx(min(12.706 * np.std(shares, ddof=1) / np.sqrt(2), 1), rel=1e-3)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"names": ("O6",)}, "index 'O6' is unknown"),
        ({"names": ()}, "name each one once"),
        ({"names": ("O1", "O1")}, "name each one once"),
        ({"noise_um": 0.0}, "noise of 0 µm"),
        ({"noise_um": np.nan}, "noise of nan µm"),
        ({"draws": 0}, "0 draws"),
    ],
)
def test_bad_input(given: dict, words: str) -> None:
    with pytest.raises(LabError, match=words):
        live_tables(**given)
