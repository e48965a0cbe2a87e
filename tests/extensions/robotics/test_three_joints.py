"""Arms of three joints of any kind: every solution, nothing lost at singularities, and the determinant."""

import itertools

import numpy as np
import pytest
from helpers.robots import chain_of

from lab.core.se3 import Array
from lab.extensions.robotics.inverse.first_joints import ThreeJoints, fitted_factor
from lab.kinematics.inverse.branches import NominalInverse, nearest_whole_turns
from lab.kinematics.inverse.closed_form import closed_form_of
from lab.kinematics.inverse.newton import PoseTarget
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.chain import Chain

POINT = np.array([0.25, 0.03, 0.02])
ANY = {  # all eight kinds, with axes at odd angles and nothing zero
    "".join(kinds): chain_of(
        "any", "craig", "".join(kinds), [0, 40 + 5 * i, 70 - 6 * i], [0.1, 0.2 + 0.02 * i, 0.3], [10, 20, 30],
        [0.3, 0.1 + 0.02 * i, 0.2],
    )
    for i, kinds in enumerate(itertools.product("RP", repeat=3))
}  # fmt: skip
CLASSICAL = {
    "anthropomorphic": chain_of("a", "craig", "RRR", [0, 90, 0], [0, 0, 0.5], [0] * 3, [0.3, 0, 0]),
    "orthogonal": chain_of("o", "craig", "RRR", [0, 90, 90], [0, 0.2, 0.5], [0] * 3, [0.3, 0.1, 0.2]),
    "axes 1 and 2 parallel": chain_of("p", "craig", "RRR", [0, 0, 90], [0, 0.4, 0.2], [0] * 3, [0.3, 0.1, 0]),
    "spherical": chain_of("s", "craig", "RRP", [0, -90, 90], [0] * 3, [0] * 3, [0.3, 0, 0]),
    "cylindrical": chain_of("c", "craig", "RPP", [0, 0, -90], [0] * 3, [0] * 3, [0.3, 0, 0.1]),
    "cylindrical, slide first": chain_of("l", "craig", "PRP", [0, 0, -90], [0] * 3, [0] * 3, [0.3, 0, 0.4]),
    "Cartesian": chain_of("t", "craig", "PPP", [0, -90, -90], [0] * 3, [0, 90, 0], [0.3, 0, 0.1]),
    "SCARA": chain_of("r", "craig", "RRP", [0, 0, 0], [0, 0.4, 0.3], [0] * 3, [0.3, 0, 0]),
    "SCARA, slide first": chain_of("f", "craig", "PRR", [0, 0, 0], [0, 0.4, 0.3], [0] * 3, [0.3, 0, 0]),
    "SCARA, slide second": chain_of("e", "craig", "RPR", [0, 0, 0], [0, 0.4, 0.3], [0] * 3, [0.3, 0, 0]),
}
ALL = {**ANY, **CLASSICAL}


def form_of(chain: Chain, point: Array = POINT) -> ThreeJoints:
    form = closed_form_of(chain, point)
    assert isinstance(form, ThreeJoints)
    return form


def drawn(chain: Chain, count: int, seed: int) -> Array:
    wide = np.where(chain.prismatic, 0.8, np.pi)
    return np.random.default_rng(seed).uniform(-wide, wide, (count, 3))


def points(chain: Chain, joints: Array) -> Array:
    arm = SerialArm(chain, ("p1",))
    return arm.points(joints.reshape(-1, 3), arm.nominal({"p1": POINT}))[:, 0].reshape(*joints.shape[:-1], 3)


def flanges(chain: Chain, joints: Array) -> Array:
    arm = SerialArm(chain, ("p1",))
    return arm.flange(joints, arm.nominal({"p1": POINT}))


def apart(chain: Chain, a: Array, b: Array) -> Array:
    off = a - b
    return np.abs(off - np.where(chain.prismatic, 0, 2 * np.pi) * np.round(off / (2 * np.pi))).max(axis=-1)


