"""Set the statements of chapters I and II of Mahdadi and Bouafia 2020 beside what ``thesis_claims`` finds."""

from functools import cache

import numpy as np

from lab.core.units import MM
from lab.extensions.reproduction.answer import ComparedValue, number, stated
from lab.extensions.reproduction.item import Item
from lab.extensions.reproduction.thesis_claims import (
    PAIRS,
    RANKED,
    WORKSPACE_ARMS,
    Interval,
    contradiction,
    error_sources,
    growth_along,
    paired_ratio,
    ratio_of,
    serial_over_parallel,
    thesis_arm_sources,
    wrist_workspace,
)
from lab.extensions.robotics.closed.recognition import classical_model_of
from lab.kinematics.closed.mechanism import Mechanism
from lab.report.charts.chart import axes_picture
from lab.report.charts.marks import Axes
from lab.report.document import Picture
from lab.report.style import AFTER, BEFORE
from lab.robots.load_robot import load_robot

__all__ = ["STATEMENT_ITEMS"]

_GROWING = ("irb120", "irb140", "irb2400", "rx130", "ur5")


def _workspaces() -> tuple[ComparedValue, ...]:
    answers = []
    for name in WORKSPACE_ARMS:
        reach, space = wrist_workspace(name)
        robot = name.upper().replace("IRB", "IRB ")
        answers.append(number(f"{robot}, reach of the wrist's centre", "", float(MM.of(reach)), "mm", digits=0))
        size, half = space.measured.size, 1.96 * space.measured.standard_error
        found = f"{size:.2f} ({size - half:.2f} to {size + half:.2f}) m³"
        answers.append(stated(f"{robot}, volume", "", holds=None, found=found))
    return tuple(answers)


def _workspace_pictures() -> tuple[Picture, ...]:
    sections = {name: wrist_workspace(name, 512)[1].section((0, 2), 0.0, 0) for name in WORKSPACE_ARMS}

    def draw(axes: Axes) -> None:
        for (name, cut), colour in zip(sections.items(), (AFTER, BEFORE), strict=True):
            for i, (first, second) in enumerate(MM.of(cut.vertices[cut.segments])):
                label = {"label": name} if not i else {}
                axes.plot([first[0], second[0]], [first[1], second[1]], "-", color=colour, linewidth=1.2, **label)
        axes.set_aspect("equal")
        axes.legend()
        axes.set(xlabel="x, mm", ylabel="z, mm")

    label = "Sections y = 0 of what the wrist's centre reaches: IRB 140 and IRB 2400"
    return (axes_picture("wrist-workspaces", label, (5.2, 5.2), draw),)


_ROWS = {  # of table I.1: printed, and the property of which the serial robot has more
    "workspace": ("serial large, parallel restricted", "workspace", "equal length"),
    "repeatability": ("parallel better", "repeatability", "equal length"),
    "accuracy before calibration": ("", "error before calibration", "equal length"),
    "accuracy after calibration": ("parallel better", "error after calibration", "equal length"),
    "accuracy after calibration, exact joints": (
        "parallel better", "error after calibration, exact joints", "equal length"
    ),
    "stiffness": ("parallel higher", "compliance", "equal length"),
    "repeatability at equal workspace": ("parallel better", "repeatability", "equal workspace"),
    "stiffness at equal workspace": ("parallel higher", "compliance", "equal workspace"),
}  # fmt: skip
_WHY = {
    "accuracy after calibration, exact joints": "with exact joints the error is that of the noise, about "
    "σ √(parameters / poses), and the parallel robot has more parameters",
    "repeatability at equal workspace": "made as large as the serial one's workspace, the parallel robot has longer "
    "levers",
    "stiffness at equal workspace": "compliance is the square of the same levers",
}


@cache
def _ratios(pair: str) -> dict[str, dict[str, Interval]]:
    return serial_over_parallel(pair)


def _compared() -> tuple[ComparedValue, ...]:
    answers = [_direct_models()]
    for name, (printed, quantity, size) in _ROWS.items():
        ratios = {pair: _ratios(pair)[quantity][size] for pair in PAIRS}
        sides = {ratio.side for ratio in ratios.values()}
        holds = None if not printed or 0 in sides or len(sides) > 1 else sides == {1}
        found = "; ".join(f"{pair}: serial over parallel {ratio}" for pair, ratio in ratios.items())
        answers.append(stated(name, printed, holds=holds, found=found, why=_WHY.get(name, "")))
    return tuple(answers)


def _direct_models() -> ComparedValue:
    """Count the solutions of the direct model: the poses at the same joint positions."""
    chain = load_robot("delta").chain
    assert isinstance(chain, Mechanism)
    classical = classical_model_of(chain)
    assert classical is not None
    modes = classical.modes(chain.home[None])[0]
    count = int(np.isfinite(modes).all(axis=1).sum())
    found = f"solutions of the direct model: delta {count}, a serial arm 1"
    return stated("kinematic models", "parallel complex, serial simple", holds=count > 1, found=found)


