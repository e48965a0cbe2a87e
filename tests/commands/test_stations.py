"""An instrument that measures from several stations: the cell, the plan, the simulated day, and the identification."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from helpers.campaigns import session

import lab
from lab.calibration.guess import few_points_of_a_station
from lab.calibration.identification import identify
from lab.calibration.weights import Noise
from lab.cli.main import main
from lab.core import se3
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.kinematics.effects.effect import SessionInfo
from lab.library.simulate import MeasurementSession
from lab.library.virtual_arm import truth_of
from lab.noise.instruments import INSTRUMENTS
from lab.prediction.validation import compare_with_truth
from lab.robots.load_robot import load_virtual
from lab.simulation.effects import true_parameters

WEST, EAST, BACK = (
    ("west", (1600, -1300, 1100), 0),
    ("east", (1400, 1500, 900), 40),
    ("back", (-1700, 200, 1300), 170),
)
TWO, THREE = (WEST, EAST), (WEST, EAST, BACK)


def cell(folder: Path, stations: tuple[tuple[str, tuple[int, int, int], int], ...], more: str = "") -> Path:
    parts = [
        f'[[station]]\nname = "{name}"\nposition_mm = {list(head)}\nrotation_deg = [0, 0, {turn}]\n'
        for name, head, turn in stations
    ]
    path = folder / "cell.toml"
    path.write_text("\n".join([*parts, more]), encoding="utf-8")
    return path


def day_in(path: Path, seed: int = 4, poses: int = 60, instrument: str = "exact") -> MeasurementSession:
    return lab.simulate("irb120", cell=path, poses=poses, seed=seed, instrument=instrument)


def seen_from(data: Measurements, Ts_first_station: dict[str, Array], names: tuple[str, ...]) -> Measurements:
    """The same points, row by row in the frame of the station that is to have measured them."""
    points = data.points.copy()
    for name, T in Ts_first_station.items():
        here = np.array(names) == name
        points[here] = se3.transform(se3.inverse(T), points[here])
    return replace(data, points=points, other={"station": names})


@pytest.mark.parametrize("stations", [TWO, pytest.param(THREE, marks=pytest.mark.thorough)], ids=["two", "three"])
def test_without_noise_the_robot_and_the_stations_are_recovered(tmp_path: Path, stations: tuple[object, ...]) -> None:
    found = lab.calibrate("irb120", cell=cell(tmp_path, stations), poses=60, seed=4, instrument="exact")  # type: ignore[arg-type]
    assert found.truth.comparison is not None and found.validation.errors is not None
    assert np.abs(found.truth.comparison.error).max() < 1e-9
    assert np.nanmax(found.validation.errors.after) < 1e-9
    names = {each.name for each in found.parameters}
    assert {f"station.{name}.rx" for name, *_ in stations[1:]} <= names and "station.west.x" not in names  # type: ignore[misc]


def test_stations_anywhere_tell_what_one_station_tells() -> None:
    """The same noisy points, moved by hand into other frames: everything of the robot is the same."""
    day = session(poses=60, seed=3, instrument="uniform-8um")
    Ts = {
        "B": se3.pose(se3.exp(np.array([0.1, 0.2, 2.9])), np.array([2.0, 3.0, -0.4])),
        "C": se3.pose(se3.exp(np.array([0.0, 0.0, np.pi])), np.array([-2.0, 1.0, 0.2])),
    }
    names = tuple("ABC"[i % 3] for i in range(60))
    moved = seen_from(day.measurements, Ts, names)
    result = lab.identify(moved, robot="irb120", instrument="uniform-8um", holdout=0.2)
    assert result.to_dict()["verdict"] == "good"
    found = {each.name: each.estimate for each in result.parameters}
    for name, T in Ts.items():
        numbers = np.array([found[f"station.{name}.{axis}"] for axis in ("x", "y", "z", "rx", "ry", "rz")])
        np.testing.assert_allclose(numbers[:3], T[:3, 3], atol=1e-4)
        np.testing.assert_allclose(se3.exp(numbers[3:]), T[:3, :3], atol=1e-4)
    as_one = lab.identify(day.measurements, robot="irb120", instrument="uniform-8um", holdout=0.2)
    alone = {each.name: (each.estimate, float(each.std or np.nan)) for each in as_one.parameters}
    off = [abs(found[k] - v) / s for k, (v, s) in alone.items() if np.isfinite(s) and s > 0 and k.startswith("link")]
    assert max(off) < 4  # of the errors with one station: the further places take some of the information


def test_noise_is_weighed_in_the_frame_of_the_station_that_measured() -> None:
    """A tracker's noise, long across the beam, is another one in the frame of another station."""
    day = session(poses=40, seed=5, instrument="leica-at960")
    T = se3.pose(se3.exp(np.array([0.0, 0.0, 1.5])), np.array([3.0, 0.0, 0.0]))
    data = seen_from(day.measurements, {"B": T}, ("A",) * 20 + ("B",) * 20)
    model = day.robot.arm_with(("p1",), (), SessionInfo(stations=("A", "B")))
    device = INSTRUMENTS["leica-at960"]
    found = identify(model, data, model.nominal(day.robot.tool), Noise(device))
    expected = np.linalg.inv(np.linalg.cholesky(device.covariance(data.points)))
    residuals = (expected @ found.residuals[..., None])[..., 0]
    assert 2 * found.fit.cost_trace[-1] == pytest.approx(float((residuals**2).sum()), rel=1e-6)


