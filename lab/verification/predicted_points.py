"""Predict new measurements from a run, and compare the two by generalized least squares.

Measured less predicted is r = e + J d, with e the instrument's noise and d the error of the identified parameters,
whose covariance is C: without any change r has the covariance S = noise + J C J', and r' S^-1 r is chi squared
(or F, where sigma was estimated: Chow 1960).

Where S stands on estimated variances t with the covariance W, r' S^-1 r is larger on average and scatters more: with
G_i = S^-1 dS/dt_i, A1 = sum W_ij tr G_i tr G_j and A2 = sum W_ij tr G_i G_j, its mean and variance are those of q / l
times an F with q and m degrees of freedom (Kenward & Roger 1997, equations 5 to 8).

Sums of squares of noise with the tails of Student's t are drawn. Of very many numbers only the few beyond a bound are
drawn one by one; the sum of the others is normal by the central limit theorem.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import scipy  # its statistics are loaded at their first use
from scipy import integrate, stats
from scipy.optimize import brentq

from lab.calibration.gauss_newton import Observations
from lab.calibration.guess import initial_guess
from lab.calibration.observation import observation_of
from lab.calibration.residual.gaussian_process import PredictedBy
from lab.calibration.statistics.outliers import LEAST_SIGMA_M
from lab.calibration.weights import Noise, root_mean_square_sigma, weigh
from lab.core.errors import LabError
from lab.core.linear_model import LinearModel, covariance_root, p_value_of_squares, triangle_of, whitening
from lab.core.measurements import Measurements, seen_mask
from lab.core.probability import chi2_isf, f_isf
from lab.core.progress import Progress, no_progress
from lab.core.se3 import Array
from lab.core.significance import VERIFICATION
from lab.kinematics.effects.arm_with_effects import Arm
from lab.noise.correlation import Correlation
from lab.noise.error_model import ErrorModel
from lab.noise.variance_components import ComponentErrors
from lab.prediction.estimate import Estimate
from lab.prediction.extrapolation import MeasuredRange

__all__ = [
    "DRAWS",
    "FULL_RANK",
    "STEP",
    "CalibrationPrediction",
    "RefitSolution",
    "VerificationProblem",
    "predict_measurements",
    "squares_of_tails",
    "with_estimated_noise",
]

DRAWS = 1999  # (draws + 1) x level is a whole number
_MOST_ESTIMATING = 3000
_MOST_DRAWN = 3000  # numbers that are drawn one by one
_MEAN = 30  # errors
_AT_ONCE = 32  # means
_BEYOND = 300  # numbers of each draw that lie beyond the bound where there are more


@lru_cache(maxsize=64)
def squares_of_tails(tail_dof: float, numbers: int, dof: int | None, each_of: int = 1) -> Array:
    """Sums of squares ``(draws,)`` of so many numbers of unit variance, over an estimated variance of ``dof`` others.

    The draws are always the same ones.

    Args:
        tail_dof: degrees of freedom of Student's t, above 2.
        each_of: how many independent errors each number is a mean of, times their square root. Such means are nearer to
            normal than the errors are, so more than thirty count as thirty.
    """
    rng = np.random.default_rng(0)
    squares = _sums(tail_dof, numbers, rng) if each_of < 2 else _of_means(tail_dof, numbers, min(each_of, _MEAN))
    if dof is not None and dof <= _MOST_ESTIMATING:  # of more the variance is known as well as need be
        squares = squares / (_sums(tail_dof, dof, rng) / dof)
    return squares


def _sums(tail_dof: float, numbers: int, rng: np.random.Generator) -> Array:
    size = (tail_dof - 2) / tail_dof
    if numbers <= _MOST_DRAWN:
        drawn: Array = size * (rng.standard_t(tail_dof, (DRAWS, numbers)) ** 2).sum(axis=1)
        return drawn
    student, share = stats.t(tail_dof), _BEYOND / numbers
    bound = float(student.isf(share / 2))
    mean, square = (_within(student, bound, power) / (1 - share) for power in (2, 4))
    beyond = rng.binomial(numbers, share, DRAWS)
    within = numbers - beyond
    sums = mean * within + np.sqrt(within * (square - mean**2)) * rng.standard_normal(DRAWS)
    tails = student.isf(share / 2 * rng.random(int(beyond.sum()))) ** 2
    sums += np.bincount(np.repeat(np.arange(DRAWS), beyond), weights=tails, minlength=DRAWS)
    return np.asarray(size * sums)


def _of_means(tail_dof: float, numbers: int, each_of: int) -> Array:
    return np.asarray(_summed_means(tail_dof, -(-numbers // _AT_ONCE) * _AT_ONCE, each_of)[:, numbers - 1])


@lru_cache(maxsize=8)
def _summed_means(tail_dof: float, most: int, each_of: int) -> Array:
    """Sums ``(draws, most)`` of the squares of the first mean, of the first two, and so on."""
    rng, size = np.random.default_rng(1), (tail_dof - 2) / tail_dof / each_of
    means = [rng.standard_t(tail_dof, (DRAWS, each_of)).sum(axis=1) for _ in range(most)]
    return size * np.cumsum(np.square(means).T, axis=1)


def _within(student: Any, bound: float, power: int) -> float:
    return float(2 * integrate.quad(lambda t: t**power * student.pdf(t), 0, bound, limit=500)[0])


_POWER = 0.95  # with which a change that "would be noticed" is
_ITERATIONS = 20
_PLACED_BY = 4_000  # poses that place base and tool
_SETTLED = 1e-3  # standard deviations: a step that moves the predictions by less
FULL_RANK = 1e-8  # of the largest singular value of unit columns


@dataclass(frozen=True)
class CalibrationPrediction:
    """Prediction of an arm's points from a run.

    Attributes:
        values: ``(p,)`` of ``arm``.
        free: indices of those that were identified.
        dof: with how many degrees of freedom its sigma was estimated; None where it was given.
        strange: targets of the arm that the run did not have.
        tail_dof: degrees of freedom of the noise's Student's t; None if Gaussian.
    """

    arm: Arm
    values: Array
    free: tuple[int, ...]
    covariance: Array
    dof: int | None = None
    strange: tuple[str, ...] = ()
    tail_dof: float | None = None

    def p(self, square: float, numbers: int, each_of: int = 1) -> float:
        """Return the chance of a larger r' S^-1 r of so many numbers by noise alone; 1 where there are none.

        Args:
            each_of: how many measured numbers each is a combination of.
        """
        if numbers < 1:
            return 1.0
        if self.tail_dof is not None:
            drawn = squares_of_tails(self.tail_dof, numbers, self.dof, each_of)
            return float((1 + np.count_nonzero(drawn >= square)) / (1 + len(drawn)))
        return float(p_value_of_squares(square, numbers, self.dof))

    def deviance(self, square: float, numbers: int) -> float:
        """Minus twice the logarithm of the likelihood, up to a constant: of a Gaussian, or of Student's t."""
        if self.dof is None:
            return square
        return (self.dof + numbers) * float(np.log1p(square / self.dof))

    def noticeable(self, numbers: int, level: float = VERIFICATION) -> float:
        """Return the change of r' S^-1 r that a test with ``numbers`` degrees of freedom has power 95 % to detect."""

        def missed(shift: float) -> float:
            if self.dof is None:
                return float(scipy.stats.ncx2.cdf(chi2_isf(level, numbers), numbers, shift)) - (1 - _POWER)
            bound = f_isf(level, numbers, self.dof)
            return float(scipy.stats.ncf.cdf(bound, numbers, self.dof, shift)) - (1 - _POWER)

        enough = 1.0
        while missed(enough) > 0:  # no larger than that: far out the distribution is not to be had
            enough *= 2
        return float(brentq(missed, 0.5 * enough if enough > 1 else 0.0, enough))


