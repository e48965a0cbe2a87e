"""Effects of loads along a trajectory: inertia beside gravity, against MuJoCo's inverse dynamics and moving arms."""

import mujoco
import numpy as np
from helpers.robots import IRB120

from lab.kinematics.dynamics.beam import COMPLIANCES
from lab.kinematics.dynamics.gravity import link_loads
from lab.kinematics.effects.effect import rates_of
from lab.robots.load_robot import load_virtual
from lab.simulation.elastic_links import FlexibleArm, JointMotion, along_the_line

TUBE = np.array([2e-5, 2e-5, 3e-5, 1.5e-8])


def test_generalized_forces_of_inertia_are_mujocos() -> None:
    """qfrc of mj_rne with and without the rates, of an arm whose links' masses lie along their lines."""
    for robot in (IRB120, load_virtual("tx40")):
        assert robot.loads is not None
        links, serial = link_loads(robot.loads), robot.serial_model
        model = FlexibleArm(serial.model, serial)._model
        along_the_line(model, serial, tuple(links.beams))
        for body in range(model.nbody):  # links without a length are points here
            if body not in [serial.model.body(serial.bodies[link]).id for link in links.beams]:
                model.body_inertia[body] = 0.0
        data, rng, size = mujoco.MjData(model), np.random.default_rng(1), robot.chain.size
        q = robot.chain.random_joints(5, rng)
        v, a = rng.normal(size=(2, 5, size)) * np.array([2.0, 10.0])[:, None, None]
        expected, held = np.zeros((5, size)), np.zeros(model.nv)
        for i in range(5):
            for rate, sign in ((1.0, -1.0), (0.0, 1.0)):
                data.qpos[:], data.qvel[:], data.qacc[:] = q[i], rate * v[i], rate * a[i]
                mujoco.mj_kinematics(model, data)
                mujoco.mj_comPos(model, data)
                mujoco.mj_comVel(model, data)
                mujoco.mj_rne(model, data, 1, held)
                expected[i] += sign * held
        found = links.inertia(q, v, a, np.zeros(5))
        np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())


def test_at_rest_the_moving_effects_are_the_others() -> None:
    rng = np.random.default_rng(2)
    groups = ("compliance", "bending", "torsion", "extension")
    still, moving = (IRB120.arm_with(("p1",), groups, moving=each) for each in (False, True))
    assert moving.names == still.names and moving.conditions == ("payload_kg", *rates_of(IRB120.chain.joint_names))
    values = np.append(
        still.rigid.nominal(IRB120.tool), rng.uniform(0, 2e-5, len(still.names) - len(still.rigid.names))
    )
    q, load = IRB120.chain.random_joints(4, rng), np.array([[0.0], [1.0], [2.0], [3.0]])
    at_rest = np.concatenate([q, load], axis=1)
    rates = np.zeros((4, 12))
    found = moving.observe(np.concatenate([at_rest, rates], axis=1), values)
    for mine, other in zip(found, still.observe(at_rest, values), strict=True):
        np.testing.assert_allclose(mine, other, atol=1e-13)


def test_joints_and_links_that_give_way_in_motion_are_the_virtual_arms() -> None:
    """Springs and beams under gravity, 2 kg and inertia: to the share by which the sag changes its own loads."""
    rng, size = np.random.default_rng(3), IRB120.chain.size
    sections = np.full((size, 4), 1e-15)  # as good as stiff, but the mass along its line, as the equations have it
    sections[4] = 0.0
    sections[[1, 3]] = TUBE
    springs = np.array([0.0, 1e-5, 1e-5, 0.0, 0.0, 0.0])
    q, load = IRB120.chain.random_joints(3, rng), np.full(3, 2.0)
    v, a = (scale * rng.normal(size=(3, size)) * [1, 1, 1, 0, 0, 0] for scale in (2, 10))
    made = FlexibleArm(IRB120.model.model, IRB120.model, sections=sections)
    sites = [IRB120.model.model.site("p1").id]
    rigid = made.positions(made.straight(q), sites)
    expected = made.positions(made.settled(q, springs, load, JointMotion(v, a)), sites) - rigid
    arm = IRB120.arm_with(("p1",), ("compliance", "bending", "torsion", "extension"), moving=True)
    values = arm.nominal(IRB120.tool)
    known = {f"link{link}.{symbol}": TUBE[i] for link in (2, 4) for i, symbol in enumerate(COMPLIANCES)}
    for name, value in {"joint2.compliance": 1e-5, "joint3.compliance": 1e-5, **known}.items():
        values[arm.names.index(name)] = value
    inputs = np.concatenate([q, load[:, None], v, a], axis=1)
    moved = arm.points(inputs, values) - arm.rigid.points(q, values[: len(arm.rigid.names)])
    turned = moved @ IRB120.T_world_frame0[:3, :3].T
    size_of = np.abs(expected).max()
    np.testing.assert_allclose(turned, expected, atol=5e-3 * size_of)
    still = arm.points(np.concatenate([q, load[:, None], 0 * v, 0 * a], axis=1), values)
    assert np.abs(still - arm.points(inputs, values)).max() > 0.05 * size_of
