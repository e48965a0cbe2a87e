"""A run that was moved, and whose inputs were changed or deleted: what is built on it stays the same."""

import json
import shutil
from pathlib import Path

import pytest
import trimesh
from helpers.bad_input import ARM_TOML, ARM_XML, run, the_line
from helpers.drawing import nothing_drawn
from helpers.file_kinds import CELL, TRACKER

from lab.core.errors import LabError
from lab.library.load_run import load_run

MADE = "--robot arm.toml --instrument tracker.toml --cell cell.toml --poses 14"
BUILT = (
    "certify {}/first",
    "compensate {}/second/measurements.csv --run {}/first --no-check",
)  # fmt: skip


def shown(argv: str, runs: Path, capfd: pytest.CaptureFixture[str]) -> str:
    """What a command prints of runs, their folder under one name and the working folder's own names aside."""
    with nothing_drawn():
        code = run(f"{argv.format(runs, runs)} --out built --json")
    out, err = capfd.readouterr()
    assert code in (0, 1), err
    shutil.rmtree("built")
    return f"{out}{err}".replace(str(runs), "RUNS")


def write_inputs(place: Path, tracker: str = TRACKER) -> None:
    place.mkdir()
    for name, text in (("arm.toml", ARM_TOML), ("tracker.toml", tracker), ("cell.toml", CELL)):
        (place / name).write_text(text)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with inputs, and two runs in its folder ``runs``."""
    place = tmp_path_factory.mktemp("made") / "day"
    write_inputs(place)
    with pytest.MonkeyPatch.context() as patch, nothing_drawn():
        patch.chdir(place)
        for seed, name in enumerate(("first", "second")):
            assert run(f"calibrate {MADE} --seed {seed} --date 2026-01-0{1 + seed} --out runs/{name}") == 0
    return place


@pytest.fixture
def day(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same, to be changed, as the working folder."""
    shutil.copytree(made, tmp_path / "day")
    monkeypatch.chdir(tmp_path / "day")
    monkeypatch.setattr("lab.certification.budget._DRAWS", 10)
    return tmp_path / "day"


@pytest.mark.parametrize("argv", [BUILT[0], *(pytest.param(each, marks=pytest.mark.thorough) for each in BUILT[1:])])
def test_a_moved_run_whose_inputs_are_gone_or_others_gives_the_same(
    argv: str, day: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    before = shown(argv, day / "runs", capfd)
    moved = shutil.move(day / "runs", tmp_path / "archive")
    shutil.rmtree(day)
    write_inputs(tmp_path / "elsewhere", TRACKER.replace("transverse_um = 7.5", "transverse_um = 900"))
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert shown(argv, moved, capfd) == before


@pytest.mark.thorough
def test_a_moved_run_is_made_again_by_its_configuration(
    day: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    moved = shutil.move(day / "runs" / "first", tmp_path / "archive")
    shutil.rmtree(day)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert run(f"calibrate --config {moved}/config.json --out again") == 0
    assert run("calibrate --config again/config.json --out again --overwrite") == 0  # from its own copies
    for name in ("measurements.csv", "parameters.json", "covariance.csv", "inputs/tracker.toml"):
        assert Path("again", name).read_bytes() == (tmp_path / "archive" / name).read_bytes()


@pytest.mark.parametrize("argv", ["certify runs/first", "calibrate --config runs/first/config.json"])
def test_an_altered_copy_is_refused(day: Path, argv: str, capfd: pytest.CaptureFixture[str]) -> None:
    copy = day / "runs" / "first" / "inputs" / "tracker.toml"
    copy.write_text(copy.read_text().replace("7.5", "75"))
    assert run(f"{argv} --out built") == 2
    assert "inputs/tracker.toml was changed since the run was written" in the_line(capfd.readouterr().err)
    copy.unlink()
    assert run(f"{argv} --out built") == 2
    assert "inputs/tracker.toml was changed since the run was written" in the_line(capfd.readouterr().err)


def without_copies(folder: Path) -> Path:
    """The run as a version without copies wrote it."""
    shutil.rmtree(folder / "inputs")
    config = json.loads((folder / "config.json").read_text())
    del config["inputs"]
    (folder / "config.json").write_text(json.dumps(config))
    return folder


def test_a_run_without_copies_takes_only_its_own_inputs(
    day: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    older = without_copies(day / "runs" / "first")
    (older / "SHA256SUMS").unlink()

    def instrument() -> float:
        found = load_run(older, accept_edited=True).instrument
        assert found is not None
        return found.transverse_m

    assert instrument() == pytest.approx(7.5e-6)
    Path("tracker.toml").write_text(TRACKER.replace("7.5", "75"))
    with pytest.raises(LabError, match=r"tracker.toml, .* is another one"):
        instrument()
    Path("tracker.toml").unlink()
    with pytest.raises(LabError, match=r"tracker.toml, .* is not there"):
        instrument()
    Path("cell.toml").write_text(CELL.replace("clearance_mm = 5", "clearance_mm = 6"))
    with pytest.raises(LabError, match=r"cell.toml, .* is another one"):
        load_run(older, accept_edited=True)
    load_run(older, cell=day / "runs" / "second" / "inputs" / "cell.toml", accept_edited=True)


@pytest.mark.thorough
def test_what_inputs_name_in_their_turn_is_copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    day = tmp_path / "day"
    (day / "arm").mkdir(parents=True)
    (day / "meshes").mkdir()
    trimesh.creation.box((0.1, 0.1, 0.1)).export(day / "meshes" / "box.stl")
    with_mesh = ARM_XML.replace(
        "<worldbody>", '<asset><mesh name="m" file="../meshes/box.stl"/></asset><worldbody>'
    ).replace('<geom type="box" size=".05 .05 .05" mass="1"/>', '<geom type="mesh" mesh="m" mass="1"/>', 1)
    (day / "arm" / "robot.xml").write_text(with_mesh)
    obstacle = (
        '[[obstacle]]\nname = "b"\nshape = "mesh"\nunit = "m"\nfile = "meshes/box.stl"\nposition_mm = [1500, 0, 0]\n'
    )
    (day / "cell.toml").write_text(obstacle)
    monkeypatch.chdir(day)
    assert run("calibrate --robot arm/robot.xml --cell cell.toml --poses 14 --out run") == 0
    before = load_run(Path("run"))
    moved = Path(shutil.move("run", tmp_path / "archive"))
    shutil.rmtree(day)
    monkeypatch.chdir(tmp_path)
    after = load_run(moved)
    assert after.robot.name == before.robot.name == "arm" and after.robot.warnings == before.robot.warnings
    assert after.robot.model.model.nmesh == before.robot.model.model.nmesh == 2
    names = {str(path.relative_to(moved / "inputs")) for path in (moved / "inputs").rglob("*") if path.is_file()}
    assert names == {"arm/robot.xml", "meshes/box.stl", "cell.toml"}


def test_two_inputs_of_one_name_are_kept_apart(day: Path) -> None:
    (day / "other").mkdir()
    shutil.copy("runs/second/measurements.csv", "other/measurements.csv")
    judged = "--validate other/measurements.csv --refit base,tool"
    assert run(f"identify runs/first/measurements.csv --robot arm.toml {judged} --out run") in (0, 1)
    kept = json.loads(Path("run/config.json").read_text())["inputs"]
    assert Path("run", kept["runs/first/measurements.csv"]).read_bytes() != Path("other/measurements.csv").read_bytes()
    assert Path("run", kept["other/measurements.csv"]).read_bytes() == Path("other/measurements.csv").read_bytes()
