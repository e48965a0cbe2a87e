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
from lab.kinematics.inverse.closed_form import ClosedForm, closed_form_of
from lab.kinematics.inverse.newton import PoseTarget
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
}  # fmt: skip
ALL = {**PLANAR, **FIVE}


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
@pytest.mark.parametrize("name", ALL)
def test_every_solution_leads_back_and_the_true_one_is_among_them(name: str) -> None:
    count, rng = 100, np.random.default_rng(1)
    for chain in (ALL[name], mixed(ALL[name], rng)):
        form, joints = form_of(chain), drawn(chain, count, 2)
        Ts = flanges(chain, joints)
        found = form.solve(Ts)
        reached = met(form, found)
        assert found.joints.shape == (count, form.branches, chain.size) and reached.any(axis=1).all()
        assert missed(chain, form, found.joints, Ts)[reached].max() <= 1e-11
        nearest = np.where(reached, apart(chain, found.joints, joints[:, None]), np.inf).min(axis=1)
        assert nearest.max() < 1e-4 and np.quantile(nearest, 0.99) < 1e-9  # near a double root


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
@pytest.mark.parametrize(("name", "kind"), SINGULAR)
def test_at_a_singularity_nothing_is_lost(name: str, kind: str) -> None:
    chain, form, rng = ALL[name], form_of(ALL[name]), np.random.default_rng(7)
    there = at_zero(chain, kind, 40)
    for away in (0.0, 1e-9, 1e-6):
        joints = there + away * rng.uniform(-1, 1, there.shape)
        Ts = flanges(chain, joints)
        found = form.solve(Ts, drawn(chain, len(joints), 8))
        reached = met(form, found)
        assert np.isfinite(found.joints).all() and reached.any(axis=1).all(), away
        assert missed(chain, form, found.joints, Ts)[reached].max() < 1e-9


def test_a_wrist_on_the_axis_of_joint_1_is_turned_by_the_rotation() -> None:
    """There the place does not determine joint 1."""
    chain, form, joints = ALL["scorbot"], form_of(ALL["scorbot"]), drawn(ALL["scorbot"], 60, 9)
    q2 = joints[:, 1]
    joints[:, 2] = np.arccos(np.clip(-(0.016 + 0.22 * np.cos(q2)) / 0.22, -1, 1)) - q2
    for off in (0.0, 1e-13, 1e-10, 1e-8, 1e-6):
        Ts = flanges(chain, joints + off * np.random.default_rng(0).uniform(-1, 1, joints.shape))
        found = form.solve(Ts, drawn(chain, 60, 10))
        reached = met(form, found)
        assert reached.any(axis=1).all(), off
        assert missed(chain, form, found.joints, Ts)[reached].max() < 1e-9


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ALL)
def test_the_determinant_is_that_of_the_jacobian(name: str) -> None:
    """Of a planar arm the rows of its plane; of five axes the place of the centre and one turn."""
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
            rows = np.array([form.rows(form.axes.jacobian(row, form.centre)) for row in joints])
        np.testing.assert_allclose(found, np.linalg.det(rows), atol=1e-12)
        assert np.abs(found).max() > 1e-4


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


def test_other_shapes_have_none() -> None:
    five = FIVE["scorbot"]
    table = five.table.copy()
    table[1, 3] += 1e-4  # axes 2 and 3 not parallel
    assert closed_form_of(five.with_table(table)) is None
    across = PLANAR["RRR"].table.copy()
    across[1, 3] += 0.3
    assert not isinstance(closed_form_of(PLANAR["RRR"].with_table(across), POINT), PlanarArm)
    assert closed_form_of(PLANAR["RR"], np.zeros(3)) is None  # a point on the last axis
    assert not isinstance(closed_form_of(IRB120.chain), FiveAxes)
