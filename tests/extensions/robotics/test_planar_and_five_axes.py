"""Planar arms and arms of five axes: every solution, nothing lost at singularities, and the determinant."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120, chain_of

from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.robotics.inverse.five_axes import FiveAxes
from lab.extensions.robotics.inverse.planar import PlanarArm
from lab.kinematics.inverse.branches import NominalInverse
from lab.kinematics.inverse.closed_form import Axes, ClosedForm, closed_form_of
from lab.kinematics.inverse.newton import PoseTarget, reach
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.chain import Chain

POINT = np.array([0.2, 0.05, 0.03])


def planar(kinds: str) -> Chain:
    """Hinges across a plane and slides in it, with axes that point both ways and lengths that are all different."""
    bends = {"RR": 0, "RP": 90, "PR": -90}
    alpha = [bends[a + b] for a, b in itertools.pairwise("R" + kinds)]
    if kinds.startswith("RR"):
        alpha[1] = 180
    theta = [10 + 7 * i if kind == "R" else 0 for i, kind in enumerate(kinds)]
    a = [0.0, 0.35, 0.4][: len(kinds)]
    return chain_of(kinds, "craig", kinds, alpha, a, theta, [0.1 * i for i in range(len(kinds))])


PLANAR = {
    **{kinds: planar(kinds) for kinds in ("RR", "RP", "PR", "RRR", "RRP", "RPR", "PRR", "PRP")},
    "PP": chain_of("PP", "craig", "PP", [90, 70], [0, 0.2], [20, 0], [0, 0]),
    "PPR": chain_of("PPR", "craig", "PPR", [90, 70, 90], [0, 0, 0.2], [0, 90, 0], [0, 0, 0]),
}
FIVE = {
    "scorbot": chain_of(
        "scorbot", "distal", "RRRRR", [90, 0, 0, 90, 0], [0.016, 0.22, 0.22, 0, 0], [0, 0, 0, 90, 0],
        [0.349, 0, 0, 0, 0.145],
    ),
    "three parallel, slanted": chain_of(  # axis 5 not square to them, axes against each other, nothing zero
        "slanted", "craig", "RRRRR", [0, 70, 180, 0, 60], [0.1, 0.05, 0.4, 0.3, 0.02], [10, 20, 30, 40, 50],
        [0.3, 0.05, 0.02, 0.01, 0.1],
    ),
    "three parallel, with a slide": chain_of(
        "slide", "craig", "RRPRR", [0, 90, 90, -90, 90], [0, 0.05, 0.1, 0.1, 0.05], [0] * 5,
        [0.3, 0.05, 0.02, 0.01, 0.1],
    ),
    "on a track": chain_of(
        "track", "craig", "PRRRR", [30, 40, 0, 0, 90], [0, 0.05, 0.4, 0.3, 0.05], [0] * 5, [0.3, 0.05, 0.02, 0.01, 0.1]
    ),
    "two parallel": chain_of(  # a 6R arm without its last axis
        "two", "craig", "RRRRR", [0, -90, 0, -90, 90], [0, 0.05, 0.625, 0.1, 0], [0, -90, 90, 0, 0],
        [0, 0, 0.03, 0.625, 0],
    ),
    "two parallel, equal links": chain_of(
        "equal", "craig", "RRRRR", [0, -90, 0, -90, 90], [0, 0, 0.625, 0, 0], [0, -90, 90, 0, 0], [0, 0, 0, 0.625, 0]
    ),
    "SCARA that tilts": chain_of(
        "tilting", "craig", "RRPRR", [0, 0, 0, 30, 70], [0, 0.4, 0.25, 0, 0], [0] * 5, [0.1, 0, 0, 0, 0]
    ),
    "gantry": chain_of("gantry", "craig", "PPPRR", [0, -90, -90, 10, 70], [0] * 5, [0, 90, 0, 0, 0], [0.1, 0, 0, 0, 0]),
    "three parallel at the end": chain_of(  # no two axes meet
        "end", "craig", "RRRRR", [10, 50, 70, 0, 180], [0, 0.15, 0.1, 0.4, 0.3], [10, 20, 30, 40, 50],
        [0.3, 0.1, 0.05, 0.02, 0.1],
    ),
    "three parallel at the base": chain_of(
        "base", "craig", "RRRRR", [0, 0, 0, 60, 70], [0, 0.4, 0.3, 0.1, 0.15], [10, 20, 30, 40, 50],
        [0.3, 0.05, 0.02, 0.1, 0.1],
    ),
    "two and three parallel": chain_of(
        "pairs", "craig", "RRRRR", [0, 0, 70, 0, 0], [0, 0.2, 0.1, 0.4, 0.3], [10] * 5, [0.3, 0.05, 0.02, 0.01, 0.1]
    ),
    "planar arm on a hinge and a slide": chain_of(
        "RP", "craig", "RPRRR", [0, 40, 50, 0, 0], [0, 0.2, 0.1, 0.4, 0.3], [10, 0, 20, 30, 40],
        [0.1, 0.05, 0.02, 0.01, 0.1],
    ),
    "axes 1 and 2 meet": chain_of(
        "shoulder", "craig", "RRRRR", [0, -90, 0, -70, 80], [0, 0, 0.4, 0.1, 0.2], [10] * 5, [0.1, 0, 0.1, 0.1, 0.1]
    ),
    "axes 4 and 5 meet": chain_of(
        "any", "craig", "RRRRR", [0, 40, 50, 60, 70], [0, 0.2, 0.4, 0.1, 0], [10] * 5, [0.1, 0.2, 0.1, 0.1, 0]
    ),
    **{
        f"axes {k} and {k + 1} parallel": chain_of(  # no two axes meet
            "pair", "craig", "RRRRR", [0, *(turn if i == k else 30 + 20 * i for i in (1, 2, 3, 4))],
            [0, 0.2, 0.4, 0.15, 0.3], [10, 20, 30, 40, 50], [0.3, 0.05, 0.1, 0.02, 0.1],
        )
        for k, turn in ((1, 0), (2, 180), (3, 0), (4, 180))
    },
    "axis 5 folds onto axis 3": chain_of(  # a pair that is square to its neighbours
        "folding", "craig", "RRRRR", [0, 90, 0, 90, 90], [0, 0.1, 0.4, 0.15, 0.15], [0] * 5, [0.3, 0.05, 0.1, 0, 0.1]
    ),
}  # fmt: skip
ALL = {**PLANAR, **FIVE}
COUNTS = [100, pytest.param(100_000, marks=pytest.mark.slow)]


def form_of(chain: Chain) -> ClosedForm:
    form = closed_form_of(chain, POINT)
    assert isinstance(form, (PlanarArm, FiveAxes))
    return form


def drawn(chain: Chain, count: int, seed: int) -> Array:
    wide = np.where(chain.prismatic, 0.8, np.pi)
    return np.random.default_rng(seed).uniform(-wide, wide, (count, chain.size))


def flanges(chain: Chain, joints: Array) -> Array:
    arm = SerialArm(chain)
    return arm.flange(joints.reshape(-1, chain.size), arm.nominal()).reshape(*joints.shape[:-1], 4, 4)


def apart(chain: Chain, a: Array, b: Array) -> Array:
    off = a - b
    return np.abs(off - np.where(chain.prismatic, 0, 2 * np.pi) * np.round(off / (2 * np.pi))).max(axis=-1)


def mixed(chain: Chain, rng: np.random.Generator) -> Chain:
    """The same arm with other zeros and with joint positions that count the other way."""
    table = chain.table.copy()
    table[:, 0] += np.where(chain.prismatic, 0.0, rng.normal(size=chain.size))
    table[:, 1] += np.where(chain.prismatic, rng.normal(size=chain.size), 0.0)
    return replace(chain.with_table(table), sign=rng.choice([-1.0, 1.0], chain.size))


def missed(chain: Chain, form: ClosedForm, joints: Array, Ts: Array) -> Array:
    """By how much solutions ``(n, k, joints)`` miss poses (m, and elements of the rotation)."""
    off = flanges(chain, joints) - Ts[:, None]
    if not form.by_point:
        return np.abs(off).max(axis=(2, 3))
    return np.abs(off[..., :3, :3] @ POINT + off[..., :3, 3]).max(axis=2)


def met(form: ClosedForm, found) -> Array:
    return (found.gap_m == 0) & (True if form.by_point else found.tilt_rad == 0)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", ALL)
def test_every_solution_leads_back_and_the_true_one_is_among_them(name: str, count: int) -> None:
    rng = np.random.default_rng(1)
    for chain in (ALL[name], mixed(ALL[name], rng)):
        form, joints = form_of(chain), drawn(chain, count, 2)
        Ts = flanges(chain, joints)
        found = form.solve(Ts)
        reached = met(form, found)
        assert found.joints.shape == (count, form.branches, chain.size) and reached.any(axis=1).all()
        assert missed(chain, form, found.joints, Ts)[reached].max() <= 1e-11
        nearest = np.where(reached, apart(chain, found.joints, joints[:, None]), np.inf).min(axis=1)
        assert nearest.max() < 1e-4 and np.quantile(nearest, 0.99) < 1e-9  # near a double root


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name",
    [
        "RPR",
        "scorbot",
        "three parallel, slanted",
        "axes 1 and 2 meet",
        *(f"axes {k} and {k + 1} parallel" for k in (1, 2, 3, 4)),
    ],
)
def test_newton_from_anywhere_finds_no_other_solution(name: str) -> None:
    chain, starts = ALL[name], 20
    arm = SerialArm(chain, ("p1",))
    by_point = form_of(chain).by_point
    values = arm.nominal({"p1": POINT if by_point else np.zeros(3)})
    Ts = np.repeat(flanges(chain, drawn(chain, 4, 3)), starts, axis=0)
    places = Ts[:, :3, :3] @ values[-3:] + Ts[:, :3, 3]
    wanted = PoseTarget(places, np.full((len(Ts), 3, 3), np.nan) if by_point else Ts[:, :3, :3])
    ended = reach(arm, values, wanted, drawn(chain, len(Ts), 4), np.empty((len(Ts), 0)))
    there = (np.abs(ended.errors) < 1e-9).all(axis=1)
    found = form_of(chain).solve(Ts)
    off = np.where(met(form_of(chain), found), apart(chain, found.joints, ended.joints[:, None]), np.inf)
    assert there.mean() > 0.05 and off.min(axis=1)[there].max() < 1e-4


SINGULAR = [
    (name, factor.name)
    for name in ALL
    for factor in form_of(ALL[name]).determinant.factors
    if factor.terms
]  # fmt: skip


def at_zero(chain: Chain, name: str, count: int) -> Array:
    """Joint positions where a factor is zero, by bisection between positions of other signs."""
    (factor,) = (each for each in form_of(chain).determinant.factors if each.name == name)
    low, high = drawn(chain, count, 5), drawn(chain, count, 6)
    crossing = factor.at(low) * factor.at(high) < 0
    low, high = low[crossing], high[crossing]
    for _ in range(60):
        middle = (low + high) / 2
        same = (factor.at(low) * factor.at(middle) > 0)[:, None]
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    assert len(low) > 0.1 * count and np.abs(factor.at(low)).max() < 1e-12
    return low


@pytest.mark.sampled(3)
@pytest.mark.parametrize("count", [40, pytest.param(10_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("name", "kind"), SINGULAR)
def test_at_a_singularity_nothing_is_lost(name: str, kind: str, count: int) -> None:
    chain, form, rng = ALL[name], form_of(ALL[name]), np.random.default_rng(7)
    there = at_zero(chain, kind, count)
    for away in (0.0, 1e-9, 1e-6):
        joints = there + away * rng.uniform(-1, 1, there.shape)
        Ts = flanges(chain, joints)
        found = form.solve(Ts, drawn(chain, len(joints), 8))
        reached = met(form, found)
        assert np.isfinite(found.joints).all() and reached.any(axis=1).all(), away
        assert missed(chain, form, found.joints, Ts)[reached].max() < 1e-9


@pytest.mark.parametrize("name", ["two parallel, equal links", "scorbot", "SCARA that tilts"])
def test_a_wrist_on_the_axis_of_a_hinge_is_turned_by_the_rotation(name: str) -> None:
    """The place does not say joint 1 where the wrist is on its axis, nor joint 2 where equal links are folded."""
    chain, form = ALL[name], form_of(ALL[name])
    joints = drawn(chain, 60, 9)
    if name == "two parallel, equal links":
        joints[:30, 2] = 0.0  # folded: onto axis 2, and here onto axis 1 as well
        joints[30:] = at_zero(chain, "shoulder", 300)[:30]  # above axis 1
    elif name == "scorbot":
        q2 = joints[:, 1]
        joints[:, 2] = np.arccos(np.clip(-(0.016 + 0.22 * np.cos(q2)) / 0.22, -1, 1)) - q2
    else:
        joints[:, 1] = np.pi
        joints[:, 2] = 0.0
    Ts = flanges(chain, joints)
    for off in (0.0, 1e-13, 1e-10, 1e-8, 1e-6):
        Ts = flanges(chain, joints + off * np.random.default_rng(0).uniform(-1, 1, joints.shape))
        found = form.solve(Ts, drawn(chain, 60, 10))
        reached = met(form, found)
        assert reached.any(axis=1).all(), off
        assert missed(chain, form, found.joints, Ts)[reached].max() < 1e-9


def test_of_two_candidates_that_are_the_same_the_better_one_counts() -> None:
    """With the wrist near the axis of joint 2 one candidate is off by rounding, and its like is not."""
    chain = FIVE["two parallel, equal links"]
    joints = np.append(drawn(chain, 100_000, 21)[[31025, 32224, 37580, 84548]], [[1, 0.7, 0, 0.3, 0.5]], axis=0)
    form, Ts = form_of(chain), flanges(chain, joints)  # the last row brings more candidates
    found = form.solve(Ts)
    nearest = np.where(met(form, found), apart(chain, found.joints, joints[:, None]), np.inf)
    assert nearest[:4].min(axis=1).max() < 1e-9


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ALL)
def test_the_determinant_is_that_of_the_jacobian(name: str) -> None:
    """Of a planar arm the rows of its plane; of five axes the place of the shape's centre, and one turn or none."""
    rng = np.random.default_rng(11)
    for chain in (ALL[name], mixed(ALL[name], rng)):
        form, joints = form_of(chain), drawn(chain, 8, 12)
        arm = SerialArm(chain, ("p1",))
        found = form.determinant.at(joints)
        if isinstance(form, PlanarArm):
            J = arm.tool(joints, arm.nominal({"p1": POINT}))[1]
            rows = np.concatenate([form.plane[:2] @ J[:, :3], form.plane[2:] @ J[:, 3:]], axis=1)[:, : chain.size]
        else:
            assert isinstance(form, FiveAxes)
            axes = form.shape.axes
            held = joints[:, ::-1] if form.backwards else joints
            rows = np.array([form.shape.rows(axes.jacobian(row, form.shape.centre)) for row in held])
        np.testing.assert_allclose(found, np.linalg.det(rows), atol=1e-12)
        assert np.abs(found).max() > 1e-4


