"""Bad input to ``lab calibrate``: one line that names the place and the mend, exit code 2, and no half-written run."""

import errno
import json
from pathlib import Path

import pytest
from helpers.bad_input import (
    ARM_URDF,
    INERTIA,
    Case,
    assert_told_in_one_line,
    contents,
    run,
    the_line,
    write,
)

from lab.robots.load_robot import load_robot, load_virtual

pytestmark = pytest.mark.usefixtures("folder")

CALIBRATE = "calibrate --robot arm.xml --poses 12"


def plan(*poses: tuple[float, float, float]) -> str:
    return "q1_deg,q2_deg,q3_deg\n" + "".join(",".join(map(str, pose)) + "\n" for pose in poses)


def planned(name: str, text: str, *says: str) -> Case:
    return Case(f"plan: {name}", f"{CALIBRATE} --plan p.csv", ("p.csv", *says), {"p.csv": text})


def configured(name: str, text: str, *says: str) -> Case:
    return Case(f"config: {name}", f"{CALIBRATE} --config c.json", ("c.json", *says), {"c.json": text})


OPTIONS = [
    Case("option: no poses", f"{CALIBRATE} --poses 0", ("--poses 0", "1 or more")),
    Case("option: negative poses", f"{CALIBRATE} --poses -3", ("--poses -3", "1 or more")),
    Case("option: too few poses", f"{CALIBRATE} --poses 3", ("--poses 3", "need at least 5", "measure more")),
    Case("option: one pose", f"{CALIBRATE} --poses 1", ("--poses 1", "at least 5 poses")),
    Case("option: no readings", f"{CALIBRATE} --readings 0", ("--readings 0", "1 or more")),
    Case("option: negative seed", f"{CALIBRATE} --seed -1", ("--seed -1", "0 or more")),
    Case("option: negative sigma", f"{CALIBRATE} --position-sigma-mm -1", ("--position-sigma-mm -1", "0 to")),
    Case("option: sigma NaN", f"{CALIBRATE} --rotation-sigma-mrad nan", ("--rotation-sigma-mrad nan", "0 to")),
    Case("option: sigma absurd", f"{CALIBRATE} --position-sigma-mm 1e300", ("--position-sigma-mm", "0 to")),
    Case("option: noise zero", f"{CALIBRATE} --noise-mm 0", ("--noise-mm 0", "above zero")),
    Case("option: gate NaN", f"{CALIBRATE} --gate-mm nan", ("--gate-mm nan", "above zero")),
    Case("option: unknown target", f"{CALIBRATE} --targets p9", ("'p9'", "p1, p2, p3")),
    Case("option: target doubled", f"{CALIBRATE} --targets p1,p1", ("targets p1, p1", "each once")),
    Case(
        "option: unknown instrument", f"{CALIBRATE} --instrument ruler", ("--instrument ruler", "exact", "leica-at960")
    ),
    Case("out: is a file", f"{CALIBRATE} --out good.csv", ("good.csv", "is a file", "--out")),
    Case("out: below a file", f"{CALIBRATE} --out good.csv/run", ("good.csv/run", "cannot be written", "--out")),
    Case("out: holds other files", f"{CALIBRATE} --out mine", ("mine", "photo.jpg", "--out"), {"mine/photo.jpg": ""}),
    Case("out: the working folder", f"{CALIBRATE} --out .", ("working folder", "--out")),
    Case(
        "out: a config of something else",
        f"{CALIBRATE} --out mine",
        ("mine", "not of a run", "--out"),
        {"mine/config.json": "{}"},
    ),
    Case(
        "out: a run with a note in it",
        f"{CALIBRATE} --out mine",
        ("mine", "holds note.txt", "--out"),
        {"mine/config.json": '{"model_sha256": ""}', "mine/note.txt": ""},
    ),
]

