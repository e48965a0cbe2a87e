"""Which error source costs most? One at a time is added to a base case whose identifier knows nothing of it.

The base: rigid arms, 30 designed poses, noise of ±8 µm. The same arms and the same noise in every case; what is told is
the mean error on validation poses, where the source acts as well.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from shared import FIGURE_STYLE, Answer, Document, Flag, Table, mark_ratios, paragraphs, run_script, save_figure

from lab.campaign.option_groups import Effects
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.core.significance import STUDY_COMPARISON
from lab.render.document import fixed
from lab.render.style import AXIS, BETTER, PREDICTED, REFERENCE
from lab.studies.analysis import CampaignArray, CellGroup, compared, holm, means
from lab.studies.grid import NONE, Cell, Study
from lab.studies.run import study_runner

METRIC = "fresh_mean_mm"
BASE = Cell()
EFFECTS = {
    "stiffness 1e5 Nm/rad, 0 or 3 kg": Effects(stiffness_nm_per_rad=1e5, payload_kg=(0.0, 3.0)),
    "stiffness 1e5 Nm/rad, no load": Effects(stiffness_nm_per_rad=1e5),
    "runout 0.2 mrad once a turn": Effects(harmonic_mrad=0.2),
    "gear ratios off by 50 ppm": Effects(gear_ppm=50.0),
    "backlash 0.1 mrad": Effects(backlash_mrad=0.1),
    "repeatability 0.01 mrad a joint": Effects(repeatability_mrad=0.01),
    "tracker drifts 0.02 mm, 0.01 mrad/h": Effects(drift_mm_per_h=0.02, drift_mrad_per_h=0.01),
    "arm grows by 10 ppm/h": Effects(growth_ppm_per_h=10.0),
    "read 1 s after a move, settling in 0.1 s": Effects(lag=float(np.exp(-10))),
    "1 % bad readings, 1 to 50 mm": Effects(bad_share=0.01),
}
OTHERS: dict[str, dict[str, Any]] = {
    "half the noise": {"noise": 0.5},
    "twice the noise": {"noise": 2.0},
    "an arm half as far off": {"position_sigma_mm": 0.25, "rotation_sigma_mrad": 0.75},
    "an arm twice as far off": {"position_sigma_mm": 1.0, "rotation_sigma_mrad": 3.0},
    "10 poses": {"poses": 10},
    "15 poses": {"poses": 15},
    "60 poses": {"poses": 60},
    "30 random poses": {"criterion": "random"},
}


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    robots: int = 100
    """Virtual arms."""
    draws: int = 20
    """Campaigns with each, that differ in the noise."""
    cases: tuple[str, ...] = (*EFFECTS, *OTHERS)
    """Which are set against the base."""
    workers: int = 2
    """Processes."""
    out: Path = Path("runs/what-matters")
    """Folder of the studies and the picture; studies that are there go on."""
    quick: Flag = False
    """10 arms and 10 draws."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Cost:
    """What a change adds to the base case's mean error, mm, with its 95 % interval.

    Attributes:
        told: whether it can be told from nothing, among all changes.
        left_out: campaigns that did not converge here or in the base.
    """

    name: str
    extra_mm: float
    lower_mm: float
    upper_mm: float
    base_mm: float
    told: bool
    left_out: int = 0

    @property
    def ends(self) -> tuple[float, float, float]:
        """Times the base's error, with the interval; that of the base itself, much smaller, is not in it."""
        ratio, lower, upper = (1 + each / self.base_mm for each in (self.extra_mm, self.lower_mm, self.upper_mm))
        return ratio, lower, upper

    @property
    def ratio(self) -> float:
        """Times the base's error."""
        return self.ends[0]

    @property
    def words(self) -> str:
        """The ratio with its interval."""
        return "{:.3g} ({:.3g} to {:.3g})".format(*self.ends)


def answer(options: Options) -> Answer:
    """Run all cases, sort them by what they cost, draw them."""
    robots, draws = (10, 10) if options.quick else (options.robots, options.draws)
    campaigns = together(studies(robots, draws, options.cases), options)
    cases = [name for name in (*EFFECTS, *OTHERS) if name in options.cases]
    base, costs = sorted_costs(campaigns, ["", *cases])
    words = f"30 designed poses, ±8 µm, {1e3 * base:.2f} µm"
    title = f"Which error source costs most? {robots * draws:,} paired campaigns each"
    save_figure(options.out, "what_matters", costs_figure(costs, words, title))
    said = summary(base, costs)
    blocks = (table(costs), *paragraphs([said, f"picture: {options.out / 'what_matters.png'}"]))
    return Answer({"base_mm": base, "costs": [asdict(cost) for cost in costs], "words": said}, Document(title, blocks))


