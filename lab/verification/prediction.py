"""What a run predicts of new measurements, and the generalized least squares that hold them against it.

Measured less predicted is r = e + J d, with e the instrument's noise and d the error of the identified parameters,
whose covariance is C: without any change r has the covariance S = noise + J C J', and r' S^-1 r is chi squared
(or F, where sigma was estimated: Chow 1960).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy import stats
from scipy.optimize import brentq

from lab.calibration.gauss_newton import Observations
from lab.calibration.initial_guess import initial_guess
from lab.calibration.noise.correlation import Correlation
from lab.calibration.weights import root_mean_square_sigma
from lab.core.linear_model import LinearModel, p_value_of_squares
from lab.core.measurements import seen_mask
from lab.core.se3 import Array
from lab.core.significance import VERIFICATION
from lab.kinematics.effects.arm import Arm

__all__ = ["FULL_RANK", "CalibrationPrediction", "RefitSolution", "VerificationProblem", "WhitenedSystem"]

_MOST_ESTIMATING = 3000
_DRAWS = 1999  # (draws + 1) x level is a whole number
_POWER = 0.95  # with which a change that "would be noticed" is
_ITERATIONS = 20
_SETTLED = 1e-3  # standard deviations: a step that moves the predictions by less
FULL_RANK = 1e-8  # of the largest singular value of unit columns


@dataclass(frozen=True)
class CalibrationPrediction:
    """What a run says of an arm.

    Attributes:
        values: ``(p,)`` of ``arm``.
        free: indices of those that were identified.
        covariance: ``(f, f)`` of these.
        dof: with how many degrees of freedom its sigma was estimated; None where it was known.
        strange: targets of the arm of which the run says nothing.
        tail_dof: degrees of freedom of Student's t that the noise is like; None if Gaussian.
    """

    arm: Arm
    values: Array
    free: tuple[int, ...]
    covariance: Array
    dof: int | None = None
    strange: tuple[str, ...] = ()
    tail_dof: float | None = None

    def test(self, numbers: int, p: float) -> str:
        """The test of so many numbers and its outcome, for a person."""
        if self.tail_dof is not None:
            said = f"noise with the tails of Student's t, {self.tail_dof:g} degrees of freedom, in {_DRAWS:,} draws"
            return f"test at {100 * VERIFICATION:g} % against {said}, p = {p:.2g}"
        name, dof = ("chi2", f"{numbers}") if self.dof is None else ("F", f"{numbers} and {self.dof}")
        chance = f"p = {p:.2g}" if p > 0 else "p < 1e-300"
        return f"{name} test at {100 * VERIFICATION:g} %, {dof} degrees of freedom, {chance}"

    def p(self, square: float, numbers: int) -> float:
        """The chance of a larger r' S^-1 r of so many numbers by noise alone; 1 where there are none."""
        if numbers < 1:
            return 1.0
        if self.tail_dof is not None:
            drawn = _squares_of_tails(self.tail_dof, numbers, self.dof)
            return float((1 + np.count_nonzero(drawn >= square)) / (1 + len(drawn)))
        return float(p_value_of_squares(square, numbers, self.dof))

    def deviance(self, square: float, numbers: int) -> float:
        """Minus twice the logarithm of the likelihood, up to a constant: of a Gaussian, or of Student's t."""
        if self.dof is None:
            return square
        return (self.dof + numbers) * float(np.log1p(square / self.dof))

    def noticeable(self, numbers: int) -> float:
        """How large a change of r, as r' S^-1 r, the test of so many numbers notices in 95 of 100 files."""

        def missed(shift: float) -> float:
            if self.dof is None:
                return float(stats.ncx2.cdf(stats.chi2.isf(VERIFICATION, numbers), numbers, shift)) - (1 - _POWER)
            bound = stats.f.isf(VERIFICATION, numbers, self.dof)
            return float(stats.ncf.cdf(bound, numbers, self.dof, shift)) - (1 - _POWER)

        enough = 1.0
        while missed(enough) > 0:  # no larger than that: far out the distribution is not to be had
            enough *= 2
        return float(brentq(missed, 0.5 * enough if enough > 1 else 0.0, enough))


