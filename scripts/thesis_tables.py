"""Which criterion should choose the poses? The thesis' tables done again, and 10,000 paired campaigns for each answer.

First tables IV.2 and IV.3 of Mahdadi & Bouafia (2020) as the thesis computed them: what they compare is three aliased
errors and one draw of the noise. Then the question itself: the 27 parameters of the canonical gauge, poses chosen by
each criterion in each scaling, or at random; 100 virtual arms, each measured 100 times, the same arms and the same
noise for every criterion; judged by the parameters' errors and on fresh poses.
"""

import json
import time
from dataclasses import dataclass
from pathlib import Path

import tyro
from rich.console import Console
from threadpoolctl import threadpool_limits

from lab.campaign.option_groups import Flag
from lab.commands.design.figures import save
from lab.experiments.figures import criteria_figure
from lab.experiments.other_searches import other_searches
from lab.experiments.thesis_mahdadi_2020 import reproduced
from lab.experiments.thesis_tables import print_thesis, thesis_summary
from lab.experiments.which_criterion import (
    CRITERIA,
    REFERENCE,
    SCALINGS,
    answer_summary,
    answered,
    criterion_study,
    print_answer,
)
from lab.studies.progress import study_runner

THESIS_DRAWS = 2000
SHOWN = {"fresh_mean_mm": "mean fresh error", "length_rms_mm": "error of the lengths"}


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    robots: int = 100
    """Virtual arms."""
    draws: int = 100
    """Campaigns with each, that differ in the noise."""
    poses: tuple[int, ...] = (10, 20, 40)
    """Numbers of poses."""
    criteria: tuple[str, ...] = CRITERIA
    """Which are compared with O1."""
    scalings: tuple[str, ...] = SCALINGS
    """In which units of the parameters."""
    searches: int = 2
    """How often all poses are chosen anew, to say how much is the search's luck."""
    workers: int = 2
    """Processes."""
    out: Path = Path("runs/thesis-tables")
    """Folder of the study and the picture; a study that is there goes on."""
    quick: Flag = False
    """10 arms, 10 draws, 20 poses, two scalings: a minute."""
    json: Flag = False
    """Print one JSON object."""


def main() -> None:
    """The thesis' tables, then the study and its answer."""
    given, started, console = tyro.cli(Options), time.perf_counter(), Console(highlight=False)
    with threadpool_limits(1):
        thesis = reproduced(THESIS_DRAWS)
        if not given.json:
            print_thesis(thesis, console)
        if given.quick:
            study = criterion_study(10, 10, (20,), CRITERIA, ("raw", "whitened"))
        else:
            study = criterion_study(given.robots, given.draws, given.poses, given.criteria, given.scalings)
        with study_runner(given.workers) as run:
            arranged, done = run(study, given.out / "study")
            seeds = range(1, 1 + (0 if given.quick else given.searches))
            others = other_searches(study, seeds, given.out, run, REFERENCE)
        answer = answered(arranged, others)
    each = study.robots * study.draws
    title = f"Which criterion should choose the poses? {each:,} paired campaigns each"
    save(given.out, "which_criterion", criteria_figure(answer, list(SHOWN), list(SHOWN.values()), title))
    seconds = time.perf_counter() - started
    if given.json:
        print(json.dumps({"thesis": thesis_summary(thesis), "answer": answer_summary(answer), "seconds": seconds}))
        return
    print_answer(answer, console)
    console.print(f"{done.computed:,} campaigns, all in {seconds:.0f} s; {given.out / 'which_criterion.png'}")


if __name__ == "__main__":
    main()
