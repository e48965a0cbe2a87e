"""What manufacture says of the parameters before anything is measured, and the arm it makes most likely.

A drawing's tolerances are a normal prior of *all* parameters. Of the base set it is the prior of
what those are: an error of a fixed parameter goes into them, so theirs are wider, and correlated.
Whichever representative of an aliased group is kept, the prior, the posterior and the arm that is
lifted from it are the same.
"""

from dataclasses import dataclass

import numpy as np

from lab.calibration.locate import columns_of
from lab.calibration.solver import Further
from lab.frames import Array
from lab.geometry.gauge import BaseSet
from lab.geometry.model import Model, unit_of

ANYWHERE = 1e3  # standard deviation, m or rad, of what has no drawing
EFFECTS = {"rad": 1e-3, "m": 1e-3, "rad/Nm": 1e-4, "m/N": 1e-4, "": 1e-3, "kg": 10.0}


@dataclass(frozen=True)
class Tolerance:
    """One standard deviation of manufacture, of lengths and of angles of the links."""

    length_m: float = 0.5e-3
    angle_rad: float = 1.5e-3


@dataclass(frozen=True)
class Prior:
    """Normal, of the base set.

    Attributes:
        mean: ``(p,)``.
        kept: indices ``(f,)`` of the base set.
        whiten: ``(f, f)`` the inverse of the covariance's Cholesky factor.
    """

    mean: Array
    kept: tuple[int, ...]
    whiten: Array

    def rows(self, sigma: float) -> Further:
        """The prior as residuals beside measurements that weigh as one over ``sigma`` of theirs."""
        jacobian = np.zeros((len(self.kept), len(self.mean)))
        jacobian[:, list(self.kept)] = self.whiten * sigma
        return lambda values: (jacobian @ (self.mean - values), jacobian)


def standard_deviations(model: Model, tolerance: Tolerance, placed: tuple[str, ...]) -> Array:
    """One standard deviation ``(p,)`` of each parameter: tolerances of links, effects' sizes, else anywhere."""
    anywhere = set(columns_of(model, placed))
    sigma = np.empty(len(model.names))
    for i, name in enumerate(model.names):
        unit = unit_of(name)
        if i in anywhere:
            sigma[i] = ANYWHERE
        elif name.startswith("link"):
            sigma[i] = tolerance.angle_rad if unit == "rad" else tolerance.length_m
        else:
            sigma[i] = EFFECTS.get(unit, ANYWHERE)
    return sigma


def prior_of(model: Model, structure: BaseSet, nominal: Array, tolerance: Tolerance, placed: tuple[str, ...]) -> Prior:
    """The prior of the base set that the tolerances of all parameters make."""
    sigma, wide = standard_deviations(model, tolerance, placed), gather(structure, len(model.names))
    covariance = (wide * sigma**2) @ wide.T
    size = np.sqrt(np.diag(covariance))
    factor = np.linalg.cholesky(covariance / np.outer(size, size))
    return Prior(nominal, structure.kept, np.linalg.inv(factor) / size)


def gather(structure: BaseSet, count: int) -> Array:
    """B ``(kept, p)``: what errors of all parameters look like in the kept ones, ``z = B x``."""
    wide = np.zeros((len(structure.kept), count))
    wide[:, list(structure.kept)] = np.eye(len(structure.kept))
    wide[:, list(structure.fixed)] = structure.alias
    return wide
