"""How large the processes of the joints' offsets are, and what they make of an identification.

The variances are those of the largest restricted likelihood (Patterson & Thompson 1971), found by a fixed point that
never lowers it (Zhou, Hu, Zhou & Lange 2019). A variance at its bound of zero has an error too: on the linear scale, by
the average information (Gilmour, Thompson & Cullis 1995), whose upper quartile the predictions' covariances are by.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.calibration.identify import Identification
from lab.calibration.residual.kernels import COMPONENTS, JointKernels
from lab.calibration.residual.process import JointProcess, PredictedBy, precisions, total_covariance
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.calibration.validation import configurations
from lab.core.errors import LabError
from lab.core.linear_model import unit_columns
from lab.core.measurements import Measurements, thinned
from lab.core.se3 import Array
from lab.kinematics.effects.arm import ArmWithEffects
from lab.kinematics.serial.arm import SerialArm

__all__ = ["ExpectedGain", "expected_gain", "with_residual"]

_MOST_NUMBERS = 2_100  # that the process is conditioned on: its time grows with the third power
_MOST_ESTIMATING = 900  # that the variances come from
_LEAST_SPARE = 30  # numbers beyond the parameters, of which so many variances can be told
_LEAST_TOLD = 1e-6  # of what is known best: a mixture of variances that is told less well is not told at all
_STEPS, _SETTLED = 40, 2e-3
_MOST_STEPS, _CONVERGED_M = 8, 1e-8
_MOST_LEFT_OUT = 450  # numbers by which the gain is told
_RATIOS = np.logspace(-2.0, 5.0, 29)  # of the process' variance to the noise's, of which the likeliest tells the gain
_LEAST_GAIN = 0.1  # of the error: less is not worth a group that names no cause
_QUARTILE = 0.6744897501960817  # of a standard normal


@dataclass(frozen=True)
class _Rows:
    """Some poses of an identification, as numbers that were seen.

    Attributes:
        kinds: unit covariances of all components.
        columns: derivatives by the free parameters, of unit norm.
        residual: measured less predicted (m).
    """

    kinds: tuple[Array, ...]
    columns: Array
    scale: Array
    residual: Array

    @classmethod
    def of(cls, found: Identification, values: Array, data: Measurements, turning: NDArray[np.bool_]) -> "_Rows":
        """Of some rows, at parameters ``(p,)``."""
        model = found.model
        inputs = data.inputs(model.conditions)
        points, jacobian = model.observe(inputs, values)
        kept = np.flatnonzero(np.repeat(data.seen.ravel(), 3))
        n, size = len(data), len(turning)
        slopes = by_joint_positions(model, inputs, values, size).reshape(n, -1, size)
        here, kernels, pairs = (inputs[:, :size], slopes), JointKernels(turning), np.ix_(kept, kept)
        scatter = total_covariance(kernels, np.array([0.0, 1.0, *[0.0] * (len(COMPONENTS) - 2)]), here)[pairs]
        kinds = (np.eye(len(kept)), scatter, *(kind[pairs] for kind in kernels.of_numbers(here, here)))
        free = list(found.fit.free)
        columns, scale = unit_columns(jacobian[..., free].reshape(-1, len(free))[kept])
        return cls(kinds, columns, scale, (data.points - points).reshape(-1)[kept])


@dataclass(frozen=True)
class ExpectedGain:
    """What the group residual would make of the error at poses that are left out, each in its turn.

    Attributes:
        before_m, after_m: mean errors of points, without and with it.
        poses: how many were left out.
    """

    before_m: float
    after_m: float
    poses: int

    @property
    def words(self) -> str:
        """For a person."""
        return (
            "The group residual would lower the error at poses that are left out from "
            f"{1e3 * self.before_m:.2g} to about {1e3 * self.after_m:.2g} mm (means, leave-one-out over {self.poses} "
            "poses): add it to --model, e.g. auto+residual."
        )


def expected_gain(found: Identification, data: Measurements) -> ExpectedGain | None:
    """What the group residual would gain, without fitting it: all its parts by one ratio to the noise.

    The residuals of a pose left out are (P_ii)^-1 (P r)_i, with P that of the restricted likelihood (Cook & Weisberg
    1982). Repeats of a configuration are left out together.

    Args:
        found: of points of a serial arm.
        data: the rows that it comes from; of many some tell, evenly spaced.

    Returns:
        None where too few numbers are left, or where it would gain less than a tenth.
    """
    model = found.model
    assert isinstance(model, SerialArm | ArmWithEffects)
    numbers = 3 * max(int(data.seen.sum(axis=1).max()), 1)
    some = thinned(data, _MOST_LEFT_OUT // numbers)
    if 3 * int(some.seen.sum()) - len(found.fit.free) < _LEAST_SPARE:
        return None
    rows = _Rows.of(found, found.values, some, ~np.array(model.rigid.chain.prismatic, dtype=np.bool_))
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


def with_residual(found: Identification, data: Measurements) -> Identification:
    """An identification with what its parameters do not explain, as offsets of the joints.

    Its parameters and their covariance are those of generalized least squares beside the process, which is
    conditioned on the same residuals; ``process`` is what predicts beside them.

    Args:
        found: of points of a serial arm.
        data: the rows that it comes from. Of very many the process is conditioned on some, evenly spaced.

    Raises:
        LabError: there are too few poses.
    """
    model = found.model
    assert isinstance(model, SerialArm | ArmWithEffects)
    numbers = 3 * max(int(data.seen.sum(axis=1).max()), 1)
    support = thinned(data, _MOST_NUMBERS // numbers)
    few = thinned(support, _MOST_ESTIMATING // numbers)
    if 3 * int(_seen_at_poses(few).sum()) - len(found.fit.free) < _LEAST_SPARE:
        count = len(_seen_at_poses(data))
        raise LabError(f"{count} distinct poses are too few for the group residual; measure more, or leave it out")
    turning = ~np.array(model.rigid.chain.prismatic, dtype=np.bool_)
    known = found.sigma_m**2 if found.sigma_known else None
    variances, upper, p = _variances(_Rows.of(found, found.values, few, turning), known)
    values, covariance, left = _beside(found, support, turning, variances)
    inputs = support.inputs(model.conditions)
    spread = np.zeros(support.points.shape)
    spread[support.seen] = left.reshape(-1, 3)
    slopes = by_joint_positions(model, inputs, values, len(turning))
    weights = np.einsum("nki,nkij->nj", spread, slopes)
    process = JointProcess(inputs, support.seen, variances, upper, weights, turning, p)
    return _replaced(found, data, process, values, covariance)


def _seen_at_poses(data: Measurements) -> NDArray[np.bool_]:
    """``(m, k)`` whether a target was seen at each distinct pose: the joints' offsets come back with its repeats."""
    labels = configurations(data.joints)
    seen = np.zeros((labels.max() + 1, len(data.targets)), dtype=np.bool_)
    np.logical_or.at(seen, labels, data.seen)
    return seen


