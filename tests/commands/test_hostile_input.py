"""Hostile and mistaken input by class, to every command that takes it: one line, exit code 2, and nothing left behind.

A case is a class of mistakes times the commands that read such a file or option; no page is drawn, as nothing is done.
"""

import itertools
import os
import re
from pathlib import Path

import pytest
from helpers.bad_input import ARM_TOML, ARM_URDF, ARM_XML, csv, run, swapped, the_line
from helpers.drawing import nothing_drawn

import lab

HEADER, *ROWS = csv().splitlines()
BIG = "9" * 400

# What reads a file of each kind: {} stands for it
MEASUREMENTS = (
    "identify {} --robot arm.toml --out never",
    "identify good.csv --robot arm.toml --validate {} --out never",
    "calibrate --robot arm.toml --plan {} --out never",
    "design --robot arm.toml --extend {} --out never",
    "payload {} --robot arm.toml --out never",
    "predict run {} --out never",
    "verify run {} --observe socket --out never",
)
ROBOTS = (
    "inspect {}",
    "identify good.csv --robot {} --out never",
    "calibrate --robot {} --out never",
    "design --robot {} --out never",
    "payload good.csv --robot {} --out never",
)
STUDIES = ("study {} --workers 1 --out never", "study {} --workers 1 --resume --out never")
RUNS = (
    "verify {} good.csv --out never",
    "verify {} good.csv --observe socket --out never",
    "predict {} good.csv --out never",
    "compensate good.csv --run {} --out never",
    "payload good.csv --run {} --out never",
    "identify good.csv --robot arm.toml --load {} --out never",
    "calibrate --robot arm.toml --load {} --out never",
)
PATHS = ("trajectory {} --robot arm.toml --out never", "kinematics arm.toml --file {} --out never")
MOTIONS = (
    "dynamics {} --robot arm.toml --out never",
    "dynamics motion.csv --robot arm.toml --validate {} --out never",
)
EXPORTS = (
    "import {} --joints good.csv --robot arm.toml --out never",
    "import good.csv --joints {} --robot arm.toml --out never",
)
PROGRAMS = tuple(
    f"compensate --program {{}} --run run --controller {language} --out never"
    for language in ("rapid", "krl", "urscript", "fanuc", "val3", "jbi")
)
TARGETS = ("compensate {} --run run --no-check --out never",)
PLANS = ("design --check {} --robot arm.toml --out never",)
TOMLS = (
    "dynamics motion.csv --robot arm.toml --drives {} --out never",
    "dynamics motion.csv --robot arm.toml --sensor {} --out never",
    "dynamics motion.csv --robot arm.toml --load {} --out never",
    "import good.csv --joints good.csv --robot arm.toml --columns {} --out never",
    "certify run --details {} --out never",
    "certify run --instrument {} --out never",
    "calibrate --robot arm.toml --instrument {} --out never",
    "inspect arm.toml --cell {}",
    "design --robot arm.toml --cell {} --out never",
)
FOLDERS = (
    "certify {} --out never",
    "history {} --out never",
    "history run {} --out never",
    "history {} run --out never",
    "next {} --out never",
)
CONFIGS = tuple(f"{name} --config {{}} --out never" for name in ("calibrate", "design"))

