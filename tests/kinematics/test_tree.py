"""Robots with several tips against MuJoCo, differences, and serial arms that are joined by hand."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.gauge import base_set, structure_jacobian
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm
from lab.kinematics.tree import TreeArm, first_of_tips, tree_chain
from lab.robots.load_robot import load_robot

BOTH = ("left.p1", "right.p1")


def arm_of(name: str, *targets: str) -> TreeArm:
    robot = load_robot(name)
    return TreeArm(robot.model.chain, targets or tuple(robot.tool))


def off_nominal(arm: TreeArm, seed: int = 0) -> Array:
    rng = np.random.default_rng(seed)
    values = arm.nominal() + 0.02 * rng.standard_normal(len(arm.names))
    values[:6] += rng.standard_normal(6)
    return values


def two_of(name: str) -> TreeArm:
    """Two arms of the lab on one table, the second turned about an oblique axis, by their serial chains."""
    first: Chain = load_robot(name).serial_model.chain
    second = replace(first, joint_names=tuple(f"other_{joint}" for joint in first.joint_names))
    mount = se3.pose(se3.exp(np.array([0.3, -0.4, 2.5])), np.array([1.2, 0.3, -0.1]))
    return TreeArm(tree_chain("pair", ("a", "b"), (first, second), (np.eye(4), mount)), ("a.p1", "b.p1", "b.p2"))


def forked(convention: str) -> TreeArm:
    """Three joints, of which two chains share the first two; of a Craig table the fork turns and shifts on axis 2."""
    rng = np.random.default_rng(5)
    trunk, tables = rng.uniform(-1, 1, (2, 5)), [rng.uniform(-1, 1, (3, 5)) for _ in range(2)]
    chains = []
    for i, table in enumerate(tables):
        rows = np.concatenate([trunk[:1], table[:2], table[2:]])
        if convention == "craig":  # before axis 2 both are alike, behind it theta and d are their own
            rows[1, 2:] = trunk[1, 2:]
        rows[:, 4] = 0.0
        names = ("t1", "t2", f"{'uv'[i]}3", f"{'uv'[i]}4")
        size = (4,)
        chains.append(
            Chain(
                name="fork", convention=convention, joint_names=names, prismatic=(False,) * 4, table=rows,
                sign=np.ones(size), lower=-np.ones(size), upper=np.ones(size), speed=np.full(size, np.nan),
                acceleration=np.full(size, np.nan), parallel=(False,) * 4,
            )
        )  # fmt: skip
    return TreeArm(tree_chain("fork", ("u", "v"), chains, (np.eye(4),) * 2), ("u.p1", "v.p1"))


ARMS = {
    "torso": lambda: arm_of("torso"),
    "rail": lambda: arm_of("rail"),
    "pair": lambda: two_of("irb120"),
    "distal": lambda: forked("distal"),
    "craig": lambda: forked("craig"),
}


@pytest.mark.parametrize("name", ["torso", "rail"])
def test_points_are_mujocos(name: str) -> None:
    robot, arm = load_robot(name), arm_of(name)
    joints = arm.chain.random_joints(40, np.random.default_rng(1))
    data, found = mujoco.MjData(robot.model.model), []
    for row in robot.model.qpos(joints):
        data.qpos[:] = row
        mujoco.mj_kinematics(robot.model.model, data)
        found.append([data.site(target).xpos.copy() for target in arm.targets])
    T = se3.inverse(robot.T_world_frame0)
    expected = np.array(found) @ T[:3, :3].T + T[:3, 3]
    np.testing.assert_allclose(arm.points(joints, arm.nominal(robot.tool)), expected, atol=1e-12)


@pytest.mark.parametrize("name", ARMS)
def test_derivatives_are_those_of_differences(name: str) -> None:
    arm, step = ARMS[name](), 1e-6
    values = off_nominal(arm)
    joints = arm.chain.random_joints(8, np.random.default_rng(2))
    points, jacobian = arm.observe(joints, values)
    np.testing.assert_array_equal(points, arm.points(joints, values))

    def differences(count: int, by: str) -> Array:
        moved = [
            arm.points(joints + sign * step * row, values) if by == "joints" else
            arm.points(joints, values + sign * step * row)
            for row in np.eye(count) for sign in (1, -1)
        ]  # fmt: skip
        return np.stack([(a - b) / (2 * step) for a, b in zip(moved[::2], moved[1::2], strict=True)], axis=-1)

    np.testing.assert_allclose(jacobian, differences(len(values), "values"), atol=1e-8)
    by_joints = differences(arm.chain.size, "joints")
    np.testing.assert_allclose(arm.joint_derivatives(jacobian), by_joints, atol=1e-8)
    for k in range(len(arm.targets)):
        Ts, twists = arm.tool(joints, values, k)
        np.testing.assert_allclose(Ts[:, :3, 3], points[:, k], atol=1e-13)
        np.testing.assert_allclose(twists[:, :3], by_joints[:, k], atol=1e-8)
        later = arm.tool(joints + step, values, k)[0]
        turned = se3.log(later[:, :3, :3] @ Ts[:, :3, :3].swapaxes(1, 2)) / step
        np.testing.assert_allclose(turned, twists[:, 3:].sum(axis=2), atol=1e-5)


@pytest.mark.parametrize("convention", ["distal", "craig"])
def test_branches_are_serial_chains_that_share_their_first_joints(convention: str) -> None:
    arm = forked(convention)
    joints = np.random.default_rng(3).uniform(-1, 1, (5, arm.chain.size))
    for k, (chain, members) in enumerate(zip(arm.chain.chains, arm.chain.members, strict=True)):
        alone = SerialArm(chain)
        np.testing.assert_allclose(
            arm.points(joints, arm.nominal())[:, k], alone.points(joints[:, members], alone.nominal())[:, 0], atol=1e-14
        )
    own = {"distal": "theta d a alpha", "craig": "theta d"}[convention].split()
    shared = {"distal": set(), "craig": {"link2.a", "link2.alpha"}}[convention]
    fork = {name for name in arm.names if name.startswith("link2.")}
    assert fork == {f"link2.{joint}.{cell}" for joint in ("u3", "v3") for cell in own} | shared


def test_a_mount_places_a_robot_beside_another() -> None:
    arm, alone = two_of("irb120"), SerialArm(load_robot("irb120").serial_model.chain, ("p1", "p2"))
    values = off_nominal(arm)
    joints = arm.chain.random_joints(6, np.random.default_rng(4))
    named = dict(zip(arm.names, values.tolist(), strict=True))
    mount = np.array([named[f"mount.other_q1.{axis}"] for axis in ("x", "y", "z", "rx", "ry", "rz")])
    own = alone.nominal()
    for i, name in enumerate(alone.names[6:], start=6):
        owner, cell = name.rsplit(".", 1)
        other = f"link{int(owner[4:]) + 6}" if owner.startswith("link") else owner.replace("tool.", "tool.b.")
        own[i] = named[f"{other}.{cell}"]
    own[:6] = 0.0
    at = alone.points(joints[:, 6:], own)
    T = arm.T_tracker_frame0(values) @ se3.pose(se3.exp(mount[3:]), mount[:3])
    expected = at @ T[:3, :3].T + T[:3, 3]
    np.testing.assert_allclose(arm.points(joints, values)[:, 1:], expected, atol=1e-13)


def test_two_arms_share_the_axis_of_the_waist() -> None:
    """Alone each of the arms shows 31 parameters; together they share a line in the tracker's frame, four numbers."""
    counts = []
    for targets in (("left.p1",), ("right.p1",), BOTH):
        arm = arm_of("torso", *targets)
        values = arm.nominal(load_robot("torso").tool)
        found = base_set(arm, values)
        jacobian = structure_jacobian(arm, values, 100).reshape(-1, len(arm.names))
        scaled = jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-12)
        assert len(found.identifiable) == np.linalg.matrix_rank(scaled, tol=1e-8 * np.sqrt(len(scaled)))
        counts.append(len(found.identifiable))
    assert counts == [31, 31, 31 + 31 - 4]


