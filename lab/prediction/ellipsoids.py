"""Draw what a fit determines as ellipsoids: images of the parameters' unit ball, and covariances of positions."""

from dataclasses import dataclass

import numpy as np

from lab.calibration.identification import Identification
from lab.core.se3 import Array

__all__ = ["Ellipsoids", "ellipsoids", "mapping_ellipsoids", "position_covariance"]


@dataclass(frozen=True)
class Ellipsoids:
    """Centred ellipsoids, one a row.

    Attributes:
        axes: ``(n, 3, 3)``, columns the unit half-axes' directions, right-handed.
        half_lengths: ``(n, 3)``, descending.
    """

    axes: Array
    half_lengths: Array


def ellipsoids(squares: Array) -> Ellipsoids:
    """Return the ellipsoids ``x' S^-1 x = 1`` of symmetric matrices S ``(n, 3, 3)``."""
    sizes, axes = np.linalg.eigh(squares)
    axes, sizes = axes[..., ::-1].copy(), sizes[..., ::-1]
    axes[np.linalg.det(axes) < 0, :, 2] *= -1
    return Ellipsoids(axes, np.sqrt(np.maximum(sizes, 0.0)))


def mapping_ellipsoids(identification: Identification, joints: Array, target: int = 0) -> Ellipsoids:
    """Return the images of the unit ball of scaled parameters under each pose's Jacobian (thesis fig. II.1).

    Parameters are scaled as in the solution: so that over all measured poses each moves the whitened points alike.
    Lengths are those of the positions in m per unit.
    """
    jacobian = _free_jacobian(identification, joints, target) / identification.fit.scale
    return ellipsoids(jacobian @ np.swapaxes(jacobian, 1, 2))


def position_covariance(identification: Identification, joints: Array, target: int = 0) -> Array:
    """Return the covariance ``(n, 3, 3)`` in m^2 of the identified position of a target: J C J'."""
    jacobian = _free_jacobian(identification, joints, target)
    covariance: Array = jacobian @ identification.covariance @ np.swapaxes(jacobian, 1, 2)
    return covariance


def _free_jacobian(identification: Identification, joints: Array, target: int) -> Array:
    _, jacobian = identification.model.observe(joints, identification.values)
    return jacobian[:, target][..., list(identification.fit.free)]
