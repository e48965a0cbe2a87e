"""The complex roots of many polynomials at once."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["polynomial_roots"]


def polynomial_roots(coefficients: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """The roots ``(d, n)`` of polynomials ``(d + 1, n)`` of rising powers, by their companion matrices."""
    degree = len(coefficients) - 1
    last = coefficients[-1]
    size = np.abs(coefficients).max(axis=0)
    last = np.where(np.abs(last) > 1e-14 * size, last, 1e-14 * np.maximum(size, 1e-280))
    matrix = np.zeros((coefficients.shape[1], degree, degree), dtype=np.complex128)
    matrix[:, 1:, :-1] = np.eye(degree - 1)
    matrix[:, :, -1] = -(coefficients[:-1] / last).T
    return np.asarray(np.linalg.eigvals(matrix).T, dtype=np.complex128)
