"""Mechanisms with loops: derivatives, other formulations of the same thing, what can be told apart, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import ROOT, RX130

from lab.calibration.identification import identify
from lab.calibration.weights import Noise
from lab.core.errors import LabError
from lab.core.measurements import measured
from lab.core.se3 import Array
from lab.formats.mechanism_toml import read_mechanism
from lab.kinematics.closed.closed_arm import ClosedArm
from lab.kinematics.closed.loop_closure import Frame, Rod, Step, Tree
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.effects.arm_with_effects import affected
from lab.kinematics.effects.coupling import gear
from lab.kinematics.gauge import base_set, base_set_of
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm, stacked

FILES = ("rpr2/mechanism", "rpr3/mechanism", "delta/mechanism", "delta/small", "delta/six_rods")


def described(name: str, targets: tuple[str, ...] = ("p1",)) -> tuple[ClosedArm, Array]:
    """An arm as drawn, and its parameters before a tracker."""
    file = read_mechanism(ROOT / "models" / f"{name}.toml")
    arm = ClosedArm(file.mechanism, targets)
    values = arm.nominal(file.tool)
    values[:6] = 0.4, -1.2, 0.9, 0.3, -0.2, 2.0
    return arm, values


def off(arm: ClosedArm, values: Array, rng: np.random.Generator, milli: float) -> Array:
    """An imperfect copy, off by so many mm and mrad."""
    return values + 1e-3 * milli * rng.standard_normal(len(values)) * (np.arange(len(values)) >= 6)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", FILES)
def test_the_derivatives_are_those_of_the_points(name: str) -> None:
    rng = np.random.default_rng(1)
    arm, values = described(name, ("p1", "p2"))
    values = off(arm, values, rng, 0.1)
    joints = arm.structure_joints(10, rng)
    points, jacobian = arm.observe(joints, values)
    np.testing.assert_array_equal(points, arm.points(joints, values))
    step = 1e-6
    for column, move in enumerate(step * np.eye(len(values))):
        slope = (arm.points(joints, values + move) - arm.points(joints, values - move)) / (2 * step)
        np.testing.assert_allclose(jacobian[..., column], slope, rtol=1e-6, atol=3e-8, err_msg=arm.names[column])
    Ts, twist = arm.tool(joints, values, 1)
    np.testing.assert_allclose(Ts[:, :3, 3], points[:, 1], rtol=0, atol=1e-15)
    np.testing.assert_allclose(twist[:, :3], arm.joint_derivatives(jacobian)[:, 1], rtol=0, atol=1e-12)
    for joint, move in enumerate(step * np.eye(arm.chain.size)):
        after, before = (arm.tool(joints + sign * move, values, 1)[0] for sign in (1, -1))
        turned = (after[:, :3, :3] - before[:, :3, :3]) / (2 * step) @ Ts[:, :3, :3].swapaxes(1, 2)
        found = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=1)
        np.testing.assert_allclose(twist[:, 3:, joint], found, rtol=1e-5, atol=1e-6)


def as_tree(chain: Chain) -> Mechanism:
    """A Craig chain as a mechanism without loops."""
    frames = []
    for i, (theta, d, a, alpha, beta) in enumerate(chain.table.tolist()):
        hayati = (Step("ry", beta),) if chain.parallel[i] else ()
        path = (Step("rx", alpha), Step("x", a), *hayati, Step("rz", theta, joint=i), Step("z", d))
        frames.append(Frame(f"body{i + 1}", i - 1, path))
    joints = {name: getattr(chain, name) for name in ("name", "joint_names", "prismatic", "sign", "lower", "upper")}
    unknown = np.full(chain.size, np.nan)
    tree = Tree(tuple(frames), (), (), chain.size - 1)
    return Mechanism(**joints, speed=unknown, acceleration=unknown, tree=tree)


def test_a_chain_is_a_mechanism_without_loops() -> None:
    """The same points and derivatives as the serial kernel's, column by column, and the same rank."""
    rng = np.random.default_rng(2)
    serial, tree = SerialArm(RX130, ("p1", "p2")), ClosedArm(as_tree(RX130), ("p1", "p2"))
    joints, values = RX130.random_joints(50, rng), serial.nominal()
    values[:6] = rng.standard_normal(6)
    words = {"rx": "alpha", "x": "a", "ry": "beta", "rz": "theta", "z": "d"}
    same = {
        name: serial.names.index(name if name in serial.names else f"link{name[4]}.{words[name.split('.')[1]]}")
        for name in tree.names
    }
    order = list(same.values())
    points, jacobian = serial.observe(joints, values)
    ours, slopes = tree.observe(joints, values[order])
    np.testing.assert_allclose(ours, points, rtol=0, atol=1e-14)
    np.testing.assert_allclose(slopes, jacobian[..., order], rtol=0, atol=1e-14)
    assert (
        len(base_set(tree, values[order]).identifiable) == len(base_set(serial, values).identifiable) == 30
    )  # of two targets


RANKS = [  # facts, section 5: of the parameters that are not held
    ("rpr2/mechanism", ("p1",), ("base.z", "base.rx", "base.ry", "tool.*"), True, 8, 11),
    ("rpr3/mechanism", ("p1", "p2", "p3"), ("base.*", "tool.*"), False, 15, 15),
    ("rpr3/mechanism", ("p1",), ("base.*", "tool.*"), False, 14, 15),
    ("delta/mechanism", ("p1",), ("tool.*",), False, 24, 39),
    ("delta/six_rods", ("p1",), ("tool.*",), False, 38, 60),
]


