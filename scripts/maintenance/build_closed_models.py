"""Writes the MJCF of the mechanisms in models/ from their descriptions, for MuJoCo's own tools.

    python scripts/maintenance/build_closed_models.py

``mechanism.toml`` becomes ``robot.xml``, any other description an MJCF of its own name. Rods and legs are tendons with
an equality each; the file rests in the nominal position, with its loops closed.
"""

from pathlib import Path

import tyro

from lab.robots.load_robot import load_robot
from lab.robots.robot_files import models_folder
from lab.simulation.closed_robot import closed_mjcf


def target(description: Path) -> Path:
    """Where the MJCF of a description belongs."""
    return description.with_name("robot.xml" if description.stem == "mechanism" else f"{description.stem}.xml")


def main() -> None:
    """Write all of them."""
    for folder in sorted(path.parent for path in models_folder().glob("*/mechanism.toml")):
        for description in sorted(folder.glob("*.toml")):
            text = closed_mjcf(load_robot(str(description)).model.spec)
            target(description).write_text(text, encoding="utf-8")
            print(f"{target(description)} from {description.name}")


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
