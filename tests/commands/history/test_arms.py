"""``lab history`` on folders of runs whose summaries are written here: states, what is left out, and metrics."""

import csv
import json
import re
from datetime import UTC, date, datetime, timedelta
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.html_page import Page
from scipy import stats

import lab
from lab.arm_history.history_result import STATES
from lab.cli.main import main
from lab.core.errors import LabError
from lab.core.whole_folder import CHECKSUMS, checksum_lines

SAMPLE = re.compile(r'([a-z_]+)(?:\{serial="((?:[^"\\\n]|\\.)*)",robot="((?:[^"\\\n]|\\.)*)"\})? (\S+)')
STATISTICS = {"rms": 0.0, "p95": 0.0, "max": 0.0, "count": 9}


def written(run: Path, config: dict[str, Any], result: dict[str, Any]) -> Path:
    """A run that has only its summary, with its checksums."""
    run.mkdir(parents=True)
    for name, content in (("config", config), ("result", result)):
        (run / f"{name}.json").write_text(json.dumps({"schema": 1, **content}))
    (run / CHECKSUMS).write_text(checksum_lines(run))
    return run


def calibrated(
    run: Path, on: str | None, verdict: str = "good", *, serial: str | None = "A-1", mean: float = 0.02, **more: Any
) -> Path:
    options = {"date": on, "serial": serial, "robot": "irb120"}
    result = {"robot": "irb120", "serial": serial, "verdict": verdict, "after_mm": {"mean": mean, **STATISTICS}, **more}
    return written(run, {"command": "identify", "model_sha256": "0" * 64, "options": options}, result)


def verified(run: Path, of: Path, on: str | None, *, good: bool = True, mean: float = 0.02, **more: Any) -> Path:
    serial = json.loads((of / "result.json").read_text())["serial"]
    result = {"robot": "irb120", "serial": serial, "good": good, "observed_mm": {"mean": mean, **STATISTICS}, **more}
    digest = sha256((of / "result.json").read_bytes()).hexdigest()
    options = {"run": str(of), "date": on}
    config = {"command": "verify", "model_sha256": "0" * 64, "options": options, "inputs_sha256": {str(of): digest}}
    return written(run, config, result)


def states(folder: Path, on: str, **options: Any) -> dict[str | None, str]:
    return {arm.serial: arm.state for arm in lab.history(folder, on=on, **options).arms}


def test_each_state_comes_from_the_last_check_of_the_last_calibration(tmp_path: Path) -> None:
    def arm(serial: str, verdict: str = "good") -> Path:
        return calibrated(tmp_path / serial / "calibration", "2026-01-10", verdict, serial=serial)

    for word in ("good", "doubtful", "bad", "not judged"):
        arm(word, word)
    verified(tmp_path / "found" / "v", arm("found"), "2026-02-10", good=False)
    late = arm("late")
    verified(tmp_path / "late" / "v", late, "2026-01-20")
    verified(
        tmp_path / "rests on a doubtful run" / "v", arm("rests on a doubtful run"), "2026-02-01", verdict="doubtful"
    )
    mended = arm("mended")
    verified(tmp_path / "mended" / "v", mended, "2026-02-10", good=False)
    again = calibrated(tmp_path / "mended" / "again", "2026-02-10", serial="mended", mean=0.03)
    verified(tmp_path / "mended" / "old", mended, "2026-02-12", good=False)  # by mistake against the old run
    lost = arm("lost")
    verified(tmp_path / "lost" / "v", lost, "2026-02-01")
    for path in (*lost.iterdir(), lost):
        path.unlink() if path.is_file() else path.rmdir()
    calibrated(tmp_path / "undated", None, serial="undated")
    assert states(tmp_path, "2026-02-14") == {
        "good": "good",
        "doubtful": "doubtful",
        "bad": "bad",
        "not judged": "unknown",
        "found": "bad",
        "late": "good",
        "rests on a doubtful run": "doubtful",
        "mended": "good",
        "lost": "never calibrated",
        "undated": "unknown",
    }
    later = states(tmp_path, "2026-02-25")  # 36 days after 2026-01-20
    assert later["late"] == later["good"] == "due" and later["mended"] == "good" and later["found"] == "bad"
    assert states(tmp_path, "2026-02-24")["late"] == "good"
    assert states(tmp_path, "2026-02-25", every_days=400)["good"] == "good"
    before = states(tmp_path, "2026-02-09")  # runs of later days are passed over
    assert before["found"] == "good" and before["mended"] == "good"
    (found,) = (each for each in lab.history(tmp_path, on="2026-02-14").arms if each.serial == "mended")
    assert found.calibration is not None and found.calibration.folder == again
    assert (found.error_then_mm, found.error_now_mm) == (0.03, None)
    assert found.due == date(2026, 2, 10) + timedelta(35)
    (bad,) = (each for each in lab.history(tmp_path, on="2026-02-14").arms if each.serial == "found")
    assert bad.due == date(2026, 2, 10)  # at once


