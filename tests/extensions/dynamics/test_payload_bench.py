"""The virtual load: MuJoCo against the regressor and against energy, and each error of a run against its formula."""

import copy
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.robots import IRB120

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.dynamics.arm_simulation import (
    CarryingArm,
    LoadBench,
    RigidLoad,
    RunErrors,
    drawn_mounting,
    own_dynamics,
    peak_torques,
)
from lab.extensions.dynamics.load_files import Mounting, PayloadSamples
from lab.kinematics.dynamics.rigid_body import hand_motion, torque_regressor, wrench_regressor
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm
from lab.robots.load_robot import load_virtual
from lab.simulation.load_model import load_model
from lab.simulation.robot_model import RobotModel

PEAK_NM = np.array([131.8, 131.8, 103.5, 46.1, 43.2, 30.7])
LOAD = RigidLoad(1.5, np.array([0.010, -0.005, 0.060]), np.diag([22.5e-4, 26e-4, 12.5e-4]))
LEANING = Mounting.tilted(np.array([0.2, -0.1]), 9.79)
LEVEL = Mounting.tilted(np.zeros(2))


def with_peaks(robot: RobotModel) -> RobotModel:
    model = copy.deepcopy(robot.model)
    model.jnt_actfrclimited[:] = True
    model.jnt_actfrcrange[:] = np.outer(PEAK_NM, [-1.0, 1.0])
    return replace(robot, model=model)


TX40 = with_peaks(load_virtual("tx40").model)
ARM = SerialArm(TX40.chain)
VALUES = ARM.nominal()


def random_load(rng: np.random.Generator) -> RigidLoad:
    points = rng.normal(size=(5, 3)) * 0.05  # five point masses: physical
    spread = points - points.mean(axis=0)
    lever = se3.skew(spread)
    return RigidLoad(2.5, points.mean(axis=0) + 0.02, -0.5 * (lever @ lever).sum(axis=0))


def random_motion(chain: Chain, count: int, seed: int) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    joints = chain.random_joints(count, rng)
    return joints, 3 * rng.normal(size=joints.shape), 10 * rng.normal(size=joints.shape)


def wave(times: Array) -> tuple[Array, Array, Array]:
    """A smooth path of the TX 40, each joint at its own rate."""
    rate, swing = 2 * np.pi * np.array([0.2, 0.4, 0.6, 0.8, 1.0, 1.2]), np.array([1.0, 0.4, 0.5, 1.0, 0.8, 1.5])
    middle, phase = np.array([0.3, -0.5, 1.2, 0.2, 0.9, -0.4]), np.arange(6.0)
    angle = np.outer(times, rate) + phase
    return middle + swing * np.sin(angle), swing * rate * np.cos(angle), -swing * rate**2 * np.sin(angle)


# Inverse dynamics


@pytest.mark.parametrize("name", ["tx40", "irb120", "scara", "versatran"])
def test_a_load_adds_its_regressor(name: str) -> None:
    robot = load_virtual(name).model
    arm, motion = SerialArm(robot.chain), random_motion(robot.chain, 100, 1)
    load = random_load(np.random.default_rng(2))
    torques, wrench = CarryingArm(robot, LEANING.gravity, load).torques_and_wrench(*motion)
    difference = torques - own_dynamics(robot, LEANING.gravity)(*motion)
    expected = torque_regressor(arm, arm.nominal(), *motion, LEANING.gravity) @ load.phi
    np.testing.assert_allclose(difference, expected, rtol=0, atol=1e-12 * np.abs(torques).max())
    hand = wrench_regressor(hand_motion(arm, arm.nominal(), *motion), LEANING.gravity) @ load.phi
    np.testing.assert_allclose(wrench, hand, rtol=0, atol=1e-12 * np.abs(hand).max())


def test_power_is_the_rate_of_energy() -> None:
    """The load's energy from forward kinematics alone, by finite differences in time."""
    times, step = np.linspace(0.1, 2.0, 20), 1e-3

    def energy(at: Array) -> Array:
        before, now, after = (ARM.flange(wave(at + shift)[0], VALUES) for shift in (-step, 0.0, step))
        centre = [se3.transform(T, np.broadcast_to(LOAD.centre_m, (len(at), 1, 3)))[:, 0] for T in (before, after)]
        velocity = (centre[1] - centre[0]) / (2 * step)
        turn = se3.log(np.swapaxes(before[:, :3, :3], 1, 2) @ after[:, :3, :3]) / (2 * step)  # in the middle's axes
        place = se3.transform(now, np.broadcast_to(LOAD.centre_m, (len(at), 1, 3)))[:, 0]
        spin = np.einsum("ni,ij,nj->n", turn, LOAD.inertia_kgm2, turn)
        return 0.5 * (LOAD.mass_kg * (velocity**2).sum(axis=1) + spin) - LOAD.mass_kg * place @ LEANING.gravity

    rate = (energy(times + step) - energy(times - step)) / (2 * step)
    motion = wave(times)
    carried = CarryingArm(TX40, LEANING.gravity, LOAD).torques(*motion) - own_dynamics(TX40, LEANING.gravity)(*motion)
    power = (carried * motion[1]).sum(axis=1)
    np.testing.assert_allclose(power, rate, rtol=0, atol=2e-4 * np.abs(power).max())


