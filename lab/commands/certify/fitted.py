"""The measurements that a run was fitted to, read back from its folder, and how they were weighed."""

from dataclasses import dataclass, replace

import numpy as np

from lab.calibration.gauss_newton import Observations
from lab.calibration.observation import observation_of
from lab.calibration.statistics.outliers import LEAST_SIGMA_M
from lab.calibration.validation import hold_out, hold_out_last
from lab.calibration.weights import Noise, root_mean_square_sigma, weighed
from lab.commands.calibrate.load_run import MEASUREMENTS_FILE, CalibrationRun
from lab.commands.calibrate.options import MeasuredCampaign
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.formats.measurement_csv import read_measurements
from lab.noise.instruments import Instrument

__all__ = ["FittedRows", "fitted_rows"]

_NOWHERE = (
    "say where the robot stands, so there is no position whose uncertainty could be certified: measure points with a "
    "tracker, identify these, and certify that run"
)
_UNCERTIFIED = {
    "pose": (
        "the budget has no terms for measured orientations; identify the file again without it, by its points, and "
        "certify that run"
    ),
    "cable": f"lengths of a cable do not {_NOWHERE}",
    "socket": f"contacts with sockets do not {_NOWHERE}",
    "plane": f"contacts with planes do not {_NOWHERE}",
}  # why a run that observed this has no certificate, and what to do


@dataclass(frozen=True)
class FittedRows:
    """What a run was fitted to, and what it kept to validate on.

    Attributes:
        rows: that were fitted.
        judged: rows of the same file that were not fitted; None where there are none.
        observed: the fitted rows, weighed as the run weighed them.
        sigma_m: the noise by which they are weighed, of one coordinate.
        instrument: whose noise that is; None where it was given as a number, or estimated.
        validated: rows of the validation file that the run kept; None where there was none.
    """

    rows: Measurements
    judged: Measurements | None
    observed: Observations
    sigma_m: float
    instrument: Instrument | None
    validated: Measurements | None = None

    @property
    def sets(self) -> dict[str, Measurements]:
        """All rows in which a pose may be repeated, by what they were used for."""
        found = {"fitted rows": self.rows, "rows held out": self.judged, "validation file": self.validated}
        return {name: rows for name, rows in found.items() if rows is not None}


def fitted_rows(calibrated: CalibrationRun) -> FittedRows:
    """Read them.

    Raises:
        LabError: the run observed something else than points, or its measurements cannot be read.
    """
    if (kind := calibrated.options.observe) != "points":
        why = _UNCERTIFIED.get(kind, "its measurements are no positions, of which a certificate tells the uncertainty")
        raise LabError(f"{calibrated.folder}: identified with --observe {kind}: {why}")
    rows, judged = _split(calibrated)
    device = calibrated.instrument
    noise = _noise(calibrated, device)
    observation = observation_of(calibrated.estimate.arm)
    observed, _ = weighed(observation, rows, noise)
    sigma = root_mean_square_sigma(observed, 0)
    validated = _validated(calibrated)
    return FittedRows(rows, judged, observed, sigma, None if noise.instrument is None else device, validated)


def _validated(calibrated: CalibrationRun) -> Measurements | None:
    """The rows of the validation file, less those that place base or tool anew; None without a file."""
    options, chain, inputs = calibrated.options, calibrated.robot.chain, calibrated.inputs
    if not isinstance(options, MeasuredCampaign) or options.validate is None or inputs is None:
        return None
    if (path := inputs.copy(options.validate)) is None:  # measurements in memory
        return None
    read = read_measurements(path, chain.joint_names, chain.prismatic)
    read = read.take(np.flatnonzero(read.seen.any(axis=1) & ~np.isin(read.use, ("reference", "skip"))))
    return read if len(read) else None


def _split(calibrated: CalibrationRun) -> tuple[Measurements, Measurements | None]:
    chain, result = calibrated.robot.chain, calibrated.result
    path = calibrated.folder / MEASUREMENTS_FILE
    read = read_measurements(path, chain.joint_names, chain.prismatic)
    if unknown := [name for name in calibrated.estimate.arm.targets if name not in read.targets]:
        raise LabError(f"{path}: has no target {unknown[0]}, which the run identified; make the run again")
    read = read.take(np.flatnonzero(read.seen.any(axis=1)))
    rows, judged = read.only("calibrate"), read.only("test")
    if isinstance(options := calibrated.options, MeasuredCampaign):
        if options.holdout is not None:
            rows, judged = hold_out(calibrated.estimate.arm, rows, options.holdout, options.seed)
        if options.holdout_last is not None:
            rows, judged = hold_out_last(calibrated.estimate.arm, rows, options.holdout_last)
    if result.outliers_left_out:
        rows = rows.without([each.id for each in result.outliers if not each.held_out])
    if not len(rows):
        raise LabError(f"{path}: has no row that was fitted; make the run again")
    return rows, judged if len(judged) else None


def _noise(calibrated: CalibrationRun, device: Instrument | None) -> Noise:
    """As the run weighed its rows."""
    shared = calibrated.estimate.shared
    if (given := calibrated.options.noise_mm) is not None:
        return Noise(sigma_m=given / 1e3, shared=shared)
    if device is not None:
        return Noise(device, readings=calibrated.readings, shared=shared)
    estimated = max(calibrated.estimate.noise_m, LEAST_SIGMA_M)
    return Noise(sigma_m=estimated, shared=None if shared is None else replace(shared, independent_share=1.0))
