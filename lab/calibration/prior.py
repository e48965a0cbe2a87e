"""Prior of the parameters from manufacturing tolerances, and the most likely arm (MAP).

Tolerances of manufacture are a normal prior of *all* parameters. Of the base set it is the prior of
what those are: an error of a fixed parameter goes into them, so theirs are wider, and correlated.
Whichever representative of an aliased group is kept, the prior, the posterior and the arm that is
lifted from it are the same.

A prior of all parameters pulls what is well measured, too, if an arm is far outside its tolerances. So an automatic
prior acts only along directions that the measurements hardly determine, and the size of the tolerances is estimated
from all directions, each as well as it is measured (empirical Bayes: Efron & Morris 1973).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.calibration.gauss_newton import ExtraResiduals
from lab.core.se3 import Array
from lab.kinematics.effects.range_errors import RANGE
from lab.kinematics.gauge import BaseSet
from lab.kinematics.model import Model
from lab.kinematics.parameter import SIZE, TOLERANCE_M, TOLERANCE_RAD

__all__ = [
    "ActingPrior",
    "Prior",
    "PriorDirections",
    "Tolerance",
    "alias_matrix",
    "directions_of",
    "prior_of",
    "standard_deviations",
]

_WEAK = 1.0  # of a direction's prior standard deviation: measured better, a direction is not weak
_SCALES = np.geomspace(1.0, 1e4, 369)  # of the tolerances as they are given, by 2.5 %: none is below one
_NO_SLOPE = 1e-12  # of the largest singular value: below, there is none


@dataclass(frozen=True)
class Tolerance:
    """Manufacturing tolerance: one standard deviation of lengths and of angles of the links.

    Twists between nominally parallel axes have a larger one, by the same share (``link_parameter``).
    """

    length_m: float = TOLERANCE_M
    angle_rad: float = TOLERANCE_RAD


@dataclass(frozen=True)
class Prior:
    """Normal distribution of those parameters of the base set that have a tolerance.

    Attributes:
        of: indices ``(m,)`` of the parameters it is of.
        whiten: ``(m, m)`` the inverse of the covariance's Cholesky factor.
    """

    mean: Array
    of: tuple[int, ...]
    whiten: Array

    def rows(self, sigma: float) -> ExtraResiduals:
        """Return the prior as residuals beside measurements that weigh as one over ``sigma`` of theirs."""
        jacobian = np.zeros((len(self.of), len(self.mean)))
        jacobian[:, list(self.of)] = self.whiten * sigma
        return lambda values: (jacobian @ (self.mean - values), jacobian)

    def knows_less(self, covariance: Array) -> bool:
        """Decide whether measurements of this covariance ``(m, m)`` are better in every direction, at any scale."""
        return bool(np.trace(self.whiten @ covariance @ self.whiten.T) < _WEAK**2)

    def surprise(self, values: Array) -> Array:
        """Return the deviation of each parameter of ``of`` from nominal ``(m,)``, in its own standard deviations."""
        covariance = np.linalg.inv(self.whiten.T @ self.whiten)
        off: Array = (values - self.mean)[list(self.of)] / np.sqrt(np.diag(covariance))
        return off


@dataclass(frozen=True)
class ActingPrior:
    """A prior as it takes part in a fit: along some directions, at some scale of the tolerances.

    Attributes:
        names: of the parameters ``(p,)``.
        rows_by_parameter: ``(w, p)`` of each direction, in its prior standard deviations.
        scale: the tolerances that it takes, in those that were given.
        scale_from: how many well measured directions the scale was estimated from; none where it was not.
        directions: how many there are in all.
        plain_condition: the condition number of the measurements' Jacobian alone.
        automatic: whether directions and scale were found from the measurements.
    """

    names: tuple[str, ...]
    mean: Array
    rows_by_parameter: Array
    scale: float
    scale_from: int
    directions: int
    plain_condition: float
    automatic: bool = True

    @property
    def acts_in(self) -> int:
        """Count the directions in which the prior acts."""
        return len(self.rows_by_parameter)

    def rows(self, sigma: float, names: Sequence[str] | None = None) -> ExtraResiduals:
        """Return the prior as residuals beside measurements that weigh as one over ``sigma`` of theirs.

        Args:
            names: of another model's parameters, among which are these; by default of this one's.
        """
        jacobian, mean = self.rows_by_parameter * sigma, self.mean
        if names is not None and tuple(names) != self.names:
            at = {name: i for i, name in enumerate(self.names)}
            of = [at.get(name, -1) for name in names]  # the last column, of zeros, for parameters without a prior
            jacobian = np.column_stack([jacobian, np.zeros(len(jacobian))])[:, of]
            mean = np.append(mean, 0.0)[of]
        return lambda values: (jacobian @ (mean - values), jacobian)


@dataclass(frozen=True)
class PriorDirections:
    """Directions of the parameters with a prior, independent of each other by prior and by measurements.

    Attributes:
        by_parameter: ``(m, p)`` of each direction: parameters to its prior standard deviations.
        stds: ``(m,)`` of its measurement, whatever the parameters without a prior are; infinite where there is none.
        values: ``(m,)`` where the measurements alone place the parameters along it, from the prior's mean.
    """

    by_parameter: Array
    stds: Array
    values: Array

    def weak(self, scale: float) -> NDArray[np.bool_]:
        """Check ``(m,)`` which parameters are measured hardly better than a prior of this scale determines them."""
        return np.asarray(self.stds > _WEAK * scale)

    def left_by_prior(self, scale: float) -> float:
        """Return the degrees of freedom that a prior of this scale takes from the fit."""
        stds = self.stds[self.weak(scale)]
        return float(np.sum(1 / (1 + (scale / stds) ** 2)))

    def scale(self) -> tuple[float, int]:
        """Return the most likely scale, at least one, and the number of directions measured better than that.

        Of the marginal likelihood: a value is normal with the variance of the tolerances and that of its measurement.
        """
        determined = np.isfinite(self.stds)
        variance = _SCALES[:, None] ** 2 + self.stds[determined] ** 2
        scale = float(_SCALES[np.argmin((np.log(variance) + self.values[determined] ** 2 / variance).sum(axis=1))])
        return scale, int((self.stds < scale).sum())


def directions_of(
    prior: Prior, triangle: Array, right: Array, columns: Sequence[int], values: Array
) -> PriorDirections:
    """Return directions in which prior and measurements are both diagonal (a generalized SVD).

    Args:
        triangle: ``(r, c)`` R of the measurements' rows, as the prior weighs beside them.
        right: ``(r,)`` Q'r of the residuals at ``values``, weighed alike.
        columns: the parameters ``(c,)`` of its columns, those of the prior among them.
        values: ``(p,)``.
    """
    links = [columns.index(i) for i in prior.of]
    others = [j for j in range(len(columns)) if j not in set(links)]
    slopes = triangle[:, links]
    if others:
        basis, sizes, _ = np.linalg.svd(_unit(triangle[:, others]), full_matrices=False)
        basis = basis[:, sizes > _NO_SLOPE * sizes.max(initial=0.0)]
        slopes, right = slopes - basis @ (basis.T @ slopes), right - basis @ (basis.T @ right)
    left, sizes, turn = np.linalg.svd(np.linalg.solve(prior.whiten.T, slopes.T).T)
    toward = np.zeros(len(links))
    toward[: len(sizes)] = left[:, : len(sizes)].T @ right
    sizes = np.append(sizes, np.zeros(len(links) - len(sizes)))
    floor = _NO_SLOPE * max(float(sizes.max(initial=0.0)), 1e-300)
    stds = np.where(sizes > floor, 1 / np.maximum(sizes, floor), np.inf)
    rows = np.zeros((len(links), len(values)))
    rows[:, list(prior.of)] = turn @ prior.whiten
    measured = rows @ (values - prior.mean) + toward * np.where(np.isfinite(stds), stds, 0.0)
    return PriorDirections(rows, stds, measured)


def _unit(columns: Array) -> Array:
    size = np.linalg.norm(columns, axis=0)
    return np.asarray(columns / np.where(size > 0, size, 1.0))


def standard_deviations(model: Model, tolerance: Tolerance) -> Array:
    """Return the standard deviations ``(p,)``: tolerances of links, sizes of effects, else infinite.

    The prior of an artefact's size is the observation's own: here it has none.
    """
    shares = {True: tolerance.angle_rad / TOLERANCE_RAD, False: tolerance.length_m / TOLERANCE_M}
    sizes = [np.inf if each.group == SIZE else each.scale for each in model.parameters]
    factors = [shares[each.is_angle] if each.is_link else 1.0 for each in model.parameters]
    return np.asarray(np.array(sizes) * np.array(factors))


def prior_of(
    model: Model, structure: BaseSet, nominal: Array, tolerance: Tolerance, *, links_alone: bool = False
) -> Prior:
    """Return the prior of the base set that the tolerances of all parameters make.

    What has no nominal value (base, tool, fixtures) has no prior; an error of a link that goes into it alone is
    uninformative. Range errors of the instrument have one of their own (``weights.weighted_constraints``).

    Args:
        links_alone: whether effects have none either; tests decide whether there are any.
    """
    sigma = standard_deviations(model, tolerance)
    sigma[[each.group == RANGE for each in model.parameters]] = np.inf
    if links_alone:
        sigma[[not each.is_link for each in model.parameters]] = np.inf
    of = tuple(i for i in structure.identifiable if np.isfinite(sigma[i]))
    drawn = np.isfinite(sigma)
    wide = alias_matrix(structure, len(model.names))[[structure.identifiable.index(i) for i in of]][:, drawn]
    covariance = (wide * sigma[drawn] ** 2) @ wide.T
    size = np.sqrt(np.diag(covariance))
    factor = np.linalg.cholesky(covariance / np.outer(size, size))
    return Prior(nominal, of, np.linalg.inv(factor) / size)


def alias_matrix(structure: BaseSet, count: int) -> Array:
    """Return B ``(kept, p)``, the effect of all parameters' errors on the kept ones, ``z = B x``."""
    wide = np.zeros((len(structure.identifiable), count))
    wide[:, list(structure.identifiable)] = np.eye(len(structure.identifiable))
    wide[:, list(structure.fixed)] = structure.alias
    return wide
