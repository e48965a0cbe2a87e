"""Machine code does what numpy does, to rounding, and numpy does it alone where there is no machine code."""

import importlib
import importlib.util
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.robots import ROOT

from lab.campaign.robot import load_robot
from lab.kinematics.compiled import kernels
from lab.kinematics.gauge import independent_columns
from lab.kinematics.inverse.analytic.spherical_wrist import SphericalWrist
from lab.kinematics.inverse.newton import PoseTarget, reach
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.batch import StackedArm

ROUNDING = 1e-14  # m, rad or their quotients: of some dozens of products of numbers of about one

compiled = pytest.mark.skipif(kernels.machine_code() is None, reason="built without a C compiler")


def both(name: str, targets: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> tuple[SerialArm, SerialArm]:
    """An arm in machine code, and the same in numpy."""
    fast = load_robot(name).serial_arm(targets)
    assert fast.compiled(np.zeros(1), np.zeros(1)) is not None
    with monkeypatch.context() as without:
        without.setattr("lab.kinematics.serial.arm.machine_code", lambda: None)
        slow = SerialArm(fast.chain, fast.targets)
        assert slow.compiled(np.zeros(1), np.zeros(1)) is None
    return fast, slow


def some(arm: SerialArm, poses: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Joint positions, and parameters of an arm that stands anywhere."""
    values = arm.nominal() + 0.01 * rng.standard_normal(len(arm.names))
    values[3:6] = rng.standard_normal(3)
    return arm.chain.random_joints(poses, rng), values


@compiled
@pytest.mark.parametrize("name", ["irb120", "rx130", "scara", "course2r", "versatran"])  # distal, Craig, slides, betas
@pytest.mark.parametrize("poses", [0, 1, 32, 2100])  # none, one, a block, more than numpy takes at a time
def test_every_walk_is_that_of_numpy(name: str, poses: int, monkeypatch: pytest.MonkeyPatch) -> None:
    fast, slow = both(name, ("p1", "p3"), monkeypatch)
    joints, values = some(fast, poses, np.random.default_rng(poses))
    wide = np.concatenate([joints, joints], axis=1)[:, : joints.shape[1]]  # not contiguous
    found = [fast.points(wide, values), *fast.observe(wide, values), *fast.tool(wide, values, 1)]
    expected = [slow.points(joints, values), *slow.observe(joints, values), *slow.tool(joints, values, 1)]
    found.append(fast.joint_jacobian(wide, values))
    expected.append(slow.joint_jacobian(joints, values))
    for here, there in zip(found, expected, strict=True):
        assert here.shape == there.shape
        assert np.abs(here - there).max(initial=0.0) < ROUNDING


@compiled
@pytest.mark.parametrize(("name", "poses"), [("irb120", 90), ("irb120", 0), ("rx130", 40)])
def test_newtons_method_is_that_of_numpy(name: str, poses: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of targets with and without a rotation, from near and from so far that steps are damped."""
    fast, slow = both(name, ("p1", "p2"), monkeypatch)
    rng = np.random.default_rng(3)
    joints, values = some(fast, poses, rng)
    Ts = fast.tool(joints, values, 1)[0]
    rotations = np.where(rng.random((poses, 1, 1)) < 0.5, Ts[:, :3, :3], np.nan)
    wanted, far = PoseTarget(Ts[:, :3, 3], rotations), rng.choice([0.02, 1.0], (poses, 1))
    start = joints + far * rng.uniform(-1, 1, joints.shape)
    found, expected = (reach(arm, values, wanted, start, np.empty((poses, 0)), 1) for arm in (fast, slow))
    same = (found.steps == expected.steps) & (np.abs(found.joints - expected.joints).max(axis=1, initial=0.0) < 1e-7)
    assert same.all() if not poses else same.mean() > 0.9 and same[far[:, 0] < 1].all()
    assert (found.arrived == expected.arrived)[same].all() and found.errors.shape == (poses, 6)
    assert expected.steps.max(initial=0) > 8 or not poses


@compiled
@pytest.mark.parametrize("own", [False, True])
def test_many_arms_walk_as_numpy_does(own: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    fast, slow = (StackedArm(arm) for arm in both("irb120", ("p1", "p2"), monkeypatch))
    joints, values = some(fast.arm, 35, np.random.default_rng(1))
    many, free = values + 0.01 * np.random.default_rng(2).standard_normal((4, len(values))), [3, 0, 9, 31, 36]
    joints = np.stack([joints + 0.1 * i for i in range(4)]) if own else joints
    for here, there in zip(fast.observe(joints, many, free), slow.observe(joints, many, free), strict=True):
        assert here.shape == there.shape
        assert np.abs(here - there).max() < ROUNDING
    assert np.abs(fast.points(joints, many) - slow.points(joints, many)).max() < ROUNDING


@compiled
def test_a_complex_step_and_elastic_links_are_left_to_numpy() -> None:
    arm = load_robot("irb120").serial_arm(("p1",))
    joints, values = some(arm, 3, np.random.default_rng(0))
    step = values + 1e-30j * np.eye(len(values))[7]
    assert np.abs(arm.points(joints, step).imag / 1e-30 - arm.observe(joints, values)[1][..., 7]).max() < ROUNDING
    assert arm.compiled(joints, values, {0: np.zeros((3, 6))}) is None


@compiled
def test_arrays_that_do_not_belong_together_are_refused() -> None:
    arm = load_robot("irb120").serial_arm(("p1",))
    joints, values = some(arm, 3, np.random.default_rng(0))
    code = arm.compiled(joints, values)
    assert code is not None
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


def test_a_build_without_a_compiler_says_so_and_leaves_nothing(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    spec = importlib.util.spec_from_file_location("build_kernels", ROOT / "scripts" / "build_kernels.py")
    assert spec is not None and spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    monkeypatch.setenv("CC", "no-such-compiler")
    monkeypatch.setenv("PATH", str(tmp_path))
    (tmp_path / "machine_code.abi3.so").write_bytes(b"old")
    assert "no-such-compiler" in script.build(tmp_path)
    assert list(tmp_path.iterdir()) == []


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
        with monkeypatch.context() as without:
            without.setattr("lab.kinematics.inverse.analytic.spherical_wrist.machine_code", lambda: None)
            slow = form.solve(Ts, liked)
        turn = np.abs(fast.joints - slow.joints)[20:]
        assert np.minimum(turn, 2 * np.pi - turn).max() < 1e-9  # rad: some poses are near a singularity
        assert np.abs(fast.gap_m - slow.gap_m).max() < ROUNDING and (slow.gap_m[100:200] > 0).mean() > 0.2
        assert (fast.free == slow.free)[20:].all() and not fast.tilt_rad.any()


@compiled
def test_independent_columns_are_those_of_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(8)
    columns = rng.standard_normal((40, 9))
    columns[:, 4] = columns[:, [0, 2]] @ [1.0, -3.0] + 1e-12 * rng.standard_normal(40)
    columns[:, 6] *= 1e-10  # moves nothing
    columns[:, 7] = columns[:, 1] + 1e-6 * rng.standard_normal(40)
    for order in ([*range(9)], [4, 2, 0, 8], [7, 6, 1]):
        fast = independent_columns(columns, order)
        with monkeypatch.context() as without:
            without.setattr("lab.kinematics.gauge.machine_code", lambda: None)
            assert fast == independent_columns(columns, order)
    assert independent_columns(columns, range(9)) == (0, 1, 2, 3, 5, 7, 8)


def test_positive_systems_and_others_are_solved() -> None:
    rng = np.random.default_rng(4)
    factors, right = rng.standard_normal((5, 13, 13)), rng.standard_normal((5, 13))
    matrices = factors @ factors.swapaxes(1, 2)
    assert np.abs(np.einsum("bij,bj->bi", matrices, kernels.solve_positive(matrices, right)) - right).max() < 1e-9
    matrices[3] -= 5 * np.eye(13)  # not positive any more
    assert np.abs(np.einsum("bij,bj->bi", matrices, kernels.solve_positive(matrices, right)) - right).max() < 1e-9
