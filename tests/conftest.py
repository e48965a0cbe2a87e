"""Provide what every test may ask for, and keep compiled modules.

Without compiled modules each process that the tests start compiles the whole package again.
"""

import gc
import os
import sys
from collections import Counter
from collections.abc import Generator, Iterator
from contextlib import nullcontext

import pytest
from helpers.drawing import nothing_drawn
from hypothesis import settings

from lab.core.errors import options_as_flags

os.environ["BROWSER"] = "true"  # the program, which opens nothing
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

settings.register_profile("quick", max_examples=25, derandomize=True, deadline=None, database=None)
settings.load_profile("quick")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Of a test marked ``sampled(n)`` every n-th case is of the default suite, and the others are thorough."""
    seen: Counter[str] = Counter()
    for item in items:
        if marker := item.get_closest_marker("sampled"):
            name = item.nodeid.partition("[")[0]
            if seen[name] % marker.args[0]:
                item.add_marker(pytest.mark.thorough)
            seen[name] += 1


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Modules and test items live to the end: the garbage collector does not walk through them again and again."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()
        gc.set_threshold(20_000, 20, 20)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Only tests marked ``figures`` draw and record, and only these and those marked ``pages`` write pages.

    Fixtures that they are the first to ask for are included.
    Messages name options as flags, whether a test runs a command or makes the call that it is; that a call names
    arguments is for ``tests/core/test_errors.py``.
    """
    pages = item.get_closest_marker("pages") is not None
    drawn = nullcontext() if item.get_closest_marker("figures") else nothing_drawn(pages=pages)
    with drawn, options_as_flags():
        return (yield)


@pytest.fixture
def strict_recordings() -> Iterator[None]:
    """Rerun raises where it would only warn."""
    import rerun as rr

    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


@pytest.fixture(scope="session")
def home(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment with a home of their own for rerun's programs: they keep settings there."""
    folder = tmp_path_factory.mktemp("home")
    return os.environ | {"HOME": str(folder), "XDG_CONFIG_HOME": str(folder), "XDG_DATA_HOME": str(folder)}
