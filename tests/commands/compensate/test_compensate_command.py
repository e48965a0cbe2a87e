"""``lab compensate`` as a user calls it: what it prints, what it writes, what it refuses."""

import csv
import json
import re
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.campaigns import run_of
from helpers.robots import IRB120, perturbed, somewhere

from lab.cli.main import main
from lab.core import se3
from lab.core.se3 import Array
from lab.core.whole_folder import CHECKSUMS, checksum_lines
from lab.formats.robot_toml import read_table
from lab.formats.target_csv import read_targets
from lab.kinematics.differential import singular_distance
from lab.library.load_run import CalibrationRun, load_run
from lab.robots.load_robot import load_robot
from lab.simulation.collisions import collides

FILES = {
    "config.json", "result.json", "report.html", "joints.csv", "cartesian.csv", "nominal.toml", "program.mod",
    "SHA256SUMS", "calibrated.xml", "calibrated.urdf", "calibrated.toml", "calibrated.py", "recording.rrd", "inputs",
}  # fmt: skip


@pytest.fixture(scope="module")
def run() -> Path:
    return run_of(seed=3)


@pytest.fixture(scope="module")
def soft() -> Path:
    return run_of(seed=3, stiffness_nm_per_rad=1e5, payload_kg=(0.0, 3.0), model="compliance")


def poses(calibrated: CalibrationRun, count: int) -> Array:
    """Where the calibrated arm can be, clear of singularities and of all that it could touch."""
    arm, values = calibrated.estimate.geometry
    joints = 0.8 * arm.chain.random_joints(8 * count, np.random.default_rng(1))
    joints = joints[~collides(calibrated.robot.model, joints)]
    joints = joints[singular_distance(arm.tool(joints, values)[1])[0] > 0.05][:count]
    return arm.tool(joints, values)[0]


def write_targets(path: Path, Ts: Array, extra: str = "", cell: str = "") -> None:
    quaternions = se3.quaternion_from_rotation(Ts[:, :3, :3])
    rows = [f"id,x_mm,y_mm,z_mm,qw,qx,qy,qz{extra}"]
    for i, (T, q) in enumerate(zip(Ts, quaternions, strict=True)):
        rows.append(",".join([f"t{i}", *(repr(float(v)) for v in (*(1e3 * T[:3, 3]), *q))]) + cell)
    path.write_text("\n".join(rows) + "\n")


def compensated(capsys, targets: Path, run: Path, out: Path, *more: str) -> tuple[int, dict]:
    code = main(["compensate", str(targets), "--run", str(run), "--out", str(out), "--json", *more])
    return code, json.loads(capsys.readouterr().out)


def rows_of(path: Path) -> tuple[list[str], Array]:
    with path.open(encoding="utf-8") as file:
        table = [row for row in csv.DictReader(file) if row.get("stop") != "via"]
    return [row["id"] for row in table], np.array(
        [[row[key] for key in row if key not in ("id", "stop")] for row in table], dtype=float
    )