def test_what_mj_inverse_would_count_in_is_off() -> None:
    spec = IRB120.model.spec.copy()
    for joint in spec.joints:
        joint.damping, joint.stiffness = np.full(3, 2.0), np.full(3, 10.0)  # polynomials in MuJoCo 4
        joint.frictionloss, joint.armature = 3.0, 0.5
    for body in spec.bodies:
        body.gravcomp = 0.5
    spec.option.viscosity, spec.option.density = 1.0, 1000.0
    dull = replace(IRB120.model, spec=spec, model=spec.compile())
    motion = random_motion(IRB120.chain, 50, 5)  # some of these collide and are near limits
    for load in (LOAD, None):
        plain, odd = (CarryingArm(robot, LEVEL.gravity, load).torques(*motion) for robot in (IRB120.model, dull))
        np.testing.assert_array_equal(plain, odd)


def test_an_arm_on_a_wall(tmp_path: Path) -> None:
    """Gravity is given in frame 0, which a base turned in the world turns."""
    path = tmp_path / "wall.xml"
    path.write_text(
        "<mujoco><worldbody><body name='base' euler='90 20 0'><geom size='.05'/><body name='a' pos='0 0 .1'>"
        "<joint name='q1' axis='0 0 1'/><geom size='.05' pos='.3 0 0'/><body name='b' pos='.3 0 0'>"
        "<joint name='q2' axis='0 1 0'/><geom size='.04' pos='0 0 .3'/></body></body></body></worldbody></mujoco>"
    )
    robot = load_model(path)
    arm, motion = SerialArm(robot.chain), random_motion(robot.chain, 30, 7)
    gravity = drawn_mounting(robot).gravity
    assert abs(gravity[2]) < 5
    data = mujoco.MjData(robot.model)
    data.qpos[:], data.qvel[:], data.qacc[:] = motion[0][0], motion[1][0], motion[2][0]
    mujoco.mj_inverse(robot.model, data)  # nothing of this arm is to be switched off but contacts
    own = own_dynamics(robot, gravity)(*motion)
    np.testing.assert_allclose(own[0], data.qfrc_inverse, atol=1e-12)
    difference = CarryingArm(robot, gravity, LOAD).torques(*motion) - own
    expected = torque_regressor(arm, arm.nominal(), *motion, gravity) @ LOAD.phi
    np.testing.assert_allclose(difference, expected, rtol=0, atol=1e-11)


def test_peak_torques() -> None:
    np.testing.assert_array_equal(peak_torques(TX40), PEAK_NM)
    model = copy.deepcopy(TX40.model)
    model.jnt_actfrclimited[2] = False
    with pytest.raises(LabError, match=r"tx40.robot.toml: joint q3 has no peak torque; give torque_nm"):
        peak_torques(replace(TX40, model=model))


def test_an_arm_without_masses(tmp_path: Path) -> None:
    path = tmp_path / "light.xml"
    path.write_text(
        "<mujoco><compiler boundmass='1e-9' boundinertia='1e-12'/><worldbody><body name='a'>"
        "<joint name='q1' axis='0 0 1'/><geom size='.1' mass='0'/><body name='b' pos='1 0 0'>"
        "<joint name='q2' axis='0 0 1'/><geom size='.1' mass='0'/></body></body></worldbody></mujoco>"
    )
    with pytest.raises(LabError, match="no link has a mass, so there is no dynamics; give mass_kg"):
        CarryingArm(load_model(path), LEVEL.gravity)


@pytest.mark.parametrize(
    ("mass", "inertia", "said"),
    [
        (0.0, np.eye(3), "give a mass above zero"),
        (np.nan, np.eye(3), "give a mass above zero"),
        (1.0, np.diag([1.0, 1.0, 2.1]), "one is above the sum of the others"),
        (1.0, np.diag([1.0, 1.0, -1.0]), "one is above the sum of the others"),
        (1.0, np.eye(3) + np.eye(3)[[1, 2, 0]], "finite and symmetric"),
    ],
)
def test_no_such_load(mass: float, inertia: Array, said: str) -> None:
    with pytest.raises(LabError, match=said):
        RigidLoad(mass, np.zeros(3), inertia)


# Runs


def moving(errors: RunErrors, mounting: Mounting = LEANING, seed: int = 0, rate_hz: float = 100.0) -> PayloadSamples:
    return LoadBench(TX40, LOAD, mounting, errors).moving(wave, 2.0, rate_hz, np.random.default_rng(seed))


