"""Every command and snippet of the README is executed, and its figures are those of the code."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.no_rendering import nothing_drawn  # noqa: F401
from helpers.robots import ROOT

from lab.campaign.robot import load_virtual
from lab.cli import main
from lab.core.load_samples import Mounting
from lab.formats.dh_table_toml import read_table
from lab.formats.load_csv import read_mounting, write_loads
from lab.formats.mechanism_toml import read_mechanism
from lab.simulation.collisions import random_poses
from lab.simulation.payload import RigidLoad
from lab.simulation.payload_bench import LoadBench, RunErrors

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


def test_the_first_two_commands_are_what_ci_runs() -> None:
    """They install, so .ci/run executes them: it takes them from here, the first block of the README."""
    first, second = blocks("sh")[0].strip().splitlines()
    assert first == "python3 -m venv .venv && .venv/bin/pip install -e '.[dev]' && .venv/bin/lab calibrate"
    assert second == ".venv/bin/pytest"


def write_load(path: Path, mounting: Mounting) -> None:
    """What a wrist sensor reads at twenty poses with a load and without it."""
    robot, noise = load_virtual("tx40"), RunErrors(force_noise_n=0.05, moment_noise_nm=0.002)
    load = RigidLoad(1.5, np.array([0.010, -0.005, 0.060]), np.diag([22.5e-4, 26e-4, 12.5e-4]))
    poses = random_poses(robot.model, 20, np.random.default_rng(0))
    records = LoadBench(robot.model, load, mounting, noise).resting(poses, np.random.default_rng(1))
    write_loads(path, records, robot.chain.joint_names, robot.chain.prismatic)


def test_every_further_command_runs(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    commands = [line for block in blocks("sh")[1:] for line in block.strip().splitlines()]
    assert len(commands) >= 4
    (tmp_path / "targets.csv").write_text(blocks("csv")[0])
    (tmp_path / "grid.toml").write_text(blocks("study")[0])
    (sensor,) = (block for block in blocks("text") if block.startswith("[base]"))
    (tmp_path / "sensor.toml").write_text(sensor)
    write_load(tmp_path / "load.csv", read_mounting(tmp_path / "sensor.toml"))
    for command in commands:
        program, *arguments = shlex.split(command)
        assert program == ".venv/bin/lab"
        assert main(arguments) == 0, command
        assert capsys.readouterr().out


@pytest.mark.parametrize(("at", "name"), [(0, "first_calibration.py"), (1, "own_effect.py")])
def test_the_snippets_are_scripts_and_print_what_is_shown(at: int, name: str, tmp_path) -> None:
    assert len(blocks("python")) == 2
    snippet = blocks("python")[at]
    assert snippet == (ROOT / "scripts" / name).read_text()
    script = tmp_path / "snippet.py"
    script.write_text(snippet)
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stdout == blocks("text")[at]


def test_the_table_is_a_robot(tmp_path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(blocks("toml")[0])
    robot = read_table(path)
    assert robot.chain.prismatic == (False, True) and not robot.warnings


def test_the_mechanism_is_a_robot(tmp_path) -> None:
    path = tmp_path / "mechanism.toml"
    path.write_text(blocks("toml")[1])
    assert main(["inspect", str(path), "--json"]) == 0
    assert read_mechanism(path).mechanism.names[6:] == ("A1.x", "A1.y", "A2.x", "A2.y", "leg1.length", "leg2.length")


@pytest.mark.parametrize("link", re.findall(r"\]\(([^)#]+)\)", TEXT))
def test_every_link_leads_somewhere(link: str) -> None:
    assert link.startswith("http") or (ROOT / link).exists()
