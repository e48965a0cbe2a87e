"""A command that is killed leaves nothing half-written under its name, and what is done again is whole.

The commands run in forks of the tests' process, so that a kill meets their work and not only Python's start. The long
run (``-m slow``) kills as often as ``LAB_KILLS`` says.
"""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from helpers.bad_input import run

from lab.campaign.robot import load_virtual
from lab.commands.integrity import said_of_edits
from lab.core.load_samples import Mounting
from lab.core.whole_folder import CHECKSUMS
from lab.formats.load_csv import write_loads, write_mounting
from lab.simulation.collisions import random_poses
from lab.simulation.payload import RigidLoad
from lab.simulation.payload_bench import LoadBench, RunErrors

pytestmark = [
    pytest.mark.usefixtures("folder"),
    pytest.mark.skipif(not hasattr(os, "fork"), reason="forks of POSIX"),
    pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning"),
]

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
    "trajectory": "trajectory goals.csv --robot irb120",
    "compare": "compare day day2",
    "compensate checked": "compensate few.csv --run day",
    "design": "design --robot irb120 --poses 10 --candidates 100 --starts 1",
    "payload": "payload runs.csv --robot tx40 --sensor sensor.toml",
    "import": "import points.txt --joints joints.csv --robot irb120 --unit mm --by name",
    "certify": "certify day",
    "dynamics": "dynamics --robot scara",
    "kinematics": "kinematics irb120 --joints 10,20,30,40,50,60",
}


@pytest.fixture
def made(folder: Path) -> Path:
    """Runs and files that the commands are given."""
    assert run("calibrate --robot irb120 --poses 30 --seed 7 --out day") == 0
    assert run("calibrate --robot irb120 --poses 30 --seed 8 --out day2") == 0
    lines = (folder / "day" / "measurements.csv").read_text().splitlines()
    (folder / "goals.csv").write_text("\n".join(line.rsplit(",", 3)[0] for line in lines[:4]) + "\n")
    (folder / "few.csv").write_text("\n".join(lines[:4]) + "\n")
    cells = [line.split(",") for line in lines[1:9]]
    points = (f"P{i} {' '.join(row[6:9])}\n" for i, row in enumerate(cells))
    (folder / "points.txt").write_text("".join(points))
    joints = (f"P{i},{','.join(row[:6])}\n" for i, row in enumerate(cells))
    header = ",".join(f"J{j + 1} (rad)" for j in range(6))
    (folder / "joints.csv").write_text(f"Pose,{header}\n" + "".join(joints))
    weighed(folder)
    (folder / "study.toml").write_text(STUDY)
    return folder


def weighed(folder: Path) -> None:
    """A file of a loaded and an unloaded run at rest, and how the sensor stands."""
    robot, rng = load_virtual("tx40"), np.random.default_rng(2)
    load = RigidLoad(1.5, np.array([0.010, -0.005, 0.060]), 1e-3 * np.eye(3))
    mounting = Mounting.tilted(np.zeros(2), sign=-1.0)
    bench = LoadBench(robot.model, load, mounting, RunErrors(force_noise_n=0.05, moment_noise_nm=0.002))
    samples = bench.resting(random_poses(robot.model, 12, rng), rng)
    write_loads(folder / "runs.csv", samples, robot.chain.joint_names, robot.chain.prismatic)
    write_mounting(folder / "sensor.toml", mounting)


def forked(work: Callable[[], int]) -> int:
    """The process that does it, silent."""
    if child := os.fork():
        return child
    code = 70
    try:
        null = os.open(os.devnull, os.O_RDWR)
        os.dup2(null, 1)
        os.dup2(null, 2)
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
    assert sorted(names) == sorted(path.name for path in place.iterdir() if path.name != CHECKSUMS)
    assert said_of_edits(place, names, accept=False) == ()
    return True


def moments(count: int, seconds: float, rng: np.random.Generator) -> Iterator[float]:
    """At random over a command's time and a little more."""
    return (float(each) for each in rng.uniform(0, 1.1 * seconds, count))


def killed(name: str, count: int, folder: Path) -> None:
    """Kill a command so often; an earlier run is in its place or not, alternately."""
    argv = f"{COMMANDS[name]} --out run --overwrite"
    started = time.perf_counter()
    assert (code := ended(forked(lambda: run(argv)))) in (0, 1), name
    seconds, before = time.perf_counter() - started, sorted(path.name for path in folder.iterdir())
    assert "run" in before and whole(folder / "run")
    for i, moment in enumerate(moments(count, seconds, np.random.default_rng(len(name)))):
        place = folder / "run"
        had = i % 2 == 0 and place.exists()
        if not had and place.exists():
            for path in place.iterdir():
                path.unlink()
            place.rmdir()
        ended(forked(lambda: run(argv)), moment)
        whole(place)
        assert all(path.name in before or path.name.startswith(".run.") for path in folder.iterdir())
        assert ended(forked(lambda: run(argv))) == code and whole(place)
        assert sorted(path.name for path in folder.iterdir()) == before


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["identify", "payload"])
def test_a_killed_command_leaves_nothing_half_written(name: str, made: Path) -> None:
    killed(name, 2, made)


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_commands_killed_at_any_moment_leave_nothing_half_written(name: str, made: Path) -> None:
    killed(name, -(-int(os.environ.get("LAB_KILLS", "30")) // (len(COMMANDS) + 1)), made)


def study_bytes(place: Path) -> dict[str, bytes]:
    """What a study ends with, less what says when and where it ran."""
    return {path.name: path.read_bytes() for path in (place / "campaigns").rglob("*") if path.is_file()}


@pytest.mark.slow
def test_a_killed_study_goes_on_to_the_same_bytes(made: Path) -> None:
    argv = "study study.toml --workers 1"
    started = time.perf_counter()
    assert run(f"{argv} --out straight") == 0
    seconds, wanted = time.perf_counter() - started, study_bytes(made / "straight")
    assert wanted
    count = -(-int(os.environ.get("LAB_KILLS", "30")) // (len(COMMANDS) + 1))
    for i, moment in enumerate(moments(count, seconds, np.random.default_rng(0))):
        place = made / f"killed{i}"
        ended(forked(lambda place=place: run(f"{argv} --out {place.name}")), moment)
        again = f"{argv} --out {place.name}" + (" --resume" if (place / "config.json").exists() else " --overwrite")
        assert run(again) == 0
        assert study_bytes(place) == wanted
