"""``calibrated.py``: plain Python that puts the points where the lab's own arm does, whatever the effects."""

import ast
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.bare_python import bare_python
from helpers.robots import perturbed, somewhere

from lab.calibration.residual.gaussian_process import COMPONENTS, JointProcess
from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.calibrated_module import largest_difference, loaded, module_text, plain_model, refusing_text
from lab.formats.plain_arm import place
from lab.kinematics.effects.arm_with_effects import ArmWithEffects
from lab.kinematics.effects.effect import Effect
from lab.kinematics.effects.effect_registry import CAMPAIGN_SPECIFIC, GROUPS
from lab.kinematics.parameter import joint_parameter
from lab.robots.load_robot import load_virtual

TURN = se3.exp(np.array([0.1, -0.4, 0.2]))  # of the measured tool in the last frame
CASES = {
    "everything of joints": (
        "irb120",
        ("payload", "hardening", "coupling", "gear", "harmonics", "backlash", "hysteresis", "compensator",
         "expansion", "thermal_zeros", "joint2.harmonic20", "joint3.coupling5", "joint2.cross6", "joint2.gravity3"),
    ),
    "links that bend and move": (
        "irb120",
        ("compliance", "bending", "torsion", "extension", "link3.x_cross1", "link6.y_cross2", "link6.ry_cross3",
         "joint4.backlash"),
    ),
    "a craig table": ("ur10", ("compliance", "bending", "link6.ry_cross2", "link2.z_cross3", "gear")),
    "tubes": ("rx130", ("tubes", "compliance")),
    "seven joints": ("panda", ("gear", "joint2.gravity2", "joint3.gravity5", "harmonics2")),
    "a slide": ("scara", ("compliance", "hardening", "bending", "backlash")),
    "two slides": ("versatran", ("compliance", "gear", "hardening", "thermal_zeros")),
}  # fmt: skip


def arm_with(robot: str, groups: Sequence[str], *, process: bool = False) -> tuple[ArmWithEffects, Array, dict]:
    """An arm that is off in every parameter, with effects of usual sizes; its values, and the module's numbers."""
    loaded_robot, rng = load_virtual(robot), np.random.default_rng(4)
    arm = loaded_robot.arm_with(("p1", "p2"), groups)
    if process:
        chain, n = arm.rigid.chain, 30
        inputs, weights = chain.random_joints(n, rng), rng.normal(size=(n, chain.size))
        c = len(COMPONENTS)
        variances = rng.uniform(0.1, 1.0, c) * 1e-4
        arm = JointProcess(
            inputs, np.ones((n, 2), dtype=bool), variances, np.eye(c), weights, ~np.array(chain.prismatic), 0.0
        ).added_to(arm)
    first = len(arm.rigid.names)
    values = np.zeros(len(arm.names))
    values[:first] = perturbed(arm.rigid, somewhere(arm.rigid, rng), rng, 0.5e-3, 1.5e-3)
    values[first:] = [0.3 * each.scale * rng.normal() for each in arm.parameters[first:]]
    return arm, values, plain_model(arm, values, loaded_robot.loads, TURN, {"payload_kg": 0.5})


def inputs_of(arm: ArmWithEffects, count: int) -> Array:
    return arm.structure_joints(count, np.random.default_rng(8))


QUICK = ("everything of joints", "a craig table")


@pytest.mark.parametrize("case", [c if c in QUICK else pytest.param(c, marks=pytest.mark.thorough) for c in CASES])
def test_it_puts_the_points_where_the_arm_does(case: str) -> None:
    arm, values, model = arm_with(*CASES[case])
    inputs = inputs_of(arm, 8)
    assert largest_difference(module_text("t", "a", "f", model), arm, values, inputs) < 1e-13
    rigid = arm.rigid.points(inputs[:, : arm.rigid.chain.size], values[: len(arm.rigid.names)])
    assert np.abs(arm.points(inputs, values) - rigid).max() > 1e-5  # its effects are no small matter


