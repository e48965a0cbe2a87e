"""Commands given bad input: what they print, and what they leave behind."""

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from lab.cli.main import main
from lab.formats.robot_toml import read_table
from lab.kinematics.serial.serial_arm import SerialArm

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


POINTS = ("p1_x_mm", "p1_y_mm", "p1_z_mm")

# Files of measurements with one thing changed


def edited(*cells: tuple[int, str, str], table: list[list[str]] = GOOD) -> str:
    """The file with some cells changed; lines as an editor counts them."""
    new = [list(row) for row in table]
    for line, column, text in cells:
        new[line - 1][new[0].index(column)] = text
    return csv(new)


def renamed(*pairs: tuple[str, str]) -> str:
    names = dict(pairs)
    return csv([[names.get(name, name) for name in GOOD[0]], *GOOD[1:]])


def without(column: str) -> str:
    at = GOOD[0].index(column)
    return csv([row[:at] + row[at + 1 :] for row in GOOD])


def cells(text: str) -> list[list[str]]:
    return [line.split(",") for line in text.splitlines()]


def joined(name: str, texts: Mapping[int, str] | str = "", table: list[list[str]] = GOOD) -> str:
    """The file with one more column: the same text in every row, or texts by line."""
    of_line = texts if isinstance(texts, Mapping) else {}
    rest = texts if isinstance(texts, str) else ""
    return csv([[*row, name if i == 0 else of_line.get(i + 1, rest)] for i, row in enumerate(table)])


def emptied(*lines: int) -> str:
    return edited(*((line, column, "") for line in lines for column in POINTS))


def approached(blank: int = 0) -> str:
    """The file with sides from which each joint came; no side for the second joint in a line."""
    table = GOOD
    for k, joint in enumerate(("q1", "q2", "rail")):
        sides = {line: "1" if (line >> k) % 2 else "-1" for line in range(2, ROWS + 2)}
        if joint == "q2":
            sides.pop(blank, None)
        table = cells(joined(f"approach_{joint}", sides, table))
    return csv(table)


# A command that is given it


@dataclass(frozen=True)
class Case:
    """Arguments, the files they speak of, and what the one line must contain."""

    id: str
    argv: str
    says: tuple[str, ...]
    files: Mapping[str, str | bytes] = field(default_factory=dict)


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


def write(folder: Path, files: Mapping[str, str | bytes]) -> None:
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())


def warnings_of(err: str) -> list[str]:
    lines = err.splitlines()
    assert all(line.startswith("lab: warning: ") for line in lines), err
    return lines


def assert_told_in_one_line(case: Case, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Exit code 2, one line that says what and where, and no file more or less than before."""
    write(folder, case.files)
    before = contents(folder)
    assert run(case.argv) == 2
    out, err = capfd.readouterr()
    line = the_line(err)
    assert out == ""
    assert [fragment for fragment in case.says if fragment not in line] == [], line
    assert contents(folder) == before  # no run, no half of one, no log
