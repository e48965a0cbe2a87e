"""The errors to expect of a program's corrected targets, in the robot's base and relative to each other.

A target's error has three parts: of the calibrated model (the covariance of its parameters, what it lacks), of the
flange, which moves every tool alike in the last frame, and of the base, which moves all targets alike. The second and
third are not measured; they have the sizes of the tolerances of the last and first link. Relative to each other, after
the best rigid motion of all, targets keep of these what differs from one to the other.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lab.compensation.flange import point_rows
from lab.core.covariance import covariance_root
from lab.core.linear_model import matched_dof
from lab.core.probabilities import f_isf
from lab.core.se3 import Array

if TYPE_CHECKING:
    from lab.commands.compensate.program_reference import ProgramReference

__all__ = ["ProgramErrors", "program_errors"]

_SHARE = 0.05  # of the errors that are larger than the expected ones
_ENDLESS = 1e9  # degrees of freedom of what is known
_RANK = 1e-9  # of the largest singular value of rigid motions: targets on a line do not show all
_LEAST_M2 = 1e-24  # a mean square that is none


@dataclass(frozen=True)
class ProgramErrors:
    """Expected errors of n targets.

    Attributes:
        flange_m: ``(n,)`` the flange's part (RMS).
        flange_95_m: ``(n,)`` length that 95 % of the flange's part do not exceed.
        base_95_m: ``(n,)`` length that 95 % of the errors in the robot's base do not exceed.
        shape_95_m: ``(n,)`` the same of errors after the best rigid motion of all targets.
    """

    flange_m: Array
    flange_95_m: Array
    base_95_m: Array
    shape_95_m: Array


def program_errors(
    reference: "ProgramReference",
    positions: Array,
    offsets: Array,
    by_tool: Array,
    by_measured: Array,
    rest_m: Array,
    dof: float | None,
) -> ProgramErrors:
    """Predict the errors of corrected targets.

    Args:
        positions: ``(n, 3)`` m of the tools, in the instrument's frame.
        offsets: ``(n, 3)`` m of the tools, in the flange.
        by_tool: ``(n, 3, 3)`` derivatives of the positions by the tools' places in the last frame.
        by_measured: ``(n, 3, m)`` derivatives by what was measured, in standard deviations.
        rest_m: ``(n,)`` RMS of what is independent from target to target.
        dof: degrees of freedom of the measured part; None where its size is known.
    """
    by_flange = by_tool @ point_rows(offsets) @ covariance_root(reference.flange.covariance)
    by_base = point_rows(positions - reference.first_origin) * reference.sigma
    parts = (by_measured, by_flange, by_base)
    dofs = (_ENDLESS if dof is None else max(dof, 1.0), reference.flange.dof, reference.dof)
    rest = np.asarray(rest_m**2 / 3)
    whole = sum(each @ each.swapaxes(1, 2) for each in parts) + rest[:, None, None] * np.eye(3)
    return ProgramErrors(
        _sizes(by_flange),
        _length_95(by_flange @ by_flange.swapaxes(1, 2), [_sizes(by_flange) ** 2], [reference.flange.dof]),
        _length_95(whole, [_sizes(each) ** 2 for each in parts], dofs),
        _shape_95(positions, parts[:2], rest, dofs[:2]),
    )


def _shape_95(positions: Array, parts: Sequence[Array], rest: Array, dofs: Sequence[float]) -> Array:
    """Lengths ``(n,)`` m that 95 % of the errors do not exceed after the best rigid motion of all targets."""
    count = len(positions)
    left, sizes, _ = np.linalg.svd(point_rows(positions - positions.mean(axis=0)).reshape(-1, 6), full_matrices=False)
    rigid = left[:, sizes > _RANK * sizes.max(initial=0.0)]
    own = rigid.reshape(count, 3, -1)
    moved = np.einsum("n,nik,nil->kl", rest, own, own)
    square = rest[:, None, None] * (np.eye(3) - 2 * own @ own.swapaxes(1, 2)) + own @ moved @ own.swapaxes(1, 2)
    squares = []
    for each in parts:
        flat = each.reshape(3 * count, -1)
        bent = (flat - rigid @ (rigid.T @ flat)).reshape(each.shape)
        square = square + bent @ bent.swapaxes(1, 2)
        squares.append(_sizes(bent) ** 2)
    return _length_95(square, squares, dofs)


def _length_95(squares: Array, of_parts: Sequence[Array], dofs: Sequence[float]) -> Array:
    """Lengths ``(n,)`` m that 95 % of errors with covariances ``(n, 3, 3)`` do not exceed (Satterthwaite 1946).

    Args:
        of_parts: mean squares ``(n,)`` of the parts whose sizes are known with so many degrees of freedom.
    """
    mean = np.maximum(np.trace(squares, axis1=1, axis2=2), _LEAST_M2)
    numbers = np.clip(matched_dof(mean, np.maximum(2 * (squares**2).sum(axis=(1, 2)), _LEAST_M2**2)), 1.0, 3.0)
    spread = sum(part**2 / dof for part, dof in zip(of_parts, dofs, strict=True))
    dof = mean**2 / np.maximum(spread, mean**2 / _ENDLESS)
    return np.asarray(np.sqrt(mean * f_isf(_SHARE, numbers, dof)))


def _sizes(slopes: Array) -> Array:
    """Root mean square ``(n,)`` m of errors with independent causes, by derivatives ``(n, 3, m)``."""
    return np.asarray(np.sqrt((slopes**2).sum(axis=(1, 2))))
