"""Bad input to the command line: one line that names the place and the mend, exit code 2, and no half-written run."""

import errno
import io
import sys
from pathlib import Path

import pytest
from helpers.bad_input import Case, assert_told_in_one_line, run, the_line

pytestmark = pytest.mark.usefixtures("folder")


CASES = [
    Case("cli: no command", "", ("calibrate, identify, example, inspect", "--help")),
    Case("cli: mistyped command", "callibrate", ("callibrate", "is calibrate meant", "--help")),
    Case("cli: unknown command", "frobnicate", ("frobnicate", "calibrate, identify, example, inspect", "--help")),
    Case("cli: identify nothing", "identify", ("identify", "PATH", "--help")),
    Case("cli: unknown flag", "calibrate --bogus 3", ("--bogus", "--help")),
    Case("cli: frames not whole", "kinematics arm.toml --between a 2", ("--between: not understood; give FIRST LAST",)),
    Case("cli: poses not whole", "calibrate --poses 1.5", ("--poses", "'1.5' is not a whole number")),
    Case("cli: gate not a number", "calibrate --gate-mm wide", ("--gate-mm", "'wide' is not a number")),
    Case("cli: value missing", "calibrate --poses", ("--poses", "value is missing")),
    Case("cli: one argument too many", "inspect arm.toml more", ("more", "--help")),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_bad_input_is_told_in_one_line(case: Case, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert_told_in_one_line(case, folder, capfd)


def test_output_that_cannot_be_written_is_told(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    class Full(io.StringIO):
        def flush(self) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(sys, "stdout", Full())
    assert run("inspect arm.toml --json") == 2
    assert "No space left on device" in the_line(capfd.readouterr().err)
