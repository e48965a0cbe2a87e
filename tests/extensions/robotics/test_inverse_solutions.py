"""Inverses in closed form: every solution, none but solutions, nothing lost at singularities, and the determinant."""

import re
from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120, chain_of

from lab.campaign.robot import load_robot
from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.robotics.inverse.khalil_equations import type_2
from lab.extensions.robotics.inverse.planar import Scara
from lab.extensions.robotics.inverse.six_axes import SphericalWrist, ThreeParallel
from lab.kinematics.differential import singular_distance
from lab.kinematics.inverse.closed_form import ClosedForm, Factor, closed_form_of
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.chain import Chain

MODELS = {name: load_robot(name).chain for name in ("irb120", "rx130", "tx40", "scemi", "versatran", "scara")}
BRANCHES = {"irb120": 8, "rx130": 8, "tx40": 8, "versatran": 4, "scemi": 8, "scara": 2}
STANFORD = chain_of(
    "stanford", "craig", "RRPRRR", [0, -90, 90, 0, -90, 90], [0] * 6, [0] * 6, [0.4, 0.15, 0, 0, 0, 0.1]
)
ODD = {  # all that may be at an angle or off an axis is
    "antiparallel": chain_of(  # axis 3 against axis 2
        "antiparallel", "craig", "RRRRRR", [0, -90, 180, -90, 90, -90], [0.1, 0.05, 0.5, 0.02, 0, 0],
        [0, 10, 20, 0, 0, 0], [0.3, 0.1, 0.05, 0.4, 0, 0.1],
    ),
    "slanted": chain_of(
        "slanted", "craig", "RRRRRR", [0, -70, 0, -60, 90, -90], [0.1, 0.05, 0.5, 0.02, 0, 0],
        [10, 10, 20, 30, 40, 50], [0.3, 0.1, 0.05, 0.4, 0, 0.1],
    ),
    "stanford": STANFORD,
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
    "scara, antiparallel": chain_of(
        "a", "craig", "RRRP", [0, 0, 180, 0], [0, 0.4, 0.25, 0.1], [9, 8, 7, 6], [0.1, 0.2, 0.3, 0.4],
    ),
    "scara, slide first": chain_of("b", "craig", "PRRR", [30, 180, 0, 0], [0, 0.3, 0.2, 0.2], [0] * 4, [0.1] * 4),
    "scara, slide second": chain_of("c", "distal", "RPRR", [0, 0, 180, 20], [0.2, 0.1, 0.3, 0.1], [5] * 4, [0.1] * 4),
}  # fmt: skip
ALL = {**MODELS, **ODD}


def closed_form(chain: Chain) -> ClosedForm:
    found = closed_form_of(chain)
    assert found is not None
    return found


def flanges(chain: Chain, joints: Array) -> Array:
    """Poses of the last frame in frame 0, ``(..., 4, 4)``."""
    arm = SerialArm(chain)
    return arm.flange(joints.reshape(-1, chain.size), arm.nominal()).reshape(*joints.shape[:-1], 4, 4)


def apart(chain: Chain, a: Array, b: Array) -> Array:
    """Between readings ``(..., joints)`` the largest difference, without whole turns of hinges."""
    turns = np.where(chain.prismatic, 0.0, 2 * np.pi)
    return np.abs(a - b - turns * np.round((a - b) / (2 * np.pi))).max(axis=-1)


def mixed(chain: Chain, rng: np.random.Generator) -> Chain:
    """The same arm with other zeros and with readings that count the other way."""
    table = chain.table.copy()
    table[:, 0] += rng.normal(size=chain.size)
    table[:, 1] += np.where(chain.prismatic, rng.normal(size=chain.size), 0.0)
    return replace(chain.with_table(table), sign=rng.choice([-1.0, 1.0], chain.size))


# Solutions


@pytest.mark.parametrize("name", MODELS)
def test_every_solution_leads_back_and_the_true_one_is_among_them(name: str) -> None:
    """TX 40's wrist cannot come within 35 mm of axis 1, which random joints never ask for."""
    count, chain, form = 2000, MODELS[name], closed_form(MODELS[name])
    joints = chain.random_joints(count, np.random.default_rng(2))
    Ts = flanges(chain, joints)
    found = form.solve(Ts)
    assert found.joints.shape == (count, BRANCHES[name], chain.size) and form.branches == BRANCHES[name]
    assert not found.gap_m.any() and not found.free.any() and not found.tilt_rad.any()
    assert np.abs(flanges(chain, found.joints) - Ts[:, None]).max() < 1e-11
    assert apart(chain, found.joints, joints[:, None]).min(axis=1).max() < 1e-9
    between = apart(chain, found.joints[:, :, None], found.joints[:, None])
    others = np.where(np.eye(form.branches, dtype=bool), np.inf, between)
    assert np.median(others.min(axis=(1, 2))) > 0.05  # all of them are different