FITTING = [
    Case("model: unknown", f"{CALIBRATE} --model sag", ("--model sag", "compliance, payload, harmonics")),
    Case("model: empty", f"{CALIBRATE} --model ''", ("--model", "geometric, auto")),
    Case("model: twice", f"{CALIBRATE} --model gear+gear", ("--model gear+gear", "different groups")),
    Case("model: auto beside a group", f"{CALIBRATE} --model auto+gear", ("--model auto", "no such group")),
    Case("model: both compliances", f"{CALIBRATE} --model compliance+payload", ("compliance+payload", "choose one")),
    Case("effects: lag", f"{CALIBRATE} --lag 1", ("--lag", "below 1")),
    Case("effects: negative", f"{CALIBRATE} --harmonic-mrad -1", ("--harmonic-mrad -1", "from 0")),
    Case("effects: no stiffness", f"{CALIBRATE} --stiffness-nm-per-rad 0", ("--stiffness-nm-per-rad", "above zero")),
    Case("effects: half a range", f"{CALIBRATE} --bad-mm 5", ("--bad-mm", "least and the largest")),
    Case("effects: payload in words", f"{CALIBRATE} --payload-kg heavy", ("--payload-kg", "not a number")),
    Case("config: missing", f"{CALIBRATE} --config gone.json", ("gone.json", "config.json")),
    Case("config: no file named", f"{CALIBRATE} --config", ("--config", "config.json")),
    configured("not JSON", "poses: 3", "not JSON"),
    configured("a list", "[]", "is to be a group of options"),
    configured("of another command", '{"schema": 1, "command": "identify", "options": {}}', "lab identify"),
    configured("unknown option", '{"schema": 1, "options": {"pose": 12}}', "'pose'", "poses"),
    configured("wrong kind", '{"schema": 1, "options": {"poses": "many"}}', "'many'", "poses"),
    configured("wrong group", '{"schema": 1, "options": {"effects": 3}}', "'effects'"),
    configured(
        "a truth in a list", '{"schema": 1, "options": {"effects": {"payload_kg": [true]}}}', "[True]", "payload_kg'"
    ),
    configured("a number among names", '{"schema": 1, "options": {"targets": ["p1", 1]}}', "'targets'"),
]

PLANS = [
    planned("out of limits", plan((10, 10, 10), (10, 10, 171)), "line 3", "joint q3", "beyond its limits", "mend"),
    planned("degrees called radians", plan((1, 1, 10)).replace("deg", "rad"), "line 2", "q3", "572.958°", "unit"),
    planned("colliding", plan((10, 10, 10), (0, 108, 0)), "line 3", "collides", "take it out"),
    planned("empty", "", "empty", "header"),
    planned("no pose", "q1_deg,q2_deg,q3_deg\n", "no rows", "below the header"),
    planned("a joint missing", "q1_deg,q2_deg\n1,2\n", "line 1", "q3", "q3_deg"),
    planned("a word", plan((1, 2, 3)).replace("3\n", "three\n").replace("qthree", "q3"), "line 2", "'three'"),
    planned("two poses", plan((1, 2, 3), (30, 20, 10)), "2 measured points", "at least 5 poses"),
    planned("too few poses", plan((1, 2, 3), (30, 20, 10), (-10, 5, 30)), "3 poses", "at least 5"),
]

CASES = [*OPTIONS, *FITTING, *PLANS]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_bad_input_is_told_in_one_line(case: Case, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert_told_in_one_line(case, folder, capfd)


def test_a_run_that_cannot_be_put_in_place_leaves_the_earlier_one(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run(f"{CALIBRATE} --out run") == 0
    before, rename = contents(folder), Path.rename

    def busy(path: Path, target: Path) -> Path:
        if ".partial-" in path.name:
            raise OSError(errno.EBUSY, "Device or resource busy")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", busy)
    capfd.readouterr()
    assert run(f"{CALIBRATE} --seed 5 --overwrite --out run") == 2
    assert "busy" in the_line(capfd.readouterr().err)
    assert contents(folder) == before


@pytest.mark.thorough
def test_an_earlier_run_is_replaced_only_where_that_is_said(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(f"{CALIBRATE} --out run") == 0
    before = contents(folder)
    capfd.readouterr()
    assert run(f"{CALIBRATE} --seed 1 --out run") == 2
    assert "--overwrite" in the_line(capfd.readouterr().err)
    assert contents(folder) == before
    assert run(f"{CALIBRATE} --seed 2 --out run --overwrite") == 0
    assert json.loads((folder / "run" / "config.json").read_text())["options"]["seed"] == 2
    assert {path.name for path in folder.iterdir() if path.is_dir()} == {"run"}


def test_an_empty_folder_may_become_the_run(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (folder / "run").mkdir()
    assert run(f"{CALIBRATE} --out run") == 0
    assert (folder / "run" / "result.json").is_file()


def test_a_run_without_out_gets_a_name_of_its_own(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert [run(CALIBRATE), run(CALIBRATE)] == [0, 0]
    assert {path.name for path in (folder / "runs").iterdir()} == {"calibrate-arm-seed0", "calibrate-arm-seed0-2"}


def test_a_urdf_of_axes_alone_becomes_a_virtual_arm(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write(folder, {"robot.urdf": ARM_URDF.replace(INERTIA, "")})
    assert run("calibrate --robot robot.urdf --poses 20 --json") == 0
    assert "drawn as rods and weigh what rods would" in capfd.readouterr().err
    assert load_robot("robot.urdf").loads is None  # measurements of a real arm are not explained by guessed masses
    loads = load_virtual("robot.urdf").loads
    assert loads is not None and (loads.mass_kg > 0.01).all()
