"""Effects on the virtual arm: each against its formula or an independent model, and off where it is off."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.robots import IRB120
from scipy import optimize, stats

from lab.core import se3
from lab.core.errors import LabError
from lab.core.measurements import last_moves, measured
from lab.core.se3 import Array
from lab.kinematics.effects.arm_with_effects import ArmWithEffects
from lab.kinematics.effects.backlash import JointHysteresis, Play, ReadingLag
from lab.kinematics.effects.compliance import CompensatorSpring, HardeningSprings, JointSprings, compliances
from lab.kinematics.effects.coupling import GearErrors, JointCoupling
from lab.kinematics.effects.effect import LEVER_M, ArmFacts, PoseConditions, SimulatedEffect
from lab.kinematics.effects.effect_registry import EffectOptions, effect
from lab.kinematics.effects.harmonics import Runout
from lab.kinematics.effects.readings import DisplacedReadings, VisitScatter
from lab.kinematics.effects.temperature import ThermalExpansion, ThermalGrowth, ThermalZeros, TrackerDrift
from lab.kinematics.serial.serial_arm import SerialArm
from lab.noise.instruments import INSTRUMENTS
from lab.simulation.effects import TrueEffects, random_conditions, random_effects, true_parameters
from lab.simulation.elastic_links import FlexibleArm
from lab.simulation.load_model import load_model, loads_of
from lab.simulation.robot_model import RobotModel
from lab.simulation.tracking import VirtualMeasurement, misalignments, track, track_with_errors
from lab.simulation.true_robot import Perturbation, TrueRobot, random_perturbation, random_tracker, true_robot

MODEL, CHAIN = IRB120.model, IRB120.chain
TARGETS = ("p1", "p2", "p3")
OFFSETS = TrueEffects.none(6)
OUTSTRETCHED = np.deg2rad([[0.0, 90.0, -90.0, 0.0, 0.0, 0.0]])
FACTS = ArmFacts(CHAIN, IRB120.loads)
ALL = EffectOptions(
    stiffness_nm_per_rad=1e5,
    harmonic_mrad=0.2,
    harmonic2_mrad=0.1,
    gear_ppm=100.0,
    coupling_ppm=1000.0,
    backlash_mrad=0.1,
    repeatability_mrad=0.02,
    lag=1e-4,
    link_ei=(1e5,),
    link_gj=(8e4,),
    drift_mm_per_h=0.02,
    drift_mrad_per_h=0.01,
    growth_ppm_per_h=10.0,
    bad_share=0.1,
)


def perturbed(seed: int = 3) -> TrueRobot:
    rng = np.random.default_rng(seed)
    off = random_perturbation(MODEL, 5e-4, 1.5e-3, rng, offset_sigma=1e-3)
    return true_robot(MODEL, off, random_tracker(MODEL, rng))


def drawn(robot: RobotModel = MODEL) -> TrueRobot:
    """As on the drawing, seen from the world."""
    n = robot.chain.size
    return true_robot(robot, Perturbation((), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(n)), np.eye(4))


REAL = perturbed()
JOINTS = CHAIN.random_joints(40, np.random.default_rng(8))


def only(*parts: SimulatedEffect) -> TrueEffects:
    return OFFSETS.having(*parts)


def sprung_by(compliance_rad_per_nm: Array) -> JointSprings:
    return JointSprings(compliance_rad_per_nm, np.zeros(3))


def drawn_values(effects: TrueEffects) -> dict[str, Array]:
    """What of the effects is drawn, by name."""
    return {
        "gear": effects.part(GearErrors).gear,
        "harmonics_rad": effects.part(Runout).harmonics_rad,
        "coupling": effects.part(JointCoupling).coupling,
        "backlash_rad": effects.part(Play).backlash_rad,
        "drift_per_h": effects.part(TrackerDrift).motion,
    }


def entry(joint: int, value: float, joints: int = 6) -> Array:
    """Zero but for one joint, which count from 1."""
    vector = np.zeros(joints)
    vector[joint - 1] = value
    return vector


def loaded_spec(payload_kg: float) -> mujoco.MjSpec:
    """The drawing with a ball of this mass at the flange, compiled by MuJoCo."""
    spec = MODEL.spec.copy()
    ball = spec.body("flange").add_body(name="ball")
    ball.explicitinertial, ball.mass, ball.inertia = True, payload_kg, np.full(3, 1e-3)
    return spec


def holding(model: mujoco.MjModel, joints: Array) -> Array:
    """The torques of inverse dynamics at rest, touching nothing."""
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data = mujoco.MjData(model)
    data.qpos[:] = joints
    mujoco.mj_inverse(model, data)
    return data.qfrc_inverse.copy()


def xml_robot(path: Path, bodies: str) -> RobotModel:
    path.write_text(f"<mujoco><compiler autolimits='true'/><worldbody>{bodies}</worldbody></mujoco>")
    return load_model(path)


# Off


def test_without_effects_nothing_changes_not_even_a_bit() -> None:
    """Positions as plain kinematics gives them, noise as the instrument alone draws it."""
    data, sites = mujoco.MjData(REAL.model), [REAL.model.site(name).id for name in TARGETS]
    plain = np.empty((len(JOINTS), 3, 3))
    for i, stand in enumerate(JOINTS + REAL.joint_offset):
        data.qpos[:] = stand
        mujoco.mj_kinematics(REAL.model, data)
        plain[i] = data.site_xpos[sites]
    plain = se3.transform(se3.inverse(REAL.T_world_tracker), plain.reshape(-1, 3)).reshape(plain.shape)
    np.testing.assert_array_equal(REAL.points(JOINTS, TARGETS), plain)
    device, rng, alone = INSTRUMENTS["leica-at960"], np.random.default_rng(1), np.random.default_rng(1)
    data = track(REAL, JOINTS, TARGETS, device, rng, readings=3)
    placed = device.errors.sample(plain, misalignments(np.random.default_rng(1)))
    np.testing.assert_array_equal(data.points, plain + placed + (device.sample(plain, alone, 3) - plain))
    assert rng.bit_generator.state == alone.bit_generator.state
    np.testing.assert_array_equal(data.joints, JOINTS)
    assert data.conditions == {}
    quiet = random_effects(FACTS, EffectOptions(), np.random.default_rng(0))
    np.testing.assert_array_equal(REAL.with_effects(quiet).points(JOINTS, TARGETS), plain)
    assert random_conditions(CHAIN, quiet, 5, np.random.default_rng(0), (0.0, 3.0), 60.0) == {}
    assert set(true_parameters(quiet).values()) == {0.0}


# Loads


def test_gravity_torques_are_those_of_the_facts() -> None:
    """Outstretched: 22.7 Nm about axis 2 with bare links, 31.9 with the model's 25 kg, 19.0 more with 3 kg."""
    arm = FlexibleArm(MODEL.model, MODEL)
    empty, loaded = (arm.loads(arm.straight(OUTSTRETCHED), np.array([mass]))[0][0] for mass in (0.0, 3.0))
    assert -empty[1] == pytest.approx(31.9, abs=0.05)
    assert empty[1] - loaded[1] == pytest.approx(19.0, abs=0.05)
    np.testing.assert_allclose(empty, holding(MODEL.spec.compile(), OUTSTRETCHED[0]), atol=1e-12)
    np.testing.assert_allclose(loaded, holding(loaded_spec(3.0).compile(), OUTSTRETCHED[0]), atol=1e-12)
    bare = MODEL.spec.copy()
    for body in [body for body in bare.bodies if body.name.startswith(("motor", "covers"))]:
        bare.delete(body)
    links = FlexibleArm(bare.compile(), MODEL).loads(arm.straight(OUTSTRETCHED), np.zeros(1))[0][0]
    assert -links[1] == pytest.approx(22.7, abs=0.05)


