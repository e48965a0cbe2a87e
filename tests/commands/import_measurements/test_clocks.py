"""Two clocks: the offset between a tracker's and a controller's is found from the data, or the pair is refused."""

import re
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.joint_log import JointLog
from lab.formats.tracker_export import TrackerPoints
from lab.library.log_clocks import NominalFit
from lab.library.log_matching import Matching, matched, settled_windows
from lab.options.command_options import ImportOptions
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot

ROBOTS = ("irb120", "ur5", "ur10", "panda", "rx130", "tx40")
PATTERNS = ("equal", "uneven", "long", "short moves")
FLAG = re.compile(r"--clock-offset-s (\S+?)(?: --clock-drift-ppm (\S+?))? (?:would place|places) ")


@dataclass(frozen=True)
class Pair:
    """A log and an export of one session; ``truth`` is the joint position at which each point was measured."""

    robot: Robot
    points: TrackerPoints
    log: JointLog
    truth: Array
    offset_s: float
    drift_ppm: float

    def matched(self, offset_s: float | None = None, drift_ppm: float = 0.0) -> Matching:
        """What `lab import --by time` makes of it."""
        options = ImportOptions(Path("points"), Path("log"), by="time", clock_offset_s=offset_s,
                                clock_drift_ppm=drift_ppm)  # fmt: skip
        nominal = NominalFit(self.robot, ("p1",), self.points.positions)
        return matched(options, self.points, self.log, self.robot.chain.prismatic, nominal)

    def wrong(self, found: Matching) -> int:
        """How many points were given the joints of another pose."""
        rows = [(pose.joints, row) for pose in found.poses for row in pose.points.values()]
        return sum(bool(np.abs(joints - self.truth[row]).max() > 1e-3) for joints, row in rows)


def session(
    seed: int,
    *,
    pattern: str | None = None,
    offset_s: float | None = None,
    drift_ppm: float | None = None,
    poses: int | None = None,
    joints: Array | None = None,
    robot: str | None = None,
    lost: float | None = None,
) -> Pair:
    """A session of an arm that is off by millimetres; what is not given is drawn."""
    rng = np.random.default_rng(seed)
    pattern = pattern or PATTERNS[seed % len(PATTERNS)]
    known = load_robot(robot or ROBOTS[seed % len(ROBOTS)])
    offset_s = rng.uniform(0, 60) * rng.choice([-1, 1]) if offset_s is None else offset_s
    drift_ppm = rng.uniform(-100, 100) if drift_ppm is None else drift_ppm
    joints = known.chain.random_joints(poses or int(rng.integers(8, 50)), rng) if joints is None else joints
    arm = known.arm(("p1",))
    truth = arm.nominal({"p1": rng.uniform(-0.1, 0.1, 3)})
    truth[:6] = [*rng.uniform(-3, 3, 3), *rng.uniform(-1, 1, 3)]
    truth[6:-3] += 1e-3 * rng.standard_normal(len(truth) - 9)
    # the controller's clock
    count = len(joints)
    stand, move = {
        "equal": (np.full(count, 4.0), np.full(count, 2.0)),
        "uneven": (rng.uniform(2, 12, count), rng.uniform(1, 5, count)),
        "long": (rng.uniform(5, 120, count), rng.uniform(5, 60, count)),
        "hours": (np.full(count, 1.3), np.full(count, 240.0)),
        "short moves": (np.full(count, 2.0), np.full(count, 0.8)),
    }[pattern]
    ends = 1.7e9 + np.cumsum(stand + move)
    starts = ends - stand
    knots = np.stack([starts, ends], axis=1).ravel()
    times = np.arange(starts[0] - 3, ends[-1] + 3, 0.5 if pattern == "long" else 0.1)
    if pattern == "hours":  # that the log records from a second before to a second after each stand
        times = np.concatenate([np.arange(start - 1, end + 1, 0.1) for start, end in zip(starts, ends, strict=True)])
    logged = np.stack([np.interp(times, knots, np.repeat(q, 2)) for q in joints.T], axis=1)
    logged += rng.uniform(-1e-5, 1e-5, logged.shape)
    # the tracker's
    double = rng.choice([0.0, 0.1]) if lost is None else 0.0
    lost = rng.choice([0.0, 0.1, 0.3]) if lost is None else lost
    kept = np.flatnonzero(rng.random(count) >= lost)
    kept = np.sort(np.concatenate([kept, kept[rng.random(len(kept)) < double]]))
    share = rng.uniform(0.3, 0.7, len(kept)) if rng.random() < 0.5 else np.full(len(kept), 0.5)
    measured_at = np.sort(starts[kept] + share * stand[kept])
    positions = arm.points(joints[kept], truth)[:, 0] + 1e-5 * rng.standard_normal((len(kept), 3))
    clock = measured_at + offset_s + 1e-6 * drift_ppm * (measured_at - measured_at[0])
    none = np.full(len(kept), np.nan)
    points = TrackerPoints(
        Path("points"), tuple(f"P{i}" for i in range(len(kept))), ("",) * len(kept), tuple(range(1, len(kept) + 1)),
        positions, none, clock, "date", none, none, none, {}, (), (), (),
    )  # fmt: skip
    log = JointLog(Path("log"), ("",) * len(times), tuple(range(1, len(times) + 1)), logged, times, "date", {}, ())
    return Pair(known, points, log, joints[kept], offset_s, drift_ppm)


