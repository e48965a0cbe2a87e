"""Every command that writes a folder with small inputs, run in forks of the tests' process."""

import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from helpers.bad_input import run
from helpers.daily_checks import daily
from lab.core.whole_folder import CHECKSUMS
from lab.extensions.dynamics.arm_simulation import LoadBench, RigidLoad, RunErrors
from lab.extensions.dynamics.load_files import Mounting, write_loads, write_mounting
from lab.formats.measurement_csv import write_measurements
from lab.library.run_folder import check_edits
from lab.robots.load_robot import load_virtual
from lab.simulation.collisions import random_poses

__all__ = ["COMMANDS", "ended", "forked", "inputs_of_commands", "weighted", "whole"]

STUDY = """\
name = "small"
robots = 2
draws = 2
fresh = 20
[factors]
poses = [20, 25]
"""
COMMANDS = {
    "calibrate": "calibrate --robot irb120 --poses 30 --seed 1",
    "identify": "identify day/measurements.csv --instrument uniform-8um",
    "verify": "verify day day/measurements.csv --force",
    "compensate": "compensate few.csv --run day --no-check",
    "predict": "predict day few.csv",
    "trajectory": "trajectory goals.csv --robot irb120",
    "history": "history history/day history/day2",
    "verify touches": "verify day daily.csv",
    "compensate checked": "compensate few.csv --run day",
    "design": "design --robot irb120 --poses 10 --candidates 100 --starts 1",
    "next": "next day few.csv --instrument uniform-8um --candidates 100",
    "payload": "payload runs.csv --robot tx40 --sensor sensor.toml",
    "import": "import points.txt --joints joints.csv --robot irb120 --unit mm --by name",
    "certify": "certify day",
    "dynamics": "dynamics --robot scara",
    "kinematics": "kinematics irb120 --joints 10,20,30,40,50,60",
    "history of arms": "history history --on 2026-03-01",
    "inspect": "inspect irb120",
    "reproduce": "reproduce elastic",
    "kinematics of a rotation": "kinematics --angles 10,20,30",
    "workspace": "workspace carrier/cartesian --places 200",
}


def inputs_of_commands(folder: Path) -> Path:
    """Write the runs and files that the commands are given into the working folder."""
    assert run("calibrate --robot irb120 --poses 30 --seed 7 --out day") == 0
    assert run("calibrate --robot irb120 --poses 30 --seed 8 --out day2") == 0
    for i, day in enumerate(("day", "day2")):
        dated = f"--instrument uniform-8um --date 2026-0{i + 1}-12 --out history/{day}"
        assert run(f"identify {day}/measurements.csv {dated}") == 0
    lines = (folder / "day" / "measurements.csv").read_text().splitlines()
    (folder / "goals.csv").write_text("\n".join(line.rsplit(",", 3)[0] for line in lines[:4]) + "\n")
    (folder / "few.csv").write_text("\n".join(lines[:4]) + "\n")
    cells = [line.split(",") for line in lines[1:9]]
    points = (f"P{i} {' '.join(row[6:9])}\n" for i, row in enumerate(cells))
    (folder / "points.txt").write_text("".join(points))
    joints = (f"P{i},{','.join(row[:6])}\n" for i, row in enumerate(cells))
    header = ",".join(f"J{j + 1} (rad)" for j in range(6))
    (folder / "joints.csv").write_text(f"Pose,{header}\n" + "".join(joints))
    weighted(folder)
    write_measurements(folder / "daily.csv", daily(12), (False,) * 6)
    (folder / "study.toml").write_text(STUDY)
    return folder


def weighted(folder: Path) -> None:
    """A file of a loaded and an unloaded run at rest, and how the sensor stands."""
    robot, rng = load_virtual("tx40"), np.random.default_rng(2)
    load = RigidLoad(1.5, np.array([0.010, -0.005, 0.060]), 1e-3 * np.eye(3))
    mounting = Mounting.tilted(np.zeros(2), sign=-1.0)
    bench = LoadBench(robot.model, load, mounting, RunErrors(force_noise_n=0.05, moment_noise_nm=0.002))
    samples = bench.resting(random_poses(robot.model, 12, rng), rng)
    write_loads(folder / "runs.csv", samples, robot.chain.joint_names, robot.chain.prismatic)
    write_mounting(folder / "sensor.toml", mounting)


def forked(work: Callable[[], int], said: Path | None = None) -> int:
    """The process that does it, silent, or whose words go to a file.

    An interruption before it is in its own code waits until then: it would end as the tests' process does.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    if child := os.fork():
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        return child
    code = 70
    try:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        null = os.open(os.devnull, os.O_RDWR)
        os.dup2(null, 1)
        os.dup2(null if said is None else os.open(said, os.O_RDWR | os.O_CREAT | os.O_TRUNC), 2)
        sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)  # noqa: SIM115
        code = work()
    finally:
        os._exit(code)


def ended(child: int, within_s: float | None = None) -> int | None:
    """The exit code of a process; None of one that was killed after so long."""
    if within_s is not None:
        time.sleep(within_s)
        os.kill(child, signal.SIGKILL)
    status = os.waitpid(child, 0)[1]
    return None if os.WIFSIGNALED(status) else os.WEXITSTATUS(status)


def whole(place: Path) -> bool:
    """Whether a run's folder is there; it is then as its checksums say."""
    if not place.exists():
        return False
    names = [line.split("  ", 1)[1] for line in (place / CHECKSUMS).read_text().splitlines()]
    assert sorted(names) == sorted(
        path.relative_to(place).as_posix() for path in place.rglob("*") if path.is_file() and path != place / CHECKSUMS
    )
    assert check_edits(place, names, accept=False) == ()
    return True