@pytest.mark.parametrize("name", ["two parallel", "axes 1 and 2 meet", "on a track"])
def test_the_axes_Jacobian_is_the_arm_s_and_backwards_undoes_it(name: str) -> None:
    chain, arm = ALL[name], SerialArm(ALL[name], ("p1",))
    axes, joints = Axes.of(chain), drawn(chain, 3, 13)
    for row, J in zip(joints, arm.tool(joints, arm.nominal({"p1": POINT}))[1], strict=True):
        np.testing.assert_allclose(axes.jacobian(row, POINT), J, atol=1e-13)
    twice = axes.backwards.backwards
    np.testing.assert_allclose(twice.directions, axes.directions, atol=1e-14)
    np.testing.assert_allclose(twice.T_frame0_last, axes.T_frame0_last, atol=1e-14)


def test_the_planar_arms_have_the_determinants_of_the_literature() -> None:
    """2R and 3R: L1 L2 sin q2 (e.g. Siciliano et al. 2009, section 3.2); RP: the slide's length."""
    two = chain_of("2R", "craig", "RR", [0, 0], [0, 0.4], [0, 0], [0, 0])
    form = closed_form_of(two, np.array([0.3, 0, 0]))
    assert form is not None and form.determinant.text == "0.4 * 0.3 sin q2" and form.branches == 2
    three = chain_of("3R", "craig", "RRR", [0, 0, 0], [0, 0.4, 0.3], [0] * 3, [0] * 3)
    form = closed_form_of(three)
    assert form is not None and form.determinant.text == "0.4 * 0.3 sin q2"
    scorbot = form_of(FIVE["scorbot"]).determinant
    assert scorbot.text == "-0.22 * 0.22 sin q3 (0.016 + 0.22 cos q2 + 0.22 cos(q2+q3))"
    assert [factor.name for factor in scorbot.factors] == ["elbow", "shoulder"]


