"""From poses to joints: Khalil's equations, the closed form, singularities, Newton's method."""

import numpy as np
import pytest
from arms import (
    IRB120,
    RX130,
    SCARA,
    SCEMI,
    TX40,
    VERSATRAN,
    assert_derivatives,
    chain_of,
    perturbed,
    somewhere,
    table_robot,
)

from lab import frames
from lab.frames import Array
from lab.geometry.affected import AffectedArm
from lab.geometry.chain import Chain
from lab.geometry.closed_form import SphericalWrist
from lab.geometry.effects import effect
from lab.geometry.equations import type_2, type_3, type_8
from lab.geometry.inverse import Wanted, reach
from lab.geometry.serial import SerialArm
from lab.geometry.singular import manipulability, singular_distance
from lab.geometry.ways import Drawing, nearest_turns

DECOUPLED = {chain.name: chain for chain in (IRB120.chain, RX130, TX40, SCEMI)}
ANTIPARALLEL = chain_of(  # axis 3 against axis 2
    "antiparallel", "craig", "RRRRRR", [0, -90, 180, -90, 90, -90], [0.1, 0.05, 0.5, 0.02, 0, 0], [0, 10, 20, 0, 0, 0],
    [0.3, 0.1, 0.05, 0.4, 0, 0.1],
)  # fmt: skip
TINY = 1e-13


def closed_form(chain: Chain) -> SphericalWrist:
    found = SphericalWrist.of(chain)
    assert found is not None
    return found


def flanges(chain: Chain, joints: Array) -> Array:
    """Poses of the last frame in frame 0, ``(..., 4, 4)``."""
    arm = SerialArm(chain)
    return arm.flange(joints.reshape(-1, chain.size), arm.nominal()).reshape(*joints.shape[:-1], 4, 4)


def difference(a: Array, b: Array) -> Array:
    """Of angles, without whole turns."""
    return (a - b + np.pi) % (2 * np.pi) - np.pi


# Khalil's equations


def test_type_2_has_both_roots_and_says_what_is_missing() -> None:
    rng = np.random.default_rng(0)
    x, y, root = rng.normal(size=(3, 20_000))
    roots, gap, free = type_2(x, y, x * np.sin(root) + y * np.cos(root), TINY)
    assert not gap.any() and not free.any()
    for t in roots:
        np.testing.assert_allclose(x * np.sin(t) + y * np.cos(t), x * np.sin(root) + y * np.cos(root), atol=7e-15)
    nearest = np.abs(difference(roots, root)).min(axis=0)
    assert nearest.max() < 1e-6 and np.median(nearest) < 1e-15  # a double root is known to sqrt(eps)
    size = np.hypot(x, y)
    roots, gap, _ = type_2(x, y, 1.5 * size, TINY)
    np.testing.assert_allclose(gap, 0.5 * size, rtol=1e-12)
    np.testing.assert_allclose(x * np.sin(roots) + y * np.cos(roots), np.stack([size, size]), rtol=1e-12)


def test_type_2_keeps_a_root_that_rounding_would_lose() -> None:
    x, y = np.array([3e-7]), np.array([4e-7])
    roots, gap, free = type_2(x, y, np.array([5e-7 * (1 + 1e-13)]), TINY)
    assert gap[0] == 0 and not free[0] and np.isfinite(roots).all()
    assert type_2(x, y, np.array([5e-7 * (1 + 1e-9)]), TINY)[1][0] > 0


def test_a_free_angle_takes_its_reference() -> None:
    zero = np.zeros(2)
    roots, gap, free = type_2(zero, zero, zero, TINY, np.array([0.3, -2.0]))
    assert free.all() and not gap.any()
    np.testing.assert_array_equal(roots, [[0.3, -2.0], [0.3, -2.0]])
    assert type_2(zero, zero, np.ones(2), TINY)[1] == pytest.approx([1.0, 1.0])  # 0 = 1 has no root
    i, j, gap, free = type_8(0.5, 0.5, zero, zero, TINY, np.array([0.3, -2.0]))
    assert free.all() and not gap.any()
    np.testing.assert_array_equal(i[0], [0.3, -2.0])
    np.testing.assert_allclose(np.abs(j), np.pi)


def test_type_3() -> None:
    angles = np.linspace(-3, 3, 7)
    np.testing.assert_allclose(type_3(2 * np.sin(angles), 2 * np.cos(angles)), angles, atol=1e-15)


