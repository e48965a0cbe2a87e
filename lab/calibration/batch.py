"""Many identifications at once: campaigns with arms of one drawing at the same poses, solved in blocks.

A block always holds as many campaigns, the last one padded: a matrix product's last bits change with its size.
The base is no unknown of size here: each campaign's points are first turned onto the drawing (``aligned``), so that
every fit begins with the base at rest, and one Jacobian can serve all.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.serial.batch import Stacked

BLOCK = 50
MAX_STEPS = 20
SETTLED_M = 1e-9  # root mean square move of the predicted points: the step is still taken
CHORD_SETTLED_M = 1e-8  # the same of the chord method, which gains two digits a step


@dataclass(frozen=True)
class Campaigns:
    """What was measured in some campaigns at the same poses, each turned onto the drawing.

    Attributes:
        joints: ``(n, joints)``.
        points: ``(b, k, 3, n)`` m.
        Ts_instrument_drawing: ``(b, 4, 4)``, how they were turned: the drawing's frame 0 in the instrument's.
        whiten: ``(b, k, 3, 3, n)``, of the points as they are turned; None where all coordinates weigh alike.
    """

    joints: Array
    points: Array
    Ts_instrument_drawing: Array
    whiten: Array | None = None

    def __len__(self) -> int:
        return len(self.points)

    def block(self, rows: NDArray[np.int_]) -> "Campaigns":
        """Some of them."""
        whiten = None if self.whiten is None else self.whiten[rows]
        return Campaigns(self.joints, self.points[rows], self.Ts_instrument_drawing[rows], whiten)


@dataclass(frozen=True)
class Fits:
    """Where the fits ended.

    Attributes:
        values: ``(b, p)``, the base relative to ``Ts_instrument_drawing``.
        converged, steps: ``(b,)``.
        information: ``(b, f, f)`` J' J of the free parameters, whitened where that was asked for.
    """

    values: Array
    converged: NDArray[np.bool_]
    steps: NDArray[np.int_]
    information: Array


def aligned(arm: Stacked, joints: Array, points: Array, nominal: Array) -> Campaigns:
    """Campaigns turned onto the drawing: by the rotation that fits their points best (Kabsch 1976), and the means.

    Args:
        points: ``(b, n, k, 3)`` m in the instrument's frame.
        nominal: parameters ``(p,)`` of the drawing.
    """
    drawn = _still(arm, joints, nominal)  # (k, 3, n)
    seen = points.transpose(0, 2, 3, 1)  # (b, k, 3, n)
    centre, middle = drawn.mean(axis=(0, 2)), seen.mean(axis=(1, 3))
    moment = np.einsum("bkin,kjn->bij", seen - middle[:, None, :, None], drawn - centre[:, None])
    u, _, vt = np.linalg.svd(moment)
    flip = np.ones((len(points), 3))
    flip[:, 2] = np.linalg.det(u @ vt)
    turns = (u * flip[:, None]) @ vt
    Ts = se3.pose(turns, middle - turns @ centre)
    return Campaigns(joints, in_drawing(points, Ts), Ts)


def in_drawing(points: Array, Ts_instrument_drawing: Array) -> Array:
    """Points ``(b, n, k, 3)`` (or of all alike ``(n, k, 3)``) turned onto the drawing, ``(b, k, 3, n)``."""
    moved = (points - Ts_instrument_drawing[:, None, None, :3, 3]) @ Ts_instrument_drawing[:, None, :3, :3]
    return moved.transpose(0, 2, 3, 1)


def fit_many(
    arm: Stacked,
    campaigns: Campaigns,
    nominal: Array,
    free: Sequence[int],
    *,
    frozen: bool = False,
    block: int = BLOCK,
) -> Fits:
    """Gauss-Newton from the drawing for every campaign, block by block.

    Args:
        nominal: parameters ``(p,)`` of the drawing.
        frozen: take the drawing's Jacobian for all steps (the chord method).
        block: how many are solved together.
    """
    count = len(campaigns)
    order = np.arange(-(-count // block) * block)
    order[count:] = 0
    solve = _chord if frozen else _newton
    start = nominal.copy()
    start[:6] = 0.0
    parts = [
        solve(arm, campaigns.block(order[at : at + block]), start, list(free)) for at in range(0, len(order), block)
    ]
    values, converged, steps, information = (np.concatenate(part)[:count] for part in zip(*parts, strict=True))
    return Fits(values, converged, steps, information)


Part = tuple[Array, NDArray[np.bool_], NDArray[np.int_], Array]


def _newton(arm: Stacked, block: Campaigns, start: Array, free: list[int]) -> Part:
    """Full Gauss-Newton by normal equations of unit columns: a base set's condition leaves them ten digits."""
    values = np.tile(start, (len(block), 1))
    converged, steps = np.zeros(len(block), dtype=np.bool_), np.zeros(len(block), dtype=np.int_)
    information = np.empty((len(block), len(free), len(free)))
    for _ in range(MAX_STEPS):
        rows, residual = _linearized(arm, block, values, free)
        scale = np.sqrt(np.einsum("bfr,bfr->bf", rows, rows))
        rows /= scale[:, :, None]
        square = rows @ rows.swapaxes(1, 2)
        step = np.linalg.solve(square, rows @ residual[:, :, None])[:, :, 0]
        moved = np.sqrt(np.einsum("bf,bfg,bg->b", step, square, step) / block.joints.shape[0])
        going = ~converged
        values[:, free] += np.where(going[:, None], step / scale, 0.0)
        information[going] = (square * scale[:, :, None] * scale[:, None, :])[going]
        steps += going
        converged |= moved < SETTLED_M * _metre(block)
        if converged.all():
            break
    return values, converged, steps, information


