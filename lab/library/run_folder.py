"""Write folders of runs whole, and check them for edits; keep their inputs and versions with them."""

import itertools
import json
import os
import platform
import shlex
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import MISSING, asdict, dataclass, fields, is_dataclass
from functools import cache
from hashlib import sha256
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args, get_type_hints

import numpy as np
import tyro
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from lab.core.errors import LabError
from lab.core.gaps import attempted
from lab.core.limits import TEXT_BYTES
from lab.core.progress import stages
from lab.core.se3 import Array
from lab.core.version import __version__
from lab.core.whole_folder import (
    CHECKSUMS,
    checksum_lines,
    draft_of,
    edited_files,
    file_digest,
    held,
    is_being_written,
    left_of,
    listed_digests,
    resolved,
    write_whole,
)
from lab.formats.structured import read_bytes, read_checksums
from lab.kinematics.joints import JointSpec
from lab.robots.config_file import CONFIG_FILE, INPUTS, RUN_FILES, SCHEMA
from lab.robots.robot_files import is_own, parted

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

__all__ = [
    "VIA", "Waypoints", "check_edits", "command_line", "complete", "free_name", "input_files",
    "joint_columns", "listed_files", "positional", "run_config", "run_folder",
    "write_config", "write_json",
]  # fmt: skip

_OF_RUN = (".json", ".csv", ".toml", ".xml")  # files of a run that others build on: all but page and recording
_NAMING = ("file", "robot")  # keys of a TOML file whose values name another one
_NAMED_BY_FOLDER = ("robot", "scene")  # stems of models that are called as their folder is
_OUTPUT = "out"


def input_files(options: Any) -> tuple[Path, ...]:
    """The files and folders that options name, which a run of them never replaces."""
    values = [getattr(options, field.name) for field in fields(options) if field.name != _OUTPUT]
    files = [each for value in values for each in (value if isinstance(value, tuple) else (value,))]
    paths = [each for each in files if isinstance(each, Path)]
    paths += [path for value in values if isinstance(value, str) and (path := _named_file(value)) is not None]
    for group in filter(is_dataclass, values):
        paths += input_files(group)
    return tuple(paths)


def _named_file(value: str) -> Path | None:
    """Return the file that an option names as a text; None where it names none."""
    path = Path(parted(value)[0])
    return path if path.suffix and path.is_file() else None


def _copy_inputs(folder: Path, options: Any) -> dict[str, str]:
    """Copy the inputs of options into a run's folder, with the files that they name, as meshes.

    The lab's own robots and folders that are no runs are not copied. The result maps paths to those of their copies.
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
            from lab.simulation.load_model import model_files

            for file in sorted(model_files(path)):
                yield file, Path(os.path.relpath(file.absolute(), path.parent.absolute()))
        elif path.suffix == ".toml":
            from lab.formats.structured import read_toml

            for name in _texts(read_toml(path)):
                beside = path.parent / name
                yield (beside if beside.is_file() else Path(name)), Path(name)


def _texts(content: Any) -> Iterator[str]:
    if isinstance(content, dict):
        yield from (value for key, value in content.items() if key in _NAMING and isinstance(value, str))
        yield from (text for value in content.values() for text in _texts(value))
    elif isinstance(content, list):
        yield from (text for value in content for text in _texts(value))


def _copied(folder: Path, files: list[tuple[Path, Path]], taken: dict[Path, Path]) -> str:
    """Copy the files of an input with their relative paths; return the path of the input's copy in the folder.

    ``taken`` has the sources of earlier copies; where one of another file is in the way, this input gets a subfolder.
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
    """Decide whether a copy of a file may replace another file, if there is one."""
    if other is None or file.resolve() == other.resolve():
        return True
    return file.is_file() and other.is_file() and file_digest(file) == file_digest(other)


_LONGEST_STEM = 100  # characters of a folder's default name
_LIBRARIES = ("mujoco", "numpy", "scipy", "rerun-sdk")


