"""Long work of a command that was interrupted: what of it is done waits beside its folder for ``--resume``."""

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import Any

from lab.commands.program import was_interrupted
from lab.commands.run_folder import input_files, versions
from lab.core.errors import LabError
from lab.core.kept_pieces import Pieces, keeping
from lab.core.limits import TABLE_BYTES
from lab.core.whole_folder import file_digest, resolved
from lab.formats.structured import read_json

__all__ = ["unfinished"]

_LABEL = "work.json"
_PARTS = {"command": "command", "options": "option", "files": "content of", "versions": "version of"}
_OF_RUN, _MOST_FILES = {".json", ".csv", ".xml", ".toml"}, 100  # of a run that is built on
_NO_PART = ("out", "overwrite")  # options that say where a run goes, and not what it is


@contextmanager
def unfinished(command: str, options: Any, out: Path | None, *, resume: bool) -> Iterator[None]:
    """Pieces of the work inside the block are kept beside the run's folder, until that stands.

    Args:
        out: the run's folder; None where none is written, and nothing is kept.
        resume: whether to go on with what an earlier run with the same options kept; otherwise it is removed.

    Raises:
        LabError: what is there is of other options, other files or another version.
    """
    if out is None:
        if resume:
            raise LabError("--resume goes on with a run that was interrupted: give its folder, --out")
        yield
        return
    folder = _beside(out)
    work = _work(command, options)
    if resume:
        _refuse_other(out, folder, work)
    else:
        shutil.rmtree(folder, ignore_errors=True)
    pieces = Pieces(folder, _LABEL, json.dumps(work, indent=1).encode())
    try:
        with keeping(pieces):
            yield
    except BaseException as stop:
        if was_interrupted(stop) and folder.is_dir():
            raise KeyboardInterrupt(f"the same command with --out {out} --resume goes on with what is done") from stop
        if pieces.kept and isinstance(stop, LabError) and not isinstance(stop.__cause__, OSError):
            shutil.rmtree(folder, ignore_errors=True)  # it cannot be done: there is nothing to go on with
        raise
    shutil.rmtree(folder, ignore_errors=True)


def _beside(out: Path) -> Path:
    """Where pieces are kept."""
    try:
        place = resolved(out)
    except OSError as error:
        raise LabError(f"{out}: cannot be written ({error.strerror}); give --out another folder") from error
    return place.parent / f".{place.name}.unfinished"


def _work(command: str, options: Any) -> dict[str, Any]:
    """What pieces depend on: options, the content of the files that they name, and versions; as JSON has it."""
    asked = {name: value for name, value in asdict(options).items() if name not in _NO_PART}
    own = getattr(options, "out", None)
    files = {str(path): _content(path) for path in input_files(options) if path != own}
    work = {"command": command, "options": asked, "files": files, "versions": versions()}
    plain: dict[str, Any] = json.loads(json.dumps(work, default=str))
    return plain


def _content(path: Path) -> str:
    """The checksum of a file, or of the tables and values of a folder; "" of what its reader refuses."""
    with suppress(OSError):
        if path.is_dir():
            own = sorted(each for each in path.iterdir() if each.suffix in _OF_RUN)[:_MOST_FILES]
            return sha256("".join(map(_content, own)).encode()).hexdigest()
        if path.is_file() and path.stat().st_size <= TABLE_BYTES.most:  # no device, and nothing without end
            return file_digest(path)
    return ""


def _refuse_other(out: Path, folder: Path, work: dict[str, Any]) -> None:
    """Pieces of other work; where none are, the work begins."""
    if not (folder / _LABEL).exists():
        return
    there = read_json(folder / _LABEL, "leave out --resume to begin anew")
    if there == work:
        return
    said: dict[str, Any] = there if isinstance(there, dict) else {}
    for part, words in _PARTS.items():
        if said.get(part) != work[part]:
            what = f"another {words}{_other(said.get(part), work[part])}"
            raise LabError(f"{out}: was interrupted with {what}; give the same, or leave out --resume to begin anew")
    raise LabError(f"{out}: what was kept of it is damaged; leave out --resume to begin anew")


def _other(old: Any, new: Any) -> str:
    """The first name whose value is not the same, after a space."""
    if not (isinstance(old, dict) and isinstance(new, dict)):
        return ""
    return next((f" {name}" for name in sorted({*old, *new}) if old.get(name) != new.get(name)), "")