@pytest.mark.thorough
def test_the_corrected_joints_bring_the_tool_to_the_targets(run: Path, tmp_path, capsys) -> None:
    """By the exported arm, in MuJoCo; and the corrected targets by the nominal arm alone."""
    calibrated = load_run(run)
    Ts = poses(calibrated, 40)
    Ts[11, :3, 3] += 4.0
    write_targets(tmp_path / "targets.csv", Ts)
    out = tmp_path / "out"
    code, result = compensated(capsys, tmp_path / "targets.csv", run, out)
    assert code == 1 and {path.name for path in out.iterdir()} == FILES
    assert result == json.loads((out / "result.json").read_text())
    assert (result["targets"], result["converged"]) == (40, 39) and result["tool"] == "p1"
    assert [each["id"] for each in result["failed"]] == ["t11"] and "out of reach" in result["failed"][0]["reason"]
    assert 0.3 < result["correction_mm"]["mean"] < result["correction_mm"]["max"] < 12
    assert 0.001 < result["predicted_mm"]["mean"] < 0.01 and result["schemes_apart_mm"] <= 1e-3
    (frame,) = result["warnings"]
    assert result["without_effects_mm"] is None and "t11" in frame

    kept = [i for i in range(40) if i != 11]
    ids, degrees = rows_of(out / "joints.csv")
    assert ids == [f"t{i}" for i in kept]
    model = mujoco.MjModel.from_xml_path(str(out / "calibrated.xml"))
    data, tracker, site = mujoco.MjData(model), model.site("tracker").id, model.site("p1").id
    for angles, T in zip(np.deg2rad(degrees), Ts[kept], strict=True):
        data.qpos[:] = angles
        mujoco.mj_kinematics(model, data)
        R = data.site_xmat[tracker].reshape(3, 3)
        np.testing.assert_allclose(R.T @ (data.site_xpos[site] - data.site_xpos[tracker]), T[:3, 3], atol=1e-9)

    corrected = read_targets(out / "cartesian.csv", IRB120.chain.joint_names, IRB120.chain.prismatic)
    drawing = calibrated.estimate.nominal_inverse(0)
    by_controller = drawing.tool(np.deg2rad(degrees))[0]
    np.testing.assert_allclose(by_controller[:, :3, 3], corrected.positions, atol=1e-6)
    np.testing.assert_allclose(by_controller[:, :3, :3], corrected.rotations, atol=1e-6)
    np.testing.assert_array_equal(corrected.joints, np.deg2rad(degrees))  # which of the ways to them
    nominal = read_table(out / "nominal.toml")
    assert (nominal.chain.table == IRB120.chain.table).all()
    assert nominal.base is not None and (nominal.base == drawing.values[:6]).all()
    assert (nominal.tool["p1"] == drawing.values[-3:]).all()


@pytest.mark.thorough
def test_the_program_and_the_arm_are_those_of_the_run(run: Path, tmp_path, capsys) -> None:
    calibrated = load_run(run)
    Ts = poses(calibrated, 3)
    write_targets(tmp_path / "targets.csv", Ts)
    out = tmp_path / "out"
    assert compensated(capsys, tmp_path / "targets.csv", run, out)[0] == 0
    program = (out / "program.mod").read_text(encoding="ascii")
    found = re.findall(r"jointtarget \w+:=\[\[([^\]]*)\]", program)
    _, degrees = rows_of(out / "joints.csv")
    stops = json.loads((out / "result.json").read_text())["stops"]
    at_stops = [[stop[f"q{i}_deg"] for i in range(1, 7)] for stop in stops]
    np.testing.assert_allclose([[float(x) for x in each.split(",")] for each in found], at_stops, atol=1e-6)
    assert [stop["stop"] for stop in stops if stop["stop"] != "via"] == ["target"] * 3
    assert [list(stop.values())[2:] for stop in stops if stop["stop"] == "target"] == degrees.tolist()
    assert [stops[0]["id"], stops[-1]["id"]] == ["home", "home_again"]
    drawing = calibrated.estimate.nominal_inverse(0)
    base, _, tool = drawing.arm.split(drawing.values)  # the controller computes with the drawing, so these suit it
    tool_at = re.search(r"tooldata \w+:=\[TRUE,\[\[([^\]]*)\]", program)
    frame = re.search(r'wobjdata \w+:=\[FALSE,TRUE,"",\[\[([^\]]*)\],\[([^\]]*)\]', program)
    assert tool_at and frame
    np.testing.assert_allclose([float(x) / 1e3 for x in tool_at[1].split(",")], tool[0], atol=1e-9)
    place, turn = (np.array([float(x) for x in group.split(",")]) for group in frame.groups())
    T_frame0_instrument = se3.pose(se3.rotation_from_quaternion(turn), place / 1e3)
    np.testing.assert_allclose(T_frame0_instrument @ se3.pose(se3.exp(base[3:]), base[:3]), np.eye(4), atol=1e-8)
    table = read_table(out / "calibrated.toml")
    arm, values = calibrated.estimate.geometry
    base, rows, tool = arm.split(values)
    assert (table.chain.table == rows).all() and (table.base == base).all() and (table.tool["p1"] == tool[0]).all()
    urdf = load_robot(str(out / "calibrated.urdf"))
    assert urdf.chain.joint_names == IRB120.chain.joint_names


