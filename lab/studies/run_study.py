"""Run a study on any executor, and read and write its folder: its options, poses of every cell, campaigns.

Each file is stored when it is finished: written under a temporary name and renamed, so that none is incomplete.
"""

import hashlib
import json
import shutil
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from threadpoolctl import threadpool_limits

from lab.core.errors import LabError, option_name
from lab.core.progress import Stage, no_stage
from lab.core.se3 import Array
from lab.core.whole_folder import (
    draft_of,
    held,
    keep_checked,
    left_of,
    piece_files,
    read_checked,
    resolved,
    write_whole,
)
from lab.extension_points import receive_parts, sent_parts
from lab.formats.structured import read_json, read_structured
from lab.kinematics.effects.effect import PAYLOAD
from lab.robots.load_robot import load_robot
from lab.studies.campaigns import COLUMNS, cell_poses, difference, origin_of, other_version, run_task
from lab.studies.executors import TIMEOUT_S, StoppedError, run_jobs
from lab.studies.grid import OF_PLAN, GridCell, Study, Task, study_from

__all__ = ["StudyDone", "read_campaigns", "read_store", "run_study"]

_CONFIG, _MANIFEST, _POSES, _CAMPAIGNS = "config.json", "manifest.json", "poses", "campaigns"
_DIGEST = "sha256"  # of the numbers, in a file of campaigns
_TYPES = {
    **dict.fromkeys(("cell", "robot", "draw", "steps", "lost"), pa.int32()),
    "converged": pa.bool_(),
    "failure": pa.string(),
}
_MEND = "give the folder of a study, or begin it again in another"
_SCHEMA = pa.schema([(name, _TYPES.get(name, pa.float64())) for name in COLUMNS])
_REALS = [field.name for field in _SCHEMA if field.type == pa.float64()]


@dataclass(frozen=True)
class _Begun:
    """Content of ``config.json`` of a study."""

    options: Mapping[str, Any]
    model_sha256: str
    versions: Mapping[str, str]


