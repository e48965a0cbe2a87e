"""Read ``config.json`` of a run: its command, its options, and its inputs.

A run keeps a copy of each input file in its folder ``inputs``, which later commands read. Of a file without a copy the
file that its options name is used, if it has the run's checksum.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar

from lab.core.errors import LabError
from lab.core.whole_folder import CHECKSUMS, edited_files, file_digest, listed_digests
from lab.formats.structured import read_checksums, read_structured, structured
from lab.robots.robot_files import parted

__all__ = [
    "CONFIG_FILE", "INPUTS", "LOAD_FILE", "RUN_FILES", "SCHEMA", "RunConfig", "RunInputs", "input_names",
    "read_config", "read_options", "refuse_own_name", "robot_of_file",
]  # fmt: skip

_Options = TypeVar("_Options")
SCHEMA = 1  # the version of what config.json, parameters.json and result.json hold; docs/reference/schemas describes it
CONFIG_FILE, INPUTS = "config.json", "inputs"
_FILES = (".toml", ".xml", ".urdf")  # descriptions of robots, instruments and cells, unlike names of the lab's own
LOAD_FILE = "load.json"  # a payload, in the folder of a run
RUN_FILES = {  # and what its checksums list: a folder with anything else is not replaced
    LOAD_FILE, CHECKSUMS,
    "config.json", "measurements.csv", "parameters.json", "covariance.csv", "residual.csv", "fitted_poses.csv",
    "result.json", "calibrated.xml", "calibrated.toml", "calibrated.urdf", "calibrated_origins.xacro",
    "ur_kinematics.yaml", "calibration.conf", "calibrated.py", "next.csv", "predicted.csv", "nominal.toml",
    "joints.csv", "cartesian.csv", "plan.csv", "trajectory.csv", "corrected.csv", "load.csv", "motion.csv",
    "another.csv", "values.csv", "workspace.csv", "sensor.toml", "history.csv", "history.prom",
    "recording.rrd", "model.py", "model.c", "model.m",
    "report.html",
}  # fmt: skip


@dataclass(frozen=True)
class RunConfig:
    """Content of ``config.json`` of a run.

    Attributes:
        schema: version of what the run's files hold; ``SCHEMA`` alone is read.
        options: those of the command, as plain values.
        inputs_sha256: checksum of each input, by its path as given.
        inputs: path of each input's copy in the run's folder, by the same key.
        versions: of the lab and of libraries that made the run.
    """

    options: Mapping[str, Any]
    command: str = ""
    model_sha256: str = ""
    schema: int = 0
    inputs_sha256: Mapping[str, str] = field(default_factory=dict)
    inputs: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse copies outside of the folder of copies, with a LabError."""
        for copy in self.inputs.values():
            parts = PurePosixPath(copy).parts
            if parts[:1] != (INPUTS,) or ".." in parts:
                raise LabError(f"inputs: {copy!r} is to be a path below {INPUTS}/")


@dataclass(frozen=True)
class RunInputs:
    """Input files of a run, by the paths in its options.

    Attributes:
        folder: of the run.
    """

    folder: Path
    config: RunConfig

    def copy(self, given: object) -> Path | None:
        """Return the copy of an input in the run's folder; None without one."""
        file, ends = parted(str(given))
        kept = self.config.inputs.get(file)
        copy = None if kept is None else self.folder / kept
        return Path(f"{copy}{ends}") if copy is not None and copy.exists() else None

    def path(self, given: object) -> Path:
        """Return the copy of an input, or the input itself if it is the run's; names of the lab's own are unchanged.

        Raises:
            LabError: the run keeps no copy, and the file is missing or another one.
        """
        file, ends = parted(str(given))
        path, valid = Path(file), self.config.inputs_sha256.get(file)
        if (copy := self.copy(given)) is not None:
            return copy
        if valid is None and path.suffix not in _FILES:
            return Path(f"{path}{ends}")
        if path.is_file() and file_digest(path) == valid:
            return Path(f"{path}{ends}")
        what = f"the file of that name is {'another one' if path.is_file() else 'not there'}"
        raise LabError(
            f"{self.folder}: keeps no copy of its input {given}, and {what}; put the run's own file there, or make the "
            "run again"
        )

    def located(self, value: Any) -> Any:
        """Return options as plain values, with inputs replaced by their copies."""
        if isinstance(value, Mapping):
            return {name: self.located(each) for name, each in value.items()}
        if isinstance(value, list):
            return [self.located(each) for each in value]
        copy = self.copy(value) if isinstance(value, str) else None
        return value if copy is None else str(copy)