def test_one_arm_is_of_one_serial_and_robot(tmp_path: Path) -> None:
    calibrated(tmp_path / "deep" / "er" / "run", "2026-01-10")
    calibrated(tmp_path / "other model", "2026-01-10", robot="ur5")
    calibrated(tmp_path / "nameless", "2026-01-10", serial=None)
    found = lab.history(tmp_path, on="2026-01-20").arms
    assert {(each.serial, each.robot) for each in found} == {("A-1", "irb120"), ("A-1", "ur5"), (None, "irb120")}


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda run: (run / "result.json").write_text((run / "result.json").read_text() + " "), "was changed since"),
        (lambda run: (run / "result.json").write_text("{"), "result.json was changed since"),
        (lambda run: (run / "config.json").write_text('{"options": 3}'), "config.json"),
        (lambda run: (run / "config.json").unlink(), "config.json"),
        (lambda run: (run / CHECKSUMS).unlink(), "its checksums are missing"),
        (lambda run: run.rename(run.parent / f".{run.name}.partial-x1"), "is an incomplete copy of the run broken"),
    ],
)
def test_a_broken_run_is_named_and_blocks_no_other(tmp_path: Path, damage: Any, says: str, capsys: Any) -> None:
    calibrated(tmp_path / "whole", "2026-01-10")
    damage(calibrated(tmp_path / "broken", "2026-01-12", "bad"))
    out = tmp_path.parent / f"{tmp_path.name}-history"
    assert main(["history", str(tmp_path), "--on", "2026-01-20", "--out", str(out)]) == 0
    assert "broken" in (told := capsys.readouterr().err) and says in told
    result = json.loads((out / "result.json").read_text())
    assert [each["state"] for each in result["arms"]] == ["good"] and len(result["left_out"]) == 1
    assert "broken" in result["left_out"][0]["run"] and says in result["left_out"][0]["reason"]
    assert "lab_history_left_out_runs 1\n" in (out / "history.prom").read_text()


@pytest.mark.pages
def test_copies_inside_of_runs_and_other_commands_are_passed_over(tmp_path: Path) -> None:
    run = calibrated(tmp_path / "run", "2026-01-10")
    checked = verified(tmp_path / "check", run, "2026-02-10")
    calibrated(checked / "inputs" / "run", "2026-01-10", "bad", serial="copy")
    written(tmp_path / "plan", {"command": "design", "options": {}, "model_sha256": ""}, {})
    result = lab.history(tmp_path, on="2026-02-12")
    assert [arm.serial for arm in result.arms] == ["A-1"] and not result.left_out


def test_touches_of_a_socket_are_checks_and_plans_are_not(tmp_path: Path) -> None:
    run = calibrated(tmp_path / "run", "2026-01-10")
    digest = sha256((run / "result.json").read_bytes()).hexdigest()
    for name, verdict, options in (
        ("touches", "good", {}),
        ("few", "not judged", {"date": "2026-02-22"}),
        ("plan", None, {"plan": 5}),
    ):
        config = {"command": "verify", "model_sha256": "0" * 64, "options": {"run": str(run), **options}}
        result = {"robot": "irb120", "serial": "A-1", "last": "2026-02-20"} | ({"verdict": verdict} if verdict else {})
        written(tmp_path / name, config | {"inputs_sha256": {str(run): digest}}, result)
    found = lab.history(tmp_path, on="2026-02-24")
    (arm,) = found.arms
    assert not found.left_out and arm.due == date(2026, 2, 20) + timedelta(35)
    assert [each.folder.name for each in arm.verifications] == ["touches"] and arm.error_now_mm is None


def test_the_slope_is_that_of_least_squares_with_its_interval(tmp_path: Path) -> None:
    run = calibrated(tmp_path / "run", "2026-01-01")
    errors = [0.020, 0.024, 0.023, 0.030, 0.031]
    days = [date(2026, month, 1) for month in range(2, 7)]
    for on, error in zip(days, errors, strict=True):
        (arm,) = lab.history(tmp_path, on="2026-07-01").arms
        assert (arm.slope is None) is (len(arm.verifications) < 4)
        verified(tmp_path / f"v{on}", run, on.isoformat(), mean=error)
    (arm,) = lab.history(tmp_path, on="2026-07-01").arms
    line = stats.linregress([on.toordinal() / 365.25 for on in days], errors)
    assert arm.slope is not None and arm.slope.verifications == 5
    assert np.isclose(arm.slope.per_year, line.slope) and np.isclose(
        arm.slope.half_width, stats.t.ppf(0.975, 3) * line.stderr
    )