@dataclass(frozen=True)
class _Store:
    """Files of a study on the disk.

    Attributes:
        columns: names of the joints with their units, in the files of poses.
    """

    folder: Path
    study: Study
    columns: tuple[str, ...]

    @cached_property
    def cells(self) -> tuple[GridCell, ...]:
        """Cells of the study, computed once."""
        return self.study.cells

    def campaigns_of(self, task: Task) -> int:
        """Return the number of campaigns of a task."""
        return (task.last - task.first) * self.study.draws

    def read_poses(self, cell: int) -> Array | None:
        """Read the poses ``(n, joints)`` of a cell, in rad or m; None if missing or incomplete."""
        content = read_checked(self._poses(cell))
        if content is None:
            return None
        try:
            header, *rows, end = content.decode().split("\n")
            joints = np.array([row.split(",") for row in rows], dtype=np.float64)
        except ValueError:
            return None
        poses, columns = self.cells[cell].poses, header.split(",")
        named = columns in ([*self.columns], [*self.columns, PAYLOAD])
        whole = joints.shape == (len(joints) if poses == OF_PLAN else poses, len(columns)) and joints.size > 0
        return joints if whole and named and not end else None

    def keep_poses(self, cell: int, joints: Array) -> None:
        """Write the poses of a cell, to the last digit, with payloads where there is a column of these."""
        names = [*self.columns, PAYLOAD][: joints.shape[1]]
        rows = [",".join(map(repr, row)) for row in joints.tolist()]
        content = ("\n".join([",".join(names), *rows]) + "\n").encode()
        path = self._poses(cell)
        with _write_errors(path):
            keep_checked(path, content)

    def has(self, task: Task) -> bool:
        """Decide whether all campaigns of a task are stored, and undamaged."""
        try:
            return len(_read(self._campaigns(task))) == self.campaigns_of(task)
        except (OSError, pa.ArrowException):
            return False

    def keep(self, task: Task, columns: dict[str, Array]) -> None:
        """Write the campaigns of a task: the same campaigns give the same bytes."""
        arrays = [np.asarray(columns[field.name], dtype=field.type.to_pandas_dtype()) for field in _SCHEMA]
        parts = [pa.array(array, field.type) for array, field in zip(arrays, _SCHEMA, strict=True)]
        table = pa.Table.from_arrays(parts, schema=_SCHEMA)
        table = table.replace_schema_metadata({_DIGEST: _digest(table)})
        assert len(table) == self.campaigns_of(task), task
        buffer = pa.BufferOutputStream()
        pq.write_table(
            table,
            buffer,
            compression="zstd",
            use_dictionary=False,
            use_byte_stream_split=_REALS,
            write_page_checksum=True,
        )
        path = self._campaigns(task)
        with _write_errors(path):
            write_whole(path, buffer.getvalue())

    def read(self) -> pa.Table:
        """Read all campaigns, in the order of the tasks.

        Raises:
            LabError: some are missing or damaged.
        """
        tables = []
        for path in map(self._campaigns, self.study.tasks):
            try:
                tables.append(_read(path))
            except (OSError, pa.ArrowException) as error:
                raise LabError(
                    f"{path}: not there, or not whole; run the study again with {option_name('resume')}"
                ) from error
        return pa.concat_tables(tables)

    def remove_left_over(self) -> None:
        """Remove half-written files of the study itself, from a killed run, and no others."""
        posed = {path.name for i in range(len(self.cells)) for path in piece_files(self._poses(i))}
        done = {self._campaigns(task).name for task in self.study.tasks}
        for part, names in ((_POSES, posed), (_CAMPAIGNS, done)):
            for path in (self.folder / part).iterdir():
                if left_of(path) in names and path.is_file():
                    path.unlink()

    def _poses(self, cell: int) -> Path:
        return self.folder / _POSES / f"cell{cell:04d}.csv"

    def _campaigns(self, task: Task) -> Path:
        return self.folder / _CAMPAIGNS / f"{task.name}.parquet"


def _begin(folder: Path, study: Study) -> _Store:
    """Create a study's folder with its description, or nothing at all.

    Raises:
        LabError: it is not empty, or cannot be written.
    """
    content = _described(study)
    try:
        place = resolved(folder)
        if place.exists() and (not place.is_dir() or any(place.iterdir())):
            raise LabError(
                f"{folder}: holds something; {option_name('resume')} goes on with a study, else give another folder"
            )
        with draft_of(place, replacing=False) as draft:
            for part in (_POSES, _CAMPAIGNS):
                (draft / part).mkdir()
            for name, values in content.items():
                (draft / name).write_bytes(_json(values))
    except OSError as error:
        raise LabError(f"{folder}: cannot be written ({error.strerror}); make room, or give another folder") from error
    return _Store(folder, study, _pose_columns(study))


def _resume(folder: Path, study: Study) -> _Store:
    """Open the folder of this study, and remove half-written files of a killed run.

    Raises:
        LabError: it holds another study, or was begun with another version or other files of the robot.
    """
    _refuse_another_study(folder, _described(study))
    try:
        with held(folder):
            for part in (folder, folder / _POSES, folder / _CAMPAIGNS):
                part.mkdir(exist_ok=True)
            store = _Store(folder, study, _pose_columns(study))
            store.remove_left_over()
    except OSError as error:
        raise LabError(
            f"{folder}: cannot be written ({error.strerror}); mend that, then {option_name('resume')}"
        ) from error
    return store


