"""Run studies on processes of this machine, each into a folder of its own."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from lab.core.progress import stages
from lab.studies.analysis import CampaignArray
from lab.studies.executors import local_executor
from lab.studies.grid import Study
from lab.studies.run_study import StudyDone, read_campaigns, run_study

__all__ = ["study_runner"]


@contextmanager
def study_runner(workers: int) -> Iterator[Callable[[Study, Path], tuple[CampaignArray, StudyDone]]]:
    """Yield a function that runs studies on processes of this machine, each into a new or unfinished folder.

    The function returns a study's campaigns in order, and its result; it refuses a folder of another study.
    """
    with local_executor(workers) as executor:

        def run(study: Study, folder: Path) -> tuple[CampaignArray, StudyDone]:
            folder.parent.mkdir(parents=True, exist_ok=True)
            with stages("running the study") as progress:
                there = (folder / "config.json").is_file()
                done = run_study(study, folder, executor, resume=there, progress=progress)
            table = read_campaigns(folder)
            columns = {name: table[name].to_numpy() for name in table.column_names}
            return CampaignArray.of(columns, study.cells, study.seed), done

        yield run