@pytest.mark.parametrize(("name", "targets", "held", "gains", "rank", "count"), RANKS)
def test_the_ranks_are_found_unaided(
    name: str, targets: tuple[str, ...], held: tuple[str, ...], gains: bool, rank: int, count: int
) -> None:
    arm, values = described(name, targets)
    values[:6] = 0.0  # so that the base's x, y and rz are those of the plane
    whole = affected(arm, [gear(arm.chain)] if gains else [])
    asked = [i for i, n in enumerate(whole.names) if not any(n.startswith(h.rstrip("*")) for h in held)]
    inputs = whole.structure_joints(200, np.random.default_rng(0))
    _, jacobian = whole.observe(inputs, np.concatenate([values, np.zeros(len(whole.names) - len(values))]))
    found = base_set_of(jacobian.reshape(-1, len(whole.names))[:, asked], range(count))
    assert len(asked) == count and len(found.identifiable) == rank


def test_where_a_wrist_is_is_hidden_in_where_its_arm_is() -> None:
    """The platform never turns: a wrist that is off by a vector looks like an arm that is off by its opposite."""
    arm, values = described("delta/mechanism")
    found = base_set(arm, values)
    for axis in "xyz":
        hidden = found.alias[:, found.fixed.index(arm.names.index(f"wrist2.{axis}"))]
        strong = {arm.names[i]: part for i, part in zip(found.identifiable, hidden, strict=True) if abs(part) > 1e-9}
        assert strong[f"arm2.{axis}"] == pytest.approx(-1, abs=1e-9)


@pytest.mark.parametrize("name", ["rpr3/mechanism", pytest.param("delta/small", marks=pytest.mark.thorough)])
def test_without_noise_an_imperfect_copy_is_found_to_rounding(name: str) -> None:
    rng = np.random.default_rng(0)
    arm, nominal = described(name)
    true = off(arm, nominal, rng, 0.5)
    joints, fresh = arm.structure_joints(60, rng), arm.structure_joints(300, rng)
    data = measured(arm.chain.joint_names, joints, arm.targets, arm.points(joints, true))
    found = identify(arm, data, nominal, Noise(None, 1e-9))
    missed = np.abs(arm.points(fresh, found.values) - arm.points(fresh, true))
    assert found.status == "converged" and np.nanmax(missed) < 1e-12
    assert np.isfinite(missed).all(axis=(1, 2)).mean() > 0.99


def test_many_copies_at_once_are_what_each_is_alone() -> None:
    arm, values = described("delta/small")
    rng = np.random.default_rng(4)
    joints, copies = arm.structure_joints(7, rng), np.stack([off(arm, values, rng, 0.3) for _ in range(3)])
    free = (7, 0, 33, 20)
    points, jacobian = stacked(arm).observe(joints, copies, free)
    np.testing.assert_array_equal(points, stacked(arm).points(joints, copies))
    for i, copy in enumerate(copies):
        alone, slopes = arm.observe(joints, copy)
        np.testing.assert_array_equal(points[i], alone.transpose(1, 2, 0))
        np.testing.assert_array_equal(jacobian[:, :, :, i], slopes[..., list(free)].transpose(3, 2, 1, 0))


def test_readings_that_close_nothing_are_nan_and_said() -> None:
    arm, values = described("rpr2/mechanism")
    joints = np.array([[0.4, 0.5], [0.2, 0.3], [0.3, 0.3], [0.5, 0.4]])  # the second too short, the third in line
    points, jacobian = arm.observe(joints, values)
    lost = np.array([False, True, True, False])
    np.testing.assert_array_equal(np.isnan(points).all(axis=(1, 2)), lost)
    np.testing.assert_array_equal(np.isnan(jacobian).any(axis=(1, 2, 3)), lost)
    np.testing.assert_array_equal(arm.chain.is_assemblable(joints), ~lost)
    assert "cannot meet" in arm.chain.infeasibility_reason(
        joints[1]
    ) and "mm stay open" in arm.chain.infeasibility_reason(joints[1])
    assert "singular" in arm.chain.infeasibility_reason(joints[2]) and arm.chain.infeasibility_reason(joints[0]) == ""


def test_a_pose_that_cannot_be_is_told_by_the_fit() -> None:
    arm, values = described("rpr2/mechanism")
    joints = np.array([*arm.structure_joints(20, np.random.default_rng(5)), [0.2, 0.3]])
    data = measured(arm.chain.joint_names, joints, arm.targets, np.nan_to_num(arm.points(joints, values)))
    with pytest.raises(LabError, match="1 of 21 measured poses are impossible for the nominal robot"):
        identify(arm, data, values)


def test_closures_that_do_not_count_up_are_refused_with_the_mobility() -> None:
    drawn = described("delta/mechanism")[0].chain
    with pytest.raises(LabError, match="mobility is 4,"):
        replace(drawn, tree=replace(drawn.tree, rods=drawn.tree.rods[:2]))
    with pytest.raises(LabError, match="mobility is 2,"):
        replace(drawn, tree=replace(drawn.tree, rods=(*drawn.tree.rods, Rod("more", (0, 6), 1.0))))
    with pytest.raises(LabError, match=r"in the nominal position \(.*\) rod"):
        rods = (replace(drawn.tree.rods[0], length_m=5.0), *drawn.tree.rods[1:])
        replace(drawn, tree=replace(drawn.tree, rods=rods)).refuse_open()
