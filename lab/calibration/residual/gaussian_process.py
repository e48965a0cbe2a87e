"""Model joint offsets as a Gaussian process, conditioned on measurements, beside parameters estimated with it.

What is measured is y = X b + Z f + e: parameters b without a prior, offsets f of the joints through the derivatives Z
by their positions, and noise. The best linear unbiased prediction and its covariance are those of universal kriging
(Cressie 1993, section 3.4). The variances of f are estimates: with fixed weights the variance of a predicted point is
linear in them, and its upper quartile follows from their covariance, and counts far from all measured poses. Near them
a factor of the predicted variance is chosen so that 95 % of the poses left out in turn lie within their 95 % bounds
(``estimation``).

Each joint is off by the sum of a function of its own position, as gears are, and one of all positions, as compliant
links are. Either is a sum of stationary processes of several lengths (Rasmussen & Williams 2006, section 4.2): Matern's
with 3/2 of the own position; with 1/2 of all, which assumes no smoothness, and with 5/2 and longer lengths, as the sag
of springs varies. Distances of hinges are chords, 2 sin(d / 2); a slide's are in units of 0.3 m.

All numbers of one pose depend on the same offsets. A pose with three targets has nine numbers and six joints: an
orthogonal transformation leaves six that depend on the offsets and three with the noise alone. The likelihood is that
of all nine, and the covariance matrix is two thirds as large.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.core.linear_model import unit_columns
from lab.core.measurements import evenly
from lab.core.se3 import Array
from lab.core.units import PPM
from lab.kinematics.effects.arm_with_effects import Arm, ArmWithEffects, affected
from lab.kinematics.effects.effect import LEVER_M, Effect
from lab.kinematics.model import RigidArm
from lab.kinematics.parameter import Parameter

__all__ = [
    "COMPONENTS",
    "GROUP",
    "UPPER_QUARTILE",
    "JointKernels",
    "JointProcess",
    "PoseNumbers",
    "PredictedBy",
    "Reduction",
    "Support",
    "covariance",
    "precisions",
    "scaled_by",
    "unit_covariances",
]

_OWN = (0.05, 0.2, 0.8)  # rad: lengths of the functions of a joint's own position
_ALL = (0.1, 0.4, 1.6)  # of those of all positions
_SMOOTH = (1.0, 4.0)  # of smooth functions of all positions
COMPONENTS = (
    *("noise", "scatter"),
    *(f"own {size:g}" for size in _OWN),
    *(f"all {size:g}" for size in _ALL),
    *(f"smooth {size:g}" for size in _SMOOTH),
)


@dataclass(frozen=True)
class JointKernels:
    """The processes of an arm's joints.

    Attributes:
        turning: ``(joints,)`` which joints turn.
    """

    turning: NDArray[np.bool_]

    def of_offsets(self, first: Array, second: Array) -> Iterator[tuple[bool, Array]]:
        """Unit covariances of the offsets at joint positions ``(n, joints)`` and ``(m, joints)``, one a length.

        Yields:
            Whether it is of each joint's own position; ``(n, m, joints)`` if so, else ``(n, m)``, of every joint.
        """
        apart = first[:, None] - second
        apart = np.where(self.turning, 2 * np.sin(apart / 2), apart / LEVER_M)
        own = np.abs(apart)
        whole = np.sqrt((apart**2).sum(axis=2))
        for size in _OWN:
            scaled = np.sqrt(3) * own / size
            yield True, (1 + scaled) * np.exp(-scaled)
        for size in _ALL:
            yield False, np.exp(-whole / size)
        for size in _SMOOTH:
            scaled = np.sqrt(5) * whole / size
            yield False, (1 + scaled + scaled**2 / 3) * np.exp(-scaled)

    def of_joints(self, sizes: Array, first: Array, second: Array) -> Array:
        """Covariances ``(joints, n, m)`` of each joint's offsets: the sum of all lengths with these variances.

        Args:
            sizes: ``(lengths,)`` in the order of ``of_offsets``.
            first, second: joint positions ``(n, joints)`` and ``(m, joints)``.
        """
        found = np.zeros((first.shape[1], len(first), len(second)))
        for (own, kernel), size in zip(self.of_offsets(first, second), sizes, strict=True):
            if size > 0:
                found += size * (np.moveaxis(kernel, 2, 0) if own else kernel)
        return found


_BLOCK_ROWS = 1_000  # rows of a covariance matrix that are worked out at once, which bounds the memory


@dataclass(frozen=True)
class PoseNumbers:
    """Numbers that depend on the offsets of the joints.

    Attributes:
        joints: ``(n, joints)`` positions of the poses.
        pose: ``(N,)`` the pose of each number, ascending.
        slopes: ``(N, joints)`` derivatives by that pose's joint positions.
    """

    joints: Array
    pose: NDArray[np.int_]
    slopes: Array

    @classmethod
    def whole(cls, joints: Array, slopes: Array) -> "PoseNumbers":
        """Build from all coordinates of poses: positions ``(n, joints)``, derivatives ``(n, d, joints)``."""
        n, d, size = slopes.shape
        return cls(joints, np.repeat(np.arange(n), d), slopes.reshape(n * d, size))

    def per_joint(self, numbers: Array) -> Array:
        """Multiply the transposed derivatives by numbers ``(N, q)``: ``(joints, n, q)``."""
        first = np.flatnonzero(np.diff(self.pose, prepend=-1))
        found = np.zeros((self.slopes.shape[1], len(self.joints), numbers.shape[1]), dtype=numbers.dtype)
        there = self.pose[first]
        for joint, slope in enumerate(self.slopes.T.astype(numbers.dtype)):
            found[joint, there] = np.add.reduceat(slope[:, None] * numbers, first, axis=0)
        return found


@dataclass(frozen=True)
class Reduction:
    """An orthogonal transformation of the numbers of each pose.

    Attributes:
        numbers: those that depend on the joints' offsets, N of them.
        groups: poses that saw the same targets: their rows, the numbers seen, and the transformations ``(m, s, s)``.
        order: ``(all,)`` where each transformed number belongs: the N first, those with the noise alone after them.
        alone: ``(M,)`` the pose of each number with the noise alone, ascending.
    """

    numbers: PoseNumbers
    groups: tuple[tuple[NDArray[np.int_], NDArray[np.int_], Array], ...]
    order: NDArray[np.int_]
    alone: NDArray[np.int_]

    @classmethod
    def of(cls, joints: Array, slopes: Array, seen: NDArray[np.bool_]) -> "Reduction":
        """Build the reduction of poses.

        Args:
            joints: ``(n, joints)``.
            slopes: ``(n, 3 k, joints)`` derivatives of all numbers.
            seen: ``(n, k)``.
        """
        size, groups = joints.shape[1], []
        poses, moved, reduced = [], [], []
        patterns, labels = np.unique(seen, axis=0, return_inverse=True)
        for label, pattern in enumerate(patterns):
            rows, retained = np.flatnonzero(labels.ravel() == label), np.flatnonzero(np.repeat(pattern, 3))
            some = slopes[rows][:, retained]
            if len(retained) > size:
                turn, left = np.linalg.qr(some, mode="complete")
            else:
                turn, left = np.broadcast_to(np.eye(len(retained)), (len(rows), len(retained), len(retained))), some
            groups.append((rows, retained, turn))
            poses.append(np.repeat(rows, len(retained)))
            moved.append(np.tile(np.arange(len(retained)) < size, len(rows)))
            reduced.append(left.reshape(-1, size))
        pose, by_offsets = np.concatenate(poses), np.concatenate(moved)
        order = np.lexsort((pose, ~by_offsets))
        count = int(by_offsets.sum())
        first = order[:count]
        numbers = PoseNumbers(joints, pose[first], np.concatenate(reduced)[first])
        return cls(numbers, tuple(groups), order, pose[order[count:]])

    def back(self, pose: int, matrix: Array) -> Array:
        """Transformed numbers of one pose ``(s, ...)``, those that the offsets move first, as they were measured."""
        for rows, _, turn in self.groups:
            if len(found := np.flatnonzero(rows == pose)):
                return np.asarray(turn[found[0]] @ matrix)
        raise KeyError(pose)

    def __call__(self, numbers: Array) -> tuple[Array, Array]:
        """Numbers ``(n, 3 k, ...)`` transformed: those that the offsets move ``(N, ...)``, and the others."""
        tail = numbers.shape[2:]
        parts = []
        for rows, seen_numbers, turn in self.groups:
            some = numbers[rows][:, seen_numbers].reshape(len(rows), len(seen_numbers), -1)
            parts.append((np.swapaxes(turn, 1, 2) @ some).reshape(-1, *tail))
        found, count = np.concatenate(parts)[self.order], len(self.numbers.pose)
        return found[:count], found[count:]


def covariance(kernels: JointKernels, sizes: Array, first: PoseNumbers, second: PoseNumbers | None = None) -> Array:
    """Covariance ``(N, M)`` of numbers, the noise aside, of processes with these variances.

    Args:
        sizes: ``(c,)`` of ``kernels.COMPONENTS``.
        first, second: the numbers; of one set without ``second``, and then with the scatter of each pose.
    """
    other = first if second is None else second
    found = np.zeros((len(first.pose), len(other.pose)))
    for joint, kernel in enumerate(kernels.of_joints(sizes[2:], first.joints, other.joints)):
        for start in range(0, len(found), _BLOCK_ROWS):
            rows = slice(start, start + _BLOCK_ROWS)
            whole = kernel[np.ix_(first.pose[rows], other.pose)]
            whole *= first.slopes[rows, joint, None]
            whole *= other.slopes[:, joint]
            found[rows] += whole
    if second is None:
        _add_scatter(found, sizes[1], first)
    return found


def unit_covariances(kernels: JointKernels, numbers: PoseNumbers) -> tuple[Array, ...]:
    """Covariances ``(N, N)`` of numbers by each component with a variance of one, the noise's first."""
    alone = np.eye(len(COMPONENTS))[2:]  # one component each
    scatter = np.zeros((len(numbers.pose), len(numbers.pose)))
    _add_scatter(scatter, 1.0, numbers)
    return np.eye(len(numbers.pose)), scatter, *(covariance(kernels, each, numbers) for each in alone)


