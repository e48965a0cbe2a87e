"""Inverses in closed form: every solution, nothing lost at singularities, what is out of reach, and the determinant."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120, chain_of

from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.robotics.inverse.first_joints import ThreeJoints, fitted_factor
from lab.extensions.robotics.inverse.five_axes import FiveAxes
from lab.extensions.robotics.inverse.planar import PlanarArm, Scara
from lab.extensions.robotics.inverse.six_axes import SphericalWrist, ThreeParallel
from lab.kinematics.inverse.branches import NominalInverse, nearest_whole_turns
from lab.kinematics.inverse.closed_form import ClosedForm, Solutions, closed_form_of
from lab.kinematics.inverse.newton_inverse import PoseTarget
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm
from lab.robots.load_robot import load_robot

POINT = np.array([0.25, 0.03, 0.02])  # that arms of two and three joints bring to a place
BRANCHES = {"irb120": 8, "rx130": 8, "tx40": 8, "versatran": 4, "scemi": 8, "scara": 2}
MODELS = {name: load_robot(name).chain for name in BRANCHES}
SIX = {  # wrists of all kinds, and all that may be at an angle or off an axis is
    "antiparallel": chain_of(  # axis 3 against axis 2
        "antiparallel", "craig", "RRRRRR", [0, -90, 180, -90, 90, -90], [0.1, 0.05, 0.5, 0.02, 0, 0],
        [0, 10, 20, 0, 0, 0], [0.3, 0.1, 0.05, 0.4, 0, 0.1],
    ),
    "slanted": chain_of(
        "slanted", "craig", "RRRRRR", [0, -70, 0, -60, 90, -90], [0.1, 0.05, 0.5, 0.02, 0, 0],
        [10, 10, 20, 30, 40, 50], [0.3, 0.1, 0.05, 0.4, 0, 0.1],
    ),
    "stanford": chain_of(
        "stanford", "craig", "RRPRRR", [0, -90, 90, 0, -90, 90], [0] * 6, [0] * 6, [0.4, 0.15, 0, 0, 0, 0.1]
    ),
    "stanford, slanted": chain_of(
        "stanford, slanted", "craig", "RRPRRR", [0, -70, 90, 40, -90, 90], [0, 0.1, 0.05, 0, 0, 0],
        [10, 20, 30, 40, 50, 60], [0.4, 0.15, 0.1, 0, 0, 0.1],
    ),
    "versatran, off its axis": chain_of(
        "versatran off", "craig", "RPPRRR", [0, 180, -90, 30, -90, 90], [0, 0.05, 0.1, 0, 0, 0],
        [10, 20, 30, 40, 50, 60], [0.1, 0, 0.2, 0, 0, 0.3],
    ),
    "ur10": chain_of(  # the public table (ur_description)
        "ur10", "distal", "RRRRRR", [90, 0, 0, 90, -90, 0], [0, -0.612, -0.5723, 0, 0, 0], [0] * 6,
        [0.1273, 0, 0, 0.163941, 0.1157, 0.0922],
    ),
    "ur, slanted": chain_of(  # axis 2 not square to axis 1, axes 3 and 4 against it, axis 4 off axis 5
        "ur slanted", "craig", "RRRRRR", [0, 70, 180, 180, 90, -90], [0.1, 0.1, 0.5, 0.4, 0.05, 0],
        [10, 20, 30, 40, 50, 60], [0.3, 0.05, 0.1, 0.1, 0.1, 0.1],
    ),
}  # fmt: skip
SCARAS = {
    "scara": MODELS["scara"],
    "scara, antiparallel": chain_of(
        "a", "craig", "RRRP", [0, 0, 180, 0], [0, 0.4, 0.25, 0.1], [9, 8, 7, 6], [0.1, 0.2, 0.3, 0.4],
    ),
    "scara, slide first": chain_of("b", "craig", "PRRR", [30, 180, 0, 0], [0, 0.3, 0.2, 0.2], [0] * 4, [0.1] * 4),
    "scara, slide second": chain_of("c", "distal", "RPRR", [0, 0, 180, 20], [0.2, 0.1, 0.3, 0.1], [5] * 4, [0.1] * 4),
}  # fmt: skip
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
}  # fmt: skip


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
    **{f"planar {kinds}": planar(kinds) for kinds in ("RR", "RP", "PR", "RRR", "RRP", "RPR", "PRR", "PRP")},
    "planar PP": chain_of("PP", "craig", "PP", [90, 70], [0, 0.2], [20, 0], [0, 0]),
    "planar PPR": chain_of("PPR", "craig", "PPR", [90, 70, 90], [0, 0, 0.2], [0, 90, 0], [0, 0, 0]),
}
THREE = {  # all eight kinds, with axes at odd angles and nothing zero
    "".join(kinds): chain_of(
        "any", "craig", "".join(kinds), [0, 40 + 5 * i, 70 - 6 * i], [0.1, 0.2 + 0.02 * i, 0.3], [10, 20, 30],
        [0.3, 0.1 + 0.02 * i, 0.2],
    )
    for i, kinds in enumerate(itertools.product("RP", repeat=3))
}  # fmt: skip
THREE |= {
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
ALL = {**MODELS, **SIX, **SCARAS, **FIVE, **PLANAR, **THREE}


def form_of(chain: Chain) -> ClosedForm:
    found = closed_form_of(chain, POINT if chain.size < 4 or chain.size == 5 else None)
    assert found is not None
    return found


def drawn(chain: Chain, count: int, seed: int) -> Array:
    """Joint positions of robots within their limits, and of other chains anywhere."""
    rng = np.random.default_rng(seed)
    if chain.size in (4, 6):
        return chain.random_joints(count, rng)
    wide = np.where(chain.prismatic, 0.8, np.pi)
    return rng.uniform(-wide, wide, (count, chain.size))


def flanges(chain: Chain, joints: Array) -> Array:
    """Poses of the last frame in frame 0, ``(..., 4, 4)``."""
    arm = SerialArm(chain)
    return arm.flange(joints.reshape(-1, chain.size), arm.nominal()).reshape(*joints.shape[:-1], 4, 4)


def apart(chain: Chain, a: Array, b: Array) -> Array:
    """Between joint positions ``(..., joints)`` the largest difference, without whole turns of hinges."""
    turns = np.where(chain.prismatic, 0.0, 2 * np.pi)
    return np.abs(a - b - turns * np.round((a - b) / (2 * np.pi))).max(axis=-1)


def mixed(chain: Chain, rng: np.random.Generator) -> Chain:
    """The same arm with other zeros and with joint positions that count the other way."""
    table = chain.table.copy()
    table[:, 0] += np.where(chain.prismatic, 0.0, rng.normal(size=chain.size))
    table[:, 1] += np.where(chain.prismatic, rng.normal(size=chain.size), 0.0)
    return replace(chain.with_table(table), sign=rng.choice([-1.0, 1.0], chain.size))


def points(chain: Chain, joints: Array) -> Array:
    """Where the last frame carries the point, ``(..., 3)`` in frame 0."""
    Ts = flanges(chain, joints)
    return Ts[..., :3, :3] @ POINT + Ts[..., :3, 3]


def missed(chain: Chain, form: ClosedForm, joints: Array, Ts: Array) -> Array:
    """By how much solutions ``(n, k, joints)`` miss poses (m, and elements of the rotation)."""
    off = flanges(chain, joints) - Ts[:, None]
    if not form.by_point:
        return np.abs(off).max(axis=(2, 3))
    return np.abs(off[..., :3, :3] @ POINT + off[..., :3, 3]).max(axis=2)


def met(form: ClosedForm, found: Solutions) -> Array:
    return (found.gap_m == 0) & (True if form.by_point else found.tilt_rad == 0)


# Solutions


@pytest.mark.parametrize("name", ALL)
def test_every_solution_leads_back_and_the_true_one_is_among_them(name: str) -> None:
    """Also with other signs and zeros of the joints."""
    count, rng = 400, np.random.default_rng(4)
    for chain in (ALL[name], mixed(ALL[name], rng), mixed(ALL[name], rng)):
        form, joints = form_of(chain), drawn(chain, count, 2)
        Ts = flanges(chain, joints)
        found = form.solve(Ts)
        reached = met(form, found)
        assert found.joints.shape == (count, form.branches, chain.size) and reached.any(axis=1).all()
        assert missed(chain, form, found.joints, Ts)[reached].max() <= 1e-11
        off = np.where(reached, apart(chain, found.joints, joints[:, None]), np.inf)
        nearest = off.min(axis=1)
        assert nearest.max() < 1e-4 and np.quantile(nearest, 0.99) < 1e-9  # near a double root
        true = np.take_along_axis(found.tilt_rad, off.argmin(axis=1)[:, None], axis=1)
        assert np.quantile(true, 0.99) < 1e-9  # with the true joints the rotation is met as well


@pytest.mark.parametrize("name", MODELS)
def test_every_pose_has_all_solutions_and_they_differ(name: str) -> None:
    """TX 40's wrist cannot come within 35 mm of axis 1, which random joints never ask for."""
    count, chain, form = 2000, MODELS[name], form_of(MODELS[name])
    joints = drawn(chain, count, 2)
    found = form.solve(flanges(chain, joints))
    assert form.branches == BRANCHES[name] and not found.gap_m.any() and not found.free.any()
    assert apart(chain, found.joints, joints[:, None]).min(axis=1).max() < 1e-9
    between = apart(chain, found.joints[:, :, None], found.joints[:, None])
    others = np.where(np.eye(form.branches, dtype=bool), np.inf, between)
    assert np.median(others.min(axis=(1, 2))) > 0.05


