"""Distribution functions of test statistics, as in ``scipy.stats``, which is slow to import.

``sf`` is the survival function, ``cdf`` the distribution function, ``isf`` the upper and ``ppf`` the lower quantile.
Arguments broadcast.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy  # its special functions are loaded at their first use
from numpy.typing import ArrayLike

from lab.core.errors import LabError
from lab.core.se3 import Array

__all__ = [
    "DistributionName",
    "Uncertain",
    "beta_ppf",
    "binomial_cdf",
    "chi2_isf",
    "chi2_ppf",
    "chi2_sf",
    "f_cdf",
    "f_isf",
    "f_sf",
    "normal_ppf",
    "normal_sf",
    "t_isf",
    "t_ppf",
    "t_sf",
]

DistributionName = Literal["normal", "rectangular", "triangular", "arcsine"]
_MIN_DOF = 3.0  # smallest accepted: Student's t has a variance above 2, which grows without bound towards it


@dataclass(frozen=True)
class Uncertain:
    """A quantity whose best estimate is zero (JCGM 100:2008, 4.3; JCGM 101:2008, 6.4).

    Attributes:
        standard: standard uncertainty, in the quantity's SI unit.
        distribution: a normal one with finite ``dof`` is drawn as Student's t.
        dof: degrees of freedom of the standard uncertainty.
    """

    standard: float = 0.0
    distribution: DistributionName = "normal"
    dof: float = np.inf

    def __post_init__(self) -> None:
        if not 0 <= self.standard < np.inf:
            raise LabError(f"a standard uncertainty of {self.standard:g}: give a finite one of zero or more")
        if not self.dof >= _MIN_DOF:
            raise LabError(f"degrees of freedom = {self.dof:g}: give {_MIN_DOF:g} or more, or leave it out")
        if np.isfinite(self.dof) and self.distribution != "normal":
            raise LabError(f"degrees of freedom go with a normal distribution, not with a {self.distribution} one")

    @classmethod
    def within(cls, limit: float, distribution: DistributionName = "rectangular") -> "Uncertain":
        """Return a quantity between minus and plus a limit."""
        if distribution == "normal":
            raise LabError("a normal distribution has no limits; give its standard uncertainty")
        return cls(limit / _LIMITS[distribution], distribution)

    @property
    def limit(self) -> float:
        """The largest value; infinite for a normal distribution."""
        return np.inf if self.distribution == "normal" else self.standard * _LIMITS[self.distribution]

    def sample(self, rng: np.random.Generator, shape: int | tuple[int, ...]) -> Array:
        """Draw values."""
        if self.distribution == "normal":
            if np.isinf(self.dof):
                return self.standard * rng.standard_normal(shape)
            return np.asarray(self.standard * rng.standard_t(self.dof, shape))
        if self.distribution == "rectangular":
            return rng.uniform(-self.limit, self.limit, shape)
        if self.distribution == "triangular":
            return self.limit * (rng.random(shape) - rng.random(shape))
        return np.asarray(self.limit * np.sin(2 * np.pi * rng.random(shape)))


_LIMITS = {"rectangular": np.sqrt(3.0), "triangular": np.sqrt(6.0), "arcsine": np.sqrt(2.0)}  # over the standard one


def normal_sf(x: ArrayLike) -> Array:
    """Survival function of the standard normal distribution."""
    return np.asarray(scipy.special.ndtr(-np.asarray(x, dtype=np.float64)))


def normal_ppf(p: ArrayLike) -> Array:
    """Quantile of the standard normal distribution."""
    return np.asarray(scipy.special.ndtri(p))


def t_sf(x: ArrayLike, dof: ArrayLike) -> Array:
    """Survival function of Student's t."""
    return np.asarray(scipy.special.stdtr(dof, -np.asarray(x, dtype=np.float64)))


def t_ppf(p: ArrayLike, dof: ArrayLike) -> Array:
    """Quantile of Student's t."""
    return np.asarray(scipy.special.stdtrit(dof, p))


def t_isf(p: ArrayLike, dof: ArrayLike) -> Array:
    """Upper quantile of Student's t."""
    return -t_ppf(p, dof)


def chi2_sf(x: ArrayLike, dof: ArrayLike) -> Array:
    """Survival function of chi squared, one below zero."""
    return np.asarray(scipy.special.chdtrc(dof, np.maximum(x, 0.0)))


def chi2_isf(p: ArrayLike, dof: ArrayLike) -> Array:
    """Upper quantile of chi squared."""
    return np.asarray(scipy.special.chdtri(dof, p))


def chi2_ppf(p: ArrayLike, dof: ArrayLike) -> Array:
    """Quantile of chi squared."""
    return np.asarray(2 * scipy.special.gammaincinv(np.asarray(dof) / 2, p))


def f_sf(x: ArrayLike, first: ArrayLike, second: ArrayLike) -> Array:
    """Survival function of F with degrees of freedom of numerator and denominator; one below zero."""
    return np.asarray(scipy.special.fdtrc(first, second, np.maximum(x, 0.0)))


def f_cdf(x: ArrayLike, first: ArrayLike, second: ArrayLike) -> Array:
    """Distribution function of F."""
    return np.asarray(scipy.special.fdtr(first, second, np.maximum(x, 0.0)))


def f_isf(p: ArrayLike, first: ArrayLike, second: ArrayLike) -> Array:
    """Upper quantile of F."""
    return np.asarray(1 / scipy.special.fdtri(second, first, p))


def beta_ppf(p: ArrayLike, first: ArrayLike, second: ArrayLike) -> Array:
    """Quantile of the beta distribution."""
    return np.asarray(scipy.special.betaincinv(first, second, p))


def binomial_cdf(count: ArrayLike, trials: ArrayLike, chance: ArrayLike) -> Array:
    """Probability of at most ``count`` successes, from -1 on, among trials."""
    below = np.floor(np.asarray(count, dtype=np.float64))
    return np.asarray(np.where(below < 0, 0.0, scipy.special.bdtr(np.maximum(below, 0), trials, chance)))