def test_what_a_planar_arm_cannot_do_is_told() -> None:
    chain, form = PLANAR["RRR"], form_of(PLANAR["RRR"])
    assert isinstance(form, PlanarArm)
    joints = drawn(chain, 50, 14)
    Ts = flanges(chain, joints)
    off = Ts.copy()
    off[:, :3, 3] += 0.05 * form.plane[2]
    np.testing.assert_allclose(form.solve(off).gap_m, 0.05, rtol=1e-9)
    tilted = Ts.copy()
    tilted[:, :3, :3] = se3.exp(0.2 * form.plane[0]) @ Ts[:, :3, :3]
    found = form.solve(tilted)
    np.testing.assert_allclose(found.tilt_rad, 0.2, rtol=1e-9)
    np.testing.assert_allclose(form.nearest_rotations(tilted[:, :3, :3]), Ts[:, :3, :3], atol=1e-12)
    far = Ts.copy()
    far[:, :3, 3] += 3.0 * form.plane[0]
    assert form.solve(far).gap_m.min() > 1.0


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ["scorbot", "two parallel", "axes 1 and 2 meet", "axes 2 and 3 parallel"])
def test_a_pose_that_five_axes_cannot_take_is_come_near_to(name: str) -> None:
    """The place is met, and no small move that leaves it there brings the rotation nearer."""
    chain = FIVE[name]
    arm = SerialArm(chain, ("p1",))
    values = arm.nominal({"p1": POINT})
    inverse, rng = NominalInverse(arm, values), np.random.default_rng(15)
    joints = drawn(chain, 10, 16)
    Ts = arm.tool(joints, values)[0]
    turned = se3.exp(0.05 * rng.normal(size=(10, 3))) @ Ts[:, :3, :3]
    wanted = PoseTarget(Ts[:, :3, 3], turned)
    found = inverse.solutions(wanted, np.full((10, 5), np.nan))
    counts = np.isfinite(found.gap_m) & (found.gap_m == 0)
    assert counts.any(axis=1).mean() > 0.9
    for i, k in zip(*np.nonzero(counts), strict=True):
        T, J = arm.tool(found.joints[i, k][None], values)
        assert np.linalg.norm(T[0, :3, 3] - Ts[i, :3, 3]) < 1e-9
        error = se3.log(turned[i] @ T[0, :3, :3].T)
        assert np.linalg.norm(error) == pytest.approx(found.tilt_rad[i, k], abs=1e-12)  # rad, of a dozen products
        still = np.linalg.svd(J[0, :3])[2][3:]  # moves that leave the place
        assert np.abs(J[0, 3:] @ still.T @ np.linalg.pinv(J[0, 3:] @ still.T) @ error).max() < 1e-8
    exact = inverse.solutions(PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3]), np.full((10, 5), np.nan))
    good = exact.gap_m == 0
    assert good.any(axis=1).all() and not exact.tilt_rad[good].any()


