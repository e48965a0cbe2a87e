"""Extension points: a third party's package adds to the lab, a broken one breaks nothing, and the core needs none."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.robots import ROOT

COMMAND = '''
"""The command ``lab weigh``."""

from dataclasses import dataclass

import numpy as np
import tyro

import lab
from lab.options.command import Command
from lab.library.result import Result
from lab.core.errors import LabError
from lab.report.document import Document, Paragraph
from lab.report.view import View

WEIGH = Command("weigh", "Weigh a robot.", "weighing:Options", "weighing:weigh")


@dataclass(frozen=True)
class Options:
    """What to weigh."""

    kg: tyro.conf.Positional[float]
    """Its mass."""

    def check(self) -> None:
        if self.kg <= 0:
            raise LabError("give a mass above 0 kg")


@dataclass(frozen=True, repr=False, eq=False)
class Weight(Result):
    command = "weigh"
    warnings = ()

    options: Options

    def to_dict(self):
        return {"newton": 9.81 * self.options.kg}

    def columns(self):
        return {"newton": [9.81 * self.options.kg]}


weigh = Weight
VIEW = View("weighing:document_of")


def leave(options):
    raise SystemExit(0)


BOTH = Command("both", "Weigh.", "weighing:Options", "weighing:weigh", writes_on_request=True)
LEAVE = Command("leaving", "Leave.", "weighing:Options", "weighing:leave")


def document_of(weight):
    return Document("A weight", (Paragraph(f"It weighs {9.81 * weight.options.kg:.2f} N."),))


class Volume(lab.Criterion):
    name = "volume"

    def score(self, information):
        return np.linalg.slogdet(information)[1]


class Frobenius(lab.Criterion):
    name = "frobenius"

    def score(self, information):
        return (information**2).sum(axis=(-2, -1))

    def slope(self, information):
        return 2 * information


class Far(lab.Criterion):
    name = "far"

    def score(self, information):
        return information[..., 99, 99]


class Spoken:
    """A language of robots of two joints."""

    name, suffix, reads, makers, speed, most_digits = "Spoken", ".txt", (), ("talker",), "slowly", (3, 3)

    def refusal(self, joints):
        return None if joints.size == 2 else f"no spoken program for {joints.size} joints"

    def measuring_tour(self, tour):
        return f"{tour.robot}: {len(tour.waypoints)} stops".encode()
'''


def package(site: Path, name: str, entry_points: str, module: str = "") -> None:
    """Install a package into a folder of ``sys.path``: its metadata, and one module of its own."""
    metadata = site / f"{name}-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(entry_points)
    if module:
        (site / f"{name}.py").write_text(module)


def python(site: Path, *arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run Python with a folder first on its path."""
    path = os.pathsep.join([str(site), *filter(None, [os.environ.get("PYTHONPATH")])])
    env = os.environ | {"PYTHONPATH": path, "COLUMNS": "200"}
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, cwd=cwd or site, env=env)


COMMANDS = """
import contextlib, io, json, sys
from lab.cli.main import main
for line in json.loads(sys.argv[1]):
    printed, said = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
        try:
            code = main(line)
        except SystemExit as stop:
            code = stop.code
    print(json.dumps([code, printed.getvalue(), said.getvalue()]))
"""


def lab(site: Path, *lines: str, cwd: Path | None = None, after: str = "") -> list[tuple[int, str, str]]:
    """Run command lines in one process; the exit code of each, and what it writes on standard output and error."""
    done = python(site, "-c", COMMANDS + after, json.dumps([line.split() for line in lines]), cwd=cwd)
    assert done.returncode == 0, done.stderr
    return [tuple(json.loads(each)) for each in done.stdout.splitlines()]


def weighing(site: Path) -> Path:
    """Install the package of this file into a folder."""
    commands = "[lab.commands]\nweigh = weighing:WEIGH\n[lab.languages]\nspoken = weighing:Spoken\n"
    commands += "[lab.views]\nWeight = weighing:VIEW\n"
    commands += "[lab.criteria]\nfar = weighing:Far\nfrobenius = weighing:Frobenius\nvolume = weighing:Volume\n"
    package(site, "weighing", commands, COMMAND)
    return site


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int, str, str]]:
    """Command lines of one process, beside a package that is broken and one with the name of a core command."""
    site = weighing(tmp_path_factory.mktemp("site"))
    package(site, "broken", "[lab.commands]\nbroken = broken:BROKEN\n", "import a_module_that_is_not_there\n")
    package(site, "other", "[lab.commands]\nidentify = weighing:WEIGH\n")
    ends = "print('printed at import')\nraise SystemExit('no licence')\n"
    package(
        site, "ending", "[lab.commands]\nending = ending:ENDING\nleaving = weighing:LEAVE\nboth = weighing:BOTH\n", ends
    )
    package(site, "corrupt", "[lab.commands]\nweigh\n")
    lines = (
        "weigh 2 --json",
        "weigh -1",
        "weigh 2",
        "weigh --help",
        "broken",
        "ending",
        "leaving 2",
        "both 2",
        "--help",
        "design --help",
    )
    return dict(zip(lines, lab(site, *lines, after=SPOKEN), strict=True))


