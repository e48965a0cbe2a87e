"""`lab import` of ROS joint states and corners in pictures: a simulated campaign comes back and identifies the same."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

import lab
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.formats.joint_log import read_joint_log
from lab.formats.loose_table import JointColumns

POSES, START, AHEAD = 14, 1_700_000_000, 2.5
NAMES = tuple(f"joint_{j}" for j in range(1, 7))
ORDER = (2, 0, 1, 5, 3, 4)  # joint states are often not in the order of the arm
CAMERAS = """[[camera]]
name = "wrist"
fixed_to = "hand"
[[board]]
name = "table"
columns = 6
rows = 4
square_mm = 30.0
fixed_to = "world"
"""


@pytest.fixture(scope="module")
def cameras(tmp_path_factory: pytest.TempPathFactory) -> Path:
    (file := tmp_path_factory.mktemp("rig") / "cameras.toml").write_text(CAMERAS)
    return file


@pytest.fixture(scope="module")
def campaign(cameras: Path) -> Measurements:
    return lab.simulate("irb120", observe="pixels", cameras=cameras, poses=POSES, seed=3).measurements


def log_of(poses: Array) -> tuple[Array, Array]:
    """A log of 10 rows a second: rests of unequal length and straight moves; times and joints."""
    rests = np.random.default_rng(1).integers(12, 40, len(poses))
    parts = []
    for k, pose in enumerate(poses):
        parts.append(np.tile(pose, (rests[k], 1)))
        if k + 1 < len(poses):
            parts.append(pose + np.linspace(0, 1, 17)[1:-1, None] * (poses[k + 1] - pose))
    joints = np.concatenate(parts)
    return 0.1 * np.arange(len(joints)), joints


def rostopic(path: Path, at: Array, joints: Array, names: Sequence[str] = NAMES) -> Path:
    head = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
    head += [f"field.name{k}" for k in range(6)] + [f"field.position{k}" for k in range(6)]
    rows = [[f"{round((START + t + 0.02) * 1e3)}000000", i, f"{round((START + t) * 1e3)}000000", "",
             *(names[j] for j in ORDER), *map(repr, q[list(ORDER)].tolist())]
            for i, (t, q) in enumerate(zip(at, joints, strict=True))]  # fmt: skip
    return written(path, head, rows)


def bagpy(path: Path, at: Array, joints: Array) -> Path:
    head = ["Time", "header.seq", "header.stamp.secs", "header.stamp.nsecs", "header.frame_id", "name"]
    head += [f"position_{k}" for k in range(6)]
    listed = '"[' + ", ".join(f"'{NAMES[j]}'" for j in ORDER) + ']"'
    rows = [[START + t + 0.02, i, *stamp(t), "", listed, *map(repr, q[list(ORDER)].tolist())]
            for i, (t, q) in enumerate(zip(at, joints, strict=True))]  # fmt: skip
    return written(path, head, rows)


def ros2_echo(path: Path, at: Array, joints: Array) -> Path:
    rows = [[*stamp(t), "base_link", *(NAMES[j] for j in ORDER), *map(repr, q[list(ORDER)].tolist()), *["0.0"] * 12]
            for t, q in zip(at, joints, strict=True)]  # fmt: skip
    return written(path, None, rows)


def plotjuggler(path: Path, at: Array, joints: Array) -> Path:
    head = ["__time", *(f"/joint_states/{NAMES[j]}/position" for j in ORDER)]
    head += [f"/joint_states/{name}/velocity" for name in NAMES]
    rows = [[f"{START + t:.6f}", *map(repr, q[list(ORDER)].tolist()), *["0.0"] * 6]
            for t, q in zip(at, joints, strict=True)]  # fmt: skip
    return written(path, head, rows)


def stamp(t: float) -> tuple[int, int]:
    ms = round(1000 * t)
    return START + ms // 1000, ms % 1000 * 1_000_000


def written(path: Path, head: Sequence[str] | None, rows: Sequence[Sequence[object]]) -> Path:
    lines = [",".join(map(str, row)) for row in ([head] if head else []) + list(rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


WRITERS = {each.__name__: each for each in (rostopic, bagpy, ros2_echo, plotjuggler)}


def rests_of(at: Array, joints: Array, poses: Array) -> Array:
    """The middle of the rest at each pose."""
    return np.array([at[(joints == pose).all(axis=1)].mean() for pose in poses])


def corners(path: Path, data: Measurements, moments: Array, ahead: float = 0.0) -> Path:
    """A row for each corner; stamps are those of the camera's clock."""
    _, pose = np.unique(data.joints, axis=0, return_inverse=True)
    rows = [[*stamp(moments[pose[i]] + ahead), data.other["corner"][i], *(repr(float(data.conditions[c][i])) for c in
             ("u_px", "v_px")), data.other["camera"][i], data.other["board"][i]] for i in range(len(data))]  # fmt: skip
    return written(path, ["header.stamp.sec", "header.stamp.nanosec", "corner", "u", "v", "camera", "board"], rows)


