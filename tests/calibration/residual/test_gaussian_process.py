"""The process of joints' offsets: against the joint Gaussian distribution itself, and on arms whose truth is known."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from extrapolation import prediction_squares
from helpers.robots import IRB120
from scipy import stats

import lab
from lab.calibration.identification import identify
from lab.calibration.residual.estimation import with_residual
from lab.calibration.residual.gaussian_process import (
    COMPONENTS,
    UPPER_QUARTILE,
    JointKernels,
    JointProcess,
    PredictedBy,
    Reduction,
    covariance,
    precisions,
    scaled_by,
    unit_covariances,
)
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.core.se3 import Array
from lab.formats.structured import structured
from lab.prediction.estimate_files import (
    ResidualSizes,
    read_residual,
    residual_columns,
    residual_to_dict,
    write_residual,
)
from lab.prediction.residual_spread import residual_spread

ARM = IRB120.arm(("p1",))
NOMINAL = ARM.nominal(IRB120.tool)
TURNING = np.ones(6, dtype=np.bool_)
SIZES = 1e-10 * np.array([1.0, 0.3, 2.0, 4.0, 8.0, 1.0, 3.0, 5.0, 2.0, 6.0])
NO_ERRORS = np.zeros((10, 10))


def sizes(content: Mapping[str, Any] | None) -> ResidualSizes:
    return structured("residual", ResidualSizes, content, extra=True)


def dense(there: Array, slopes: Array) -> Array:
    """The covariance matrix ``(n d, n d)`` of numbers, the noise aside, written out number by number."""
    n, d, size = slopes.shape
    by_length = list(JointKernels(TURNING).of_offsets(there, there))
    whole = np.zeros((n, d, n, d))
    for i in range(n):
        for m in range(n):
            offsets = np.full(size, SIZES[1] * (i == m))
            for (own, kernel), variance in zip(by_length, SIZES[2:], strict=True):
                offsets += variance * (kernel[i, m] if own else np.full(size, kernel[i, m]))
            whole[i, :, m] = slopes[i] @ np.diag(offsets) @ slopes[m].T
    return whole.reshape(n * d, n * d)


def waving(joints: Array) -> Array:
    """Offsets that no group of the catalogue has: of each joint's own position, and of two together."""
    own = 2e-4 * np.sin(3.0 * np.abs(joints))
    own[:, 1] += 1e-4 * np.sin(joints[:, 1]) * np.cos(2 * joints[:, 2])
    return own


def campaign(poses: int, seed: int, *, rigid: bool) -> Measurements:
    rng = np.random.default_rng(seed)
    joints = IRB120.chain.random_joints(poses, rng)
    points = ARM.points(joints if rigid else joints + waving(joints), NOMINAL)
    return measured(IRB120.chain.joint_names, joints, ("p1",), points + 2e-5 * rng.standard_normal(points.shape))