@dataclass(frozen=True)
class _WhitenedSystem:
    """The problem at some parameters, in units of the noise, and turned so that p + 1 rows hold it.

    With [J r] = Q R of all N rows, whatever the test asks of J, r and S = 1 + J C J' is the same of the rows of R:
    the other N - p - 1 directions hold nothing. Only how many numbers there are has to be kept beside them.

    Attributes:
        residual: ``(m,)`` measured less predicted, m at most p + 1.
        axes, sizes: ``(m, f)`` and ``(f,)`` of J C^1/2, so that S = 1 + axes sizes^2 axes'.
        known: ``(p, f)`` from the parameters to these axes: axes times sizes is J known.
    """

    residual: Array
    jacobian: Array
    axes: Array
    sizes: Array
    prior_rows: Array

    def white(self, rows: Array) -> Array:
        """S^-1/2 of rows ``(m, ...)``."""
        less = 1 / np.sqrt(1 + self.sizes**2) - 1
        white: Array = rows + (self.axes * less) @ (self.axes.T @ rows)
        return white


@dataclass(frozen=True)
class RefitSolution:
    """Minimum of r' S^-1 r over the fitted parameters.

    Attributes:
        square: r' S^-1 r there.
        model: of the fitted columns ``(m, h)`` times S^-1/2.
        directions: ``(p, h)`` how the h fitted numbers change the parameters.
        there: the problem at ``values``.
    """

    values: Array
    square: float
    numbers: int
    model: LinearModel
    directions: Array
    there: _WhitenedSystem

    @property
    def rank(self) -> int:
        """Number of fitted parameters that the measurements determine."""
        return self.model.rank

    @property
    def dof(self) -> int:
        """Degrees of freedom of ``square``."""
        return self.numbers - self.rank

    @property
    def back(self) -> Array:
        """Matrix ``(p, rank)`` from the model's basis to the parameters."""
        back: Array = self.directions @ self.model.back
        return back

    @property
    def covariance(self) -> Array:
        """Covariance ``(p, p)`` of the fitted parameters."""
        covariance: Array = self.back @ self.back.T
        return covariance

    @property
    def taken(self) -> Array:
        """Matrix T ``(p, f + rank)``, for which S^-1 less what is fitted is 1 - J T (J T)'."""
        gained = self.there.prior_rows / np.sqrt(1 + self.there.sizes**2)
        shared = (self.there.jacobian @ gained).T @ (self.there.jacobian @ self.back)
        return np.concatenate([gained, self.back - gained @ shared], axis=1)

    def beyond(self, directions: Array) -> Array:
        """Return the whitened derivatives ``(m, h)`` along ``(p, h)``, orthogonal to the fitted columns."""
        return self.model.residual(self.there.white(self.there.jacobian @ directions))