def studies(robots: int, draws: int, cases: tuple[str, ...]) -> list[Study]:
    """The base with each effect; then one study for every other change. All have the same arms and noise.

    Raises:
        LabError: a case is unknown.
    """
    if strange := [name for name in cases if name not in {**EFFECTS, **OTHERS}]:
        raise LabError(f"--cases: '{strange[0]}' is none; there are {', '.join((*EFFECTS, *OTHERS))}")
    effects = {name: each for name, each in EFFECTS.items() if name in cases}
    changes = {
        name: {factor: (value,) for factor, value in change.items()} for name, change in OTHERS.items() if name in cases
    }
    base = Study("effects", robots=robots, draws=draws, factors={"effects": (NONE, *effects)}, effects=effects)
    return [base, *(Study(name, robots=robots, draws=draws, factors=change) for name, change in changes.items())]


def together(asked: list[Study], options: Options) -> CampaignArray:
    """The campaigns of all studies as those of one, its cells numbered through."""
    parts: list[dict[str, Array]] = []
    cells: list[Cell] = []
    with study_runner(options.workers) as run:
        for study in asked:
            columns = run(study, options.out / study.name.replace(" ", "-"))[0].columns
            parts.append({**columns, "cell": columns["cell"] + len(cells)})
            cells += study.cells
    return CampaignArray.of({name: np.concatenate([part[name] for part in parts]) for name in parts[0]}, cells)


def sorted_costs(arranged: CampaignArray, names: list[str]) -> tuple[float, list[Cost]]:
    """The base's mean error (mm), and what each case adds to it, the most expensive first."""
    base = means(arranged, METRIC)[0].mean
    group = CellGroup(("case",), {}, tuple(range(len(names))))
    pairs = [pair for pair in compared(arranged, group, METRIC, "difference").pairs if pair.first == 0]
    told = holm(np.array([pair.p for pair in pairs])) < STUDY_COMPARISON  # of the pairs with the base alone
    costs = [
        Cost(names[pair.second], pair.effect, pair.lower, pair.upper, base, bool(sure), pair.left_out)
        for pair, sure in zip(pairs, told, strict=True)
    ]
    return base, sorted(costs, key=lambda cost: -cost.extra_mm)


def costs_figure(costs: Sequence[Cost], base: str, title: str) -> Figure:
    """How many times the base case's error each change makes, the dearest on top, with 95 % intervals."""
    with matplotlib.rc_context(FIGURE_STYLE):
        figure = Figure(figsize=(10, 1.6 + 0.33 * len(costs)), layout="constrained")
        axes = figure.add_subplot()
        axes.set_xscale("log")
        lowest = min(0.9, *(max(cost.ends[1], 0.1) for cost in costs))
        axes.set_xlim(lowest / 1.1, 2.2 * max(cost.ends[2] for cost in costs))
        for row, cost in enumerate(costs):
            ratio, lower, upper = cost.ends
            colour = AXIS if not cost.told else PREDICTED if ratio > 1 else BETTER
            axes.barh(row, ratio - 1, left=1, color=colour, height=0.68)
            axes.hlines(row, max(lower, lowest), upper, color=REFERENCE, linewidth=1.5)
            axes.text(1.05 * max(upper, 1.0), row, cost.words, va="center", fontsize=8.5, color=REFERENCE)
        axes.axvline(1.0, color=REFERENCE, linewidth=1)
        axes.set_yticks(range(len(costs)), [cost.name for cost in costs])
        axes.set_ylim(len(costs) - 0.4, -0.6)
        axes.tick_params(axis="y", length=0)
        axes.grid(visible=False, axis="y")
        mark_ratios(axes)
        axes.set_xlabel(f"mean error on validation poses, times that of the base case ({base})")
        axes.set_title(title)
    return figure


def table(costs: list[Cost]) -> Table:
    """The most expensive first."""
    rows = tuple((cost.name, fixed(1e3 * cost.extra_mm, 2, signed=True), cost.words) for cost in costs)
    caption = "mean error on validation poses (95 % intervals over the arms)"
    return Table(("case", "adds, µm", "times the base"), rows, caption)


def summary(base: float, costs: list[Cost]) -> str:
    """The answer in a sentence or two."""
    dear = [cost for cost in costs if cost.ratio >= 2]
    small = [cost for cost in costs if abs(cost.ratio - 1) < 0.05 or not cost.told]
    lost = sum(cost.left_out for cost in costs)
    return (
        f"The base has {1e3 * base:.2f} µm. Most expensive: "
        + "; ".join(f"{cost.name} {cost.ratio:.3g} times" for cost in dear)
        + f". Hardly anything (below 5 %, or not to be told): {', '.join(cost.name for cost in small) or 'none'}."
        + (f" {lost} campaigns did not converge, and are left out." if lost else "")
    )


if __name__ == "__main__":
    run_script("what_matters")