@contextmanager
def run_folder(out: Path, inputs: Sequence[Path] = (), *, overwrite: bool = False) -> Iterator[Path]:
    """Give a folder to write a run into, which becomes ``out`` (missing, or empty) when the block ends well.

    Args:
        inputs: of the run, which are not to be replaced.
        overwrite: whether ``out`` may also be an earlier run, which is then replaced.

    Raises:
        LabError: ``out`` holds an earlier run, something else, or an input, is the working folder or above it, is
            being written by another run, or cannot be written.
    """
    place = _place(out)
    for path in inputs:
        own = _leads_to(path)
        if own.is_relative_to(place) and not own.is_relative_to(place / INPUTS):  # copies are copied again
            raise LabError(f"{out}: holds {path}, an input of this run; give --out another folder")
    begun = False
    try:
        _refuse_other_files(out)
        with draft_of(place, replacing=overwrite) as draft:
            begun = True
            with _hide_draft_path(draft):
                yield draft
            (draft / CHECKSUMS).write_bytes(checksum_lines(draft).encode("utf-8", "surrogateescape"))
    except OSError as error:
        why = error.strerror or error
        mend = "nothing was saved; free disk space and run again" if begun else "give --out another folder"
        text = f"writing failed ({why})" if begun else f"cannot be written ({why})"
        raise LabError(f"{out}: {text}; {mend}") from error


def complete(out: Path, draw: Callable[[Path], None]) -> None:
    """Add what is drawn to the folder of a run whose numbers are there, and to its checksums."""

    def drawn() -> None:
        draw(out)
        write_whole(out / CHECKSUMS, checksum_lines(out).encode("utf-8", "surrogateescape"))

    with threadpool_limits(1), held(out), stages("writing the page"):
        attempted(f"{CHECKSUMS} of page and recording", drawn, lambda _: None)


@contextmanager
def _hide_draft_path(draft: Path) -> Iterator[None]:
    """Raise only the cause if a file in the draft cannot be written: the user does not know the draft's path."""
    try:
        yield
    except LabError as error:
        if str(draft) in str(error) and isinstance(error.__cause__, OSError):
            raise error.__cause__ from None
        raise


def _place(out: Path) -> Path:
    try:
        place, here = resolved(out), Path.cwd()
    except OSError as error:
        raise LabError(f"{out}: cannot be written ({error.strerror}); change to another folder") from error
    if here.is_relative_to(place):
        raise LabError(f"{out}: is the working folder, or holds it; give --out a folder for the run alone")
    if not place.name.strip():
        raise LabError(f"--out '{out}': the name is blank; give --out a folder with a name")
    return place


def _leads_to(path: Path) -> Path:
    """Resolve the path of an input; an unreadable one stays as given, for its reader to report."""
    try:
        return resolved(path)
    except OSError:
        return path.absolute()


def _refuse_other_files(out: Path) -> None:
    if out.exists() and not out.is_dir():
        raise LabError(f"{out}: is a file; give --out a folder")
    there = {path.name: path for path in out.iterdir()} if out.exists() else {}
    known = RUN_FILES.union(listed_files(out))  # programs and volumes have names of their own
    strays = [name for name, path in there.items() if not _is_of_run(path, known)]
    if strays:
        raise LabError(f"{out}: holds {min(strays)}, which is not a file of a run; give --out another folder")
    if there and not _is_config(out / "config.json"):
        raise LabError(f"{out}: holds files that are not of a run of the lab; give --out another folder")


def _is_of_run(path: Path, known: set[str]) -> bool:
    if path.is_symlink():
        return False
    return path.is_dir() if path.name == INPUTS else (left_of(path) or path.name) in known and path.is_file()


def _is_config(path: Path) -> bool:
    return path.is_file() and b'"model_sha256"' in read_bytes(path, TEXT_BYTES)


