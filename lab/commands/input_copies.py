"""Copies of the files that a run is made from, in the run's folder: with them a run is whole wherever it is moved."""

import os
import shutil
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from lab.campaign.config_file import CONFIG_FILE, INPUTS
from lab.campaign.model_files import is_own
from lab.core.errors import LabError
from lab.core.whole_folder import CHECKSUMS, file_digest

__all__ = ["copy_inputs", "input_files"]

_OF_RUN = (".json", ".csv", ".toml", ".xml")  # files of a run that others build on: all but page and recording
_NAMING = ("file", "robot")  # keys of a TOML file whose values name another one
_NAMED_BY_FOLDER = ("robot", "scene")  # stems of models that are called as their folder is
_OUTPUT = "out"


def input_files(options: Any) -> tuple[Path, ...]:
    """The files and folders that options name, which a run of them never replaces."""
    values = [getattr(options, field.name) for field in fields(options) if field.name != _OUTPUT]
    listed = [each for value in values for each in (value if isinstance(value, tuple) else (value,))]
    own = [each for each in listed if isinstance(each, Path)]
    own += [Path(value) for value in values if isinstance(value, str) and Path(value).suffix and Path(value).is_file()]
    return tuple(own) + tuple(path for value in values if is_dataclass(value) for path in input_files(value))


def copy_inputs(folder: Path, options: Any) -> dict[str, str]:
    """Copy what options name into a run's folder, with what those files name in their turn, as meshes.

    Robots of the lab's own are not copied, and of folders only runs are: a folder of many runs is not.

    Args:
        folder: of the run, that is there.

    Returns:
        By the path that the options name, the path of the copy in the run's folder.
    """
    found, taken = dict[str, str](), dict[Path, Path]()
    for path in input_files(options):
        with suppress(OSError):  # nobody has to read it any more
            if files := _files(path):
                found[str(path)] = _copied(folder, files, taken)
    return found


def _files(path: Path) -> list[tuple[Path, Path]]:
    """The files of an input, each with the place that it has beside the others; the input's own place first."""
    place = Path(os.path.normpath(path.absolute()))
    if path.is_dir():
        if not (path / CONFIG_FILE).is_file():
            return []
        own = [each for each in path.iterdir() if each.suffix in _OF_RUN or each.name == CHECKSUMS]
        own = [each for each in sorted((*own, *(path / INPUTS).rglob("*"))) if each.is_file()]
        return [(path, place), *((each, place / each.relative_to(path)) for each in own)]
    if not path.is_file() or is_own(path.resolve()):
        return []
    return [(path, place), *_named(path, place, {path.resolve()})]


def _named(path: Path, place: Path, seen: set[Path]) -> Iterator[tuple[Path, Path]]:
    """The files that a file names by relative paths, and those that they name."""
    for file, name in _names(path):
        if file.is_file() and not name.is_absolute() and file.resolve() not in seen and not is_own(file.resolve()):
            seen.add(file.resolve())
            beside = Path(os.path.normpath(place.parent / name))
            yield file, beside
            yield from _named(file, beside, seen)


def _names(path: Path) -> Iterator[tuple[Path, Path]]:
    """The files that a description names, and where each is as seen from it; nothing of another file."""
    with suppress(LabError):
        if path.suffix in (".xml", ".urdf"):
            from lab.simulation.model_file_gate import model_files

            for file in sorted(model_files(path)):
                yield file, Path(os.path.relpath(file.absolute(), path.parent.absolute()))
        elif path.suffix == ".toml":
            from lab.formats.toml import read_toml

            for name in _texts(read_toml(path)):
                beside = path.parent / name
                yield (beside if beside.is_file() else Path(name)), Path(name)


def _texts(content: Any) -> Iterator[str]:
    """The values of a TOML file that name other files."""
    if isinstance(content, dict):
        yield from (value for key, value in content.items() if key in _NAMING and isinstance(value, str))
        yield from (text for value in content.values() for text in _texts(value))
    elif isinstance(content, list):
        yield from (text for value in content for text in _texts(value))


def _copied(folder: Path, files: list[tuple[Path, Path]], taken: dict[Path, Path]) -> str:
    """Copy the files of an input as they are to each other; where the input's own copy is, in the run's folder.

    Args:
        taken: by the places that copies have, what was copied; where another file is, this input gets a folder.
    """
    own = files[0][1]
    root = Path(os.path.commonpath([place.parent for _, place in files]))
    if own.stem in _NAMED_BY_FOLDER and own.suffix != ".toml" and root == own.parent:
        root = root.parent
    number, base = 1, folder / INPUTS
    while any(not _same(file, taken.get(base / place.relative_to(root))) for file, place in files):
        number += 1
        base = folder / INPUTS / str(number)
    for file, place in files:
        copy = base / place.relative_to(root)
        taken[copy] = file
        if file.is_file():
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, copy)
    return (base / own.relative_to(root)).relative_to(folder).as_posix()


def _same(file: Path, other: Path | None) -> bool:
    """Whether a copy of a file can stand where one of another file stands already, if any."""
    if other is None or file.resolve() == other.resolve():
        return True
    return file.is_file() and other.is_file() and file_digest(file) == file_digest(other)