def _beside(
    found: Identification, data: Measurements, turning: NDArray[np.bool_], variances: Array
) -> tuple[Array, Array, Array]:
    """Parameters ``(p,)`` beside a process, by Gauss-Newton, their covariance, and V^-1 of what they leave."""
    values, free = found.values.copy(), list(found.fit.free)
    near = precisions([found.model.parameters[i] for i in free])
    for _ in range(_MOST_STEPS):
        rows = _Rows.of(found, values, data, turning)
        covariance = sum(size * kind for size, kind in zip(variances, rows.kinds, strict=True))
        factor = scipy.linalg.cho_factor(covariance, lower=True)
        whitened = scipy.linalg.cho_solve(factor, rows.columns)
        precision = near / rows.scale**2
        information = rows.columns.T @ whitened + np.diag(precision)
        away = (values - found.values)[free] * rows.scale
        step = np.linalg.solve(information, whitened.T @ rows.residual - precision * away)
        moved = rows.columns @ step
        values[free] += step / rows.scale
        if np.sqrt(np.mean(moved**2)) < _CONVERGED_M:
            break
    left = scipy.linalg.cho_solve(factor, rows.residual - moved)
    return values, np.linalg.inv(information) / np.outer(rows.scale, rows.scale), left


def _replaced(
    found: Identification, data: Measurements, process: JointProcess, values: Array, covariance: Array
) -> Identification:
    """The identification with the process and the parameters beside it."""
    base = found.model
    assert isinstance(base, SerialArm | ArmWithEffects)
    model = process.added_to(base)
    whole = np.append(values, 1.0)
    noise = process.noise_m
    return replace(
        found,
        model=model,
        values=whole,
        nominal_aligned=np.append(found.nominal_aligned, 0.0),
        fit=replace(found.fit, values=whole),
        covariance=covariance,
        dof_each=None,
        sigma_m=found.sigma_m if found.sigma_known else noise,
        residual_sigma_m=float(np.sqrt(process.upper[0])),
        residuals=data.points - model.points(data.inputs(model.conditions), whole),
        process=PredictedBy(process, base, values, found.fit.free),
    )


