"""The published JSON Schemas, against what commands write; and the errors that programs read."""

import json
import shutil
from collections.abc import Iterator
from dataclasses import fields
from hashlib import sha256
from pathlib import Path

import jsonschema
import pytest
from helpers.bad_input import run as run_line
from helpers.campaigns import own_copy
from helpers.robots import ROOT
from helpers.writing_commands import COMMANDS as EXAMPLES

import lab
from lab.cli.commands import all_commands, command_named
from lab.cli.main import main
from lab.library.run_folder import run_folder, write_json
from lab.robots.config_file import SCHEMA

FILES = ("config", "parameters", "result")
FILE_OF = {"calibrate": "result", "identify": "result", "certify": "certificate"}  # of other commands their name
MORE = {
    "verify": ("verify day few.csv --force --refit base --serial A-17 --date 2026-02-01 --noise-mm 0.01",),
    "design": ("design --check plan/plan.csv",),
    "inspect": ("inspect delta",),
    "example": ("example", "example panda --out examples"),
    "history": ("history broken", "history one/day"),
    "dynamics": ("dynamics --robot scara --symbolic",),
    "kinematics": ("kinematics scara --symbolic --symbolic-inverse --inverse-jacobian",),
    "study": ("study one.toml --workers 1 --out st",),
}
ONE_CAMPAIGN = 'name = "one"\nrobots = 1\ndraws = 1\nfresh = 20\n[factors]\nposes = [20]\n'
RECORDED = {"calibrate", "identify", "verify", "compensate", "design", "next", "trajectory"}


def schema(name: str) -> dict:
    return json.loads((ROOT / "docs" / "reference" / "schemas" / f"{name}.schema.json").read_text())


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> list[Path]:
    """A run of a virtual arm, and one of its measurements, which was not judged."""
    folder = tmp_path_factory.mktemp("runs")
    assert main(["calibrate", "--poses", "12", "--gate-mm", "1", "--out", str(folder / "virtual")]) == 0
    file = str(folder / "virtual" / "measurements.csv")
    assert main(["identify", file, "--noise-mm", "0.005", "--out", str(folder / "measured")]) == 0
    return [folder / "virtual", folder / "measured"]


@pytest.mark.thorough
def test_runs_hold_what_the_schemas_say(runs: list[Path]) -> None:
    for run in runs:
        for name in FILES:
            jsonschema.validate(json.loads((run / f"{name}.json").read_text()), schema(name))
        result, config = (json.loads((run / f"{name}.json").read_text()) for name in ("result", "config"))
        assert result["schema"] == config["schema"] == SCHEMA
        assert set(result) <= {*schema("result")["properties"], "stiffness_nm_per_rad", "stiffness_std_nm_per_rad"}
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(result | {"verdict": "splendid"}, schema("result"))
        part = {name: value for name, value in result.items() if name != "answers"}
        with pytest.raises(jsonschema.ValidationError, match="answers"):
            jsonschema.validate(part, schema("result"))


def test_a_run_knows_its_inputs(runs: list[Path]) -> None:
    file = runs[0] / "measurements.csv"
    config = json.loads((runs[1] / "config.json").read_text())
    assert config["inputs_sha256"] == {str(file): sha256(file.read_bytes()).hexdigest()}


def test_programs_read_errors_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "nowhere.csv", "--json"]) == 2
    told = capsys.readouterr()
    jsonschema.validate(json.loads(told.out), schema("error"))
    error = json.loads(told.out)["error"]
    assert error["exit_code"] == 2 and "nowhere.csv" in error["message"] and error["message"] in told.err
    assert main(["identify", "nowhere.csv"]) == 2
    assert capsys.readouterr().out == ""


def test_json_is_written_as_the_library_writes_it(tmp_path: Path) -> None:
    content = {
        "a": [1, 2.5, "x, y: [z]", None, True], "b": [], "c": {}, "d": [{"e": 1, "f": "é"}, {"g": [1, [2, (3, 4)]]}],
        "h": Path("p"), "i": {"j": {"k": 1e-300}, "l": (1, 2)},
    }  # fmt: skip
    write_json(tmp_path / "file.json", content)
    assert (tmp_path / "file.json").read_text() == json.dumps(content, indent=1, default=str) + "\n"


@pytest.fixture(scope="module")
def place(command_inputs: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A working folder with what the examples of all commands read."""
    folder = own_copy(command_inputs, tmp_path_factory.mktemp("examples") / "here")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        shutil.copytree("history/day", "one/day")
        shutil.copytree("history/day", "broken/day")
        (folder / "broken" / "day" / "result.json").write_text("{")
        (folder / "one.toml").write_text(ONE_CAMPAIGN)
        assert run_line("design --poses 10 --candidates 100 --starts 1 --out plan --no-recording") == 0
        yield folder


def examples() -> Iterator[tuple[str, str]]:
    """Every command with its arguments."""
    for name, line in EXAMPLES.items():
        yield name.split()[0], line
    for name, lines in MORE.items():
        yield from ((name, line) for line in lines)


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "line"), tuple(examples()))
def test_the_json_of_every_command_is_as_its_schema_says(
    place: Path, name: str, line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = line.split()
    out = tmp_path / "out"
    writes = command_named(name).folder or name in ("kinematics", "workspace", "history")
    arguments += ["--out", str(out)] if writes else []
    arguments += ["--no-recording"] if name in RECORDED else []
    capsys.readouterr()
    assert main([*arguments, "--json"]) in (0, 1)
    result, kind = json.loads(capsys.readouterr().out), schema(FILE_OF.get(name, name))
    jsonschema.validate(result, kind)
    assert set(result) <= set(kind["properties"])
    with pytest.raises(jsonschema.ValidationError):  # a key that is missing, or of another type
        jsonschema.validate({key: [None] for key in result}, kind)
    with pytest.raises(jsonschema.ValidationError, match="required"):
        jsonschema.validate({key: value for key, value in result.items() if key not in kind["required"][:1]}, kind)
    if writes:
        assert json.loads((out / "result.json").read_text()) == result
        assert not (out / "recording.rrd").exists()
        config = json.loads((out / "config.json").read_text())
        if config["model_sha256"]:
            jsonschema.validate(config, schema("config"))
        if name != "study":  # which goes on in its folder
            with run_folder(out, overwrite=True):  # every file is known as the run's own
                pass


def test_every_command_has_a_schema_and_every_recording_can_be_left_out() -> None:
    for command in all_commands():
        kind = schema(FILE_OF.get(command.name, command.name))
        jsonschema.Draft202012Validator.check_schema(kind)
        assert kind["required"] and kind["title"].partition("lab ")[2]
        names = {field.name for field in fields(command.load_options())}
        assert ("no_recording" in names) is (command.name in RECORDED), command.name


def test_a_recording_is_written_unless_it_is_left_out(tmp_path: Path) -> None:
    points = tmp_path / "points.csv"
    points.write_text("q1_deg,q2_deg\n0,-30\n90,0\n")
    result = lab.trajectory(points, robot="course2r")
    without = lab.trajectory(points, robot="course2r", no_recording=True)
    result.save(tmp_path / "with")
    without.save(tmp_path / "without")
    assert result.to_dict() == without.to_dict()
    names = {each: {path.name for path in (tmp_path / each).iterdir()} for each in ("with", "without")}
    assert names["with"] - names["without"] == {"recording.rrd"} and names["without"] < names["with"]