@pytest.mark.parametrize("name", ["ur10", "ur, slanted"])
def test_three_parallel_axes_have_up_to_eight_solutions(name: str) -> None:
    count, chain, form = 2000, ALL[name], closed_form(ALL[name])
    joints = chain.random_joints(count, np.random.default_rng(2))
    Ts = flanges(chain, joints)
    found = form.solve(Ts)
    assert isinstance(form, ThreeParallel) and found.joints.shape == (count, 8, 6)
    reached = found.gap_m == 0
    assert reached.any(axis=1).all() and (reached.sum(axis=1) == 8).mean() > 0.4 and not found.free.any()
    assert np.abs(flanges(chain, found.joints) - Ts[:, None])[reached].max() < 1e-11
    assert apart(chain, found.joints, joints[:, None]).min(axis=1).max() < 1e-6  # near a double root


@pytest.mark.parametrize("name", ALL)
def test_signs_zeros_and_offsets_do_not_matter(name: str) -> None:
    rng = np.random.default_rng(4)
    for _ in range(5):
        chain = mixed(ALL[name], rng)
        joints = chain.random_joints(500, rng)
        Ts = flanges(chain, joints)
        found = closed_form(chain).solve(Ts)
        reached = found.gap_m == 0
        assert reached.any(axis=1).all() and reached.mean() > 0.7 and not found.tilt_rad.any()
        assert np.abs(flanges(chain, found.joints) - Ts[:, None])[reached].max() < 1e-11
        assert np.quantile(apart(chain, found.joints, joints[:, None]).min(axis=1), 0.99) < 1e-9
        assert apart(chain, found.joints, joints[:, None]).min(axis=1).max() < 1e-6  # near a double root


def test_other_arms_have_no_closed_form() -> None:
    for row, column in ((4, 2), (1, 3), (3, 3), (4, 3)):  # axes 5 and 6 do not meet; 2 and 3 not parallel; askew wrists
        table = IRB120.chain.table.copy()
        table[row, column] += 1e-4
        assert closed_form_of(IRB120.chain.with_table(table)) is None
    for name, row, column in (("versatran", 1, 3), ("versatran", 2, 3), ("stanford", 2, 3), ("scara", 2, 3)):
        table = ALL[name].table.copy()
        table[row, column] += 1e-4
        assert closed_form_of(ALL[name].with_table(table)) is None
    assert closed_form_of(load_robot("course2r").chain) is None


# Singularities


def solved_for(factor: Factor, joints: Array, joint: int, slides: bool) -> Array:
    """Readings at which a factor is zero, by changing one joint as little as can be; those where it can be."""
    there = np.repeat(joints[:, None], 3, axis=1)
    there[:, :, joint] = [0.0, 1.0, 2.0] if slides else [0.0, np.pi / 2, np.pi]
    first, second, third = factor.at(there).T
    found = joints.copy()
    if slides:
        found[:, joint] = first / (first - second)
        return found
    fixed, cosine = (first + third) / 2, (first - third) / 2
    (roots,), gap, _ = type_2(second - fixed, cosine, -fixed)
    found[:, joint] = np.where(np.abs(roots[0]) < np.abs(roots[1]), *roots)
    return found[gap == 0]