def outcome(pair: Pair) -> str:
    """What becomes of a pair whose user gives no offset, then the one that the error proposes."""
    try:
        found = pair.matched()
    except LabError as error:
        proposed = FLAG.findall(str(error))
        if not proposed or "fit both" in str(error):
            return "refused"
        offset, drift = proposed[-1]
        try:
            found = pair.matched(float(offset), float(drift or 0))
        except LabError as again:
            return f"refused its own proposal: {again}"
        if abs(float(offset) - pair.offset_s) > 5 and not pair.wrong(found):
            return "right by chance"
    if wrong := pair.wrong(found):
        return f"{wrong} wrong"
    enough = sum(len(pose.points) for pose in found.poses) >= 0.9 * len(pair.truth)
    return "right" if enough else "right, with few"


def outcomes(seeds: range) -> Counter[str]:
    return Counter(outcome(session(seed)) for seed in seeds)


def test_pairs_of_logs_are_matched_right_or_refused() -> None:
    found = outcomes(range(2))
    assert found == {"right": 2}, found


@pytest.mark.slow
def test_two_hundred_pairs_of_logs_are_matched_right_or_refused() -> None:
    """Offsets to 60 s, drifts to 100 ppm, missing and double points, four patterns of dwell: none silently wrong."""
    found = outcomes(range(1000, 1200))
    assert set(found) <= {"right", "refused"} and found["right"] >= 180, found


@pytest.mark.slow
def test_any_given_offset_is_right_or_refused() -> None:
    """The user gives a wrong offset: whatever is accepted has no point at another pose."""
    accepted = 0
    for seed in range(2000, 2060):
        pair = session(seed, offset_s=0.0)
        try:
            found = pair.matched(float(np.random.default_rng(seed).uniform(-20, 20)))
        except LabError:
            continue
        accepted += 1
        assert pair.wrong(found) == 0, seed
    assert accepted < 30


def test_clocks_that_agree_need_no_option() -> None:
    for pattern in ("equal", "uneven"):
        pair = session(5, pattern=pattern, offset_s=0.0, drift_ppm=20.0, poses=12, lost=0.1)
        found = pair.matched()
        assert pair.wrong(found) == 0 and len(found.poses) == len(pair.truth)
        assert found.timeline is not None and found.timeline.placed.rms_m < 0.01