def test_without_errors_a_run_is_exact() -> None:
    records = moving(RunErrors())
    times = np.arange(200) / 100.0
    assert records.step_s == pytest.approx(0.01)
    for loaded, load in ((True, LOAD), (False, None)):
        run = records.run(loaded)
        torques, wrench = CarryingArm(TX40, LEANING.gravity, load).torques_and_wrench(*wave(times))
        np.testing.assert_array_equal(run.time_s, times)
        np.testing.assert_array_equal(run.joints, wave(times)[0])
        np.testing.assert_array_equal(run.torques, torques)
        np.testing.assert_allclose(run.wrench, wrench, atol=1e-15)


NOISY = RunErrors(encoder_rad=1e-5, torque_noise=0.005, force_noise_n=0.05, moment_noise_nm=0.002)


def test_one_seed_gives_one_run_and_streams_are_independent() -> None:
    first, again, other = moving(NOISY), moving(NOISY), moving(NOISY, seed=1)
    for name in ("joints", "torques", "wrench"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
        assert (getattr(first, name) != getattr(other, name)).all()
    quiet = moving(replace(NOISY, torque_noise=0.0))
    np.testing.assert_array_equal(quiet.joints, first.joints)
    np.testing.assert_array_equal(quiet.wrench, first.wrench)


def test_noise_is_as_large_as_said() -> None:
    noisy, exact = moving(NOISY, rate_hz=1000.0), moving(RunErrors(), rate_hz=1000.0)
    for name, sigma in (("joints", 1e-5), ("torques", 0.005 * PEAK_NM), ("wrench", np.repeat([0.05, 0.002], 3))):
        white = (getattr(noisy, name) - getattr(exact, name)) / sigma
        np.testing.assert_allclose(white.std(axis=0), 1.0, atol=0.06)  # 4,000 samples: 3 of 0.011 and the worst of 6
        assert abs(np.corrcoef(white[:2000].ravel(), white[2000:].ravel())[0, 1]) < 0.04  # the runs' own noise


def test_friction() -> None:
    coulomb = 0.05 * PEAK_NM
    exact = moving(RunErrors())
    rough = moving(RunErrors(coulomb_nm=coulomb, viscous_nm_s=2.0, load_friction=0.1))
    assert exact.torques is not None and rough.torques is not None
    speeds = np.tile(wave(np.arange(200) / 100.0)[1], (2, 1))
    signs = np.where(np.abs(speeds) > 1e-6, np.sign(speeds), 0.0)  # at rest friction has no known direction
    expected = (coulomb + 0.1 * np.abs(exact.torques)) * signs + 2.0 * speeds
    np.testing.assert_allclose(rough.torques - exact.torques, expected, atol=1e-12)


def test_lag_is_of_the_torques_alone() -> None:
    lag = 0.0013
    late, exact = moving(RunErrors(lag_s=lag, coulomb_nm=1.0)), moving(RunErrors())
    motion = wave(np.arange(200) / 100.0 - lag)
    run = late.run(loaded=True)
    signs = np.where(np.abs(motion[1]) > 1e-6, np.sign(motion[1]), 0.0)
    held = CarryingArm(TX40, LEANING.gravity, LOAD).torques(*motion) + signs
    np.testing.assert_allclose(run.torques, held, atol=1e-12)
    np.testing.assert_array_equal(late.joints, exact.joints)
    np.testing.assert_array_equal(late.wrench, exact.wrench)


def test_a_sensor_that_is_turned_and_off_on_a_tilted_base() -> None:
    offset = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
    known = Mounting.tilted(np.array([0.02, 0.01]), 9.81, -1.0, np.array([0.0, 0.0, 0.5]))
    errors = RunErrors(wrench_offset=offset, tilt_rad=(0.03, -0.02))
    records = moving(errors, known)
    gravity = se3.exp(np.array([0.03, -0.02, 0.0])).T @ known.gravity
    exact = CarryingArm(TX40, gravity, LOAD).torques_and_wrench(*wave(np.arange(200) / 100.0))[1]
    R_last_sensor = se3.exp(np.array([0.0, 0.0, 0.5]))
    in_sensor = np.concatenate([exact[:, :3] @ R_last_sensor, exact[:, 3:] @ R_last_sensor], axis=1)
    np.testing.assert_allclose(records.run(True).wrench, -in_sensor + offset, atol=1e-12)
    np.testing.assert_allclose(records.run(False).wrench, np.tile(offset, (200, 1)), atol=1e-15)


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("torque_noise", -0.1, "torque_noise is -0.1; give zero or more"),
        ("lag_s", np.inf, "lag_s is inf; give finite numbers"),
        ("tilt_rad", (1.0,), r"tilt_rad has 1 numbers; give 2"),
        ("coulomb_nm", np.ones(5), r"coulomb_nm is .*; give one number, or 6 of them"),
    ],
)
def test_errors_that_cannot_be(name: str, value, said: str) -> None:
    with pytest.raises(LabError, match=said):
        moving(RunErrors(**{name: value}))


def test_a_run_has_samples() -> None:
    with pytest.raises(LabError, match="are 1 samples"):
        LoadBench(TX40, LOAD, LEVEL, RunErrors()).moving(wave, 0.01, 100.0, np.random.default_rng(0))