@dataclass(frozen=True)
class VerificationProblem:
    """New measurements, weighted by the instrument's noise, against a run's prediction.

    Attributes:
        progress: takes how many poses were worked out of how many, each time that all are gone through.
    """

    prediction: CalibrationPrediction
    observed: Observations
    progress: Progress = no_progress

    @property
    def numbers(self) -> int:
        """Number of measured coordinates."""
        return 3 * int(seen_mask(self.observed.points).sum())

    def parts(self, values: Array) -> Iterator[tuple[Observations, Array, Array]]:
        """Yield blocks of poses: their measurements, with whitened residuals and derivatives.

        Raises:
            LabError: the arm cannot be in one of the poses: its loops do not close.
        """
        done = 0
        for each in self.observed.blocks():
            points, slopes = self.prediction.arm.observe(each.inputs, values)
            if np.isnan(points).any():
                raise LabError("the calibrated arm cannot be in one of these poses: its loops do not close; calibrate")
            yield each, each.apply(each.points - points), each.apply(slopes)
            done += len(each.inputs)
            self.progress(done, len(self.observed.inputs))

    def fitted(self, start: Array, directions: Array, at_start: _WhitenedSystem | None = None) -> RefitSolution:
        """Fit the numbers of ``directions`` ``(p, h)`` by Gauss-Newton from ``start``.

        S is that of the parameters reached: a base may be turned by any angle. The loop is its own: the best is kept,
        and a step that leads to where loops do not close ends it.
        """
        values = start
        best, step, moved = self._step(values, directions, self._at(values) if at_start is None else at_start)
        for _ in range(_ITERATIONS):
            if moved < _SETTLED:
                break
            values = values + step
            try:
                there = self._at(values)
            except LabError:  # too far
                break
            here, step, moved = self._step(values, directions, there)
            best = here if here.square < best.square else best
        return best

    def placed(
        self, start: Array, directions: Array, groups: Sequence[str], at_start: _WhitenedSystem | None = None
    ) -> RefitSolution:
        """Fit base or tool anew, from ``start`` or, as they may be anywhere, from the points alone."""
        near = self.fitted(start, directions, at_start)
        some = self.observed.thinned(_PLACED_BY)
        enough = int(seen_mask(some.points).sum()) >= 3
        if "base" not in groups or not enough or self.prediction.p(near.square, near.dof) >= VERIFICATION:
            return near
        far = self.fitted(initial_guess(self.prediction.arm, some, start, groups), directions)
        return far if far.square < near.square else near

    def expected_m(self, fit: RefitSolution) -> float:
        """Root mean square length of the errors to be expected where ``fit`` was made.

        Their covariance is S^1/2 (1 - Q Q') S^1/2, with Q the basis of what was fitted, and S^1/2 Q is J B.
        """
        rows = triangle_of(each.in_metres(jacobian) for each, _, jacobian in self.parts(fit.values))
        known, taken = (float(((rows @ part) ** 2).sum()) for part in (fit.there.prior_rows, fit.back))
        noise = self.numbers * root_mean_square_sigma(self.observed, 0) ** 2 + self._shared_squares()
        return float(np.sqrt(max(noise + known - taken, 0.0) * 3 / self.numbers))

    def _shared_squares(self) -> float:
        if (shared := self.observed.correlation) is None:
            return 0.0
        alone = replace(self.observed, correlation=None)
        mask = np.repeat(seen_mask(self.observed.points), 3, axis=1)
        parts = (shared.scatter, shared.shift, shared.trend)
        return sum(float((alone.in_metres(part[mask]) ** 2).sum()) for part in parts if part.size)

    def _at(self, values: Array) -> _WhitenedSystem:
        both = triangle_of(np.column_stack([jacobian, part]) for _, part, jacobian in self.parts(values))
        jacobian, free = both[:, :-1], list(self.prediction.free)
        root = covariance_root(self.prediction.covariance)
        axes, sizes, turned = np.linalg.svd(jacobian[:, free] @ root, full_matrices=False)
        known = np.zeros((len(values), len(sizes)))
        known[free] = root @ turned.T
        return _WhitenedSystem(both[:, -1], jacobian, axes, sizes, known)

    def _step(self, values: Array, directions: Array, there: _WhitenedSystem) -> tuple[RefitSolution, Array, float]:
        """Solve there: return the fit, the step ``(p,)`` to a better one, and its size."""
        residual, columns = there.white(there.residual), there.white(there.jacobian @ directions)
        model = LinearModel.of(columns, FULL_RANK)
        pull = model.coordinates(residual)
        here = RefitSolution(values, float(residual @ residual), self.numbers, model, directions, there)
        return here, here.back @ pull, float(np.linalg.norm(pull))


