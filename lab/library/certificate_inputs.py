"""Collect the inputs of the uncertainty budget from a run: repeats, motions, validation, chance."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import Observations
from lab.calibration.observation import observation_of
from lab.calibration.row_groups import cv_groups_of, folds, hold_out, hold_out_last
from lab.calibration.statistics.outliers import LEAST_SIGMA_M
from lab.calibration.weights import Noise, root_mean_square_sigma, weigh
from lab.certification.budget import (
    FrameMotion,
    InputQuantity,
    Placement,
    Propagation,
    RandomErrors,
    RandomScatter,
    RangeUncertainty,
)
from lab.certification.characteristics import Repeats
from lab.certification.lack_of_fit import ValidationErrors
from lab.core.errors import LabError
from lab.core.linear_model import covariance_root, p_value_of_squares
from lab.core.measurements import Measurements, thinned
from lab.core.se3 import Array
from lab.core.significance import VERDICT_LACK_OF_FIT
from lab.core.units import MM
from lab.core.whole_folder import CHECKSUMS, file_digest
from lab.formats.measurement_csv import read_measurements
from lab.kinematics.effects.effect import HOUR_S
from lab.kinematics.effects.range_errors import CONSTANT, SCALE
from lab.library.load_run import MEASUREMENTS_FILE, CalibrationRun
from lab.noise.instruments import Instrument
from lab.options.measured_campaign import MeasuredCampaign
from lab.prediction.estimate import Estimate, EstimatedParameter
from lab.prediction.estimate_files import COVARIANCE_FILE, PARAMETERS_FILE, RESULT_FILE
from lab.prediction.validation import shared_rows

__all__ = [
    "FittedRows", "digests_of", "fitted_motions", "fitted_rows", "instrument_noise_m", "motions_found", "random_errors",
    "validation_errors", "without_range",
]  # fmt: skip

_NOWHERE = (
    "determine the robot's base, so no position can be certified: measure points with a tracker, identify these, and "
    "certify that run"
)
_UNCERTIFIED = {
    "pose": (
        "the budget has no terms for measured orientations; identify the file again without this option, by its "
        "points, and certify that run"
    ),
    "cable": f"lengths of a cable do not {_NOWHERE}",
    "socket": f"contacts with sockets do not {_NOWHERE}",
    "plane": f"contacts with planes do not {_NOWHERE}",
    "cube": f"contacts with a cube do not {_NOWHERE}",
    "sphere-plate": f"contacts with a plate of spheres do not {_NOWHERE}",
    "ball-bar": f"poses of a ball bar do not {_NOWHERE}",
    "dial": f"readings of indicators do not {_NOWHERE}",
}  # why a run that observed this has no certificate, and what to do


_SIGNED = (MEASUREMENTS_FILE, PARAMETERS_FILE, COVARIANCE_FILE, RESULT_FILE)  # what a certificate's numbers come from


def digests_of(folder: Path) -> dict[str, str]:
    """Return the SHA-256, by file, of what the certificate of a run comes from, and of its list of checksums.

    That list has a line for every other file of the run.
    """
    return {name: file_digest(folder / name) for name in (*_SIGNED, CHECKSUMS) if (folder / name).is_file()}


@dataclass(frozen=True)
class FittedRows:
    """Rows that a run was fitted to, and rows that it held out for validation."""

    rows: Measurements  # the fitted rows
    judged: Measurements | None  # rows of the same file that were held out; None where there are none
    observed: Observations  # the fitted rows, weighted as in the run
    sigma_m: float  # noise of one coordinate, by which they are weighted
    instrument: Instrument | None  # the source of that noise; None where it was given as a number, or estimated
    validated: Measurements | None = None  # rows of the validation file that the run used; None where there was none

    def unfitted(self, calibrated: CalibrationRun) -> Measurements | None:
        """Rows that test the calibrated model as it stands: held out, or of a validation file; None without any.

        A file does not where base or tool were placed anew for it, or where it shares rows with the fit or lacks a
        target.
        """
        options, found = calibrated.options, self.validated
        if self.judged is not None or found is None or not isinstance(options, MeasuredCampaign):
            return self.judged
        lacks = set(calibrated.estimate.arm.targets) - set(found.targets)
        return None if options.refit or lacks or shared_rows(found, self.rows) else found

    @property
    def sets(self) -> dict[str, Measurements]:
        """Rows in which a pose may be repeated, by their use."""
        found = {"fitted rows": self.rows, "rows held out": self.judged, "validation file": self.validated}
        return {name: rows for name, rows in found.items() if rows is not None}


def fitted_rows(calibrated: CalibrationRun) -> FittedRows:
    """Read the rows of a run, fitted and held out.

    Raises:
        LabError: the run observed something else than points, or its measurements cannot be read.
    """
    if (kind := calibrated.options.observe) != "points":
        why = _UNCERTIFIED.get(kind, "a certificate needs measured positions; identify points")
        raise LabError(f"{calibrated.folder}: identified with --observe {kind}: {why}")
    rows, judged = _split(calibrated)
    device = calibrated.instrument
    noise = _noise(calibrated, device)
    observation = observation_of(calibrated.estimate.arm)
    observed, _ = weigh(observation, rows, noise)
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
    read = read[read.seen.any(axis=1) & ~np.isin(read.use, ("reference", "skip"))]
    return read if len(read) else None


def _split(calibrated: CalibrationRun) -> tuple[Measurements, Measurements | None]:
    chain, result = calibrated.robot.chain, calibrated.result
    path = calibrated.folder / MEASUREMENTS_FILE
    read = read_measurements(path, chain.joint_names, chain.prismatic)
    if unknown := [name for name in calibrated.estimate.arm.targets if name not in read.targets]:
        raise LabError(f"{path}: has no target {unknown[0]}, which the run identified; make the run again")
    read = read.with_points()
    rows, judged = _held_out(calibrated, read)
    if result.outliers_left_out:
        rows = rows.without([each.id for each in result.outliers if not each.held_out])
    if not len(rows):
        raise LabError(f"{path}: has no row that was fitted; make the run again")
    return rows, judged if len(judged) else None


def _held_out(calibrated: CalibrationRun, read: Measurements) -> tuple[Measurements, Measurements]:
    """Return the rows to fit and those to judge by, as the run's options divide them."""
    rows, judged = read.only("calibrate"), read.only("test")
    if isinstance(options := calibrated.options, MeasuredCampaign):
        if options.holdout is not None:
            rows, judged = hold_out(calibrated.estimate.arm, rows, options.holdout, options.seed)
        if options.holdout_last is not None:
            rows, judged = hold_out_last(calibrated.estimate.arm, rows, options.holdout_last)
    return rows, judged