def _add_scatter(found: Array, size: float, numbers: PoseNumbers) -> None:
    """Add the covariance of numbers by offsets of the joints that each pose has of its own."""
    for apart in range(int(np.bincount(numbers.pose).max())):
        one = np.arange(len(numbers.pose) - apart)
        one = one[numbers.pose[one] == numbers.pose[one + apart]]
        products = size * (numbers.slopes[one] * numbers.slopes[one + apart]).sum(axis=1)
        found[one, one + apart] += products
        if apart:
            found[one + apart, one] += products


GROUP = "residual"
_SHARE = Parameter(GROUP, "share", GROUP, "ratio", PPM, 1.0)
_BLOCK_POSES = 400  # poses that are worked out at once
UPPER_QUARTILE = 0.6744897501960817  # of a standard normal
_MAX_COVARIANCE_NUMBERS = 4_500  # measured, by which covariances are predicted: their time grows with the square
_AWAY = (5e-3, 15e-3)  # m and rad: one standard deviation of how far a link is from where least squares alone puts it


@dataclass(frozen=True)
class JointProcess:
    """Offsets of an arm's joints, estimated from measurements.

    Attributes:
        inputs: ``(s, joints + conditions)`` its poses.
        seen: ``(s, k)`` which targets were measured there.
        variances: ``(c,)`` of ``kernels.COMPONENTS``, m^2 of the noise and rad^2 (m^2 of a slide) of the others.
        errors: ``(c, c)`` covariance of their estimates.
        weights: ``(s, joints)`` by which the processes' covariances with these poses give the offsets.
        turning: ``(joints,)`` which joints turn.
        p: the chance of as large a likelihood if there were noise and scatter alone.
        factor: of the predicted variances, by which 95 % of the poses left out lie within their bounds.
    """

    inputs: Array
    seen: NDArray[np.bool_]
    variances: Array
    errors: Array
    weights: Array
    turning: NDArray[np.bool_]
    p: float
    factor: float = 1.0

    @property
    def kernels(self) -> JointKernels:
        """Kernels of the arm's joints."""
        return JointKernels(self.turning)

    @property
    def upper(self) -> Array:
        """``(c,)`` the upper quartile of each variance."""
        return np.asarray(self.variances + UPPER_QUARTILE * np.sqrt(np.diag(self.errors)))

    @property
    def noise_m(self) -> float:
        """Standard deviation of a coordinate's noise, without the joints' offsets and their scatter."""
        return float(np.sqrt(self.variances[0]))

    @property
    def scatter_rad(self) -> float:
        """Standard deviation of a joint's error that is independent between poses, even similar ones."""
        return float(np.sqrt(self.variances[1]))

    def offsets(self, joints: Array) -> Array:
        """Return the joints' offsets ``(n, joints)`` (rad, m of a slide) at positions ``(n, joints)``."""
        there = self.inputs[:, : len(self.turning)]
        found = np.zeros(joints.shape)
        for first in range(0, len(joints), _BLOCK_POSES):
            some = joints[first : first + _BLOCK_POSES]
            for (own, kernel), size in zip(self.kernels.of_offsets(some, there), self.variances[2:], strict=True):
                rows = "nmj,mj->nj" if own else "nm,mj->nj"
                found[first : first + _BLOCK_POSES] += size * np.einsum(rows, kernel, self.weights)
        return found

    def prior(self, slopes: Array) -> Array:
        """Variances ``(q,)`` of numbers by the offsets before any measurement, from derivatives ``(q, joints)``."""
        return np.asarray(self.variances[1:].sum() * (slopes**2).sum(axis=1))

    def effect(self) -> Effect:
        """Return the offsets as a group of one parameter: their share, zero in the nominal model."""

        def moved(joints: Array, _: Array, values: Array) -> tuple[Array, Array]:
            offsets = self.offsets(np.real(joints))
            return offsets * values[0], offsets[..., None]

        return Effect(GROUP, (_SHARE,), moved, terms=self._plain, made_by=self.effect)

    def _plain(self, values: Array) -> list[dict[str, Any]]:
        """Return the offsets as a term of ``formats.plain_arm``."""
        lengths = {kind: [(size, value) for size, value in pairs if value > 0] for kind, pairs in self._lengths.items()}
        poses = self.inputs[:, : len(self.turning)]
        return [
            {
                "residual": float(values[0]),
                **lengths,
                "slide_m": LEVER_M,
                "turning": self.turning.tolist(),
                "poses": poses.tolist(),
                "weights": self.weights.tolist(),
            }
        ]

    @property
    def _lengths(self) -> dict[str, list[tuple[float, float]]]:
        """Lengths and variances of the offsets by their kind: ``own``, ``all``, ``smooth``."""
        found: dict[str, list[tuple[float, float]]] = {"own": [], "all": [], "smooth": []}
        for name, variance in zip(COMPONENTS[2:], self.variances[2:].tolist(), strict=True):
            kind, length = name.split()
            found[kind].append((float(length), variance))
        return found

    def added_to(self, arm: Arm) -> ArmWithEffects:
        """Return the arm with these offsets, whose share is its last parameter."""
        effects = arm.effects if isinstance(arm, ArmWithEffects) else ()
        added = affected(arm.rigid, (*effects, self.effect()))
        assert isinstance(added, ArmWithEffects)
        return added


