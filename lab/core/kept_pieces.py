"""Pieces of long work, kept on the disk as they are done, so that work that was stopped goes on where it was.

A piece is there whole, as it was written, or not at all: beside each stands the checksum of its bytes.
"""

import hashlib
import io
import os
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Columns",
    "Keep",
    "Pieces",
    "at_once",
    "current_keep",
    "keep_checked",
    "keeping",
    "left_of",
    "of_one",
    "piece_files",
    "read_checked",
    "write_whole",
]

_LEFT_OVER = re.compile(r"\.(.+)\.partial-\d+")  # what a killed process left of a file
WORTH_S = 5.0  # of processor time: work that takes less is done again, not kept
_SUM = ".sha256"

Columns = Mapping[str, NDArray[Any]]
Keep = Callable[[str, Sequence[NDArray[Any]], Callable[[], Columns]], Columns]


def at_once(stage: str, of: Sequence[NDArray[Any]], work: Callable[[], Columns]) -> Columns:
    """Do a piece of work, and keep nothing."""
    return work()


def of_one(keep: Keep, *names: str) -> Keep:
    """The same, for pieces that follow from something with names, too: of several robots each has its own."""

    def kept(stage: str, of: Sequence[NDArray[Any]], work: Callable[[], Columns]) -> Columns:
        return keep(stage, [np.array(names), *of], work)

    return kept


class Pieces:
    """What one run has done so far, in a folder that is made with the first piece.

    Called with a stage's name, the arrays from which a piece follows and the work that makes it, it returns the piece:
    as it was kept, if it was made of the same arrays, else made now. The same arrays have to give the same piece.

    Attributes:
        kept: whether this process has kept any.
    """

    def __init__(self, folder: Path, label: str, content: bytes) -> None:
        """Begin, or go on with what the folder holds.

        Args:
            label: of a file that says of which run the pieces are.
            content: its.
        """
        self.folder, self.kept = folder, False
        self._label, self._content, self._begun, self._full = label, content, time.process_time(), False

    def __call__(self, stage: str, of: Sequence[NDArray[Any]], work: Callable[[], Columns]) -> Columns:
        """A piece, by the names of its arrays."""
        path = self.folder / f"{stage}-{_digest(of)}.npz"
        known = _unpacked(read_checked(path))
        if known is not None:
            return known
        made = work()
        if not self._full and time.process_time() - self._begun > WORTH_S:
            self._keep(path, made)
        return made

    def _keep(self, path: Path, made: Columns) -> None:
        """Write a piece; where that is not possible the work goes on all the same."""
        try:
            if not self.kept:
                self.folder.mkdir(exist_ok=True)
                write_whole(self.folder / self._label, self._content)
            keep_checked(path, _packed(made))
            self.kept = True
        except OSError:
            self._full = True


_CURRENT: ContextVar[Keep] = ContextVar("keep", default=at_once)


@contextmanager
def keeping(keep: Keep) -> Iterator[None]:
    """Let the work inside the block keep its pieces."""
    token = _CURRENT.set(keep)
    try:
        yield
    finally:
        _CURRENT.reset(token)


def current_keep() -> Keep:
    """How the work that is running keeps its pieces; nothing is kept where nobody asked for it."""
    return _CURRENT.get()


def write_whole(path: Path, content: Any) -> None:
    """Write bytes as a file that is there whole, on the disk, or not at all.

    Raises:
        OSError: the disk is full, or does not let it be written.
    """
    draft = path.parent / f".{path.name}.partial-{os.getpid()}"
    try:
        with draft.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except BaseException:
        with suppress(OSError):
            draft.unlink()
        raise


def keep_checked(path: Path, content: bytes) -> None:
    """Write a file, and its checksum beside it, as ``sha256sum`` writes it.

    Raises:
        OSError: the disk is full, or does not let it be written.
    """
    write_whole(path, content)
    write_whole(path.with_suffix(_SUM), _sum_line(content, path).encode())


def piece_files(path: Path) -> tuple[Path, Path]:
    """A file that is kept with its checksum, and the file of that."""
    return path, path.with_suffix(_SUM)


def left_of(path: Path) -> str:
    """The name of the file that a killed process had half written as this one; "" of any other file."""
    found = _LEFT_OVER.fullmatch(path.name)
    return "" if found is None else found[1]


def read_checked(path: Path) -> bytes | None:
    """What was written with its checksum; None if it is not there, or not as it was written."""
    try:
        content = path.read_bytes()
        said = path.with_suffix(_SUM).read_bytes()
    except OSError:
        return None
    return content if said == _sum_line(content, path).encode() else None


def _sum_line(content: bytes, path: Path) -> str:
    return f"{hashlib.sha256(content).hexdigest()}  {path.name}\n"


def _digest(arrays: Sequence[NDArray[Any]]) -> str:
    """Of types, shapes and numbers."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f"{array.dtype.str}{array.shape};".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]


def _packed(columns: Columns) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **columns)
    return buffer.getvalue()


def _unpacked(content: bytes | None) -> Columns | None:
    if content is None:
        return None
    with np.load(io.BytesIO(content), allow_pickle=False) as found:
        return {name: found[name] for name in found.files}
