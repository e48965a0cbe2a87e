"""Records whose mistakes physics shows are accepted by no route; legitimate records are."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers.load_mistakes import (
    OF_DYNAMICS,
    OF_SAG,
    OF_TORQUES,
    OF_WRENCH,
    dynamics_answer,
    motion,
    payload_answer,
    poses,
    sag,
    sag_answer,
)
from scipy import stats

from lab.extensions.dynamics.dynamics_phrases import phrase
from lab.extensions.dynamics.dynamics_plausibility import misplaced_points, stuck_channels
from lab.extensions.dynamics.load_files import PayloadSamples

ROUTES = {"torques": OF_TORQUES, "wrench": OF_WRENCH}
LEVEL = 0.05  # of the test of residuals


def of_seed(seed: int) -> np.random.Generator:
    return np.random.default_rng([seed, 77])


def test_a_sag_without_mistakes_is_accepted() -> None:
    assert sag_answer(sag("tx40", 0)) == []


@pytest.mark.sampled(2)
@pytest.mark.parametrize("mistake", list(OF_SAG)[::3])
def test_a_mistake_in_a_sag_is_not_accepted(mistake: str) -> None:
    assert sag_answer(OF_SAG[mistake](sag("tx40", 0), of_seed(0)))


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("method", "mistake"), [(method, name) for method in ROUTES for name in ROUTES[method]][::3])
def test_a_mistake_in_poses_is_not_accepted(method: str, mistake: str, tmp_path: Path) -> None:
    changed = ROUTES[method][mistake](poses("tx40", 3), of_seed(0))
    assert payload_answer(changed, tmp_path, method)  # type: ignore[arg-type]


@pytest.mark.thorough
@pytest.mark.parametrize("mistake", ["one drive in Nmm", "time in ms"])
def test_a_mistake_in_a_motion_is_not_accepted(mistake: str, tmp_path: Path) -> None:
    record = motion("tx40", 1, loaded=False)
    assert dynamics_answer(OF_DYNAMICS[mistake](record, of_seed(0)), tmp_path)


def readings(change: Callable[[np.ndarray], None]) -> list[str]:
    """Messages about a made-up record of which a channel is changed."""
    rng = np.random.default_rng(0)
    torques = rng.standard_normal((60, 6))
    change(torques)
    samples = PayloadSamples(None, rng.standard_normal((60, 6)), torques, None, np.arange(60) < 30)
    names = [f"the torque of q{i + 1}" for i in range(6)]
    return [phrase(each) for each in stuck_channels(samples, names, np.arange(6) != 5)]


def test_a_channel_that_is_stuck_or_saturates_is_named() -> None:
    assert readings(lambda torques: None) == []
    (said,) = readings(lambda torques: torques[:30].__setitem__((slice(None), 2), 4.5))
    assert "the torque of q3 is 4.5 in all 30 rows" in said
    assert readings(lambda torques: torques.__setitem__((slice(None), 5), 0.0)) == []  # it does not have to change
    clipped = readings(lambda torques: np.clip(torques[:, 1], -1.2, 0.5, out=torques[:, 1]))
    assert len(clipped) == 0 or all("saturates" in words for words in clipped)
    many = PayloadSamples(
        *(None, np.zeros((400, 1)), np.clip(np.random.default_rng(1).standard_normal((400, 1)), -0.8, 0.8), None),
        np.ones(400, dtype=np.bool_),
    )
    (said,) = (phrase(each) for each in stuck_channels(many, ["the torque of q1"], np.ones(1, dtype=np.bool_)))
    assert "saturates" in said


def test_points_of_another_frame_are_named() -> None:
    there = np.random.default_rng(0).standard_normal((9, 2, 3))
    assert misplaced_points(there, there + 1e-3, np.where(np.arange(9)[:, None, None] < 2, np.nan, there)) == ()
    (said,) = misplaced_points(there, there, there * [1, 1, -1])
    assert "from where the calibrated arm has them" in phrase(said)


def test_rounded_readings_are_not_called_stuck() -> None:
    rng = np.random.default_rng(2)
    rounded = np.round(rng.standard_normal((300, 6)), 1)  # some forty different readings
    samples = PayloadSamples(None, rng.standard_normal((300, 6)), rounded, None, np.ones(300, dtype=np.bool_))
    assert stuck_channels(samples, [f"q{i}" for i in range(6)], np.ones(6, dtype=np.bool_)) == ()


def doubted_no_more_than_the_level(doubted: int, runs: int) -> bool:
    """Whether so many doubted legitimate records agree with the level of the test of residuals."""
    return bool(stats.binom.sf(doubted - 1, runs, LEVEL) > 0.01)


@pytest.mark.slow
@pytest.mark.parametrize("route", ["sag", "torques", "wrench"])
def test_of_many_loads_no_mistake_is_accepted(route: str, tmp_path: Path) -> None:
    """24 arms with every mistake of the route (264 to 312 runs), and 40 legitimate records."""
    accepted, doubted = [], 0
    for seed in range(40):
        robot = ("tx40", "irb120")[seed % 2] if route == "sag" else "tx40"
        if route == "sag":
            of_sag = sag(robot, seed)
            doubted += bool(sag_answer(of_sag))
            answers = {name: sag_answer(change(of_sag, of_seed(seed))) for name, change in OF_SAG.items() if seed < 24}
        else:
            record = poses(robot, seed)
            doubted += bool(payload_answer(record, tmp_path, route))  # type: ignore[arg-type]
            answers = {
                name: payload_answer(change(record, of_seed(seed)), tmp_path, route)  # type: ignore[arg-type]
                for name, change in ROUTES[route].items()
                if seed < 24
            }
        accepted += [(robot, seed, name) for name, said in answers.items() if not said]
    assert accepted == [] and doubted_no_more_than_the_level(doubted, 40)