@pytest.mark.parametrize("case", ["everything of joints", "links that bend and move"])
def test_each_effect_is_told(case: str) -> None:
    """Without one of them the points are elsewhere."""
    arm, _, model = arm_with(*CASES[case])
    size = arm.rigid.chain.size
    row = inputs_of(arm, 1)[0] + 0.1  # no approach is zero
    joints, given = row[:size].tolist(), dict(zip(arm.conditions, row[size:].tolist(), strict=True))
    whole = np.array(list(place(model, joints, given)[1].values()))
    for k, term in enumerate(model["terms"]):
        terms = [*model["terms"][:k], *model["terms"][k + 1 :]]
        without = np.array(list(place({**model, "terms": terms}, joints, given)[1].values()))
        assert np.abs(whole - without).max() > 1e-9, term


def test_every_lasting_group_is_in_the_cases() -> None:
    tried = {name for _, groups in CASES.values() for name in groups}
    of_its_own = {"compliance", "payload"}  # one or the other
    assert set(GROUPS) - set(CAMPAIGN_SPECIFIC) <= tried | of_its_own


def test_it_has_offsets_that_no_group_explains() -> None:
    arm, values, model = arm_with("irb120", ("backlash",), process=True)
    text = module_text("t", "a", "f", model)
    inputs = inputs_of(arm, 6)
    assert largest_difference(text, arm, values, inputs) < 1e-13
    bare = {**model, "terms": [term for term in model["terms"] if "residual" not in term]}
    assert largest_difference(module_text("t", "a", "f", bare), arm, values, inputs) > 1e-5


def test_a_bare_python_runs_it(tmp_path) -> None:
    arm, values, model = arm_with(*CASES["everything of joints"])
    (tmp_path / "calibrated.py").write_text(module_text('t """ \\', "a", "f", model), encoding="utf-8")
    inputs, size = inputs_of(arm, 20), arm.rigid.chain.size
    conditions = dict(zip(arm.conditions, inputs[:, size:].T.tolist(), strict=True))
    ast.parse((tmp_path / "calibrated.py").read_text(encoding="utf-8"), feature_version=(3, 8))
    rows = bare_python(tmp_path, inputs[:, :size], conditions)
    points = np.array([[row[target] for target in arm.targets] for row in rows])
    np.testing.assert_allclose(points, arm.points(inputs, values), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "case",
    [
        "links that bend and move",
        *(pytest.param(c, marks=pytest.mark.thorough) for c in ("everything of joints", "seven joints")),
    ],
)
def test_the_inverse_leads_back_to_the_pose(case: str) -> None:
    arm, values, model = arm_with(*CASES[case])
    module, rng, size = loaded(module_text("t", "a", "f", model)), np.random.default_rng(2), arm.rigid.chain.size
    inputs = inputs_of(arm, 6)
    middle = (arm.rigid.chain.lower + arm.rigid.chain.upper) / 2
    inputs[:, :size] = middle + 0.6 * (inputs[:, :size] - middle)
    last, _ = arm.tool(inputs, values, 1)  # axes of the last frame, at the point
    for row, T in zip(inputs, last, strict=True):
        given = dict(zip(arm.conditions, row[size:].tolist(), strict=True))
        wanted = se3.pose(T[:3, :3] @ TURN, T[:3, 3])
        near = (row[:size] + 0.05 * rng.normal(size=size)).tolist()
        joints = module.inverse(wanted.tolist(), near, point="p2", **given)
        pose, points = module.forward(joints, **given)
        np.testing.assert_allclose(points["p2"], T[:3, 3], rtol=0, atol=1e-9)
        np.testing.assert_allclose(np.array(pose)[:3, :3], T[:3, :3], rtol=0, atol=1e-9)
        again = module.inverse(pose, near, **given)  # of the last frame
        if size == 6:
            np.testing.assert_allclose(joints, row[:size], rtol=0, atol=1e-8)
            np.testing.assert_allclose(again, row[:size], rtol=0, atol=1e-8)


