"""Folders and files written whole or not at all, and files with a checksum beside them.

A folder is written under a temporary name, locked, and renamed; the lock ends with its process, so that leftovers of a
killed process are recognized.
"""

import errno
import hashlib
import os
import re
import secrets
import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from lab.core.errors import LabError, option_name

__all__ = [
    "CHECKSUMS",
    "checksum_lines",
    "draft_file",
    "draft_of",
    "edited_files",
    "file_digest",
    "held",
    "is_being_written",
    "keep_checked",
    "left_of",
    "listed_digests",
    "piece_files",
    "place_of_draft",
    "read_checked",
    "resolved",
    "write_whole",
]

try:
    import fcntl
except ImportError:  # no POSIX: leftovers stay until they are removed by hand
    fcntl = None  # type: ignore[assignment]

CHECKSUMS: Final = "SHA256SUMS"  # as sha256sum writes and checks it
_DRAFT, _ASIDE = "partial", "replaced"
_UNLOCKED_S = 60.0  # longer than a draft is without its lock
_LEFT = re.compile(rf"\.(.+)\.(?:{_DRAFT}|{_ASIDE})-[^.]*")


@contextmanager
def draft_of(place: Path, *, replacing: bool) -> Iterator[Path]:
    """Yield a folder to write into, which becomes ``place``, an absolute path, if the block succeeds.

    Until then an earlier folder is only moved aside. New parents that stay empty and leftovers of killed processes are
    removed.

    Args:
        replacing: replace a folder that is not empty.

    Raises:
        LabError: another process is writing this folder, or it must not be replaced.
        OSError: it cannot be written.
    """
    new_parents = [parent for parent in place.parents if not parent.exists()]
    draft = place.parent / f".{place.name}.{_DRAFT}-{secrets.token_hex(4)}"  # named before it is made, to be removed
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        _recover(place)
        _sweep(place.parent)
        _refuse_to_replace(place, replacing)
        draft.mkdir()
        with _locked(draft):
            if is_being_written(place, but=draft):
                raise LabError(f"{place}: is being written by another run; wait for it, or give another folder")
            yield draft
            _refuse_to_replace(place, replacing)  # another process may have written it meanwhile
            _swap(draft, place)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
        for parent in new_parents:
            with suppress(OSError):
                parent.rmdir()


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Lock an existing folder against other writers; raise a LabError if one is writing it."""
    with _locked(folder) as alone:
        if not alone:
            raise LabError(f"{folder}: is being written by another run; wait for it, or give another folder")
        yield


def place_of_draft(path: Path) -> Path | None:
    """Return the folder of a draft, or of an earlier folder moved aside; None for any other path."""
    left = _LEFT.fullmatch(path.name)
    return None if left is None else path.parent / left[1]


def is_being_written(place: Path, but: Path | None = None) -> bool:
    """Check whether a process is writing this folder, apart from the draft ``but``, or adds what is drawn to it."""
    for draft in (place, *_siblings(place, _DRAFT)):
        if draft != but:
            with _locked(draft) as free:
                if not free:
                    return True
    return False


def _sweep(parent: Path) -> None:
    """Restore the folders in this one that killed processes moved aside, and remove their drafts.

    A draft that was made just now may be before its lock, and stays.
    """
    left = [(path, found[1]) for path in parent.iterdir() if (found := _LEFT.fullmatch(path.name))]
    for path, name in left:
        with suppress(OSError):  # another process was faster, or may not be written
            if time.time() - path.stat().st_mtime > _UNLOCKED_S:
                _recover(parent / name)


def checksum_lines(folder: Path) -> str:
    """Return a line of ``sha256sum`` for each file below a folder, in the order of paths."""
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path != folder / CHECKSUMS)
    return "".join(f"{file_digest(path)}  {path.relative_to(folder).as_posix()}\n" for path in files)


def edited_files(folder: Path, text: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return those of the named files that differ from the lines of ``sha256sum``: changed, added or gone."""
    digests = listed_digests(text)
    found = {name: file_digest(folder / name) for name in names if (folder / name).is_file()}
    return tuple(name for name in names if found.get(name) != digests.get(name))


