"""Pictures and recordings left out: drawing them takes most of a command's time."""

import sys
import types
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from markupsafe import Markup

_WRITES = {
    "lab.commands.calibrate.recording": "record",
    "lab.commands.error_recording": "record_compensation record_verification",
    "lab.commands.design.recording": "record_plan",
    "lab.extensions.dynamics.recording": "record_dynamics record_payload",
}  # by module: the functions that write a file


@contextmanager
def nothing_drawn() -> Iterator[None]:
    """Recordings are empty files, pages have empty pictures, and studies have none."""
    with pytest.MonkeyPatch.context() as patch:
        for name, functions in _WRITES.items():
            module = types.ModuleType(name)
            for function in functions.split():
                setattr(module, function, lambda path, *_: Path(path).write_bytes(b""))
            patch.setitem(sys.modules, name, module)
        patch.setattr("lab.render.charts.chart.inline_svg", lambda picture: Markup())
        patch.setattr("lab.commands.study.document.pictures_of", lambda _: {})
        yield