def test_it_predicts_as_the_joint_distribution_of_all_numbers_does() -> None:
    """Parameters are one more Gaussian, links' of 5 mm and 15 mrad, the base's almost flat: all conditioned at one
    stroke on what was measured."""
    rng = np.random.default_rng(0)
    there, here = IRB120.chain.random_joints(14, rng), IRB120.chain.random_joints(3, rng)
    free = (0, 1, 2, 9)
    both = np.concatenate([there, here])
    slopes = by_joint_positions(ARM, both, NOMINAL, 6)[:, 0]
    columns = ARM.observe(both, NOMINAL)[1][..., list(free)].reshape(-1, len(free))
    near = precisions([ARM.parameters[i] for i in free])
    assert (near[:3] == 0).all() and near[3] in (1 / 5e-3**2, 1 / 15e-3**2)
    prior = np.where(near > 0, 1 / np.where(near > 0, near, 1.0), 1e-1)
    whole = dense(both, slopes) + (columns * prior) @ columns.T
    split = 3 * len(there)
    noisy = whole[:split, :split] + SIZES[0] * np.eye(split)
    rows = rng.standard_normal(split) * 1e-4
    gain = np.linalg.solve(noisy, whole[:split, split:]).T
    expected, left = gain @ rows, whole[split:, split:] - gain @ whole[:split, split:]
    process = JointProcess(there, np.ones((14, 1), bool), SIZES, NO_ERRORS, np.zeros((14, 6)), TURNING, 0.0)
    by = PredictedBy(process, ARM, NOMINAL, free)
    assert np.allclose(by.covariance(here), left, rtol=2e-4, atol=1e-4 * left.max())
    assert np.allclose(by.covariances(here)[1, 0], left[3:6, 3:6], rtol=2e-4, atol=1e-4 * left.max())
    likely = noisy - (columns[:split] * prior) @ columns[:split].T
    inverse = np.linalg.inv(likely)
    information = columns[:split].T @ inverse @ columns[:split] + np.diag(near)
    b = np.linalg.solve(information, columns[:split].T @ inverse @ rows)
    weights = np.einsum("ni,nij->nj", (inverse @ (rows - columns[:split] @ b)).reshape(-1, 3), slopes[:14])
    offsets = JointProcess(there, process.seen, SIZES, NO_ERRORS, weights, TURNING, 0.0).offsets(here)
    predicted = columns[split:] @ b + np.einsum("nij,nj->ni", slopes[14:], offsets).ravel()
    assert np.allclose(predicted, expected, rtol=0, atol=2e-4 * np.abs(expected).max())


@pytest.mark.thorough
def test_what_no_group_has_is_predicted_and_its_bounds_hold() -> None:
    data, fresh = campaign(90, 1, rigid=False), campaign(300, 2, rigid=False)
    found = identify(ARM, data, NOMINAL)
    better = with_residual(found, data)
    errors = [
        np.linalg.norm(each.model.points(fresh.joints, each.values) - fresh.points, axis=2).mean()
        for each in (found, better)
    ]
    assert errors[1] < 0.75 * errors[0]
    assert isinstance(better.process, PredictedBy) and better.process.process.p < 1e-6
    squares = prediction_squares(better, None, fresh.joints, fresh.points, residual_spread(better))[0]
    assert (squares < 3 * stats.f.ppf(0.95, 3, better.dof)).mean() > 0.93
    assert 0.6 < squares.mean() / 3 < 1.3
    assert better.values[-1] == 1 and better.nominal_aligned[-1] == 0


def test_a_file_gives_the_same_process_and_one_that_was_cut_is_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    process = JointProcess(
        *(rng.standard_normal((4, 6)), rng.random((4, 1)) < 2, SIZES, np.diag(SIZES**2)),
        *(rng.standard_normal((4, 6)), TURNING, 0.1, 0.7),
    )
    write_residual(tmp_path / "residual.csv", process, residual_columns(IRB120.chain, (), ("p1",)))
    content = residual_to_dict(process)
    read = read_residual(tmp_path, sizes(content), IRB120.chain, (), ("p1",))
    for name in ("inputs", "seen", "variances", "errors", "weights", "turning", "factor"):
        assert np.array_equal(getattr(read, name), getattr(process, name)), name
    with pytest.raises(LabError, match=r"residual\.csv: its columns are not"):
        read_residual(tmp_path, sizes(content), IRB120.chain, (), ("p2",))
    assert content is not None
    with pytest.raises(LabError, match=r"residual\.variances: 'noise' is missing"):
        sizes({**content, "variances": {}})
    with pytest.raises(LabError, match="variance_errors"):
        sizes({**content, "variance_errors": [[1.0]]})


@pytest.mark.parametrize(
    ("robot", "observe", "instead"), [("irb120", "pose", "--observe pose"), ("rrr3", "points", "a m")]
)
def test_what_has_no_such_offsets_is_refused_in_one_line(robot: str, observe: str, instead: str) -> None:
    with pytest.raises(LabError, match=f"^--model residual: it takes measured points of a serial arm, not {instead}"):
        lab.calibrate(robot, poses=9, observe=observe, model="residual")


