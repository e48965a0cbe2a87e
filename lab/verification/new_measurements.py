"""Weight new measurements and hold them against an estimate, also where the variances of its noise are estimates.

r' S^-1 r of q numbers is chi squared if S is known. Where S stands on estimated variances t with the covariance W, it
is larger on average and scatters more: with G_i = S^-1 dS/dt_i, A1 = sum W_ij tr G_i tr G_j and A2 = sum W_ij tr G_i
G_j, its mean and variance are those of q / l times an F with q and m degrees of freedom (Kenward & Roger 1997,
equations 5 to 8). Where one variance alone was estimated that is the usual F. Errors that are correlated in time say
much less of their variance than there are numbers.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lab.calibration.estimate import Estimate
from lab.calibration.extrapolation import MeasuredRange
from lab.calibration.gauss_newton import Observations
from lab.calibration.observation import observation_of
from lab.calibration.residual.process import PredictedBy
from lab.calibration.statistics.outliers import LEAST_SIGMA_M
from lab.calibration.weights import Noise, root_mean_square_sigma, weigh
from lab.core.linear_model import whitening
from lab.core.measurements import Measurements, seen_mask
from lab.core.se3 import Array
from lab.noise.correlation import Correlation
from lab.noise.error_model import ErrorModel
from lab.noise.variance_components import ComponentErrors
from lab.verification.prediction import CalibrationPrediction

__all__ = ["MOST_POSES", "STEP", "predict_measurements", "with_estimated_noise"]

STEP = 0.1  # of the logarithm of a variance, for differences
MOST_POSES = 100  # that say the degrees of freedom: of more they are much the same
_MOST_DOF = 1_000_000
_MOST_SHARE = 0.5  # of the numbers: what is told so badly that A2 were more is beyond an expansion


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
    arm = estimate.with_targets(rows.targets)
    strange = tuple(target for target in rows.targets if target not in estimate.arm.targets)
    named = dict(zip(estimate.arm.names, estimate.values, strict=True))
    values = np.array([named.get(name, 0.0) for name in arm.names])
    retained = [i for i, name in enumerate(estimate.identified) if name in arm.names]
    free = tuple(arm.names.index(estimate.identified[i]) for i in retained)
    covariance = estimate.covariance[np.ix_(retained, retained)]
    observations, _ = weigh(observation_of(arm), rows, noise)
    discrepancy, inflation, dof = estimate.discrepancy(root_mean_square_sigma(observations, 0))
    prediction = CalibrationPrediction(arm, values, free, inflation * covariance, dof, strange, estimate.tail_dof)
    if (by := estimate.predicted_by) is not None:
        prediction = replace(prediction, covariance=0.0 * covariance)
        beside = _beside_process(_widened(observations, discrepancy), by, rows.targets)
        return _beyond_range(beside, prediction, estimate.measured), prediction
    errors = estimate.component_errors
    if errors is None:
        return _beyond_range(_widened(observations, discrepancy), prediction, estimate.measured), prediction
    if given or estimate.noise_m < LEAST_SIGMA_M:  # of what is hardly there nothing is estimated
        errors = errors.without("scale")
    return _of_estimated_noise(estimate, rows, noise, prediction, errors.of(retained))


def _of_estimated_noise(
    estimate: Estimate, rows: Measurements, noise: Noise, prediction: CalibrationPrediction, errors: ComponentErrors
) -> tuple[Observations, CalibrationPrediction]:
    """Measurements and prediction by a noise model whose variances the run estimated, with what that costs."""
    observation, shared = observation_of(prediction.arm), noise.shared
    assert shared is not None

    def by(some: Measurements, its: ErrorModel) -> Observations:
        observations, _ = weigh(observation, some, replace(noise, shared=its))
        return _beyond_range(observations, prediction, estimate.measured)

    first = rows.take(np.arange(min(len(rows), MOST_POSES)))
    moved = [(by(first, shared.moved(name, STEP)), by(first, shared.moved(name, -STEP))) for name in errors.names]
    prediction, observations = with_estimated_noise(prediction, by(rows, shared), errors, moved)
    return observations, prediction


def with_estimated_noise(
    prediction: CalibrationPrediction,
    observed: Observations,
    errors: ComponentErrors,
    moved: Sequence[tuple[Observations, Observations]],
) -> tuple[CalibrationPrediction, Observations]:
    """A prediction and measurements whose test keeps its level although the variances were estimated.

    Args:
        observed: the measurements, weighted by the estimated variances.
        errors: of these; its slopes are of the prediction's free parameters.
        moved: for each variance the first ``MOST_POSES`` measurements, weighted by it ``STEP`` larger and smaller.
    """
    some = observed.take(np.arange(min(len(observed.inputs), MOST_POSES)))
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
    """Covariance ``(numbers, numbers)`` (m^2) of the measurements' errors."""
    root = observed.in_metres(np.eye(numbers))
    return root @ root.T


def _matched(q: int, first: float, second: float) -> tuple[float, int]:
    """The factor l and the degrees of freedom m (Kenward & Roger 1997)."""
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
    """Return the measurements with the model discrepancy beyond the joint positions that the run fitted."""
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
    """Return the observations with their noise increased by the model discrepancy."""
    if discrepancy_m == 0:
        return observations
    if observations.whiten.ndim == 2:
        return replace(observations, whiten=1 / np.sqrt(1 / observations.whiten**2 + discrepancy_m**2))
    root = np.linalg.inv(observations.whiten)
    return replace(observations, whiten=whitening(root @ np.swapaxes(root, -1, -2) + discrepancy_m**2 * np.eye(3)))
