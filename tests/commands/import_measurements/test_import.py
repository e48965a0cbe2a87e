"""`lab import`: a day in a tracker's and a controller's files comes back as it was, by name, in order and by time."""

import json
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from day_files import controller_log, leica
from helpers.html_page import Page
from helpers.tracker_files import plain, polyworks, rows_of_joints, spatial_analyzer

from lab.cli.main import main
from lab.core.errors import LabError
from lab.formats.measurement_csv import read_measurements
from lab.library.import_measurements import import_measurements
from lab.library.simulate import MeasurementSession, simulate
from lab.options.command_options import ImportOptions
from lab.robots.load_robot import load_robot

POSES = 30


@pytest.fixture(scope="module")
def day() -> MeasurementSession:
    return simulate("irb120", poses=POSES, seed=3, instrument="uniform-8um")


@pytest.fixture
def files(tmp_path: Path, day: MeasurementSession) -> tuple[Path, Path]:
    """A tracker's export and the poses, both with names, the poses in another order."""
    names, data = [f"P{i}" for i in range(POSES)], day.measurements
    points = spatial_analyzer(tmp_path / "sa.txt", names, data.points[:, 0], np.full((POSES, 3), 8e-6))
    joints = rows_of_joints(tmp_path / "poses.csv", names[::-1], data.joints[::-1])
    return points, joints


def test_names_bring_points_and_poses_together(files: tuple[Path, Path], day: MeasurementSession) -> None:
    result = import_measurements(ImportOptions(*files))
    assert result.matching.by == "name" and result.measurements.ids[0] == f"P{POSES - 1}"
    np.testing.assert_allclose(result.measurements.joints[::-1], day.measurements.joints, atol=1e-10)
    np.testing.assert_allclose(result.measurements.points[::-1], day.measurements.points, atol=1e-9)
    np.testing.assert_allclose(result.measurements.sigma_m, 8e-6)


def test_the_written_file_is_what_identify_reads(files: tuple[Path, Path], tmp_path: Path) -> None:
    import_measurements(ImportOptions(*files)).save(tmp_path / "run")
    chain = load_robot("irb120").chain
    again = read_measurements(tmp_path / "run" / "measurements.csv", chain.joint_names, chain.prismatic)
    assert again.warnings == () and len(again) == POSES and np.allclose(again.sigma_m, 8e-6)
    told = json.loads((tmp_path / "run" / "result.json").read_text())
    assert told["by"] == "name" and told["columns"]["points"]["x"] == "X"


def test_files_of_two_stations_are_joined_line_by_line(files: tuple[Path, Path], tmp_path: Path) -> None:
    written = []
    for station in ("west", "east"):
        import_measurements(ImportOptions(*files, station=station)).save(tmp_path / station)
        written.append((tmp_path / station / "measurements.csv").read_text().splitlines(keepends=True))
    (both := tmp_path / "both.csv").write_text("".join(written[0] + written[1][1:]))
    chain = load_robot("irb120").chain
    data = read_measurements(both, chain.joint_names, chain.prismatic)
    assert data.stations == ("west",) * POSES + ("east",) * POSES and data.warnings == ()
    assert data.ids[0] == f"west P{POSES - 1}" and len(set(data.ids)) == 2 * POSES


def test_order_brings_them_together(tmp_path: Path, day: MeasurementSession) -> None:
    data = day.measurements
    points = plain(tmp_path / "p.txt", [f"x{i}" for i in range(POSES)], data.points[:, 0])
    joints = rows_of_joints(tmp_path / "j.csv", [f"y{i}" for i in range(POSES)], data.joints)
    result = import_measurements(ImportOptions(points, joints, by="order", unit="mm"))
    np.testing.assert_allclose(result.measurements.points, data.points, atol=1e-9)