def test_type_8_has_both_roots_and_says_what_is_missing() -> None:
    rng = np.random.default_rng(1)
    for x, y in ((0.27, 0.31), (0.5, 0.5), (0.7, 0.2)):
        first, second = rng.uniform(-np.pi, np.pi, (2, 20_000))
        z1 = x * np.cos(first) + y * np.cos(first + second)
        z2 = x * np.sin(first) + y * np.sin(first + second)
        i, j, gap, _ = type_8(x, y, z1, z2, TINY)
        assert not gap.any()
        np.testing.assert_allclose(x * np.cos(i) + y * np.cos(i + j), np.stack([z1, z1]), atol=7e-15)
        np.testing.assert_allclose(x * np.sin(i) + y * np.sin(i + j), np.stack([z2, z2]), atol=7e-15)
        missed = np.maximum(np.abs(difference(i, first)), np.abs(difference(j, second))).min(axis=0)
        assert np.median(missed) < 1e-14 and missed.max() < 1e-6
    i, j, gap, _ = type_8(0.7, 0.2, np.array([1.0, 0.4]), np.zeros(2), TINY)
    np.testing.assert_allclose(gap, [0.1, 0.1])  # too far out, too far in
    np.testing.assert_allclose(np.abs(j), [[0, np.pi], [0, np.pi]], atol=1e-12)


# The closed form

EIGHT = [  # facts of the IRB 120: thesis III.2.2
    [100, 27.12, -64.90, -38.99, 30.72, 120.98],
    [100, 27.12, -64.90, 141.01, -30.72, -59.02],
    [100, 40.00, -89.00, -30.00, 40.00, 110.00],
    [100, 40.00, -89.00, 150.00, -40.00, -70.00],
    [-80, -40.00, -64.90, 158.99, 63.70, 95.80],
    [-80, -40.00, -64.90, -21.01, -63.70, -84.20],
    [-80, -27.12, -89.00, 156.37, 53.32, 100.78],
    [-80, -27.12, -89.00, -23.63, -53.32, -79.22],
]


def test_the_eight_solutions_of_the_thesis() -> None:
    x, y, z = (frames.exp(np.deg2rad(angle) * np.eye(3)[i]) for i, angle in enumerate((77.71, -0.38, 170.88)))
    T = frames.pose(z @ y @ x, np.array([-44.11, 383.46, 786.00]) / 1e3)
    found = np.rad2deg(closed_form(IRB120.chain).solve(T[None]).joints[0])
    for expected in EIGHT:
        apart = np.abs((found - expected + 180) % 360 - 180).max(axis=1)
        assert apart.min() < 0.0101, expected  # the thesis' own figures agree to 0.009


@pytest.mark.parametrize("name", DECOUPLED)
def test_every_solution_leads_back_and_the_true_one_is_among_them(name: str) -> None:
    """TX 40's wrist cannot come within 35 mm of axis 1, which random joints never ask for."""
    chain, count = DECOUPLED[name], 100_000 if name == "irb120" else 20_000
    joints = chain.random_joints(count, np.random.default_rng(2))
    Ts = flanges(chain, joints)
    found = closed_form(chain).solve(Ts)
    assert found.joints.shape == (count, 8, 6) and not found.gap_m.any() and not found.free.any()
    assert np.abs(flanges(chain, found.joints) - Ts[:, None]).max() < 1e-11
    missed = np.abs(difference(found.joints, joints[:, None])).max(axis=2)
    assert missed.min(axis=1).max() < 1e-9
    apart = np.abs(difference(found.joints[:, :, None], found.joints[:, None])).max(axis=3)
    assert np.median(np.where(np.eye(8, dtype=bool), np.inf, apart).min(axis=(1, 2))) > 0.05  # all eight are different


def test_signs_zeros_and_conventions_do_not_matter() -> None:
    """The IRB 120 with its readings reversed, and with other zeros, has the same solutions in its own readings."""
    chain = IRB120.chain
    sign = np.array([-1.0, 1, -1, -1, 1, -1])
    turned = Chain(
        "turned", chain.convention, chain.joint_names, chain.prismatic, chain.table, sign, chain.lower, chain.upper,
        chain.speed, chain.parallel,
    )  # fmt: skip
    table = chain.table.copy()
    table[:, 0] += [0.1, -0.2, 0.3, 0.4, -0.5, 0.6]
    joints = 0.5 * chain.random_joints(1000, np.random.default_rng(3))
    for other in (turned, chain.with_table(table)):
        found = closed_form(other).solve(flanges(other, joints))
        assert np.abs(difference(found.joints, joints[:, None])).max(axis=2).min(axis=1).max() < 1e-9