def _noise(calibrated: CalibrationRun, device: Instrument | None) -> Noise:
    shared = calibrated.estimate.shared
    if (given := calibrated.options.noise_mm) is not None:
        return Noise(sigma_m=MM.to_si(given), shared=shared)
    if device is not None:
        return Noise(device, readings=calibrated.readings, shared=shared)
    estimated = max(calibrated.estimate.noise_m, LEAST_SIGMA_M)
    return Noise(sigma_m=estimated, shared=None if shared is None else replace(shared, independent_share=1.0))


_AXES = ("x", "y", "z", "rx", "ry", "rz", "scale")


def fitted_motions(calibrated: CalibrationRun, rows: Measurements, positions: Array) -> Iterator[FrameMotion]:
    """The displacement of positions ``(w, 3)`` m from the start of the campaign to its end, and to each session.

    The model takes the motion out of the fit; on another day the frame's pose is unknown.
    """
    if not calibrated.estimate.left_out:
        return
    parameters = calibrated.estimate.params
    source = "fitted with the parameters; a calibrated position is that at the start"
    if "drift" in calibrated.estimate.left_out and (offset := _size(parameters, "drift", positions) * _spans(rows)):
        yield FrameMotion("drift of base or instrument to the campaign's end", source, offset)
    sessions = dict.fromkeys(rows.sessions) if "sessions" in calibrated.estimate.left_out else ()
    sizes = {name: _size(parameters, f"session.{name}", positions) for name in sessions}
    if sizes and (offset := max(sizes.values())):
        name = max(sizes, key=sizes.__getitem__)
        yield FrameMotion(f"base or instrument moved to session {name}", source, offset)


def _spans(rows: Measurements) -> float:
    """Return the length of a drift in units of its rate: hours where the rows are timed, else one campaign."""
    times = rows.conditions.get("time_s")
    finite = None if times is None else times[np.isfinite(times)]
    return 1.0 if finite is None or not finite.size else float(np.ptp(finite)) / HOUR_S


