"""Run a study on any executor: the poses of every cell, then all campaigns, each file stored when it is finished."""

import contextlib
import shutil
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from lab.core.errors import option_name
from lab.core.se3 import Array
from lab.core.whole_folder import held
from lab.render.terminal import bars
from lab.studies.analysis import CampaignArray
from lab.studies.campaigns import cell_poses, difference, origin_of, run_task
from lab.studies.executors import StoppedError, local_executor, run_jobs
from lab.studies.grid import Cell, Study, Task
from lab.studies.store import Store, begin, go_on, read_campaigns

__all__ = ["StudyDone", "run_study", "study_runner"]

_Progress = Callable[[str, int, int], None]  # kind of files, number of finished ones, number of all


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
    progress: _Progress = lambda kind, done, total: None,
    posing: Callable[[Study, Cell], Array] = cell_poses,
    solving: Callable[[Study, Task, Array], dict[str, Array]] = run_task,
) -> StudyDone:
    """Run a study into a folder, or go on with one that stopped.

    Args:
        executor: whose workers have the lab: threads, processes or a cluster; the campaigns are the same.

    Raises:
        LabError: the folder cannot be written, or the study is impossible.
        StoppedError: the disk is full or workers were lost; finished files stay.
    """
    started = time.perf_counter()
    store = go_on(folder, study) if resume else begin(folder, study)
    work = partial(_work, origin_of(study.robot), study.robot)
    with held(folder), threadpool_limits(1):  # of this process, whose threads may be the workers
        try:
            poses = _posed(store, executor, progress, partial(work, posing))
        except StoppedError:
            raise
        except Exception:  # of a worker: the study is impossible
            if not resume:
                shutil.rmtree(folder, ignore_errors=True)
            raise
        computed = _solved(store, executor, progress, partial(work, solving), poses)
    return StudyDone(folder, study, computed, time.perf_counter() - started)


def _posed(store: Store, executor: Executor, progress: _Progress, work: Callable[..., Array]) -> dict[int, Array]:
    """Return the poses of every cell; missing ones are computed and stored."""
    cells = store.cells
    read = ((number, store.read_poses(number)) for number in range(len(cells)))
    poses = {number: joints for number, joints in read if joints is not None}
    progress("poses", len(poses), len(cells))
    left = [number for number in range(len(cells)) if number not in poses]
    jobs = ((number, partial(work, store.study, cells[number])) for number in left)
    with closing(run_jobs(executor, jobs)) as results:
        for number, joints in results:
            store.keep_poses(number, joints)
            poses[number] = joints
            progress("poses", len(poses), len(cells))
    return poses


def _solved(
    store: Store,
    executor: Executor,
    progress: _Progress,
    work: Callable[..., dict[str, Array]],
    poses: dict[int, Array],
) -> int:
    """Compute and store the missing campaigns; return their number."""
    study = store.study
    left = [task for task in study.tasks if not store.has(task)]
    at_first = there = study.campaigns - sum(store.campaigns_of(task) for task in left)
    progress("campaigns", there, study.campaigns)
    jobs = ((task, partial(work, study, task, poses[task.cell])) for task in left)
    with closing(run_jobs(executor, jobs)) as results:
        for task, columns in results:
            store.keep(task, columns)
            there += store.campaigns_of(task)
            progress("campaigns", there, study.campaigns)
    return there - at_first


def _work(origin: dict[str, Any], robot: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function in a worker, with one BLAS thread; refuse other versions or files, whose results may differ."""
    what = difference(_origin_here(robot), origin)
    if what is not None:
        raise StoppedError(f"a worker has {what}; mend that, then {option_name('resume')} goes on")
    threadpool_limits(1)
    return function(*arguments)


@lru_cache
def _origin_here(robot: str) -> dict[str, Any]:
    """Return the origin of this process, computed once."""
    return origin_of(robot)


@contextlib.contextmanager
def study_runner(workers: int) -> Iterator[Callable[[Study, Path], tuple[CampaignArray, StudyDone]]]:
    """Yield a function that runs studies on processes of this machine, each into a new or unfinished folder.

    The function returns a study's campaigns in order, and its result; it refuses a folder of another study.
    """
    with local_executor(workers) as executor:

        def run(study: Study, folder: Path) -> tuple[CampaignArray, StudyDone]:
            folder.parent.mkdir(parents=True, exist_ok=True)
            with bars() as progress:
                there = (folder / "config.json").is_file()
                done = run_study(study, folder, executor, resume=there, progress=progress)
            table = read_campaigns(folder)
            columns = {name: table[name].to_numpy() for name in table.column_names}
            return CampaignArray.of(columns, study.cells, study.seed), done

        yield run