def test_offsets_of_one_joint_are_smooth_and_those_of_all_are_both() -> None:
    """Matern's 3/2 and 5/2 fall by the square of a small distance, 1/2 by the distance itself."""
    near, here = np.array([[1e-4, 0.0]]), np.zeros((1, 2))
    found = JointKernels(np.ones(2, dtype=bool)).of_offsets(near, here)
    for name, (own, kernel) in zip(COMPONENTS[2:], found, strict=True):
        fall = 1 - (kernel[0, 0, 0] if own else kernel[0, 0])
        assert own == name.startswith("own")
        assert (fall < 1e-5) != name.startswith("all") and fall > 0


def test_numbers_of_a_pose_are_turned_and_their_distribution_is_the_same() -> None:
    """Three targets, one of them unseen twice: six numbers of a pose have all that its joints' offsets do."""
    rng = np.random.default_rng(7)
    joints, slopes = IRB120.chain.random_joints(5, rng), rng.standard_normal((5, 9, 6))
    seen = np.ones((5, 3), dtype=np.bool_)
    seen[1, 2] = seen[3, 0] = seen[3, 1] = False
    reduction, values = Reduction.of(joints, slopes, seen), rng.standard_normal((5, 9))
    kept = np.repeat(seen, 3, axis=1).ravel()
    moved, alone = reduction(values)
    assert [len(moved), len(alone)] == [6 + 6 + 6 + 3 + 6, 3 + 0 + 3 + 0 + 3]
    whole = (dense(joints, slopes) + SIZES[0] * np.eye(45))[np.ix_(kept, kept)]
    part = covariance(JointKernels(TURNING), SIZES, reduction.numbers) + SIZES[0] * np.eye(len(moved))
    squares = values.ravel()[kept] @ np.linalg.solve(whole, values.ravel()[kept])
    assert moved @ np.linalg.solve(part, moved) + alone @ alone / SIZES[0] == pytest.approx(squares)
    halves = np.linalg.slogdet(part)[1] + len(alone) * np.log(SIZES[0]), np.linalg.slogdet(whole)[1]
    assert halves[0] == pytest.approx(halves[1])
    kinds = unit_covariances(JointKernels(TURNING), reduction.numbers)
    assert np.allclose(sum(size * kind for size, kind in zip(SIZES, kinds, strict=True)), part)
    pose = np.concatenate([moved[reduction.numbers.pose == 1], alone[reduction.alone == 1]])
    assert np.allclose(reduction.back(1, pose), values[1, :6])


def test_the_bounds_widen_by_the_error_of_the_variances_together() -> None:
    """A bound is the upper quartile of the variance of a predicted point, which is linear in the variances."""
    rng = np.random.default_rng(8)
    there, here = IRB120.chain.random_joints(9, rng), IRB120.chain.random_joints(2, rng)
    process = JointProcess(there, np.ones((9, 1), bool), SIZES, NO_ERRORS, np.zeros((9, 6)), TURNING, 0.0)

    def size(process: JointProcess) -> Array:
        found = PredictedBy(process, ARM, NOMINAL, (0, 1, 2)).covariances(here)[:, 0]
        return np.asarray(np.trace(found, axis1=1, axis2=2))

    plain = size(process)
    wider = size(replace(process, errors=np.outer(SIZES, SIZES)))  # all by the same share: so is the variance
    assert np.allclose(wider, (1 + UPPER_QUARTILE) * plain, rtol=1e-4)
    one = np.eye(10)[1]  # as much more of the scatter as less of the offsets that change at once
    apart = 1e-12 * (one - np.eye(10)[5])
    confounded, alone = (
        size(replace(process, errors=np.outer(apart, apart))),
        size(replace(process, errors=1e-24 * np.outer(one, one))),
    )
    assert ((confounded - plain) < 0.3 * (alone - plain)).all()  # the sum of both is known


def test_less_is_less_only_where_measurements_are_near() -> None:
    assert np.allclose(scaled_by(0.5, np.array([0.0, 0.5, 1.0])), [0.5, 0.75, 1.0])
    assert np.allclose(scaled_by(2.0, np.array([0.0, 0.5, 1.0])), 2.0)