def test_joints_are_like_sprung_hinges() -> None:
    """A second hinge with a spring beside each motor, the equilibrium found on MuJoCo's passive forces alone."""
    compliance = np.array([0.0, 2e-5, 3e-5, 0.0, 1e-4, 0.0])
    soft = [i for i in range(6) if compliance[i]]
    spec = loaded_spec(1.5)
    for i in soft:
        joint = MODEL.model.joint(CHAIN.joint_names[i])
        spring = spec.body(MODEL.bodies[i]).add_joint(name=f"spring{i}", axis=joint.axis)
        spring.armature = 1.0  # two hinges on one axis: MuJoCo asks for inertia between them, a balance does not
        spring.stiffness = np.array([1 / compliance[i], 0.0, 0.0])
    model = spec.compile()
    data, real = mujoco.MjData(model), drawn().with_effects(only(sprung_by(compliance)))
    motors = [int(model.joint(name).qposadr[0]) for name in CHAIN.joint_names]
    springs = [int(model.joint(f"spring{i}").qposadr[0]) for i in soft]

    def unbalanced(sag: Array, joints: Array) -> Array:
        data.qpos[motors], data.qpos[springs] = joints, sag
        mujoco.mj_forward(model, data)
        return (data.qfrc_passive - data.qfrc_bias)[springs] * compliance[soft]

    for joints in JOINTS[:5]:
        sag = optimize.root(unbalanced, np.zeros(len(soft)), args=(joints,), options={"xtol": 1e-14}).x
        assert np.abs(unbalanced(sag, joints) / compliance[soft]).max() < 1e-8  # Nm
        expected = data.site_xpos[[model.site(name).id for name in TARGETS]]
        seen = real.points(joints[None], TARGETS, {"payload_kg": np.array([1.5])})[0]
        np.testing.assert_allclose(seen, expected, atol=1e-12)
        assert np.abs(real.points(joints[None], TARGETS)[0] - expected).max() > 1e-5  # the payload counts


