"""Find outliers among readings that come in wholes: pictures of many corners, and single corners of sound pictures.

The errors of a picture's corners are smooth over the picture, whatever moved it: a polynomial of their places in it.
A corner off that surface is an outlier of its own. A picture is tested by six numbers, the affine part of its errors,
as a pose is by its points; its corners are off with it, and are not tested one by one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import cast

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import ExtraResiduals, Fit, Observations, fit
from lab.calibration.statistics.outliers import (
    HeldOut,
    Outliers,
    find_outliers,
    held_out_outliers,
    leave_out,
    residual_lengths,
)
from lab.core.probability import chi2_sf
from lab.core.se3 import Array
from lab.core.significance import CAMPAIGN_OUTLIERS
from lab.kinematics.model import Model

__all__ = ["find_whole_outliers", "held_out_whole_outliers"]

_TERMS = 3  # of the affine part: 1, u, v
_CURVED = 6  # with the second order, which a corner is tested beside
_LARGE = 4.0  # times the error that three quarters of the pictures are below
_FAR_OFF = 6.0  # standard deviations of a reading: tails of its noise are not outliers
_MANY = 24  # readings of a whole, from which on the second order is fitted
_SPARE = 4  # corners beyond the terms that they are fitted by
_MEDIAN_OF_TWO = 1.1774100225154747  # median length of two standard normal numbers
_LEAST_SHARE = 0.5  # of the variance of an error that a residual is taken to have: of few readings all could be
_PASSES = 3
_ROUNDS = 12  # of a robust surface
_TUKEY = 4.685
_LEAST_SIGMA = 1e-9  # thousands of pixels: rounding


def find_whole_outliers(
    model: Model,
    observed: Observations,
    wholes: NDArray[np.int_],
    free: Sequence[int],
    start: Array,
    fitted: Array,
    *,
    rng: np.random.Generator,
    level: float = CAMPAIGN_OUTLIERS,
    extra_residuals: ExtraResiduals | None = None,
) -> Outliers:
    """Find the wholes that are off, and the single readings that are off in sound ones, and fit the others.

    Args:
        observed: ``(n, 1, 2)``, rows of one whole together.
        wholes: ``(n,)`` number of each row's whole, ascending from 0.
        start: ``(p,)`` links near the nominal ones.
        fitted: ``(p,)`` from all rows, beside which the errors of a whole are smooth.

    Returns:
        Outliers by rows, with the number of its whole for each that is off with it.
    """
    values = fitted
    for _ in range(2):
        off, p_single = _single_outliers(model, observed, wholes, values, level)
        projected = _Projected.of(model, observed, wholes, ~off)
        seen = projected.observations(observed.typical_weight)
        search = partial(find_outliers, cast(Model, projected), seen, free, start, sigma_given=False, rng=rng)
        found = search(level=level, extra_residuals=extra_residuals)
        values = found.fit.values
    # significant, and large beside the others: noise differs from picture to picture
    index = np.arange(len(projected.numbers), dtype=np.float64)[:, None]
    size = np.linalg.norm((seen.points - projected.points(index, values))[:, 0], axis=1)
    large = found.rows[size[found.rows] > _LARGE * np.quantile(size, 0.75)]
    # all rows of a whole are off with it; single ones count in sound wholes alone
    whole_off = np.isin(wholes, projected.numbers[large])
    rows = np.flatnonzero(whole_off | off)
    solution = fit(model, leave_out(observed, rows), free, values, extra_residuals=extra_residuals)
    p = np.where(off, p_single, 1.0)
    of_whole = dict(zip(projected.numbers[found.rows].tolist(), found.p_values.tolist(), strict=True))
    p[whole_off] = [of_whole[number] for number in wholes[whole_off].tolist()]
    sizes, weights = residual_lengths(model, observed, solution.values, None), np.where(whole_off | off, 0.0, 1.0)
    needed, of_rows = np.empty(0, dtype=np.int_), np.where(whole_off, wholes, -1)[rows]
    return Outliers(rows, sizes[rows], p[rows], solution, weights, False, level, needed, of_rows)


def held_out_whole_outliers(
    model: Model,
    fitted: tuple[Observations, NDArray[np.int_]],
    held_out: tuple[Observations, NDArray[np.int_]],
    solution: Fit,
    extra_residuals: ExtraResiduals | None = None,
) -> HeldOut:
    """Find the wholes held out that are off, beside the fitted ones.

    Args:
        fitted, held_out: readings, and the number of the whole of each.
    """
    (before, own), (after, others) = fitted, held_out
    first = int(own.max()) + 1
    both, wholes = before.joined(after), np.concatenate([own, first + others])
    projected = _Projected.of(model, both, wholes, np.ones(len(wholes), dtype=np.bool_))
    count = int((projected.numbers < first).sum())
    seen = projected.observations(both.typical_weight)
    found = held_out_outliers(
        cast(Model, projected), seen, count, solution, sigma_given=False, extra_residuals=extra_residuals
    )
    off = projected.numbers[count:][found.rows] - first
    p = dict(zip(off.tolist(), found.p_values.tolist(), strict=True))
    rows = np.flatnonzero(np.isin(others, off))
    sizes = residual_lengths(model, after, solution.values, None)[rows]
    return HeldOut(rows, sizes, np.array([p[number] for number in others[rows].tolist()]), others[rows])


@dataclass(frozen=True)
class _Projected:
    """A model of the affine part of each whole's readings: six numbers, in the readings' unit and of their noise.

    Attributes:
        model: of the readings.
        inputs: ``(n, joints + conditions)`` of these.
        places: ``(n, 2)`` the readings.
        basis: ``(n, 3)`` orthonormal over each whole; zero for rows that are left out.
        bounds: ``(w + 1,)`` first row of each whole, and the end.
        numbers: ``(w,)`` of the wholes.
    """

    model: Model
    inputs: Array
    places: Array
    basis: Array
    bounds: NDArray[np.int_]
    numbers: NDArray[np.int_]

    @staticmethod
    def of(model: Model, observed: Observations, wholes: NDArray[np.int_], used: NDArray[np.bool_]) -> "_Projected":
        """Return the wholes that have enough rows in use."""
        rows, basis, bounds, numbers = list[NDArray[np.int_]](), list[Array](), [0], list[int]()
        for number in range(int(wholes.max()) + 1):
            own = np.flatnonzero((wholes == number) & used)
            if len(own) >= _TERMS + _SPARE:
                rows.append(own)
                basis.append(np.linalg.qr(_terms(observed.points[own, 0], _TERMS))[0])
                bounds.append(bounds[-1] + len(own))
                numbers.append(number)
        at = np.concatenate(rows)
        parts = observed.inputs[at], observed.points[at, 0], np.concatenate(basis)
        return _Projected(model, *parts, np.array(bounds), np.array(numbers, dtype=np.int_))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return self.model.names

    def observations(self, weight: float) -> Observations:
        """Return the numbers of all wholes as they were measured, with the weight of a reading."""
        index = np.arange(len(self.numbers), dtype=np.float64)[:, None]
        rows, starts = self._rows(index)
        return Observations(index, self._project(self.places, rows, starts), np.full((len(index), 1), weight))

    def points(self, inputs: Array, values: Array) -> Array:
        """Return the numbers ``(w, 1, 6)`` of some wholes, by their index."""
        rows, starts = self._rows(inputs)
        return self._project(self.model.points(self.inputs[rows], values)[:, 0], rows, starts)

    def observe(self, inputs: Array, values: Array) -> tuple[Array, Array]:
        """Return the numbers ``(w, 1, 6)`` and their derivatives ``(w, 1, 6, p)``."""
        rows, starts = self._rows(inputs)
        places, slopes = self.model.observe(self.inputs[rows], values)
        return self._project(places[:, 0], rows, starts), self._project(slopes[:, 0], rows, starts)

    def _rows(self, inputs: Array) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """Return the rows of wholes, and where each begins among them."""
        index = inputs[:, 0].real.astype(np.int_)
        rows = np.concatenate([np.arange(self.bounds[i], self.bounds[i + 1]) for i in index])
        counts = self.bounds[index + 1] - self.bounds[index]
        return rows, np.cumsum([0, *counts[:-1]])

    def _project(self, numbers: Array, rows: NDArray[np.int_], starts: NDArray[np.int_]) -> Array:
        """Return ``(w, 1, 6, ...)`` from ``(n, 2, ...)``."""
        basis = self.basis[rows].reshape(len(rows), _TERMS, 1, *[1] * (numbers.ndim - 2))
        summed = np.add.reduceat(basis * numbers[:, None], starts, axis=0)
        return np.asarray(summed.reshape(len(starts), 1, 2 * _TERMS, *numbers.shape[2:]))


def _single_outliers(
    model: Model, observed: Observations, wholes: NDArray[np.int_], values: Array, level: float
) -> tuple[NDArray[np.bool_], Array]:
    """Return which readings ``(n,)`` are off the surface of their whole's errors, and p-values of the campaign."""
    errors = (observed.points - model.points(observed.inputs, values))[:, 0]
    surfaces = dict[int, tuple[NDArray[np.int_], Array]]()
    for number in range(int(wholes.max()) + 1):
        own = np.flatnonzero(wholes == number)
        count = _CURVED if len(own) >= _MANY else _TERMS if len(own) >= _TERMS + _SPARE else 1
        if len(own) >= count + 2:
            surfaces[number] = own, _terms(observed.points[own, 0], count)
    # the noise of a reading by robust surfaces, then surfaces by the readings that it explains
    lengths, sigma = np.full(len(errors), np.nan), np.inf
    for _ in range(_PASSES):
        for own, terms in surfaces.values():
            lengths[own] = _off_surface(terms, errors[own], sigma)
        tested = np.isfinite(lengths)
        if not tested.any():
            break
        sigma = max(float(np.median(lengths[tested])) / _MEDIAN_OF_TWO, _LEAST_SIGMA)
    # a blurred picture, or a board seen at a low angle, has more noise than the others
    sigmas = np.full(len(errors), sigma)
    for own, _ in surfaces.values():
        sigmas[own] = max(sigma, float(np.median(lengths[own])) / _MEDIAN_OF_TWO)
    p = np.ones(len(errors))
    p[tested] = np.minimum(1.0, tested.sum() * chi2_sf((lengths[tested] / sigmas[tested]) ** 2, 2))
    return (p < level) & ~(lengths <= _FAR_OFF * sigmas), p


