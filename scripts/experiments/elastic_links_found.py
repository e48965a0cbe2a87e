"""Are bending links found by ``--model auto``, joint springs where those are, and nothing where nothing is?

Each arm has its bodies off and is measured at three targets in 60 poses with 0 or 3 kg, designed for joint springs and
bending links, by an instrument of 8 µm. Its upper arm and forearm bend as tubes of aluminium (80 x 4 mm), its joints 2
and 3 give way by 1e-5 rad/Nm, or both, or neither.
A curve says how often links are found over their EI, or cannot be told from joint springs, and what geometry and joint
springs leave of their deflection; fits with the group asked for by name say how often the intervals of 1/EI hold.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from designed_campaign import POSES, DesignedCampaign
from shared import SERIES, Answer, Document, Flag, Paragraph, drawing, paragraphs, run_script, save_figure
from threadpoolctl import threadpool_limits

from lab.core.measurements import Measurements
from lab.kinematics.gauge import base_set
from lab.library.virtual_arm import perturbed_arm
from lab.options.option_groups import Effects
from lab.options.virtual_campaign import VirtualCampaign
from lab.simulation.true_robot import TrueRobot
from lab.studies import executors

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NEEDS = ("matplotlib",)

EI = 48_400.0  # N m²: aluminium, 70 GPa, a tube of 80 x 4 mm
TARGETS = ("p1", "p2", "p3")
DAY = DesignedCampaign("irb120", TARGETS, ("compliance", "bending"))
STIFFER = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)  # times as stiff as those tubes; steel's of 80 x 5 mm are 3.6 times
FRESH_POSES = 100
SAID = ("found", "not told apart", "springs alone", "nothing")


def links(ei: float) -> tuple[float, ...]:
    """Upper arm and forearm."""
    return (0.0, ei, 0.0, ei, 0.0, 0.0)


CASES = {
    "links": (Effects(link_ei=links(EI)), ("bending",)),
    "joint springs": (Effects(stiffness_nm_per_rad=1e5), ("compliance",)),
    "both": (Effects(stiffness_nm_per_rad=1e5, link_ei=links(EI)), ("bending", "compliance")),
    "neither": (Effects(), ()),
}


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    arms: int = 100
    """Arms of each kind with elastic links, joint springs, or both."""
    rigid: int = 300
    """Arms with neither."""
    curve: int = 20
    """Arms at each point of the curve."""
    intervals: int = 1000
    """Arms for the intervals."""
    workers: int = 1
    """Processes."""
    out: Path | None = None
    """The folder for the figure of the curve; none is drawn if not given."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Found:
    """What came out for one arm.

    Attributes:
        chosen: the groups taken, in alphabetical order.
        fresh: root mean square error on validation poses over sigma sqrt(p / n), n the points measured.
    """

    chosen: tuple[str, ...]
    fresh: float


def answer(options: Options) -> Answer:
    """All counts."""
    with executors.local_executor(options.workers) as pool:
        found = {
            case: list(pool.map(partial(found_in, case), range(options.rigid if case == "neither" else options.arms)))
            for case in CASES
        }
        curve = {times: list(pool.map(partial(found_at, times * EI), range(options.curve))) for times in STIFFER}
        held = np.array(list(pool.map(interval_holds, range(options.intervals))))
    result: dict[str, Any] = {
        "cases": {case: of_case(case, each) for case, each in found.items() if each},
        "curve": [of_curve(times * EI, each) for times, each in curve.items() if each],
        "intervals": dict(zip(NAMES, held.mean(axis=0).tolist(), strict=True)) if len(held) else {},
        "interval_arms": options.intervals,
    }
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        save_figure(options.out, "elastic_links_found", picture(result["curve"]))
    return Answer(result, Document("Are bending links found, and only where they are?", words(result)))


def arm(effects: Effects, seed: int) -> tuple[TrueRobot, Measurements]:
    """An arm, and its measurement session."""
    real = perturbed_arm(DAY.robot, VirtualCampaign(seed=seed, effects=effects))
    return real, DAY.measured(real, seed)


def found_in(case: str, seed: int) -> Found:
    """One arm of a case."""
    with threadpool_limits(1):
        real, data = arm(CASES[case][0], seed)
        chosen = DAY.selected(data)
        errors = DAY.fresh_errors(real, chosen.identification, seed, FRESH_POSES)
        found = chosen.identification
        least = found.sigma_m * np.sqrt(len(found.fit.free) / (POSES * len(TARGETS)))
        return Found(tuple(sorted(chosen.chosen)), float(np.sqrt((errors**2).mean()) / least))


