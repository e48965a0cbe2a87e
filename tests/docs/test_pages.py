"""Everything that the README and the pages of docs/ show is executed or compared."""

import ast
import contextlib
import importlib
import json
import re
import runpy
import shlex
import sys
import tomllib
import xml.etree.ElementTree as ET
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from helpers.pages import PAGES, README, Page
from helpers.robots import ROOT
from helpers.run_script import threads_for_processes

from lab import extension_points
from lab.cli.commands import all_commands
from lab.cli.main import main
from lab.extensions.cameras.rig import read_rig
from lab.extensions.dynamics.arm_simulation import LoadBench, RigidLoad, RunErrors
from lab.extensions.dynamics.load_files import Mounting, read_mounting, write_loads
from lab.formats.cell_toml import read_cell
from lab.formats.certificate_toml import read_certificate_details
from lab.formats.drives_toml import read_drives
from lab.formats.instrument_toml import read_instrument
from lab.formats.loose_table import read_column_map
from lab.formats.mechanism_toml import read_mechanism
from lab.formats.robot_toml import read_table
from lab.robots.load_robot import load_robot, load_virtual
from lab.simulation.collisions import random_poses
from lab.studies.grid import read_study

LANGUAGES = {"sh", "text", "python", "toml", "xml"}
named = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


def write_load(path: Path, mounting: Mounting) -> None:
    """What a wrist sensor measures at twenty poses with a payload and without it."""
    robot, noise = load_virtual("tx40"), RunErrors(force_noise_n=0.05, moment_noise_nm=0.002)
    load = RigidLoad(1.5, np.array([0.010, -0.005, 0.060]), np.diag([22.5e-4, 26e-4, 12.5e-4]))
    poses = random_poses(robot.model, 20, np.random.default_rng(0))
    records = LoadBench(robot.model, load, mounting, noise).resting(poses, np.random.default_rng(1))
    write_loads(path, records, robot.chain.joint_names, robot.chain.prismatic)


def write_files(page: Page, folder: Path) -> None:
    """The files that a page shows, under the names by which its commands read them."""
    for block in page.of("text"):
        if block.startswith(("id,x_mm", "id,move")):
            name = "square.csv" if "move" in block else "points.csv" if "vx_mm" in block else "targets.csv"
            (folder / name).write_text(block)
        if block.startswith("session,q1_deg"):
            (folder / "daily.csv").write_text(block)
        if block.startswith(("// Working", "Pose,J1")):
            (folder / ("tracker.txt" if block.startswith("//") else "poses.csv")).write_text(block)
    for block in page.of("xml"):
        (folder / f"{ET.fromstring(block).get('name')}.urdf").write_text(block)
    for block in page.of("toml"):
        if "[factors]" in block:
            name = "compliant.toml" if "compliant arms" in block else "grid.toml"
            (folder / name).write_text(block)
        if "[[obstacle]]" in block:
            (folder / "cell.toml").write_text(block)
        if "[certificate]" in block:
            (folder / "details.toml").write_text(block)
        if block.startswith("robot ="):
            (folder / ("soft2r.toml" if "course2r" in block else "soft.toml")).write_text(block)
        if "[systematic]" in block:
            (folder / "tracker.toml").write_text(block)
        if "[[camera]]" in block:
            (folder / ("placed.toml" if "position_mm" in block else "cameras.toml")).write_text(block)
        if "[sensor]" in block:
            (folder / "sensor.toml").write_text(block)
            write_load(folder / "load.csv", read_mounting(folder / "sensor.toml"))


REAL_EXAMPLE = [each for each in README.commands if "example ur5" in each or "ur5_jacobi_1000" in each]


