"""Fit many campaigns at once by Gauss-Newton: arms of one nominal model, solved in blocks by normal equations.

A batch is of positions at poses that all campaigns share (``PointBatch``), or of positions and orientations at joint
positions of their own (``PoseBatch``). A block always has as many campaigns, the last one padded: a matrix product's
last bits change with its size.

Points are first turned onto the nominal model (``align``), so that every fit begins with the base at rest, and one
Jacobian can serve all. Residuals of poses are those of ``sensors.full_pose``: a target's position, and
log(R_measured' R_predicted) of a frame fixed to it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.calibration.observation import ROTATION_PARAMETERS
from lab.core import se3
from lab.core.newton import newton
from lab.core.se3 import Array
from lab.kinematics.compiled.kernels import solve_positive
from lab.kinematics.compiled.numpy_kernels import walk_stacked
from lab.kinematics.parameter import Parameter, names_of
from lab.kinematics.serial.serial_arm import SerialArm, Stacked
from lab.kinematics.serial.walk import ElementaryMotion

__all__ = [
    "BLOCK",
    "MAX_STEPS",
    "BatchFits",
    "MeasuredPoses",
    "PointBatch",
    "StackedPoseArm",
    "align",
    "fit_points",
    "fit_poses",
    "in_nominal_frame",
    "in_the_instruments_frame",
    "weighted",
]

BLOCK = 50  # campaigns solved together: what fits the processor's cache
MAX_STEPS = 20
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


def _fit_batch(
    observed: "PointBatch | _PoseBatch",
    start: Array,
    free: Sequence[int],
    *,
    frozen: bool = False,
    shortest: bool = False,
    max_steps: int = MAX_STEPS,
    block: int = BLOCK,
) -> BatchFits:
    """Least squares over the free parameters of every campaign, block by block, the others held.

    Args:
        start: ``(b, p)``, or ``(p,)`` for all alike.
        frozen: take the Jacobian at the start of the first campaign for all steps (the chord method).
        shortest: take the shortest step in unit columns where parameters are not identifiable; else all must be.
    """
    count = len(observed)
    order = np.arange(-(-count // block) * block)
    order[count:] = 0
    starts = np.broadcast_to(start, (count, np.shape(start)[-1]))
    parts = []
    for first in range(0, len(order), block):
        rows = order[first : first + block]
        some, values, unknowns = observed.take(rows), starts[rows].copy(), list(free)
        if frozen:
            parts.append(_chord(some, values, unknowns, max_steps))
        else:
            parts.append(_gauss_newton(some, values, unknowns, shortest, max_steps))
    return BatchFits(*(np.concatenate(part)[:count] for part in zip(*parts, strict=True)))


_Part = tuple[Array, NDArray[np.bool_], NDArray[np.int_], Array]


def _gauss_newton(
    block: "PointBatch | _PoseBatch", values: Array, free: list[int], shortest: bool, max_steps: int
) -> _Part:
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
        scaled = _shortest(square, right) if shortest else _solved(square, right)
        squares = np.einsum("bf,bfg,bg->b", scaled, square, scaled)
        information[going] = products[going]
        return scaled / scale, block.settled(scaled / scale, squares, _SETTLED)

    solution = newton(step, values[:, free], max_steps)
    values[:, free] = solution.values
    return values, solution.converged, solution.iterations, information


def _solved(matrices: Array, right: Array) -> Array:
    try:
        return solve_positive(matrices, right)
    except np.linalg.LinAlgError:  # the poses do not show a parameter of some campaign
        finite = np.isfinite(matrices).all(axis=(1, 2))
        step = np.full(right.shape, np.nan)
        step[finite] = _shortest(matrices[finite], right[finite])
        return step


def _shortest(matrices: Array, right: Array) -> Array:
    inverse = np.linalg.pinv(matrices, rcond=_RANK_TOLERANCE, hermitian=True)
    return np.asarray(np.einsum("bfg,bg->bf", inverse, right))


def _chord(block: "PointBatch | _PoseBatch", values: Array, free: list[int], max_steps: int) -> _Part:
    """Take the Jacobian at the first campaign's start for all campaigns and steps: x += pinv(J0) r."""
    first = np.zeros(1, dtype=np.int_)
    rows = block.take(first).linearized(values[first], free)[0][0]  # (f, r)
    scale = np.linalg.norm(rows, axis=1)
    inverse = np.linalg.pinv((rows / scale[:, None]).T) / scale[:, None]  # (f, r)

    def step(unknowns: Array, _: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        values[:, free] = unknowns
        change = block.residual(values) @ inverse.T
        return change, block.settled(change, ((change @ rows) ** 2).sum(axis=1), _CHORD_SETTLED)

    solution = newton(step, values[:, free], max_steps)
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
    start = _base_at_rest(nominal) if nominal.ndim == 1 else nominal
    return _fit_batch(observed, start, free, frozen=frozen, block=block)


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


@dataclass(frozen=True)
class MeasuredPoses:
    """Poses measured in some campaigns.

    Attributes:
        joints: joint positions ``(b, n, joints)``.
        points: positions ``(b, n, 3)`` m.
        rotations: ``(b, n, 3, 3)`` of the target's frame.
    """

    joints: Array
    points: Array
    rotations: Array

    def __len__(self) -> int:
        return len(self.points)

    def take(self, rows: NDArray[np.int_]) -> "MeasuredPoses":
        """Select campaigns."""
        return MeasuredPoses(self.joints[rows], self.points[rows], self.rotations[rows])


@dataclass(frozen=True)
class StackedPoseArm:
    """Arms of one nominal model with a target whose pose is measured; their parameters are rows ``(b, p)``.

    Attributes:
        parameters: the arm's, then the rotation vector of the target's frame in the last one.
    """

    arm: SerialArm
    parameters: tuple[Parameter, ...] = field(init=False)
    names: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        assert len(self.arm.targets) == 1
        parameters = (*self.arm.parameters, *ROTATION_PARAMETERS)
        object.__setattr__(self, "parameters", parameters)
        object.__setattr__(self, "names", names_of(parameters))

    def nominal(self) -> Array:
        """Return the nominal parameters ``(p,)`` with the default tool, the target's frame along the last one."""
        return np.concatenate([self.arm.nominal(), np.zeros(3)])

    def columns(self, names: Sequence[str]) -> list[int]:
        """Return the indices of parameters by name."""
        return [self.names.index(name) for name in names]

    def poses(self, joints: Array, values: Array) -> tuple[Array, Array]:
        """Positions ``(b, n, 3)`` and rotations ``(b, n, 3, 3)`` at joint positions ``(b, n, joints)``."""
        _, point, rotation = self._walk(joints, values)
        return point[:3].transpose(1, 2, 0), rotation

    def observe(self, joints: Array, values: Array, free: Sequence[int]) -> tuple[Array, Array, Array, Array]:
        """Return the poses, and moves of position and turns by some parameters, each ``(b, n, 3, f)``.

        A turn is a small rotation vector in the instrument's frame, by which the rotation is multiplied on its left.
        """
        motions, point, rotation = self._walk(joints, values)
        moves, turns = np.zeros((2, len(free), 3, *point.shape[1:]))
        slot = {parameter: i for i, parameter in enumerate(free)}
        for motion in motions:
            i = slot.get(motion.column)
            if i is None:
                continue
            if motion.origin is None:
                moves[i] = motion.axis[:3]
                continue
            lever = point - motion.origin
            moves[i] = motion.axis[1:4] * lever[2:5] - motion.axis[2:5] * lever[1:4]
            turns[i] = motion.axis[:3]
        # the rotation is R exp(v): a change dv turns it by R J_l(v) dv = R exp(v) J_l(-v) dv
        vector = values[:, None, -3:]
        turning = rotation @ se3.left_jacobian(-vector)
        for k, column in enumerate(range(len(self.names) - 3, len(self.names))):
            if column in slot:
                turns[slot[column]] = np.moveaxis(turning[..., k], 2, 0)
        return point[:3].transpose(1, 2, 0), rotation, moves.transpose(2, 3, 1, 0), turns.transpose(2, 3, 1, 0)

    def _walk(self, joints: Array, values: Array) -> tuple[list[ElementaryMotion], Array, Array]:
        motions, points, frame = walk_stacked(self.arm, joints, values[:, :-3], 5)
        first = len(self.arm.names) - 3
        motions += [ElementaryMotion(column, axis, None) for column, axis in enumerate(frame, start=first)]
        last = np.stack([axis[:3] for axis in frame], axis=-1).transpose(1, 2, 0, 3)
        return motions, points[:, 0], last @ se3.exp(values[:, None, -3:])


@dataclass(frozen=True)
class _PoseBatch:
    """Measured poses of b campaigns with their weights and the arms that predict them, as ``batch`` fits them.

    Attributes:
        position_weight: one over the standard deviation of a coordinate, 1/m; 0 leaves positions out.
        rotation_weight: ``(3,)`` that of a rotation about the axes of the target's frame, 1/rad; 0 leaves them out.
    """

    model: StackedPoseArm
    measured: MeasuredPoses
    position_weight: float
    rotation_weight: Array

    def __len__(self) -> int:
        return len(self.measured)

    def take(self, rows: NDArray[np.int_]) -> "_PoseBatch":
        """Select campaigns."""
        return replace(self, measured=self.measured.take(rows))

    def residual(self, values: Array) -> Array:
        """Whitened residual ``(b, r)`` at parameters ``(b, p)``."""
        return self._residual(*self.model.poses(self.measured.joints, values))

    def linearized(self, values: Array, free: Sequence[int]) -> tuple[Array, Array]:
        """Whitened derivatives ``(b, f, r)`` and residual ``(b, r)`` at parameters ``(b, p)``."""
        points, rotations, moves, turns = self.model.observe(self.measured.joints, values, free)
        rows = []
        if self.position_weight:
            rows.append(self.position_weight * moves)
        if self.rotation_weight.any():
            vector = self._rotation_errors(rotations)
            back = self.measured.rotations.swapaxes(2, 3)
            rows.append(self.rotation_weight[:, None] * np.linalg.solve(se3.left_jacobian(vector), back @ turns))
        columns = np.concatenate(rows, 1).reshape(len(values), -1, len(free)).swapaxes(1, 2)
        return columns, self._residual(points, rotations)

    def settled(self, step: Array, squares: Array, tolerance: float) -> NDArray[np.bool_]:
        """Check whether no parameter moves by more than the tolerance (m or rad)."""
        return np.asarray(np.abs(step).max(axis=1) < tolerance)

    def _rotation_errors(self, rotations: Array) -> Array:
        """log(R_measured' R_predicted) ``(b, n, 3)``."""
        return se3.log(self.measured.rotations.swapaxes(2, 3) @ rotations)

    def _residual(self, points: Array, rotations: Array) -> Array:
        parts = []
        if self.position_weight:
            parts.append(self.position_weight * (self.measured.points - points))
        if self.rotation_weight.any():
            parts.append(-self.rotation_weight * self._rotation_errors(rotations))
        return np.concatenate(parts, 1).reshape(len(points), -1)


def fit_poses(
    model: StackedPoseArm,
    measured: MeasuredPoses,
    start: Array,
    free: Sequence[int],
    *,
    position_weight: float = 0.0,
    rotation_weight: float | Array = 0.0,
    max_steps: int = MAX_STEPS,
) -> BatchFits:
    """Gauss-Newton from ``start`` ``(b, p)`` over the free parameters of every campaign, the others held.

    Where the free parameters are not identifiable, each step is the shortest (in unit columns).

    Args:
        position_weight: one over the standard deviation of a coordinate, 1/m; 0 leaves positions out.
        rotation_weight: that of a rotation, 1/rad, of all axes or ``(3,)`` of the target's frame; 0 leaves them out.
    """
    weights = np.broadcast_to(np.asarray(rotation_weight, dtype=np.float64), 3)
    observed = _PoseBatch(model, measured, position_weight, weights)
    return _fit_batch(observed, start, free, shortest=True, max_steps=max_steps)