def test_a_tool_of_three_targets_by_name_and_in_order(tmp_path: Path, day: MeasurementSession) -> None:
    data, targets = day.measurements, ("p1", "p2", "p3")
    shifted = np.stack([data.points[:, 0] + 0.01 * k for k in range(3)], axis=1)
    names = [f"P{i}_{t}" for i in range(POSES) for t in targets]
    points = polyworks(tmp_path / "p.txt", names, shifted.reshape(-1, 3))
    joints = rows_of_joints(tmp_path / "j.csv", [f"P{i}" for i in range(POSES)], data.joints)
    for by in ("name", "order"):
        result = import_measurements(ImportOptions(points, joints, by=by, targets=targets))
        np.testing.assert_allclose(result.measurements.points, shifted, atol=1e-9)


@pytest.mark.parametrize("lost", [(), (4, 17)], ids=["all", "some lost"])
def test_times_find_the_settled_poses_of_a_log(tmp_path: Path, day: MeasurementSession, lost: tuple[int, ...]) -> None:
    data = day.measurements
    middles = controller_log(tmp_path / "log.txt", data.joints, start=1000.0)
    kept = [i for i in range(POSES) if i not in lost]
    points = leica(tmp_path / "l.csv", [f"L{i}" for i in kept], data.points[kept, 0],
                   np.full((len(kept), 3), 1e-5), (middles[kept] - 1000.0))  # fmt: skip
    options = ImportOptions(points, tmp_path / "log.txt", by="time")
    with pytest.raises(LabError, match=f"would place {len(kept)} of {len(kept)}") as error:
        import_measurements(options)
    offset = float(str(error.value).split("--clock-offset-s ")[1].split()[0])
    result = import_measurements(replace(options, clock_offset_s=offset))
    assert len(result.measurements) == len(kept)
    np.testing.assert_allclose(result.measurements.joints, data.joints[kept], atol=2e-6)
    np.testing.assert_allclose(result.measurements.points, data.points[kept], atol=1e-8)
    assert {"temp_C", "time_s"} == set(result.measurements.conditions)
    assert [each.why for each in result.matching.left_out] == ["no point was measured at this pose"] * len(lost)


def test_a_point_measured_while_the_arm_moves_is_left_out(tmp_path: Path, day: MeasurementSession) -> None:
    data = day.measurements
    middles = controller_log(tmp_path / "log.txt", data.joints)
    seconds = middles - middles[0]
    seconds[7] += 2.5  # in the move to the next pose
    points = leica(tmp_path / "l.csv", [f"L{i}" for i in range(POSES)], data.points[:, 0],
                   np.full((POSES, 3), 1e-5), seconds)  # fmt: skip
    result = import_measurements(ImportOptions(points, tmp_path / "log.txt", by="time", clock_offset_s=-middles[0]))
    assert len(result.measurements) == POSES - 1
    assert ("L7", "measured while the arm moved, or outside the log") in [
        (each.what, each.why) for each in result.matching.left_out
    ]


def test_another_unit_is_refused_by_the_size_of_the_arm(files: tuple[Path, Path], tmp_path: Path) -> None:
    text = files[0].read_text().replace("Units: mm", "Units: m")
    (tmp_path / "m.txt").write_text(text)
    with pytest.raises(LabError, match="lengths are in another unit"):
        import_measurements(ImportOptions(tmp_path / "m.txt", files[1]))


def test_rows_of_other_poses_are_suspected(tmp_path: Path, day: MeasurementSession) -> None:
    data = day.measurements
    points = plain(tmp_path / "p.txt", [f"x{i}" for i in range(POSES)], np.roll(data.points[:, 0], 5, axis=0))
    joints = rows_of_joints(tmp_path / "j.csv", [f"y{i}" for i in range(POSES)], data.joints)
    result = import_measurements(ImportOptions(points, joints, by="order", unit="mm"))
    assert "do not follow the nominal arm" in result.warnings[-1]


