"""Find the most likely arm among those that predict the same as the identified one.

The canonical gauge fixes some parameters at nominal, and errors of these go into others. Among all arms with the same
predictions, tolerances of manufacture make one most likely: its errors are spread over each aliased group by their
variances, whichever of the group is identified. That arm is exported.
"""

import numpy as np
from numpy.typing import NDArray

from lab.calibration.identification import Identification
from lab.calibration.prior import Tolerance, alias_matrix, standard_deviations
from lab.core.newton import least_squares_step, newton
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.gauge import STRUCTURE_POSES
from lab.kinematics.parameter import indices_of_groups

__all__ = ["SAME_M", "most_likely_parameters"]

_STEPS = 8
_SETTLED = 1e-13  # m or rad
_RANK_TOLERANCE = 1e-12  # of the largest singular value of unit columns
SAME_M = 1e-9  # what predictions may differ by
_ANYWHERE = 1e3  # standard deviation of parameters without a nominal value, m or rad


def most_likely_parameters(identification: Identification, nominal: Array, tolerance: Tolerance) -> Array:
    """Return the parameters ``(p,)`` of least prior-weighted norm with the predictions of the identified ones.

    They are x = x0 + S B' w, with S the prior's covariance and B the directions in which the nominal
    predictions change (``prior.alias_matrix``): w is found by Gauss-Newton on the predictions themselves,
    so that these are equal to rounding, not to first order. Parameters without a nominal value are free; effects stay
    as identified. With links fixed on request the identified parameters are returned, and so where the iteration does
    not settle, because the parameters are weakly observable.

    Args:
        nominal: the nominal parameters ``(p,)``.
    """
    model, structure = identification.model, identification.base_set
    links = list(indices_of_groups(model.parameters, ["link"]))
    if set(structure.fixed_observable) & set(links):
        return identification.values
    # the predictions to keep
    inputs = model.structure_joints(STRUCTURE_POSES, rng_for(0, "structure"))
    wanted = model.points(inputs, identification.values)
    answered = np.isfinite(wanted).all(axis=(1, 2))
    inputs, wanted = inputs[answered], wanted[answered]
    # the directions S B' in which they change, by the prior's covariance S
    sigma = standard_deviations(model, tolerance)
    sigma[[i for i in range(len(sigma)) if i not in links and np.isfinite(sigma[i])]] = 0.0
    sigma[np.isinf(sigma)] = _ANYWHERE
    directions = sigma[:, None] ** 2 * alias_matrix(structure, len(model.names)).T
    directions = directions[:, directions.any(axis=0)]
    directions /= np.linalg.norm(directions / np.where(sigma > 0, sigma, 1.0)[:, None], axis=0)
    # Gauss-Newton on the predictions, from the nominal links
    values = identification.values.copy()
    values[links] = nominal[links]

    def step(rows: Array, _: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        points, jacobian = model.observe(inputs, rows[0])
        if np.isnan(points).any():  # the loops of a mechanism do not close there
            return np.full_like(rows, np.nan), np.array([True])
        moves = jacobian.reshape(-1, len(values)) @ directions
        change = directions @ least_squares_step(moves, (wanted - points).ravel(), _RANK_TOLERANCE)
        return change[None], np.array([np.abs(change).max() < _SETTLED])

    values = newton(step, values[None], _STEPS).values[0]
    if np.isnan(values).any():
        return identification.values
    missed = np.abs(model.points(inputs, values) - wanted).max(initial=0.0)
    return values if missed < SAME_M else identification.values
