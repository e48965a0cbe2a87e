"""What is by chance in a run's measurements and in its robot, from what the run and its certificate know."""

from collections.abc import Iterator

import numpy as np

from lab.certification.characteristics import Repeats
from lab.certification.quantities import FrameMotion, KnownSpread, Placement, RandomErrors
from lab.commands.calibrate.load_run import CalibrationRun
from lab.commands.certify.fitted import FittedRows
from lab.core.linear_model import p_value_of_squares
from lab.core.significance import VERDICT_LACK_OF_FIT
from lab.noise.error_model import row_times
from lab.noise.instruments import Instrument

__all__ = ["instrument_noise_m", "motions_found", "random_errors"]

_RP_OVER_SIGMA = float(np.sqrt(8 / np.pi) + 3 * np.sqrt(3 - 8 / np.pi))  # of the lengths of isotropic normal scatter
_BY_NOISE_MODEL = "by the run's noise model"


def random_errors(
    calibrated: CalibrationRun,
    fitted: FittedRows,
    device: Instrument | None,
    stated_mm: float | None,
    found: Repeats | None,
) -> RandomErrors:
    """Of a run.

    Args:
        device: the instrument; None where it is not known.
        stated_mm: the robot's repeatability (RP), as its data sheet states it.
        found: what repeated poses say of it; None where none was repeated.
    """
    result, estimate = calibrated.result, calibrated.estimate
    instrument_m = instrument_noise_m(calibrated, fitted, device)
    lacking, larger, dof = estimate.discrepancy(instrument_m)
    if result.noise_model is not None and not estimate.noise_known:  # what is independent there is not all the noise
        lacking = float(np.sqrt(max((result.noise_model.independent_mm / 1e3) ** 2 - instrument_m**2, 0.0)))
    elif estimate.noise_known and not lacking and (excess := _excess(calibrated)) > 1:
        lacking, larger, dof = fitted.sigma_m * float(np.sqrt(excess - 1)), max(larger, excess), estimate.dof
    freedom = np.inf if dof is None else float(dof)
    scattered = result.noise_model is not None and result.noise_model.joint_scatter_mrad > 0
    repeatability = _repeatability(fitted, instrument_m, stated_mm, found, of_residuals=scattered)
    known_m = 0.0 if repeatability is None else repeatability.sigma_m
    left = float(np.sqrt(max(lacking**2 - known_m**2, 0.0)))
    wandering_m = 0.0 if result.noise_model is None else result.noise_model.wandering_mm / 1e3
    return RandomErrors(
        larger * estimate.free_covariance,
        KnownSpread(fitted.sigma_m * float(np.sqrt(larger)), freedom, _noise_source(calibrated)),
        _placement(calibrated, fitted),
        repeatability,
        not estimate.noise_known or larger > 1 or estimate.shared is not None,
        KnownSpread(left, freedom, _model_source(calibrated, device)) if left else None,
        KnownSpread(wandering_m, np.inf, _BY_NOISE_MODEL) if wandering_m else None,
    )


def instrument_noise_m(calibrated: CalibrationRun, fitted: FittedRows, device: Instrument | None) -> float:
    """Estimate the noise of one measured coordinate that is the instrument's, not the robot's (m)."""
    return fitted.sigma_m if calibrated.estimate.noise_known else _device_sigma(device, fitted)


def motions_found(calibrated: CalibrationRun, fitted: FittedRows) -> Iterator[FrameMotion]:
    """Steps and drift that the run found beside its model: how far the ends of the campaign are from its result."""
    found = calibrated.result.noise_model
    if found is None:
        return
    times = row_times(fitted.rows)
    order = [fitted.rows.ids[i] for i in np.argsort(times, kind="stable")]
    for move in found.moves:
        earlier = (order.index(move.before) + 1) / len(order) if move.before in order else 1.0
        offset = move.size_mm / 1e3 * max(earlier, 1 - earlier)
        words = f"base or instrument moved between poses {move.before} and {move.after}"
        yield FrameMotion(words, f"{_BY_NOISE_MODEL}, {move.size_mm:.2g} mm", offset)
    if found.drift_mm:
        words = "drift of base or instrument to the campaign's end"
        yield FrameMotion(words, _BY_NOISE_MODEL, found.drift_mm / 1e3 * float(np.sqrt(3)))


def _excess(calibrated: CalibrationRun) -> float:
    """The variance of the residuals over that of the noise that was given; 1 where chance explains it."""
    estimate = calibrated.estimate
    if estimate.shared is not None or not estimate.noise_m or not estimate.dof:
        return 1.0
    ratio = (estimate.residual_m / estimate.noise_m) ** 2
    p = float(p_value_of_squares(ratio * estimate.dof, estimate.dof))
    return ratio if p < VERDICT_LACK_OF_FIT else 1.0


def _device_sigma(device: Instrument | None, fitted: FittedRows) -> float:
    """The noise of one coordinate by the instrument; 0 where it is not known, so that all counts as the robot's."""
    if device is None:
        return 0.0
    points = fitted.rows.points
    covariance = device.covariance(points[np.isfinite(points).all(axis=2)])
    return float(np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean() / 3))


def _repeatability(
    fitted: FittedRows, instrument_m: float, stated_mm: float | None, found: Repeats | None, *, of_residuals: bool
) -> KnownSpread | None:
    """By the noise model of the run, by repeated poses, or as it is stated; None where nothing is known.

    Args:
        of_residuals: whether the run estimated the scatter of the joints; else their encoders' counts make it.
    """
    shared = fitted.observed.correlation
    if shared is not None and shared.scatter.size:
        source = f"scatter of the joints, {_BY_NOISE_MODEL}"
        return KnownSpread(_scatter_m(fitted), np.inf, source, of_residuals)
    if found is not None and (more := found.scatter_m**2 - instrument_m**2) > 0:
        freedom = (more / found.scatter_m**2) ** 2 * found.freedom
        return KnownSpread(float(np.sqrt(more)), freedom, "repeated poses, less the instrument's noise")
    if stated_mm is not None:
        return KnownSpread(stated_mm / 1e3 / _RP_OVER_SIGMA, np.inf, f"stated RP of {stated_mm:g} mm")
    return None


def _scatter_m(fitted: FittedRows) -> float:
    """What the scatter of the joints makes of a measured coordinate, root mean square, m.

    It is kept in units of the noise, which differ along the beam and across it.
    """
    observed, shared = fitted.observed, fitted.observed.correlation
    assert shared is not None
    moved = observed.in_units_of_points(shared.scatter.reshape(*observed.points.shape, -1))[observed.seen]
    return float(np.sqrt((moved**2).sum(axis=-1).mean()))


def _placement(calibrated: CalibrationRun, fitted: FittedRows) -> Placement:
    if not calibrated.estimate.noise_known:
        return "in the residuals"
    device = fitted.instrument
    return "in the noise" if device is not None and device.errors.placement else "beside"


def _noise_source(calibrated: CalibrationRun) -> str:
    if not calibrated.estimate.noise_known:
        return "residuals of the fit"
    if calibrated.options.noise_mm is not None:
        return "noise given to the run"
    return f"noise of {calibrated.options.instrument}, given to the run"


def _model_source(calibrated: CalibrationRun, device: Instrument | None) -> str:
    if not calibrated.estimate.noise_known and device is None:
        return "residuals; how much of them is the instrument's is not known, so all count"
    return "residuals beyond the instrument's noise"
