"""The nearest load that a body can be: a positive definite pseudo-inertia, in the metric of the estimate's covariance.

A body has positive mass everywhere, which says that J = [[tr(I) / 2 1 - I, m c], [m c', m]] is positive definite
(Wensing, Kim & Slotine 2018). The set is convex, so that of all loads in it the one nearest to least squares', by the
weights of the data, is never farther from the truth by these weights. J is physical where it has a factor U U', U
upper triangular with a positive diagonal; a weak prior, -w log det J = -2 w sum log U_ii, keeps it off the boundary,
where a body is flat. Steps are taken in the load's own parameters, in which all of this is convex: in those of U it is
not.
"""

from dataclasses import replace

import numpy as np

from lab.core.errors import LabError
from lab.core.newton import least_squares_step
from lab.core.se3 import Array
from lab.kinematics.dynamics.rigid_body import LOAD, is_physical, pseudo_inertia
from lab.payload_identification.estimate import LoadEstimate

__all__ = ["nearest_physical", "physical_estimate"]

_PRIOR = 1e-4  # weight w: it moves the load by far less than a standard deviation
_FALL = 0.2  # of the weight, from one that outweighs the misfit at the start down to the prior's
_STEPS, _SETTLED = (
    60,
    1e-14,
)  # Newton's steps at each weight, and half its decrement squared, which says how far there is
_BASIS = np.array([pseudo_inertia(unit) for unit in np.eye(10)])  # (10, 4, 4): J = phi . basis


def physical_estimate(estimate: LoadEstimate) -> LoadEstimate:
    """The estimate itself if it is physical, else with the nearest physical parameters.

    The covariance and the intervals remain those of least squares, which the truth still satisfies. Without an
    inertia only the mass is to be positive.

    Raises:
        LabError: mass or centre of mass are not identified.
    """
    if not np.isfinite(estimate.phi[:4]).all():
        raise LabError("mass and centre of mass are not identified: there is nothing to make physical; add poses")
    if estimate.physical:
        return estimate
    if not np.isfinite(estimate.phi).all():
        return replace(estimate, phi=_positive_mass(estimate.phi, estimate.covariance))
    return replace(estimate, phi=nearest_physical(estimate.phi, estimate.covariance))


def nearest_physical(phi: Array, covariance: Array) -> Array:
    """The minimum of (x - phi)' C^-1 (x - phi) / 2 - w log det J(x), from a large w down to ``PRIOR``.

    The function is convex and its barrier self-concordant: Newton's steps, halved while they leave the set or do not
    descend, converge from any start in it (Boyd & Vandenberghe 2004, section 9.6).
    """
    scale = np.sqrt(np.diag(covariance))
    root = np.linalg.inv(np.linalg.cholesky(covariance / np.outer(scale, scale))) / scale  # C^-1 = root' root
    x = _inside(phi)
    weight = max(_PRIOR, float(np.sum((root @ (x - phi)) ** 2)))
    while True:
        x = _descended(x, phi, root, weight)
        if weight <= _PRIOR:
            return x
        weight = max(weight * _FALL, _PRIOR)


def _descended(x: Array, phi: Array, root: Array, weight: float) -> Array:
    """The minimum at one weight of the prior."""

    def value(x: Array) -> float:
        factor = _factor(x)
        if factor is None:
            return np.inf
        misfit = root @ (x - phi)
        return float(misfit @ misfit / 2 - 2 * weight * np.log(np.diag(factor)).sum())

    for _ in range(_STEPS):
        factor = _factor(x)
        assert factor is not None
        inverse = np.linalg.inv(factor)
        whitened = inverse @ _BASIS @ inverse.T  # (10, 4, 4): d log det J = trace
        flat = np.sqrt(weight) * whitened.reshape(10, 16).T
        # least squares of both parts at once: its normal equations are Newton's
        rows = np.concatenate([root, flat])
        target = np.concatenate([root @ (phi - x), np.sqrt(weight) * np.eye(4).ravel()])
        step = least_squares_step(rows, target)
        slope = float(np.sum((rows @ step) ** 2))
        if slope / 2 < _SETTLED * weight:
            return x
        now, length = value(x), 1.0
        while value(x + length * step) > now - 0.1 * length * slope and length > 1e-10:
            length /= 2
        if length <= 1e-10:  # rounding: no descent is left
            return x
        x = x + length * step
    return x


def _factor(x: Array) -> Array | None:
    """U with J = U U', upper triangular with a positive diagonal; None outside the set."""
    try:
        lower = np.linalg.cholesky(pseudo_inertia(x)[::-1, ::-1])
    except np.linalg.LinAlgError:
        return None
    return np.asarray(lower[::-1, ::-1])


def _inside(phi: Array) -> Array:
    """A physical load near: eigenvalues of J, with lengths in the load's own size, raised to a thousandth."""
    mass = max(abs(phi[0]), 1e-6)
    size = np.sqrt(max(np.abs(phi[4:7]).max() / mass, float(phi[1:4] @ phi[1:4]) / mass**2, 1e-8))
    unit = np.array([size, size, size, 1.0]) * np.sqrt(mass)
    sizes, axes = np.linalg.eigh(pseudo_inertia(phi) / np.outer(unit, unit))
    matrix = (axes * np.maximum(sizes, 1e-3)) @ axes.T * np.outer(unit, unit)
    flat: Array = np.linalg.lstsq(_BASIS.reshape(10, 16).T, matrix.ravel(), rcond=None)[0]
    assert is_physical(flat)
    return flat


def _positive_mass(phi: Array, covariance: Array) -> Array:
    """Mass and first moment alone: the mass raised to a little of its sigma, the moment where it then is best."""
    raised = _PRIOR * np.sqrt(covariance[0, 0]) - phi[0]
    moved = phi.copy()
    moved[:4] += covariance[:4, 0] / covariance[0, 0] * raised
    return moved


assert len(LOAD) == len(_BASIS)
