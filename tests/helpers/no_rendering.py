"""Commands without their pictures: for tests of what a run's other files hold. Drawing has tests of its own."""

import sys
import types
from collections.abc import Iterator
from pathlib import Path

import pytest

_WRITES = {
    "lab.commands.calibrate.recording": ("record", ""),
    "lab.commands.calibrate.report": ("write_report", ""),
    "lab.commands.design.recording": ("record_plan", ""),
    "lab.commands.design.report": ("write_plan_report", "report.html"),
}  # by module: what it is asked for, and which file that writes into a folder


@pytest.fixture(scope="module", autouse=True)
def nothing_drawn() -> Iterator[None]:
    """Recordings and reports are empty files, and a plan has no pictures."""
    with pytest.MonkeyPatch.context() as patch:
        for name, (function, file) in _WRITES.items():
            module = types.ModuleType(name)
            setattr(module, function, lambda path, *_, file=file: Path(path, file).write_bytes(b""))
            patch.setitem(sys.modules, name, module)
        patch.setattr("lab.commands.design.figures.plot_plan", lambda folder, plan: None)
        yield