def _chord(arm: Stacked, block: Campaigns, start: Array, free: list[int]) -> Part:
    """Gauss-Newton with the Jacobian at the start for all steps: x += pinv(J0) r."""
    assert block.whiten is None
    _, jacobian = arm.observe(block.joints, start[None], free)  # (f, 3, k, 1, n)
    rows = jacobian[:, :, :, 0].transpose(0, 2, 1, 3).reshape(len(free), -1)
    scale = np.linalg.norm(rows, axis=1)
    inverse = np.linalg.pinv((rows / scale[:, None]).T) / scale[:, None]  # (f, r)
    values = np.tile(start, (len(block), 1))
    converged, steps = np.zeros(len(block), dtype=np.bool_), np.zeros(len(block), dtype=np.int_)
    for _ in range(MAX_STEPS):
        residual = (block.points - arm.points(block.joints, values)).reshape(len(block), -1)
        step = residual @ inverse.T
        moved = np.sqrt(((step @ rows) ** 2).sum(axis=1) / block.joints.shape[0])
        going = ~converged
        values[:, free] += np.where(going[:, None], step, 0.0)
        steps += going
        converged |= moved < CHORD_SETTLED_M
        if converged.all():
            break
    return values, converged, steps, np.tile(rows @ rows.T, (len(block), 1, 1))


def _linearized(arm: Stacked, block: Campaigns, values: Array, free: list[int]) -> tuple[Array, Array]:
    """Whitened Jacobian rows ``(b, f, r)`` and residual ``(b, r)``."""
    points, jacobian = arm.observe(block.joints, values, free)
    residual = block.points - points  # (b, k, 3, n)
    rows = jacobian.transpose(3, 0, 2, 1, 4)  # (b, f, k, 3, n)
    if block.whiten is not None:
        residual = np.einsum("bkijn,bkjn->bkin", block.whiten, residual)
        rows = np.einsum("bkijn,bfkjn->bfkin", block.whiten, rows)
    return rows.reshape(len(values), len(free), -1), residual.reshape(len(values), -1)


def _metre(block: Campaigns) -> float:
    """What a metre weighs."""
    return 1.0 if block.whiten is None else float(np.sqrt((block.whiten**2).sum() / block.points.size))


def _still(arm: Stacked, joints: Array, nominal: Array) -> Array:
    """The drawing's points ``(k, 3, n)`` in frame 0."""
    values = nominal.copy()
    values[:6] = 0.0
    still: Array = arm.points(joints, values[None])[0]
    return still
