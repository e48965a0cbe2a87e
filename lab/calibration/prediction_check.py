"""Compare the errors at poses that were not fitted with what the calibration predicts of them.

The predicted errors are those of the parameters (by their covariance, and beyond the measured range what the model may
lack there) and, where measured points judge, those of the noise. They are drawn many times, with one draw of the
parameters for all poses, so that the 95 % error of the campaign's own poses is known with its chance. Poses in regions
that were not measured are left out where enough others remain: the model discrepancy there is wide, and would hide
errors where poses were measured.
"""

import numpy as np
from numpy.typing import NDArray

from lab.calibration.extrapolation import MeasuredRange
from lab.calibration.identify import Identification
from lab.calibration.observation import observation_of, only_positions
from lab.calibration.validation import FOLDS, Validation
from lab.calibration.weights import Noise, weigh
from lab.core.checks import Check
from lab.core.linear_model import covariance_root
from lab.core.measurements import Measurements, evenly
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.significance import PREDICTION_EXCEEDED

__all__ = ["check_prediction", "prediction_check"]

DRAWS = 999
_MAX_POSES = 300
SHARE = 95.0  # percent
ROUNDING_M = 1e-7  # errors below are those of the arithmetic
_LEAST_POSES = 10  # in the measured region: of fewer, those beyond it are compared too


def prediction_check(
    observed_p95_m: float, predicted_p95_m: float, allowed_p95_m: float, extrapolated: int = 0
) -> Check:
    """Return the check of the 95 % error (m) at poses that were not fitted: failed where it exceeds what is allowed.

    Args:
        observed_p95_m: of the validation.
        predicted_p95_m: the median of what was predicted for these poses.
        allowed_p95_m: what chance exceeds in 1 % of campaigns like this one.
        extrapolated: poses beyond the measured region that were left out.
    """
    return Check(
        "accuracy.prediction",
        "failed" if observed_p95_m > allowed_p95_m + ROUNDING_M else "passed",
        observed_p95_m / max(allowed_p95_m, ROUNDING_M),
        level=PREDICTION_EXCEEDED,
        data={
            "observed_p95_m": observed_p95_m,
            "predicted_p95_m": predicted_p95_m,
            "allowed_p95_m": allowed_p95_m,
            "extrapolated": extrapolated,
        },
    )


def check_prediction(
    identification: Identification,
    validation: Validation,
    noise: Noise,
    measured: MeasuredRange | None = None,
    *,
    seed: int = 0,
) -> Check | None:
    """Compare observed and predicted 95 % errors; None where there is nothing to compare.

    Args:
        validation: errors of points at poses whose rows are known.
        noise: of the measurements that judge, with the errors that they share.
        measured: the range of the fitted joint positions.
        seed: of the draws.
    """
    rows, errors = validation.rows, validation.errors
    if rows is None or errors is None or not only_positions(observation_of(identification.model)):
        return None
    after = errors.after
    if after.shape != rows.points.shape[:2] or validation.fitted_share > 0:
        return None
    inside, extrapolated = _measured_region(measured, rows), 0
    if inside is not None:
        extrapolated = len(rows) - len(inside)
        rows, after = rows.take(inside), after[inside]
    if (some := evenly(len(rows), _MAX_POSES)) is not None:
        rows, after = rows.take(some), after[some]
    seen = np.isfinite(after)
    if not seen.any() or not np.isfinite(identification.covariance).all():
        return None
    rng = rng_for(seed, "bootstrap")
    inflation = FOLDS / (FOLDS - 1) if validation.judged_by == "cross-validation" else 1.0
    scale = _scale(identification, rng)
    drawn = np.sqrt(inflation) * _errors_of_parameters(identification, measured, rows, rng)
    if validation.judged_by != "fresh":
        drawn = drawn + _errors_of_noise(identification, noise, rows, rng)
    lengths = np.linalg.norm(drawn * scale, axis=2)[seen]  # (points, draws)
    p95 = np.percentile(lengths, SHARE, axis=0)
    return prediction_check(
        float(np.percentile(after[seen], SHARE)),
        float(np.median(p95)),
        float(np.quantile(p95, 1 - PREDICTION_EXCEEDED)),
        extrapolated,
    )


def _measured_region(measured: MeasuredRange | None, rows: Measurements) -> NDArray[np.int_] | None:
    """Return the rows whose poses lie in the measured region; None where all are compared."""
    if measured is None or not measured.is_worse_beyond:
        return None
    inside = np.flatnonzero(~measured.outside(rows.joints))
    return inside if _LEAST_POSES <= len(inside) < len(rows) else None


def _errors_of_parameters(
    found: Identification, measured: MeasuredRange | None, rows: Measurements, rng: np.random.Generator
) -> Array:
    """``(n, k, 3, draws)`` errors (m) of predicted points."""
    inputs = rows.inputs(found.model.conditions)
    n, k = rows.points.shape[:2]
    if found.process is not None:
        root = covariance_root(found.process.covariance(inputs))
        return np.asarray((root @ rng.standard_normal((len(root), DRAWS))).reshape(n, k, 3, DRAWS))
    slopes = found.model.observe(inputs, found.values)[1][..., list(found.fit.free)]
    drawn = slopes @ (covariance_root(found.covariance) @ rng.standard_normal((slopes.shape[-1], DRAWS)))
    if measured is not None and measured.is_worse_beyond:
        unknown = measured.unknown(found.model, inputs, found.values)
        drawn = drawn + unknown @ rng.standard_normal((unknown.shape[-1], DRAWS))
    return np.asarray(drawn)


def _errors_of_noise(found: Identification, noise: Noise, rows: Measurements, rng: np.random.Generator) -> Array:
    """``(n, k, 3, draws)`` errors (m) of the measured points."""
    observed, known = weigh(observation_of(found.model), rows, noise)
    drawn = np.zeros((*observed.points.shape, DRAWS))
    white = rng.standard_normal((3 * int(observed.seen.sum()), DRAWS))
    drawn[observed.seen] = observed.in_metres(white).reshape(-1, 3, DRAWS)
    if known:
        return drawn
    sigma = found.sigma_m if noise.shared is None else noise.shared.sigma_m
    return np.asarray(sigma * drawn)


def _scale(found: Identification, rng: np.random.Generator) -> Array:
    """Draw the true over the estimated standard deviation ``(draws,)``: one where it was given."""
    if found.sigma_given:
        return np.ones(DRAWS)
    dof = max(found.dof, 1)
    return np.asarray(np.sqrt(dof / np.maximum(rng.chisquare(dof, DRAWS), 1e-300)))
