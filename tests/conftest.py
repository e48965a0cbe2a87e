"""What every test may ask for; and one BLAS thread a process.

On a busy machine small matrices wait a hundred times longer for a second thread.
"""

import os
import sys
import types
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings
from markupsafe import Markup

for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")  # before numpy is imported; commands started by tests inherit it

settings.register_profile("quick", max_examples=25, derandomize=True, deadline=None, database=None)
settings.load_profile("quick")

_WRITES = {
    "lab.commands.calibrate.recording": "record",
    "lab.commands.design.recording": "record_plan",
}  # by module: the function that writes a file


@pytest.fixture(scope="module")
def nothing_drawn() -> Iterator[None]:
    """Recordings are empty files, and pages and plans have no pictures."""
    with pytest.MonkeyPatch.context() as patch:
        for name, function in _WRITES.items():
            module = types.ModuleType(name)
            setattr(module, function, lambda path, *_: Path(path).write_bytes(b""))
            patch.setitem(sys.modules, name, module)
        patch.setattr("lab.render.svg.inline_svg", lambda picture: Markup())
        patch.setattr("lab.commands.design.figures.write_figures", lambda folder, plan: None)
        yield


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