@pytest.mark.parametrize("name", ["ur10", "ur, slanted"])
def test_three_parallel_axes_have_up_to_eight_solutions(name: str) -> None:
    chain, form = ALL[name], form_of(ALL[name])
    found = form.solve(flanges(chain, drawn(chain, 2000, 2)))
    assert isinstance(form, ThreeParallel) and found.joints.shape[1] == 8 and not found.free.any()
    assert (met(form, found).sum(axis=1) == 8).mean() > 0.4


def test_other_arms_have_no_closed_form() -> None:
    """Axes 5 and 6 that do not meet, 2 and 3 that are not parallel, wrists askew."""
    off = {"irb120": [(4, 2), (1, 3), (3, 3), (4, 3)], "versatran": [(1, 3), (2, 3)], "stanford": [(2, 3)],
           "scara": [(2, 3)], "scorbot": [(1, 3)]}  # fmt: skip
    for name, entries in off.items():
        for row, column in entries:
            table = ALL[name].table.copy()
            table[row, column] += 1e-4
            assert closed_form_of(ALL[name].with_table(table)) is None
    assert closed_form_of(load_robot("course2r").chain) is None
    across = PLANAR["planar RRR"].table.copy()
    across[1, 3] += 0.3
    assert not isinstance(closed_form_of(PLANAR["planar RRR"].with_table(across), POINT), PlanarArm)
    assert closed_form_of(PLANAR["planar RR"], np.zeros(3)) is None  # a point on the last axis
    assert closed_form_of(THREE["anthropomorphic"], np.zeros(3)) is None
    assert not isinstance(form_of(PLANAR["planar RRR"]), ThreeJoints)  # it does not move in space


