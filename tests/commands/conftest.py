"""A working folder for commands, and runs of them that are made once."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from helpers.bad_input import ARM_TOML, ARM_URDF, ARM_XML, csv
from helpers.browser import BROWSERS, Browser, installed, opened
from helpers.campaigns import calibration, run_of, session
from helpers.drawing import nothing_drawn
from helpers.writing_commands import inputs_of_commands

from lab.cli.main import main
from lab.library.calibration_result import CalibrationResult
from lab.library.identify import identify


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with a good robot of each kind and good measurements."""
    monkeypatch.chdir(tmp_path)
    for name, text in {"arm.toml": ARM_TOML, "arm.xml": ARM_XML, "arm.urdf": ARM_URDF, "good.csv": csv()}.items():
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """A browser without a window, in which pages are opened; the test is skipped where there is none."""
    if (program := installed()) is None:
        pytest.skip(f"no Chromium here ({', '.join(BROWSERS)}): the pages are not opened")
    with opened(program, tmp_path_factory.mktemp("home")) as browser:
        yield browser


@pytest.fixture(scope="session")
def seven() -> CalibrationResult:
    """The calibration of the virtual robot of seed 7."""
    return calibration(seed=7)


@pytest.fixture(scope="session")
def seven_run() -> Path:
    """The folder of that calibration, without page, pictures and recording."""
    return run_of(seed=7)


@pytest.fixture(scope="session")
def command_inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What ``helpers.writing_commands.COMMANDS`` read, to be copied."""
    folder = tmp_path_factory.mktemp("inputs")
    with pytest.MonkeyPatch.context() as patch, nothing_drawn():
        patch.chdir(folder)
        return inputs_of_commands(folder)


@pytest.fixture(scope="session")
def drawn_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of that calibration as the command writes it, for tests marked ``figures``."""
    return _written(tmp_path_factory, "run", "calibrate", "--seed", "7")


@pytest.fixture(scope="session")
def drawn_plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a small plan, for tests marked ``figures``."""
    return _written(tmp_path_factory, "plan", "design", "--candidates", "100", "--starts", "1", "--poses", "12")


@pytest.fixture(scope="session")
def drawn_study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a small study, for tests marked ``figures``."""
    grid = 'name = "grid"\nrobots = 4\ndraws = 4\nfresh = 20\n[factors]\ncriterion = "random"\nposes = [12, 20]\n'
    file = tmp_path_factory.mktemp("grid") / "grid.toml"
    file.write_text(grid)
    return _written(tmp_path_factory, "study", "study", str(file), "--workers", "1")


def _written(tmp_path_factory: pytest.TempPathFactory, name: str, *arguments: str) -> Path:
    folder = tmp_path_factory.mktemp("runs") / name
    assert main([*arguments, "--out", str(folder), "--json"]) == 0
    return folder


@pytest.fixture(scope="session")
def dated_runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four dated calibrations in 30 poses each; before the last the zero of joint 3 moved by 0.5 mrad. Read only."""
    day = session(poses=120, seed=7, targets=("p1", "p2", "p3")).measurements
    folder = tmp_path_factory.mktemp("dated")
    with nothing_drawn():
        for i, at in enumerate(("2026-01-10", "2026-02-11", "2026-03-09", "2026-04-14")):
            part = day[30 * i : 30 * i + 30]
            if i == 3:
                joints = part.joints.copy()
                joints[:, 2] -= 0.5e-3  # the controller reports less than where the joint stands
                part = replace(part, joints=joints)
            identify(part, robot="irb120", instrument="uniform-8um", date=at, no_recording=True).save(
                folder / f"run{3 - i}"
            )
    return folder
