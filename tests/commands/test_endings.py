"""However a command ends, one line tells it: a defect, an interruption, an output that is closed or lacks letters."""

import io
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import pytest
from helpers.bad_input import run, the_line
from helpers.processes import interruptible

from lab.cli import process as program
from lab.core.errors import LabError
from lab.library.result import Result
from lab.options import command as registry

pytestmark = pytest.mark.usefixtures("folder")


def raising(error: BaseException, monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(*_: object) -> None:
        raise error

    monkeypatch.setattr(registry, "load_reference", failing)


def test_a_defect_is_told_in_one_line_and_its_traceback_kept(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    raising(ZeroDivisionError("by\nzero"), monkeypatch)
    assert run("inspect arm.toml") == program.DEFECT == 70
    line = the_line(capfd.readouterr().err)
    (log,) = folder.glob("lab-defect-*.log")
    assert str(log) in line and "ZeroDivisionError: by zero" in line
    kept = log.read_text()
    assert "Traceback" in kept and "in failing" in kept and "arm.toml" in kept


def test_a_defect_without_room_for_its_log_is_told(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tempfile.NamedTemporaryFile", full)
    raising(RuntimeError("x"), monkeypatch)
    assert run("inspect arm.toml") == 70
    assert "no log of it could be written" in the_line(capfd.readouterr().err)


@pytest.mark.parametrize("wrapped", [False, True])
def test_an_interruption_is_130_even_where_a_library_makes_another_error_of_it(
    wrapped: bool, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    error: BaseException = KeyboardInterrupt()
    if wrapped:
        error = ImportError("cannot be loaded")
        error.__cause__ = KeyboardInterrupt()
    raising(error, monkeypatch)
    assert run("inspect arm.toml") == 130
    assert the_line(capfd.readouterr().err) == "lab: interrupted; nothing was written"


def test_an_error_that_is_its_own_cause_is_told(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    error = LabError("x")
    error.__cause__ = error
    raising(error, monkeypatch)
    assert run("inspect arm.toml") == 2
    assert the_line(capfd.readouterr().err) == "lab: x"


def test_too_little_memory_is_no_defect(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    raising(MemoryError(), monkeypatch)
    assert run("inspect arm.toml") == 2
    assert "more memory than there is" in the_line(capfd.readouterr().err)


class Closed(io.StringIO):
    """An output whose reader has gone."""

    def write(self, text: str) -> int:
        raise BrokenPipeError(32, "Broken pipe")


@pytest.mark.parametrize("arguments", ["inspect arm.toml", "inspect arm.toml --json", "--help", "inspect --help"])
def test_a_reader_that_has_seen_enough_is_no_error(
    arguments: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdout", Closed())
    assert run(arguments) == 0
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252", "utf-8"])
def test_a_terminal_of_any_encoding_shows_what_it_can(encoding: str, monkeypatch: pytest.MonkeyPatch) -> None:
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding=encoding))
    program.plain_streams()
    print("before → after: −0.003 ± 0.001 mm, σ at 30°, µm, é, \udcff, ─")
    sys.stdout.flush()
    shown = raw.getvalue().decode(encoding)
    if encoding == "ascii":
        assert shown == "before -> after: -0.003 +- 0.001 mm, sigma at 30deg, um, e, ?, ?\n"
    else:
        assert "0.003" in shown and "mm" in shown and ("→" in shown) == (encoding == "utf-8")


def test_a_model_that_mujoco_cannot_compute_is_no_defect(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    raising(mujoco.FatalError("out of\nmemory"), monkeypatch)
    assert run("inspect arm.toml") == 2
    assert "MuJoCo cannot compute this model (out of memory)" in the_line(capfd.readouterr().err)


@dataclass(frozen=True, repr=False, eq=False)
class Unwarned(Result):
    """A result of another package's command that lacks one of what each has."""

    command = "inspect"
    options: object = None

    def to_dict(self) -> dict[str, Any]:
        return {}

    def columns(self) -> dict[str, Any]:
        return {}


@pytest.mark.parametrize(("result", "missing"), [(Unwarned(), "Unwarned without 'warnings'"), ({}, "returns dict")])
def test_a_result_that_lacks_what_each_has_is_no_defect(
    result: object, missing: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    usual = registry.load_reference
    returning = {"lab.library.inspect:inspect": lambda _: result}
    monkeypatch.setattr(registry, "load_reference", lambda name: returning.get(name) or usual(name))
    assert run("inspect arm.toml") == 2
    assert missing in the_line(capfd.readouterr().err)


def test_what_is_said_is_one_line_that_steers_no_terminal(capfd: pytest.CaptureFixture[str]) -> None:
    program.say("one\ntwo \x1b[31mred\x07 " + "x" * 100_000)
    err = capfd.readouterr().err
    assert err.count("\n") == 1 and len(err) < 1200 and "\x1b" not in err and "\\x1b[31mred\\x07" in err


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="signals of POSIX")
@pytest.mark.parametrize(
    "name",
    ["SIGINT", pytest.param("SIGTERM", marks=pytest.mark.thorough)],
)
def test_a_program_that_is_ended_while_it_writes_says_so_and_leaves_nothing(name: str, folder: Path) -> None:
    before = sorted(folder.iterdir())
    command = [sys.executable, "-m", "lab", "calibrate", "--poses", "20000"]  # seconds of work
    session = {"start_new_session": True, "preexec_fn": interruptible}
    with subprocess.Popen(command, cwd=folder, stdout=-1, stderr=-1, text=True, **session) as started:
        while not list(folder.glob("runs/.*.partial-*")):
            assert started.poll() is None
            time.sleep(0.01)
        os.killpg(started.pid, getattr(signal, name))
        _, err = started.communicate(timeout=60)
    assert started.returncode == 130 and the_line(err).startswith("lab: interrupted")
    assert sorted(folder.iterdir()) == before


@pytest.mark.thorough
@pytest.mark.parametrize(("argv", "closed", "code"), [("inspect arm.toml", ">&-", 0), ("inspect none", "2>&-", 2)])
def test_streams_that_were_closed_before_lead_nowhere(argv: str, closed: str, code: int, folder: Path) -> None:
    ended = subprocess.run(["sh", "-c", f"{sys.executable} -m lab {argv} {closed}"], cwd=folder, capture_output=True)
    assert (ended.returncode, ended.stdout, ended.stderr) == (code, b"", b"")
