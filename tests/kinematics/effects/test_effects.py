"""Groups of parameters that move joints: derivatives, gravity against MuJoCo, ranks, recovery, errors."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from helpers.robots import IRB120, RX130, SCARA, TX40, VERSATRAN, assert_derivatives, somewhere

from lab.calibration.identification import identify
from lab.core import se3
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.core.se3 import Array
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.effects.arm_with_effects import ArmWithEffects
from lab.kinematics.effects.effect import HOUR_S, SessionInfo
from lab.kinematics.effects.effect_registry import GROUPS, effect
from lab.kinematics.gauge import base_set
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SequentialBatch, SerialArm, stacked
from lab.robots.load_robot import load_robot

ALONE = tuple(name for name in GROUPS if name not in ("payload", "tubes", "compensator"))  # in others
PARAMETERS = {
    "compliance": 2,
    "payload": 3,
    "harmonics": 12,
    "harmonics2": 12,
    "gear": 6,
    "coupling": 6,
    "bending": 10,
    "torsion": 4,  # link 1 is upright: nothing twists it
    "extension": 5,
    "tubes": 5,
    "backlash": 6,
    "drift": 7,
    "sessions": 12,
    "hysteresis": 6,
    "compensator": 4,
    "hardening": 2,
    "expansion": 1,
    "thermal_zeros": 6,
}
SIZE_BY_SYMBOL = {"compliance": 1e-5, "ei_y": 1e-5, "ei_z": 1e-5, "gj": 1e-5, "mass": 0.5, "hardening": 1e-9}
SESSIONS = SessionInfo(("a", "b", "c"))
SIZES = {
    "compliance": 1e-5,
    "payload": 1e-5,
    "bending": 1e-5,
    "torsion": 1e-5,
    "extension": 1e-6,
    "tubes": 1e-5,
    "hardening": 1e-9,
}  # of the others 0.2 mrad, ...


def loads_on(chain: Chain, rng: np.random.Generator) -> Loads:
    """Masses of any size anywhere on an arm that has none, and gravity in any direction."""
    return Loads(chain, rng.uniform(1, 5, chain.size), rng.normal(0, 0.1, (chain.size, 3)), rng.normal(0, 9.81, 3))


def true_values(arm: SerialArm | ArmWithEffects, rng: np.random.Generator) -> Array:
    """An arm before a tracker: base set off by 0.5 mm and mrad, effects of the size that arms have."""
    rigid = arm.rigid
    values = arm.nominal()
    values[: len(rigid.names)] = somewhere(rigid, rng)
    kept = list(base_set(rigid, values[: len(rigid.names)]).identifiable)
    values[kept] += 5e-4 * rng.normal(size=len(kept))
    for i in range(len(rigid.names), len(arm.names)):
        last = arm.names[i].rpartition(".")[2]
        size = SIZE_BY_SYMBOL.get(last, 2e-4)
        values[i] = size * rng.uniform(0.5, 1.5)
    return values


def seen(arm: SerialArm | ArmWithEffects, values: Array, poses: int, rng: np.random.Generator) -> Measurements:
    """What a perfect instrument sees of it, with every condition asked for."""
    inputs = arm.structure_joints(poses, rng)
    size = IRB120.chain.size
    data = measured(IRB120.chain.joint_names, inputs[:, :size], arm.targets, arm.points(inputs, values))
    conditions = {name: inputs[:, size + i] for i, name in enumerate(arm.conditions)}
    return replace(data, conditions=conditions)


@pytest.mark.parametrize("name", GROUPS)
@pytest.mark.parametrize("chain", [IRB120.chain, SCARA, VERSATRAN], ids=lambda chain: chain.name)
def test_derivatives_of_effects(chain: Chain, name: str) -> None:
    rng = np.random.default_rng(0)
    loads = IRB120.loads if chain is IRB120.chain else loads_on(chain, rng)
    if chain is VERSATRAN and name in ("bending", "torsion", "extension", "tubes", "compensator"):
        with pytest.raises(LabError, match=r"has no joint (or link that could have it|2 that turns)"):
            effect(name, chain, loads, SESSIONS)  # slides alone, and links without a length
        return
    made = effect(name, chain, loads, SESSIONS)
    joints, values = chain.random_joints(20, rng), SIZES.get(name, 2e-4) * rng.normal(size=len(made.parameters))
    conditions = rng.uniform(0, 3, (20, len(made.conditions)))
    offset, derivative = made.offsets(joints, conditions, values)
    moved = {"frame": 7, "joints": chain.size, "links": 6 * len(made.links), "size": 1}[made.moves]
    assert offset.shape == (20, moved) and derivative.shape == (20, moved, len(made.parameters))
    assert_derivatives(lambda v: made.offsets(joints, conditions, v)[0], derivative, values, relative=1e-7)
    still, _ = made.offsets(joints, conditions, np.zeros(len(values)))
    assert not still.any()  # the drawing has no effect


TERMS = ("joint1.harmonic20", "joint5.harmonic1", "joint4.coupling1", "joint1.gravity4", "joint5.gravity6")


@pytest.mark.parametrize("name", TERMS)
@pytest.mark.parametrize("chain", [IRB120.chain, SCARA, VERSATRAN], ids=lambda chain: chain.name)
def test_derivatives_of_single_joints_groups(chain: Chain, name: str) -> None:
    rng = np.random.default_rng(0)
    if chain is SCARA:
        name = name.replace("joint5", "joint2").replace("6", "4").replace("joint4.coupling1", "joint4.coupling2")
    made = effect(name, chain, loads_on(chain, rng))
    joints, values = chain.random_joints(20, rng), 2e-4 * rng.normal(size=len(made.parameters))
    _, derivative = made.offsets(joints, np.zeros((20, 0)), values)
    assert_derivatives(lambda v: made.offsets(joints, np.zeros((20, 0)), v)[0], derivative, values, relative=1e-7)
    moved = int(name[5]) - 1
    assert derivative[:, moved].any() and not np.delete(derivative, moved, axis=1).any()
    assert not made.offsets(joints, np.zeros((20, 0)), np.zeros(len(values)))[0].any()


@pytest.mark.parametrize("name", ["irb120", "rx130", "tx40"])
def test_torques_of_any_masses_are_made_of_a_few_functions(name: str) -> None:
    """Whatever the links weigh, the torque about a joint is a sum of what the groups of the links beyond it say."""
    rng = np.random.default_rng(8)
    chain = {"irb120": IRB120.chain, "rx130": RX130, "tx40": TX40}[name]
    loads = loads_on(chain, rng)
    joints = chain.random_joints(100, rng)
    force, _ = loads.forces(joints, rng.uniform(0, 3, 1) * np.ones(100))
    for joint in range(6):
        groups = [effect(f"joint{joint + 1}.gravity{link + 1}", chain, loads) for link in range(joint, 6)]
        columns = np.concatenate(
            [each.offsets(joints, np.zeros((100, 0)), np.zeros(2))[1][:, joint] for each in groups], axis=1
        )
        solution = np.linalg.lstsq(columns, force[:, joint], rcond=None)[0]
        np.testing.assert_allclose(columns @ solution, force[:, joint], atol=1e-10)
        if joint < 5:  # without the last link, what that carries is missing
            fewer = np.linalg.lstsq(columns[:, :-2], force[:, joint], rcond=None)[0]
            assert np.abs(columns[:, :-2] @ fewer - force[:, joint]).max() > 1e-2


def test_what_a_single_joint_cannot_have_says_so() -> None:
    for name, message in (
        ("joint7.harmonic2", "joints 1 to 6"),
        ("joint2.harmonic2", "give a joint that turns"),
        ("joint1.coupling1", "give two different joints"),
        ("joint4.gravity3", "a link that it carries"),
        ("joint2.gravity4", "give a joint that turns"),
    ):
        with pytest.raises(LabError, match=message):
            effect(name, VERSATRAN, None)


@pytest.mark.thorough
def test_derivatives_of_an_arm_with_effects() -> None:
    rng = np.random.default_rng(1)
    arm = IRB120.arm_with(("p1", "p2"), ALONE, SESSIONS)
    values, inputs = true_values(arm, rng), arm.structure_joints(20, rng)
    points, jacobian = arm.observe(inputs, values)
    np.testing.assert_allclose(points, arm.points(inputs, values), atol=1e-14)
    assert_derivatives(lambda v: arm.points(inputs, v), jacobian, values, relative=1e-7)


def test_no_poses_give_no_rows() -> None:
    """The points and derivatives of a part of the poses are those rows of all poses; of no poses there are none."""
    rng = np.random.default_rng(2)
    arm = IRB120.arm_with(("p1", "p2"), ALONE, SESSIONS)
    values, inputs = true_values(arm, rng), arm.structure_joints(3, rng)
    points, jacobian = arm.observe(inputs, values)
    for chosen in ([], [2], [0, 1]):
        some = arm.observe(inputs[chosen], values)
        for part, whole in zip(some, (points, jacobian), strict=True):
            assert part.shape == (len(chosen), *whole.shape[1:])
            np.testing.assert_allclose(part, whole[chosen], rtol=1e-12, atol=1e-12)


def test_torques_are_those_of_mujoco() -> None:
    """qfrc_bias at rest is what holds the arm; a payload adds J'mg at the last frame's origin."""
    robot, loads = IRB120.model, IRB120.loads
    assert loads is not None
    rng = np.random.default_rng(2)
    joints, payload = IRB120.chain.random_joints(50, rng), rng.choice([0.0, 1.5, 3.0], 50)
    force, _ = loads.forces(joints, payload)
    data = mujoco.MjData(robot.model)
    arm = IRB120.arm(("p1",))
    flange = arm.flange(joints, arm.nominal())
    addresses = [int(robot.model.joint(name).qposadr[0]) for name in IRB120.chain.joint_names]
    speeds = [int(robot.model.joint(name).dofadr[0]) for name in IRB120.chain.joint_names]
    jacobian = np.zeros((3, robot.model.nv))
    for pose in range(50):
        data.qpos[addresses] = joints[pose]
        mujoco.mj_forward(robot.model, data)
        origin = (robot.T_world_frame0 @ flange[pose])[:3, 3]
        mujoco.mj_jac(robot.model, data, jacobian, None, origin, robot.model.body(robot.carrier).id)
        pushed = -data.qfrc_bias + payload[pose] * jacobian.T @ robot.model.opt.gravity
        np.testing.assert_allclose(force[pose], pushed[speeds], atol=1e-11)


@pytest.mark.parametrize("name", GROUPS)
def test_recovery_without_noise(name: str) -> None:
    rng = np.random.default_rng(4)
    arm = IRB120.arm_with(("p1",), (name,), SESSIONS)
    truth = true_values(arm, rng)
    found = identify(arm, seen(arm, truth, 60, rng), arm.nominal(IRB120.tool))
    assert found.status == "converged" and len(found.fit.free) == 27 + PARAMETERS[name]
    fresh = arm.structure_joints(200, rng)
    np.testing.assert_allclose(arm.points(fresh, found.values), arm.points(fresh, truth), atol=1e-11)
    effects = slice(len(arm.arm.names), None)
    unsure = {"payload": 1e-7, "torsion": 1e-9}.get(name, 1e-11)  # a mass, the hand's twist: they hardly show
    untwisted = np.array([name == "link1.gj" for name in arm.names[effects]])
    np.testing.assert_allclose(found.values[effects], np.where(untwisted, 0.0, truth[effects]), atol=unsure)


def test_masses_are_needed_for_gravity() -> None:
    with pytest.raises(LabError, match="table without masses; give it as MJCF or URDF"):
        load_robot("ur10").arm_with(("p1",), ("compliance",))


def test_sessions_are_rows_of_a_frame_of_their_own() -> None:
    arm = IRB120.arm_with(("p1",), ("sessions",), SESSIONS)
    values, joints = arm.nominal(IRB120.tool), IRB120.chain.random_joints(4, np.random.default_rng(0))
    values[arm.names.index("session.b.x")] = 1e-3
    data = replace(measured(IRB120.chain.joint_names, joints, ("p1",), np.zeros((4, 1, 3))), sessions=tuple("abca"))
    moved = arm.points(data.inputs(arm.conditions), values) - arm.arm.points(joints, values[: len(arm.arm.names)])
    np.testing.assert_allclose(moved[:, 0], np.array([[0, 0, 0], [1e-3, 0, 0], [0, 0, 0], [0, 0, 0]]), atol=1e-15)
    with pytest.raises(LabError, match="all rows are of one session; add a column session"):
        IRB120.arm_with(("p1",), ("sessions",), SessionInfo(("a",)))


def test_unknown_and_doubled_groups() -> None:
    with pytest.raises(LabError, match="--model sag: no such group; there are geometric, auto, compliance, payload"):
        IRB120.arm_with(("p1",), ("sag",))
    with pytest.raises(LabError, match=r"--model compliance\+payload: both have joint2.compliance; choose one"):
        IRB120.arm_with(("p1",), ("compliance", "payload"))


def test_missing_and_empty_conditions() -> None:
    rng = np.random.default_rng(6)
    arm = IRB120.arm_with(("p1",), ("drift", "compliance"))
    data = seen(arm, true_values(arm, rng), 40, rng)
    with pytest.raises(LabError, match="column time_s is missing"):
        identify(arm, replace(data, conditions={}), arm.nominal(IRB120.tool))
    late = np.where(np.arange(40) == 7, np.nan, data.conditions["time_s"])
    with pytest.raises(LabError, match="row 7, column time_s: empty"):
        identify(arm, replace(data, conditions={"time_s": late}), arm.nominal(IRB120.tool))


def test_slides_and_hinges_bear_weight_apart() -> None:
    """Newtons of a slide say nothing of the Newton metres of hinges."""
    rng = np.random.default_rng(0)
    loads = Loads(VERSATRAN, np.full(6, 2.0), np.tile([0.05, 0.0, 0.02], (6, 1)), np.array([0.0, 0.0, -9.81]))
    bearing = loads.bearing(rng)
    hinges = [j for j in bearing if not VERSATRAN.prismatic[j]]
    assert 1 in bearing and hinges  # the vertical slide, and the wrist
    assert 0 not in bearing  # the vertical axis


def test_drift_is_of_time_alone() -> None:
    """After an hour points are shifted, turned and stretched by the parameters themselves."""
    arm = IRB120.arm_with(("p1",), ("drift",))
    rng = np.random.default_rng(8)
    values = arm.nominal()
    values[-7:] = v = 1e-4 * rng.normal(size=7)
    joints = np.append(IRB120.chain.random_joints(1, rng)[0], HOUR_S)[None]
    still = arm.arm.points(joints[:, :6], values[:-7])[0, 0]
    moved = (1 + v[6]) * se3.exp(v[3:6]) @ (still + v[:3])
    np.testing.assert_allclose(arm.points(joints, values)[0, 0], moved, atol=1e-15)


def test_a_drift_without_a_clock_is_of_the_place_in_the_file() -> None:
    """The last row is moved by the parameters themselves, the first not at all, rows that are left out or not."""
    untimed = SessionInfo(timed=False)
    arm = IRB120.arm_with(("p1",), ("drift",), untimed)
    assert [each.unit.si for each in arm.parameters if each.name in ("drift.x", "drift.rx")] == ["m", "rad"]
    values, joints = arm.nominal(IRB120.tool), IRB120.chain.random_joints(5, np.random.default_rng(0))
    values[arm.names.index("drift.x")] = 1e-3
    data = measured(IRB120.chain.joint_names, joints, ("p1",), np.zeros((5, 1, 3)))[[4, 0, 1]]
    rigid = arm.arm.points(data.joints, values[: len(arm.arm.names)])
    moved = arm.points(data.inputs(arm.conditions), values) - rigid
    np.testing.assert_allclose(moved[:, 0, 0], [1e-3, 0.0, 0.25e-3], atol=1e-15)


def test_an_arm_expands_about_its_base() -> None:
    """Every distance from the base grows alike, wherever the tracker is, and ``tool`` agrees with ``points``."""
    rng = np.random.default_rng(1)
    arm = IRB120.arm_with(("p1", "p2"), ("expansion", "drift"))
    values = true_values(arm, rng)
    values[arm.names.index("thermal.expansion")] = 20e-6
    still = np.where([name.startswith("drift") for name in arm.names], 0.0, values)
    joints = IRB120.chain.random_joints(6, rng)
    cold, warm = (np.column_stack([joints, np.full(6, t), np.full(6, 1800.0)]) for t in (20.0, 45.0))
    assert arm.conditions == ("temp_C", "time_s")
    before, after = (arm.points(inputs, still) - values[:3] for inputs in (cold, warm))
    np.testing.assert_allclose(after, (1 + 25 * 20e-6) * before, atol=1e-15)
    np.testing.assert_allclose(arm.tool(warm, values, 1)[0][:, :3, 3], arm.points(warm, values)[:, 1], atol=1e-15)
    assert_derivatives(lambda v: arm.points(warm, v), arm.observe(warm, values)[1], values, relative=1e-6)
    np.testing.assert_allclose(arm.observe(warm, values)[0], arm.points(warm, values), atol=1e-15)


@pytest.mark.parametrize(
    ("robot", "groups", "at_once"),
    [
        ("irb120", ("compliance",), True),
        ("irb120", ("harmonics", "hardening", "compliance", "gear", "backlash"), True),
        ("scara", ("coupling", "harmonics2"), True),
        ("versatran", ("backlash", "harmonics"), True),
        ("irb120", ("payload",), False),
        ("irb120", ("bending", "harmonics"), False),
    ],
)
def test_a_stack_of_arms_with_effects_is_each_arm_alone(robot: str, groups: tuple[str, ...], at_once: bool) -> None:
    """Points and derivatives by some parameters; the last joint's reading is reversed."""
    arm, rng = load_robot(robot).arm_with(("p1", "p2"), groups), np.random.default_rng(3)
    chain = arm.rigid.chain
    assert isinstance(chain, Chain)
    reversed_last = replace(chain, sign=np.append(chain.sign[:-1], -1.0))
    arm = ArmWithEffects(SerialArm(reversed_last, ("p1", "p2")), arm.effects)
    assert isinstance(stacked(arm), SequentialBatch) != at_once
    inputs = arm.structure_joints(7, rng)
    values = np.tile(arm.nominal(), (4, 1))
    values += (
        1e-3 * rng.normal(size=values.shape) * np.where([each.kind == "compliance" for each in arm.parameters], 1e-3, 1)
    )
    first = len(arm.rigid.names)
    free = [2, 7, 9, first - 1, *range(first, len(arm.names))][::-1]
    points, columns = stacked(arm).observe(inputs, values, free)
    np.testing.assert_array_equal(stacked(arm).points(inputs, values), points)
    for b, row in enumerate(values):
        alone, jacobian = arm.observe(inputs, row)
        np.testing.assert_allclose(points[b], alone.transpose(1, 2, 0), atol=1e-13)
        np.testing.assert_allclose(
            columns[:, :, :, b], jacobian[..., free].transpose(3, 2, 1, 0), rtol=1e-9, atol=1e-12
        )
