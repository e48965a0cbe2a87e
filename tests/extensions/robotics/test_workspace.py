"""What robots reach: against closed formulas, their own poses, and one way of measuring against another."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120, chain_of

from lab.extensions.robotics.workspace.boundary import boundary
from lab.extensions.robotics.workspace.measure import measured, workspace_of
from lab.extensions.robotics.workspace.membership import ByRods, Search, anyhow, domain_of, memberships, within_turns
from lab.kinematics.inverse.newton_inverse import PoseTarget
from lab.kinematics.joints import JointSpec
from lab.kinematics.serial.serial_arm import SerialArm
from lab.robots.load_robot import load_robot

VOLUMES = {  # m³, L = 1 m
    "cartesian": 1.0,
    "cylindrical": np.pi,
    "spherical": 4 * np.pi / 3,
    "scara": 4 * np.pi,
    "anthropomorphic": 32 * np.pi / 3,
}


def carrier(name: str):
    arm = load_robot(f"carrier/{name}").arm(("p1",))
    return arm, arm.nominal({"p1": np.zeros(3)})


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.sampled(5)) for n in VOLUMES])
def test_the_five_carriers_reach_what_closed_formulas_say(name) -> None:
    """By sections to 0.1 %, by Monte Carlo within its own standard error, by the boundary to a few per cent."""
    space = workspace_of(*carrier(name), 2000, np.random.default_rng(0))
    assert space.by_sections == pytest.approx(VOLUMES[name], rel=1e-3)
    assert abs(space.measured.size - VOLUMES[name]) < 4 * space.measured.standard_error
    assert space.measured.standard_error < 0.02 * VOLUMES[name] and not space.measured.voids
    vertices, triangles = space.surface
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    assert np.einsum("ni,ni->n", a, np.cross(b, c)).sum() / 6 == pytest.approx(VOLUMES[name], rel=0.03)
    assert space.orientations is None


@pytest.mark.thorough
def test_a_hollow_ball_has_a_void_and_a_whole_one_none() -> None:
    chain = chain_of("spherical", "craig", "RRP", [0, -90, 90], [0] * 3, [0] * 3, [0] * 3)
    for least, void in ((0.4, 4 * np.pi / 3 * 0.4**3), (0.0, 0.0)):
        arm = SerialArm(
            replace(chain, lower=np.array([-np.pi, -np.pi, least]), upper=np.array([np.pi, np.pi, 1.0])), ("p1",)
        )
        values = arm.nominal({"p1": np.zeros(3)})
        found = measured(domain_of(arm, values), memberships(arm, values)[0], 3000, np.random.default_rng(1))
        assert sum(found.voids) == pytest.approx(void, abs=0.03)


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.sampled(3)) for n in ("irb120", "rx130", "tx40")])
def test_the_search_finds_poses_at_the_joints_limits(name) -> None:
    """Half of the joints at a limit each: places at the boundary of what is reached; none farther out is found."""
    robot, rng = load_robot(name), np.random.default_rng(1)
    arm, chain = robot.arm(("p1",)), robot.chain
    values = arm.nominal({"p1": np.zeros(3)})
    joints, which = chain.random_joints(150, rng), rng.random((150, chain.size))
    joints = np.where(which < 0.25, chain.lower, np.where(which > 0.75, chain.upper, joints))
    places = arm.tool(joints, values)[0][:, :3, 3]
    search = Search(arm, values)
    reached, found = search.reached(anyhow(places))
    assert reached.mean() > 0.98
    assert not chain.beyond_limits(found[reached], 0.0).any()
    np.testing.assert_allclose(arm.tool(found[reached], values)[0][:, :3, 3], places[reached], atol=1e-6)
    assert not search.reached(anyhow(places + np.array([0.0, 0.0, 10.0])))[0].any()


def test_places_that_are_all_reached_from_the_first_start_need_no_other() -> None:
    arm = IRB120.arm(("p1",))
    values = arm.nominal({"p1": np.zeros(3)})
    search = Search(arm, values)
    places = search.samples[1][:3, :3, 3]  # those of starts
    assert search.reached(anyhow(places))[0].all() and search.reached(anyhow(places[:0]))[0].size == 0


def test_search_and_closed_form_agree_on_poses() -> None:
    arm = IRB120.arm(("p1",))
    values = arm.nominal({"p1": np.array([0.01, 0.02, 0.1])})
    rng = np.random.default_rng(2)
    Ts = arm.tool(arm.chain.random_joints(60, rng), values)[0]
    Ts[30:, :3, 3] += rng.uniform(-0.4, 0.4, (30, 3))
    wanted = PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3])
    exact, by_search = (each.reached(wanted) for each in (memberships(arm, values)[1], Search(arm, values)))
    assert exact[0][:30].all() and 0 < exact[0][30:].sum() < 30
    assert (exact[0] >= by_search[0]).all() and (exact[0] == by_search[0]).mean() > 0.95  # it misses, it invents none
    reached = exact[0]
    np.testing.assert_allclose(arm.tool(exact[1][reached], values)[0], Ts[reached], atol=1e-9)


def test_the_delta_reaches_its_own_poses_alone() -> None:
    robot = load_robot("delta")
    arm = robot.arm(("p1",))
    values = arm.nominal({"p1": np.array([0.05, 0.0, -0.02])})
    by_place, _ = memberships(arm, values)
    joints = robot.chain.random_joints(200, np.random.default_rng(3))
    places = arm.tool(joints, values)[0][:, :3, 3]
    reached, found = by_place.reached(anyhow(places))
    assert by_place.exact and reached.all()
    np.testing.assert_allclose(found, joints, atol=1e-8)
    assert not by_place.reached(anyhow(places + np.array([0.0, 0.0, 3.0])))[0].any()


def test_whole_turns_count() -> None:
    chain = chain_of("wide", "craig", "RRP", [0, -90, 90], [0] * 3, [0] * 3, [0] * 3)
    wide = replace(chain, lower=np.array([3.5, -7.0, 0.0]), upper=np.array([4.5, 7.0, 1.0]))
    inside = within_turns(wide, np.array([[4.0 - 2 * np.pi, 3.0, 0.5], [3.0, -3.0, 0.5], [4.0, 0.0, 0.5 + 2 * np.pi]]))
    assert inside.tolist() == [[True, True, True], [False, True, True], [True, True, False]]


def test_the_boundary_of_a_ball_is_closed_and_of_its_volume() -> None:
    axis = np.linspace(-1.3, 1.3, 16)
    _, vertices, faces = boundary(lambda at: np.linalg.norm(at, axis=1) < 1.0, (axis, axis, axis), 12)
    a, b, c, d = vertices[faces].transpose(1, 0, 2)
    parts = np.einsum("ni,ni->n", a, np.cross(b, c)) + np.einsum("ni,ni->n", a, np.cross(c, d))
    assert parts.sum() / 6 == pytest.approx(4 * np.pi / 3, rel=0.04)
    edges = np.sort(np.concatenate([faces[:, [i, (i + 1) % 4]] for i in range(4)]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    _, vertices, segments = boundary(lambda at: np.linalg.norm(at, axis=1) < 1.0, (axis, axis), 12)
    first, last = vertices[segments].transpose(1, 0, 2)
    assert (first[:, 0] * last[:, 1] - first[:, 1] * last[:, 0]).sum() / 2 == pytest.approx(np.pi, rel=0.02)


@pytest.mark.thorough
def test_a_hexapod_takes_its_own_poses_by_the_lengths_of_its_legs() -> None:
    """Joint positions come back; a leg that is too long, and the mirror image under the base, are not reached."""
    robot, rng = load_robot("hexapod"), np.random.default_rng(1)
    arm, chain = robot.arm(("p1",)), robot.chain
    values = arm.nominal({"p1": np.array([0.05, 0.02, 0.1])})
    by_pose = memberships(arm, values)[1]
    assert isinstance(by_pose, ByRods)
    joints = JointSpec.random_joints(chain, 60, rng)
    Ts = arm.tool(joints, values)[0]
    stands = np.isfinite(Ts).all(axis=(1, 2))
    joints, Ts = joints[stands], Ts[stands]
    assert stands.sum() > 20
    reached, found = by_pose.reached(PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3]))
    assert reached.all()
    np.testing.assert_allclose(found, joints, atol=1e-12)
    np.testing.assert_array_equal(by_pose.solutions(PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3]))[:, 0], found)
    far = Ts[:, :3, 3] + [0.0, 0.0, 0.4]
    assert not by_pose.reached(PoseTarget(far, Ts[:, :3, :3]))[0].any()
    flip = np.diag([1.0, 1.0, -1.0])  # base and platform are flat: legs of the same lengths hold it mirrored, too
    flange = Ts[:, :3, 3] - Ts[:, :3, :3] @ values[-3:]
    turned = flip @ Ts[:, :3, :3] @ flip
    mirrored = PoseTarget(flange @ flip + turned @ values[-3:], turned)
    assert not by_pose.reached(mirrored)[0].any()
    beside = replace(by_pose, T_home=np.block([[flip, np.zeros((3, 1))], [np.zeros((1, 3)), 1]]) @ by_pose.T_home
                     @ np.diag([1.0, 1.0, -1.0, 1.0]))  # fmt: skip
    np.testing.assert_allclose(beside.reached(mirrored)[1], joints, atol=1e-12)