# Singularities

SINGULAR = [
    (name, factor.name)
    for name in ALL
    for factor in form_of(ALL[name]).determinant.factors
    if factor.terms and (name, factor.name) != ("stanford", "slide")  # where the shoulder's is zero too
]


def at_zero(chain: Chain, name: str, count: int) -> Array:
    """Joint positions where a factor is zero, by bisection between positions of other signs."""
    factor = next(each for each in form_of(chain).determinant.factors if each.name == name)
    low, high = drawn(chain, count, 5), drawn(chain, count, 6)
    if not (factor.at(low) * factor.at(high) < 0).any():  # within its limits a slide is never zero
        low, high = low - 0.5 * np.array(chain.prismatic), high - 0.5 * np.array(chain.prismatic)
    crossing = factor.at(low) * factor.at(high) < 0
    low, high = low[crossing], high[crossing]
    for _ in range(60):
        middle = (low + high) / 2
        same = (factor.at(low) * factor.at(middle) > 0)[:, None]
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    assert len(low) > 0.1 * count and np.abs(factor.at(low)).max() < 1e-12
    return low


@pytest.mark.parametrize(("name", "kind"), SINGULAR)
def test_at_a_singularity_nothing_is_lost(name: str, kind: str) -> None:
    chain, form, rng = ALL[name], form_of(ALL[name]), np.random.default_rng(7)
    there = at_zero(chain, kind, 1500)
    for away in (0.0, 1e-9, 1e-6):
        joints = there + away * rng.uniform(-1, 1, there.shape)
        Ts = flanges(chain, joints)
        found = form.solve(Ts, drawn(chain, len(joints), 8))
        reached = met(form, found)
        assert np.isfinite(found.joints).all() and reached.any(axis=1).all(), away
        assert missed(chain, form, found.joints, Ts)[reached].max() < (1e-11 if chain.size in (4, 6) else 1e-9)
        if away == 1e-6 and chain.size == 6:  # at two singularities at once the pose does not say
            free = (found.free & reached[:, :, None]).any(axis=(1, 2))
            assert ((apart(chain, found.joints, joints[:, None]).min(axis=1) < 1e-5) | free).mean() > 0.99


