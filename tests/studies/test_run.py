"""Studies on every executor: the same bytes, whatever is killed, full, cut short or done in another order."""

import dataclasses
import errno
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers import toy_study
from helpers.processes import interruptible
from helpers.robots import ROOT

from lab.cli.main import main
from lab.core.errors import LabError
from lab.studies.campaigns import origin_of
from lab.studies.executors import StoppedError, cluster_executor, local_executor
from lab.studies.grid import Study, read_study
from lab.studies.run_study import StudyDone, read_campaigns, read_store, run_study

TOY = toy_study.STUDY
SMALL = """
name = "small"
robots = 4
draws = 3
fresh = 20
[factors]
criterion = ["random"]
poses = [12, 15]
"""
LONG = f"""
robots = 1
draws = 100
fresh = 20
[factors]
criterion = ["random"]
poses = {list(range(12, 24))}
"""


def toy(folder: Path, executor: Executor, study: Study = TOY, **more: Any) -> StudyDone:
    return run_study(study, folder, executor, **{"posing": toy_study.posing, "solving": toy_study.solving, **more})


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The bytes of the toy study, made by one thread."""
    folder = tmp_path_factory.mktemp("toy") / "study"
    with ThreadPoolExecutor(1) as executor:
        done = toy(folder, executor)
    assert done.computed == TOY.campaigns == 16_000
    return contents(folder)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two worker processes of dask.distributed."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0") as started:
        yield started


class Backwards(Executor):
    """Does what was handed out last first."""

    def __init__(self, *counts: int) -> None:
        self.counts, self.jobs = list(counts), []

    def submit(self, call: Callable[..., Any], /, *given: Any, **named: Any) -> Future:
        future: Future = Future()
        self.jobs.append((future, partial(call, *given, **named)))
        if len(self.jobs) == self.counts[0]:
            for waiting, job in reversed(self.jobs):
                waiting.set_result(job())
            self.jobs = []
            del self.counts[0]
        return future


# The same bytes


@pytest.mark.parametrize("executor", [ThreadPoolExecutor(3), Backwards(2, 8)], ids=["threads", "backwards"])
def test_threads_and_order_do_not_matter(executor: Executor, tmp_path: Path, expected: dict[str, bytes]) -> None:
    with executor:
        toy(tmp_path / "study", executor)
    assert contents(tmp_path / "study") == expected


@pytest.mark.thorough
def test_a_cluster_does_not_matter_nor_a_worker_that_is_killed(
    cluster: Any, tmp_path: Path, expected: dict[str, bytes]
) -> None:
    died = tmp_path / "died"
    with cluster_executor(cluster.scheduler_address) as executor:
        toy(tmp_path / "study", executor, solving=partial(toy_study.deadly, died))
    assert died.exists() and contents(tmp_path / "study") == expected


def test_the_cut_into_tasks_does_not_matter(
    tmp_path: Path, expected: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    tables = []
    for campaigns in (2000, 4000, 6000):
        monkeypatch.setattr("lab.studies.grid.CAMPAIGNS_A_TASK", campaigns)
        with ThreadPoolExecutor(1) as executor:
            toy(tmp_path / str(campaigns), executor)
        tables.append(read_campaigns(tmp_path / str(campaigns)))
    assert all(table.equals(tables[0]) for table in tables)
    numbers = [tables[0][name].to_numpy() for name in ("cell", "robot", "draw")]
    assert np.array_equal(np.ravel_multi_index(numbers, (2, 4, 2000)), np.arange(16_000))  # none lost, none twice


# What stops, and goes on


@pytest.mark.thorough
def test_a_client_that_is_killed(tmp_path: Path, expected: dict[str, bytes]) -> None:
    """SIGKILL: its workers end too, and --resume does what is missing, and no more."""
    folder = tmp_path / "study"
    client = subprocess.Popen([sys.executable, str(ROOT / "tests" / "helpers" / "toy_study.py"), str(folder)])
    until(lambda: len(list(folder.glob("campaigns/cell*"))) >= 3)
    workers = children(client.pid)
    client.kill()
    client.wait()
    until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers))
    there = len(list(folder.glob("campaigns/cell*")))
    assert 3 <= there < 8 and len(workers) >= 2
    name = next(folder.glob("campaigns/cell*")).name
    (folder / "campaigns" / f".{name}.partial-1").write_bytes(b"half")
    with ThreadPoolExecutor(2) as executor:
        done = toy(folder, executor, resume=True)
        assert done.computed == (8 - there) * 2000 and contents(folder) == expected
        assert toy(folder, executor, resume=True).computed == 0


def until(happens: Callable[[], bool]) -> None:
    end = time.monotonic() + 60
    while not happens():
        assert time.monotonic() < end
        time.sleep(0.02)


def children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


@pytest.mark.thorough
def test_a_local_worker_that_is_killed(tmp_path: Path, expected: dict[str, bytes]) -> None:
    died, folder = tmp_path / "died", tmp_path / "study"
    with local_executor(2) as executor, pytest.raises(StoppedError, match="--resume goes on"):
        toy(folder, executor, solving=partial(toy_study.deadly, died))
    with ThreadPoolExecutor(1) as executor:
        done = toy(folder, executor, resume=True)
    assert 0 < done.computed < TOY.campaigns and contents(folder) == expected


def test_a_disk_that_fills_up(tmp_path: Path, expected: dict[str, bytes], monkeypatch: pytest.MonkeyPatch) -> None:
    folder, plain, written = tmp_path / "study", os.fsync, []

    def full(descriptor: int) -> None:
        written.append(descriptor)
        if len(written) > 7:  # two files of poses with their checksums, and three of campaigns
            raise OSError(errno.ENOSPC, "No space left on device")
        plain(descriptor)

    monkeypatch.setattr(os, "fsync", full)
    with ThreadPoolExecutor(1) as executor:
        with pytest.raises(StoppedError, match=r"parquet cannot be written \(No space left on device\); make room"):
            toy(folder, executor)
        assert set(contents(folder)) < set(expected)  # no half of a file
        monkeypatch.undo()
        assert toy(folder, executor, resume=True).computed == 5 * 2000
    assert contents(folder) == expected


def test_numbers_and_poses_that_were_changed_are_done_again(tmp_path: Path, expected: dict[str, bytes]) -> None:
    for name, content in expected.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    poses, file = tmp_path / "poses" / "cell0000.csv", tmp_path / "campaigns" / "cell0001-robots00002-00003.parquet"
    poses.write_text(re.sub(r"0\.\d", "0.0", poses.read_text(), count=1))
    table = pq.read_table(file)
    changed = table.set_column(5, table.schema.field(5), pa.array(table.column(5).to_numpy() / 2))
    pq.write_table(changed, file, write_page_checksum=True)  # a sound file of the same columns, with other numbers
    with pytest.raises(LabError, match="not there, or not whole"):
        read_campaigns(tmp_path)
    with ThreadPoolExecutor(1) as executor:
        assert toy(tmp_path, executor, resume=True).computed == 2000
    assert contents(tmp_path) == expected


@pytest.mark.parametrize("damage", ["turned", "gone", "empty"])
def test_a_damaged_file_is_done_again(damage: str, tmp_path: Path, expected: dict[str, bytes]) -> None:
    for name, content in expected.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    for path in (tmp_path / "campaigns" / "cell0001-robots00002-00003.parquet", tmp_path / "poses" / "cell0000.csv"):
        whole = path.read_bytes()
        half = len(whole) // 2
        if damage == "gone":
            path.unlink()
        elif damage == "turned" and path.suffix == ".parquet":
            path.write_bytes(whole[:half] + bytes([whole[half] ^ 1]) + whole[half + 1 :])
        else:
            path.write_bytes(b"" if damage == "empty" else whole[:-3])
    if damage != "gone":
        with pytest.raises(LabError, match=r"cell0001-robots00002-00003\.parquet: not there, or not whole"):
            read_campaigns(tmp_path)
    with ThreadPoolExecutor(1) as executor:
        assert toy(tmp_path, executor, resume=True).computed == 2000
    assert contents(tmp_path) == expected


# What is refused, in one line


def test_what_can_go_on_is_the_same_study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "study"
    with ThreadPoolExecutor(1) as executor:
        with pytest.raises(LabError, match="cannot be read"):
            toy(folder, executor, resume=True)
        toy(folder, executor)
        before = contents(folder)
        with pytest.raises(LabError, match="holds something"):
            toy(folder, executor)
        other = dataclasses.replace(TOY, draws=1999)
        with pytest.raises(LabError, match=r"another study \(draws is 2000 there, 1999 here\)"):
            toy(folder, executor, other, resume=True)
        with monkeypatch.context() as patch, pytest.raises(LabError, match=r"begun with virtual-calibration-lab 0\.1"):
            patch.setattr("lab.studies.campaigns.__version__", "99")
            toy(folder, executor, resume=True)
        with monkeypatch.context() as patch, pytest.raises(LabError, match=r"begun with another manifest\.json"):
            patch.setattr("lab.studies.grid.CAMPAIGNS_A_TASK", 4000)
            toy(folder, executor, resume=True)
        config = json.loads(before["config.json"])
        (folder / "config.json").write_text(json.dumps(config | {"model_sha256": "other"}))
        with pytest.raises(LabError, match="begun with other files of the robot"):
            toy(folder, executor, resume=True)
        (folder / "config.json").write_bytes(before["config.json"])
    assert contents(folder) == before


def test_a_worker_of_another_version_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = origin_of("irb120") | {"versions": origin_of("irb120")["versions"] | {"numpy": "1"}}
    monkeypatch.setattr("lab.studies.run_study._origin_here", lambda robot: other)
    with ThreadPoolExecutor(1) as executor, pytest.raises(StoppedError, match=r"a worker has numpy 1, not 2"):
        toy(tmp_path / "study", executor)


def test_a_study_that_cannot_be_leaves_nothing(tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as executor, pytest.raises(LabError, match="12 are too few"):
        toy(tmp_path / "study", executor, posing=toy_study.refused)
    assert not any(tmp_path.iterdir())


# The command


def one_line(capfd: pytest.CaptureFixture[str]) -> str:
    out, err = capfd.readouterr()
    assert out == "" and err.startswith("lab: ") and err.count("\n") == 1, err
    return err


@pytest.mark.thorough
def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    """Real campaigns: the same bytes by a process and a thread, and numbers that make sense."""
    monkeypatch.chdir(tmp_path)
    Path("small.toml").write_text(SMALL)
    assert main(["study", "small.toml", "--workers", "1", "--json"]) == 0
    out, err = capfd.readouterr()
    result = json.loads(out)
    assert (result["folder"], result["campaigns"], result["computed"], err) == ("runs/study-small", 24, 24, "")
    assert result["campaigns_per_second"] == pytest.approx(24 / result["seconds"])
    assert [cell["factors"]["poses"] for cell in result["cells"]] == [12, 15]
    study, made = read_study(Path("small.toml")), Path("runs/study-small")
    with ThreadPoolExecutor(1) as executor:
        run_study(study, Path("alone"), executor)
    alone, analysed = contents(Path("alone")), contents(made)
    assert {name: analysed[name] for name in alone} == alone
    rows = read_campaigns(made)
    assert rows["converged"].to_pylist() == [True] * 24 and max(rows["fresh_mean_mm"].to_pylist()) < 0.1
    assert list(json.loads((made / "manifest.json").read_text())["columns"]) == rows.column_names
    assert read_store(made).study == study
    assert main(["study", "small.toml", "--out", str(made), "--resume", "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["computed"] == 0


@pytest.mark.thorough
def test_bad_commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("lab.studies.executors.CONNECTING_S", 0.5)
    Path("small.toml").write_text(SMALL)
    for arguments, says in {
        "--scheduler tcp://127.0.0.1:9": "tcp://127.0.0.1:9: does not answer",
        "--scheduler nonsense://x": "does not answer",
        "--scheduler tls://127.0.0.1:9": "does not answer",
        "--scheduler tcp://127.0.0.1:9 --workers 2": "give one",
        "--workers 0": "--workers 0",
        "--resume": "--out",
        "--resume --out gone": "gone/config.json: cannot be read",
    }.items():
        assert main(["study", "small.toml", *arguments.split()]) == 2, arguments
        assert says in one_line(capfd), arguments
    Path("few.toml").write_text(SMALL.replace("12", "5"))
    assert main(["study", "few.toml", "--workers", "1"]) == 2
    assert "5 poses" in one_line(capfd)
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["study", "small.toml", "--scheduler", "tcp://127.0.0.1:9"]) == 2
    assert "[cluster]" in one_line(capfd)
    assert {path.name for path in tmp_path.iterdir()} <= {"small.toml", "few.toml", "runs"}


@pytest.mark.thorough
def test_an_interruption_is_told(tmp_path: Path) -> None:
    """Ctrl-C reaches the workers too, which leave it to the client."""
    (tmp_path / "long.toml").write_text(LONG)
    command = [sys.executable, "-m", "lab", "study", "long.toml", "--out", "study", "--workers", "1"]
    session = {"start_new_session": True, "preexec_fn": interruptible}
    client = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True, **session)
    until(lambda: any((tmp_path / "study").glob("campaigns/cell*")))
    os.killpg(client.pid, signal.SIGINT)
    _, err = client.communicate(timeout=30)
    assert client.returncode == 130 and err == "lab: interrupted; --resume continues the study in study\n"


def test_go_on_removes_only_what_the_study_left(tmp_path: Path) -> None:
    folder = tmp_path / "study"
    with ThreadPoolExecutor(1) as executor:
        toy(folder, executor)
        pieces = [next((folder / part).iterdir()).name for part in ("poses", "campaigns")]
        left = [folder / part / f".{name}.partial-7" for part, name in zip(("poses", "campaigns"), pieces, strict=True)]
        foreign = [folder / ".notes.partial-1", folder / "campaigns" / ".notes.partial-1", folder / "poses" / "notes"]
        for path in (*left, *foreign):
            path.write_bytes(b"x")
        toy(folder, executor, resume=True)
    assert not any(path.exists() for path in left) and all(path.exists() for path in foreign)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"options": None}, "None is not a value of option 'options'"),
        ({"options": []}, r"\[\] is not a value of option 'options'"),
        ({"versions": 3}, "3 is not a value of option 'versions'"),
        ({"model_sha256": None}, "None is not a value of option 'model_sha256'"),
        ({"model_sha256": "0"}, "other files of the robot"),
    ],
)
def test_a_damaged_configuration_of_a_study_is_told(tmp_path: Path, change: dict[str, Any], says: str) -> None:
    folder = tmp_path / "study"
    with ThreadPoolExecutor(1) as executor:
        toy(folder, executor)
        path = folder / "config.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | change))
        with pytest.raises(LabError, match=says):
            toy(folder, executor, resume=True)
    if "options" in change:
        with pytest.raises(LabError, match=says):
            read_store(folder)