@pytest.mark.parametrize("name", ALL)
def test_every_solution_leads_back_and_the_true_one_is_among_them(name: str) -> None:
    count, chain, form = 100, ALL[name], form_of(ALL[name])
    joints = drawn(chain, count, 2)
    found = form.solve(flanges(chain, joints))
    reached = found.gap_m == 0
    assert found.joints.shape == (count, form.branches, 3) and reached.any(axis=1).all()
    missed = np.linalg.norm(points(chain, found.joints) - points(chain, joints)[:, None], axis=2)
    assert missed[reached].max() <= 1e-11
    nearest = np.where(reached, apart(chain, found.joints, joints[:, None]), np.inf)
    assert nearest.min(axis=1).max() < 1e-4 and np.quantile(nearest.min(axis=1), 0.99) < 1e-9  # near a double root
    true = np.take_along_axis(found.tilt_rad, nearest.argmin(axis=1)[:, None], axis=1)
    assert np.quantile(true, 0.99) < 1e-9  # with the true joints the rotation is met as well


@pytest.mark.parametrize("away", [0.0, 1e-6])
@pytest.mark.parametrize("name", ["anthropomorphic", "RRR", "PRR", "RRP"])
def test_at_a_singularity_nothing_is_lost(name: str, away: float) -> None:
    """Joints 2 and 3 are moved to where the determinant is zero, by bisection between positions of other signs."""
    chain, form = ALL[name], form_of(ALL[name])
    low, high = drawn(chain, 300, 5), drawn(chain, 300, 5)
    high[:, 1:] = drawn(chain, 300, 6)[:, 1:]
    value = form.determinant.at
    crossing = value(low) * value(high) < 0
    low, high = low[crossing], high[crossing]
    for _ in range(60):
        middle = (low + high) / 2
        same = (value(low) * value(middle) > 0)[:, None]
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    assert len(low) > 20
    joints = low + away
    found = form.solve(flanges(chain, joints))
    reached = found.gap_m == 0
    missed = np.linalg.norm(points(chain, found.joints) - points(chain, joints)[:, None], axis=2)
    assert np.isfinite(found.joints).all() and reached.any(axis=1).all() and missed[reached].max() < 1e-9


def test_a_hinge_is_free_where_the_point_is_on_its_axis() -> None:
    chain = CLASSICAL["cylindrical"]
    form = form_of(chain, np.zeros(3))
    T = np.eye(4)
    T[2, 3] = 0.5
    found = form.solve(T[None], np.array([[0.7, 0.0, 0.0]]))
    assert found.free[..., 0].all() and np.allclose(found.joints[..., 0], 0.7) and not found.gap_m.any()


@pytest.mark.parametrize("name", ["anthropomorphic", "orthogonal", "RRR"])
def test_out_of_reach_is_told_by_how_much(name: str) -> None:
    chain = ALL[name]
    T = np.eye(4)
    T[:3, 3] = 3.0, 1.0, 0.5
    found = form_of(chain).solve(T[None])
    there = points(chain, found.joints)[0]
    gap = np.linalg.norm(there - (T[:3, 3] + POINT), axis=1)
    best = gap.min()
    assert (found.gap_m > 0).all() and found.gap_m.min() == pytest.approx(best, abs=1e-9)
    tried = points(chain, drawn(chain, 20_000, 7))
    assert best <= np.linalg.norm(tried - (T[:3, 3] + POINT), axis=1).min()


@pytest.mark.parametrize("name", ALL)
def test_the_determinant_is_that_of_the_jacobian(name: str) -> None:
    chain = ALL[name]
    arm, joints = SerialArm(chain, ("p1",)), drawn(chain, 100, 8)
    J = arm.joint_jacobian(joints, arm.nominal({"p1": POINT}))[:, 0]
    np.testing.assert_allclose(form_of(chain).determinant.at(joints), np.linalg.det(J), atol=1e-12)


