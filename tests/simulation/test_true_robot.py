"""The virtual arm: its truth, its tracker's noise, its streams, its poses."""

import mujoco
import numpy as np
import pytest
from helpers.robots import IRB120, somewhere

import lab
from lab.core import se3
from lab.core.errors import LabWarning
from lab.core.random import rng_for
from lab.kinematics.serial.serial_arm import SerialArm
from lab.library.virtual_arm import perturbed_arm
from lab.options.virtual_campaign import VirtualCampaign
from lab.robots.load_robot import load_robot
from lab.simulation.collisions import collides, random_poses
from lab.simulation.load_model import calibrated_mjcf
from lab.simulation.robot_model import at_zero
from lab.simulation.true_robot import Perturbation, perturbed_bodies, random_perturbation, random_tracker, true_robot

MODEL = IRB120.model
TARGETS = ("p1", "p2", "p3")
ARM = SerialArm(IRB120.chain, TARGETS)


def test_the_table_is_the_drawings() -> None:
    table = IRB120.chain.table * [180 / np.pi, 1e3, 1e3, 180 / np.pi, 1]
    expected = [
        [0, 290, 0, -90, 0],
        [-90, 0, 270, 0, 0],
        [0, 0, 70, -90, 0],
        [0, 302, 0, 90, 0],
        [0, 0, 0, -90, 0],
        [180, 72, 0, 0, 0],
    ]
    np.testing.assert_allclose(table, expected, atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(IRB120.chain.lower), [-165, -110, -110, -160, -120, -400])
    np.testing.assert_allclose(np.rad2deg(IRB120.chain.upper), [165, 110, 70, 160, 120, 400])
    np.testing.assert_allclose(np.rad2deg(IRB120.chain.speed), [250, 250, 250, 320, 320, 420])


def test_equations_agree_with_mujoco() -> None:
    """Sites of the nominal model at 10,000 random poses, to 1e-12 m."""
    joints = IRB120.chain.random_joints(10_000, np.random.default_rng(0))
    still = Perturbation((), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(6))
    seen = true_robot(MODEL, still, np.eye(4)).points(joints, TARGETS)
    np.testing.assert_allclose(ARM.points(joints, ARM.nominal(IRB120.tool)), seen, atol=1e-12)


@pytest.mark.parametrize(("metres", "radians"), [(0.5e-3, 1.5e-3), (5e-3, 20e-3)])
def test_the_truth_is_the_arm(metres: float, radians: float) -> None:
    """The canonical parameters reproduce the perturbed model at 1,000 poses, joint offsets included."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        off = random_perturbation(MODEL, metres, radians, rng)
        off = Perturbation(off.bodies, off.position_m, off.rotation_rad, radians * rng.normal(size=6))
        real = true_robot(MODEL, off, random_tracker(MODEL, rng))
        truth = real.truth(ARM.targets)
        joints = IRB120.chain.random_joints(1000, rng)
        np.testing.assert_allclose(ARM.points(joints, truth.values), real.points(joints, TARGETS), atol=1e-12)
        fixed = list(truth.base_set.fixed)
        np.testing.assert_array_equal(truth.values[fixed], ARM.nominal(IRB120.tool)[fixed])


def test_each_body_can_be_off() -> None:
    """Moving any one body by 1 mm along an axis moves the target by just that at zero readings."""
    assert perturbed_bodies(MODEL) == ("base", *(f"link{i}" for i in range(1, 7)), "flange")
    zero = np.zeros((1, 6))
    still = true_robot(MODEL, Perturbation((), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(6)), np.eye(4))
    for body in perturbed_bodies(MODEL):
        off = Perturbation((body,), np.array([[0, 1e-3, 0]]), np.zeros((1, 3)), np.zeros(6))
        moved = true_robot(MODEL, off, np.eye(4)).points(zero, TARGETS) - still.points(zero, TARGETS)
        np.testing.assert_allclose(moved[0], np.tile([0, 1e-3, 0], (3, 1)), atol=1e-15)


def test_a_denavit_hartenberg_arm_has_just_those_parameters() -> None:
    """--dh-only: the model is placed on a perturbed table; only base and what the gauge moves differ from it."""
    options = VirtualCampaign(seed=3, dh_only=True)
    real = perturbed_arm(IRB120, options)
    again = perturbed_arm(IRB120, options)
    joints = IRB120.chain.random_joints(200, np.random.default_rng(0))
    np.testing.assert_array_equal(real.points(joints, TARGETS), again.points(joints, TARGETS))
    truth = real.truth(ARM.targets)
    np.testing.assert_allclose(ARM.points(joints, truth.values), real.points(joints, TARGETS), atol=1e-12)
    base = [ARM.names.index(f"base.{axis}") for axis in ("x", "y", "z")]
    assert np.abs(truth.values - ARM.nominal(IRB120.tool))[len(base) + 3 :].max() < 0.01


def test_more_poses_keep_the_first_ones_and_none_collides() -> None:
    fifty = random_poses(MODEL, 50, rng_for(1, "poses"))
    sixty = random_poses(MODEL, 60, rng_for(1, "poses"))
    np.testing.assert_array_equal(fifty, sixty[:50])
    assert not collides(MODEL, sixty).any()
    assert ((sixty >= IRB120.chain.lower) & (sixty <= IRB120.chain.upper)).all()
    assert collides(MODEL, np.deg2rad([[0, 60, 70, 0, 110, 0]])).all()  # folded into its own base


def test_a_calibrated_arm_is_a_robot_again(tmp_path) -> None:
    """Read as a drawing, nearly parallel axes get a beta, not a d of a hundred metres (facts, section 7)."""
    truth = perturbed_arm(IRB120, VirtualCampaign(seed=7)).truth(ARM.targets)
    path = tmp_path / "calibrated.xml"
    path.write_text(calibrated_mjcf(MODEL, ARM, truth.values))
    again = load_robot(str(path))
    assert np.abs(again.chain.table[:, 1:3]).max() < 0.5 and again.chain.parallel == IRB120.chain.parallel
    np.testing.assert_allclose(again.chain.table, IRB120.chain.table, atol=0.05)
    arm = again.arm(TARGETS)
    real = perturbed_arm(again, VirtualCampaign(seed=8))
    joints = again.chain.random_joints(100, np.random.default_rng(0))
    np.testing.assert_allclose(
        arm.points(joints, real.truth(arm.targets).values), real.points(joints, TARGETS), atol=1e-12
    )
    assert len(real.truth(arm.targets).base_set.identifiable) == 33


def test_the_calibrated_model_loads_again_exactly(tmp_path) -> None:
    """calibrated.xml: sites in the tracker's frame as identified, to 1e-12 m, from an empty folder."""
    rng = np.random.default_rng(4)
    values = somewhere(ARM, rng)
    values[:6] += ARM.nominal()[:6]
    values += 1e-3 * rng.normal(size=len(values))
    path = tmp_path / "calibrated.xml"
    path.write_text(calibrated_mjcf(MODEL, ARM, values))
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    tracker, sites = model.site("tracker").id, [model.site(name).id for name in TARGETS]
    for joints in IRB120.chain.random_joints(200, rng):
        data.qpos[:] = joints
        mujoco.mj_kinematics(model, data)
        T = se3.pose(data.site_xmat[tracker].reshape(3, 3), data.site_xpos[tracker])
        seen = se3.transform(se3.inverse(T), data.site_xpos[sites])
        np.testing.assert_allclose(seen, ARM.points(joints[None], values)[0], atol=1e-12)


