"""Fit many campaigns at once by Gauss-Newton: arms of one nominal model, solved in blocks by normal equations.

A batch is of positions at poses that all campaigns share (``PointBatch``). A block always has as many campaigns, the
last one padded: a matrix product's last bits change with its size. Points are first turned onto the nominal model
(``align``), so that every fit begins with the base at rest, and one Jacobian can serve all.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.newton import newton
from lab.core.se3 import Array
from lab.kinematics.compiled.kernels import solve_positive
from lab.kinematics.serial.serial_arm import Stacked

__all__ = [
    "BLOCK",
    "BatchFits",
    "PointBatch",
    "align",
    "fit_points",
    "in_nominal_frame",
    "in_the_instruments_frame",
    "weighted",
]

BLOCK = 50  # campaigns solved together: what fits the processor's cache
_MAX_STEPS = 20
_SETTLED = 1e-9  # m or rad: a step below is still taken, so that what remains is its square
_CHORD_SETTLED = 1e-8  # of the chord method, which gains two digits a step
_RANK_TOLERANCE = 1e-10  # of the normal equations of unit columns


@dataclass(frozen=True)
class BatchFits:
    """Results of a batch of fits.

    Attributes:
        values: ``(b, p)`` the parameters.
        information: ``(b, f, f)`` J' J of the free parameters, whitened as the observation is.
    """

    values: Array
    converged: NDArray[np.bool_]
    steps: NDArray[np.int_]
    information: Array


_Part = tuple[Array, NDArray[np.bool_], NDArray[np.int_], Array]


def _gauss_newton(block: "PointBatch", values: Array, free: list[int]) -> _Part:
    """Solve normal equations of unit columns: the condition of a base set leaves them ten digits."""
    information = np.empty((len(block), len(free), len(free)))

    def step(unknowns: Array, going: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        values[:, free] = unknowns
        columns, residual = block.linearized(values, free)
        products = columns @ columns.swapaxes(1, 2)
        scale = np.sqrt(np.diagonal(products, axis1=1, axis2=2))
        scale = np.where(scale == 0, 1.0, scale)
        square = products / (scale[:, :, None] * scale[:, None, :])
        right = (columns @ residual[:, :, None])[:, :, 0] / scale
        scaled = _solved(square, right)
        squares = np.einsum("bf,bfg,bg->b", scaled, square, scaled)
        information[going] = products[going]
        return scaled / scale, block.settled(scaled / scale, squares, _SETTLED)

    solution = newton(step, values[:, free], _MAX_STEPS)
    values[:, free] = solution.values
    return values, solution.converged, solution.iterations, information


def _solved(matrices: Array, right: Array) -> Array:
    try:
        return solve_positive(matrices, right)
    except np.linalg.LinAlgError:  # the poses do not show a parameter of some campaign
        finite = np.isfinite(matrices).all(axis=(1, 2))
        step = np.full(right.shape, np.nan)
        inverse = np.linalg.pinv(matrices[finite], rcond=_RANK_TOLERANCE, hermitian=True)
        step[finite] = np.einsum("bfg,bg->bf", inverse, right[finite])
        return step


def _chord(block: "PointBatch", values: Array, free: list[int]) -> _Part:
    """Take the Jacobian at the first campaign's start for all campaigns and steps: x += pinv(J0) r."""
    first = np.zeros(1, dtype=np.int_)
    rows = block.take(first).linearized(values[first], free)[0][0]  # (f, r)
    scale = np.linalg.norm(rows, axis=1)
    inverse = np.linalg.pinv((rows / scale[:, None]).T) / scale[:, None]  # (f, r)

    def step(unknowns: Array, _: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        values[:, free] = unknowns
        change = block.residual(values) @ inverse.T
        return change, block.settled(change, ((change @ rows) ** 2).sum(axis=1), _CHORD_SETTLED)

    solution = newton(step, values[:, free], _MAX_STEPS)
    values[:, free] = solution.values
    return values, solution.converged, solution.iterations, np.tile(rows @ rows.T, (len(block), 1, 1))


@dataclass(frozen=True)
class PointBatch:
    """Points measured in b campaigns at the same n poses, each aligned with the nominal model.

    Attributes:
        arm: arms of one nominal model, which predict the k targets.
        joints: joint positions ``(n, joints)``.
        points: ``(b, k, 3, n)`` m, in the nominal model's frame 0.
        Ts_instrument_nominal: ``(b, 4, 4)``, their alignment: the nominal model's frame 0 in the instrument's.
        whiten: ``(b, k, 3, 3, n)`` 1/m, of the aligned points; None where all coordinates have the same weight.
    """

    arm: Stacked
    joints: Array
    points: Array
    Ts_instrument_nominal: Array
    whiten: Array | None = None

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def metre(self) -> float:
        """Weight of one metre of a coordinate."""
        return 1.0 if self.whiten is None else float(np.sqrt((self.whiten**2).sum() / self.points.size))

    def take(self, rows: NDArray[np.int_]) -> "PointBatch":
        """Select campaigns."""
        whiten = None if self.whiten is None else self.whiten[rows]
        return replace(
            self, points=self.points[rows], Ts_instrument_nominal=self.Ts_instrument_nominal[rows], whiten=whiten
        )

    def residual(self, values: Array) -> Array:
        """Whitened residual ``(b, 3 k n)`` at parameters ``(b, p)``."""
        residual = self.points - self.arm.points(self.joints, values)
        return self._whitened(residual).reshape(len(values), -1)

    def linearized(self, values: Array, free: Sequence[int]) -> tuple[Array, Array]:
        """Whitened derivatives ``(b, f, 3 k n)`` and residual ``(b, 3 k n)`` at parameters ``(b, p)``."""
        points, jacobian = self.arm.observe(self.joints, values, free)
        columns = jacobian.transpose(3, 0, 2, 1, 4)  # (b, f, k, 3, n)
        if self.whiten is not None:
            columns = np.einsum("bkijn,bfkjn->bfkin", self.whiten, columns)
        residual = self._whitened(self.points - points)
        return columns.reshape(len(values), len(free), -1), residual.reshape(len(values), -1)

    def settled(self, step: Array, squares: Array, tolerance: float) -> NDArray[np.bool_]:
        """Check whether a pose's predicted points move by less than the tolerance (m, root mean square)."""
        return np.asarray(np.sqrt(squares / self.joints.shape[0]) < tolerance * self.metre)

    def _whitened(self, residual: Array) -> Array:
        return residual if self.whiten is None else np.einsum("bkijn,bkjn->bkin", self.whiten, residual)


def align(arm: Stacked, joints: Array, points: Array, nominal: Array) -> PointBatch:
    """Turn campaigns onto the nominal model by the rotation that fits their points best (Kabsch 1976), and the means.

    Args:
        arm: arms of one nominal model.
        joints: joint positions ``(n, joints)``.
        points: ``(b, n, k, 3)`` m in the instrument's frame.
        nominal: parameters ``(p,)`` of the nominal model.
    """
    predicted = arm.points(joints, _base_at_rest(nominal)[None])[0]  # (k, 3, n)
    measured = points.transpose(0, 2, 3, 1)  # (b, k, 3, n)
    centre, middle = predicted.mean(axis=(0, 2)), measured.mean(axis=(1, 3))
    moment = np.einsum("bkin,kjn->bij", measured - middle[:, None, :, None], predicted - centre[:, None])
    u, _, vt = np.linalg.svd(moment)
    flip = np.ones((len(points), 3))
    flip[:, 2] = np.linalg.det(u @ vt)
    rotations = (u * flip[:, None]) @ vt
    Ts = se3.pose(rotations, middle - rotations @ centre)
    return PointBatch(arm, joints, in_nominal_frame(points, Ts), Ts)


def weighted(campaigns: PointBatch, whiten: Array) -> PointBatch:
    """Return campaigns with the weights of their measured points.

    Args:
        whiten: ``(b, n, k, 3, 3)`` 1/m, the inverse of the covariance's Cholesky factor in the instrument's frame.
    """
    turned = whiten @ campaigns.Ts_instrument_nominal[:, None, None, :3, :3]
    return replace(campaigns, whiten=turned.transpose(0, 2, 3, 4, 1))


def in_nominal_frame(points: Array, Ts_instrument_nominal: Array) -> Array:
    """Points ``(b, n, k, 3)`` m of the instrument's frame, or of all alike ``(n, k, 3)``, in the nominal model's.

    Args:
        Ts_instrument_nominal: ``(b, 4, 4)``.

    Returns:
        ``(b, k, 3, n)`` m.
    """
    moved = (points - Ts_instrument_nominal[:, None, None, :3, 3]) @ Ts_instrument_nominal[:, None, :3, :3]
    return moved.transpose(0, 2, 3, 1)


def fit_points(
    observed: PointBatch, nominal: Array, free: Sequence[int], *, frozen: bool = False, block: int = BLOCK
) -> BatchFits:
    """Gauss-Newton for every campaign; the base is relative to ``Ts_instrument_nominal``.

    Args:
        nominal: parameters ``(p,)`` of the nominal model, from which all campaigns start with the base at rest; or the
            start ``(b, p)`` of each.
        free: indices of the parameters to fit.
        frozen: take the nominal model's Jacobian for all steps (the chord method); only where nothing is whitened.
    """
    assert not frozen or observed.whiten is None
    count, start = len(observed), _base_at_rest(nominal) if nominal.ndim == 1 else nominal
    order = np.arange(-(-count // block) * block)
    order[count:] = 0
    starts, fit = np.broadcast_to(start, (count, start.shape[-1])), _chord if frozen else _gauss_newton
    blocks = (order[first : first + block] for first in range(0, len(order), block))
    parts = [fit(observed.take(rows), starts[rows].copy(), list(free)) for rows in blocks]
    return BatchFits(*(np.concatenate(part)[:count] for part in zip(*parts, strict=True)))


def in_the_instruments_frame(campaigns: PointBatch, values: Array) -> Array:
    """Return parameters ``(b, p)`` with the base in the instrument's frame, of those relative to the alignment."""
    turned = values.copy()
    Ts = campaigns.Ts_instrument_nominal @ se3.pose(se3.exp(values[:, 3:6]), values[:, :3])
    turned[:, :3], turned[:, 3:6] = Ts[:, :3, 3], se3.log(Ts[:, :3, :3])
    return turned


def _base_at_rest(nominal: Array) -> Array:
    values = nominal.copy()
    values[:6] = 0.0
    return values
