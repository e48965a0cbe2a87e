"""Does the diagnosis name a mistake that was made in the rows of a real arm, and what does it say without one?

Each file as it is, as it is with its rows in another order, and with one mistake of a known size in it: range constant,
exchanged rows or targets, shifted rows, coupling and steps. Where a file does not say where the instrument's head is,
its points are put before a head for the range constant. A finding of rows (a step, a drift) that survives a permutation
of the rows is no finding.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import mistakes
import numpy as np
from diagnosis_study import covers, identified
from shared import Answer, Document, Flag, Section, Table, run_script

import lab
from lab.core.errors import LabError
from lab.core.measurements import Measurements, thinned

__all__ = ["SETS", "Real"]

_HEAD_M = np.array([2.5, 0.0, 0.0])  # from the middle of the points, of files that do not say where the head is
_ROWS = 400  # of a file in which a mistake is made: evenly spaced ones of a longer file
_TIMED = ("base_step", "target_step", "tool_step", "joint_step", "drift", "growth")


@dataclass(frozen=True)
class Options:
    """Which files."""

    shared: Path = Path("shared/data")
    """Folder of measurements that do not come with the lab."""
    sets: tuple[str, ...] = ()
    """Names of files; all of them if none is given."""
    seeds: int = 5
    """Mistakes of each kind and size in each file."""
    implant: Flag = False
    """Make mistakes in the files; else they are read as they are, and in another order."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Real:
    """A file of a real arm.

    Attributes:
        file: below the models of the lab, or below the folder of shared data.
        robot: name, or its file there.
        options: of ``lab.identify``.
        kinds: mistakes that are made in it.
    """

    file: str
    robot: str
    options: Mapping[str, Any]
    kinds: tuple[str, ...] = ()


_POINTS = (
    "range_constant",
    "rows_exchanged",
    "rows_shifted",
    "joints_coupled",
    "joint_coupling",
    "base_step",
    "joint_step",
)
_POSES = ("rows_exchanged", "rows_shifted", "joints_coupled", "joint_coupling", "joint_step")
_XYZ = {"observe": "pose", "orientation": "intrinsic-xyz"}
SETS = {
    "UR5, 1,000": Real("ur5/measured/ur5_jacobi_1000.csv", "ur5", {}, _POINTS),
    "UR5, 20": Real("ur5/measured/ur5_jacobi_20.csv", "ur5", {}),
    "UR10 C": Real("ur10/measured/ur10_ipa_C.csv", "ur10", _XYZ, _POSES),
    "UR10 C, points": Real("ur10/measured/ur10_ipa_C.csv", "ur10", {}, _POINTS),
    "UR10 D": Real("ur10/measured/ur10_ipa_D.csv", "ur10", _XYZ),
    "IRB 120": Real("irb120_liaowu_calib36.csv", "irb120", {}, (*_POINTS, "targets_exchanged", "target_step")),
    "IRB 120, cable": Real("irb120_cable_robotcali_1042.csv", "irb120", {"observe": "cable"}),
    "Panda, sockets": Real("panda/measured/panda_sockets_mukca_3.csv", "panda", {"observe": "socket"}, _POSES),
    "Panda, board": Real("panda_charuco12.csv", "panda", {"observe": "pose"}),
    "Rokae": Real("rokae_tracker.csv", "rokae.toml", {"observe": "pose", "orientation": "fixed-xyz"}, _POSES),
    "Rokae, points": Real("rokae_tracker.csv", "rokae.toml", {}, _POINTS),
    "iiwa 7": Real("iiwa7_november.csv", "iiwa7", {"observe": "pose"}),
    "positioner": Real("positioner.csv", "positioner.toml", {"observe": "pose"}),
    "surgical arm, plane": Real("psm_plane.csv", "psm.toml", {"observe": "plane"}),
    "lift and arm": Real("hilti_flat.csv", "trailblazer.urdf", {}),
    "UR3e, four cameras": Real(
        "ur3e_4cams_corrected.csv", "ur3e", {"observe": "pixels", "cameras": "ur3e_cameras.toml"}
    ),
}


@cache
def _models() -> Path:
    return Path(__file__).parents[2] / "models"


def _path(shared: Path, name: str) -> Path:
    return _models() / name if (_models() / name).exists() else shared / name


def read(real: Real, shared: Path) -> tuple[Any, Measurements, dict[str, Any]]:
    """The robot of a file, its measurements, and the options with the paths of files."""
    robot = lab.load_robot(_path(shared, real.robot) if real.robot.endswith((".toml", ".urdf")) else real.robot)
    options = dict(real.options)
    if "cameras" in options:
        options["cameras"] = _path(shared, options["cameras"])
    data = lab.read_measurements(_path(shared, real.file), robot, observe=options.get("observe", "points"))
    return robot, data, options


