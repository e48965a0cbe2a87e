"""A run as a folder, complete or not there: written under a temporary name, then renamed."""

import itertools
import json
import platform
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from functools import cache
from hashlib import sha256
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lab.campaign.config_file import CONFIG_FILE, INPUTS
from lab.commands.input_copies import copy_inputs, input_files
from lab.core.errors import LabError
from lab.core.limits import TEXT_BYTES
from lab.core.version import __version__
from lab.core.whole_folder import CHECKSUMS, checksum_lines, draft_of, is_being_written, resolved
from lab.formats.structured import read_json
from lab.formats.text_file import read_bytes

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

__all__ = [
    "LOAD_FILE",
    "SCHEMA",
    "config",
    "free_name",
    "input_files",
    "refuse_own_name",
    "run_folder",
    "versions",
    "write_config",
    "write_json",
]

LOAD_FILE = "load.json"  # a payload, in the folder of a run
_FILES = {
    "config.json",
    "measurements.csv",
    "parameters.json",
    "covariance.csv",
    "residual.csv",
    "fitted_poses.csv",
    "result.json",
    LOAD_FILE,
    "calibrated.xml",
    "calibrated.toml",
    "calibrated.urdf",
    "calibrated_origins.xacro",
    "ur_kinematics.yaml",
    "calibration.conf",
    "calibrated.py",
    "predicted.csv",
    "nominal.toml",
    "joints.csv",
    "cartesian.csv",
    "plan.csv",
    "trajectory.csv",
    "corrected.csv",
    "load.csv",
    "motion.csv",
    "another.csv",
    "values.csv",
    "exercise.csv",
    "workspace.csv",
    "sensor.toml",
    "status.csv",
    "status.prom",
    "recording.rrd",
    "report.html",
    CHECKSUMS,
}  # and programs: a folder with anything else is not replaced
SCHEMA = 1  # the version of what config.json, parameters.json and result.json hold; docs/reference/schemas says it
LONGEST_STEM = 100  # characters of a folder's default name
_LIBRARIES = ("mujoco", "numpy", "scipy", "rerun-sdk")


@contextmanager
def run_folder(out: Path, inputs: Sequence[Path] = (), *, overwrite: bool = False) -> Iterator[Path]:
    """A folder to write a run into, which becomes ``out`` when the block ends well.

    ``out`` may be missing or empty.

    Args:
        inputs: what the run is made from, which is not to be replaced.
        overwrite: whether ``out`` may also be an earlier run, which is then replaced.

    Raises:
        LabError: ``out`` holds an earlier run, something else, or an input, is the working folder or above it, is
            being written by another run, or cannot be written.
    """
    place = _place(out)
    for path in inputs:
        own = _leads_to(path)
        if own.is_relative_to(place) and not own.is_relative_to(place / INPUTS):  # copies are copied again
            raise LabError(f"{out}: holds {path}, which this run is made from; give --out another folder")
    begun = False
    try:
        _refuse_other_files(out)
        with draft_of(place, replacing=overwrite) as draft:
            begun = True
            with _known_by_name(draft):
                yield draft
            (draft / CHECKSUMS).write_text(checksum_lines(draft), encoding="utf-8")
    except OSError as error:
        why = error.strerror or error
        mend = "nothing was kept, make room and run again" if begun else "give --out another folder"
        said = f"writing failed ({why})" if begun else f"cannot be written ({why})"
        raise LabError(f"{out}: {said}; {mend}") from error


@contextmanager
def _known_by_name(draft: Path) -> Iterator[None]:
    """Of a file in the draft that cannot be written only the cause goes on: nobody has heard of the draft."""
    try:
        yield
    except LabError as error:
        if str(draft) in str(error) and isinstance(error.__cause__, OSError):
            raise error.__cause__ from None
        raise


def _place(out: Path) -> Path:
    """Where a run is to be: a folder of its own."""
    try:
        place, here = resolved(out), Path.cwd()
    except OSError as error:
        raise LabError(f"{out}: cannot be written ({error.strerror}); go to another folder") from error
    if here.is_relative_to(place):
        raise LabError(f"{out}: is the working folder, or holds it; give --out a folder for the run alone")
    if not place.name.strip():
        raise LabError(f"--out '{out}': a name of blanks; give --out a folder with a name")
    return place


def _leads_to(path: Path) -> Path:
    """Where an input is; where it cannot be read, which its reader tells, as it is given."""
    try:
        return resolved(path)
    except OSError:
        return path.absolute()


