"""Pages, pictures and recordings left out: they take most of a command's time."""

import sys
import types
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from markupsafe import Markup

from lab.commands.result import Result

_WRITES = {
    "lab.commands.calibrate.recording": "record",
    "lab.commands.error_recording": "record_compensation record_verification",
    "lab.commands.design.recording": "record_plan",
    "lab.extensions.dynamics.recording": "record_dynamics record_payload",
}  # by module: the functions that write a file
_REPORT = Result.report


@contextmanager
def nothing_drawn(*, pages: bool = False) -> Iterator[None]:
    """Leave out the drawings of results: recordings are empty files, and studies have no figures.

    Args:
        pages: write pages, with empty pictures; else they are empty files, too.
    """
    with pytest.MonkeyPatch.context() as patch:
        for name, functions in _WRITES.items():
            module = types.ModuleType(name)
            for function in functions.split():
                setattr(module, function, lambda path, *_: _empty(path))
            patch.setitem(sys.modules, name, module)
        patch.setattr("lab.render.charts.chart.inline_svg", lambda picture: Markup())
        patch.setattr("lab.commands.study.document.pictures_of", lambda _: {})
        patch.setattr(Result, "report", _REPORT if pages else lambda self, path: _empty(path))
        yield


def _empty(path: str | Path) -> Path:
    Path(path).write_bytes(b"")
    return Path(path)
