"""Sections [Z] and [E] of a robot's table, and what they come back as."""

from pathlib import Path

import numpy as np
import pytest

import lab
from lab.core.errors import LabError
from lab.formats.robot_toml import read_table
from lab.kinematics.serial.khalil_frames import pose_of

SIX = {"gamma_deg": 30.0, "b_mm": 400.0, "alpha_deg": 60.0, "d_mm": 50.0, "theta_deg": -20.0, "r_mm": 80.0}
ARM = 'name = "arm"\nconvention = "craig"\n' + "".join(
    f"[[joint]]\ntheta_deg = 0\nd_mm = {d}\na_mm = 0\nalpha_deg = {alpha}\nlower_deg = -90\nupper_deg = 90\n"
    for d, alpha in ((0, 0), (100, 90))
)


def section(name: str, values: dict[str, float]) -> str:
    return f"[{name}]\n" + "".join(f"{key} = {value!r}\n" for key, value in values.items())


@pytest.fixture
def table(tmp_path: Path) -> Path:
    path = tmp_path / "arm.toml"
    point = {**SIX, "theta_deg": 0.0, "alpha_deg": 0.0}
    path.write_text(ARM + section("Z", SIX) + section("E.p1", SIX) + section("E.p2", point))
    return path


def test_z_places_the_arm_and_e_its_targets(table: Path) -> None:
    radians = np.array([np.deg2rad(v) if key.endswith("deg") else v / 1e3 for key, v in SIX.items()])
    robot = lab.load_robot(table)
    np.testing.assert_allclose(robot.T_world_frame0, pose_of(radians), atol=1e-15)
    np.testing.assert_allclose(robot.tool["p1"], pose_of(radians)[:3, 3], atol=1e-15)
    assert [warning for warning in read_table(table).warnings if "[E.p1]: its orientation is not used" in warning]


def test_inspect_gives_back_what_was_written(table: Path) -> None:
    values = lab.inspect(table, targets=("p1", "p2")).to_dict()["khalil"]
    assert {key: values["Z"][key] for key in SIX} == pytest.approx(SIX, abs=1e-8) and values["Z"]["note"] is None
    assert "only b + r is determined" in values["E.p2"]["note"]
    assert values["E.p2"]["b_mm"] == pytest.approx(480.0)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("gamma_deg = 30.0\n", "", r"\[Z\]: gamma is missing; give gamma_rad or _deg"),
        ("gamma_deg", "gamma_grad", r"\[Z\]: gamma is missing"),
        ("r_mm = 80.0\n[E", "r_mm = 80.0\nq_mm = 1\n[E", r"\[Z\]: unknown key 'q_mm'; known are gamma, b, alpha"),
        ("[Z]", "height_mm = 5\n[Z]", "unknown key 'height_mm'"),
        ('convention = "craig"', 'convention = "craig"\nheight_mm = 5', r"height_mm and \[Z\] both set"),
        ("[E.p1]", "[E]", "E is .*; write a section"),
    ],
)
def test_what_cannot_be_is_refused(table: Path, old: str, new: str, what: str) -> None:
    table.write_text(table.read_text().replace(old, new, 1))
    with pytest.raises(LabError, match=what):
        lab.load_robot(table)