def test_a_slide_gives_way_in_metres_per_newton(tmp_path) -> None:
    robot = xml_robot(
        tmp_path / "lift.xml",
        "<body name='turn'><joint name='q1' axis='0 0 1' range='-2 2'/>"
        "<inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/>"
        "<body name='lift' pos='.3 0 .5'><joint name='q2' type='slide' axis='0 0 1' range='0 1'/>"
        "<inertial pos='.1 0 0' mass='4' diaginertia='1 1 1'/></body></body>",
    )
    sizes = EffectOptions(harmonic_mrad=1.0)
    effects = random_effects(ArmFacts(robot.chain), sizes, np.random.default_rng(0))
    assert compliances(robot.chain, {2: 9e3})[1] == pytest.approx(LEVER_M**2 / 9e3)  # 1e-5 m/N
    waves = effects.part(Runout).harmonics_rad
    assert not waves[1].any() and waves[0].any()
    real = drawn(robot).with_effects(TrueEffects.none(2).having(sprung_by(np.array([0.0, 1e-5]))))
    joints = np.array([[0.4, 0.2]])
    drop = real.points(joints, ("p1",), {"payload_kg": np.array([2.0])}) - drawn(robot).points(joints, ("p1",))
    np.testing.assert_allclose(drop[0, 0], [0, 0, -1e-5 * 6 * 9.81], atol=1e-14)


def test_a_payload_hangs_at_the_flange_of_a_balanced_body(tmp_path) -> None:
    """MuJoCo takes a body with its centre of mass at its origin for simple, and does not look where it moves to."""
    robot = xml_robot(
        tmp_path / "balanced.xml",
        "<body name='post'><joint name='q1' axis='0 0 1' range='-2 2'/>"
        "<inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/>"
        "<body name='rocker' pos='0 0 1'><joint name='q2' axis='0 1 0' range='-2 2'/>"
        "<inertial pos='0 0 0' mass='5' diaginertia='1 1 1'/>"
        "<body name='wrist'><joint name='q3' axis='1 0 0' range='-2 2'/>"
        "<inertial pos='0 0 0' mass='3' diaginertia='1 1 1'/><site name='flange' pos='0.5 0 0'/></body></body></body>",
    )
    arm = FlexibleArm(drawn(robot).model, robot)
    still = arm.straight(np.deg2rad([[0.0, 0.0, 20.0], [0.0, 60.0, 0.0], [0.0, 0.0, 0.0]]))
    torques, _ = arm.loads(still, np.array([2.0, 2.0, 0.0]))
    np.testing.assert_allclose(torques, [[0, -9.81, 0], [0, -9.81 / 2, 0], [0, 0, 0]], atol=1e-12)


def test_an_arm_of_rubber_is_refused() -> None:
    real = drawn().with_effects(only(sprung_by(np.full(6, 10.0))))
    with pytest.raises(LabError, match="too soft"):
        real.points(JOINTS[:3], TARGETS)


# Motors


def test_a_gear_scales_readings() -> None:
    gear = np.array([1e-3, -2e-3, 0, 3e-4, 0, 1e-4])
    seen = REAL.with_effects(only(GearErrors(gear))).points(JOINTS, TARGETS)
    np.testing.assert_allclose(seen, REAL.points(JOINTS * (1 + gear), TARGETS), atol=1e-14)
    assert np.abs(seen - REAL.points(JOINTS, TARGETS)).max() > 1e-4