def test_a_mistake_of_reading_is_named(tmp_path: Path, day: MeasurementSession) -> None:
    """In place of a list of what may be wrong: a joint's sign, and rows that are shifted by one."""
    data, names = day.measurements, [f"P{i}" for i in range(POSES)]
    turned = data.joints * np.array([1, 1, -1, 1, 1, 1])
    shifted = np.roll(data.joints, 1, axis=0)
    points = plain(tmp_path / "p.txt", names, data.points[:, 0])
    for key, joints in (("joint_sign:q3", turned), ("rows_shifted:+1", shifted)):
        result = import_measurements(
            ImportOptions(points, rows_of_joints(tmp_path / "j.csv", names, joints), unit="mm")
        )
        assert key in result.warnings[-1]
    sound = import_measurements(
        ImportOptions(points, rows_of_joints(tmp_path / "j.csv", names, data.joints), unit="mm")
    )
    assert not any("nominal arm" in each for each in sound.warnings)


def replacing(old: str, new: str) -> Callable[[str], str]:
    return lambda text: text.replace(old, new)


Change = Callable[[str], str | None] | None  # of a file's text; None takes the file away
CASES: dict[str, tuple[str, str, Change, Change]] = {  # words, options, changes of points and of poses
    "count mismatch": (
        "remove those without a partner", "--by order", None, lambda text: "\n".join(text.splitlines()[:-2])
    ),
    "no common name": ("--by order", "--by name", None, replacing("P", "Q")),
    "a pose twice": ("two poses are named", "", None, replacing("P1,", "P2,")),
    "a point twice": ("appears twice", "", replacing("robot, P1,", "robot, P2,"), None),
    "no times": ("--by name", "--by time", None, None),
    "degrees called radians": ("correct the unit in the header", "", None, replacing("(deg)", "(rad)")),
    "no targets": ("--targets", "--targets ,", None, None),
    "targets twice": ("--targets", "--targets p1,p1", None, None),
    "coverage of nothing": ("--coverage", "--coverage 0", None, None),
    "no map": ("map.toml", "--columns map.toml", None, None),
    "no such joint file": ("poses.csv", "", None, lambda _: None),
    "no such export": ("sa.txt", "", lambda _: None, None),
    "another robot": ("the joint slides", "--robot scara", None, None),
    "export of joints": ("no column is x", "", lambda _: "name, q1 (deg), q2 (deg), q3 (deg)\nP1, 1, 2, 3\n", None),
    "three targets, one measured": ("3 points each", "--by order --targets p1,p2,p3", None, None),
    "offset not finite": ("--clock-offset-s", "--clock-offset-s inf", None, None),
    "station without a name": ("--station", "--station ' '", None, None),
    "station with a comma": ("--station", "--station a,b", None, None),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_mistakes_are_told_in_one_line(
    case: str, files: tuple[Path, Path], capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(files[0].parent)
    words, flags, *changes = CASES[case]
    for file, change in zip(files, changes, strict=True):
        if change is None:
            continue
        if (text := change(file.read_text())) is None:
            file.unlink()
        else:
            file.write_text(text)
    assert main(["import", str(files[0]), "--joints", str(files[1]), *shlex.split(flags), "--out", "run"]) == 2
    out, err = capfd.readouterr()
    assert words in err and len(err.strip().splitlines()) == 1 and out == ""
    assert not Path("run").exists()


@pytest.mark.figures
def test_the_page_shows_both_files_on_one_clock(tmp_path: Path, day: MeasurementSession) -> None:
    data = day.measurements
    middles = controller_log(tmp_path / "log.txt", data.joints)
    points = leica(tmp_path / "l.csv", [f"L{i}" for i in range(POSES)], data.points[:, 0], np.full((POSES, 3), 1e-5),
                   middles - middles[0])  # fmt: skip
    result = import_measurements(ImportOptions(points, tmp_path / "log.txt", by="time", clock_offset_s=-middles[0]))
    result.save(tmp_path / "run")
    page, told = Page(tmp_path / "run" / "report.html"), json.loads((tmp_path / "run" / "result.json").read_text())
    assert "match" in page.figures and f"{POSES} of {POSES}, within" in page.text
    assert told["clocks"]["offset_s"] == -middles[0] and told["clocks"]["nominal_arm_rms_mm"] < 10
