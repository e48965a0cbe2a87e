"""How much of the elastic error does a purely geometric calibration absorb? (Benmisra 2007, eq. 3.39 and 3.40.)

An IRB 120 whose upper arm and forearm bend and twist as tubes of aluminium (80 x 4 mm), or whose joints 2 and 3 give
way, its geometry nominal otherwise, is measured without noise in random poses of a workspace. Its base and tool are
fitted, and then all of its geometry; what is left at other poses of the workspace says how much of the elastic error
the geometry took in. Payloads: none, 3 kg always, 0 or 3 kg, and none while measured but 3 kg at work. All is linear in
the compliances, so that the share does not depend on them; the errors do.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from shared import SERIES, Answer, Document, Flag, drawing, paragraphs, run_script, save_figure

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.gauge import base_set
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NEEDS = ("matplotlib",)

EI, GJ, STIFFNESS = 48_400.0, 36_000.0, 1e5
CAUSES: Mapping[str, Mapping[str, float]] = {
    "links bend and twist": {
        **{f"link{link}.{symbol}": 1 / EI for link in (2, 4) for symbol in ("ei_y", "ei_z")},
        **{f"link{link}.gj": 1 / GJ for link in (2, 4)},
    },
    "joints 2 and 3 give way": {f"joint{joint}.compliance": 1 / STIFFNESS for joint in (2, 3)},
}
PAYLOADS: Mapping[str, tuple[tuple[float, ...], tuple[float, ...]]] = {  # kg while measured, kg at work
    "no payload": ((0.0,), (0.0,)),
    "3 kg always": ((3.0,), (3.0,)),
    "0 or 3 kg": ((0.0, 3.0), (0.0, 3.0)),
    "measured empty, 3 kg at work": ((0.0,), (3.0,)),
}
EDGES_M = (0.2, 0.4, np.inf)  # of the cube of targets that is measured and worked in
GROUPS = ("compliance", "bending", "torsion")


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    poses: int = 100
    """Poses measured, and as many to judge by."""
    pool: int = 100_000
    """Random poses within the joints' limits, from which those in a cube are taken."""
    out: Path | None = None
    """The folder for the figure; none is drawn if not given."""
    json: Flag = False
    """Print one JSON object."""


def answer(options: Options) -> Answer:
    """All cases."""
    robot = load_robot("irb120")
    pool = robot.chain.random_joints(options.pool, rng_for(0, "poses"))
    rows = [
        {
            "cause": cause,
            "edge_m": None if np.isinf(edge) else edge,
            "payload": payload,
            **absorbed(robot, inside(robot, pool, edge, options.poses), cause, payload),
        }
        for cause in CAUSES
        for edge in EDGES_M
        for payload in PAYLOADS
    ]
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        save_figure(options.out, "elastic_error_absorbed", picture(rows))
    said = Document("How much of the elastic error does geometry absorb?", paragraphs(words(rows)))
    return Answer({"rows": rows}, said)


def inside(robot: Robot, pool: Array, edge: float, poses: int) -> Array:
    """Twice as many joint positions ``(2 poses, joints)`` as are measured, their first target in a cube before the arm.

    The cube's edge is in m; where it is infinite, anywhere.
    """
    arm = robot.serial_arm(("p1",))
    places = arm.points(pool, arm.nominal(robot.tool))[:, 0]
    off = np.abs(places - np.array([0.35, 0.0, 0.45])).max(axis=1)
    return np.asarray(pool[off <= edge / 2][: 2 * poses])


def absorbed(robot: Robot, joints: Array, cause: str, payload: str) -> dict[str, float]:
    """Root mean square errors (mm) at poses that were not measured: base and tool fitted, then all geometry."""
    arm = robot.arm_with(("p1", "p2", "p3"), GROUPS)
    values, names = arm.nominal(robot.tool), list(arm.names)
    elastic = values.copy()
    for name, value in CAUSES[cause].items():
        elastic[names.index(name)] = value
    rigid = robot.arm(("p1", "p2", "p3"))
    whole = list(base_set(rigid, values[: len(rigid.names)]).identifiable)
    setup = [i for i in whole if rigid.parameters[i].group in ("base", "tool")]
    half = len(joints) // 2
    errors, columns = [], []
    for part, masses in ((joints[:half], PAYLOADS[payload][0]), (joints[half:], PAYLOADS[payload][1])):
        inputs = np.column_stack([part, np.resize(masses, len(part))])
        errors.append((arm.points(inputs, elastic) - arm.points(inputs, values)).ravel())
        columns.append(arm.observe(inputs, values)[1].reshape(-1, len(names)))
    found = {}
    for label, fitted in (("aligned_mm", setup), ("geometry_mm", whole)):
        scale = np.linalg.norm(columns[0][:, fitted], axis=0)
        taken = np.linalg.lstsq(columns[0][:, fitted] / scale, errors[0], rcond=1e-9)[0] / scale
        left = errors[1] - columns[1][:, fitted] @ taken
        found[label] = 1e3 * float(np.sqrt((left.reshape(-1, 3) ** 2).sum(axis=1).mean()))
    raw = 1e3 * float(np.sqrt((errors[1].reshape(-1, 3) ** 2).sum(axis=1).mean()))
    return {"poses": half, "elastic_mm": raw, **found, "share": 1 - found["geometry_mm"] / found["aligned_mm"]}


def picture(rows: list[dict[str, Any]]) -> "Figure":
    """What is left over what base and tool leave, by payload and workspace."""
    with drawing((9.0, 4.0)) as figure:
        for at, cause in enumerate(CAUSES):
            left = "" if at else "left of the elastic error, %"
            axes = figure.add_subplot(1, 2, at + 1, title=cause, ylabel=left)
            for k, edge in enumerate(EDGES_M):
                own = [r for r in rows if r["cause"] == cause and r["edge_m"] == (None if np.isinf(edge) else edge)]
                label = "all poses" if np.isinf(edge) else f"cube of {1e3 * edge:.0f} mm"
                places = np.arange(len(own)) + 0.27 * (k - 1)
                axes.bar(places, [100 * (1 - r["share"]) for r in own], 0.25, color=SERIES[k][0], label=label)
            axes.set_xticks(range(len(PAYLOADS)), [name.replace(", ", ",\n") for name in PAYLOADS], fontsize=8)
            axes.axhline(100, color="0.5", linewidth=0.8)
            axes.set_ylim(0, 130)
            axes.legend(loc="upper left", ncols=3, fontsize=8)
    return figure


def words(rows: list[dict[str, Any]]) -> list[str]:
    """One line a case."""
    return [
        f"{r['cause']}, {'all poses' if r['edge_m'] is None else format(1e3 * r['edge_m'], '.0f') + ' mm cube'}, "
        f"{r['payload']}: {r['elastic_mm']:.4f} mm elastic; {r['aligned_mm']:.4f} with base and tool fitted, "
        f"{r['geometry_mm']:.4f} with all geometry: {100 * r['share']:.0f} % absorbed"
        for r in rows
    ]


if __name__ == "__main__":
    run_script("elastic_error_absorbed")