def test_runout_is_a_wave_of_each_joints_reading() -> None:
    waves = 1e-3 * np.random.default_rng(0).normal(size=(6, 4))
    stands = JOINTS.copy()
    for joint, (s1, c1, s2, c2) in enumerate(waves):
        for pose, q in enumerate(JOINTS[:, joint]):
            stands[pose, joint] += s1 * np.sin(q) + c1 * np.cos(q) + s2 * np.sin(2 * q) + c2 * np.cos(2 * q)
    seen = REAL.with_effects(only(Runout(waves))).points(JOINTS, TARGETS)
    np.testing.assert_allclose(seen, REAL.points(stands, TARGETS), atol=1e-14)
    turned = REAL.with_effects(only(Runout(waves))).points(JOINTS + 2 * np.pi, TARGETS)
    np.testing.assert_allclose(turned, seen, atol=1e-13)  # the same after a turn


def test_a_coupled_joint_goes_along_and_its_neighbour_does_not() -> None:
    coupling = np.zeros((6, 6))
    coupling[4, 3] = 0.01
    stands = JOINTS.copy()
    stands[:, 4] += 0.01 * JOINTS[:, 3]
    effects = only(JointCoupling(coupling))
    np.testing.assert_allclose(
        REAL.with_effects(effects).points(JOINTS, TARGETS), REAL.points(stands, TARGETS), atol=1e-14
    )
    named = {name: value for name, value in true_parameters(effects).items() if value}
    assert named == {"joint5.coupling4": 0.01}


def test_backlash_is_even_about_the_reading() -> None:
    real = REAL.with_effects(only(Play(entry(2, 1e-3))))
    side = {"approach_q2": np.where(np.arange(len(JOINTS)) % 2, 1.0, -1.0), "approach_q3": np.ones(len(JOINTS))}
    stands = JOINTS + np.outer(side["approach_q2"], entry(2, 0.5e-3))
    np.testing.assert_allclose(real.points(JOINTS, TARGETS, side), REAL.points(stands, TARGETS), atol=1e-14)
    np.testing.assert_array_equal(real.points(JOINTS, TARGETS), REAL.points(JOINTS, TARGETS))


# Time


def test_growth_is_a_similarity_about_the_foot() -> None:
    real, hours = REAL.with_effects(only(ThermalGrowth(1e-4))), np.linspace(0, 2, len(JOINTS))
    foot = se3.transform(se3.inverse(REAL.T_world_tracker), MODEL.T_world_frame0[None, :3, 3])
    cold, warm = REAL.points(JOINTS, TARGETS), real.points(JOINTS, TARGETS, {"time_s": 3600 * hours})
    np.testing.assert_allclose(warm - foot, (1 + 1e-4 * hours)[:, None, None] * (cold - foot), atol=1e-14)
    np.testing.assert_array_equal(real.points(JOINTS, TARGETS), cold)
    later = PoseConditions({"time_s": np.full(len(cold), 7200.0)}, len(cold), CHAIN.joint_names)
    elsewhere = real.effects.moved(cold, np.array([1.0, 2.0, 3.0]), later)
    np.testing.assert_allclose(elsewhere, cold + 2e-4 * (cold - [1.0, 2.0, 3.0]), atol=1e-14)
    truth = true_parameters(real.effects.having(TrackerDrift.none(6)))
    assert [name for name in truth if "drift" in name] == ["drift.rx", "drift.ry", "drift.rz"]


def test_drift_is_a_tracker_that_moves() -> None:
    rate = np.array([1e-4, -2e-4, 3e-4, 2e-5, 1e-5, -3e-5])
    real, time = REAL.with_effects(only(TrackerDrift(rate))), np.linspace(0, 5400, len(JOINTS))
    seen, still = real.points(JOINTS, TARGETS, {"time_s": time}), REAL.points(JOINTS, TARGETS)
    np.testing.assert_array_equal(seen[0], still[0])
    T_world_moved = REAL.T_world_tracker @ se3.pose(se3.exp(1.5 * rate[3:]), 1.5 * rate[:3])
    moved = se3.transform(se3.inverse(T_world_moved) @ REAL.T_world_tracker, still[-1])
    np.testing.assert_allclose(seen[-1], moved, atol=1e-14)
    truth = true_parameters(real.effects)
    v, w = (np.array([truth[f"drift.{turn}{axis}"] for axis in "xyz"]) for turn in ("", "r"))
    hours = (time / 3600)[:, None, None]
    np.testing.assert_allclose(seen, still + hours * (v + np.cross(w, still)), atol=1e-7)
    assert np.abs(seen - still).max() > 3e-4 and truth["drift.scale"] == 0