def test_a_sum_of_terms_is_read_off_its_values() -> None:
    def value(q: Array) -> Array:
        return 0.5 - 2 * np.sin(2 * q[:, 1]) * q[:, 2] ** 2 + 0.3 * np.cos(q[:, 1]) * q[:, 2]

    terms = fitted_factor(value, (False, False, True), (1, 2))
    joints = np.random.default_rng(0).normal(size=(50, 3))
    assert len(terms) == 3
    np.testing.assert_allclose(sum(term.at(joints) for term in terms), value(joints), atol=1e-12)
    said = {term.text(("q1", "q2", "q3")) for term in terms}
    assert said == {"0.5", "2 q3 q3 sin(2 * q2)", "0.3 q3 cos q2"}


def test_points_that_joint_3_does_not_move_have_none() -> None:
    planar = chain_of("planar", "craig", "RRR", [0, 0, 0], [0, 0.4, 0.3], [0] * 3, [0] * 3)
    assert not isinstance(closed_form_of(planar, POINT), ThreeJoints)  # it does not move in space
    assert closed_form_of(CLASSICAL["anthropomorphic"], np.zeros(3)) is None


def test_a_place_alone_is_solved_in_closed_form_whatever_the_rotation() -> None:
    chain = CLASSICAL["anthropomorphic"]
    arm = SerialArm(chain, ("p1",))
    inverse = NominalInverse(arm, arm.nominal({"p1": POINT}))
    joints = drawn(chain, 50, 9)
    anywhere = PoseTarget(points(chain, joints), np.full((50, 3, 3), np.nan))
    found = inverse.solutions(anywhere, np.full((50, 3), np.nan))
    assert inverse.exact(anywhere).all() and not found.tilt_rad.any() and (found.gap_m == 0).all()
    assert apart(chain, found.joints, joints[:, None]).min(axis=1).max() < 1e-6


@pytest.mark.thorough
@pytest.mark.parametrize("kinds", ["RRR", "PRR"])
def test_a_way_is_followed_in_its_own_branch_and_none_is_taken_beyond_its_fold(kinds: str) -> None:
    """Against many small steps of Newton's method, which keep to a branch: near folds the roots change their order."""
    chain = ANY[kinds]
    arm = SerialArm(chain, ("p1",))
    count, inverse = 300, NominalInverse(arm, arm.nominal({"p1": POINT}))
    joints = drawn(chain, count, 3)
    Ts = inverse.tool(joints)[0]
    moves = np.random.default_rng(4).normal(0.0, 1e-3, (count, 3))
    unturned = np.full((count, 3, 3), np.nan)
    ways = inverse.solutions(PoseTarget(Ts[:, :3, 3], unturned), joints)
    apart = nearest_whole_turns(chain, ways.joints, joints[:, None]) - joints[:, None]
    branch = np.where(ways.gap_m == 0, np.abs(apart).max(axis=2), np.inf).argmin(axis=1)
    found, reached = inverse.again(PoseTarget(Ts[:, :3, 3] + moves, unturned), joints, branch)
    stepped = joints.copy()
    for part in np.arange(1, 9) / 8:
        stepped = inverse.again(PoseTarget(Ts[:, :3, 3] + part * moves, unturned), stepped, np.full(count, -1))[0]
    smallest = np.linalg.svd(inverse.tool(joints)[1][:, :3], compute_uv=False)[:, -1]
    clear = smallest > 0.05  # m per rad: a move of 1 mm does not come to a fold
    assert clear.sum() > 0.6 * count and reached[clear].all()
    assert np.abs(found - stepped)[clear].max() < 1e-7
    kept = np.sign(np.linalg.det(inverse.tool(found)[1][:, :3])) == np.sign(
        np.linalg.det(inverse.tool(joints)[1][:, :3])
    )
    assert kept[reached].all() and (found == joints)[~reached].all()
