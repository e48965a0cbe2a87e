"""``lab dynamics``: what of an arm's dynamics its torques determine."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.robots import ROOT

import lab
from lab.cli.main import main
from lab.extensions.dynamics.arm.dynamics_document import dynamics_document
from lab.extensions.dynamics.arm_simulation import LoadBench, RigidLoad, RunErrors, drawn_mounting
from lab.extensions.dynamics.load_files import read_motion, write_loads
from lab.extensions.dynamics.payload.excitation import Limits, random_path
from lab.extensions.dynamics.payload.payload_document import payload_document
from lab.formats.drives_toml import Drives, drives_lines, read_drives
from lab.report.document import Card, plain
from lab.robots.load_robot import load_virtual


@pytest.mark.pages
def test_it_prints_the_base_parameters_and_their_formulas(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dynamics", "--robot", "tx40", "--json", "--out", str(tmp_path / "run")]) == 0
    seen = json.loads(capsys.readouterr().out)
    assert (seen["standard_parameters"], seen["base_parameters"], seen["inertial_base_parameters"]) == (84, 58, 40)
    assert seen["formulas"]["ZZR1"] == "ZZ1 + YY2 + YY3 + Ia1 + 2 d3 MZ3 + (a3² + d3²) (M3 + M4 + M5 + M6)"
    assert "M1" in seen["without_effect"]
    assert json.loads((tmp_path / "run" / "result.json").read_text()) == seen
    page = (tmp_path / "run" / "report.html").read_text()
    assert "XX2 − YY2 − a3² (M3 + M4 + M5 + M6)" in page and "40 parameters of links and motors" in page


def test_parts_of_the_model_can_be_left_out() -> None:
    bare = lab.dynamics(robot="tx40", without=("motor-inertia", "friction", "offsets"))
    assert bare.to_dict()["base_parameters"] == 36
    assert bare.columns()["unit"][0] == "kg m²"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--without", "gears"], "--without gears: there are motor-inertia, friction, offsets"),
        (["--robot", "delta"], "serial arms"),
        (["--robot", "nowhere"], "nowhere"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dynamics", *arguments]) == 2
    told = capsys.readouterr()
    assert says in told.err and told.err.count("\n") == 1


TX40 = load_virtual("tx40")
TX40_TABLE = ROOT / "models" / "tx40" / "robot.toml"
WRIST = np.eye(6)
WRIST[5, 4] = 32 / 45


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A motion with torques, with a load and without, and one of motor currents with the drives that it needs."""
    folder, chain = tmp_path_factory.mktemp("dynamics"), TX40.chain
    path = random_path(Limits.of(chain), np.random.default_rng(3), at_rest=True).at
    noise = RunErrors(torque_noise=0.005, coulomb_nm=2.0, viscous_nm_s=1.0, motor_inertia_kgm2=0.1)
    load = RigidLoad(1.5, np.array([0.010, -0.005, 0.060]), np.diag([22.5, 26, 12.5]) * 1e-4)
    mounting = drawn_mounting(TX40.serial_model)
    both = LoadBench(TX40.serial_model, load, mounting, noise).moving(path, 10.0, 100.0, np.random.default_rng(1))
    write_loads(folder / "both.csv", replace(both, wrench=None), chain.joint_names, chain.prismatic)
    drives = Drives(np.array([-48.0, 48, 45, -45, 45, 32]), WRIST, np.full(6, 0.2))
    bench = LoadBench(TX40.serial_model, None, mounting, noise, WRIST)
    driven = bench.moving(path, 10.0, 100.0, np.random.default_rng(2))
    currents = driven.torques / drives.torques(np.ones((1, 6)))
    driven = replace(driven, torques=currents, currents=True, wrench=None)
    write_loads(folder / "currents.csv", driven, chain.joint_names, chain.prismatic)
    (folder / "drives.toml").write_text("\n".join(drives_lines(drives)), encoding="utf-8")
    return folder


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, dict, str]:
    code = main(["dynamics", *map(str, arguments), "--robot", "tx40", "--json"])
    said = capsys.readouterr()
    return code, json.loads(said.out) if said.out else {}, said.err