# Chance


def test_joints_come_back_within_their_repeatability() -> None:
    """One pose visited 20,000 times: the target scatters along axis 1's circle alone."""
    sigma, visits = 1e-4, np.tile(JOINTS[:1], (20_000, 1))
    real = drawn().with_effects(only(VisitScatter(entry(1, sigma))))
    seen = track(real, visits, ("p1",), INSTRUMENTS["exact"], np.random.default_rng(0)).points[:, 0]
    centre = drawn().points(JOINTS[:1], ("p1",))[0, 0]
    radius = np.hypot(*centre[:2])
    along = (seen - centre) @ np.array([-centre[1], centre[0], 0]) / radius
    assert stats.kstest(along / (radius * sigma), "norm").pvalue > 0.01
    np.testing.assert_allclose(np.hypot(seen[:, 0], seen[:, 1]), radius, atol=1e-14)
    np.testing.assert_allclose(seen[:, 2], centre[2], atol=1e-14)
    everywhere = only(VisitScatter(np.full(6, sigma))).scatter(20_000, np.random.default_rng(1))
    np.testing.assert_allclose(np.cov(everywhere.T) / sigma**2, np.eye(6), atol=0.03)


def test_bad_readings_are_as_stated_and_the_others_untouched() -> None:
    visits, device = np.tile(JOINTS, (250, 1)), INSTRUMENTS["uniform-8um"]
    real = REAL.with_effects(only(DisplacedReadings(0.05, (1e-3, 50e-3))))
    data, bad = track_with_errors(VirtualMeasurement(real, visits, TARGETS, device, np.random.default_rng(2)))[:2]
    clean = track(REAL, visits, TARGETS, device, np.random.default_rng(2))
    np.testing.assert_array_equal(data.points[~bad], clean.points[~bad])
    off = (data.points - clean.points)[bad]
    np.testing.assert_allclose(off, np.repeat(off[:, :1], 3, axis=1), atol=1e-14)  # all targets alike
    size = np.linalg.norm(off[:, 0], axis=1)
    assert stats.binomtest(int(bad.sum()), len(bad), 0.05).pvalue > 0.01
    assert stats.kstest(np.log(size), stats.uniform(np.log(1e-3), np.log(50)).cdf).pvalue > 0.01
    for axis in range(3):  # a coordinate of a random direction is uniform
        assert stats.kstest(off[:, 0, axis] / size, stats.uniform(-1, 2).cdf).pvalue > 0.01
    assert not track_with_errors(VirtualMeasurement(REAL, visits, TARGETS, device, np.random.default_rng(2)))[1].any()


def test_readings_lag_and_points_do_not() -> None:
    real, device = REAL.with_effects(only(ReadingLag(0.01))), INSTRUMENTS["exact"]
    data = track(real, JOINTS, TARGETS, device, np.random.default_rng(0))
    np.testing.assert_array_equal(data.points, REAL.points(JOINTS, TARGETS))
    np.testing.assert_array_equal(data.joints[0], JOINTS[0])
    np.testing.assert_allclose(data.joints[1:], 0.99 * JOINTS[1:] + 0.01 * JOINTS[:-1], atol=1e-15)