NO_TEXT: dict[str, bytes] = {
    "empty": b"",
    "blank": b"\n\n \n",
    "binary": bytes(range(256)) * 8,
    "UTF-16": HEADER.encode("utf-16"),
    "NUL": b"\0" * 1000,
    "an image": b"\x89PNG\r\n\x1a\n" + bytes(100),
    "a long line": b"a" * 2_000_000,
}
TABLES: dict[str, str] = {
    "a comment before the header": "# my day\n" + csv(),
    "3,000 columns": ",".join(f"c{i}" for i in range(3000)) + "\n" + ",".join(["1"] * 3000) + "\n",
    "a quote that is left open": csv().replace(ROWS[3], '"' + ROWS[3], 1),
    "300 targets": ",".join(["q1_deg,q2_deg,rail_mm", *(f"t{i}_{a}_mm" for i in range(300) for a in "xyz")]) + "\n1,2,3"
    + ",1" * 900 + "\n",
    "a target with a slash": csv().replace("p1_", "a/b_"),
    "a target with a dot": csv().replace("p1_", "a.b_"),
    "a target that is a formula": csv().replace("p1_", "=cmd_"),
    "a target of 10,000 characters": csv().replace("p1_", "n" * 10_000 + "_"),
    "a number of 400 digits": csv().replace(ROWS[2].split(",")[0], BIG),
    "NaN": csv().replace(ROWS[2].split(",")[0], "NaN"),
    "an infinite number": csv().replace(ROWS[2].split(",")[0], "-inf"),
    "arabic digits": csv().replace(ROWS[2].split(",")[0], "٣"),
    "a formula": csv().replace(ROWS[2].split(",")[0], "=1+1"),
    "two headers": HEADER + "\n" + csv(),
    "a header alone": HEADER + "\n",
    "JSON": '{"joints": [1, 2]}',
}  # fmt: skip
TOML_TEXTS: dict[str, str] = {
    "deep lists": "x = " + "[" * 5000,
    "deep tables": "x = " + "{a=" * 5000,
    "lists that end": "x = " + "[" * 60 + "]" * 60,
    "20,000 dotted names": ".".join(["a"] * 20_000) + " = 1",
    "20,000 dotted in quotes": ".".join(['"a"'] * 20_000) + " = 1",
    "a table of 20,000 names": "[" + ".".join(["a"] * 20_000) + "]",
    "400 digits": f"seed = {BIG}",
    "5,000 digits": "seed = " + "9" * 5000,
    "2 MiB": "# " + "x" * (2 << 20),
    "doubled keys": "name = 'a'\nname = 'b'",
    "no TOML": "<robot/>",
}
TOML_ROBOTS: dict[str, str] = {
    "300 joints": 'convention = "distal"\n' + "[[joint]]\ntheta_deg=0\nd_mm=1\na_mm=1\nalpha_deg=0\n" * 300,
    "300 targets": ARM_TOML + "[tool]\n" + "".join(f"t{i} = [0, 0, 0.1]\n" for i in range(300)),
    "a target with a slash": ARM_TOML + '[tool]\n"a/b" = [0, 0, 0.1]\n',
    "a target with a dot": ARM_TOML + '[tool]\n"a.b" = [0, 0, 0.1]\n',
    "a joint with a comma": swapped(ARM_TOML, '"q2"', '"q,2"'),
    "a joint of 10,000 characters": swapped(ARM_TOML, '"q2"', '"' + "q" * 10_000 + '"'),
    "a length of NaN": swapped(ARM_TOML, "a_mm = 270", "a_mm = nan"),
    "a length of 1e300": swapped(ARM_TOML, "a_mm = 270", "a_mm = 1e300"),
    "a length that is true": swapped(ARM_TOML, "a_mm = 270", "a_mm = true"),
    "a length that is text": swapped(ARM_TOML, "a_mm = 270", 'a_mm = "270"'),
    "a length that is a date": swapped(ARM_TOML, "a_mm = 270", "a_mm = 2026-01-01"),
    "an infinite limit": swapped(ARM_TOML, "upper_deg = 100", "upper_deg = inf"),
    "joint as a table": 'convention = "distal"\njoint = {a = 1}',
    "joint as numbers": 'convention = "distal"\njoint = [1, 2]',
}
STUDY = 'name = "s"\nrobots = 1\ndraws = 1\nfresh = 5\n[factors]\ncriterion = "random"\nposes = 12\n'
THREE = ("noise", "position_sigma_mm", "rotation_sigma_mrad")
STUDY_TEXTS: dict[str, str] = {
    "frozen is no text": 'frozen = "no"\n' + STUDY,
    "robots is no truth": STUDY.replace("robots = 1", "robots = true"),
    "robots is no fraction": STUDY.replace("robots = 1", "robots = 1.5"),
    "1e12 draws": STUDY.replace("draws = 1", "draws = 1000000000000"),
    "1e41 robots": STUDY.replace("robots = 1", "robots = 1" + "0" * 17),
    "1e9 poses": STUDY.replace("poses = 12", "poses = 1000000000"),
    "1e9 cells": STUDY + "".join(f"{name} = {list(range(1, 1001))}\n" for name in THREE),
    "a misspelt target": 'targets = ["p9"]\n' + STUDY,
    "targets as text": 'targets = "p1"\n' + STUDY,
    "a misspelt criterion": STUDY.replace('"random"', '"O9"'),
    "a misspelt instrument": STUDY + 'instrument = "leica"\n',
    "a misspelt factor": STUDY + "pose = 3\n",
    "a misspelt robot": 'robot = "irb1200"\n' + STUDY,
    "a misspelt parameter": STUDY + 'parameters = "few"\n[parameters.few]\nfix = ["link9.*"]\n',
    "an undefined effect": STUDY + 'effects = "soft"\n',
    "an effect of NaN": STUDY + 'effects = "soft"\n[effects.soft]\ngear_ppm = nan\n',
    "a noise of NaN": STUDY + "noise = nan\n",
    "an infinite noise": STUDY + "noise = inf\n",
    "a negative seed": "seed = -1\n" + STUDY,
    "a name that leads away": STUDY.replace('"s"', '"../s"'),
    "factors as a list": 'name = "s"\nfactors = [1, 2]\n',
    "a factor as a table": 'name = "s"\n[factors]\nposes = {a = 1}\n',
    "a factor without values": STUDY.replace("poses = 12", "poses = []"),
    "too few poses": STUDY.replace("poses = 12", "poses = 2"),
}  # fmt: skip