def scaled_by(factor: float, share: Array) -> Array:
    """Return the factor of predicted variances that are a ``share`` of those before any measurement.

    A factor above one applies everywhere, one below only near measurements, which determine the offsets.
    """
    return np.asarray(factor + max(1 - factor, 0.0) * np.clip(share, 0.0, 1.0))


def precisions(parameters: Sequence[Parameter]) -> Array:
    """Return ``(f,)`` prior precisions of the parameters about least squares: links to ten usual tolerances.

    A weakly observable direction would else take up what the process does not, and lead far away.
    """
    return np.array([1 / _AWAY[each.is_angle] ** 2 if each.is_link else 0.0 for each in parameters])


@dataclass(frozen=True)
class PredictedBy:
    """A process beside the parameters of an arm.

    Attributes:
        free: those that were estimated together with the process.
    """

    process: JointProcess
    model: RigidArm | ArmWithEffects
    values: Array
    free: tuple[int, ...]

    def covariances(self, inputs: Array, targets: int | None = None) -> Array:
        """Covariances ``(n, k, 3, 3)`` (m^2) of the predicted points' errors at poses ``(n, joints + conditions)``."""
        k = len(self.model.targets) if targets is None else targets
        found = np.empty((len(inputs), k, 3, 3))
        for first in range(0, len(inputs), _BLOCK_POSES // k):
            some = inputs[first : first + _BLOCK_POSES // k]
            n = len(some)
            whole = self.covariance(some, k).reshape(n, k, 3, n, k, 3)
            rows, target = np.meshgrid(np.arange(n), np.arange(k), indexing="ij")
            found[first : first + n] = whole[rows, target, :, rows, target]
        return found

    def covariance(self, inputs: Array, targets: int | None = None) -> Array:
        """Covariance ``(n k 3, n k 3)`` (m^2) of the predicted points' errors, of all poses together."""
        (joints, slopes), columns = self._at(inputs, targets)
        here, kernels, support = PoseNumbers.whole(joints, slopes), self.process.kernels, self._support
        crossed = covariance(kernels, self.process.variances, support.numbers, here)
        half = scipy.linalg.solve_triangular(support.root, crossed, lower=True, check_finite=False)
        unexplained = (columns / support.scale).T - support.half_columns.T @ half
        by_parameters = np.linalg.solve(support.information, unexplained)
        found = covariance(kernels, self.process.variances, here) - half.T @ half + unexplained.T @ by_parameters
        half += support.half_columns @ by_parameters
        weights = scipy.linalg.solve_triangular(support.root, half, lower=True, trans="T", check_finite=False)
        alone = support.noise_columns @ by_parameters / self.process.variances[0]
        parts = self._by_component(here, weights, alone).reshape(len(self.process.variances), -1, 3).sum(axis=2)
        errors = np.sqrt(np.maximum(np.einsum("cq,cd,dq->q", parts, self.process.errors, parts), 0.0))
        sizes = np.maximum(np.diag(found).reshape(-1, 3).sum(axis=1), 1e-300)
        before = np.maximum(self.process.prior(here.slopes).reshape(-1, 3).sum(axis=1), 1e-300)
        share = np.minimum(sizes / before, 1.0)
        wider = (1 + UPPER_QUARTILE * share * errors / sizes) * scaled_by(self.process.factor, share)
        root = np.sqrt(wider).repeat(3)
        return np.asarray(found * root[:, None] * root)

    def _by_component(self, here: PoseNumbers, weights: Array, alone: Array) -> Array:
        """Error variances ``(c, q)`` of q predicted numbers, by components with a variance of one, with fixed weights.

        Args:
            weights: ``(N, q)`` of the measured numbers that the offsets move.
            alone: ``(M, q)`` of those that have the noise alone.
        """
        numbers, kernels = self._support.numbers, self.process.kernels
        pulled = numbers.per_joint(weights.astype(np.float32))  # a few digits of the width of a bound are enough
        slopes, pose = here.slopes.astype(np.float32), here.pose
        own = (slopes**2).sum(axis=1)
        found = [(weights**2).sum(axis=0) + (alone**2).sum(axis=0), own + (pulled**2).sum(axis=(0, 1))]
        between = kernels.of_offsets(numbers.joints, numbers.joints)
        across = kernels.of_offsets(numbers.joints, here.joints)
        for (each, kernel), (_, crossed) in zip(between, across, strict=True):
            total = own.copy()
            for joint, part in enumerate(pulled):
                inner, outer = (k[..., joint] if each else k for k in (kernel, crossed))
                moved = inner.astype(np.float32) @ part - 2 * slopes[:, joint] * outer.astype(np.float32)[:, pose]
                total += np.einsum("nq,nq->q", moved, part)
            found.append(np.maximum(total, 0.0))
        return np.array(found, dtype=np.float64)

    def _at(self, inputs: Array, targets: int | None = None) -> tuple[tuple[Array, Array], Array]:
        """Joint positions with derivatives ``(n, k 3, joints)`` by them, and ``(n k 3, f)`` by the parameters."""
        size, n = len(self.process.turning), len(inputs)
        jacobian = self.model.observe(inputs, self.values)[1][:, :targets][..., list(self.free)]
        slopes = by_joint_positions(self.model, inputs, self.values, size)[:, :targets]
        return (inputs[:, :size], slopes.reshape(n, -1, size)), jacobian.reshape(-1, len(self.free))

    @cached_property
    def _support(self) -> "Support":
        inputs, seen = self.process.inputs, self.process.seen
        per_pose = min(3 * int(seen.sum(axis=1).max()), len(self.process.turning))
        some = evenly(len(inputs), _MAX_COVARIANCE_NUMBERS // per_pose)
        if some is not None:
            inputs, seen = inputs[some], seen[some]
        (joints, slopes), columns = self._at(inputs)
        near = precisions([self.model.parameters[i] for i in self.free])
        reduction = Reduction.of(joints, slopes, seen)
        return Support.of(reduction, self.process.kernels, self.process.variances, columns, near)


@dataclass(frozen=True)
class Support:
    """Measured numbers with their covariance matrix, factorized, beside parameters.

    Attributes:
        numbers: the N numbers that the joints' offsets move.
        root: ``(N, N)`` the Cholesky factor of their covariance matrix, lower.
        columns: ``(N, f)`` derivatives by the parameters, scaled to unit norm over all numbers.
        scale: ``(f,)`` the norms that they had.
        half_columns: the factor's inverse times ``columns``.
        noise_columns: ``(M, f)`` the derivatives of the numbers that have the noise alone.
        precision: ``(f,)`` of the parameters beforehand, in these units.
        information: ``(f, f)`` of the parameters, in these units, ``precision`` included.
    """

    numbers: PoseNumbers
    root: Array
    columns: Array
    scale: Array
    half_columns: Array
    noise_columns: Array
    precision: Array
    information: Array

    @classmethod
    def of(
        cls, reduction: Reduction, kernels: JointKernels, variances: Array, columns: Array, near: Array
    ) -> "Support":
        """Build the support from poses.

        Args:
            variances: ``(c,)`` of ``kernels.COMPONENTS``.
            columns: ``(n k 3, f)`` derivatives of all numbers by the parameters.
            near: ``(f,)`` precisions of the parameters beforehand.
        """
        numbers = reduction.numbers
        some = reduction(columns.reshape(len(numbers.joints), -1, columns.shape[1]))
        units, scale = unit_columns(np.concatenate(some))
        moved, alone = units[: len(numbers.pose)], units[len(numbers.pose) :]
        whole = covariance(kernels, variances, numbers)
        whole[np.diag_indices_from(whole)] += variances[0]
        root = scipy.linalg.cholesky(whole, lower=True, overwrite_a=True, check_finite=False)
        half = scipy.linalg.solve_triangular(root, moved, lower=True, check_finite=False)
        precision = near / scale**2
        information = half.T @ half + alone.T @ alone / variances[0] + np.diag(precision)
        return cls(numbers, root, moved, scale, half, alone, precision, information)