def _size(parameters: Mapping[str, EstimatedParameter], group: str, positions: Array) -> float:
    """The root mean square displacement (m) of positions by a frame's motion."""
    names = [f"{group}.{axis}" for axis in _AXES]
    shift, turn, scale = np.split(
        np.array([parameters[name].exported if name in parameters else 0.0 for name in names]), (3, 6)
    )
    moved = shift + np.cross(turn, positions) + scale * positions
    return float(np.sqrt((moved**2).sum(axis=1).mean()))


_SHOWN = ("parameters", "repeatability", "model", "stability")  # what the same instrument shows on other poses
_MOST_ROWS = 400  # whose errors are held with all that they share
_MOST_LEVERAGE = 0.95  # of a held-out number: beyond, its error is all prediction


def validation_errors(
    calibrated: CalibrationRun,
    fitted: FittedRows,
    propagation: Propagation,
    quantities: Sequence[InputQuantity],
    chance: RandomErrors,
    instrument_m: float,
) -> ValidationErrors | None:
    """The errors of a run's validation, and what the budget makes of them; None where the run was not validated.

    The instrument's systematic errors and the temperatures displace fitted and validated points alike, and are not
    counted here.

    Args:
        quantities: of the budget.
        instrument_m: noise of one coordinate of a measured point, beside what the budget has of the robot.
    """
    after = calibrated.result.after_mm
    if after is None or not after["count"]:
        return None
    shown = [quantity for quantity in quantities if quantity.group in _SHOWN or quantity.placed]
    if calibrated.result.judged_by == "cross-validation":
        poses, own, shared = _by_folds(calibrated, fitted, shown, instrument_m)
    elif (rows := _validating_rows(calibrated, fitted)) is None:  # exact points of a virtual robot
        used = [quantity for quantity in shown if quantity.group != "repeatability" or quantity.shifts is not None]
        own, shared = _of_quantities(used, propagation.slopes, 0.0)
        poses = int(after["count"])
    else:
        some = thinned(rows, _MOST_ROWS)
        own, shared = _of_quantities(shown, _slopes(calibrated, some), instrument_m)
        if _places_anew(calibrated):
            shared = _placed_anew(calibrated, some, shared)
        poses = _distinct(calibrated, rows)
    rms_m, p95_m = MM.to_si(after["rms"]), MM.to_si(after["p95"])
    return ValidationErrors(rms_m, p95_m, poses, own, shared, chance.noise.dof, chance.all_given)


def _validating_rows(calibrated: CalibrationRun, fitted: FittedRows) -> Measurements | None:
    """Return the rows that judged a run; None where exact points of a virtual robot did."""
    by = calibrated.result.judged_by
    return {"holdout": fitted.judged, "file": fitted.validated or fitted.rows}.get(by or "")


def _places_anew(calibrated: CalibrationRun) -> bool:
    """Decide whether base or tool were fitted anew to the file that judged a run."""
    options = calibrated.options
    of_file = calibrated.result.judged_by == "file"
    return of_file and isinstance(options, MeasuredCampaign) and bool(options.refit)


def _distinct(calibrated: CalibrationRun, rows: Measurements) -> int:
    return int(cv_groups_of(calibrated.estimate.arm, rows).max()) + 1


def _slopes(calibrated: CalibrationRun, rows: Measurements) -> Array:
    """``(points, 3, f)`` derivatives of the measured points of some rows by the identified parameters."""
    arm = calibrated.estimate.arm
    free = list(calibrated.estimate.free)
    _, slopes = arm.observe(rows.inputs(arm.conditions), calibrated.estimate.values)
    common = [name for name in arm.targets if name in rows.targets] or list(arm.targets[:1])
    picked = slopes[:, [arm.targets.index(name) for name in common]][..., free]
    if set(common) <= set(rows.targets):
        picked = picked[rows.seen[:, [rows.targets.index(name) for name in common]]]
    flat = picked.reshape(-1, 3, len(free))
    return np.asarray(flat[np.isfinite(flat).all(axis=(1, 2))])


def _of_quantities(shown: Sequence[InputQuantity], slopes: Array, instrument_m: float) -> tuple[Array, Array]:
    """Covariances ``(n, 3, 3)`` of what differs from point to point, and columns ``(n, 3, c)`` of what is shared."""
    own = np.broadcast_to(instrument_m**2 * np.eye(3), (len(slopes), 3, 3))
    shared: list[Array] = [np.zeros((len(slopes), 3, 0))]
    for each in shown:
        size = each.uncertainty.standard
        if each.shifts is None:
            own = own + size**2 * np.eye(3)
        else:
            shared.append(size * slopes @ each.shifts)
    return np.asarray(own), np.concatenate(shared, axis=2)