def test_parallel_axes_have_a_beta_and_no_d() -> None:
    arm = arm_of("torso", *BOTH)
    free = {arm.names[i] for i in base_set(arm, arm.nominal()).identifiable}
    for link in ("link3", "link9"):  # between upper arm and elbow
        assert f"{link}.beta" in free and f"{link}.d" not in free
    tilted = arm.nominal()
    tilted[arm.names.index("link3.beta")] = 1e-3
    assert arm.rank_point(tilted)[arm.names.index("link3.beta")] == 0.0


def test_a_single_measured_tip_is_a_serial_arm() -> None:
    tree, robot = arm_of("torso", "right.p1"), load_robot("torso", tips=("right",))
    alone = robot.arm(("p1",))
    assert len(base_set(tree, tree.nominal()).identifiable) == len(base_set(alone, alone.nominal()).identifiable)
    joints = alone.chain.random_joints(5, np.random.default_rng(6))
    whole = np.zeros((5, tree.chain.size))
    whole[:, [tree.chain.joint_names.index(name) for name in alone.chain.joint_names]] = joints
    at = {name: place for name, place in load_robot("torso").tool.items() if name.startswith("right")}
    np.testing.assert_allclose(
        tree.points(whole, tree.nominal(at)), alone.points(joints, alone.nominal(robot.tool)), atol=1e-14
    )
    distance, joint = tree.singular_distance(whole, tree.nominal(at))
    expected, which = alone.singular_distance(joints, alone.nominal(robot.tool))
    np.testing.assert_allclose(distance, expected, atol=1e-9)
    assert [tree.chain.joint_names[i] for i in joint] == [alone.chain.joint_names[i] for i in which]


def test_targets_are_named_by_their_tip() -> None:
    tree = load_robot("torso").model.chain
    for targets, says in ((("p1",), "left.p1"), (("middle.p1",), "left, right"), ((), "at least one")):
        with pytest.raises(LabError, match=says):
            TreeArm(tree, targets)
    assert first_of_tips(("left.p2", "left.p1", "right.p1", "left.p3")) == (0, 2)
    assert first_of_tips(("p1", "p2")) == (0,)