def test_metrics_are_prometheus_text(tmp_path: Path) -> None:
    strange = 'A"1\\n, é'
    calibrated(tmp_path / "strange", "2026-01-10", "doubtful", serial=strange, mean=0.25)
    never = calibrated(tmp_path / "gone", "2026-01-10", serial="gone")
    verified(tmp_path / "v", never, "2026-01-11")
    (never / "config.json").write_text("{}")
    out = tmp_path / "status"
    lab.history(tmp_path, on="2026-01-20", out=str(out))
    text = (out / "history.prom").read_text()
    assert text.endswith("\n") and "\r" not in text
    seen: dict[str, dict[str, float]] = {}
    announced: dict[str, str] = {}
    for line in text.splitlines():
        if line.startswith("# "):
            _, what, name, words = line.split(" ", 3)
            assert announced.get(name) == (None if what == "HELP" else "HELP") and (what == "HELP" or words == "gauge")
            announced[name] = what
            continue
        match = SAMPLE.fullmatch(line)
        assert match is not None, line
        name, serial, robot, value = match.groups()
        assert announced[name] == "TYPE" and (robot == "irb120" or serial is None)
        label = re.sub(r"\\(.)", lambda c: {"n": "\n"}.get(c[1], c[1]), serial or "")
        assert label not in seen.setdefault(name, {})
        seen[name][label] = float(value)
    at = datetime(2026, 1, 10, tzinfo=UTC).timestamp()
    assert seen == {
        "lab_arm_state": {strange: STATES.index("doubtful"), "gone": STATES.index("never calibrated")},
        "lab_arm_error_mm": {strange: 0.25},
        "lab_arm_last_calibration_timestamp_seconds": {strange: at},
        "lab_arm_due_timestamp_seconds": {strange: at + 35 * 86400},
        "lab_history_left_out_runs": {"": 1.0},
    }


def test_exit_codes_and_files(tmp_path: Path, capsys: Any) -> None:
    runs, out = tmp_path / "runs", tmp_path / "out"
    calibrated(runs / "one", "2026-01-10")
    asked = ["history", str(runs), "--require", "good", "--out", str(out), "--overwrite", "--on"]
    assert main([*asked, "2026-01-20"]) == 0
    assert main([*asked, "2026-03-20"]) == 3 and main(["history", str(runs), "--on", "2026-03-20"]) == 0
    calibrated(runs / "two", "2026-01-10", "bad", serial="A-2")
    assert main([*asked, "2026-01-20"]) == 1
    with (out / "history.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["serial"], row["state"]) for row in rows] == [("A-2", "bad"), ("A-1", "good")]  # the worst first
    assert rows[1]["next_due"] == "2026-02-14" and rows[1]["calibrations"] == "1" and rows[1]["error_now_mm"] == ""
    capsys.readouterr()
    empty = tmp_path / "empty"
    empty.mkdir()
    for folder, says in ((tmp_path / "nowhere", "is no folder"), (empty, "contains no run")):
        with pytest.raises(LabError, match=says):
            lab.history(folder)
    with pytest.raises(LabError, match="--every-days 0"):
        lab.history(runs, every_days=0)


@pytest.mark.figures
def test_the_page_shows_every_arm_and_its_checks(tmp_path: Path) -> None:
    run = calibrated(tmp_path / "runs" / "one", "2026-01-10")
    verified(tmp_path / "runs" / "v", run, "2026-02-10", good=False)
    calibrated(tmp_path / "runs" / "two", "2026-01-10", serial="A-2")
    lab.history(tmp_path / "runs", on="2026-02-12", out=str(tmp_path / "out"))
    page = Page(tmp_path / "out" / "report.html")
    assert set(page.figures) == {"errors-now-figure", "checks"}
    assert [row[:2] for row in page.table("state")] == [["bad", "irb120 A-1"], ["good", "irb120 A-2"]]


def test_arms_are_in_the_order_of_what_needs_attention_and_say_what_to_do(tmp_path: Path) -> None:
    good = {"b": "2026-01-01", "a": "2026-01-20", "c": "2026-02-20"}
    other = {"d": ("2026-03-01", "bad"), "e": ("2026-02-02", "bad"), "f": ("2026-03-03", "doubtful")}
    for i, (serial, (at, verdict)) in enumerate([*((name, (at, "good")) for name, at in good.items()), *other.items()]):
        calibrated(tmp_path / f"{i}", at, verdict, serial=serial)
    result = lab.history(tmp_path, on="2026-03-05")
    assert [arm.serial for arm in result.arms] == ["e", "d", "f", "b", "a", "c"]
    assert [arm.to_do for arm in result.arms] == [
        "calibrate again", "calibrate again", "see the reasons of its last run", "verify: 28 days late",
        "verify: 9 days late", "verify by 2026-03-27",
    ]  # fmt: skip