@dataclass(frozen=True)
class WhitenedSystem:
    """The problem at some parameters, in units of the noise.

    Attributes:
        residual: ``(N,)`` measured less predicted.
        jacobian: ``(N, p)``.
        axes, sizes: ``(N, f)`` and ``(f,)`` of J C^1/2, so that S = 1 + axes sizes^2 axes'.
    """

    residual: Array
    jacobian: Array
    axes: Array
    sizes: Array

    def white(self, rows: Array) -> Array:
        """S^-1/2 of rows ``(N, ...)``."""
        return self._scaled(rows, 1 / np.sqrt(1 + self.sizes**2))

    def coloured(self, rows: Array) -> Array:
        """S^1/2 of rows ``(N, ...)``."""
        return self._scaled(rows, np.sqrt(1 + self.sizes**2))

    def _scaled(self, rows: Array, by: Array) -> Array:
        scaled: Array = rows + (self.axes * (by - 1)) @ (self.axes.T @ rows)
        return scaled


@dataclass(frozen=True)
class RefitSolution:
    """Where r' S^-1 r is least.

    Attributes:
        values: ``(p,)``.
        square: r' S^-1 r there.
        model: of the fitted columns ``(N, h)`` times S^-1/2.
        directions: ``(p, h)`` how the h fitted numbers change the parameters.
        there: the problem at ``values``.
    """

    values: Array
    square: float
    model: LinearModel
    directions: Array
    there: WhitenedSystem

    @property
    def rank(self) -> int:
        """How many numbers the measurements determine."""
        return self.model.rank

    @property
    def dof(self) -> int:
        """Degrees of freedom of ``square``."""
        return self.model.dof

    @property
    def back(self) -> Array:
        """``(p, rank)`` from the model's basis to the parameters."""
        back: Array = self.directions @ self.model.back
        return back

    @property
    def covariance(self) -> Array:
        """``(p, p)`` of what was fitted."""
        covariance: Array = self.back @ self.back.T
        return covariance

    def beyond(self, directions: Array) -> Array:
        """What directions ``(p, h)`` change, without what is fitted anyhow: whitened columns ``(N, h)``."""
        return self.model.residual(self.there.white(self.there.jacobian @ directions))


