"""Scripts in the test's own process: their work, without loading every library once more."""

import contextlib
import io
import json
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from shared import run_script

from helpers.robots import ROOT

_TAKING = ("lab.studies.executors", "study_runs", "lab.studies.study")


@contextlib.contextmanager
def threads_for_processes() -> Iterator[None]:
    """Processes, which would load every library again, are a thread.

    All modules that take the executor are loaded before it is replaced: one that is loaded meanwhile would keep the
    thread for good.
    """
    taking = [import_module(name) for name in _TAKING]
    with pytest.MonkeyPatch.context() as patch:
        for module in taking:
            patch.setattr(module, "local_executor", lambda *_: ThreadPoolExecutor(1))
        yield


def answer_of(name: str, *flags: object) -> Any:
    """What a script prints with these flags and ``--json``, the work of its processes done by a thread."""
    printed, errors = io.StringIO(), io.StringIO()
    with threads_for_processes(), contextlib.redirect_stdout(printed), contextlib.redirect_stderr(errors):
        run_script(Path(name).stem, [*map(str, flags), "--json"])
    assert not errors.getvalue(), "in a pipe there are no bars"
    return json.loads(printed.getvalue())


def answer_in_processes(name: str, *flags: object) -> Any:
    """The answer of a script run as a program of its own, with as many processes as it likes."""
    command = [sys.executable, str(ROOT / "scripts" / "experiments" / name), *map(str, flags), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    assert not done.stderr, "in a pipe there are no bars"
    return json.loads(done.stdout)
