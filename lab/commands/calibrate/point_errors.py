"""How sure the points of a calibrated arm are: covariances of their errors, by cause."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.calibration.workspace_prediction import PredictedErrors
from lab.commands.calibrate.load_run import Calibrated
from lab.core.se3 import Array
from lab.payload_identification.sag_uncertainty import sag_uncertainty

__all__ = ["PointErrors", "load_errors", "point_errors", "visit_covariances"]

_BLOCK = 2_000  # poses whose derivatives are held at a time


@dataclass(frozen=True)
class PointErrors:
    """Covariances ``(n, k, 3, 3)`` (m^2) of predicted points, in the frame of the measurements; a new instrument apart.

    Attributes:
        parameters: of the identified parameters, of the joints' offsets that no group explains, and of a payload.
        unmodelled: what the model lacks, where the run measured and beyond.
        visit: what differs from one visit of a pose to the next.
        dof: degrees of freedom of the size of the others; None where it is known.
    """

    parameters: Array
    unmodelled: Array
    visit: Array
    dof: int | None

    @property
    def together(self) -> Array:
        """Their sum."""
        return np.asarray(self.parameters + self.unmodelled + self.visit)

    def radii_95(self) -> dict[str, Array]:
        """``(n, k)`` the lengths (m) that 95 % of the errors do not exceed, by their cause and together."""
        parts = {"parameters": self.parameters, "unmodelled": self.unmodelled, "visit": self.visit}
        return {name: self._radius(part) for name, part in {**parts, "together": self.together}.items()}

    def _radius(self, covariances: Array) -> Array:
        there = np.trace(covariances, axis1=2, axis2=3) > 0
        safe = np.where(there[..., None, None], covariances, np.eye(3))
        return np.where(there | np.isnan(covariances[..., 0, 0]), PredictedErrors(safe, self.dof).lengths_95, 0.0)


def point_errors(run: Calibrated, inputs: Array) -> PointErrors:
    """The covariances of a run's points at inputs ``(n, joints + conditions)`` of its arm.

    They are those of ``lab compensate``'s predicted error, part by part.
    """
    blocks = (inputs[first : first + _BLOCK] for first in range(0, len(inputs), _BLOCK))
    parts = [tuple(_parts(run, each)) for each in blocks]
    parameters, unmodelled, visit = (np.concatenate(each) for each in zip(*parts, strict=True))
    dof = None if run.predicted_by is not None else run.lacking(_noise_m(run))[2]
    return PointErrors(parameters, unmodelled, visit, dof)


def _noise_m(run: Calibrated) -> float:
    return (run.result.noise_mm or 0.0) / 1e3


def _parts(run: Calibrated, inputs: Array) -> Iterator[Array]:
    """Of the parameters, unmodelled, of a visit: ``(n, k, 3, 3)`` each."""
    size, lacking = run.robot.chain.size, 0.0
    slopes = by_joint_positions(run.arm, inputs, run.values, size)
    if (by := run.predicted_by) is not None:
        scatter = min(by.process.factor, 1.0) * by.process.variances[1]  # which its predictions contain
        visit = scatter * slopes @ np.swapaxes(slopes, 2, 3)
        known = by.covariances(inputs) - visit
    else:
        lacking, larger, _ = run.lacking(_noise_m(run))
        columns = [run.arm.names.index(name) for name in run.identified]
        jacobian = run.arm.observe(inputs, run.values)[1][..., columns]
        known = larger * jacobian @ run.covariance @ np.swapaxes(jacobian, 2, 3)
        visit = visit_covariances(run, slopes)
    of_load = load_errors(run, inputs, range(len(run.arm.targets)))
    yield known + of_load[..., None, None] ** 2 / 3 * np.eye(3)
    beyond = np.zeros_like(known)
    if run.measured is not None:
        unknown = run.measured.unknown(run.arm, inputs, run.values)
        beyond = unknown @ np.swapaxes(unknown, 2, 3)
    yield beyond + lacking**2 * np.eye(3)
    yield visit


def visit_covariances(run: Calibrated, slopes: Array) -> Array:
    """Covariances ``(..., 3, 3)`` (m^2) that differ from one visit of a pose to the next, as the run found them.

    They are those of errors beside the instrument's: the arm may have made them.

    Args:
        slopes: ``(..., 3, joints)`` derivatives of points by the joint positions.
    """
    if (shared := run.shared) is None:
        return np.zeros((*slopes.shape[:-1], 3))
    scattered = slopes @ shared.joint_covariance(slopes.shape[-1]) @ np.swapaxes(slopes, -1, -2)
    return np.asarray(scattered + shared.common_m2 * np.eye(3))


def load_errors(run: Calibrated, inputs: Array, targets: Sequence[int]) -> Array:
    """Errors ``(n, k)`` (m, root mean square) that the uncertainty of an identified payload makes of some targets."""
    arm, values = run.geometry
    joints, none = inputs[:, : arm.chain.size], np.zeros((len(inputs), len(targets)))
    if run.load is None or run.robot.loads is None or "payload_kg" not in run.arm.conditions:
        return none
    serial, gravity = run.robot.serial_arm(arm.targets), run.robot.loads.gravity
    off = [
        sag_uncertainty(serial, values, run.compliance, joints, gravity, run.load.covariance, target)
        for target in targets
    ]
    carried = inputs[:, arm.chain.size + run.arm.conditions.index("payload_kg")] > 0
    return np.asarray(np.where(carried[:, None], np.stack(off, axis=1), none))