def _grows() -> tuple[ComparedValue, ...]:
    answers = []
    for name in _GROWING:
        grown = growth_along(name)
        steps = grown.steps
        answers.append(
            stated(f"{name}, mean of the arms", "grow from the base to the effector",
                    holds=True if all(step.side > 0 for step in steps) else None,
                    found=f"last frame over first {grown.whole}; the least step {min(steps, key=lambda s: s.value)}")
        )  # fmt: skip
        share = grown.monotone
        answers.append(
            stated(f"{name}, every arm at every step", "",
                    holds=None, found=f"in {100 * share.value:.0f} % of arms ({100 * share.lower:.0f} to "
                    f"{100 * share.upper:.0f})")
        )  # fmt: skip
    return tuple(answers)


def _ranking() -> tuple[ComparedValue, ...]:
    answers = []
    for name in RANKED:
        for aligned, words in ((False, "base and tool given"), (True, "base and tool fitted")):
            rms = error_sources(name, aligned=aligned)
            first, second = paired_ratio(rms["joints"], rms["geometry"]), paired_ratio(rms["geometry"], rms["other"])
            needed = float(1.5 / first.value)
            answers.append(
                stated(f"{name}, {words}: joints before geometry", "joints first",
                        holds=None if not first.side else first.side > 0, found=f"joints over geometry {first}",
                        why=f"at equal tolerances the reverse: zeros off by {needed:.1f} mrad (1σ) and more come first")
            )  # fmt: skip
            answers.append(
                stated(f"{name}, {words}: geometry before the rest", "geometry second",
                        holds=None if not second.side else second.side > 0, found=f"geometry over the rest {second}",
                        why="the other sources are larger")
            )  # fmt: skip
    own = thesis_arm_sources()
    ratio = ratio_of(own["joints"], own["geometry"])
    answers.append(
        stated("the arm of table IV.2: joints before geometry", "joints first",
                holds=None if not ratio.side else ratio.side > 0, found=f"joints over geometry {ratio}",
                why="lengths and α of the thesis' own arm displace its flange more than the five zeros do")
    )  # fmt: skip
    return tuple(answers)


def _contradicts() -> tuple[ComparedValue, ...]:
    found = contradiction()
    answers = []
    for names in (("O1", "O2", "O3"), ("O1", "O2"), ("O1", "O3"), ("O2", "O3")):
        share = found.disagree(*names)
        text = f"{100 * share.value:.0f} % of pairs ({100 * share.lower:.0f} to {100 * share.upper:.0f})"
        answers.append(
            stated(f"{', '.join(names)} order two sets differently", "in some cases", holds=share.lower > 0,
                    found=text, why="no pair was found")
        )  # fmt: skip
    pair = found.example()
    for name in ("O1", "O2", "O3"):
        first, second = found.scores[name][pair]
        answers.append(
            stated(f"an example, {name} of both sets", "", holds=None,
                    found=f"{first:.4g} and {second:.4g}: {'first' if first > second else 'second'} set")
        )  # fmt: skip
    return tuple(answers)


STATEMENT_ITEMS = (
    Item("Chapter I, section III.1", "Errors grow from the base to the effector", _grows, "lab inspect irb140",
         "RMS position error of each frame of 100 virtual arms, each link with tolerances of 0.5 mm and 1.5 mrad (1σ): "
         "geometric means of ratios, 95 % intervals over the arms."),
    Item("Figure I.4", "Workspaces of the IRB 140 and 2400", _workspaces, "lab workspace irb140 --tool-mm 0,0,-65",
         "Of the wrist's centre, as makers draw it, within the joint limits alone. The makers' reaches are 810 and "
         "1550 mm.", _workspace_pictures),
    Item("Table I.1", "Parallel against serial robots", _compared, "lab workspace planar3r rrr3",
         "Pairs with the same freedoms and three motors that turn: planar3r and rrr3 in the plane, an anthropomorphic "
         "carrier and a Delta in space. Equal length: the parts of one leg, laid end to end from the middle of the "
         "base to the tool, are as long; equal workspace: both reach as large an area or volume. Equal joint errors: "
         "0.01 mrad (1σ) of each motor, and springs of one stiffness at each; equal tolerances of all link parameters: "
         "0.5 mm and 1.5 mrad for legs of 1 m; equal calibrations: 30 random poses, noise of ±8 µm. Means over the "
         "workspace, 95 % intervals."),
    Item("Chapter I, section V.3", "Ranking of error sources", _ranking, "python scripts/experiments/error_sources.py",
         "RMS position error of 200 virtual arms by each source alone. Joints: zeros (1.5 mrad, 1σ), gains (50 ppm); "
         "geometry: all other table entries (0.5 mm, 1.5 mrad); the rest: joints of 1e5 Nm/rad under their own weight "
         "and 0 to 2 kg, runout of 0.1 mrad, backlash of 0.05 mrad, 5 K of warming. The order depends on these sizes. "
         "The command ranks the sources of two measured arms."),
    Item("Chapter II, section I.4", "O1 to O3 contradict each other", _contradicts,
         "lab design --robot irb120 --criterion O3",
         "Nahvi and Hollerbach 1996: 400 pairs of sets of 20 random poses, the 19 parameters in mm and rad."),
)  # fmt: skip
