"""The nearest load that a body can be, with a positive definite pseudo-inertia, by the estimate's covariance."""

from dataclasses import replace

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.dynamics.rigid_body import is_physical, pseudo_inertia
from lab.payload_identification.body_cone import BASIS, BodyCone, Nearest
from lab.payload_identification.estimate import LoadEstimate

__all__ = ["nearest_physical", "physical_estimate"]

_LEAST = 1e-4  # of the mass's standard deviation, which it is raised to where it was not positive


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
        return replace(estimate, phi=_positive_mass(estimate.phi, estimate.covariance), moved=True)
    return replace(estimate, phi=nearest_physical(estimate.phi, estimate.covariance), moved=True)


def nearest_physical(phi: Array, covariance: Array) -> Array:
    """The nearest load that a body can be, by the covariance ``(10, 10)`` (``body_cone``)."""
    scale = np.sqrt(np.diag(covariance))
    root = np.linalg.inv(np.linalg.cholesky(covariance / np.outer(scale, scale))) / scale  # C^-1 = root' root
    cone = BodyCone(np.arange(10)[None], np.empty(0, dtype=np.int_))
    return cone.nearest(Nearest(np.eye(10), phi, root), _inside(phi))


def _inside(phi: Array) -> Array:
    """A physical load near: eigenvalues of J, with lengths in the load's own size, raised to a thousandth."""
    mass = max(abs(phi[0]), 1e-6)
    size = np.sqrt(max(np.abs(phi[4:7]).max() / mass, float(phi[1:4] @ phi[1:4]) / mass**2, 1e-8))
    unit = np.array([size, size, size, 1.0]) * np.sqrt(mass)
    sizes, axes = np.linalg.eigh(pseudo_inertia(phi) / np.outer(unit, unit))
    matrix = (axes * np.maximum(sizes, 1e-3)) @ axes.T * np.outer(unit, unit)
    flat: Array = np.linalg.lstsq(BASIS.reshape(10, 16).T, matrix.ravel(), rcond=None)[0]
    assert is_physical(flat)
    return flat


def _positive_mass(phi: Array, covariance: Array) -> Array:
    """Mass and first moment alone: the mass raised to a little of its sigma, the moment where it then is best."""
    raised = _LEAST * np.sqrt(covariance[0, 0]) - phi[0]
    moved = phi.copy()
    moved[:4] += covariance[:4, 0] / covariance[0, 0] * raised
    return moved
