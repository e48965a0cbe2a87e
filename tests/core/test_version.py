"""The version that the package, its command and its metadata tell is one."""

from importlib import metadata

import lab
from lab.core.version import __version__


def test_there_is_one_version() -> None:
    assert lab.__version__ == __version__ == metadata.version("virtual-calibration-lab")
