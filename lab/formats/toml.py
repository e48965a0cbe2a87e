"""TOML files, read."""

import tomllib
from pathlib import Path
from typing import Any

from lab.core.errors import LabError

_LARGEST = 1e15  # of any number; squares of more overflow


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a file.

    Raises:
        LabError: it cannot be read, or is no TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise LabError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise LabError(f"{path}: not a TOML file: {' '.join(str(error).split())}; mend it there") from error


def is_number(value: Any) -> bool:
    """A number that can be true of an arm."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < _LARGEST
