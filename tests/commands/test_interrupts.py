"""A command that is interrupted ends with 130 and one line, and leaves what there was.

The commands run in forks of the tests' process, so that the signal meets their work and not only Python's start. The
long run (``-m slow``) interrupts as often as ``LAB_INTERRUPTS`` says.
"""

import os
import shlex
import shutil
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from helpers.bad_input import contents, run, the_line
from helpers.campaigns import own_copy
from helpers.writing_commands import COMMANDS, forked, whole

from lab.cli.main import main

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "fork"), reason="forks of POSIX"),
    pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning"),
]
EARLY = 99  # interrupted before the program's first line
LONGEST_S = 120.0  # that a command may go on after an interruption


@pytest.fixture(scope="module")
def made(command_inputs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs and files that the commands are given; each test leaves them as they were."""
    place = own_copy(command_inputs, tmp_path_factory.mktemp("interrupted") / "here")
    shutil.copytree(place / "day2", place / "run")
    return place


def started(argv: str, said: Path) -> tuple[int, float]:
    """A command as a program runs it, with its own handling of signals, and when it began."""
    ready, tell = os.pipe()

    def program() -> int:
        sys.argv = ["lab", *shlex.split(argv)]
        signal.signal(signal.SIGINT, signal.default_int_handler)
        os.write(tell, b".")
        try:
            return main()
        except KeyboardInterrupt:
            return EARLY

    child = forked(program, said)
    os.close(tell)
    os.read(ready, 1)
    os.close(ready)
    return child, time.perf_counter()


def ended_by_itself(child: int) -> int:
    """The exit code; a command that goes on for too long is killed, and its code is that of a signal."""
    for _ in range(int(LONGEST_S / 0.01)):
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.01)
    os.kill(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def interrupted(name: str, count: int, place: Path, said: Path) -> list[int]:
    """Interrupt a command so often, each at a random moment; the codes with which it ended."""
    argv, before = f"{COMMANDS[name]} --out run --overwrite", contents(place)
    child, began = started(f"{COMMANDS[name]} --out other", said)
    usual = ended_by_itself(child)
    seconds = time.perf_counter() - began
    assert usual in (0, 1), said.read_text()
    shutil.rmtree(place / "other")
    codes, rng = [], np.random.default_rng(len(name))
    for moment in rng.uniform(0, seconds, count):
        child, _ = started(argv, said)
        time.sleep(moment)
        os.kill(child, signal.SIGINT)
        codes.append(code := ended_by_itself(child))
        after, words = contents(place), said.read_text()
        assert whole(place / "run")
        assert code in (usual, 130, EARLY), (name, moment, code, words)
        if code == 130:
            assert the_line(words).startswith("lab: interrupted"), words
        done = code == usual or "run was written before" in words
        kept, stood = (
            {path: each for path, each in there.items() if not (done and path.partition("/")[0] == "run")}
            for there in (after, before)
        )
        assert kept == stood, sorted({*after} ^ {*before})
        if done:
            shutil.rmtree(place / "run")
            shutil.copytree(place / "day2", place / "run")
    return codes


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["verify"])
def test_an_interrupted_command_ends_with_130_and_leaves_what_there_was(
    name: str, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(made)
    assert interrupted(name, 4, made, tmp_path / "said").count(130) >= 1


def test_an_interruption_after_the_run_was_written_says_so(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """While its words are printed: the run stands, and "nothing was written" would not be true."""

    def late(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("lab.report.terminal.print_document", late)
    assert run("kinematics arm.toml --joints 1,2,3 --out there") == 130
    assert the_line(capfd.readouterr().err).endswith("there was written before") and whole(folder / "there")


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_commands_interrupted_at_any_moment_leave_what_there_was(
    name: str, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(made)
    count = max(int(os.environ.get("LAB_INTERRUPTS", "60")) // len(COMMANDS), 3)
    codes = interrupted(name, count, made, tmp_path / "said")
    print(name, {code: codes.count(code) for code in set(codes)})
    assert codes.count(130) >= 1