@pytest.mark.parametrize(
    ("name", "kind", "joint"),
    [("irb120", "wrist", 3), ("stanford", "wrist", 3), ("ur10", "wrist", 5), ("rx130", "shoulder", 0),
     ("versatran", "shoulder", 0)],
)  # fmt: skip
def test_a_joint_that_is_free_keeps_its_reference(name: str, kind: str, joint: int) -> None:
    chain, form = ALL[name], form_of(ALL[name])
    joints = at_zero(chain, kind, 400)
    reference = drawn(chain, len(joints), 6)
    found = form.solve(flanges(chain, joints), reference)
    free = found.free[..., joint] & met(form, found)
    assert free.any(axis=1).mean() > 0.2  # the rest is off by rounding
    away = apart(chain, found.joints[..., [joint] * chain.size], reference[:, None, [joint] * chain.size])
    kept = away[found.free[..., joint]] < 1e-12
    assert kept.mean() > 0.5 if name == "ur10" else kept.all()  # with others the arm is too short


def test_two_equal_links_folded_back_leave_their_root_free() -> None:
    """The wrist's centre on axis 2, and, where that is on axis 1, anything goes for joints 1 and 2."""
    for name, folded in (("rx130", np.pi), ("scemi", np.pi / 2), ("scara, slide first", np.pi)):
        chain, rng, elbow = ALL[name], np.random.default_rng(7), 2
        joints = chain.random_joints(1000, rng)
        joints[:, elbow] = folded
        Ts, reference = flanges(chain, joints), chain.random_joints(1000, rng)
        found = form_of(chain).solve(Ts, reference)
        assert not found.gap_m.any() and np.isfinite(found.joints).all()
        assert np.abs(flanges(chain, found.joints) - Ts[:, None]).max() < 1e-11
        assert found.free[:, :, elbow - 1].any(axis=1).mean() > 0.2


def test_a_wrist_on_the_axis_of_joint_1_is_turned_by_the_rotation() -> None:
    """There the place does not determine joint 1 of an arm of five axes."""
    chain, form, joints = ALL["scorbot"], form_of(ALL["scorbot"]), drawn(ALL["scorbot"], 60, 9)
    q2 = joints[:, 1]
    joints[:, 2] = np.arccos(np.clip(-(0.016 + 0.22 * np.cos(q2)) / 0.22, -1, 1)) - q2
    for off in (0.0, 1e-13, 1e-10, 1e-8, 1e-6):
        Ts = flanges(chain, joints + off * np.random.default_rng(0).uniform(-1, 1, joints.shape))
        found = form.solve(Ts, drawn(chain, 60, 10))
        reached = met(form, found)
        assert reached.any(axis=1).all(), off
        assert missed(chain, form, found.joints, Ts)[reached].max() < 1e-9


def test_a_hinge_is_free_where_the_point_is_on_its_axis() -> None:
    form = closed_form_of(THREE["cylindrical"], np.zeros(3))
    T = np.eye(4)
    T[2, 3] = 0.5
    found = form.solve(T[None], np.array([[0.7, 0.0, 0.0]]))
    assert found.free[..., 0].all() and np.allclose(found.joints[..., 0], 0.7) and not found.gap_m.any()


# Out of reach