@dataclass(frozen=True)
class VerificationProblem:
    """New measurements, weighted by the instrument's noise, against what a run predicts."""

    prediction: CalibrationPrediction
    observed: Observations

    def fitted(self, start: Array, directions: Array) -> RefitSolution:
        """Least squares over the numbers of ``directions`` ``(p, h)``, by Gauss-Newton from ``start``.

        S is that of the parameters reached: a base may be turned by any angle. The loop is its own: the best is kept,
        and a step that leads to where loops do not close ends it.
        """
        values = start
        best, step, moved = self._step(values, directions)
        for _ in range(_ITERATIONS):
            if moved < _SETTLED:
                break
            values = values + step
            if np.isnan(self.prediction.arm.points(self.observed.inputs, values)).any():  # too far: loops do not close
                break
            here, step, moved = self._step(values, directions)
            best = here if here.square < best.square else best
        return best

    def placed(self, start: Array, directions: Array, groups: Sequence[str]) -> RefitSolution:
        """The same for base or tool, which may be anywhere: from ``start``, or from where the points alone put them."""
        near = self.fitted(start, directions)
        enough = int(seen_mask(self.observed.points).sum()) >= 3
        if "base" not in groups or not enough or self.prediction.p(near.square, near.dof) >= VERIFICATION:
            return near
        far = self.fitted(initial_guess(self.prediction.arm, self.observed, start, groups), directions)
        return far if far.square < near.square else near

    def promised_m(self, fit: RefitSolution) -> float:
        """Root mean square length of the errors to be expected where ``fit`` was made.

        Their covariance is S^1/2 (1 - Q Q') S^1/2, with Q the basis of what was fitted.
        """
        there = fit.there
        known, taken = (
            float((self.in_metres(rows) ** 2).sum())
            for rows in (there.axes * there.sizes, there.coloured(fit.model.basis))
        )
        numbers = len(there.residual)
        noise = numbers * root_mean_square_sigma(self.observed, 0) ** 2 + self._shared_squares()
        return float(np.sqrt(max(noise + known - taken, 0.0) * 3 / numbers))

    def in_metres(self, rows: Array) -> Array:
        """Rows ``(N, h)`` in units of the noise, in metres."""
        if self.observed.correlation is not None:
            rows = self._spread_over_poses(rows, self.observed.correlation)
        whiten, blocks = self.observed.whiten[seen_mask(self.observed.points)], rows.reshape(len(rows) // 3, 3, -1)
        metres = blocks / whiten[:, None, None] if whiten.ndim == 1 else np.linalg.solve(whiten, blocks)
        return np.asarray(metres.reshape(rows.shape))

    def _spread_over_poses(self, rows: Array, correlation: Correlation) -> Array:
        """Rows ``(N, h)`` with the errors that they share, in units of the instrument's noise."""
        mask = np.repeat(seen_mask(self.observed.points), 3, axis=1)
        blocks = np.zeros((*mask.shape, rows.shape[1]))
        blocks[mask] = rows
        return np.asarray(correlation.coloured(blocks)[mask])

    def _shared_squares(self) -> float:
        """The sum (m^2) of the variances of all numbers, the instrument's aside."""
        if (shared := self.observed.correlation) is None:
            return 0.0
        alone = replace(self, observed=replace(self.observed, correlation=None))
        mask = np.repeat(seen_mask(self.observed.points), 3, axis=1)
        parts = (shared.scatter, shared.shift, shared.trend)
        return sum(float((alone.in_metres(part[mask]) ** 2).sum()) for part in parts if part.size)

    def _at(self, values: Array) -> WhitenedSystem:
        points, slopes = self.prediction.arm.observe(self.observed.inputs, values)
        jacobian = self.observed.apply(slopes)
        known = jacobian[:, list(self.prediction.free)] @ _root(self.prediction.covariance)
        axes, sizes, _ = np.linalg.svd(known, full_matrices=False)
        return WhitenedSystem(self.observed.apply(self.observed.points - points), jacobian, axes, sizes)

    def _step(self, values: Array, directions: Array) -> tuple[RefitSolution, Array, float]:
        """The fit if it were solved here, the step ``(p,)`` to a better one, and how far that leads."""
        there = self._at(values)
        residual, columns = there.white(there.residual), there.white(there.jacobian @ directions)
        model = LinearModel.of(columns, FULL_RANK)
        pull = model.coordinates(residual)
        here = RefitSolution(values, float(residual @ residual), model, directions, there)
        return here, here.back @ pull, float(np.linalg.norm(pull))


@lru_cache(maxsize=64)
def _squares_of_tails(tail_dof: float, numbers: int, dof: int | None) -> Array:
    """Sums of squares ``(draws,)`` of so many numbers of unit variance, over an estimated variance of ``dof`` others.

    Of Student's t neither has a distribution with a name: the draws are always the same ones.
    """
    rng, size = np.random.default_rng(0), np.sqrt((tail_dof - 2) / tail_dof)
    squares: Array = ((size * rng.standard_t(tail_dof, (_DRAWS, numbers))) ** 2).sum(axis=1)
    if dof is not None and dof <= _MOST_ESTIMATING:  # of more the variance is known as well as need be
        squares = squares / ((size * rng.standard_t(tail_dof, (_DRAWS, dof))) ** 2).mean(axis=1)
    return squares


def _root(covariance: Array) -> Array:
    """A square root ``(f, f)`` of a covariance of parameters in several units."""
    scale = np.sqrt(np.diag(covariance))
    scale[scale == 0] = 1.0
    sizes, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    root: Array = scale[:, None] * axes * np.sqrt(np.maximum(sizes, 0.0))
    return root
