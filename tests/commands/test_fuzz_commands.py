"""Whole commands given valid files with something changed: done, or told in one line; no defect, nothing left behind.

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
from helpers.drawing import nothing_drawn
from helpers.file_kinds import KINDS, RUNS
from helpers.fuzzing import RandomChance, mutated
from helpers.time_limit import within

import lab

LONGEST_S, MOST_KIB = 30, 1 << 20
COMMANDS: dict[str, tuple[str, str]] = {  # the kind of the file, and the command that is given it as {}
    "identify": ("measurements", "identify {} --robot arm.toml"),
    "identify of a table": ("table", "identify good.csv --robot {}"),
    "identify, judged by": ("measurements", "identify good.csv --robot arm.toml --validate {}"),
    "verify": ("measurements", "verify run {} --refit base,tool"),
    "calibrate by a plan": ("measurements", "calibrate --robot arm.toml --plan {}"),
    "calibrate by a tracker": ("tracker", "calibrate --robot arm.toml --instrument {} --poses 20"),
    "calibrate as configured": ("config", "calibrate --robot arm.toml --config {}"),
    "inspect a table": ("table with drives", "inspect {}"),
    "inspect a mechanism": ("mechanism", "inspect {}"),
    "inspect an MJCF": ("MJCF", "inspect {}"),
    "inspect a URDF": ("URDF", "inspect {}"),
    "inspect a cell": ("cell", "inspect arm.toml --cell {}"),
    "payload": ("runs", "payload {} --robot arm.toml"),
    "payload by a sensor": ("mounting", "payload runs.csv --robot arm.toml --sensor {}"),
    "dynamics": ("motion", "dynamics {} --robot arm.toml"),
    "dynamics of drives": ("drives", "dynamics runs.csv --robot arm.toml --drives {}"),
    "dynamics with a load": ("rigid load", "dynamics runs.csv --robot arm.toml --load {}"),
    "trajectory": ("path", "trajectory {} --robot arm.toml"),
    "kinematics": ("joints", "kinematics arm.toml --file {}"),
    "import": ("export", "import {} --joints log.csv --robot arm.toml --by order"),
    "import by columns": ("columns", "import export.txt --joints log.csv --robot arm.toml --columns {}"),
    "certify": ("certificate", "certify run --details {}"),
    "compensate": ("targets", "compensate {} --run run --no-check"),
    "design": ("cell", "design --robot arm.toml --cell {} --poses 8 --candidates 40 --starts 1"),
    "study": ("study", "study {} --workers 1"),
    **{
        f"{command.split()[0]} of a run's {name}": (f"run's {name}", command)
        for name in ("config.json", "result.json", "parameters.json", "covariance.csv")
        for command in (
            "verify {} day.csv --accept-edited",
            "compensate day.csv --run {} --no-check --accept-edited",
            "certify {} --accept-edited",
            "compare {} other --accept-edited",
        )
    },
    **{
        f"compensate a program in {language}": (
            f"{language} program",
            f"compensate --program {{}} --run other --no-check --controller {language}",
        )
        for language in ("rapid", "krl", "urscript", "fanuc", "val3", "jbi")
    },
}
CHEAP = ("identify", "inspect a table", "payload", "kinematics", "import", "certify of a run's result.json")
FOUND = (("compensate of a run's result.json", "compensate of a run's result.json 2"),)  # commands and seeds


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One working folder for all commands: each leaves it as it was."""
    folder = tmp_path_factory.mktemp("fuzzed")
    texts = {"arm.toml": ARM_TOML, "arm.xml": ARM_XML, "arm.urdf": ARM_URDF, "good.csv": csv(), "runs.csv": RUNS}
    texts |= {"export.txt": KINDS["export"].text(), "log.csv": KINDS["log"].text()}
    for name, text in texts.items():
        (folder / name).write_text(text)
    with nothing_drawn():
        lab.calibrate(str(folder / "arm.toml"), poses=20, seed=1).save(folder / "run")
        for name, seed in (("other", 2), ("irb", 1)):
            lab.calibrate("irb120", poses=20, seed=seed).save(folder / name)
    shutil.copy(folder / "irb" / "measurements.csv", folder / "day.csv")
    return folder


def given(name: str, seed: str, place: Path) -> str:
    """The command line of a case, its changed file written."""
    kind, command = COMMANDS[name]
    content = mutated(KINDS[kind].text(), RandomChance(seed))
    if kind.startswith("run's "):
        folder = place / "changed"
        shutil.copytree(place / "irb", folder)
        (folder / KINDS[kind].name).write_bytes(content)
        return command.format("changed")
    (place / f"changed_{KINDS[kind].name}").write_bytes(content)
    return command.format(f"changed_{KINDS[kind].name}")


def wrong_with(name: str, seed: str, place: Path, capfd: pytest.CaptureFixture[str]) -> str | None:
    """What was wrong with how a command ended, if anything."""
    before = sorted(path.name for path in place.iterdir())
    try:
        argv = f"{given(name, seed, place)} --out never"
        with nothing_drawn(), np.errstate(all="ignore"), within(LONGEST_S):
            code = run(argv)
        _, err = capfd.readouterr()
        lines = [line for line in err.splitlines() if not line.startswith("lab: warning: ")]
        shutil.rmtree(place / "never", ignore_errors=True)
    except TimeoutError as late:
        return f"{seed}: {late}"
    finally:
        for path in place.glob("changed*"):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    told = code in (0, 1) or (code == 2 and len(lines) == 1 and lines[0].startswith("lab: "))
    left = sorted({path.name for path in place.iterdir()} ^ set(before))
    return None if told and not left else f"{seed}: code {code}, {lines[:3]}, {left}"


@pytest.mark.thorough
@pytest.mark.parametrize("name", CHEAP)
def test_a_command_given_a_changed_file_is_done_or_tells_in_one_line(
    name: str, place: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(place)
    assert [said for i in range(3) if (said := wrong_with(name, f"{name} {i}", place, capfd))] == []


@pytest.mark.thorough
def test_what_was_found_stays_mended(
    place: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(place)
    assert [said for name, seed in FOUND if (said := wrong_with(name, seed, place, capfd))] == []


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