def _by_folds(
    calibrated: CalibrationRun, fitted: FittedRows, shown: Sequence[InputQuantity], instrument_m: float
) -> tuple[int, Array, Array]:
    """Predict errors by cross-validation: number of poses, own and shared errors.

    A fold's points are predicted without it. With the leverage H of its values among all fitted ones, the error
    of prediction and the noise have the covariance (I - H)^-1 together, in units of the noise.
    """
    rows, estimate = fitted.rows, calibrated.estimate.as_measured
    arm = estimate.arm
    labels = folds(cv_groups_of(arm, rows), calibrated.options.seed)
    free = list(estimate.free)
    _, slopes = observation_of(arm).model.observe(rows.inputs(arm.conditions), estimate.values)
    columns = [rows.targets.index(name) for name in arm.targets]
    of_noise = [each for each in shown if each.shifts is None]
    sigma = float(np.sqrt(instrument_m**2 + sum(each.uncertainty.standard**2 for each in of_noise)))
    blocks = list(_fold_blocks(calibrated, fitted.sigma_m, slopes[..., free], rows.seen[:, columns], labels))
    own = sigma**2 * np.concatenate(blocks)
    return _distinct(calibrated, rows), own, np.zeros((len(own), 3, 0))


def _fold_blocks(
    calibrated: CalibrationRun, sigma_m: float, slopes: Array, seen: NDArray[np.bool_], labels: NDArray[np.int_]
) -> Iterator[Array]:
    """Yield the blocks ``(points, 3, 3)`` of (I - H)^-1 of each fold."""
    root = covariance_root(calibrated.estimate.as_measured.free_covariance) / sigma_m
    for fold in np.unique(labels):
        here = np.flatnonzero(labels == fold)[:_MOST_ROWS]
        picked = slopes[here][seen[here]]
        flat = (picked @ root).reshape(-1, root.shape[1])
        leverage, axes = np.linalg.eigh(flat @ flat.T)
        leverage = np.clip(leverage, 0.0, _MOST_LEVERAGE)
        whole = ((axes / (1 - leverage)) @ axes.T).reshape(len(picked), 3, len(picked), 3)
        yield whole[np.arange(len(picked)), :, np.arange(len(picked))]


def _placed_anew(calibrated: CalibrationRun, rows: Measurements, shared: Array) -> Array:
    """Remove from shared errors what placing base or targets anew takes up, so that those of the links are left."""
    options = calibrated.options
    assert isinstance(options, MeasuredCampaign)
    free = [i for i, name in enumerate(calibrated.estimate.free_names) if name.split(".")[0] in options.refit]
    if not free:
        return shared
    placed = _slopes(calibrated, rows)[..., free].reshape(-1, len(free))
    flat = shared.reshape(len(placed), -1)
    return np.asarray((flat - placed @ np.linalg.lstsq(placed, flat, rcond=None)[0]).reshape(shared.shape))


_RANGE_ERRORS = (CONSTANT, SCALE)
_RP_OVER_SIGMA = float(np.sqrt(8 / np.pi) + 3 * np.sqrt(3 - 8 / np.pi))  # of the lengths of isotropic normal scatter
_BY_NOISE_MODEL = "by the run's noise model"