def test_out_of_reach_is_told_by_how_much_and_the_readings_come_near() -> None:
    chain = IRB120.chain
    joints = chain.random_joints(500, np.random.default_rng(5))
    joints[:, 2] = -np.arctan2(0.302, 0.07)  # straight
    Ts = flanges(chain, joints)
    wrist = Ts[:, :3, 3] - 0.072 * Ts[:, :3, 2]
    shoulder = np.array([0.0, 0.0, 0.29])
    outward = (wrist - shoulder) / np.linalg.norm(wrist - shoulder, axis=1)[:, None]
    Ts[:, :3, 3] += 0.01 * outward
    found = form_of(chain).solve(Ts)
    np.testing.assert_allclose(found.gap_m, 0.01, rtol=1e-9)
    back = flanges(chain, found.joints)
    np.testing.assert_allclose(back[..., :3, :3], np.broadcast_to(Ts[:, None, :3, :3], (500, 8, 3, 3)), atol=1e-12)
    assert np.linalg.norm(back[..., :3, 3] - Ts[:, None, :3, 3], axis=2).max() < 0.0105


def test_a_slide_that_passes_beside_its_axis_does_not_come_nearer() -> None:
    """The TX 40's 35 mm, and an arm whose slide passes 100 mm beside axis 1."""
    for name, beside in (("tx40", 0.035), ("versatran, off its axis", None)):
        chain, form = ALL[name], form_of(ALL[name])
        assert isinstance(form, SphericalWrist)
        offset = beside or abs(form.carrier.middle.imag)
        Ts = flanges(chain, chain.random_joints(100, np.random.default_rng(8)))
        Ts[:, :2, 3] -= (Ts[:, :3, :3] @ form.centre + Ts[:, :3, 3])[:, :2]  # the wrist's centre onto axis 1
        if name == "tx40":
            Ts[:, 2, 3] += 0.2 - (Ts[:, :3, :3] @ form.centre + Ts[:, :3, 3])[:, 2]
        found = form.solve(Ts)
        np.testing.assert_allclose(found.gap_m, offset, rtol=1e-9)
        assert np.isfinite(found.joints).all()


@pytest.mark.parametrize("name", SCARAS)
def test_a_tilt_is_out_of_reach_of_four_parallel_axes_and_told(name: str) -> None:
    chain, form, rng = ALL[name], form_of(ALL[name]), np.random.default_rng(9)
    joints = chain.random_joints(300, rng)
    Ts = flanges(chain, joints)
    axis = np.cross(form.plane[2], rng.normal(size=(300, 3)))
    tilt = rng.uniform(1e-6, 3.0, 300)
    tilted = Ts.copy()
    tilted[:, :3, :3] = se3.exp(tilt[:, None] * axis / np.linalg.norm(axis, axis=1)[:, None]) @ Ts[:, :3, :3]
    np.testing.assert_allclose(form.nearest_rotations(tilted[:, :3, :3]), Ts[:, :3, :3], atol=1e-9)
    found = form.solve(tilted)
    np.testing.assert_allclose(found.tilt_rad, np.stack([tilt, tilt], axis=1), rtol=1e-9)
    assert not found.gap_m.any()
    assert apart(chain, found.joints, joints[:, None]).min(axis=1).max() < 1e-6
    np.testing.assert_allclose(flanges(chain, found.joints), np.stack([Ts, Ts], axis=1), atol=1e-9)
    over = Ts.copy()
    over[:, :3, :3] = se3.exp(np.pi * form.plane[0]) @ Ts[:, :3, :3]  # upside down: any turn is as near
    assert form.solve(over).tilt_rad == pytest.approx(np.pi) and np.isfinite(form.solve(over).joints).all()
    Ts[:, :3, 3] += 10.0 * form.plane[0]
    far = form.solve(Ts)
    assert far.gap_m.min() > 8.5 and np.isfinite(far.joints).all()


def test_what_a_planar_arm_cannot_do_is_told() -> None:
    chain, form = PLANAR["planar RRR"], form_of(PLANAR["planar RRR"])
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


def test_a_pose_that_five_axes_cannot_take_is_come_near_to() -> None:
    """The place is met, and no small move that leaves it there brings the rotation nearer."""
    chain = FIVE["scorbot"]
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


@pytest.mark.parametrize("name", ["anthropomorphic", "orthogonal", "RRR"])
def test_a_place_out_of_reach_is_told_by_how_much(name: str) -> None:
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