BY_JOINT = {"elbow": 2, "wrist": 4, "shoulder": 1, "slide": 2}  # which makes a factor zero
SINGULAR = [
    (name, factor.name, {("versatran", "shoulder"): 2, ("scara", "elbow"): 1}.get((name, factor.name)))
    for name in ("irb120", "rx130", "tx40", "scemi", "versatran", "scara", "stanford", "stanford, slanted", "ur10")
    for factor in closed_form(ALL[name]).determinant.factors
    if (name, factor.name) != ("stanford", "slide")  # where the shoulder's is zero too
]


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("name", "kind", "joint"), SINGULAR)
@pytest.mark.parametrize("away", [0.0, 1e-6])
def test_at_a_singularity_nothing_is_lost(name: str, kind: str, joint: int | None, away: float) -> None:
    chain, form, rng = ALL[name], closed_form(ALL[name]), np.random.default_rng(6)
    (factor,) = (each for each in form.determinant.factors if each.name == kind)
    by = BY_JOINT[kind] if joint is None else joint
    joints = solved_for(factor, chain.random_joints(1000, rng), by, chain.prismatic[by])
    assert len(joints) > 500
    joints = joints + rng.uniform(-away, away, joints.shape)
    assert np.abs(factor.at(joints)).max() <= 3 * away + 1e-14
    Ts = flanges(chain, joints)
    reference = chain.random_joints(len(joints), rng)
    found = form.solve(Ts, reference)
    assert np.isfinite(found.joints).all() and not found.tilt_rad.any()
    reached = found.gap_m == 0
    assert reached.all() if name in MODELS else reached.any(axis=1).all()  # the others have a wrist off its plane
    assert np.abs(flanges(chain, found.joints) - Ts[:, None])[reached].max() < 1e-11

    distance, leading = singular_distance(SerialArm(chain).tool(joints, SerialArm(chain).nominal())[1])
    assert distance.max() < 1e-5
    if (name, kind) not in (("tx40", "shoulder"), ("stanford, slanted", "shoulder")):
        assert kind == "shoulder" or (leading == by).mean() > 0.95
    free = (found.free & reached[:, :, None]).any(axis=1)
    if away == 1e-6:
        true = apart(chain, found.joints, joints[:, None]).min(axis=1) < 1e-5
        assert (true | free.any(axis=1)).mean() > 0.99  # at two singularities at once the pose does not say
    turning = {"wrist": 5 if isinstance(form, ThreeParallel) else 3, "shoulder": 0}.get(kind)
    if away == 0 and turning is not None and passes_through_axis_1(form, kind):
        assert free[:, turning].mean() > 0.2  # the rest is off by rounding
        picked = apart(chain, found.joints[..., [turning] * chain.size], reference[:, None, [turning] * chain.size])
        kept = picked[found.free[..., turning]] < 1e-12
        assert kept.mean() > 0.5 if isinstance(form, ThreeParallel) else kept.all()  # with others the arm is too short


def passes_through_axis_1(form: ClosedForm, kind: str) -> bool:
    """Whether joint 1 is free at the shoulder's singularity: where the wrist's centre comes onto its axis."""
    carrier = form.carrier if isinstance(form, SphericalWrist) else form
    return kind != "shoulder" or abs(getattr(carrier, "offset", 0.0)) < 1e-12


def test_two_equal_links_folded_back_leave_their_root_free() -> None:
    """The wrist's centre on axis 2, and, where that is on axis 1, anything goes for joints 1 and 2."""
    for name, folded in (("rx130", np.pi), ("scemi", np.pi / 2), ("scara, slide first", np.pi)):
        chain, rng, elbow = ALL[name], np.random.default_rng(7), 2
        joints = chain.random_joints(1000, rng)
        joints[:, elbow] = folded
        Ts, reference = flanges(chain, joints), chain.random_joints(1000, rng)
        found = closed_form(chain).solve(Ts, reference)
        assert not found.gap_m.any() and np.isfinite(found.joints).all()
        assert np.abs(flanges(chain, found.joints) - Ts[:, None]).max() < 1e-11
        assert found.free[:, :, elbow - 1].any(axis=1).mean() > 0.2


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
    found = closed_form(chain).solve(Ts)
    np.testing.assert_allclose(found.gap_m, 0.01, rtol=1e-9)
    back = flanges(chain, found.joints)
    np.testing.assert_allclose(back[..., :3, :3], np.broadcast_to(Ts[:, None, :3, :3], (500, 8, 3, 3)), atol=1e-12)
    assert np.linalg.norm(back[..., :3, 3] - Ts[:, None, :3, 3], axis=2).max() < 0.0105