@pytest.mark.thorough
def test_a_bent_arm_is_corrected_for_its_payload_and_says_what_files_cannot_hold(soft: Path, tmp_path, capsys) -> None:
    Ts = poses(load_run(soft), 20)
    write_targets(tmp_path / "loaded.csv", Ts, ",payload_kg", ",3")
    code, result = compensated(capsys, tmp_path / "loaded.csv", soft, tmp_path / "loaded")
    assert code == 0 and result["model"] == "geometric+compliance"
    assert 0.1 < result["without_effects_mm"] < 0.5
    header = (tmp_path / "loaded" / "joints.csv").read_text().splitlines()[0]
    assert header == "id,stop,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,payload_kg"
    write_targets(tmp_path / "empty.csv", Ts)
    code, unloaded = compensated(capsys, tmp_path / "empty.csv", soft, tmp_path / "empty")
    assert code == 0 and unloaded["without_effects_mm"] < 0.8 * result["without_effects_mm"]
    assert any("no column payload_kg" in warning for warning in unloaded["warnings"])
    (_, heavy), (_, light) = (rows_of(tmp_path / name / "joints.csv") for name in ("loaded", "empty"))
    lifted = np.abs(np.deg2rad(heavy[:, 1] - light[:, 1]))
    assert 1e-5 < lifted.max() < 1e-3  # 3 kg half a metre out on 1e5 Nm/rad


@pytest.mark.thorough
def test_hysteresis_is_corrected_in_the_order_of_the_targets(tmp_path, capsys) -> None:
    """The arm comes to a target from the one before: the joint positions lean against the way that it comes."""
    out = tmp_path / "sticky"
    assert main(["calibrate", "--hysteresis-mrad", "0.4", "--model", "hysteresis", "--out", str(out), "--json"]) == 0
    capsys.readouterr()
    run = load_run(out)
    Ts = poses(run, 12)
    found = []
    for name, order in (("forth", Ts), ("back", Ts[::-1])):
        write_targets(tmp_path / f"{name}.csv", order)
        code, result = compensated(capsys, tmp_path / f"{name}.csv", out, tmp_path / name)
        assert code == 0 and any("from each target to the next" in warning for warning in result["warnings"])
        found.append(np.deg2rad(rows_of(tmp_path / name / "joints.csv")[1][:, :6]))
    signs = [np.sign(np.diff(joints, axis=0, prepend=joints[:1])) for joints in found]
    (forth, back), signs = (found[0], found[1][::-1]), [signs[0], signs[1][::-1]]
    known = dict(zip(run.estimate.arm.names, run.estimate.values, strict=True))
    width = np.array([known[f"joint{i}.hysteresis"] for i in range(1, 7)])
    same = np.abs(forth - back).max(axis=1) < 0.01  # the same solution of the inverse
    assert same.sum() >= 4 and (width > 1e-4).all()
    np.testing.assert_allclose((forth - back)[same], (-width / 2 * (signs[0] - signs[1]))[same], atol=1e-8)


def copied(run: Path, tmp_path: Path, name: str, change) -> Path:
    folder = tmp_path / "changed"
    shutil.copytree(run, folder, ignore=shutil.ignore_patterns(CHECKSUMS))
    path = folder / name
    path.write_text(change(path.read_text()))
    (folder / CHECKSUMS).write_text(checksum_lines(folder))  # as if it had been written so
    return folder


