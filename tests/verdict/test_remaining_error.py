"""The remaining error taken apart, where it is known who made it."""

from dataclasses import replace

import numpy as np
import pytest

from lab.core.se3 import Array
from lab.noise.error_model import ErrorModel
from lab.verdict.remaining_error import RemainingError, remaining_error

POSES = 150


def taken_apart(made: Array, seed: int, instrument_m: float, shared: ErrorModel | None = None) -> RemainingError:
    """Of residuals ``(n, 1, 3)`` of so many poses, in the order in which they were made."""
    joints = np.random.default_rng(seed).uniform(-1, 1, (POSES, 3))
    slopes = np.broadcast_to(np.eye(3), (POSES, 1, 3, 3))
    found = remaining_error(
        made,
        joints,
        np.arange(POSES, dtype=float),
        made.size,
        instrument_m=instrument_m,
        shared=shared,
        scatter_slopes=slopes,
    )
    assert found is not None
    return found


def noise(seed: int, sigma: float = 1e-5) -> Array:
    return sigma * np.random.default_rng(100 + seed).standard_normal((POSES, 1, 3))


def test_the_instruments_noise_is_the_instruments() -> None:
    found = [taken_apart(noise(seed), seed, 1e-5) for seed in range(10)]
    assert sum(each.is_explained for each in found) >= 8
    shown = [alike.is_shown for each in found for alike in (each.over_joints, each.over_time) if alike is not None]
    assert len(shown) == 20 and sum(shown) <= 2


def test_a_rest_that_follows_the_joints_is_the_arms() -> None:
    joints = np.random.default_rng(1).uniform(-1, 1, (POSES, 3))
    arm = 4e-5 * np.sin(2 * joints)[:, None]
    found = taken_apart(noise(1) + arm, 1, 1e-5)
    assert found.over_joints is not None and found.over_joints.is_shown and found.over_joints.correlation > 0.4
    assert found.over_time is not None and not found.over_time.is_shown
    assert found.rest_m == pytest.approx(np.sqrt((arm**2).mean()), rel=0.1)
    assert found.measure_next != replace(found, searched=True).measure_next


def test_a_rest_that_follows_the_time_is_told() -> None:
    walk = np.cumsum(1e-5 * np.random.default_rng(2).standard_normal((POSES, 1, 3)), axis=0)
    found = taken_apart(noise(2) + walk - walk.mean(axis=0), 2, 1e-5)
    assert found.over_time is not None and found.over_time.correlation > 0.7


def test_what_poses_share_has_its_part() -> None:
    shared = ErrorModel(1e-5, 1.0, {"scatter": 3e-5}, None, {})
    found = taken_apart(noise(3) + noise(33, 3e-5), 3, 1e-5, shared)
    assert found.shared_m == pytest.approx(3e-5) and found.is_explained
    unknown = taken_apart(noise(3), 3, float("nan"))
    assert not unknown.is_explained


def test_gaps_and_a_fit_without_anything_left_are_no_error() -> None:
    made = noise(4)
    made[:3] = np.nan
    assert taken_apart(made, 4, 1e-5).total_m == pytest.approx(1e-5 * np.sqrt(147 / 150), rel=0.1)
    slopes, joints = np.zeros((5, 1, 3, 2)), np.zeros((5, 2))
    nothing = {"instrument_m": 1e-5, "shared": None, "scatter_slopes": slopes}
    assert remaining_error(np.zeros((5, 1, 3)), joints, np.arange(5.0), 3, **nothing) is None
    assert remaining_error(made[:5], joints, np.arange(5.0), 0, **nothing) is None