def test_a_place_alone_is_solved_in_closed_form_whatever_the_rotation() -> None:
    chain = THREE["anthropomorphic"]
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
    chain = THREE[kinds]
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


# The determinant


def jacobian_determinant(chain: Chain, form: ClosedForm, joints: Array) -> Array:
    """det J at the centre or point that a form solves for; of fewer joints of the rows that they move."""
    arm = SerialArm(chain, ("p1",))
    if isinstance(form, FiveAxes):  # the place of the centre and one turn
        return np.linalg.det([form.rows(form.axes.jacobian(row, form.centre)) for row in joints])
    at = (
        POINT
        if form.by_point or isinstance(form, PlanarArm)
        else form.wrist
        if isinstance(form, Scara)
        else form.centre
    )
    J = arm.tool(joints, arm.nominal({"p1": at}))[1]
    if isinstance(form, ThreeJoints):
        return np.linalg.det(J[:, :3])
    if isinstance(form, PlanarArm):
        return np.linalg.det(
            np.concatenate([form.plane[:2] @ J[:, :3], form.plane[2:] @ J[:, 3:]], axis=1)[:, : chain.size]
        )
    if isinstance(form, Scara):
        return np.linalg.det(np.concatenate([J[:, :3], (form.plane[2] @ J[:, 3:])[:, None]], axis=1))
    return np.linalg.det(J)


def read(text: str, joints: Array) -> Array:
    """What a text says, as a person would take it."""
    text = re.sub(r"(sin|cos) (q\d)", r"\1(\2)", text)
    text = re.sub(r"(?<=[\w)]) (?=[\w(])", " * ", text)
    names = {f"q{i + 1}": joints[:, i] for i in range(joints.shape[1])}
    return eval(text, {"sin": np.sin, "cos": np.cos, **names})


@pytest.mark.parametrize("name", ALL)
def test_the_determinant_is_that_of_the_jacobian_whatever_signs_and_zeros(name: str) -> None:
    rng = np.random.default_rng(11)
    for chain in (ALL[name], mixed(ALL[name], rng), mixed(ALL[name], rng)):
        joints = rng.uniform(-3, 3, (40 if chain.size == 5 else 200, chain.size))
        form = form_of(chain)
        found, expected = form.determinant, jacobian_determinant(chain, form, joints)
        np.testing.assert_allclose(found.at(joints), expected, atol=1e-12)
        assert np.abs(expected).max() > 1e-4
        product = found.sign * np.prod(found.lengths) * np.prod([each.at(joints) for each in found.factors], axis=0)
        np.testing.assert_allclose(product, expected, atol=1e-12)
        np.testing.assert_allclose(read(found.text.removesuffix("-") or f"{found.text}1", joints), expected, atol=1e-4)


def test_factors_have_names_and_the_joints_names() -> None:
    chain = replace(IRB120.chain, joint_names=("base", "arm_2", "arm 3", "a", "tilt", "b"))
    found = form_of(chain).determinant
    assert [factor.name for factor in found.factors] == ["elbow", "wrist", "shoulder"]
    assert [factor.text for factor in found.factors] == [
        "0.302 cos arm 3 + 0.07 sin arm 3",
        "sin tilt",
        "0.27 sin arm_2 + 0.07 sin(arm_2+arm 3) + 0.302 cos(arm_2+arm 3)",
    ]
    assert [factor.name for factor in form_of(SIX["stanford"]).determinant.factors] == ["slide", "wrist", "shoulder"]
    assert form_of(SIX["stanford"]).determinant.text == "q3 sin q5 q3 sin q2"


def test_a_sum_of_terms_is_read_off_its_values() -> None:
    def value(q: Array) -> Array:
        return 0.5 - 2 * np.sin(2 * q[:, 1]) * q[:, 2] ** 2 + 0.3 * np.cos(q[:, 1]) * q[:, 2]

    terms = fitted_factor(value, (False, False, True), (1, 2))
    joints = np.random.default_rng(0).normal(size=(50, 3))
    assert len(terms) == 3
    np.testing.assert_allclose(sum(term.at(joints) for term in terms), value(joints), atol=1e-12)
    said = {term.text(("q1", "q2", "q3")) for term in terms}
    assert said == {"0.5", "2 q3 q3 sin(2 * q2)", "0.3 q3 cos q2"}
