"""The leaderboard: scores against a case computed by hand, files of predictions, fixed splits, and the stored page."""

import csv
import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import leaderboard as board
import numpy as np
import pytest
from shared import run_script

import lab
from lab.calibration.row_groups import configurations

SETS = board.data_sets()
DIGESTS = {  # of the held-out rows: a split never changes
    "ur5-grid": "d2106f3f80bde652",
    "ur5-random": "0309058c71626f62",
    "ur10-random": "4f0ce4850caee0b8",
    "ur10-cubes": "2ba9415a8b41eb42",
    "ur10-beyond": "a661656b334164fe",
    "irb120-sessions": "d312b94bc7b7d198",
}


def test_scores_of_a_case_by_hand() -> None:
    measured = np.zeros((4, 3))
    points = 1e-3 * np.array([[1.0, 0, 0], [0, 2, 0], [0, 0, 2], [0, 3, 4]])  # lengths 1, 2, 2, 5 mm
    covariances = 1e-6 * np.array([np.eye(3)] * 3 + [np.diag([1.0, 1, 2])])
    found = board.scored(measured, board.Predictions(points, covariances))
    assert found["poses"] == 4
    assert found["rms_mm"] == pytest.approx(math.sqrt((1 + 4 + 4 + 25) / 4))
    assert found["p95_mm"] == pytest.approx(5)
    # e' V^-1 e is 1, 4, 4 and 9 + 16/2 = 17; the bound is the 95 % quantile of chi squared with three degrees, 7.815
    assert found["coverage"] == 0.75
    # Wilson: (p + z²/2n ± z sqrt(p (1 - p) / n + z²/4n²)) / (1 + z²/n) of 3 of 4
    assert (found["coverage_low"], found["coverage_high"]) == pytest.approx((0.3006, 0.9544), abs=1e-4)
    assert found["region_mm"] == pytest.approx(math.sqrt(7.8147), rel=1e-4)
    squares = np.array([1, 4, 4, 25])
    half = 1.959964 * squares.std(ddof=1) / 2
    assert found["rms_high_mm"] == pytest.approx(math.sqrt(8.5 + half)) and found["rms_low_mm"] == 0
    bare = board.scored(measured, board.Predictions(points))
    assert bare["coverage"] is None and bare["rms_mm"] == found["rms_mm"]


@pytest.mark.parametrize("name", list(SETS))
def test_a_split_is_fixed(name: str) -> None:
    rows = SETS[name].rows
    assert len(set(rows.tolist())) == len(rows) and (np.diff(rows) > 0).all()
    assert hashlib.sha256(",".join(map(str, rows)).encode()).hexdigest()[:16] == DIGESTS[name]


@pytest.mark.parametrize("name", [name for name, about in SETS.items() if about.ships])
def test_a_split_is_of_its_files_and_shares_no_pose(name: str) -> None:
    task, measured = board.task_of(SETS[name], None)
    assert np.isfinite(measured).all() and np.isnan(task.held_out.points).all() and not task.held_out.other
    together = np.concatenate([task.fit.joints, task.held_out.joints])
    labels = configurations(together)
    assert not set(labels[: len(task.fit)]) & set(labels[len(task.fit) :])


def _table(rows: np.ndarray, covariance: bool = False) -> list[list[str]]:
    heads = ["row", *board.POSITION, *(board.COVARIANCE if covariance else ())]
    cells = ["1.0", "2.0", "3.0", *(["1", "0", "0", "1", "0", "1"] if covariance else [])]
    return [heads, *([str(row), *cells] for row in rows)]