def test_a_slide_that_passes_beside_its_axis_does_not_come_nearer() -> None:
    """The TX 40's 35 mm, and an arm whose slide passes 100 mm beside axis 1."""
    for name, beside in (("tx40", 0.035), ("versatran, off its axis", None)):
        chain, form = ALL[name], closed_form(ALL[name])
        assert isinstance(form, SphericalWrist)
        offset = beside or abs(form.carrier.middle.imag)
        Ts = flanges(chain, chain.random_joints(100, np.random.default_rng(8)))
        Ts[:, :2, 3] -= (Ts[:, :3, :3] @ form.centre + Ts[:, :3, 3])[:, :2]  # the wrist's centre onto axis 1
        if name == "tx40":
            Ts[:, 2, 3] += 0.2 - (Ts[:, :3, :3] @ form.centre + Ts[:, :3, 3])[:, 2]
        found = form.solve(Ts)
        np.testing.assert_allclose(found.gap_m, offset, rtol=1e-9)
        assert np.isfinite(found.joints).all()


@pytest.mark.parametrize("name", [name for name in ALL if name.startswith("scara")])
def test_a_tilt_is_out_of_reach_of_four_parallel_axes_and_told(name: str) -> None:
    chain, form, rng = ALL[name], closed_form(ALL[name]), np.random.default_rng(9)
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


# The determinant

TEXTS = {
    "irb120": "-0.27 (0.302 cos q3 + 0.07 sin q3) sin q5 (0.27 sin q2 + 0.07 sin(q2+q3) + 0.302 cos(q2+q3))",
    "rx130": "-0.625 * 0.625 sin q3 sin q5 (0.625 sin q2 + 0.625 sin(q2+q3))",
    "tx40": "-0.225 * 0.225 sin q3 sin q5 (0.225 sin q2 + 0.225 sin(q2+q3))",
    "scemi": "0.5 * 0.5 cos q3 sin q5 (0.5 cos q2 - 0.5 sin(q2+q3))",
    "versatran": "-q3 sin q5",
    "scara": "0.4 * 0.25 sin q2",
    "stanford": "q3 sin q5 q3 sin q2",
}


def by_jacobian(chain: Chain, joints: Array) -> Array:
    """det J at the wrist's centre; of a SCARA that of x, y, z and the turn about its axes."""
    form, arm = closed_form(chain), SerialArm(chain)
    at = form.wrist if isinstance(form, Scara) else form.centre
    _, jacobian = arm.tool(joints, arm.assemble(np.zeros(6), chain.table, at[None]))
    if not isinstance(form, Scara):
        return np.linalg.det(jacobian)
    turn = form.plane[2] @ jacobian[:, 3:]
    return np.linalg.det(np.concatenate([jacobian[:, :3], turn[:, None]], axis=1))


@pytest.mark.parametrize("name", ALL)
def test_the_determinant_is_that_of_the_jacobian_whatever_signs_and_zeros(name: str) -> None:
    rng = np.random.default_rng(11)
    for chain in (ALL[name], *(mixed(ALL[name], rng) for _ in range(5))):
        joints = rng.uniform(-3, 3, (500, chain.size))
        found = closed_form(chain).determinant
        expected = by_jacobian(chain, joints)
        np.testing.assert_allclose(found.at(joints), expected, atol=1e-12)
        assert np.abs(expected).max() > 1e-3
        product = found.sign * np.prod(found.lengths) * np.prod([each.at(joints) for each in found.factors], axis=0)
        np.testing.assert_allclose(product, expected, atol=1e-12)
        np.testing.assert_allclose(read(found.text, joints), expected, atol=1e-4)


def read(text: str, joints: Array) -> Array:
    """What a text says, as a person would take it."""
    text = re.sub(r"(sin|cos) (q\d)", r"\1(\2)", text)
    text = re.sub(r"(?<=[\w)]) (?=[\w(])", " * ", text)
    names = {f"q{i + 1}": joints[:, i] for i in range(joints.shape[1])}
    return eval(text, {"sin": np.sin, "cos": np.cos, **names})


def test_factors_have_names_and_the_joints_names() -> None:
    chain = replace(IRB120.chain, joint_names=("base", "arm_2", "arm 3", "a", "tilt", "b"))
    found = closed_form(chain).determinant
    assert [factor.name for factor in found.factors] == ["elbow", "wrist", "shoulder"]
    assert [factor.text for factor in found.factors] == [
        "0.302 cos arm 3 + 0.07 sin arm 3",
        "sin tilt",
        "0.27 sin arm_2 + 0.07 sin(arm_2+arm 3) + 0.302 cos(arm_2+arm 3)",
    ]
    assert [factor.name for factor in closed_form(STANFORD).determinant.factors] == ["slide", "wrist", "shoulder"]
    assert closed_form(STANFORD).determinant.text == TEXTS["stanford"]