def test_axes_may_be_offset_and_antiparallel() -> None:
    joints = 0.3 * ANTIPARALLEL.random_joints(2000, np.random.default_rng(12))
    Ts = flanges(ANTIPARALLEL, joints)
    found = closed_form(ANTIPARALLEL).solve(Ts)
    assert np.abs(difference(found.joints, joints[:, None])).max(axis=2).min(axis=1).max() < 1e-9
    reached = found.gap_m == 0
    assert reached.mean() > 0.7
    assert np.abs(flanges(ANTIPARALLEL, found.joints) - Ts[:, None])[reached].max() < 1e-11


@pytest.mark.parametrize("chain", [SCARA, VERSATRAN], ids=lambda chain: chain.name)
def test_other_arms_have_no_such_closed_form(chain: Chain) -> None:
    assert SphericalWrist.of(chain) is None
    off = IRB120.chain.table.copy()
    off[4, 2] = 1e-4  # axes 5 and 6 no longer meet
    assert SphericalWrist.of(IRB120.chain.with_table(off)) is None
    off = IRB120.chain.table.copy()
    off[1, 3] = 1e-4  # axes 2 and 3 no longer parallel
    assert SphericalWrist.of(IRB120.chain.with_table(off)) is None


def singular_poses(chain: Chain, kind: str, count: int, rng: np.random.Generator, away: float) -> Array:
    """Joints within ``away`` of a singularity of the IRB 120, by its det J."""
    joints = chain.random_joints(count, rng)
    if kind == "wrist":
        joints[:, 4] = 0.0
    elif kind == "elbow":
        joints[:, 2] = -np.arctan2(0.302, 0.07)
    else:  # 0.27 sin q2 + 0.07 sin q23 + 0.302 cos q23 = 0, solved for q2
        q3 = joints[:, 2]
        joints[:, 1] = -np.arctan2(
            0.07 * np.sin(q3) + 0.302 * np.cos(q3), 0.27 + 0.07 * np.cos(q3) - 0.302 * np.sin(q3)
        )
    return joints + rng.uniform(-away, away, joints.shape)


@pytest.mark.parametrize("away", [0.0, 1e-6], ids=["at", "near"])
@pytest.mark.parametrize("kind", ["wrist", "elbow", "shoulder"])
def test_at_a_singularity_nothing_is_lost(kind: str, away: float) -> None:
    chain, rng = IRB120.chain, np.random.default_rng(4)
    joints = singular_poses(chain, kind, 10_000, rng, away)
    Ts = flanges(chain, joints)
    reference = chain.random_joints(10_000, rng)
    found = closed_form(chain).solve(Ts, reference)
    assert np.isfinite(found.joints).all()
    assert found.gap_m.max() <= 1e-12
    assert np.abs(flanges(chain, found.joints) - Ts[:, None]).max() < 1e-11
    distance, joint = singular_distance(SerialArm(chain).tool(joints, SerialArm(chain).nominal())[1])
    assert distance.max() < 1e-5
    if kind == "wrist":
        assert (joint == 4).mean() > 0.99
    if away == 0 and kind != "elbow":  # an elbow leaves no joint free
        moving = 3 if kind == "wrist" else 0
        free = found.free[..., moving].any(axis=1)
        assert free.mean() > 0.2  # the rest is off by rounding
        picked = difference(found.joints[..., moving], reference[:, None, moving])[found.free[..., moving]]
        assert np.abs(picked).max() < 1e-12


