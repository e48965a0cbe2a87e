"""``lab study`` from a file to tables, figures and a page."""

import csv
import json
import re
import shutil
from concurrent.futures import ThreadPoolExecutor

import pytest
from helpers.drawing import nothing_drawn
from helpers.run_script import threads_for_processes

from lab.cli.main import main

GRID = """
name = "a <small> one"
robots = 6
draws = 5
fresh = 40

[factors]
criterion = ["random", "O1"]
poses = 12
"""


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The study without figures."""
    folder = tmp_path_factory.mktemp("study")
    (folder / "grid.toml").write_text(GRID)
    command = ["study", str(folder / "grid.toml"), "--out", str(folder / "out"), "--workers", "1", "--json"]
    with nothing_drawn(), threads_for_processes(), pytest.MonkeyPatch.context() as patch:
        patch.setattr("lab.studies.campaigns.CANDIDATES", 200)  # of 1000
        assert main(command) == 0
    return folder


@pytest.mark.thorough
def test_the_analysis_is_in_the_folder(done) -> None:
    names = {path.name for path in (done / "out").iterdir()}
    assert {"means.csv", "pairs.csv", "ranks.csv", "report.html", "config.json", "manifest.json"} <= names
    with (done / "out" / "means.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["metric"] == "fresh_mean_mm"]
    means = {row["criterion"]: float(row["mean"]) for row in rows}
    assert len(means) == 2 and means["O1"] < means["random"]


@pytest.mark.thorough
@pytest.mark.figures
def test_the_page_says_it_and_needs_nothing_else(done, tmp_path) -> None:
    """And the figures are drawn, of what is there already."""
    shutil.copytree(done / "out", tmp_path / "out")
    assert main(["study", str(done / "grid.toml"), "--out", str(tmp_path / "out"), "--resume", "--workers", "1"]) == 0
    names = {path.name for path in (tmp_path / "out").iterdir()}
    for metric in ("fresh_mean_mm", "fresh_worst_mm"):
        for kind in ("means", "pairs"):
            assert {f"{metric}-criterion-{kind}.png", f"{metric}-criterion-{kind}.svg"} <= names
    page = (tmp_path / "out" / "report.html").read_text()
    assert "<h1>a &lt;small&gt; one</h1>" in page and page.count("<script") == 1
    assert not re.search(r'(src|href)="(?!#|data:)', page)
    assert page.count("<svg") == page.count("<figure") == 5


@pytest.mark.thorough
def test_again_it_prints_and_writes_the_same(done, capsys) -> None:
    before = {path: path.read_bytes() for path in (done / "out").rglob("*") if path.is_file()}
    flags = ["study", str(done / "grid.toml"), "--out", str(done / "out"), "--resume", "--workers", "1"]
    assert main(flags) == 0
    capsys.readouterr()
    assert {path: path.read_bytes() for path in (done / "out").rglob("*") if path.is_file()} == before
    assert main([*flags, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["campaigns"] == 60 and result["computed"] == 0 and len(result["cells"]) == 2


def test_a_name_is_one_folder(tmp_path, capsys) -> None:
    (tmp_path / "grid.toml").write_text('name = "a/b"\n')
    assert main(["study", str(tmp_path / "grid.toml")]) == 2
    assert "name 'a/b': give a name without slashes" in capsys.readouterr().err


@pytest.mark.thorough
def test_failures_are_in_the_json_by_reason(tmp_path, capsys, monkeypatch) -> None:
    """Twelve poses are too few for compliance and harmonics, which is known of each campaign alone."""
    monkeypatch.setattr("lab.studies.study.local_executor", lambda workers: ThreadPoolExecutor(1))
    (tmp_path / "grid.toml").write_text(
        'name = "few"\nrobots = 5\ndraws = 1\nfresh = 10\n[factors]\ncriterion = "random"\nposes = 12\n'
        'model = ["geometric", "compliance+harmonics"]\nprior = "auto"\n'
    )
    assert main(["study", str(tmp_path / "grid.toml"), "--out", str(tmp_path / "out"), "--json"]) == 0
    fine, few = json.loads(capsys.readouterr().out)["cells"]
    assert (fine["failed"], fine["failures"]) == (0, {})
    reason = "refused: 12 poses, but the 41 identifiable parameters need at least 14: measure more"
    assert (few["failed"], few["failures"]) == (5, {reason: 5})
    with (tmp_path / "out" / "means.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["metric"] == "fresh_mean_mm"]
    assert [(row["used"], row["robots"], row["failures"]) for row in rows] == [
        ("5", "5", ""),
        ("0", "0", f"5 {reason}"),
    ]