SPOKEN = """
import numpy as np
from lab.robots.load_robot import load_robot
from lab.formats.programs.protocol import MeasuringTour
from lab.formats.programs.languages import plan_files, refusal
tour = MeasuringTour("two", np.zeros((4, 2)), np.array([-1, 0, 1, -1]), ("3", "4"))
assert plan_files(load_robot("course2r").chain, "spoken", tour) == {"plan.txt": b"two: 4 stops"}
assert refusal(load_robot("irb120").chain, "spoken") == "no spoken program for 6 joints"
"""


@pytest.mark.thorough
def test_a_third_party_s_command_is_run_as_the_lab_s_own(said: dict[str, tuple[int, str, str]]) -> None:
    code, printed, warned = said["weigh 2 --json"]
    assert (
        code == 0 and "'corrupt' cannot be read" in warned and json.loads(printed) == {"newton": pytest.approx(19.62)}
    )
    assert said["weigh -1"] == (2, "", "lab: give a mass above 0 kg\n")
    assert "It weighs 19.62 N." in said["weigh 2"][1] and "Its mass." in said["weigh --help"][1]


def test_a_third_party_s_language_is_chosen_by_its_name(said: dict[str, tuple[int, str, str]]) -> None:
    assert any(",spoken," in line for line in said["design --help"][1].splitlines())


def test_what_cannot_be_imported_is_reported_in_a_line_and_breaks_nothing(
    said: dict[str, tuple[int, str, str]],
) -> None:
    """A core command is not replaced, either."""
    code, listed, warned = said["--help"]
    assert code == 0 and listed.count("  identify ") == 1 and listed.count("Weigh a robot.") == 1
    line = "extension 'broken' (broken:BROKEN) cannot be loaded (ModuleNotFoundError: No module named"
    assert warned.count(f"lab: warning: {line}") == 1 and warned.count("Traceback") == 0
    assert "printed at import" not in listed, listed[-300:]
    assert "Leave." in listed
    for text in (
        "extension 'ending' (ending:ENDING) cannot be loaded (SystemExit: no licence)",
        "entry points of package 'corrupt' cannot be read",
    ):
        assert text in "".join(shown for _, _, shown in said.values())
    assert said["ending"][0] == 2 and "\nlab: extension 'ending'" in said["ending"][2]
    assert said["leaving 2"][:2] == (2, "") and "weighing:leave raises SystemExit: 0" in said["leaving 2"][2]
    assert said["both 2"][:2] == (2, "") and "writes_on_request needs a field out" in said["both 2"][2]
    assert said["broken"][0] == 2 and said["broken"][2].startswith(f"lab: {line}")
    assert said["broken"][2].count("\n") == 1


OWN_PARTS = """
[lab.estimators]
kalman = own_kalman:KalmanFilter
least-squares = own_kalman:KalmanFilter
[lab.effects]
runout = own_parts:Runout
[lab.sensors]
low-beam = own_parts:LowBeam
[lab.instruments]
photogrammetry = own_parts:Photogrammetry
[lab.error_terms]
bow = own_parts:Bow
[lab.samplers]
tolerances = own_parts:Tolerances
"""


