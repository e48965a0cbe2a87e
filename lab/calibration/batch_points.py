"""Positions of targets in many campaigns at the same poses, as ``batch`` fits them.

The base is no unknown of size here: each campaign's points are first turned onto the nominal model (``align``), so
that every fit begins with the base at rest, and one Jacobian can serve all.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.calibration.batch import BLOCK, BatchFits, fit_batch
from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.serial.batch import Stacked

__all__ = ["PointBatch", "align", "fit_points", "in_nominal_frame"]


@dataclass(frozen=True)
class PointBatch:
    """What was measured in b campaigns at the same n poses, each turned onto the nominal model.

    Attributes:
        arm: arms of one nominal model, which predict the k targets.
        joints: joint positions ``(n, joints)``.
        points: ``(b, k, 3, n)`` m, in the nominal model's frame 0.
        Ts_instrument_nominal: ``(b, 4, 4)``, how they were turned: the nominal model's frame 0 in the instrument's.
        whiten: ``(b, k, 3, 3, n)`` 1/m, of the points as they are turned; None where all coordinates weigh alike.
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
        """What a metre of a coordinate weighs."""
        return 1.0 if self.whiten is None else float(np.sqrt((self.whiten**2).sum() / self.points.size))

    def take(self, rows: NDArray[np.int_]) -> "PointBatch":
        """Some of the campaigns."""
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
        """Whether a pose's predicted points move by less than the tolerance (m, root mean square)."""
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


def in_nominal_frame(points: Array, Ts_instrument_nominal: Array) -> Array:
    """Points ``(b, n, k, 3)`` m of the instrument's frame, or of all alike ``(n, k, 3)``, in the nominal model's.

    Args:
        points: in the instrument's frame.
        Ts_instrument_nominal: ``(b, 4, 4)``.

    Returns:
        ``(b, k, 3, n)`` m.
    """
    moved = (points - Ts_instrument_nominal[:, None, None, :3, 3]) @ Ts_instrument_nominal[:, None, :3, :3]
    return moved.transpose(0, 2, 3, 1)


def fit_points(
    observed: PointBatch, nominal: Array, free: Sequence[int], *, frozen: bool = False, block: int = BLOCK
) -> BatchFits:
    """Gauss-Newton from the nominal model for every campaign; the base is relative to ``Ts_instrument_nominal``.

    Args:
        nominal: parameters ``(p,)`` of the nominal model.
        free: indices of the parameters to fit.
        frozen: take the nominal model's Jacobian for all steps (the chord method); only where nothing is whitened.
        block: how many campaigns are solved together.
    """
    assert not frozen or observed.whiten is None
    return fit_batch(observed, _base_at_rest(nominal), free, frozen=frozen, block=block)


def _base_at_rest(nominal: Array) -> Array:
    """The parameters ``(p,)`` with frame 0 in the nominal model's place."""
    values = nominal.copy()
    values[:6] = 0.0
    return values