@pytest.mark.parametrize("away", [0.0, 1e-12, 1e-10, 1e-8])
def test_axes_that_fold_onto_each_other_leave_a_joint_free(away: float) -> None:
    """Joint 4 at half a turn puts axis 5 onto axis 3: joints 3 and 5 do the same, and nothing says joint 5."""
    chain = FIVE["axis 5 folds onto axis 3"]
    form, joints, liked = form_of(chain), drawn(chain, 40, 9), drawn(chain, 40, 10)
    joints[:, 3] = np.pi
    joints += away * np.random.default_rng(0).uniform(-1, 1, joints.shape)
    Ts = flanges(chain, joints)
    found = form.solve(Ts, liked)
    reached = met(form, found)
    assert reached.any(axis=1).all()
    assert missed(chain, form, found.joints, Ts)[reached].max() < 1e-9
    if away:
        return
    free = found.free & reached[..., None]
    assert (free.any(axis=1) == [False, False, False, False, True]).all()
    wished = np.where(reached, np.abs(np.angle(np.exp(1j * (found.joints[..., 4] - liked[:, None, 4])))), np.inf)
    assert wished.min(axis=1).max() < 1e-12


def test_quarter_turns_of_a_square_arm_lose_nothing() -> None:
    """There det N is zero for any s, which is not free: the length of N's null vector says it."""
    chain = chain_of(
        "square", "craig", "RRRRR", [90, 180, 90, 90, 90], [0, 0.3, 0.3, 0, 0.3], [0] * 5, [0, 0, 0, 0, 0.1]
    )  # fmt: skip
    joints = np.pi / 2 * np.random.default_rng(18).integers(0, 4, (60, 5))
    form, Ts = form_of(chain), flanges(chain, joints)
    found = form.solve(Ts, drawn(chain, 60, 19))
    reached = met(form, found)
    assert reached.any(axis=1).all()
    assert missed(chain, form, found.joints, Ts)[reached].max() < 1e-9


