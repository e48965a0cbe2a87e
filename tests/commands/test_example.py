"""``lab example``: what comes with the lab is listed, written whole or not at all, and can be identified from."""

import json
import os
import shlex
from pathlib import Path

import numpy as np
import pytest
from helpers.bad_input import contents, the_line
from helpers.robots import ROOT

import lab
from lab.cli.main import main
from lab.library.example import EXAMPLES
from lab.options.command_options import ExampleOptions

NAMES = [each.name for each in EXAMPLES]


def refused(line: str, capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command that is refused, and return its message."""
    assert main(shlex.split(line)) == 2
    return the_line(capsys.readouterr().err)


def test_all_that_is_measured_is_listed(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["example", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert listed["written"] == [] and not list(tmp_path.iterdir())
    files = [
        ROOT / "models" / each["robot"] / "measured" / file for each in listed["examples"] for file in each["files"]
    ]
    assert sorted(files) == sorted((ROOT / "models").glob("*/measured/*.csv"))
    for each, shipped in zip(listed["examples"], EXAMPLES, strict=True):
        assert each["bytes"] == sum(path.stat().st_size for path in shipped.paths) and each["licence"] == "MIT"
        assert each["rows"] == len(shipped.measurements)


@pytest.mark.parametrize("name", NAMES)
def test_an_example_is_written_with_source_and_licence(name: str, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.csv").write_text("1")
    (found,) = (each for each in EXAMPLES if each.name == name)
    assert main(["example", name]) == 0
    note = (tmp_path / f"{name}_source.txt").read_text()
    assert found.source in note and found.licence in note and "Permission is hereby granted" in note
    for path in found.paths:
        assert (tmp_path / path.name).read_bytes() == path.read_bytes() and path.name in note
    assert {path.name for path in tmp_path.iterdir()} == {"mine.csv", f"{name}_source.txt", *found.files}
    assert found.command() in capsys.readouterr().out


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.thorough if name == "panda" else pytest.mark.slow) for name in NAMES]
)
def test_the_printed_command_identifies_the_robot(name: str, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["example", name, "--out", "my data", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    (found,) = told["examples"]
    assert told["written"] == [f"my data/{file}" for file in (*found["files"], f"{name}_source.txt")]
    _, *arguments = shlex.split(found["command"])
    assert main([*arguments, "--no-recording", "--out", "run", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["status"] == "converged" and result["after_mm"]["mean"] < 0.7 * result["before_mm"]["mean"]


def test_a_call_gives_measurements_and_writes_where_it_is_told_to(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    found = lab.example("ur5")
    assert not list(tmp_path.iterdir()) and found.files == ()
    data = found.measurements
    assert data.robot == "ur5" and data.points.shape == (1000, 1, 3)
    first = np.array([-432.471963, -9.795327, -97.822432])
    np.testing.assert_allclose(1e3 * data.points[0, 0], first, atol=1e-9)
    written = lab.example("ur5", out="there").files
    assert [path.name for path in written] == ["ur5_jacobi_1000.csv", "ur5_jacobi_20.csv", "ur5_source.txt"]
    np.testing.assert_array_equal(lab.read_measurements(written[0], "ur5").points, data.points)
    assert lab.example(ExampleOptions("panda")).files[0] == Path("panda_sockets_mukca_3.csv")  # as the command line
    with pytest.raises(lab.LabError, match="no example is named; there are ur5"):
        _ = lab.example().measurements
    assert lab.example().columns()["name"] == NAMES


def test_nothing_is_overwritten(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["example", "ur10"]) == 0
    before = contents(tmp_path)
    assert refused("example ur10", capsys).startswith("lab: ur10_ipa_D.csv: is there already, and nothing was written")
    (tmp_path / "ur10_ipa_D.csv").unlink()  # the note alone is there
    assert "ur10_source.txt: is there already" in refused("example ur10", capsys)
    assert not (tmp_path / "ur10_ipa_D.csv").exists()
    (tmp_path / "ur10_ipa_D.csv").symlink_to("nowhere")
    assert "ur10_ipa_D.csv: is there already" in refused("example ur10", capsys)
    (tmp_path / "ur10_ipa_D.csv").unlink()
    assert set(contents(tmp_path)) < set(before)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("ur5e", "'ur5e' is no example; is ur5 meant? There are ur5, ur10, ur10-random, panda"),
        ("UR10", "'UR10' is no example; is ur10 meant?"),
        ("--out here", "--out is for one example: name it; there are ur5"),
        ("panda --out file", "file: cannot be written (File exists); nothing was written; give another --out"),
        ("panda --out file/below", "file/below: cannot be written (Not a directory); nothing was written"),
    ],
)
def test_what_is_refused(line: str, says: str, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    assert refused(f"example {line}", capsys).startswith(f"lab: {says}")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("stop", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_disk_that_fills_and_an_interruption_leave_nothing(stop, tmp_path: Path, monkeypatch) -> None:
    """The second file fails after the first was written."""
    flushed, real = [], os.fsync

    def filling(file: int) -> None:
        flushed.append(file)
        if len(flushed) == 2:
            raise stop
        real(file)

    monkeypatch.setattr(os, "fsync", filling)
    with pytest.raises(lab.LabError if isinstance(stop, OSError) else KeyboardInterrupt) as error:
        lab.example("ur5", out=tmp_path)
    assert len(flushed) == 2 and not list(tmp_path.iterdir())
    assert not isinstance(stop, OSError) or "cannot be written (No space left on device)" in str(error.value)
