"""What a recording shows: magnified ellipsoids, legs, and the arm's lines."""

import os
from pathlib import Path

import numpy as np
import pytest
from helpers.robots import RX130
from hypothesis import given
from hypothesis import strategies as st

from lab.core import se3
from lab.kinematics.serial.serial_arm import SerialArm
from lab.report.document import plain
from lab.report.recording import recording_to
from lab.report.scene import (
    MOST_POSES,
    Legs,
    drawn_rows,
    legs_legend,
    magnification,
    moved,
    reach_of,
    skeleton,
    world_legs,
)
from lab.robots.load_robot import load_robot


@given(st.floats(1e-9, 1e3), st.floats(1e-3, 1e3))
def test_a_magnification_is_round_and_the_nearest(length: float, wanted: float) -> None:
    """1, 2, 5 times a power of ten: the size drawn is within a factor sqrt(2.5) of what is wanted."""
    factor = magnification(length, wanted)
    assert 1 / 1.59 < factor * length / wanted < 1.59
    assert float(f"{factor:e}".split("e")[0]) in (1.0, 2.0, 5.0)


@pytest.mark.parametrize("length", [0.0, np.nan, np.inf])
def test_nothing_is_not_magnified(length: float) -> None:
    assert magnification(length, 1.0) == 1.0


@given(st.integers(1, 5000))
def test_the_rows_that_are_drawn(count: int) -> None:
    rows = drawn_rows(count)
    assert len(rows) == len(set(rows.tolist())) == min(count, MOST_POSES)
    assert rows[0] == 0 and rows[-1] == count - 1


def test_an_arms_lines_end_at_its_frames() -> None:
    arm, joints = SerialArm(RX130, ("p1",)), RX130.random_joints(3, np.random.default_rng(0))
    values = arm.nominal()
    found = skeleton(arm, values, joints)
    assert len(found.lines) == 1 and found.lines[0].shape[::2] == (3, 3) and found.measured == ()
    np.testing.assert_allclose(found.lines[0][:, -1], found.frames[:, -1], atol=1e-12)
    assert found.origins.shape[0] == 3
    turned = values.copy()
    turned[:6] = 0.3
    np.testing.assert_allclose(skeleton(arm, turned, joints).lines[0], found.lines[0], atol=1e-12)  # whatever the base


def test_legs_of_a_mechanism_in_the_world() -> None:
    robot = load_robot("rpr2")
    arm = robot.arm(("p1",))
    joints, T = robot.chain.random_joints(4, np.random.default_rng(0)), robot.model.T_world_frame0
    found = world_legs(T, arm, arm.nominal(robot.tool), joints)
    lengths = np.linalg.norm(found.ends[:, :, 1] - found.ends[:, :, 0], axis=2)
    np.testing.assert_allclose(lengths[:, np.array(found.measured)], joints, atol=1e-9)
    assert "length is a joint position" in plain(legs_legend(found)) and legs_legend(Legs(found.ends[:, :0], ())) == ""
    assert reach_of(T, found.ends, found) == pytest.approx(np.linalg.norm(found.ends - T[:3, 3], axis=-1).max())
    np.testing.assert_allclose(moved(T, found.ends)[0, 0, 0], se3.transform(T, found.ends[0, 0, :1])[0])


@pytest.mark.figures
def test_a_recording_is_written_where_rerun_is_turned_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The variable turns off what a program logs to a viewer; the file is asked for."""
    monkeypatch.setenv("RERUN", "0")
    with recording_to(tmp_path / "off.rrd", "irb120", "0123456789abcdef"):
        assert os.environ["RERUN"] == "0"
    assert (tmp_path / "off.rrd").stat().st_size > 1000  # without content there would be none
    assert capfd.readouterr() == ("", "")