@pytest.mark.parametrize("name", [f"axes {k} and {k + 1} parallel" for k in (1, 2, 3, 4)])
def test_a_pair_of_parallel_axes_has_one_solution_at_most_poses(name: str) -> None:
    """Six equations ask for five joints: of the four roots one is left, and no solution is told twice."""
    chain = FIVE[name]
    form = form_of(chain)
    found = form.solve(flanges(chain, drawn(chain, 1000, 17)))
    assert form.branches == 4 and (met(form, found).sum(axis=1) == 1).mean() > 0.99


def test_the_shapes_that_came_first_keep_their_arms() -> None:
    shapes = {name: type(form.shape).__name__ for name in FIVE if isinstance(form := form_of(FIVE[name]), FiveAxes)}
    assert {name for name, shape in shapes.items() if shape == "_ParallelPair"} == {
        *(f"axes {k} and {k + 1} parallel" for k in (1, 2, 3, 4)), "axis 5 folds onto axis 3",
    }  # fmt: skip
    assert shapes["two parallel"] == shapes["SCARA that tilts"] == "_TwoAxisWrist"
    assert shapes["scorbot"] == "PlanarMiddle" and shapes["two and three parallel"] == "PlanarEnd"


def test_four_axes_that_may_be_parallel_are_left_to_the_search() -> None:
    right = chain_of("right", "craig", "RRRRR", [0, 90, 90, 0, 0], [0, 0.15, 0.1, 0.4, 0.3], [0] * 5, [0.1] * 5)
    assert closed_form_of(right) is None


def test_other_shapes_have_none() -> None:
    five = FIVE["scorbot"]
    table = five.table.copy()
    table[1:3, 3] += 1e-4  # axes 2, 3 and 4 not parallel
    table[3, 2] += 1e-4  # axes 4 and 5 do not meet
    assert closed_form_of(five.with_table(table)) is None
    across = PLANAR["RRR"].table.copy()
    across[1, 3] += 0.3
    assert not isinstance(closed_form_of(PLANAR["RRR"].with_table(across), POINT), PlanarArm)
    assert closed_form_of(PLANAR["RR"], np.zeros(3)) is None  # a point on the last axis
    assert not isinstance(closed_form_of(IRB120.chain), FiveAxes)