def _variances(rows: _Rows, known: float | None) -> tuple[Array, Array, float]:
    """The likeliest variances ``(c,)``, the upper quartile of each, and the p-value of all but noise and scatter."""
    sizes, deviance, information = _likeliest(rows, known, len(rows.kinds))
    alone = _likeliest(rows, known, 2)[1]
    ratio = max(alone - deviance, 0.0)
    estimated = np.arange(len(sizes)) >= (known is not None)
    errors = np.zeros(len(sizes))
    known_so_well = np.sqrt(np.diag(information)[estimated])
    relative = information[np.ix_(estimated, estimated)] / np.outer(known_so_well, known_so_well)
    inverse = np.linalg.pinv(relative, rcond=_LEAST_TOLD, hermitian=True)
    errors[estimated] = np.sqrt(np.diag(inverse)) / known_so_well
    p = float(scipy.stats.chi2.sf(ratio, len(rows.kinds) - 2)) / 2 if ratio > 0 else 1.0
    return sizes, sizes + _QUARTILE * errors, p


def _likeliest(rows: _Rows, known: float | None, count: int) -> tuple[Array, float, Array]:
    """Variances of the first components, minus twice their restricted log-likelihood, and the average information."""
    kinds, residual = rows.kinds[:count], rows.residual
    dof = len(residual) - rows.columns.shape[1]
    mean = np.array([np.trace(kind) / len(residual) for kind in kinds])
    whole = float(residual @ residual) / dof
    sizes = whole / (len(kinds) * mean)
    fixed = known is not None
    for step in range(_STEPS + 1):
        if fixed:
            sizes[0] = known
        covariance = sum(size * kind for size, kind in zip(sizes, kinds, strict=True))
        triangle = np.linalg.cholesky(covariance)
        inverse = scipy.linalg.lapack.dpotri(triangle, lower=1)[0]
        inverse = np.tril(inverse) + np.tril(inverse, -1).T
        whitened = inverse @ rows.columns
        information = rows.columns.T @ whitened
        projector = inverse - whitened @ np.linalg.solve(information, whitened.T)
        left = projector @ residual
        gains = np.array([(left @ kind @ left) / max(float((projector * kind).sum()), 1e-300) for kind in kinds])
        moved = sizes * np.sqrt(np.maximum(gains, 0.0))
        settled = np.abs(np.sqrt(moved * mean) - np.sqrt(sizes * mean)).max() < _SETTLED * np.sqrt(whole)
        if settled or step == _STEPS:
            break
        sizes = moved
    deviance = 2 * float(np.log(np.diag(triangle)).sum()) + float(np.linalg.slogdet(information)[1] + residual @ left)
    products = [projector @ kind for kind in kinds] if count == len(rows.kinds) else []
    average = np.array([[0.5 * float((a * b.T).sum()) for b in products] for a in products])
    return sizes, deviance, average
