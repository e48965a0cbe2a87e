"""How far long work is, and what time is left: bars on a terminal, nothing in a pipe."""

import contextlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn

from lab.studies.executors import local_executor
from lab.studies.grid import Study
from lab.studies.run import StudyDone, run_study
from lab.studies.store import read_campaigns
from lab.studies.table import CampaignArray


@contextlib.contextmanager
def bars() -> Iterator[Callable[[str, int, int], None]]:
    """Takes what is being made, how many there are, and how many there are to be; a bar for each kind."""
    if not sys.stderr.isatty():
        yield lambda what, there, all_of_them: None
        return
    shown_bars: dict[str, Any] = {}
    columns = (*Progress.get_default_columns()[:2], MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as shown:

        def progress(what: str, there: int, all_of_them: int) -> None:
            if what not in shown_bars:
                shown_bars[what] = shown.add_task(what, total=all_of_them, completed=there)
            shown.update(shown_bars[what], completed=there)

        yield progress


Running = Callable[[Study, Path], tuple[CampaignArray, StudyDone]]


@contextlib.contextmanager
def study_runner(workers: int) -> Iterator[Running]:
    """Processes of this machine that run studies, one after another, each into a folder or on with what is there.

    What is yielded gives a study's campaigns in order, and how long it took; a LabError where the folder holds another
    study.
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