def _off_surface(terms: Array, errors: Array, sigma: float) -> Array:
    """Return the lengths ``(m,)`` of errors ``(m, 2)`` less the surface that most of them lie on, as long as alone.

    Args:
        terms: ``(m, t)`` of the surface.
        sigma: noise of a reading; infinite to estimate it from these errors.
    """
    weights, lengths = np.ones(len(errors)), np.linalg.norm(errors - np.median(errors, axis=0), axis=1)
    for _ in range(_ROUNDS):
        scale = sigma if np.isfinite(sigma) else max(float(np.median(lengths)) / _MEDIAN_OF_TWO, _LEAST_SIGMA)
        weights = np.maximum(1 - (lengths / (_TUKEY * scale)) ** 2, 0.0) ** 2
        if (weights > 0).sum() < terms.shape[1] + 1:
            weights = (lengths <= np.median(lengths)).astype(np.float64)
        root = np.sqrt(weights)[:, None]
        solved = np.linalg.lstsq(root * terms, root * errors)[0]
        lengths = np.linalg.norm(errors - terms @ solved, axis=1)
    # a residual is shorter than its error by its leverage where it has weight, longer where it has none
    inside = weights > 0
    leverage = ((terms @ np.linalg.pinv(terms[inside].T @ terms[inside])) * terms).sum(axis=1)
    alone = lengths / np.sqrt(np.where(inside, np.maximum(1 - leverage, _LEAST_SHARE), 1 + leverage))
    # few readings, of a row of corners and one beside it, show no slope: the middle of all is as near
    return np.asarray(np.minimum(alone, np.linalg.norm(errors - np.median(errors, axis=0), axis=1)))


def _terms(places: Array, count: int) -> Array:
    """Return polynomials ``(m, count)`` of places ``(m, 2)`` about their middle."""
    u, v = ((places - places.mean(axis=0)) / max(float(np.ptp(places, axis=0).max()), 1e-12)).T
    return np.column_stack([np.ones(len(u)), u, v, u * u, u * v, v * v])[:, :count]
