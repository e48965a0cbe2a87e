"""[[link]] sections: textbook sections, lines, robots that take their model from elsewhere; wrong ones are told."""

from pathlib import Path

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.kinematics.dynamics.beam import MATERIALS, tube
from lab.kinematics.dynamics.gravity import link_loads
from lab.kinematics.effects.bending import ElasticLinks
from lab.library.virtual_arm import perturbed_arm
from lab.options.virtual_campaign import VirtualCampaign
from lab.robots.load_robot import load_robot

TUBES = """robot = "irb120"

[[link]]
number = 2
material = "aluminium"
tube_mm = [80, 4]
path_mm = [[0, 0, 0], [0, 0, 120], [270, 0, 120], [270, 0, 0]]

[[link]]
number = 4
ei_y_nm2 = 4e4
ei_z_nm2 = 5e4
gj_nm2 = 3e4
ea_n = 6e7
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "tubes.toml"
    path.write_text(text)
    return path


def test_a_tube_is_that_of_the_textbook() -> None:
    """A full bar: I = pi d^4 / 64; a thin wall: I = pi r^3 t, J = 2 pi r^3 t, A = 2 pi r t."""
    steel = MATERIALS["steel"]
    bar = tube(0.02, 0.01, steel)
    np.testing.assert_allclose(1 / bar[0], 210e9 * np.pi * 0.02**4 / 64, rtol=1e-14)
    ei_y, ei_z, gj, ea = 1 / tube(0.1, 1e-6, steel)
    r = 0.05 - 0.5e-6
    np.testing.assert_allclose([ei_y, ei_z], 210e9 * np.pi * r**3 * 1e-6, rtol=1e-9)
    np.testing.assert_allclose([gj, ea], [80e9 * 2 * np.pi * r**3 * 1e-6, 210e9 * 2 * np.pi * r * 1e-6], rtol=1e-9)


def test_a_robot_takes_its_links_from_a_file(tmp_path) -> None:
    """The virtual arm bends as the file says; an option replaces its kind; the nominal model knows the lines."""
    robot = load_robot(str(written(tmp_path, TUBES)))
    assert robot.name == "irb120" and robot.sha256 != load_robot("irb120").sha256
    compliances = robot.link_compliances
    assert compliances is not None and not compliances[[0, 2, 4, 5]].any()
    np.testing.assert_allclose(1 / compliances[3], [4e4, 5e4, 3e4, 6e7])
    np.testing.assert_allclose(1 / compliances[1, :3], [48_400, 48_400, 35_950], rtol=1e-3)
    assert robot.loads is not None and link_loads(robot.loads).beams[1].length_m == pytest.approx(0.51)
    real = perturbed_arm(robot, VirtualCampaign(seed=1))
    np.testing.assert_array_equal(real.effects.part(ElasticLinks).compliances, compliances)
    known = load_robot("irb120")
    assert known.link_compliances is None and not perturbed_arm(known, VirtualCampaign(seed=1)).effects.is_elastic


def test_a_table_has_links_of_its_own(tmp_path) -> None:
    joint = (
        "[[joint]]\ntheta_deg = 0\nd_mm = 0\na_mm = 400\nalpha_deg = 0\nlower_deg = -90\nupper_deg = 90\nmass_kg = 4\n"
    )
    link = "[[link]]\nnumber = 1\nyoung_gpa = 70\nshear_gpa = 26\ntube_mm = [80, 4]\n"
    robot = load_robot(str(written(tmp_path, f'name = "two"\nconvention = "distal"\n{joint}{joint}{link}')))
    assert robot.link_compliances is not None
    np.testing.assert_allclose(robot.link_compliances[0], tube(0.08, 0.004, MATERIALS["aluminium"]))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("number = 4", "number = 7", r"\[\[link\]\] 2: number is 7; give a link's, from 1 to 6"),
        ("number = 4", "number = 2", r"\[\[link\]\] 2: link 2 has a section already"),
        ("number = 4", "number = 5", "link 5 of robot irb120 has no length, so it does not bend"),
        ('"aluminium"', '"wood"', "link 2: material is 'wood'; known are aluminium, steel, cast iron, magnesium; or"),
        ('material = "aluminium"\n', "", "link 2: give a material .* or young_gpa and shear_gpa"),
        ('"aluminium"', '"steel"\nyoung_gpa = 3', "link 2: a material and moduli are both given"),
        ("[80, 4]", "[80, 41]", "the wall of 41 mm exceeds half the diameter of 80 mm"),
        ("[80, 4]", "80", r"tube_mm is 80; give \[outer diameter, wall\]"),
        ("tube_mm = [80, 4]\n", "", "a material needs a cross-section; give tube_mm"),
        ("tube_mm = [80, 4]\n", "tube_mm = [80, 4]\nei_nm2 = 3\n", "tube_mm and stiffnesses are both given"),
        ("ei_y_nm2 = 4e4", "ei_nm2 = 4e4", "ei_nm2 is for every axis"),
        ("ei_y_nm2 = 4e4", "ei_y_nm2 = -4e4", "ei_y is -40000; give more than zero"),
        ("ei_y_nm2 = 4e4", "ei_x_nm2 = 4e4", "unknown key 'ei_x_nm2'; known are number"),
        ("[270, 0, 0]]", "[260, 0, 0]]", "path of link 2: it runs from 0, 0, 0 to 270, 0, 0 mm in the link's axes"),
        ("[[0, 0, 0], ", "[", "path of link 2: it runs from 0, 0, 0"),
        ("[270, 0, 120]", "[270, 0]", "path_mm is to be a list of two or more points"),
        ("[270, 0, 120]", "[0, 0, 120]", "two of its points after each other are the same"),
        ('robot = "irb120"', 'robot = "irb12"', "robot 'irb12': no such model or file"),
        ('robot = "irb120"', "robot = 3", "robot is 3; give a model's name or a file"),
        pytest.param('robot = "irb120"', 'robot = "rpr2"', "robot .* has loops", marks=pytest.mark.thorough),
        ('robot = "irb120"', 'robot = "tubes.toml"', "names another robot in its turn; give that one"),
        ('robot = "irb120"', 'robot = "irb120"\nname = "soft"', "unknown key 'name'; valid are robot"),
    ],
)  # fmt: skip
def test_wrong_sections_are_told_in_one_line(tmp_path, old: str, new: str, message: str) -> None:
    assert old in TUBES
    with pytest.raises(LabError, match=message) as said:
        load_robot(str(written(tmp_path, TUBES.replace(old, new, 1))))
    assert "\n" not in str(said.value)


def test_a_file_without_links_is_told(tmp_path) -> None:
    with pytest.raises(LabError, match=r"no links; give each elastic link a \[\[link\]\] section"):
        load_robot(str(written(tmp_path, 'robot = "irb120"\n')))