def found_at(ei: float, seed: int) -> str:
    """What is said of an arm whose links have this EI (N m²)."""
    with threadpool_limits(1):
        found = DAY.selected(arm(Effects(link_ei=links(ei)), seed)[1])
        if "bending" in found.chosen:
            return "found"
        doubted = any("bending" in (each.chosen, each.other) for each in found.alternatives)
        return "not told apart" if doubted else "springs alone" if "compliance" in found.chosen else "nothing"


def left_um(ei: float) -> float:
    """What geometry and joint springs leave (µm, root mean square of a point) of links with this EI, noise apart."""
    arm = DAY.robot.arm_with(TARGETS, DAY.groups)
    rigid, values = arm.rigid, arm.nominal(DAY.robot.tool)
    kept = list(base_set(rigid, rigid.nominal(DAY.robot.tool)).identifiable)
    kept += [i for i, name in enumerate(arm.names) if name.endswith(".compliance")]
    elastic = values.copy()
    elastic[[arm.names.index(f"link{link}.ei_{axis}") for link in (2, 4) for axis in "yz"]] = 1 / ei
    inputs = np.column_stack(DAY.designed)
    points, jacobian = arm.observe(inputs, values)
    off, columns = (arm.points(inputs, elastic) - points).ravel(), jacobian.reshape(points.size, -1)[:, kept]
    columns = columns / np.linalg.norm(columns, axis=0)
    left = off - columns @ np.linalg.lstsq(columns, off, rcond=1e-9)[0]
    return 1e6 * float(np.sqrt((left.reshape(-1, 3) ** 2).sum(axis=1).mean()))


def of_curve(ei: float, said: Sequence[str]) -> dict[str, Any]:
    """One point of the curve."""
    return {"ei_nm2": ei, "left_um": left_um(ei), "arms": len(said), **{name: said.count(name) for name in SAID}}


NAMES = ("link2.ei_z", "link4.ei_y", "link4.ei_z")


def interval_holds(seed: int) -> tuple[bool, ...]:
    """Whether the 95 % intervals of an arm hold 1/EI, of each of ``NAMES``."""
    with threadpool_limits(1):
        found = DAY.identified(arm(CASES["links"][0], seed)[1], ("bending",))
        free = [found.model.names[i] for i in found.fit.free]
        half = found.half_width_95 * np.ones(len(free))
        held = []
        for name in NAMES:
            at = free.index(name)
            off = found.values[found.model.names.index(name)] - 1 / EI
            held.append(bool(abs(off) <= half[at] * found.std[at]))
        return tuple(held)


def of_case(case: str, found: Sequence[Found]) -> dict[str, Any]:
    """The counts of one kind of arm."""
    taken = Counter(each.chosen for each in found)
    return {
        "arms": len(found),
        "right": taken[CASES[case][1]],
        "taken": {"+".join(groups) or "none": count for groups, count in taken.most_common()},
        "fresh_over_bound": {
            "median": float(np.median([each.fresh for each in found])),
            "mean": float(np.mean([each.fresh for each in found])),
        },
    }


def picture(curve: Sequence[dict[str, Any]]) -> "Figure":
    """What is said, over what geometry and joint springs leave."""
    with drawing((7.0, 3.4)) as figure:
        axes = figure.add_subplot(xlabel="EI, N m² (µm left by geometry and joint springs)", ylabel="arms, %")
        under = np.zeros(len(curve))
        for i, name in enumerate(SAID):
            shares = np.array([100 * each[name] / each["arms"] for each in curve])
            if shares.any():
                axes.bar(range(len(curve)), shares, 0.7, bottom=under, color=SERIES[2 * i][0], label=name)
            under += shares
        axes.set_xticks(range(len(curve)), [f"{each['ei_nm2']:,.0f}\n({each['left_um']:.1f})" for each in curve])
        axes.set_ylim(0, 115)
        axes.legend(loc="upper right", ncols=4, fontsize=8)
    return figure


def words(result: dict[str, Any]) -> tuple[Paragraph, ...]:
    """The figures in a few lines."""
    lines = []
    for case, each in result["cases"].items():
        taken = ", ".join(f"{groups} {count}" for groups, count in each["taken"].items())
        over = each["fresh_over_bound"]["mean"]
        lines.append(f"{case}: {each['right']} of {each['arms']} arms right ({taken})")
        lines.append(f"  error on validation poses {over:.2f} times sigma sqrt(p/n)")
    for each in result["curve"]:
        counts = ", ".join(f"{name} {each[name]}" for name in SAID if each[name])
        left = f"{each['left_um']:.1f} µm left by geometry and joint springs"
        lines.append(f"EI {each['ei_nm2']:.0f} N m², {left}, {each['arms']} arms: {counts}")
    held = ", ".join(f"{name} {share:.1%}" for name, share in result["intervals"].items())
    lines.append(f"95 % intervals of 1/EI hold over {result['interval_arms']} arms: {held}")
    return paragraphs(lines)


if __name__ == "__main__":
    run_script("elastic_links_found")
