"""A cell's file: what it says in SI, and one line for what makes no sense."""

from pathlib import Path

import numpy as np
import pytest
from helpers.robots import IRB120

from lab.core.errors import LabError
from lab.formats.cell_toml import Place, ToolPoint, read_cell

BOX = '[[obstacle]]\nname = "table"\nshape = "box"\nsize_mm = [100, 200, 300]\n'
POINT = '[[tool]]\nname = "p1"\nposition_mm = [1, 2, 3]\n'


def test_poses_are_turned_about_the_fixed_axes() -> None:
    """Roll about x first, then pitch about the fixed y, then yaw about the fixed z."""
    T = Place(position_mm=(10.0, 20.0, 30.0), rotation_deg=(90.0, 0.0, 90.0)).pose
    np.testing.assert_allclose(T[:3, 3], [0.01, 0.02, 0.03])
    np.testing.assert_allclose(T[:3, :3] @ [0, 1, 0], [0, 0, 1], atol=1e-15)  # y to z by roll, which yaw leaves
    np.testing.assert_allclose(T[:3, :3] @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    for axis in ((0.0, 3.0, 4.0), (0.0, 0.0, -2.0)):
        turned = ToolPoint(name="p1", position_mm=(0.0, 0.0, 0.0), axis=axis).rotation @ [0, 0, 1]
        np.testing.assert_allclose(turned, np.array(axis) / np.linalg.norm(axis), atol=1e-12)


def test_limits_are_the_narrowest_and_cables_count_from_home(tmp_path: Path) -> None:
    path = tmp_path / "cell.toml"
    home = "".join(f"q{i}_deg = {30 if i == 4 else 0}\n" for i in range(1, 7))
    path.write_text(f"[joints.q1]\nlower_deg = -400\nupper_deg = 20\n[joints.q4]\ncable_deg = 100\n[home]\n{home}")
    lower, upper, start = read_cell(path).joint_spec_values(IRB120.chain)
    np.testing.assert_allclose(np.rad2deg([lower[0], upper[0]]), [-165, 20])
    np.testing.assert_allclose(np.rad2deg([lower[3], upper[3]]), [-70, 130])
    assert start is not None and lower[1] == IRB120.chain.lower[1]
    np.testing.assert_allclose(np.rad2deg(start), [0, 0, 0, 30, 0, 0], atol=1e-12)


POST = "[[obstacle]]\nname = 'post'\nshape = 'cylinder'\nradius_mm = 50\nheight_mm = 900\n"
HAND = "[[obstacle]]\nname = 'hand'\nshape = 'mesh'\nfile = 'hand.stl'\n"
PLATE = "[[plate]]\nname = 'plate'\nshape = 'box'\nsize_mm = [1, 2, 3]\n"
WRONG = {
    "colour = 1\n": "'colour' is not an option of a cell; valid are name, clearance_mm",
    "path = 'x'\n": "'path' is not an option",
    "clearance_mm = -1\n": "clearance_mm is -1",
    "clearance_mm = nan\n": "clearance_mm is nan; give a finite number",
    "clearance_mm = 'wide'\n": "give a number",
    BOX.replace('"box"', '"ball"'): "one of box, cylinder, mesh",
    BOX.replace("[100, 200, 300]", "[100, 200]"): "give the lengths of three edges",
    BOX.replace("100", "0"): "a length is not above zero",
    BOX.replace("size_mm = [100, 200, 300]", ""): "size_mm is missing",
    BOX + "radius_mm = 3\n": "radius_mm is not of this shape",
    BOX + "position_mm = [1, 2]\n": "give three numbers",
    BOX + "rotation_deg = [1, inf, 3]\n": "rotation_deg is inf",
    BOX + "clearance_mm = -2\n": "give zero or more",
    BOX + BOX: "its name 'table' is taken",
    BOX.replace('"table"', '""'): "is empty",
    BOX.replace('name = "table"\n', ""): ".name' is missing",
    POINT + "axis = [0, 0, 0]\n": "give its reflector's direction",
    POINT.replace("[1, 2, 3]", "[1, 2]"): "give three numbers",
    POINT + POINT: "its name 'p1' is taken",
    "[reflector]\nkind = 'mirror'\n": "one of corner cube, cat's eye, other",
    "[reflector]\nkind = 'other'\n": 'acceptance_deg goes with kind = "other"',
    "[reflector]\nacceptance_deg = 20\n": 'acceptance_deg goes with kind = "other"',
    "[reflector]\nkind = 'other'\nacceptance_deg = 0\n": "give an angle above 0",
    "[robot]\nposition_mm = 3\n": "a list, each a number",
    "[robot]\nposition_mm = [1, 2, inf]\n": "position_mm is inf",
    BOX + "position_mm = [1e300, 0, 0]\n": "farther than a kilometre",
    BOX + "position_mm = 'here'\n": "give a list, each a number",
    BOX + "color = 'red'\n": "'color' is no option",
    BOX.replace('"table"', "3"): "give a text",
    POST.replace("50", "0"): "radius_mm is missing",
    POST.replace("900", "-900"): "a length is not above zero",
    POST.replace("900", "'high'"): "give a number",
    POST + "size_mm = [1, 2, 3]\n": "size_mm is not of this shape",
    HAND.replace("file = 'hand.stl'\n", ""): "file is missing",
    HAND + "unit = 'inch'\n": "give one of mm, m",
    HAND + "radius_mm = 1\n": "radius_mm is not of this shape",
    PLATE + PLATE: "its name 'plate' is taken",
    PLATE.replace("3]", "true]"): "a list, each a number",
    POINT + "axis = [nan, 0, 1]\n": "axis is nan",
    POINT.replace("position_mm = [1, 2, 3]\n", ""): "'tool.position_mm' is missing",
    "[tool]\nname = 'p1'\n": "a list",
    "[instrument]\nposition = [1, 2, 3]\n": "'position' is no option",
    "[instrument]\nrotation_deg = [1, 2, 3, 4]\n": "give three numbers",
    "[reflector]\nkind = 'other'\nacceptance_deg = 200\n": "up to 180",
    "[joints.q1]\nlower = 3\n": "'lower' is no option",
    "[joints.q1]\nlower_deg = 'x'\n": "give a number",
    "[joints]\nq1 = 3\n": "a group of options",
    "[home]\nq1_deg = 'zero'\n": "give a number",
    "\0": "not a text file",
    "obstacle = 3\n": "a list",
    "x = = 3\n": "not a TOML file",
}


@pytest.mark.parametrize("text", WRONG, ids=range(len(WRONG)))
def test_what_makes_no_sense_is_one_line_with_the_file(text: str, tmp_path: Path) -> None:
    path = tmp_path / "cell.toml"
    path.write_text(text)
    with pytest.raises(LabError) as error:
        read_cell(path)
    said = str(error.value)
    assert said.startswith(f"{path}: ") and WRONG[text] in said and "\n" not in said


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[joints.q9]\nlower_deg = 1\n", "[joints.q9]: the robot has q1, q2"),
        ("[joints.q1]\nlower_mm = 1\n", "joint q1 is revolute"),
        ("[joints.q1]\nlower_deg = 170\n", "joint q1 has an empty range"),
        ("[home]\nq1_deg = 1\n", "[home] has q1_deg; give q1_deg, q2_deg"),
        ("[home]\nq1_rad = 1\n", "[home] has q1_rad; give q1_deg, q2_deg"),
        ("[joints.q1]\ncable_deg = -5\n", "joint q1 has an empty range"),
        ("[joints.q1]\nlower_deg = 20\nupper_deg = 10\n", "joint q1 has an empty range"),
    ],
)
def test_joints_that_the_robot_does_not_have_are_told(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "cell.toml"
    path.write_text(text)
    with pytest.raises(LabError) as error:
        read_cell(path).joint_spec_values(IRB120.chain)
    assert words in str(error.value) and str(path) in str(error.value)
