"""Predict points by an estimate, with the covariance of each one's error by its cause."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.core.se3 import Array
from lab.kinematics.dynamics.rigid_body import sag_uncertainty
from lab.kinematics.effects.effect import PAYLOAD
from lab.kinematics.serial.serial_arm import SerialArm
from lab.prediction.workspace_prediction import PredictedErrors

if TYPE_CHECKING:
    from lab.prediction.estimate import Estimate

__all__ = ["PredictedPoints", "load_errors", "predicted_points"]

_BLOCK = 2_000  # poses whose derivatives are held at a time


@dataclass(frozen=True)
class PredictedPoints:
    """Predicted points with the covariances ``(n, k, 3, 3)`` (m^2) of their errors; a new instrument's noise apart.

    Attributes:
        points: ``(n, k, 3)`` m in the frame of the measurements; NaN where the loops of a mechanism do not close.
        identified: covariances by the identified parameters, and by the joints' offsets that no group explains.
        load: covariances by an identified load.
        discrepancy: covariances by what the model lacks within the measured range.
        extrapolation: covariances by what it may lack beyond.
        visit: covariances of what differs from one visit of a pose to the next.
        dof: degrees of freedom of the size of the others; None where it is known.
    """

    points: Array
    identified: Array
    load: Array
    discrepancy: Array
    extrapolation: Array
    visit: Array
    dof: int | None

    @property
    def parameters(self) -> Array:
        """Covariances by everything that was identified."""
        return np.asarray(self.identified + self.load)

    @property
    def unmodelled(self) -> Array:
        """Covariances by model discrepancy, within the measured range and beyond."""
        return np.asarray(self.extrapolation + self.discrepancy)

    @property
    def covariance(self) -> Array:
        """Covariances by all causes together."""
        return np.asarray(self.parameters + self.unmodelled + self.visit)

    def radii_95(self) -> dict[str, Array]:
        """Return the lengths ``(n, k)`` (m) that 95 % of the errors do not exceed, by their cause and together."""
        parts = {"parameters": self.parameters, "unmodelled": self.unmodelled, "visit": self.visit}
        return {name: self._radius(part) for name, part in {**parts, "together": self.covariance}.items()}

    def _radius(self, covariances: Array) -> Array:
        there = np.trace(covariances, axis1=2, axis2=3) > 0
        safe = np.where(there[..., None, None], covariances, np.eye(3))
        return np.where(there | np.isnan(covariances[..., 0, 0]), PredictedErrors(safe, self.dof).lengths_95, 0.0)


def predicted_points(estimate: "Estimate", inputs: Array, targets: NDArray[np.int_] | None) -> PredictedPoints:
    """Return ``Estimate.predict`` at checked inputs, block by block."""
    blocks = [slice(first, first + _BLOCK) for first in range(0, max(len(inputs), 1), _BLOCK)]
    parts = [_predicted(estimate, inputs[rows], None if targets is None else targets[rows]) for rows in blocks]
    dof = None if estimate.process is not None else estimate.discrepancy().dof
    points, identified, load, discrepancy, extrapolation, visit = map(np.concatenate, zip(*parts, strict=True))
    return PredictedPoints(points, identified, load, discrepancy, extrapolation, visit, dof)


def _predicted(estimate: "Estimate", inputs: Array, targets: NDArray[np.int_] | None) -> tuple[Array, ...]:
    """Return points ``(n, k, 3)`` and their covariances ``(n, k, 3, 3)``, in the order of ``PredictedPoints``."""
    arm, values = estimate.arm, estimate.values

    def chosen(every: Array) -> Array:
        return every if targets is None else every[np.arange(len(every)), targets][:, None]

    points = chosen(arm.points(inputs, values))
    # of joint positions that differ from one visit to the next: S C_q S', with the slopes S by the joint positions
    slopes = chosen(by_joint_positions(arm, inputs, values, estimate.rigid.chain.size))
    if (by := estimate.predicted_by) is not None:
        # of the identified parameters and the joints' offsets together, which contain that of a visit
        scatter = min(by.process.factor, 1.0) * by.process.variances[1]
        visit = scatter * slopes @ np.swapaxes(slopes, 2, 3)
        whole = by.covariances(inputs)
        if targets is not None:  # a point that was not measured moves as the first one that was
            whole = whole[np.arange(len(whole)), np.where(targets < whole.shape[1], targets, 0)][:, None]
        identified, sigma_m = whole - visit, 0.0
    else:
        # of the identified parameters: J C J', larger where the residuals are more than noise
        sigma_m, inflation, _ = estimate.discrepancy()
        J = chosen(arm.observe(inputs, values)[1][..., list(estimate.free)])
        identified = inflation * J @ estimate.free_covariance @ np.swapaxes(J, 2, 3)
        visit = _visit_covariances(estimate, slopes)
    # of an identified load, alike in all directions
    load = chosen(load_errors(estimate, inputs, range(len(arm.targets))))[..., None, None] ** 2 / 3 * np.eye(3)
    # of what the model lacks, within the measured range and beyond
    discrepancy = np.broadcast_to(sigma_m**2 * np.eye(3), identified.shape)
    extrapolation = np.zeros_like(identified)
    if estimate.measured is not None:
        unknown = chosen(estimate.measured.unknown(arm, inputs, values))
        extrapolation = unknown @ np.swapaxes(unknown, 2, 3)
    return points, identified, load, discrepancy, extrapolation, visit


def _visit_covariances(estimate: "Estimate", slopes: Array) -> Array:
    """Return covariances ``(..., 3, 3)`` (m^2) of what differs from one visit of a pose to the next.

    They are those of errors beside the instrument's: the arm may have made them.

    Args:
        slopes: ``(..., 3, joints)`` derivatives of points by the joint positions.
    """
    if (shared := estimate.shared) is None:
        return np.zeros((*slopes.shape[:-1], 3))
    scattered = slopes @ shared.joint_covariance(slopes.shape[-1]) @ np.swapaxes(slopes, -1, -2)
    return np.asarray(scattered + shared.common_m2 * np.eye(3))


def load_errors(estimate: "Estimate", inputs: Array, targets: Sequence[int]) -> Array:
    """Return ``Estimate.load_errors``."""
    none = np.zeros((len(inputs), len(targets)))
    if estimate.load is None or estimate.loads is None or PAYLOAD not in estimate.arm.conditions:
        return none
    (arm, values), size = estimate.geometry, estimate.rigid.chain.size
    assert isinstance(arm, SerialArm)  # the conditions are those of effects of gravity
    joints, gravity, covariance = inputs[:, :size], estimate.loads.gravity, estimate.load.covariance
    errors = [
        sag_uncertainty(arm, values, estimate.compliance, joints, gravity, covariance, target) for target in targets
    ]
    carried = inputs[:, size + estimate.arm.conditions.index(PAYLOAD)] > 0
    return np.asarray(np.where(carried[:, None], np.stack(errors, axis=1), none))