def asset(text: str) -> str:
    return swapped(ARM_XML, "<worldbody>", f"<asset>{text}</asset><worldbody>")


MODELS: dict[str, str] = {
    "deep elements": "<mujoco>" + "<body>" * 3000 + "</body>" * 3000 + "</mujoco>",
    "no XML": "<mujoco><worldbody>",
    "another XML": "<html><body>hello</body></html>",
    "entities": '<!DOCTYPE a [<!ENTITY x "' + "y" * 1000 + '"><!ENTITY z "&x;&x;&x;">]><mujoco>&z;</mujoco>',
    "NaN": swapped(ARM_XML, 'pos="0.1 0 0.3"', 'pos="nan 0 0.3"'),
    "a huge texture": asset('<texture name="t" width="99999" height="99999"/>'),
    "a huge height field": asset('<hfield name="t" nrow="99999" ncol="99999" size="1 1 1 1"/>'),
    "itself included": swapped(ARM_XML, "<worldbody>", '<include file="hostile.xml"/><worldbody>'),
    "many copies": swapped(ARM_XML, "<worldbody>", '<worldbody><replicate count="100000000"><body/></replicate>'),
}  # fmt: skip
URDFS: dict[str, str] = {
    "an infinite limit": swapped(ARM_URDF, 'upper="2"', 'upper="inf"'),
    "a loop of links": swapped(ARM_URDF, '<parent link="base"/>', '<parent link="l2"/>'),
    "a link that is missing": swapped(ARM_URDF, '<child link="l2"/>', '<child link="l9"/>'),
    "two joints of one name": swapped(ARM_URDF, 'name="q2"', 'name="q1"'),
}
JSON_TEXTS: dict[str, str] = {
    "deep": "[" * 100_000,
    "deep that ends": "[" * 60 + "]" * 60,
    "400 digits": '{"command": "calibrate", "options": {"seed": ' + BIG + "}}",
    "NaN": '{"command": "calibrate", "options": {"gate_mm": NaN}}',
    "an infinite number": '{"command": "calibrate", "options": {"gate_mm": 1e999}}',
    "a list": "[]",
    "a text": '"options"',
    "options as a list": '{"options": [1]}',
    "an unknown option": '{"options": {"pose": 3}}',
    "a text for a number": '{"options": {"seed": "7"}}',
}
SPECIAL = ("/dev/zero", "/dev/stdin", "pipe", "folder", "loop", "missing", "dangling", "arm.toml/x", "n" * 300)
OPTIONS = (
    "calibrate --poses 1000000000",
    "calibrate --poses 0",
    "calibrate --poses -5",
    "calibrate --readings 1000000000000000000",
    "calibrate --seed -1",
    f"calibrate --seed {BIG}",
    "calibrate --gate-mm nan",
    "calibrate --gate-mm inf",
    "calibrate --gate-mm 0",
    "calibrate --noise-mm -1",
    "calibrate --noise-mm nan",
    "calibrate --position-sigma-mm inf",
    "calibrate --rotation-sigma-mrad nan",
    "calibrate --offset-sigma-mrad -1",
    "calibrate --targets p9",
    "calibrate --targets '../p1'",
    "calibrate --instrument leica",
    "calibrate --model geometric+geometric",
    "calibrate --model x",
    "calibrate --fix zz",
    "calibrate --gear-ppm nan",
    "calibrate --stiffness-nm-per-rad 0",
    "calibrate --payload-kg -1",
    "calibrate --hours inf",
    "calibrate --tolerance-mm 0",
    "design --candidates 1000000000",
    "design --candidates 0",
    "design --starts 1000000000",
    "design --starts 0",
    "design --poses 1000000000",
    "design --poses 10 --accuracy-mm 1",
    "design --accuracy-mm inf",
    "design --accuracy-mm nan",
    "design --accuracy-mm -1",
    "design --criterion O9",
    "design --scaling x",
    "design --home 1,nan,3",
    "design --home 1",
    "design --instrument exact",
    "design --targets p9",
    "design --payload-kg nan",
    "design --payload-kg 0,2",
    "design --model auto",
    "design --model x",
    "design --region measured",
    "design --region none.csv",
)


