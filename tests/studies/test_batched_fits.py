"""Many campaigns at once: the same as one by one, bit for bit the same in any company, and fast steps as good."""

import numpy as np
import pytest
from helpers.robots import IRB120, RX130, SCARA, VERSATRAN, perturbed, somewhere

from lab.calibration.batched_fits import BLOCK, align, fit_points
from lab.calibration.identification import identify
from lab.calibration.weights import Noise
from lab.core import se3
from lab.core.measurements import measured
from lab.core.se3 import Array
from lab.kinematics.gauge import base_set
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm, StackedArm
from lab.noise.instruments import instrument
from lab.studies.campaigns import COLUMNS, METRICS, cell_poses, run_task
from lab.studies.grid import Study, Task, study_from

ARM = IRB120.arm(("p1",))
NOMINAL = ARM.nominal(IRB120.tool)
FREE = base_set(ARM, NOMINAL).identifiable
STACKED = StackedArm(ARM)


def campaigns(count: int, noise_m: float, seed: int = 0, poses: int = 30) -> tuple[Array, Array, Array]:
    """Parameters ``(b, p)``, readings and measured points ``(b, n, 1, 3)``: other arms, bases anywhere."""
    rng = np.random.default_rng(seed)
    joints = IRB120.chain.random_joints(poses, rng)
    values = np.array([perturbed(ARM, NOMINAL, rng, 0.5e-3, 1.5e-3) for _ in range(count)])
    values[:, :6] = [somewhere(ARM, rng)[:6] for _ in range(count)]
    points = np.array([ARM.points(joints, each) for each in values])
    return values, joints, points + rng.uniform(-noise_m, noise_m, points.shape)


@pytest.mark.parametrize("chain", [IRB120.chain, RX130, SCARA, VERSATRAN], ids=lambda chain: chain.name)
def test_stacked_arms_are_where_each_is_alone(chain: Chain) -> None:
    rng, arm = np.random.default_rng(1), SerialArm(chain, ("p1", "p2"))
    values = np.array([perturbed(arm, somewhere(arm, rng), rng, 1e-3, 3e-3) for _ in range(5)])
    joints, some = chain.random_joints(7, rng), list(range(len(arm.names)))[::2]
    points, jacobian = StackedArm(arm).observe(joints, values, some)
    np.testing.assert_array_equal(StackedArm(arm).points(joints, values), points)
    for b, each in enumerate(values):
        expected, derivative = arm.observe(joints, each)
        np.testing.assert_allclose(points[b].transpose(2, 0, 1), expected, rtol=0, atol=1e-14)
        np.testing.assert_allclose(
            jacobian[:, :, :, b].transpose(3, 2, 1, 0), derivative[..., some], rtol=0, atol=1e-14
        )


def test_it_is_the_identifier() -> None:
    """Base and links one by one, from no guess, by an orthogonal factorization."""
    _, joints, points = campaigns(4, 8e-6)
    turned = align(STACKED, joints, points, NOMINAL)
    found = fit_points(turned, NOMINAL, FREE)
    for b, seen in enumerate(points):
        data = measured(IRB120.chain.joint_names, joints, ("p1",), seen)
        alone = identify(ARM, data, NOMINAL, Noise(instrument("uniform-8um")))
        np.testing.assert_allclose(found.values[b, 6:], alone.values[6:], rtol=0, atol=1e-10)
        base = found.values[b, :6]
        T = turned.Ts_instrument_nominal[b] @ se3.pose(se3.exp(base[3:]), base[:3])
        np.testing.assert_allclose(T[:3, 3], alone.values[:3], rtol=0, atol=1e-10)
        np.testing.assert_allclose(T[:3, :3], se3.exp(alone.values[3:6]), rtol=0, atol=1e-10)


@pytest.mark.parametrize("frozen", [False, True])
def test_a_campaign_is_the_same_in_any_company(frozen: bool) -> None:
    """Alone, among others, in another place of its block, with a block of its own.

    To the bit with most BLAS kernels; some round a row of a product by its place in the block, by some of the last
    digits of rotations and lengths of about one.
    """
    _, joints, points = campaigns(2 * BLOCK + 7, 8e-6, seed=3)
    turned = align(STACKED, joints, points, NOMINAL)

    def solve(rows: Array) -> Array:
        return fit_points(turned.take(rows), NOMINAL, FREE, frozen=frozen).values

    everything = solve(np.arange(len(points)))
    for rows in (np.array([3]), np.arange(60, 71), np.random.default_rng(0).permutation(len(points))):
        np.testing.assert_allclose(solve(rows), everything[rows], rtol=0, atol=1e-14)
    alone = align(STACKED, joints, points[5:6], NOMINAL)
    np.testing.assert_array_equal(alone.points, turned.points[5:6])


