"""Robots in cells: a table and a post where each of them gets in its own way of working."""

from pathlib import Path

from lab.robots.load_robot import load_robot
from lab.simulation.robot_model import RobotModel

CELL = """clearance_mm = {}
[[obstacle]]
name = "table"
shape = "box"
size_mm = {}
position_mm = {}
[[obstacle]]
name = "post"
shape = "cylinder"
radius_mm = 60
height_mm = 1200
position_mm = {}
"""
PLACES = {
    "irb120": ([300, 900, 250], [480, 0, 125], [-250, 300, 600]),
    "tx40": ([300, 600, 200], [450, 0, -100], [-200, 350, 600]),
    "rx130": ([600, 1500, 300], [1000, 0, -150], [-500, 700, 600]),
    "scara": ([200, 200, 100], [300, 200, -300], [-500, 300, 600]),
    "scemi": ([300, 600, 200], [600, 0, 0], [-400, 500, 600]),
}


def between_table_and_post(name: str, folder: Path, clearance_mm: float = 20) -> RobotModel:
    """A robot's model in its cell, whose file is written to the folder."""
    path = folder / "cell.toml"
    path.write_text(CELL.format(clearance_mm, *PLACES[name]))
    return load_robot(name, path).model
