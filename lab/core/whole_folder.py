"""A folder that is there whole or not at all: written under a temporary name and renamed; its files' checksums.

A draft is locked while it is written. The lock ends with its process, so what a killed one left is told from what
another one is writing.
"""

import errno
import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from lab.core.errors import LabError

try:
    import fcntl
except ImportError:  # no POSIX: leftovers stay until they are removed by hand
    fcntl = None  # type: ignore[assignment]

__all__ = [
    "CHECKSUMS",
    "checksum_lines",
    "draft_of",
    "edited_files",
    "file_digest",
    "held",
    "is_being_written",
    "place_of_draft",
    "recover",
    "resolved",
]

CHECKSUMS: Final = "SHA256SUMS"  # as sha256sum writes and checks it
_DRAFT, _ASIDE = "partial", "replaced"
_LEFT = re.compile(rf"\.(.+)\.(?:{_DRAFT}|{_ASIDE})-[^.]*")
_BLOCK = 1 << 20


@contextmanager
def draft_of(place: Path, *, replacing: bool) -> Iterator[Path]:
    """A folder to write into, which becomes ``place`` when the block ends well.

    Until the new folder stands, an earlier one is only moved aside. Parents of ``place`` that are made and stay empty
    are removed again, as is what killed processes left.

    Args:
        place: absolute.
        replacing: whether a folder that stands there with something in it is replaced.

    Raises:
        LabError: another process is writing this folder, or it holds something that is not to be replaced.
        OSError: it cannot be written.
    """
    new_parents = [parent for parent in place.parents if not parent.exists()]
    draft: Path | None = None
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        _recover(place)
        _refuse_to_replace(place, replacing)
        draft = Path(tempfile.mkdtemp(prefix=f".{place.name}.{_DRAFT}-", dir=place.parent))
        draft.chmod(0o777 & ~_umask())
        with _locked(draft):
            if is_being_written(place, but=draft):
                raise LabError(f"{place}: is being written by another run; wait for it, or give another folder")
            yield draft
            _refuse_to_replace(place, replacing)  # what another one has written meanwhile
            _swap(draft, place)
    finally:
        if draft is not None:
            shutil.rmtree(draft, ignore_errors=True)
        for parent in new_parents:
            with suppress(OSError):
                parent.rmdir()


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Nobody else writes a folder that is there, while the block runs.

    Raises:
        LabError: somebody does.
    """
    with _locked(folder) as alone:
        if not alone:
            raise LabError(f"{folder}: is being written by another run; wait for it, or give another folder")
        yield


def place_of_draft(path: Path) -> Path | None:
    """Return the folder that a draft, or an earlier folder moved aside, is of; None of any other path."""
    left = _LEFT.fullmatch(path.name)
    return None if left is None else path.parent / left[1]


def is_being_written(place: Path, but: Path | None = None) -> bool:
    """Whether a process is writing this folder.

    Args:
        but: a draft that does not count.
    """
    for draft in _siblings(place, _DRAFT):
        if draft != but:
            with _locked(draft) as free:
                if not free:
                    return True
    return False


def recover(place: Path) -> None:
    """Put back what killed processes had moved aside of a folder and of those in it, and remove what they left.

    Args:
        place: absolute.

    Raises:
        OSError: something cannot be moved.
    """
    if place.parent.is_dir():
        _recover(place)
    if place.is_dir():
        for name in sorted({left[1] for path in place.iterdir() if (left := _LEFT.fullmatch(path.name))}):
            _recover(place / name)


def checksum_lines(folder: Path) -> str:
    """A line for each file of a folder and of those in it, by its path, as ``sha256sum`` writes it."""
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path != folder / CHECKSUMS)
    return "".join(f"{file_digest(path)}  {path.relative_to(folder).as_posix()}\n" for path in files)


def edited_files(folder: Path, text: str, names: Sequence[str]) -> tuple[str, ...]:
    """The files that are not as the lines of their checksums say: changed, added or gone.

    Args:
        text: the lines.
        names: of the files that are looked at.
    """
    said: dict[str, str] = {}
    for line in text.splitlines():
        digest, _, name = line.partition("  ")
        said[name] = digest
    found = {name: file_digest(folder / name) for name in names if (folder / name).is_file()}
    return tuple(name for name in names if found.get(name) != said.get(name))


def file_digest(path: Path) -> str:
    """The SHA-256 of a file, read in blocks."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()


def _siblings(place: Path, kind: str) -> list[Path]:
    """Drafts of a folder, or what of it was moved aside."""
    start = f".{place.name}.{kind}-"
    return [path for path in place.parent.iterdir() if path.name.startswith(start) and path.is_dir()]


def _recover(place: Path) -> None:
    """Put back what a killed process had moved aside, and remove what it had not finished."""
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
        raise LabError(f"{place}: holds an earlier run; add --overwrite to replace it, or give --out another folder")


def _swap(draft: Path, place: Path) -> None:
    """Rename the draft; what stands in its place is moved aside, and removed when the new folder stands."""
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
        except KeyboardInterrupt:  # the new folder stands: what it replaced goes all the same
            shutil.rmtree(old, ignore_errors=True)
            raise


@contextmanager
def _locked(folder: Path) -> Iterator[bool]:
    """Hold a folder's lock, which is not waited for: whether it was free."""
    if fcntl is None:
        yield True
        return
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except FileNotFoundError:  # gone meanwhile
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
    """Where a path leads, absolute.

    Raises:
        OSError: it is a loop of links, or the working folder is gone.
    """
    try:
        return path.absolute().resolve()
    except RuntimeError as error:  # Python 3.11 and 3.12
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path)) from error


def _umask() -> int:
    """Of this process: ``mkdtemp`` makes folders that only their owner may read."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