def random_errors(
    calibrated: CalibrationRun,
    fitted: FittedRows,
    device: Instrument | None,
    stated_mm: float | None,
    found: Repeats | None,
) -> RandomErrors:
    """Collect the random errors of a run.

    Args:
        device: the instrument; None if unknown.
        stated_mm: the robot's repeatability (RP), as its data sheet states it.
        found: repeatability estimated from repeated poses; None where none was repeated.
    """
    result, estimate = calibrated.result, calibrated.estimate
    instrument_m = instrument_noise_m(calibrated, fitted, device)
    discrepancy, larger, dof = estimate.discrepancy(instrument_m)
    if result.noise_model is not None and not estimate.noise_known:  # what is independent there is not all the noise
        discrepancy = float(np.sqrt(max(MM.to_si(result.noise_model.independent_mm) ** 2 - instrument_m**2, 0.0)))
    elif estimate.noise_known and not discrepancy and (excess := _excess(calibrated)) > 1:
        discrepancy, larger, dof = fitted.sigma_m * float(np.sqrt(excess - 1)), max(larger, excess), estimate.dof
    dof_or_inf = np.inf if dof is None else float(dof)
    scattered = result.noise_model is not None and result.noise_model.joint_scatter_mrad > 0
    repeatability = _repeatability(fitted, instrument_m, stated_mm, found, of_residuals=scattered)
    known_m = 0.0 if repeatability is None else repeatability.sigma_m
    left = float(np.sqrt(max(discrepancy**2 - known_m**2, 0.0)))
    autocorrelated_m = 0.0 if result.noise_model is None else MM.to_si(result.noise_model.wandering_mm)
    return RandomErrors(
        larger * without_range(estimate),
        RandomScatter(fitted.sigma_m * float(np.sqrt(larger)), dof_or_inf, _noise_source(calibrated)),
        _placement(calibrated, fitted),
        repeatability,
        not estimate.noise_known or larger > 1 or estimate.shared is not None,
        RandomScatter(left, dof_or_inf, _model_source(calibrated, device)) if left else None,
        RandomScatter(autocorrelated_m, np.inf, _BY_NOISE_MODEL) if autocorrelated_m else None,
        _of_range(estimate, larger),
    )


def without_range(estimate: Estimate) -> Array:
    """Return the covariance ``(f, f)`` of the identified parameters of the arm, less that by fitted range errors."""
    shifts = estimate.shifts_by_range
    return np.asarray(estimate.free_covariance - shifts @ shifts.T)


def _of_range(estimate: Estimate, larger: float) -> RangeUncertainty | None:
    """Return the range errors of a run that fitted both; None for another.

    Args:
        larger: factor of the covariance.
    """
    shifts, grown = estimate.shifts_by_range, float(np.sqrt(larger))
    if shifts.shape[1] != len(_RANGE_ERRORS):
        return None
    stds = [grown * (estimate.params[name].std or 0.0) for name in _RANGE_ERRORS]
    return RangeUncertainty((stds[0], stds[1]), grown * shifts, "fitted with the parameters")


def instrument_noise_m(calibrated: CalibrationRun, fitted: FittedRows, device: Instrument | None) -> float:
    """Estimate the noise of one measured coordinate that is the instrument's, not the robot's (m)."""
    return fitted.sigma_m if calibrated.estimate.noise_known else _device_sigma(device, fitted)


def motions_found(calibrated: CalibrationRun) -> Iterator[FrameMotion]:
    """Drift that the run found beside its model: how far the ends of the campaign are from its result."""
    found = calibrated.result.noise_model
    if found is not None and found.drift_mm:
        text = "drift of base or instrument to the campaign's end"
        yield FrameMotion(text, _BY_NOISE_MODEL, MM.to_si(found.drift_mm) * float(np.sqrt(3)))


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
) -> RandomScatter | None:
    """Return the repeatability by the run's noise model, by repeated poses, or as stated; None if there is none."""
    shared = fitted.observed.correlation
    if shared is not None and shared.scatter.size:
        source = f"scatter of the joints, {_BY_NOISE_MODEL}"
        return RandomScatter(_scatter_m(fitted), np.inf, source, of_residuals)
    if found is not None and (more := found.scatter_m**2 - instrument_m**2) > 0:
        dof = (more / found.scatter_m**2) ** 2 * found.dof
        return RandomScatter(float(np.sqrt(more)), dof, "repeated poses, less the instrument's noise")
    if stated_mm is not None:
        return RandomScatter(MM.to_si(stated_mm) / _RP_OVER_SIGMA, np.inf, _stated_source(stated_mm))
    return None


def _stated_source(stated_mm: float) -> str:
    """Name a stated repeatability, and how the standard deviation of a coordinate follows from it (ISO 9283, 7.2.2)."""
    return (
        f"stated RP of {stated_mm:g} mm; u = RP / {_RP_OVER_SIGMA:.2f}: RP is mean + 3 s of lengths, u of a coordinate"
    )


def _scatter_m(fitted: FittedRows) -> float:
    """Compute the root mean square (m) of the joint scatter in a measured coordinate.

    It is stored in units of the noise, which differ along the beam and across it.
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
        return "residuals; all of them, because the instrument's share is unknown"
    return "residuals beyond the instrument's noise"
