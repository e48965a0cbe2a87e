"""A factor of a determinant as a sum of terms, read off its values on a grid of the joints that it hangs on.

In a hinge it is a trigonometric polynomial, in a slide a polynomial, of degree 3 at most.
"""

import itertools
from collections.abc import Callable, Iterator
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.core.se3 import Array
from lab.kinematics.inverse.closed_form import Term

__all__ = ["fitted_factor"]

_NODES = 7
_NONE = 1e-12


def fitted_factor(value: Callable[[Array], Array], prismatic: tuple[bool, ...], varied: tuple[int, ...]) -> list[Term]:
    """The terms of a function of joint positions ``(n, joints)``.

    Args:
        varied: the joints that it hangs on.
    """
    slides = [prismatic[joint] for joint in varied]
    nodes = [np.linspace(-1, 1, _NODES) if each else 2 * np.pi * np.arange(_NODES) / _NODES for each in slides]
    grid = np.full((_NODES ** len(varied), len(prismatic)), 0.3)
    grid[:, list(varied)] = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1).reshape(-1, len(varied))
    found = value(grid).reshape((_NODES,) * len(varied)).astype(np.complex128)
    for axis, each in enumerate(slides):
        if each:
            inverse = np.linalg.inv(np.vander(nodes[axis], increasing=True))
            found = np.moveaxis(np.tensordot(inverse, found, (1, axis)), 0, axis)
        else:
            found = np.fft.fft(found, axis=axis) / _NODES
    return list(_terms(found, varied, slides))


def _terms(found: NDArray[np.complex128], varied: tuple[int, ...], slides: list[bool]) -> Iterator[Term]:
    """Combine each pair of a frequency and its negative to a cosine and a sine."""
    least = _NONE * max(1.0, float(np.abs(found).max()))
    for index in itertools.product(range(_NODES), repeat=len(varied)):
        orders = [i if each or 2 * i < _NODES else i - _NODES for i, each in zip(index, slides, strict=True)]
        turns = [(joint, float(order)) for joint, order, each in zip(varied, orders, slides, strict=True)
                 if order and not each]  # fmt: skip
        if (turns and turns[0][1] < 0) or abs(found[index]) <= least:
            continue
        powers = [(joint,) * order for joint, order, each in zip(varied, orders, slides, strict=True) if each]
        angle, whole = tuple(turns), 2.0 if turns else 1.0
        parts: tuple[tuple[float, Literal["cos", "sin"]], ...]
        parts = (found[index].real, "cos"), (-found[index].imag, "sin")
        for part, function in parts:
            if abs(whole * part) > least and (turns or function == "cos"):
                yield Term(whole * part, function if turns else "", angle, slides=tuple(itertools.chain(*powers)))