@pytest.mark.pages
@pytest.mark.thorough
def test_torques_give_the_arm_and_its_load(files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = (files / "both.csv", "--validate", files / "both.csv", "--out", tmp_path / "run")
    code, seen, _ = run(capsys, *arguments)
    assert code in (0, 1) and seen["p"] > 1e-3
    assert seen["base_parameters"] == 58 and len(seen["identified"]) == 58
    friction = seen["identified"]["Fc3"]
    assert abs(friction["value"] - 2.0) < 2 * friction["half_width_95"] < 0.2
    for load in (seen["load"], seen["load_by_difference"]):
        assert abs(load["mass_kg"]["value"] - 1.5) < 2 * load["mass_kg"]["half_width_95"] < 0.1
    assert seen["predictions"][0]["relative_error"] == pytest.approx(seen["relative_error"], rel=1e-6)
    assert seen["physical"]["distance_sigma"] < 6
    names = {path.name for path in (tmp_path / "run").iterdir()}
    assert names == {"SHA256SUMS", "config.json", "inputs", "result.json", "report.html"}
    page = (tmp_path / "run" / "report.html").read_text()
    assert "by difference of the runs" in page and "relative σ" in page


def with_motors(files: Path, folder: Path, unit: str = "turns") -> tuple[Path, Path]:
    """The file of currents with the motors' positions in the place of the joints', whose zeros are anywhere."""
    drives = read_drives(files / "drives.toml", 6)
    drives = replace(drives, motor_zero_rad=np.arange(6.0), counts_per_turn=np.full(6, 4096.0))
    header, *lines = (files / "currents.csv").read_text().splitlines()
    rows = np.array([[float(cell) for cell in line.split(",")[:13]] for line in lines])
    motors = (rows[:, 1:7] @ drives.couplings.T * drives.gear_ratio + drives.motor_zero_rad) / (2 * np.pi)
    motors = np.round(4096 * motors) if unit == "counts" else motors
    names = [f"motor{j}_{unit}" for j in range(1, 7)]
    text = [",".join(["time_s", *names, *header.split(",")[7:13]])]
    text += [",".join(map(repr, each)) for each in np.column_stack([rows[:, 0], motors, rows[:, 7:]]).tolist()]
    (folder / "motors.csv").write_text("\n".join(text) + "\n")
    (folder / "motors.toml").write_text("\n".join(drives_lines(drives)), encoding="utf-8")
    return folder / "motors.csv", folder / "motors.toml"


def test_motor_positions_are_joint_positions(files: Path, tmp_path: Path) -> None:
    """As they come: turns or counts of the motors of a coupled wrist, with signs, from wherever their zeros are."""
    limits, joints = (TX40.chain.lower, TX40.chain.upper), (TX40.chain.joint_names, TX40.chain.prismatic)
    expected = read_motion(files / "currents.csv", *joints, limits)
    for unit, rounding in (("turns", 1e-12), ("counts", np.pi / 4096 / 32 * 2.5)):  # half a count, twice for joint 6
        path, drives = with_motors(files, tmp_path, unit)
        found = read_motion(path, *joints, limits, read_drives(drives, 6))
        assert np.abs(found.joints - expected.joints).max() < rounding
        np.testing.assert_array_equal(found.torques, expected.torques)
        assert found.currents and not found.warnings


@pytest.mark.thorough
def test_counts_and_currents_of_motors_are_enough(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No torques, no masses, no joint positions: base parameters with intervals, and a held-out part predicted.

    The robot is a table without masses that says itself how its drives turn it.
    """
    chain, mounting = TX40.chain, drawn_mounting(TX40.serial_model)
    path = random_path(Limits.of(chain), np.random.default_rng(3), at_rest=True).at
    noise = RunErrors(torque_noise=0.005, coulomb_nm=2.0, viscous_nm_s=1.0, motor_inertia_kgm2=0.1)
    bench = LoadBench(TX40.serial_model, None, mounting, noise, WRIST)
    driven = bench.moving(path, 8.0, 500.0, np.random.default_rng(2))
    ratio, counts, gain = np.array([-48.0, 48, 45, -45, 45, 32]), 4096.0, 0.2
    assert driven.time_s is not None and driven.torques is not None
    columns = {"time_s": driven.time_s}
    motors = np.round(counts * (driven.joints @ WRIST.T * ratio) / (2 * np.pi))
    columns |= {f"motor{j + 1}_counts": motors[:, j] for j in range(6)}
    columns |= {f"current{j + 1}_a": driven.torques[:, j] / (gain * ratio[j]) for j in range(6)}
    np.savetxt(tmp_path / "raw.csv", np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns),
               comments="", fmt="%.8g")  # fmt: skip
    drives = Drives(ratio, WRIST, np.full(6, gain), np.full(6, counts))
    table = "\n".join(line for line in TX40_TABLE.read_text().splitlines() if not line.startswith("mass_kg"))
    (tmp_path / "arm.toml").write_text(table + "\n\n" + "\n".join(drives_lines(drives)))
    arguments = ["dynamics", tmp_path / "raw.csv", "--robot", tmp_path / "arm.toml", "--holdout", 0.3]
    code = main([*map(str, arguments), "--json", "--out", str(tmp_path / "run")])
    seen = json.loads(capsys.readouterr().out)
    assert code in (0, 1) and len(seen["identified"]) == seen["base_parameters"] == 60
    held = seen["predictions"][0]
    assert held["noise_ratio"] < 1.3 and held["relative_error"] < 0.05
    motor = seen["identified"]["Ia6"]
    assert abs(motor["value"] - 0.1) < 2 * motor["half_width_95"]


def test_bad_motor_positions_are_one_line(files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, drives = with_motors(files, tmp_path)
    text, toml = path.read_text(), drives.read_text()
    (tmp_path / "wrong_sign.toml").write_text(toml.replace("gear_ratio = -48.0", "gear_ratio = 4.0"))
    both = ",".join(["q1_rad", text.split("\n", 1)[0]])
    body = ["0.1," + line for line in text.splitlines()[1:]]
    (tmp_path / "both.csv").write_text("\n".join([both, *body]) + "\n")
    for name, old, new in (("few", "motor6_turns", "m6"), ("unit", "motor6_turns", "motor6_grad"),
                           ("twice", "current6_a", "motor6_rad"), ("more", "current6_a", "motor7_rad")):  # fmt: skip
        (tmp_path / f"{name}.csv").write_text(text.replace(old, new, 1))
    (tmp_path / "counts.csv").write_text(text.replace("_turns", "_counts"))
    uncounted = "\n".join(line for line in toml.splitlines() if "counts" not in line)
    (tmp_path / "uncounted.toml").write_text(uncounted)
    for file, given, says in (
        (path, None, "motor1_turns: motor positions need gear ratios; give --drives"),
        (path, tmp_path / "wrong_sign.toml", "beyond its limits of"),
        (tmp_path / "both.csv", drives, "q1_rad: the motors' positions say where the joints are"),
        (tmp_path / "few.csv", drives, "motor 6 is missing; give one of motor6_rad, motor6_deg, motor6_turns"),
        (tmp_path / "unit.csv", drives, "motor 6 is missing"),
        (tmp_path / "twice.csv", drives, "motor6_rad and motor6_turns are the same motor"),
        (tmp_path / "more.csv", drives, "motor7_rad is no motor of the robot"),
        (tmp_path / "counts.csv", tmp_path / "uncounted.toml", "where the drives have counts_per_turn"),
    ):
        code, _, said = run(capsys, file, *(() if given is None else ("--drives", given)), "--out", tmp_path / "run")
        assert code == 2 and says in said and said.count("\n") == 1, said


def test_bad_measurements_are_one_line(files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "drives.toml").write_text("[[drive]]\ngear_ratio = 3\n")
    (tmp_path / "load.toml").write_text("[load]\nmass_kg = 1\ncom_mm = [0, 0, 0]\ninertia_kgcm2 = [1, 1, 1, 0, 0, 0]\n")
    text = (files / "currents.csv").read_text()
    (tmp_path / "both.csv").write_text(text.replace("current6_a", "tau6_nm", 1))
    (tmp_path / "still.csv").write_text(text.replace("time_s", "when", 1))
    header, *rows = text.split("\n")
    still = [",".join([row.split(",")[0], *["0.1"] * 6, *row.split(",")[7:]]) for row in rows if row]
    (tmp_path / "unmoved.csv").write_text("\n".join([header, *still]) + "\n")
    (tmp_path / "short.csv").write_text("\n".join(text.split("\n")[:60]) + "\n")
    drives = ("--drives", files / "drives.toml")
    for arguments, says in (
        ((files / "currents.csv",), "--drives"),
        ((files / "currents.csv", "--drives", tmp_path / "drives.toml"), "6 joints"),
        ((files / "currents.csv", *drives, "--load", tmp_path / "load.toml"), "run = loaded"),
        ((tmp_path / "both.csv", *drives), "missing"),
        ((tmp_path / "still.csv", *drives), "time_s"),
        ((tmp_path / "short.csv", *drives), "too short"),
        ((tmp_path / "unmoved.csv", *drives), "stand still"),
        ((files / "currents.csv", *drives, "--holdout", 0.9), "--holdout"),
        (("--delay",), "give a FILE"),
    ):
        code, _, said = run(capsys, *arguments, "--out", tmp_path / "run")
        assert code == 2 and says in said and said.count("\n") == 1, (arguments, said)


QUICK = ("--simulate", "--rounds", "0", "--rate-hz", "100", "--seconds", "5")


def told(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict:
    assert main([*map(str, arguments), "--json"]) in (0, 1)
    return json.loads(capsys.readouterr().out)


@pytest.mark.thorough
def test_a_rehearsed_day_is_evaluated_from_its_own_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, again = tmp_path / "day", tmp_path / "again"
    day = told(capsys, "dynamics", "--robot", "course2r", *QUICK, "--payload-kg", 1, "--out", folder)
    measured = ("--validate", folder / "another.csv", "--out", again)
    read = told(capsys, "dynamics", folder / "motion.csv", "--robot", "course2r", *measured)
    for key in ("identified", "load", "load_by_difference", "predictions", "p"):
        assert day[key] == read[key], key
    errors = [
        (day["identified"][name]["value"] - true) / day["identified"][name]["half_width_95"]
        for name, true in day["true"].items()
    ]
    assert np.abs(errors).max() < 3 and day["predictions"][0]["noise_ratio"] < 1.2
    assert day["load"]["mass_kg"]["value"] is None  # two axes show first moments alone


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--simulate", "motion.csv"], "leave FILE out"),
        (["--seconds", "3"], "--seconds needs --simulate"),
        (["--simulate", "--payload-mm", "1,2"], "--payload-mm: give 3"),
        (["--simulate", "--seconds", "0.2"], "--seconds 0.2: give 2 or more"),
        (["--simulate", "--rate-hz", "1e9"], "too many"),
        (["--simulate", "--noise-percent", "-1"], "--noise-percent -1"),
        (["--simulate", "--rounds", "1000"], "--rounds: 1,000 rounds"),
    ],
)
def test_bad_rehearsals_are_one_line(arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dynamics", *arguments]) == 2
    said = capsys.readouterr()
    assert says in said.err and said.err.count("\n") == 1, said.err


def test_pages_show_residuals_over_seconds_and_what_to_do() -> None:
    """Each drive is measured, predicted and left over, on an axis that goes on from run to run."""
    arm = lab.dynamics(robot="course2r", simulate=True, rounds=0, rate_hz=100, payload_kg=1.0)
    load = lab.payload(robot="course2r", simulate=True, rounds=0, rate_hz=100, payload_kg=1.0)
    for document, found in ((dynamics_document(arm), arm.estimate), (payload_document(load), load.estimate)):
        charts = {each.name: each.chart() for each in document.pictures}
        names = [name for name in charts if name.endswith("-residuals")]
        assert len(names) == found.measured.shape[1] and all(charts[name].x.label == "time, s" for name in names)
        left, seen = charts[names[0]], charts[names[0].removesuffix("-residuals")]
        times, residuals = left.points[0]
        assert (np.diff(times) > 0).all() and times[0] == 0
        every = len(found.residual) // len(residuals)
        np.testing.assert_allclose(residuals, found.residual[::every, 0][: len(residuals)])
        (_, measured), (_, predicted) = ((x, y) for x, y in seen.points[:2])
        assert len(measured) == len(times) and np.abs(measured).max() > np.abs(residuals).max() and len(predicted)
        (card,) = (each for each in document.blocks if isinstance(each, Card))
        assert plain(card.next_step) and card.numbers