def test_out_of_reach_is_told_by_how_much_and_the_readings_come_near() -> None:
    chain = IRB120.chain
    joints = chain.random_joints(500, np.random.default_rng(5))
    joints[:, 2] = -np.arctan2(0.302, 0.07)  # straight
    Ts = flanges(chain, joints)
    wrist = Ts[:, :3, 3] - 0.072 * Ts[:, :3, 2]
    shoulder = np.array([0.0, 0.0, 0.29])
    outward = (wrist - shoulder) / np.linalg.norm(wrist - shoulder, axis=1)[:, None]
    Ts[:, :3, 3] += 0.01 * outward
    found = closed_form(chain).solve(Ts)
    np.testing.assert_allclose(found.gap_m, 0.01, rtol=1e-9)
    back = flanges(chain, found.joints)
    np.testing.assert_allclose(back[..., :3, :3], np.broadcast_to(Ts[:, None, :3, :3], (500, 8, 3, 3)), atol=1e-12)
    assert np.linalg.norm(back[..., :3, 3] - Ts[:, None, :3, 3], axis=2).max() < 0.0105


# Jacobian and singularities


@pytest.mark.parametrize("chain", [IRB120.chain, RX130, SCARA, VERSATRAN], ids=lambda chain: chain.name)
def test_the_jacobian_is_the_derivative_of_the_pose(chain: Chain) -> None:
    rng = np.random.default_rng(6)
    arm = SerialArm(chain, ("p1", "p2"))
    values = perturbed(arm, somewhere(arm, rng), rng, 1e-3, 3e-3)
    for joints in chain.random_joints(5, rng):
        Ts, jacobian = arm.tool(joints[None], values, 1)
        np.testing.assert_allclose(Ts[0, :3, 3], arm.points(joints[None], values)[0, 1], atol=1e-15)
        assert_derivatives(lambda q: arm.points(q[None], values)[0, 1], jacobian[0, :3], joints)

        def turned(q: Array, R=Ts[0, :3, :3]) -> Array:
            spin = arm.flange(q[None], values)[0, :3, :3] @ R.T  # I + [w]x to first order
            return np.array([spin[2, 1] - spin[1, 2], spin[0, 2] - spin[2, 0], spin[1, 0] - spin[0, 1]]) / 2

        assert_derivatives(turned, jacobian[0, 3:], joints)


def det(name: str, q: Array) -> Array:
    """det J in factored form, from the literature."""
    s, c = np.sin(q.T), np.cos(q.T)
    s23, c23 = np.sin(q[:, 1] + q[:, 2]), np.cos(q[:, 1] + q[:, 2])
    if name == "irb120":
        return -0.27 * (0.302 * c[2] + 0.07 * s[2]) * s[4] * (0.27 * s[1] + 0.07 * s23 + 0.302 * c23)
    if name == "scemi":
        return -0.5 * 0.5 * c[2] * s[4] * (0.5 * s23 - 0.5 * c[1])
    a, d = (0.625, 0.625) if name == "rx130" else (0.225, 0.225)
    return -a * d * s[2] * s[4] * (a * s[1] + d * s23)


@pytest.mark.parametrize("name", DECOUPLED)
def test_manipulability_is_the_determinant_and_its_gradient_gives_the_distance(name: str) -> None:
    chain = DECOUPLED[name]
    arm, joints = SerialArm(chain), chain.random_joints(300, np.random.default_rng(7))

    def at(q: Array) -> Array:
        return arm.tool(q, arm.nominal())[1]

    np.testing.assert_allclose(manipulability(at(joints)), np.abs(det(name, joints)), atol=1e-15)
    step = 1e-6 * np.eye(6)
    gradient = np.stack([(det(name, joints + s) - det(name, joints - s)) / 2e-6 for s in step], axis=1)
    distance, joint = singular_distance(at(joints))
    np.testing.assert_allclose(distance, np.abs(det(name, joints)) / np.linalg.norm(gradient, axis=1), rtol=1e-5)
    assert (joint == np.abs(gradient).argmax(axis=1)).mean() > 0.99


def test_a_wrist_bent_by_one_degree_is_one_degree_from_singular() -> None:
    arm, joints = IRB120.arm(("p1",)), np.deg2rad([[20.0, 10, -20, 40, 1, 60]])
    distance, joint = singular_distance(arm.tool(joints, arm.nominal())[1])
    assert np.rad2deg(distance[0]) == pytest.approx(1.0, rel=1e-3) and joint[0] == 4


# Newton's method


