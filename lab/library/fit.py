"""Fit a robot to measurements in milliseconds, without judging the fit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lab.calibration.alike_campaigns import identify_alike
from lab.calibration.fit_options import FitOptions
from lab.calibration.fitter import Fitter
from lab.calibration.identification import Identification
from lab.calibration.most_likely import most_likely_parameters
from lab.calibration.observation import observation_of
from lab.calibration.sensor import ArmSensor
from lab.calibration.weights import Noise, weigh
from lab.core.errors import LabError, error_context
from lab.core.measurements import Measurements, without_copies
from lab.core.se3 import Array
from lab.core.values import Deferred
from lab.library.measurement_checks import checked, robot_of
from lab.options.call_options import options_of, takes
from lab.options.measured_campaign import MeasuredCampaign
from lab.options.named_instruments import noise_of
from lab.prediction.estimate import Estimate
from lab.prediction.estimate_of_fit import estimate_of
from lab.prediction.extrapolation import MeasuredRange, measured_range
from lab.robots.robot import Robot
from lab.verdict.pipeline import start

__all__ = ["fit"]

_CALL = "lab.fit"
_JUDGING = ("cell", "holdout", "holdout_last", "validate", "refit", "gate_mm", "region", "require", "date", "serial")
_OF_FILES = ("no_recording", "load", "accept_edited", "error_terms", "seed")


@overload
def fit(
    measurements: Measurements, robot: str | Path | Robot | None = None, *, points: None = None, **options: Any
) -> Estimate: ...
@overload
def fit(
    measurements: Sequence[Measurements],
    robot: str | Path | Robot | None = None,
    *,
    points: None = None,
    **options: Any,
) -> tuple[Estimate, ...]: ...
@overload
def fit(
    measurements: Measurements, robot: str | Path | Robot | None = None, *, points: "ArrayLike", **options: Any
) -> tuple[Estimate, ...]: ...
@takes(MeasuredCampaign, unused=(*_JUDGING, *_OF_FILES), file="measurements")
def fit(
    measurements: Measurements | Sequence[Measurements],
    robot: str | Path | Robot | None = None,
    *,
    points: "ArrayLike | None" = None,
    **options: Any,
) -> Estimate | tuple[Estimate, ...]:
    """Fit the parameters of a robot to measurements, without validating or judging the fit: in milliseconds.

    ``lab.identify`` does more: it selects the model and the noise, finds outliers, tests the lack of fit, widens the
    covariance accordingly, validates and judges. Where it changes neither model nor noise, the values are the same.

    Args:
        measurements: in memory (joint positions in rad or m, points in m in any one frame), as ``lab.measurements``
            and ``lab.read_measurements`` make them; or those of several campaigns.
        robot: the nominal model: a name, a path, or a loaded robot, which is compiled once for all calls; by default
            the one that the measurements name.
        points: ``(campaigns, n, k, 3)`` points of several campaigns (m), measured at the poses of ``measurements``,
            whose own points they replace; NaN where a target was not seen. Those of a rigid serial arm are solved
            together where they have the same gaps; so are campaigns of a list at the same poses.
        options: those of ``lab identify``, by name: ``model``, ``instrument``, ``noise_mm``, ``prior``, ``fix``,
            ``free``, ``robust``, ``estimator``, ``observe`` and so on.

    Returns:
        The estimate: ``params`` and ``values``, their ``covariance`` (by the noise that is given, else by the
        residuals), the degrees of freedom ``dof``, and the ``checks`` of the fit. Of several campaigns one each. The
        most likely arm, and what is needed to predict beyond the measured range, are computed when they are first
        read.

    Raises:
        LabError: an option makes no sense, no robot is given or named, or the measurements are too few, of another
            robot, or in another unit; of several campaigns the message names the campaign.

    Example:
        >>> import lab
        >>> day = lab.simulate("irb120", poses=40, seed=7)
        >>> estimate = lab.fit(day.measurements, robot="irb120", instrument="uniform-8um")
        >>> len(estimate.identified), estimate.checks
        (27, ())
    """
    campaigns = _campaigns(measurements, points)
    loaded = robot_of(_CALL, campaigns[0], robot)
    requested = options_of(_CALL, MeasuredCampaign, {"file": _CALL, "robot": None, **options})
    requested.check()
    _refuse_selection(requested)
    sensor, options_si = requested.kind(), requested.fitting.to_si()
    noise = noise_of(requested, sensor)
    estimates = dict[int, Estimate]()
    for i, data in enumerate(campaigns):
        if i in estimates:
            continue
        several = f"campaign {i + 1} of {len(campaigns)}" if len(campaigns) > 1 else _CALL
        with error_context(several):
            campaign = _fitted(loaded, data, sensor, noise, options_si)
        estimates[i] = campaign.estimate(campaign.identification, campaign.rows.points)
        estimates |= campaign.alike({j: campaigns[j] for j in range(i + 1, len(campaigns)) if j not in estimates})
    ordered = tuple(estimates[i] for i in range(len(campaigns)))
    return ordered[0] if isinstance(measurements, Measurements) and points is None else ordered


def _campaigns(measurements: object, points: ArrayLike | None) -> Sequence[Measurements]:
    """Return the measurements of each campaign.

    Raises:
        LabError: they are nothing of the kind, or the points have another shape.
    """
    if isinstance(measurements, Measurements):
        if points is None:
            return [measurements]
        return _of_points(measurements, points)
    if points is not None:
        raise LabError(f"{_CALL}: points are of campaigns at the same poses; give one campaign's measurements beside")
    campaigns = list(measurements) if isinstance(measurements, Sequence) and not isinstance(measurements, str) else []
    if not campaigns or (others := [each for each in campaigns if not isinstance(each, Measurements)]):
        kind = type(others[0] if campaigns else measurements).__name__
        raise LabError(
            f"{_CALL}: measurements are {f'a list with {kind}' if campaigns else kind}; give lab.measurements(joints, "
            "points, robot=...), lab.read_measurements(file), or a list of these"
        )
    return campaigns


def _of_points(measurements: Measurements, points: ArrayLike) -> Sequence[Measurements]:
    """Return the measurements with each campaign's points."""
    of_campaigns = np.asarray(points, dtype=np.float64)
    if of_campaigns.ndim != 4 or of_campaigns.shape[1:] != measurements.points.shape or not len(of_campaigns):
        shape = ", ".join(map(str, measurements.points.shape))
        raise LabError(f"{_CALL}: points have shape {of_campaigns.shape}; give (campaigns, {shape})")
    return [replace(measurements, points=each) for each in of_campaigns]