@pytest.mark.parametrize(
    ("group", "kind"),
    [
        ("compliance", JointSprings),
        ("harmonics+harmonics2", Runout),
        ("gear", GearErrors),
        ("coupling", JointCoupling),
        ("backlash", Play),
        ("drift", TrackerDrift),
        ("hysteresis", JointHysteresis),
        ("expansion", ThermalExpansion),
        ("thermal_zeros", ThermalZeros),
    ],
)
def test_the_true_parameters_make_the_identifiers_arm_the_real_one(group: str, kind: type[SimulatedEffect]) -> None:
    """The equations of calibration, at these parameters, say where the arm that MuJoCo moves is."""
    drawing = SerialArm(CHAIN, TARGETS)
    arm = ArmWithEffects(drawing, tuple(effect(name, CHAIN, loads_of(MODEL)) for name in group.split("+")))
    later = {"hysteresis_mrad": 0.1, "expansion_ppm_per_k": 20.0, "thermal_zero_mrad_per_k": 0.01}
    every = random_effects(FACTS, replace(ALL, **later), np.random.default_rng(4))
    effects = only(every.part(kind))
    real = true_robot(MODEL, Perturbation((), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(6)), REAL.T_world_tracker)
    real = real.with_effects(effects)
    truth = true_parameters(effects)
    geometry = MODEL.values_before(drawing, real.T_world_tracker)
    values = np.concatenate([geometry, [truth[name] for name in arm.names[len(geometry) :]]])
    conditions = random_conditions(CHAIN, effects, len(JOINTS), np.random.default_rng(0), (0.0, 3.0), 3600.0)
    data = replace(measured(CHAIN.joint_names, JOINTS, (), np.zeros((len(JOINTS), 0, 3))), conditions=conditions)
    inputs = data.inputs(arm.conditions)
    seen = real.points(JOINTS, TARGETS, conditions)
    np.testing.assert_allclose(arm.points(inputs, values), seen, atol=1e-9)
    assert np.abs(drawing.points(JOINTS, geometry) - seen).max() > 1e-5


def test_a_compensators_spring_is_that_of_its_ends() -> None:
    """The torque is the derivative of the spring's energy, and its first two harmonics hold nearly all of it."""
    part, angle = CompensatorSpring(1.0), np.linspace(-np.pi, np.pi, 721)
    near, far = 0.1010205144336438, 1.0  # ends at distances whose 2 a b / (a^2 + b^2) is 0.2
    energy_scale, free = near * far, 0.7 * np.hypot(near, far)

    def energy(at: Array) -> Array:
        length = np.sqrt(near**2 + far**2 - 2 * near * far * np.cos(at))
        return 0.5 * (length - free) ** 2 / energy_scale

    joints = np.tile(angle[:, None], (1, 6))
    offsets = part.joint_offsets(joints, PoseConditions({}, len(joints), ()))
    torque = (energy(angle + 1e-5) - energy(angle - 1e-5)) / 2e-5
    np.testing.assert_allclose(offsets[:, 1], torque, atol=1e-9)
    assert not np.delete(offsets, 1, axis=1).any()
    fitted, truth = effect("compensator", CHAIN, None), part.true_parameters()
    values = np.array([truth[each.name] for each in fitted.parameters])
    left = offsets[:, 1] - fitted.offsets(joints, np.zeros((len(joints), 0)), values)[0][:, 1]
    assert 1e-3 < np.abs(left).max() < 0.004 < 0.03 < np.abs(values[2])


def test_a_joint_that_hardens_gives_way_by_the_cube_of_its_torque() -> None:
    """MuJoCo's equilibrium is that of the fitted group, but for how the sag itself changes the torque."""
    loads, cubic = loads_of(MODEL), -1e-9 * (entry(2, 1.0) + entry(3, 1.0))
    fitted = effect("hardening", CHAIN, loads)
    driven, payload = JOINTS[:5], np.array([0.0, 1.0, 2.0, 3.0, 0.0])
    stand = FlexibleArm(MODEL.model, MODEL).settled(driven, np.zeros(6), payload, cubic=cubic)
    offsets, _ = fitted.offsets(driven, payload[:, None], np.array([-1e-9, -1e-9]))
    np.testing.assert_allclose(stand.joints - driven, offsets, atol=1e-3 * np.abs(offsets).max())
    assert np.abs(offsets).max() > 1e-6
    real = REAL.with_effects(only(HardeningSprings(cubic)))
    rigid = REAL.with_effects(TrueEffects.none(6))
    assert np.abs(real.points(driven, TARGETS) - rigid.points(driven, TARGETS)).max() > 1e-6


def test_the_last_move_is_kept_until_the_next_and_forgotten_between_sessions() -> None:
    joints = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, -0.2], [0.05, -0.2], [0.3, 0.4]])
    np.testing.assert_array_equal(last_moves(joints), [[0, 0], [1, 0], [1, -1], [-1, -1], [1, 1]])
    np.testing.assert_array_equal(last_moves(joints, "aabbb"), [[0, 0], [1, 0], [0, 0], [-1, 0], [1, 1]])
    assert last_moves(joints[:0]).shape == (0, 2)
    data = measured(CHAIN.joint_names[:2], joints, (), np.zeros((5, 0, 3)))
    picked = data[[4, 1]][[1]]  # rows know what came before them in the whole campaign
    name = CHAIN.joint_names[0]
    np.testing.assert_array_equal(picked.inputs([f"last move of {name}", "place in the file"])[:, 2:], [[1.0, 0.25]])


