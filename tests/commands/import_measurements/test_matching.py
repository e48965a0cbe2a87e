"""Which pose each point belongs to: against looking at every pair, and of very many points."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.formats.joint_log import JointLog
from lab.formats.tracker_export import TrackerPoints
from lab.library.log_matching import matched
from lab.options.command_options import ImportOptions

MANY = 20_000


def files(at: np.ndarray, poses_at: np.ndarray, clocks=("seconds", "seconds"), prefix=("P", "P")):
    """Points and poses at times (s), called by their numbers."""
    n, k = len(at), len(poses_at)
    none = np.full(n, np.nan)
    points = TrackerPoints(
        Path("points"), tuple(f"{prefix[0]}{i}" for i in range(n)), ("",) * n, tuple(range(1, n + 1)), np.ones((n, 3)),
        none, at, clocks[0], none, none, none, {}, (), (), (),
    )  # fmt: skip
    log = JointLog(
        Path("poses"), tuple(f"{prefix[1]}{i}" for i in range(k)), tuple(range(1, k + 1)), np.zeros((k, 6)), poses_at,
        clocks[1], {}, (),
    )  # fmt: skip
    return points, log


def options(by, **others) -> ImportOptions:
    return ImportOptions(Path("points"), Path("poses"), by=by, **others)


@pytest.mark.parametrize("seed", range(4))
def test_points_find_the_nearest_moment_as_by_all_pairs(seed) -> None:
    rng = np.random.default_rng(seed)
    poses_at = np.sort(rng.uniform(0, 100, 12).round())  # some at once, and two not in their order
    poses_at[[3, 8]] = poses_at[[8, 3]]
    at = rng.uniform(-5, 105, 30).round(1)
    at[rng.random(30) < 0.1] = np.nan
    found = matched(options("time"), *files(at, poses_at), (False,) * 6)
    apart, gap = np.abs(at[:, None] - poses_at), abs(np.median(np.diff(poses_at)))
    expected = {
        k: [i for i in range(30) if np.isfinite(at[i]) and apart[i].argmin() == k and apart[i, k] <= gap / 2]
        for k in range(12)
    }
    by_pose = [(pose.name, pose.points["p1"]) for pose in found.poses]
    assert [rows for _, rows in by_pose] == [i for k in range(12) for i in expected[k]]
    lost = {each.what for each in found.left_out if each.why == "no point was measured at this pose"}
    assert lost == {f"pose {k + 1}" for k in range(12) if not expected[k]}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("by", ["name", "time"])
def test_very_many_points_find_their_poses(by) -> None:
    """All pairs of points and poses would take 3 GB: the work grows with their number, not with its square."""
    at = 10.0 * np.arange(MANY)
    tracemalloc.start()
    found = matched(options(by), *files(at + 1, at), (False,) * 6)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 100e6  # bytes
    assert [pose.points["p1"] for pose in found.poses] == list(range(MANY)) and not found.left_out


def test_many_poses_with_other_names_and_clocks_are_refused() -> None:
    at = 10.0 * np.arange(MANY)
    with pytest.raises(LabError, match="no point has the name of a pose"):
        matched(options("name"), *files(at, at, prefix=("A", "B")), (False,) * 6)
    with pytest.raises(LabError, match=r"--clock-offset-s [0-9]+ would place 20 of 20"):
        matched(options("time"), *files(at[:20] + 5e6, at), (False,) * 6)
