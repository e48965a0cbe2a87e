"""Many simulated calibrations: read what is asked, choose who works it out, run it, and write what came out."""

from pathlib import Path
from typing import Any

from lab.commands.command_line import options_of, takes
from lab.commands.run_folder import free_name
from lab.commands.study.options import StudyOptions
from lab.commands.study.result import StudyResult
from lab.core.errors import LabError, error_context
from lab.render.terminal import bars
from lab.studies.analysis import Analysis, analysed
from lab.studies.campaigns import refuse_impossible
from lab.studies.executors import StoppedError, cluster_executor, local_executor
from lab.studies.grid import Study, read_study
from lab.studies.run import StudyDone, run_study
from lab.studies.store import read_campaigns

__all__ = ["study"]


@takes(StudyOptions)
def study(config: str | Path | Study | StudyOptions, **options: Any) -> StudyResult:
    """Run a study of many simulated calibrations into a folder, or go on with one that stopped.

    Its processes do not import the calling script, which needs no ``if __name__ == "__main__"``.

    Args:
        config: the study: a TOML file, or one in memory; or all options in one object.
        options: those of ``lab study``, by name: ``out``, ``resume``, ``workers``, ``scheduler``.

    Returns:
        Where its simulated calibrations are, and their analysis.

    Raises:
        LabError: the study asks for what there is not, or was stopped; the message says how to go on.
    """
    if isinstance(config, StudyOptions):
        return _run(config, read_study(config.config))
    known = config if isinstance(config, Study) else read_study(Path(config))
    file = "study.toml" if isinstance(config, Study) else str(config)
    return _run(options_of("lab.study", StudyOptions, {"config": file, **options}), known)


def _run(options: StudyOptions, known: Study) -> StudyResult:
    options.check()
    with error_context(options.config):
        refuse_impossible(known)
    folder = options.out or free_name(Path("runs"), f"study-{known.name}")
    chosen = local_executor(options.workers) if options.scheduler is None else cluster_executor(options.scheduler)
    try:
        with bars() as progress, chosen as executor:
            done = run_study(known, folder, executor, resume=options.resume, progress=progress)
    except StoppedError as error:
        raise LabError(f"{folder}: {error}") from error
    except KeyboardInterrupt as stop:
        raise KeyboardInterrupt(f"--resume goes on with what is in {folder}") from stop
    result = StudyResult(options, done, _analysis(done))
    result.write(done.folder)
    return result


def _analysis(done: StudyDone) -> Analysis:
    """Analyse the simulated calibrations of a study."""
    campaigns = read_campaigns(done.folder)
    columns = {name: campaigns[name].to_numpy() for name in campaigns.column_names}
    return analysed(columns, done.study.cells, done.study.seed)
