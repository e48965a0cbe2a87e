"""What a calibration predicts over the whole workspace, and how far it moved the links from their nominal values.

Errors of the identified parameters are normal, with the covariance C that the fit gives: at a pose with derivatives J
the position error is normal with covariance J C J'. What the tolerances of manufacture alone would make of an arm that
was never calibrated is the same with their variances, after base and tool are fitted.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded at their first use, which not every process comes to

from lab.calibration.extrapolation import MeasuredRange, position_covariances
from lab.calibration.identify import Identification
from lab.calibration.observations.protocol import observation_of
from lab.calibration.prior import Tolerance, alias_matrix, standard_deviations
from lab.core.linear_model import matched_dof, p_value_of_squares
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.effects.stations import at_first_station
from lab.kinematics.gauge import BaseSet
from lab.kinematics.model import Model
from lab.kinematics.parameter import indices_of_groups

__all__ = [
    "MEAN_OF_RMS",
    "Distance",
    "WorkspacePrediction",
    "distances_from_nominal",
    "length_not_exceeded",
    "predict_over_workspace",
    "predicted_errors",
    "tolerance_rms",
]

MEAN_OF_RMS = float(np.sqrt(8 / (3 * np.pi)))  # of the lengths of isotropic normal errors (Maxwell)
_POSES = 200
_UNCOVERED = "extrapolated: not covered by measured poses"
_SHARE = 0.95


@dataclass(frozen=True)
class WorkspacePrediction:
    """Predicted position errors (m) over random poses of the workspace; NaN where they are not known.

    Attributes:
        rms_m: root mean square, by the parameters' covariance.
        mean_m, p95_m: the mean, and the length that 95 % of the errors do not exceed, over poses and over campaigns
            like this one; where the residuals are more than the noise, as large as they say.
        tolerance_rms_m: root mean square error of an arm within the tolerances that was never calibrated.
        beyond_share: the share of the poses that are beyond the measured joint positions, where the model is known to
            be worse than its covariance; zero where nothing says so.
        uncovered_share: the share of the poses that no measured pose is near, where the model is known to lack
            something; zero where nothing says so.
    """

    rms_m: float
    mean_m: float
    p95_m: float
    tolerance_rms_m: float
    beyond_share: float = 0.0
    uncovered_share: float = 0.0

    @property
    def coverage_words(self) -> str:
        """How much of the workspace is not where anything was measured, for the end of a sentence."""
        shares = (self.beyond_share, "beyond the measured joint positions"), (self.uncovered_share, _UNCOVERED)
        return "".join(f", {100 * share:.0f} % of it {words}" for share, words in shares if share > 0)


@dataclass(frozen=True)
class Distance:
    """How far a link's parameter is estimated from its nominal value.

    Attributes:
        name: of the parameter.
        size: the distance (m, or rad and then half a turn at most).
        sure: as much of it as is left when two standard deviations are taken off.
        tolerances: ``size`` in the standard deviations that the tolerances of all links give this parameter.
        sure_tolerances: ``sure`` in these.
        is_angle: whether it is in rad.
    """

    name: str
    size: float
    sure: float
    tolerances: float
    sure_tolerances: float
    is_angle: bool


def predict_over_workspace(
    identification: Identification,
    tolerance: Tolerance,
    *,
    lack_of_fit: bool = False,
    measured: MeasuredRange | None = None,
) -> WorkspacePrediction:
    """Predicted errors of the first target over the workspace.

    Args:
        tolerance: of manufacture.
        lack_of_fit: whether the residuals are more than the noise that was given.
        measured: the joint positions that were measured, and what the model may lack beyond them.
    """
    model, nothing = identification.model, float("nan")
    if not observation_of(model).positions:
        return WorkspacePrediction(nothing, nothing, nothing, nothing)
    inputs, jacobian = _target_jacobian(model, identification.values)
    placed = indices_of_groups(model.parameters, ("base", "tool"))
    of_tolerances = float(np.sqrt(np.mean(tolerance_rms(model, jacobian, tolerance, placed) ** 2)))
    squares = position_covariances(identification, measured, inputs)[:, 0]
    if not np.isfinite(squares).all():
        return WorkspacePrediction(nothing, nothing, nothing, of_tolerances)
    beyond = uncovered = 0.0
    if measured is not None and (measured.is_worse_beyond or identification.process is not None):
        joints = inputs[:, : len(measured.lower)]
        beyond = float((measured.beyond(joints) > 0).any(axis=1).mean())
        uncovered = float(measured.uncovered(joints).mean())
    rms = float(np.sqrt(np.trace(squares, axis1=1, axis2=2).mean()))
    known = identification.sigma_known and not lack_of_fit
    dof = None if known else max(identification.dof, 1)
    larger = 1.0
    if lack_of_fit and identification.sigma_known and identification.dof_each is None:  # the poses' own say it already
        larger = max(identification.residual_sigma_m / identification.sigma_m, 1.0)
    mean, most = MEAN_OF_RMS * rms, length_not_exceeded(squares, dof)
    return WorkspacePrediction(rms, larger * mean, larger * most, of_tolerances, beyond, uncovered)


def predicted_errors(
    identification: Identification, measured: MeasuredRange | None = None
) -> tuple[Array, Array] | None:
    """Random poses of the workspace ``(n, joints + conditions)`` and the predicted RMS error ``(n,)`` (m) at each.

    It is that of the first target, by the parameters' covariance and what the model may lack beyond the measured joint
    positions. None where the covariance is not known, or no position is measured.
    """
    model = identification.model
    if not observation_of(model).positions:
        return None
    inputs, _ = _target_jacobian(model, identification.values)
    squares = np.trace(position_covariances(identification, measured, inputs)[:, 0], axis1=1, axis2=2)
    known = np.isfinite(squares)
    return (inputs[known], np.sqrt(np.maximum(squares[known], 0.0))) if known.any() else None


def tolerance_rms(model: Model, jacobian: Array, tolerance: Tolerance, placed: tuple[int, ...] = ()) -> Array:
    """Root mean square position error ``(n,)`` (m) of arms within the tolerances, at each pose.

    Args:
        jacobian: ``(n, 3, p)`` of positions.
        placed: columns that are fitted whatever the links are (base, tool); none where nothing is.
    """
    links = [i for i, each in enumerate(model.parameters) if each.is_link]
    rows = jacobian[..., links] * standard_deviations(model, tolerance)[links]
    if placed:
        columns, flat = jacobian[..., list(placed)].reshape(-1, len(placed)), rows.reshape(-1, len(links))
        rows = (flat - columns @ np.linalg.lstsq(columns, flat, rcond=None)[0]).reshape(rows.shape)
    return np.asarray(np.sqrt((rows**2).sum(axis=(1, 2))))


def distances_from_nominal(identification: Identification, tolerance: Tolerance) -> tuple[Distance, ...]:
    """The identified link parameters, farthest from nominal first, counted in tolerances.

    An error of a link that is fixed goes into those that it is aliased with, so their tolerances are wider.
    """
    model, structure = identification.model, identification.base_set
    free, std = list(identification.fit.free), identification.std
    spread = _spread_of_kept(model, structure, tolerance)
    found = []
    for i, deviation in zip(free, np.nan_to_num(std), strict=True):
        parameter = model.parameters[i]
        if not parameter.is_link:
            continue
        size = float(identification.values[i] - identification.nominal_aligned[i])
        if parameter.is_angle:
            size = float(np.remainder(size + np.pi, 2 * np.pi) - np.pi)
        sure = max(abs(size) - 2 * float(deviation), 0.0)
        wide = spread[structure.kept.index(i)]
        found.append(Distance(parameter.name, abs(size), sure, abs(size) / wide, sure / wide, parameter.is_angle))
    return tuple(sorted(found, key=lambda each: -each.tolerances))


def _spread_of_kept(model: Model, structure: BaseSet, tolerance: Tolerance) -> Array:
    """One standard deviation ``(kept,)`` of what the tolerances of all parameters make of those that are identified."""
    sigma = standard_deviations(model, tolerance)
    drawn = np.isfinite(sigma)
    wide = alias_matrix(structure, len(model.names))[:, drawn] * sigma[drawn]
    return np.asarray(np.maximum(np.sqrt((wide**2).sum(axis=1)), np.finfo(float).tiny))


def _target_jacobian(model: Model, values: Array) -> tuple[Array, Array]:
    """Random poses of the workspace, and derivatives ``(n, 3, p)`` of the first target's positions there."""
    inputs = at_first_station(model.conditions, model.structure_joints(_POSES, rng_for(0, "structure")))
    jacobian: Array = model.observe(inputs, values)[1][:, 0]
    reached = np.isfinite(jacobian).all(axis=(1, 2))
    return inputs[reached], jacobian[reached]


def length_not_exceeded(squares: Array, dof: float | None, share: float = _SHARE) -> float:
    """The length that 95 % of normal errors with these covariances ``(n, d, d)``, taken together, do not exceed.

    Or another ``share`` of them. A sum of squares of correlated normal numbers is taken for a scaled chi squared
    (Satterthwaite 1946), an F where the variance was estimated with ``dof`` degrees of freedom.
    """
    mean = np.trace(squares, axis1=1, axis2=2)
    if not mean.max() > 0:
        return 0.0
    mean = np.maximum(mean, 1e-12 * mean.max())
    numbers = matched_dof(mean, np.maximum(2 * (squares**2).sum(axis=(1, 2)), 1e-300))

    def exceeded(length: float) -> float:
        chances = p_value_of_squares(length**2 * np.ones_like(mean), numbers, dof, mean / numbers)
        return float(chances.mean()) - (1 - share)

    high = float(np.sqrt(mean.max()))
    while exceeded(high) > 0:
        high *= 2
    return float(scipy.optimize.brentq(exceeded, 0.0, high, xtol=1e-6 * high))
