"""The published JSON Schemas, against what commands write; and the errors that programs read."""

import json
from hashlib import sha256
from pathlib import Path

import jsonschema
import pytest
from helpers.robots import ROOT

from lab.cli import main
from lab.commands.run_folder import SCHEMA, write_json

FILES = ("config", "parameters", "result")


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
        jsonschema.validate(part | {"migrated": True}, schema("result"))


def test_a_run_knows_its_inputs(runs: list[Path]) -> None:
    file = runs[0] / "measurements.csv"
    config = json.loads((runs[1] / "config.json").read_text())
    assert config["inputs_sha256"] == {str(file): sha256(file.read_bytes()).hexdigest()}


def test_programs_read_errors_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "nowhere.csv", "--json"]) == 2
    told = capsys.readouterr()
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