def test_a_pose_in_the_base_is_that_without_the_base() -> None:
    arm, values, model = arm_with("irb120", ())
    module, joints = loaded(module_text("t", "a", "f", model)), [0.1, 0.2, -0.3, 0.4, 0.5, 0.6]
    there = values.copy()
    there[:6] = 0.0
    in_base = module.to_base(module.forward(joints)[0])
    np.testing.assert_allclose(in_base, arm.rigid.flange(np.array([joints]), there)[0], rtol=0, atol=1e-14)


def test_it_says_what_it_cannot_do() -> None:
    arm, _, model = arm_with(*CASES["a slide"])
    module = loaded(module_text("t", "a", "f", model))
    zero = [0.0] * arm.rigid.chain.size
    usual = {name: 0.0 for name in arm.conditions if name != "payload_kg"}
    assert module.forward(zero, **usual) == module.forward(zero, payload_kg=0.5, **usual)
    with pytest.raises(TypeError, match="approach_q"):
        module.forward(zero)
    with pytest.raises(TypeError, match="humidity"):
        module.forward(zero, humidity=1.0, **usual)
    with pytest.raises(ValueError, match="finite positions"):
        module.forward(zero[1:], **usual)
    T = np.array(module.forward(zero, **usual)[0])
    with pytest.raises(ValueError, match="not reached"):  # four joints do not tip the tool
        module.inverse((T @ se3.pose(se3.exp(np.array([0.5, 0, 0])), np.zeros(3))).tolist(), zero, **usual)
    with pytest.raises(ValueError, match="not a rotation"):
        module.inverse((2 * T).tolist(), zero, **usual)
    with pytest.raises(ValueError, match="was not measured"):
        module.inverse(T.tolist(), zero, point="p9", **usual)


def test_what_cannot_be_written_down_makes_a_module_that_refuses() -> None:
    robot = load_virtual("irb120")
    arm = robot.arm_with(("p1",), ("gear",))
    strange = replace(arm, effects=(replace(arm.effects[0], terms=None),))
    with pytest.raises(LabError, match="effect gear"):
        plain_model(strange, strange.nominal(), robot.loads, np.eye(3), {})
    delta = load_virtual("delta").arm(("p1",))
    with pytest.raises(LabError, match="loops"):
        plain_model(delta, delta.nominal(), None, np.eye(3), {})
    module = loaded(refusing_text("t", "a", "it has loops"))
    assert "it has loops" in module.__doc__
    for refused in (lambda: module.forward([0.0]), lambda: module.inverse(np.eye(4).tolist(), [0.0])):
        with pytest.raises(NotImplementedError, match="it has loops"):
            refused()


ALONE = sorted(set(GROUPS) - set(CAMPAIGN_SPECIFIC))
ELSEWHERE = {"tubes": "rx130"}  # which the usual arm cannot have


@pytest.mark.parametrize("group", ALONE)
def test_each_effect_alone_is_where_the_arm_puts_it(group: str) -> None:
    arm, values, model = arm_with(ELSEWHERE.get(group, "irb120"), (group,))
    inputs = inputs_of(arm, 3)
    assert largest_difference(module_text("t", "a", "f", model), arm, values, inputs) < 1e-13
    assert model["terms"] and not any("call" in term for term in model["terms"])


def plain_warm(joints, conditions, values):
    """Joints that turn with the oil's temperature, and with the sine of their neighbour."""
    warm = conditions[0] - 20.0
    return [value * warm + value * math.sin(joints[i - 1]) for i, value in enumerate(values)]


def plain_bend(joints, conditions, values):
    """Far ends of links 2 and 4 that move by the first joint's cosine."""
    along = [0.0] * 12
    along[2], along[9] = values[0] * math.cos(joints[0]), values[1] * math.cos(joints[0])
    return along


def plain_growth(joints, conditions, values):
    """Growth by the square of one parameter."""
    return [values[0] ** 2]


