"""From poses to joints: Newton's method, whatever the arm, and all ways of a drawing."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120, RX130, SCARA, VERSATRAN, chain_of, perturbed, somewhere

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.differential import singular_distance
from lab.kinematics.inverse.branches import NominalInverse, nearest_whole_turns, ordered
from lab.kinematics.inverse.closed_form import Solutions
from lab.kinematics.inverse.newton_inverse import PoseTarget, reach, shortest_step, within_reach
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm
from lab.robots.load_robot import load_robot

# Newton's method


@pytest.mark.parametrize("groups", [(), ("compliance", "harmonics")], ids=["rigid", "bending"])
def test_newton_ends_where_the_arm_is(groups: tuple[str, ...]) -> None:
    rng = np.random.default_rng(8)
    arm = IRB120.arm_with(("p1",), groups)
    rigid = arm.rigid
    values = np.zeros(len(arm.names))
    values[: len(rigid.names)] = perturbed(rigid, somewhere(rigid, rng), rng, 0.5e-3, 1.5e-3)
    values[len(rigid.names) :] = [1e-5 if "compliance" in name else 2e-4 for name in arm.names[len(rigid.names) :]]
    joints = IRB120.chain.random_joints(500, rng)
    load = np.full((500, len(arm.conditions)), 3.0)
    Ts = arm.tool(np.concatenate([joints, load], axis=1), values)[0]
    points = arm.points(np.concatenate([joints, load], axis=1), values)[:, 0]
    np.testing.assert_allclose(Ts[:, :3, 3], points, atol=1e-15)
    near = singular_distance(rigid.tool(joints, values[: len(rigid.names)])[1])[0] < 0.1
    start = joints + rng.normal(scale=0.01, size=joints.shape)
    found = reach(arm, values, PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3]), start, load)
    assert found.arrived[~near].all() and found.steps[~near].max() <= 6
    assert np.abs(found.joints - joints)[~near].max() < 1e-8
    anywhere = np.full((500, 3, 3), np.nan)
    free = reach(arm, values, PoseTarget(Ts[:, :3, 3], anywhere), start, load)
    assert free.arrived.all()
    assert np.linalg.norm(free.joints - start, axis=1)[~near].max() < 0.1  # the shortest way there


# Fewer joints than a pose has freedoms

FIVE = chain_of(
    "five", "craig", "RRRRR", [0, -90, 0, 0, 90], [0, 0.1, 0.4, 0.3, 0.05], [0, 20, 30, 10, 0], [0.3, 0, 0, 0, 0.1]
)
ASKEW = chain_of(  # no axes parallel or meeting: no closed form
    "askew", "craig", "RRRRR", [0, -80, 10, 20, 70], [0, 0.1, 0.4, 0.3, 0.05], [0, 20, 30, 10, 0], [0.3, 0.1, 0, 0, 0.1]
)
FEW = {chain.name: chain for chain in (SCARA, FIVE)}


def turned_targets(chain: Chain, tilt_rad: float, seed: int) -> tuple[SerialArm, Array, PoseTarget, Array]:
    """An arm that is off in every parameter, and poses near those that it takes at some readings, turned away."""
    rng = np.random.default_rng(seed)
    arm = SerialArm(chain)
    values = perturbed(arm, somewhere(arm, rng), rng, 0.5e-3, 1e-3)
    joints = chain.random_joints(200, rng)
    Ts, jacobian = arm.tool(joints, values)
    away = se3.exp(tilt_rad * rng.normal(size=(200, 3)))
    clear = np.linalg.svd(jacobian, compute_uv=False)[:, -1] > 0.1
    return arm, values, PoseTarget(Ts[:, :3, 3], away @ Ts[:, :3, :3]).take(np.flatnonzero(clear)), joints[clear]


@pytest.mark.parametrize(("name", "tilt_rad"), [("scara", 0.02), ("five", 0.0), ("five", 0.5)])
def test_the_place_is_met_and_the_rotation_as_near_as_can_be(name: str, tilt_rad: float) -> None:
    chain, (arm, values, wanted, joints) = FEW[name], turned_targets(FEW[name], tilt_rad, 1)
    start, nothing = joints + np.random.default_rng(2).normal(scale=0.01, size=joints.shape), np.empty((len(joints), 0))
    found = reach(arm, values, wanted, start, nothing)
    assert found.arrived.mean() > (0.99 if tilt_rad < 0.1 else 0.7)  # the others cannot turn so far there
    Ts, jacobian = arm.tool(found.joints, values)
    errors = wanted.errors(Ts)
    np.testing.assert_array_equal(errors, found.errors)
    assert np.linalg.norm(errors[:, :3], axis=1).max() < (1e-10 if found.arrived.all() else 1e-4)
    missed = np.linalg.norm(errors[:, 3:], axis=1)
    if tilt_rad == 0:
        assert missed.max() < 1e-9 and np.abs(found.joints - joints).max() < 1e-6
        return
    assert np.median(missed) > 0.3 * tilt_rad  # it cannot be met
    vt, anyhow = np.linalg.svd(jacobian[:, :3])[2], np.full_like(wanted.rotations, np.nan)
    for k in range(3, chain.size):  # moves that leave the place come no nearer
        for step in (1e-3, -1e-3):
            back = reach(arm, values, PoseTarget(wanted.positions, anyhow), found.joints + step * vt[:, k], nothing)
            other = wanted.errors(arm.tool(back.joints, values)[0])
            worse = np.linalg.norm(other[:, 3:], axis=1) - missed
            assert back.arrived.all() and worse[found.arrived].min() > -1e-12


def test_what_is_within_reach_is_all_of_it_with_six_joints_and_a_projection_with_fewer() -> None:
    rng = np.random.default_rng(3)
    errors, yes, no = rng.normal(size=(50, 6)), np.full(50, True), np.full(50, False)
    arm = SerialArm(RX130)
    six = arm.tool(RX130.random_joints(50, rng), arm.nominal())[1]
    np.testing.assert_array_equal(within_reach(six, errors, yes), errors)
    arm = SerialArm(SCARA)
    four = arm.tool(SCARA.random_joints(50, rng), arm.nominal())[1]
    np.testing.assert_allclose(within_reach(four, errors, yes), errors * [1, 1, 1, 0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(within_reach(four[:, :, :3], errors, yes), errors * [1, 1, 1, 0, 0, 0], atol=1e-12)
    np.testing.assert_array_equal(within_reach(four, errors * [1, 1, 1, 0, 0, 0], no), errors * [1, 1, 1, 0, 0, 0])
    made = four @ shortest_step(four, 1e-2 * errors, yes)[:, :, None]
    gentle = np.abs(shortest_step(four, 1e-2 * errors, yes)).max(axis=1) < 0.29
    np.testing.assert_allclose(made[gentle, :, 0], 1e-2 * (errors * [1, 1, 1, 0, 0, 1])[gentle], atol=1e-12)


def test_a_scara_upside_down_or_out_of_reach_ends_somewhere() -> None:
    arm = SerialArm(SCARA)
    joints = SCARA.random_joints(20, np.random.default_rng(6))
    Ts, _ = arm.tool(joints, arm.nominal())
    over = PoseTarget(Ts[:, :3, 3], se3.exp(np.array([np.pi, 0, 0])) @ Ts[:, :3, :3])
    found = reach(arm, arm.nominal(), over, joints, np.empty((20, 0)))
    assert found.arrived.all() and np.linalg.norm(found.errors[:, 3:], axis=1) == pytest.approx(np.pi)
    far = PoseTarget(Ts[:, :3, 3] + [5.0, 0, 0], Ts[:, :3, :3])
    found = reach(arm, arm.nominal(), far, joints, np.empty((20, 0)))
    assert not found.arrived.any() and np.isfinite(found.joints).all()


# All ways of a drawing


def five_hinges() -> Chain:
    """No two axes are parallel, and none meet."""
    rng = np.random.default_rng(3)
    table = np.zeros((5, 5))
    table[:, 1:3], table[:, 3] = rng.uniform(0.1, 0.3, (5, 2)), rng.uniform(-1.5, 1.5, 5)
    return replace(load_robot("scorbot").chain, table=table, parallel=(False,) * 5)


@pytest.mark.thorough
@pytest.mark.parametrize("chain", [load_robot("panda").chain, five_hinges()], ids=["seven", "five"])
def test_an_arm_without_a_closed_form_is_searched(chain: Chain) -> None:
    arm = SerialArm(chain)
    joints = chain.random_joints(200, np.random.default_rng(10))
    drawing = NominalInverse(arm, arm.nominal())
    assert drawing.closed_form is None
    Ts, _ = drawing.tool(joints)
    found = drawing.solutions(PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3]), np.full(joints.shape, np.nan))
    reached = (found.gap_m == 0) & (found.tilt_rad < 1e-9)
    assert reached.any(axis=1).all()
    back = drawing.tool(found.joints[reached])[0]
    assert np.abs(back - np.repeat(Ts, reached.sum(axis=1), axis=0)).max() < 1e-9


def test_a_reference_is_where_the_search_begins() -> None:
    arm = IRB120.arm(("p1",))
    drawing = NominalInverse(arm, arm.nominal(IRB120.tool))
    joints = IRB120.chain.random_joints(50, np.random.default_rng(11))
    Ts, _ = drawing.tool(joints)
    anywhere = PoseTarget(Ts[:, :3, 3], np.full((50, 3, 3), np.nan))
    np.testing.assert_allclose(drawing.solutions(anywhere, joints).joints[:, 0], joints, atol=1e-12)


def test_whole_turns_stay_near_and_within_limits() -> None:
    chain = IRB120.chain  # the last joint turns by 400 degrees each way
    for given, near, expected in ((10, 350, 370), (-170, 180, 190), (100, 400, 100), (60, 400, 60 + 0), (30, 400, 390)):
        joints = np.zeros(6)
        joints[5] = np.deg2rad(given)
        liked = np.zeros(6)
        liked[5] = np.deg2rad(near)
        assert np.rad2deg(nearest_whole_turns(chain, joints, liked)[5]) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("chain", "count"), [(SCARA, 2), (VERSATRAN, 4), (RX130, 8), (FIVE, 4), (ASKEW, 8)], ids=lambda x: str(x)[:9]
)
def test_a_drawing_has_as_many_ways_as_its_form(chain: Chain, count: int) -> None:
    """Of poses; places alone are searched, and beside those the poses' list is filled up with what nobody takes."""
    arm, rng = SerialArm(chain), np.random.default_rng(12)
    drawing = NominalInverse(arm, somewhere(arm, rng))
    assert (drawing.closed_form is None) == (chain is ASKEW)
    joints = chain.random_joints(10, rng)
    Ts, _ = drawing.tool(joints)
    turns, nowhere = Ts[:, :3, :3].copy(), np.full(joints.shape, np.nan)
    found = drawing.solutions(PoseTarget(Ts[:, :3, 3], turns), nowhere)
    assert found.gap_m.shape == (10, count)
    turns[::2] = np.nan
    mixed = drawing.solutions(PoseTarget(Ts[:, :3, 3], turns), nowhere)
    assert mixed.gap_m.shape == (10, 8)
    if chain is not ASKEW:
        np.testing.assert_array_equal(mixed.joints[1::2, :count], found.joints[1::2])
        assert np.isinf(mixed.gap_m[1::2, count:]).all()
    liked, order = ordered(chain, mixed, nowhere, np.zeros((10, 8), dtype=bool))
    assert np.isfinite(liked).all() and (order[1::2, 0] < count).all()
    back = drawing.tool(liked[:, 0])[0]
    assert np.linalg.norm(back[:, :3, 3] - Ts[:, :3, 3], axis=1).max() < 1e-9


