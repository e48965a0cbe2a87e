"""A command that is killed leaves nothing half-written under its name, and what is done again is whole.

The commands run in forks of the tests' process, so that a kill meets their work and not only Python's start. The long
run (``-m slow``) kills as often as ``LAB_KILLS`` says.
"""

import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from helpers.bad_input import run
from helpers.campaigns import own_copy
from helpers.writing_commands import COMMANDS, ended, forked, whole

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "fork"), reason="forks of POSIX"),
    pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning"),
]


@pytest.fixture
def made(command_inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Runs and files that the commands are given."""
    place = own_copy(command_inputs, tmp_path / "here")
    monkeypatch.chdir(place)
    return place


def moments(count: int, seconds: float, rng: np.random.Generator) -> Iterator[float]:
    """At random over a command's time and a little more."""
    return (float(each) for each in rng.uniform(0, 1.1 * seconds, count))


def killed(name: str, count: int, folder: Path) -> None:
    """Kill a command so often; an earlier run is in its place or not, alternately."""
    argv = f"{COMMANDS[name]} --out run --overwrite"
    started = time.perf_counter()
    assert (code := ended(forked(lambda: run(argv)))) in (0, 1), name
    seconds, before = time.perf_counter() - started, sorted(path.name for path in folder.iterdir())
    assert "run" in before and whole(folder / "run")
    for i, moment in enumerate(moments(count, seconds, np.random.default_rng(len(name)))):
        place = folder / "run"
        had = i % 2 == 0 and place.exists()
        if not had and place.exists():
            shutil.rmtree(place)
        ended(forked(lambda: run(argv)), moment)
        whole(place)
        assert all(path.name in before or path.name.startswith(".run.") for path in folder.iterdir())
        assert ended(forked(lambda: run(argv))) == code and whole(place)
        assert sorted(path.name for path in folder.iterdir()) == before


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["payload"])
def test_a_killed_command_leaves_nothing_half_written(name: str, made: Path) -> None:
    killed(name, 2, made)


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_commands_killed_at_any_moment_leave_nothing_half_written(name: str, made: Path) -> None:
    killed(name, -(-int(os.environ.get("LAB_KILLS", "30")) // (len(COMMANDS) + 1)), made)


def study_bytes(place: Path) -> dict[str, bytes]:
    """What a study ends with, less what says when and where it ran."""
    return {path.name: path.read_bytes() for path in (place / "campaigns").rglob("*") if path.is_file()}


@pytest.mark.slow
def test_a_killed_study_goes_on_to_the_same_bytes(made: Path) -> None:
    argv = "study study.toml --workers 1"
    started = time.perf_counter()
    assert run(f"{argv} --out straight") == 0
    seconds, wanted = time.perf_counter() - started, study_bytes(made / "straight")
    assert wanted
    count = -(-int(os.environ.get("LAB_KILLS", "30")) // (len(COMMANDS) + 1))
    for i, moment in enumerate(moments(count, seconds, np.random.default_rng(0))):
        place = made / f"killed{i}"
        ended(forked(lambda place=place: run(f"{argv} --out {place.name}")), moment)
        again = f"{argv} --out {place.name}" + (" --resume" if (place / "config.json").exists() else "")
        assert run(again) == 0
        assert study_bytes(place) == wanted