def test_a_measured_point_may_be_called_as_a_site_of_another_branch() -> None:
    """The site of the other hand gets a free name, and the measured one stands where it was found."""
    robot = load_robot("torso", tips=("left",))
    arm = robot.arm(("right.p1",))
    values = somewhere(arm, np.random.default_rng(5))
    model = mujoco.MjModel.from_xml_string(calibrated_mjcf(robot.model, arm, values))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    tracker, site = model.site("tracker").id, model.site("right.p1").id
    T = se3.pose(data.site_xmat[tracker].reshape(3, 3), data.site_xpos[tracker])
    seen = se3.transform(se3.inverse(T), data.site_xpos[[site]])
    np.testing.assert_allclose(seen, arm.points(np.zeros((1, arm.chain.size)), values)[0], atol=1e-12)


def test_mujoco_says_nothing_of_the_dynamics(tmp_path, monkeypatch, capfd) -> None:
    """A link of 1e11 m makes its inertia matrix nearly singular: MuJoCo would print that, and leave a log."""
    link = '<body name="b{1}" pos="{0} 0 0"><joint name="q{1}" axis="0 1 0"/><geom size=".05" mass="1"/>{2}</body>'
    chain = link.format(0, 1, link.format(1e11, 2, link.format(0.3, 3, "")))
    (tmp_path / "far.xml").write_text(f"<mujoco><worldbody>{chain}</worldbody></mujoco>")
    monkeypatch.chdir(tmp_path)
    before = mujoco.get_mju_user_warning()
    lab.simulate("far.xml", poses=3)
    assert capfd.readouterr() == ("", "") and not (tmp_path / "MUJOCO_LOG.TXT").exists()
    assert mujoco.get_mju_user_warning() is before


def test_messages_of_mujoco_are_warnings_of_the_lab(tmp_path, monkeypatch, capfd) -> None:
    """Sixty touched boxes need more memory than the file has: MuJoCo would print that, and leave a log."""
    boxes = "".join(f'<geom type="box" size=".2 .2 .2" pos="{i / 20} 0 {i / 50}"/>' for i in range(60))
    arm = '<body><joint axis="0 1 0"/><geom size="2"/></body>'
    file = f'<mujoco><size memory="12K"/><worldbody>{boxes}{arm}</worldbody></mujoco>'
    monkeypatch.chdir(tmp_path)
    model = mujoco.MjModel.from_xml_string(file)
    with pytest.warns(LabWarning, match="^MuJoCo: Too many contacts") as told:
        mujoco.mj_collision(model, at_zero(model))
    assert len(told) == 1 and capfd.readouterr() == ("", "") and list(tmp_path.iterdir()) == []
