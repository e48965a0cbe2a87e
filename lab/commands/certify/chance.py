"""What is by chance in a run's measurements and in its robot, from what the run and its certificate know."""

import numpy as np

from lab.certification.characteristics import PoseCharacteristics
from lab.certification.quantities import KnownSpread, Placement, RandomErrors
from lab.commands.calibrate.load_run import Calibrated
from lab.commands.certify.fitted import FittedRows
from lab.core.instruments import Instrument

__all__ = ["random_errors"]

_RP_OVER_SIGMA = float(np.sqrt(8 / np.pi) + 3 * np.sqrt(3 - 8 / np.pi))  # of the lengths of isotropic normal scatter


def random_errors(
    calibrated: Calibrated,
    fitted: FittedRows,
    device: Instrument | None,
    stated_mm: float | None,
    found: PoseCharacteristics,
) -> RandomErrors:
    """Of a run.

    Args:
        device: the instrument; None where it is not known.
        stated_mm: the robot's repeatability (RP), as its data sheet states it.
        found: what repeated poses say of it.
    """
    result = calibrated.result
    instrument_m = fitted.sigma_m if result.noise_known else _device_sigma(device, fitted)
    lacking, larger, dof = calibrated.lacking(instrument_m)
    freedom = np.inf if dof is None else float(dof)
    repeatability = _repeatability(fitted, instrument_m, stated_mm, found)
    known_m = 0.0 if repeatability is None else repeatability.sigma_m
    left = float(np.sqrt(max(lacking**2 - known_m**2, 0.0)))
    return RandomErrors(
        larger * calibrated.covariance,
        KnownSpread(fitted.sigma_m * float(np.sqrt(larger)), freedom, _noise_source(calibrated)),
        _placement(calibrated, fitted),
        repeatability,
        not result.noise_known or larger > 1 or calibrated.shared is not None,
        KnownSpread(left, freedom, _model_source(calibrated, device)) if left else None,
    )


def _device_sigma(device: Instrument | None, fitted: FittedRows) -> float:
    """The noise of one coordinate by the instrument; 0 where it is not known, so that all counts as the robot's."""
    if device is None:
        return 0.0
    points = fitted.rows.points
    covariance = device.covariance(points[np.isfinite(points).all(axis=2)])
    return float(np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean() / 3))


def _repeatability(
    fitted: FittedRows, instrument_m: float, stated_mm: float | None, found: PoseCharacteristics
) -> KnownSpread | None:
    """By the noise model of the run, by repeated poses, or as it is stated; None where nothing is known."""
    shared = fitted.observed.correlation
    if shared is not None and shared.scatter.size:
        return KnownSpread(_scatter_m(fitted), np.inf, "scatter of the joints, by the run's noise model")
    if found.scatter_m is not None and (more := found.scatter_m**2 - instrument_m**2) > 0:
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


def _placement(calibrated: Calibrated, fitted: FittedRows) -> Placement:
    if not calibrated.result.noise_known:
        return "in the residuals"
    device = fitted.instrument
    return "in the noise" if device is not None and device.errors.placement else "beside"


def _noise_source(calibrated: Calibrated) -> str:
    if not calibrated.result.noise_known:
        return "residuals of the fit"
    if calibrated.options.noise_mm is not None:
        return "noise given to the run"
    return f"noise of {calibrated.options.instrument}, given to the run"


def _model_source(calibrated: Calibrated, device: Instrument | None) -> str:
    if not calibrated.result.noise_known and device is None:
        return "residuals; how much of them is the instrument's is not known, so all count"
    return "residuals beyond the instrument's noise"