def test_a_given_offset_that_is_a_stop_off_is_refused() -> None:
    pair = session(4, pattern="equal", offset_s=7.3, drift_ppm=0.0, poses=18, lost=0.0)
    with pytest.raises(LabError, match=r"13.3 places 17 of 18; .*7.3 places 18 of 18"):
        pair.matched(13.3)
    assert pair.wrong(pair.matched(7.3)) == 0


def test_a_tour_that_is_repeated_is_ambiguous() -> None:
    """Three rounds of eight poses in the log, points of one: the nominal arm cannot tell which round it was."""
    known = load_robot("irb120")
    once = known.chain.random_joints(8, np.random.default_rng(3))
    pair = session(
        8, pattern="equal", offset_s=0.0, drift_ppm=0.0, joints=np.tile(once, (3, 1)), robot="irb120", lost=0
    )
    points, near = pair.points, list(range(8, 16))
    few = replace(
        points, names=("P",) * 8, targets=("",) * 8, lines=tuple(near), positions=points.positions[near],
        seconds=points.seconds[near],
    )  # fmt: skip
    part = replace(pair, points=few, truth=pair.truth[near])
    with pytest.raises(LabError, match="fit both; give --clock-offset-s 0"):
        part.matched()
    assert part.wrong(part.matched(0.0)) == 0


def test_too_few_poses_need_the_offset() -> None:
    pair = session(12, pattern="equal", offset_s=0.0, drift_ppm=0.0, poses=4, lost=0.0)
    with pytest.raises(LabError, match="fit both"):
        pair.matched()
    assert pair.wrong(pair.matched(0.0)) == 0


def test_a_point_of_something_else_is_left_out() -> None:
    pair = session(5, pattern="equal", offset_s=0.0, drift_ppm=0.0, poses=12, lost=0.0)
    pair.points.positions[3] += [0.3, 0.0, 0.0]
    found = pair.matched()
    assert [pose.points["p1"] for pose in found.poses] == [i for i in range(12) if i != 3]
    assert [each.what for each in found.left_out if "from the nominal arm in the pose" in each.why] == ["P3"]


def test_points_of_another_session_are_refused() -> None:
    pair = session(6, pattern="equal", offset_s=0.0, poses=12, lost=0.0)
    other = session(60, pattern="equal", offset_s=0.0, poses=12, lost=0.0)
    mixed = replace(pair, points=replace(other.points, seconds=other.points.seconds))
    with pytest.raises(LabError, match="no offset of the clocks"):
        mixed.matched()


def test_a_drift_that_loses_points_is_proposed() -> None:
    """Two hours of short stands: no single offset places all points, an offset with a drift does."""
    pair = session(2, pattern="hours", offset_s=7.3, drift_ppm=100.0, poses=30, lost=0.0)
    with pytest.raises(LabError, match=r"--clock-drift-ppm \S+ (would place|places) 30 of 30") as error:
        pair.matched()
    offset, drift = FLAG.findall(str(error.value))[-1]
    with pytest.raises(LabError, match="--clock-drift-ppm"):
        pair.matched(float(offset))
    found = pair.matched(float(offset), float(drift))
    assert pair.wrong(found) == 0 and len(found.poses) == 30


def test_a_log_with_gaps_between_stands_has_a_pose_for_each() -> None:
    """Rows only while the arm stands: without rows of the motion, joints that differ are different poses."""
    joints = np.repeat([[0.0] * 6, [0.3] * 6, [0.3] * 6], 20, axis=0)
    times = np.concatenate([start + 0.1 * np.arange(20) for start in (0.0, 500.0, 510.0)])
    log = JointLog(Path("log"), ("",) * 60, tuple(range(1, 61)), joints, times, "seconds", {}, ())
    found = settled_windows(log, (False,) * 6, 0.1, 0.5)
    assert found.lines == (1, 21) and np.allclose(found.joints[:, 0], [0.0, 0.3], atol=1e-12)
    assert found.ends[1] == times[-1]