@pytest.mark.thorough
@pytest.mark.parametrize("page", [page for page in PAGES if page.commands], ids=lambda page: page.name)
def test_every_command_of_a_page_runs(page: Page, tmp_path, monkeypatch, capsys) -> None:
    """With few candidates and fresh poses, in this process alone: what is judged is not asked here."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("lab.library.virtual_arm.FRESH_POSES", 100)  # of 1000
    monkeypatch.setattr("lab.studies.campaigns.CANDIDATES", 100)  # of 1000
    monkeypatch.setattr("lab.studies.campaigns.STARTS", 1)  # of 2
    write_files(page, tmp_path)
    (tmp_path / "models").symlink_to(ROOT / "models")
    for command in [each for each in page.commands if each not in REAL_EXAMPLE]:  # which a test below runs
        _, *arguments = shlex.split(command)
        if arguments[0] == "design":
            arguments += [] if "--candidates" in arguments else ["--candidates", "100"]  # of 2000
            arguments += [] if "--starts" in arguments else ["--starts", "1"]
        with threads_for_processes():
            assert main(arguments) == 0, command
        assert capsys.readouterr().out


@named
def test_blocks_are_of_a_kind_that_is_tested(page: Page) -> None:
    directives = {language for language, _ in page.blocks if language.startswith("{")}
    assert {language for language, _ in page.blocks} - directives <= LANGUAGES
    others = [block for block in page.of("sh") if not block.startswith(("lab ", ".venv/bin/lab "))]
    assert others == (README.of("sh")[:1] if page is README else [])  # what else a person types is `text`


def program_of(page: Page, language: str, body: str) -> str:
    """The program that a block shows or includes; empty for other blocks."""
    if language.startswith("{literalinclude}"):
        return (page.path.parent / language.split()[1]).read_text(encoding="utf-8")
    return body if language == "python" else ""


def imported(program: str) -> set[str]:
    """The packages that a program imports."""
    found = list(ast.walk(ast.parse(program)))
    names = [name.name for each in found if isinstance(each, ast.Import) for name in each.names]
    names += [each.module or "" for each in found if isinstance(each, ast.ImportFrom)]
    return {name.partition(".")[0] for name in names}


PROGRAMS = [
    pytest.param(page, program, page.blocks[i + 1], id=page.name)
    for page in PAGES
    for i, block in enumerate(page.blocks)
    if (program := program_of(page, *block))
]


@pytest.mark.thorough
@pytest.mark.parametrize(("page", "program", "below"), PROGRAMS)
def test_a_program_prints_what_is_shown_below_it(
    page: Page, program: str, below: tuple[str, str], tmp_path, monkeypatch, capsys
) -> None:
    if absent := [name for name in imported(program) if find_spec(name) is None]:
        pytest.skip(f"{absent[0]} is not installed")
    (tmp_path / "program.py").write_text(program, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(extension_points, "_given", {})
    monkeypatch.setattr(sys, "argv", ["program.py"])
    runpy.run_path("program.py", run_name="__main__")
    assert below == ("text", capsys.readouterr().out)


TOML = [(page, block) for page in PAGES for block in page.of("toml")]


@pytest.mark.parametrize(("page", "block"), TOML, ids=[page.name for page, _ in TOML])
def test_a_toml_file_is_read_by_the_lab(page: Page, block: str, tmp_path) -> None:
    path, content = tmp_path / "file.toml", tomllib.loads(block)
    path.write_text(block)
    if "factors" in content:
        assert read_study(path).robots == content["robots"] >= 10
    elif "sensor" in content:
        read_mounting(path)
    elif "camera" in content:
        assert [each.name for each in read_rig(path).cameras] == ["wrist"]
    elif "obstacle" in content:
        assert [each.name for each in read_cell(path).obstacle] == ["table"]
    elif "drive" in content:
        assert read_drives(path, 2).couplings[1].tolist() == [float("coupling" in content), 1.0]
    elif "certificate" in content:
        assert not read_certificate_details(path).missing
    elif "systematic" in content:
        assert "collimation" in {term.name for term in read_instrument(path).errors.stated}
    elif "points" in content:
        assert len(read_column_map(path).joints.joints) == 6
    elif "link" in content:
        assert load_robot(str(path)).link_compliances is not None
    elif "Z" in content:
        robot = read_table(path)
        assert robot.T_world_frame0 is not None and set(robot.tool) == {"p1"}
    elif "frame" in content:
        assert main(["inspect", str(path), "--json"]) == 0
        names = read_mechanism(path).mechanism.names
        assert names[6:] == ("A1.x", "A1.y", "A2.x", "A2.y", "leg1.length", "leg2.length")
    else:
        robot = read_table(path)
        assert robot.chain.prismatic == (False, True) and not robot.warnings


URDFS = [(page, block) for page in PAGES for block in page.of("xml")]


@pytest.mark.parametrize(("page", "block"), URDFS, ids=[page.name for page, _ in URDFS])
def test_a_urdf_is_read_without_a_warning(page: Page, block: str, tmp_path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(block)
    robot = load_virtual(str(path))
    assert not robot.warnings and (robot.chain.acceleration > 0).all()


@named
def test_every_link_leads_somewhere(page: Page) -> None:
    for link in page.links:
        target = (page.path.parent / link.partition("#")[0]).resolve()
        assert link.startswith(("https://", "#")) or target.exists(), link


@named
def test_every_name_of_the_code_exists(page: Page) -> None:
    gone = set(re.findall(r"`([^`]+)`\s+at\s+`[0-9a-f]{8}`", page.prose))  # scripts of an earlier commit
    if page.name == "CHANGELOG.md":  # which names what is gone, too
        return
    for name in set(page.names) - gone:
        if re.fullmatch(r"lab(\.\w+)+", name):
            assert resolved(name) or f"- ``{name}``: " in extension_points.__doc__, name
        elif re.fullmatch(r"(lab|tests|scripts|models|docs|\.ci)/[\w./]*", name) and "NAME" not in name:
            assert (ROOT / name).exists(), name


def resolved(name: str) -> bool:
    """Whether a dotted name is a module, or an attribute of one."""
    try:
        importlib.import_module(name)
    except ModuleNotFoundError:
        module, _, attribute = name.rpartition(".")
        return hasattr(importlib.import_module(module), attribute)
    return True


def test_every_command_is_in_the_reference() -> None:
    names = [command.name for command in all_commands()]
    reference = (ROOT / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| \[`lab (\w+)`\]\(#lab-\1\)", reference, re.MULTILINE) == names
    table = README.text.partition("\n## Commands\n")[2].partition("\n## ")[0]
    assert sorted(re.findall(r"\[`lab (\w+)`\]\(docs/", table)) == sorted(names)  # each in one group


def test_every_flag_exists(capsys) -> None:
    exist = set()
    for asked in (["--help"], *([each.name, "--help-all"] for each in all_commands())):
        with contextlib.suppress(SystemExit):
            main(asked)
        exist |= set(re.findall(r"--[a-z][a-z-]*", capsys.readouterr().out))
    for page in (each for each in PAGES if each.name != "CHANGELOG.md"):  # which names what is gone, too
        for name in page.names:
            if name.startswith(("--", "lab ")):
                assert set(re.findall(r"--[a-z][a-z-]*", name)) <= exist, (page.name, name)


def test_the_first_two_commands_are_what_ci_runs() -> None:
    """They install, so .ci/run executes them: it takes them from here, the first block of the README."""
    first, second = README.of("sh")[0].strip().splitlines()
    assert first == "python3 -m venv .venv && .venv/bin/pip install -e . && .venv/bin/lab calibrate"
    assert second == ".venv/bin/pip install -e '.[test]' && .venv/bin/pytest"


def test_the_numbers_beside_the_picture_are_those_of_the_command(tmp_path, capsys) -> None:
    assert main(["calibrate", "--out", str(tmp_path / "run"), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    before, after = (result[name]["mean"] for name in ("before_mm", "after_mm"))
    assert f"the mean error falls from {before:.2f} mm to {after:.4f} mm" in README.text


@pytest.mark.thorough
def test_the_numbers_of_the_real_example_are_those_of_its_command(tmp_path, monkeypatch, capsys) -> None:
    *before_it, command = REAL_EXAMPLE
    (tmp_path / "models").symlink_to(ROOT / "models")
    monkeypatch.chdir(tmp_path)
    assert all(main(shlex.split(each)[1:]) == 0 for each in before_it)
    capsys.readouterr()
    assert main([*shlex.split(command)[1:], "--out", str(tmp_path / "run"), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    before, after = (result[name]["mean"] for name in ("before_mm", "after_mm"))
    text = " ".join(README.text.split())
    assert f"{before:.3f} mm for the nominal model, and {after:.4f} mm for the calibrated one" in text
    assert f"The verdict is {result['verdict']}" in text
