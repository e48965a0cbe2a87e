"""The arms that one can buy: tables against the makers' URDFs, their page, and all main commands on each."""

import json
from pathlib import Path

import numpy as np
import pytest
import robots_against_urdf
from helpers.robots import ROOT

import lab
from lab.robots.load_robot import load_robot
from lab.robots.robot_files import description_of, own_models

POSES = json.loads(Path(__file__).with_name("urdf_poses.json").read_text())
MAKERS = sorted(
    path for path in set(own_models().values())
    if path.name not in ("robot.toml", "robot.xml", "scene.xml", "mechanism.toml")
    and path.parent.name not in ("carrier", "delta", "rpr3")
)  # fmt: skip
ROWS = {
    cells[1].strip("`"): cells[2:]
    for line in (ROOT / "docs" / "reference" / "robots.md").read_text().splitlines()
    if len(cells := [cell.strip() for cell in line.split("|")]) == 9 and cells[1].startswith("`")
}


def test_every_table_of_a_maker_has_poses_of_its_urdf_and_a_row_on_the_page() -> None:
    names = {path.stem for path in MAKERS}
    assert names <= set(POSES) == set(robots_against_urdf.URDFS) and names <= set(ROWS)
    assert {"ur3e", "ur20", "fr3", "iiwa7", "kr6_r700", "irb1200_5_90", "hc10", "xarm7", "gen3", "so101"} <= names


@pytest.mark.parametrize("name", POSES)
def test_the_last_frame_is_where_the_maker_s_urdf_has_it(name: str) -> None:
    """Stored poses, which ``robots_against_urdf.py`` reads off the URDF of that commit without the lab."""
    stored = POSES[name]
    assert len(stored["commit"]) == 40 and (stored["repository"], stored["commit"]) == tuple(
        robots_against_urdf.URDFS[name].source
    )
    robot = load_robot(name)
    arm, offset = robot.serial_arm(("p1",)), np.eye(4)
    offset[:3, 3] = 1e-3 * np.array(stored["offset_mm"])
    found = robot.T_world_frame0 @ arm.flange(np.array(stored["joints"]), arm.nominal()) @ offset
    poses = np.array(stored.get("exact_poses", stored["poses"]))
    np.testing.assert_allclose(found[:, :3, 3], poses[:, :, 3], atol=1e-6)
    np.testing.assert_allclose(found[:, :3, :3], poses[:, :, :3], atol=1e-6)
    apart = np.linalg.norm(np.array(stored["poses"])[:, :, 3] - found[:, :3, 3], axis=1).max()
    if "exact_poses" in stored:  # the URDF's right angles are rounded: the README says what that makes
        largest = stored["largest_difference_m"]
        assert 1e-6 < largest < 1e-5 and apart <= largest
        assert f"{1e6 * largest:.1f} µm" in description_of(name).with_name("README.md").read_text()


@pytest.mark.sampled(8)
@pytest.mark.parametrize("name", ROWS)
def test_a_row_of_the_page_is_what_lab_inspect_says(name: str) -> None:
    robot, found = load_robot(name), lab.inspect(name).to_dict()
    _, joints, identifiable, ways, masses, _, _ = ROWS[name]
    assert robot.warnings == () and joints == f"{robot.chain.size}R" and not any(robot.chain.prismatic)
    assert identifiable == f"{found['rank']} of {found['parameters']}"
    assert ways == str(found["ways"] or "by search")
    assert masses == ("unknown" if robot.loads is None else "published")