@pytest.mark.thorough
def test_intervals_of_robot_and_stations_hold_the_truth_as_often_as_they_say(tmp_path: Path) -> None:
    """Thirty campaigns of 39 or 45 parameters each: the share of intervals has a standard error of about 0.01."""
    device, held, pulls = INSTRUMENTS["leica-at960"], list[float](), list[float]()
    path = cell(tmp_path, THREE)
    for seed in range(30):
        day = day_in(path, seed, 40, "leica-at960")
        model = day.robot.arm_with(("p1",), (), SessionInfo(stations=day.robot.model.stations))
        found = identify(model, day.measurements, model.nominal(day.robot.tool), Noise(device))
        truth = truth_of(day.true_robot, day.robot.arm(("p1",)))
        assert truth is not None
        compared = compare_with_truth(found, replace(truth, effects=true_parameters(day.true_robot.effects)))
        held.append(compared.coverage_95)
        pulls.append(compared.nees_per_parameter)
    assert 0.92 < np.mean(held) < 0.98
    assert 0.85 < np.mean(pulls) < 1.15


@pytest.mark.thorough
def test_a_plan_assigns_poses_to_stations_and_is_measured_and_checked_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = cell(tmp_path, TWO)
    device = INSTRUMENTS["leica-at960"]
    plan = lab.design("irb120", cell=path, poses=14, candidates=60, starts=1, instrument="leica-at960", criterion="A")
    model = load_virtual("irb120", path).model
    view = replace(device.field_of_view, acceptance_rad=np.deg2rad(30))
    named = plan.columns()["station"]
    measured = plan.tour.measured >= 0
    assert set(named) == {"west", "east"} and sum(a != b for a, b in pairwise(named)) == 1
    assert plan.columns()["id"].count("home_between1") == 1 and (plan.tour.waypoints[plan.tour.breaks[0]] == 0).all()
    arm = plan.problem.robot.arm(("p1",))
    values = arm.nominal(plan.problem.robot.tool)
    Ts = model.T_world_frame0 @ arm.tool(plan.tour.waypoints, values)[0]
    for T, name, is_measured in zip(Ts, named, measured, strict=True):
        if not is_measured:
            continue
        here = model.Ts_world_station[["west", "east"].index(name)]
        there = se3.transform(se3.inverse(here), T[:3, 3][None]), T[:3, 2][None] @ here[:3, :3]
        assert view.admits(*there)[0]  # in sight of the station that is named, by range, elevation and acceptance
    plan.save(tmp_path / "plan")
    assert {"plan_west.mod", "plan_east.mod"} <= {each.name for each in (tmp_path / "plan").iterdir()}
    day = lab.simulate("irb120", cell=path, plan=tmp_path / "plan" / "plan.csv", seed=1, instrument="exact")
    assert list(day.measurements.stations) == [name for name, is_pose in zip(named, measured, strict=True) if is_pose]
    checked = ["design", "--cell", str(path), "--instrument", "leica-at960", "--json", "--check"]
    assert main([*checked, str(tmp_path / "plan" / "plan.csv")]) == 0
    text = (tmp_path / "plan" / "plan.csv").read_text()
    swapped = tmp_path / "swapped.csv"
    swapped.write_text(text.replace("west", "?").replace("east", "west").replace("?", "east"))
    capsys.readouterr()
    assert main([*checked, str(swapped)]) == 1
    assert "at station 'east' does not see p1" in capsys.readouterr().out


def refused(data: Measurements) -> str:
    with pytest.raises(LabError) as error:
        lab.identify(data, robot="irb120", instrument="exact")
    assert "\n" not in str(error.value)
    return str(error.value)


def test_too_few_points_of_a_station_and_rows_of_none_are_refused_in_one_line(tmp_path: Path) -> None:
    day = session(poses=40, seed=3, instrument="exact")
    T = {"B": se3.pose(np.eye(3), np.array([1.0, 0.0, 0.0]))}
    assert "station 'B' measured 2 points" in refused(seen_from(day.measurements, T, ("A",) * 38 + ("B",) * 2))
    assert "station 'A' measured 2 points" in refused(seen_from(day.measurements, T, ("A",) * 2 + ("B",) * 38))
    assert "column station: empty" in refused(seen_from(day.measurements, T, ("A",) * 39 + ("",)))


