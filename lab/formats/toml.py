"""TOML files as plain values."""

import re
import tomllib
from pathlib import Path
from typing import Any

from lab.core.errors import LabError
from lab.core.limits import DEPTH, TOML_BYTES
from lab.core.ranges import NUMBER_SIZE
from lab.formats.text_file import read_text, refuse_unbounded

__all__ = ["is_number", "read_toml"]

_PART = r"""(?:(?<![\w-])[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_DEEP = re.compile(rf"(?:{_PART}[ \t]*+\.[ \t]*+){{{DEPTH.most}}}")  # dotted names: the parser's memory is their square


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file.

    Raises:
        LabError: it cannot be read, is no TOML, or holds more or larger values than a description needs.
    """
    text = read_text(path, TOML_BYTES)
    if deep := _DEEP.search(text):
        line = text.count("\n", 0, deep.start()) + 1
        raise LabError(f"{path}: line {line}: a name of more than {DEPTH.most} {DEPTH.what}; give it fewer")
    try:
        content = tomllib.loads(text)
    except RecursionError as error:
        raise LabError(f"{path}: more than {DEPTH.most} {DEPTH.what}; give it fewer") from error
    except ValueError as error:  # TOMLDecodeError, and Python's own of a number of too many digits
        raise LabError(f"{path}: not a TOML file: {' '.join(str(error).split())}; fix it there") from error
    if not content:
        raise LabError(f"{path}: says nothing; write into it what it is for, or leave it out")
    refuse_unbounded(path, content, finite=False)
    return content


def is_number(value: Any) -> bool:
    """Whether a value is a number that a robot's description may hold."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) in NUMBER_SIZE
