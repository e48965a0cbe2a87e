"""The file of an arm's drives: gear ratios, couplings and gains, and what cannot be."""

from pathlib import Path

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.extensions.dynamics.load_files import read_load
from lab.formats.drives_toml import drives_lines, read_drives
from lab.kinematics.dynamics.rigid_body import inertia_about_centre

TWO = "[[drive]]\ngear_ratio = -48\ntorque_nm_per_a = 0.2\n[[drive]]\ngear_ratio = 32\ntorque_nm_per_a = 0.1\n"
COUPLED = TWO + "[[coupling]]\ndrive = 2\njoint = 1\nratio = 16\n"
LOAD = "[load]\nmass_kg = 1.5\ncom_mm = [10, -5, 60]\ninertia_kgcm2 = [22.5, 26, 12.5, 0, 0, 0]\n"


def test_currents_become_torques_and_couplings_ratios(tmp_path: Path) -> None:
    path = tmp_path / "drives.toml"
    path.write_text(COUPLED)
    drives = read_drives(path, 2)
    np.testing.assert_allclose(drives.torques(np.array([[1.0, 2.0]])), [[-9.6, 6.4]])
    np.testing.assert_allclose(drives.couplings, [[1, 0], [0.5, 1]])
    (tmp_path / "again.toml").write_text("\n".join(drives_lines(drives)), encoding="utf-8")
    again = read_drives(tmp_path / "again.toml", 2)
    np.testing.assert_allclose(again.couplings, drives.couplings)
    np.testing.assert_array_equal(again.gear_ratio, drives.gear_ratio)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (TWO.replace("48", "0"), "gear_ratio is 0"),
        (TWO.split("[[drive]]\ngear_ratio = 32")[0], r"1 \[\[drive\]\], but the robot has 2 joints"),
        (TWO.replace("torque_nm_per_a = 0.1\n", ""), r"2 has no torque_nm_per_a"),
        (COUPLED.replace("joint = 1", "joint = 3"), "from 1 to 2"),
        (COUPLED.replace("joint = 1", "joint = 2"), "give this ratio as its gear_ratio"),
        (COUPLED.replace("ratio = 16", "turns = 16"), "turns"),
        ("drive = 3\n", "drive"),
    ],
)
def test_what_cannot_be_is_refused(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "drives.toml"
    path.write_text(text)
    with pytest.raises(LabError, match=says):
        read_drives(path, 2)


def test_currents_need_gains(tmp_path: Path) -> None:
    path = tmp_path / "drives.toml"
    path.write_text("[[drive]]\ngear_ratio = 3\n")
    with pytest.raises(LabError, match="torque_nm_per_a"):
        read_drives(path, 1).torques(np.ones((1, 1)))


def test_a_known_load(tmp_path: Path) -> None:
    path = tmp_path / "load.toml"
    path.write_text(LOAD)
    phi = read_load(path)
    np.testing.assert_allclose(phi[:4], [1.5, 0.015, -0.0075, 0.09])
    np.testing.assert_allclose(inertia_about_centre(phi), np.diag([22.5, 26, 12.5]) * 1e-4, atol=1e-15)
    for text, says in ((LOAD.replace("1.5", "-1"), "no body"), (LOAD.replace("[10, -5, 60]", "[10]"), "give 3")):
        path.write_text(text)
        with pytest.raises(LabError, match=says):
            read_load(path)


def test_motor_positions_become_joint_positions(tmp_path: Path) -> None:
    """Motors turn G C q beside where they are at zero, as encoders count it."""
    path = tmp_path / "drives.toml"
    text = COUPLED.replace("gear_ratio = 32\n", "gear_ratio = 32\ncounts_per_turn = 4096\nmotor_zero_deg = 90\n")
    path.write_text(text.replace("gear_ratio = -48\n", "gear_ratio = -48\ncounts_per_turn = 4096\n"))
    drives, joints = read_drives(path, 2), np.array([[0.3, -0.2], [0.0, 0.0]])
    motors = np.array([[-48 * 0.3, 32 * -0.2 + 16 * 0.3 + np.pi / 2], [0.0, np.pi / 2]])
    np.testing.assert_allclose(drives.joints(motors), joints, atol=1e-15)
    assert drives.encoders is not None
    counts = joints @ drives.encoders.counts.T
    np.testing.assert_allclose(counts * 2 * np.pi / 4096 + [0, np.pi / 2], motors, atol=1e-12)
    (tmp_path / "again.toml").write_text("\n".join(drives_lines(drives)), encoding="utf-8")
    np.testing.assert_allclose(read_drives(tmp_path / "again.toml", 2).joints(motors), joints, atol=1e-15)


def test_couplings_that_tell_no_joint(tmp_path: Path) -> None:
    path = tmp_path / "drives.toml"
    path.write_text(COUPLED.replace("ratio = 16", "ratio = 32") + "[[coupling]]\ndrive = 1\njoint = 2\nratio = -48\n")
    with pytest.raises(LabError, match="are not independent"):
        read_drives(path, 2).joints(np.ones((1, 2)))
