"""No room, no right, another writer, a folder that goes away, a clock set back: one line, and what stood still stands.

Every command that writes a folder is tried, in forks of the tests' process.
"""

import os
import shutil
import signal
import sys
import time
from pathlib import Path

import pytest
from helpers.bad_input import contents, run, the_line
from helpers.campaigns import own_copy
from helpers.writing_commands import COMMANDS, ended, forked, whole

from lab.core.errors import LabError
from lab.core.whole_folder import draft_of
from lab.library.run_folder import run_folder

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="forks of POSIX"),
    pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning"),
]
STUDY = "study study.toml --workers 1"
CHEAP = ("verify", "import")  # the others with -m slow
EACH = [pytest.param(name, marks=() if name in CHEAP else pytest.mark.slow) for name in (*COMMANDS, "study")]


@pytest.fixture(scope="module")
def made(command_inputs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs and files that the commands are given; each test leaves them as they were."""
    return own_copy(command_inputs, tmp_path_factory.mktemp("places") / "here")


@pytest.fixture
def place(made: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, in which a run of each command stands as ``run``."""
    monkeypatch.chdir(made)
    shutil.rmtree(made / "run", ignore_errors=True)
    shutil.copytree(made / "day2", made / "run")
    return made


def without_room() -> None:
    """Files of this process have 400 bytes at most, as on a disk that is full; Python's own are not written."""
    import resource

    sys.dont_write_bytecode = True
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (400, 400))


@pytest.mark.parametrize("name", EACH[:-1])
def test_a_disk_that_is_full_is_told_and_the_earlier_run_stands(name: str, place: Path, tmp_path: Path) -> None:
    before, argv = contents(place), f"{COMMANDS[name]} --out run --overwrite"

    def full() -> int:
        without_room()
        return run(argv)

    said = tmp_path / "said"
    assert ended(forked(full, said)) == 2
    line = the_line(said.read_text())
    assert "run: writing failed (File too large)" in line and "free disk space" in line
    assert contents(place) == before and whole(place / "run")


@pytest.mark.parametrize("name", EACH[:-1])
def test_a_place_that_takes_no_folder_is_told_before_work_begins(name: str, place: Path, tmp_path: Path) -> None:
    if not Path("/sys/kernel").is_dir():
        pytest.skip("a place in which nobody may write")
    before = contents(place)
    said = tmp_path / "said"
    assert ended(forked(lambda: run(f"{COMMANDS[name]} --out /sys/kernel/run"), said)) == 2
    assert "/sys/kernel/run: cannot be written (" in the_line(said.read_text())
    assert contents(place) == before


@pytest.mark.parametrize("name", EACH)
def test_of_two_writers_the_second_is_told(name: str, place: Path, tmp_path: Path) -> None:
    shutil.rmtree(place / "run")
    with draft_of(place / "run", replacing=False):
        child = forked(lambda: run(f"{COMMANDS.get(name, STUDY)} --out run"), said := tmp_path / "said")
        assert ended(child) == 2
    assert "run: is being written by another run" in the_line(said.read_text())
    assert sorted(path.name for path in place.glob(".run.*")) == []


def test_a_folder_that_goes_away_is_told_and_the_earlier_run_stands(place: Path) -> None:
    """Somebody empties the disk of what has a dot in front."""
    before = contents(place)
    with (
        pytest.raises(LabError, match=r"run: writing failed \(No such file or directory\)"),
        run_folder(place / "run", overwrite=True) as draft,
    ):
        shutil.rmtree(draft)
        (draft / "result.json").write_text("{}")
    assert contents(place) == before


@pytest.mark.parametrize("name", EACH)
def test_a_clock_set_back_changes_nothing(name: str, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten years back when it starts, and a minute less with every look."""
    looks, now = iter(range(10**9)), time.time()
    monkeypatch.setattr(time, "time", lambda: now - 3e8 - 60 * next(looks))
    argv = f"{COMMANDS[name]} --out run --overwrite" if name in COMMANDS else f"{STUDY} --out late"
    assert ended(forked(lambda: run(argv))) in (0, 1)
    if name in COMMANDS:
        assert whole(place / "run")
    shutil.rmtree(place / "late", ignore_errors=True)