def _refuse_another_study(folder: Path, here: Mapping[str, dict[str, Any]]) -> None:
    """Refuse the folder of a study that is not this one.

    Args:
        here: what the files of this study would say.

    Raises:
        LabError: it has other options, or was begun with another version or other files of the robot.
    """
    there = read_structured(folder / _CONFIG, _Begun, _MEND)
    old, new = there.options, _plain(here[_CONFIG])["options"]
    what = other_version(there.versions, here[_CONFIG]["versions"])
    compared = [name for name in new if name != "metric"]  # which changes the page alone
    if what is None and (other := next((name for name in compared if old.get(name) != new[name]), None)):
        raise LabError(
            f"{folder}: holds another study ({other} is {old.get(other)} there, {new[other]} here); "
            "give the folder of this one, or begin it in a folder of its own"
        )
    if what is None:
        what = _other_files(folder, there, here)
    if what is not None:
        raise LabError(f"{folder}: was begun with {what}; go on with that, or begin again in another folder")


def _other_files(folder: Path, there: _Begun, here: Mapping[str, dict[str, Any]]) -> str | None:
    """Describe files of the robot or of the study's folder that are others than this study's; None if none are."""
    if there.model_sha256 != here[_CONFIG]["model_sha256"]:
        return "other files of the robot"
    return None if read_json(folder / _MANIFEST, _MEND) == _plain(here[_MANIFEST]) else "another manifest.json"


def read_store(folder: Path) -> _Store:
    """Open the folder of a study to read.

    Raises:
        LabError: it holds none.
    """
    study = study_from(read_structured(folder / _CONFIG, _Begun, _MEND).options)
    return _Store(folder, study, _pose_columns(study))


def read_campaigns(folder: Path) -> pa.Table:
    """Read all campaigns of a study, a row each: cell by cell, robot by robot, draw by draw.

    Raises:
        LabError: the folder holds no study, or one that is not finished.
    """
    return read_store(folder).read()


@contextmanager
def _write_errors(path: Path) -> Iterator[None]:
    """Stop the study if a file cannot be written; finished files stay.

    Raises:
        StoppedError: the disk is full, or does not let it be written.
    """
    try:
        yield
    except OSError as error:
        raise StoppedError(
            f"{path.name} cannot be written ({error.strerror}); make room, then {option_name('resume')} goes on"
        ) from error


def _described(study: Study) -> dict[str, dict[str, Any]]:
    columns = {field.name: {"type": str(field.type), "meaning": COLUMNS[field.name]} for field in _SCHEMA}
    cells = [{"number": number, "factors": asdict(cell)} for number, cell in enumerate(study.cells)]
    tasks = [{"file": f"{_CAMPAIGNS}/{task.name}.parquet", **asdict(task)} for task in study.tasks]
    return {
        _CONFIG: {"command": "study", "options": asdict(study), **origin_of(study.robot)},
        _MANIFEST: {"columns": columns, "cells": cells, "tasks": tasks},
    }


def _pose_columns(study: Study) -> tuple[str, ...]:
    chain = load_robot(study.robot).chain
    units = ("m" if slides else "rad" for slides in chain.prismatic)
    return tuple(f"{name}_{unit}" for name, unit in zip(chain.joint_names, units, strict=True))


def _read(path: Path) -> pa.Table:
    """Read a file of campaigns; an Arrow error or OSError if it was changed or damaged."""
    with pq.ParquetFile(path, page_checksum_verification=True) as file:
        table = file.read()
    if not table.schema.equals(_SCHEMA):
        raise pa.ArrowInvalid("other columns")
    if (table.schema.metadata or {}).get(_DIGEST.encode()) != _digest(table).encode():
        raise pa.ArrowInvalid("other numbers than were written")
    return table.replace_schema_metadata()


def _digest(table: pa.Table) -> str:
    digest = hashlib.sha256()
    for column in table.columns:
        values = column.to_numpy()
        digest.update(json.dumps(values.tolist()).encode() if values.dtype == object else values.tobytes())
    return digest.hexdigest()


def _json(values: dict[str, Any]) -> bytes:
    return (json.dumps(values, indent=1, allow_nan=False) + "\n").encode()


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    plain: dict[str, Any] = json.loads(_json(values))
    return plain


