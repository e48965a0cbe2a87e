"""How errors of what was measured come through a fit into positions of the workspace."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lab.calibration.gauss_newton import RANK_TOLERANCE, Observations
from lab.calibration.observation import Observation
from lab.core.linear_model import LinearModel
from lab.core.measurements import seen_mask
from lab.core.random import rng_for
from lab.core.se3 import Array

__all__ = ["Propagation"]

_POSES = 200


@dataclass(frozen=True)
class Propagation:
    """The linear map of a fit, from errors of measured points to errors of the calibrated positions.

    Attributes:
        observed: the points that were fitted, as they were weighed.
        gain: ``(f, r)`` from whitened rows to the identified parameters.
        positions: ``(w, 3)`` m of the first target at random poses of the workspace.
        slopes: ``(w, 3, f)`` of these positions by the identified parameters.
        moved: the same positions ``(w, 3)`` m by the full kinematics, with the identified parameters moved by ``(f,)``.
    """

    observed: Observations
    gain: Array
    positions: Array
    slopes: Array
    moved: Callable[[Array], Array]

    @classmethod
    def of(
        cls,
        observation: Observation,
        observed: Observations,
        values: Array,
        free: Sequence[int],
        prior_covariance: Array | None = None,
    ) -> "Propagation":
        """Of a fit, at the parameters ``(p,)`` that it found.

        Args:
            free: which of them were identified.
            prior_covariance: ``(f, f)`` of these, in units of the weights, where a prior took part in the fit.
        """
        model = observation.model
        _, slopes = model.observe(observed.inputs, values)
        columns = observed.apply(slopes[..., list(free)])
        if prior_covariance is None:
            solved = LinearModel.of(columns, RANK_TOLERANCE)
            gain = solved.back @ solved.basis.T
        else:
            gain = prior_covariance @ columns.T
        inputs = model.structure_joints(_POSES, rng_for(0, "structure"))
        points, there = model.observe(inputs, values)
        there, points = there[:, 0][..., list(free)], points[:, 0]
        kept = np.isfinite(there).all(axis=(1, 2)) & np.isfinite(points).all(axis=1)

        def moved(shift: Array) -> Array:
            shifted = values.copy()
            shifted[list(free)] += shift
            return model.points(inputs[kept], shifted)[:, 0]

        return cls(observed, gain, points[kept], there[kept], moved)

    def shifts_by(self, displacements: Array) -> Array:
        """Shifts ``(f, c)`` of the identified parameters where the measured points are off by ``(n, k, 3, c)`` m."""
        return np.asarray(self.gain @ self.observed.apply(displacements))

    def columns_of(self, shifts: Array) -> Array:
        """Columns ``(w, 3, c)`` m of shifts ``(f, c)`` of the identified parameters."""
        return np.asarray(self.slopes @ shifts)

    def covariance_of(self, independent: Array) -> Array:
        """Covariance ``(f, f)`` of the parameters by errors with ``(n, k, 3, 3)`` m^2, independent from point to point.

        What the errors of several points share is passed over in the weights: it changes little of these.
        """
        alone = replace(self.observed, correlation=None)
        least = 1e-12 * np.trace(independent, axis1=2, axis2=3).max()  # some are flat: across a beam
        roots = np.linalg.cholesky(independent + least * np.eye(3))
        whitened = alone.in_units_of_noise(roots)[seen_mask(alone.points)]  # (points, 3, 3)
        blocks = self.gain.reshape(len(self.gain), -1, 3).transpose(1, 0, 2) @ whitened
        return np.asarray(np.einsum("pfi,pgi->fg", blocks, blocks))
