"""``lab migrate`` on runs as an older lab wrote them: without schema, without checksums."""

import json
import shutil
from pathlib import Path

import jsonschema
import pytest
from helpers.robots import ROOT

from lab.commands.calibrate.load_run import load_run
from lab.commands.migrate import migrate
from lab.commands.options import MigrateOptions
from lab.core.errors import LabError


@pytest.fixture
def old(seven_run: Path, tmp_path: Path) -> Path:
    """A run without what came with the schema: its version, hashes, answers, checksums."""
    run = tmp_path / "runs" / "old"
    shutil.copytree(seven_run, run)
    (run / "SHA256SUMS").unlink()
    without = {"config.json": {"schema", "inputs_sha256"}, "result.json": {"schema", "answers", "noise_mrad"}}
    for name, keys in without.items():
        write(run / name, {key: value for key, value in read(run / name).items() if key not in keys})
    rows = read(run / "parameters.json")
    write(run / "parameters.json", [{k: v for k, v in row.items() if k != "weakly_observable"} for row in rows])
    return run


def read(path: Path):
    return json.loads(path.read_text())


def write(path: Path, content) -> None:
    path.write_text(json.dumps(content))


def valid(run: Path) -> None:
    for name in ("config", "result", "parameters"):
        schema = ROOT / "docs" / "reference" / "schemas" / f"{name}.schema.json"
        jsonschema.validate(read(run / f"{name}.json"), read(schema))


def test_an_older_run_is_read_with_a_word(old: Path, seven_run: Path) -> None:
    found, ours = load_run(old), load_run(seven_run)
    assert [row.estimate for row in found.estimate.rows] == [row.estimate for row in ours.estimate.rows]
    assert any("without checksums: edits cannot be detected; lab migrate" in said for said in found.warnings)
    assert any("judged it by other rules" in said for said in found.warnings)
    assert all(said.startswith(f"{old}: ") for said in found.named_warnings)
    assert not any(said.startswith(f"{old}: {old}: ") for said in found.named_warnings)
    assert not any("older" in said for said in ours.warnings)


def test_a_migrated_run_has_schema_and_checksums_and_the_same_numbers(old: Path, seven_run: Path) -> None:
    before = {path.name: path.read_bytes() for path in old.iterdir()}
    (done,) = migrate(MigrateOptions(old)).runs
    assert done.given == ("schema 1", "checksums")
    valid(old)
    assert read(old / "parameters.json") == read(seven_run / "parameters.json")
    result = read(old / "result.json")
    assert result.pop("migrated") is True and result.pop("schema") == 1
    assert result == json.loads(before["result.json"])
    kept = set(before) - {"config.json", "result.json", "parameters.json"}
    assert all((old / name).read_bytes() == before[name] for name in kept)
    words = load_run(old).warnings
    assert any("judged it by other rules" in said for said in words) and not any("checksums" in said for said in words)
    assert migrate(MigrateOptions(old.parent)).runs[0].given == ()  # and of the folder above it
    assert sorted(path.name for path in old.parent.iterdir()) == ["old"]


def test_a_run_gets_its_date_once(old: Path) -> None:
    assert migrate(MigrateOptions(old, "2025-02-01")).runs[0].given == ("schema 1", "date 2025-02-01", "checksums")
    assert read(old / "config.json")["options"]["date"] == "2025-02-01"
    assert migrate(MigrateOptions(old, "2025-02-01")).runs[0].given == ()
    with pytest.raises(LabError, match="its date is 2025-02-01; leave out --date 2025-03-01"):
        migrate(MigrateOptions(old, "2025-03-01"))


def test_what_cannot_be_migrated_is_left_as_it_was(old: Path, seven_run: Path, tmp_path: Path, monkeypatch) -> None:
    with pytest.raises(LabError, match="holds no run"):
        migrate(MigrateOptions(ROOT / "models"))
    shutil.copytree(old, old.parent / "other")
    with pytest.raises(LabError, match="holds 2 runs, but --date is for one run"):
        migrate(MigrateOptions(old.parent, "2025-02-01"))
    edited = tmp_path / "edited"
    shutil.copytree(seven_run, edited)
    write(edited / "result.json", read(edited / "result.json") | {"verdict": "good"})
    with pytest.raises(LabError, match=r"result\.json was changed since the run was written"):
        migrate(MigrateOptions(edited))
    (edited / "SHA256SUMS").unlink()  # a run that has a schema had checksums
    with pytest.raises(LabError, match="its checksums are missing"):
        migrate(MigrateOptions(edited))
    shutil.move(edited, old.parent / "z_edited")
    with pytest.raises(LabError, match="its checksums are missing"):  # and no run before it is touched
        migrate(MigrateOptions(old.parent))
    assert not (old / "SHA256SUMS").exists()
    monkeypatch.chdir(old)
    with pytest.raises(LabError, match="is the working folder"):
        migrate(MigrateOptions(Path()))
    assert "schema" not in read(old / "config.json")


@pytest.mark.parametrize(
    ("name", "key", "value"),
    [("parameters.json", "std", {}), ("parameters.json", "exported", 1e300), ("result.json", "freedom", "many"),
     ("result.json", "after_mm", {"mean": 1.0}), ("config.json", "options", None)],
)  # fmt: skip
def test_a_run_that_holds_something_else_gets_no_checksums(old: Path, name: str, key: str, value: object) -> None:
    content = read(old / name)
    (content[0] if isinstance(content, list) else content)[key] = value
    write(old / name, content)
    with pytest.raises(LabError, match=f"{name}: is not in the lab's format: .*{key}"):
        migrate(MigrateOptions(old))
    assert not (old / "SHA256SUMS").exists()