def _refuse_selection(options: MeasuredCampaign) -> None:
    """Refuse models that tests choose or that are no parameters: they belong to an identification."""
    fitting = options.fitting
    if fitting.searched or fitting.residual:
        name = "auto" if fitting.searched else "residual"
        raise LabError(f"{_CALL}: model {name} is found by tests; name the groups, or call lab.identify")


@dataclass(frozen=True)
class _FittedCampaign:
    """One campaign that was fitted.

    Attributes:
        data: the measurements as they were given.
        groups: effects of the model.
        rows: those that were fitted.
    """

    data: Measurements
    fitter: Fitter
    groups: tuple[str, ...]
    identification: Identification
    rows: Measurements

    def estimate(self, found: Identification, points: Array) -> Estimate:
        """Make the estimate of a campaign with these rows, from its points ``(n, k, 3)``.

        What needs more than the fit is left until it is read.
        """
        fitter = self.fitter
        exported = partial(most_likely_parameters, found, fitter.nominal(found.model), fitter.options.tolerance)
        measured = Deferred(partial(_measured_range, fitter, found, self.rows, points))
        return estimate_of(found, exported, fitter.robot, self.groups, adequate=None, measured=measured)

    def alike(self, campaigns: Mapping[int, Measurements]) -> dict[int, Estimate]:
        """Fit those of other campaigns that differ in nothing but their points, together, as far as that is the same.

        Args:
            campaigns: by their numbers.
        """
        fitter = self.fitter
        row = np.flatnonzero((np.array(self.data.use) == "calibrate") & self.data.seen.any(axis=1))
        if not campaigns or not self._may_be_joined(row):
            return {}
        same = {i: other for i, other in campaigns.items() if self._has_same_rows(other)}
        if not same:
            return {}
        points = np.array([other.points[row] for other in same.values()])
        model, options = fitter.modelled(self.groups, ())
        nominal = fitter.nominal(model)
        identified = identify_alike(self.identification, self.rows, points, nominal, fitter.noise, options)
        return {
            i: self.estimate(one, own) for i, one, own in zip(same, identified, points, strict=True) if one is not None
        }

    def _has_same_rows(self, other: Measurements) -> bool:
        """Check whether measurements differ in the values of their points alone, and in no gap."""
        if other.points.shape != self.data.points.shape or not np.array_equal(other.seen, self.data.seen):
            return False
        return replace(other, points=self.data.points) == self.data

    def _may_be_joined(self, row: NDArray[np.int_]) -> bool:
        """Check whether rows are fitted as they are: measured points, none left out as an outlier or a copy."""
        plain = self.fitter.kind.name == "points" and not self.fitter.options.robust
        fitted = len(self.rows) == len(row) and np.array_equal(self.rows.points, self.data.points[row], equal_nan=True)
        return plain and fitted and len(np.unique(self.data.joints[row], axis=0)) == len(row)


def _fitted(robot: Robot, data: Measurements, sensor: ArmSensor, noise: Noise, options: FitOptions) -> _FittedCampaign:
    """Fit one campaign."""
    # take the rows as an identification does
    positions, given = sensor.in_instrument_frame, data
    data = checked("measurements in memory", data, robot, points=False)
    robot.refuse_impossible(Path(_CALL), data[data.used])
    data = without_copies(Path(_CALL), data) if positions else data
    # fit; points in another unit are looked for where they may be
    try:
        state = start(robot, data, sensor, noise, options)
        fitter = state.fitter
        groups = fitter.approached(options.groups)
        identification, rows, _ = fitter.identified(state.given, groups)
    except LabError:
        checked("measurements in memory", data, robot, points=positions)
        raise
    if not identification.plausible:
        checked("measurements in memory", data, robot, points=positions)
    return _FittedCampaign(given, fitter, groups, identification, rows)


def _measured_range(fitter: Fitter, found: Identification, rows: Measurements, points: Array) -> MeasuredRange | None:
    observations = weigh(observation_of(found.model), replace(rows, points=points), fitter.noise)[0]
    return measured_range(found, observations, fitter.robot.chain.prismatic)
