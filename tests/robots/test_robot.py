"""Robots by name and by file, and what each kind can be described in."""

import os
import subprocess
import sys
from types import ModuleType

import numpy as np
import pytest
from helpers.hidden_robots import ur5e_urdf
from helpers.robots import ROOT

from lab.core.errors import LabError
from lab.robots.description_formats import CLOSED_FORMATS, SERIAL_FORMATS
from lab.robots.load_robot import load_robot, load_virtual
from lab.robots.robot import ClosedRobot, SerialRobot
from lab.robots.robot_files import description_of, models_folder, own_models, sha256_of


@pytest.mark.parametrize(("name", "kind"), [("irb120", SerialRobot), ("scara", SerialRobot), ("rpr2", ClosedRobot)])
def test_a_robot_by_name_is_of_its_kind(name: str, kind: type) -> None:
    robot = load_robot(name)
    assert type(robot) is kind and robot.name and load_robot(robot) is robot
    formats = SERIAL_FORMATS if kind is SerialRobot else CLOSED_FORMATS
    assert 0 < len(robot.description_files) <= len(formats)
    arm = robot.arm(("p1",))
    joints = robot.chain.random_joints(3, np.random.default_rng(0))
    assert arm.points(joints, arm.nominal(robot.tool)).shape == (3, 1, 3)


def test_what_serial_arms_alone_have() -> None:
    robot = load_robot("irb120")
    assert robot.serial_arm(("p1",)).chain is robot.serial_model.chain
    with pytest.raises(LabError, match=r"loops|2-RPR"):
        load_robot("rpr2").serial_arm(("p1",))


def test_every_model_of_the_folder_is_found() -> None:
    described = {path for path in models_folder().glob("*/*.toml") if path.name != "drives.toml"}
    shaped = {
        models_folder() / "irb120" / "scene.xml",
        *(models_folder() / name / "robot.xml" for name in ("rail", "torso")),
    }
    assert set(own_models().values()) == described | shaped
    with pytest.raises(LabError) as error:
        load_virtual("no such robot")
    shown, more = str(error.value).split("there are ")[1].split(" others")[0].split(" and ")
    named = {own_models()[name] for name in shown.split(", ")}
    assert len(named) + int(more) == len(set(own_models().values()))


def test_a_robot_of_a_maker_s_folder_has_its_file_s_name(tmp_path) -> None:
    path = models_folder() / "universal_robots" / "ur5e.toml"
    assert description_of("ur5e") == description_of("universal_robots/ur5e") == path
    assert description_of("scara") == models_folder() / "scara" / "robot.toml"  # and not that of the carriers
    with pytest.raises(LabError, match="no such model or file; there are"):
        description_of("small")  # delta/small: the folder's other description goes with its name
    with pytest.raises(LabError, match=r"there are ur5, .* others \(the page Robots") as found:
        description_of("ur5f")
    assert "ur5e" in str(found.value) and "versatran" not in str(found.value)  # the nearest alone
    for typed, meant in (("UR5e", "ur5e"), ("kr6-r900", "kr6_r900"), ("xarm 6", "xarm6"), ("so-101", "so101")):
        with pytest.raises(LabError, match=rf"no such model or file \(is {meant} meant\?\)"):
            description_of(typed)
    alone = tmp_path / "ur5e.toml"
    alone.write_bytes(path.read_bytes())
    assert sha256_of(alone) == sha256_of(path)  # the maker's other arms are no part of it


@pytest.fixture
def descriptions(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """A package robot_descriptions without any of its descriptions; tests add some."""
    package = ModuleType("robot_descriptions")
    package.__path__ = []  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "robot_descriptions", package)
    return package


@pytest.mark.parametrize("kind", ["URDF_PATH", "MJCF_PATH"])
def test_a_name_of_robot_descriptions(kind, descriptions, monkeypatch, tmp_path) -> None:
    file = ROOT / "models" / "irb120" / "robot.xml" if kind == "MJCF_PATH" else ur5e_urdf(tmp_path / "arm.urdf")
    module = ModuleType("robot_descriptions.some_arm_description")
    setattr(module, kind, str(file))
    monkeypatch.setitem(sys.modules, module.__name__, module)
    robot = load_robot("some_arm_description")
    assert robot.model.path == file and robot.source == "some_arm_description"


def test_descriptions_that_are_not_there(descriptions, monkeypatch) -> None:
    with pytest.raises(LabError, match="the package robot_descriptions has no such description"):
        load_robot("no_arm_description")
    module = ModuleType("robot_descriptions.some_arm_description")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    with pytest.raises(LabError, match="neither an MJCF nor a URDF"):
        load_robot("some_arm_description")
    module.XACRO_PATH = "arm.urdf.xacro"  # type: ignore[attr-defined]
    with pytest.raises(LabError, match="is a xacro; expand it first"):
        load_robot("some_arm_description")


@pytest.mark.parametrize("missing", ["robot_descriptions", "git"])
def test_without_the_package_the_message_names_the_extra(missing, monkeypatch) -> None:
    def imported(name: str) -> None:
        raise ModuleNotFoundError(name=missing)

    monkeypatch.setattr("lab.robots.robot_files.import_module", imported)
    with pytest.raises(LabError, match=r"is not installed; pip install 'virtual-calibration-lab\[robots\]'"):
        load_robot("another_description")


def test_nothing_is_downloaded(monkeypatch, tmp_path, capsys) -> None:
    """The package clones what it misses when it is imported: git may not, and its prints do not reach the terminal."""
    package = tmp_path / "robot_descriptions"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "far_description.py").write_text(
        "import subprocess\nprint('Cloning')\n"
        "git = subprocess.run(['git', 'ls-remote', 'https://localhost:1/arm'], capture_output=True, text=True)\n"
        "assert 'not allowed' in git.stderr, git.stderr\n"
        "git.check_returncode()\n"
    )
    for name in [each for each in sys.modules if each.startswith("robot_descriptions")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("GIT_ALLOW_PROTOCOL", "https")
    with pytest.raises(LabError, match="not on this machine; download it first: robot_descriptions pull far_") as error:
        load_robot("far_description")
    assert isinstance(error.value.__cause__, subprocess.CalledProcessError)
    assert os.environ["GIT_ALLOW_PROTOCOL"] == "https" and capsys.readouterr().out == ""


def test_a_target_that_the_robot_lacks() -> None:
    with pytest.raises(LabError, match="p9"):
        load_robot("irb120").refuse_unknown(("p1", "p9"))


@pytest.mark.parametrize(
    ("name", "says"),
    [
        (
            "arm.urdf.xacro",
            r"is a xacro; expand it first \(xacro \S*arm.urdf.xacro > \S*arm.urdf\), and give \S*arm.urdf$",
        ),
        ("arm.xacro", r"is a xacro; expand it first \(xacro \S*arm.xacro > \S*arm.urdf\), and give \S*arm.urdf$"),
        ("plan.csv", "neither MJCF, URDF nor TOML; there are"),
    ],
)
def test_a_file_that_is_there_is_not_denied(tmp_path, name: str, says: str) -> None:
    with pytest.raises(LabError, match="no such model or file"):
        load_robot(tmp_path / name)
    (tmp_path / name).touch()
    with pytest.raises(LabError, match=says):
        load_robot(tmp_path / name)