STEP = 0.1  # of the logarithm of a variance, for differences
_MOST_POSES = 100  # that determine the degrees of freedom
_MOST_DOF = 1_000_000
_MOST_SHARE = 0.5  # of the numbers that A2 may be: beyond, the expansion does not hold


def predict_measurements(
    estimate: Estimate, rows: Measurements, noise: Noise, *, given: bool
) -> tuple[Observations, CalibrationPrediction]:
    """Weight new measurements, and predict them by an estimate.

    Where the residuals of the fit were more than noise, or its noise was estimated, they are the measure: what the
    model lacks is taken for noise of its own, and the covariance grows as the residuals do.

    Args:
        estimate: with a known covariance.
        rows: measured points, of targets of the estimate; others stand at zero in the last frame.
        noise: of the new measurements, with the errors that the estimate found beside the instrument's.
        given: whether the instrument's noise is given, so that its variance is no estimate.
    """
    observations, _ = weigh(observation_of(estimate.with_targets(rows.targets)), rows, noise)
    discrepancy, inflation, dof = estimate.discrepancy(root_mean_square_sigma(observations, 0))
    prediction, retained = _at_targets(estimate, rows.targets, inflation, dof)
    if (by := estimate.predicted_by) is not None:
        prediction = replace(prediction, covariance=0.0 * prediction.covariance)
        beside = _beside_process(_widened(observations, discrepancy), by, rows.targets)
        return _beyond_range(beside, prediction, estimate.measured), prediction
    errors = estimate.component_errors
    if errors is None:
        return _beyond_range(_widened(observations, discrepancy), prediction, estimate.measured), prediction
    if given or estimate.noise_m < LEAST_SIGMA_M:
        errors = errors.without("scale")
    return _of_estimated_noise(estimate, rows, noise, prediction, errors.of(retained))


