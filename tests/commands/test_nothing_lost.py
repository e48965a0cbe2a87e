"""Nothing that stands is lost by a run: neither what it is made from, nor what is no run, nor an earlier run."""

import json
import os
from pathlib import Path

import pytest
from helpers.bad_input import ARM_TOML, contents, run, the_line

from lab.core.errors import LabError
from lab.library.run_folder import free_name, input_files, run_folder

pytestmark = pytest.mark.usefixtures("folder")


@pytest.fixture
def earlier(folder: Path) -> Path:
    """An earlier run, with a robot of its own."""
    with run_folder(folder / "r") as draft:
        (draft / "config.json").write_text(json.dumps({"model_sha256": ""}))
        (draft / "calibrated.toml").write_text(ARM_TOML)
        (draft / "load.json").write_text("{}")
    return folder / "r"


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        ("identify good.csv --robot r/calibrated.toml --out r", "r: holds r/calibrated.toml, an input of this run"),
        ("identify good.csv --robot arm.toml --load r --out r", "r: holds r, an input of this run"),
        ("calibrate --robot r/calibrated.toml --out r", "r: holds r/calibrated.toml"),
        ("identify good.csv --robot arm.toml --out .", "is the working folder, or holds it"),
        ("identify good.csv --robot arm.toml --out ''", "is the working folder, or holds it"),
        ("identify good.csv --robot arm.toml --out ..", "is the working folder, or holds it"),
        ("identify good.csv --robot arm.toml --out ' '", "the name is blank"),
        ("identify good.csv --robot arm.toml --out /", "is the working folder, or holds it"),
        ("identify good.csv --robot arm.toml --out arm.xml", "arm.xml: is a file"),
        ("identify good.csv --robot arm.toml --out arm.toml/x", "arm.toml/x: cannot be written"),
        ("identify good.csv --robot arm.toml --out loop", "loop: cannot be written"),
        (f"identify good.csv --robot arm.toml --out {'x' * 300}", "cannot be written (File name too long)"),
    ],
)
def test_an_input_is_never_inside_what_is_replaced(
    earlier: Path, folder: Path, argv: str, says: str, capfd: pytest.CaptureFixture[str]
) -> None:
    (folder / "loop").symlink_to("loop")
    before = contents(folder)
    assert run(argv) == 2
    assert says in the_line(capfd.readouterr().err)
    assert contents(folder) == before


@pytest.mark.parametrize("kind", ["folder", "link", "stranger"])
def test_what_is_no_file_of_a_run_is_not_replaced(earlier: Path, folder: Path, kind: str) -> None:
    if kind == "folder":
        (earlier / "report.html").mkdir()
        (earlier / "report.html" / "thesis.txt").write_text("years of work")
    elif kind == "link":
        (earlier / "report.html").symlink_to(folder / "arm.toml")
    else:
        (earlier / "notes.txt").write_text("")
    before = contents(folder)
    with pytest.raises(LabError, match="is not a file of a run"), run_folder(earlier):
        raise AssertionError("nothing is to begin")
    assert contents(folder) == before


def test_two_runs_of_one_name_are_two_folders(folder: Path) -> None:
    first = free_name(folder / "runs", "x")
    with run_folder(first):
        second = free_name(folder / "runs", "x")
        assert (first.name, second.name) == ("x", "x-2")
    assert len(free_name(folder, "n" * 4000).name) <= 100


def test_robots_by_path_are_inputs(folder: Path) -> None:
    from lab.options.virtual_campaign import VirtualCampaign

    assert input_files(VirtualCampaign(robot="arm.toml")) == (Path("arm.toml"),)
    assert input_files(VirtualCampaign(robot="irb120")) == ()


def test_a_folder_that_has_gone_is_told(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gone = folder / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    words = r"cannot be written \(No such file or directory\); change to another folder"
    with pytest.raises(LabError, match=words), run_folder(Path("out")):
        raise AssertionError("nothing is to begin")
    os.chdir(folder)
