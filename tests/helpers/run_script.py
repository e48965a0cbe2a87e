"""Scripts in the test's own process: their work, without loading every library once more."""

import contextlib
import importlib.util
import io
import json
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from types import ModuleType
from typing import Any

import pytest

from helpers.robots import ROOT


def script(name: str) -> ModuleType:
    """A script as a module of its own: what a test changes in it is changed for that test alone."""
    spec = importlib.util.spec_from_file_location(name.removesuffix(".py"), ROOT / "scripts" / name)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses look for it
    spec.loader.exec_module(module)
    return module


def answer_of(module: ModuleType, *flags: object) -> Any:
    """What the script's command prints with these flags and ``--json``, the work of its processes done by a thread."""
    printed, errors = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, _one_thread(patch, module):
        patch.setattr(sys, "argv", [module.__name__, *map(str, flags), "--json"])
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(errors):
            module.main()
    assert not errors.getvalue(), "in a pipe there are no bars"
    return json.loads(printed.getvalue())


@contextlib.contextmanager
def _one_thread(patch: pytest.MonkeyPatch, module: ModuleType) -> Iterator[None]:
    def alone(*_: object, **__: object) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(1)

    if hasattr(module, "ProcessPoolExecutor"):
        patch.setattr(module, "ProcessPoolExecutor", alone)
    patch.setattr("lab.studies.progress.local_executor", alone)
    yield
