"""Whole commands given valid files with something changed: done, or told in one line; no defect, nothing left behind.

The files of runs are changed in ``test_fuzz_runs.py``.

The readers alone are tried far more often (``tests/formats/test_fuzz.py``): here what a reader lets through goes on
into models, fits, and what is written. The long run (``-m slow``) tries as many files of each command as ``LAB_FUZZ``
says.
"""

import os
import resource
import shutil
from pathlib import Path

import numpy as np
import pytest
from helpers.bad_input import ARM_TOML, ARM_URDF, ARM_XML, csv, run
from helpers.campaigns import own_copy, run_of
from helpers.drawing import nothing_drawn
from helpers.file_kinds import KINDS, LONG_RUNS, calibration, weighing
from helpers.fuzzing import RandomChance, mutated
from helpers.time_limit import ends

import lab

MOST_KIB = 1 << 20
SIX, PULSES = "=1,2,3,4,5,6", "100,100,100,100,100,100"
OUTSIDE = {  # what the text of a program does not hold
    "fanuc": f" --frames 'UTOOL[2]{SIX}; UFRAME[3]{SIX}'",
    "jbi": f" --frames 'TOOL[2]{SIX}; USER[3]{SIX}' --pulses-per-deg {PULSES}",
}
COMMANDS: dict[str, tuple[str, str]] = {  # the kind of the file, and the command that is given it as {}
    "identify": ("measurements", "identify {} --robot arm.toml"),
    "identify of a table": ("table", "identify good.csv --robot {}"),
    "identify, judged by": ("measurements", "identify good.csv --robot arm.toml --validate {}"),
    "verify": ("measurements", "verify run {} --refit base,tool"),
    "calibrate by a plan": ("day", "calibrate --plan {}"),
    "calibrate by cameras": ("cameras", "calibrate --observe pixels --cameras {} --poses 12"),
    "calibrate by a tracker": ("tracker", "calibrate --robot arm.toml --instrument {} --poses 20"),
    "calibrate as configured": ("config", "calibrate --robot arm.toml --config {}"),
    "inspect a table": ("table with drives", "inspect {}"),
    "inspect a mechanism": ("mechanism", "inspect {}"),
    "inspect an MJCF": ("MJCF", "inspect {}"),
    "inspect a URDF": ("URDF", "inspect {}"),
    "inspect a cell": ("cell", "inspect arm.toml --cell {}"),
    "payload": ("payload", "payload {} --robot tx40 --sensor sensor.toml"),
    "payload by a sensor": ("mounting", "payload weighted.csv --robot tx40 --sensor {}"),
    "dynamics": ("motion", "dynamics {} --robot heavy.toml"),
    "dynamics of drives": ("drives", "dynamics currents.csv --robot heavy.toml --drives {}"),
    "dynamics with a load": ("rigid load", "dynamics motion.csv --robot heavy.toml --load {}"),
    "trajectory": ("path", "trajectory {} --robot arm.toml"),
    "kinematics": ("joints", "kinematics arm.toml --file {}"),
    "import": ("export", "import {} --joints log.csv --robot arm.toml --by order"),
    "import by columns": ("columns", "import export.txt --joints log.csv --robot arm.toml --columns {}"),
    "certify": ("certificate", "certify run --details {}"),
    "compensate": ("targets", "compensate {} --run run --no-check"),
    "design": ("cell", "design --robot arm.toml --cell {} --poses 8 --candidates 40 --starts 1"),
    "study": ("study", "study {} --workers 1"),
    "workspace": ("table", "workspace {} --places 100 --orientations 2"),
    "workspace of a mechanism": ("mechanism", "workspace {} --places 100 --orientations 2"),
    "workspace of a cell": ("cell", "workspace arm.toml --cell {} --places 100 --orientations 2"),
    "kinematics of a table": ("table", "kinematics {} --joints 10,20,30"),
    "kinematics of a mechanism": ("mechanism", "kinematics {} --pose 100,200,300"),
    "kinematics of a URDF": ("URDF", "kinematics {} --joints 10,20"),
    "trajectory of elastic links": ("elastic links", "trajectory moves.csv --robot {} --payload-kg 1"),
    "trajectory of an MJCF": ("MJCF", "trajectory xml_moves.csv --robot {}"),
    "identify of an MJCF": ("MJCF", "calibrate --robot {} --poses 20"),
    "calibrate a mechanism": ("mechanism", "calibrate --robot {} --poses 20"),
    "compensate with a load": ("load", "compensate day.csv --run irb --load {} --accept-edited --no-check"),
    "certify by a tracker": ("tracker", "certify run --instrument {}"),
    "verify touches": ("daily", "verify irb {}"),
    **{
        f"compensate a program in {language}": (
            f"{language} program",
            f"compensate --program {{}} --run other --no-check --controller {language}{more}",
        )
        for language, more in {**dict.fromkeys(("rapid", "krl", "urscript", "val3"), ""), **OUTSIDE}.items()
    },
}
CHEAP = ("identify", "inspect a table", "payload", "kinematics", "import")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One working folder for all commands: each leaves it as it was."""
    folder = tmp_path_factory.mktemp("fuzzed")
    heavy = ARM_TOML.replace('name = "q', 'mass_kg = 5\nname = "q').replace(
        'name = "rail"', 'mass_kg = 2\nname = "rail"'
    )
    torques, currents = "tau1_nm,tau2_nm,f3_n", "current1_a,current2_a,current3_a"
    texts = {"arm.toml": ARM_TOML, "heavy.toml": heavy, "arm.xml": ARM_XML, "arm.urdf": ARM_URDF, "good.csv": csv()}
    texts |= {"weighted.csv": weighing()["runs.csv"], "sensor.toml": weighing()["sensor.toml"]}
    texts |= {"motion.csv": LONG_RUNS, "currents.csv": LONG_RUNS.replace(torques, currents)}
    texts |= {"export.txt": KINDS["export"].text(), "log.csv": KINDS["log"].text()}
    texts |= {"moves.csv": "q1_deg,q2_deg,rail_mm\n0,0,10\n10,20,30\n"}
    texts |= {"xml_moves.csv": "q1_deg,q2_deg,q3_deg\n0,0,0\n10,20,30\n"}
    for name, text in texts.items():
        (folder / name).write_text(text)
    with nothing_drawn():
        lab.calibrate(str(folder / "arm.toml"), poses=20, seed=1).save(folder / "run")
    own_copy(run_of(poses=20, seed=2), folder / "other")
    (folder / "irb").mkdir()
    for name, content in calibration().items():
        (folder / "irb" / name).write_bytes(content)
    shutil.copy(folder / "irb" / "measurements.csv", folder / "day.csv")
    (folder / "weighted").mkdir()
    (folder / "weighted" / "config.json").write_text('{"schema": 1, "options": {}}')
    return folder


def given(name: str, seed: str | None, place: Path) -> str:
    """The command line of a case, its changed file written; without a seed the file is as it should be."""
    kind, command = COMMANDS[name]
    text = KINDS[kind].text()
    content = text.encode() if seed is None else mutated(text, RandomChance(seed))
    if kind == "load":
        shutil.copytree(place / "weighted", place / "changed")
        (place / "changed" / KINDS[kind].name).write_bytes(content)
        return command.format("changed")
    (place / f"changed_{KINDS[kind].name}").write_bytes(content)
    return command.format(f"changed_{KINDS[kind].name}")


def wrong_with(name: str, seed: str | None, place: Path, capfd: pytest.CaptureFixture[str]) -> str | None:
    """What was wrong with how a command ended, if anything."""
    before = sorted(path.name for path in place.iterdir())
    try:
        argv = f"{given(name, seed, place)} --out never"
        with nothing_drawn(), np.errstate(all="ignore"), ends():
            code = run(argv)
        _, err = capfd.readouterr()
        lines = [line for line in err.splitlines() if not line.startswith("lab: warning: ")]
        shutil.rmtree(place / "never", ignore_errors=True)
    except TimeoutError as late:
        return f"{seed}: {late}"
    finally:
        for path in place.glob("changed*"):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    told = code in (0, 1) or (seed is not None and code == 2 and len(lines) == 1 and lines[0].startswith("lab: "))
    left = sorted({path.name for path in place.iterdir()} ^ set(before))
    return None if told and not left else f"{seed}: code {code}, {lines[:3]}, {left}"


@pytest.mark.parametrize("name", [pytest.param(n, marks=() if n in CHEAP else pytest.mark.slow) for n in COMMANDS])
@pytest.mark.thorough
def test_a_command_given_the_valid_file_is_done(
    name: str, place: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Else a file with something changed would be refused for what was wrong with it before."""
    monkeypatch.chdir(place)
    assert wrong_with(name, None, place, capfd) is None


@pytest.mark.thorough
@pytest.mark.parametrize("name", CHEAP)
def test_a_command_given_a_changed_file_is_done_or_tells_in_one_line(
    name: str, place: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(place)
    assert [said for i in range(3) if (said := wrong_with(name, f"{name} {i}", place, capfd))] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_commands_given_many_changed_files_are_done_or_tell_in_one_line(
    name: str, place: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """What is not handled is named by its seed."""
    monkeypatch.chdir(place)
    seeds = (f"{name} {i}" for i in range(int(os.environ.get("LAB_FUZZ", "100"))))
    assert [said for seed in seeds if (said := wrong_with(name, seed, place, capfd))] == []
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < MOST_KIB