def free_name(parent: Path, stem: str) -> Path:
    """A folder that does not exist yet: the stem, or the stem with a number."""
    stem = stem[:_LONGEST_STEM]
    names = (parent / (stem if i == 1 else f"{stem}-{i}") for i in itertools.count(1))
    return next(name for name in names if not name.exists() and not (parent.exists() and is_being_written(name)))


def run_config(command: str, options: "DataclassInstance", model_sha256: str) -> dict[str, Any]:
    """Return all options, and what else the numbers depend on: file contents, versions of libraries and schema."""
    return {
        "schema": SCHEMA,
        "command": command,
        "options": asdict(options),
        "model_sha256": model_sha256,
        "inputs_sha256": dict(_input_hashes(options)),
        "versions": _versions(),
    }


def write_config(folder: Path, command: str, options: "DataclassInstance", model_sha256: str) -> None:
    """Write ``config.json`` of a run, and beside it the copies of its inputs."""
    content = run_config(command, options, model_sha256)
    write_json(folder / CONFIG_FILE, {**content, "inputs": _copy_inputs(folder, options)})


def _input_hashes(options: "DataclassInstance") -> Iterator[tuple[str, str]]:
    """The SHA-256 of each file that options name, and of the ``result.json`` of each run."""
    for path in input_files(options):
        content = path / "result.json" if path.is_dir() else path
        with suppress(OSError):  # a file that no longer exists has no digest
            yield str(path), sha256(content.read_bytes()).hexdigest()


@cache
def _versions() -> dict[str, str]:
    """Return the versions of all software that the numbers depend on."""
    installed = {name: _version(name) for name in _LIBRARIES}
    return installed | {"python": platform.python_version(), "virtual-calibration-lab": __version__}


def _version(library: str) -> str:
    """Return the version of a library; without rerun there is no recording, and all else is the same."""
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return "not installed"


def write_json(path: Path, content: Any) -> None:
    """Write plain values, indented; an iterator is a list that is never held whole."""
    with path.open("w", encoding="utf-8") as file:
        file.writelines(_indented(content, 0))
        file.write("\n")