@pytest.mark.parametrize("export", WRITERS.values(), ids=WRITERS.keys())
def test_exports_of_joint_states_are_read(export: Callable[..., Path], tmp_path: Path) -> None:
    at, joints = log_of(np.random.default_rng(2).uniform(-1.5, 1.5, (3, 6)))
    log = read_joint_log(export(tmp_path / "js.csv", at, joints), tuple(f"q{j}" for j in range(1, 7)), (False,) * 6,
                         JointColumns(), None)  # fmt: skip
    np.testing.assert_array_equal(log.joints, joints)
    np.testing.assert_allclose(log.seconds, START + at, atol=1e-6)
    assert log.clock == "date"


@pytest.mark.thorough
@pytest.mark.sampled(2)
@pytest.mark.parametrize("ahead", [AHEAD, 0.0])
def test_a_campaign_comes_back_and_identifies_the_same(
    ahead: float, campaign: Measurements, cameras: Path, tmp_path: Path
) -> None:
    poses = np.unique(campaign.joints, axis=0)
    at, joints = log_of(poses)
    log = rostopic(tmp_path / "joint_states.csv", at, joints)
    seen = corners(tmp_path / "corners.csv", campaign, rests_of(at, joints, poses), ahead)
    result = lab.import_measurements(seen, "irb120", joints=log, clock_offset_s=ahead)
    assert result.matching.by == "time" and result.to_dict()["points"] == len(campaign) and result.left_out == ()
    result.save(tmp_path / "run")
    options = {"observe": "pixels", "cameras": cameras}
    found = lab.identify(tmp_path / "run" / "measurements.csv", "irb120", **options)
    truth = lab.identify(campaign, "irb120", **options)
    np.testing.assert_allclose(found.identification.values, truth.identification.values, atol=1e-8)
    assert found.verdict.word == truth.verdict.word


def test_pictures_in_motion_are_left_out_and_a_wrong_clock_is_refused(campaign: Measurements, tmp_path: Path) -> None:
    poses = np.unique(campaign.joints, axis=0)
    at, joints = log_of(poses)
    log, moments = rostopic(tmp_path / "joint_states.csv", at, joints), rests_of(at, joints, poses)
    with pytest.raises(LabError, match=r"taking the two clocks for one .*--clock-offset-s 2\.\d* places 14 of 14"):
        seen = corners(tmp_path / "late.csv", campaign, moments, AHEAD)
        lab.import_measurements(seen, "irb120", joints=log)
    moments[4] = at[np.flatnonzero((joints == poses[4]).all(axis=1))[-1]] + 0.8  # half way to the next
    result = lab.import_measurements(
        corners(tmp_path / "moved.csv", campaign, moments), "irb120", joints=log, clock_offset_s=0.0
    )
    assert len(result.matching.poses) == POSES - 1
    assert sorted(each.what.split()[0] for each in result.left_out) == ["picture", "pose"]
    assert not (result.measurements.joints == poses[4]).all(axis=1).any()


def test_options_of_points_are_refused(campaign: Measurements, tmp_path: Path) -> None:
    poses = np.unique(campaign.joints, axis=0)
    at, joints = log_of(poses)
    log = rostopic(tmp_path / "joint_states.csv", at, joints)
    seen = corners(tmp_path / "corners.csv", campaign, rests_of(at, joints, poses))
    for options in ({"unit": "mm"}, {"station": "west"}, {"targets": ("p1", "p2")}, {"coverage": 2.0}):
        with pytest.raises(LabError, match=f"corners in pictures; leave out .*{next(iter(options))}"):
            lab.import_measurements(seen, "irb120", joints=log, **options)


def test_joint_states_that_name_no_joint_or_others_are_refused(tmp_path: Path) -> None:
    at, joints = log_of(np.random.default_rng(2).uniform(-1.5, 1.5, (3, 6)))

    def refusal(text: str) -> str:
        (file := tmp_path / "js.csv").write_text(text)
        with pytest.raises(LabError) as refused:
            read_joint_log(file, tuple(f"q{j}" for j in range(1, 7)), (False,) * 6, JointColumns(), None)
        return str(refused.value)

    text = rostopic(tmp_path / "right.csv", at, joints).read_text()
    assert "no joint is q3 (the file names elbow, joint_1" in refusal(text.replace("joint_3", "elbow"))
    lines = text.splitlines()
    lines[7] = lines[7].replace("joint_1", "other").replace("joint_2", "joint_1").replace("other", "joint_2")
    assert "line 8: joints are named in another order" in refusal("\n".join(lines))
    nameless = bagpy(tmp_path / "bag.csv", at, joints).read_text()
    assert "no column names their joints" in refusal(re.sub(r',"\[.*?\]"', ",0", nameless.replace(",name,", ",n,")))
    assert "line 3, column field.header.stamp: 'now'" in refusal(text.replace(f"{START}100000000", "now", 1))
    degrees = rostopic(tmp_path / "deg.csv", at, np.rad2deg(joints)).read_text()
    assert "which are degrees; give" in refusal(degrees)
