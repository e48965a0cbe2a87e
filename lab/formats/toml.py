"""TOML files as plain values."""

import tomllib
from pathlib import Path
from typing import Any

from lab.core.errors import LabError

__all__ = ["is_number", "read_toml"]

_LARGEST = 1e15  # of any number; squares of more overflow


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file.

    Raises:
        LabError: it cannot be read, or is no TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise LabError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise LabError(f"{path}: not a TOML file: {' '.join(str(error).split())}; fix it there") from error


def is_number(value: Any) -> bool:
    """Whether a value is a number that a robot's description may hold."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < _LARGEST