@pytest.mark.thorough
@pytest.mark.parametrize("verdict", ["bad", "not judged"])
def test_a_run_that_is_not_good_is_refused_unless_forced(run: Path, tmp_path, capsys, verdict: str) -> None:
    changed = copied(run, tmp_path, "result.json", lambda text: json.dumps({**json.loads(text), "verdict": verdict}))
    write_targets(tmp_path / "targets.csv", poses(load_run(run), 2))
    arguments = ["compensate", str(tmp_path / "targets.csv"), "--run", str(changed), "--out", str(tmp_path / "out")]
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert f"'{verdict}'" in said and "--force" in said and said.count("\n") == 1 and not (tmp_path / "out").exists()
    assert main([*arguments, "--force"]) == 0


def test_a_doubtful_run_is_used_and_its_reasons_are_repeated(run: Path, tmp_path, capsys) -> None:
    doubt = {"verdict": "doubtful", "reason": "lack of fit", "reasons": ["lack of fit"], "gate_mm": 0.25}
    changed = copied(run, tmp_path, "result.json", lambda text: json.dumps({**json.loads(text), **doubt}))
    write_targets(tmp_path / "targets.csv", poses(load_run(run), 2))
    code, found = compensated(capsys, tmp_path / "targets.csv", changed, tmp_path / "out")
    assert code == 0 and found["verdict"] == "doubtful" and found["reasons"] == ["the run is doubtful: lack of fit"]
    assert found["run_verdict"] == {"verdict": "doubtful", "reasons": ["lack of fit"], "gate_mm": 0.25}


@pytest.mark.thorough
def test_targets_that_are_moved_too_far_are_doubtful(run: Path, tmp_path, capsys) -> None:
    """With tolerances a hundred times smaller the same corrections are more than any arm needs."""
    write_targets(tmp_path / "targets.csv", poses(load_run(run), 2))

    def precise(text: str) -> str:
        config = json.loads(text)
        config["options"]["fitting"] |= {"tolerance_mm": 0.005, "tolerance_mrad": 0.015}
        return json.dumps(config)

    changed = copied(run, tmp_path, "config.json", precise)
    code, found = compensated(capsys, tmp_path / "targets.csv", changed, tmp_path / "out")
    assert code == 0 and found["verdict"] == "doubtful"