def _at_targets(
    estimate: Estimate, targets: tuple[str, ...], inflation: float, dof: int | None
) -> tuple[CalibrationPrediction, list[int]]:
    """Return the prediction of an arm with these targets, and which identified parameters it has.

    Args:
        inflation: factor of the parameters' covariance.
        dof: of the noise; None where it is known.
    """
    arm = estimate.with_targets(targets)
    strange = tuple(target for target in targets if target not in estimate.arm.targets)
    named = dict(zip(estimate.arm.names, estimate.values, strict=True))
    values = np.array([named.get(name, 0.0) for name in arm.names])
    retained = [i for i, name in enumerate(estimate.identified) if name in arm.names]
    free = tuple(arm.names.index(estimate.identified[i]) for i in retained)
    covariance = inflation * estimate.covariance[np.ix_(retained, retained)]
    return CalibrationPrediction(arm, values, free, covariance, dof, strange, estimate.tail_dof), retained


def _of_estimated_noise(
    estimate: Estimate, rows: Measurements, noise: Noise, prediction: CalibrationPrediction, errors: ComponentErrors
) -> tuple[Observations, CalibrationPrediction]:
    """Measurements and prediction by a noise model whose variances the run estimated, with what that costs."""
    observation, shared = observation_of(prediction.arm), noise.shared
    assert shared is not None

    def by(some: Measurements, its: ErrorModel) -> Observations:
        observations, _ = weigh(observation, some, replace(noise, shared=its))
        return _beyond_range(observations, prediction, estimate.measured)

    first = rows[:_MOST_POSES]
    moved = [(by(first, shared.moved(name, STEP)), by(first, shared.moved(name, -STEP))) for name in errors.names]
    prediction, observations = with_estimated_noise(prediction, by(rows, shared), errors, moved)
    return observations, prediction


def with_estimated_noise(
    prediction: CalibrationPrediction,
    observed: Observations,
    errors: ComponentErrors,
    moved: Sequence[tuple[Observations, Observations]],
) -> tuple[CalibrationPrediction, Observations]:
    """Correct a prediction and measurements for estimated variances, so that the test keeps its level.

    Args:
        observed: the measurements, weighted by the estimated variances.
        errors: of these; its slopes are of the prediction's free parameters.
        moved: for each variance the first ``_MOST_POSES`` measurements, weighted by it ``STEP`` larger and smaller.
    """
    some = observed.take(np.arange(min(len(observed.inputs), _MOST_POSES)))
    mask = seen_mask(some.points)
    numbers = 3 * int(mask.sum())
    slopes = prediction.arm.observe(some.inputs, prediction.values)[1][mask]
    rows = slopes.reshape(numbers, -1)[:, list(prediction.free)]
    inverse = np.linalg.inv(_noise(some, numbers) + rows @ prediction.covariance @ rows.T)
    shares = []
    for (more, less), slope in zip(moved, errors.slopes, strict=True):
        change = (_noise(more, numbers) - _noise(less, numbers)) / (2 * STEP)
        known = (slope[:, None] + slope) * prediction.covariance
        shares.append(inverse @ (change + rows @ known @ rows.T))
    traces = np.array([np.trace(share) for share in shares])
    products = np.array([[np.sum(a * b.T) for b in shares] for a in shares])
    scale, dof = _matched(
        numbers, float(traces @ errors.covariance @ traces), float((errors.covariance * products).sum())
    )
    return (
        replace(prediction, covariance=prediction.covariance / scale, dof=dof),
        replace(observed, whiten=observed.whiten * np.sqrt(scale)),
    )