def test_a_first_station_without_any_point_is_told() -> None:
    """As where a hold-out takes all of its rows: the frame of the others is where it stood."""
    day = session(poses=40, seed=3, instrument="exact")
    model = day.robot.arm_with(("p1",), (), SessionInfo(stations=("A", "B", "C")))
    T = {name: se3.pose(np.eye(3), np.array([1.0, 0.0, 0.0])) for name in "BC"}
    data = seen_from(day.measurements, T, ("A",) * 10 + ("B",) * 15 + ("C",) * 15)
    assert few_points_of_a_station(model, data) == ""
    assert "the first station measured 0 points" in few_points_of_a_station(model, data[10:40])
    assert "station 'B' measured 0 points" in few_points_of_a_station(model, data[[*range(10), *range(25, 40)]])


def test_rows_of_unknown_stations_are_not_judged_by(tmp_path: Path) -> None:
    day = session(poses=60, seed=3, instrument="exact")
    T = {name: se3.pose(np.eye(3), np.array([x, 0.0, 0.0])) for name, x in (("B", 1.0), ("C", 5.0))}
    data = seen_from(day.measurements, T, ("A",) * 25 + ("B",) * 25 + ("B",) * 5 + ("C",) * 5)
    data = replace(data, use=("calibrate",) * 50 + ("test",) * 10, marked=True)
    result = lab.identify(data, robot="irb120")
    assert result.validation.errors is not None and result.validation.errors.after.shape == (5, 1)
    assert result.validation.errors.after.max() < 1e-9
    assert any("station C is not used for validation: it was not fitted" in each for each in result.warnings)


@pytest.mark.thorough
def test_other_files_are_validated_from_known_stations_or_with_a_base_placed_anew(tmp_path: Path) -> None:
    day = session(poses=80, seed=3, instrument="exact")
    T = {"B": se3.pose(se3.exp(np.array([0.0, 0.0, 1.0])), np.array([1.0, 0.0, 0.0]))}
    data = seen_from(day.measurements, T, ("A", "B") * 40)
    fitted, other = data[:50], data[50:80]
    known = lab.identify(fitted, robot="irb120", validate=other)
    assert known.validation.errors is not None and known.validation.errors.after.max() < 1e-9
    renamed = replace(other, other={"station": ("C", "D") * 15})
    with pytest.raises(LabError, match="station 'C' was not fitted"):
        lab.identify(fitted, robot="irb120", validate=renamed)
    anew = lab.identify(fitted, robot="irb120", validate=renamed, refit=("base",))
    assert anew.validation.errors is not None and anew.validation.errors.after.max() < 1e-8


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[instrument]\nposition_mm = [1, 2, 3]\n[[station]]\nname = "a"', "both set the instrument's pose"),
        ('[[station]]\nname = "a"\n[[station]]\nname = "a"', "is taken"),
        ('[[station]]\nname = "a/b"', "has a '/'"),
        ("[[station]]\nposition_mm = [1, 2, 3]", "name"),
        ('[[station]]\nname = "a"\nposition_mm = [0, 0, 300]', "stands inside the arm"),
        (
            '[[station]]\nname = "a"\nposition_mm = [1600, -1300, 1100]\n[[station]]\nname = "far"\nposition_mm = '
            "[90000, 0, 0]",
            "station 'far' measures 0 of",
        ),
    ],
)
def test_cells_with_impossible_stations_are_refused(
    tmp_path: Path, text: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "cell.toml").write_text(text)
    asked = ["design", "--cell", str(tmp_path / "cell.toml"), "--poses", "14", "--candidates", "30", "--starts", "1"]
    assert main([*asked, "--instrument", "leica-at960", "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert said in error and len(error.strip().splitlines()) == 1 and not (tmp_path / "out").exists()


@pytest.mark.thorough
def test_plans_without_stations_and_verifications_from_several_are_refused(tmp_path: Path) -> None:
    path = cell(tmp_path, TWO)
    (tmp_path / "plan.csv").write_text("id,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\na,0,0,0,0,30,0\n")
    with pytest.raises(LabError, match="the station is missing"):
        lab.simulate("irb120", cell=path, plan=tmp_path / "plan.csv")
    day = session(poses=50, seed=3)
    result = lab.identify(day.measurements[:40], robot="irb120", instrument="uniform-8um", holdout=0.2)
    with pytest.raises(LabError, match="stations A, B; verify the rows of each alone"):
        lab.verify(result, replace(day.measurements, other={"station": ("A", "B") * 25}))