@pytest.mark.thorough
def test_a_third_party_s_parts_are_used_by_their_names_in_commands_and_studies(tmp_path: Path) -> None:
    site = weighing(tmp_path)
    design = "design --robot course2r --poses 6 --candidates 60 --starts 1 --json"
    own, known, refused, blind, failed = lab(
        site,
        f"{design} --criterion frobenius --out own",
        f"{design} --out known",
        f"{design} --criterion frobenios",
        "design --robot scara --criterion frobenius --poses 8 --candidates 60",
        f"{design} --criterion far",
    )
    assert failed[0] == 2 and "criterion 'far' raises IndexError" in failed[2]
    assert own[0] == known[0] == 0, own[2] + known[2]
    first, second = json.loads(own[1]), json.loads(known[1])
    assert first["criterion"] == "frobenius" and first["indices"]["o1"]["value"] < second["indices"]["o1"]["value"]
    assert refused[0] == 2 and "A, G, I, far, frobenius, volume; for one of your own" in refused[2]
    assert blind[0] == 2 and "criterion frobenius chose 8 poses that cannot tell all" in blind[2]
    package(site, "parts", OWN_PARTS)
    for name in ("own_parts", "own_kalman"):
        shutil.copy(ROOT / "scripts" / "examples" / f"{name}.py", site)
    named = "--estimator kalman --sampler tolerances --observe low-beam --instrument photogrammetry --error-terms bow"
    fitted = f"--own-effects runout:mrad=0.2 --model runout {named} --poses 60 --no-recording --json".split()
    found = python(site, "-m", "lab", "calibrate", *fitted, "--out", "own_parts_run")
    assert found.returncode == 0, found.stderr
    warned = "'least-squares' of lab.estimators is left out: the lab has one of that name; rename the entry"
    assert found.stderr.startswith(f"lab: warning: {warned}\n") and "assembly mode" not in found.stderr
    result, config = json.loads(found.stdout), json.loads((site / "own_parts_run" / "config.json").read_text())
    assert result["estimator"] == "kalman" and result["model"] == "geometric+runout" and result["verdict"] == "good"
    options = config["options"]
    assert (options["observe"], options["instrument"], options["sampler"]) == (
        "low-beam",
        "photogrammetry",
        "tolerances",
    )
    loaded = python(site, "-c", "import lab; print(lab.load_run('own_parts_run').estimate.groups)")
    assert loaded.stdout == "('runout',)\n", loaded.stderr
    (site / "grid.toml").write_text(
        'name = "grid"\nrobots = 1\ndraws = 1\nfresh = 10\n[factors]\ncriterion = "random"\ninstrument = '
        '"photogrammetry"\nposes = 20\neffects = "gears"\nsampler = "tolerances"\n'
        'estimator = ["least-squares", "kalman"]\n[effects.gears]\nown_effects = ["runout:mrad=0.3"]\n'
    )
    of_parts = python(site, "-m", "lab", "study", "grid.toml", "--workers", "1", "--json", "--out", "parts_study")
    assert of_parts.returncode == 0, of_parts.stderr


@pytest.mark.thorough
def test_the_core_runs_without_its_extensions(tmp_path: Path) -> None:
    """A copy of the package without ``lab/extensions`` and their entry points."""
    site, work = tmp_path / "site", tmp_path / "work"
    shutil.copytree(ROOT / "lab", site / "lab", ignore=shutil.ignore_patterns("extensions", "__pycache__"))
    (site / "models").symlink_to(ROOT / "models")
    package(site, "virtual_calibration_lab", "")
    work.mkdir()
    (work / "targets.csv").write_text("id,x_mm,y_mm,z_mm\n1,2007.2,96.8,-877.6\n2,1828.3,93.2,-842.8\n")
    grid = 'name = "grid"\nrobot = "scara"\nrobots = 1\ndraws = 1\nfresh = 10\n'
    grid += '[factors]\ncriterion = "random"\nposes = [20, 30]\n'
    (work / "grid.toml").write_text(grid)
    commands = {
        "calibrate --robot scara --poses 30 --no-recording --out first": 0,
        "identify first/measurements.csv --robot scara --no-recording --out again": 0,
        "design --robot scara --poses 12 --candidates 100 --starts 1 --no-recording --out plan": 0,
        "verify again first/measurements.csv --force --no-recording --out check": 0,
        "certify again --out certificate": 0,
        "compensate targets.csv --run again --no-recording --out corrected": 0,
        "history first again --out since": 0,
        "study grid.toml --workers 1 --out many": 0,
        "inspect irb120": 0,
        "inspect delta": 0,
        "payload --robot tx40 --simulate": 2,
        "design --controller rapid": 2,
        "calibrate --robot scara --observe pixels": 2,
        "identify first/measurements.csv --robot scara --noise-px 0.1": 2,
    }
    for command, (code, _, said) in zip(
        commands, lab(site, *(f"{each} --json" for each in commands), cwd=work), strict=True
    ):
        assert code == commands[command], (command, said)
        if code:
            assert said.count("\n") == 1 and "Traceback" not in said, said
    assert "'payload' is no command; there are calibrate, identify" in python(site, "-m", "lab", "payload").stderr
    loaded = python(site, "-c", "import lab; print(lab.__file__, hasattr(lab, 'trajectory')); lab.payload", cwd=work)
    assert loaded.stdout == f"{site / 'lab' / '__init__.py'} False\n"
    assert "module 'lab' has no attribute 'payload': the extension 'dynamics' is not installed" in loaded.stderr
