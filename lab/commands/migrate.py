"""Migrate runs of an older lab to the current format: schema, checksums, and a date where one is given."""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from lab.calibration.estimate import EstimatedParameter
from lab.calibration.estimate_files import read_estimate_files
from lab.calibration.identify import WEAK
from lab.campaign.config_file import CONFIG_FILE, INPUTS, read_config
from lab.commands.calibrate.load_run import CALIBRATIONS, read_header
from lab.commands.options import MigrateOptions
from lab.commands.result import Result
from lab.commands.run_folder import SCHEMA, is_older, refuse_edits, write_json
from lab.core.errors import LabError
from lab.core.whole_folder import CHECKSUMS, checksum_lines, draft_of, recover, resolved
from lab.formats.structured import read_json
from lab.render.document import Document, Table

__all__ = ["MigrationResult", "migrate"]


class _Migrated(NamedTuple):
    folder: Path
    given: tuple[str, ...]  # what the run lacked before


@dataclass(frozen=True, repr=False, eq=False)
class MigrationResult(Result):
    """The runs that were looked at."""

    command = "migrate"
    shown_by = "lab.commands.migrate:_migration_document"

    options: MigrateOptions
    runs: tuple[_Migrated, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings on facts that a migration cannot recover."""
        if any(each.given and each.given[0].startswith("schema") for each in self.runs):
            return ("edits of an older run without checksums cannot be detected; the numbers are not changed",)
        return ()

    def to_dict(self) -> dict[str, Any]:
        """Return the values that ``--json`` prints."""
        return {
            "runs": [{"run": str(each.folder), "given": list(each.given)} for each in self.runs],
            "warnings": list(self.warnings),
        }

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each run."""
        return {"run": [str(each.folder) for each in self.runs], "given": [", ".join(each.given) for each in self.runs]}


def _migration_document(result: MigrationResult) -> Document:
    given = [", ".join(each.given) or "nothing: the run has the current format" for each in result.runs]
    rows = tuple((str(each.folder), text) for each, text in zip(result.runs, given, strict=True))
    count = sum(bool(each.given) for each in result.runs)
    return Document(f"{count} of {len(result.runs)} runs migrated", (Table(("run", "given"), rows),))


_NO_RUN = "give the folder of a run of the lab"


def migrate(options: MigrateOptions) -> MigrationResult:
    """Bring the runs of a folder to the schema of today; a run stands there whole, the old one or the new one.

    Raises:
        LabError: the folder holds no run, a run was edited, or a date is given for several runs or instead of another.
    """
    with suppress(OSError):  # a run that was moved aside by a migration that was killed
        recover(resolved(options.folder))
    folders = list(_runs(options.folder))
    for folder in folders:  # before any is changed
        refuse_edits(folder)
    if options.date is not None and len(folders) > 1:
        raise LabError(
            f"{options.folder}: holds {len(folders)} runs, but --date is for one run; give that run's folder"
        )
    return MigrationResult(options, tuple(_Migrated(each, _migrated(each, options.date)) for each in folders))


def _runs(folder: Path) -> Iterator[Path]:
    if (folder / "config.json").is_file():
        yield folder
        return
    inside = sorted(folder.iterdir()) if folder.is_dir() else []
    found = [path for path in inside if (path / "config.json").is_file()]
    if not found:
        raise LabError(f"{folder}: holds no run; {_NO_RUN}, or the one above it")
    yield from found


def _migrated(folder: Path, date: str | None) -> tuple[str, ...]:
    """Migrate a run: what was done, in words; nothing where it is as today's runs are."""
    config, header = _object(folder / CONFIG_FILE), read_config(folder, _NO_RUN)
    if "model_sha256" not in config:
        raise LabError(f"{folder}/config.json: is not what the lab writes; {_NO_RUN}")
    parameters = dict[str, EstimatedParameter]()
    if header.command in CALIBRATIONS:  # no checksums for what does not hold what a run holds
        read_header(folder)
        parameters.update({row.name: row for row in read_estimate_files(folder).rows})
    files, done = dict[str, Any](), []
    if is_older(folder):
        done.append(f"schema {SCHEMA}")
        files[CONFIG_FILE] = {"schema": SCHEMA, **config, "inputs_sha256": config.get("inputs_sha256", {})}
        if header.command in CALIBRATIONS:
            files["result.json"] = _object(folder / "result.json") | {"schema": SCHEMA, "migrated": True}
            files["parameters.json"] = [
                _observability(row, parameters[row["name"]]) for row in _rows(folder / "parameters.json")
            ]
    if date is not None:
        if (there := header.options.get("date")) not in (None, date):
            raise LabError(f"{folder}: its date is {there}; leave out --date {date}, or make the run again")
        if header.command not in (*CALIBRATIONS, "verify"):
            raise LabError(f"{folder}: is no run of lab calibrate, lab identify or lab verify; only these have a date")
        done += [] if there == date else [f"date {date}"]
        files[CONFIG_FILE] = files.get(CONFIG_FILE, config) | {"options": {**header.options, "date": date}}
    if not (folder / CHECKSUMS).is_file():
        done.append("checksums")
    if done:
        _replace(folder, files)
    return tuple(done)


def _replace(folder: Path, files: Mapping[str, Any]) -> None:
    own = {path for path in folder.iterdir() if (path.is_dir() if path.name == INPUTS else path.is_file())}
    if strays := sorted(path.name for path in folder.iterdir() if path not in own or path.is_symlink()):
        raise LabError(f"{folder}: holds {strays[0]}, which is not a file of a run; move it elsewhere")
    if Path.cwd().is_relative_to(folder.resolve()):
        raise LabError(f"{folder}: is the working folder, or holds it; go above it")
    try:
        with draft_of(resolved(folder), replacing=True) as draft:
            for path in folder.iterdir():  # copytree would list every file for which there is no space
                (shutil.copytree if path.is_dir() else shutil.copy2)(path, draft / path.name)
            for name, content in files.items():
                write_json(draft / name, content)
            (draft / CHECKSUMS).write_text(checksum_lines(draft), encoding="utf-8")
    except OSError as error:
        raise LabError(f"{folder}: cannot be written ({error.strerror or error}); nothing was changed") from error


def _observability(row: Mapping[str, Any], parameter: EstimatedParameter) -> dict[str, Any]:
    """Add to a row of ``parameters.json`` whether the parameter is weakly observable."""
    sure = parameter.std is not None and parameter.std <= WEAK
    weak = parameter.status == "identified" and parameter.unit in ("m", "rad") and not sure
    return {**row, "weakly_observable": row.get("weakly_observable", weak)}


def _object(path: Path) -> dict[str, Any]:
    content = read_json(path, _NO_RUN)
    if not isinstance(content, dict):
        raise LabError(f"{path}: is not what the lab writes; {_NO_RUN}")
    return content


def _rows(path: Path) -> list[dict[str, Any]]:
    content = read_json(path, _NO_RUN)
    if not isinstance(content, list) or not all(isinstance(row, dict) for row in content):
        raise LabError(f"{path}: is not what the lab writes; {_NO_RUN}")
    return content