def test_sizes_are_what_the_effects_have() -> None:
    effects = random_effects(FACTS, ALL, np.random.default_rng(5))
    np.testing.assert_allclose(effects.part(JointSprings).compliance_rad_per_nm, [0, 1e-5, 1e-5, 0, 0, 0])
    values = drawn_values(effects)
    np.testing.assert_allclose(np.hypot(*values["harmonics_rad"][:, :2].T), 2e-4)
    np.testing.assert_allclose(np.hypot(*values["harmonics_rad"][:, 2:].T), 1e-4)
    assert [tuple(pair) for pair in np.argwhere(values["coupling"])] == [(4, 3), (5, 4)]
    assert ((values["backlash_rad"] >= 0.5e-4) & (values["backlash_rad"] <= 1.5e-4)).all()
    np.testing.assert_allclose(
        [np.linalg.norm(values["drift_per_h"][:3]), np.linalg.norm(values["drift_per_h"][3:])], [2e-5, 1e-5]
    )
    many = [random_effects(FACTS, ALL, np.random.default_rng(seed)).part(GearErrors).gear for seed in range(60)]
    assert np.std(many) == pytest.approx(1e-4, rel=0.11)  # 360 numbers: 3 standard deviations


def test_a_campaign_sets_what_its_effects_need() -> None:
    def columns(effects: TrueEffects, **options: object) -> set[str]:
        return set(random_conditions(CHAIN, effects, 7, np.random.default_rng(0), **options))

    assert columns(only(GearErrors(np.ones(6)))) == set()
    assert columns(only(Play(entry(3, 1e-4)))) == {"approach_q3"}
    assert columns(only(ThermalGrowth(1e-5)), duration_s=60.0) == {"time_s"}
    soft = only(sprung_by(entry(2, 1e-5)))
    assert columns(soft, payload_kg=(0.0, 3.0)) == {"payload_kg"} and columns(soft) == set()
    full = random_effects(FACTS, ALL, np.random.default_rng(5))
    few, more = (random_conditions(CHAIN, full, n, np.random.default_rng(0), (0.0, 1.0, 3.0), 90.0) for n in (10, 900))
    assert set(few) == {"payload_kg", "time_s", *(f"approach_q{i}" for i in range(1, 7))}
    for name in set(few) - {"time_s"}:
        np.testing.assert_array_equal(few[name], more[name][:10])
        values, counts = np.unique(more[name], return_counts=True)
        assert values.tolist() == ([0.0, 1.0, 3.0] if name == "payload_kg" else [-1.0, 1.0])
        assert stats.chisquare(counts).pvalue > 0.001
    np.testing.assert_allclose(few["time_s"], np.linspace(0, 90, 10))
    data = track(REAL.with_effects(full), JOINTS[:10], TARGETS, INSTRUMENTS["exact"], np.random.default_rng(0), 1, few)
    assert dict(data.conditions) == few


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: only(GearErrors(np.full(6, np.nan))), "gear is to be finite"),
        (lambda: only(Runout(np.zeros((6, 2)))), r"harmonics_rad is to be finite numbers of shape \(6, 4\)"),
        (lambda: only(JointCoupling(np.eye(6))), "itself"),
        (lambda: only(sprung_by(np.full(6, -1e-5))), "compliance_rad_per_nm has a negative entry"),
        (lambda: only(ReadingLag(1.0)), r"lag is to be in \[0, 1\)"),
        (lambda: only(DisplacedReadings(0.0, (2.0, 1.0))), "bad_range_m"),
        (lambda: REAL.with_effects(TrueEffects.none(5)), "effects of 5 joints"),
        (lambda: REAL.points(JOINTS, TARGETS, {"time_s": np.zeros(3)}), "condition time_s"),
        (lambda: REAL.points(JOINTS[:1], TARGETS, {"payload_kg": np.array([np.nan])}), "condition payload_kg"),
        (lambda: compliances(CHAIN, {7: 1e5}), "joints 1 to 6"),
        (lambda: compliances(CHAIN, {2: 0.0}), "above zero"),
    ],
)
def test_what_cannot_be_is_refused(wrong, message: str) -> None:
    with pytest.raises(LabError, match=message):
        wrong()
