"""An engineer's day with a UR5e: the cell, the plan, the measurements as files, the calibration, a corrected program.

The arm of the day is a virtual one, whose geometry is off and whose joints give way. Everything else goes the way that
it goes in a real cell: through the files that a tracker and a controller write, and the lab's own commands. The noise
floor is what the same measurements leave of the error with the effects that the arm has: noise and nothing else.
"""

import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).with_name("experiments")))
from day_files import controller_log, leica, ur5e_urdf
from shared import Answer, Document, named_values, paragraphs, run_script

import lab
from lab.core import limits
from lab.core.limits import whole
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.robots.load_robot import load_virtual
from lab.simulation.collisions import collides, random_poses
from lab.simulation.free_path import path_check
from lab.simulation.tracking import track

CELL = """\
clearance_mm = 20

[[obstacle]]
name = "table"
shape = "box"
size_mm = [1200, 1200, 40]
position_mm = [300, 0, -45]

[[obstacle]]
name = "fixture"
shape = "box"
size_mm = [150, 300, 200]
position_mm = [550, 350, 75]

[[tool]]
name = "p1"
position_mm = [40, 0, 60]
axis = [0, 0, 1]

[[plate]]
name = "reflector plate"
shape = "box"
size_mm = [100, 60, 10]
position_mm = [20, 0, 10]

[instrument]
position_mm = [2200, -1200, 900]

[reflector]
kind = "corner cube"

[joints.shoulder_lift_joint]
lower_deg = -200
upper_deg = 20
"""
INSTRUMENT, SIGMA_M = "uniform-8um", 8e-6 / np.sqrt(3)
STIFFNESS_NM_PER_RAD = 2e4
LOOKS = 1000  # along each way
ROOM_RAD = np.deg2rad(2)  # that a taught way has for each joint: a correction moves the arm by up to about so much
FROM_SINGULAR_RAD = np.deg2rad(5)  # of a taught target: a stretched arm that is a little shorter does not reach it


@dataclass(frozen=True)
class Options:
    """A day for each seed."""

    days: int = 1
    """How many arms are calibrated, each on a day of its own."""
    poses: int = 30
    """Of the plan."""
    candidates: int = 500
    """From which the plan is chosen."""
    targets: int = 20
    """Of the program that is corrected."""
    seed: int = 0
    """Of the first day."""
    json: bool = False
    """Print the result as one JSON object."""


@dataclass(frozen=True)
class Cell:
    """The robot in its cell, and the plan's folder."""

    robot: lab.Robot
    folder: Path


def answer(options: Options) -> Answer:
    """Plan once, and work through the days.

    Raises:
        LabError: an option is out of range.
    """
    whole("--days", options.days, 1, limits.ROBOTS)
    whole("--poses", options.poses, 1, limits.POSES)
    whole("--targets", options.targets, 1, limits.POSES)
    with TemporaryDirectory() as folder:
        cell = planned_cell(Path(folder), options.poses, options.candidates)
        days = [worked_day(cell, seed, options.targets) for seed in range(options.seed, options.seed + options.days)]
    found: dict[str, Any] = {"days": options.days, "poses": options.poses, "targets": options.targets}
    found["error_over_floor"] = float(np.median([day["error_over_floor"] for day in days]))
    found["before_mm"] = float(np.median([day["before_mm"] for day in days]))
    found["after_mm"] = float(np.median([day["after_mm"] for day in days]))
    found["worst_hit_mm"] = max(day["worst_hit_mm"] for day in days)
    found["uncorrected_mm"] = float(np.median([day["uncorrected_mm"] for day in days]))
    found["touched"] = sum(day["touched"] for day in days)
    found["ways_not_free"] = sum(day["ways_not_free"] for day in days)
    found["not_corrected"] = sum(day["not_corrected"] for day in days)
    found["verified"] = sum(day["verified"] for day in days)
    return Answer(found, Document("An engineer's day with a UR5e", paragraphs(named_values(found))))


def planned_cell(folder: Path, poses: int, candidates: int) -> Cell:
    """The UR5e's description, the cell's file and a plan with its URScript, in a folder."""
    urdf = ur5e_urdf(folder / "ur5e.urdf")
    (folder / "cell.toml").write_text(CELL, encoding="utf-8")
    robot = load_virtual(str(urdf), folder / "cell.toml")
    plan = lab.design(str(urdf), cell=folder / "cell.toml", poses=poses, candidates=candidates, starts=1)
    plan.save(folder / "plan")
    return Cell(robot, folder)


