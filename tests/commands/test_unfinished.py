"""Long work that was interrupted or killed goes on with ``--resume``, and ends with the same bytes."""

import json
import os
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from helpers.bad_input import run, the_line
from helpers.drawing import nothing_drawn
from helpers.time_limit import ends
from helpers.writing_commands import ended, forked, whole

import lab
from lab.campaign import design_problem as reachability
from lab.commands import run_folder as unfinished
from lab.compensation import compensator
from lab.core import whole_folder as kept_pieces
from lab.core.whole_folder import Pieces
from lab.extensions.robotics.workspace import measure

COMMANDS = {
    "workspace": "workspace carrier/cartesian irb120 --places 1000 --orientations 2",
    "compensate": "compensate few.csv --run day",
    "design": "design --robot irb120 --poses 10 --candidates 3000 --starts 2",
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run and targets; each test leaves them as they were."""
    place = tmp_path_factory.mktemp("unfinished")
    with nothing_drawn():
        lab.calibrate("irb120", poses=30, seed=7).save(place / "day")
    lines = (place / "day" / "measurements.csv").read_text().splitlines()
    (place / "few.csv").write_text("\n".join(",".join(line.split(",")[6:9]) for line in lines[:9]) + "\n")
    return place


@pytest.fixture
def small(made: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Pieces of less than a second are kept, too."""
    monkeypatch.chdir(made)
    monkeypatch.setattr(kept_pieces, "_MIN_CPU_S", -1.0)
    monkeypatch.setattr(measure, "_BLOCK", 200)
    for module in (compensator, reachability):
        monkeypatch.setattr(module, "_BLOCK", 3)
    return made


@pytest.fixture
def stopped(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[int], None]]:
    """Interrupts the work when so many pieces are kept."""
    usual, kept = Pieces._keep, [0, 0]

    def keep(self: Pieces, *piece: object) -> None:
        usual(self, *piece)  # type: ignore[arg-type]
        kept[0] += 1
        if kept[0] == kept[1]:
            raise KeyboardInterrupt

    def after(count: int) -> None:
        kept[:] = [0, count]
        monkeypatch.setattr(Pieces, "_keep", keep if count else usual)

    yield after
    after(0)


def content(place: Path) -> dict[str, object]:
    """What a run ends with, less the recording, whose chunks have no order, and how long it took."""
    files: dict[str, object] = {path.name: path.read_bytes() for path in place.iterdir() if path.suffix == ".csv"}
    result = json.loads((place / "result.json").read_text())
    result.pop("seconds", None)
    return files | {"result": result, "config": json.loads((place / "config.json").read_text())}


def straight(name: str, folder: Path) -> dict[str, object]:
    """The run that nothing interrupts."""
    if not (folder / f"straight {name}").exists():
        assert run(f"{COMMANDS[name]} --out 'straight {name}'") in (0, 1)
    return content(folder / f"straight {name}")


@pytest.mark.thorough
@pytest.mark.parametrize("name", COMMANDS)
def test_an_interrupted_run_goes_on_and_ends_the_same(
    name: str, small: Path, stopped: Callable[[int], None], capfd: pytest.CaptureFixture[str]
) -> None:
    wanted, argv = straight(name, small), f"{COMMANDS[name]} --out run"
    before = sorted(path.name for path in small.iterdir())
    capfd.readouterr()
    for resume, count in (("", 2), (" --resume", 2)):
        stopped(count)
        assert run(argv + resume) == 130
        assert "interrupted; to continue, repeat the command with --out run --resume" in the_line(
            capfd.readouterr().err
        )
        assert not (small / "run").exists()
        assert len(list((small / ".run.unfinished").glob("*.npz"))) == (4 if resume else 2)
    stopped(0)
    assert run(f"{argv} --resume") in (0, 1)
    assert whole(small / "run") and content(small / "run") == wanted
    shutil.rmtree(small / "run")
    assert sorted(path.name for path in small.iterdir()) == before


@pytest.mark.thorough
def test_other_work_does_not_go_on_with_it(
    small: Path, stopped: Callable[[int], None], capfd: pytest.CaptureFixture[str]
) -> None:
    argv = f"{COMMANDS['compensate']} --out run"
    stopped(1)
    assert run(argv) == 130
    stopped(0)
    capfd.readouterr()
    other = (small / "few.csv").read_text()
    for change, said in {
        f"{argv} --no-check --resume": "another option no_check",
        "design --robot irb120 --out run --resume": "another command",
        f"{argv} --resume": "another content of few.csv",
    }.items():
        (small / "few.csv").write_text(other + ("300,0,500\n" if "content" in said else ""))
        assert run(change) == 2
        assert said in (line := the_line(capfd.readouterr().err)) and "leave out --resume" in line
        (small / "few.csv").write_text(other)
    (small / ".run.unfinished" / "work.json").write_text("[]")
    assert run(f"{argv} --resume") == 2 and "command" in the_line(capfd.readouterr().err)
    assert run(argv) in (0, 1)  # without --resume it begins anew
    assert not (small / ".run.unfinished").exists()
    shutil.rmtree(small / "run")


def test_what_cannot_go_on_is_told(
    made: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(made)
    for name in COMMANDS:
        assert run(f"{COMMANDS[name]} --resume") == 2
        assert "give its folder by --out" in the_line(capfd.readouterr().err)


def test_work_that_fails_leaves_nothing_to_go_on_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from lab.core.errors import LabError
    from lab.core.whole_folder import current_keep

    monkeypatch.setattr(kept_pieces, "_MIN_CPU_S", -1.0)
    options = lab.commands.compensate.options.CompensateOptions(run=tmp_path)
    for cause, left in ((None, False), (OSError("no room"), True)):
        with pytest.raises(LabError), unfinished.unfinished("compensate", options, tmp_path / "run", resume=False):
            current_keep()("stage", [np.zeros(1)], lambda: {"one": np.zeros(1)})
            assert (tmp_path / ".run.unfinished").is_dir()
            raise LabError("it fails") from cause
        assert (tmp_path / ".run.unfinished").is_dir() == left


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_a_killed_run_goes_on_to_the_same_bytes(name: str, small: Path) -> None:
    """SIGKILL at random moments, one after the other, until it is done."""
    started = time.perf_counter()
    wanted, argv = straight(name, small), f"{COMMANDS[name]} --out run"
    seconds, rng = time.perf_counter() - started, np.random.default_rng(len(name))
    for _ in range(-(-int(os.environ.get("LAB_KILLS", "30")) // 15)):
        for resume in ("", *3 * (" --resume",)):
            ended(forked(lambda resume=resume: run(argv + resume)), float(rng.uniform(0, seconds)))
            whole(small / "run")
            shutil.rmtree(small / "run", ignore_errors=True)
        assert ended(forked(lambda: run(f"{argv} --resume"))) in (0, 1)
        assert whole(small / "run") and content(small / "run") == wanted
        assert not [path.name for path in small.iterdir() if path.name.startswith(".run.")]
        shutil.rmtree(small / "run")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes of POSIX")
def test_what_never_ends_is_refused_and_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    for source in ("pipe", "/dev/zero"):
        with ends():
            assert run(f"compensate --program {source} --run {source} --out never") == 2
        assert "cannot be read" in the_line(capfd.readouterr().err)