def _indented(value: Any, level: int) -> Iterator[str]:
    """Yield the text of ``json.dumps`` with an indent of one, five times as fast as its item-by-item Python loop.

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


_ACCEPT_EDITED = "--accept-edited"


def check_edits(folder: Path, names: Sequence[str], *, accept: bool) -> tuple[str, ...]:
    """Refuse files of a run that were changed since it was written, or return a warning where they are accepted.

    Args:
        names: of the files that matter, as far as they are there.

    Raises:
        LabError: they are not accepted.
    """
    found = "its checksums are missing"
    if (folder / CHECKSUMS).is_file():
        edited = edited_files(folder, read_checksums(folder), names)
        if not edited:
            return ()
        found = f"{', '.join(edited)} {'was' if len(edited) == 1 else 'were'} changed since the run was written"
    if not accept:
        raise LabError(f"{folder}: {found}; repeat the run, or accept the edits by {_ACCEPT_EDITED}")
    return (f"{folder}: {found}: the edited files are used",)


def listed_files(folder: Path) -> tuple[str, ...]:
    """Return the files of a run that its checksums list, as far as they are there; a recording may be deleted."""
    if not (folder / CHECKSUMS).is_file():
        return ()
    names = listed_digests(read_checksums(folder))
    return tuple(name for name in names if (folder / name).is_file())


VIA = "via"  # the purpose of a stop that is only passed
_BLOCK = 10_000  # stops that are made plain values at a time


@dataclass(frozen=True)
class Waypoints:
    """Waypoints of a robot's way, each reached in a straight line of all joints."""

    joints: Array  # (s, n) rad or m
    which: NDArray[np.int_]  # (s,) which of the poses or targets ids each one is; -1 where it is none
    ids: Sequence[str]  # what these are called
    purpose: str  # what is done at them; every other stop is there for via
    stations: tuple[str, ...] = ()  # of the instrument that measures then, (s,) names; none where it has one alone
    payloads_kg: tuple[float, ...] = ()  # that the arm carries then, (s,); none where nothing is given

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the waypoints: the pose's or target's id, ``home`` at the ends, or ``via`` and a number.

        Between two stations, and between two payloads, the name is ``home_between`` and a number.
        """
        setups = [each for each in (self.stations, self.payloads_kg) if each]
        last, names, via, between = len(self.which) - 1, list[str](), 0, 0
        for i, pose in enumerate(self.which.tolist()):
            moved = 0 < i < last and any(each[i] != each[i + 1] for each in setups)
            between += moved
            via += pose < 0 and i not in (0, last) and not moved
            passed = "home" if i == 0 else "home_again" if i == last else f"via{via:03d}"
            passed = f"home_between{between}" if moved else passed
            names.append(self.ids[pose] if pose >= 0 else passed)
        return tuple(names)

    @property
    def purposes(self) -> tuple[str, ...]:
        """Purposes of the waypoints."""
        return tuple(self.purpose if pose >= 0 else VIA for pose in self.which)

    def columns(self, chain: JointSpec) -> Mapping[str, Sequence[Any] | Array]:
        """``id``, ``stop`` (what each is for), ``station`` and ``payload_kg`` where there are several, joint positions.

        These are called ``<joint>_deg`` or ``<joint>_mm``.
        """
        stations = {"station": list(self.stations)} if self.stations else {}
        loads = {"payload_kg": list(self.payloads_kg)} if self.payloads_kg else {}
        positions = joint_columns(chain, self.joints)
        return {"id": list(self.names), "stop": list(self.purposes), **stations, **loads, **positions}

    def rows(self, chain: JointSpec) -> Iterator[dict[str, Any]]:
        """A mapping for each one, by the names of ``columns``, made as it is asked for."""
        columns = self.columns(chain)
        for first in range(0, len(self.which), _BLOCK):
            some = (values[first : first + _BLOCK] for values in columns.values())
            plain = [each.tolist() if isinstance(each, np.ndarray) else each for each in some]
            for row in zip(*plain, strict=True):
                yield dict(zip(columns, row, strict=True))


def joint_columns(chain: JointSpec, joints: Array) -> dict[str, Array]:
    """Joint positions ``(n, joints)`` (rad or m) by joint and unit, as people read them: ``<joint>_deg`` or ``_mm``."""
    columns = zip(chain.column_names, joints.T, strict=True)
    return {name: chain.unit(i).of(values) for i, (name, values) in enumerate(columns)}


(_POSITIONAL,) = get_args(tyro.conf.Positional[str])[1:]  # the mark of an option without a flag


def command_line(name: str, options: "DataclassInstance") -> str:
    """Write the command line for these options, without those at their defaults."""
    given, parts, flags = dict(_given_options(options)), ["lab", name], []
    for option in positional(type(options)):
        value, text = getattr(options, option), given.pop(option, "")
        several = map(str, value) if isinstance(value, tuple) else (text,)
        parts += map(shlex.quote, several if text else ())
    for option, value in given.items():
        flags.append(f"--{option.replace('_', '-')}" + (f" {shlex.quote(value)}" if value else ""))
    return " ".join([*parts, *flags])


def positional(kind: type[Any]) -> list[str]:
    """The options of a command that stand without a flag."""
    hints = get_type_hints(kind, include_extras=True)
    return [option for option, hint in hints.items() if _POSITIONAL in get_args(hint)]


def _given_options(options: Any) -> Iterator[tuple[str, str]]:
    """Options that are not at their defaults, those of groups among them; no text for one that is only switched on."""
    for field in fields(options):
        value = getattr(options, field.name)
        default = field.default if field.default_factory is MISSING else field.default_factory()
        if is_dataclass(value):
            yield from _given_options(value)
        elif value != default:
            yield field.name, _written(value)


def _written(value: Any) -> str:
    if value is True:
        return ""
    if isinstance(value, tuple):
        return ",".join(_written(each) for each in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
