"""No room, no right, another writer, a folder that goes away, a clock set back: one line, and what stood still stands.

Every command that writes a folder is tried, in forks of the tests' process.
"""

import os
import shutil
import signal
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest
from helpers.bad_input import contents, run, the_line
from helpers.writing_commands import COMMANDS, MIGRATE, ended, forked, inputs_of_commands, older_run, whole

from lab.core.whole_folder import draft_of

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="forks of POSIX"),
    pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning"),
]
STUDY = "study study.toml --workers 1"
CHEAP = ("verify", "payload", "import", "certify")  # the others with -m slow
EACH = [pytest.param(name, marks=() if name in CHEAP else pytest.mark.slow) for name in (*COMMANDS, "study")]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs and files that the commands are given; each test leaves them as they were."""
    place, here = tmp_path_factory.mktemp("places"), Path.cwd()
    os.chdir(place)
    try:
        return inputs_of_commands(place)
    finally:
        os.chdir(here)


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


@pytest.fixture
def older(place: Path) -> Path:
    """A run as an older lab wrote it, which lab migrate writes again where it stands."""
    older_run(place)
    return place / "older"


def test_a_migration_without_room_leaves_the_run_as_it_was(older: Path, place: Path, tmp_path: Path) -> None:
    before = contents(place)

    def full() -> int:
        without_room()
        return run(MIGRATE)

    assert ended(forked(full, said := tmp_path / "said")) == 2
    assert "older: cannot be written (File too large); nothing was changed" in the_line(said.read_text())
    assert contents(place) == before


def test_a_migration_whose_draft_goes_away_leaves_the_run_as_it_was(older: Path, place: Path, tmp_path: Path) -> None:
    before, over = contents(place), threading.Event()

    def taken_away() -> None:  # at once: who deletes file by file goes on in the folder that the draft becomes
        while not over.wait(0.0005):
            for draft in place.glob(".older.partial-*"):
                with suppress(OSError):
                    draft.rename(tmp_path / str(time.monotonic_ns()))

    thread = threading.Thread(target=taken_away)
    child = forked(lambda: run(MIGRATE), said := tmp_path / "said")
    thread.start()
    code = ended(child)
    over.set()
    thread.join()
    assert (code == 2 and the_line(said.read_text()) and contents(place) == before) or (code == 0 and whole(older))


def test_a_second_migration_is_told(older: Path, place: Path, tmp_path: Path) -> None:
    before = contents(place)
    with draft_of(older, replacing=True) as draft:
        assert ended(forked(lambda: run(MIGRATE), said := tmp_path / "said")) == 2
        assert "older: is being written by another run" in the_line(said.read_text())
        shutil.copytree(older, draft, dirs_exist_ok=True)
    assert contents(place) == before


@pytest.mark.parametrize("kind", ["link", "folder", "pipe"])
def test_a_run_with_what_is_no_file_is_not_migrated(kind: str, older: Path, place: Path, tmp_path: Path) -> None:
    """A link to the folder above would be copied into itself without end, and a pipe waited for."""
    stray = older / "stray"
    {"link": lambda: stray.symlink_to(".."), "folder": stray.mkdir, "pipe": lambda: os.mkfifo(stray)}[kind]()
    try:
        before = sorted(path.name for path in place.iterdir())
        assert ended(forked(lambda: run(MIGRATE), said := tmp_path / "said")) == 2
        assert "older: holds stray, which is not a file of a run" in the_line(said.read_text())
        assert sorted(path.name for path in place.iterdir()) == before
    finally:
        shutil.rmtree(older)


@pytest.mark.parametrize("ending", [signal.SIGKILL, signal.SIGINT])
def test_a_migration_that_is_ended_leaves_the_old_run_or_the_new_one(
    ending: signal.Signals, older: Path, place: Path, tmp_path: Path
) -> None:
    """At moments over its time: before it begins, while it copies, while it puts the new run in its place."""
    old = contents(older)
    for i in range(12):
        child = forked(lambda: run(MIGRATE), said := tmp_path / "said")
        time.sleep(0.004 * i)
        os.kill(child, ending)
        ended(child)
        now = contents(older) if older.exists() else {}
        aside = list(place.glob(".older.replaced-*"))
        assert now == old or aside or whole(older), said.read_text()
        assert ended(forked(lambda: run(MIGRATE))) == 0 and whole(older)
        assert not list(place.glob(".older.*"))
        older_run(place)


@pytest.mark.parametrize("name", EACH[:-1])
def test_a_folder_that_goes_away_is_told_and_the_earlier_run_stands(name: str, place: Path, tmp_path: Path) -> None:
    """Somebody empties the disk of what has a dot in front."""
    before, over = contents(place), threading.Event()

    def emptied() -> None:
        while not over.wait(0.001):
            for draft in place.glob(".run.partial-*"):
                shutil.rmtree(draft, ignore_errors=True)

    thread = threading.Thread(target=emptied)
    child = forked(lambda: run(f"{COMMANDS[name]} --out run --overwrite"), said := tmp_path / "said")
    thread.start()
    code = ended(child)
    over.set()
    thread.join()
    line = the_line(said.read_text())
    assert code == 2 and line.startswith("lab: run: ") and "(No such file or directory)" in line
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
