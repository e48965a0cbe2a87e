"""What uncertainty the parameters leave in position, and how a pose maps parameters to positions."""

from dataclasses import dataclass

import numpy as np

from lab.calibration.identify import Identification
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
    """The ellipsoids ``x' S^-1 x = 1`` of symmetric matrices S ``(n, 3, 3)``."""
    sizes, axes = np.linalg.eigh(squares)
    axes, sizes = axes[..., ::-1].copy(), sizes[..., ::-1]
    axes[np.linalg.det(axes) < 0, :, 2] *= -1
    return Ellipsoids(axes, np.sqrt(np.maximum(sizes, 0.0)))


def mapping_ellipsoids(identification: Identification, joints: Array, target: int = 0) -> Ellipsoids:
    """Onto what each pose's Jacobian maps the unit ball of scaled parameters (thesis fig. II.1).

    Parameters are scaled as in the solution: so that over all measured poses each moves the
    whitened points alike. Lengths are those of the positions in m per unit.
    """
    jacobian = _free_jacobian(identification, joints, target) / identification.fit.scale
    return ellipsoids(jacobian @ np.swapaxes(jacobian, 1, 2))


def position_covariance(identification: Identification, joints: Array, target: int = 0) -> Array:
    """Covariance ``(n, 3, 3)`` in m^2 of the identified arm's position of a target: J C J'."""
    jacobian = _free_jacobian(identification, joints, target)
    covariance: Array = jacobian @ identification.covariance @ np.swapaxes(jacobian, 1, 2)
    return covariance


def _free_jacobian(identification: Identification, joints: Array, target: int) -> Array:
    _, jacobian = identification.model.observe(joints, identification.values)
    return jacobian[:, target][..., list(identification.fit.free)]
