"""Errors of poses left out by formulas against leaving them out, and the factor of the bounds by them."""

import numpy as np
import pytest
from helpers.robots import IRB120
from numpy.typing import NDArray

from lab.calibration.residual.estimation import bound_factor, left_out
from lab.calibration.residual.gaussian_process import JointKernels, Reduction, Support, covariance
from lab.core.se3 import Array

SIZES = 1e-10 * np.array([1.0, 0.3, 2.0, 4.0, 8.0, 1.0, 3.0, 5.0, 2.0, 6.0])
KERNELS = JointKernels(np.ones(6, dtype=np.bool_))


def test_errors_of_poses_left_out_are_those_of_leaving_them_out() -> None:
    rng = np.random.default_rng(0)
    joints, slopes = IRB120.chain.random_joints(12, rng), rng.standard_normal((12, 9, 6))
    joints[7] = joints[3]  # a repeat, left out with its configuration
    labels = np.arange(12)
    labels[7], labels[8:] = 3, np.arange(7, 11)
    seen = np.ones((12, 3), dtype=np.bool_)
    seen[5, 0] = False
    columns, residual = rng.standard_normal((12, 9, 4)), 1e-4 * rng.standard_normal((12, 9))
    reduction = Reduction.of(joints, slopes, seen)
    support = Support.of(reduction, KERNELS, SIZES, columns.reshape(-1, 4), np.zeros(4))

    def fitted(poses: NDArray[np.int_]) -> tuple[Array, Array, Array]:
        """The inverse of the covariance matrix of some poses, their derivatives, and the parameters by them."""
        some = Reduction.of(joints[poses], slopes[poses], seen[poses])
        whole = covariance(KERNELS, SIZES, some.numbers)
        count, (moved, alone) = len(whole), some(columns[poses])
        inverse = np.eye(count + len(alone)) / SIZES[0]
        inverse[:count, :count] = np.linalg.inv(whole + SIZES[0] * np.eye(count))
        x, y = np.concatenate([moved, alone]), np.concatenate(some(residual[poses]))
        return inverse, x, np.linalg.solve(x.T @ inverse @ x, x.T @ inverse @ y)

    inverse, x, by_all = fitted(np.arange(12))
    left = inverse @ (np.concatenate(reduction(residual)) - x @ by_all)
    count = len(reduction.numbers.pose)
    found = {each.pose: each for each in left_out(support, reduction, SIZES[0], (left[:count], left[count:]), labels)}
    assert sorted(found) == list(range(12))
    for pose in (3, 5, 7, 11):
        rest = np.flatnonzero(labels != labels[pose])
        inverse, x, parameters = fitted(rest)
        some, own = (
            Reduction.of(joints[rest], slopes[rest], seen[rest]),
            Reduction.of(*(a[[pose]] for a in (joints, slopes, seen))),
        )
        kept = np.repeat(seen[pose], 3)
        crossed = np.zeros((kept.sum(), len(inverse)))
        turned = covariance(KERNELS, SIZES, own.numbers, some.numbers)
        crossed[:, : turned.shape[1]] = own.back(
            0, np.concatenate([turned, np.zeros((kept.sum() - len(turned), turned.shape[1]))])
        )
        rows = columns[pose][kept]
        error = residual[pose][kept] - rows @ parameters
        error -= crossed @ inverse @ (np.concatenate(some(residual[rest])) - x @ parameters)
        assert np.allclose(found[pose].error, error, rtol=1e-7, atol=1e-12)
        lacking = rows - crossed @ inverse @ x
        expected = slopes[pose][kept] @ slopes[pose][kept].T * SIZES[1:].sum() + SIZES[0] * np.eye(kept.sum())
        expected += lacking @ np.linalg.solve(x.T @ inverse @ x, lacking.T) - crossed @ inverse @ crossed.T
        assert np.allclose(found[pose].covariance, expected, rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize("wider", [0.5, 1.0, 2.0])
def test_the_factor_puts_95_percent_inside(wider: float) -> None:
    rng, noise = np.random.default_rng(1), 1e-10
    made = rng.standard_normal((2000, 3, 3))
    predicted = 1e-9 * (made @ np.swapaxes(made, 1, 2) + np.eye(3))
    true = wider * predicted + noise * np.eye(3)
    errors = np.einsum("nij,nj->ni", np.linalg.cholesky(true), rng.standard_normal((2000, 3)))
    far = 1e3 * np.trace(predicted, axis1=1, axis2=2)  # what was known before any measurement: nothing
    assert bound_factor(errors, predicted + noise * np.eye(3), noise, far) == pytest.approx(wider, rel=0.15)
    few = bound_factor(errors[:25], predicted[:25] + noise * np.eye(3), noise, far[:25])
    assert few >= 1.0  # they say too little of the largest errors to make bounds narrower
    assert bound_factor(errors[:10], predicted[:10] + noise * np.eye(3), noise, far[:10]) == 1.0
