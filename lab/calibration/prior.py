"""What manufacture says of the parameters before anything is measured, and the arm it makes most likely.

Tolerances of manufacture are a normal prior of *all* parameters. Of the base set it is the prior of
what those are: an error of a fixed parameter goes into them, so theirs are wider, and correlated.
Whichever representative of an aliased group is kept, the prior, the posterior and the arm that is
lifted from it are the same.
"""

from dataclasses import dataclass

import numpy as np

from lab.calibration.gauss_newton import ExtraResiduals
from lab.core.se3 import Array
from lab.kinematics.gauge import BaseSet
from lab.kinematics.model import Model
from lab.kinematics.parameter import TOLERANCE_M, TOLERANCE_RAD

__all__ = ["Prior", "Tolerance", "alias_matrix", "prior_of", "standard_deviations"]


@dataclass(frozen=True)
class Tolerance:
    """One standard deviation of manufacture, of lengths and of angles of the links."""

    length_m: float = TOLERANCE_M
    angle_rad: float = TOLERANCE_RAD


@dataclass(frozen=True)
class Prior:
    """A normal distribution of those parameters of the base set that have a tolerance; of the rest nothing is known.

    Attributes:
        mean: ``(p,)``.
        of: indices ``(m,)`` of the parameters it is of.
        whiten: ``(m, m)`` the inverse of the covariance's Cholesky factor.
    """

    mean: Array
    of: tuple[int, ...]
    whiten: Array

    def rows(self, sigma: float) -> ExtraResiduals:
        """The prior as residuals beside measurements that weigh as one over ``sigma`` of theirs."""
        jacobian = np.zeros((len(self.of), len(self.mean)))
        jacobian[:, list(self.of)] = self.whiten * sigma
        return lambda values: (jacobian @ (self.mean - values), jacobian)

    def surprise(self, values: Array) -> Array:
        """How far each parameter of ``of`` is from its nominal value ``(m,)``, in its own standard deviations."""
        covariance = np.linalg.inv(self.whiten.T @ self.whiten)
        off: Array = (values - self.mean)[list(self.of)] / np.sqrt(np.diag(covariance))
        return off


def standard_deviations(model: Model, tolerance: Tolerance) -> Array:
    """One standard deviation ``(p,)`` of each parameter: tolerances of links, sizes of effects, else infinite."""
    links = {True: tolerance.angle_rad, False: tolerance.length_m}
    return np.array([links[each.is_angle] if each.is_link else each.scale for each in model.parameters])


def prior_of(model: Model, structure: BaseSet, nominal: Array, tolerance: Tolerance) -> Prior:
    """The prior of the base set that the tolerances of all parameters make.

    What has no nominal value (base, tool, fixtures) has no prior; an error of a link that goes into it alone tells
    nothing.
    """
    sigma = standard_deviations(model, tolerance)
    of = tuple(i for i in structure.kept if np.isfinite(sigma[i]))
    drawn = np.isfinite(sigma)
    wide = alias_matrix(structure, len(model.names))[[structure.kept.index(i) for i in of]][:, drawn]
    covariance = (wide * sigma[drawn] ** 2) @ wide.T
    size = np.sqrt(np.diag(covariance))
    factor = np.linalg.cholesky(covariance / np.outer(size, size))
    return Prior(nominal, of, np.linalg.inv(factor) / size)


def alias_matrix(structure: BaseSet, count: int) -> Array:
    """B ``(kept, p)``: what errors of all parameters look like in the kept ones, ``z = B x``."""
    wide = np.zeros((len(structure.kept), count))
    wide[:, list(structure.kept)] = np.eye(len(structure.kept))
    wide[:, list(structure.fixed)] = structure.alias
    return wide