Change = Callable[[list[list[str]]], object]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.pop(), "1 of 20 held-out rows are not predicted (first: row 19)"),
        (lambda t: t.append(t[1]), "line 22: row 0 is there twice"),
        (lambda t: t[3].__setitem__(0, "77"), "line 4: row 77 is not held out in ur5-random"),
        (lambda t: t[3].__setitem__(0, "1.5"), "line 4: row 1.5 is not held out"),
        (lambda t: t[3].__setitem__(2, "x"), "line 4, column y_mm: 'x' is no finite number"),
        (lambda t: t[3].__setitem__(3, "nan"), "line 4, column z_mm: 'nan' is no finite number"),
        (lambda t: t[3].__delitem__(slice(2, None)), "line 4, column y_mm: None is no finite number"),
        (lambda t: t[0].__setitem__(3, "z"), "no column z_mm"),
        (lambda t: t[0].__setitem__(5, "cov"), "no column cov_xy_mm2"),
        (lambda t: t[3].__setitem__(4, "-1"), "line 4: the covariance is not positive definite"),
        (lambda t: t.clear(), "no column row"),
    ],
)
def test_a_wrong_file_of_predictions_is_one_line(
    change: Change, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, path = _table(SETS["ur5-random"].rows, covariance=True), tmp_path / "mine.csv"
    change(table)
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(table)
    with pytest.raises(SystemExit) as stop:
        run_script("leaderboard", ["--sets", "ur5-random", "--predictions", str(path)])
    printed = capsys.readouterr()
    assert stop.value.code == 2 and printed.err.startswith("lab: ") and printed.err.count("\n") == 1
    assert message in printed.err


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--predictions", "none.csv", "--sets", "ur5-random"], "none.csv: cannot be read"),
        (["--predictions", "none.csv"], "name the set"),
        (["--sets", "ur6"], "--sets ur6: give ur5-grid;"),
        (["--methods", "luck"], "--methods luck: give nominal;"),
        (["--limit-s", "0"], "--limit-s 0: give more than 0"),
    ],
)
def test_a_wrong_request_is_one_line(given: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        run_script("leaderboard", given)
    printed = capsys.readouterr()
    assert stop.value.code == 2 and message in printed.err and printed.err.count("\n") == 1 and not printed.out


def test_a_stranger_can_enter(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run_script("leaderboard", ["--export", str(tmp_path), "--sets", "ur5-random", "ur10-cubes", "--json"])
    assert len(json.loads(capsys.readouterr().out)["written"]) == 2
    with (tmp_path / "ur10-cubes" / "held_out.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["row"]) for row in rows] == SETS["ur10-cubes"].rows.tolist()
    assert not [name for name in rows[0] if name.endswith(board.MEASURED)] and "temp_C" in rows[0]
    robot = lab.load_robot(tmp_path / "ur10-cubes" / "robot.toml")
    fit = lab.read_measurements(tmp_path / "ur10-cubes" / "fit.csv", robot)
    task, measured = board.task_of(SETS["ur10-cubes"], None)
    assert np.array_equal(fit.points, task.fit.points)
    path, points = tmp_path / "mine.csv", measured + np.array([1e-3, 0, 0])
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(
            [["row", *board.POSITION], *([row["row"], *point] for row, point in zip(rows, 1e3 * points, strict=True))]
        )
    run_script("leaderboard", ["--sets", "ur10-cubes", "--predictions", str(path), "--json"])
    (row,) = json.loads(capsys.readouterr().out)["rows"]
    assert row["method"] == "mine" and row["poses"] == 171 and row["coverage"] is None
    assert row["rms_mm"] == pytest.approx(1, abs=1e-6) and row["p95_mm"] == pytest.approx(1, abs=1e-6)


@pytest.mark.thorough
def test_independent_geometry_predicts_as_the_lab_does() -> None:
    task, _ = board.task_of(SETS["ur10-cubes"], None)
    part = replace(task, fit=task.fit[np.arange(0, len(task.fit), 4)])
    own, other = board.by_the_lab(part, prior="off"), board.by_scipy(part, fitted=True)
    assert np.abs(own.points - other.points).max() < 1e-6  # the same optimum, by two chains and two solvers
    assert own.covariances is not None and other.covariances is not None
    sizes = [np.sqrt(np.trace(found, axis1=1, axis2=2)) for found in (own.covariances, other.covariances)]
    assert np.median(sizes[0] / sizes[1]) == pytest.approx(1, abs=0.1)
