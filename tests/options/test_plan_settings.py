"""A plan's robot, cell, targets and instrument are those of the run that made it, wherever the plan is used."""

import json
import shutil
from pathlib import Path

import pytest
from helpers.bad_input import run as run_line

import lab
from lab.cli.main import main
from lab.core.errors import LabError
from lab.formats.measurement_csv import write_measurements
from lab.options.plan_settings import settings_of_plan

URDF = """<robot name="arm">
  <link name="base"/>
  <link name="upper"><collision><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.06 0.06"/></geometry></collision>
  </link>
  <link name="lower"><collision><origin xyz="0.15 0 0"/><geometry><box size="0.3 0.05 0.05"/></geometry></collision>
  </link>
  <joint name="axis1" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.25"/>
    <axis xyz="0 0 1"/><limit lower="-2.9" upper="2.9" velocity="2.5" effort="100"/></joint>
  <joint name="axis2" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.45 0 0.05"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="2.5" effort="100"/></joint>
</robot>
"""
CELL = """[[tool]]
name = "p1"
position_mm = [300, 20, 60]
[[tool]]
name = "p2"
position_mm = [300, -20, 60]
[instrument]
position_mm = [2500, 0, 600]
[reflector]
kind = "cat's eye"
"""
PLANNED = ("--robot arm.urdf --cell cell.toml --targets p1,p2 --instrument leica-at960 --poses 10 --candidates 60 "
           "--starts 1 --clearance-mm 5")  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an own robot, its cell, and a plan in ``plan``."""
    folder = tmp_path_factory.mktemp("own")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        Path("arm.urdf").write_text(URDF)
        Path("cell.toml").write_text(CELL)
        assert run_line(f"design {PLANNED} --no-recording --out plan") == 0
    return folder


@pytest.fixture
def own(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of that folder, in which the test runs."""
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def options(run: str) -> dict[str, object]:
    found: dict[str, object] = json.loads(Path(run, "config.json").read_text())["options"]
    return found


def ran(line: str, capsys: pytest.CaptureFixture[str]) -> str:
    capsys.readouterr()
    assert main(line.split()) == 0
    return capsys.readouterr().err


@pytest.mark.thorough
def test_calibrate_measures_a_plan_as_it_was_made(own: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Elsewhere too: the copies in the run's folder are read."""
    Path("elsewhere").mkdir()
    shutil.move("plan", "elsewhere/plan")
    for name in ("arm.urdf", "cell.toml"):
        Path(name).unlink()
    told = ran("calibrate --plan elsewhere/plan/plan.csv --no-recording --out run", capsys)
    assert "taken from elsewhere/plan/config.json: --robot arm.urdf, --cell cell.toml" in told
    used = options("run")
    assert used["targets"] == ["p1", "p2"] and used["instrument"] == "leica-at960"
    assert str(used["cell"]).endswith("inputs/cell.toml") and str(used["robot"]).endswith("inputs/arm.urdf")
    assert json.loads(Path("run/result.json").read_text())["poses"] == 10


@pytest.mark.thorough
def test_options_that_differ_are_kept_and_named(own: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = ran(
        "calibrate --robot arm.urdf --plan=plan/plan.csv --targets p1 --instrument uniform-8um --no-recording --out a",
        capsys,
    )
    assert "warning: --targets is p1" in told and "warning: --instrument is uniform-8um" in told
    assert options("a")["targets"] == ["p1"] and options("a")["instrument"] == "uniform-8um"


@pytest.mark.thorough
def test_a_check_is_in_the_plans_cell_or_a_given_one(own: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("cell.toml").write_text(CELL + '[[obstacle]]\nname="pole"\nshape="box"\nsize_mm=[50,50,50]\n'
                                 "position_mm=[2000,2000,25]\n")  # fmt: skip
    told = ran("design --check plan/plan.csv --no-recording --out b", capsys)
    assert "changed since, so give --cell cell.toml" in told
    told = ran("design --check plan/plan.csv --cell cell.toml --no-recording --out c", capsys)
    assert "warning: --cell" not in told and "changed" not in told and options("c")["cell"] == "cell.toml"


@pytest.mark.thorough
def test_identify_reads_a_filled_in_plan_as_it_was_made(own: Path, capsys: pytest.CaptureFixture[str]) -> None:
    day = lab.simulate(
        "arm.urdf", cell=Path("cell.toml"), targets=("p1", "p2"), instrument="leica-at960", plan=Path("plan/plan.csv")
    )
    write_measurements(Path("plan/day.csv"), day.measurements, (False, False))
    in_python = lab.identify(Path("plan/day.csv"))
    assert in_python.options.instrument == "leica-at960" and in_python.options.cell is not None
    by_names = lab.identify(day.measurements, robot="arm.urdf", cell=Path("cell.toml"), instrument="leica-at960")
    assert in_python.to_dict()["after_mm"] == pytest.approx(by_names.to_dict()["after_mm"])
    assert main(["identify", "plan/day.csv", "--robot", "course2r", "--out", "c"]) == 2  # its joints have other names
    assert "warning: --robot is course2r" in capsys.readouterr().err


def test_only_the_run_of_a_design_states_settings(own: Path) -> None:
    assert settings_of_plan(Path("arm.urdf")) is None
    config = json.loads(Path("plan/config.json").read_text())
    Path("other").mkdir()
    Path("other/config.json").write_text(json.dumps(config | {"command": "inspect"}))
    assert settings_of_plan(Path("other/plan.csv")) is None
    Path("plan/inputs/cell.toml").write_text(CELL.replace("2500", "2600"))
    with pytest.raises(LabError, match=r"cell.toml was changed since the plan was made"):
        settings_of_plan(Path("plan/plan.csv"))
