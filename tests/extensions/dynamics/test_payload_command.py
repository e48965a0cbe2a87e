"""``lab payload``: a file in, the load with its intervals out, and what calibration and compensation make of it."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lab.cli.main import main
from lab.extensions.dynamics.arm_simulation import LoadBench, RigidLoad, RunErrors
from lab.extensions.dynamics.load_files import Mounting, write_loads, write_mounting
from lab.extensions.dynamics.payload.excitation import Limits, random_path
from lab.extensions.dynamics.payload.payload_estimate import equivalent_ellipsoid
from lab.library.hand_load import HandLoad
from lab.library.load_run import load_run
from lab.robots.load_robot import load_virtual
from lab.simulation.collisions import random_poses

TX40 = load_virtual("tx40")
LOAD = RigidLoad(1.5, np.array([0.010, -0.005, 0.060]), np.diag([22.5, 26, 12.5]) * 1e-4)
MOUNTING = Mounting.tilted(np.zeros(2), sign=-1.0)
NOISE = RunErrors(
    torque_noise=0.005, force_noise_n=0.05, moment_noise_nm=0.002, wrench_offset=(1.0, -2, 0.5, 0.02, -0.01, 0.03)
)


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> Path:
    """A motion with torques, static poses with both, and how the sensor stands."""
    folder = tmp_path_factory.mktemp("load")
    bench, chain = LoadBench(TX40.model, LOAD, MOUNTING, NOISE), TX40.chain
    path = random_path(Limits.of(chain), np.random.default_rng(3))
    moving = bench.moving(path.at, 5.0, 500.0, np.random.default_rng(1))
    static = bench.resting(random_poses(TX40.model, 20, np.random.default_rng(5)), np.random.default_rng(2))
    write_loads(folder / "moving.csv", replace(moving, wrench=None), chain.joint_names, chain.prismatic)
    write_loads(folder / "static.csv", static, chain.joint_names, chain.prismatic)
    write_mounting(folder / "sensor.toml", MOUNTING)
    return folder


def run(capsys, *arguments: object) -> tuple[int, dict, str]:
    code = main([*map(str, arguments), "--json"])
    said = capsys.readouterr()
    return code, json.loads(said.out) if said.out else {}, said.err


def assert_the_load(seen: dict) -> None:
    """Within three half-widths, which are there."""
    for value, half, true in (
        (seen["mass_kg"]["value"], seen["mass_kg"]["half_width_95"], LOAD.mass_kg),
        (seen["com_m"]["value"], seen["com_m"]["half_width_95"], LOAD.centre_m),
    ):
        assert (np.abs(np.array(value) - true) < 1.5 * np.array(half)).all() and np.all(np.array(half) > 0)


def test_a_motion_tells_all_ten_parameters(files: Path, tmp_path: Path, capsys) -> None:
    code, seen, _ = run(capsys, "payload", files / "moving.csv", "--robot", "tx40", "--out", tmp_path / "run")
    assert code == 0 and seen["rank"] == 10 and seen["adequate"] is True and seen["method"].startswith("torque")
    assert_the_load(seen)
    assert np.shape(seen["inertia_kgm2"]["value"]) == (3, 3) and seen["unseen"] == []
    names = {path.name for path in (tmp_path / "run").iterdir()}
    assert names == {"SHA256SUMS", "config.json", "inputs", "result.json", "load.json", "report.html"}
    assert json.loads((tmp_path / "run" / "result.json").read_text()) == seen


def test_static_poses_of_a_sensor_tell_mass_and_centre(files: Path, tmp_path: Path, capsys) -> None:
    sensor = ("--sensor", files / "sensor.toml")
    code, seen, _ = run(capsys, "payload", files / "static.csv", "--robot", "tx40", *sensor, "--out", tmp_path / "run")
    assert code == 0 and seen["rank"] == 10 and seen["parameters"] == 16 and "inertia" in seen["unseen"][0]
    assert_the_load(seen)
    assert seen["inertia_kgm2"]["value"][0] == [None] * 3
    offsets = [each["value"] for each in seen["also_fitted"]]
    np.testing.assert_allclose(offsets, NOISE.wrench_offset, atol=0.03)  # as the sensor reads
    freed = ("--tilt", "--turn", "--out", tmp_path / "freed")
    _, seen, _ = run(capsys, "payload", files / "static.csv", "--robot", "tx40", *sensor, *freed)
    assert "turn.x" in [each["name"] for each in seen["also_fitted"]]


@pytest.mark.thorough
def test_identify_and_compensate_carry_the_load(files: Path, tmp_path: Path, capsys) -> None:
    sensor = ("--sensor", files / "sensor.toml")
    assert run(capsys, "payload", files / "static.csv", "--robot", "tx40", *sensor, "--out", tmp_path / "load")[0] == 0
    arm = ("--robot", "tx40", "--model", "compliance")
    campaign = ("--poses", 60, "--seed", 2, "--stiffness-nm-per-rad", 2e4, "--payload-kg", "0,1.5")
    load = ("--load", tmp_path / "load")
    code, seen, _ = run(capsys, "calibrate", *arm, *campaign, *load, "--out", tmp_path / "soft")
    assert code == 0 and seen["adequate"] is True and seen["after_mm"]["mean"] < 0.006
    data = tmp_path / "soft" / "measurements.csv"
    code, without, _ = run(capsys, "identify", data, *arm, "--instrument", "uniform-8um", "--out", tmp_path / "no")
    assert without["adequate"] is False  # the load is taken to hang at the flange's origin
    code, with_it, _ = run(
        capsys, "identify", data, *arm, "--instrument", "uniform-8um", *load, "--out", tmp_path / "id"
    )
    assert code == 0 and with_it["adequate"] is True
    assert with_it["after_mm"]["mean"] < 0.9 * without["after_mm"]["mean"]
    with data.open() as file:
        rows = list(csv.DictReader(file))[:4]
    run(capsys, "calibrate", *arm, *campaign, *load, "--poses", 80, "--out", tmp_path / "more")
    with (tmp_path / "more" / "measurements.csv").open() as file:  # of the same arm; the first 60 are those above
        carrying = [row for row in list(csv.DictReader(file))[60:] if float(row["payload_kg"])]
    told = [",".join(row[name] for name in carrying[0] if not name.startswith("payload")) for row in carrying]
    heads = ",".join(name for name in carrying[0] if not name.startswith("payload"))
    (tmp_path / "new.csv").write_text("\n".join([heads, *told]) + "\n")
    assert run(capsys, "verify", tmp_path / "id", tmp_path / "new.csv", "--out", tmp_path / "v")[0] == 0
    lines = ["x_mm,y_mm,z_mm", *(",".join(row[f"p1_{axis}_mm"] for axis in "xyz") for row in rows)]
    (tmp_path / "t.csv").write_text("\n".join(lines) + "\n")
    code, _, said = run(capsys, "compensate", tmp_path / "t.csv", "--run", tmp_path / "id", "--out", tmp_path / "c")
    assert code == 0 and "every target carries the load that was identified, 1.498 kg" in said
    assert "µm (1σ, root mean square) is the load's uncertainty" in said


def test_the_load_is_drawn_as_the_ellipsoid_that_has_its_inertia() -> None:
    half, axes = equivalent_ellipsoid(LOAD.mass_kg, LOAD.inertia_kgm2)
    squares = half**2
    moments = LOAD.mass_kg / 5 * (squares.sum() - squares)
    np.testing.assert_allclose(axes @ np.diag(moments) @ axes.T, LOAD.inertia_kgm2, atol=1e-15)
    ball, _ = equivalent_ellipsoid(7850 * 4 / 3 * np.pi * 0.05**3, np.full((3, 3), np.nan))
    np.testing.assert_allclose(ball, 0.05)


@pytest.fixture(scope="module")
def spoilt(files: Path, tmp_path_factory) -> Path:
    """Files with a mistake each, beside the right ones."""
    folder = tmp_path_factory.mktemp("spoilt")
    for name in ("moving.csv", "static.csv", "sensor.toml"):
        (folder / name).write_text((files / name).read_text())
    (folder / "bare.toml").write_text("[base]\ntilt_x_deg = 1\n")
    lines = (files / "moving.csv").read_text().splitlines()
    cells = lines[1].split(",")
    first = ",".join([cells[0], str(60 * float(cells[1])), *cells[2:]])
    (folder / "degrees.csv").write_text("\n".join([lines[0], first, *lines[2:]]) + "\n")
    table = TX40.model.path.read_text()
    (folder / "bare_arm.toml").write_text("\n".join(row for row in table.splitlines() if "mass_kg" not in row))
    (folder / "uneven.csv").write_text("\n".join([*lines[:6], *lines[7:]]) + "\n")
    other = {"loaded": "unloaded", "unloaded": "loaded"}
    swapped = [f"{line.rpartition(',')[0]},{other[line.rpartition(',')[2]]}" for line in lines[1:]]
    (folder / "exchanged.csv").write_text("\n".join([lines[0], *swapped]) + "\n")
    still = [",".join([line.split(",")[0], *lines[1].split(",")[1:-1], line.split(",")[-1]]) for line in lines[1:]]
    (folder / "still.csv").write_text("\n".join([lines[0], *still]) + "\n")
    return folder


@pytest.mark.parametrize(
    ("arguments", "fragments"),
    {
        "no masses": (("moving.csv", "--robot", "bare_arm.toml"), ("moving.csv", "no masses", "mass_kg")),
        "no sensor file": (("static.csv", "--robot", "tx40"), ("static.csv", "sign", "--sensor")),
        "no such sensor file": (("static.csv", "--robot", "tx40", "--sensor", "gone.toml"), ("gone.toml", "path")),
        "a sensor without a sign": (("static.csv", "--robot", "tx40", "--sensor", "bare.toml"), ("bare.toml", "sign")),
        "no wrench": (
            ("moving.csv", "--robot", "tx40", "--method", "wrench", "--sensor", "sensor.toml"),
            ("no wrench", "fx_n"),
        ),
        "degrees": (("degrees.csv", "--robot", "tx40"), ("degrees.csv", "line 2", "q1_rad", "probably degrees")),
        "uneven": (("uneven.csv", "--robot", "tx40"), ("uneven.csv", "line 7", "time_s", "evenly timed")),
        "runs exchanged": (("exchanged.csv", "--robot", "tx40"), ("exchanged.csv", "-1.5", "exchanged", "sign")),
        "a motion that is none": (("still.csv", "--robot", "tx40"), ("still.csv", "nothing of the load shows")),
        "friction of a wrench": (
            ("static.csv", "--robot", "tx40", "--sensor", "sensor.toml", "--friction"),
            ("--friction", "torques"),
        ),
        "friction at rest": (("static.csv", "--robot", "tx40", "--method", "torques", "--friction"), ("static poses",)),
        "sag of a run that is none": (("static.csv", "--run", "."), ("config.json", "lab calibrate")),
        "sag and a sensor": (("static.csv", "--run", ".", "--sensor", "sensor.toml"), ("--run", "--sensor", "one")),
        "stiffness of zero": (("moving.csv", "--robot", "tx40", "--stiffness-nm-per-rad", "0"), ("above zero",)),
    }.values(),
)
def test_bad_input_is_one_line(arguments, fragments, spoilt: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(spoilt)
    before = {path.name for path in spoilt.iterdir()}
    assert main(["payload", *arguments, "--out", "run"]) == 2
    said = capsys.readouterr()
    (line,) = said.err.strip().splitlines()
    assert said.out == "" and [part for part in fragments if part not in line] == [], line
    assert {path.name for path in spoilt.iterdir()} == before


@pytest.mark.parametrize(
    ("content", "fragment"),
    [(None, "cannot be read"), ("{}", "is not in the lab's format: 'mass_kg' is missing")],
)
def test_a_load_that_is_none_is_refused(content: str | None, fragment: str, tmp_path: Path, capsys) -> None:
    (tmp_path / "no").mkdir()
    if content is not None:
        (tmp_path / "no" / "load.json").write_text(content)
    assert main(["calibrate", "--load", str(tmp_path / "no"), "--out", str(tmp_path / "run")]) == 2
    assert fragment in capsys.readouterr().err


def test_a_load_whose_centre_was_not_told_is_refused(tmp_path: Path, capsys) -> None:
    HandLoad(1.0, np.full(3, np.nan), np.eye(4)).write(tmp_path)
    assert main(["calibrate", "--load", str(tmp_path), "--out", str(tmp_path / "run")]) == 2
    assert "were not identified there" in capsys.readouterr().err


@pytest.mark.thorough
def test_an_arm_that_sags_tells_mass_and_centre(tmp_path: Path, capsys) -> None:
    """Tracked with and without the load, and the compliances that a run identified."""
    arm = ("--robot", "tx40", "--model", "compliance", "--stiffness-nm-per-rad", 2e4, "--payload-kg", "0,2")
    assert run(capsys, "calibrate", *arm, "--seed", 2, "--poses", 60, "--out", tmp_path / "soft")[0] == 0
    calibrated = load_run(tmp_path / "soft")
    assert calibrated.robot.loads is not None
    carrying = replace(calibrated.robot, loads=replace(calibrated.robot.loads, payload_at_m=LOAD.centre_m))
    model = carrying.arm_with(calibrated.estimate.arm.targets, ["compliance"])
    joints, rng = random_poses(TX40.model, 30, np.random.default_rng(4)), np.random.default_rng(5)
    rows = []
    for kind, mass in (("unloaded", 0.0), ("loaded", LOAD.mass_kg)):
        points = model.points(np.column_stack([joints, np.full(30, mass)]), calibrated.estimate.values)[:, 0]
        both = np.column_stack([joints, points + 2e-6 * rng.standard_normal(points.shape)])
        rows += [[*map(repr, row), kind] for row in both.tolist()]
    header = ",".join([*(f"q{i}_rad" for i in range(1, 7)), *(f"p1_{axis}_m" for axis in "xyz"), "run"])
    (tmp_path / "sag.csv").write_text("\n".join([header, *(",".join(row) for row in rows)]) + "\n")
    code, seen, _ = run(capsys, "payload", tmp_path / "sag.csv", "--run", tmp_path / "soft", "--out", tmp_path / "sag")
    assert code == 0 and seen["rank"] == 4 and seen["method"] == "sag"
    assert_the_load(seen)
    assert {path.name for path in (tmp_path / "sag").iterdir()} >= {"load.json", "report.html", "result.json"}


@pytest.mark.thorough
def test_a_wild_reading_is_told_and_not_believed(files: Path, tmp_path: Path, capsys) -> None:
    lines = (files / "moving.csv").read_text().splitlines()
    cells = lines[1200].split(",")
    cells[8] = "900.0"  # Nm of joint 2
    (tmp_path / "wild.csv").write_text("\n".join([*lines[:1200], ",".join(cells), *lines[1201:]]) + "\n")
    code, seen, said = run(capsys, "payload", tmp_path / "wild.csv", "--robot", "tx40", "--out", tmp_path / "run")
    assert code == 1 and any("standard deviations off" in words for words in seen["warnings"]) and "intervals" in said


def test_the_sag_of_an_arm_without_masses_is_refused(tmp_path: Path, capsys) -> None:
    """A measured table says nothing of masses, whatever its virtual arm was given."""
    assert run(capsys, "calibrate", "--robot", "scara", "--poses", 30, "--out", tmp_path / "c")[0] == 0
    data = tmp_path / "c" / "measurements.csv"
    assert run(capsys, "identify", data, "--robot", "scara", "--out", tmp_path / "i")[0] == 0
    code, _, said = run(capsys, "payload", data, "--run", tmp_path / "i", "--out", tmp_path / "p")
    assert code == 2 and "robot scara has no masses" in said and not (tmp_path / "p").exists()


def test_a_rehearsed_day_is_evaluated_from_its_own_files(tmp_path: Path, capsys) -> None:
    folder, robot = tmp_path / "day", ("--robot", "scara")
    quick = ("--simulate", "--rounds", "0", "--rate-hz", "100", "--seconds", "5")
    day = run(capsys, "payload", *robot, *quick, "--out", folder)[1]
    code, _, said = run(capsys, "payload", folder / "load.csv", "--robot", "scara", "--out", tmp_path / "again")
    assert code == 2 and "masses" in said  # the rehearsal assumes them, a real evaluation does not
    assert day["true"]["mass_kg"] == 1.0
    assert abs(day["mass_kg"]["value"] - 1.0) < 2 * day["mass_kg"]["half_width_95"] < 0.2
    names = {path.name for path in folder.iterdir()}
    assert {"load.csv", "sensor.toml", "result.json", "report.html"} <= names


def test_a_rehearsal_or_a_file(files: Path, capsys) -> None:
    for arguments, says in (
        ((), "or --simulate"),
        ((files / "moving.csv", "--simulate"), "one of the two"),
        ((files / "moving.csv", "--lag-ms", 3), "--lag-ms needs --simulate"),
        (("--simulate", "--sensor", files / "sensor.toml"), "leave --run, --sensor out"),
    ):
        code, _, said = run(capsys, "payload", *arguments, "--robot", "tx40")
        assert code == 2 and says in said and said.count("\n") == 1