def worked_day(cell: Cell, seed: int, targets: int) -> dict[str, Any]:
    """Measure, import, identify, correct a program, run it, verify.

    Args:
        seed: of the arm, the tracker and the noise.
        targets: of the program.
    """
    folder = cell.folder
    day = lab.simulate(
        str(folder / "ur5e.urdf"), cell=folder / "cell.toml", plan=folder / "plan" / "plan.csv", seed=seed,
        instrument=INSTRUMENT, effects=lab.Effects(STIFFNESS_NM_PER_RAD),
    )  # fmt: skip
    file = _imported(cell, day)
    result, known = (
        lab.identify(
            file, robot=str(folder / "ur5e.urdf"), cell=folder / "cell.toml", instrument=INSTRUMENT, model=model,
            validate=validation,
        )
        for validation in (day.validation,)
        for model in ("auto", "compliance")
    )  # fmt: skip
    run = result.save(folder / f"run{seed}")
    corrected, places = _corrected(cell, run, targets, seed)
    wanted = corrected.wanted.positions[corrected.found.converged]
    hits, before = (_off(day, joints, wanted) for joints in places)
    errors, floor = result.validation.errors, known.validation.errors
    untold, told = _touched(cell.robot, corrected)
    assert errors is not None and floor is not None
    return {
        "error_over_floor": float(np.sqrt(np.mean(errors.after**2) / np.mean(floor.after**2))),
        "before_mm": 1e3 * float(errors.before.mean()),
        "after_mm": 1e3 * float(errors.after.mean()),
        "worst_hit_mm": 1e3 * float(hits.max()),
        "uncorrected_mm": 1e3 * float(before.mean()),
        "not_corrected": int((~corrected.found.converged).sum()),
        "touched": untold,
        "ways_not_free": told,
        "verified": int(_is_verified(day, run, cell, seed)),
        "groups": list(result.state.groups),
    }


def _imported(cell: Cell, day: lab.MeasurementSession) -> Path:
    """The day's measurements as a tracker and a controller write them, merged by ``lab import``."""
    data, folder = day.measurements, cell.folder
    middles = controller_log(folder / "log.txt", data.joints)
    names = [f"P{i + 1}" for i in range(len(data))]
    sigma = np.full((len(data), 3), SIGMA_M)
    points = leica(folder / "tracker.csv", names, data.points[:, 0], sigma, middles.tolist())
    behind = -float(middles[0])  # the first point was measured so long after the log's first row
    merged = lab.import_measurements(
        points, joints=str(folder / "log.txt"), robot=str(folder / "ur5e.urdf"), by="time", clock_offset_s=behind
    )
    return merged.save(folder / f"imported{day.options.seed}") / "measurements.csv"


def _corrected(cell: Cell, run: Path, count: int, seed: int) -> tuple[lab.CompensationResult, tuple[Array, Array]]:
    """A program of targets in free places, corrected in its text; the joint positions corrected and as they were."""
    joints = _taught(cell.robot, count, seed)
    lines = ["def pick():", "  set_tcp(p[0.04,0,0.06,0,0,0])  # p1"]
    lines += [f"  movej([{','.join(f'{each:.6f}' for each in q)}], a=1.2, v=0.8)" for q in joints[1:]]
    program = cell.folder / "pick.script"
    program.write_text("\n".join([*lines, "end", ""]), encoding="utf-8")
    found = lab.compensate(program=str(program), run=run, force=True, cell=cell.folder / "cell.toml")
    done = found.found.converged
    return found, (found.found.joints[done], np.array(joints[1:])[done])


def _taught(robot: lab.Robot, count: int, seed: int) -> list[Array]:
    """Home, and joint positions ``(6,)`` rad one after the other, as a person teaches them.

    Each is well off singularities, and the way to it is free also where a joint is off by a little.
    """
    model, free, arm = robot.model, path_check(robot.model), robot.arm(("p1",))
    drawn = random_poses(model, 60 * count, rng_for(seed, "targets"))
    away = arm.singular_distance(drawn, arm.nominal({"p1": np.zeros(3)}))[0]
    shifts = ROOM_RAD * np.concatenate([np.zeros((1, 6)), np.eye(6), -np.eye(6)])
    joints = [model.chain.home]
    for pose in drawn[away > FROM_SINGULAR_RAD]:
        if len(joints) <= count and all(free(joints[-1] + each, pose + each) for each in shifts):
            joints.append(pose)
    return joints


def _off(day: lab.MeasurementSession, joints: Array, wanted: Array) -> Array:
    """How far the true arm's target is from where it is wanted ``(n,)`` m, without noise."""
    load = {"payload_kg": np.zeros(len(joints))}
    seen = track(day.true_robot, joints, ("p1",), lab.instrument("exact"), rng_for(0, "visits"), 1, load)
    return np.asarray(np.linalg.norm(seen.points[:, 0] - wanted, axis=1))


def _touched(robot: lab.Robot, corrected: lab.CompensationResult) -> tuple[int, int]:
    """On how many ways between corrected targets the arm touches something or is too near and it was not said.

    Returns:
        That number; and on how many ways it was said.
    """
    program, found = corrected.program, corrected.found
    assert program is not None
    joints = np.full((len(program.targets), robot.chain.size), np.nan)
    joints[program.rows[found.converged]] = found.joints[found.converged]
    share, said = np.linspace(0.0, 1.0, LOOKS)[:, None], {line for line, _ in program.touching_paths}
    untold = [
        target.name
        for target, (start, end) in zip(program.targets[1:], pairwise(joints), strict=True)
        if np.isfinite([start, end]).all()
        and target.line not in said
        and collides(robot.model, start + share * (end - start)).any()
    ]
    return len(untold), len(said)


def _is_verified(day: lab.MeasurementSession, run: Path, cell: Cell, seed: int) -> bool:
    """Whether ten new measurements of the same arm agree with the calibration."""
    joints = random_poses(cell.robot.model, 10, rng_for(seed, "fresh"))
    load = {"payload_kg": np.zeros(len(joints))}
    new = track(day.true_robot, joints, ("p1",), lab.instrument(INSTRUMENT), rng_for(seed, "visits"), 1, load)
    return lab.verify(run, new, force=True).exit_code == 0


if __name__ == "__main__":
    run_script("engineers_day")
