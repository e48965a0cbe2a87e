"""The determinant of a three-joint arm's Jacobian as a sum of terms, read off its values on a grid of joints 2 and 3.

Joint 1 moves the whole arm, so that the determinant does not hang on it. In a hinge it is a trigonometric polynomial,
in a slide a polynomial, of degree 3 at most.
"""

from collections.abc import Callable, Iterator
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.kinematics.inverse.analytic.determinant import Term

__all__ = ["fitted_factor"]

_NODES = 7
_NONE = 1e-12


def fitted_factor(value: Callable[[Array], Array], prismatic: tuple[bool, ...]) -> list[Term]:
    """The terms of a determinant, a function of joint positions ``(n, 3)``."""
    nodes = [np.linspace(-1, 1, _NODES) if slides else 2 * np.pi * np.arange(_NODES) / _NODES for slides in prismatic]
    grid = np.stack(np.meshgrid([0.3], nodes[1], nodes[2], indexing="ij"), axis=-1).reshape(-1, 3)
    found = value(grid).reshape(_NODES, _NODES).astype(np.complex128)
    for axis, joint in ((0, 1), (1, 2)):
        if prismatic[joint]:
            inverse = np.linalg.inv(np.vander(nodes[joint], increasing=True))
            found = np.tensordot(inverse, found, (1, axis)) if axis == 0 else np.tensordot(found, inverse.T, 1)
        else:
            found = np.fft.fft(found, axis=axis) / _NODES
    return list(_terms(found, prismatic))


def _terms(found: NDArray[np.complex128], prismatic: tuple[bool, ...]) -> Iterator[Term]:
    """Each pair of a frequency and its negative is a cosine and a sine."""
    least = _NONE * max(1.0, float(np.abs(found).max()))
    for i in range(_NODES):
        for j in range(_NODES):
            orders = [order if slides or 2 * order < _NODES else order - _NODES
                      for order, slides in zip((i, j), prismatic[1:], strict=True)]  # fmt: skip
            turns = [(joint, float(order)) for joint, order in zip((1, 2), orders, strict=True)
                     if order and not prismatic[joint]]  # fmt: skip
            if (turns and turns[0][1] < 0) or abs(found[i, j]) <= least:
                continue
            powers = [order if prismatic[joint] else 0 for joint, order in zip((1, 2), orders, strict=True)]
            slides = (1,) * powers[0] + (2,) * powers[1]
            angle, whole = tuple(turns), 2.0 if turns else 1.0
            parts: tuple[tuple[float, Literal["cos", "sin"]], ...]
            parts = (found[i, j].real, "cos"), (-found[i, j].imag, "sin")
            for part, function in parts:
                if abs(whole * part) > least and (turns or function == "cos"):
                    yield Term(whole * part, function if turns else "", angle, slides=slides)