def of(files: dict[str, str], name: str, commands: tuple[str, ...]) -> list[tuple[str, str, bytes]]:
    return [
        (f"{case}: {command.format(name)}", command.format(name), text.encode())
        for (case, text), command in itertools.product(files.items(), commands)
    ]


def binary(name: str, commands: tuple[str, ...]) -> list[tuple[str, str, bytes]]:
    return [
        (f"{case}: {command.format(name)}", command.format(name), content)
        for (case, content), command in itertools.product(NO_TEXT.items(), commands)
    ]


JOINT_ROW, POINT_ROW = "1,2,3\n", "300,10,400\n"
LONG: dict[str, str] = {
    "11,000 joint rows": "q1_deg,q2_deg,rail_mm\n" + JOINT_ROW * 11_000,
    "11,000 points": "x_mm,y_mm,z_mm\n" + POINT_ROW * 11_000,
}
WORK_BY_ROWS = (  # whose work for a row is so much that few rows are taken
    *PATHS,
    *PLANS,
    "design --robot arm.toml --extend {} --out never",
    "calibrate --robot arm.toml --plan {} --out never",
)
COMMAND_LINES = (
    "kinematics arm.toml --joints 1,2",
    "kinematics arm.toml --joints 1,nan,3",
    "kinematics arm.toml --joints 1,2,1e300",
    "kinematics arm.toml --pose 1,2",
    "kinematics arm.toml --pose inf,0,0",
    "kinematics arm.toml --pose 1,2,3,0,0,0,0",
    "kinematics arm.toml --joints 1,2,3 --rates 1,2,3 --twist 1,2,3,4,5,6",
    "kinematics arm.toml --joints 1,2,3 --twist 1,2",
    "kinematics arm.toml --joints 1,2,3 --of elbow+",
    "kinematics arm.toml --joints 1,2,3 --between 0 99",
    "kinematics arm.toml --joints 1,2,3 --between -1 2",
    "kinematics arm.toml --joints 1,2,3 --tool-mm 1",
    "kinematics arm.toml --joints 1,2,3 --tool-mm nan,0,0",
    "kinematics arm.toml --pose 1e15,0,0",
    "trajectory moves.csv --robot arm.toml --step-ms 0",
    "trajectory moves.csv --robot arm.toml --step-ms 1e-9",
    "trajectory moves.csv --robot arm.toml --speeds 1e-12",
    "trajectory moves.csv --robot arm.toml --speeds 0",
    "trajectory moves.csv --robot arm.toml --controller rapids",
    "trajectory moves.csv --robot arm.toml --speeds nan",
    "trajectory moves.csv --robot arm.toml --accelerations 1,2",
    "trajectory moves.csv --robot arm.toml --blend-deg inf",
    "trajectory moves.csv --robot arm.toml --feed-mm-s -1",
    "trajectory moves.csv --robot arm.toml --tool-mm 1,2",
    "dynamics motion.csv --robot arm.toml --holdout 0.9",
    "dynamics motion.csv --robot arm.toml --holdout nan",
    "dynamics motion.csv --robot arm.toml --band-hz 0",
    "dynamics motion.csv --robot arm.toml --band-hz 1e9",
    "dynamics motion.csv --robot arm.toml --band-hz 51",
    "dynamics motion.csv --robot arm.toml --without links",
    "dynamics --robot arm.toml --delay",
    "dynamics motion.csv --robot arm.toml --simulate",
    "payload --simulate --filter-hz 1e-18",
    "import good.csv --joints good.csv --robot arm.toml --coverage 0",
    "import good.csv --joints good.csv --robot arm.toml --targets p1,p1",
    "import good.csv --joints good.csv --robot arm.toml --targets a/b",
    "import good.csv --joints good.csv --robot arm.toml --by time",
    "import good.csv --joints good.csv --robot arm.toml --clock-offset-s nan",
    "import good.csv --joints good.csv --robot arm.toml --settled-s inf",
    "certify run --tolerance-mm 0",
    "certify run --tolerance-mm nan",
    "certify run --statistic median",
    "history . --kept link1",
    "history . --every-days 0",
    "history . --on yesterday",
    "verify run good.csv --date yesterday",
    "verify run good.csv --since yesterday",
    "verify run good.csv --reference 1",
    "compensate good.csv --program good.csv --run run",
    "compensate --run run",
    "compensate good.csv --run run --digits 3",
    "compensate --program moves.mod --run run --digits 99",
    "compensate --program moves.mod --run run --frames tool=1,2",
    "compensate --program moves.mod --run run --pulses-per-deg 1,2",
    "trajectory moves.csv --robot arm.toml --speeds 1e300",
    "trajectory moves.csv --robot arm.toml --payload-kg 1e300",
    "workspace arm.toml --places 99",
    "workspace arm.toml --places 100000000",
    "workspace arm.toml --orientations 0",
    "workspace arm.toml --seed -1",
    "workspace arm.toml --level-mm nan",
    "workspace arm.toml --tool-mm 1,2",
    "workspace arm.toml arm.xml --cell folder",
    "workspace nowhere",
    "kinematics arm.toml --frame 9",
    "kinematics arm.toml --frame -1",
    "kinematics arm.toml --frame link2",
    "example nowhere",
    "example",
    "kinematics --angles 1,2",
    "kinematics --angles 1,2,nan",
    "kinematics --angles 1,2,3 --quaternion 1,0,0,0",
    "kinematics --angles 1,2,3 --order zzx",
    "kinematics --quaternion 0,0,0,0",
    "kinematics --axis 0,0,0 --angle 1",
    "kinematics --axis 0,0,1",
    "kinematics --axis 0,0,1 --angle 1e300",
    "kinematics --matrix 1,0,0,0,1,0,0,0,-1",
    "kinematics --matrix 1,2,3,4,5,6,7,8,9",
    "reproduce elastic --item 99.9",
)  # fmt: skip