@pytest.mark.parametrize("groups", [(), ("compliance", "harmonics")], ids=["rigid", "bending"])
def test_newton_ends_where_the_arm_is(groups: tuple[str, ...]) -> None:
    rng = np.random.default_rng(8)
    arm = IRB120.arm_with(("p1",), groups)
    rigid = arm.arm if isinstance(arm, AffectedArm) else arm
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
    found = reach(arm, values, Wanted(Ts[:, :3, 3], Ts[:, :3, :3]), start, load)
    assert found.arrived[~near].all() and found.steps[~near].max() <= 6
    assert np.abs(found.joints - joints)[~near].max() < 1e-8
    anywhere = np.full((500, 3, 3), np.nan)
    free = reach(arm, values, Wanted(Ts[:, :3, 3], anywhere), start, load)
    assert free.arrived.all()
    assert np.linalg.norm(free.joints - start, axis=1)[~near].max() < 0.1  # the shortest way there


def test_effects_move_the_tool_as_they_move_its_points() -> None:
    """A frame that drifts turns the tool too."""
    arm = AffectedArm(IRB120.arm(("p1", "p2", "p3")), (effect("drift", IRB120.chain, None),))
    values = arm.nominal(IRB120.tool)
    values[-7:] = 1e-3, -2e-3, 3e-3, 4e-3, -5e-3, 6e-3, 1e-4
    joints = IRB120.chain.random_joints(20, np.random.default_rng(9))
    settings = np.concatenate([joints, np.full((20, 1), 3600.0)], axis=1)
    points = arm.points(settings, values)
    tool = values[-16:-7].reshape(3, 3)
    for k in range(3):
        np.testing.assert_allclose(arm.tool(settings, values, k)[0][:, :3, 3], points[:, k], atol=1e-15)
    turns = arm.tool(settings, values)[0][:, :3, :3]
    np.testing.assert_allclose(points[:, 1] - points[:, 0], (1 + 1e-4) * turns @ (tool[1] - tool[0]), atol=1e-15)


def test_out_of_reach_newton_ends_as_near_as_it_gets() -> None:
    arm = IRB120.arm(("p1",))
    values = arm.nominal(IRB120.tool)
    wanted = Wanted(np.array([[2.0, 0.0, 0.3]]), np.full((1, 3, 3), np.nan))
    found = reach(arm, values, wanted, np.deg2rad([[5.0, 30, -20, 10, 20, 0]]), np.empty((1, 0)))
    assert not found.arrived[0]
    outstretched = 0.58 + np.linalg.norm(0.072 * np.array([0, 0, 1]) + values[-3:])
    assert np.linalg.norm(found.errors[0, :3]) == pytest.approx(2.0 - outstretched, abs=0.01)


# All ways of a drawing


@pytest.mark.parametrize("name", ["ur10.toml", "panda.toml"])
def test_arms_without_a_closed_form_are_searched(name: str) -> None:
    chain = table_robot(name).chain
    arm = SerialArm(chain)
    joints = chain.random_joints(200, np.random.default_rng(10))
    drawing = Drawing(arm, arm.nominal())
    assert drawing.closed_form is None
    Ts, _ = drawing.tool(joints)
    found = drawing.ways(Wanted(Ts[:, :3, 3], Ts[:, :3, :3]), np.full(joints.shape, np.nan))
    reached = found.gap_m == 0
    assert reached.any(axis=1).mean() > 0.98
    back = drawing.tool(found.joints[reached])[0]
    assert np.abs(back - np.repeat(Ts, reached.sum(axis=1), axis=0)).max() < 1e-9


def test_a_reference_is_where_the_search_begins() -> None:
    arm = IRB120.arm(("p1",))
    drawing = Drawing(arm, arm.nominal(IRB120.tool))
    joints = IRB120.chain.random_joints(50, np.random.default_rng(11))
    Ts, _ = drawing.tool(joints)
    anywhere = Wanted(Ts[:, :3, 3], np.full((50, 3, 3), np.nan))
    np.testing.assert_allclose(drawing.ways(anywhere, joints).joints[:, 0], joints, atol=1e-12)


def test_whole_turns_stay_near_and_within_limits() -> None:
    chain = IRB120.chain  # the last joint turns by 400 degrees each way
    for given, near, expected in ((10, 350, 370), (-170, 180, 190), (100, 400, 100), (60, 400, 60 + 0), (30, 400, 390)):
        joints = np.zeros(6)
        joints[5] = np.deg2rad(given)
        liked = np.zeros(6)
        liked[5] = np.deg2rad(near)
        assert np.rad2deg(nearest_turns(chain, joints, liked)[5]) == pytest.approx(expected)