@pytest.mark.parametrize(
    ("targets", "change", "words"),
    [
        ("id,x,y,z\na,1,2,3\n", None, "column x: unknown unit or axis"),
        ("x_mm,y_mm,z_mm,qw,qx,qy,qz\n1,2,3,1,1,0,0\n", None, "quaternion's norm is 1.41421"),
        ("p2_x_mm,p2_y_mm,p2_z_mm\n1,2,3\n", None, "tool p2 was not identified"),
        ("x_mm,y_mm,z_mm,q7_deg\n1,2,3,4\n", None, "q7_deg is no joint of the robot"),
        ("x_mm,y_mm,z_mm\n1,2,3\n", ("config.json", lambda text: text.replace('256": "', '256": "0')), "another robot"),
        (
            "x_mm,y_mm,z_mm\n1,2,3\n",
            ("config.json", lambda text: text.replace('"observe": "points"', '"observe": "socket"')),
            "--observe socket",
        ),
        (
            "x_mm,y_mm,z_mm\n1,2,3\n",
            (
                "parameters.json",
                lambda text: json.dumps([r for r in json.loads(text) if not r["name"].startswith("tool.")]),
            ),
            "has no tool",
        ),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(run: Path, tmp_path, capsys, targets, change, words: str) -> None:
    path = tmp_path / "targets.csv"
    path.write_text(targets)
    folder = run if change is None else copied(run, tmp_path, *change)
    out = tmp_path / "out"
    assert main(["compensate", str(path), "--run", str(folder), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert words in said and said.startswith("lab: ") and said.count("\n") == 1 and not out.exists()


@pytest.mark.thorough
def test_what_the_model_lacks_is_in_the_error_to_expect(tmp_path, capsys) -> None:
    """An arm that bends, calibrated as if it did not: good, but with a lack of fit."""
    run = tmp_path / "bent"
    bends = ["--stiffness-nm-per-rad", "1e5", "--payload-kg", "0,3"]
    assert main(["calibrate", "--seed", "6", *bends, "--out", str(run), "--json"]) == 0
    after = json.loads(capsys.readouterr().out)["after_mm"]
    write_targets(tmp_path / "targets.csv", poses(load_run(run), 20), ",payload_kg", ",3")
    code, result = compensated(capsys, tmp_path / "targets.csv", run, tmp_path / "out")
    assert code == 0 and result["judged_mm"] == after["mean"]
    assert 0.7 * after["rms"] < result["predicted_mm"]["mean"] < 2 * after["rms"]


@pytest.mark.thorough
def test_measured_orientations_turn_the_tool(tmp_path, capsys) -> None:
    """A tool that stands askew on the last frame: targets are of its axes, not of the flange's."""
    rng = np.random.default_rng(5)
    arm, askew = IRB120.arm(("p1",)), se3.exp(np.array([0.3, -0.2, 0.5]))
    values = perturbed(arm, somewhere(arm, rng), rng, 0.5e-3, 1.5e-3)
    joints = 0.8 * IRB120.chain.random_joints(60, rng)
    Ts = arm.tool(joints, values)[0]
    Ts[:, :3, :3] = Ts[:, :3, :3] @ askew
    names = [f"q{i}_rad" for i in range(1, 7)]
    rows = [",".join([*names, "p1_x_mm", "p1_y_mm", "p1_z_mm", "p1_qw", "p1_qx", "p1_qy", "p1_qz"])]
    quaternions = se3.quaternion_from_rotation(Ts[:, :3, :3])
    rows += [
        ",".join(map(repr, map(float, [*q, *(1e3 * T[:3, 3]), *o])))
        for q, T, o in zip(joints, Ts, quaternions, strict=True)
    ]
    (tmp_path / "poses.csv").write_text("\n".join(rows) + "\n")
    run = tmp_path / "run"
    flags = ["--observe", "pose", "--noise-mm", "0.001", "--noise-mrad", "0.001"]
    assert main(["identify", str(tmp_path / "poses.csv"), *flags, "--out", str(run), "--json"]) == 0
    write_targets(tmp_path / "targets.csv", Ts[:8])
    capsys.readouterr()
    code, _ = compensated(capsys, tmp_path / "targets.csv", run, tmp_path / "out")
    assert code == 0
    _, degrees = rows_of(tmp_path / "out" / "joints.csv")
    back = arm.tool(np.deg2rad(degrees), values)[0]
    np.testing.assert_allclose(back[:, :3, 3], Ts[:8, :3, 3], atol=1e-7)
    np.testing.assert_allclose(back[:, :3, :3] @ askew, Ts[:8, :3, :3], atol=1e-7)


@pytest.mark.parametrize("inside", ["run", "targets"])
def test_what_it_is_made_from_is_not_replaced(run: Path, tmp_path, capsys, inside: str) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(run, copy)
    path = (copy if inside == "targets" else tmp_path) / "targets.csv"
    write_targets(path, poses(load_run(run), 2))
    assert main(["compensate", str(path), "--run", str(copy), "--out", str(copy)]) == 2
    assert "an input of this run" in capsys.readouterr().err and (copy / "parameters.json").is_file()


@pytest.mark.parametrize("name", ["config.json", "Joints.csv", "SHA256SUMS", "inputs"])
def test_a_program_never_replaces_a_file_of_the_run(name: str, tmp_path: Path, capfd) -> None:
    (tmp_path / name).write_text("x")
    assert main(["compensate", "--program", str(tmp_path / name), "--run", "gone", "--out", str(tmp_path / "out")]) == 2
    assert f"a file {name} of its own" in capfd.readouterr().err
    assert not (tmp_path / "out").exists()