def test_what_cannot_converge_is_told_and_does_not_touch_the_others() -> None:
    _, joints, points = campaigns(6, 8e-6, seed=4)
    good = fit_points(align(STACKED, joints, points, NOMINAL), NOMINAL, FREE)
    points[2] = np.random.default_rng(5).normal(size=points[2].shape)
    found = fit_points(align(STACKED, joints, points, NOMINAL), NOMINAL, FREE)
    others = [0, 1, 3, 4, 5]
    assert not found.converged[2] and found.converged[others].all()
    np.testing.assert_array_equal(found.values[others], good.values[others])


# A study's tasks

SMALL = Study(robots=4, draws=6, fresh=50, factors={"criterion": ("random", "O1"), "poses": (12,)})


def test_rows_do_not_depend_on_how_the_study_is_cut() -> None:
    joints = cell_poses(SMALL, SMALL.cells[0])
    whole = run_task(SMALL, Task(0, 0, 4), joints)
    assert set(whole) == set(COLUMNS) and len(whole["robot"]) == 24
    assert whole["converged"].all() and (whole["cell"] == 0).all()
    for first, last in ((0, 1), (1, 3), (3, 4)):
        part = run_task(SMALL, Task(0, first, last), joints)
        rows = (whole["robot"] >= first) & (whole["robot"] < last)
        for name in COLUMNS:
            np.testing.assert_array_equal(part[name], whole[name][rows], err_msg=name)


def test_robots_and_noise_are_the_same_in_every_cell() -> None:
    """Twelve of twenty random poses are the same poses, with the same readings: nothing else may differ."""
    study = Study(robots=2, draws=3, fresh=20, factors={"criterion": ("random",), "poses": (12, 20)})
    few, many = (cell_poses(study, cell) for cell in study.cells)
    np.testing.assert_array_equal(many[:12], few)
    again = Study(robots=2, draws=3, fresh=20, factors={"criterion": ("random",), "poses": (20, 12)})
    first = run_task(study, Task(0, 0, 2), few)
    second = run_task(again, Task(1, 0, 2), few)
    for name in METRICS:
        np.testing.assert_array_equal(first[name], second[name])
    other = run_task(Study(seed=1, robots=2, draws=3, fresh=20, factors=study.factors), Task(0, 0, 2), few)
    assert (other["fresh_mean_mm"] != first["fresh_mean_mm"]).all()
    assert len(set(first["fresh_mean_mm"])) == 6 and len(set(first["before_mm"])) == 2


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"robot": "irb120", "speed": 3}, "'speed' is no option"),
        ({"factors": {"colour": ["red"]}}, "factor 'colour' is unknown"),
        ({"factors": {"poses": []}}, "give at least one value"),
        ({"factors": {"poses": [20, 20]}}, "each once"),
        ({"factors": {"poses": [0]}}, "give a whole number of 1 or more"),
        ({"factors": {"scaling": ["big"]}}, "'big' is not a value of option 'scaling'"),
        ({"factors": {"effects": ["soft"]}}, r"add \[effects.soft\]"),
        ({"factors": {"parameters": ["few"]}}, r"add \[parameters.few\]"),
        ({"effects": {"soft": {"stiffness": 3}}}, "effects.soft: 'stiffness' is no option"),
        ({"factors": {"poses": ["many"]}}, "'many' is not a value of option 'poses'"),
        ({"effects": {"soft": {"lag": 2.0}}}, "effects.soft: --lag 2: give a share from 0 to below 1"),
        ({"robots": 0}, "robots 0"),
    ],
)
def test_a_study_that_is_none_is_told(content: dict, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        study_from(content)


def test_one_jacobian_cannot_serve_a_tracker() -> None:
    study = Study(frozen=True, factors={"poses": (30,), "instrument": ("leica-at960",)})
    with pytest.raises(ValueError, match="frozen: leica-at960 weighs every arm otherwise"):
        cell_poses(study, study.cells[0])