def _refuse_other_files(out: Path) -> None:
    if out.exists() and not out.is_dir():
        raise LabError(f"{out}: is a file; give --out a folder")
    there = {path.name: path for path in out.iterdir()} if out.exists() else {}
    from lab.formats.programs.registry import is_program_file

    known = _FILES | _program_of(out / "config.json") | {name for name in there if is_program_file(name)}
    strays = [name for name, path in there.items() if not _is_of_run(path, known)]
    if strays:
        raise LabError(f"{out}: holds {min(strays)}, which is no file of a run; give --out another folder")
    if there and not _is_config(out / "config.json"):
        raise LabError(f"{out}: holds files that are no run of the lab; give --out another folder")


def _is_of_run(path: Path, known: set[str]) -> bool:
    """Whether a file or folder may be one of a run."""
    if path.is_symlink():
        return False
    return path.is_dir() if path.name == INPUTS else path.name in known and path.is_file()


def _program_of(path: Path) -> set[str]:
    """The name of the program that a run corrected, by its ``config.json``; none where it is of no such run."""
    if not _is_config(path):
        return set()
    try:
        program = read_json(path, "").get("options", {}).get("program")
    except (LabError, AttributeError):
        return set()
    return {Path(program).name} if isinstance(program, str) else set()


def _is_config(path: Path) -> bool:
    return path.is_file() and b'"model_sha256"' in read_bytes(path, TEXT_BYTES)


def free_name(parent: Path, stem: str) -> Path:
    """A folder that does not exist yet: the stem, or the stem with a number."""
    stem = stem[:LONGEST_STEM]
    names = (parent / (stem if i == 1 else f"{stem}-{i}") for i in itertools.count(1))
    return next(name for name in names if not name.exists() and not (parent.exists() and is_being_written(name)))


def config(
    command: str,
    options: "DataclassInstance",
    model_sha256: str,
) -> dict[str, Any]:
    """Every option, and what else the numbers depend on: the content of the files, versions of libraries and schema."""
    return {
        "schema": SCHEMA,
        "command": command,
        "options": asdict(options),
        "model_sha256": model_sha256,
        "inputs_sha256": dict(_input_hashes(options)),
        "versions": versions(),
    }


def write_config(folder: Path, command: str, options: "DataclassInstance", model_sha256: str) -> None:
    """Write ``config.json`` of a run, and beside it the copies of its inputs."""
    content = config(command, options, model_sha256)
    write_json(folder / CONFIG_FILE, {**content, "inputs": copy_inputs(folder, options)})


def refuse_own_name(where: object, name: str) -> None:
    """Refuse to write a file under the name of one that a run writes for itself.

    Args:
        where: the option, or the file that is written again under its name, as the error begins.

    Raises:
        LabError: a run has a file of this name.
    """
    if name.lower() in {INPUTS, *(each.lower() for each in _FILES)}:
        raise LabError(f"{where}: a run writes a file {name} of its own, which this one would replace; rename it")


def _input_hashes(options: "DataclassInstance") -> Iterator[tuple[str, str]]:
    """The SHA-256 of each file that options name, and of the ``result.json`` of each run."""
    for path in input_files(options):
        content = path / "result.json" if path.is_dir() else path
        with suppress(OSError):  # of a file that nobody has to read any more there is nothing to say
            yield str(path), sha256(content.read_bytes()).hexdigest()


@cache
def versions() -> dict[str, str]:
    """Of everything that numbers depend on."""
    libraries = {name: metadata.version(name) for name in _LIBRARIES}
    return libraries | {"python": platform.python_version(), "virtual-calibration-lab": __version__}


def write_json(path: Path, content: Any) -> None:
    """Write plain values, indented; an iterator is a list that is never held whole."""
    with path.open("w", encoding="utf-8") as file:
        file.writelines(_indented(content, 0))
        file.write("\n")


def _indented(value: Any, level: int) -> Iterator[str]:
    """What ``json.dumps`` with an indent of one writes: that goes item by item in Python, in five times as long.

    A mapping or a list of single values is written at once, with line ends between its items.
    """
    if not isinstance(value, dict | list | tuple | Iterator) or not value:
        yield json.dumps(value, default=str, allow_nan=False)
        return
    inner, outer = "\n" + (level + 1) * " ", "\n" + level * " "
    if not isinstance(value, Iterator):
        items = value.values() if isinstance(value, dict) else value
        if not any(isinstance(each, dict | list | tuple | Iterator) for each in items):
            text = json.dumps(value, separators=("," + inner, ": "), default=str, allow_nan=False)
            yield text[0] + inner + text[1:-1] + outer + text[-1]
            return
    first, last = "{}" if isinstance(value, dict) else "[]"
    before, end = first + inner, first + last
    for each in value:
        yield before
        if isinstance(value, dict):
            yield f"{json.dumps(str(each))}: "
        yield from _indented(value[each] if isinstance(value, dict) else each, level + 1)
        before, end = "," + inner, outer + last
    yield end
