"""Estimate the variances of the joint offsets' processes, and identify the arm beside them.

The variances are those of the largest restricted likelihood (Patterson & Thompson 1971), found by a fixed point that
never lowers it (Zhou, Hu, Zhou & Lange 2019), in steps that are extrapolated (Varadhan & Roland 2008). A variance at
its bound of zero has an error too: on the linear scale, by the expected information.

With P of universal kriging the error of numbers that are left out together is P_ii^-1 (P r)_i, and its covariance
matrix P_ii^-1, noise included (Cressie 1993, section 3.2; Cook & Weisberg 1982 without a process). The factor of
predicted variances uses the quantile of conformal prediction (Vovk, Gammerman & Shafer 2005, section 4.1): that of n
errors, below which one more lies in 95 % of all cases.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy  # its solvers are loaded at their first use
from numpy.typing import NDArray

from lab.calibration.identification import Identification
from lab.calibration.residual.gaussian_process import (
    JointKernels,
    JointProcess,
    PoseNumbers,
    PredictedBy,
    Reduction,
    Support,
    precisions,
    scaled_by,
    unit_covariances,
)
from lab.calibration.row_groups import configurations
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.core.errors import LabError, option_name
from lab.core.linear_model import unit_columns
from lab.core.measurements import Measurements, evenly, thinned
from lab.core.se3 import Array
from lab.core.units import MM
from lab.kinematics.effects.arm_with_effects import ArmWithEffects
from lab.kinematics.serial.serial_arm import SerialArm

__all__ = ["ExpectedGain", "bound_factor", "expected_gain", "left_out", "with_residual"]

_MAX_LEFT_OUT = 300  # poses: their time grows with the numbers' square
_TOGETHER = 20  # poses that are worked out at once
_LEAST_NARROWING = 60  # points that may make bounds narrower: fewer do not determine the largest errors
_LEVEL, _LIMIT = 0.95, 7.814727903251179  # of chi^2 with three degrees of freedom
_FACTORS = np.geomspace(1 / 16, 16.0, 97)


@dataclass(frozen=True)
class _LeftOut:
    """A pose that was left out.

    Attributes:
        error: ``(s,)`` measured less predicted (m) of the numbers seen there.
        covariance: ``(s, s)`` predicted of it, noise included (m^2).
    """

    pose: int
    error: Array
    covariance: Array


def left_out(
    support: Support, reduction: Reduction, noise: float, left: tuple[Array, Array], labels: NDArray[np.int_]
) -> Iterator[_LeftOut]:
    """Errors of poses whose repeats are left out with them.

    Args:
        noise: variance of the noise (m^2).
        left: P times the residuals: of the numbers that the offsets move, and of those with the noise alone.
        labels: ``(n,)`` of configurations, left out together.
    """
    count = labels.max() + 1
    some = evenly(count, _MAX_LEFT_OUT)
    chosen, of_moved, of_alone = (
        np.arange(count) if some is None else some,
        labels[support.numbers.pose],
        labels[reduction.alone],
    )
    for first in range(0, len(chosen), _TOGETHER):
        columns = np.flatnonzero(np.isin(of_moved, chosen[first : first + _TOGETHER]))
        start = int(columns[0])  # rows above are zero
        unit = np.zeros((len(support.root) - start, len(columns)), order="F")
        unit[columns - start, np.arange(len(columns))] = 1
        triangle = support.root[start:, start:]
        half = scipy.linalg.solve_triangular(triangle, unit, lower=True, overwrite_b=True, check_finite=False)
        for label in chosen[first : first + _TOGETHER]:
            moved, alone = np.flatnonzero(of_moved == label), np.flatnonzero(of_alone == label)
            own = half[:, of_moved[columns] == label]
            slopes = np.concatenate([own.T @ support.half_columns[start:], support.noise_columns[alone] / noise])
            whole = scipy.linalg.block_diag(own.T @ own, np.eye(len(alone)) / noise)
            covariance = np.linalg.inv(whole - slopes @ np.linalg.solve(support.information, slopes.T))
            error = covariance @ np.concatenate([left[0][moved], left[1][alone]])
            poses = np.concatenate([support.numbers.pose[moved], reduction.alone[alone]])
            for pose in np.unique(poses):
                rows = np.flatnonzero(poses == pose)
                turned = reduction.back(pose, covariance[np.ix_(rows, rows)])
                yield _LeftOut(int(pose), reduction.back(pose, error[rows]), reduction.back(pose, turned.T))


def bound_factor(errors: Array, covariances: Array, noise: float, prior: Array) -> float:
    """Return the factor of predicted variances with which 95 % of points left out lie within their bounds.

    Args:
        errors: ``(m, 3)`` of points that were left out (m).
        covariances: ``(m, 3, 3)`` predicted, noise included (m^2).
        noise: variance of the noise of a number (m^2).
        prior: ``(m,)`` sums of the three variances by the offsets before any measurement (m^2).
    """
    rank = int(np.ceil(_LEVEL * (len(errors) + 1)))
    if rank > len(errors):  # too few
        return 1.0
    alone = noise * np.eye(3)
    predicted = covariances - alone
    share = np.trace(predicted, axis1=1, axis2=2) / np.maximum(prior, 1e-300)
    for factor in _FACTORS if len(errors) >= _LEAST_NARROWING else _FACTORS[_FACTORS >= 1]:
        whole = predicted * scaled_by(factor, share)[:, None, None] + alone
        squares = np.einsum("mi,mi->m", errors, np.linalg.solve(whole, errors[..., None])[..., 0])
        if np.sort(squares)[rank - 1] <= _LIMIT:
            return float(factor)
    return float(_FACTORS[-1])


_MOST_NUMBERS = 8_400  # that the process is conditioned on: its time grows with the third power
_MOST_ESTIMATING = 900  # that the variances come from
_LEAST_SPARE = 30  # numbers beyond the parameters that determine so many variances
_MIN_IDENTIFIABLE = 1e-6  # of the best determined: below this a mixture of variances is not identifiable
_CYCLES, _SETTLED = 12, 2e-3
_LONGEST = 16.0  # of an extrapolated step
_LEAST_SHARE = 1e-6  # of the residuals' variance, that a component has at least
_MOST_STEPS, _CONVERGED_M = 8, 1e-8
_MOST_LEFT_OUT = 450  # numbers that estimate the gain
_RATIOS = np.logspace(-2.0, 5.0, 29)  # of the process' variance to the noise's
_LEAST_GAIN = 0.1  # of the error: less is not worth a group that names no cause


@dataclass(frozen=True)
class _Rows:
    """Selected poses of an identification.

    Attributes:
        joints: ``(n, joints)``.
        slopes: ``(n, 3 k, joints)`` derivatives of all numbers by the joint positions.
        columns: ``(n, 3 k, f)`` those by the free parameters.
        residual: ``(n, 3 k)`` measured less predicted (m).
        seen: ``(n, k)``.
    """

    kernels: JointKernels
    joints: Array
    slopes: Array
    columns: Array
    residual: Array
    seen: NDArray[np.bool_]

    @classmethod
    def of(cls, found: Identification, data: Measurements) -> "_Rows":
        model = found.model
        assert isinstance(model, SerialArm | ArmWithEffects)
        turning = ~np.array(model.rigid.chain.prismatic, dtype=np.bool_)
        inputs, n, size = data.inputs(model.conditions), len(data), len(turning)
        points, jacobian = model.observe(inputs, found.values)
        slopes = by_joint_positions(model, inputs, found.values, size).reshape(n, -1, size)
        columns = jacobian[..., list(found.fit.free)].reshape(n, 3 * len(data.targets), -1)
        residual = (data.points - points).reshape(n, -1)
        return cls(JointKernels(turning), inputs[:, :size], slopes, columns, residual, data.seen)

    def take(self, rows: NDArray[np.int_]) -> "_Rows":
        some = self.joints[rows], self.slopes[rows], self.columns[rows], self.residual[rows]
        return _Rows(self.kernels, *some, self.seen[rows])

    @cached_property
    def reduction(self) -> Reduction:
        return Reduction.of(self.joints, self.slopes, self.seen)

    def reduced(self) -> "_Numbers":
        columns, alone = self.reduction(self.columns)
        residual, left = self.reduction(self.residual)
        kinds = unit_covariances(self.kernels, self.reduction.numbers)
        units, _ = unit_columns(np.concatenate([columns, alone]))
        return _Numbers(kinds, units[: len(columns)], units[len(columns) :], residual, left)

    def plain(self) -> "_Numbers":
        retained = np.repeat(self.seen, 3, axis=1).ravel()
        whole = PoseNumbers.whole(self.joints, self.slopes)
        numbers = PoseNumbers(self.joints, whole.pose[retained], whole.slopes[retained])
        units, _ = unit_columns(self.columns.reshape(len(retained), -1)[retained])
        kinds = unit_covariances(self.kernels, numbers)
        return _Numbers(kinds, units, units[:0], self.residual.ravel()[retained], np.zeros(0))


@dataclass(frozen=True)
class _Numbers:
    """Numbers of some poses with unit covariances of all components.

    Attributes:
        kinds: ``(N, N)`` of the numbers that the joints' offsets move, one a component.
        columns, noise_columns: derivatives ``(N, f)`` and, of numbers with the noise alone, ``(M, f)`` by the
            parameters; of unit norm together.
        residual, noise_residual: measured less predicted ``(N,)`` and ``(M,)`` (m).
    """

    kinds: tuple[Array, ...]
    columns: Array
    noise_columns: Array
    residual: Array
    noise_residual: Array

    @property
    def squares(self) -> float:
        return float(self.residual @ self.residual + self.noise_residual @ self.noise_residual)

    @property
    def dof(self) -> int:
        return len(self.residual) + len(self.noise_residual) - int(self.columns.shape[1])


@dataclass(frozen=True)
class ExpectedGain:
    """Expected effect of the group residual on the error at poses that are left out one at a time.

    Attributes:
        before_m, after_m: mean errors of points, without and with it.
    """

    before_m: float
    after_m: float
    poses: int

    @property
    def description(self) -> str:
        """Description for a report."""
        return (
            "The group residual would lower the error at poses that are left out from "
            f"{MM.of(self.before_m):.2g} to about {MM.text(self.after_m, 2)} (means, leave-one-out over {self.poses} "
            f"poses): add it to {option_name('model')}, e.g. auto+residual."
        )


def expected_gain(found: Identification, data: Measurements) -> ExpectedGain | None:
    """Estimate the gain of the group residual without fitting it: all its parts by one ratio to the noise.

    The residuals of a pose left out are (P_ii)^-1 (P r)_i, with P that of the restricted likelihood (Cook & Weisberg
    1982). Repeats of a configuration are left out together.

    Args:
        data: the rows that it comes from; of many, a subset, evenly spaced.

    Returns:
        None where too few numbers are left, or where it would gain less than a tenth.
    """
    numbers = 3 * max(int(data.seen.sum(axis=1).max()), 1)
    some = thinned(data, _MOST_LEFT_OUT // numbers)
    if 3 * int(some.seen.sum()) - len(found.fit.free) < _LEAST_SPARE:
        return None
    rows = _Rows.of(found, some).plain()
    kind = np.sum([each * len(each) / max(np.trace(each), 1e-300) for each in rows.kinds[2:]], axis=0)
    beside = scipy.linalg.null_space(rows.columns.T)
    sizes, axes = np.linalg.eigh(beside.T @ kind @ beside)
    turned, root = axes.T @ (beside.T @ rows.residual), beside @ axes
    variances = 1 + _RATIOS[:, None] * np.maximum(sizes, 0.0)
    deviances = len(turned) * np.log((turned**2 / variances).sum(axis=1)) + np.log(variances).sum(axis=1)
    labels = np.repeat(configurations(some.joints), 3 * some.seen.sum(axis=1))
    before, after = (
        _left_out(root / weights, root, turned, labels)
        for weights in (np.ones(len(turned)), variances[int(np.argmin(deviances))])
    )
    if after > (1 - _LEAST_GAIN) * before:
        return None
    return ExpectedGain(before, after, len(some))


def _left_out(weighted: Array, root: Array, turned: Array, labels: NDArray[np.int_]) -> float:
    """Mean length of the errors of points, those of one label left out together."""
    pulled, errors = weighted @ turned, np.empty(len(labels))
    for label in np.unique(labels):
        own = np.flatnonzero(labels == label)
        errors[own] = np.linalg.lstsq(weighted[own] @ root[own].T, pulled[own], rcond=None)[0]
    return float(np.linalg.norm(errors.reshape(-1, 3), axis=1).mean())


def with_residual(found: Identification, data: Measurements, estimated: JointProcess | None = None) -> Identification:
    """Add joint offsets that the parameters do not explain to an identification.

    Its parameters and their covariance are those of generalized least squares beside the process, which is
    conditioned on the same residuals; ``process`` is what predicts beside them.

    Args:
        found: of points of a serial arm.
        data: the rows that it comes from. Of very many the process is conditioned on some, evenly spaced.
        estimated: a process of these and other rows, whose variances are taken; without it they are estimated, and
            poses are left out in turn for the factor of the bounds.

    Raises:
        LabError: there are too few poses.
    """
    model = found.model
    assert isinstance(model, SerialArm | ArmWithEffects)
    per_pose = min(3 * max(int(data.seen.sum(axis=1).max()), 1), data.joints.shape[1])
    data_used = thinned(data, _MOST_NUMBERS // per_pose)
    if 3 * int(_seen_at_poses(data_used).sum()) - len(found.fit.free) < _LEAST_SPARE:
        count = len(_seen_at_poses(data))
        raise LabError(f"{count} distinct poses are too few for the group residual; measure more, or leave it out")
    # the variances of noise and offsets
    rows = _Rows.of(found, data_used)
    if estimated is None:
        known = found.sigma_m**2 if found.sigma_given else None
        some = evenly(len(data_used), _MOST_ESTIMATING // per_pose)
        variances, errors, p = _variances((rows if some is None else rows.take(some)).reduced(), known)
    else:
        variances, errors, p = estimated.variances, estimated.errors, estimated.p
    # the parameters beside the process, and the process beside them
    values, covariance, weights, poses = _beside(found, data_used, rows, variances)
    factor = _factor(rows, variances, poses) if estimated is None else estimated.factor
    inputs = data_used.inputs(model.conditions)
    process = JointProcess(inputs, data_used.seen, variances, errors, weights, rows.kernels.turning, p, factor)
    with_process, whole = process.added_to(model), np.append(values, 1.0)
    return replace(
        found,
        model=with_process,
        values=whole,
        nominal_aligned=np.append(found.nominal_aligned, 0.0),
        fit=replace(found.fit, values=whole),
        covariance=covariance,
        dof_each=None,
        sigma_m=found.sigma_m if found.sigma_given else process.noise_m,
        residual_sigma_m=float(np.sqrt(process.upper[0])),
        residuals=data.points - with_process.points(data.inputs(with_process.conditions), whole),
        process=PredictedBy(process, model, values, found.fit.free),
    )


def _seen_at_poses(data: Measurements) -> NDArray[np.bool_]:
    """Check ``(m, k)`` whether a target was seen at each distinct pose."""
    labels = configurations(data.joints)
    seen = np.zeros((labels.max() + 1, len(data.targets)), dtype=np.bool_)
    np.logical_or.at(seen, labels, data.seen)
    return seen


def _beside(
    found: Identification, data: Measurements, rows: _Rows, variances: Array
) -> tuple[Array, Array, Array, Iterator[_LeftOut]]:
    """Parameters ``(p,)`` beside a process, their covariance, the offsets' weights, and the poses left out in turn.

    Covariance matrix and derivatives are those at the first parameters: both change by far less than they are.
    """
    model, values, free = found.model, found.values.copy(), list(found.fit.free)
    near = precisions([model.parameters[i] for i in free])
    inputs = data.inputs(model.conditions)
    flat = rows.columns.reshape(-1, len(free))
    support = Support.of(rows.reduction, rows.kernels, variances, flat, near)
    for step in range(_MOST_STEPS):
        residual, alone = rows.reduction((data.points - model.points(inputs, values)).reshape(len(data), -1))
        half = scipy.linalg.solve_triangular(support.root, residual, lower=True, check_finite=False)
        away = (values - found.values)[free] * support.scale
        gradient = support.half_columns.T @ half + support.noise_columns.T @ alone / variances[0]
        change = np.linalg.solve(support.information, gradient - support.precision * away)
        values[free] += change / support.scale
        moved = np.concatenate([support.columns, support.noise_columns]) @ change
        if np.sqrt(np.mean(moved**2)) < _CONVERGED_M or step == _MOST_STEPS - 1:
            break
    half -= support.half_columns @ change
    left = scipy.linalg.solve_triangular(support.root, half, lower=True, trans="T", check_finite=False)
    weights = rows.reduction.numbers.per_joint(left[:, None])[..., 0].T
    covariance = np.linalg.inv(support.information) / np.outer(support.scale, support.scale)
    rest = (alone - support.noise_columns @ change) / variances[0]
    labels = configurations(rows.joints)
    poses = left_out(support, rows.reduction, variances[0], (left, rest), labels)
    return values, covariance, np.ascontiguousarray(weights), poses


def _factor(rows: _Rows, variances: Array, poses: Iterable[_LeftOut]) -> float:
    errors, covariances, priors = [], [], []
    for each in poses:
        slopes = rows.slopes[each.pose].reshape(-1, 3, rows.slopes.shape[-1])[rows.seen[each.pose]]
        priors += [variances[1:].sum() * float((part**2).sum()) for part in slopes]
        errors += list(each.error.reshape(-1, 3))
        covariances += [each.covariance[i : i + 3, i : i + 3] for i in range(0, len(each.error), 3)]
    return bound_factor(np.array(errors), np.array(covariances), variances[0], np.array(priors))


def _variances(numbers: _Numbers, known: float | None) -> tuple[Array, Array, float]:
    """Return the likeliest variances ``(c,)``, the covariance of their estimates, and the p-value of the offsets."""
    count = len(numbers.kinds)
    sizes, deviance = _likeliest(numbers, known, count)
    alone = _likeliest(numbers, known, 2)[1]
    information = _Projector.of(numbers, sizes).information(numbers.kinds)
    estimated = np.arange(count) >= (known is not None)
    errors = np.zeros((count, count))
    information_roots = np.sqrt(np.diag(information)[estimated])
    scale = np.outer(information_roots, information_roots)
    relative = information[np.ix_(estimated, estimated)] / scale
    errors[np.ix_(estimated, estimated)] = np.linalg.pinv(relative, rcond=_MIN_IDENTIFIABLE, hermitian=True) / scale
    ratio = max(alone - deviance, 0.0)
    p = float(scipy.stats.chi2.sf(ratio, count - 2)) / 2 if ratio > 0 else 1.0
    return sizes, errors, p


def _likeliest(numbers: _Numbers, known: float | None, count: int) -> tuple[Array, float]:
    """Variances of the first components, and minus twice their restricted log-likelihood."""
    kinds = numbers.kinds[:count]
    mean = np.array([np.trace(kind) / len(numbers.residual) for kind in kinds])
    whole = numbers.squares / numbers.dof
    least = _LEAST_SHARE * whole / mean

    def step(sizes: Array) -> tuple[Array, float]:
        projector = _Projector.of(numbers, sizes)
        squares, traces = projector.gains(kinds)
        moved = np.maximum(sizes * np.sqrt(squares / np.maximum(traces, 1e-300)), least)
        moved[0] = moved[0] if known is None else known
        return moved, projector.deviance

    def settled(first: Array, second: Array) -> bool:
        return bool(np.abs(np.sqrt(first * mean) - np.sqrt(second * mean)).max() < _SETTLED * np.sqrt(whole))

    # begin with equal shares of the residuals
    sizes = whole / (count * mean)
    if known is not None:
        sizes[0] = known
    for _ in range(_CYCLES):
        # two fixed-point steps
        first, deviance = step(sizes)
        if settled(first, sizes):
            return sizes, deviance
        second, deviance_first = step(first)
        if settled(second, first):
            return first, deviance_first
        # their extrapolation, taken where it is likelier
        change, second_change = np.log(first / sizes), np.log(second / first) - np.log(first / sizes)
        ratio = float(np.linalg.norm(change)) / max(float(np.linalg.norm(second_change)), 1e-300)
        length = min(max(ratio, 1.0), _LONGEST)
        far = np.clip(sizes * np.exp(2 * length * change + length**2 * second_change), least, whole / mean)
        if known is not None:
            far[0] = known
        again, deviance_far = step(far)
        sizes = again if deviance_far < deviance_first else second
    return sizes, step(sizes)[1]


@dataclass(frozen=True)
class _Projector:
    """The matrix P of a restricted likelihood, V^-1 less what the parameters take up, in parts.

    Attributes:
        moved: ``(N, N)`` of the numbers that the joints' offsets move.
        across: ``(N, M)`` between these and those with the noise alone.
        alone: ``(M, M)`` of those with the noise alone.
        left: P times the residuals ``(N,)`` and ``(M,)``.
        deviance: minus twice the restricted log-likelihood.
    """

    moved: Array
    across: Array
    alone: Array
    left: tuple[Array, Array]
    deviance: float

    @classmethod
    def of(cls, numbers: _Numbers, sizes: Array) -> "_Projector":
        triangle = np.linalg.cholesky(sum(size * kind for size, kind in zip(sizes, numbers.kinds, strict=False)))
        inverse = scipy.linalg.lapack.dpotri(triangle, lower=1)[0]
        inverse = np.tril(inverse) + np.tril(inverse, -1).T
        whitened, alone = inverse @ numbers.columns, numbers.noise_columns / sizes[0]
        information = numbers.columns.T @ whitened + numbers.noise_columns.T @ alone
        gradient = whitened.T @ numbers.residual + alone.T @ numbers.noise_residual
        fitted, back = np.linalg.solve(information, gradient), np.linalg.solve(information, whitened.T)
        pulled, rest = inverse @ numbers.residual, numbers.noise_residual / sizes[0]
        deviance = 2 * float(np.log(np.diag(triangle)).sum()) + len(alone) * float(np.log(sizes[0]))
        deviance += float(np.linalg.slogdet(information)[1] - gradient @ fitted)
        deviance += float(numbers.residual @ pulled + numbers.noise_residual @ rest)
        among = np.eye(len(alone)) / sizes[0] - alone @ np.linalg.solve(information, alone.T)
        left = pulled - whitened @ fitted, rest - alone @ fitted
        return cls(inverse - whitened @ back, -back.T @ alone.T, among, left, deviance)

    def gains(self, kinds: Sequence[Array]) -> tuple[Array, Array]:
        """Quadratic forms ``(c,)`` of ``left`` by each component, and the traces of P times it."""
        first, second = self.left
        squares = np.array([first @ kind @ first for kind in kinds])
        traces = np.array([float((self.moved * kind).sum()) for kind in kinds])
        squares[0] += second @ second
        traces[0] += np.trace(self.alone)
        return squares, traces

    def information(self, kinds: Sequence[Array]) -> Array:
        """Expected information ``(c, c)`` of the variances: halves of the traces of P K P K'."""
        products = [self.moved, *(self.moved @ kind for kind in kinds[1:])]
        found = np.array([[0.5 * float((one * other.T).sum()) for other in products] for one in products])
        between = self.across @ self.across.T
        shared = np.array([0.5 * float((between * kind).sum()) for kind in kinds])
        found[0] += shared
        found[:, 0] += shared
        found[0, 0] += 0.5 * float((self.alone**2).sum())
        return found
