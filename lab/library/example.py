"""List the measurements of real robots that come with the lab, and write one into a folder."""

import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import Any

from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.whole_folder import write_whole
from lab.library.given_measurements import read_measurements
from lab.library.result import Result
from lab.options.call_options import options_of, takes
from lab.options.command_options import ExampleOptions
from lab.robots.robot_files import models_folder

__all__ = ["EXAMPLES", "Example", "ExampleResult", "example"]


@dataclass(frozen=True)
class Example:
    """Measurements of a real robot.

    Attributes:
        name: of the example.
        robot: the name of its nominal model, in whose folder ``measured`` the files are.
        measured: what was measured, with what.
        source: who measured it, and where it is published.
        files: their names; the first is identified from.
        options: of ``lab identify``, beside the file and the robot.
        observe: what the file measures, as ``--observe`` names it.
    """

    name: str
    robot: str
    measured: str
    source: str
    files: tuple[str, ...]
    options: tuple[str, ...]
    observe: str = "points"

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files, as they come with the lab."""
        return tuple(self._folder / file for file in self.files)

    @property
    def measurements(self) -> Measurements:
        """The measurements to identify from."""
        return read_measurements(self.paths[0], self.robot, observe=self.observe)

    @cached_property
    def rows(self) -> int:
        """Number of measured poses in the first file."""
        return len(self.paths[0].read_text(encoding="utf-8").splitlines()) - 1

    @property
    def size_bytes(self) -> int:
        """Size of all files."""
        return sum(path.stat().st_size for path in self.paths)

    @cached_property
    def licence(self) -> str:
        """Text of the licence, which begins with its name."""
        return (self._folder / "LICENSE").read_text(encoding="utf-8")

    @property
    def licence_name(self) -> str:
        """The licence in a word."""
        return self.licence.splitlines()[0].removesuffix(" License")

    @property
    def note(self) -> str:
        """What goes with the files: what they are, their source, and their licence."""
        return f"{', '.join(self.files)}\n\n{self.measured}.\nSource: {self.source}.\n\n{self.licence}"

    def command(self, folder: Path = Path()) -> str:
        """Return the command that identifies the robot from the files in a folder."""
        words = (self.files[0], "--robot", self.robot, *self.options)
        placed = (str(folder / word) if word in self.files else word for word in words)
        return shlex.join(["lab", "identify", *placed])

    @property
    def _folder(self) -> Path:
        return models_folder() / self.robot / "measured"


_UR10 = (
    "C. Landgraf, ipa-robot-accuracy, 2021, published with CASE 2021 (github.com/christianlandgraf/ipa-robot-accuracy)"
)
EXAMPLES = (
    Example(
        "ur5", "ur5",
        "One reflector on the flange, by a laser tracker (GTS3800, 15 µm + 6 µm/m); 20 more poses to validate on",
        "P. Jacobi, serial_robots_datasets; Master's thesis, Tsinghua University, 2025 "
        "(github.com/pauljac7700/serial_robots_datasets)",
        ("ur5_jacobi_1000.csv", "ur5_jacobi_20.csv"), ("--validate", "ur5_jacobi_20.csv"),
    ),
    Example(
        "ur10", "ur10",
        "Position and orientation of a probe on the flange in ISO cubes, by a laser tracker; temperature",
        _UR10, ("ur10_ipa_D.csv",), ("--holdout", "0.3", "--model", "auto"),
    ),
    Example(
        "ur10-random", "ur10",
        "Position and orientation of a probe on the flange in the whole workspace, by a laser tracker; temperature",
        _UR10, ("ur10_ipa_C.csv",), ("--holdout", "0.3"),
    ),
    Example(
        "panda", "panda",
        "Joint positions alone, with a ball on the tool in one of two sockets 50 mm apart, at several places",
        "G. Franzese, M. Spahn and M. Ramirez, kinematics_calibration (Mukca), 2024 "
        "(github.com/platonics-delft/kinematics_calibration)",
        ("panda_sockets_mukca_3.csv",), ("--observe", "socket", "--socket-distance-mm", "50"), "socket",
    ),
)  # fmt: skip


@dataclass(frozen=True, repr=False, eq=False)
class ExampleResult(Result):
    """The examples that there are, or the one that was named.

    Attributes:
        examples: the examples, each with its name, robot, source and licence.
        files: that were written.
    """

    command = "example"
    warnings = ()

    options: ExampleOptions
    examples: tuple[Example, ...]
    files: tuple[Path, ...] = ()

    @property
    def measurements(self) -> Measurements:
        """The measurements of the example that was named.

        Raises:
            LabError: none was named.
        """
        if self.options.name is None:
            raise LabError(f"lab.example: no example is named; there are {_names()}")
        return self.examples[0].measurements

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints."""
        folder = self.files[0].parent if self.files else Path()
        return {
            "examples": [
                {key: value for key, value in asdict(each).items() if key not in ("options", "observe")}
                | {
                    "rows": each.rows,
                    "bytes": each.size_bytes,
                    "licence": each.licence_name,
                    "command": each.command(folder),
                }
                for each in self.examples
            ],
            "written": [str(file) for file in self.files],
        }

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each example."""
        rows = self.to_dict()["examples"]
        return {key: [row[key] for row in rows] for key in rows[0] if key != "files"}


def _names() -> str:
    return ", ".join(each.name for each in EXAMPLES)


@takes(ExampleOptions)
def example(name: str | ExampleOptions | None = None, **options: Any) -> ExampleResult:
    """List the measurements of real robots that come with the lab, or give one of them by its name.

    Args:
        name: of the example; without it all are listed. Or all options in one object, as the command line gives them:
            an example that is named is then written, into the current folder unless there is an ``out``.
        options: ``out``, the folder to write the example into; without it nothing is written.

    Returns:
        What the examples are, with ``measurements`` of the one that is named.

    Raises:
        LabError: there is no such example, or a file of its name is in the folder already.

    Example:
        >>> import lab
        >>> [each.name for each in lab.example().examples]
        ['ur5', 'ur10', 'ur10-random', 'panda']
        >>> len(lab.example("ur5").measurements)
        1000
    """
    if isinstance(name, ExampleOptions):
        return _example(name, name.out or Path())
    requested = options_of("lab.example", ExampleOptions, {"name": name, **options})
    return _example(requested, requested.out)


def _example(options: ExampleOptions, folder: Path | None) -> ExampleResult:
    """Write the named example into a folder, if any; or list all."""
    if options.name is None:
        if options.out is not None:
            raise LabError(f"--out is for one example: name it; there are {_names()}")
        return ExampleResult(options, EXAMPLES)
    found = _named(options.name)
    return ExampleResult(options, (found,), () if folder is None else _written(found, folder))


def _named(name: str) -> Example:
    for each in EXAMPLES:
        if each.name == name:
            return each
    near = get_close_matches(name.lower(), [each.name for each in EXAMPLES], 1, cutoff=0.5)
    meant = f"is {near[0]} meant? There" if near else "there"
    raise LabError(f"'{name}' is no example; {meant} are {_names()}")


def _written(found: Example, folder: Path) -> tuple[Path, ...]:
    """Write the files and the note into a folder, all or none."""
    contents = {folder / path.name: path.read_bytes() for path in found.paths}
    contents[folder / f"{found.name}_source.txt"] = found.note.encode()
    for path in contents:
        if path.is_symlink() or path.exists():
            raise LabError(f"{path}: is there already, and nothing was written; move it away, or give another --out")
    written = list[Path]()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path, content in contents.items():
            written.append(path)
            write_whole(path, content)
    except BaseException as error:
        for path in written:
            with suppress(OSError):
                path.unlink()
        if isinstance(error, OSError):
            why = error.strerror or error
            raise LabError(f"{folder}: cannot be written ({why}); nothing was written; give another --out") from error
        raise
    return tuple(written)
