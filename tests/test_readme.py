"""Every command and snippet of the README is executed, and its figures are those of the code."""

import re
import shlex
import subprocess
import sys

import pytest
from arms import ROOT

from lab.cli import main
from lab.geometry.table import read_table

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


def test_the_first_two_commands_are_what_ci_runs() -> None:
    """They install, so .ci/run executes them: it takes them from here, the first block of the README."""
    first, second = blocks("sh")[0].strip().splitlines()
    assert first == "python3 -m venv .venv && .venv/bin/pip install -e '.[dev]' && .venv/bin/lab calibrate"
    assert second == ".venv/bin/pytest"


def test_every_further_command_runs(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    commands = [line for block in blocks("sh")[1:] for line in block.strip().splitlines()]
    assert len(commands) >= 4
    (tmp_path / "targets.csv").write_text(blocks("csv")[0])
    (tmp_path / "grid.toml").write_text(blocks("study")[0])
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


@pytest.mark.parametrize("link", re.findall(r"\]\(([^)#]+)\)", TEXT))
def test_every_link_leads_somewhere(link: str) -> None:
    assert link.startswith("http") or (ROOT / link).exists()