def as_they_are(real: Real, shared: Path) -> list[dict[str, Any]]:
    """Findings of a file, and of its rows in another order; the error at rows that were held out."""
    robot, data, options = read(real, shared)
    lines = [{"rows": len(data), **identified(data, robot, options)}]
    order = np.random.default_rng(0).permutation(len(data))
    times = {name: column for name, column in data.conditions.items() if name == "time_s"}  # the clock goes on
    permuted = replace(data[order], visits=None, ids=data.ids, lines=data.lines)
    permuted = replace(permuted, conditions={**permuted.conditions, **times})
    return [*lines, {"rows": len(data), **identified(permuted, robot, options)}]


def session(robot: Any, data: Measurements, options: Mapping[str, Any]) -> mistakes.Session:
    """The rows of a file as a session in which mistakes are made, with the identified arm."""
    result = lab.identify(data, robot=robot, **options)
    arm = robot.serial_arm(data.targets or ("p1",))
    found = dict(zip(result.names, result.values, strict=True))
    values = [found.get(name, value) for name, value in zip(arm.names, arm.nominal(), strict=True)]
    return mistakes.Session(data, arm, np.array(values), 1e-3 * result.to_dict()["after_mm"]["mean"])


def implanted(name: str, options: Options) -> list[dict[str, Any]]:
    """What is found in a file with each of its kinds of mistakes."""
    real = SETS[name]
    robot, data, given = read(real, options.shared)
    data = thinned(data, _ROWS)
    untouched = session(robot, data, given)
    before = replace(untouched, data=replace(data, points=data.points - np.nanmean(data.points, (0, 1)) + _HEAD_M))
    lines = []
    for kind in real.kinds:
        headed = kind == "range_constant"
        for size in mistakes.KINDS[kind].sizes:
            for seed in range(options.seeds):
                rng = np.random.default_rng([seed, 3])
                wrong = mistakes.KINDS[kind].make(before if headed else untouched, size, rng)
                found = identified(wrong.data, robot, given | ({"instrument": "leica-at960"} if headed else {}))
                lines.append({"set": name, "kind": kind, "size": size, "number": wrong.number, **found})
    return lines


def _said(line: Mapping[str, Any]) -> str:
    """Findings in words, or why there are none."""
    if "refused" in line or "crashed" in line:
        return str(line.get("refused") or line["crashed"])
    return "; ".join(_worded(each) for each in line["found"]) or "nothing"


def _worded(found: Mapping[str, Any]) -> str:
    sizes = " ".join(f"{size:.3g}±{std:.2g}" for size, std in zip(found["sizes"], found["stds"], strict=True))
    return f"{found['name']} {' '.join(found['of'][:3])} {sizes}".strip()


def _untouched(options: Options) -> Answer:
    values, rows = {}, []
    for name in options.sets or SETS:
        try:
            found, permuted = as_they_are(SETS[name], options.shared)
        except LabError as error:
            found = permuted = {"rows": 0, "refused": str(error)[:120], "seconds": 0.0, "found": []}
        values[name] = [found, permuted]
        survived = [each["name"] for each in permuted["found"] if each["name"] in _TIMED]
        after = f"{found['after_mm']:.3g}" if found.get("after_mm") else ""
        cells = (f"{found['seconds']:.1f}", str(found.get("verdict", "")), after, _said(found), _said(permuted))
        rows.append((name, str(found["rows"]), *cells, ", ".join(survived)))
    head = ("file", "rows", "s", "verdict", "after, mm", "findings", "in another order", "survived")
    return Answer(
        values, Document("Findings in files of real arms", (Section("As they are", (Table(head, tuple(rows)),)),))
    )


def _made(options: Options) -> Answer:
    lines = [line for name in options.sets or SETS if SETS[name].kinds for line in implanted(name, options)]
    rows = []
    for which in dict.fromkeys((line["set"], line["kind"], line["size"]) for line in lines):
        some = [line for line in lines if (line["set"], line["kind"], line["size"]) == which]
        first = [line["found"][0] for line in some if line["found"]]
        right = [each for each in first if each["name"] == which[1]]
        inside = [
            covers(line["number"], line["found"][0]) for line in some if line["found"] and line["found"][0] in right
        ]
        other = ", ".join(sorted({each["name"] for each in first if each["name"] != which[1]}))
        counts = (f"{len(right)}/{len(some)}", f"{sum(map(bool, inside))}/{len(inside) - inside.count(None)}")
        rows.append((which[0], which[1], f"{which[2]:g}", *counts, str(len(some) - len(first)), other))
    head = ("file", "mistake", "size", "named first", "size covered", "nothing", "blamed")
    table = Table(head, tuple(rows))
    return Answer({"lines": lines}, Document("Mistakes in files of real arms", (Section("Made", (table,)),)))


def answer(options: Options) -> Answer:
    """Read files, or make mistakes in them."""
    return _made(options) if options.implant else _untouched(options)


if __name__ == "__main__":
    run_script("diagnosis_real")