CASES = [
    *binary("hostile.csv", MEASUREMENTS),
    *binary("hostile.toml", (*ROBOTS, *STUDIES)),
    *binary("hostile.xml", ROBOTS),
    *binary("hostile.urdf", ROBOTS[:2]),
    *binary("hostile.json", CONFIGS),
    *of(TABLES, "hostile.csv", MEASUREMENTS),
    *of(TOML_TEXTS, "hostile.toml", (*ROBOTS, *STUDIES)),
    *of(TOML_ROBOTS, "hostile.toml", ROBOTS),
    *of(STUDY_TEXTS, "hostile.toml", STUDIES[:1]),
    *of(MODELS, "hostile.xml", ROBOTS),
    *of(URDFS, "hostile.urdf", ROBOTS),
    *of(JSON_TEXTS, "hostile.json", CONFIGS),
    *binary("hostile.csv", (*PATHS, *MOTIONS, *EXPORTS, *TARGETS, *PLANS)),
    *binary("hostile.txt", PROGRAMS),
    *binary("hostile.toml", TOMLS),
    *of(TABLES, "hostile.csv", (*PATHS, *MOTIONS, *EXPORTS[:1], *TARGETS)),
    *of(LONG, "hostile.csv", WORK_BY_ROWS),
    *of(TOML_TEXTS, "hostile.toml", TOMLS),
    *((f"{each}: {command}", command.format(each), b"") for each in SPECIAL for command in
      (*MEASUREMENTS, *ROBOTS, *STUDIES, *RUNS, *CONFIGS, *PATHS, *MOTIONS, *EXPORTS, *PROGRAMS, *TARGETS, *PLANS,
       *TOMLS, *FOLDERS)),
    *((each, f"{each} --out never", b"") for each in COMMAND_LINES),
    *((each, f"{each} --robot arm.toml --out never", b"") for each in OPTIONS),
]  # fmt: skip

