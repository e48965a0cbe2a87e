"""How many poses are enough: predicted accuracy against their number, with O1 beside it (thesis fig. IV.1).

O1 is information per pose: it flattens early, which says that further poses are as good as the first
ones, not that they are of no use. The error goes on falling with the root of the number of poses.
"""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

import tyro
from threadpoolctl import threadpool_limits

from lab.campaign.options import DesignOptions, Flag
from lab.commands.design.figures import curve_figure, save
from lab.commands.design.result import plan_summary
from lab.commands.design.run import design

PLATEAU = 0.98  # of O1 at the last point of the curve


@dataclass(frozen=True)
class Options:
    """Predicted RMS, worst and 95 % error against the number of poses, and O1."""

    options: tyro.conf.OmitArgPrefixes[DesignOptions] = field(default_factory=lambda: DesignOptions(poses=50, starts=1))
    out: Path = Path("runs/how-many-poses")
    """The pictures' folder."""
    json: Flag = False
    """Print the curve as one JSON object."""


def main() -> None:
    """Plan once, draw the curve up to twice as many poses, say what it shows."""
    given = tyro.cli(Options)
    with threadpool_limits(1):
        plan = design(given.options)
    seen = plan_summary(plan)
    curve, last = seen["curve"], seen["curve"][-1]
    plateau = next(step for step in curve if step["o1"] >= PLATEAU * last["o1"])
    given.out.mkdir(parents=True, exist_ok=True)
    title = f"{seen['robot']}, {seen['instrument']}: how many poses are enough?"
    save(given.out, "how_many_poses", curve_figure(plan.curve, title, plan.problem.scaling.describe()))
    if given.json:
        print(json.dumps({"options": asdict(given.options), "curve": curve, "plateau": plateau}, default=str))
        return
    print(f"{'poses':>5} {'RMS, mm':>9} {'worst, mm':>9} {'95 % in 95 %, mm':>17} {'O1':>8}")
    for step in curve:
        numbers = f"{step['rms_mm']:9.4f} {step['worst_mm']:9.4f} {step['promise_mm']:17.4f} {step['o1']:8.2f}"
        print(f"{step['poses']:5d} {numbers}{'   O1 flattens' if step is plateau else ''}")
    print(
        f"From {plateau['poses']} to {last['poses']} poses O1 rises by {last['o1'] / plateau['o1'] - 1:.1%}, "
        f"and the error falls by {1 - last['promise_mm'] / plateau['promise_mm']:.0%}: "
        "stop by the accuracy wanted (lab design --accuracy-mm), not by O1."
    )
    print(f"picture: {given.out / 'how_many_poses.png'}")


if __name__ == "__main__":
    main()
