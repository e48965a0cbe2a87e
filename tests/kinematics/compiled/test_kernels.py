"""Machine code does what numpy does, to rounding, and numpy does it alone where there is no machine code."""

import importlib
import importlib.util
import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from helpers.robots import ROOT, chain_of

from lab.core import se3
from lab.extensions.robotics.inverse.first_joints import ThreeJoints
from lab.extensions.robotics.inverse.five_axes import FiveAxes
from lab.extensions.robotics.inverse.six_axes import SphericalWrist, ThreeParallel
from lab.kinematics.compiled import kernels
from lab.kinematics.inverse.closed_form import Solutions
from lab.kinematics.inverse.newton_inverse import PoseTarget, reach
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm, StackedArm
from lab.robots.load_robot import load_robot
from lab.sensors.full_pose import Poses

ROUNDING = 1e-14  # m, rad or their quotients: of some dozens of products of numbers of about one

compiled = pytest.mark.skipif(not kernels.compiled(), reason="built without a C compiler")


@contextmanager
def numpy_alone(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Have numpy do all, as where there is no compiler."""
    with monkeypatch.context() as without:
        without.setattr(kernels, "_CODE", None)
        assert not kernels.compiled()
        yield


def some(arm: SerialArm, poses: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Joint positions, and parameters of an arm that stands anywhere."""
    values = arm.nominal() + 0.01 * rng.standard_normal(len(arm.names))
    values[3:6] = rng.standard_normal(3)
    return arm.chain.random_joints(poses, rng), values


@compiled
@pytest.mark.parametrize("name", ["irb120", "rx130", "scara", "course2r", "versatran"])  # distal, Craig, slides, betas
@pytest.mark.parametrize("poses", [0, 1, 32, 2100])  # none, one, a block, more than numpy takes at a time
def test_every_walk_is_that_of_numpy(name: str, poses: int, monkeypatch: pytest.MonkeyPatch) -> None:
    arm = load_robot(name).serial_arm(("p1", "p3"))
    joints, values = some(arm, poses, np.random.default_rng(poses))

    def walked(at: np.ndarray) -> list[np.ndarray]:
        moved = arm.joint_jacobian(at, values)
        return [arm.points(at, values), *arm.observe(at, values), *arm.tool(at, values, 1), moved]

    found = walked(np.concatenate([joints, joints], axis=1)[:, : joints.shape[1]])  # not contiguous
    with numpy_alone(monkeypatch):
        expected = walked(joints)
    for here, there in zip(found, expected, strict=True):
        assert here.shape == there.shape
        assert np.abs(here - there).max(initial=0.0) < ROUNDING


@compiled
@pytest.mark.parametrize("name", ["irb120", "rx130", "scara", "versatran"])
def test_oriented_poses_are_those_of_numpy(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With orientations that are missed by nothing, by little and by half a turn, in quaternions of any length."""
    model, rng = Poses(load_robot(name).serial_arm(("p1", "p3")), "p1", 1.0), np.random.default_rng(5)
    joints, values = some(model.arm, 90, rng)
    values = np.append(values, rng.standard_normal(3))
    predicted = model.arm.flange(joints, values[:-3])[:, :3, :3] @ se3.exp(values[-3:])
    off = rng.choice([0.0, 1e-5, 1e-3, 1.0, 3.14], (90, 1)) * unit(rng.standard_normal((90, 3)))
    quaternions = rng.uniform(-2, 2, (90, 1)) * se3.quaternion_from_rotation(predicted @ se3.exp(off))
    inputs = np.concatenate([joints, quaternions], axis=1)
    found = [model.points(inputs, values), *model.observe(inputs, values)]
    with numpy_alone(monkeypatch):
        expected = [model.points(inputs, values), *model.observe(inputs, values)]
    for here, there in zip(found, expected, strict=True):
        assert np.abs(here - there).max() < 10 * ROUNDING


def unit(vectors: np.ndarray) -> np.ndarray:
    """Of length one."""
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@compiled
@pytest.mark.parametrize(("name", "poses"), [("irb120", 90), ("irb120", 0), ("rx130", 40)])
def test_newtons_method_is_that_of_numpy(name: str, poses: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of targets with and without a rotation, from near and from so far that steps are damped."""
    arm, rng = load_robot(name).serial_arm(("p1", "p2")), np.random.default_rng(3)
    joints, values = some(arm, poses, rng)
    Ts = arm.tool(joints, values, 1)[0]
    rotations = np.where(rng.random((poses, 1, 1)) < 0.5, Ts[:, :3, :3], np.nan)
    wanted, far = PoseTarget(Ts[:, :3, 3], rotations), rng.choice([0.02, 1.0], (poses, 1))
    start = joints + far * rng.uniform(-1, 1, joints.shape)
    found = reach(arm, values, wanted, start, np.empty((poses, 0)), 1)
    with numpy_alone(monkeypatch):
        expected = reach(arm, values, wanted, start, np.empty((poses, 0)), 1)
    same = (found.steps == expected.steps) & (np.abs(found.joints - expected.joints).max(axis=1, initial=0.0) < 1e-7)
    assert same.all() if not poses else same.mean() > 0.9 and same[far[:, 0] < 1].all()
    assert (found.arrived == expected.arrived)[same].all() and found.errors.shape == (poses, 6)
    assert expected.steps.max(initial=0) > 8 or not poses


@compiled
@pytest.mark.parametrize("own", [False, True])
def test_many_arms_walk_as_numpy_does(own: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    arms = StackedArm(load_robot("irb120").serial_arm(("p1", "p2")))
    joints, values = some(arms.arm, 35, np.random.default_rng(1))
    many, free = values + 0.01 * np.random.default_rng(2).standard_normal((4, len(values))), [3, 0, 9, 31, 36]
    joints = np.stack([joints + 0.1 * i for i in range(4)]) if own else joints
    found = [*arms.observe(joints, many, free), arms.points(joints, many)]
    with numpy_alone(monkeypatch):
        expected = [*arms.observe(joints, many, free), arms.points(joints, many)]
    for here, there in zip(found, expected, strict=True):
        assert here.shape == there.shape
        assert np.abs(here - there).max() < ROUNDING


@compiled
def test_a_complex_step_and_elastic_links_are_left_to_numpy() -> None:
    arm = load_robot("irb120").serial_arm(("p1",))
    joints, values = some(arm, 3, np.random.default_rng(0))
    step = values + 1e-30j * np.eye(len(values))[7]
    assert np.abs(arm.points(joints, step).imag / 1e-30 - arm.observe(joints, values)[1][..., 7]).max() < ROUNDING
    bent = {0: np.zeros((3, 6))}
    assert arm.observe(joints, values, bent)[1].shape[3] == len(values) + 6


@compiled
def test_arrays_that_do_not_belong_together_are_refused() -> None:
    arm = load_robot("irb120").serial_arm(("p1",))
    joints, values = some(arm, 3, np.random.default_rng(0))
    code = arm.compiled
    for wrong in ((joints, values[:-1]), (joints[:, :-1], values), (joints.astype(np.float32), values)):
        with pytest.raises(ValueError, match=r"belong|kind"):
            code.observe(*wrong, code.every, len(values))
    with pytest.raises(ValueError, match="belong"):
        code.observe(joints, values, code.every + 1, len(values))
    with pytest.raises(ValueError, match="belong"):
        code.tool(joints, values, 1)


def test_what_an_earlier_build_left_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    for found in (SimpleNamespace(VERSION=0), SimpleNamespace()):
        monkeypatch.setattr(importlib, "import_module", lambda name, found=found: found)
        assert kernels._loaded() is None


def build_script() -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        "build_kernels", ROOT / "scripts" / "maintenance" / "build_kernels.py"
    )
    assert spec is not None and spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    return script


def test_a_build_without_a_compiler_says_so_and_leaves_nothing(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = build_script()
    monkeypatch.setenv("CC", "no-such-compiler")
    monkeypatch.setenv("PATH", str(tmp_path))
    (tmp_path / "kernels.c").write_bytes(b"")
    (tmp_path / "machine_code.abi3.so").write_bytes(b"old")
    assert "no-such-compiler" in script.build(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["kernels.c"]


def test_kernels_are_compiled_again_only_for_other_sources(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    script, made = build_script(), list[Path]()

    def compiled_into(folder: Path, built: Path) -> str:
        made.append(built)
        built.write_bytes(b"code")
        return ""

    monkeypatch.setattr(script, "_compiled", compiled_into)
    for text, times in ((b"one", 1), (b"one", 1), (b"two", 2)):
        (tmp_path / "kernels.c").write_bytes(text)
        assert script.build(tmp_path) == "" and len(made) == times
    made[0].unlink()
    assert script.build(tmp_path) == "" and len(made) == 3


@compiled
@pytest.mark.parametrize("name", ["irb120", "rx130"])
def test_all_inverse_solutions_are_those_of_numpy(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the same order, reached or not, with the references of free joints; at singularities they are free alike."""
    form, rng = SphericalWrist.of(load_robot(name).chain), np.random.default_rng(5)
    assert form is not None
    arm = SerialArm(form.chain)
    joints = form.chain.random_joints(300, rng)
    joints[:20, 4] = 0.0  # the wrist is straight
    Ts = arm.flange(joints, arm.nominal())
    Ts[100:200, :3, 3] *= 1.7  # mostly out of reach
    for liked in (0.0, rng.standard_normal((300, 6))):
        fast = form.solve(Ts, liked)
        with numpy_alone(monkeypatch):
            slow = form.solve(Ts, liked)
        turn = np.abs(fast.joints - slow.joints)[20:]
        assert np.minimum(turn, 2 * np.pi - turn).max() < 1e-9  # rad: some poses are near a singularity
        assert np.abs(fast.gap_m - slow.gap_m).max() < ROUNDING and (slow.gap_m[100:200] > 0).mean() > 0.2
        assert (fast.free == slow.free)[20:].all() and not fast.tilt_rad.any()


KINDS = {kinds: chain_of(kinds, "craig", kinds, [0, 50, 70], [0.1, 0.2, 0.3], [10, 20, 30], [0.3, 0.1, 0.2])
         for kinds in map("".join, itertools.product("RP", repeat=3))}  # fmt: skip
KINDS |= {
    "anthropomorphic": chain_of("a", "craig", "RRR", [0, 90, 0], [0, 0, 0.5], [0] * 3, [0.3, 0, 0]),
    "SCARA": chain_of("r", "craig", "RRP", [0, 0, 0], [0, 0.4, 0.3], [0] * 3, [0.3, 0, 0]),
    "axes 1 and 2 parallel": chain_of("p", "craig", "RRR", [0, 0, 90], [0, 0.4, 0.2], [0] * 3, [0.3, 0.1, 0]),
}


def each_has_its_like(chain: Chain, some: Solutions, others: Solutions) -> None:
    """Every joint positions that reach a pose are among the others', in any order; near a double root to 1e-6."""
    apart = some.joints[:, :, None] - others.joints[:, None]
    apart -= np.where(chain.prismatic, 0.0, 2 * np.pi) * np.round(apart / (2 * np.pi))
    apart = np.where((others.gap_m == 0)[:, None], np.abs(apart).max(axis=3), np.inf).min(axis=2)[some.gap_m == 0]
    assert apart.max() < 1e-6 and np.quantile(apart, 0.99) < 1e-9


@compiled
@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", KINDS)
def test_all_solutions_of_three_joints_are_those_of_numpy(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Some places are out of reach: the nearest is numpy's in both."""
    chain, rng = KINDS[name], np.random.default_rng(6)
    form, arm = ThreeJoints.of(chain, np.array([0.25, 0.03, 0.02])), SerialArm(chain)
    assert form is not None
    joints = rng.uniform(-1, 1, (60, 3)) * np.where(chain.prismatic, 0.8, np.pi)
    Ts = arm.flange(joints, arm.nominal())
    Ts[50:, :3, 3] *= 4.0
    fast = form.solve(Ts, joints)
    with numpy_alone(monkeypatch):
        slow = form.solve(Ts, joints)
    each_has_its_like(chain, fast, slow)
    each_has_its_like(chain, slow, fast)
    lost = (slow.gap_m > 0).all(axis=1)
    for here, there in ((fast.gap_m, slow.gap_m), (fast.tilt_rad, slow.tilt_rad), (fast.joints, slow.joints)):
        # numpy solves these alone, then all poses in one stack: its products may round differently, and the roots of a
        # polynomial of degree 8 multiply that by up to 1e4
        np.testing.assert_allclose(here[lost], there[lost], rtol=0, atol=1e-11)
    assert not lost[:50].any() and (lost.any() or "P" in name)
    np.testing.assert_allclose(fast.tilt_rad[:50].min(axis=1), slow.tilt_rad[:50].min(axis=1), atol=1e-9)


UR = chain_of(  # axis 2 not square to axis 1, axes 3 and 4 against it, axis 4 off axis 5
    "ur", "craig", "RRRRRR", [0, 70, 180, 180, 90, -90], [0.1, 0.1, 0.5, 0.4, 0.05, 0], [10, 20, 30, 40, 50, 60],
    [0.3, 0.05, 0.1, 0.1, 0.1, 0.1],
)  # fmt: skip


@compiled
def test_all_solutions_of_three_parallel_axes_are_those_of_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the same order, reached or not, and where the wrist is straight and joint 6 is free."""
    form, rng = ThreeParallel.of(UR), np.random.default_rng(5)
    assert form is not None
    joints, arm = UR.random_joints(300, rng), SerialArm(UR)
    joints[:20, 4] = -form.bend
    Ts = arm.flange(joints, arm.nominal())
    Ts[100:200, :3, 3] *= 1.7  # mostly out of reach
    for liked in (0.0, rng.standard_normal((300, 6))):
        fast = form.solve(Ts, liked)
        with numpy_alone(monkeypatch):
            slow = form.solve(Ts, liked)
        turn = np.abs(fast.joints - slow.joints)
        exactly = (slow.free == fast.free).all(axis=(1, 2))
        assert np.minimum(turn, 2 * np.pi - turn)[20:].max() < 1e-9 and exactly[20:].all()
        assert np.abs(fast.gap_m - slow.gap_m)[20:].max() < ROUNDING and (slow.gap_m[100:200] > 0).mean() > 0.2
        again = arm.flange(fast.joints.reshape(-1, 6), arm.nominal()).reshape(300, 8, 4, 4)
        missed = np.abs(again - Ts[:, None]).max(axis=(2, 3))[fast.gap_m == 0]
        assert missed.max() < 1e-9 and (fast.gap_m[:20] == 0).any(axis=1).all() and fast.free[:20, :, 5].any()


FIVE = {
    "planar arm": chain_of("p", "craig", "RRRRR", [0, 70, 180, 0, 60], [0.1, 0.05, 0.4, 0.3, 0.02],
                           [10, 20, 30, 40, 50], [0.3, 0.05, 0.02, 0.01, 0.1]),
    "with a slide": chain_of("s", "craig", "RRPRR", [0, 90, 90, -90, 90], [0, 0.05, 0.1, 0.1, 0.05], [0] * 5,
                             [0.1] * 5),
    "on a track": chain_of("t", "craig", "PRRRR", [30, 40, 0, 0, 90], [0, 0.05, 0.4, 0.3, 0.05], [0] * 5, [0.1] * 5),
}  # fmt: skip


@compiled
@pytest.mark.parametrize("name", FIVE)
def test_all_solutions_of_five_axes_are_those_of_numpy(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    chain, rng = FIVE[name], np.random.default_rng(9)
    fast, arm = FiveAxes.of(chain), SerialArm(chain)
    assert fast is not None
    joints = rng.uniform(-1, 1, (40, 5)) * np.where(chain.prismatic, 0.8, np.pi)
    Ts = arm.flange(joints, arm.nominal())
    found = fast.solve(Ts, joints)
    with numpy_alone(monkeypatch):
        expected = fast.solve(Ts, joints)
    assert (found.gap_m == 0).any(axis=1).all() and np.isfinite(found.joints).all()
    each_has_its_like(chain, found, expected)
    each_has_its_like(chain, expected, found)
    alike = np.abs(found.joints - expected.joints).max(axis=(1, 2)) < 1e-7
    assert np.array_equal(found.free[alike], expected.free[alike])


def test_positive_systems_and_others_are_solved() -> None:
    rng = np.random.default_rng(4)
    factors, right = rng.standard_normal((5, 13, 13)), rng.standard_normal((5, 13))
    matrices = factors @ factors.swapaxes(1, 2)
    assert np.abs(np.einsum("bij,bj->bi", matrices, kernels.solve_positive(matrices, right)) - right).max() < 1e-9
    matrices[3] -= 5 * np.eye(13)  # not positive any more
    assert np.abs(np.einsum("bij,bj->bi", matrices, kernels.solve_positive(matrices, right)) - right).max() < 1e-9


def test_a_function_without_machine_code_does_as_its_fallback(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its condition checks arguments in any case."""
    chosen = kernels.with_fallback(lambda x: ("numpy", x), when=lambda x: bool(1 / x))(lambda x: ("compiled", x))
    monkeypatch.setattr(kernels, "_CODE", object())
    assert chosen(2.0) == ("compiled", 2.0) and chosen(np.inf) == ("numpy", np.inf)
    with numpy_alone(monkeypatch):
        assert chosen(2.0) == ("numpy", 2.0)
        with pytest.raises(ZeroDivisionError):
            chosen(0)