def test_a_scara_s_drawing_meets_the_place_of_a_tilted_pose_at_the_tool() -> None:
    """The tool's lever is turned as the arm can turn it, not as the pose asks."""
    arm, rng = SerialArm(SCARA), np.random.default_rng(13)
    drawing = NominalInverse(arm, somewhere(arm, rng))
    joints = SCARA.random_joints(50, rng)
    joints[:, 1] = np.clip(joints[:, 1], 0.5, 2.5)  # bent, so that it can turn
    Ts, _ = drawing.tool(joints)
    wanted = PoseTarget(Ts[:, :3, 3], se3.exp(0.05 * rng.normal(size=(50, 3))) @ Ts[:, :3, :3])
    found = drawing.solutions(wanted, joints)
    assert not found.gap_m.any()
    for way in range(2):
        Ts_found, jacobian = drawing.tool(found.joints[:, way])
        errors = wanted.errors(Ts_found)
        assert np.abs(errors[:, :3]).max() < 1e-12
        assert np.abs(within_reach(jacobian, errors, wanted.turned)).max() < 1e-12  # nothing better to be had


def test_rows_in_order_are_those_found_one_after_the_other() -> None:
    """Each row's best way says where the next one looks; all at once they come to the same."""
    chain, rng = RX130, np.random.default_rng(5)
    ways = Solutions(
        rng.uniform(-3, 3, (60, 8, 6)), np.zeros((60, 8)), np.zeros((60, 8)), np.zeros((60, 8, 6), dtype=bool)
    )
    reference = np.where(rng.random((60, 1)) < 0.1, rng.uniform(-1, 1, (60, 6)), np.nan)
    disliked, before = rng.random((60, 8)) < 0.3, rng.uniform(-1, 1, 6)
    joints, order = ordered(chain, ways, reference, disliked, before)
    for i in range(60):
        one = Solutions(*(part[i : i + 1] for part in (ways.joints, ways.gap_m, ways.tilt_rad, ways.free)))
        alone = ordered(chain, one, reference[i : i + 1], disliked[i : i + 1], before)
        assert (joints[i] == alone[0][0]).all() and (order[i] == alone[1][0]).all()
        before = joints[i, 0]