def listed_digests(text: str) -> dict[str, str]:
    """Return the SHA-256 by file name that lines of ``sha256sum`` list."""
    lines = (line.partition("  ") for line in text.splitlines())
    return {name: digest for digest, _, name in lines}


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _siblings(place: Path, kind: str) -> list[Path]:
    start = f".{place.name}.{kind}-"
    return [path for path in place.parent.iterdir() if path.name.startswith(start) and path.is_dir()]


def _recover(place: Path) -> None:
    """Restore a folder that a killed process had moved aside, and remove unfinished drafts."""
    if fcntl is None:
        return
    for old in _siblings(place, _ASIDE):
        with _locked(old) as free:
            if free and not place.exists():
                old.rename(place)
            elif free:
                shutil.rmtree(old, ignore_errors=True)
    for draft in _siblings(place, _DRAFT):
        with _locked(draft) as free:
            if free:
                shutil.rmtree(draft, ignore_errors=True)


def _refuse_to_replace(place: Path, replacing: bool) -> None:
    if not replacing and place.is_dir() and any(place.iterdir()):
        raise LabError(
            f"{place}: holds an earlier run; add {option_name('overwrite')} to replace it, or give "
            f"{option_name('out')} another folder"
        )


def _swap(draft: Path, place: Path) -> None:
    """Rename the draft; an earlier folder is moved aside, and removed afterwards."""
    if not place.exists():
        draft.rename(place)
        return
    old = place.parent / f".{place.name}.{_ASIDE}-{draft.name.rpartition('-')[2]}"
    with _locked(place):
        place.rename(old)
        try:
            draft.rename(place)
        except OSError:
            old.rename(place)
            raise
        try:
            shutil.rmtree(old, ignore_errors=True)
        except KeyboardInterrupt:  # the earlier folder is removed nevertheless
            shutil.rmtree(old, ignore_errors=True)
            raise


@contextmanager
def _locked(folder: Path) -> Iterator[bool]:
    """Lock a folder if it is free, and yield whether it was."""
    if fcntl is None:
        yield True
        return
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except FileNotFoundError:
        yield True
        return
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
        else:
            yield True
    finally:
        os.close(descriptor)


def resolved(path: Path) -> Path:
    """Return the absolute path with links resolved; raise an OSError for a loop of links."""
    try:
        return path.absolute().resolve()
    except RuntimeError as error:  # Python 3.11 and 3.12
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path)) from error


_SUM = ".sha256"
_LEFT_OVER = re.compile(r"\.(.+)\.partial-\d+")  # a file that a killed process left unfinished


def write_whole(path: Path, content: Any) -> None:
    """Write a file whole, flushed to the disk, or not at all."""
    with draft_file(path) as draft, draft.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


@contextmanager
def draft_file(path: Path) -> Iterator[Path]:
    """Yield the path of a draft, which becomes the file if the block succeeds, and is removed if not."""
    draft = path.parent / f".{path.name}.partial-{os.getpid()}"
    try:
        yield draft
        draft.replace(path)
    except BaseException:
        with suppress(OSError):
            draft.unlink()
        raise


def keep_checked(path: Path, content: bytes) -> None:
    """Write a file, and its checksum beside it as ``sha256sum`` writes it."""
    write_whole(path, content)
    write_whole(path.with_suffix(_SUM), _sum_line(content, path).encode())


def piece_files(path: Path) -> tuple[Path, Path]:
    """Return the paths of a kept file and of its checksum."""
    return path, path.with_suffix(_SUM)


def left_of(path: Path) -> str:
    """Return the name of the file of which this is an unfinished draft; "" for any other file."""
    found = _LEFT_OVER.fullmatch(path.name)
    return "" if found is None else found[1]


def read_checked(path: Path) -> bytes | None:
    """Return the content of a file with a checksum; None if the file is missing or altered."""
    try:
        content = path.read_bytes()
        stated = path.with_suffix(_SUM).read_bytes()
    except OSError:
        return None
    return content if stated == _sum_line(content, path).encode() else None


def _sum_line(content: bytes, path: Path) -> str:
    return f"{hashlib.sha256(content).hexdigest()}  {path.name}\n"
