"""The processes that do the work of a study."""

import signal
import subprocess
import sys
import textwrap
from fractions import Fraction
from pathlib import Path

import pytest

from lab import extension_points
from lab.core.errors import LabError
from lab.studies.executors import local_executor

SCRIPT = """\
    import os
    from lab.studies.executors import local_executor
    with local_executor(1) as pool:
        assert pool.submit(os.getpid).result() != os.getpid()
    print("done")
"""


@pytest.mark.parametrize("started", ["unguarded", pytest.param("standard input", marks=pytest.mark.thorough)])
def test_a_script_needs_no_guard(started: str, tmp_path: Path) -> None:
    """Its processes do not run it again, so that it ends as it does with one; nothing but its own line is printed."""
    script = tmp_path / "script.py"
    script.write_text(textwrap.dedent(SCRIPT))
    command = [sys.executable, *([] if started == "standard input" else [str(script)])]
    with script.open() as text:
        done = subprocess.run(command, stdin=text, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "done\n", "")


def blocked() -> bool:
    """Whether an interruption is kept from this process."""
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])


@pytest.mark.thorough
@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="of POSIX")
def test_workers_start_with_interruptions_blocked() -> None:
    """Else one that comes while they import is a traceback among the parent's own lines."""
    with local_executor(1) as pool:
        assert pool.submit(blocked).result()
    assert not blocked()


def test_objects_of_this_program_reach_its_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that a module defines; an object of a script alone stays unknown there."""
    monkeypatch.setattr(extension_points, "_given", {})
    extension_points.add("lab.samplers", "fractions", Fraction)
    extension_points.add("lab.samplers", "script", type("Own", (), {"__module__": "__main__"}))
    with local_executor(1) as pool:
        assert pool.submit(extension_points.load, "lab.samplers", "fractions").result() is Fraction
        with pytest.raises(LabError, match="'script' is not registered"):
            pool.submit(extension_points.load, "lab.samplers", "script").result()
