"""Commands given bad input: what they print, and what they leave behind."""

import shlex
import sys
import types
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from helpers.no_rendering import nothing_drawn  # noqa: F401
from lab.cli import main
from lab.formats.dh_table_toml import read_table
from lab.kinematics.serial.arm import SerialArm

ROWS = 24


ARM_TOML = """\
name = "three"
convention = "distal"

[[joint]]
name = "q1"
theta_deg = 0
d_mm = 300
a_mm = 100
alpha_deg = -90
lower_deg = -150
upper_deg = 150

[[joint]]
name = "q2"
theta_deg = 0
d_mm = 0
a_mm = 270
alpha_deg = 90
lower_deg = -100
upper_deg = 100

[[joint]]
name = "rail"
type = "prismatic"
theta_deg = 0
d_mm = 200
a_mm = 0
alpha_deg = 0
lower_mm = 0
upper_mm = 300
"""


ARM_XML = """\
<mujoco model="small">
  <worldbody>
    <body name="a">
      <geom type="box" size=".05 .05 .05" mass="1"/>
      <joint name="q1" axis="0 0 1" range="-150 150"/>
      <body name="b" pos="0.1 0 0.3">
        <geom type="box" size=".02 .02 .02" mass="1"/>
        <joint name="q2" axis="0 1 0" range="-170 170"/>
        <body name="c" pos="0.3 0 0">
          <geom type="box" size=".02 .02 .02" mass="1"/>
          <joint name="q3" axis="0 1 0" range="-170 170"/>
          <body name="tip" pos="0.3 0 0"><geom type="box" size=".05 .05 .05" mass="0.1"/></body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


INERTIA = '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'


ARM_URDF = f"""\
<robot name="small">
  <link name="base"/>
  <link name="l1">{INERTIA}</link>
  <link name="l2">{INERTIA}</link>
  <joint name="q1" type="revolute">
    <parent link="base"/><child link="l1"/><origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/>
  </joint>
  <joint name="q2" type="revolute">
    <parent link="l1"/><child link="l2"/><origin xyz="0.2 0 0.1"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/>
  </joint>
</robot>
"""


def swapped(text: str, old: str, new: str, count: int = 1) -> str:
    assert old in text, old
    return text.replace(old, new, count)


def good_table(targets: tuple[str, ...] = ("p1",)) -> list[list[str]]:
    """A measurement file of the arm above, exact, as cells; the header is row 0."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "arm.toml"
        file.write_text(ARM_TOML)
        chain = read_table(file).chain
    joints = chain.random_joints(ROWS, np.random.default_rng(1))
    arm = SerialArm(chain, targets)
    values = arm.nominal()
    values[:6] = 0.3, -0.2, 0.1, 0.2, -0.1, 0.4
    values[6:] += 1e-3 * np.random.default_rng(2).standard_normal(len(values) - 6)
    points = arm.points(joints, values)
    header = ["q1_deg", "q2_deg", "rail_mm", *(f"{t}_{axis}_mm" for t in targets for axis in "xyz")]
    numbers = np.column_stack([np.rad2deg(joints[:, :2]), 1e3 * joints[:, 2], 1e3 * points.reshape(ROWS, -1)])
    return [header, *([f"{value:.9f}" for value in row] for row in numbers)]


GOOD = good_table()


def csv(table: list[list[str]] = GOOD, separator: str = ",") -> str:
    return "".join(separator.join(row) + "\n" for row in table)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a good robot of each kind and good measurements; no recording is written."""
    recording = types.ModuleType("lab.commands.calibrate.recording")
    recording.record = lambda path, outcome: None  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "lab.commands.calibrate.recording", recording)
    monkeypatch.chdir(tmp_path)
    for name, text in {"arm.toml": ARM_TOML, "arm.xml": ARM_XML, "arm.urdf": ARM_URDF, "good.csv": csv()}.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def contents(folder: Path) -> dict[str, bytes | None]:
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def run(argv: str) -> int:
    try:
        return main(shlex.split(argv))
    except SystemExit as stop:
        assert isinstance(stop.code, int)
        return stop.code


def the_line(err: str) -> str:
    """The one line on standard error that is no warning."""
    lines = [line for line in err.splitlines() if not line.startswith("lab: warning: ")]
    assert len(lines) == 1 and lines[0].startswith("lab: "), err
    return lines[0]