@dataclass(frozen=True)
class StudyDone:
    """A finished study.

    Attributes:
        computed: number of campaigns added by this run.
        seconds: duration, designs and start of the processes included.
    """

    folder: Path
    study: Study
    computed: int
    seconds: float

    @property
    def summary(self) -> dict[str, Any]:
        """Summary that ``--json`` prints."""
        return {
            "folder": str(self.folder),
            "campaigns": self.study.campaigns,
            "computed": self.computed,
            "seconds": self.seconds,
            "campaigns_per_second": self.computed / self.seconds,
            "cells": [{"number": number, "factors": asdict(cell)} for number, cell in enumerate(self.study.cells)],
        }


def run_study(
    study: Study,
    folder: Path,
    executor: Executor,
    *,
    resume: bool = False,
    progress: Stage = no_stage,
    posing: Callable[[Study, GridCell], Array] = cell_poses,
    solving: Callable[[Study, Task, Array], dict[str, Array]] = run_task,
    timeout_s: float = TIMEOUT_S,
) -> StudyDone:
    """Run a study into a folder, or go on with one that stopped.

    Args:
        executor: whose workers have the lab: threads, processes or a cluster; the campaigns are the same.
        timeout_s: for so long the workers may finish nothing.

    Raises:
        LabError: the folder cannot be written, or the study is impossible.
        StoppedError: the disk is full, or workers were lost or do not answer; finished files stay.
    """
    started = time.perf_counter()
    work = partial(_work, origin_of(study.robot), study.robot, sent_parts())
    store = _resume(folder, study) if resume else _begin(folder, study)
    run = partial(run_jobs, executor, timeout_s=timeout_s)
    with held(folder), threadpool_limits(1):  # of this process, whose threads may be the workers
        try:
            poses = _posed(store, run, progress, partial(work, posing))
        except StoppedError:
            raise
        except Exception:  # of a worker: the study is impossible
            if not resume:
                shutil.rmtree(folder, ignore_errors=True)
            raise
        computed = _solved(store, run, progress, partial(work, solving), poses)
    return StudyDone(folder, study, computed, time.perf_counter() - started)


_Run = Callable[[Iterable[tuple[Any, Callable[[], Any]]]], Generator[tuple[Any, Any], None, None]]


def _posed(store: _Store, run: _Run, progress: Stage, work: Callable[..., Array]) -> dict[int, Array]:
    """Return the poses of every cell; missing ones are computed and stored."""
    cells = store.cells
    read = ((number, store.read_poses(number)) for number in range(len(cells)))
    poses = {number: joints for number, joints in read if joints is not None}
    progress("poses", len(poses), len(cells))
    left = [number for number in range(len(cells)) if number not in poses]
    jobs = ((number, partial(work, store.study, cells[number])) for number in left)
    with closing(run(jobs)) as results:
        for number, joints in results:
            store.keep_poses(number, joints)
            poses[number] = joints
            progress("poses", len(poses), len(cells))
    return poses


def _solved(
    store: _Store,
    run: _Run,
    progress: Stage,
    work: Callable[..., dict[str, Array]],
    poses: dict[int, Array],
) -> int:
    study = store.study
    left = [task for task in study.tasks if not store.has(task)]
    at_first = finished = study.campaigns - sum(store.campaigns_of(task) for task in left)
    progress("campaigns", finished, study.campaigns)
    jobs = ((task, partial(work, study, task, poses[task.cell])) for task in left)
    with closing(run(jobs)) as results:
        for task, columns in results:
            store.keep(task, columns)
            finished += store.campaigns_of(task)
            progress("campaigns", finished, study.campaigns)
    return finished - at_first


def _work(origin: dict[str, Any], robot: str, parts: bytes, function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function in a worker, with one BLAS thread; refuse other versions or files, whose results may differ."""
    what = difference(_origin_here(robot), origin)
    if what is not None:
        raise StoppedError(f"a worker has {what}; mend that, then {option_name('resume')} goes on")
    threadpool_limits(1)
    receive_parts(parts)
    return function(*arguments)


@lru_cache
def _origin_here(robot: str) -> dict[str, Any]:
    return origin_of(robot)