def own_effect(moves: str, plain: Callable[..., Any] | None) -> Effect:
    """An effect of one's own on joints, two links, or the size of six-axis arms."""

    def warm(joints: Array, conditions: Array, values: Array) -> tuple[Array, Array]:
        columns = conditions - 20.0 + np.sin(np.roll(joints, 1, axis=1))
        return columns * values, columns[:, :, None] * np.eye(6)

    def bend(joints: Array, _: Array, values: Array) -> tuple[Array, Array]:
        derivative = np.zeros((len(joints), 12, 2))
        derivative[:, 2, 0] = derivative[:, 9, 1] = np.cos(joints[:, 0])
        return derivative @ values, derivative

    def growth(joints: Array, _: Array, values: Array) -> tuple[Array, Array]:
        return np.full((len(joints), 1), values[0] ** 2), np.full((len(joints), 1, 1), 2 * values[0])

    names = tuple(joint_parameter("own", axis, "own") for axis in range({"joints": 6, "links": 2, "size": 1}[moves]))
    offsets = {"joints": warm, "links": bend, "size": growth}[moves]
    conditions = ("oil_C",) if moves == "joints" else ()
    links = (1, 3) if moves == "links" else ()
    return Effect("own", names, offsets, conditions, moves, links=links, plain=plain)  # type: ignore[arg-type]


@pytest.mark.parametrize("plain", [plain_warm, plain_bend, plain_growth])
def test_an_effect_of_one_s_own_exports_itself(plain: Callable[..., Any], tmp_path: Path) -> None:
    """Beside one of the lab's; a Python without packages runs it."""
    moves = {plain_warm: "joints", plain_bend: "links", plain_growth: "size"}[plain]
    given, values, _ = arm_with("irb120", ("backlash",))
    arm = replace(given, effects=(own_effect(moves, plain), *given.effects))
    first, own = len(given.rigid.names), len(arm.effects[0].parameters)
    values = np.concatenate([values[:first], 1e-3 * np.arange(1, own + 1), values[first:]])
    model = plain_model(arm, values, None, TURN, {})
    text, inputs = module_text("t", "a", "f", model), inputs_of(arm, 6)
    assert largest_difference(text, arm, values, inputs) < 1e-13
    without = {**model, "terms": [term for term in model["terms"] if "call" not in term]}
    assert largest_difference(module_text("t", "a", "f", without), arm, values, inputs) > 1e-7
    (tmp_path / "calibrated.py").write_text(text, encoding="utf-8")
    conditions = dict(zip(arm.conditions, inputs[:, 6:].T.tolist(), strict=True))
    rows = bare_python(tmp_path, inputs[:, :6], conditions)
    points = np.array([[row[target] for target in arm.targets] for row in rows])
    np.testing.assert_allclose(points, arm.points(inputs, values), rtol=0, atol=1e-12)


OIL_C = 20.0


def plain_by_constant(joints, conditions, values):
    return [value * (conditions[0] - OIL_C) for value in values]


def plain_of_one(joints, conditions, values):
    return values[:1]


def plain_wrong(joints, conditions, values):
    return [2.0 * value * (conditions[0] - 20.0) for value in values]


REFUSED: dict[str, tuple[Callable[..., Any] | None, str]] = {
    "none": (None, "effect own cannot be written as plain Python: it gives no function plain"),
    "lambda": (lambda joints, conditions, values: values, "plain is no function that def makes"),
    "built in": (math.hypot, "plain has no text to copy"),
    "a constant of its module": (plain_by_constant, "plain raises NameError: name 'OIL_C' is not defined"),
    "another number of offsets": (plain_of_one, r"plain returns offsets of shape \(8, 1\); return shape \(8, 6\)"),
    "other numbers": (plain_wrong, "plain returns other numbers than offsets"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_an_effect_that_cannot_be_exported_is_named(name: str) -> None:
    plain, message = REFUSED[name]
    given, values, _ = arm_with("irb120", ())
    arm = ArmWithEffects(given.rigid, (own_effect("joints", plain),))
    with pytest.raises(LabError, match=message) as refused:
        plain_model(arm, np.concatenate([values, np.full(6, 1e-3)]), None, TURN, {})
    assert "own" in str(refused.value) and "\n" not in str(refused.value)
