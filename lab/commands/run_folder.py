"""A run as a folder, complete or not there: written under a temporary name, then renamed."""

import itertools
import json
import os
import platform
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, fields, is_dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lab.commands.payload.known_payload import LOAD_FILE
from lab.core.errors import LabError
from lab.core.version import __version__
from lab.formats.programs.registry import program_file_names

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

__all__ = ["config", "free_name", "input_files", "run_folder", "write_json"]

_FILES = {
    "config.json",
    "measurements.csv",
    "parameters.json",
    "covariance.csv",
    "result.json",
    LOAD_FILE,
    "calibrated.xml",
    "calibrated.toml",
}
_FILES |= {
    "calibrated.urdf",
    "nominal.toml",
    "joints.csv",
    "cartesian.csv",
    "plan.csv",
    "curve.png",
    "curve.svg",
    "poses.png",
    "poses.svg",
    "recording.rrd",
    "report.html",
    *program_file_names(),
}  # a folder with anything else is not replaced
LONGEST_STEM = 100  # characters of a folder's default name
_LIBRARIES = ("mujoco", "numpy", "scipy", "rerun-sdk")


@contextmanager
def run_folder(out: Path, inputs: Sequence[Path] = ()) -> Iterator[Path]:
    """A folder to write a run into, which becomes ``out`` when the block ends well.

    ``out`` may be missing, empty, or an earlier run, which is then replaced.

    Args:
        inputs: what the run is made from, which is not to be replaced.

    Raises:
        LabError: ``out`` holds something else, or an input, or cannot be written.
    """
    place = out.absolute().resolve()
    for path in inputs:
        if path.absolute().resolve().is_relative_to(place):
            raise LabError(f"{out}: holds {path}, which this run is made from; give --out another folder")
    draft = place.parent / f".{place.name}.partial-{os.getpid()}"
    new_parents = [parent for parent in draft.parents if not parent.exists()]
    try:
        try:
            _refuse_other_files(out)
            draft.mkdir(parents=True)
        except OSError as error:
            raise LabError(f"{out}: cannot be written ({error.strerror}); give --out another folder") from error
        try:
            yield draft
            _swap(draft, place)
        except OSError as error:
            why = error.strerror or error
            raise LabError(f"{out}: writing failed ({why}); nothing was kept, make room and run again") from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)
        for parent in new_parents:  # empty again if nothing came of the run
            with suppress(OSError):
                parent.rmdir()


def _refuse_other_files(out: Path) -> None:
    if out.exists() and not out.is_dir():
        raise LabError(f"{out}: is a file; give --out a folder")
    names = {path.name for path in out.iterdir()} if out.exists() else set()
    if strays := sorted(names - _FILES):
        raise LabError(f"{out}: holds {strays[0]}, which is no file of a run; give --out another folder")
    if names and not _is_config(out / "config.json"):
        raise LabError(f"{out}: holds files that are no run of the lab; give --out another folder")


def _is_config(path: Path) -> bool:
    return path.is_file() and b'"model_sha256"' in path.read_bytes()


def input_files(options: Any) -> tuple[Path, ...]:
    """The files and folders that options name, which a run of them never replaces."""
    values = [getattr(options, field.name) for field in fields(options)]
    own = tuple(value for value in values if isinstance(value, Path))
    return own + tuple(path for value in values if is_dataclass(value) for path in input_files(value))


def free_name(parent: Path, stem: str) -> Path:
    """A folder that does not exist yet: the stem, or the stem with a number."""
    stem = stem[:LONGEST_STEM]
    names = (parent / (stem if i == 1 else f"{stem}-{i}") for i in itertools.count(1))
    return next(name for name in names if not name.exists())


def _swap(draft: Path, out: Path) -> None:
    old = out.parent / f".{out.name}.replaced-{os.getpid()}"
    if out.exists():
        out.rename(old)
    try:
        draft.rename(out)
    except OSError:
        if old.exists():
            old.rename(out)
        raise
    shutil.rmtree(old, ignore_errors=True)


def config(
    command: str,
    options: "DataclassInstance",
    model_sha256: str,
) -> dict[str, Any]:
    """Every option, and what else the numbers depend on."""
    versions = _library_versions() | {"python": platform.python_version(), "virtual-calibration-lab": __version__}
    return {"command": command, "options": asdict(options), "model_sha256": model_sha256, "versions": versions}


@cache
def _library_versions() -> dict[str, str]:
    return {name: metadata.version(name) for name in _LIBRARIES}


def write_json(path: Path, content: Any) -> None:
    """Write plain values, indented."""
    text = json.dumps(content, indent=1, default=str, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")
