"""The errors that a run was validated by, with their covariance by the budget of its certificate."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from lab.calibration.observation import observation_of
from lab.calibration.validation import cv_groups_of, folds
from lab.certification.budget import InputQuantity
from lab.certification.lack_of_fit import ValidationErrors
from lab.certification.propagation import Propagation
from lab.certification.quantities import RandomErrors
from lab.commands.calibrate.load_run import Calibrated
from lab.commands.calibrate.options import MeasuredCampaign
from lab.commands.certify.fitted import FittedRows
from lab.core.covariance import covariance_root
from lab.core.measurements import Measurements, thinned
from lab.core.se3 import Array
from lab.noise.tracker_errors import PLACEMENT

__all__ = ["validation_errors"]

_SHOWN = ("parameters", "repeatability", "model", "stability")  # what the same instrument shows on other poses
_PLACED = tuple(term.words for term in PLACEMENT)  # another error in each pose, of the fitted ones and of others
_MOST_ROWS = 400  # whose errors are held with all that they share
_MOST_LEVERAGE = 0.95  # of a held-out number: beyond, its error is all prediction


def validation_errors(
    calibrated: Calibrated,
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
    found, by = calibrated.result.after_mm, calibrated.result.judged_by
    if found is None or not found["count"]:
        return None
    rms_m, p95_m = found["rms"] / 1e3, found["p95"] / 1e3
    shown = [each for each in quantities if each.group in _SHOWN or each.words in _PLACED]
    freedom, known = chance.noise.freedom, chance.known
    if by == "cross-validation":
        poses, own, shared = _by_folds(calibrated, fitted, shown, instrument_m)
        return ValidationErrors(rms_m, p95_m, poses, own, shared, freedom, known)
    rows = {"holdout": fitted.judged, "file": fitted.validated or fitted.rows}.get(by or "")
    if rows is None:  # exact points of a virtual robot
        kept = [each for each in shown if each.group != "repeatability" or each.shifts is not None]
        own, shared = _of_quantities(kept, propagation.slopes, 0.0)
        return ValidationErrors(rms_m, p95_m, int(found["count"]), own, shared, freedom, known)
    some = thinned(rows, _MOST_ROWS)
    own, shared = _of_quantities(shown, _slopes(calibrated, some), instrument_m)
    if by == "file" and isinstance(calibrated.options, MeasuredCampaign) and calibrated.options.refit:
        shared = _placed_anew(calibrated, some, shared)
    return ValidationErrors(rms_m, p95_m, _distinct(calibrated, rows), own, shared, freedom, known)


def _distinct(calibrated: Calibrated, rows: Measurements) -> int:
    """Count the poses of some rows."""
    return int(cv_groups_of(calibrated.arm, rows).max()) + 1


def _slopes(calibrated: Calibrated, rows: Measurements) -> Array:
    """``(points, 3, f)`` derivatives of the measured points of some rows by the identified parameters."""
    arm = calibrated.arm
    free = [arm.names.index(name) for name in calibrated.identified]
    _, slopes = arm.observe(rows.inputs(arm.conditions), calibrated.values)
    known = [name for name in arm.targets if name in rows.targets] or list(arm.targets[:1])
    picked = slopes[:, [arm.targets.index(name) for name in known]][..., free]
    if set(known) <= set(rows.targets):
        picked = picked[rows.seen[:, [rows.targets.index(name) for name in known]]]
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
    calibrated: Calibrated, fitted: FittedRows, shown: Sequence[InputQuantity], instrument_m: float
) -> tuple[int, Array, Array]:
    """The same of cross-validation: poses, own and shared.

    A fold's points are predicted without it. With the leverage H of its numbers among all that were fitted, the error
    of prediction and the noise have the covariance (I - H)^-1 together, in units of the noise.
    """
    rows = fitted.rows
    arm = calibrated.arm
    labels = folds(cv_groups_of(arm, rows), calibrated.options.seed)
    free = [arm.names.index(name) for name in calibrated.identified]
    _, slopes = observation_of(arm).model.observe(rows.inputs(arm.conditions), calibrated.values)
    columns = [rows.targets.index(name) for name in arm.targets]
    of_noise = [each for each in shown if each.shifts is None]
    sigma = float(np.sqrt(instrument_m**2 + sum(each.uncertainty.standard**2 for each in of_noise)))
    blocks = list(_fold_blocks(calibrated, fitted.sigma_m, slopes[..., free], rows.seen[:, columns], labels))
    own = sigma**2 * np.concatenate(blocks)
    return _distinct(calibrated, rows), own, np.zeros((len(own), 3, 0))


def _fold_blocks(
    calibrated: Calibrated, sigma_m: float, slopes: Array, seen: NDArray[np.bool_], labels: NDArray[np.int_]
) -> Iterator[Array]:
    """Yield the blocks ``(points, 3, 3)`` of (I - H)^-1 of each fold."""
    root = covariance_root(calibrated.covariance) / sigma_m
    for fold in np.unique(labels):
        here = np.flatnonzero(labels == fold)[:_MOST_ROWS]
        picked = slopes[here][seen[here]]
        flat = (picked @ root).reshape(-1, root.shape[1])
        leverage, axes = np.linalg.eigh(flat @ flat.T)
        leverage = np.clip(leverage, 0.0, _MOST_LEVERAGE)
        whole = ((axes / (1 - leverage)) @ axes.T).reshape(len(picked), 3, len(picked), 3)
        yield whole[np.arange(len(picked)), :, np.arange(len(picked))]


def _placed_anew(calibrated: Calibrated, rows: Measurements, shared: Array) -> Array:
    """Remove from shared errors what placing base or targets anew takes up, so that those of the links are left."""
    options = calibrated.options
    assert isinstance(options, MeasuredCampaign)
    free = [i for i, name in enumerate(calibrated.identified) if name.split(".")[0] in options.refit]
    if not free:
        return shared
    placed = _slopes(calibrated, rows)[..., free].reshape(-1, len(free))
    flat = shared.reshape(len(placed), -1)
    return np.asarray((flat - placed @ np.linalg.lstsq(placed, flat, rcond=None)[0]).reshape(shared.shape))
