"""Runs one value of which is of another type or size: told in one line, or built on with a word, and never a defect.

Every file that a command reads from a run is changed at any of its keys, cells or lines. Without ``--accept-edited`` no
changed run is built on. The long run (``-m slow``) tries as many as ``LAB_FUZZ`` says of each command.
"""

import json
import os
import random
import shutil
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.bad_input import ARM_TOML, run
from helpers.drawing import nothing_drawn
from helpers.file_kinds import LOAD, STUDY, TRACKER
from helpers.time_limit import ends

from lab.core.whole_folder import checksum_lines

VALUES = (
    None, True, "x", "", 0, -1, 7, 0.5, 1e-300, 1e9, 1e300, -1e300, 10**30, float("nan"), float("inf"), [], {}, [1],
    [None], ["x"], {"a": 1}, [[1, 2], [3]], "../x", "2026-01-01", [1e300] * 3,
)  # fmt: skip
CELLS = ("", "x", "nan", "1e300", "-1", "0", "1e400", "[]", "7")
SETTINGS = ('"x"', "1e300", "-1", "nan", "true", "[]", "{}", "[1, 2, 3]")
COMMANDS = {
    "certify": "certify changed --force",
    "verify": "verify changed day.csv --force",
    "compensate": "compensate day.csv --run changed --no-check --force",
    "predict": "predict changed day.csv --force",
    "history": "history changed other --force",
    "history of a folder": "history . --force",
    "calibrate": "calibrate --config changed/config.json",
    "calibrate with a load": "calibrate --poses 12 --load changed",
    "study": "study study.toml --workers 1 --resume",
}
NOT_READ = {"calibrated.toml", "calibrated.py", "report.html", "recording.rrd"}
READ_OF_LOAD = {"load.json"}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Inputs, runs in folders that no command is given, and a study."""
    folder = tmp_path_factory.mktemp("fuzzed")
    heavy = ARM_TOML.replace('name = "q', 'mass_kg = 5\nname = "q')
    study = (
        STUDY.replace('"O1", "random"', '"random"').replace("[12, 20]", "[12]").replace('["none", "soft"]', '["none"]')
    )
    texts = {"arm.toml": heavy, "tracker.toml": TRACKER, "study.toml": f'robot = "arm.toml"\n{study}'}
    for name, text in texts.items():
        (folder / name).write_text(text)
    soft = "--stiffness-nm-per-rad 1e5 --payload-kg 0,3 --model compliance"
    made = f"calibrate --robot arm.toml --poses 14 --instrument tracker.toml {soft}"
    with pytest.MonkeyPatch.context() as patch, nothing_drawn():
        patch.chdir(folder)
        patch.setattr("lab.studies.study.local_executor", lambda _: ThreadPoolExecutor(1))
        for seed, name in enumerate(("base/run", "other")):
            assert run(f"{made} --seed {seed} --date 2026-01-0{1 + seed} --out {name}") == 0
        assert run("study study.toml --workers 1 --out base/study") == 0
    (folder / "base" / "payload").mkdir()
    (folder / "base" / "payload" / "load.json").write_text(LOAD)
    (folder / "base" / "payload" / "SHA256SUMS").write_text(checksum_lines(folder / "base" / "payload"))
    shutil.copy(folder / "other" / "measurements.csv", folder / "day.csv")
    return folder


def keys(content: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The way to every value."""
    yield at
    named = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in named:
        yield from keys(value, (*at, key))


def edited_json(text: str, chance: random.Random) -> str:
    """One value left out, or another; keys that differ in their places in lists are equally likely together."""
    content, alike = json.loads(text), defaultdict(list)
    for way in keys(content):
        alike[str([key if isinstance(key, str) else "" for key in way])].append(way)
    way = chance.choice(alike[chance.choice(sorted(alike))])
    if not way:
        return json.dumps(chance.choice(VALUES))
    inside = content
    for key in way[:-1]:
        inside = inside[key]
    old, kind = inside[way[-1]], chance.randrange(10)
    if kind == 0:
        del inside[way[-1]]
    elif kind < 3 and isinstance(old, int | float) and not isinstance(old, bool):
        inside[way[-1]] = chance.choice([2 * old + 1, -old - 1, 1.0001 * old + 1e-9])
    else:
        inside[way[-1]] = chance.choice([value for value in VALUES if value != old])
    return json.dumps(content)


