"""Cells in wrong units and places are refused or warned of; cells as people build them are neither."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from lab.core.errors import LabError
from lab.robots.load_robot import load_robot

BOX = '[[obstacle]]\nname = "table"\nshape = "box"\nsize_mm = {}\nposition_mm = {}\n'
POST = '[[obstacle]]\nname = "post"\nshape = "cylinder"\nradius_mm = {}\nheight_mm = {}\nposition_mm = {}\n'
MESH = '[[obstacle]]\nname = "fixture"\nshape = "mesh"\nfile = "{}.obj"\nunit = "{}"\nposition_mm = {}\n'
HEAD = "[instrument]\nposition_mm = {}\n"
TABLE = BOX.format([500, 1200, 100], [0, 800, 150])
WRONG = {
    # sizes in another unit
    "table in metres": ("irb120", BOX.format([0.5, 1.2, 0.1], [0, 800, 150])),
    "all of a table in metres": ("irb120", BOX.format([0.5, 1.2, 0.1], [0, 0.8, 0.15])),
    "table of half a millimetre": ("ur5", BOX.format([0.5, 0.5, 0.5], [0, 600, 100])),
    "wall of 20 m in metres": ("rx130", BOX.format([20, 0.2, 3], [0, 2000, 1500])),
    "table in micrometres": ("irb120", BOX.format([500000, 1200000, 100000], [0, 800, 150])),
    "table of 60 m": ("irb120", BOX.format([60000, 1200, 100], [0, 800, -300])),
    "post in metres": ("irb120", POST.format(0.04, 0.9, [-250, 250, 450])),
    "post in micrometres": ("tx40", POST.format(40000, 900000, [-250, 250, 450])),
    "plate in metres": ("irb120", '[[plate]]\nname = "p"\nshape = "box"\nsize_mm = [0.12, 0.12, 0.01]\n'),
    "plate of 10 m": ("irb120", '[[plate]]\nname = "p"\nshape = "box"\nsize_mm = [10000, 120, 10]\n'),
    "plate longer than the arm": ("irb120", '[[plate]]\nname = "p"\nshape = "box"\nsize_mm = [1500, 50, 10]\n'),
    "clearance in metres": ("irb120", "clearance_mm = 0.02\n" + TABLE),
    "clearance of one obstacle in metres": ("irb120", TABLE + "clearance_mm = 0.03\n"),
    "clearance in micrometres": ("irb120", "clearance_mm = 20000\n" + TABLE),
    # meshes in another unit
    "mesh in metres as mm": ("irb120", MESH.format("metres", "mm", [0, 800, 150])),
    "mesh in mm as metres": ("irb120", MESH.format("millimetres", "m", [0, 800, 150])),
    "small mesh in mm as metres": ("irb120", MESH.format("small", "m", [0, 0, -26000])),
    "mesh of a hall in metres as mm": ("ur5", MESH.format("hall", "mm", [0, 800, 150])),
    # places
    "position of a table in metres": ("irb120", BOX.format([500, 1200, 100], [0, 0.8, 0.15])),
    "robot's place in metres": ("irb120", "[robot]\nposition_mm = [0, 0, 0.8]\n" + TABLE),
    "robot's place left out": ("irb120", BOX.format([500, 1200, 800], [0, 0, 400])),
    "block over the base": ("ur5", BOX.format([400, 400, 400], [0, 0, 100])),
    "block over all of the arm": ("scara", BOX.format([3000, 3000, 3000], [0, 0, 0])),
    "everything out of reach": ("irb120", BOX.format([500, 1200, 100], [0, 80000, 150])),
    # the instrument
    "instrument in metres": ("irb120", HEAD.format([2, 2.5, 1.4])),
    "instrument in the base": ("irb120", HEAD.format([0, 0, 100])),
    "instrument in the arm": ("irb120", HEAD.format([0, 0, 300])),
    "instrument in a table": ("ur5", TABLE + HEAD.format([0, 800, 150])),
    "instrument in the arm's way": ("ur5", HEAD.format([400, 400, 400])),
    "instrument in micrometres": ("irb120", HEAD.format([200000, 250000, 140000])),
    # the tool, and limits
    "tool point in metres": ("irb120", '[[tool]]\nname = "p1"\nposition_mm = [0.03, 0.02, 0.1]\n'),
    "tool point in micrometres": ("irb120", '[[tool]]\nname = "p1"\nposition_mm = [30000, 20000, 100000]\n'),
    "limits in radians": ("irb120", "[joints.q6]\nlower_deg = -3.14\nupper_deg = 3.14\n"),
    "cable in radians": ("irb120", "[joints.q1]\ncable_deg = 2.6\n"),
}  # fmt: skip
TRACKER = HEAD.format([2000, 2500, 1400])
RIGHT = {
    "table and tracker": ("irb120", "clearance_mm = 20\n" + BOX.format([300, 900, 250], [480, 0, 125]) + TRACKER),
    "table under the base": ("irb120", BOX.format([1200, 1200, 40], [0, 0, -20]) + TRACKER),
    "robot on a pedestal": (
        "irb120", "[robot]\nposition_mm = [0, 0, 800]\nrotation_deg = [0, 0, 90]\n" + POST.format(120, 800, [0, 0, 400])
        + BOX.format([500, 1200, 100], [0, 700, 750]) + TRACKER,
    ),
    "hall": (
        "rx130", BOX.format([8000, 100, 4000], [0, 3000, 2000]) + POST.format(60, 1200, [-500, 900, 600])
        + HEAD.format([4000, -3000, 1200]),
    ),
    "mesh in mm": ("irb120", MESH.format("millimetres", "mm", [0, 900, 150]) + TRACKER),
    "mesh in metres": ("irb120", MESH.format("metres", "m", [0, 900, 150]) + TRACKER),
    "camera near a large arm": ("ur10", BOX.format([800, 1600, 700], [900, 0, -400]) + HEAD.format([2500, 0, 1500])),
    "plate, tool and narrower limits": (
        "irb120", '[[plate]]\nname = "p"\nshape = "box"\nsize_mm = [120, 120, 10]\nposition_mm = [0, 0, 5]\n'
        '[[tool]]\nname = "p1"\nposition_mm = [30, 20, 40]\n[joints.q1]\ncable_deg = 150\n[joints.q6]\n'
        "lower_deg = -180\nupper_deg = 180\n",
    ),
    "stations": (
        "irb120", '[[station]]\nname = "west"\nposition_mm = [1600, -1300, 1100]\n[[station]]\nname = "east"\n'
        "position_mm = [1400, 1500, 900]\n",
    ),
    "hanging robot": (
        "tx40", "[robot]\nposition_mm = [0, 0, 2500]\nrotation_deg = [180, 0, 0]\n"
        + POST.format(400, 60, [0, 0, 2535]) + BOX.format([600, 900, 100], [0, 500, 1900])
        + HEAD.format([2500, 0, 1500]),
    ),
}  # fmt: skip


def box_of(path: Path, edges: tuple[float, float, float]) -> None:
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) * np.array(edges)
    faces = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    path.write_text("\n".join(lines + [f"f {face}" for face in faces]) + "\n")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    box_of(tmp_path / "millimetres.obj", (500, 1200, 100))
    box_of(tmp_path / "metres.obj", (0.5, 1.2, 0.1))
    box_of(tmp_path / "small.obj", (50, 40, 20))
    box_of(tmp_path / "hall.obj", (8, 6, 4))
    return tmp_path


@cache
def own_warnings(robot: str) -> int:
    return len(load_robot(robot).warnings)


def said_of(folder: Path, robot: str, text: str) -> str:
    """What is refused, else what is warned of beyond the robot's own warnings."""
    path = folder / "cell.toml"
    path.write_text(text)
    try:
        found = load_robot(robot, path)
    except LabError as error:
        return str(error)
    return "\n".join(found.warnings[own_warnings(robot) :])


@pytest.mark.parametrize("name", WRONG)
def test_cells_that_cannot_be_meant_are_refused_or_warned_of(name: str, folder: Path) -> None:
    said = said_of(folder, *WRONG[name])
    assert all(line.startswith(f"{folder / 'cell.toml'}: ") and re.search(";", line) for line in said.splitlines())
    assert said, "silent"


@pytest.mark.parametrize("name", RIGHT)
def test_cells_as_people_build_them_are_taken_without_a_word(name: str, folder: Path) -> None:
    assert said_of(folder, *RIGHT[name]) == ""
