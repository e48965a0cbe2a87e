"""The gate of every file that is read: only regular files of a stated size, as text, and values that are finite."""

import os
import stat
from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any

from lab.core.errors import LabError
from lab.core.limits import DEPTH, SEED, VALUES, Limit

__all__ = ["read_bytes", "read_text", "refuse_unbounded"]

_MARK = b"\xef\xbb\xbf"  # by which some editors begin a file in UTF-8


def read_bytes(path: Path, most: Limit, mend: str = "check the path") -> bytes:
    """The content of a regular file.

    Args:
        most: how large it may be.
        mend: what to do if it cannot be read, for the end of the message.

    Raises:
        LabError: it cannot be read, is no regular file (a device or a pipe may never end), or is too large.
    """
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):
            kind = "a directory" if stat.S_ISDIR(found.st_mode) else "no regular file"
            raise LabError(f"{path}: cannot be read (it is {kind}); {mend}")
        most(path, found.st_size)
        with open(path, "rb", opener=_without_waiting) as file:
            content = file.read(most.most + 1) or b""
    except OSError as error:
        raise LabError(f"{path}: cannot be read ({error.strerror}); {mend}") from error
    except ValueError as error:
        if isinstance(error, LabError):
            raise
        raise LabError(f"{str(path)!r}: is no path ({error}); {mend}") from error
    most(path, content)
    return content


def _without_waiting(path: str, flags: int) -> int:
    """Some files of the system call themselves regular and keep a reader waiting for what may never come."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def read_text(path: Path, most: Limit, mend: str = "check the path") -> str:
    """The text of a file in UTF-8, without the mark by which some editors begin it.

    Args:
        most: how large it may be.
        mend: what to do if it cannot be read, for the end of the message.

    Raises:
        LabError: as of ``read_bytes``, or it is not in UTF-8, or has zero bytes (as UTF-16 without a mark has).
    """
    content = read_bytes(path, most, mend).removeprefix(_MARK)
    try:
        text, wrong = content.decode("utf-8"), content.find(b"\0")
    except UnicodeDecodeError as error:
        text, wrong = "", error.start
    if wrong >= 0:
        raise LabError(f"{path}: not a text file in UTF-8 (byte {wrong}); save it as UTF-8")
    return text


def refuse_unbounded(where: object, content: Any, *, finite: bool = True) -> None:
    """Refuse values, as TOML and JSON have them, that are nested too deeply, too many, not finite or too large.

    Args:
        finite: whether numbers that are not finite are refused here; not where their reader says more of them.

    Raises:
        LabError: with the name of the value.
    """
    waiting, count = [("", content, 0)], 0
    while waiting:
        name, value, depth = waiting.pop()
        count += 1
        if isinstance(value, Mapping | list):
            DEPTH(f"{where}: {name}" if name else where, depth)
            named = value.items() if isinstance(value, Mapping) else ((name, each) for each in value)
            waiting.extend((str(key), each, depth + 1) for key, each in named)
            VALUES(where, count + len(waiting))
        elif finite and isinstance(value, float) and not isfinite(value):
            raise LabError(f"{where}: {name} is {value}; give a finite number")
        elif isinstance(value, int) and abs(value) > SEED.most:
            raise LabError(f"{where}: {name} is a whole number of more than 63 bits; give a smaller one")
