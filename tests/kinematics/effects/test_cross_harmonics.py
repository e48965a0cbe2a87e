"""Harmonics of one joint's turn in another joint's frame: their derivatives, and that a search finds them."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import IRB120, SCARA

import lab
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.kinematics.effects.effect import ArmFacts
from lab.kinematics.effects.effect_registry import describe_term, effect, searched_terms
from lab.kinematics.effects.harmonics import CROSS_FAMILIES, CrossHarmonics
from lab.kinematics.gauge import base_set

FACTS = ArmFacts(IRB120.chain, IRB120.loads)
CROSSED = [name for name in searched_terms(FACTS) if "cross" in name]
SIGMA_M = 8e-6
_JOINTS = IRB120.chain.random_joints(40, np.random.default_rng(0))
_SIZE = 3e-4


def session(seed: int, group: str, size: float, poses: int = 80) -> tuple[Measurements, Measurements]:
    """Measurements of an arm off by usual tolerances that has one such group, and exact points elsewhere."""
    rng = np.random.default_rng(seed)
    arm, rigid = IRB120.arm_with(("p1",), [group]), IRB120.arm(("p1",))
    values = np.zeros(len(arm.names))
    values[: len(rigid.names)] = rigid.nominal(IRB120.tool)
    values[list(base_set(rigid, values[: len(rigid.names)]).identifiable)] += 5e-4 * rng.normal(size=27)
    phase = rng.uniform(0, 2 * np.pi)
    values[len(rigid.names) :] = size * np.sin(phase), size * np.cos(phase)
    found = []
    for count, sigma_m in ((poses, SIGMA_M), (100, 0.0)):
        joints = IRB120.chain.random_joints(count, rng)
        points = arm.points(joints, values) + sigma_m * rng.normal(size=(count, 1, 3))
        found.append(replace(measured(IRB120.chain.joint_names, joints, ("p1",), points), robot="irb120"))
    return found[0], found[1]


@pytest.mark.sampled(8)
@pytest.mark.parametrize("name", CROSSED)
def test_points_move_as_the_derivatives_say(name: str) -> None:
    arm = IRB120.arm_with(("p1", "p2"), [name])
    rng = np.random.default_rng(0)
    values = 1e-3 * rng.normal(size=len(arm.names))
    values += np.array([*IRB120.arm(("p1", "p2")).nominal(IRB120.tool), 0.0, 0.0])
    joints = IRB120.chain.random_joints(5, rng)
    jacobian = arm.observe(joints, values)[1]
    for i in (-2, -1):
        step = 1e-6 * (np.arange(len(values)) == len(values) + i)
        slope = (arm.points(joints, values + step) - arm.points(joints, values - step)) / 2e-6
        assert np.allclose(slope, jacobian[..., i], atol=1e-8) and np.abs(slope).max() > 1e-6
    assert describe_term(name)


@pytest.mark.parametrize(
    ("group", "dimension"),
    [("link3.x_cross6", "link3.a"), ("link5.rx_cross2", "link5.alpha"), ("link4.z_cross1", "link4.d")],
)
def test_a_links_end_moves_as_a_dimension_that_changes_from_pose_to_pose(group: str, dimension: str) -> None:
    arm = IRB120.arm(("p1",))
    nominal, other = arm.nominal(IRB120.tool), int(group[-1]) - 1
    moved = IRB120.arm_with(("p1",), [group]).points(_JOINTS, np.append(nominal, [_SIZE, -_SIZE / 2]))
    waves = _SIZE * np.sin(_JOINTS[:, other]) - _SIZE / 2 * np.cos(_JOINTS[:, other])
    for joints, wave, point in zip(_JOINTS, waves, moved, strict=True):
        values = nominal.copy()
        values[arm.names.index(dimension)] += wave
        np.testing.assert_allclose(arm.points(joints[None], values)[0], point, atol=1e-13)


def test_a_joint_moves_with_the_turn_of_another_one() -> None:
    arm = IRB120.arm(("p1",))
    nominal, joints = arm.nominal(IRB120.tool), _JOINTS.copy()
    moved = IRB120.arm_with(("p1",), ["joint2.cross6"]).points(_JOINTS, np.append(nominal, [_SIZE, _SIZE / 3]))
    joints[:, 1] += _SIZE * np.sin(_JOINTS[:, 5]) + _SIZE / 3 * np.cos(_JOINTS[:, 5])
    np.testing.assert_allclose(moved, arm.points(joints, nominal), atol=1e-13)


@pytest.mark.parametrize(("link", "other"), [(0, 1), (1, 5), (2, 3), (3, 0), (4, 1), (5, 3)])
def test_groups_span_every_displacement_of_a_frame(link: int, other: int) -> None:
    """Any shift and turn of a link's end, with sine and cosine of a joint, is a sum of groups and geometry."""
    arm = IRB120.arm(("p1", "p2", "p3"))
    joints = IRB120.chain.random_joints(150, np.random.default_rng(2))
    nominal = arm.nominal(IRB120.tool)
    torsor = arm.observe(joints, nominal, {link: np.zeros((150, 6))})[1][..., len(arm.names) :]
    waves = np.stack([np.sin(joints[:, other]), np.cos(joints[:, other])], axis=1)
    wanted = (torsor[..., None] * waves[:, None, None, None]).reshape(-1, 12)
    groups = [name for name in searched_terms(ArmFacts(IRB120.chain)) if name.endswith(f"cross{other + 1}")]
    groups.append(f"joint{other + 1}.harmonic1")
    with_groups = IRB120.arm_with(arm.targets, groups)
    columns = with_groups.observe(joints, with_groups.nominal(IRB120.tool))[1].reshape(-1, len(with_groups.names))
    solution = np.linalg.lstsq(columns, wanted, rcond=1e-12)[0]
    assert np.abs(columns @ solution - wanted).max() < 1e-9


def test_a_joint_is_not_crossed_by_itself_nor_by_a_slide() -> None:
    for name in ("joint2.cross2", "joint2.cross9", "link2.y_cross3", "link1.ry_cross2"):
        with pytest.raises(LabError, match="--model"):
            effect(name, IRB120.chain, IRB120.loads)
    scara = ArmFacts(SCARA, None)
    names = [name for family in CROSS_FAMILIES for name in (family.name(*pair) for pair in family.searched(scara))]
    slides = [i + 1 for i, slide in enumerate(SCARA.prismatic) if slide]
    assert names and not [name for name in names if name.endswith(tuple(f"cross{i}" for i in slides))]


@pytest.mark.thorough
@pytest.mark.parametrize("group", ["joint2.cross6", "link5.rx_cross4"])
def test_auto_finds_it_and_the_error_falls_to_the_noise(group: str) -> None:
    data, elsewhere = session(0, group, 0.4e-3)
    alone, found = (
        lab.identify(data, robot="irb120", model=model, validate=elsewhere) for model in ("geometric", "auto")
    )
    assert any("cross" in name for name in found.state.groups), found.state.groups
    assert found.after.mean < 0.015 and alone.after.mean > 2 * found.after.mean
    assert alone.verdict.word != "good"


def test_a_virtual_arm_has_it_only_where_it_is_asked_for() -> None:
    rngs = [np.random.default_rng(0)]
    assert not CrossHarmonics().simulated(FACTS, rngs).cross_rad.any()
    drawn = CrossHarmonics(0.3).simulated(FACTS, rngs).cross_rad
    assert np.allclose(np.linalg.norm(drawn, axis=2).max(axis=1), 0.3e-3) and not np.diagonal(drawn).any()