def edited(path: Path, chance: random.Random) -> str:
    """The text of a file with one thing changed."""
    lines = path.read_text().splitlines()
    if path.suffix == ".json":
        return edited_json(path.read_text(), chance)
    at = chance.randrange(len(lines))
    if path.suffix == ".csv":
        cells = lines[at].split(",")
        column = chance.randrange(len(cells))
        cells[column] = chance.choice([cell for cell in CELLS if cell != cells[column]])
        lines[at] = ",".join(cells)
    elif path.suffix == ".toml":
        at = chance.choice([i for i, line in enumerate(lines) if "=" in line])
        lines[at] = f"{lines[at].split('=')[0]}= {chance.choice(SETTINGS)}"
    else:
        at = chance.choice([i for i, line in enumerate(lines) if line.partition("  ")[2] not in NOT_READ])
        lines[at] = chance.choice(["", "x", lines[at][::-1]])
    return "\n".join(lines) + "\n"


def changed_files(name: str, folder: Path) -> list[Path]:
    """Those that the command reads."""
    if name == "calibrate":
        return [folder / "config.json", *sorted((folder / "inputs").iterdir())]
    found = [path for path in sorted(folder.rglob("*")) if path.suffix in (".json", ".csv", ".toml")]
    found = [path for path in found if path.name not in NOT_READ]
    if name == "calibrate with a load":
        return [path for path in found if path.name in READ_OF_LOAD]
    return found if name == "study" else [*found, folder / "SHA256SUMS"]


def wrong_with(name: str, seed: int, place: Path, capfd: pytest.CaptureFixture[str]) -> str | None:
    """What was wrong with how a command ended that was given a changed run, if anything."""
    chance, folder = random.Random(f"{name} {seed}"), place / "changed"
    shutil.copytree(place / "base" / {"calibrate with a load": "payload", "study": "study"}.get(name, "run"), folder)
    accepted = (
        name in ("certify", "verify", "compensate", "history", "history of a folder") and chance.randrange(2) == 0
    )
    argv = f"{COMMANDS[name]} --json" + (" --accept-edited" if accepted else "")
    argv += f" --out {'changed' if name == 'study' else 'built'}"
    path = chance.choice([each for each in changed_files(name, folder) if each.exists()])
    path.write_text(edited(path, chance))
    try:
        with nothing_drawn(), np.errstate(all="ignore"), ends():
            code = run(argv)
    finally:
        shutil.rmtree(folder)
        shutil.rmtree(place / "built", ignore_errors=True)
    err = capfd.readouterr().err
    told = [line for line in err.splitlines() if not line.startswith("lab: warning: ")]
    if code == 2 and len(told) == 1 and told[0].startswith("lab: "):
        return None
    said = "changed since the run was written: the edited files are used" in err or "checksums are missing" in err
    said = said or (name == "history of a folder" and "left out" in err)
    if code in (0, 1) and (said or name in ("calibrate", "calibrate with a load", "study")):
        return None
    return f"{seed}: {path.name}, code {code}, {told[:2]}"


@pytest.fixture
def quick(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Few draws of a budget, robots that are built once, studies in this process, and pages that are not laid out."""
    monkeypatch.chdir(place)
    monkeypatch.setattr("lab.certification.budget._DRAWS", 10)
    monkeypatch.setattr("lab.robots.robot_files.is_own", lambda _: True)
    monkeypatch.setattr("lab.report.page.to_html", lambda _: "")
    monkeypatch.setattr("lab.studies.study.local_executor", lambda _: ThreadPoolExecutor(1))


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("name", COMMANDS)
def test_a_run_with_one_value_changed_is_told(name: str, place: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert [said for seed in range(2) if (said := wrong_with(name, seed, place, capfd))] == []


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("name", COMMANDS)
def test_runs_with_many_values_changed_are_told(name: str, place: Path, capfd: pytest.CaptureFixture[str]) -> None:
    most = int(os.environ.get("LAB_FUZZ", "400"))
    assert [said for seed in range(12, 12 + most) if (said := wrong_with(name, seed, place, capfd))] == []
