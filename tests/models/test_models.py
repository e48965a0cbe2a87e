"""The models' folders: layout, masses, looks, and a second of physics without a warning."""

import hashlib
import json
import shlex

import mujoco
import numpy as np
import pytest
import trimesh
from helpers.robots import IRB120, ROOT

from lab.cli.main import main
from lab.formats.drives_toml import read_drives
from lab.formats.measurement_csv import read_measurements
from lab.robots.load_robot import load_robot
from lab.robots.robot_files import models_folder, own_models, sha256_of
from lab.sensors.sensor_registry import sensor_named

CLOSED = sorted(path for folder in (ROOT / "models").glob("*/mechanism.toml") for path in folder.parent.glob("*.toml"))
MEASURED = sorted((ROOT / "models").glob("*/measured"))
ROBOTS = {path: name for name, path in own_models().items()}  # each once
SCENES = [name for path, name in ROBOTS.items() if "/" not in name or path.parent.name == "carrier"]


def mjcf_of(description):
    """Where ``build_closed_models.py`` writes it."""
    return description.with_name("robot.xml" if description.stem == "mechanism" else f"{description.stem}.xml")


@pytest.mark.parametrize("folder", MEASURED, ids=lambda folder: folder.parent.name)
def test_measured_data_have_a_licence_and_their_source_in_the_readme(folder) -> None:
    """Each file is read as measurements of its robot, and the README says where it comes from."""
    licence, text = (folder / "LICENSE").read_text(), (folder.parent / "README.md").read_text()
    assert licence.startswith("MIT License\n\nCopyright (c) ") and "measured/LICENSE" in text
    files = [path for path in folder.iterdir() if path.name != "LICENSE"]
    chain = load_robot(folder.parent.name).chain
    for path in files:
        assert f"measured/{path.name}" in text and path.suffix == ".csv"
        joints, rows = chain.joint_names, path.read_text().splitlines()
        kind = sensor_named("socket" if "socket," in rows[0] else "points")
        data = read_measurements(path, joints, chain.prismatic, columns=kind.columns)
        inside = (data.joints >= chain.lower - 1e-6) & (data.joints <= chain.upper + 1e-6)  # rad: printed digits
        assert len(data) == len(rows) - 1 and inside.all()


@pytest.mark.thorough
@pytest.mark.parametrize("folder", MEASURED, ids=lambda folder: folder.parent.name)
def test_the_command_of_a_measured_robot_s_readme_runs(folder, tmp_path, monkeypatch, capsys) -> None:
    command = (folder.parent / "README.md").read_text().split("```sh\n")[1].split("```")[0].replace("\\\n", "")
    monkeypatch.chdir(ROOT)
    assert main([*shlex.split(command)[1:], "--out", str(tmp_path / "run"), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["status"] == "converged" and result["after_mm"]["mean"] < 0.7 * result["before_mm"]["mean"]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", SCENES)
def test_the_scene_steps_a_second_without_a_warning(name) -> None:
    model = load_robot(name).model.model
    data = mujoco.MjData(model)
    for _ in range(int(1.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    assert not any(warning.number for warning in data.warning)
    assert np.isfinite(data.qpos).all() and np.abs(data.qvel).max() < 100


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    "path",
    sorted(path for path in (ROOT / "models").glob("*/*.toml") if path.name != "drives.toml"),
    ids=lambda path: f"{path.parent.name}-{path.stem}",
)
def test_limits_in_mujoco_are_those_of_the_description(path) -> None:
    robot = load_robot(str(path))
    assert robot.warnings == ()
    joints = {robot.model.model.joint(i).name: robot.model.model.jnt_range[i] for i in range(robot.model.model.njnt)}
    for name, lower, upper in zip(robot.chain.joint_names, robot.chain.lower, robot.chain.upper, strict=True):
        if name in joints:  # a leg's length is no joint there
            np.testing.assert_allclose(joints[name], [lower, upper], rtol=1e-12)


@pytest.mark.parametrize("path", CLOSED, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_the_mjcf_of_a_mechanism_is_what_its_description_says(path) -> None:
    """``build_closed_models.py`` writes it: the same numbers, whatever MuJoCo's layout of a file."""
    built, read = load_robot(str(path)).model.model, mujoco.MjModel.from_xml_path(str(mjcf_of(path)))
    for name in ("body_pos", "body_quat", "jnt_axis", "jnt_range", "qpos0", "site_pos", "eq_data", "tendon_length0"):
        np.testing.assert_allclose(getattr(read, name), getattr(built, name), rtol=0, atol=1e-12, err_msg=name)
    assert [read.tendon(i).name for i in range(read.ntendon)] == [built.tendon(i).name for i in range(built.ntendon)]


def test_the_irb120_weighs_25_kg_and_its_links_18() -> None:
    model = IRB120.model.model
    robot = [body for body in range(1, model.nbody) if not model.body(body).name.startswith("tracker")]
    assert model.body_mass[robot].sum() == pytest.approx(25.0, abs=1e-9)
    links = {
        "base": 6.215,
        "link1": 3.067,
        "link2": 3.909,
        "link3": 2.944,
        "link4": 1.328,
        "link5": 0.546,
        "link6": 0.137,
    }
    for name, mass in links.items():
        assert model.body(name).mass[0] == pytest.approx(mass, abs=6e-4)


def test_the_shells_are_closed_and_near_the_collision_shapes() -> None:
    model = IRB120.model.model
    for path in (ROOT / "models" / "irb120" / "assets").iterdir():
        shell = trimesh.load_mesh(path)
        assert shell.is_watertight and shell.volume > 0, path.name
    groups = {int(model.geom_group[geom]) for geom in range(model.ngeom) if model.geom_contype[geom]}
    assert groups <= {0, 3}


def test_the_tx_40_s_wrist_is_coupled_as_published() -> None:
    """By hand: tau5 = 45 tau_m5 + 32 tau_m6, and the sixth motor turns by 32 (q5 + q6); no robot is called so."""
    path = models_folder() / "tx40" / "drives.toml"
    drives, motor = read_drives(path, 6), np.array([1.0, 2, 3, 4, 5, 6])
    torques = drives.couplings.T @ (drives.gear_ratio * motor)
    np.testing.assert_allclose(torques, [32, 64, 135, -192, 45 * 5 + 32 * 6, 32 * 6])
    joints = np.deg2rad([[10.0, 20, 30, 40, 50, 60]])
    turned = np.deg2rad([[320.0, 640, 1350, -1920, 2250, 32 * (50 + 60)]])
    np.testing.assert_allclose(drives.joints(turned), joints, atol=1e-12)
    assert "tx40/drives" not in own_models() and drives.encoders is None
    table = path.with_name("robot.toml")
    assert sha256_of(table) == hashlib.sha256(b"robot.toml\0" + table.read_bytes()).hexdigest()
