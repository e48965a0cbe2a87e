"""Which criterion should choose the poses? The thesis' tables done again, and 10,000 paired campaigns for each answer.

First tables IV.2 and IV.3 of Mahdadi & Bouafia (2020) as the thesis computed them: what they compare is three aliased
errors and one draw of the noise. Then the question itself: the 27 parameters of the canonical gauge, poses chosen by
each criterion in each scaling, or at random; 100 virtual arms, each measured 100 times, the same arms and the same
noise for every criterion; validated on the parameters' errors and on validation poses.
"""

import time
from dataclasses import dataclass
from pathlib import Path

from lab.campaign.option_types import Flag
from lab.experiments.figures import criteria_figure
from lab.experiments.other_searches import other_searches
from lab.experiments.script import Answer
from lab.experiments.thesis_tables import thesis_blocks, thesis_summary
from lab.experiments.which_criterion import (
    CRITERIA,
    REFERENCE,
    SCALINGS,
    answer_blocks,
    answer_summary,
    answered,
    criterion_study,
)
from lab.extensions.reproduction.thesis_case import reproduced
from lab.render.document import Document, Paragraph, Section
from lab.render.svg import save_figure
from lab.studies.progress import study_runner

__all__ = ["Options", "answer"]

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


def answer(options: Options) -> Answer:
    """The thesis' tables, then the study of criteria."""
    began, thesis = time.perf_counter(), reproduced(THESIS_DRAWS)
    if options.quick:
        study = criterion_study(10, 10, (20,), CRITERIA, ("raw", "whitened"))
    else:
        study = criterion_study(options.robots, options.draws, options.poses, options.criteria, options.scalings)
    with study_runner(options.workers) as run:
        campaigns, done = run(study, options.out / "study")
        seeds = range(1, 1 + (0 if options.quick else options.searches))
        others = other_searches(study, seeds, options.out, run, REFERENCE)
    comparison = answered(campaigns, others)
    title = f"Which criterion should choose the poses? {study.robots * study.draws:,} paired campaigns each"
    save_figure(options.out, "which_criterion", criteria_figure(comparison, list(SHOWN), list(SHOWN.values()), title))
    seconds = time.perf_counter() - began
    end = f"{done.computed:,} campaigns, all in {seconds:.0f} s; {options.out / 'which_criterion.png'}"
    blocks = (
        Section("The tables of the thesis", thesis_blocks(thesis)),
        Section("Which criterion", (*answer_blocks(comparison), Paragraph(end))),
    )
    values = {"thesis": thesis_summary(thesis), "answer": answer_summary(comparison), "seconds": seconds}
    return Answer(values, Document(title, blocks))
