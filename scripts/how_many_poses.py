"""How many poses are enough: predicted accuracy against their number, with O1 beside it (thesis fig. IV.1).

O1 is information per pose: it flattens early, which says that further poses are as good as the first
ones, not that they are of no use. The error goes on falling with the root of the number of poses.
"""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import tyro
from shared import FIGURE_STYLE, Answer, Document, Flag, Table, paragraphs, run_script, save_figure

from lab.campaign.options import DesignOptions
from lab.commands.design.figures import draw_errors, draw_information
from lab.commands.design.result import DesignResult
from lab.commands.design.run import planned_day

if TYPE_CHECKING:
    from matplotlib.figure import Figure


PLATEAU = 0.98  # of O1 at the last point of the curve


@dataclass(frozen=True)
class Options:
    """Predicted RMS, worst and 95 % error against the number of poses, and O1."""

    options: tyro.conf.OmitArgPrefixes[DesignOptions] = field(
        default_factory=lambda: DesignOptions(poses=50, starts=1, curve=True)
    )
    out: Path = Path("runs/how-many-poses")
    """The pictures' folder."""
    json: Flag = False
    """Print the curve as one JSON object."""


def answer(options: Options) -> Answer:
    """Plan once, and draw the curve up to twice as many poses."""
    plan = planned_day(options.options)
    summary = plan.to_dict()
    curve, last = summary["curve"], summary["curve"][-1]
    plateau = next(step for step in curve if step["o1"] >= PLATEAU * last["o1"])
    options.out.mkdir(parents=True, exist_ok=True)
    title = f"{summary['robot']}, {summary['instrument']}: how many poses are enough?"
    save_figure(options.out, "how_many_poses", _figure(plan, title))
    rows = tuple(
        (
            str(step["poses"]),
            *(f"{step[key]:.4f}" for key in ("rms_mm", "worst_mm", "promise_mm")),
            f"{step['o1']:.2f}",
            "O1 flattens" if step is plateau else "",
        )
        for step in curve
    )
    said = (
        f"From {plateau['poses']} to {last['poses']} poses O1 rises by {last['o1'] / plateau['o1'] - 1:.1%}, "
        f"and the error falls by {1 - last['promise_mm'] / plateau['promise_mm']:.0%}: "
        "stop by the accuracy wanted (lab design --accuracy-mm), not by O1."
    )
    table = Table(("poses", "RMS, mm", "worst, mm", "95 %/95 %, mm", "O1", ""), rows)
    picture = f"picture: {options.out / 'how_many_poses.png'}"
    asked = {name: str(value) if isinstance(value, Path) else value for name, value in asdict(options.options).items()}
    values = {"options": asked, "curve": curve, "plateau": plateau}
    return Answer(values, Document(title, (table, *paragraphs([said, picture]))))


def _figure(plan: DesignResult, title: str) -> "Figure":
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(FIGURE_STYLE):
        figure = Figure(figsize=(9, 4), layout="constrained")
        figure.suptitle(title)
        left, right = figure.subplots(1, 2)
        draw_errors(left, plan.curve)
        draw_information(right, plan.curve, plan.problem.scaling.describe())
    return figure


if __name__ == "__main__":
    run_script("how_many_poses")