def _read(path: Path, mend: str) -> RunConfig:
    config = read_structured(path, RunConfig, mend)
    if config.schema != SCHEMA:
        wrote = config.versions.get("virtual-calibration-lab", "of unknown version")
        raise LabError(
            f"{path}: has schema {config.schema} of lab {wrote}; this lab reads {SCHEMA}; make the run "
            "again, or use that lab"
        )
    return config


def read_config(folder: Path, mend: str = "give the folder of a run of the lab") -> RunConfig:
    """Read ``config.json`` of a run.

    Args:
        mend: end of the message if it cannot be read.

    Raises:
        LabError: the file cannot be read, or is not a run's.
    """
    return _read(folder / CONFIG_FILE, mend)


def robot_of_file(path: Path) -> str | None:
    """Return the robot of the run in whose folder a file lies: a name, or the path of its description; else None.

    Raises:
        LabError: the folder's ``config.json`` cannot be read.
    """
    if not (path.parent / CONFIG_FILE).is_file():
        return None
    config = read_config(path.parent)
    robot = config.options.get("robot")
    return str(RunInputs(path.parent, config).copy(robot) or robot) if isinstance(robot, str) else None


def input_names(folder: Path) -> tuple[str, ...]:
    """Return the paths of input copies that a run's folder holds, or should hold by its checksums."""
    there = [path for path in (folder / INPUTS).rglob("*") if path.is_file()]
    names = {path.relative_to(folder).as_posix() for path in there}
    if (folder / CHECKSUMS).is_file():
        listed = listed_digests(read_checksums(folder))
        names |= {name for name in listed if name.startswith(f"{INPUTS}/")}
    return tuple(sorted(names))


def read_options(path: Path, command: str, kind: type[_Options]) -> _Options:
    """Read the options of a run of ``command``; missing ones have their defaults.

    Inputs are read from their copies beside the file.

    Raises:
        LabError: the file cannot be read, is of another command, or has an unknown option, or a copy was changed.
    """
    mend, folder = "give a run's config.json", path.parent
    config = _read(path, mend)
    if config.command not in (command, ""):
        raise LabError(f"{path}: is of lab {config.command}, not of lab {command}; run that")
    if config.inputs and (folder / CHECKSUMS).is_file():
        text = read_checksums(folder)
        if edited := edited_files(folder, text, input_names(folder)):
            raise LabError(f"{folder}: {edited[0]} was changed since the run was written; put it back, or run anew")
    inputs = RunInputs(folder, config)
    for given, digest in config.inputs_sha256.items():
        if inputs.copy(given) is None and Path(given).is_file() and file_digest(Path(given)) != digest:
            raise LabError(f"{path}: {given} is another file than that of the run; put it back, or run anew")
    return structured(path, kind, inputs.located(config.options))


def refuse_own_name(where: object, name: str) -> None:
    """Refuse to write a file under the name of one that a run writes for itself.

    Args:
        where: the option, or the file that is written again under its name, as the error begins.

    Raises:
        LabError: a run has a file of this name.
    """
    if name.lower() in {INPUTS, *(each.lower() for each in RUN_FILES)}:
        raise LabError(f"{where}: a run writes a file {name} of its own, which this one would replace; rename it")
