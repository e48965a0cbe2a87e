"""What is said of data whose mistake is known? A row for each of those that earlier versions called something else.

Files of real arms where there are any, else campaigns that are simulated like them. Run it with another checkout of the
lab first on PYTHONPATH to see what that says.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import diagnosis_real
import mistakes
import numpy as np
from diagnosis_study import INSTRUMENTS, identified
from shared import Answer, Document, Flag, Section, Table, run_script

import lab
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.se3 import Array

__all__ = ["CASES"]


@dataclass(frozen=True)
class Options:
    """Which rows."""

    shared: Path = Path("shared/data")
    """Folder of measurements that do not come with the lab."""
    cases: tuple[str, ...] = ()
    """Beginnings of the rows' names; all of them if none is given."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Case:
    """Measurements with a known mistake, the robot that is given, and options of ``lab.identify``."""

    data: Measurements
    robot: Any
    options: dict[str, Any]


Make = Callable[[Path], Case]
_EFFECTS: dict[str, Any] = {"stiffness_nm_per_rad": 2e5, "harmonic_mrad": 0.05, "repeatability_mrad": 0.02}


def _made(kind: str, size: float, observe: str = "points", robot: str = "irb120", **fit: Any) -> Make:
    """A simulated campaign of three targets, or of another sensor, with a mistake of the study."""

    def make(_: Path) -> Case:
        session = _session(robot, observe, 25 if observe == "pixels" else 60)
        wrong = mistakes.KINDS[kind].make(session, size, np.random.default_rng(1))
        known = {"instrument": INSTRUMENTS[observe]} if observe in ("points", "pose") else {}
        return Case(wrong.data, wrong.robot or robot, {"observe": observe, **known, **wrong.options, **fit})

    return make


def _session(robot: str, observe: str, poses: int) -> mistakes.Session:
    device: dict[str, Any] = {"instrument": INSTRUMENTS[observe]} if observe in INSTRUMENTS else {}
    targets = ("p1", "p2", "p3") if observe == "points" else ("p1",)
    what: dict[str, Any] = {"observe": observe, "poses": poses, "targets": targets, "effects": lab.Effects(**_EFFECTS)}
    return mistakes.session_of(lab.simulate(robot, seed=4, **what, **device), 5e-5)


def _far_outliers(_: Path) -> Case:
    """Three poses of forty off by 4 to 8 mm, one target, no instrument named."""
    session, rng = _session("fr3", "points", 40), np.random.default_rng(3)
    data = replace(session.data, targets=("p1",), points=session.data.points[:, :1].copy())
    for row, size in zip(rng.choice(40, 3, replace=False), (4e-3, 6e-3, 8e-3), strict=True):
        data.points[row] += size * rng.normal(size=3) / np.sqrt(3)
    return Case(data, "fr3", {})


def _real(name: str) -> Make:
    def make(shared: Path) -> Case:
        robot, data, options = diagnosis_real.read(diagnosis_real.SETS[name], shared)
        return Case(data, robot, options)

    return make


def _two_pictures(shared: Path) -> Case:
    """Joints of two pictures of the four cameras exchanged, as the source published them."""
    case = _real("UR3e, four cameras")(shared)
    picture, joints = np.array(case.data.other["picture"]), case.data.joints.copy()
    first, second = (picture == str(number) for number in (12, 27))
    before: Array = case.data.joints
    joints[first], joints[second] = before[second][0], before[first][0]
    return replace(case, data=replace(case.data, joints=joints))


def _still_joints(_: Path) -> Case:
    """Two joints of seven move, and the target is remounted half way."""
    session = _session("iiwa7", "points", 60)
    real = lab.simulate("iiwa7", poses=60, seed=4, targets=("p1",), instrument="leica-at960").true_robot
    joints = session.data.joints.copy()
    joints[:, 2:] = joints[0, 2:]
    noise = 1e-5 * np.random.default_rng(0).normal(size=(60, 1, 3))
    data = replace(session.data, joints=joints, targets=("p1",), points=real.points(joints, ("p1",)) + noise)
    rng = np.random.default_rng(1)
    sound = mistakes.Session(data, session.arm, session.values, 5e-5)
    return Case(mistakes.KINDS["target_step"].make(sound, 100, rng).data, "iiwa7", {})


CASES: dict[str, Make] = {
    "range constant 0.5 mm": _made("range_constant", 10),
    "range constant 0.5 mm, auto": _made("range_constant", 10, model="auto"),
    "nests swapped from a pose on": _made("targets_exchanged", 0.25),
    "one pose with two targets exchanged": _made("targets_exchanged_once", 1),
    "rows shifted by one": _made("rows_shifted", 1),
    "two joints exchanged": _made("joints_exchanged", 1),
    "two joints coupled": _made("joints_coupled", 1),
    "three outliers of 4 to 8 mm": _far_outliers,
    "positioner, target 1 m off": _real("positioner"),
    "orientations in other axes": _made("orientation_convention", 2, "pose", "ur5"),
    "two pictures exchanged, four cameras": _two_pictures,
    "board turned in 6 of 25 pictures": _made("board_turned", 0.25, "pixels"),
    "pictures shifted by one": _made("pictures_shifted", 1, "pixels"),
    "camera in the hand taken for fixed": _made("camera_mount", 1, "pixels"),
    "focal length 10 % off": _made("focal_length", 0.1, "pixels"),
    "squares 5 % off": _made("square_size", 0.05, "pixels"),
    "joints 3 to 7 never moved, target remounted": _still_joints,
    "target remounted, iiwa": _real("iiwa 7"),
    "ur5 given for ur5e": _made("other_robot", 0, robot="ur5e"),
    "plane of a surgical arm": _real("surgical arm, plane"),
    "one joint negated": _made("joint_sign", 1),
}


def _lines(options: Options) -> Iterator[tuple[str, dict[str, Any]]]:
    for name, make in CASES.items():
        if options.cases and not name.startswith(options.cases):
            continue
        began = time.process_time()
        try:
            case = make(options.shared)
            given = dict(case.options)
            with NamedTemporaryFile("w", suffix=".toml") as file:
                if isinstance(given.get("cameras"), str):
                    print(given["cameras"], file=file, flush=True)
                    given["cameras"] = Path(file.name)
                robot = lab.load_robot(case.robot) if isinstance(case.robot, str) else case.robot
                yield name, identified(case.data, robot, given)
        except LabError as error:
            yield name, {"refused": str(error), "seconds": time.process_time() - began, "found": []}


def answer(options: Options) -> Answer:
    """What is said of each."""
    values, rows = {}, []
    for name, line in _lines(options):
        values[name] = line
        found = "; ".join(" ".join((each["name"], *each["of"][:3])) for each in line["found"]) or "nothing"
        reasons = line.get("refused") or line.get("crashed") or ". ".join(line["reasons"][:2])
        rows.append((name, str(line.get("verdict", "refused")), found, reasons, f"{line['seconds']:.1f}"))
    table = Table(("data", "verdict", "findings", "reasons", "s"), tuple(rows))
    return Answer(values, Document("What is said of data whose mistake is known", (Section("Rows", (table,)),)))


if __name__ == "__main__":
    run_script("diagnosis_table")