def _noise(observed: Observations, numbers: int) -> Array:
    root = observed.in_metres(np.eye(numbers))
    return root @ root.T


def _matched(q: int, first: float, second: float) -> tuple[float, int]:
    """Return the factor l and the degrees of freedom m (Kenward & Roger 1997)."""
    if not second > 0:
        return 1.0, _MOST_DOF
    shrunk = min(1.0, _MOST_SHARE * q / second)
    first, second = shrunk * first, shrunk * second
    b, g = (first + 6 * second) / (2 * q), ((q + 1) * first - (q + 4) * second) / ((q + 2) * second)
    c = np.array([g, q - g, q + 2 - g]) / (3 * q + 2 * (1 - g))
    mean = 1 / (1 - second / q)
    variance = 2 / q * (1 + c[0] * b) / ((1 - c[1] * b) ** 2 * (1 - c[2] * b))
    excess = q * variance / (2 * mean**2) - 1
    dof = min(4 + (q + 2) / excess, _MOST_DOF) if excess > 0 else _MOST_DOF
    return float(dof / (mean * (dof - 2))), round(dof)


def _beside_process(observations: Observations, by: PredictedBy, targets: tuple[str, ...]) -> Observations:
    """Return the measurements with the errors of a process's predictions, of all poses together."""
    n, k, _ = observations.points.shape
    which = [by.model.targets.index(target) for target in targets]
    whole = by.covariance(observations.inputs).reshape(n, -1, 3, n, len(by.model.targets), 3)[:, which][..., which, :]
    sizes, axes = np.linalg.eigh(whole.reshape(3 * n * k, 3 * n * k))
    root = (axes * np.sqrt(np.maximum(sizes, 0.0))).reshape(n, k, 3, -1)
    root = np.where(seen_mask(observations.points)[..., None, None], observations.in_units_of_noise(root), 0.0)
    shared, nothing = root.reshape(n, 3 * k, -1), np.zeros((n, 3 * k, 0))
    found = observations.correlation
    if found is None:
        found = Correlation(nothing, nothing, 0.0, nothing, np.arange(n, dtype=float))
    return replace(observations, correlation=replace(found, trend=np.concatenate([found.trend, shared], axis=2)))


def _beyond_range(
    observations: Observations, prediction: CalibrationPrediction, measured: MeasuredRange | None
) -> Observations:
    if measured is None or not measured.is_worse_beyond:
        return observations
    n, k, d = observations.points.shape
    unknown = measured.unknown(prediction.arm, observations.inputs, prediction.values)
    if not unknown.any():
        return observations
    scatter = observations.in_units_of_noise(unknown).reshape(n, k * d, -1)
    found = observations.correlation
    if found is None:
        nothing = np.zeros((n, k * d, 0))
        return replace(observations, correlation=Correlation(scatter, nothing, 0.0, nothing, np.arange(n, dtype=float)))
    return replace(observations, correlation=replace(found, scatter=np.concatenate([found.scatter, scatter], axis=2)))


def _widened(observations: Observations, discrepancy_m: float) -> Observations:
    if discrepancy_m == 0:
        return observations
    if observations.whiten.ndim == 2:
        return replace(observations, whiten=1 / np.sqrt(1 / observations.whiten**2 + discrepancy_m**2))
    root = np.linalg.inv(observations.whiten)
    return replace(observations, whiten=whitening(root @ np.swapaxes(root, -1, -2) + discrepancy_m**2 * np.eye(3)))