PARTS = 32  # of which the first runs with every change, and all with -m slow


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One working folder for all cases: each leaves it as it was."""
    folder = tmp_path_factory.mktemp("hostile")
    for name, text in {"arm.toml": ARM_TOML, "arm.xml": ARM_XML, "arm.urdf": ARM_URDF, "good.csv": csv()}.items():
        (folder / name).write_text(text)
    header = "time_s,q1_deg,q2_deg,rail_mm,tau1_nm,tau2_nm,f3_n\n"
    rows = "".join(f"{0.01 * i:.2f},{i % 40},{i % 30},{i % 20},1,2,3\n" for i in range(200))
    (folder / "motion.csv").write_text(header + rows)
    (folder / "moves.csv").write_text("q1_deg,q2_deg,rail_mm\n0,0,10\n10,20,30\n")
    (folder / "moves.mod").write_text("MODULE a\nPROC main()\nENDPROC\nENDMODULE\n")
    with nothing_drawn():
        lab.calibrate("irb120", poses=20, seed=1, gate_mm=1).save(folder / "run")
    os.mkfifo(folder / "pipe")
    (folder / "folder").mkdir()
    (folder / "loop").symlink_to("loop")
    (folder / "dangling").symlink_to("nowhere")
    return folder


def refused(name: str, argv: str, content: bytes, folder: Path, capfd: pytest.CaptureFixture[str]) -> str | None:
    """What was wrong with how a case ended."""
    words = argv.split()
    file = next((folder / word for word in words if word.startswith("hostile.")), None)
    if file is not None:
        file.write_bytes(content)
    before = sorted(path.name for path in folder.iterdir())
    code = run(argv)
    out, err = capfd.readouterr()
    after = sorted(path.name for path in folder.iterdir())
    if file is not None:
        file.unlink()
    lines = [line for line in err.splitlines() if not line.startswith("lab: warning: ")]
    good = code == 2 and not out and len(lines) == 1 and the_line(err) and after == before
    return None if good else f"{name[:100]}: code {code}, {out[:40]!r}, {err[:200]!r}, {set(after) ^ set(before)}"


@pytest.mark.thorough
def test_more_rows_than_a_work_can_take_are_refused_before_it(
    place: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(place)
    (place / "long.csv").write_text(LONG["11,000 joint rows"])
    for command in WORK_BY_ROWS:
        assert run(command.format("long.csv")) == 2
        assert re.search(r"11,000 [^;]+ are too many; give at most (2|10),000", the_line(capfd.readouterr().err))
    (place / "long.csv").unlink()


@pytest.mark.parametrize("part", [0, *(pytest.param(part, marks=pytest.mark.slow) for part in range(1, PARTS))])
def test_each_is_told_in_one_line(
    part: int, place: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(place)
    wrong = [refused(*case, place, capfd) for case in CASES[part::PARTS]]
    assert [each for each in wrong if each] == []
