"""Studies one after another, with bars that say how far they are."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

from lab.render.progress import bars
from lab.studies.executors import local_executor
from lab.studies.grid import Study
from lab.studies.run import StudyDone, run_study
from lab.studies.store import read_campaigns
from lab.studies.table import CampaignArray

__all__ = ["study_runner"]

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
