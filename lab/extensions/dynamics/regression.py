"""Weighted least squares of rows in channels (joints, or a sensor's axes), and tests of the residuals."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to
from numpy.typing import NDArray

from lab.core.checks import Check, Outcome
from lab.core.errors import LabError
from lab.core.linear_model import LinearModel, half_width_95, matched_dof, p_value_of_squares
from lab.core.se3 import Array
from lab.core.significance import PAYLOAD_RESIDUALS

__all__ = ["BiasCandidate", "ChannelSolution", "EvenSamples", "check_residuals", "least_squares"]

_RANK_TOLERANCE = 1e-9  # of the largest singular value of the scaled columns
_ROUNDING = 1e-6  # of the signal: noise below is rounding, and not estimated
_OWN_NOISE = 20  # rows from which on a channel's noise is estimated by itself
_MAX_ITERATIONS, _CONVERGED = 20, 1e-6
_SLOW_HZ = 5.0  # below it a quick arm's torques change
_MAX_SLOW = 0.5  # of the band
_NEW = 1e-6  # of a candidate's column: the least that the fit's own columns leave of it


@dataclass(frozen=True)
class ChannelSolution:
    """Least-squares solution of rows in channels.

    Attributes:
        names: of the parameters, p of them.
        values: ``(p,)``; zero where they are not identifiable.
        model: the whitened columns ``(n d, p)``, row by row with its channels.
        covariances: ``(g, p, p)``, as the noise of each group of channels makes it; zero where not identifiable.
        dof: ``(g,)`` of each group's noise.
        sigma: ``(d,)`` noise of a row in each channel, in its unit.
        measured: ``(n, d)`` the measurements.
        residual: ``(n, d)`` measured less fitted, by sigma.
        rounding: whether some channel's noise is too small to be noise.
    """

    names: tuple[str, ...]
    values: Array
    model: LinearModel
    covariances: Array
    dof: Array
    sigma: Array
    measured: Array
    residual: Array
    rounding: bool

    @property
    def identifiable(self) -> NDArray[np.bool_]:
        """Flags ``(p,)`` of the parameters that the rows determine."""
        return self.model.identifiable

    @property
    def covariance(self) -> Array:
        """Covariance ``(p, p)`` of the parameters."""
        return np.asarray(self.covariances.sum(axis=0))

    def half_widths(self, slopes: Array) -> Array:
        """Return half-widths ``(k,)`` of 95 % intervals of quantities with derivatives ``(k, p)`` by the parameters.

        Student's t, with the degrees of freedom of a sum of variances (Satterthwaite 1946).
        """
        shares = np.einsum("kp,gpq,kq->kg", slopes, self.covariances, slopes)
        variance = shares.sum(axis=1)
        dof = matched_dof(variance, 2 * (shares**2 / self.dof).sum(axis=1))
        half: Array = half_width_95(dof) * np.sqrt(variance)
        return half


def least_squares(names: Sequence[str], columns: Array, measured: Array, groups: Sequence[int]) -> ChannelSolution:
    """Estimate parameters from ``columns`` ``(n, d, p)`` and measurements ``(n, d)``.

    Channels of a group share one sigma, estimated from the residuals in turn with the parameters: the
    sum of squares by the rows less the fit's leverages, which is unbiased where all is linear.

    Args:
        groups: ``(d,)`` labels from 0 on; from ``_OWN_NOISE`` rows on every channel is its own group.

    Raises:
        LabError: there are no more rows than parameters.
    """
    label = np.arange(measured.shape[1]) if len(measured) >= _OWN_NOISE else np.asarray(groups)
    count = int(label.max()) + 1
    least = _ROUNDING * max(float(np.sqrt((measured**2).mean())), 1e-300)
    found = _reweighted(names, columns, measured, label, least)
    dof = np.maximum(_residual_dof(found, label, count), 1.0)
    rounding = bool((found.sigma <= 1.001 * least).any())
    return replace(found, covariances=_covariances(found, label, dof), dof=dof, rounding=rounding)


def _reweighted(
    names: Sequence[str], columns: Array, measured: Array, label: NDArray[np.int_], least: float
) -> ChannelSolution:
    """Iterate the fit until its sigmas, ``least`` or more, are those of its residuals."""
    count = int(label.max()) + 1
    spread = np.array([np.sqrt((measured[:, label == g] ** 2).mean()) for g in range(count)])
    found = _solved(names, columns, measured, np.maximum(spread, least)[label])
    for _ in range(_MAX_ITERATIONS):
        before, free = found.sigma, _residual_dof(found, label, count)
        if free.sum() < 0.5:
            raise LabError(
                f"{measured.size} measured numbers for {found.model.rank} unknowns leave none to tell the noise: "
                "give more samples or poses"
            )
        squares = np.array([(found.residual[:, label == g] ** 2).sum() for g in range(count)])
        scale = np.sqrt(np.where(free > 0.5, squares / np.maximum(free, 0.5), squares.sum() / free.sum()))
        found = _solved(names, columns, measured, np.maximum(before * scale[label], least))
        if np.abs(found.sigma / before - 1).max() < _CONVERGED:
            break
    return found


def _residual_dof(found: ChannelSolution, label: NDArray[np.int_], count: int) -> Array:
    """Return the number of rows of each group less its leverages."""
    left = 1 - found.model.leverages.reshape(found.residual.shape).sum(axis=0) / len(found.residual)
    return np.array([left[label == g].sum() for g in range(count)]) * len(found.residual)


def _covariances(found: ChannelSolution, label: NDArray[np.int_], dof: Array) -> Array:
    """Return covariances ``(g, p, p)`` by groups, larger for estimated weights (Kenward & Roger 1997).

    In the coordinates of the basis the information of group j is H_j, and all of it 1: the covariance has its part
    H_j + 4 / nu_j (H_j - H_j^2).
    """
    rows = found.model.basis.reshape(*found.residual.shape, -1)
    back = np.where(found.identifiable[:, None], found.model.back, 0.0)
    parts = []
    for g, nu in enumerate(dof):
        own = np.einsum("ndr,nds->rs", rows[:, label == g], rows[:, label == g])
        parts.append(back @ (own + 4 / nu * (own - own @ own)) @ back.T)
    return np.array(parts)


def _solved(names: Sequence[str], columns: Array, measured: Array, sigma: Array) -> ChannelSolution:
    """Fit with a given sigma ``(d,)``; covariances and degrees of freedom stay empty."""
    model = LinearModel.of((columns / sigma[:, None]).reshape(-1, columns.shape[2]), _RANK_TOLERANCE)
    target, nothing = (measured / sigma).ravel(), np.empty(0)
    values = np.where(model.identifiable, model.solve(target), 0.0)
    residual = model.residual(target).reshape(measured.shape)
    return ChannelSolution(tuple(names), values, model, nothing, nothing, sigma, measured, residual, False)


@dataclass(frozen=True)
class BiasCandidate:
    """A systematic effect that the residuals may follow.

    Attributes:
        columns: ``(n, d, k)`` beside those fitted.
        name: of the effect; of effects with equal p-values the first by name is reported.
    """

    columns: Array
    name: str


@dataclass(frozen=True)
class EvenSamples:
    """Rows that are evenly timed samples, one after the other, whose content is limited to half their rate.

    Attributes:
        first, last: the rows are ``first:last``.
        band_hz: of their content.
    """

    first: int
    last: int
    band_hz: float

    @property
    def slow(self) -> int:
        """Number of low-frequency coefficients of a cosine transform."""
        return round((self.last - self.first) * min(_SLOW_HZ / self.band_hz, _MAX_SLOW))


def check_residuals(
    solution: ChannelSolution, candidates: Sequence[BiasCandidate], series: Sequence[EvenSamples] = ()
) -> Check:
    """Run all applicable lack-of-fit tests; rows in no series are poses, or anything without order."""
    outcomes = [(_added(solution, _slow(each.columns, series)), each.name) for each in candidates]
    outcomes.append((_slowness(solution, series), "slow"))
    tested = [(p, name) for p, name in outcomes if not np.isnan(p)]
    if not tested:
        return Check("residuals", "not tested")
    least, cause = min(tested)
    p = min(1.0, len(tested) * least)
    outcome: Outcome = "passed" if p >= PAYLOAD_RESIDUALS else "failed"
    return Check("residuals", outcome, p=p, level=PAYLOAD_RESIDUALS, data={"cause": cause, "tests": len(tested)})


def _added(solution: ChannelSolution, columns: Array) -> float:
    """Return the p-value of the F test of further columns; NaN where the fit leaves too little of them."""
    rows = (columns / solution.sigma[:, None]).reshape(solution.residual.size, -1)
    length = np.linalg.norm(rows, axis=0)
    rows = rows[:, length > 0] / length[length > 0]
    rows = solution.model.residual(rows)
    u, sizes, _ = np.linalg.svd(rows, full_matrices=False)
    pull = u[:, sizes > _NEW].T @ solution.residual.ravel()
    squares, gained = float((solution.residual**2).sum()), float(pull @ pull)
    dof = solution.model.dof - len(pull)
    if len(pull) == 0 or dof < 3:
        return float("nan")
    noise = max((squares - gained) / dof, 1.0 if solution.rounding else 1e-300)
    return float(p_value_of_squares(gained, len(pull), dof, noise))


def _slow(columns: Array, series: Sequence[EvenSamples]) -> Array:
    """Return the low-frequency part of columns ``(n, d, k)``."""
    slow = np.array(columns)
    for part in series:
        rows = slice(part.first, part.last)
        transformed = scipy.fft.dct(columns[rows], axis=0, norm="ortho")
        transformed[part.slow :] = 0.0
        slow[rows] = scipy.fft.idct(transformed, axis=0, norm="ortho")
    return slow


def _slowness(solution: ChannelSolution, series: Sequence[EvenSamples]) -> float:
    """Return the p-value of the F test of the residuals' slow part against their quick one."""
    squares, dof = np.zeros(2), np.zeros(2)
    basis = solution.model.basis.reshape(*solution.residual.shape, -1)
    for part in series:
        rows = slice(part.first, part.last)
        power = scipy.fft.dct(solution.residual[rows], axis=0, norm="ortho") ** 2
        left = 1 - (scipy.fft.dct(basis[rows], axis=0, norm="ortho") ** 2).sum(axis=2)
        for i, which in enumerate((slice(0, part.slow), slice(part.slow, None))):
            squares[i] += power[which].sum()
            dof[i] += left[which].sum()
    if dof.min() < 3:
        return float("nan")
    mean = np.maximum(squares / dof, 1.0 if solution.rounding else 1e-300)
    return float(p_value_of_squares(mean[0] * dof[0], dof[0], dof[1], mean[1]))
