"""How a pose is measured: joint positions with columns of the station and of the payload, and derivatives there.

The inputs of a pose are its joint positions, for an instrument with several stations an indicator column (1 or 0) of
each station but the first, and, if payloads are given, a column of the payload (kg).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.calibration.guess import STATION_POINTS
from lab.core.linear_model import whitening
from lab.core.se3 import Array
from lab.kinematics.effects.arm_with_effects import Arm
from lab.kinematics.effects.effect import PAYLOAD
from lab.noise.instruments import Instrument, is_isotropic
from lab.options.virtual_campaign import DesignOptions
from lab.pose_selection.exchange import Feasible
from lab.simulation.candidate_poses import feasibility, refuse_idle_stations, seeing_station
from lab.simulation.robot_model import RobotModel

__all__ = ["PointDerivatives", "carrying", "feasible_inputs", "inputs_of", "station_of", "with_stations"]


@dataclass(frozen=True)
class PointDerivatives:
    """Compute derivatives ``(n, r, f)`` of measured points by the base set, at inputs ``(n, joints + conditions)``.

    Attributes:
        seen: the arm with the effects of the stations and of the model.
        values: ``(p,)`` its parameters.
        retained: f of them, the base set.
        device: of the noise units of ``whitened``.
        payloads: kg, of which the last column of the inputs is one; without them there is no such column.
    """

    seen: Arm
    values: Array
    retained: tuple[int, ...]
    device: Instrument
    payloads: tuple[float, ...] = ()

    def unweighted(self, inputs: Array) -> Array:
        """Return derivatives in m; zeros for an impossible pose."""
        return self._flat(self._observed(inputs)[1])

    def whitened(self, inputs: Array) -> Array:
        """Return derivatives in standard deviations of the device's noise."""
        points, jacobian = self._observed(inputs)
        if not is_isotropic(self.device):
            return self._flat(whitening(self.device.covariance(points)) @ jacobian)
        everywhere = whitening(self.device.covariance(np.ones(3)))
        return self._flat(np.multiply(jacobian, everywhere[0, 0], order="C"))  # contiguous numbers of a pose

    def _observed(self, inputs: Array) -> tuple[Array, Array]:
        points, jacobian = self.seen.observe(self._conditioned(inputs), self.values)
        return _finite(points), _finite(jacobian[..., list(self.retained)])

    def _conditioned(self, inputs: Array) -> Array:
        """Return the inputs with the columns of the arm's conditions.

        Differences move those columns too, which hold whole numbers, or payloads.
        """
        size = self.seen.rigid.chain.size
        further = inputs[:, size : inputs.shape[1] - bool(self.payloads)].round()
        if PAYLOAD not in self.seen.conditions:
            return np.append(inputs[:, :size], further, axis=1) if inputs.shape[1] > size else inputs
        masses = np.array(self.payloads or (0.0,))
        carried = inputs[:, -1] if self.payloads else np.zeros(len(inputs))
        nearest = masses[np.abs(carried[:, None] - masses).argmin(axis=1)]
        return np.column_stack([inputs[:, :size], further, nearest])

    def _flat(self, jacobian: Array) -> Array:
        flat: Array = jacobian.reshape(len(jacobian), 3 * len(self.seen.targets), len(self.retained))
        return flat


def carrying(inputs: Array, payloads: Array) -> Array:
    """Return inputs ``(m, c)`` with each payload ``(l,)``, as ``(l m, c + 1)``; as they are without any."""
    if not len(payloads):
        return inputs
    return np.concatenate([np.column_stack([inputs, np.full(len(inputs), mass)]) for mass in payloads])


def with_stations(options: DesignOptions, model: RobotModel, device: Instrument, joints: Array) -> Array:
    """Return inputs of candidates ``(m, joints)``, each with its best station."""
    if not model.stations:
        return joints
    stations = seeing_station(model, options.targets, device)(joints)
    refuse_idle_stations(model, stations, STATION_POINTS)
    return inputs_of(model, joints, stations)


def station_of(columns: Array) -> NDArray[np.int_]:
    """Return the station ``(n,)``, from 0, of indicator columns ``(n, stations - 1)`` of the further ones."""
    return np.asarray(columns.round() @ np.arange(1, columns.shape[1] + 1), dtype=np.int_)


def inputs_of(model: RobotModel, joints: Array, stations: NDArray[np.int_] | None = None) -> Array:
    """Return joint positions ``(n, joints)`` with indicator columns of the stations ``(n,)``; default is the first."""
    further = np.arange(1, len(model.station_sites))
    at = np.zeros(len(joints), dtype=np.int_) if stations is None else stations
    return np.concatenate([joints, at[:, None] == further], axis=1) if len(further) else joints


def feasible_inputs(model: RobotModel, targets: Sequence[str], device: Instrument) -> Feasible:
    """Return a test of inputs: feasible poses, every target visible to their station."""
    allowed = [feasibility(model, targets, device, station=k) for k in range(len(model.station_sites))]
    size = model.chain.size
    if len(allowed) == 1:
        return lambda inputs: allowed[0](inputs[:, :size])

    def feasible(inputs: Array) -> NDArray[np.bool_]:
        joints, fine = inputs[:, :size], np.zeros(len(inputs), dtype=np.bool_)
        at = station_of(inputs[:, size : size + len(allowed) - 1])
        for k, check in enumerate(allowed):
            fine[at == k] = check(joints[at == k])
        return fine

    return feasible


def _finite(numbers: Array) -> Array:
    return numbers if np.isfinite(numbers).all() else np.nan_to_num(numbers)
